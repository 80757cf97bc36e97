"""Many tests at once: how many independent ones those of one residual amount to, and rates of false discoveries."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from functools import lru_cache

import numpy as np

from rodgen.array_types import Array

SIMULATIONS = 2000
RATE = 0.01
"""Rate of false alarms at which the effective number is counted: that at which it is used."""
AT_ONCE = 128
"""Columns that are multiplied with all residuals at once."""


def effective_tests(bases: Sequence[Array], residual_dof: int, base: Array | None = None) -> float:
    """Return the number of independent tests of which the least p-value is distributed like that of these.

    Parameters
    ----------
    bases : sequence of ndarray, each of shape (N, k)
        Orthonormal basis of what each test looks at.
    residual_dof : int
        Degrees of freedom that a test with no columns of its own would leave.
    base : ndarray, shape (N, r), optional
        Orthonormal basis of the model's columns; residuals are orthogonal to it.

    Returns
    -------
    float
        At least 1.

    Notes
    -----
    The quantile of the least p-value at the rate α of false alarms is simulated with normal residuals, and the Šidák
    correction 1 - (1 - p)ⁿ = α solved for n. The residuals are drawn in the N coordinates of the bases, so that
    rounding of the bases changes the result by as little.
    """
    from scipy import special

    if not bases:
        return 1.0
    residuals, random = _drawn(len(bases[0]))
    random = deepcopy(random)  # the kept one draws the same next time
    rest = residual_dof - len(residuals)
    if base is not None:
        residuals = residuals - base @ (base.T @ residuals)
        rest += base.shape[1]
    total = np.sum(residuals**2, axis=0) + (random.chisquare(rest, SIMULATIONS) if rest > 0 else 0.0)
    largest = _largest_falls(bases, residuals)
    least = np.ones(SIMULATIONS)
    for k, fall in largest.items():
        x = np.clip(1 - fall / total, 0.0, 1.0)
        least = np.minimum(least, special.betainc(max(residual_dof - k, 1) / 2, k / 2, x))
    quantile = float(np.quantile(least, RATE))
    return max(-np.log1p(-RATE) / quantile, 1.0) if quantile > 0 else float(len(bases))


@lru_cache(maxsize=1)
def _drawn(count: int) -> tuple[Array, np.random.Generator]:
    """Return normal residuals, (count, SIMULATIONS), and what drew them: a selection asks for as many each time."""
    random = np.random.default_rng(0)
    return random.normal(size=(count, SIMULATIONS)), random


def _largest_falls(bases: Sequence[Array], residuals: Array) -> dict[int, Array]:
    """Return the largest fall of the sum of squares by tests of as many columns, (SIMULATIONS,), by their number.

    Of these the test with the largest fall has the least p-value. Bases are multiplied with the residuals together,
    which reads these a few times only.
    """
    by: dict[int, list[Array]] = {}
    for basis in bases:
        by.setdefault(basis.shape[1], []).append(basis)
    found = {}
    for k, several in by.items():
        largest = np.zeros(SIMULATIONS)
        step = max(AT_ONCE // max(k, 1), 1)
        for some in (several[i : i + step] for i in range(0, len(several), step)):
            along = np.concatenate(some, axis=1).T @ residuals
            falls = np.sum(along.reshape(len(some), k, SIMULATIONS) ** 2, axis=1)
            largest = np.maximum(largest, falls.max(axis=0))
        found[k] = largest
    return found


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
    found = np.empty_like(flat)
    found[order] = np.minimum.accumulate(rates[::-1])[::-1]
    return np.minimum(found, 1.0).reshape(p_values.shape)
