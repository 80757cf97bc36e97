"""``rodgen tricept inverse | direct``: poses and rods of points, poses and points of rods."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from rodgen.cli._console import Command
from rodgen.cli._tables import Columns, add_table, map_rows, named, rows_of
from rodgen.cli.tricept._options import add_geometry, geometry_of, limits_of

_POINT = named("length", "Qx Qy Qz")
_RODS = named("length", "A0 A1 A-1")
_POSE = [*named("angle", "alpha beta"), ("z", "length")]

_INVERSE = """\
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

_DIRECT = """\
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
    """Add the commands."""
    inverse = command("inverse", _inverse, "poses and rods of points", _INVERSE)
    add_table(inverse, "POINTS")
    inverse.add_argument("--all", action="store_true", help="all four poses of each point, a row each")
    add_geometry(inverse)

    direct = command("direct", _direct, "poses and points of rods", _DIRECT)
    add_table(direct, "RODS")
    direct.add_argument("--all", action="store_true", help="all real poses, a row each")
    add_geometry(direct)


def _inverse(options: argparse.Namespace) -> int:
    from rodgen.kinematics import tricept

    signs = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    first = named("count", "S K") if options.all else []
    results = [*first, *_POSE, *_RODS, ("status", tricept.TriceptStatus)]

    def prepare(unit: str) -> tuple[Columns, Any]:
        geometry, limits = geometry_of(options, unit), limits_of(options, unit)

        def function(points: Any) -> Any:
            if not options.all:
                pose, legs, status = tricept.pose(points, geometry, limits)
                return [*pose.T, *legs.T, status], None
            poses, legs, status = tricept.inverse(points, geometry, limits)
            index = np.repeat(np.arange(len(poses)), 4)
            both = np.tile(signs, (len(poses), 1)).T
            return [*both, *poses.reshape(-1, 3).T, *legs.reshape(-1, 3).T, status.ravel()], index

        return results, function

    return map_rows(options, _POINT, prepare)


def _direct(options: argparse.Namespace) -> int:
    from rodgen.kinematics import tricept

    Status = tricept.TriceptStatus
    first = named("count", "pose") if options.all else []
    results = [*first, *_POSE, *_POINT, ("status", Status)]

    def prepare(unit: str) -> tuple[Columns, Any]:
        geometry, limits = geometry_of(options, unit), limits_of(options, unit)
        low, high = limits or (0.0, np.inf)

        def function(rods: Any) -> Any:
            outside = np.asarray((rods.min(axis=1) < low) | (rods.max(axis=1) > high))
            if options.all:
                poses, count = tricept.direct_all(rods, geometry)
                index, slot, number = rows_of(count)
                pose = poses[index, slot]
                invalid = ~(rods.min(axis=1)[index] > 0)
                status = np.where(invalid, Status.INVALID, np.where(count[index] > 0, 0, Status.UNREACHABLE))
                first = [number]
            else:
                pose, status = tricept.direct(rods, geometry)
                index, first = None, []
            rows = slice(None) if index is None else index
            status = np.where((status == Status.REACHABLE) & outside[rows], Status.OUT_OF_LIMITS, status)
            return [*first, *pose.T, *tricept.point(pose, geometry).T, status], index

        return results, function

    return map_rows(options, _RODS, prepare)
