"""Inputs for the kernels of closed loops: ordinary ones, and ones at what a kernel decides by."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

COUNT = 10


def loop_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input of a kernel."""
    rng = np.random.default_rng(41)
    if name.startswith("loop_pair_"):
        return ring_inputs(rng)
    links = 4 if name == "loop_rccc" else 5
    alpha = rng.uniform(-np.pi, np.pi, (COUNT, links))
    a = rng.uniform(-2, 2, (COUNT, links))
    angles = rng.uniform(-np.pi, np.pi, (COUNT, 3))
    values = {"alpha": alpha, "a": a}
    if name == "loop_rccc":
        alpha[:4] = np.radians([40, 70, 85, 70])  # closes at every angle; most of the random ones do not
        alpha[4] = np.radians([90, 45, 45, 0])  # two axes parallel: a triangle, and theta_4 turns nothing
        alpha[5] = np.radians([0, 50, 50, 30])  # an equation that says nothing of theta_1
        a[6] *= 1e6
        values |= {"S_4": rng.uniform(-1, 1, COUNT), "theta_4": angles[:, 0]}
        values["theta_4"][0] = np.radians(75.0)
        values["S_4"][9] = np.inf
        values["theta_4"][8] = np.nan
        return values
    alpha[0] = np.radians([90, 0, 90, 60, 90])
    a[1] *= 1e6
    a[2] = 0.0
    values |= {"S": rng.uniform(-2, 2, (COUNT, 3)), "theta_5": angles[:, 0]}
    values["theta_5"][9] = np.nan
    if name == "loop_rrrcc_back":
        values |= {"theta_1": angles[:, 1], "theta_2": angles[:, 2]}
    return values


def ring_inputs(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Rings of four links: any ones, one of right angles, one with parallel axes, and one that is not finite."""
    rotations = Rotation.random(4 * 5, random_state=8).as_matrix().reshape(5, 4, 3, 3)
    rotations[1] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    vectors, p, q = rng.normal(size=(5, 4, 3)), rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    rotations[3, 3] = np.eye(3)
    p[4, 1] = np.nan
    return {"rotation": rotations, "vector": vectors, "p": p, "q": q}
