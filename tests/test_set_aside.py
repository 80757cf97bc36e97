"""Rows that the machine file sets aside: every command leaves them out and says so, and never other rows."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import commands
import numpy as np
import pytest
from machine_cases import joint, machine_file, toml
from simulated_fits import measure

from rodgen.calibration.fit import Fit, fit
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.data.set_aside import SetAside
from rodgen.machines.files.edit import edited_text
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Machine

FILE = machine_file(
    [joint("C", "revolute", (0, 0, 1), travel=[-3, 3])], [(120, 0, 40)], estimate=["C.axis"], noise=0.002
)
SAID = (
    "4 of the 40 rows of data.csv are set aside: lines 7-8, 20 (bumped); run 2 (haze); but not lines 36-41."
)


@pytest.fixture(autouse=True)
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write a machine, and measurements in two runs, of which lines 7, 8, 20 and 35 are 1 mm off."""
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(1)
    columns = measure(FILE, {"C [rad]": random.uniform(-3, 3, 40)}, noise=0.002, random=random)
    columns["x [mm]"] = columns["x [mm]"] + np.isin(np.arange(40), [5, 6, 18, 33])
    columns["run"] = np.where(np.arange(40) < 33, 1, 2)
    columns["load [N]"] = np.arange(40.0)
    lines = [",".join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    Path("m.toml").write_text(f"# a table\n{toml(FILE)}# its end\n")
    Path("data.csv").write_text("\n".join([",".join(columns), *lines]) + "\n")


def run(*words: str) -> None:
    assert main([*words]) == 0


def set_aside() -> None:
    run("exclude", "m.toml", "data.csv", "--rows", "7-8,20", "--why", "bumped", "-o", "m.toml")
    run("exclude", "m.toml", "data.csv", "--run", "2", "--why", "haze", "-o", "m.toml")
    run("exclude", "--undo", "m.toml", "data.csv", "--rows", "36-41", "-o", "m.toml")


def read() -> tuple[Machine, Measurements]:
    return Machine.load("m.toml"), Measurements.load("data.csv")


@pytest.mark.quick("check", "fit", "predict", "plan", "report")
@pytest.mark.thorough("check", "fit", "predict")
@pytest.mark.parametrize(
    "command", ["check", "fit", "compare", "diagnose", "predict", "add", "plan", "emit", "report"]
)
def test_every_command_leaves_them_out_and_says_so(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    set_aside()
    assert SAID in capsys.readouterr().out
    run(*commands.words(command, "m.toml", "data.csv", "."))
    said = capsys.readouterr()
    text = " ".join((said.out if command in {"check", "fit", "compare", "diagnose"} else said.err).split())
    assert text.count(SAID) == 1
    assert "off by" not in said.out + said.err  # what is set aside disturbs no more
    if command == "predict":
        assert len(Path("p.csv").read_text().splitlines()) == 41  # where to look is no measurement


@pytest.mark.parametrize("command", ["check", "fit", "compare", "diagnose", "add"])
def test_json_says_which_and_why(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    set_aside()
    capsys.readouterr()
    run(*commands.words(command, "m.toml", "data.csv", "."), "--json")
    found = json.loads(capsys.readouterr().out)
    found = (found["ladder"] if command == "add" else found)["set_aside"]
    assert found["rows"] == 4
    assert [entry["count"] for entry in found["entries"]] == [3, 7, 6]
    assert found["entries"][1] == {"run": "2", "file": "data.csv", "why": "haze", "count": 7}
    assert found["entries"][2]["back"]


def test_a_fit_is_that_of_the_other_rows(capsys: pytest.CaptureFixture[str]) -> None:
    set_aside()
    machine, data = read()
    found = fit(machine, data)
    lines = Path("data.csv").read_text().splitlines()
    gone = [7, 8, 20, 35]
    Path("few.csv").write_text("\n".join(x for i, x in enumerate(lines, 1) if i not in gone) + "\n")
    few = fit(Machine.load("m.toml").bringing_back(data), Measurements.load("few.csv"))
    assert found.rms == pytest.approx(few.rms, rel=1e-9)
    assert found.observations.n == 36
    assert found.observations.data.place(5) == "line 9"
    run("fit", "m.toml", "data.csv", "--residuals", "r.csv")
    with Path("r.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [i + 2 for i, row in enumerate(rows) if row["residual_x [mm]"] == ""] == gone
    assert [i + 2 for i, row in enumerate(rows) if row["outlier"] == ""] == gone
    table = found.residuals.columns()
    assert table["load [N]"].tolist() == [*range(40)]
    assert np.flatnonzero(table["outlier"].mask).tolist() == [5, 6, 18, 33]


def test_a_saved_fit_reads_back(capsys: pytest.CaptureFixture[str]) -> None:
    set_aside()
    machine, data = read()
    outlier = np.zeros(40, bool)
    outlier[[7, 30]] = True
    table = {column.text: column.values for column in data.columns.values()}
    in_memory = (
        machine.bringing_back(data).setting_aside(table, rows=[5, 6, 18]).setting_aside(table, run="2")
    )
    for one, given in ((machine, data), (in_memory, table)):
        found = fit(one, given, outliers=outlier)
        assert found.outlier_numbers == [7, 30]
        found.save("fit.json")
        again = Fit.load("fit.json")
        assert again.rms == pytest.approx(found.rms, rel=1e-12)
        np.testing.assert_array_equal(again.outliers, found.outliers)
        assert again.outlier_numbers == found.outlier_numbers
        assert again.observations.aside.mask.tolist() == found.observations.aside.mask.tolist()
    copied = {name: np.repeat(values, 2) for name, values in table.items()}
    found = fit(machine.bringing_back(data), copied, outliers=np.repeat(outlier, 2))
    found.save("fit.json")
    np.testing.assert_array_equal(Fit.load("fit.json").outliers, found.outliers)


def test_rows_stay_the_same_rows(refuses, capsys: pytest.CaptureFixture[str]) -> None:
    set_aside()
    text, machine = Path("data.csv").read_text(), Machine.load("m.toml")
    header, *lines = text.splitlines(keepends=True)

    def aside(content: str, name: str = "data.csv") -> str:
        Path(name).write_text(content)
        found = machine.aside(Measurements.load(name))
        return found.text if found else ""

    assert aside(text + lines[0]).startswith("4 of the 41 rows of data.csv")  # it grew
    assert aside(text.replace("load", "weight")).startswith("4 of the 40 rows")  # another column
    assert aside(text, "copy.csv").startswith("3 of the 40 rows of copy.csv are set aside: lines 7-8, 20")
    others = aside("".join([header, *reversed(lines)]), "other.csv")
    assert others.startswith(
        "What the machine file sets aside of other files is not in other.csv: rows 7-8, 20"
    )
    for content in (
        header + "\n" + "".join(lines),
        header + "".join(lines[1:]),
        "".join([header, *lines[:9]]),
    ):
        refuses(aside, content)  # lines that are others now
    cells = lines[18].split(",")
    Path("data.csv").write_text(text.replace(lines[18], ",".join([cells[0], "0.5", *cells[2:]])))
    assert main(["check", "m.toml", "data.csv"]) == 2
    run(
        "exclude", "--undo", "m.toml", "data.csv", "--rows", "7-8,20", "-o", "m.toml"
    )  # the entry can be removed
    assert "bumped" not in Path("m.toml").read_text()


@pytest.mark.parametrize(
    ("words", "rows"),
    [
        (["--where", "load < 5 N"], 5),
        (["--where", "load >= 0.005 kN and load<8"], 3),
        (["--where", "run != 1"], 7),
        (["--where", "run = 3"], 0),
        (["--where", "run = 2.0"], 7),
        (["--run", "1"], 33),
        (["--rows", "2, 4-6,5 - 7"], 5),
    ],
)
def test_rows_are_chosen_by_number_run_and_rule(
    words: list[str], rows: int, capsys: pytest.CaptureFixture[str]
) -> None:
    before = Path("m.toml").read_bytes().replace(b"\n", b"\r\n")
    Path("m.toml").write_bytes(before)
    run("exclude", "m.toml", "data.csv", *words, "-o", "m.toml", "--json")
    assert json.loads(capsys.readouterr().out)["set_aside"]["rows"] == rows
    machine, data = read()
    assert len(fit(machine, data).observations.data.columns["load"].values) == 40 - rows
    assert fit(machine, data).observations.run_names == (
        ("2",) if "--run" in words else ("1",) if rows == 7 else ("1", "2")
    )
    made = Path("made.toml")
    made.write_text(machine_text(machine))
    assert Machine.load(made) == machine
    run("exclude", "--undo", "m.toml", "data.csv", *words, "-o", "m.toml")
    assert Path("m.toml").read_bytes() == before


@pytest.mark.parametrize(
    ("rule", "comparisons"),
    [
        ("run = day and night", [("run", "=", "day and night")]),
        ("run = 'day and night' and C<1 rad", [("run", "=", "day and night"), ("C", "<", "1 rad")]),
        ("run=day and night and load >= 5 N", [("run", "=", "day and night"), ("load", ">=", "5 N")]),
        ('run != "a and b = 2"', [("run", "!=", "a and b = 2")]),
        ('"band and C" > 2 and T_land<3', [("band and C", ">", "2"), ("T_land", "<", "3")]),
        ("run = a=b", [("run", "=", "a=b")]),
    ],
)
def test_a_value_may_have_an_and_of_its_own(rule: str, comparisons: list[tuple[str, str, str]]) -> None:
    assert SetAside(where=rule)._comparisons() == comparisons


@pytest.mark.parametrize("rule", ["run = 'day", "run =", "and C < 1", "C < 1 and", "C 1", "run = 'a' b"])
def test_a_rule_that_cannot_be_read_is_refused(rule: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["exclude", "m.toml", "data.csv", "--where", rule]) == 2
    assert "; expected a" in capsys.readouterr().err


def test_a_rule_is_kept_while_some_of_its_rows_count(capsys: pytest.CaptureFixture[str]) -> None:
    machine, data = read()
    changed = machine.setting_aside(data, where="load < 5 N").bringing_back(data, rows="4", why="clear")
    assert changed.aside(data).text == (
        "4 of the 40 rows of data.csv are set aside: load < 5 N; but not line 4 (clear)."
    )
    assert changed.setting_aside(data, rows=[4]).aside(data).mask.sum() == 5
    assert changed.bringing_back(data, where="load < 5 N") == machine
    assert changed.bringing_back(data) == machine
    Path("other.csv").write_text(Path("data.csv").read_text().replace("20", "21"))
    both = changed.setting_aside(Measurements.load("other.csv"), run="1")
    assert [entry.file for entry in both.bringing_back(data).measured.set_aside] == ["other.csv"]
    several = machine.setting_aside(data, rows=[4], why="x").setting_aside(data, rows=[5, 9], why="x")
    assert [entry.rows for entry in several.measured.set_aside] == ["4-5, 9"]


@pytest.mark.parametrize(
    "words",
    [
        "--rows 42",
        "--rows 1-3",
        "--rows 9-3",
        "--rows x",
        "--run 3",
        "--where C",
        "--where c<1",
        "--where run<1",
        "--where C<x",
        "--where C<3mm",
        "--where C<3quux",
        "--where C<9",
        "--why \t --run 2",
    ],
)
def test_what_cannot_be_set_aside_is_one_sentence(refuses_command, words: str) -> None:
    refuses_command("exclude", "m.toml", "data.csv", *words.split(" "), "-o", "m.toml")


@pytest.mark.parametrize(
    "value",
    [
        '"12"',
        "[{}]",
        '[{ run = 2 }, { run = 1, where = "C < 1" }]',
        "[{ rows = 12 }]",
        '[{ rwos = "12" }]',
        "[{ run = true }]",
        '[{ run = 2, back = "yes" }]',
        "[{ run = 7 }]",
        '[{ rows = "44", file = "data.csv" }]',
        "[{ run = 1 }, { run = 2 }]",
    ],
)
def test_entries_that_cannot_be_right_are_one_sentence(refuses_command, value: str) -> None:
    text = Path("m.toml").read_text().replace("[measured]\n", f"[measured]\nset_aside = {value}\n")
    Path("m.toml").write_text(text)
    refuses_command("fit", "m.toml", "data.csv")


def test_a_run_of_another_file_is_another_run(capsys: pytest.CaptureFixture[str]) -> None:
    set_aside()
    machine = Machine.load("m.toml")
    Path("night2.csv").write_text(Path("data.csv").read_text().replace("20", "21"))
    other = fit(machine, Measurements.load("night2.csv"))
    assert other.observations.n == 40
    assert other.to_dict()["set_aside"]["entries"][1]["count"] is None


def test_measurements_that_are_read_in_parts_are_refused(
    refuses, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    set_aside()
    machine, data = read()
    data.to_pandas().to_parquet("part.parquet")
    monkeypatch.setattr("rodgen.calibration.problem.blocks.STRETCH", 1)
    refuses(fit, machine, Measurements.scan("part.parquet"))


def test_copies_of_rows_that_are_set_aside_count_no_more_than_they(
    capsys: pytest.CaptureFixture[str],
) -> None:
    header, *lines = Path("data.csv").read_text().splitlines(keepends=True)
    Path("data.csv").write_text("".join([header, *lines, *lines]))
    machine, data = read()
    once = fit(machine.setting_aside(data, where="load < 5 N"), data)
    assert once.observations.n == 35
    assert once.observations.copies == 35
    assert once.observations.given(np.array([0, 34])).tolist() == [5, 39]
    of_first = fit(machine.setting_aside(data, rows="2"), data)
    assert of_first.observations.n == 40  # its copy still counts
    assert of_first.observations.on_rows[1].startswith("39 of the 80 rows of data.csv are copies")


def test_a_file_that_could_not_be_read_again_is_not_written(refuses, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, data = read()
    changed = machine.setting_aside(data, rows=[*range(3, 40, 2)])
    assert "rows = " in edited_text("m.toml", changed)
    monkeypatch.setattr("rodgen.limits.FILE", 1000)
    text = Path("m.toml").read_text()
    refuses(edited_text, "m.toml", changed, text + "#" * 1000)


def test_a_list_in_another_form_is_not_edited(capsys: pytest.CaptureFixture[str]) -> None:
    Path("m.toml").write_text(Path("m.toml").read_text() + '[[measured.set_aside]]\nrun = "2"\n')
    assert main(["exclude", "--undo", "m.toml", "data.csv", "--run", "2"]) == 2
    assert "[measured]: a table or a key set_aside in another form" in capsys.readouterr().err


def test_a_rule_that_no_row_meets_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["exclude", "m.toml", "data.csv", "--where", "C < -1000 deg"]) == 0
    assert (
        "0 of the 40 rows of data.csv are set aside: C < -1000 deg, true of no row."
        in capsys.readouterr().out
    )
