"""``rodgen euler angles``: instantaneous Euler angles of attitudes."""

from __future__ import annotations

import argparse
from typing import Any

from rodgen.cli._attitude import ATTITUDE_TEXT, add_form, columns_of, map_array
from rodgen.cli._console import Command
from rodgen.cli._tables import add_table

__all__ = ["add_to"]

_TEXT = f"""\
Find the instantaneous Euler angles of the attitude in every row of a table.

The table is CSV (gzip or not) or Parquet, and may have further columns. {ATTITUDE_TEXT}
The output gets every column of the table, then
  chi_x chi_y chi_z [deg]   the angles, in the unit of the first angle
  status                    angles; no_ridge (one is 0 or 180 deg); identity; not_normal (made a rotation); invalid
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("angles", _run, "instantaneous Euler angles of attitudes", _TEXT)
    add_table(parser, "ATTITUDES")
    add_form(parser)


def _run(options: argparse.Namespace) -> int:
    from rodgen.data.tables import Result
    from rodgen.kinematics import instantaneous_euler as ie

    results = [*(Result(f"chi_{axis}", "angle") for axis in "xyz"), Result("status", ie.AngleStatus)]

    def function(values: Any) -> Any:
        if options.form == "quaternion":
            chi, status = ie.angles_from_quaternion(values)
        elif options.form == "matrix":
            chi, status = ie.angles_from_matrix(values.reshape(-1, 3, 3))
        else:
            chi, status = ie.angles_from_euler(values, options.form)
        return [*chi.T, status], None

    return map_array(options, columns_of(options.form), results, function)
