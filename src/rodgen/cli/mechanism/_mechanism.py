"""Read the mechanism of a command: a link table, a machine file, or a preset robot."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.cli._console import argument, located, option
from rodgen.cli._tables import Columns
from rodgen.cli._values import InputFile, quantity
from rodgen.errors import InputFileError

if TYPE_CHECKING:
    from rodgen.kinematics.spatial import Mechanism, Placement

PRESETS = {"puma_560": "PUMA_560", "ge_p60": "GE_P60", "t3_776": "T3_776"}

MECHANISM_TEXT = """\
MECHANISM is a link table, a machine file (.toml), or puma_560, ge_p60 or t3_776. A link table is a CSV
with a row for each joint, of type R, P, C, H, E, T or S, and the link after it:

  joint,type,S [mm],theta [deg],pitch [mm/rad],a [mm],alpha [deg]

A cell is empty where the joint has its variable. Without a link after the last joint it is an open chain, a robot."""


@dataclass(frozen=True)
class Chain:
    """A mechanism with the name of its file; a robot also has its placement."""

    file: str
    mechanism: Mechanism
    placement: Placement | None = None

    def robot(self) -> Placement:
        """Return the placement of an open chain.

        Raises
        ------
        InputFileError
            When the mechanism is a loop.
        """
        if self.placement is None:
            expected = "an open chain; 'rodgen mechanism reverse' solves loops"
            raise InputFileError(self.file, "mechanism", "a closed loop", expected)
        return self.placement

    def to(self, unit: str) -> Chain:
        """Return the chain in another unit of length; unchanged when `unit` is empty."""
        if not unit:
            return self
        placement = self.placement.in_unit(unit) if self.placement else None
        return Chain(self.file, self.mechanism.in_unit(unit), placement)


MECHANISM = argument("MECHANISM", "link table, machine file, or robot", InputFile)
TOOL = option(
    "--tool X,Y,Z",
    "point of the last link, in its frame (x along the next link, z along the last joint), such as 2,3,5cm; "
    "of a machine file in machine axes at zero; default: the frame's origin",
    quantity("--tool", "2,3,5cm", 3),
)


def tool_of(options: argparse.Namespace, chain: Chain) -> Any:
    """Return the frame at the tool in that of the last link, (4, 4)."""
    shift = np.eye(4)
    if options.tool:
        shift[:3, 3] = options.tool.to(chain.mechanism.unit)
    return shift


def chain_of(name: str) -> Chain:
    """Read a mechanism, its joints E, T and S replaced by joints R and P."""
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
    mechanism = mechanism.expanded()
    if mechanism.closed:
        return Chain(name, mechanism)
    return Chain(name, mechanism, spatial.Placement(mechanism))


def _of_machine(file: str) -> Chain:
    from rodgen.machines.machine import Machine
    from rodgen.machines.mechanism import to_mechanism

    with located(file, "mechanism"):
        found = to_mechanism(Machine.load(file))
    return Chain(file, found.mechanism, found)


def column_name(mechanism: Mechanism, variable: int) -> str:
    """Return the column name of a variable: the name of its joint, with the kind of variable for a joint C."""
    joint, kind = mechanism.variables[variable]
    name = mechanism.names[joint]
    return f"{name}.{kind}" if mechanism.joints[joint] == "C" else name


def quantity_of(mechanism: Mechanism, variable: int) -> Any:
    """Return the quantity of a variable, angle or length."""
    return "angle" if mechanism.variables[variable][1] == "theta" else "length"


def place(names: Sequence[str], unit: str) -> Columns:
    """Return result columns for lengths in a unit, also when the table has no length column."""
    return [(f"{name} [{unit}]", "number") for name in names]
