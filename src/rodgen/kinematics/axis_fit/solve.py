"""The axis and point of least weighted squares, or of least robust loss, and the other local optimum.

The solution is the global minimum in closed form (:mod:`.moments`); a robust loss repeats it with reduced weights from
a start that gross errors cannot move; Newton steps on the residuals themselves remove what rounding of the
sums has left: the sums lose the square of the condition number, the residuals only its first power.

A loss replaces the square of z = |d|/(σ sqrt 2), which for good pairs is chi-distributed with three degrees
of freedom. Its weights need a noise and a start that bad pairs cannot
move: axes are solved for exactly from a few hundred smallest sets of pairs, ranked by the median of
|d| over all pairs (least median of squares, P. J. Rousseeuw, J. Am. Stat. Assoc. 79 (1984) 871-880), and the
best are improved on the better half of the pairs (concentration steps). The sets come from a hash of
a counter, not from a random generator: no state, no seed, no pattern in the data that they can fall in with.
From the solution follow the size of the noise, and the pairs that are too far off to be noise.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.axis_fit.moments import Moments, global_maximum, maximise_on_sphere, tangents
from rodgen.kinematics.axis_fit.pairs import Line, Pairs, residual_gradient
from rodgen.statistics.robust import HUBER, chi3_quantile, chi_share, huber_weight, median_factor
from rodgen.statistics.thresholds import ROBUST

_HUBER = HUBER[3]

# Median of the chi distribution with three degrees of freedom.
_CHI_MEDIAN = 1.5381722544550522

# A set of three pairs is free of 40 % bad pairs with probability 0.22; 240 sets all fail with 1e-26.
_MOST_SETS = 240
# Sets are ranked on no more pairs than this: a median over 2000 is good to 2 %.
_MOST_RANKED = 2000
_BEST_SETS, _CONCENTRATIONS = 8, 6
# A set of three from one of two equal camps has probability 1/4: 60 sets all fail with 3e-8.
_CAMP_SETS = 60

# Beyond this z a pair does not count in the estimated noise; 0.2 % of good pairs are there.
_TRIM = 3.8


@dataclass(frozen=True)
class Loss:
    """A loss ρ(z) by its weight ψ(z)/z and slope ψ′(z); ψ = ρ′."""

    name: str

    def weight(self, z: Array) -> Array:
        """Return ψ(z)/z: 1 for small z."""
        if self.name == "huber":
            return huber_weight(z, _HUBER)
        return np.ones_like(z)

    def slope(self, z: Array) -> Array:
        """Return ψ′(z)."""
        if self.name == "huber":
            return np.where(z < _HUBER, 1.0, 0.0)
        return np.ones_like(z)


LOSSES = {name: Loss(name) for name in ("linear", "huber")}


def chi_cut(pairs: int) -> float:
    """Return the z that the largest of `pairs` good pairs exceeds with 1 % probability."""
    return chi3_quantile(ROBUST.false_alarm / max(pairs, 1))


def median_variance(squares: Array, freedoms_used: int) -> float:
    """Return the variance of unit weight from the median, rather too large; arguments as :func:`trimmed_variance`.

    A fit that makes the median small makes it too small in a small sample, and a trim that begins there
    throws out good pairs.
    """
    return float(np.median(squares)) / _CHI_MEDIAN**2 * median_factor(len(squares) - freedoms_used / 3) ** 2


def trimmed_variance(squares: Array, freedoms_used: int, start: float) -> float:
    """Return the variance of unit weight from the pairs within the trim, corrected for what the trim cuts off.

    `squares` (N,) are w |d|²/2, `freedoms_used` counts the parameters fitted, and `start` decides first who is within.
    """
    # The mean of a chi-square variable without its tail is smaller by this.
    shrink = chi_share(_TRIM, 5) / chi_share(_TRIM, 3)
    variance = start
    for _ in range(50):
        inside = squares <= _TRIM**2 * variance
        freedoms = 3 * int(inside.sum()) - freedoms_used
        if freedoms <= 0:
            return variance
        new = float(squares.sum(where=inside)) / (freedoms * shrink)
        if abs(new - variance) <= 1e-12 * variance:
            return new
        variance = new
    return variance


def robust_start(pairs: Pairs) -> tuple[Line, float]:
    """Return a line and the variance of unit weight, from pairs of which up to two in five may be wrong."""
    some = pairs.only(_ranked(len(pairs.angle)))
    lines = _lines(pairs, _sets(len(pairs.angle), pairs.point is None))
    medians = np.median(_half_squares(some, lines), axis=-1)
    line = _concentrated(some, lines, medians, len(some.angle) // 2 + 1)
    squares = pairs.half_squares(line)
    start = median_variance(squares, pairs.parameters)
    return line, trimmed_variance(squares, pairs.parameters, start)


def best_agreement(pairs: Pairs, share: float) -> Line:
    """Return the line on which that share of the pairs, three at least, agree best with one another.

    Of more than 2000 pairs some are looked at.
    """
    some = pairs.only(_ranked(len(pairs.angle)))
    sets = _sets(len(some.angle), pairs.point is None)
    lines = _lines(some, sets if len(sets) < _MOST_SETS else sets[:_CAMP_SETS])
    count = min(max(math.ceil(share * len(some.angle)), 3), len(some.angle))
    farthest = np.partition(_half_squares(some, lines), count - 1, axis=-1)[:, count - 1]
    return _concentrated(some, lines, farthest, count)


def _concentrated(pairs: Pairs, lines: list[Line], rank: Array, count: int) -> Line:
    """Return the best of the lines that rank first, each improved on the `count` pairs that are nearest to it."""
    lines = [lines[k] for k in np.argsort(rank, kind="stable")[:_BEST_SETS]]
    for _ in range(_CONCENTRATIONS):
        lines = _lines(pairs, np.argpartition(_half_squares(pairs, lines), count - 1, axis=-1)[:, :count])
    nearest = np.partition(_half_squares(pairs, lines), count - 1, axis=-1)[:, :count]
    return lines[int(np.argmin(nearest.sum(axis=-1)))]


def _lines(pairs: Pairs, sets: NDArray[Any]) -> list[Line]:
    """Return the best line of each of S sets of pairs."""
    best = pairs.only(sets).best_line()
    return [Line(axis, point) for axis, point in zip(best.axis, best.point, strict=True)]


def _half_squares(pairs: Pairs, lines: list[Line]) -> Array:
    """Return half the weighted squares (S, N) of all pairs against each line."""
    return np.array([pairs.half_squares(line) for line in lines])


def _ranked(n: int) -> NDArray[np.int64]:
    """Return which of n pairs sets are ranked on."""
    return np.arange(n) if n <= _MOST_RANKED else np.unique(_hash(np.arange(_MOST_RANKED)) % n)


def _sets(n: int, free: bool) -> NDArray[np.int64]:
    """Return sets of pairs that determine an axis, with a free point or without: all, or as many as are enough."""
    size = 3 if free else 2
    if math.comb(n, size) <= _MOST_SETS:
        return np.array(list(itertools.combinations(range(n), size)))
    drawn = (_hash(np.arange(3 * _MOST_SETS * size)) % n).reshape(-1, size)
    distinct = (np.diff(np.sort(drawn, axis=1), axis=1) > 0).all(axis=1)
    return drawn[distinct][:_MOST_SETS]


def _hash(counter: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return SplitMix64 of a counter, as non-negative integers."""
    with np.errstate(over="ignore"):
        z = (counter.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return (z >> np.uint64(1)).astype(np.int64)


# Reweighting converges by a factor of three to ten a solution; a fit that has not converged by then gets a remark.
MOST_REWEIGHTINGS = 100
_SETTLED = 1e-12
# Two optima of one data set are farther apart than the step from one solution to the next.
_SAME_OPTIMUM = 0.99
# From the closed form one step is enough, and one more shows that it was.
_MOST_NEWTON_STEPS = 5
_STEP_ENOUGH = 1e-12
# The closed form is nearer than this wherever a step makes sense at all.
_LONGEST_STEP = 1e-3
# Turns with less than this share of the best one's information are left as the closed form has them.
_LEAST_INFORMATION = 1e-11


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimum, the other local optimum if it is worth a comparison, and the weight of each pair."""

    best: Line
    other: Line | None
    share: Array
    """(N,) factor of the loss on each pair's weight; 0 for pairs that are left out."""
    iterations: int
    converged: bool


def solve(pairs: Pairs, loss: Loss) -> Solution:
    """Return the optimum, the other local optimum, and the weight that the loss leaves each pair.

    Raises
    ------
    RodgenError
        When there are too few pairs for a robust loss.
    """
    used = pairs.weight > 0
    counted = pairs if used.all() else pairs.only(used)
    share, iterations, converged, near = np.broadcast_to(1.0, counted.weight.shape), 0, True, None
    if loss.name != "linear":
        needed = 4 if pairs.point is None else 3
        if len(share) < needed:
            raise RodgenError(
                f"loss={loss.name!r} has {len(share)} pairs; it needs at least {needed} to tell a bad one from "
                "the good ones; use loss='linear'"
            )
        near, share, iterations, converged = _reweight(counted, loss, *robust_start(counted))
        counted = counted.weighted(share)
    best, other = _optima(counted, near)
    everyone = np.zeros(len(used))
    everyone[used] = share
    return Solution(best, other, everyone, iterations, converged)


def _optima(pairs: Pairs, near: Line | None) -> tuple[Line, Line | None]:
    """Return both optima for given weights; `near` says to which one the weights belong."""
    moments = pairs.moments()
    A, b = moments.quadratic()
    first, second = maximise_on_sphere(A, b)
    if near is not None and second @ near.axis > first @ near.axis:
        first, second = second, first
    best = _polish(pairs, moments, first)
    if not np.isfinite(second).all():
        return best, None
    # ½ Σ w |d|² is a constant less the quadratic: a far worse optimum is known without another look at
    # the pairs.
    worse = float(first @ A @ first + b @ first - second @ A @ second - b @ second)
    if worse > 100 * float(pairs.half_squares(best).sum()) + 1e-6 * float(np.abs(A).max()):
        return best, None
    return best, _polish(pairs, moments, second)


def _reweight(pairs: Pairs, loss: Loss, line: Line, variance: float) -> tuple[Line, Array, int, bool]:
    """Solve with the loss's weights until they stay; each solution is a global one.

    The noise, where it is not given, follows the solutions until it stays too. Which pairs it is taken from
    changes by whole pairs and may go in a circle: half way it is held. Exact pairs have the noise of rounding.
    """
    share = np.ones(len(pairs.weight))
    for count in range(1, MOST_REWEIGHTINGS + 1):
        squares = pairs.half_squares(line)
        if pairs.variance is not None:
            variance = pairs.variance
        elif count <= MOST_REWEIGHTINGS // 2:
            variance = trimmed_variance(squares, pairs.parameters, variance)
        squares /= max(variance, pairs.rounding**2)
        share = loss.weight(np.sqrt(squares, out=squares))
        del squares
        moments = pairs.weighted(share).moments()
        axis = global_maximum(*moments.quadratic())
        if axis @ line.axis < _SAME_OPTIMUM:
            # Of two optima stay with the one that the start has chosen.
            axis = max(maximise_on_sphere(*moments.quadratic()), key=lambda e: float(e @ line.axis))
        new = Line(axis, moments.point(axis)).nearest(line.point)
        moved = max(float(np.abs(axis - line.axis).max()), float(np.abs(new.point - line.point).max()))
        line = new
        if moved <= _SETTLED:
            return line, share, count, True
    return line, share, MOST_REWEIGHTINGS, False


def _gradient(pairs: Pairs, line: Line) -> tuple[Array, Array]:
    parts = [
        residual_gradient(block.rho, block.rho_prime, block.angle, block.weight, line.axis, line.point)
        for _, block in pairs.blocks()
    ]
    by_axis, by_point = zip(*parts, strict=True)
    return np.sum(by_axis, axis=0), np.sum(by_point, axis=0)


def _polish(pairs: Pairs, moments: Moments, axis: Array) -> Line:
    """Return the line after Newton steps on the residuals, in the turns and shifts that are determined."""
    point = moments.point(axis)
    squares = sum(float(((block.rho - point) ** 2).sum()) for _, block in pairs.blocks())
    arm = math.sqrt(squares / len(pairs.angle)) or 1.0
    last = _LONGEST_STEP
    for _ in range(_MOST_NEWTON_STEPS):
        basis = tangents(axis)
        by_axis, by_point = _gradient(pairs, Line(axis, point))
        gradient, units = by_axis @ basis / arm, np.repeat(1 / arm, 2)
        if moments.free:
            gradient = np.concatenate([gradient, by_point @ basis])
            units = np.concatenate([units, np.ones(2)])
        values, vectors = np.linalg.eigh(moments.hessian(axis, point, basis) * np.outer(units, units))
        kept = values > max(_LEAST_INFORMATION * values[-1], 0.0)
        step = -vectors[:, kept] @ ((vectors[:, kept].T @ gradient) / values[kept])
        size = float(np.abs(step).max()) / arm
        if not size < last / 2:
            break
        axis = axis + basis @ step[:2] / arm
        axis = axis / math.sqrt(axis @ axis)
        if moments.free:
            point = point + basis @ step[2:]
        if size < _STEP_ENOUGH:
            break
        last = size
    return Line(axis, point)


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise and outliers at a solution."""

    variance: float
    """Of a coordinate at weight 1, scaled lengths; NaN where unknown."""
    sigma: float
    """Standard uncertainty in the user's unit; NaN where unknown."""
    squares: Array
    """w |d|²/2 of the residuals, (N,)."""
    unit: float
    """What `squares` are compared with: the variance or that of rounding, infinite where unknown."""
    used: NDArray[np.bool_]
    outliers: NDArray[np.bool_]
    good: NDArray[np.bool_]
    """Pairs with a weight, those too far off, and the others, (N,)."""
    dof: int
    """Degrees of freedom of the good pairs."""
    chi_square: float | None
    """Of the good pairs, where sigma was given."""

    @classmethod
    def of(cls, pairs: Pairs, loss: Loss, squares: Array) -> Noise:
        """Judge by half the weighted squares of the residuals."""
        used = pairs.weight > 0
        count, parameters = int(used.sum()), pairs.parameters
        counted = squares if used.all() else squares[used]
        freedoms = 3 * count - parameters
        if pairs.variance is not None:
            variance = pairs.variance
        elif freedoms <= 0:
            variance = math.nan
        elif loss.name == "linear":
            variance = float(counted.sum()) / freedoms
        else:
            variance = trimmed_variance(counted, parameters, median_variance(counted, parameters))

        # Exact pairs leave residuals of rounding; none of them is an outlier.
        unit = math.inf if math.isnan(variance) else max(variance, (4 * pairs.rounding) ** 2)
        # A pair that alone makes the fit cannot be off it.
        outliers = used & (squares > chi_cut(count) ** 2 * unit) if freedoms > 0 else np.zeros_like(used)
        good = used & ~outliers
        if 3 * int(good.sum()) < max(parameters, 1):
            good = used
        dof = 3 * int(good.sum()) - parameters
        if pairs.variance is not None:
            chi_square = float(squares.sum(where=good)) / variance
            return cls(variance, pairs.sigma, squares, unit, used, outliers, good, dof, chi_square)
        sigma = (
            math.sqrt(variance / pairs.unit_weight) * pairs.scale if not math.isnan(variance) else math.nan
        )
        return cls(variance, sigma, squares, unit, used, outliers, good, dof, None)

    def less_dof(self, absorbed: float, pairs: Pairs) -> Noise:
        """Return the noise where the fit has absorbed more of it than one variance for each parameter.

        `absorbed` are those variances. Errors that pairs share are absorbed more; given noise stays.
        """
        if pairs.variance is not None:
            return self
        factor = self.dof / max(self.dof - absorbed, 1.0)
        return replace(self, variance=self.variance * factor, sigma=self.sigma * math.sqrt(factor))
