"""``rodgen euler rotations``: all rotations with given instantaneous Euler angles."""

from __future__ import annotations

import argparse
from typing import Any

from rodgen.cli._attitude import map_array
from rodgen.cli._console import Command
from rodgen.cli._tables import add_table, rows_of
from rodgen.cli._values import number
from rodgen.errors import shown

__all__ = ["add_to"]

_TEXT = """\
Find all rotations with the instantaneous Euler angles in every row of a table, or the one with given ridge lines.

The table, CSV (gzip or not) or Parquet, has the columns

  chi_x [deg],chi_y [deg],chi_z [deg]

in any unit of angle, 0 to 180 deg, and may have further ones. The output has a row for each rotation with every column
of the table, then
  rotation                        its number, from 1; 0 where there is none
  q0 qx qy qz                     its unit quaternion
  status                          eight, four, two, one: so many there are; infeasible: there is none; invalid
  distance                        of the cosines from those of the nearest triple that there is
  nearest_x nearest_y nearest_z   that triple
With --ridge x, y or z (also several, as in --ridge xz) the table has the directions of these ridge lines, such as
Zr_x,Zr_y,Zr_z, of any length, and the output one row for each of its own: q0 qx qy qz, then
  misfit                          largest angle between a given ridge line and the rotation's
  left                            rotations that fit as well
  status                          chosen; ambiguous; infeasible; invalid
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("rotations", _run, "all rotations with given instantaneous Euler angles", _TEXT)
    add_table(parser, "ANGLES")
    parser.add_argument(
        "--tolerance",
        metavar="RATIO",
        type=number("a ratio: a number from 0 up, such as 1e-6", lambda x: x >= 0),
        default=0.0,
        help="squared component of the quaternion, relative to the rotation's size, that is taken for 0 (default: 16 "
        "times the machine epsilon; for measured angles some three times their uncertainty over the largest)",
    )
    parser.add_argument("--ridge", metavar="AXES", type=_axes, help="choose by the ridge lines of these axes")
    parser.add_argument("--unoriented", action="store_true", help="the ridge lines have no sense")


def _axes(text: str) -> str:
    if text and set(text) <= set("xyz") and len(set(text)) == len(text):
        return text
    raise argparse.ArgumentTypeError(f"{shown(text)} names no axes: x, y, z, or several of them, such as xz")


def _run(options: argparse.Namespace) -> int:
    from rodgen.data.tables import Column, Result
    from rodgen.kinematics import instantaneous_euler as ie

    columns = [Column(f"chi_{axis}", "angle") for axis in "xyz"]
    quaternion = [Result(name, "number") for name in ("q0", "qx", "qy", "qz")]
    if options.ridge:
        return _choose(options, columns, quaternion)
    results = [
        Result("rotation", "count"),
        *quaternion,
        Result("status", ie.RotationsStatus),
        Result("distance", "number"),
        *(Result(f"nearest_{axis}", "angle") for axis in "xyz"),
    ]

    def function(values: Any) -> Any:
        found = ie.rotations(values, tolerance=options.tolerance)
        index, slot, numbers = rows_of(found.count)
        return [
            numbers,
            *found.quaternions[index, slot].T,
            found.status[index],
            found.distance[index],
            *found.nearest[index].T,
        ], index

    return map_array(options, columns, results, function)


def _choose(options: argparse.Namespace, columns: Any, quaternion: Any) -> int:
    from rodgen.data.tables import Column, Result
    from rodgen.kinematics import instantaneous_euler as ie

    for axis in options.ridge:
        columns += [Column(f"{axis.upper()}r_{along}", "number") for along in "xyz"]
    results = [
        *quaternion,
        Result("misfit", "angle"),
        Result("left", "count"),
        Result("status", ie.ChoiceStatus),
    ]

    def function(values: Any) -> Any:
        given = {axis: values[:, 3 + 3 * n : 6 + 3 * n] for n, axis in enumerate(options.ridge)}
        choice = ie.choose(
            values[:, :3], **given, oriented=not options.unoriented, tolerance=options.tolerance
        )
        return [*choice.quaternion.T, choice.misfit, choice.left, choice.status], None

    return map_array(options, columns, results, function)
