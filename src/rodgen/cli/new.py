"""``rodgen new``: a machine file with comments to begin with."""

from __future__ import annotations

import argparse

from rodgen.cli._console import OK, Command, argument, flag, option, show
from rodgen.cli._values import OutputFile, quantity, whole
from rodgen.document import Document, Table
from rodgen.errors import in_file
from rodgen.files import write_file

_NEW = """\
Write a machine file with comments, to be changed to your machine. Without KIND the kinds are listed. CODE is that of
ISO 10791: the axes in order from the workpiece w over the bed b to the tool t. Of a machine tool the tool is measured,
in the workpiece's axes; with --balls, balls on its table as the spindle probes them; with --ballbar, distances.

  rodgen new table-table --code "[w C B b X Y Z t]" --balls 3 -o machine.toml
"""


def add_to(command: Command) -> None:
    """Add the command."""
    command(
        "new",
        _run,
        _NEW,
        argument("KIND", "of machine; left out, the kinds are listed", nargs="?"),
        option("-o --output MACHINE.toml", "default: standard output", OutputFile),
        option("--code CODE", "of a machine tool, such as '[w C A b X Y Z t]'"),
        option(
            "--latitude ANGLE",
            "of an equatorial mount, such as 31.7deg",
            quantity("--latitude", "31.7deg", dimension="angle"),
        ),
        option("--balls N", "of a machine tool: balls on the table are probed", whole(1, 1000)),
        flag("--ballbar", "of a machine tool: the distance from a ball on the table is measured"),
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
