"""``rodgen euler trajectory``: instantaneous and conventional Euler angles along a motion."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from rodgen.cli._attitude import ATTITUDE_TEXT, add_form, columns_of, map_array, quaternions
from rodgen.cli._console import Command
from rodgen.cli._tables import add_table

__all__ = ["add_to"]

_TEXT = f"""\
Put instantaneous and conventional Euler angles side by side along a motion, whose attitudes are the rows of a table.

The table is CSV (gzip or not) or Parquet, and may have further columns. {ATTITUDE_TEXT}
The output gets every column of the table, then
  chi_x chi_y chi_z                  the instantaneous Euler angles
  signed_x signed_y signed_z         the same, continuous: followed by their ridge lines through 0 and 180 deg
  path_x path_y path_z               smooth; turned (passed 0 or 180 deg since the row before); no_ridge; coarse (the
                                     rows are too far apart to decide); invalid
  ZYX_1 ZYX_2 ZYX_3, ZYZ_1 ...       angles of each sequence of --to, continuous
  ZYX_status, ZYZ_status             regular; singular (gimbal lock; the third angle is held); not_normal; invalid
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("trajectory", _run, "instantaneous and conventional angles along a motion", _TEXT)
    add_table(parser, "MOTION")
    add_form(parser)
    parser.add_argument(
        "--to",
        metavar="SEQUENCE,...",
        type=_sequences,
        default=("ZYX", "ZYZ"),
        help="conventional sequences; default: ZYX,ZYZ",
    )


def _sequences(text: str) -> tuple[str, ...]:
    from rodgen.errors import UnexpectedError
    from rodgen.kinematics.instantaneous_euler.sequences import sequence_of

    names = tuple(text.split(","))
    for name in names:
        try:
            sequence_of(name)
        except UnexpectedError as error:
            raise argparse.ArgumentTypeError(str(error)) from None
    if len(set(names)) < len(names):
        raise argparse.ArgumentTypeError(f"{text}: a sequence twice")
    return names


def _run(options: argparse.Namespace) -> int:
    from rodgen.data.tables import Result
    from rodgen.kinematics import instantaneous_euler as ie

    results = [
        *(Result(f"chi_{axis}", "angle") for axis in "xyz"),
        *(Result(f"signed_{axis}", "angle") for axis in "xyz"),
        *(Result(f"path_{axis}", ie.PathStatus) for axis in "xyz"),
    ]
    for name in options.to:
        results += [Result(f"{name}_{n}", "angle") for n in (1, 2, 3)]
        results.append(Result(f"{name}_status", ie.MotionStatus))

    def function(values: Any) -> Any:
        attitudes, abnormal = quaternions(options.form, values)
        found = ie.trajectory(attitudes, options.to)
        made = [*found.chi.T, *found.signed.T, *found.status.T]
        for name in options.to:
            status = found.euler_status[name]
            status = np.where(
                abnormal & (status == ie.MotionStatus.REGULAR), ie.MotionStatus.NOT_NORMAL, status
            )
            made += [*found.continuous[name].T, status]
        return made, None

    return map_array(options, columns_of(options.form), results, function, whole=True)
