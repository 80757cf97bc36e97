"""Interval arithmetic with derivatives, enclosures of a Tricept's matrices, and certified extremes over a box.

Every result encloses the exact one: each operation of IEEE 754 (+, −, ·, /, √) has a relative error of at most
the unit roundoff, 2⁻⁵³, and both ends are moved outwards by four times that. Where something is not bounded the ends
are NaN or infinite, never too narrow.

Enclosed are every element of A35(Q), its derivatives by Q, and the rods' lengths, while Q is anywhere in an
axis-aligned box. The steps of the kernel `tricept_at_point`, of which the derivation proves that they give these
matrices and rods, are evaluated on intervals. It has no angles, so that only +, −, ·, / and √ occur.

Extremes are found by branch and bound: every remaining box is enclosed with the derivatives of the functions. Where a
derivative has one sign, the extreme is on a face, and the box shrinks to it; what remains is bounded from a corner or
the centre by the derivatives (mean value theorem), discarded when it cannot exceed a value that a point has reached, or
halved.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.generated.numpy.tricept import tricept_at_point
from rodgen.kinematics.tricept._geometry import Geometry

Ends = tuple[Array, Array]
"""Lower and upper ends of intervals."""

_RELATIVE = 2.0**-51
# Far above the rounding of results that are not normal numbers, 2^-1075.
_ABSOLUTE = 1e-300


def outward(low: Array, high: Array) -> Ends:
    """Return both ends moved outwards by more than what rounding to nearest can have moved them inwards.

    A result v of one operation is off by at most 2^-53 |v| + 2^-1075; 2^-51 |v| + 1e-300 is taken off, and the rounding
    of that is again at most about 2^-53 |v|.
    """
    return low - (np.abs(low) * _RELATIVE + _ABSOLUTE), high + (np.abs(high) * _RELATIVE + _ABSOLUTE)


def _times(a: Ends, b: Ends) -> Ends:
    for interval, number in ((a, b), (b, a)):
        if number[0] is number[1]:
            one, two = interval[0] * number[0], interval[1] * number[0]
            return outward(np.minimum(one, two), np.maximum(one, two))
    one, two, three, four = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    return outward(
        np.minimum(np.minimum(one, two), np.minimum(three, four)),
        np.maximum(np.maximum(one, two), np.maximum(three, four)),
    )


def _plus(a: Ends, b: Ends) -> Ends:
    return outward(a[0] + b[0], a[1] + b[1])


class Jet:
    """Enclosures of values and, where there are any, of their derivatives by the box's coordinates.

    Parameters
    ----------
    value : pair of ndarray, shape (..., n)
        Lower and upper ends; n boxes.
    slope : pair of ndarray, shape (3, ..., n), or None
        The same of the derivatives; None for constants, and where no derivatives are wanted.
    """

    __slots__ = ("slope", "value")

    def __init__(self, value: Ends, slope: Ends | None = None) -> None:
        self.value = value
        self.slope = slope

    def __getitem__(self, index: Any) -> Jet:
        index = index if isinstance(index, tuple) else (index,)
        slope = None
        if self.slope is not None:
            slope = self.slope[0][(slice(None), *index)], self.slope[1][(slice(None), *index)]
        return Jet((self.value[0][index], self.value[1][index]), slope)

    def __neg__(self) -> Jet:
        slope = None if self.slope is None else (-self.slope[1], -self.slope[0])
        return Jet((-self.value[1], -self.value[0]), slope)

    def __add__(self, other: Operand) -> Jet:
        other = _jet(other)
        slopes = [jet.slope for jet in (self, other) if jet.slope is not None]
        return Jet(_plus(self.value, other.value), _sum(slopes))

    __radd__ = __add__

    def __sub__(self, other: Operand) -> Jet:
        return self + (-other)

    def __rsub__(self, other: float) -> Jet:
        return -self + other

    def __mul__(self, other: Operand) -> Jet:
        if other is self:
            return self.square()
        other = _jet(other)
        pairs = (self.slope, other.value), (other.slope, self.value)
        slopes = [_times(slope, value) for slope, value in pairs if slope is not None]
        return Jet(_times(self.value, other.value), _sum(slopes))

    __rmul__ = __mul__

    def square(self) -> Jet:
        """Return the square; never negative."""
        low, high = self.value
        ends = low * low, high * high
        least = np.where((low <= 0) & (high >= 0), 0.0, np.minimum(*ends))
        least, greatest = outward(least, np.maximum(*ends))
        slope = None if self.slope is None else _times(_times(self.slope, self.value), exact(2.0).value)
        return Jet((np.maximum(least, 0.0), greatest), slope)

    def inverse(self) -> Jet:
        """Return the reciprocal; not bounded where 0 is inside."""
        low, high = self.value
        with np.errstate(divide="ignore", invalid="ignore"):
            bad = (low <= 0) & (high >= 0)
            ends = np.where(bad, -np.inf, 1.0 / high), np.where(bad, np.inf, 1.0 / low)
        value = outward(*ends)
        slope = None
        if self.slope is not None:
            factor = Jet(value).square().value
            slope = _times(self.slope, (-factor[1], -factor[0]))
        return Jet(value, slope)

    def __truediv__(self, other: Operand) -> Jet:
        return self * _jet(other).inverse()

    def __rtruediv__(self, other: float) -> Jet:
        return self.inverse() if other == 1 else self.inverse() * other

    def sqrt(self) -> Jet:
        """Return the square root; NaN where the argument can be negative."""
        with np.errstate(invalid="ignore"):
            low, high = outward(np.sqrt(self.value[0]), np.sqrt(self.value[1]))
        root = Jet((np.maximum(low, 0.0), high))
        if self.slope is not None:
            half = root.inverse() * 0.5
            root.slope = _times(self.slope, half.value)
        return root


Operand = Jet | float


def exact(number: float) -> Jet:
    """Return a number as an interval without width."""
    end = np.float64(number)
    return Jet((end, end))  # type: ignore[arg-type]


@lru_cache
def _constant(number: float) -> Jet:
    """Return an enclosure of the constant that a generated program shows as this number.

    One with few binary digits is the constant itself. Any other is it after up to three roundings, as 2*sqrt(3)/3.
    """
    if number == round(number * 1024) / 1024 and abs(number) < 2**20:
        return exact(number)
    return Jet(outward(np.float64(number), np.float64(number)))  # type: ignore[arg-type]


def _jet(operand: Operand) -> Jet:
    return operand if isinstance(operand, Jet) else _constant(operand)


def _sum(slopes: list[Ends]) -> Ends | None:
    """Return the sum of the slopes that are not zero, at most two."""
    if len(slopes) == 2:
        return _plus(*slopes)
    return slopes[0] if slopes else None


def stack(parts: list[Any]) -> Jet:
    """Return jets (a list, or lists of lists) as one, along leading axes."""
    if isinstance(parts[0], list):
        parts = [stack(part) for part in parts]
    value = np.stack([p.value[0] for p in parts]), np.stack([p.value[1] for p in parts])
    slope = None
    if parts[0].slope is not None:
        slope = np.stack([p.slope[0] for p in parts], axis=1), np.stack([p.slope[1] for p in parts], axis=1)
    return Jet(value, slope)


class Enclosed(NamedTuple):
    """Enclosures over n boxes, of `enclose`."""

    A: Jet
    """The sensitivities, (3, 5, n)."""
    rods: Jet
    """A0, A1, A-1, (3, n)."""


def enclose(low: Array, high: Array, geometry: Geometry, slopes: bool) -> Enclosed:
    """Return enclosures of A35 and the rods over boxes: the steps of the kernel `tricept_at_point` on intervals.

    Parameters
    ----------
    low, high : ndarray, shape (3, n)
        Opposite corners of n boxes.
    geometry : Geometry
        The machine.
    slopes : bool
        Whether to enclose the derivatives by Q, too.
    """
    unit = np.zeros((3, 3, low.shape[1])) + np.eye(3)[:, :, None]
    point = [Jet((low[n], high[n]), (unit[n], unit[n]) if slopes else None) for n in range(3)]
    numbers = map(exact, (geometry.r, geometry.R, *geometry.q))
    *A, a, b, c = tricept_at_point.steps(_FUNCTIONS, *point, *numbers, 0.0, np.inf)
    return Enclosed(stack([A[:5], A[5:10], A[10:]]), stack([a, b, c]))


_FUNCTIONS = SimpleNamespace(sqrt=Jet.sqrt)
"""What the steps call."""

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
        enclosed = function(queue_low[:, part], queue_high[:, part], False, which[queue[part]])
        np.maximum.at(bound, queue[part], _signed(enclosed.value, signs[queue[part]])[1])
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
        enclosed = function(a, b, True)
        assert enclosed.slope is not None
        centre = _centres(a, b)
        value = _signed(function(centre, centre, False).value, sign)
        slope = np.maximum(np.abs(enclosed.slope[0]), np.abs(enclosed.slope[1]))
        slope = np.where(np.isnan(slope), np.inf, slope)
        total = _linear(value[1], np.broadcast_to(slope[:, None], (3, *value[1].shape)), a, b, centre)
        tops[:, :, part] = np.minimum(total, _signed(enclosed.value, sign)[1])
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
    enclosed = function(lower, upper, True, which)
    assert enclosed.slope is not None
    least, greatest = _signed(enclosed.slope, sign)
    rising, falling = least >= 0, greatest <= 0
    lower, upper = np.where(rising, upper, lower), np.where(falling & ~rising, lower, upper)
    centre = _centres(lower, upper)
    value = _signed(function(centre, centre, False, which).value, sign)
    slope = np.where(rising | falling, 0.0, np.maximum(np.abs(least), np.abs(greatest)))
    whole = _signed(enclosed.value, sign)[1]
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


def grid_points(*axes: Array) -> Array:
    """Return the points (k, n) of a grid, given the values of each of its k coordinates; the last one runs fastest."""
    return np.stack(np.meshgrid(*axes, indexing="ij")).reshape(len(axes), -1)
