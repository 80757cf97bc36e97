"""Tail probabilities of F."""

from __future__ import annotations


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
