"""Values of several subjects, each with its standard deviation, and how the subjects themselves differ.

The value of a subject is normal about its own truth, with a known standard deviation sᵢ; the truths are normal about a
mean μ with a spread τ (the normal-normal hierarchical model, or random-effects model of meta-analysis). τ is where the
weighted sum of squares about the mean has its expected value (Paule and Mandel 1982), which is one root of a decreasing
function; the same function at the quantiles of chi-square bounds its confidence interval (Viechtbauer 2007). Subjects
that belong to no such population are left out first: they would widen the spread and hide in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rodgen.array_types import Array, Mask
from rodgen.statistics.robust import HALF_OF_NORMAL
from rodgen.statistics.thresholds import FLEET

ROUNDS = 10
"""Times that the odd ones are looked for again at most; two or three are usual."""


@dataclass(frozen=True, eq=False)
class Population:
    """The distribution that subjects were drawn from, and where each is in it.

    Attributes
    ----------
    mean, mean_std : float
        μ and its standard deviation.
    spread : float
        τ, the standard deviation of the truths.
    spread_interval : pair of floats
        95 % confidence interval of τ.
    shrunk, shrunk_std : ndarray, shape (n,)
        Each truth given its own value and the population, and its standard deviation: the best linear predictor. Of an
        odd subject its own value: it is not of this population.
    p_value : ndarray, shape (n,)
        Probability that a subject of this population, which does not include it, is as far from the mean.
    odd : ndarray of bool, shape (n,)
        Subjects that do not belong to it, at the false discovery rate of `FLEET`.
    """

    mean: float
    mean_std: float
    spread: float
    spread_interval: tuple[float, float]
    shrunk: Array
    shrunk_std: Array
    p_value: Array
    odd: Mask


def population(values: Array, std: Array) -> Population:
    """Return the distribution that subjects were drawn from.

    Parameters
    ----------
    values, std : ndarray, shape (n,)
        Estimates of each subject and their standard deviations, which are positive; n is at least 3.

    Examples
    --------
    >>> found = population(np.array([1.0, 3.0, 2.0, 2.5, 1.5, 40.0]), np.full(6, 0.1))
    >>> round(found.mean, 3), found.odd.tolist(), round(float(found.shrunk[0]), 3)
    (2.0, [False, False, False, False, False, True], 1.016)
    """
    from scipy import special

    n = len(values)
    distance = np.abs(values - np.median(values))
    scale = float(np.median(distance)) / HALF_OF_NORMAL
    variance = max(scale**2 - float(np.median(std**2)), 0.0)
    p_value = np.asarray(2 * special.ndtr(-distance / np.sqrt(variance + std**2)))
    odd = _odd(p_value)
    for _ in range(ROUNDS):
        variance = _spread_variance(values[~odd], std[~odd], float(n - odd.sum() - 1))
        p_value = _p_values(values, std, ~odd, variance)
        again = _odd(p_value)
        if np.array_equal(again, odd):
            break
        odd = again
    is_usual, degrees = ~odd, float(n - odd.sum() - 1)
    variance = _spread_variance(values[is_usual], std[is_usual], degrees)
    low, high = (
        _spread_variance(values[is_usual], std[is_usual], float(special.chdtri(degrees, tail)))
        for tail in (0.025, 0.975)
    )
    weight = 1 / (variance + std**2)
    total = weight[is_usual].sum()
    mean = float(weight[is_usual] @ values[is_usual] / total)
    part = variance * weight  # of a subject's own value in what is known of it
    shrunk = np.where(odd, values, mean + part * (values - mean))
    shrunk_std = np.where(odd, std, np.sqrt(part * std**2 + (1 - part) ** 2 / total))
    return Population(
        mean, float(1 / np.sqrt(total)), float(np.sqrt(variance)), (float(np.sqrt(low)), float(np.sqrt(high))),
        shrunk, shrunk_std, p_value, odd,
    )  # fmt: skip


def _odd(p_value: Array) -> Mask:
    """Return which subjects do not belong to the population: a minority, else there is none."""
    is_discovery = discovery_rates(p_value) < FLEET.false_discoveries
    worst = np.argsort(np.argsort(p_value)) < int(FLEET.most_odd * len(p_value))
    return np.asarray(is_discovery & worst)


def _sum_of_squares(values: Array, std: Array, variance: float) -> float:
    """Return the weighted sum of squares about the weighted mean, for a variance of the truths; it decreases."""
    weight = 1 / (variance + std**2)
    mean = weight @ values / weight.sum()
    return float(weight @ (values - mean) ** 2)


def _spread_variance(values: Array, std: Array, wanted: float) -> float:
    """Return the variance of the truths for which the weighted sum of squares is as wanted; 0 where it is less."""
    if len(values) < 2 or _sum_of_squares(values, std, 0.0) <= wanted:
        return 0.0
    low, high = 0.0, float(np.sum((values - values.mean()) ** 2) / wanted)  # without std it is less there
    for _ in range(60):
        middle = (low + high) / 2
        if _sum_of_squares(values, std, middle) > wanted:
            low = middle
        else:
            high = middle
        if high - low < 1e-9 * high:
            break
    return (low + high) / 2


def _p_values(values: Array, std: Array, is_usual: Mask, variance: float) -> Array:
    """Return the probability that each subject is as far from the mean of the others, (n,).

    The variance of the truths is estimated: its information is half the sum of squared weights, so that a value is t
    with the degrees of freedom of Satterthwaite (1946). A subject that was among those estimated from is compared with
    the others (externally studentised).
    """
    from scipy import special

    each = variance + std**2
    weight = np.where(is_usual, 1 / each, 0.0)
    total = weight.sum()
    mean = weight @ values / total
    spread = np.where(
        is_usual, 1 - weight / total, 1 + 1 / (total * each)
    )  # of the variance of a value less the mean
    size = (values - mean) ** 2 / (each * np.maximum(spread, 1e-12))
    if variance == 0:
        return np.asarray(2 * special.ndtr(-np.sqrt(size)))
    squares = (weight**2).sum()
    information = squares - 2 * (weight**3).sum() / total + (squares / total) ** 2
    degrees = np.maximum(each**2 * information - is_usual, 1.0)
    size = np.where(is_usual, size * degrees / np.maximum(degrees + 1 - size, 1e-3), size)
    return np.asarray(special.betainc(degrees / 2, 0.5, degrees / (degrees + size)))


def discovery_rates(p_values: Array) -> Array:
    """Return for each test the least rate of false discoveries at which it is one, of the same shape.

    Parameters
    ----------
    p_values : ndarray

    Notes
    -----
    Benjamini and Hochberg (1995); also where tests depend on each other positively (Benjamini and Yekutieli 2001).

    Examples
    --------
    >>> discovery_rates(np.array([0.01, 0.5, 0.02, 1.0])).tolist()
    [0.04, 0.6666666666666666, 0.04, 1.0]
    """
    flat = p_values.ravel()
    order = np.argsort(flat)
    rates = flat[order] * len(flat) / np.arange(1, len(flat) + 1)
    adjusted = np.empty_like(flat)
    adjusted[order] = np.minimum.accumulate(rates[::-1])[::-1]
    return np.minimum(adjusted, 1.0).reshape(p_values.shape)
