"""The angle in A cos θ + B sin θ + D = 0.

Problem: every closed form of a mechanism ends in this equation. With r = √(A² + B²) and A = r cos γ, B = r sin γ it is
cos(θ - γ) = -D/r, so θ = γ ± h with tan h = √(r² - D²) / -D: two angles where |D| < r, one where |D| = r, none where
|D| > r. Where A = B = 0 it holds for every angle or for none.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["TrigStatus", "solve_trig"]

EPS = float(np.finfo(float).eps)


class TrigStatus(IntEnum):
    """How many angles there are."""

    TWO = 0
    DOUBLE = 1
    INFEASIBLE = 2
    ALL = 3
    NONE = 4
    INVALID = 5


def solve_trig(A: ArrayLike, B: ArrayLike, D: ArrayLike, method: str = "trig") -> tuple[Any, Any]:
    """Find both angles with ``A cos(theta) + B sin(theta) + D = 0``."""
    a, b, d = np.broadcast_arrays(*(np.asarray(x, float) for x in (A, B, D)))
    with np.errstate(all="ignore"):
        size = np.maximum(np.maximum(abs(a), abs(b)), abs(d))
        good = np.isfinite(size)
        _, exponent = np.frexp(np.where(good, size, 1.0))
        a, b, d = (np.ldexp(x, -exponent) for x in (a, b, d))
        r = np.hypot(a, b)
        left = (r - d) * (r + d)
        double = abs(r - abs(d)) <= 4 * EPS * r
        root = np.sqrt(np.where(double | (left < 0), 0.0, left))
        gamma, half = np.arctan2(b, a), np.arctan2(root, -d)
        theta = np.stack([gamma + half, gamma - half], axis=-1)
        theta = theta - 2 * np.pi * np.where(theta > np.pi, 1, np.where(theta <= -np.pi, -1, 0))
    status = np.select(
        [~good, (r == 0) & (d == 0), r == 0, double, left < 0],
        [TrigStatus.INVALID, TrigStatus.ALL, TrigStatus.NONE, TrigStatus.DOUBLE, TrigStatus.INFEASIBLE],
        TrigStatus.TWO,
    ).astype(np.int8)
    there = (status == TrigStatus.TWO) | (status == TrigStatus.DOUBLE)
    return np.where(there[..., None], theta, np.nan), status[()]
