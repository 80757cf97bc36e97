"""The twelve sequences of rotations about coordinate axes, reduced to two.

A sequence in capitals, such as ``"ZYX"``, is intrinsic: each rotation is about an axis of the frame that the ones
before have turned. In small letters, ``"xyz"``, it is extrinsic, about fixed axes, and is the intrinsic one read
backwards with the angles backwards. (So SciPy writes them, too.)

With other names of the axes, a permutation P, each intrinsic sequence is Z-Y-X or Z-Y-Z; where P is a reflection all
angles change their signs. That is the entry ``twelve-from-two`` of the derivation ``instantaneous_euler``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import UnexpectedError, shown
from rodgen.kinematics.arrays import refuse_masked

SEQUENCES = ("XYX", "XYZ", "XZX", "XZY", "YXY", "YXZ", "YZX", "YZY", "ZXY", "ZXZ", "ZYX", "ZYZ")
"""The twelve intrinsic sequences; in small letters they are extrinsic."""


class Sequence(NamedTuple):
    """A sequence as its base sequence, Z-Y-X or Z-Y-Z, with renamed axes."""

    like: str
    """The base sequence, ``"zyx"`` or ``"zyz"``."""
    sign: int
    """Of the angles of the base sequence, -1 where the renaming is a reflection."""
    axes: tuple[int, int, int]
    """Names here of x, y and z of the base sequence: 0, 1, 2 for x, y, z."""
    backwards: bool
    """Whether the angles come backwards, as extrinsic ones do."""

    def angles(self, angles: ArrayLike) -> NDArray[Any]:
        """Return the angles, or rates, of the base sequence from those of this one; the inverse is the same."""
        refuse_masked("angles", angles)
        array = np.asarray(angles)
        if array.dtype.kind == "c":
            raise TypeError("angles are real numbers")
        if array.ndim == 0 or array.shape[-1] != 3:
            raise ValueError(f"angles have the shape {array.shape}; expected a last axis of 3")
        array = array[..., ::-1] if self.backwards else array
        return array if self.sign > 0 else -array

    def vector(self, vector: NDArray[Any]) -> NDArray[Any]:
        """Return the components of a vector along x, y, z from those along the axes of the base sequence."""
        permuted = np.empty_like(vector)
        permuted[..., self.axes] = vector
        return permuted

    def matrix(self, matrix: NDArray[Any]) -> NDArray[Any]:
        """Return the rotation matrix in x, y, z from the one in the axes of the base sequence."""
        permuted = np.empty_like(matrix)
        rows, columns = np.ix_(self.axes, self.axes)
        permuted[..., rows, columns] = matrix
        return permuted

    def quaternion(self, quaternion: NDArray[Any]) -> NDArray[Any]:
        """Return the unit quaternion in the axes of the base sequence from the one in x, y, z."""
        part = self.sign * quaternion[..., 1:][..., list(self.axes)]
        return np.concatenate([quaternion[..., :1], part], axis=-1)


def sequence_of(name: str) -> Sequence:
    """Return the sequence of a name.

    Raises
    ------
    UnexpectedError
        When it is not one of the twelve, in capitals or in small letters.
    """
    intrinsic = name if isinstance(name, str) and name.isupper() else str(name)[::-1].upper()
    if intrinsic not in SEQUENCES or not (name.isupper() or name.islower()):
        expected = (
            f"one of {', '.join(SEQUENCES)}, in capitals for intrinsic and in small letters for extrinsic"
        )
        raise UnexpectedError(f"the sequence {shown(name)}", expected)
    first, second, third = ("XYZ".index(axis) for axis in intrinsic)
    rest = 3 - first - second
    even = (rest, second, first) in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    return Sequence(
        "zyx" if third == rest else "zyz", 1 if even else -1, (rest, second, first), name.islower()
    )
