"""Trends and changes in many short series of values with standard deviations, such as those of a machine's nights.

A value scatters by more than its own standard deviation says: machines do not repeat themselves exactly. How much is
estimated from the successive differences of all series together, the large ones cut off, so that neither trends nor
a few changes move it much; and that of each series from these and its own. Each series is then compared with a constant
in two ways: a straight line, and one change of the level, at whichever place it fits best. Both are weighted least
squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rodgen.array_types import Array, Index
from rodgen.statistics.thresholds import FLEET

LARGEST, USUAL = 2.25, 0.7785
"""Squared differences count as so many variances at most, and are as large as the other on average where they are
normal: a third of them may be of changes."""
EFFICIENCY = 0.725
"""Degrees of freedom that such a variance has, for each difference; two thirds of that where each shares a value with
the one before and the one after it."""
ALIKE = (4.0, 8.0, 16.0, 32.0, 64.0, 1e6)
"""Degrees of freedom that the scatter of all series is worth for that of one: with 4 some scatter twice as much as
others, with the last all scatter alike, ..."""
PRIOR = (0.1, 0.1, 0.1, 0.1, 0.1, 0.5)
"""... and how likely each is, before the series are seen."""
CAUTION = 0.3
"""Probability that it is less than what is taken."""
CENSORED = 3.0
"""Ratio of variances beyond which it counts no more how large it is: it may be of a change."""


@dataclass(frozen=True, eq=False)
class Drifts:
    """The tests of series, each for a straight line and for one change of its level.

    Attributes
    ----------
    size, std : ndarray, shape (2, N)
        The slope, per unit of time; and the change, at the place where it fits best.
    p_value : ndarray, shape (2, N)
        Probability that chance makes as steep a line, and as large a change at any place; 1 of too few values.
    at : ndarray of int, shape (N,)
        Number of the first value after the change.
    """

    size: Array
    std: Array
    p_value: Array
    at: Index


def drifts(values: Array, std: Array, degrees: Array, times: Array) -> Drifts:
    """Return the tests of series.

    Parameters
    ----------
    values, std, degrees : ndarray, shape (N, T)
        Values, standard deviations, and the degrees of freedom that these are known with; NaN where there is none.
    times : ndarray, shape (T,)
        Increasing.

    Notes
    -----
    Both are contrasts Σ cₜ yₜ with the variance Σ cₜ² (sₜ² + ω²), ω the scatter from night to night. Series do not
    scatter alike: the variance of each is moderated by its own squared differences, without the change or the trend
    (Smyth 2004). The p-value of a change is that of the best place times the number of places (Bonferroni).
    """
    from scipy import special

    known = np.isfinite(values) & np.isfinite(std)
    count, last = known.sum(axis=1), np.maximum.accumulate(np.where(known, np.arange(len(times)), 0), axis=1)
    y, s = np.where(known, values, 0.0), np.where(known, std, 1.0) ** 2
    nu = np.where(known & np.isfinite(degrees), degrees, 1e9).min(axis=1)
    there = known[:, 1:] & (np.cumsum(known, axis=1)[:, :-1] > 0)

    def before(x: Array) -> Array:
        return np.take_along_axis(np.broadcast_to(x, y.shape), last[:, :-1], axis=1)

    step, single = y[:, 1:] - before(y), s[:, 1:] + before(s)
    individual = step.copy()  # less what most series of a night have in common
    for column in np.flatnonzero(there.sum(axis=0) >= FLEET.fewest):
        some = step[there[:, column], column]
        individual[:, column] = (individual[:, column] - np.median(some)) * np.sqrt(
            len(some) / (len(some) - 1)
        )
    scatter = _repeatability(individual[there] ** 2, single[there])
    expected = np.where(there, single + 2 * scatter, np.inf)
    alike = _alike((individual**2 / expected).sum(axis=1) / np.maximum(count - 1, 1), _worth(count - 1))
    of_all = np.minimum(alike, max(EFFICIENCY * float(_worth(count - 1).sum()), 1.0))
    # what weights that follow estimated variances make too small (Meier 1953)
    weight, variance = known / (s + scatter), s * (1 + 4 / nu[:, None]) + scatter

    def fitted(regressor: Array) -> tuple[Array, Array, Array]:
        """Return by how much values follow a regressor, (T,), beside a constant; standard deviations and p, (N,)."""
        centred = regressor - (weight @ regressor / np.maximum(weight.sum(axis=1), 1e-300))[:, None]
        moment = (weight * centred**2).sum(axis=1)
        lever = np.divide(
            weight * centred, moment[:, None], out=np.zeros_like(y), where=moment[:, None] > 1e-9
        )
        size, beside = (lever * y).sum(axis=1), _worth(count - 2)
        left = (step - size[:, None] * (regressor[1:] - before(regressor))) ** 2 / expected
        factor = (of_all + beside * left.sum(axis=1) / np.maximum(count - 2, 1)) / (of_all + beside)
        deviation = np.sqrt((lever**2 * variance).sum(axis=1) * factor)
        dof = 1 / (1 / (of_all + beside) + 1 / nu)
        t = np.divide(size, deviation, out=np.zeros_like(size), where=deviation > 0)
        return size, deviation, 2 * special.stdtr(dof, -np.abs(t))

    slope, slope_std, trend_p = fitted(times)
    steps = [fitted((np.arange(len(times)) >= k).astype(float)) for k in range(1, len(times))]
    size, size_std, p = (np.stack(part, axis=1) for part in zip(*steps, strict=True))
    best, row = np.where(there, p, 2.0).argmin(axis=1), np.arange(len(y))
    change_p = np.where(count > 1, np.minimum(p[row, best] * np.maximum(count - 1, 1), 1.0), 1.0)
    return Drifts(
        np.stack([slope, size[row, best]]),
        np.stack([slope_std, size_std[row, best]]),
        np.stack([np.where(count > 2, trend_p, 1.0), change_p]),
        best + 1,
    )


def _repeatability(squares: Array, single: Array) -> float:
    """Return the variance by which values scatter beyond their own, from squared differences and their variances."""
    from scipy import optimize

    def excess(variance: float) -> float:
        return float(np.mean(np.minimum(squares / (single + 2 * variance), LARGEST))) - USUAL

    if not len(squares) or excess(0.0) <= 0:
        return 0.0
    return float(optimize.brentq(excess, 0.0, float(squares.max()) / USUAL, xtol=1e-300, rtol=1e-9))


def _worth(count: Index) -> Array:
    """Return the degrees of freedom of a mean of so many squared successive differences."""
    some = np.maximum(count, 1)
    return np.asarray((count > 0) * some / (1 + (some - 1) / (2 * some)))


def _alike(ratio: Array, degrees: Array) -> float:
    """Return the degrees of freedom that the scatter of all series is worth for that of one.

    The scatter of a series has a variance that is drawn from a scaled inverse chi-square distribution, so that the
    ratio of its squared differences to what is expected of them has an F distribution (Smyth 2004).

    Parameters
    ----------
    ratio, degrees : ndarray, shape (N,)
        Of each series, and its degrees of freedom.
    """
    from scipy import stats

    x, dof = np.clip(ratio, 1e-12, CENSORED)[degrees > 0], degrees[degrees > 0]
    log = np.array(
        [
            np.where(x < CENSORED, stats.f.logpdf(x, dof, alike), stats.f.logsf(CENSORED, dof, alike)).sum()
            for alike in ALIKE
        ]
    )
    weight = np.array(PRIOR) * np.exp(log - log.max())
    return ALIKE[int(np.searchsorted(np.cumsum(weight / weight.sum()), CAUTION))]
