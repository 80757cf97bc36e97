"""Rotated vectors, and conversions between the representations of a rotation.

A rotation by the angle χ about the unit axis e is also its Rodrigues vector θ = 2 tan(χ/2) e, its matrix, or
its unit quaternion (cos χ/2, sin χ/2 e), scalar part first. Conversions return the value and a status for each
element; proofs are in the derivation ``rotations``. Every conversion is named TARGET_from_SOURCE.
An axis has unit length; otherwise the status is NOT_NORMAL. A result is NaN where the status is INVALID; an axis of a
rotation by zero is z, a quaternion has w ≥ 0.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from rodgen.generated.numpy import rotations as generated
from rodgen.generated.numpy.rotations import RotationStatus
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.ports import documented_by

__all__ = [
    "RotationStatus",
    "axis_angle_from_matrix",
    "axis_angle_from_quaternion",
    "axis_angle_from_rodrigues_vector",
    "matrix_from_axis_angle",
    "matrix_from_quaternion",
    "matrix_from_rodrigues_vector",
    "quaternion_from_axis_angle",
    "quaternion_from_matrix",
    "quaternion_from_rodrigues_vector",
    "rodrigues_vector",
    "rodrigues_vector_from_matrix",
    "rodrigues_vector_from_quaternion",
    "rotate",
]


@documented_by(generated.rotate)
def rotate(rho: ArrayLike, theta: ArrayLike, *, out: Any = None) -> Any:
    """Return vectors rotated by Rodrigues' formula.

    Parameters
    ----------
    rho
        Any unit will do.
    theta
        It may be huge (half turns), not infinite.
    out : array (..., 3), optional
        Where the result goes.

    Returns
    -------
    rotated
        ρ + θ × (ρ + θ × ρ / 2) / (1 + |θ|² / 4), in the unit of `rho`; NaN where an input is not finite.

    Examples
    --------
    >>> import rodgen
    >>> rodgen.rotate([1.0, 0.0, 0.0], [0.0, 0.0, 2.0])  # a quarter turn about z
    array([0., 1., 0.])
    """
    return call_kernel(kernels.rotate, (rho, theta), out)


@documented_by(generated.rodrigues_vector_from_axis_angle)
def rodrigues_vector(axis: ArrayLike, angle: ArrayLike) -> tuple[Any, Any]:
    """Return the Rodrigues vector θ = 2 tan(χ/2) e of an axis and an angle.

    Returns
    -------
    theta
        It is about 3e16 long for a half turn.

    Examples
    --------
    >>> import rodgen
    >>> theta, status = rodgen.rodrigues_vector([0.0, 0.0, 1.0], 1.0)
    >>> theta.round(6)
    array([0.      , 0.      , 1.092605])
    """
    return call_kernel(kernels.rodrigues_vector_from_axis_angle, (axis, angle))  # type: ignore[no-any-return]


@documented_by(generated.matrix_from_axis_angle)
def matrix_from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from axis and angle to matrix."""
    return call_kernel(kernels.matrix_from_axis_angle, (axis, angle))  # type: ignore[no-any-return]


@documented_by(generated.quaternion_from_axis_angle)
def quaternion_from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from axis and angle to quaternion."""
    return call_kernel(kernels.quaternion_from_axis_angle, (axis, angle))  # type: ignore[no-any-return]


@documented_by(generated.axis_angle_from_rodrigues_vector)
def axis_angle_from_rodrigues_vector(theta: ArrayLike) -> tuple[Any, Any, Any]:
    """Convert a rotation from Rodrigues vector to axis and angle."""
    return call_kernel(kernels.axis_angle_from_rodrigues_vector, (theta,))  # type: ignore[no-any-return]


@documented_by(generated.matrix_from_rodrigues_vector)
def matrix_from_rodrigues_vector(theta: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from Rodrigues vector to matrix."""
    return call_kernel(kernels.matrix_from_rodrigues_vector, (theta,))  # type: ignore[no-any-return]


@documented_by(generated.quaternion_from_rodrigues_vector)
def quaternion_from_rodrigues_vector(theta: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from Rodrigues vector to quaternion."""
    return call_kernel(kernels.quaternion_from_rodrigues_vector, (theta,))  # type: ignore[no-any-return]


@documented_by(generated.axis_angle_from_matrix)
def axis_angle_from_matrix(matrix: ArrayLike) -> tuple[Any, Any, Any]:
    """Convert a rotation from matrix to axis and angle."""
    return call_kernel(kernels.axis_angle_from_matrix, (matrix,))  # type: ignore[no-any-return]


@documented_by(generated.rodrigues_vector_from_matrix)
def rodrigues_vector_from_matrix(matrix: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from matrix to Rodrigues vector."""
    return call_kernel(kernels.rodrigues_vector_from_matrix, (matrix,))  # type: ignore[no-any-return]


@documented_by(generated.quaternion_from_matrix)
def quaternion_from_matrix(matrix: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from matrix to quaternion."""
    return call_kernel(kernels.quaternion_from_matrix, (matrix,))  # type: ignore[no-any-return]


@documented_by(generated.axis_angle_from_quaternion)
def axis_angle_from_quaternion(quaternion: ArrayLike) -> tuple[Any, Any, Any]:
    """Convert a rotation from quaternion to axis and angle."""
    return call_kernel(kernels.axis_angle_from_quaternion, (quaternion,))  # type: ignore[no-any-return]


@documented_by(generated.rodrigues_vector_from_quaternion)
def rodrigues_vector_from_quaternion(quaternion: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from quaternion to Rodrigues vector."""
    return call_kernel(kernels.rodrigues_vector_from_quaternion, (quaternion,))  # type: ignore[no-any-return]


@documented_by(generated.matrix_from_quaternion)
def matrix_from_quaternion(quaternion: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from quaternion to matrix."""
    return call_kernel(kernels.matrix_from_quaternion, (quaternion,))  # type: ignore[no-any-return]
