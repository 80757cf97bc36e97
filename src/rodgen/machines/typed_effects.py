"""Effects as typed on the command line: ``encoder_eccentricity@C:a=12arcsec,b=3arcsec``.

NAME, then ``@`` and its joint or target unless it is of the whole machine, then ``:`` and its parameters. A number may
have a unit; without one it is in the units of the machine file. ``frame_shift[2]:x=0.1mm`` is that of the set-up 2.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rodgen.data.units import number_and_unit, unit_factor
from rodgen.errors import shown
from rodgen.machines.known import factor_of
from rodgen.machines.rules import UnfitEffectError

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine
    from rodgen.machines.parts import Effect

_EFFECT = re.compile(r"\s*(\w+)\s*(?:\[([^\[\]]*)\])?\s*(?:@\s*([^:@]*?)\s*)?(?::(.*))?", re.DOTALL)


@dataclass(frozen=True)
class TypedEffect:
    """What was typed."""

    name: str
    place: str | None
    run: str | None
    numbers: Mapping[str, str]
    """Parameters with their numbers, as text."""


def typed_effect(text: str) -> TypedEffect:
    """Return the parts of a typed effect.

    Raises
    ------
    UnfitEffectError
        When it is not such a text.

    Examples
    --------
    >>> typed_effect("backlash@C: b = 20 arcsec")
    TypedEffect(name='backlash', place='C', run=None, numbers={'b': '20 arcsec'})
    """
    match = _EFFECT.fullmatch(text)
    if match is None:
        raise UnfitEffectError("effect", shown(text), "NAME, NAME@JOINT or NAME@JOINT:a=12arcsec,b=3arcsec")
    name, run, place, numbers = match.groups()
    return TypedEffect(name, place or None, run, assignments(numbers.split(",") if numbers else ()))


def assignments(texts: Sequence[str]) -> dict[str, str]:
    """Return names and values of texts such as ``k2=0``.

    Raises
    ------
    UnfitEffectError
        When one is not such a text, or a name stands twice.
    """
    assigned: dict[str, str] = {}
    for text in texts:
        name, equals, number = (part.strip() for part in text.partition("="))
        if not (name and equals and number):
            raise UnfitEffectError("hold", shown(text), "NAME=VALUE, such as k2=0 or b=12arcsec")
        if name in assigned:
            raise UnfitEffectError("hold", f"{shown(name)} twice", "it once")
        assigned[name] = number
    return assigned


def effect_with(machine: Machine, name: str, place: str | None, numbers: Mapping[str, str]) -> Effect:
    """Return an effect of the catalogue that holds typed numbers.

    Parameters
    ----------
    place : str or None
        Joint or target; None for the whole machine.
    numbers : mapping of str to str
        Parameters with their numbers, as text.

    Raises
    ------
    InputFileError
        When the effect cannot stand there.
    UnfitEffectError
        When a number is none, or its unit does not fit.
    """
    return holding(machine, lambda hold: machine.effect(name, place, hold=hold), numbers)


def holding(
    machine: Machine, make: Callable[[Mapping[str, float]], Effect], numbers: Mapping[str, str]
) -> Effect:
    """Return an effect, made of what it holds, that holds typed numbers; see `effect_with`."""
    units = make({}).units(machine)
    hold: dict[str, float] = {}
    for parameter, text in numbers.items():
        number = number_and_unit(text)
        if number is None:
            raise UnfitEffectError(f"hold.{parameter}", shown(text), "a number, such as 0 or 12arcsec")
        hold[parameter], unit = number
        if unit and parameter in units:  # unknown names are reported where the hold is checked
            _, dimension = unit_factor(units[parameter], machine.length_unit)
            internal = factor_of(machine, f"hold.{parameter}", unit, units[parameter])
            hold[parameter] *= internal / machine.file_factor(dimension)
    return make(hold)
