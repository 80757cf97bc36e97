"""``rodgen euler ridge``: ridge lines of attitudes."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from rodgen.cli._attitude import ATTITUDE_TEXT, add_form, columns_of, map_array, matrices
from rodgen.cli._console import Command
from rodgen.cli._tables import add_table

__all__ = ["add_to"]

_TEXT = f"""\
Find the lines in which the yz, xz and xy planes meet their images, for every row of a table.

The table is CSV (gzip or not) or Parquet, and may have further columns. {ATTITUDE_TEXT}
With --point it also has where the origin has moved, x [mm],y [mm],z [mm]; without it stays.
The output gets every column of the table, then for each of Xr, Yr, Zr
  Xr_x Xr_y Xr_z                 its direction; the rotation by chi about it brings the plane to its image
  Xr_mx Xr_my Xr_mz [mm]         its moment about the fixed origin, with --point
  status_x                       line; planes_coincide (the angle is 0 or 180 deg); planes_parallel; not_normal; invalid
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("ridge", _run, "ridge lines of attitudes", _TEXT)
    add_table(parser, "ATTITUDES")
    add_form(parser)
    parser.add_argument("--point", action="store_true", dest="moved", help="the origin moves, too")


def _run(options: argparse.Namespace) -> int:
    from rodgen.data.tables import Column, Result
    from rodgen.kinematics import instantaneous_euler as ie

    columns = columns_of(options.form)
    n = len(columns)
    if options.moved:
        columns += [Column(axis, "length") for axis in "xyz"]
    results = []
    for axis in "xyz":
        results += [Result(f"{axis.upper()}r_{along}", "number") for along in "xyz"]
        if options.moved:
            results += [Result(f"{axis.upper()}r_m{along}", "length") for along in "xyz"]
        results.append(Result(f"status_{axis}", ie.RidgeStatus))

    def function(values: Any) -> Any:
        points = values[:, n:] if options.moved else np.zeros(3)
        attitudes, abnormal = matrices(options.form, values[:, :n])
        lines, status = ie.ridge_lines(attitudes, points)
        line = status == ie.RidgeStatus.LINE
        status = np.where(abnormal[:, None] & line, ie.RidgeStatus.NOT_NORMAL, status)
        made = []
        for i in range(3):
            made += [*lines[:, i, : 6 if options.moved else 3].T, status[:, i]]
        return made, None

    return map_array(options, columns, results, function)
