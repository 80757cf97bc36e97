"""The mechanism that a command is about: a link table, a machine file, or a robot of the course."""

from __future__ import annotations

import argparse
import contextlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rodgen.cli import _attitude
from rodgen.cli._console import OK, reading, tell
from rodgen.errors import InputFileError, RodgenError

if TYPE_CHECKING:
    from rodgen.data.tables import Column, Result
    from rodgen.kinematics.spatial import Mechanism, Placement

__all__ = [
    "MECHANISM_TEXT",
    "Chain",
    "add_files",
    "add_mechanism",
    "chain_of",
    "column_name",
    "faults_of",
    "run",
]

PRESETS = {"puma_560": "PUMA_560", "ge_p60": "GE_P60", "t3_776": "T3_776"}

MECHANISM_TEXT = """\
MECHANISM is a link table, a machine file of the workbench (.toml), or puma_560, ge_p60 or t3_776. A link table is a CSV
with a row for each joint, of type R, P, C, H, E, T or S, and the link after it:

  joint,type,S [mm],theta [deg],pitch [mm/rad],a [mm],alpha [deg]

A cell is empty where the joint has its variable. Without a link after the last joint it is an open chain, a robot."""


@dataclass(frozen=True)
class Chain:
    """A mechanism, and the file that it is from, as the user named it; of a robot with its place."""

    file: str
    mechanism: Mechanism
    placement: Placement | None = None

    def robot(self) -> Placement:
        """Return the open chain in its place.

        Raises
        ------
        InputFileError
            When it is a loop.
        """
        if self.placement is None:
            expected = "an open chain; 'rodgen mechanism reverse' solves loops"
            raise InputFileError(self.file, "mechanism", "a closed loop", expected)
        return self.placement

    def to(self, unit: str) -> Chain:
        """Return it with another unit of length; the same where none is given."""
        if not unit:
            return self
        placement = self.placement.in_unit(unit) if self.placement else None
        return Chain(self.file, self.mechanism.in_unit(unit), placement)


def add_mechanism(parser: argparse.ArgumentParser) -> None:
    """Add MECHANISM."""
    parser.add_argument("mechanism", metavar="MECHANISM", help="link table, machine file, or robot")


def add_files(parser: argparse.ArgumentParser, name: str) -> None:
    """Add MECHANISM, the table that is read and the one that is written."""
    add_mechanism(parser)
    _attitude.add_files(parser, name)


def chain_of(name: str, *, expand: bool = True) -> Chain:
    """Read a mechanism; with its joints E, T and S as joints R and P where they are to be moved."""
    from rodgen.kinematics import spatial

    if name.lower().endswith(".toml"):
        return _of_machine(name)
    if name in PRESETS and not os.path.exists(name):
        mechanism: Mechanism = getattr(spatial, PRESETS[name])
    elif not os.path.exists(name):
        known = ", ".join(PRESETS)
        raise InputFileError(name, "file", "no such file", f"a link table, a machine file, or one of {known}")
    else:
        mechanism = spatial.load_mechanism(name)
    mechanism = mechanism.expanded() if expand else mechanism
    if mechanism.closed or not expand:
        return Chain(name, mechanism)
    return Chain(name, mechanism, spatial.Placement(mechanism))


def _of_machine(file: str) -> Chain:
    from rodgen.kinematics import spatial
    from rodgen.machines.machine import Machine

    with faults_of(file):
        found = spatial.from_machine(Machine.load(file))
    return Chain(file, found.mechanism, found)


def column_name(mechanism: Mechanism, variable: int) -> str:
    """Return the name of the column that a variable is read from and written to: its joint's, and of a C which."""
    joint, kind = mechanism.variables[variable]
    name = mechanism.names[joint]
    return f"{name}.{kind}" if mechanism.joints[joint] == "C" else name


def quantity_of(mechanism: Mechanism, variable: int) -> Any:
    """Return what a variable measures."""
    return "angle" if mechanism.variables[variable][1] == "theta" else "length"


@contextlib.contextmanager
def faults_of(file: str) -> Iterator[None]:
    """Say of which file it is that a function cannot do what it was asked to."""
    try:
        yield
    except InputFileError:
        raise
    except (RodgenError, ValueError) as error:
        found, _, expected = str(error).partition("; expected ")
        if not expected:
            raise
        raise InputFileError(file, "mechanism", found, expected) from None


def run(options: argparse.Namespace, columns: Sequence[Column], prepare: Any) -> int:
    """Add results to a table, and count them."""
    from rodgen.data.tables import map_table

    with contextlib.ExitStack() as stack:
        summary = map_table(
            options.table, options.output, columns, prepare, progress=reading(stack), given="given "
        )
    counts = ", ".join(f"{count} {name}" for name, count in summary.counts.items())
    name = "standard input" if options.table == "-" else options.table
    tell(f"{name}: {summary.rows} row{'s' * (summary.rows != 1)} written{': ' * bool(counts)}{counts}")
    return OK


def place(names: Sequence[str], unit: str) -> list[Result]:
    """Return the results of a place, also where no column of the table has told the unit of length."""
    from rodgen.data.tables import Result

    return [Result(f"{name} [{unit}]", "number") for name in names]
