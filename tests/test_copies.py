"""Data that were pasted twice: every command says so, and counts each row once."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from commands import words
from machine_cases import joint, machine_file, toml
from simulated_fits import measure

from rodgen.calibration.fit import fit
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.data.poses import originals
from rodgen.machines.machine import Machine

EXAMPLES = Path(__file__).resolve().parents[1] / "examples" / "machines"


def data_of(name: str) -> str:
    (data,) = (EXAMPLES / name).glob("*.csv")
    return data.read_text()


def files(name: str, folder: Path, *, in_place: bool = False) -> tuple[str, str]:
    """Write an example's data twice, one after the other, or each line twice; return machine and data."""
    header, *lines = data_of(name).splitlines(keepends=True)
    lines = [line for line in lines for _ in range(2)] if in_place else 2 * lines
    (folder / "data.csv").write_text("".join([header, *lines]))
    return str(EXAMPLES / name / "machine.toml"), str(folder / "data.csv")


SAID = "40 of the 80 rows of data.csv are copies of others, their readings included; each is counted once."


@pytest.mark.quick("check", "compare", "fit", "diagnose", "predict")
@pytest.mark.thorough("check", "compare", "fit")
@pytest.mark.parametrize(
    "command", ["check", "fit", "compare", "diagnose", "predict", "add", "plan", "emit", "report"]
)
def test_every_command_says_that_rows_are_copies(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only `diagnose` did."""
    file = machine_file(
        [joint("C", "revolute", (0, 0, 1), travel=[-3, 3])], [(120, 0, 40)], estimate=["C.axis"], noise=0.002
    )
    random = np.random.default_rng(1)
    columns = measure(file, {"C [rad]": random.uniform(-3, 3, 40)}, noise=0.002, random=random)
    lines = [",".join(map(str, row)) for row in zip(*columns.values(), strict=True)]
    machine, data = str(tmp_path / "table.toml"), str(tmp_path / "data.csv")
    Path(machine).write_text(toml(file))
    Path(data).write_text("\n".join([",".join(columns), *lines, *lines]) + "\n")
    assert main(words(command, machine, data, tmp_path)) == 0
    said = capsys.readouterr()
    shown = said.out if command in {"check", "fit", "compare", "diagnose"} else said.err
    assert " ".join(shown.split()).count(SAID) == 1
    assert "copies" not in (said.err if shown is said.out else said.out)


@pytest.mark.thorough("twice-mount", "each line twice-mount", "twice-positioner")
@pytest.mark.parametrize("name", ["rotary_table", "mount", "ballbar_gantry", "three_sps_s", "positioner"])
@pytest.mark.parametrize("in_place", [False, True], ids=["twice", "each line twice"])
def test_copies_count_once(name: str, in_place: bool, tmp_path: Path) -> None:
    """The noise was 0 arcsec, or nothing at all: a division by zero."""
    path, twice = files(name, tmp_path, in_place=in_place)
    machine = Machine.load(path)
    (single,) = (EXAMPLES / name).glob("*.csv")
    once, found = fit(machine, Measurements.load(single)), fit(machine, Measurements.load(twice))
    assert found.observations.copies == once.observations.n
    assert found.rms == pytest.approx(once.rms, rel=1e-9)
    assert found.noise.value == pytest.approx(once.noise.value, rel=1e-9)
    np.testing.assert_allclose(np.diag(found.covariance), np.diag(once.covariance), rtol=1e-6)


def test_residuals_and_outliers_are_those_of_all_rows_of_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine, data = files("rotary_table", tmp_path, in_place=True)
    lines = Path(data).read_text().splitlines()
    column = [cell.partition(" ")[0] for cell in lines[0].split(",")].index("x")
    for line in (21, 22):  # the 10th row, and its copy
        cells = lines[line].split(",")
        cells[column] = repr(float(cells[column]) + 1.0)
        lines[line] = ",".join(cells)
    del lines[3]  # ... which is not the number of the row among those that differ twice over
    Path(data).write_text("\n".join(lines) + "\n")
    out = tmp_path / "residuals.csv"
    assert main(["fit", machine, data, "--loss", "huber", "--json", "--residuals", str(out)]) == 0
    found = json.loads(capsys.readouterr().out)
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert found["rows"] + found["copies"] == len(rows) == len(lines) - 1
    wrong = [i for i, row in enumerate(rows) if row["outlier"] == "1"]
    assert len(wrong) == 2
    assert found["outliers"] == wrong[:1]
    keys = [key for key in rows[0] if key.startswith(("residual_", "predicted_"))]
    assert all(rows[wrong[0]][key] == rows[wrong[1]][key] for key in keys)


def test_rows_that_are_not_to_be_believed_are_those_of_the_data(tmp_path: Path) -> None:
    path, twice = files("rotary_table", tmp_path)
    machine, data = Machine.load(path), Measurements.load(twice)
    mask = np.zeros(data.rows, bool)
    mask[data.rows // 2 + 4] = True  # the copy of row 4
    found = fit(machine, data, outliers=mask)
    assert found.outlier_numbers == [4]
    assert found.observations.n == data.rows // 2


@pytest.mark.parametrize("seed", range(20))
def test_readings_of_few_digits_are_no_copies(seed: int) -> None:
    """Five passes over the same 40 positions with a noise of one digit: a third of the rows repeats another."""
    position = np.tile(np.arange(40.0), 5)
    reading = np.round(np.random.default_rng(seed).normal(0.1 * position, 1.0))
    equal = len(position) - len({*zip(position, reading, strict=True)})
    assert equal > 0.2 * len(position)
    assert originals([position, reading], len(position)) is None


@pytest.mark.parametrize("times", [2, 3])
def test_pasted_rows_are_copies_of_the_first(times: int) -> None:
    reading = np.random.default_rng(0).normal(size=30)
    np.testing.assert_array_equal(
        originals([np.tile(reading, times)], 30 * times), np.tile(np.arange(30), times)
    )
    np.testing.assert_array_equal(
        originals([np.repeat(reading, times)], 30 * times), times * np.repeat(np.arange(30), times)
    )


def test_a_part_that_was_pasted_is_found() -> None:
    reading = np.random.default_rng(0).normal(size=100)
    found = originals([np.concatenate([reading, reading[40:50]])], 110)
    np.testing.assert_array_equal(found, [*range(100), *range(40, 50)])
