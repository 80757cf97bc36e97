"""Inputs for the kernels of the derivation tricept_uncertainty: ordinary machines, a singular one, and no numbers."""

from __future__ import annotations

import numpy as np

DIRECTIONS = np.array([[np.cos(a), np.sin(a), 0] for a in np.radians([0, 120, -120])])


def parameter_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input that a kernel of the module has."""
    rng = np.random.default_rng(12)
    n = 12
    pose = np.column_stack([rng.uniform(-0.6, 0.6, (n, 2)), rng.uniform(400, 900, n)])
    pose[3] = 0, 0, 700
    pose[4] = 0, 0, 2e-3
    pose[5] = 1.2, -1.3, 650
    fixed = 330 * DIRECTIONS + rng.normal(scale=3, size=(n, 3, 3))
    moving = 140 * DIRECTIONS + rng.normal(scale=3, size=(n, 3, 3))
    fixed[3], moving[3] = 330 * DIRECTIONS, 140 * DIRECTIONS
    rods = rng.uniform(568, 858, (n, 3))
    guide = rng.normal(scale=0.05, size=(n, 14))
    guide[3] = 0
    if name == "tricept_parameter_sensitivity":
        pose[6] = 0, 0, 0  # the rods lie in one plane with the joints: the closures do not determine the pose
        fixed[6], moving[6] = 330 * DIRECTIONS, 140 * DIRECTIONS
    pose[7, 1] = np.nan
    return {
        "pose": pose,
        "fixed": fixed,
        "moving": moving,
        "tool": rng.normal(scale=50, size=(n, 3)),
        "rods": rods,
        "guide": guide,
        "alpha": pose[:, 0],
        "beta": pose[:, 1],
        "R": rng.uniform(100, 500, n),
        "r": rng.uniform(50, 200, n),
    }
