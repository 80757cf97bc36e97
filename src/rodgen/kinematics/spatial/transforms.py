"""Transformation matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.generated.numpy import spatial_links as generated
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.ports import documented_by

ORTHOGONAL = 1e-6
"""Sum of the deviations of RᵀR and of the last row up to which a matrix is a rounded pose; as in the kernels."""


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
    T = np.zeros((*shape, 4, 4))
    T[..., :3, :3] = turned
    T[..., :3, 3] = moved
    T[..., 3, 3] = 1.0
    return T


@documented_by(generated.link_inverse)
def inverse_transform(transform: ArrayLike) -> Any:
    """Return the inverses of transformation matrices.

    Parameters
    ----------
    transform
        Of a system B in A.

    Returns
    -------
    inverse
        Rotation and origin of A in B: the transposed rotation, which is exact, and -Rᵀ p.

    Examples
    --------
    >>> from rodgen import spatial
    >>> spatial.inverse_transform(spatial.transform(origin=[1.0, 2.0, 3.0]))[:3, 3]
    array([-1., -2., -3.])
    """
    return kernels.link_inverse(real_array("the transformation", transform, (4, 4)))


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
