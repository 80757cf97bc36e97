"""The squareness of an instrument's own axes: told from errors of the joints where joints cannot imitate it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hidden_effects import BENCHES
from machine_simulator import arcsec

from rodgen.calibration.fit import Fit, fit
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

SQUARENESS = ("instrument_squareness", None)


def diagnosis(folder: Path, bench: str, seed: int, truth: dict[str, float]) -> Any:
    """Diagnose a machine that an instrument with errors of its axes has measured."""
    of = BENCHES[bench](np.random.default_rng(seed), 0.6)
    machine = of.simulator(of.file, {**of.wrong, **truth})
    reading = machine.with_noise(
        machine.measure(of.q, target=of.target), of.sigma, np.random.default_rng(seed)
    )
    (folder / "machine.toml").write_text(of.text.replace("{noise}", ""), encoding="utf-8")
    machine.write_csv(folder / "data.csv", q=of.q, reading=reading, target=of.target)
    fit = Machine.load(folder / "machine.toml").fit(Measurements.load(folder / "data.csv"))
    return fit.diagnose()


@pytest.mark.thorough("rotary_table-xy")
@pytest.mark.parametrize("angle", ["xy", pytest.param("xz", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "bench",
    [
        "rotary_table",
        "trunnion",
        *(pytest.param(b, marks=pytest.mark.slow) for b in ("robot", "gantry_rotary")),
    ],
)
def test_turning_joints_do_not_imitate_an_instrument_that_is_not_square(bench, angle, tmp_path):
    """A circle is read as an ellipse: no error motion of the joint does that at every radius and height."""
    found = diagnosis(tmp_path, bench, 1, {f"instrument_squareness.{angle}": arcsec(20)})
    assert [step.effect.identity for step in found.steps] == [SQUARENESS]
    assert not found.steps[0].indistinguishable_from
    for key, estimate in found.final.estimates.items():
        if key.startswith("instrument_squareness."):
            true = 20.0 if key.endswith(angle) else 0.0
            assert abs(estimate.value - true) < 4 * estimate.std < 8, key


def test_where_the_machines_own_axes_do_the_same_both_are_said(tmp_path):
    found = diagnosis(tmp_path, "gantry", 1, {"instrument_squareness.xy": arcsec(20)})
    (step,) = found.steps
    assert step.effect.identity == ("squareness", "Y")
    assert SQUARENESS in {other.effect.identity for other in step.indistinguishable_from}


# Where the pose of a body was measured, its markers are right or wrong together, and their distances say no
# noise


def of_table(folder: Path, noise: float) -> Fit:
    """Fit a trunnion that stands 36 arcsec off in every pose, and once half a degree; its balls are seen with noise."""
    random = np.random.default_rng(3)
    bench = BENCHES["trunnion"](random, 0.6)
    _, pose = np.unique(bench.q, axis=0, return_inverse=True)
    off = random.normal(size=(pose.max() + 1, 2)) * 0.01
    off[pose[20]] = [0, 0.6]
    machine = bench.simulator(bench.file, bench.wrong)
    reading = machine.measure(bench.q + off[pose], target=bench.target)
    reading = machine.with_noise(reading, noise, random)
    (folder / "machine.toml").write_text(bench.text.replace("{noise}", ""))
    machine.write_csv(folder / "data.csv", q=bench.q, reading=reading, target=bench.target)
    machine_file, data = Machine.load(folder / "machine.toml"), Measurements.load(folder / "data.csv")
    return fit(machine_file, data, loss="huber")


@pytest.mark.slow
def test_a_pose_is_an_outlier_as_a_whole(tmp_path: Path) -> None:
    """One of two balls was left out, or two of three."""
    found = of_table(tmp_path, 0.0)
    diagnosis = fit(found.problem.model.machine, found.observations).diagnose()
    pose = found.observations.pose
    for outliers in (np.flatnonzero(found.outliers), np.array(diagnosis.outliers)):
        assert {20, 21} <= set(outliers)
        np.testing.assert_array_equal(np.isin(pose, pose[outliers]).nonzero()[0], outliers)
    assert "The targets keep their distances to " in found.summary()
    assert "the pose of one body, and this does not say how well." in found.summary()


@pytest.mark.parametrize("noise", [0.001, 0.01])
def test_balls_that_are_read_one_by_one_are_no_body(noise: float, tmp_path: Path) -> None:
    found = of_table(tmp_path, noise)
    assert not found.noise.one_body
    assert found.noise.distances == pytest.approx(noise, rel=0.2)  # 14 poses, 5 distances each


@pytest.mark.thorough
def test_a_slip_of_the_comma_does_not_make_balls_one_body(tmp_path: Path) -> None:
    """The other five balls of the pose were taken out with the wrong one."""
    table = Path(__file__).parent.parent / "examples/machines/rotary_table"
    lines = (table / "data.csv").read_text(encoding="utf-8").splitlines()
    cells = lines[50].split(",")
    cells[2] = str(10 * float(cells[2]))
    (tmp_path / "data.csv").write_text("\n".join([*lines[:50], ",".join(cells), *lines[51:]]) + "\n")
    found = fit(Machine.load(table / "machine.toml"), Measurements.load(tmp_path / "data.csv"))
    assert not found.noise.one_body
    assert "one body" not in found.summary()
    assert found.diagnose().outliers == (49,)
