"""Tail probabilities of F, also where they are too small for a double, and falls of sums of squares."""

from __future__ import annotations

import numpy as np

from rodgen.statistics.thresholds import SMALLEST_P

SERIES_BELOW = 1e-250
"""Probabilities below are summed up from the series, as logarithms; a double ends at 1e-308."""


def f_tail(ratio: float, numerator: float, denominator: float) -> float:
    """Return the probability that F(numerator, denominator) exceeds a ratio.

    Parameters
    ----------
    ratio : float
        Not negative; infinity gives 0.
    numerator, denominator : float
        Degrees of freedom.

    Examples
    --------
    >>> round(f_tail(4.0, 1, 10), 6)
    0.073388
    """
    from scipy import special

    return float(
        special.betainc(denominator / 2, numerator / 2, denominator / (denominator + numerator * ratio))
    )


def log10_f_tail(ratio: float, numerator: float, denominator: float) -> float:
    """Return log10 of the probability that F(numerator, denominator) exceeds a ratio.

    Parameters
    ----------
    ratio, numerator, denominator : float
        As of :func:`f_tail`; a ratio that is not finite gives minus infinity.

    Examples
    --------
    >>> round(log10_f_tail(4.0, 1, 10), 6)
    -1.134375
    """
    return log10_p_of_fall(numerator * ratio, denominator, numerator, denominator)


def log10_p_of_fall(fall: float, left: float, numerator: float, denominator: float) -> float:
    """Return log10 of the probability that chance lowers a sum of squares as much.

    Parameters
    ----------
    fall, left : float
        What further columns take away from the sum of squares, and what remains.
    numerator, denominator : float
        Degrees of freedom of the two.

    Returns
    -------
    float
        0 where nothing falls, or fewer than one degree of freedom remains.

    Notes
    -----
    The tail of F is the incomplete beta function I_x(b/2, a/2) at x = left / (left + fall). Where it underflows, its
    series is summed up, separately from the logarithm of its first term (DLMF 8.17.8): all terms are positive.

    Examples
    --------
    >>> round(log10_p_of_fall(4.0, 10.0, 1, 10), 6), round(log10_p_of_fall(1e4, 1e3, 2, 1000))
    (-1.134375, -521)
    """
    from scipy import special

    if not fall > 0 or denominator < 1:
        return 0.0
    if not np.isfinite(fall):
        return -np.inf
    a, b = denominator / 2, numerator / 2
    x = left / (left + fall)
    p = float(special.betainc(a, b, x))
    if p > SERIES_BELOW:
        return float(np.log10(p))
    if not x > 0:
        return -np.inf
    total, term, k = 1.0, 1.0, 0
    while term > 1e-12 * total and k < 100_000:
        term *= (a + b + k) / (a + 1 + k) * x
        total += term
        k += 1
    logarithm = a * np.log(x) + b * np.log1p(-x) - np.log(a) - special.betaln(a, b) + np.log(total)
    return float(logarithm / np.log(10))


def log_p_of_fall(fall: float, left: float, numerator: float, denominator: float) -> float:
    """Return the natural logarithm of the same probability as :func:`log10_p_of_fall`."""
    return log10_p_of_fall(fall, left, numerator, denominator) * float(np.log(10))


def p_of_log10(log10_p: float) -> float:
    """Return a probability from its log10; at least :data:`rodgen.statistics.thresholds.SMALLEST_P`."""
    return float(max(10.0 ** max(log10_p, -300.0), SMALLEST_P))
