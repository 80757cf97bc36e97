"""``rodgen mechanism forward``: from joint coordinates to poses."""

from __future__ import annotations

import argparse
from typing import Any

from rodgen.cli._console import Command, located
from rodgen.cli._tables import OUTPUT, map_rows, table
from rodgen.cli.mechanism._attitude import QUATERNION
from rodgen.cli.mechanism._mechanism import (
    MECHANISM,
    MECHANISM_TEXT,
    TOOL,
    chain_of,
    column_name,
    place,
    quantity_of,
    tool_of,
)

_TEXT = f"""\
Find the pose of the last link of a robot for the joint coordinates in every row of a table.

{MECHANISM_TEXT}

The table, CSV (gzip or not) or Parquet, has a column for each joint, under its name and with any unit, such as

  R1 [deg],R2 [deg],P3 [mm]

and for a joint C two, such as C3.theta [deg],C3.S [mm]. It may have further ones. The output gets every column of the
table, then
  x y z          of the point --tool, in the unit of the first length column, else in that of the mechanism
  q0 qx qy qz    the attitude of the last link, a quaternion, scalar part first
both in the fixed frame: origin at the meeting of S1 and a12 (at S1 = 0), z along S1, x from where theta1 counts; of a
machine file in machine axes. A column of the table that has such a name is kept as 'given x', and so on.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command("forward", _run, _TEXT, MECHANISM, table("COORDINATES"), OUTPUT, TOOL)


def _run(options: argparse.Namespace) -> int:
    from rodgen import quaternion_from_matrix

    chain = chain_of(options.mechanism)
    chain.robot()  # is no loop
    count = len(chain.mechanism.variables)
    columns = [(column_name(chain.mechanism, v), quantity_of(chain.mechanism, v)) for v in range(count)]

    def prepare(unit: str) -> Any:
        here = chain.to(unit)
        robot = here.robot()
        tool = tool_of(options, here)

        def function(values: Any) -> Any:
            T = robot.forward(values) @ tool
            return [*T[:, :3, 3].T, *quaternion_from_matrix(T[:, :3, :3])[0].T], None

        return [*place("xyz", here.mechanism.unit), *QUATERNION], function

    with located(chain.file, "mechanism"):
        return map_rows(options, columns, prepare)
