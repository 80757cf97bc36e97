"""Robust losses, and a start that gross errors cannot move, the same in every run.

A loss replaces the square of z = |d|/(σ sqrt 2), which for good pairs is chi-distributed with three degrees
of freedom. Its weights need a noise and a start that bad pairs cannot
move: axes are solved for exactly from a few hundred smallest sets of pairs, ranked by the median of
|d| over all pairs (least median of squares, P. J. Rousseeuw, J. Am. Stat. Assoc. 79 (1984) 871-880), and the
best are improved on the better half of the pairs (concentration steps). The sets come from a hash of
a counter, not from a random generator: no state, no seed, no pattern in the data that they can fall in with.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.kinematics.axis_fit.moments import Moments
from rodgen.kinematics.axis_fit.residual import residual
from rodgen.kinematics.axis_fit.sphere import global_maximum
from rodgen.statistics.chi_distribution import chi3_quantile, chi_share

__all__ = [
    "LOSSES",
    "Loss",
    "RobustStart",
    "best_agreement",
    "chi_cut",
    "median_variance",
    "robust_start",
    "trimmed_variance",
]

Floats = NDArray[np.float64]

# Tuning constant k: 95 % efficiency for vectors of three normal components, that is
# (E[ψ′/3 + 2ψ/(3z)])² / (E[ψ²]/3) = 0.95 with z chi-distributed, three degrees of freedom.
_HUBER = 1.6279879

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

    def weight(self, z: Floats) -> Floats:
        """Return ψ(z)/z: 1 for small z."""
        if self.name == "huber":
            return np.minimum(1.0, _HUBER / np.maximum(z, _HUBER))
        return np.ones_like(z)

    def slope(self, z: Floats) -> Floats:
        """Return ψ′(z)."""
        if self.name == "huber":
            return np.where(z < _HUBER, 1.0, 0.0)
        return np.ones_like(z)


LOSSES = {name: Loss(name) for name in ("linear", "huber")}


@dataclass(frozen=True, eq=False)
class RobustStart:
    """Axis, point and variance of unit weight that gross errors have not moved."""

    axis: Floats
    point: Floats
    variance: float


def chi_cut(pairs: int) -> float:
    """Return the z that the largest of `pairs` good pairs exceeds with 1 % probability."""
    return chi3_quantile(0.01 / max(pairs, 1))


def median_variance(squares: Floats, freedoms_used: int) -> float:
    """Return the variance of unit weight from the median, rather too large; arguments as :func:`trimmed_variance`.

    A fit that makes the median small makes it too small in a small sample, and a trim that begins there
    throws out good pairs; the factor is Rousseeuw's for the least median of squares.
    """
    spare = max(len(squares) - freedoms_used / 3, 1.0)
    return float(np.median(squares)) / _CHI_MEDIAN**2 * (1 + 5 / spare) ** 2


def trimmed_variance(squares: Floats, freedoms_used: int, start: float) -> float:
    """Return the variance of unit weight from the pairs within the trim, corrected for what the trim cuts off.

    Parameters
    ----------
    squares : (N,) array
        w |d|²/2 of each pair: three degrees of freedom times the variance, in the mean.
    freedoms_used : int
        Parameters fitted.
    start : float
        Variance that decides first who is within.
    """
    # The mean of a chi-square variable without its tail is smaller by this.
    shrink = chi_share(_TRIM, 5) / chi_share(_TRIM, 3)
    variance = start
    for _ in range(50):
        inside = squares <= _TRIM**2 * variance
        freedoms = 3 * int(inside.sum()) - freedoms_used
        if freedoms <= 0:
            return variance
        new = float(squares[inside].sum()) / (freedoms * shrink)
        if abs(new - variance) <= 1e-12 * variance:
            return new
        variance = new
    return variance


def robust_start(
    rho: Floats, rho_prime: Floats, angle: Floats, weight: Floats, point: Floats | None
) -> RobustStart:
    """Return axis, point and noise from pairs of which up to two in five may be wrong.

    Parameters
    ----------
    rho, rho_prime : (N, 3) arrays
    angle, weight : (N,) arrays
        Weights are inverse variances, relative.
    point : (3,) array or None
        Known point, or None where it is free.
    """
    n = len(angle)
    sets = _sets(n, 3 if point is None else 2)
    axes, points = _solve_sets(rho, rho_prime, angle, weight, sets, point)

    ranked = np.arange(n) if n <= _MOST_RANKED else np.unique(_hash(np.arange(_MOST_RANKED)) % n)
    some = (rho[ranked], rho_prime[ranked], angle[ranked], weight[ranked])
    half = len(ranked) // 2 + 1
    medians = np.median(_half_squares(*some, axes, points), axis=-1)
    first = np.argsort(medians, kind="stable")[:_BEST_SETS]
    axes, points = axes[first], points[first]
    for _ in range(_CONCENTRATIONS):
        inside = np.argpartition(_half_squares(*some, axes, points), half - 1, axis=-1)[:, :half]
        axes, points = _solve_sets(*some, inside, point)
    trimmed = np.partition(_half_squares(*some, axes, points), half - 1, axis=-1)[:, :half].sum(axis=-1)
    best = [np.argmin(trimmed)]
    every = _half_squares(rho, rho_prime, angle, weight, axes[best], points[best])[0]
    used = 4 if point is None else 2
    return RobustStart(
        axes[best][0], points[best][0], trimmed_variance(every, used, median_variance(every, used))
    )


def best_agreement(
    rho: Floats, rho_prime: Floats, angle: Floats, weight: Floats, point: Floats | None, share: float
) -> tuple[Floats, Floats]:
    """Return axis and point on which that share of the pairs, three at least, agree best with one another.

    Other arguments as :func:`robust_start`. Of more than 2000 pairs some are looked at.
    """
    n = len(angle)
    some = np.arange(n) if n <= _MOST_RANKED else np.unique(_hash(np.arange(_MOST_RANKED)) % n)
    arrays = (rho[some], rho_prime[some], angle[some], weight[some])
    sets = _sets(len(some), 3 if point is None else 2)
    axes, points = _solve_sets(*arrays, sets if len(sets) < _MOST_SETS else sets[:_CAMP_SETS], point)
    count = min(max(math.ceil(share * len(some)), 3), len(some))
    squares = _half_squares(*arrays, axes, points)
    inside = np.argpartition(squares, count - 1, axis=-1)[:, :count]
    first = np.argsort(np.take_along_axis(squares, inside, axis=-1).max(axis=-1), kind="stable")[:_BEST_SETS]
    axes, points = axes[first], points[first]
    for _ in range(_CONCENTRATIONS):
        squares = _half_squares(*arrays, axes, points)
        inside = np.argpartition(squares, count - 1, axis=-1)[:, :count]
        axes, points = _solve_sets(*arrays, inside, point)
    squares = np.partition(_half_squares(*arrays, axes, points), count - 1, axis=-1)[:, :count]
    best = int(np.argmin(squares.sum(axis=-1)))
    return axes[best], points[best]


def _solve_sets(
    x: Floats, y: Floats, angle: Floats, w: Floats, sets: NDArray[np.int64], point: Floats | None
) -> tuple[Floats, Floats]:
    """Return the best axis and point (S, 3) of each of S sets of pairs."""
    moments = Moments.of(x[sets], y[sets], angle[sets], w[sets], point)
    axes = global_maximum(*moments.quadratic())
    return axes, moments.point(axes)


def _half_squares(x: Floats, y: Floats, angle: Floats, w: Floats, axes: Floats, points: Floats) -> Floats:
    """Return half the weighted squares (S, N) of all pairs against each of the lines (S, 3)."""
    lines = zip(axes, points, strict=True)
    return np.array([w * (residual(x, y, angle, e, p) ** 2).sum(axis=-1) / 2 for e, p in lines])


def _sets(n: int, size: int) -> NDArray[np.int64]:
    """Return sets of `size` different pairs: all of them, or as many as are enough."""
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
