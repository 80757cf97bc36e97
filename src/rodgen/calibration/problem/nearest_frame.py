"""The measuring frame in which a geometry that is known meets its readings best."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.machines.model import Frame
from rodgen.statistics.decompositions import svd

__all__ = ["nearest_frame"]

Array: TypeAlias = NDArray[np.float64]


def nearest_frame(places: Array, readings: Array, weight: Array, *, moving: bool) -> Frame:
    """Return the rigid motion that brings predicted places nearest to readings.

    Parameters
    ----------
    places, readings : ndarray, shape (n, 3)
    weight : ndarray, shape (n,)
        Of the squares.
    moving : bool
        Whether the frame may be displaced, too; directions only turn.

    Notes
    -----
    Orthogonal Procrustes problem with the determinant held at 1 (Kabsch 1976, Umeyama 1991).
    """
    weight = weight / weight.sum()
    zero = np.zeros(3)
    from_mean = weight @ places if moving else zero
    to_mean = weight @ readings if moving else zero
    u, _, vt = svd((readings - to_mean).T @ ((places - from_mean) * weight[:, None]), full_matrices=True)
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0]) @ vt
    return Frame(rotation, to_mean - rotation @ from_mean)
