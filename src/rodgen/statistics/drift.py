"""Trends and changes in many short series of values with standard deviations, such as those of a machine's nights.

A value scatters by more than its own standard deviation says: machines do not repeat themselves exactly. How much is
estimated from the successive differences of all series together, the large ones cut off, so that neither trends nor
a few changes move it much; and that of each series from these and its own. Each series is then held against a constant
in two ways: a straight line (generalised least squares), and one change of the level, at whichever place it fits best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rodgen.array_types import Array, Index, Mask
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
    """The tests of series.

    Attributes
    ----------
    slope, slope_std : ndarray, shape (N,)
        Of the line, per unit of time.
    trend_p : ndarray, shape (N,)
        Probability that chance makes as steep a line; 1 where there are too few values.
    step, step_std : ndarray, shape (N,)
        The change of the level.
    at : ndarray of int, shape (N,)
        Number of the first value after it.
    change_p : ndarray, shape (N,)
        Probability that chance makes as large a change at any place.
    """

    slope: Array
    slope_std: Array
    trend_p: Array
    step: Array
    step_std: Array
    at: Index
    change_p: Array


@dataclass(frozen=True, eq=False)
class _Differences:
    """Successive differences of series, each at its second value, (N, T-1).

    Attributes
    ----------
    known : ndarray of bool
        Where there is one.
    step : ndarray
    own : ndarray
        The same less what most series of a night have in common, which is no scatter of theirs.
    single : ndarray
        Variances that follow from those of the values.
    passed : ndarray
        Times between the values.
    """

    known: Mask
    step: Array
    own: Array
    single: Array
    passed: Array

    @classmethod
    def of(cls, values: Array, variances: Array, times: Array) -> _Differences:
        """Return those of values, (N, T), NaN where there is none."""
        there = np.isfinite(values) & np.isfinite(variances)
        y, s = np.where(there, values, 0.0), np.where(there, variances, 1.0)
        last = np.maximum.accumulate(np.where(there, np.arange(len(times)), 0), axis=1)[:, :-1]
        known = there[:, 1:] & (np.cumsum(there, axis=1)[:, :-1] > 0)
        step = y[:, 1:] - np.take_along_axis(y, last, axis=1)
        own = step.copy()
        for column in np.flatnonzero(known.sum(axis=0) >= FLEET.fewest):
            some = step[known[:, column], column]
            own[:, column] = (own[:, column] - np.median(some)) * np.sqrt(len(some) / (len(some) - 1))
        single = s[:, 1:] + np.take_along_axis(s, last, axis=1)
        return cls(known, step, own, single, times[1:] - times[last])

    @property
    def count(self) -> Index:
        """Number of each series, (N,)."""
        return np.asarray(self.known.sum(axis=1))


def repeatability(values: Array, std: Array) -> tuple[float, float]:
    """Return the variance by which values of series scatter beyond their own, and half the variance of that number.

    What is estimated is the scatter in all; how uncertain it is does not become less where the values' own variances
    happen to explain it.

    Parameters
    ----------
    values, std : ndarray, shape (N, T)
        NaN where there is none.
    """
    found = _Differences.of(values, std**2, np.arange(float(values.shape[1])))
    if not found.known.any():
        return 0.0, 0.0
    squares, single = found.own[found.known] ** 2, found.single[found.known]
    degrees = EFFICIENCY * float(_worth(found.count).sum())

    def excess(variance: float) -> float:
        return float(np.mean(np.minimum(squares / (single + 2 * variance), LARGEST))) - USUAL

    low = high = 0.0
    if excess(0.0) > 0:
        high = float(squares.max()) / USUAL
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    variance = (low + high) / 2
    return variance, (variance + float(np.median(single)) / 2) ** 2 / max(degrees, 1.0)


def _smoothed(squares: Array, degrees: Array, known: Mask) -> Array:
    """Return variances of each series, nearer to their mean as far as their own uncertainty made them differ.

    Weights by variances that are estimated follow their errors: values of which the variance happens to be too small
    would count most, and a mean would seem more certain than it is.
    """
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    logs = np.log(squares)
    mean = (logs * known).sum(axis=1, keepdims=True) / count
    differ = ((logs - mean) ** 2 * known).sum(axis=1, keepdims=True) / np.maximum(count - 1, 1)
    chance = (2 / degrees * known).sum(axis=1, keepdims=True) / count
    kept = np.clip(1 - np.divide(chance, differ, out=np.ones_like(chance), where=differ > 0), 0.0, 1.0)
    return np.asarray(np.exp(mean + kept * (logs - mean)))


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
    from scipy import special

    x, own = np.clip(ratio, 1e-12, CENSORED), degrees / 2
    log = []
    for alike in ALIKE:
        other = alike / 2
        density = (
            own * np.log(own / other) + (own - 1) * np.log(x) - (own + other) * np.log1p(x * own / other)
        )
        density -= special.gammaln(own) + special.gammaln(other) - special.gammaln(own + other)
        beyond = special.betainc(other, own, other / (other + own * CENSORED))
        log.append(np.where(ratio < CENSORED, density, np.log(np.maximum(beyond, 1e-300))).sum())
    weight = np.array(PRIOR) * np.exp(np.array(log) - max(log))
    return ALIKE[int(np.searchsorted(np.cumsum(weight / weight.sum()), CAUTION))]


def drifts(values: Array, std: Array, degrees: Array, times: Array, repeat: tuple[float, float]) -> Drifts:
    """Return the tests of series.

    Parameters
    ----------
    values, std, degrees : ndarray, shape (N, T)
        Values, standard deviations, and the degrees of freedom that these are known with; NaN where there is none.
    times : ndarray, shape (T,)
        Increasing.
    repeat : pair of floats
        As of `repeatability`.

    Notes
    -----
    Both are contrasts Σ cₜ yₜ with the variance Σ cₜ² (sₜ² + ω²), whose degrees of freedom are those of Satterthwaite
    (1946). The p-value of a change is that of the best place times the number of places (Bonferroni). Series do not
    scatter alike: the variance of each is moderated by its own squared differences, without that at the place of the
    change, or without the trend.
    """
    omega, of_omega = repeat
    known = np.isfinite(values) & np.isfinite(std)
    y, s = np.where(known, values, 0.0), np.where(known, std, 1.0) ** 2
    nu = np.where(known & np.isfinite(degrees), degrees, 1e9)
    weight = known / (_smoothed(s, nu, known) + omega)
    s = s * (1 + 4 / nu)  # what weights that follow them make too small (Meier 1953)
    count, total = known.sum(axis=1), np.maximum(weight.sum(axis=1), 1e-300)

    found = _Differences.of(np.where(known, values, np.nan), s, times)
    place, expected = found.known, found.single + 2 * omega
    differ = np.where(place, found.own**2 / expected, 0.0)
    of_all, others = _worth(count - 1), _worth(count - 2)
    some = of_all > 0
    alike = _alike(differ.sum(axis=1)[some] / (count - 1)[some], of_all[some]) if some.any() else ALIKE[-1]

    def moderated(squares: Array) -> tuple[Array, Array]:
        """Return factors of variances and their degrees of freedom, from sums of the squares of one difference less."""
        fewer = np.maximum(count - 2, 1).reshape(-1, *[1] * (squares.ndim - 1))
        own = others.reshape(fewer.shape)
        return (alike + own * squares / fewer) / (alike + own), alike + own

    def tail(
        size: Array, variance: Array, squares: Array, fourths: Array, factor: Array, known_with: Array
    ) -> Array:
        """Return p of contrasts, given their variances, Σc² and Σc⁴s⁴/ν, and a factor and its degrees of freedom."""
        from scipy import special

        spread = fourths + squares**2 * of_omega
        dof = np.clip(
            np.divide(variance**2, spread, out=np.full_like(spread, 1e9), where=spread > 0), 1.0, 1e9
        )
        dof = 1 / (1 / dof + 1 / known_with)
        variance = variance * factor
        t = np.divide(size**2, variance, out=np.zeros_like(size), where=variance > 0)
        return np.asarray(special.betainc(dof / 2, 0.5, dof / (dof + t)))

    centred = np.where(known, times - (weight @ times / total)[:, None], 0.0)
    moment = (weight * centred**2).sum(axis=1)
    lever = np.divide(weight * centred, moment[:, None], out=np.zeros_like(y), where=moment[:, None] > 0)
    slope, slope_var = (lever * y).sum(axis=1), (lever**2 * (s + omega) * known).sum(axis=1)
    about_line = np.where(place, (found.step - slope[:, None] * found.passed) ** 2 / expected, 0.0).sum(
        axis=1
    )
    of_line = moderated(about_line)
    trend_p = tail(slope, slope_var, (lever**2).sum(axis=1), (lever**4 * s**2 / nu).sum(axis=1), *of_line)

    left = np.cumsum(weight, axis=1)[:, :-1]
    right = total[:, None] - left

    def at_places(terms: Array, power: int) -> tuple[Array, Array]:
        """Return sums of terms before and after each place, over the total weights there to a power, (N, T-1)."""
        before = np.cumsum(terms, axis=1)[:, :-1]
        after = terms.sum(axis=1)[:, None] - before
        sides = []
        for part, whole in ((before, left), (after, right)):
            sides.append(np.divide(part, np.where(place, whole, 1.0) ** power))
        return sides[0], sides[1]

    before, after = at_places(weight * y, 1)
    step = after - before
    variance = np.add(*at_places(weight**2 * (s + omega), 2))
    squares = np.add(*at_places(weight**2, 2))
    fourths = np.add(*at_places(weight**4 * s**2 / nu, 4))
    factor = moderated(differ.sum(axis=1)[:, None] - differ)
    p = np.where(place, tail(step, variance, squares, fourths, *factor), 2.0)
    best = p.argmin(axis=1)
    row = np.arange(len(y))
    change_p = np.minimum(p[row, best] * np.maximum(count - 1, 1), 1.0)
    return Drifts(
        slope,
        np.sqrt(slope_var * of_line[0]),
        np.where(count > 2, trend_p, 1.0),
        step[row, best],
        np.sqrt((variance * factor[0])[row, best]),
        best + 1,
        np.where(count > 1, change_p, 1.0),
    )
