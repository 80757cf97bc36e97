"""Transformation matrices, and the vector and the angle of a rotation matrix.

A rotation matrix R turns about the unit vector m by the angle theta. The arccosine of the
trace loses half of the digits near 0 and near a half turn, and the differences r_ji - r_ij = 2 m_k sin(theta) lose the
vector near a half turn. Both come from the quaternion's largest component here, which loses nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.generated.numpy.rotations import RotationStatus
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.backend import kernels
from rodgen.views import with_html

ORTHOGONAL = 1e-6
"""Sum of the deviations of RᵀR and of the last row up to which a matrix is a rounded pose; as in the kernels."""


@with_html
class VectorAngle(NamedTuple):
    """Vector and angle of a rotation, of :func:`vector_and_angle`."""

    vector: Any
    angle: Any
    status: Any


def vector_and_angle(matrix: ArrayLike) -> VectorAngle:
    """Return the vector and the angle of a rotation matrix.

    Parameters
    ----------
    matrix : array_like (..., 3, 3)
        Rotation matrix.

    Returns
    -------
    VectorAngle
        vector (..., 3): unit vector m; NaN where the angle is zero, since the vector is arbitrary there. angle (...): 0
        to π in rad. status (...) of int8: codes of :class:`rodgen.RotationStatus`, IDENTITY for no turn, HALF_TURN
        for π to rounding, where m and -m are the same and the first component that is not zero is positive, NOT_NORMAL
        where the matrix is orthogonal only roughly, INVALID with NaN where it is not finite, or a reflection.

    Raises
    ------
    RodgenError
        When it is not an array of real numbers of that shape.

    Notes
    -----
    Crane and Duffy; the formulas of the notes are proved in the derivation ``spatial_links``, those that are used in
    ``rotations``. Both results are right to a few times the machine epsilon for every angle, 1e-8 and
    π - 1e-8 among them. A turn by theta about m is also one by 2π - theta about -m. The way back, the rotation about a
    general vector (and so about x, y and z), is :func:`rodgen.matrix_from_axis_angle`.

    Examples
    --------
    >>> from rodgen import spatial
    >>> found = spatial.vector_and_angle([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> found.vector, round(float(found.angle), 6)
    (array([0., 0., 1.]), 1.570796)
    """
    given = real_array("the matrix", matrix, (3, 3))
    vector, angle, status = (np.array(x) for x in kernels.axis_angle_from_matrix(given))
    vector[angle == 0] = np.nan
    half = status == RotationStatus.HALF_TURN
    if half.any():
        turned = vector[half]
        first = np.argmax(np.abs(turned) > 4 * np.finfo(turned.dtype).eps, axis=-1)
        vector[half] = turned * np.sign(np.take_along_axis(turned, first[..., None], axis=-1))
    return VectorAngle(vector, angle, status)


def transform(rotation: ArrayLike | None = None, origin: ArrayLike | None = None) -> Any:
    """Return the transformation matrices of rotation matrices and origins.

    Parameters
    ----------
    rotation : array_like (..., 3, 3), optional
        The axes of system B in system A, as columns; left out: those of A.
    origin : array_like (..., 3), optional
        The origin of B in A; left out: that of A.

    Returns
    -------
    array (..., 4, 4)
        Matrices from homogeneous coordinates in B to those in A.

    Raises
    ------
    RodgenError
        When it is not an array of real numbers of that shape.

    Examples
    --------
    >>> from rodgen import spatial
    >>> spatial.transform(origin=[1.0, 2.0, 3.0])[:3, 3]
    array([1., 2., 3.])
    """
    turned = np.eye(3) if rotation is None else real_array("the rotation", rotation, (3, 3))
    moved = np.zeros(3) if origin is None else real_array("the origin", origin, (3,))
    shape = np.broadcast_shapes(turned.shape[:-2], moved.shape[:-1])
    found = np.zeros((*shape, 4, 4))
    found[..., :3, :3] = turned
    found[..., :3, 3] = moved
    found[..., 3, 3] = 1.0
    return found


def inverse_transform(transformation: ArrayLike) -> Any:
    """Return the inverses of transformation matrices.

    Parameters
    ----------
    transformation : array_like (..., 4, 4)
        Rotation and origin of a system B in A.

    Returns
    -------
    array (..., 4, 4)
        Rotation and origin of A in B: the transposed rotation, which is exact, and -Rᵀ p.

    Raises
    ------
    RodgenError
        When it is not an array of real numbers of that shape.

    Examples
    --------
    >>> from rodgen import spatial
    >>> spatial.inverse_transform(spatial.transform(origin=[1.0, 2.0, 3.0]))[:3, 3]
    array([-1., -2., -3.])
    """
    return kernels.link_inverse(real_array("the transformation", transformation, (4, 4)))


def one_frame(what: str, given: ArrayLike | None) -> NDArray[np.float64]:
    """Return one transformation matrix (4, 4), the unit matrix for None.

    Raises
    ------
    RodgenError
        When it has another shape or is not finite.
    """
    frame = np.eye(4) if given is None else real_array(what, given, (4, 4)).copy()
    if frame.shape != (4, 4) or not np.isfinite(frame).all():
        raise RodgenError(f"{what} has the shape {frame.shape}; expected a transformation matrix (4, 4)")
    return frame


def is_pose(T: Any) -> Any:
    """Return which matrices (..., 4, 4) are finite transformation matrices with a right-handed rotation."""
    with np.errstate(all="ignore"):
        R = T[..., :3, :3]
        rough = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).sum(axis=(-2, -1))
        rough += np.abs(T[..., 3, :] - [0.0, 0.0, 0.0, 1.0]).sum(axis=-1)
        handed = (np.cross(R[..., :, 0], R[..., :, 1]) * R[..., :, 2]).sum(axis=-1)
        return (rough <= ORTHOGONAL) & (handed > 0) & np.isfinite(T[..., :3, 3]).all(axis=-1)


def rx(angle: Any) -> NDArray[np.float64]:
    """Return the matrices (..., 3, 3) of rotations about x."""
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(c), np.ones_like(c)
    return _matrix([[one, zero, zero], [zero, c, -s], [zero, s, c]])


def rz(angle: Any) -> NDArray[np.float64]:
    """Return the matrices (..., 3, 3) of rotations about z."""
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(c), np.ones_like(c)
    return _matrix([[c, -s, zero], [s, c, zero], [zero, zero, one]])


def _matrix(rows: list[list[Any]]) -> NDArray[np.float64]:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
