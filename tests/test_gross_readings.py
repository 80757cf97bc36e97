"""Every command names a reading that is grossly wrong, by line and by how far it is off; of good data none is."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from commands import words
from hidden_effects import BENCHES

from rodgen.calibration.fit import Fit, fit
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

EXAMPLES = Path(__file__).resolve().parents[1] / "examples" / "machines"


def spoiled(name: str, folder: Path, *slips: tuple[int, str, float]) -> tuple[str, str]:
    """Copy an example's data with something added to a column of some lines; return machine and data."""
    (data,) = (EXAMPLES / name).glob("*.csv")
    lines = [line.split(",") for line in data.read_text().splitlines()]
    names = [cell.partition(" ")[0] for cell in lines[0]]
    for line, column, error in slips:
        cells = lines[line - 1]
        cells[names.index(column)] = repr(float(cells[names.index(column)]) + error)
    (folder / "data.csv").write_text("\n".join(map(",".join, lines)) + "\n")
    return str(EXAMPLES / name / "machine.toml"), str(folder / "data.csv")


def fitted(files: tuple[str, str]) -> Fit:
    return fit(Machine.load(files[0]), Measurements.load(files[1]))


SAID = (
    "Line 20 of data.csv is off by +1e+06 mm in x, all other rows by 7.72 um at most: correct this row, or "
    "exclude it with rodgen exclude --rows 20, or fit with --loss huber"
)


@pytest.mark.thorough("check", "predict")
@pytest.mark.parametrize("command", ["check", "fit", "compare", "predict", "add", "plan"])
def test_every_command_names_the_reading(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Neither `fit` nor `compare` named it."""
    machine, data = spoiled("rotary_table", tmp_path, (20, "x", 1e6))
    main(words(command, machine, data, tmp_path))
    said = capsys.readouterr()
    assert SAID in (said.out if command in {"fit", "compare"} else said.err)


def test_the_reading_is_among_the_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = spoiled("rotary_table", tmp_path, (20, "x", 1e6))
    main(["fit", *files, "--json"])
    (gross,) = json.loads(capsys.readouterr().out)["gross"]
    assert (gross["row"], gross["component"]) == (18, "x")
    assert gross["off"] == pytest.approx(1e6, rel=1e-6)


@pytest.mark.thorough(
    "mount-slips0-Line 20 of data.csv is off by ",
    "ballbar_gantry-slips1-Lines 7 and 20 of data.csv are off by -0.304 mm, +100 mm",
)
@pytest.mark.parametrize(
    ("name", "slips", "found"),
    [
        ("mount", [(20, "EL", 1.0)], "Line 20 of data.csv is off by "),
        (
            "ballbar_gantry",
            [(20, "d", 100.0), (7, "d", -0.3)],
            "Lines 7 and 20 of data.csv are off by -0.304 mm, +100 mm",
        ),
        ("three_sps_s", [(20, "x", -50.0)], "Line 20 of data.csv is off by -50 mm in x"),
    ],
)
def test_slips_are_found_whatever_their_size(name: str, slips, found: str, tmp_path: Path) -> None:
    assert fitted(spoiled(name, tmp_path, *slips)).summary().splitlines()[1].startswith(found)


@pytest.mark.parametrize("name", ["rotary_table", "mount", "ballbar_gantry", "three_sps_s", "positioner"])
def test_good_readings_are_not_named(name: str, tmp_path: Path) -> None:
    assert fitted(spoiled(name, tmp_path)).gross_readings == ()


@pytest.mark.parametrize("poses", [4, 5, 6, 8, 12, 20])
def test_few_readings_are_not_named(poses: int, tmp_path: Path) -> None:
    """With as many readings as parameters a fit to all others may be exact."""
    for seed in range(4):
        random = np.random.default_rng(seed)
        bench = BENCHES["trunnion"](random, 0.4)
        machine = bench.simulator(bench.file, bench.wrong)
        reading = machine.measure(bench.q[: 2 * poses], target=bench.target[: 2 * poses])
        reading = machine.with_noise(reading, bench.sigma, random)
        (tmp_path / "machine.toml").write_text(bench.text.replace("{noise}", ""))
        machine.write_csv(
            tmp_path / "data.csv", q=bench.q[: 2 * poses], reading=reading, target=bench.target[: 2 * poses]
        )
        assert fitted((str(tmp_path / "machine.toml"), str(tmp_path / "data.csv"))).gross_readings == ()


@pytest.mark.slow
def test_a_diagnosis_and_its_plan_say_how_far_off_what_they_leave_out_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = spoiled("mount", tmp_path, (20, "EL", 1.0), (33, "EL", -2.0))
    said = r"2 outliers, taken out: lines 20 and 33 of data\.csv, off by -3\d{3} arcsec .+, \+7\d{3} arcsec towards the"
    main(["diagnose", *files])
    assert re.search(said, " ".join(capsys.readouterr().out.split()))
    main(["plan", *files, "-n", "1"])
    assert re.search(said, capsys.readouterr().err)
