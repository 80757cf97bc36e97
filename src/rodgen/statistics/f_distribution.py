"""The probability of an F as large by chance, as a logarithm: those that matter are too small for a double."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["log10_of_f", "log_of_fall"]


def log10_of_f(fall: float, left: float, numerator: float, denominator: float) -> float:
    """Return log10 of the probability that chance lowers a sum of squares as much.

    Parameters
    ----------
    fall, left : float
        What is taken away, and what is left.
    numerator, denominator : float
        Degrees of freedom of the two.

    Notes
    -----
    The tail of F is the incomplete beta function I_x(b/2, a/2) at x = left / (left + fall). Where it underflows, its
    series is summed up beside the logarithm of its first term (DLMF 8.17.8): all terms are positive.

    Examples
    --------
    >>> round(log10_of_f(4.0, 10.0, 1, 10), 6), round(log10_of_f(1e4, 1e3, 2, 1000))
    (-1.134375, -521)
    """
    from scipy.special import betainc, betaln

    if not fall > 0 or denominator < 1:
        return 0.0
    a, b = denominator / 2, numerator / 2
    x = left / (left + fall)
    p = float(betainc(a, b, x))
    if p > 1e-250:
        return float(np.log10(p))
    if not x > 0:
        return -np.inf
    total, term, k = 1.0, 1.0, 0
    while term > 1e-12 * total and k < 100_000:
        term *= (a + b + k) / (a + 1 + k) * x
        total += term
        k += 1
    logarithm = a * np.log(x) + b * np.log1p(-x) - np.log(a) - betaln(a, b) + np.log(total)
    return float(logarithm / np.log(10))


def log_of_fall(part: Any, freedoms: float, parameters: Any) -> NDArray[np.float64]:
    """Return about the natural logarithm of the same probability, of many at once, for ranking.

    Parameters
    ----------
    part : array_like
        Part of the sum of squares that is taken away.
    freedoms : float
        Readings less parameters.
    parameters : array_like
        Further ones of each.
    """
    from scipy.special import gammaln

    k = np.asarray(parameters, float)
    half = -freedoms / 2 * np.log1p(-np.minimum(np.asarray(part, float), 1 - 1e-15))
    # above its mean, the tail of chi-square is close to its first term
    tail = -half + (k / 2 - 1) * np.log(np.maximum(half, k / 2)) - gammaln(k / 2)
    return np.asarray(np.minimum(tail, 0.0))
