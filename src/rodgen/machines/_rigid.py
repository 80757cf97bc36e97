"""Rotations of a few vectors, with their derivatives: the geometry that does not change from row to row."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["complete_basis", "cross_matrix", "left_jacobian", "rotation_matrix", "rotation_vector", "tilted"]

Array: TypeAlias = NDArray[np.float64]


def complete_basis(axis: ArrayLike) -> tuple[Array, Array]:
    """Return the unit vectors u, v that complete an axis n: for n = z they are x and y, and cyclically.

    Otherwise u is the next machine axis after n's largest component, made perpendicular to n, and v = n × u.

    Examples
    --------
    >>> complete_basis([0, 0, 1])
    (array([1., 0., 0.]), array([0., 1., 0.]))
    """
    n = np.asarray(axis, float) / np.linalg.norm(axis)
    largest = int(np.argmax(np.abs(n)))
    u = np.zeros(3)
    u[(largest + 1) % 3] = 1.0
    u = u - n * (n @ u)
    u = u / np.linalg.norm(u)
    return u + 0.0, np.cross(n, u) + 0.0


def cross_matrix(w: ArrayLike) -> Array:
    """Return the matrix of the cross product with w, (3, 3)."""
    x, y, z = np.asarray(w, float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _coefficients(square: float) -> tuple[float, float, float]:
    """Return sin(x)/x, (1 - cos x)/x² and (x - sin x)/x³ of the root x of a number, also near zero."""
    if square < 1e-4:  # the terms that are left out are below 1e-18 of the sum
        return (
            1 - square / 6 * (1 - square / 20 * (1 - square / 42)),
            (1 - square / 12 * (1 - square / 30 * (1 - square / 56))) / 2,
            (1 - square / 20 * (1 - square / 42 * (1 - square / 72))) / 6,
        )
    angle = np.sqrt(square)
    return np.sin(angle) / angle, 2 * np.sin(angle / 2) ** 2 / square, (angle - np.sin(angle)) / angle**3


def rotation_matrix(w: ArrayLike) -> Array:
    """Return the matrix of the rotation by a rotation vector in radians, (3, 3)."""
    w = np.asarray(w, float)
    by_sine, by_cosine, _ = _coefficients(float(w @ w))
    k = cross_matrix(w)
    return np.eye(3) + by_sine * k + by_cosine * (k @ k)


def left_jacobian(w: ArrayLike) -> Array:
    """Return L with R(w + dw) = R(L dw) R(w) to first order, (3, 3)."""
    w = np.asarray(w, float)
    _, by_cosine, third = _coefficients(float(w @ w))
    k = cross_matrix(w)
    return np.eye(3) + by_cosine * k + third * (k @ k)


def rotation_vector(matrix: ArrayLike) -> Array:
    """Return the rotation vector of a rotation matrix, in radians, at most π long."""
    from rodgen.rotation import axis_angle_from_matrix

    axis, angle, _ = axis_angle_from_matrix(np.asarray(matrix, float))
    return np.asarray(axis, float) * float(angle)


def tilted(axis: Array, u: Array, v: Array, tilt: Array) -> tuple[Array, Array]:
    """Turn an axis by the rotation vector a u + b v.

    Parameters
    ----------
    axis, u, v : ndarray, shape (3,)
        Orthonormal.
    tilt : ndarray, shape (2,)
        a and b in radians.

    Returns
    -------
    axis : ndarray, shape (3,)
    derivative : ndarray, shape (3, 2)
        With respect to a and b.
    """
    w = tilt[0] * u + tilt[1] * v
    turned = rotation_matrix(w) @ axis
    turns = left_jacobian(w) @ np.column_stack([u, v])
    return turned, cross_matrix(turned) @ -turns
