"""The chi distribution with three degrees of freedom: the length of a vector of three standard normal components."""

from __future__ import annotations

import math

FARTHEST = 40.0
"""Beyond it the tail is less than the least positive number."""


def chi_share(cut: float, dof: int) -> float:
    """Return the probability that a chi variable with 3 or 5 degrees of freedom is below `cut`."""
    density = math.sqrt(2 / math.pi) * math.exp(-(cut**2) / 2)
    share = math.erf(cut / math.sqrt(2)) - density * cut
    return share if dof == 3 else share - density * cut**3 / 3


def chi3_quantile(tail: float) -> float:
    """Return the value that a chi variable with three degrees of freedom exceeds with the probability `tail`.

    By bisection of the survival function erfc(k/√2) + √(2/π) k exp(−k²/2).

    Examples
    --------
    >>> round(chi3_quantile(0.05), 4)
    2.7955
    """
    low, high = 0.0, FARTHEST
    for _ in range(60):
        k = (low + high) / 2
        above = math.erfc(k / math.sqrt(2)) + math.sqrt(2 / math.pi) * k * math.exp(-(k**2) / 2)
        low, high = (k, high) if above > tail else (low, k)
    return high
