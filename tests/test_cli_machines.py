"""The commands of machines as a user types them: what they print where, what they write, and what they refuse."""

from __future__ import annotations

import csv
import gzip
import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from browser import needs_browser
from commands import run, run_process

import rodgen
from rodgen.calibration.solve.least_squares import minimise
from rodgen.cli import main as cli
from rodgen.machines.templates import machine_template

EXAMPLES = Path(__file__).parent.parent / "examples" / "machines"
NAMES = sorted(path.parent.name for path in EXAMPLES.glob("*/machine.toml"))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work where a user does: the telescope's files in the current folder."""
    shutil.copy(EXAMPLES / "mount" / "machine.toml", tmp_path / "mount.toml")
    shutil.copy(EXAMPLES / "mount" / "mmt_2021.csv", tmp_path / "stars.csv")
    shutil.copy(EXAMPLES / "rotary_table" / "machine.toml", tmp_path / "table.toml")
    shutil.copy(EXAMPLES / "rotary_table" / "data.csv", tmp_path / "balls.csv")
    (tmp_path / "empty.csv").write_text("AZ [deg],EL [deg],ux,uy,uz\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def rows(path):
    content = Path(path).read_bytes()
    text = (gzip.decompress(content) if str(path).endswith(".gz") else content).decode()
    header, *body = csv.reader(text.splitlines())
    return header, body


# fit ---------------------------------------------------------------------------------------------------


def test_fit_prints_json_and_nothing_else(folder, rodgen_command):
    code, out, err = rodgen_command("fit", "mount.toml", "stars.csv", "--json")
    found = json.loads(out)
    assert (code, err) == (0, "")
    assert round(found["rms"], 3) == 2.711
    assert found["unit"] == "arcsec"
    assert set(found["parameters"]["AZ.axis.a"]) == {
        "value",
        "std",
        "unit",
        "held",
        "determined",
        "convention",
        "at_bound",
    }


def test_fit_without_a_spare_reading_is_json_all_the_same(folder, rodgen_command):
    lines = (folder / "stars.csv").read_text().splitlines()
    (folder / "three.csv").write_text("\n".join(lines[:4]) + "\n")
    code, out, _ = rodgen_command("fit", "mount.toml", "three.csv", "--json")
    assert code == 0
    assert json.loads(out, parse_constant=pytest.fail)["degrees_of_freedom"] == 0


@pytest.mark.thorough
def test_loading_a_compiled_model_imports_no_sympy(folder):
    assert run_process("fit", "mount.toml", "stars.csv").returncode == 0
    code = (
        "import sys, rodgen.cli.main\n"
        "assert rodgen.cli.main.main(['fit', 'mount.toml', 'stars.csv']) == 0\n"
        "heavy = {'sympy', 'matplotlib', 'plotly', 'pint', 'jinja2', 'tqdm'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


@pytest.mark.thorough("mount", "gantry_rotary", "ballbar_gantry")
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow) if n in ("robot_6r_tracker", "tricept") else n for n in NAMES],
)
def test_a_fitted_machine_predicts_what_the_fit_predicted(name, tmp_path, rodgen_command):
    machine = EXAMPLES / name / "machine.toml"
    (data,) = (EXAMPLES / name).glob("*.csv")
    code, out, _ = rodgen_command("fit", machine, data, "-o", tmp_path / "fitted.toml", "--json")
    first = json.loads(out)
    assert code == 0
    code, out, _ = rodgen_command("fit", tmp_path / "fitted.toml", data, "--json")
    second = json.loads(out)
    assert code == 0
    # The file holds every bit; a free frame is fitted again, to a part of its uncertainty.
    assert second["rms"] == pytest.approx(first["rms"], rel=1e-7)
    assert all(p["held"] or key.startswith("frame.") for key, p in second["parameters"].items())


