"""The optimum of a fit of an axis, and how uncertain it is.

The solution is the global minimum in closed form (:mod:`.pairs`); a robust loss repeats it with reduced weights from a
start that gross errors cannot move; Newton steps on the residuals themselves remove what rounding of the sums has left:
the sums lose the square of the condition number, the residuals only its first power.

A loss replaces the square of z = |d|/(σ sqrt 2), which for good pairs is chi-distributed with three degrees
of freedom. Its weights need a noise and a start that bad pairs cannot
move: axes are solved for exactly from a few hundred smallest sets of pairs, ranked by the median of
|d| over all pairs (least median of squares, P. J. Rousseeuw, J. Am. Stat. Assoc. 79 (1984) 871-880), and the
best are improved on the better half of the pairs (concentration steps). The sets come from a hash of
a counter, not from a random generator: no state, no seed, no pattern in the data that they can fall in with.
From the solution follow the size of the noise, and the pairs that are too far off to be noise.

With H the second derivatives of ½ Σ w |d|² by axis and point, and v the variance of a coordinate at weight 1, the
score's variance is H/(2v) plus, in the direction's block, Σ (1 - cos χ) I: the noise of ρ, turned by the error of the
axis, meets the noise of ρ′. Hence

    cov = 2v H⁻¹ + 4v² H⁻¹ (Σ (1 - cos χ) I) H⁻¹.

The second term matters only where the points lie within some σ of the axis; without it pairs of pure noise
would claim an axis (proved in ``derivation/axis_fit.py``). H holds products ρ ρ′ᵀ of two independent
readings and so is free of the bias that the Gauss-Newton matrix, with ρ ρᵀ, has there. A robust loss
changes H by its mean slope and the score's variance by its mean square, as usual for M-estimates (P. J.
Huber, Robust Statistics, 1981, section 7.6).

The direction's own information matrix (the Hessian with the point eliminated) has an eigenvalue for each
of the two ways to turn. An eigenvalue that rounding can have made counts as zero; one that is positive but
leaves an uncertainty of a third of a radian is reported as hidden in the noise: no linearised figure can be
trusted there. The quadratic on the sphere has at most two local maxima; the second one is a candidate when
the likelihood ratio does not speak against it.
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
from rodgen.kinematics.axis_fit.pairs import (
    ZERO_TURN,
    Line,
    Moments,
    Pairs,
    blocks,
    global_maximum,
    maximise_on_sphere,
    residual_gradient,
    shown,
    tangents,
)
from rodgen.kinematics.axis_fit.result import AxisFitStatus
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
    best, second = _optima(counted, near)
    everyone = np.zeros(len(used))
    everyone[used] = share
    return Solution(best, second, everyone, iterations, converged)


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
        is_known = values > max(_LEAST_INFORMATION * values[-1], 0.0)
        step = -vectors[:, is_known] @ ((vectors[:, is_known].T @ gradient) / values[is_known])
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


def information_of(pairs: Pairs, noise: Noise, loss: Loss, line: Line, basis: Array) -> tuple[Array, float]:
    """Return the information H on axis and point along the basis, and the factor of the score's variance on it.

    Of a robust loss every good pair gets the mean slope and the mean square of all pairs: pair by pair
    they would follow the noise of a small sample, and claim too much.
    """
    if loss.name == "linear":
        return pairs.moments().hessian(line.axis, line.point, basis), 1.0
    good = noise.good
    # Over the three directions: ψ′ along the residual, ψ/z across it; and E[ψ²] a direction.
    slope = square = 0.0
    for rows in blocks(noise.squares):
        z = np.sqrt(noise.squares[rows][noise.used[rows]] / noise.unit)
        weight = loss.weight(z)
        slope += float(((loss.slope(z) + 2 * weight) / 3).sum()) / int(good.sum())
        square += float(((weight * z) ** 2 / 3).sum()) / int(good.sum())
    H = pairs.weighted(good).moments().hessian(line.axis, line.point, basis)
    # The fit has made the residuals smaller than the errors by its own degrees of freedom.
    count = 3 * int(noise.used.sum())
    return slope * H, square / slope * count / max(count - len(H), 1)


def parameter_covariance(information: Array, score: float, variance: float, versines: float) -> Array:
    """Return the covariance (4, 4) or (2, 2) of axis and point along the basis, by the formula above.

    `information` and `score` are those of :func:`information_of`, `versines` is Σ (1 - cos χ) of the pairs that count.
    """
    inverse = np.linalg.inv(information)
    noise = np.zeros_like(information)
    noise[:2, :2] = versines * np.eye(2)
    covariance = inverse @ (2 * variance * score * information + 4 * variance**2 * noise) @ inverse
    return (covariance + covariance.T) / 2


def joint_covariance(covariance: Array, line: Line, centroid: Array, basis: Array, scale: float) -> Array:
    """Return the covariance (6, 6) of the axis and of its point nearest to the centroid, lengths times `scale`."""
    size = len(covariance)
    jacobian = np.zeros((6, size))
    jacobian[:3, :2] = basis
    if size == 4:
        # The foot of the perpendicular slides along the axis as the axis turns.
        jacobian[3:, :2] = -np.outer(line.axis, (line.point - centroid) @ basis)
        jacobian[3:, 2:] = basis
    units = np.array([1.0, 1.0, 1.0, scale, scale, scale])
    with np.errstate(over="ignore"):  # a length beyond 1e154 has no square; its covariance is infinite
        whole: Array = (jacobian @ covariance @ jacobian.T) * units * units[:, None]
    if size == 2:
        whole[3:], whole[:, 3:] = 0.0, 0.0
    return whole


def condition_number(information: Array, arm: float) -> float:
    """Return the ratio of the extreme uncertainties of direction times arm, and point."""
    units = np.ones(len(information))
    units[:2] = 1 / arm
    values = np.linalg.eigvalsh(information * np.outer(units, units))
    return math.sqrt(values[-1] / values[0]) if values[0] > 0 else math.inf


_EPS = float(np.finfo(float).eps)
# Beyond this a turn does not stay in the range where the model is straight.
LOST_RADIANS = 1 / 3
# Twice the log of a likelihood ratio below which a second axis is kept: odds of 150 to 1.
_KEEP_BELOW = 10.0
# Standard deviations by which noise alone may favour one of two axes that fit alike.
_KEEP_DEVIATIONS = 4.0
_HALF_TURN = 1e-6
# Opposite to within 8 degrees: the same line, as far as a message is concerned.
_OPPOSITE = -0.99


@dataclass(frozen=True)
class PairFacts:
    """Facts about the pairs on which statuses and messages depend."""

    count: int
    """Pairs that are used and no outliers."""
    free: bool
    """Whether the point is free."""
    largest_half_sine: float
    """Of the angles."""
    half_turns: bool
    """Whether all angles are half turns."""
    moved: float
    missed: float
    """Root mean square lengths of displacements and of residuals, in the user's unit."""
    displaced: bool
    """Whether the points move by more than twice as much as the residuals, and than rounding."""
    exact: bool
    """Whether the residuals are no more than rounding."""
    arm: float
    """Root mean square distance of the points from their mean, or from the known point."""
    size: float
    """Largest coordinate as given, before any origin was subtracted: its rounding is in every arm."""
    versines: float
    """Σ 2 w (1 - cos χ)."""

    @classmethod
    def of(cls, pairs: Pairs, good: NDArray[np.bool_], line: Line) -> PairFacts:
        """Return the facts about the good pairs at a line."""
        some = pairs.only(good)
        count = len(some.angle)
        middle = pairs.point
        if middle is None:
            sums = [block.rho.sum(axis=0) + block.rho_prime.sum(axis=0) for _, block in some.blocks()]
            middle = np.sum(sums, axis=0) / (2 * count)
        missed = moved = spread = versines = largest = 0.0
        half_turns = True
        for _, block in some.blocks():
            missed += float((block.residuals(line) ** 2).sum()) / (3 * count)
            moved += float(((block.rho_prime - block.rho) ** 2).sum()) / (3 * count)
            spread += float(sum(((x - middle) ** 2).sum() for x in (block.rho, block.rho_prime))) / (
                2 * count
            )
            sines = np.abs(np.sin(block.angle / 2))
            versines += 4 * float(block.weight @ sines**2)
            largest = max(largest, float(sines.max()))
            half_turns &= bool((np.abs(np.cos(block.angle / 2)) < _HALF_TURN / 2).all())
        size = max(pairs.size, 1.0)
        return cls(
            count=count,
            free=pairs.point is None,
            largest_half_sine=largest,
            half_turns=half_turns,
            moved=math.sqrt(3 * moved) * pairs.scale,
            missed=math.sqrt(3 * missed) * pairs.scale,
            displaced=moved > max(4 * missed, (16 * _EPS * size) ** 2),
            exact=missed <= (16 * _EPS * size) ** 2,
            arm=math.sqrt(spread),
            size=size,
            versines=versines,
        )

    @property
    def turns(self) -> bool:
        """Whether any angle is not zero."""
        return self.largest_half_sine > ZERO_TURN

    @property
    def tolerance(self) -> float:
        """Relative size of the information that rounding of the coordinates can produce."""
        return 64 * _EPS * (1 + self.size / self.arm) / self.largest_half_sine


