"""``rodgen tricept direct``: from rods to poses and points."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np

from rodgen.cli._console import Command
from rodgen.cli._tables import add_table, map_rows, rows_of
from rodgen.cli.tricept._options import add_geometry, geometry_of, limits_of

__all__ = ["add_to"]

_TEXT = """\
Find, for the rods in every row of a table, the pose of the platform and its point.

The table, CSV (gzip or not) or Parquet, has the columns

  A0 [mm],A1 [mm],A-1 [mm]

in any unit of length, and may have further ones. The output gets every column of the table, then
  alpha [deg] beta [deg] z [mm]   the pose of the assembled machine
  Qx [mm] Qy [mm] Qz [mm]         its point
  status                          reachable; out_of_limits (a rod); singular; unreachable (no such pose); invalid
With --all there is a row for each real pose, numbered in the column pose, the assembled machine's first; rods with no
pose keep one row.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("direct", _run, "poses and points of rods", _TEXT)
    add_table(parser, "RODS")
    parser.add_argument("--all", action="store_true", help="all real poses, a row each")
    add_geometry(parser)


def _run(options: argparse.Namespace) -> int:
    from rodgen.data.tables import Answer, Column, Result
    from rodgen.kinematics import tricept

    columns = [Column(name, "length") for name in ("A0", "A1", "A-1")]
    results = [
        *([Result("pose", "count")] if options.all else []),
        Result("alpha", "angle"),
        Result("beta", "angle"),
        Result("z", "length"),
        *(Result(f"Q{axis}", "length") for axis in "xyz"),
        Result("status", tricept.TriceptStatus),
    ]
    Status = tricept.TriceptStatus

    def prepare(unit: str) -> tuple[Sequence[Result], Any]:
        geometry, limits = geometry_of(options, unit), limits_of(options, unit)
        low, high = limits or (0.0, np.inf)

        def function(values: Sequence[Any]) -> Answer:
            rods = np.column_stack(values)
            outside = np.asarray((rods.min(axis=1) < low) | (rods.max(axis=1) > high))
            if options.all:
                poses, count = tricept.direct_all(rods, geometry)
                index, slot, number = rows_of(count)
                pose = poses[index, slot]
                invalid = rods.min(axis=1)[index] <= 0
                status = np.where(invalid, Status.INVALID, np.where(count[index] > 0, 0, Status.UNREACHABLE))
                first = [number]
            else:
                pose, status = tricept.direct(rods, geometry)
                index, first = None, []
            rows = slice(None) if index is None else index
            status = np.where((status == Status.REACHABLE) & outside[rows], Status.OUT_OF_LIMITS, status)
            return [*first, *pose.T, *tricept.point(pose, geometry).T, status], index

        return results, function

    return map_rows(options, columns, prepare)
