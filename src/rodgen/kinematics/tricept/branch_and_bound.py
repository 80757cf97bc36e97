"""The least and the greatest value of functions over a box, certified: branch and bound with intervals.

Every remaining box is enclosed with the derivatives of the functions. Where a derivative has one sign,
the extreme is on a face, and the box shrinks to it; what remains is bounded from a corner or the centre by the
derivatives (mean value theorem), discarded when it cannot exceed a value that a point has reached, or halved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.kinematics.tricept._grids import grid_points
from rodgen.kinematics.tricept.interval import Jet, outward

# As many boxes as keep most arrays in the processor's cache; fewer where all functions are wanted of each.
_BLOCK, _FEW = 2048, 512


class Functions(Protocol):
    """Enclosures of m functions over n boxes."""

    def __call__(
        self, lower: Array, upper: Array, slopes: bool, which: NDArray[np.int64] | None = None
    ) -> Jet:
        """Return a `Jet` of shape (m, n), or of shape (n,): of each box the function `which`."""


@dataclass(frozen=True)
class Extremes:
    """Certified bounds of the least and the greatest values of m functions over a box."""

    outer: Array
    """No value is below the first or above the second, (m, 2)."""
    inner: Array
    """Values that are reached: the least is at most the first, the greatest at least the second, (m, 2)."""
    points: Array
    """Where, (m, 2, 3)."""
    boxes: int
    """How many boxes were looked at."""
    complete: bool
    """Whether the wanted gap was reached everywhere."""


def certified_extremes(
    function: Functions,
    low: Array,
    high: Array,
    *,
    gap: Array,
    parts: int = 16,
    most_boxes: int = 1_000_000,
) -> Extremes:
    """Return certified bounds of the range of functions over a box.

    Parameters
    ----------
    function : Functions
        Encloses them.
    low, high : ndarray, shape (3,)
        The box.
    gap : ndarray, shape (m,)
        How far outer and inner values of each function may differ.
    parts : int, optional
        Into how many parts each side is cut at the beginning: in large boxes derivatives are too uncertain to exclude
        anything, and one pass over all functions is cheaper than one for each.
    most_boxes : int, optional
        After so many boxes the bounds stay as wide as they are.
    """
    start = function(low[:, None], high[:, None], False)
    m = len(start.value[0])
    # Problem p asks for the greatest value of sign * f: first all least, then all greatest values.
    signs, which = np.repeat([-1.0, 1.0], m), np.tile(np.arange(m), 2)
    best = np.full(2 * m, -np.inf)
    places = np.zeros((2 * m, 3))
    bound = np.full(2 * m, -np.inf)  # of everything that was thrown away
    points = lattice(low, high)
    _keep_greatest(
        _signed(function(points, points, False).value, signs.reshape(2, m, 1))[0], points, best, places
    )

    queue_low, queue_high, queue, looked = _first(
        function, _divided(low, high, parts), signs, best, places, bound, gap
    )
    while queue.size and looked < most_boxes:
        part = slice(-_BLOCK, None)
        lower, upper, problem = queue_low[:, part].copy(), queue_high[:, part].copy(), queue[part]
        queue_low, queue_high, queue = queue_low[:, :-_BLOCK], queue_high[:, :-_BLOCK], queue[:-_BLOCK]
        looked += len(problem)
        lower, upper, slope, value, top = _bounded(function, lower, upper, signs[problem], which[problem])
        _keep_best(value[0], lower, upper, problem, best, places)
        thin = (lower >= upper).all(axis=0)
        done = (top <= (best + np.tile(gap, 2))[problem]) | thin
        np.maximum.at(bound, problem[done], top[done])
        rest = ~done
        if rest.any():
            lower, upper = lower[:, rest], upper[:, rest]
            lower, upper = halved(lower, upper, _widest_change(lower, upper, slope[:, rest]))
            queue_low = np.concatenate([queue_low, lower], axis=1)
            queue_high = np.concatenate([queue_high, upper], axis=1)
            queue = np.concatenate([queue, problem[rest], problem[rest]])
    complete = not queue.size
    for first in range(0, queue.size, _BLOCK):  # no more boxes: what was not looked at is bounded as a whole
        part = slice(first, first + _BLOCK)
        found = function(queue_low[:, part], queue_high[:, part], False, which[queue[part]])
        np.maximum.at(bound, queue[part], _signed(found.value, signs[queue[part]])[1])
    # a point that was reached by rounding up a little may lie above the bound of all boxes
    outer = np.maximum(bound, best).reshape(2, m).T * [-1.0, 1.0]
    inner = best.reshape(2, m).T * [-1.0, 1.0]
    return Extremes(outer, inner, places.reshape(2, m, 3).transpose(1, 0, 2), looked, complete)


def lattice(low: Array, high: Array) -> Array:
    """Return points of a box, its corners among them."""
    unit = grid_points(*[np.linspace(0.0, 1.0, 7)] * 3)
    return np.clip(low[:, None] + (high - low)[:, None] * unit, low[:, None], high[:, None])


def _divided(low: Array, high: Array, parts: int) -> tuple[Array, Array]:
    """Return a box cut into equal ones; the cuts are shared, so that nothing is between two boxes."""
    cuts = [
        np.linspace(a, b, parts + 1) if b > a else np.array([a, b]) for a, b in zip(low, high, strict=True)
    ]
    for cut, b in zip(cuts, high, strict=True):
        cut[-1] = b
    return grid_points(*(cut[:-1] for cut in cuts)), grid_points(*(cut[1:] for cut in cuts))


def _signed(ends: tuple[Array, Array], sign: Array) -> tuple[Array, Array]:
    """Return the ends with the signs of their problems; NaN becomes an infinite bound."""
    low, high = np.where(sign > 0, ends[0], -ends[1]), np.where(sign > 0, ends[1], -ends[0])
    return np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)


def _first(
    function: Functions,
    boxes: tuple[Array, Array],
    signs: Array,
    best: Array,
    places: Array,
    bound: Array,
    gap: Array,
) -> tuple[Array, Array, NDArray[np.int64], int]:
    """Return which boxes of a grid remain for which problem, after one pass over all problems."""
    lower, upper = boxes
    count, m = lower.shape[1], len(gap)
    sign = signs.reshape(2, m, 1)
    tops = np.empty((2, m, count))
    for start in range(0, count, _FEW):
        part = slice(start, start + _FEW)
        a, b = lower[:, part], upper[:, part]
        found = function(a, b, True)
        assert found.slope is not None
        centre = _centres(a, b)
        value = _signed(function(centre, centre, False).value, sign)
        slope = np.maximum(np.abs(found.slope[0]), np.abs(found.slope[1]))
        slope = np.where(np.isnan(slope), np.inf, slope)
        total = _linear(value[1], np.broadcast_to(slope[:, None], (3, *value[1].shape)), a, b, centre)
        tops[:, :, part] = np.minimum(total, _signed(found.value, sign)[1])
        _keep_greatest(value[0], centre, best, places)
    flat = tops.reshape(2 * m, count)
    left = flat > (best + np.tile(gap, 2))[:, None]
    np.maximum(bound, np.where(left, -np.inf, flat).max(axis=1), out=bound)
    problem, box = np.nonzero(left)
    return lower[:, box], upper[:, box], problem, count


def _linear(top: Array, slope: Array, lower: Array, upper: Array, centre: Array) -> Array:
    """Return upper bounds of functions by the value at the centre and the derivatives, rounded up."""
    reach = outward(upper - centre, np.maximum(upper - centre, centre - lower))[1]
    reach = np.where(upper > lower, reach, 0.0)
    for n in range(3):
        with np.errstate(invalid="ignore"):
            step = np.where(reach[n] > 0, outward(slope[n], slope[n] * reach[n])[1], 0.0)
            top = outward(top, top + step)[1]
    return np.where(np.isnan(top), np.inf, top)


def _bounded(
    function: Functions,
    lower: Array,
    upper: Array,
    sign: Array,
    which: NDArray[np.int64],
) -> tuple[Array, Array, Array, tuple[Array, Array], Array]:
    """Return boxes shrunk to faces, and upper bounds of the problems' functions on them.

    With them come the largest possible |derivative| in the remaining directions and the value at one point.
    """
    found = function(lower, upper, True, which)
    assert found.slope is not None
    least, greatest = _signed(found.slope, sign)
    rising, falling = least >= 0, greatest <= 0
    lower, upper = np.where(rising, upper, lower), np.where(falling & ~rising, lower, upper)
    centre = _centres(lower, upper)
    value = _signed(function(centre, centre, False, which).value, sign)
    slope = np.where(rising | falling, 0.0, np.maximum(np.abs(least), np.abs(greatest)))
    whole = _signed(found.value, sign)[1]
    return lower, upper, slope, value, np.minimum(_linear(value[1], slope, lower, upper, centre), whole)


def _keep_greatest(values: Array, points: Array, best: Array, places: Array) -> None:
    """Keep the greatest of the values (2, m, n) at points (3, n) of each problem where it is better."""
    for p, row in enumerate(values.reshape(len(best), -1)):
        n = int(row.argmax())
        if row[n] > best[p]:
            best[p], places[p] = row[n], points[:, n]


def _keep_best(
    value: Array,
    lower: Array,
    upper: Array,
    problem: NDArray[np.int64],
    best: Array,
    places: Array,
) -> None:
    """Keep the best values that the centres of boxes, each of one problem, have reached."""
    centre = _centres(lower, upper)
    order = np.argsort(value)
    final = np.full(len(best), -1)
    final[problem[order]] = order  # the last one of each problem is its greatest
    for p in np.flatnonzero(final >= 0):
        n = final[p]
        if value[n] > best[p]:
            best[p], places[p] = value[n], centre[:, n]


def _widest_change(lower: Array, upper: Array, slope: Array) -> NDArray[np.int64]:
    """Return the side of each box over which the function can change most."""
    width = upper - lower
    with np.errstate(invalid="ignore"):
        weight = np.where(width > 0, np.minimum(slope, 1e300) * width, -1.0)
    side: NDArray[np.int64] = np.argmax(weight, axis=0)
    return side


def halved(lower: Array, upper: Array, side: NDArray[np.int64] | int) -> tuple[Array, Array]:
    """Return boxes (3, n) halved across a side, of each or of all: first the lower halves, then the upper ones."""
    columns = np.arange(lower.shape[1])
    middle = lower[side, columns] + (upper[side, columns] - lower[side, columns]) / 2
    first, second = upper.copy(), lower.copy()
    first[side, columns] = second[side, columns] = middle
    return np.concatenate([lower, second], axis=1), np.concatenate([first, upper], axis=1)


def _centres(lower: Array, upper: Array) -> Array:
    """Return the middles of boxes, never outside of them by rounding."""
    return np.clip(lower + (upper - lower) / 2, lower, upper)
