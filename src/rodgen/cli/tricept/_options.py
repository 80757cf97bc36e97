"""The options that say which Tricept is meant, and lengths with a unit on the command line."""

from __future__ import annotations

import argparse
import contextlib
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rodgen.errors import InputFileError, RodgenError, shown

if TYPE_CHECKING:
    from rodgen.kinematics.tricept import Geometry

__all__ = ["Lengths", "add_geometry", "geometry_of", "lengths", "limits_of", "plane", "unit_of"]


@dataclass(frozen=True)
class Lengths:
    """Numbers and the unit behind them."""

    numbers: tuple[float, ...]
    unit: str
    option: str

    def to(self, unit: str) -> tuple[float, ...]:
        """Return them in another unit."""
        from rodgen.data.units import UnitError, conversion_factor

        try:
            factor = conversion_factor(self.unit, "length", unit)
        except UnitError as error:
            raise InputFileError("command line", self.option, error.found, error.expected) from None
        return tuple(number * factor for number in self.numbers)


def lengths(option: str, count: int, example: str) -> type:
    """Make what reads `count` lengths with one unit behind them."""

    def read(text: str) -> Lengths:
        found = re.fullmatch(r"\s*([-+.,\deE\s]*\d\.?)\s*([^\d\s,.+-].*?)\s*", text)
        if found:
            with contextlib.suppress(ValueError):
                numbers = tuple(float(part) for part in found[1].split(","))
                if len(numbers) == count and all(map(math.isfinite, numbers)):
                    return Lengths(numbers, found[2], option)
        what = "a length" if count == 1 else f"{count} lengths"
        raise argparse.ArgumentTypeError(f"{shown(text)} is not {what} with its unit, such as {example}")

    return read  # type: ignore[return-value]


def plane(example: str) -> Callable[[str], tuple[str, Lengths]]:
    """Make what reads a plane across an axis, such as ``z=700mm``."""

    def read(text: str) -> tuple[str, Lengths]:
        found = re.fullmatch(r"\s*([xyz])\s*=(.*)", text)
        if found:
            return found[1], lengths("--slice", 1, example)(found[2])
        raise argparse.ArgumentTypeError(
            f"{shown(text)} is no plane: an axis and a length, such as {example}"
        )

    return read


def add_geometry(parser: argparse.ArgumentParser) -> None:
    """Add the options of the machine."""
    parser.add_argument(
        "--R", metavar="LENGTH", type=lengths("--R", 1, "330mm"), help="radius of the base's joints, 330mm"
    )
    parser.add_argument(
        "--r",
        metavar="LENGTH",
        type=lengths("--r", 1, "140mm"),
        help="radius of the platform's joints, 140mm",
    )
    parser.add_argument(
        "--q",
        metavar="X,Y,Z",
        type=lengths("--q", 3, "0,0,50mm"),
        help="the point of the platform, such as 0,0,50mm; default: its centre",
    )
    parser.add_argument(
        "--limits",
        metavar="LEAST,GREATEST",
        type=lengths("--limits", 2, "568,858mm"),
        help="lengths of a rod; default: 568,858mm for the paper's machine (no --R, no --r), else none",
    )
    parser.add_argument(
        "--machine", metavar="FILE", help="machine file that has R, r and q, instead of these options"
    )


def geometry_of(options: argparse.Namespace, unit: str) -> Geometry:
    """Return the machine in a unit of length."""
    from rodgen.kinematics.tricept import PAPER, Geometry

    _take_machine(options)
    R = options.R or Lengths((PAPER.R,), "mm", "--R")
    r = options.r or Lengths((PAPER.r,), "mm", "--r")
    q = options.q.to(unit) if options.q else (0.0, 0.0, 0.0)
    for name, given in (("R", R), ("r", r)):
        if not given.numbers[0] > 0:
            found = f"{name} = {given.numbers[0]:g} {given.unit}"
            raise InputFileError("command line", given.option, found, "a positive length")
    try:
        return Geometry(R.to(unit)[0], r.to(unit)[0], q)
    except InputFileError:
        raise
    except RodgenError as error:
        found, expected = str(error).split("; expected ")
        raise InputFileError("command line", "--R, --r, --q", found, expected) from None


def limits_of(options: argparse.Namespace, unit: str) -> tuple[float, float] | None:
    """Return the limits of the rods in a unit of length."""
    from rodgen.kinematics.tricept import LEG_LIMITS

    _take_machine(options)
    if options.limits is None:
        return None if options.R or options.r else _pair(Lengths(LEG_LIMITS, "mm", "--limits"), unit)
    limits = _pair(options.limits, unit)
    if not 0 <= limits[0] <= limits[1]:
        found = ",".join(f"{x:g}" for x in options.limits.numbers)
        raise InputFileError("command line", "--limits", found, "the least length first, such as 568,858mm")
    return limits


def unit_of(options: argparse.Namespace) -> str:
    """Return the unit in which a machine was given, where no table says one."""
    _take_machine(options)
    given = next((x for x in (options.R, options.r, options.limits, options.q) if x), None)
    return given.unit if given else "mm"


def _take_machine(options: argparse.Namespace) -> None:
    """Read the machine file, where there is one, as if its numbers had been given as options."""
    if options.machine is None:
        return
    if options.R or options.r or options.q:
        raise InputFileError("command line", "--machine", "beside --R, --r or --q", "one of the two")
    from rodgen.machines.machine import Machine

    machine = Machine.load(options.machine)
    chain = machine.geometry
    if chain is None or chain.family != "tricept":
        found = "a machine of joints" if chain is None else f'family = "{chain.family}"'
        raise InputFileError(options.machine, "family", found, 'family = "tricept"')
    unit = machine.length_unit
    options.R, options.r, options.q = (
        Lengths(chain.number(name), unit, "--machine") for name in ("R", "r", "q")
    )
    options.machine = None


def _pair(given: Lengths, unit: str) -> tuple[float, float]:
    low, high = given.to(unit)
    return low, high
