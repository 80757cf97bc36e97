"""The maximum of a smooth function of a few variables in a box, where an evaluation costs a millisecond.

A quasi-Newton climb (Broyden, Fletcher, Goldfarb, Shanno; Nocedal and Wright 2006, algorithm 6.1) with derivatives from
differences. Variables that a bound holds back wait. It needs half the evaluations of a simplex search, ends
nearer to the maximum, and does not need SciPy's optimisers, whose import takes as long as a small diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["climb"]

Array: TypeAlias = NDArray[np.float64]

DIFFERENCE = 1e-4
LONGEST = 1.0
"""Step of one variable: far from the maximum second derivatives tell little."""
ITERATIONS, HALVINGS = 25, 6
SUFFICIENT = 1e-4
"""Part of the predicted rise that a step must bring (Armijo 1966)."""


def climb(function: Callable[[Array], float], start: Array, low: Array, high: Array, *, rise: float) -> Array:
    """Return where a function is largest, near a start, (n,).

    Parameters
    ----------
    function : callable
        From (n,) to a number; -inf where it is not defined.
    start : ndarray, shape (n,)
    low, high : ndarray, shape (n,)
        Bounds.
    rise : float
        The climb ends where a step promises less than this.
    """
    x = np.clip(start, low, high)
    value = function(x)
    slope = _slope(function, x, value, high)
    inverse = np.eye(len(x)) * LONGEST / max(float(np.abs(slope).max(initial=0.0)), 1e-300)
    for _ in range(ITERATIONS):
        free = ~(((x <= low) & (slope < 0)) | ((x >= high) & (slope > 0)))
        step = np.zeros(len(x))
        step[free] = inverse[np.ix_(free, free)] @ slope[free]
        step *= min(1.0, LONGEST / max(float(np.abs(step).max(initial=0.0)), 1e-300))
        if slope @ step < rise:
            break
        for _ in range(HALVINGS):
            there = np.clip(x + step, low, high)
            reached = function(there)
            if reached > value + SUFFICIENT * slope @ (there - x):
                break
            step = step / 3
        else:
            break
        before, moved = slope, there - x
        x, value = there, reached
        slope = _slope(function, x, value, high)
        inverse = _updated(inverse, moved, before - slope)
    return x


def _slope(function: Callable[[Array], float], x: Array, value: float, high: Array) -> Array:
    """Return the first derivatives, (n,), by differences that stay in the box; zero where one is not finite."""
    steps = np.where(x + DIFFERENCE > high, -DIFFERENCE, DIFFERENCE)
    slope = np.array([(function(x + step) - value) / step.sum() for step in np.diag(steps)])
    return np.where(np.isfinite(slope), slope, 0.0)


def _updated(inverse: Array, moved: Array, fell: Array) -> Array:
    """Return the inverse after a step, along which the slope fell; the same where the function is not concave."""
    along = float(moved @ fell)
    if not along > 1e-12 * float(np.linalg.norm(moved) * np.linalg.norm(fell)):
        return inverse
    left = np.eye(len(moved)) - np.outer(moved, fell) / along
    return np.asarray(left @ inverse @ left.T + np.outer(moved, moved) / along)
