"""The space that columns span."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["orthonormal"]

Array: TypeAlias = NDArray[np.float64]

DEPENDENT = 1e-9
"""Part below which a column, of length 1, depends on the others."""


def orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis of what columns span, (N, rank).

    Parameters
    ----------
    columns : ndarray, shape (N, k)
        Of any length; a zero spans nothing.
    """
    if not columns.shape[1]:
        return np.zeros((len(columns), 0))
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
    return np.asarray(u[:, s > DEPENDENT * max(s[0], 1e-300)])
