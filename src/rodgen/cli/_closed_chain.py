"""Dimensions and limits of a Tricept or a 3-SPS-S machine, from options or from a machine file."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from rodgen.cli._console import refused
from rodgen.cli._values import Quantity
from rodgen.errors import InputFileError


def take_machine(options: argparse.Namespace, family: str, names: Sequence[str]) -> Any:
    """Read the file `options.machine`, if any, as if its dimensions had been given by the options of their names.

    Returns
    -------
    Kinematics or None
        The closed chain of the file.

    Raises
    ------
    InputFileError
        When one of the options is given, too, or the machine is not of this family.
    """
    from rodgen.machines.machine import Machine

    if options.machine is None:
        return None
    if any(getattr(options, name) for name in names):
        *most, last = (f"--{name}" for name in names)
        found = f"together with {', '.join(most)} or {last}"
        raise refused("--machine", found, "one of the two")
    machine = Machine.load(options.machine)
    chain = machine.kinematics
    if chain.family != family:
        found = f'family = "{chain.family}"' if chain.is_closed else "a machine of joints"
        raise InputFileError(options.machine, "family", found, f'family = "{family}"')
    for name in names:
        setattr(options, name, Quantity(chain.number(name), machine.length_unit, "--machine"))
    options.machine = None
    return chain


def ordered_limits(given: Quantity, unit: str, example: str) -> tuple[float, float]:
    """Return the least and the greatest length of ``--limits`` in a unit; an error shows the `example`."""
    low, high = given.to(unit)
    if not 0 <= low <= high:
        found = ",".join(f"{x:g}" for x in given.numbers)
        expected = f"the least length first, such as {example}"
        raise refused("--limits", found, expected)
    return low, high
