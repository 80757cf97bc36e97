"""Attitudes in a table of measurements as rotation matrices, and the attitude and frame nearest to readings."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.data.notations import ANGULAR, NOTATIONS
from rodgen.data.units import parse_unit
from rodgen.kinematics.rotation import matrix_from_quaternion, quaternion_from_matrix
from rodgen.machines.model import Frame
from rodgen.machines.rigid import matrix_from_roll_pitch_yaw, roll_pitch_yaw, rotation_matrix, rotation_vector
from rodgen.statistics.decompositions import svd

if TYPE_CHECKING:
    from rodgen.data.measurements import Measurements

__all__ = [
    "UnfitAttitudeError",
    "attitude_columns",
    "attitude_numbers",
    "matrices",
    "nearest_attitudes",
    "nearest_frame",
    "nearest_rotation",
    "numbers_of",
]

Array: TypeAlias = NDArray[np.float64]

TOLERANCE = 1e-3
"""Largest deviation of a quaternion's length from 1, and of RᵀR from the unit matrix: numbers rounded to three decimals
pass, numbers in the wrong columns do not."""


class UnfitAttitudeError(ValueError):
    """Numbers that are no attitude.

    Attributes
    ----------
    row : int
    found, expected : str
    """

    def __init__(self, row: int, found: str, expected: str) -> None:
        super().__init__(found)
        self.row, self.found, self.expected = row, found, expected


def matrices(notation: str, numbers: Array) -> Array:
    """Return attitudes as rotation matrices, (n, 3, 3): the axes of the body as columns, in the measuring frame.

    Parameters
    ----------
    notation : str
        One of `rodgen.data.notations.NOTATIONS`.
    numbers : ndarray, shape (n, k)
        In the order of its columns, angles in radians: a rotation vector; roll r, pitch p and yaw y of
        Rz(y) Ry(p) Rx(r), as URDF has them; a quaternion of either sign, scalar part first; or a matrix row by row.

    Raises
    ------
    UnfitAttitudeError
        For the first quaternion whose length is not 1, or matrix that is no rotation.

    Examples
    --------
    >>> matrices("quaternion", np.array([[0.0, 0.0, 0.0, -1.0]]))[0].tolist() == np.diag([-1.0, -1.0, 1.0]).tolist()
    True
    """
    if notation == "rotation vector":
        return rotation_matrix(numbers)
    if notation == "roll, pitch and yaw":
        return matrix_from_roll_pitch_yaw(numbers)
    if notation == "quaternion":
        length = np.linalg.norm(numbers, axis=1)
        if (row := _first(np.abs(length - 1) > TOLERANCE)) is not None:
            raise UnfitAttitudeError(
                row, f"a quaternion of length {length[row]:.6g}", f"a length of 1 within {TOLERANCE:g}"
            )
        return np.asarray(matrix_from_quaternion(numbers / length[:, None])[0])
    matrix = numbers.reshape(-1, 3, 3)
    off = np.abs(matrix.swapaxes(1, 2) @ matrix - np.eye(3)).max(axis=(1, 2), initial=0.0)
    if (row := _first(off > TOLERANCE)) is not None:
        expected = f"a rotation: columns of length 1 at right angles, within {TOLERANCE:g}"
        raise UnfitAttitudeError(row, f"a matrix whose columns are off that by {off[row]:.3g}", expected)
    if (row := _first(np.linalg.det(matrix) < 0)) is not None:
        raise UnfitAttitudeError(row, "a matrix that mirrors, of determinant -1", "a rotation")
    return nearest_rotation(matrix)


def _first(wrong: NDArray[np.bool_]) -> int | None:
    return int(np.argmax(wrong)) if wrong.any() else None


def attitude_columns(attitude: Array, data: Measurements, angle: str = "deg") -> dict[str, Array]:
    """Return attitudes (n, 3, 3) as columns by their names with units, in the notation that a table has.

    Parameters
    ----------
    attitude : ndarray, shape (n, 3, 3)
    data : Measurements
        Without columns of an attitude: a rotation vector.
    angle : str
        Unit of angles where the table has none.
    """
    numbers = attitude_numbers(attitude, data)
    if not any(NOTATIONS[notation] == tuple(numbers) for notation in ANGULAR):
        return numbers
    units = {name: (name in data.columns and data.columns[name].unit) or angle for name in numbers}
    return {f"{name} [{units[name]}]": x / parse_unit(units[name]).factor() for name, x in numbers.items()}


def attitude_numbers(attitude: Array, data: Measurements) -> dict[str, Array]:
    """Return attitudes (n, 3, 3) as numbers by the names of columns, in the notation that a table has, in radians."""
    present = (n for n, names in NOTATIONS.items() if set(names) & data.columns.keys())
    notation = next(present, "rotation vector")
    return dict(zip(NOTATIONS[notation], numbers_of(notation, attitude).T, strict=True))


def numbers_of(notation: str, attitude: Array) -> Array:
    """Return attitudes (n, 3, 3) as numbers of a notation, (n, k); see :func:`matrices`.

    Examples
    --------
    >>> numbers_of("matrix", np.eye(3)[None]).tolist()
    [[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]]
    """
    if notation == "rotation vector":
        return rotation_vector(attitude)
    if notation == "matrix":
        return attitude.reshape(-1, 9)
    if notation == "quaternion":
        return np.asarray(quaternion_from_matrix(attitude)[0])
    return roll_pitch_yaw(attitude)


# The measuring frame, and the attitude of a body, with which a geometry that is known meets its readings best.

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
    nearest = []
    for body in (nearest_rotation(sign * u[:, 0].reshape(3, 3)).T, np.eye(3)):
        for _ in range(_TURNS):
            frame = nearest_rotation(np.einsum("nij,nkj->ik", read, predicted @ body))
            body = nearest_rotation(np.einsum("nji,nkj,nkl->il", predicted, frame[None], read))
        nearest.append((np.sum((frame @ predicted @ body - read) ** 2), frame, body))
    return min(nearest, key=lambda one: float(one[0]))[1:]
