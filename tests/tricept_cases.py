"""Inputs for the kernels of the Tricept: ordinary poses, and every degenerate case."""

from __future__ import annotations

import numpy as np

R, SMALL = 330.0, 140.0  # the paper's machine
LIMITS = (568.0, 858.0)


def poses() -> np.ndarray:
    """Poses in the workspace, beyond it, upside down, at and near singular ones."""
    rng = np.random.default_rng(11)
    inside = np.column_stack([rng.uniform(-0.4, 0.4, (12, 2)), rng.uniform(560, 780, 12)])
    far = np.column_stack([rng.uniform(-3, 3, (6, 2)), rng.uniform(-900, 900, 6)])
    special = [
        [0, 0, 600],
        [0, 0, -600],
        [np.pi / 2, 0.3, 600],
        [0.2, np.pi / 2, 500],
        [1.2, -1.1, 40],
        [1e-9, -1e-9, 650],
        [np.nan, 0, 600],
        [0, 0, np.inf],
    ]
    return np.concatenate([inside, far, special])


def points() -> np.ndarray:
    """Points in the workspace and beyond it, and where roots vanish or are imaginary."""
    rng = np.random.default_rng(12)
    inside = np.column_stack([rng.uniform(-250, 250, (12, 2)), rng.uniform(560, 780, 12)])
    special = [
        [30, 20, 600],
        [30, -20, -600],
        [-250, 300, 650],
        [0, 700, 0],  # beta is not determined
        [0, 0, 0],
        [0.25, 600, 0.125],
        [30, 100, 40],  # with q_x = 50 a double root
        [30, 100, 39],  # and none
        [10, 0, 0],
        [np.nan, 0, 600],
        [0, -np.inf, 600],
    ]
    return np.concatenate([inside, special])


def covariances(n: int) -> np.ndarray:
    """Covariance matrices: diagonal, full, of rank one, nothing; and what is none."""
    rng = np.random.default_rng(13)
    full = rng.normal(size=(n, 5, 5)) * np.array([3e-3, 3e-3, 3e-3, 6e-3, 6e-3])[:, None]
    U = full @ full.swapaxes(1, 2)
    U[0] = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
    U[1] = np.outer(np.arange(1, 6), np.arange(1, 6)) * 1e-6
    U[2] = 0
    U[3] = np.diag([1e-6, 0, 1e-6, 0, 1e-6])
    U[4] = U[5]
    U[4, 0, 1] *= 1.5  # not symmetric
    U[6] = np.diag([1e-6, 1e-6, -1e-6, 1e-6, 1e-6])
    U[7] = np.diag([1.0, 1, 1, 1, 1]) * 1e-6
    U[7, 0, 1] = U[7, 1, 0] = 1.1e-6  # a correlation above 1
    U[8] = np.full((5, 5), np.nan)
    return U


def inputs(names: set[str]) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input of a kernel with these inputs."""
    if "pose" in names:
        values = {"pose": poses()}
    elif "legs" in names:
        rng = np.random.default_rng(14)
        special = [
            [600, 600, 600],
            [190, 190, 190],  # z = 0: a singular pose
            [200, 201, 199],
            [100, 100, 100],
            [2000, 2001, 1999],
            [600, 600, -600],
            [0, 600, 600],
            [np.nan, 600, 600],
            [600, np.inf, 600],
        ]
        values = {"legs": np.concatenate([rng.uniform(568, 858, (16, 3)), special])}
    else:
        values = {"point": points()}
    n = len(next(iter(values.values())))
    values |= {"r": np.full(n, SMALL), "R": np.full(n, R)}
    values |= {"q_x": np.zeros(n), "q_y": np.zeros(n), "q_z": np.zeros(n)}
    with_q = np.arange(n) % 3 == 1
    for name, value in (("q_x", 20.0), ("q_y", -30.0), ("q_z", 50.0)):
        values[name][with_q] = value
    if "point" in names:
        for name, value in (("q_x", 50.0), ("q_y", 0.0), ("q_z", 0.0)):
            values[name][18:20] = value
        values["R"][2] = values["r"][2]
        values["r"][21] = -1.0
    values |= {"shortest": np.full(n, LIMITS[0]), "longest": np.full(n, LIMITS[1])}
    values["U_x"] = covariances(n)
    return values
