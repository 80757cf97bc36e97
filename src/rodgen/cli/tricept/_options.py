"""Options for a Tricept: its dimensions, or a machine file."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rodgen.cli._closed_chain import ordered_limits, take_machine
from rodgen.cli._console import located, refused
from rodgen.cli._values import InputFile, Quantity, quantity

if TYPE_CHECKING:
    from rodgen.kinematics.tricept import Geometry


def add_geometry(parser: argparse.ArgumentParser) -> None:
    """Add the options of the machine."""
    parser.add_argument(
        "--R", metavar="LENGTH", type=quantity("--R", "330mm"), help="radius of the base's joints, 330mm"
    )
    parser.add_argument(
        "--r",
        metavar="LENGTH",
        type=quantity("--r", "140mm"),
        help="radius of the platform's joints, 140mm",
    )
    parser.add_argument(
        "--q",
        metavar="X,Y,Z",
        type=quantity("--q", "0,0,50mm", 3),
        help="the point of the platform, such as 0,0,50mm; default: its centre",
    )
    parser.add_argument(
        "--limits",
        metavar="LEAST,GREATEST",
        type=quantity("--limits", "568,858mm", 2),
        help="lengths of a rod; default: 568,858mm for the paper's machine (no --R, no --r), else none",
    )
    parser.add_argument(
        "--machine",
        metavar="FILE",
        type=InputFile,
        help="machine file that has R, r and q, instead of these options",
    )


def geometry_of(options: argparse.Namespace, unit: str) -> Geometry:
    """Return the machine in a unit of length."""
    from rodgen.kinematics.tricept import PAPER, Geometry

    _take_machine(options)
    R = options.R or Quantity((PAPER.R,), "mm", "--R")
    r = options.r or Quantity((PAPER.r,), "mm", "--r")
    q = options.q.to(unit) if options.q else (0.0, 0.0, 0.0)
    for name, given in (("R", R), ("r", r)):
        if not given.numbers[0] > 0:
            found = f"{name} = {given.numbers[0]:g} {given.unit}"
            raise refused(given.option, found, "a positive length")
    with located("command line", "--R, --r, --q"):
        return Geometry(R.to(unit)[0], r.to(unit)[0], q)


def limits_of(options: argparse.Namespace, unit: str) -> tuple[float, float] | None:
    """Return the limits of the rods in a unit of length."""
    from rodgen.kinematics.tricept import LEG_LIMITS

    _take_machine(options)
    if options.limits is None:
        if options.R or options.r:
            return None
        return ordered_limits(Quantity(LEG_LIMITS, "mm", "--limits"), unit, "")
    return ordered_limits(options.limits, unit, "568,858mm")


def needed(limits: tuple[float, float] | None) -> tuple[float, float]:
    """Return limits of the rods; without them a command that needs them cannot run."""
    if limits is None:
        raise refused("--limits", "none", "lengths of a rod, such as 568,858mm")
    return limits


def unit_of(options: argparse.Namespace) -> str:
    """Return the unit in which the machine was given, for commands without a table."""
    _take_machine(options)
    given = next((x for x in (options.R, options.r, options.limits, options.q) if x), None)
    return given.unit if given else "mm"


def _take_machine(options: argparse.Namespace) -> None:
    take_machine(options, "tricept", ("R", "r", "q"))