@dataclass(frozen=True, eq=False)
class Freedoms:
    """Turns (3, F) of the axis that are free: exactly, or hidden in the noise with that uncertainty."""

    exact: Array
    hidden: Array
    uncertainty: Array

    @property
    def directions(self) -> Array:
        """All turns (F, 3)."""
        return np.concatenate([self.exact, self.hidden], axis=1).T


def choose(pairs: Pairs, solution: Solution) -> list[Line]:
    """Return the one or two lines that fit equally well within the noise, best first.

    Two optima that differ by rounding only are put in an order that does not depend on it: the first is the one that is
    greater along the coordinate in which their axes differ most.
    """
    best, second = solution.best, solution.other
    if second is None:
        return [best]
    here = float(solution.share @ pairs.half_squares(best))
    there = float(solution.share @ pairs.half_squares(second))
    weight = pairs.weight * solution.share
    rounding = (8 * pairs.rounding) ** 2 * float(weight.sum())
    apart = best.axis - second.axis
    if abs(there - here) <= 1e-9 * (there + here) + rounding:
        swap = bool(apart[np.argmax(np.abs(apart))] < 0)
    else:
        swap = there < here
    if swap:
        best, second, here, there = second, best, there, here

    counted = pairs.only(weight > 0)
    freedoms = max(3 * len(counted.angle) - pairs.parameters, 1)
    if pairs.variance is not None:
        ratio = (there - here) / pairs.variance
    else:
        ratio = freedoms * math.log((there + rounding) / (here + rounding))
    # Of two axes e, f that take the true points to the same places, noise favours one by
    # Σ n′·(R_e - R_f) n / v: this is its standard deviation.
    cosine = float(best.axis @ second.axis)
    by_versine = sum(float((4 * np.sin(block.angle / 2) ** 4).sum()) for _, block in counted.blocks())
    by_sine = sum(float((np.sin(block.angle) ** 2).sum()) for _, block in counted.blocks())
    chance = math.sqrt(max(2 * by_versine * (1 - cosine**2) + 4 * by_sine * (1 - cosine), 0.0))
    return [best, second] if ratio < _KEEP_BELOW + _KEEP_DEVIATIONS * chance else [best]


