"""Rotated vectors, and conversions between the representations of a rotation.

A rotation by the angle χ about the unit axis e is also its Rodrigues vector θ = 2 tan(χ/2) e, its matrix, or
its unit quaternion (cos χ/2, sin χ/2 e), scalar part first. Conversions return the value and a status for each
element; proofs are in the derivation ``rotations``. Every conversion is named TARGET_from_SOURCE; its docstring gets
the shapes and units of both from the tables below.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from numpy.typing import ArrayLike

from rodgen.generated.numpy.rotations import RotationStatus
from rodgen.kinematics.backend import call_kernel, kernels

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


_Conversion = TypeVar("_Conversion", bound=Callable[..., Any])

_SOURCES = {
    "axis": "axis : array_like (..., 3)\n    Axis e, of unit length; otherwise the status is NOT_NORMAL.",
    "angle": "angle : array_like (...)\n    Angle χ in rad.",
    "theta": "theta : array_like (..., 3)\n    Rodrigues vector 2 tan(χ/2) e.",
    "matrix": "matrix : array_like (..., 3, 3)\n    Rotation matrix.",
    "quaternion": "quaternion : array_like (..., 4)\n    Unit quaternion, scalar part first.",
}
_TARGETS = {
    "axis_angle": "axis : array (..., 3)\n    Unit axis; z for a rotation by zero.\n"
    "angle : array (...)\n    Angle in rad, 0 to π.",
    "rodrigues_vector": "theta : array (..., 3)\n    Rodrigues vector 2 tan(χ/2) e.",
    "matrix": "matrix : array (..., 3, 3)\n    Rotation matrix.",
    "quaternion": "quaternion : array (..., 4)\n    Unit quaternion, scalar part first; w ≥ 0.",
}
_STATUS = "status : array (...) of int8\n    Codes of :class:`RotationStatus`; the result is NaN where it is INVALID."


def _described(function: _Conversion) -> _Conversion:
    """Add the shapes and units of the parameters and results to the docstring of a conversion."""
    target = function.__name__.partition("_from_")[0]
    given = [_SOURCES[name] for name in inspect.signature(function).parameters]
    sections = ["Parameters\n----------", *given, "\nReturns\n-------", _TARGETS[target], _STATUS]
    function.__doc__ = f"{function.__doc__}\n\n" + "\n".join(sections)
    return function


def rotate(rho: ArrayLike, theta: ArrayLike, *, out: Any = None) -> Any:
    """Return vectors rotated by Rodrigues' formula.

    Parameters
    ----------
    rho : array_like (..., 3)
        Vectors, in any unit.
    theta : array_like (..., 3)
        Rodrigues vectors, 2 tan(χ/2) times the unit axis. They may be huge (half turns), not infinite.
    out : array (..., 3), optional
        Where the result goes.

    Returns
    -------
    array (..., 3)
        ρ + θ × (ρ + θ × ρ / 2) / (1 + |θ|² / 4), in the unit of `rho`; NaN where an input is not finite.

    Notes
    -----
    Stebulyanin and Pimushkin, eq. (1); proved in the derivation ``rotations``.

    Examples
    --------
    >>> import rodgen
    >>> rodgen.rotate([1.0, 0.0, 0.0], [0.0, 0.0, 2.0])  # a quarter turn about z
    array([0., 1., 0.])
    """
    return call_kernel(kernels.rotate, (rho, theta), out)


def rodrigues_vector(axis: ArrayLike, angle: ArrayLike) -> tuple[Any, Any]:
    """Return the Rodrigues vector θ = 2 tan(χ/2) e of an axis and an angle.

    Parameters
    ----------
    axis : array_like (..., 3)
        Axis e, of unit length; otherwise the status is NOT_NORMAL.
    angle : array_like (...)
        Angle χ in rad.

    Returns
    -------
    theta : array (..., 3)
        Rodrigues vector, no unit; about 3e16 long for a half turn.
    status : array (...) of int8
        Codes of :class:`RotationStatus`.

    Examples
    --------
    >>> import rodgen
    >>> theta, status = rodgen.rodrigues_vector([0.0, 0.0, 1.0], 1.0)
    >>> theta.round(6)
    array([0.      , 0.      , 1.092605])
    """
    return call_kernel(kernels.rodrigues_vector_from_axis_angle, (axis, angle))  # type: ignore[no-any-return]


@_described
def matrix_from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from axis and angle to matrix."""
    return call_kernel(kernels.matrix_from_axis_angle, (axis, angle))  # type: ignore[no-any-return]


@_described
def quaternion_from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from axis and angle to quaternion."""
    return call_kernel(kernels.quaternion_from_axis_angle, (axis, angle))  # type: ignore[no-any-return]


@_described
def axis_angle_from_rodrigues_vector(theta: ArrayLike) -> tuple[Any, Any, Any]:
    """Convert a rotation from Rodrigues vector to axis and angle."""
    return call_kernel(kernels.axis_angle_from_rodrigues_vector, (theta,))  # type: ignore[no-any-return]


@_described
def matrix_from_rodrigues_vector(theta: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from Rodrigues vector to matrix."""
    return call_kernel(kernels.matrix_from_rodrigues_vector, (theta,))  # type: ignore[no-any-return]


@_described
def quaternion_from_rodrigues_vector(theta: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from Rodrigues vector to quaternion."""
    return call_kernel(kernels.quaternion_from_rodrigues_vector, (theta,))  # type: ignore[no-any-return]


@_described
def axis_angle_from_matrix(matrix: ArrayLike) -> tuple[Any, Any, Any]:
    """Convert a rotation from matrix to axis and angle."""
    return call_kernel(kernels.axis_angle_from_matrix, (matrix,))  # type: ignore[no-any-return]


@_described
def rodrigues_vector_from_matrix(matrix: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from matrix to Rodrigues vector."""
    return call_kernel(kernels.rodrigues_vector_from_matrix, (matrix,))  # type: ignore[no-any-return]


@_described
def quaternion_from_matrix(matrix: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from matrix to quaternion."""
    return call_kernel(kernels.quaternion_from_matrix, (matrix,))  # type: ignore[no-any-return]


@_described
def axis_angle_from_quaternion(quaternion: ArrayLike) -> tuple[Any, Any, Any]:
    """Convert a rotation from quaternion to axis and angle."""
    return call_kernel(kernels.axis_angle_from_quaternion, (quaternion,))  # type: ignore[no-any-return]


@_described
def rodrigues_vector_from_quaternion(quaternion: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from quaternion to Rodrigues vector."""
    return call_kernel(kernels.rodrigues_vector_from_quaternion, (quaternion,))  # type: ignore[no-any-return]


@_described
def matrix_from_quaternion(quaternion: ArrayLike) -> tuple[Any, Any]:
    """Convert a rotation from quaternion to matrix."""
    return call_kernel(kernels.matrix_from_quaternion, (quaternion,))  # type: ignore[no-any-return]