def test_residuals_are_in_the_rows_that_they_belong_to(folder, rodgen_command):
    code, out, err = rodgen_command("fit", "table.toml", "balls.csv", "--residuals", "left.csv", "--json")
    assert (code, err) == (0, "")
    before, after = rows("balls.csv"), rows("left.csv")
    assert after[0][: len(before[0])] == before[0]
    assert after[0][len(before[0]) :] == [
        "predicted_x [mm]", "predicted_y [mm]", "predicted_z [mm]",
        "residual_x [mm]", "residual_y [mm]", "residual_z [mm]", "outlier",
    ]  # fmt: skip
    assert [row[: len(before[0])] for row in after[1]] == before[1]
    numbers = np.array([[float(cell) for cell in row[2:5] + row[6:12]] for row in after[1]])
    read, predicted, residual = numbers[:, :3], numbers[:, 3:6], numbers[:, 6:]
    assert read - predicted == pytest.approx(residual, abs=1e-12)
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(json.loads(out)["rms"], rel=1e-12)


def test_residuals_are_in_the_unit_of_the_readings(folder, rodgen_command):
    text = (folder / "balls.csv").read_text().replace("x [mm]", "x [um]", 1)
    header, *lines = text.splitlines()
    cells = [line.split(",") for line in lines]
    micron = [[*row[:2], f"{float(row[2]) * 1000:.1f}", *row[3:]] for row in cells]
    (folder / "micron.csv").write_text("\n".join([header, *map(",".join, micron)]) + "\n")
    for name in ("balls", "micron"):
        assert rodgen_command("fit", "table.toml", f"{name}.csv", "--residuals", f"{name}.csv.gz")[0] == 0
    (names, one), (_, other) = rows("micron.csv.gz"), rows("balls.csv.gz")
    assert names[6] == "predicted_x [um]"
    assert [float(row[9]) for row in one] == pytest.approx([1000 * float(row[9]) for row in other], abs=1e-6)


def test_residuals_of_directions_are_angles(folder, rodgen_command):
    assert rodgen_command("fit", "mount.toml", "stars.csv", "--residuals", "left.parquet")[0] == 0
    table = pq.read_table("left.parquet").to_pydict()
    read, predicted = (np.stack([table[p + x] for x in ("ux", "uy", "uz")], -1) for p in ("", "predicted_"))
    read /= np.linalg.norm(read, axis=1, keepdims=True)
    angle = 2 * np.arcsin(np.linalg.norm(read - predicted, axis=1) / 2) * 648000 / np.pi
    parts = np.hypot(table["residual_horizontal [arcsec]"], table["residual_vertical [arcsec]"])
    assert parts == pytest.approx(angle, rel=1e-6)
    # seen higher than predicted: the vertical part is positive
    up = (read - predicted)[:, 2] * 648000 / np.pi / np.sqrt(1 - read[:, 2] ** 2)
    assert table["residual_vertical [arcsec]"] == pytest.approx(up, abs=0.01)


def test_fit_reads_standard_input(folder):
    done = run("fit", "mount.toml", "-", stdin=Path("stars.csv").read_text(encoding="utf-8"))
    assert (done.returncode, done.stderr) == (0, "")
    assert "rms 2.711 arcsec" in done.stdout


@pytest.fixture
def one_iteration(monkeypatch):
    monkeypatch.setattr(
        "rodgen.calibration.solve.least_squares.minimise.__kwdefaults__",
        {**minimise.__kwdefaults__, "max_iterations": 1},
    )


@pytest.mark.parametrize(
    "command",
    [
        ["fit"],
        ["compare"],
        ["predict", "stars.csv", "-o", "predicted.csv"],
        ["emit", "--lang", "c", "--force"],
    ],
)
def test_a_fit_that_does_not_converge_ends_with_3_and_one_line_says_so(
    folder, rodgen_command, one_iteration, command
):
    name, *more = command
    code, out, err = rodgen_command(name, "mount.toml", "stars.csv", *more)
    assert code == 3
    assert err.count("did not converge") == 1
    assert ("NOT CONVERGED" in out) == (name == "fit")


