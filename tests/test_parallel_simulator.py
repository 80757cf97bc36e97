"""The simulator of machines of parallel legs: its loops and forces against SciPy, and against each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from machine_simulator import rotation
from parallel_simulator import LEGS, Parallel, about_y_then_x
from scipy.optimize import root

FILES: dict[str, dict[str, Any]] = {
    "tricept": {"geometry": {"R": 330.0, "r": 140.0, "q": [3.0, -4.0, 120.0]}},
    "3-sps-s": {"geometry": {"R": 200.0, "r": 120.0, "h": 260.0, "start": [0.0, 0.0, 42.0]}},
}
for name, made in FILES.items():
    made |= {
        "name": "A machine",
        "family": name,
        "units": {"length": "mm", "angle": "deg"},
        "environment": {"gravity": [0.3, -0.2, 0.9]},
        "measured": {"kind": "point"},
        "target": [{"name": "p", "point": [60.0, -30.0, 40.0]}],
    }
EFFECTS = {"leg_scale.k": 2e-4, "base_joint_offset.y": 0.7, "platform_joint_offset.z": -0.4}


def poses(family: str, rows: int) -> np.ndarray:
    random = np.random.default_rng(1)
    if family == "tricept":
        return random.uniform([-0.4, -0.4, 600], [0.4, 0.4, 780], (rows, 3))
    return random.uniform([-0.3, -0.3, 0.4], [0.3, 0.3, 1.0], (rows, 3))


@pytest.mark.parametrize("family", LEGS)
def test_a_closed_loop_is_what_scipy_closes(family):
    machine = Parallel(FILES[family], {f"{LEGS[family][1]}.{key}": x for key, x in EFFECTS.items()})
    x = poses(family, 8)
    q = machine.legs(x)
    read = machine.measure(q, start=x)
    at = np.radians({"tricept": [0, 120, -120], "3-sps-s": [-30, 90, 210]}[family])
    ring = np.stack([np.cos(at), np.sin(at), 0 * at], -1)
    g = machine.file["geometry"]
    base, platform = g["R"] * ring, g["r"] * ring
    base[1, 1] += 0.7
    platform[1, 2] -= 0.4
    for i, first in enumerate(x):

        def placed(at, p):
            if family == "tricept":
                turn = about_y_then_x(at[:1], at[1:2])[0]
                return turn @ np.add(p, (0, 0, at[2] * 600))
            return rotation(at) @ p + (0, 0, g["h"])

        def gap(at, i=i):
            length = [np.linalg.norm(placed(at, p) - a) for a, p in zip(base, platform, strict=True)]
            return np.array(length) - q[i] * [1, 1.0002, 1]

        start = first / [1, 1, 600] if family == "tricept" else first
        found = root(gap, start, tol=1e-14).x
        p = np.array([60, -30, 40]) + g.get("q", [0, 0, 0])
        assert read[i] == pytest.approx(placed(found, p), abs=1e-8)


@pytest.mark.parametrize("family", LEGS)
def test_forces_do_the_work_that_the_load_does(family):
    machine = Parallel(FILES[family])
    x = poses(family, 20)
    q, shape = machine.legs(x), machine.shape(displaced=False)
    target = np.array([60.0, -30.0, 40.0])

    def seen(length):
        pose = machine.closed(length, shape, x)
        return pose.origin + pose.turn @ target

    tension = machine.tensions(machine.closed(q, shape, x), shape, seen(q))
    step = 1e-3
    for k, e in enumerate(np.eye(3)):
        sinks = (seen(q + step * e) - seen(q - step * e)) @ machine.gravity / (2 * step)
        assert tension[:, k] == pytest.approx(sinks, abs=1e-7)
