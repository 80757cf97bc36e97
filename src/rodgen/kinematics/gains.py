"""Gains of a mechanism: how far its point moves for one unit of its drives, at most and at least."""

from __future__ import annotations

from typing import Any

import numpy as np


def gains_and_condition(jacobian: Any) -> tuple[Any, Any]:
    """Return singular values (..., 3), largest first, and the condition (...) of square matrices (..., 3, 3).

    The condition is infinite where the smallest gain is zero; both are NaN where the matrix is not finite.
    """
    good = np.isfinite(jacobian).all(axis=(-2, -1))
    gains = np.linalg.svd(np.where(good[..., None, None], jacobian, 0.0), compute_uv=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = np.where(gains[..., 2] > 0, gains[..., 0] / gains[..., 2], np.inf)
    return np.where(good[..., None], gains, np.nan), np.where(good, condition, np.nan)
