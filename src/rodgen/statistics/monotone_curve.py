"""A smooth curve through increasing points that increases between them, too.

A cubic in each interval, whose slopes at the points are weighted harmonic means of the chords' (Fritsch and Butland
1984); SciPy's `PchipInterpolator` is the same curve, and takes half a second to import.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from rodgen.array_types import Array


def monotone_curve(x: Array, y: Array) -> Callable[[Array], Array]:
    """Return a curve through points as a function, from the first x to the last.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Both increasing; two points or more.

    Examples
    --------
    >>> curve = monotone_curve(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 3.0]))
    >>> curve(np.array([0.0, 0.5, 1.0, 2.0, 3.0])).round(4)
    array([0.    , 1.2054, 2.    , 2.7143, 3.    ])
    """
    step, chord = np.diff(x), np.diff(y) / np.diff(x)
    slope = np.repeat(chord[0], len(x))
    if len(x) > 2:
        before, after = step[:-1], step[1:]
        to, onward = 2 * after + before, after + 2 * before
        slope[1:-1] = (to + onward) / (to / chord[:-1] + onward / chord[1:])
        slope[0] = _at_end(step[0], step[1], chord[0], chord[1])
        slope[-1] = _at_end(step[-1], step[-2], chord[-1], chord[-2])
    bend = (slope[:-1] + slope[1:] - 2 * chord) / step
    square, cube = (chord - slope[:-1]) / step - bend, bend / step
    return partial(
        _at, x, (y[:-1], slope[:-1], square, cube)
    )  # of a function of the module: it can be pickled


def _at(x: Array, coefficients: tuple[Array, ...], at: Array) -> Array:
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    constant, slope, square, cube = (each[i] for each in coefficients)
    t = at - x[i]
    return np.asarray(constant + slope * t + square * t**2 + cube * t**3)


def _at_end(step: float, next_step: float, chord: float, next_chord: float) -> float:
    """Return the slope at an end by the parabola through three points, where that does not fall."""
    return max(((2 * step + next_step) * chord - step * next_chord) / (step + next_step), 0.0)
