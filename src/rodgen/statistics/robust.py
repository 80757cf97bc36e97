"""What robust fits share: Huber's weights, a scale by the median, and the chi distribution.

The size z of a row with m components, in units of its noise, is chi-distributed with m degrees of freedom.
"""

from __future__ import annotations

import math

import numpy as np

from rodgen.array_types import Array

HALF_OF_NORMAL = 0.6745
"""Standard deviations within which half of normal errors are."""
HUBER = {1: 1.3449975, 2: 1.5011411, 3: 1.6279879, 6: 1.8693377}
"""Tuning constant k by m: 95 % efficiency for m normal components, (E[ψ′/m + (m-1)ψ/(mz)])² / (E[ψ²]/m) = 0.95."""


def huber_weight(size: Array, threshold: float) -> Array:
    """Return Huber's weight min(1, k/z) of each size (Huber 1964)."""
    return np.asarray(threshold / np.maximum(size, threshold))


def median_factor(residual_dof: float) -> float:
    """Return what a scale from the median of few sizes is multiplied by (Rousseeuw 1984): a fit makes it too small.

    Parameters
    ----------
    residual_dof : float
        Rows less those that the parameters of the fit use up.
    """
    return 1 + 5 / max(residual_dof, 1.0)


# The chi distribution with three degrees of freedom: the length of a vector of three standard normal components.


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