def test_no_code_is_emitted_of_a_fit_that_did_not_converge(folder, rodgen_command, one_iteration):
    code, out, err = rodgen_command("emit", "mount.toml", "stars.csv", "--lang", "c", "-o", "code")
    assert (code, out, err.count("\n")) == (3, "", 1)
    assert "the fit did not converge" in err
    assert not (folder / "code").exists()


def test_an_error_in_rodgen_itself_is_one_line_and_debug_shows_where(folder, rodgen_command, monkeypatch):
    def fail(*_, **__):
        raise ZeroDivisionError("of\nnothing")

    monkeypatch.setattr("rodgen.calibration.fit.fit", fail)
    code, out, err = rodgen_command("fit", "mount.toml", "stars.csv")
    assert (code, out, err.count("\n")) == (70, "", 1)
    assert err.startswith(
        "rodgen fit: an error in rodgen itself: ZeroDivisionError: of nothing; please report it"
    )
    with pytest.raises(ZeroDivisionError):
        rodgen_command("fit", "--debug", "mount.toml", "stars.csv")


# compare -----------------------------------------------------------------------------------------------


@pytest.mark.slow
@needs_browser
def test_compare_draws_images_into_a_folder(folder, rodgen_command):
    code, out, _ = rodgen_command("compare", "mount.toml", "stars.csv", "--plot", "pictures", "--json")
    assert code == 0
    plots = [Path(plot) for plot in json.loads(out)["plots"]]
    assert {plot.suffix for plot in plots} == {".png", ".svg"}
    assert all(plot.parent.name == "pictures" and plot.stat().st_size for plot in plots)


# add and remove ----------------------------------------------------------------------------------------


def test_adding_what_is_missing_makes_the_error_fall(folder, rodgen_command):
    words = ["mount.toml", "gravity_windup", "stars.csv", "--joint", "EL", "--hold", "k2=0"]
    code, out, err = rodgen_command("add", *words)
    assert (code, err) == (0, "")
    assert "Remedy       Balance the axis" in out
    # TPOINT's coefficients of this run: TF 21.41", TX 2.72"
    code, out, _ = rodgen_command("add", "mount_gravity_windup_EL.toml", "refraction", "stars.csv")
    assert code == 0
    assert "EL.gravity_windup.k  21.41 ± " in out
    assert "refraction.a         2.72 ± " in out


def test_without_measurements_only_the_file_is_written(folder, rodgen_command):
    code, out, err = rodgen_command("add", "table.toml", "backlash", "--joint", "C", "-o", "new.toml")
    assert (code, err) == (0, "")
    assert out.startswith("new.toml: table.toml with backlash at C\n")
    assert "reading -= b/2*s" in out
    code, out, _ = rodgen_command(
        "add", "table.toml", "target_offset", "--target", "ball_2", "-o", "other.toml", "--json"
    )
    assert code == 2  # its targets are fitted already
    code, out, _ = rodgen_command("remove", "new.toml", "backlash", "--joint", "C", "--json")
    found = json.loads(out)
    assert (code, found["file"], found["ladder"]) == (0, "new_without_backlash_C.toml", None)
    assert rodgen.Machine.load(found["file"]) == rodgen.Machine.load("table.toml")


def test_a_default_name_never_overwrites(folder, rodgen_command):
    names = []
    for _ in range(3):
        code, out, _ = rodgen_command("add", "mount.toml", "refraction", "--json")
        assert code == 0
        names.append(json.loads(out)["file"])
    assert names == ["mount_refraction.toml", "mount_refraction_2.toml", "mount_refraction_3.toml"]


