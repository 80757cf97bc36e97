"""Deltas by plain NumPy and SciPy: where rods hold a platform, and the probe log of a printer with errors.

It shares no code with rodgen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import brentq, least_squares

PRINTER, ROBOT = np.array([210.0, 330.0, 90.0]), np.array([0.0, 120.0, 240.0])
R, L = 140.0, 290.0
UP = np.array([0.0, 0.0, 1.0])
TARGET = np.array([3.0, -2.0, -40.0])
R_OF_ROBOT, ARM, ROD = 140.0, 300.0, 750.0


def carriage_joints(q: np.ndarray, radius: Any = R, heading: Any = PRINTER) -> np.ndarray:
    """Upper joints of a printer, (3, 3)."""
    at = np.radians(heading)
    return np.stack([radius * np.cos(at), radius * np.sin(at), q], axis=1)


def elbows(q: np.ndarray, radius: Any = R_OF_ROBOT, arm: Any = ARM, heading: Any = ROBOT) -> np.ndarray:
    at, reach = np.radians(heading), radius + arm * np.cos(q)
    return np.stack([reach * np.cos(at), reach * np.sin(at), -arm * np.sin(q)], axis=1)


def hung(joints: np.ndarray, rod: Any, start: Sequence[float]) -> np.ndarray:
    """The platform by SciPy, from a start below."""
    found = least_squares(
        lambda p: np.linalg.norm(p - joints, axis=1) - rod, start, xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return np.asarray(found.x)


def commanded(x: float, y: float, z: float) -> np.ndarray:
    """Carriages of the printer as the firmware has it: by Pythagoras."""
    at = np.radians(PRINTER)
    return z + np.sqrt(L**2 - (x - R * np.cos(at)) ** 2 - (y - R * np.sin(at)) ** 2)


def spiral(count: int, reach: float) -> np.ndarray:
    """Places all over a round plate, (count, 2)."""
    k = np.arange(count) + 0.5
    r, turn = reach * np.sqrt(k / count), k * np.pi * (3 - np.sqrt(5))
    return np.stack([r * np.cos(turn), r * np.sin(turn)], axis=1)


def probed(
    count: int = 44,
    *,
    offset: Any = 0.0,
    radius: Any = R,
    rod: Any = L,
    heading: Any = PRINTER,
    noise: float = 0.012,
    seed: int = 0,
    plate: Callable[[float, float], float] = lambda x, y: 0.0,
) -> dict[str, np.ndarray]:
    """A probe log: the nozzle of a printer with errors is lowered until it touches the plate, z = plate(x, y)."""
    random = np.random.default_rng(seed)

    def height(z: float, x: float, y: float) -> float:
        q = commanded(x, y, z) + offset
        at = hung(carriage_joints(q, radius, heading), rod, [x, y, z])
        return float(at[2] - plate(at[0], at[1]))

    rows = []
    for x, y in spiral(count, 95):
        z = brentq(height, -9, 9, args=(x, y), xtol=1e-9)
        rows.append(commanded(x, y, z + random.normal(scale=noise)))
    return {f"{name} [mm]": column for name, column in zip("ABC", np.array(rows).T, strict=True)} | {
        "d [mm]": np.zeros(count)
    }
