"""What the machine file knows of its parameters is used by checks and diagnoses; a bound beyond which the truth lies is
named before anything else, and effects do not stand for it.

The readings come from the independent simulator.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hidden_effects import BENCHES

from rodgen.calibration.check import check
from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.fit import fit
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine


def trunnion(folder: Path, known: str, **truth: float) -> tuple[Machine, Measurements]:
    """Return a trunnion, of which a file knows something, and readings of what it is; lengths in mm, angles in deg."""
    random = np.random.default_rng(3)
    bench = BENCHES["trunnion"](random, 0.4)
    values = {key.replace("__", "."): value for key, value in truth.items()}
    machine = bench.simulator(bench.file, bench.wrong | values)
    seen: dict[str, Any] = dict(bench.columns)
    reading = machine.measure(bench.q, target=bench.target, **seen)
    reading = machine.with_noise(reading, bench.sigma, random)
    text = bench.text.replace("{noise}", f"noise = {bench.sigma}") + f"\n[known]\n{known}\n"
    (folder / "machine.toml").write_text(text)
    machine.write_csv(folder / "data.csv", q=bench.q, reading=reading, target=bench.target, **seen)
    return Machine.load(folder / "machine.toml"), Measurements.load(folder / "data.csv")


@pytest.mark.thorough
def test_a_wrong_bound_is_named_first_and_explained_by_no_effect(tmp_path: Path) -> None:
    """It ended in five effects that are not there."""
    machine, data = trunnion(tmp_path, "C.point.a = { bounds = [-0.05, 0.05] }", C__point__a=0.3)
    found = fit(machine, data)
    said = "C.point.a is held at its bound, 0.05 mm; without it the error falls from 0.114 to 0.00183 mm, "
    assert found.summary().splitlines()[1].startswith(said)
    assert (
        found.summary()
        .splitlines()[1]
        .endswith("with C.point.a = 0.3002 mm, and the readings are more than a million times more probable.")
    )
    assert str(found.compare()).startswith(said)
    diagnosis = found.diagnose()
    assert diagnosis.verdict == "nothing_missing"
    assert diagnosis.wrong_bounds.startswith(said)
    assert diagnosis.to_dict()["wrong_bounds"] == diagnosis.wrong_bounds
    assert " Apart from that, nothing is missing" in " ".join(diagnosis.summary().split())


@pytest.mark.thorough
def test_a_wrong_bound_of_an_effect_is_named_with_the_effect(tmp_path: Path) -> None:
    known = 'C.backlash.b = { bounds = ["0 arcsec", "2 arcsec"] }'
    diagnosis = diagnose(*trunnion(tmp_path, known, C__backlash__b=0.01))
    assert [step.effect.title for step in diagnosis.steps] == ["backlash at C"]
    assert diagnosis.steps[0].parameters["b"].value == pytest.approx(36, abs=4)
    assert diagnosis.wrong_bounds.startswith(
        "C.backlash.b is held at its bound, 2 arcsec; without it the error falls"
    )


def test_rows_that_are_known_to_be_wrong_stay_out_where_a_bound_is_left_out(tmp_path: Path) -> None:
    machine, data = trunnion(tmp_path, "C.point.a = { bounds = [-0.05, 0.05] }", C__point__a=0.3)
    wrong = np.arange(data.rows) < 3
    freed = fit(machine, data, outliers=wrong).without_bounds
    assert freed is not None
    assert freed.outliers.tolist() == wrong.tolist()


@pytest.mark.thorough
def test_a_right_bound_stays_where_an_effect_is_missing(tmp_path: Path) -> None:
    """An eccentric encoder, not in the model, pulls the axis by 29 arcsec."""
    known = 'C.axis.a = { bounds = ["-3 arcsec", "3 arcsec"] }'
    eccentric = {"C__encoder_eccentricity__a": 0.03, "C__encoder_eccentricity__b": 0.02}
    diagnosis = diagnose(*trunnion(tmp_path, known, C__axis__a=0.0, **eccentric))
    assert [step.effect.title for step in diagnosis.steps] == ["encoder_eccentricity at C"]
    assert diagnosis.wrong_bounds == ""
    assert diagnosis.final.machine.known == diagnosis.base.machine.known != {}


@pytest.mark.parametrize(
    ("known", "wrong"),
    [
        pytest.param("", True, marks=pytest.mark.slow),
        ('C.axis.a = { prior = "48 ± 3 deg" }', False),
        ('C.axis.a = { prior = "0 ± 20 deg" }', False),
        ("C.axis.a = { bounds = [-60, 60] }", False),
    ],
)
def test_a_large_correction_is_plausible_where_the_file_says_so(
    known: str, wrong: bool, tmp_path: Path
) -> None:
    """The axis stands at 50 degrees to that of the file."""
    machine, data = trunnion(tmp_path, known, C__axis__a=50.0)
    found = check(machine, data)
    assert found.wrong is wrong
    assert found.suspicions == () or wrong
