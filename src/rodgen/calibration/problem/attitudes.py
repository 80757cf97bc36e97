"""Attitudes in a table of measurements, in any of four notations, as rotation matrices."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem.nearest_frame import nearest_rotation
from rodgen.data.units import parse_unit
from rodgen.kinematics.rotation import matrix_from_quaternion, quaternion_from_matrix
from rodgen.machines.measured import NOTATIONS
from rodgen.machines.rigid import (
    matrix_from_roll_pitch_yaw,
    roll_pitch_yaw,
    rotation_matrix,
    rotation_vector,
)

if TYPE_CHECKING:
    from rodgen.data.measurements import Measurements

__all__ = ["ANGULAR", "UnfitAttitudeError", "attitude_columns", "attitude_numbers", "matrices", "numbers_of"]

Array: TypeAlias = NDArray[np.float64]

ANGULAR = frozenset({"rotation vector", "roll, pitch and yaw"})
"""Notations whose numbers are angles."""

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
        One of `rodgen.machines.measured.NOTATIONS`.
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
    given = (n for n, names in NOTATIONS.items() if set(names) & data.columns.keys())
    notation = next(given, "rotation vector")
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
