"""``rodgen new``: a machine file with comments to begin with."""

from __future__ import annotations

import argparse
import sys

from rodgen.cli._console import OK, Command, located, show
from rodgen.cli._outputs import Outputs
from rodgen.cli._values import quantity

__all__ = ["add_to"]

_NEW = """\
Write a machine file with comments, to be changed to your machine.

  rodgen new turntable -o machine.toml
  rodgen new equatorial-german --latitude 48.1deg -o mount.toml
  rodgen new table-table --code "[w C B b X Y Z t]" -o machine.toml

Without KIND, a terminal is asked; else the kinds are listed. CODE is that of ISO 10791: the axes in order from the
workpiece w over the bed b to the tool t.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    made = command("new", _run, "a machine file with comments to begin with", _NEW)
    made.add_argument(
        "kind", metavar="KIND", nargs="?", help="what kind of machine; left out, the kinds are listed"
    )
    made.add_argument("-o", "--output", metavar="MACHINE.toml", help="default: standard output")
    made.add_argument("--code", metavar="CODE", help="of a machine tool, such as '[w C A b X Y Z t]'")
    made.add_argument(
        "--latitude",
        metavar="ANGLE",
        type=quantity("--latitude", "31.7deg", dimension="angle"),
        help="of an equatorial mount, such as 31.7deg",
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.machines.files.read import machine_of
    from rodgen.machines.machine import Machine
    from rodgen.machines.templates import KINDS, machine_template

    kind = options.kind
    if kind is None:
        width = max(map(len, KINDS))
        listed = "\n".join(f"  {name:{width}}  {words}" for name, words in KINDS.items())
        if not (sys.stdin and sys.stdin.isatty() and sys.stdout and sys.stdout.isatty()):
            show(listed)
            return OK
        show(listed)
        kind = input("Which kind? ").strip()
    latitude = options.latitude.to("rad")[0] if options.latitude else None
    with located("command line", "rodgen new", "a kind of 'rodgen new'"), Outputs() as outputs:
        outputs.claim(options.output)
        text = machine_template(kind, code=options.code, latitude=latitude)
        machine = machine_of(text, options.output or kind, Machine)
        if options.output:
            outputs.add(options.output, text.encode())
    show(
        f"{options.output}:\n{machine.describe()}" if options.output else text,
        end="\n" if options.output else "",
    )
    return OK
