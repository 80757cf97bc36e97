"""The maximum of a smooth function of a few variables in a box, where an evaluation costs a millisecond.

Newton's method with derivatives and an estimate of the curvature that is never negative, as the information of a
likelihood is (Nocedal and Wright 2006, chapters 3 and 16). Variables that a bound holds back wait.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from rodgen.array_types import Array
from rodgen.statistics.decompositions import eigh

Function: TypeAlias = Callable[[Array], tuple[float, Callable[[], tuple[Array, Array]]]]

LONGEST = 1.0
"""Step of one variable: far from the maximum second derivatives tell little."""
FLATTEST = 1e-6
"""Part of the largest curvature that is added to all: along a direction without any a step is to stay finite."""
ITERATIONS, HALVINGS = 25, 6
SUFFICIENT = 1e-4
"""Part of the predicted rise that a step must bring (Armijo 1966)."""


def climb(function: Function, start: Array, low: Array, high: Array, *, rise: float) -> Array:
    """Return where a function is largest, near a start, (n,).

    Parameters
    ----------
    function : callable
        From (n,) to a number, -inf where it is not defined, and to a function that returns the derivatives there, (n,),
        and the curvature, (n, n): about minus the second derivatives, positive semidefinite.
    start : ndarray, shape (n,)
    low, high : ndarray, shape (n,)
        Bounds.
    rise : float
        The climb ends where a step promises less than this.
    """
    x = np.clip(start, low, high)
    value, derivatives = function(x)
    if not np.isfinite(value):
        return x
    for _ in range(ITERATIONS):
        slope, curvature = derivatives()
        if not (np.isfinite(slope).all() and np.isfinite(curvature).all()):
            break  # beyond the range of numbers no step is known
        free = ~(((x <= low) & (slope < 0)) | ((x >= high) & (slope > 0)))
        if not free.any():
            break
        step = np.zeros(len(x))
        step[free] = _newton(slope[free], curvature[np.ix_(free, free)])
        if slope @ step < rise:
            break
        for _ in range(HALVINGS):
            there = np.clip(x + step, low, high)
            reached, derivatives = function(there)
            if reached > value + SUFFICIENT * slope @ (there - x):
                break
            step = step / 3
        else:
            break
        x, value = there, reached
    return x


def _newton(slope: Array, curvature: Array) -> Array:
    """Return the step to where the slope vanishes, damped so that no variable moves by more than `LONGEST`."""
    values, vectors = eigh(curvature)
    along = vectors.T @ slope
    damping = max(FLATTEST * float(values[-1]), 1e-300)
    while True:
        step = vectors @ (along / (np.maximum(values, 0.0) + damping))
        if np.abs(step).max() <= LONGEST:
            return np.asarray(step)
        damping *= 4
