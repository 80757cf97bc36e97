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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.kinematics.axis_fit.pairs import Pairs
from rodgen.kinematics.axis_fit.residual import Line
from rodgen.statistics.chi_distribution import chi3_quantile, chi_share
from rodgen.statistics.robust import HUBER, huber_weight, median_factor
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
