"""``rodgen tricept inverse``: from points to poses and rods."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np

from rodgen.cli._console import Command
from rodgen.cli._tables import add_table, map_rows
from rodgen.cli.tricept._options import add_geometry, geometry_of, limits_of

__all__ = ["add_to"]

_TEXT = """\
Find, for every point of a table, the pose of the platform and the lengths of the rods.

The table, CSV (gzip or not) or Parquet, has the columns

  Qx [mm],Qy [mm],Qz [mm]

in any unit of length, and may have further ones. The output gets every column of the table, then
  alpha [deg] beta [deg] z [mm]   the pose of the assembled machine
  A0 [mm] A1 [mm] A-1 [mm]        its rods
  status                          reachable; out_of_limits; double_pose (two poses meet); gimbal_lock (an angle is not
                                  determined, 0 stands for it); unreachable; invalid
With --all there are four rows for each point, with the signs S and K of the two roots; the first is the assembled
machine's for points before the base.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("inverse", _run, "poses and rods of points", _TEXT)
    add_table(parser, "POINTS")
    parser.add_argument("--all", action="store_true", help="all four poses of each point, a row each")
    add_geometry(parser)


def _run(options: argparse.Namespace) -> int:
    from rodgen.data.tables import Answer, Column, Result
    from rodgen.kinematics import tricept

    columns = [Column(f"Q{axis}", "length") for axis in "xyz"]
    signs = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    results = [
        *([Result("S", "count"), Result("K", "count")] if options.all else []),
        Result("alpha", "angle"),
        Result("beta", "angle"),
        Result("z", "length"),
        *(Result(name, "length") for name in ("A0", "A1", "A-1")),
        Result("status", tricept.TriceptStatus),
    ]

    def prepare(unit: str) -> tuple[Sequence[Result], Any]:
        geometry, limits = geometry_of(options, unit), limits_of(options, unit)

        def function(values: Sequence[Any]) -> Answer:
            points = np.column_stack(values)
            if not options.all:
                pose, legs, status = tricept.pose(points, geometry, limits)
                return [*pose.T, *legs.T, status], None
            poses, legs, status = tricept.inverse(points, geometry, limits)
            index = np.repeat(np.arange(len(poses)), 4)
            both = np.tile(signs, (len(poses), 1)).T
            return [*both, *poses.reshape(-1, 3).T, *legs.reshape(-1, 3).T, status.ravel()], index

        return results, function

    return map_rows(options, columns, prepare)
