"""Read attitudes from the rows of a table: the angles of a sequence, a quaternion or a matrix."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.cli._tables import map_rows
from rodgen.errors import UnexpectedError, shown

if TYPE_CHECKING:
    from rodgen.data.tables import Column, Result

__all__ = ["ANGLES", "ATTITUDE_TEXT", "add_form", "columns_of", "map_array", "matrices", "quaternions"]

ANGLES = ("alpha", "beta", "gamma")
QUATERNION = ("q0", "qx", "qy", "qz")
MATRIX = tuple(f"r{i}{j}" for i in "123" for j in "123")

ATTITUDE_TEXT = """\
Attitudes are, by --from,
  ZYX, ZYZ or another of the twelve sequences: alpha [deg],beta [deg],gamma [deg], the three angles in the
      order of the sequence, in any unit of angle. Capitals are intrinsic, about turned axes; small letters extrinsic.
  quaternion: q0,qx,qy,qz, of unit length, scalar part first
  matrix: r11,r12,r13,r21,...,r33; its columns are the moved axes
"""


def _form(text: str) -> str:
    from rodgen.kinematics.instantaneous_euler.sequences import sequence_of

    if text not in ("quaternion", "matrix"):
        try:
            sequence_of(text)
        except UnexpectedError:
            raise argparse.ArgumentTypeError(
                f"{shown(text)} is none of quaternion, matrix and the twelve sequences, such as ZYX"
            ) from None
    return text


def add_form(parser: argparse.ArgumentParser, usual: str = "ZYX") -> None:
    """Add ``--from``, the form in which the table has attitudes, with its default."""
    parser.add_argument(
        "--from",
        dest="form",
        metavar="SEQUENCE|quaternion|matrix",
        type=_form,
        default=usual,
        help=f"how the table writes attitudes; default: {usual}",
    )


def columns_of(form: str) -> list[Column]:
    """Return the columns of an attitude."""
    from rodgen.data.tables import Column

    if form == "quaternion":
        return [Column(name, "number") for name in QUATERNION]
    if form == "matrix":
        return [Column(name, "number") for name in MATRIX]
    return [Column(name, "angle") for name in ANGLES]


def quaternions(form: str, values: Any) -> tuple[Any, Any]:
    """Return the unit quaternions of attitudes, and which of the attitudes were only nearly rotations."""
    from rodgen import quaternion_from_matrix
    from rodgen.kinematics import instantaneous_euler as ie

    if form == "quaternion":
        return values, _abnormal(ie.angles_from_quaternion(values)[1])
    made, abnormal = matrices(form, values)
    return quaternion_from_matrix(made)[0], abnormal


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


def map_array(
    options: argparse.Namespace,
    columns: Sequence[Column],
    results: Sequence[Result],
    function: Callable[[Any], Any],
    *,
    whole: bool = False,
) -> int:
    """Add results to a table by a function of the values as one array, with a column for each of `columns`."""
    return map_rows(
        options,
        columns,
        lambda unit: (results, lambda values: function(np.column_stack(values))),
        whole=whole,
    )