def test_the_machine_itself_may_be_changed(folder, rodgen_command):
    assert rodgen_command("add", "mount.toml", "refraction", "-o", "mount.toml")[0] == 0
    assert [e.title for e in rodgen.Machine.load("mount.toml").effects] == ["refraction (TX)"]
    assert rodgen_command("remove", "mount.toml", "refraction", "-o", "mount.toml")[0] == 0
    # an empty line that stood before the block may stay
    assert (folder / "mount.toml").read_text().strip() == (
        EXAMPLES / "mount" / "machine.toml"
    ).read_text().strip()


def test_json_of_add_holds_the_ladder(folder, rodgen_command):
    code, out, err = rodgen_command("add", "mount.toml", "refraction", "stars.csv", "--json")
    found = json.loads(out)
    assert (code, err) == (0, "")
    base, added = found["ladder"]["rungs"]
    assert (found["effect"], found["place"], found["ladder"]["unit"]) == ("refraction", None, "arcsec")
    assert base["step"] is None
    assert added["parameters"]["refraction.a"]["unit"] == "arcsec"
    assert added["rms"] < added["rms_held_out"] < base["rms"]
    assert found["remedy"]


@pytest.mark.parametrize("hold", ["b=0.01", "b=36arcsec", "b = 36 arcsec", "b=0.6arcmin", "b=-0.01"])
def test_held_values_are_in_the_units_of_the_file_or_their_own(folder, rodgen_command, hold):
    code, _, err = rodgen_command(
        "add", "table.toml", "backlash", "--joint", "C", "-o", "new.toml", "--hold", hold
    )
    assert (code, err) == (0, "")
    value = tomllib.loads((folder / "new.toml").read_text())["effect"][-1]["hold"]["b"]
    assert abs(value) == pytest.approx(0.01, rel=1e-12)
    assert (value < 0) == ("-" in hold)


# emit --------------------------------------------------------------------------------------------------


def test_emit_wants_values(folder, rodgen_command):
    code, out, err = rodgen_command("emit", "mount.toml", "--lang", "c")
    assert (code, out) == (2, "")
    assert err.startswith("mount.toml: AZ.axis.a: no value yet; expected ")
    assert not (folder / "build").exists()
    assert rodgen_command("fit", "mount.toml", "stars.csv", "-o", "fitted.toml")[0] == 0
    assert rodgen_command("emit", "fitted.toml", "--lang", "c")[0] == 0
    assert len(list((folder / "build").iterdir())) == 3


# effects -----------------------------------------------------------------------------------------------


def test_words_are_printed_where_there_are_no_greek_letters():
    done = run_process("effects", "encoder_eccentricity", env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, "")
    assert "10 ?m of eccentricity" in done.stdout


# simulate ----------------------------------------------------------------------------------------------


def test_simulate_writes_to_standard_output(folder):
    one = run("simulate", "table.toml", "balls.csv", "--seed", "1", "--noise", "4um")
    assert one.returncode == 0
    assert one.stdout.startswith("C [deg],target,x [mm],y [mm],z [mm],run\n0.0,ball_1,")
    assert one.stderr == "standard output: 432 rows, noise 0.004 mm\n"


# what is refused ---------------------------------------------------------------------------------------

