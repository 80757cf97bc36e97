"""The covariance of an axis, the turns of it that the pairs do not determine, and a second axis that fits as well.

With H the second derivatives of ½ Σ w |d|² by axis and point, and v the variance of a coordinate at weight 1,
the score's variance is H/(2v) plus, in the direction's block, Σ (1 - cos χ) I: the noise of ρ, turned by
the error of the axis, meets the noise of ρ′. Hence

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

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.kinematics.axis_fit.moments import shown
from rodgen.kinematics.axis_fit.pairs import ZERO_TURN, Line, Pairs, blocks
from rodgen.kinematics.axis_fit.result import AxisFitStatus
from rodgen.kinematics.axis_fit.solve import Loss, Noise, Solution


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
    best, other = solution.best, solution.other
    if other is None:
        return [best]
    here = float(solution.share @ pairs.half_squares(best))
    there = float(solution.share @ pairs.half_squares(other))
    weight = pairs.weight * solution.share
    rounding = (8 * pairs.rounding) ** 2 * float(weight.sum())
    apart = best.axis - other.axis
    if abs(there - here) <= 1e-9 * (there + here) + rounding:
        swap = bool(apart[np.argmax(np.abs(apart))] < 0)
    else:
        swap = there < here
    if swap:
        best, other, here, there = other, best, there, here

    counted = pairs.only(weight > 0)
    freedoms = max(3 * len(counted.angle) - pairs.parameters, 1)
    if pairs.variance is not None:
        ratio = (there - here) / pairs.variance
    else:
        ratio = freedoms * math.log((there + rounding) / (here + rounding))
    # Of two axes e, f that take the true points to the same places, noise favours one by
    # Σ n′·(R_e - R_f) n / v: this is its standard deviation.
    cosine = float(best.axis @ other.axis)
    by_versine = sum(float((4 * np.sin(block.angle / 2) ** 4).sum()) for _, block in counted.blocks())
    by_sine = sum(float((np.sin(block.angle) ** 2).sum()) for _, block in counted.blocks())
    chance = math.sqrt(max(2 * by_versine * (1 - cosine**2) + 4 * by_sine * (1 - cosine), 0.0))
    return [best, other] if ratio < _KEEP_BELOW + _KEEP_DEVIATIONS * chance else [best]


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
