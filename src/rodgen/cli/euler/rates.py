"""``rodgen euler rates``: rates of instantaneous Euler angles."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from rodgen.cli._attitude import ANGLES, ATTITUDE_TEXT, add_form, columns_of, map_array, matrices
from rodgen.cli._console import Command
from rodgen.cli._tables import add_table

__all__ = ["add_to"]

_TEXT = f"""\
Find how fast the instantaneous Euler angles of a turning body change, in every row of a table.

The table is CSV (gzip or not) or Parquet, and may have further columns. {ATTITUDE_TEXT}
Each row also has the angular velocity in fixed axes,
  omega_x [deg/s],omega_y [deg/s],omega_z [deg/s]
or, with --euler-rates, the rates of the sequence's angles,
  alpha_rate [deg/s],beta_rate [deg/s],gamma_rate [deg/s]
The output gets every column of the table, then
  chi_x_rate chi_y_rate chi_z_rate [deg/s]   the rates, in the unit of the first rate
  determinant                                16 q0 qx qy qz; 0 where they do not determine the angular velocity
  status                                     regular; near_singular; singular (undetermined);
                                             kink (an angle is 0 or 180 deg: the rate is that towards later times);
                                             not_normal; invalid
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("rates", _run, "rates of instantaneous Euler angles", _TEXT)
    add_table(parser, "MOTIONS")
    add_form(parser)
    parser.add_argument(
        "--euler-rates", action="store_true", help="the table has the rates of the sequence's angles"
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.data.tables import Column, Result
    from rodgen.errors import InputFileError
    from rodgen.kinematics import instantaneous_euler as ie

    if options.euler_rates and options.form in ("quaternion", "matrix"):
        found = f"--from {options.form}"
        raise InputFileError("command line", "--euler-rates", found, "a sequence, such as --from ZYX")
    columns = columns_of(options.form)
    n = len(columns)
    names = [f"{name}_rate" for name in ANGLES] if options.euler_rates else [f"omega_{a}" for a in "xyz"]
    columns += [Column(name, "rate") for name in names]
    results = [
        *(Result(f"chi_{axis}_rate", "rate") for axis in "xyz"),
        Result("determinant", "number"),
        Result("status", ie.MotionStatus),
    ]

    def function(values: Any) -> Any:
        if options.euler_rates:
            found = ie.rates_from_euler(values[:, :3], values[:, 3:], options.form)
            return [*found.rate.T, found.determinant, found.status], None
        made, abnormal = matrices(options.form, values[:, :n])
        found = ie.rates(made, values[:, n:])
        right = np.isin(found.status, (ie.MotionStatus.REGULAR, ie.MotionStatus.NEAR_SINGULAR))
        status = np.where(abnormal & right, ie.MotionStatus.NOT_NORMAL, found.status)
        return [*found.rate.T, found.determinant, status], None

    return map_array(options, columns, results, function)
