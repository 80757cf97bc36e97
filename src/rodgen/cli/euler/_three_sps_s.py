"""Options for a 3-SPS-S machine: its dimensions, or a machine file."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rodgen.cli._console import located
from rodgen.cli._machine import closed_chain_of
from rodgen.cli._values import Quantity, quantity
from rodgen.errors import InputFileError

if TYPE_CHECKING:
    from rodgen.kinematics.three_sps_s import Geometry

__all__ = ["MACHINE_TEXT", "add_limits", "add_machine", "limits_of", "machine_of"]

MACHINE_TEXT = """\
The machine is given by --R, --r and --h, or by the file of a machine of the family 3-sps-s with --machine. Legs 1, 2
and 3 stand at -30, 90 and 210 deg about the z axis."""


def add_machine(parser: argparse.ArgumentParser) -> None:
    """Add the options of the machine."""
    for name, example, text in (
        ("R", "200mm", "radius of the joints on the base, such as 200mm"),
        ("r", "120mm", "radius of the joints on the platform"),
        ("h", "260mm", "height of the pivot over the base"),
    ):
        parser.add_argument(f"--{name}", metavar="LENGTH", type=quantity(f"--{name}", example), help=text)
    parser.add_argument("--machine", metavar="FILE", help="machine file that has R, r and h")


def add_limits(parser: argparse.ArgumentParser) -> None:
    """Add ``--limits``, the lengths that a leg may have."""
    parser.add_argument(
        "--limits",
        metavar="LEAST,GREATEST",
        type=quantity("--limits", "200,400mm", 2),
        help="lengths of a leg, such as 200,400mm; default: any",
    )


def machine_of(options: argparse.Namespace, unit: str = "") -> tuple[Geometry, str]:
    """Return the machine, and the unit of its lengths: `unit`, or that in which they were given.

    The start of a machine file, a rotation vector in rad, is stored in `options.start`, None without one.
    """
    from rodgen.kinematics.three_sps_s import Geometry

    options.start = None
    given = {name: getattr(options, name) for name in ("R", "r", "h")}
    if options.machine is not None:
        if any(given.values()):
            raise InputFileError(
                "command line", "--machine", "together with --R, --r or --h", "one of the two"
            )
        chain, length_unit = closed_chain_of(options.machine, "3-sps-s")
        options.start = chain.start
        given = {name: Quantity((getattr(chain, name),), length_unit, "--machine") for name in given}
    missing = [f"--{name}" for name, value in given.items() if value is None]
    if missing:
        expected = "all of --R, --r and --h, each with its unit, or --machine"
        raise InputFileError("command line", ", ".join(missing), "nothing", expected)
    for value in given.values():
        value.to("mm")  # checks the dimension of each under its own name
    unit = unit or given["R"].unit
    R, r, h = (value.to(unit)[0] for value in given.values())
    with located("command line", "--R, --r, --h"):
        return Geometry(R, r, h), unit


def limits_of(options: argparse.Namespace, unit: str) -> tuple[float, float] | None:
    """Return the limits of the legs in a unit of length."""
    if options.limits is None:
        return None
    low, high = options.limits.to(unit)
    if not 0 <= low <= high:
        found = ",".join(f"{x:g}" for x in options.limits.numbers)
        raise InputFileError("command line", "--limits", found, "the least length first, such as 200,400mm")
    return low, high
