"""What robust fits share: Huber's weights, and the correction of a scale by the median.

The size z of a row with m components, in units of its noise, is chi-distributed with m degrees of freedom.
"""

from __future__ import annotations

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