REFUSED = [
    "fit none.toml stars.csv",
    "fit mount.toml none.csv",
    "fit stars.csv mount.toml",
    "fit mount.toml balls.csv",
    "fit mount.toml stars.csv --loss cauchy",
    "fit mount.toml stars.csv -o mount.toml",
    "fit mount.toml stars.csv -o stars.csv",
    "fit mount.toml stars.csv -o .",
    "fit mount.toml stars.csv -o no/new.toml",
    "fit mount.toml stars.csv -o new.toml --residuals no/left.csv",
    "fit mount.toml stars.csv -o new.toml --residuals new.toml",
    "fit mount.toml stars.csv --residuals left.xlsx",
    "fit mount.toml - --residuals left.csv",
    "fit mount.toml",
    "fit mount.toml empty.csv -o new.toml",
    "add mount.toml refraction empty.csv",
    "compare mount.toml empty.csv",
    "emit mount.toml empty.csv --lang c",
    "simulate mount.toml empty.csv -o made.csv",
    "compare mount.toml none.csv",
    "add mount.toml refraction none.csv",
    "add mount.toml refractoin",
    "add mount.toml backlash",
    "add mount.toml backlash --joint C",
    "add mount.toml refraction --joint EL",
    "add mount.toml axis_tilt --joint EL",
    "add mount.toml axis_offset --joint EL",
    "add mount.toml backlash --joint EL --target boresight",
    "add mount.toml gravity_windup --joint EL --hold k9=0",
    "add mount.toml gravity_windup --joint EL --hold k2",
    "add mount.toml gravity_windup --joint EL --hold k2=x",
    "add mount.toml gravity_windup --joint EL --hold k2=1mm",
    "add mount.toml gravity_windup --joint EL --hold k=1 --hold k=2",
    "add mount.toml refraction stars.csv -o no/new.toml",
    "add mount.toml refraction stars.csv -o stars.csv",
    "remove mount.toml refraction",
    "emit mount.toml stars.csv",
    "emit mount.toml stars.csv --lang java",
    "emit mount.toml stars.csv --lang c -o stars.csv",
    "effects none",
    "simulate",
    "simulate table.toml balls.csv --hidden",
    "simulate table.toml balls.csv --json",
    "simulate table.toml balls.csv --seed -1",
    "simulate table.toml balls.csv --seed x",
    "simulate table.toml balls.csv -o balls.csv",
    "simulate table.toml balls.csv -o made.csv --truth made.csv",
    "simulate table.toml balls.csv -o made.csv --truth no/truth.json",
    "simulate table.toml balls.csv -o no/made.csv --truth truth.json",
    "simulate table.toml balls.csv --noise 2 -o made.txt",
    "simulate table.toml balls.csv --effect backlash@D",
    "simulate table.toml balls.csv --open truth.json",
    "simulate --open none.json",
    "simulate --open mount.toml",
]


@pytest.mark.parametrize("command", REFUSED)
def test_what_cannot_be_is_one_line_and_leaves_nothing(folder, refuses_command, command):
    refuses_command(*command.split())


@pytest.mark.parametrize(
    ("command", "header", "row", "more"),
    [
        ("check m.toml t.csv", "", "", 392),  # no target
        ("check m.toml t.csv", ",target", ",q", 392),
        ("import m.toml t.csv -d d.csv", ",ball", ",q", 392),
        ("import m.toml t.csv -d d.csv --column q=r", "".join(f",c{k}" for k in range(400)), ",1" * 400, 396),
        (
            "exclude m.toml t.csv --where q>1 --why x",
            "".join(f",c{k}" for k in range(400)),
            ",1" * 400,
            396,
        ),
    ],
)
def test_a_message_names_a_few_of_many(command, header, row, more, tmp_path, monkeypatch, rodgen_command):
    monkeypatch.chdir(tmp_path)
    machine = machine_template("turntable")
    machine = machine[: machine.index("[[target]]")] + machine[machine.index("[measured]") :]
    machine += "".join(f'\n[[target]]\nname = "t{k}"\npoint = [1, 2, 3]\n' for k in range(400))
    Path("m.toml").write_text(machine)
    rows = "".join(f"{angle},1,2,3{row}\n" for angle in (0, 0, 9, 9))
    Path("t.csv").write_text(f"C [deg],x [mm],y [mm],z [mm]{header}\n{rows.replace('q', 'r', 1)}")
    code, out, err = rodgen_command(*command.split())
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f" {more} more" in err
    assert len(err) < 300


def test_a_progress_bar_shows_where_somebody_looks(folder, capfd, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert cli.main(["fit", "mount.toml", "stars.csv"]) == 0
    shown = capfd.readouterr()
    assert "fitting" in shown.err
    assert shown.err.rstrip("\n").endswith("\r")  # and is taken away again
    assert shown.out.startswith("Alt-azimuth mount")
