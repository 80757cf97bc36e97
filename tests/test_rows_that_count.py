"""What a diagnosis leaves out, every command after it leaves out; before it, each names the same rows."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from machine_cases import joint, machine_file, toml
from simulated_fits import measure

from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.diagnosis import Diagnosis
from rodgen.calibration.fit import fit
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine
from rodgen.output.report import report_page

EXAMPLES = Path(__file__).resolve().parents[1] / "examples" / "machines"
SLIPS = {20: ("x", 0.15), 57: ("y", -0.2), 101: ("z", 0.3), 150: ("x", -0.25), 199: ("z", 0.16)}
"""By line: the component, and what is added to it, in mm."""
ROWS = [line - 2 for line in SLIPS]
SAID = "5 of the 224 rows of data.csv are set aside: lines 20, 57, 101, 150, 199 (outlier of the diagnosis)."


def spoiled(example: str, folder: Path, slips: dict[int, tuple[str, float]]) -> tuple[str, str]:
    """Copy an example with something added to the readings of some lines; return machine and data."""
    header, *lines = (EXAMPLES / example / "data.csv").read_text().splitlines()
    names = [cell.partition(" ")[0] for cell in header.split(",")]
    rows = [line.split(",") for line in lines]
    for line, (name, error) in slips.items():
        k = names.index(name)
        rows[line - 2][k] = repr(float(rows[line - 2][k]) + error)
    (folder / "data.csv").write_text("\n".join([header, *map(",".join, rows)]) + "\n")
    (folder / "machine.toml").write_text((EXAMPLES / example / "machine.toml").read_text())
    return str(folder / "machine.toml"), str(folder / "data.csv")


def printed(*command: str) -> Any:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main([*command]) == 0
    return json.loads(out.getvalue()) if "--json" in command else out.getvalue()


class Trunnion(NamedTuple):
    """A trunnion with five outliers, and its diagnosis."""

    machine: str
    data: str
    better: str
    said: dict[str, Any]
    diagnosis: Diagnosis


@pytest.fixture(scope="module")
def trunnion(tmp_path_factory: pytest.TempPathFactory) -> Trunnion:
    folder = tmp_path_factory.mktemp("trunnion")
    machine, data = spoiled("trunnion", folder, SLIPS)
    better = str(folder / "better.toml")
    said = printed("diagnose", machine, data, "-o", better, "--json")
    return Trunnion(machine, data, better, said, diagnose(Machine.load(machine), Measurements.load(data)))


def close(found: dict[str, Any], expected: dict[str, Any]) -> None:
    """Hold parameters to a thousandth of their standard deviations."""
    for key, one in expected.items():
        assert found[key]["value"] == pytest.approx(one["value"], abs=1e-3 * (one["std"] or 1e-9)), key
        assert found[key]["std"] == pytest.approx(one["std"], rel=1e-3), key


@pytest.mark.thorough
def test_a_fit_after_a_diagnosis_has_its_numbers(trunnion: Trunnion) -> None:
    said, final = trunnion.said, trunnion.diagnosis.final_with_forms
    assert said["outliers"] == ROWS
    found = printed("fit", trunnion.better, trunnion.data, "--json")
    assert found["rms"] == pytest.approx(said["rms"]["after"], rel=1e-6)
    assert found["rms"] == pytest.approx(final.rms, rel=1e-6)
    close(found["parameters"], {key: e.to_dict() for key, e in final.estimates.items()})
    assert (found["rows"], found["outliers"], found["gross"]) == (219, [], [])
    assert found["set_aside"]["entries"] == [entry | {"count": 5} for entry in said["exclude"]]
    assert SAID in printed("fit", trunnion.better, trunnion.data)


@pytest.mark.thorough
def test_other_commands_count_the_same_rows(
    trunnion: Trunnion, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    used = {key: printed("fit", trunnion.better, trunnion.data, "--json")[key] for key in
            ("rows", "copies", "set_aside", "outliers", "gross")}  # fmt: skip
    compared = printed("compare", trunnion.better, trunnion.data, "--json")
    emitted = printed(
        "emit", trunnion.better, trunnion.data, "--lang", "numpy", "-o", str(tmp_path), "--json"
    )
    for found in (compared, emitted):
        assert {key: found[key] for key in used} == used
    assert compared["rms"] == pytest.approx(trunnion.said["rms"]["after"], rel=1e-6)
    capsys.readouterr()
    places = str(tmp_path / "places.csv")
    main(["predict", trunnion.better, trunnion.data, trunnion.data, "-o", places, "--all-digits"])
    assert SAID in capsys.readouterr().err
    final = trunnion.diagnosis.final_with_forms
    expected = final.predict(Measurements.load(trunnion.data)).columns(rounded=False)
    table = Measurements.load(places).columns
    for text, values in expected.items():
        name = text.partition(" [")[0]
        if name.startswith("model_") and not name.startswith("model_u_"):
            np.testing.assert_allclose(table[name].values, values, atol=1e-6)


@pytest.mark.thorough
def test_python_has_the_same_machine(trunnion: Trunnion) -> None:
    machine, data = trunnion.diagnosis.machine, Measurements.load(trunnion.data)
    assert machine.measured.set_aside == Machine.load(trunnion.better).measured.set_aside
    final = trunnion.diagnosis.final_with_forms
    again = machine.fit(data)
    assert again.rms == pytest.approx(final.rms, rel=1e-6)
    close(
        {k: e.to_dict() for k, e in again.estimates.items()},
        {k: e.to_dict() for k, e in final.estimates.items()},
    )
    # rows of a table are no rows of another one
    table = {column.text: column.values for column in data.columns.values()}
    other = {name: values[::-1].copy() for name, values in table.items()}
    assert diagnose(machine, table).machine.fit(other).observations.n == 224


@pytest.mark.thorough
def test_a_watch_says_which_rows_of_its_reference_do_not_count(
    trunnion: Trunnion, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["watch", trunnion.better, trunnion.data, "--reference", trunnion.data, "--json"]) in {0, 1}
    assert SAID in capsys.readouterr().err.splitlines()


@pytest.mark.slow
def test_a_report_and_a_diagnosis_say_which_rows_do_not_count(trunnion: Trunnion, tmp_path: Path) -> None:
    again = printed("diagnose", trunnion.better, trunnion.data, "--json")
    assert (again["verdict"], again["steps"], again["rows"]) == ("nothing_missing", [], 219)
    assert (again["outliers"], again["set_aside"]["rows"]) == ([], 5)
    page = tmp_path / "page.html"
    main(["report", trunnion.better, trunnion.data, "-o", str(page)])
    assert "lines 20, 57, 101, 150, 199 (outlier of the diagnosis)" in page.read_text()


@pytest.mark.thorough
def test_every_command_names_the_same_rows_before_the_diagnosis(trunnion: Trunnion, tmp_path: Path) -> None:
    files = trunnion.machine, trunnion.data
    gross = printed("fit", *files, "--json")["gross"]
    assert [one["row"] for one in gross] == ROWS
    for one, (component, off) in zip(gross, SLIPS.values(), strict=True):
        assert one["component"] == component
        assert one["off"] == pytest.approx(off, abs=0.02)
    assert printed("compare", *files, "--json")["gross"] == gross
    assert printed("emit", *files, "--lang", "numpy", "-o", str(tmp_path), "--json")["gross"] == gross
    assert printed("check", *files, "--json")["gross"] == gross
    assert printed("plan", *files, "-n", "1", "--for", "C.axis.a", "--json")["used"]["gross"] == gross
    added = printed("add", trunnion.machine, "scale", trunnion.data, "--joint", "X",
                    "-o", str(tmp_path / "more.toml"), "--json")  # fmt: skip
    assert [one["row"] for one in added["ladder"]["gross"]] == ROWS


def test_outliers_can_be_brought_back(trunnion: Trunnion, tmp_path: Path) -> None:
    every = str(tmp_path / "every.toml")
    printed("exclude", "--undo", trunnion.better, trunnion.data, "--rows", "101", "-o", every)
    assert printed("fit", every, trunnion.data, "--json")["set_aside"]["rows"] == 4
    printed("exclude", "--undo", every, trunnion.data, "--all", "-o", every)
    found = printed("fit", every, trunnion.data, "--json")
    assert (found["rows"], found["set_aside"]["entries"]) == (224, [])
    assert [one["row"] for one in found["gross"]] == ROWS


def test_another_file_of_that_name_is_refused_in_one_sentence(
    refuses, trunnion: Trunnion, tmp_path: Path
) -> None:
    other = tmp_path / "data.csv"
    other.write_text((EXAMPLES / "trunnion" / "data.csv").read_text())
    refuses(fit, Machine.load(trunnion.better), Measurements.load(other))
    renamed = other.rename(tmp_path / "march.csv")
    assert fit(Machine.load(trunnion.better), Measurements.load(renamed)).observations.n == 224


def test_copies_of_an_outlier_and_outliers_of_a_robust_fit_do_not_come_back(tmp_path: Path) -> None:
    machine, data = spoiled("rotary_table", tmp_path, {20: ("x", 0.5)})
    text = Path(data).read_text()
    header, *lines = text.splitlines(keepends=True)
    Path(data).write_text(header + "".join(lines) + "".join(lines))
    fitted, again = str(tmp_path / "fitted.toml"), len(lines) + 18
    found = printed("fit", machine, data, "--loss", "huber", "-o", fitted, "--json")
    assert found["outliers"] == [18]
    assert Machine.load(fitted).aside(Measurements.load(data)).mask.nonzero()[0].tolist() == [18, again]


# Every command names a row by the line that an editor shows, with the file's name; data give its number from 0


FOLDER = Path(__file__).parent.parent / "examples"
ROW, LINE = 30, 34  # under a header and two empty lines


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    file = machine_file(
        [joint("C", "revolute", (0, 0, 1), travel=[-3, 3])], [(120, 0, 40)], estimate=["C.axis"], noise=0.002
    )
    random = np.random.default_rng(1)
    data = measure(file, {"C [rad]": random.uniform(-3, 3, 60)}, noise=0.002, random=random)
    data["z [mm]"][ROW] += 0.1
    lines = [",".join(map(str, row)) for row in zip(*data.values(), strict=True)]
    lines.insert(10, "\n")
    folder = tmp_path_factory.mktemp("places")
    (folder / "table.toml").write_text(toml(file), encoding="utf-8")
    (folder / "balls.csv").write_text("\n".join([",".join(data), *lines]) + "\n", encoding="utf-8")
    assert (folder / "balls.csv").read_text().splitlines()[LINE - 1] == lines[ROW + 1]
    return str(folder / "table.toml"), str(folder / "balls.csv")


@pytest.mark.parametrize(
    "command", [["fit", "--loss", "huber"], ["compare"], ["diagnose"]], ids=lambda c: c[0]
)
def test_commands_name_the_line_and_the_file(files, command, capsys):
    assert main([*command, *files]) == 0
    text = capsys.readouterr().out
    assert f"ine {LINE} of balls.csv" in text
    assert f"row {ROW}" not in text


def test_report_names_the_line_and_the_file(files):
    machine, data = Machine.load(files[0]), Measurements.load(files[1])
    page = report_page(diagnose(machine, data))
    assert f"<td>1: line {LINE} of balls.csv</td>" in page
    assert '>line</th><th scope="col">target</th>' in page
    worst = page.partition("Largest residuals of the last model</caption>")[2].partition("<tbody>")[2]
    assert worst.startswith(f'<tr><th scope="row">{LINE}</th>')


@pytest.mark.parametrize("command", [["fit", "--loss", "huber"], ["diagnose"]], ids=lambda c: c[0])
def test_data_give_numbers_of_rows_from_0(files, command, capsys):
    main([*command, *files, "--json"])
    assert json.loads(capsys.readouterr().out)["outliers"] == [ROW]


def test_table_in_memory_has_rows_and_no_lines(files):
    data = Measurements.load(files[1])
    frame = {column.text: column.values for column in data.columns.values()}
    text = fit(Machine.load(files[0]), Measurements.from_frame(frame, name="balls"), loss="huber").summary()
    assert f"row {ROW} (from 0) of balls" in text


def test_of_many_rows_the_first_are_named(files):
    data = Measurements.load(files[1])
    assert data.places([0, 1]) == "lines 2 and 3 of balls.csv"
    assert data.places(range(20)).startswith("lines 2, 3, ")
    assert data.places(range(20)).endswith(" and 12 more of balls.csv")
    assert data.take(slice(4, None, 2)).place(1) == "line 8"


def test_an_axis_fit_names_the_line_of_an_outlier(tmp_path, capsys):
    """It counted pairs from 0."""
    lines = (FOLDER / "pairs.csv").read_text().splitlines()
    lines.insert(5, "")
    (tmp_path / "pairs.csv").write_text("\n".join(lines) + "\n")
    assert main(["fit-axis", str(tmp_path / "pairs.csv"), "--loss", "huber"]) == 0
    assert "outliers    1: line 20 of pairs.csv" in capsys.readouterr().out
