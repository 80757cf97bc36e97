"""``rodgen new``: a machine file with comments to begin with."""

from __future__ import annotations

import argparse

from rodgen.cli._console import OK, Command, show
from rodgen.cli._values import OutputFile, quantity, whole
from rodgen.document import Document, Table
from rodgen.errors import in_file
from rodgen.files import write_file

_NEW = """\
Write a machine file with comments, to be changed to your machine.

  rodgen new turntable -o machine.toml
  rodgen new equatorial-german --latitude 48.1deg -o mount.toml
  rodgen new table-table --code "[w C B b X Y Z t]" -o machine.toml
  rodgen new table-table --balls 3 -o machine.toml

Without KIND the kinds are listed. CODE is that of ISO 10791: the axes in order from the
workpiece w over the bed b to the tool t. With --balls the measurements are the places of balls on its table, as the
spindle probes them, in the linear axes; with --ballbar distances of the tool from a ball on it; else they are those of
the tool, in the workpiece's axes.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    made = command("new", _run, "a machine file with comments to begin with", _NEW)
    made.add_argument(
        "kind", metavar="KIND", nargs="?", help="what kind of machine; left out, the kinds are listed"
    )
    about = "default: standard output"
    made.add_argument("-o", "--output", metavar="MACHINE.toml", type=OutputFile, help=about)
    made.add_argument("--code", metavar="CODE", help="of a machine tool, such as '[w C A b X Y Z t]'")
    made.add_argument(
        "--latitude",
        metavar="ANGLE",
        type=quantity("--latitude", "31.7deg", dimension="angle"),
        help="of an equatorial mount, such as 31.7deg",
    )
    made.add_argument(
        "--balls",
        metavar="N",
        type=whole(1, 1000),
        help="of a machine tool: N balls on the table are measured, by a probe in the spindle",
    )
    made.add_argument(
        "--ballbar",
        action="store_true",
        help="of a machine tool: the distance from a ball on the table is measured",
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.machines.files.read import machine_of
    from rodgen.machines.templates import KINDS, machine_template

    kind, latitude = options.kind, options.latitude
    if kind is None:
        show(str(Document([Table((), list(KINDS.items()))])))
        return OK
    north = latitude.to("rad")[0] if latitude else None
    with in_file("command line", "rodgen new"):
        text = machine_template(
            kind, code=options.code, latitude=north, balls=options.balls, ballbar=options.ballbar
        )
        machine = machine_of(text, options.output or kind)
        if options.output:
            write_file(options.output, text.encode())
    show(
        f"{options.output}:\n{machine.describe()}" if options.output else text,
        end="\n" if options.output else "",
    )
    return OK
