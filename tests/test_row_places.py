"""Every command names a row by the line that an editor shows, with the file's name; data give its number from 0."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from machine_cases import joint, machine_file, toml
from simulated_fits import measure

from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.fit import fit
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine
from rodgen.output.report import report_page

EXAMPLES = Path(__file__).parent.parent / "examples"
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
    lines = (EXAMPLES / "pairs.csv").read_text().splitlines()
    lines.insert(5, "")
    (tmp_path / "pairs.csv").write_text("\n".join(lines) + "\n")
    assert main(["fit-axis", str(tmp_path / "pairs.csv"), "--loss", "huber"]) == 0
    assert "outliers    1: line 20 of pairs.csv" in capsys.readouterr().out
