"""``rodgen import``: a machine file from the files that people have."""

from __future__ import annotations

import argparse

from rodgen.cli._console import OK, Command, show
from rodgen.cli._outputs import Outputs

__all__ = ["add_to"]

_IMPORT = """\
Make a machine file of a file in another form, and say what was taken for what.

  rodgen import robot.urdf --base base_link --tip tool0 -o machine.toml

SOURCE is
  a robot in URDF: the chain of joints from the link --base to the link --tip. Lengths become mm, limits travels;
  fixed joints are part of what they join.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    made = command("import", _run, "make a machine file of a URDF", _IMPORT)
    made.add_argument("source", metavar="SOURCE", help="the file")
    made.add_argument(
        "-o", "--output", metavar="MACHINE.toml", required=True, help="the machine file that is written"
    )
    made.add_argument(
        "--base", metavar="LINK", help="of a URDF: the link that stands still; default: the root"
    )
    made.add_argument(
        "--tip", metavar="LINK", help="of a URDF: the link that is measured; default: the only last one"
    )


def _run(options: argparse.Namespace) -> int:
    from rodgen.machines.files.read import machine_of
    from rodgen.machines.imports.urdf import machine_from_urdf
    from rodgen.machines.machine import Machine

    with Outputs(options.source) as outputs:
        outputs.claim(options.output)
        made = machine_from_urdf(options.source, options.base, options.tip)
        machine = machine_of(made.text, options.output, Machine)
        outputs.add(options.output, made.text.encode())
    show("\n".join([*made.notes, "", f"{options.output}:", machine.describe()]))
    return OK
