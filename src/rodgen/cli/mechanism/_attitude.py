"""Read attitudes from the rows of a table: the angles of a sequence, a quaternion or a matrix."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from rodgen.cli._tables import Columns, named
from rodgen.errors import UnexpectedError, shown

QUATERNION = named("number", "q0 qx qy qz")
"""The columns of an attitude as a quaternion."""

ATTITUDE_TEXT = """\
Attitudes are, by --from,
  ZYX, ZYZ or another of the twelve sequences: alpha [deg],beta [deg],gamma [deg], the three angles in the
      order of the sequence, in any unit of angle. Capitals are intrinsic, about turned axes; small letters extrinsic.
  quaternion: q0,qx,qy,qz, of unit length, scalar part first
  matrix: r11,r12,r13,r21,...,r33; its columns are the moved axes
"""


def form(text: str) -> str:
    """Read the form in which a table has attitudes."""
    from rodgen.kinematics.instantaneous_euler.sequences import sequence_of

    if text not in ("quaternion", "matrix"):
        try:
            sequence_of(text)
        except UnexpectedError:
            raise argparse.ArgumentTypeError(
                f"{shown(text)} is none of quaternion, matrix and the twelve sequences, such as ZYX"
            ) from None
    return text


def columns_of(form: str) -> Columns:
    """Return the columns of an attitude."""
    if form == "quaternion":
        return QUATERNION
    if form == "matrix":
        return named("number", "r11 r12 r13 r21 r22 r23 r31 r32 r33")
    return named("angle", "alpha beta gamma")


def matrices(form: str, values: Any) -> tuple[Any, Any]:
    """Return the rotation matrices of attitudes, and which of the attitudes were only nearly rotations."""
    from rodgen import matrix_from_quaternion
    from rodgen.kinematics import instantaneous_euler as ie

    if form == "matrix":
        made = values.reshape(-1, 3, 3)
        return made, _abnormal(ie.angles_from_matrix(made)[1])
    if form == "quaternion":
        made, _ = matrix_from_quaternion(values)
        return made, _abnormal(ie.angles_from_quaternion(values)[1])
    return ie.motion_from_euler(values, np.zeros_like(values), form)[0], np.zeros(len(values), bool)


def _abnormal(status: Any) -> Any:
    from rodgen.kinematics.instantaneous_euler import AngleStatus

    return status == AngleStatus.NOT_NORMAL