def axis_information(information: Array) -> Array:
    """Return the information (2, 2) on the direction, with the point eliminated."""
    if len(information) == 2 or not information[2, 2] > 0:
        return information[:2, :2]
    alone: Array = information[:2, :2] - information[:2, 2:] @ information[2:, :2] / information[2, 2]
    return alone


def is_determined(information: Array, reference: float, facts: PairFacts) -> bool:
    """Return whether every turn of the axis changes the residuals by more than rounding; see :func:`find_freedoms`."""
    if not facts.turns or not facts.arm > 0:
        return False
    return bool((np.linalg.eigvalsh(information) > facts.tolerance * reference).all())


def find_freedoms(
    information: Array, reference: float, covariance: Array, basis: Array, facts: PairFacts
) -> Freedoms:
    """Return the turns that the pairs do not determine.

    `information` (2, 2) is that of :func:`axis_information`, `reference` that on a turn which moves every point by its
    arm; `covariance` (2, 2) is of the direction along `basis` (3, 2), NaN where unknown.
    """
    none = np.empty((3, 0))
    if not facts.turns or not facts.arm > 0:
        return Freedoms(basis, none, np.empty(0))
    values, vectors = np.linalg.eigh(information)
    exact = ~(values > facts.tolerance * reference)
    if exact.any() or not np.isfinite(covariance).all():
        return Freedoms((basis @ vectors)[:, exact], none, np.empty(0))
    variances, along = np.linalg.eigh(covariance)
    hidden = variances > LOST_RADIANS**2
    return Freedoms(none, (basis @ along)[:, hidden], np.sqrt(variances[hidden]))


