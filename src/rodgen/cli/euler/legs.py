"""``rodgen euler legs``: legs of a 3-SPS-S machine from attitudes."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from rodgen.cli._attitude import ATTITUDE_TEXT, add_form, columns_of, map_array, matrices
from rodgen.cli._console import Command
from rodgen.cli._tables import add_table
from rodgen.cli.euler._three_sps_s import MACHINE_TEXT, add_limits, add_machine, limits_of, machine_of

__all__ = ["add_to"]

_TEXT = f"""\
Find the lengths of the three legs of a 3-SPS-S machine for the attitude in every row of a table.

The table is CSV (gzip or not) or Parquet, and may have further columns. {ATTITUDE_TEXT}
{MACHINE_TEXT}
The output gets every column of the table, then
  L1 L2 L3       lengths of the legs, in the unit of --R
  determinant    of the legs' moments, normed to lie between -1 and 1: 0 where the legs do not hold the platform, and
                 of another sign in another region; the attitude at the start is singular
  status         allowed; too_short, too_long (a leg, by --limits); near_singular; not_normal (allowed, and made a
                 rotation); invalid
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("legs", _run, "legs of a 3-SPS-S machine from attitudes", _TEXT)
    add_table(parser, "ATTITUDES")
    add_form(parser)
    add_machine(parser)
    add_limits(parser)


def _run(options: argparse.Namespace) -> int:
    from rodgen.data.tables import Result
    from rodgen.kinematics import three_sps_s

    Status = three_sps_s.OrientationStatus
    geometry, unit = machine_of(options)
    limits = limits_of(options, unit)
    results = [
        *(Result(f"L{n} [{unit}]", "number") for n in (1, 2, 3)),
        Result("determinant", "number"),
        Result("status", Status),
    ]

    def function(values: Any) -> Any:
        rotation, abnormal = matrices(options.form, values)
        status, determinant = three_sps_s.orientation_status(rotation, geometry, limits)
        status = np.where(abnormal & (status == Status.ALLOWED), Status.NOT_NORMAL, status)
        # the legs, too, are those of the nearest rotation
        rotation = np.where(abnormal[:, None, None], _made_normal(rotation), rotation)
        legs = np.where((status == Status.INVALID)[:, None], np.nan, three_sps_s.legs(rotation, geometry))
        return [*legs.T, np.where(status == Status.INVALID, np.nan, determinant), status], None

    return map_array(options, columns_of(options.form), results, function)


def _made_normal(matrices: Any) -> Any:
    """Return the rotations nearest matrices that are almost rotations."""
    from rodgen import matrix_from_quaternion, quaternion_from_matrix

    return matrix_from_quaternion(quaternion_from_matrix(matrices)[0])[0]
