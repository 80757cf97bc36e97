"""Inputs for the kernels of spherical polygons: ordinary ones, and ones near or at what a kernel decides by."""

from __future__ import annotations

import numpy as np

RIGHT = np.pi / 2


def quadrilaterals() -> dict[str, np.ndarray]:
    """Twists and the given angle: closed in two ways, in one, in none, and with axes that coincide."""
    rng = np.random.default_rng(31)
    alpha = rng.uniform(0.6, 1.3, size=(8, 4)) * rng.choice([-1, 1], size=(8, 4))
    theta = rng.uniform(-3, 3, size=8)
    special = [
        ([0.5, 0.7, 0.9, 1.1], 0.0),
        ([0.3, 0.2, 1.5, 1.5], 3.0),  # out of reach
        ([0.6, 0.8, 0.5, 0.9], 0.0),  # stretched: 0.6 + 0.8 = 0.5 + 0.9
        ([0.6, 0.8, 0.5, 0.9 + 1e-9], 0.0),
        ([RIGHT, RIGHT, RIGHT, RIGHT], RIGHT),
        ([0.0, 0.7, 0.9, 0.4], 2.0),  # the first two axes coincide, and it does not close
        ([0.8, 0.8, 0.6, 0.6], np.pi),  # the first and the third axis may coincide
        ([np.pi, 0.7, 0.9, 0.4], 2.0),
        ([0.5, np.nan, 0.9, 1.1], 1.0),
        ([0.5, 0.7, 0.9, 1.1], np.inf),
    ]
    return {
        "alpha": np.concatenate([alpha, [row for row, _ in special]]),
        "theta_4": np.concatenate([theta, [angle for _, angle in special]]),
    }


def pentagons() -> dict[str, np.ndarray]:
    """Twists and the two given angles: closed in two ways, in one, in none, and with axes that coincide."""
    rng = np.random.default_rng(32)
    alpha = rng.uniform(0.6, 1.4, size=(8, 5)) * rng.choice([-1, 1], size=(8, 5))
    theta = rng.uniform(-3, 3, size=(8, 2))
    special = [
        ([1.2, 1.0, 0.3, 0.4, 0.5], [0.3, -0.4]),
        ([0.2, 0.3, 1.5, 0.4, 1.0], [0.3, 0.4]),
        ([0.6, 0.8, 0.5, 0.2, 0.7], [0.0, 0.0]),
        ([0.6, 0.0, 0.5, 0.2, 0.7], [0.1, 0.2]),
        ([0.8, 0.8, 0.5, 0.2, 0.3], [0.0, np.pi]),
        ([RIGHT, RIGHT, RIGHT, RIGHT, RIGHT], [RIGHT, RIGHT]),
        ([0.5, np.nan, 0.9, 1.1, 1.0], [1.0, 1.0]),
        ([0.5, 0.7, 0.9, 1.1, 1.0], [1.0, -np.inf]),
    ]
    return {
        "alpha": np.concatenate([alpha, [row for row, _ in special]]),
        "theta_45": np.concatenate([theta, [angles for _, angles in special]]),
    }


def polygon_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input that a kernel of the module has."""
    if name == "polygon_quadrilateral":
        return quadrilaterals()
    if name == "polygon_pentagon":
        return pentagons()
    rng = np.random.default_rng(33)
    size = 2 * int(name[-1]) + 1
    angles = rng.uniform(-7, 7, size=(8, size))
    angles = np.concatenate([angles, rng.integers(-2, 3, size=(4, size)) * RIGHT, np.full((1, size), np.nan)])
    lengths = rng.normal(size=angles.shape) * 10.0 ** rng.integers(-3, 4, size=(len(angles), 1))
    return {"angles": angles, "lengths": lengths}
