"""Inputs for the kernels of links: ordinary robots and poses, and poses at and near what a kernel decides by."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

COUNT = 12


def poses(rng: np.random.Generator) -> np.ndarray:
    """Rotations and origins; the last ones have S6 along the first axis, on it, or are no poses."""
    found = np.tile(np.eye(4), (COUNT + 8, 1, 1))
    found[:COUNT, :3, :3] = Rotation.random(COUNT, random_state=21).as_matrix()
    found[:COUNT, :3, 3] = rng.normal(size=(COUNT, 3)) * 10.0 ** rng.integers(-2, 4, size=(COUNT, 1))
    turned = Rotation.from_euler("z", 0.7).as_matrix()
    for row, (sign, origin) in enumerate([(1, [3, 4, 2]), (-1, [3, 4, 2]), (1, [0, 0, 2]), (-1, [0, 0, 0])]):
        found[COUNT + row, :3, :3] = np.diag([1.0, sign, sign]) @ turned
        found[COUNT + row, :3, 3] = origin
    found[COUNT + 4, :3, :3] = Rotation.from_rotvec([1e-5, 0, 0]).as_matrix()
    found[COUNT + 4, :3, 3] = [1.0, 2.0, 3.0]
    found[COUNT + 5, :3, 0] *= -1
    found[COUNT + 6, 0, 3] = np.nan
    found[COUNT + 7, :3, :3] *= 1.01
    return found


def link_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input that a kernel of the module has."""
    rng = np.random.default_rng(22)
    if name in ("link_forward_6r", "link_jacobian_6r"):
        right = rng.random((COUNT, 5)) < 0.5
        alpha = np.where(right, rng.choice([0, np.pi / 2], (COUNT, 5)), 3 * rng.normal(size=(COUNT, 5)))
        return {
            "a": rng.normal(size=(COUNT, 5)) * rng.integers(0, 2, size=(COUNT, 5)),
            "cos_alpha": np.cos(alpha),
            "sin_alpha": np.sin(alpha),
            "offset": 100 * rng.normal(size=(COUNT, 6)),
            "angle": rng.uniform(-7, 7, size=(COUNT, 6)),
        }
    given = poses(rng)
    count = len(given)
    alpha = rng.uniform(-3, 3, size=count)
    return {
        "frame": given,
        "transform": given,
        "pose": given,
        "a": rng.normal(size=count),
        "cos_alpha": np.cos(alpha),
        "sin_alpha": np.sin(alpha),
        "offset": rng.normal(size=count),
        "angle": rng.uniform(-7, 7, size=count),
        # exactly parallel axes need the twist 0 and the length 0
        "a67": np.where(np.arange(count) < COUNT, rng.normal(size=count), 0.0),
        "alpha67": np.where(np.arange(count) < COUNT, rng.choice([np.pi / 2, np.pi / 4, 0.3], count), 0.0),
        "tolerance": np.full(count, 1e-4),
    }
