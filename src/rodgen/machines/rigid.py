"""Rotations of a few vectors, with their derivatives: the geometry that does not change from row to row.

The formulas are proved in the derivation ``machine_model``, which the kernels are made from.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rodgen.array_types import Array
from rodgen.kinematics.backend import kernels


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
    (x, y, z), (a, b, c) = n.tolist(), u.tolist()
    return u + 0.0, np.array(
        [y * c - z * b, z * a - x * c, x * b - y * a]
    ) + 0.0  # np.cross takes five times as long


def three(vector: ArrayLike) -> tuple[float, float, float]:
    """Return a vector as three numbers of Python, without negative zeros."""
    x, y, z = (np.asarray(vector, float) + 0.0).tolist()
    return x, y, z


def rotation_matrix(w: ArrayLike) -> Array:
    """Return the matrix of the rotation by a rotation vector in radians, (..., 3, 3).

    Examples
    --------
    >>> rotation_matrix([0, 0, 1]).round(6)
    array([[ 0.540302, -0.841471,  0.      ],
           [ 0.841471,  0.540302,  0.      ],
           [ 0.      ,  0.      ,  1.      ]])
    """
    matrix: Array = kernels.rotation_from_vector(w)[0]
    return matrix


def left_jacobian(w: ArrayLike) -> Array:
    """Return L with R(w + dw) = R(L dw) R(w) to first order, (..., 3, 3).

    Examples
    --------
    >>> left_jacobian([0, 0, 1]).round(6)
    array([[ 0.841471, -0.459698,  0.      ],
           [ 0.459698,  0.841471,  0.      ],
           [ 0.      ,  0.      ,  1.      ]])
    """
    jacobian: Array = kernels.rotation_from_vector(w)[1]
    return jacobian


def rotation_vector(matrix: ArrayLike) -> Array:
    """Return the rotation vector of a rotation matrix, in radians, at most π long."""
    axis, angle, _ = kernels.axis_angle_from_matrix(np.asarray(matrix, float))
    return np.asarray(axis * angle[..., None])


def matrix_from_roll_pitch_yaw(angles: ArrayLike) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll), (..., 3, 3), as URDF has it; angles are roll, pitch, yaw, (..., 3), in rad."""
    x, y, z = (rotation_matrix(np.asarray(angles, float)[..., i, None] * np.eye(3)[i]) for i in range(3))
    return np.asarray(z @ y @ x)


def roll_pitch_yaw(matrix: ArrayLike) -> Array:
    """Return roll, pitch and yaw of rotation matrices, (..., 3), in radians; yaw is 0 where roll is about its axis.

    Examples
    --------
    >>> roll_pitch_yaw(matrix_from_roll_pitch_yaw([0.1, 0.2, 0.3])).round(12)
    array([0.1, 0.2, 0.3])
    """
    m = np.asarray(matrix, float)
    level = np.hypot(m[..., 0, 0], m[..., 1, 0])
    upright = level < 1e-9
    roll = np.where(upright, np.arctan2(-m[..., 1, 2], m[..., 1, 1]), np.arctan2(m[..., 2, 1], m[..., 2, 2]))
    yaw = np.where(upright, 0.0, np.arctan2(m[..., 1, 0], m[..., 0, 0]))
    return np.stack([roll, np.arctan2(-m[..., 2, 0], level), yaw], axis=-1)


def tilted(axis: ArrayLike, u: ArrayLike, v: ArrayLike, tilt: ArrayLike) -> tuple[Array, Array]:
    """Turn an axis by the rotation vector a u + b v.

    Parameters
    ----------
    axis, u, v : array_like, shape (..., 3)
        Orthonormal.
    tilt : array_like, shape (..., 2)
        a and b in radians.

    Returns
    -------
    axis : ndarray, shape (..., 3)
    derivative : ndarray, shape (..., 3, 2)
        With respect to a and b.

    Examples
    --------
    >>> axis, derivative = tilted([0, 0, 1], [1, 0, 0], [0, 1, 0], [0.5, 0])
    >>> axis.round(6)
    array([ 0.      , -0.479426,  0.877583])
    >>> derivative[:, 0].round(6)
    array([ 0.      , -0.877583, -0.479426])
    """
    turned, derivative = kernels.tilted_axis(axis, u, v, tilt)
    return turned, derivative
