"""The ratio of the noises of positions and attitudes, where none is stated; poses made by rotation matrices alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rodgen
from rodgen.calibration.fit import fit

PLACE, TURN = 0.1, 2e-4  # mm, rad
FILE = """
name = "Two axes of an arm, and a tracker of six freedoms"
units = { length = "mm", angle = "rad" }
joint = [
  { name = "A1", type = "revolute", axis = [0, 0, 1] },
  { name = "A2", type = "revolute", axis = [0, 1, 0], point = [0, 0, 340] },
]
target = [{ name = "tool", point = [0, 0, 1300] }]
measured = { kind = "pose", frame = "free" }
estimate = { parameters = ["target"] }
"""


def arm_of(tmp_path, mounted: list[float], off: float = 0.0, twice: bool = False) -> float:
    """Fit poses of runs, in each of which the marker is mounted anew, turned by an angle; A2's zero may be off."""
    random = np.random.default_rng(4)
    a1, a2 = random.uniform(-2.5, 2.5, 60), random.uniform(-1, 1.2, 60)
    if twice:
        a1, a2 = np.tile(a1[:30], 2), np.tile(a2[:30], 2)
    run = np.arange(60) * len(mounted) // 60
    first, second = (
        Rotation.from_rotvec(np.outer(a, e)) for a, e in ((a1, [0, 0, 1]), (a2 + off * a2**2, [0, 1, 0]))
    )
    body = first * second * Rotation.from_rotvec(np.outer(np.array(mounted)[run], [0, 0, 1]))
    place = (
        first.apply([0, 0, 340]) + (first * second).apply([0, 0, 960]) + PLACE * random.normal(size=(60, 3))
    )
    turned = (Rotation.from_rotvec(TURN * random.normal(size=(60, 3))) * body).as_matrix()
    columns = {"A1 [rad]": a1, "A2 [rad]": a2, "run": [f"r{i}" for i in run]}
    columns |= {f"{x} [mm]": place[:, i] for i, x in enumerate("xyz")}
    columns |= {f"r{i + 1}{j + 1}": turned[:, i, j] for i in range(3) for j in range(3)}
    (tmp_path / "m.toml").write_text(FILE)
    return fit(rodgen.Machine.load(str(tmp_path / "m.toml")), columns).observations.arm


def test_it_is_that_of_the_residuals(tmp_path) -> None:
    assert arm_of(tmp_path, [0.0]) == pytest.approx(PLACE / TURN, rel=0.15)


def test_a_marker_that_is_mounted_anew_in_each_run_is_no_noise(tmp_path) -> None:
    assert arm_of(tmp_path, [0.0, 0.35, 0.66]) == pytest.approx(PLACE / TURN, rel=0.2)


def test_repeated_poses_do_not_ask_the_model(tmp_path) -> None:
    """The error of a joint that the model lacks raises both by much, and not alike."""
    wrong = arm_of(tmp_path, [0.0], off=3e-3)
    assert wrong > 1.5 * PLACE / TURN
    assert arm_of(tmp_path, [0.0], off=3e-3, twice=True) == pytest.approx(PLACE / TURN, rel=0.2)
