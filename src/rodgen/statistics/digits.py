"""Significant digits by uncertainty, after the Guide to the Expression of Uncertainty in Measurement (GUM), 7.2.6."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["round_by"]

Array: TypeAlias = NDArray[np.float64]


def round_by(values: Array, u: Array) -> Array:
    """Return values rounded to the decimal of the second significant digit of their uncertainties.

    Values whose uncertainty is 0 or not known stay as they are.

    Examples
    --------
    >>> import numpy as np
    >>> round_by(np.array([12.34567, 1234.5, 0.5]), np.array([0.0123, 99.7, np.nan])).tolist()
    [12.346, 1230.0, 0.5]
    """
    known = np.isfinite(u) & (u > 0)
    safe = np.where(known, u, 1.0)
    first = np.floor(np.log10(safe))
    first = first + (np.round(safe / 10.0 ** (first - 1)) >= 100)  # 0.0997 is 0.10
    decimals = np.clip(1 - first, -300, 300)
    up, down = 10.0 ** np.maximum(decimals, 0), 10.0 ** np.maximum(-decimals, 0)
    found = np.round(values * up / down) / up * down
    return np.asarray(np.where(known & np.isfinite(found), found, values))
