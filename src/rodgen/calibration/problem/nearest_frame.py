"""The measuring frame, and the attitude of a body, with which a geometry that is known meets its readings best."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.machines.model import Frame
from rodgen.statistics.decompositions import svd

__all__ = ["nearest_attitudes", "nearest_frame", "nearest_rotation"]

Array: TypeAlias = NDArray[np.float64]

_TURNS = 20
"""Alternating projections; a fit follows."""


def nearest_frame(places: Array, readings: Array, weight: Array, *, moving: bool) -> Frame:
    """Return the rigid motion that brings predicted places nearest to readings.

    Parameters
    ----------
    places, readings : ndarray, shape (n, 3)
    weight : ndarray, shape (n,)
        Of the squares.
    moving : bool
        Whether the frame may be displaced, too; directions only turn.

    """
    weight = weight / weight.sum()
    zero = np.zeros(3)
    from_mean = weight @ places if moving else zero
    to_mean = weight @ readings if moving else zero
    rotation = nearest_rotation((readings - to_mean).T @ ((places - from_mean) * weight[:, None]))
    return Frame(rotation, to_mean - rotation @ from_mean)


def nearest_rotation(matrix: Array) -> Array:
    """Return the rotations that are nearest to matrices, (..., 3, 3): the sum of squared differences is least.

    Notes
    -----
    Orthogonal Procrustes problem with the determinant held at 1 (Kabsch 1976, Umeyama 1991).
    """
    u, _, vt = svd(matrix, full_matrices=True)
    u[..., 2] *= np.where(np.linalg.det(u @ vt) < 0, -1.0, 1.0)[..., None]
    return np.asarray(u @ vt)


def nearest_attitudes(predicted: Array, read: Array) -> tuple[Array, Array]:
    """Return rotations B, of the measuring frame, and Y, of the body in itself, with B A Y nearest to readings.

    Parameters
    ----------
    predicted, read : ndarray, shape (n, 3, 3)
        Attitudes A as predicted without both, and as measured.

    Notes
    -----
    With exact readings M = B A Y the vectors of Yᵀ and B are the first pair of singular vectors of Σ Mᵀ ⊗ Aᵀ (Shah
    2013). Where all turns are about one axis they are not unique, so that turns by alternating projections follow, from
    there and from Y = 1; none of these enlarges the sum of squares.
    """
    products = np.einsum("nij,nkl->jlik", read, predicted).reshape(9, 9)
    u, _, vt = svd(products)
    first = vt[0].reshape(3, 3)
    sign = np.where(np.linalg.det(first) < 0, -1.0, 1.0)
    found = []
    for body in (nearest_rotation(sign * u[:, 0].reshape(3, 3)).T, np.eye(3)):
        for _ in range(_TURNS):
            frame = nearest_rotation(np.einsum("nij,nkj->ik", read, predicted @ body))
            body = nearest_rotation(np.einsum("nji,nkj,nkl->il", predicted, frame[None], read))
        found.append((np.sum((frame @ predicted @ body - read) ** 2), frame, body))
    return min(found, key=lambda one: float(one[0]))[1:]