def status_of(freedoms: Freedoms, lines: list[Line]) -> AxisFitStatus:
    """Return the status: how much of the direction is free."""
    free = len(freedoms.directions)
    if free:
        return AxisFitStatus.ONE_FREEDOM if free == 1 else AxisFitStatus.ANY_AXIS
    if len(lines) == 1:
        return AxisFitStatus.DETERMINED
    opposite = float(lines[0].axis @ lines[1].axis) < _OPPOSITE
    return AxisFitStatus.SIGN_FREE if opposite else AxisFitStatus.TWO_AXES


def sentences(status: AxisFitStatus, freedoms: Freedoms, lines: list[Line], facts: PairFacts) -> list[str]:
    """Return sentences that say what is not determined, and why."""
    texts: list[str] = []
    if freedoms.exact.shape[1]:
        texts.append(f"the axis direction: {_why_free(status, freedoms, facts)}.")
    for turn, uncertainty in zip(freedoms.hidden.T, freedoms.uncertainty, strict=True):
        texts.append(
            f"the axis direction towards {shown(turn)}: its standard uncertainty is "
            f"{math.degrees(uncertainty):.0f} deg, so the noise hides it."
        )
    if texts and facts.free:
        texts.append(
            "the point: it moves with the axis direction."
            if facts.turns
            else "the point: without a turn every point fits."
        )
    if status is AxisFitStatus.SIGN_FREE:
        texts.append(f"the sign of the axis: {_why_sign(facts)}.")
    if status is AxisFitStatus.TWO_AXES:
        both = f"{shown(lines[0].axis)} and {shown(lines[1].axis)}"
        texts.append(f"the choice between two axes, {both}: {_why_two(facts)}.")
    return texts


def _why_free(status: AxisFitStatus, freedoms: Freedoms, facts: PairFacts) -> str:
    if not facts.turns:
        return "all angles are zero or whole turns"
    if facts.arm <= 64 * _EPS * facts.size:
        return "all points are one point at rest" if facts.free else "all points lie at the known point"
    if status is AxisFitStatus.ANY_AXIS:
        return "no turn of it changes the residuals"
    towards = f"it can turn towards {shown(freedoms.exact[:, 0])} and the pairs fit as well"
    if facts.free and facts.count == 1:
        return f"{towards}; one pair with a free point allows every axis perpendicular to its displacement"
    if facts.free:
        return f"{towards}; all pairs are alike, and a point elsewhere or another angle is needed"
    if facts.half_turns:
        return f"{towards}; half turns that reverse the points allow every axis perpendicular to them"
    return f"{towards}; the angle is the smallest one that takes the points there, and two solutions merge"


def _why_sign(facts: PairFacts) -> str:
    if facts.half_turns:
        return "all angles are half turns, which are the same in both senses"
    if not facts.displaced:
        if facts.exact:
            return "all points lie on the axis and do not move"
        return (
            f"the points do not move by more than twice the residuals ({facts.moved:.3g} and "
            f"{facts.missed:.3g} rms), so the opposite axis fits about as well"
        )
    return "the opposite axis fits as well within the noise"


def _why_two(facts: PairFacts) -> str:
    if facts.free:
        return "both fit within the noise; pairs farther apart or with other angles decide"
    if facts.count == 1:
        return "one pair and a known point have two solutions; a pair with another angle or direction decides"
    return (
        "both fit within the noise, as happens when all points lie in one direction from the known point "
        "and turn by one angle; a pair with another angle or direction decides"
    )
