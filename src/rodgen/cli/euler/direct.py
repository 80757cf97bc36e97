"""``rodgen euler direct``: attitudes of a 3-SPS-S machine from its legs."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from rodgen.cli._console import Command
from rodgen.cli._tables import add_table, map_rows, rows_of
from rodgen.cli._values import quantity
from rodgen.cli.euler._three_sps_s import MACHINE_TEXT, add_machine, machine_of
from rodgen.errors import InputFileError

__all__ = ["add_to"]

_TEXT = f"""\
Find the attitude of a 3-SPS-S machine for the legs in every row of a table.

The table, CSV (gzip or not) or Parquet, has the columns

  L1 [mm],L2 [mm],L3 [mm]

in any unit of length, and may have further ones. {MACHINE_TEXT}
Up to eight attitudes have the same legs. The output has the one nearest to --near; with --follow the one nearest to
that of the row before; with --all every one, a row each, the smallest rotation first. It gets every column of the
table, then
  q0 qx qy qz               the attitude, a quaternion, scalar part first
  chi_x chi_y chi_z [deg]   its instantaneous Euler angles
  status                    converged; singular (two attitudes meet there); no_assembly (no attitude has these legs);
                            ambiguous (two are equally near: from the start, which is singular, they often are);
                            incomplete (one was not found); invalid
and with --all, first, mode: the number of the attitude, 0 where there is none.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("direct", _run, "attitudes of a 3-SPS-S machine from its legs", _TEXT)
    add_table(parser, "LEGS")
    parser.add_argument("--all", action="store_true", help="every attitude, a row each")
    parser.add_argument(
        "--near",
        metavar="X,Y,Z",
        type=quantity("--near", "0,0,30deg", 3, "angle"),
        help="rotation vector (axis times angle) with its unit, such as 0,0,30deg; default: the start in the machine "
        "file, else no rotation",
    )
    parser.add_argument(
        "--follow", action="store_true", help="the rows are a motion, which begins near --near"
    )
    add_machine(parser)


def _run(options: argparse.Namespace) -> int:
    from rodgen import matrix_from_axis_angle, quaternion_from_matrix
    from rodgen.data.tables import Column, Result
    from rodgen.kinematics import instantaneous_euler, three_sps_s

    if options.all and (options.follow or options.near is not None):
        raise InputFileError("command line", "--all", "together with --near or --follow", "one of the two")
    results = [
        *([Result("mode", "count")] if options.all else []),
        *(Result(name, "number") for name in ("q0", "qx", "qy", "qz")),
        *(Result(f"chi_{axis}", "angle") for axis in "xyz"),
        Result("status", three_sps_s.DirectStatus),
    ]

    def prepare(unit: str) -> Any:
        geometry, _ = machine_of(options, unit)
        near = np.zeros(3)
        if options.near is not None or options.start is not None:
            near = np.array(options.start if options.near is None else options.near.to("rad"))
        angle = float(np.linalg.norm(near))
        start = matrix_from_axis_angle(near / angle if angle else [0.0, 0.0, 1.0], angle)[0]

        def function(values: Any) -> Any:
            legs = np.column_stack(values)
            index, first = None, []
            if options.all:
                rotations, count, status = three_sps_s.direct_all(legs, geometry)
                index, slot, number = rows_of(count)
                first = [number]
                rotation, status = rotations[index, slot], status[index]
            elif options.follow:
                rotation, status = three_sps_s.follow(legs, geometry, start=start)
            else:
                rotation, status = three_sps_s.direct(legs, geometry, near=start)
            quaternion = quaternion_from_matrix(rotation)[0]
            chi = instantaneous_euler.angles_from_matrix(rotation)[0]
            return [*first, *quaternion.T, *chi.T, status], index

        return results, function

    columns = [Column(f"L{n}", "length") for n in (1, 2, 3)]
    return map_rows(options, columns, prepare, whole=options.follow)
