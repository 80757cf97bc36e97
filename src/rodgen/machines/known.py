"""What is known of a machine's parameters before it is measured: a prior, bounds, or both."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from rodgen.data.units import UnitError, number_and_unit, parse_unit, unit_factor
from rodgen.errors import RodgenError, shown
from rodgen.machines.effects.rules import UnfitEffectError, catalogue_effect
from rodgen.machines.parameters import parameters_of
from rodgen.machines.parts import Known, belongs

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

_PRIOR = re.compile(r"\s*(?P<mean>[^±]+?)\s*(?:±|\+/?-)\s*(?P<std>.+?)\s*")

NONE = 1e-100
"""Standard deviations below this are none: their squares vanish."""


def unit_of(machine: Machine, name: str) -> str:
    """Return the unit of the parameters of a machine, or of an effect that it may get, that a name stands for.

    Raises
    ------
    RodgenError
        When there are none, or they differ in what they measure.
    """
    units = dict.fromkeys(_units(machine, name))
    if not units:
        some = ", ".join(p.key for p in parameters_of(machine, machine.structure, ("",))[:6])
        raise RodgenError(f"the key of a parameter, such as {some or 'C.backlash.b'}")
    if len({unit_factor(unit, machine.length_unit)[1] for unit in units}) > 1:
        raise RodgenError(f"one of its parameters: they are in {', '.join(units)}")
    return next(iter(units))


def _units(machine: Machine, name: str) -> Iterator[str]:
    found = [
        p.unit
        for p in parameters_of(machine, machine.structure, ("",))
        if p.slot[0] != "frame" and belongs(p.key, name)
    ]
    yield from found
    if found:
        return
    places = {*(joint.name for joint in machine.joints), *(target.name for target in machine.targets)}
    parts = name.split(".")
    place = parts.pop(0) if parts[0] in places else None
    if not parts:
        return
    try:
        units = catalogue_effect(machine, parts[0], place, {}).units(machine)
    except UnfitEffectError:
        return
    yield from (unit for parameter, unit in units.items() if parts[1:] in ([], [parameter]))


def read_known(machine: Machine, name: str, content: Mapping[str, Any]) -> Known:
    """Return what is known of a parameter, as a machine file says it.

    Parameters
    ----------
    name : str
        Key of a parameter, such as ``"C.axis.a"``, or what several belong to, such as ``"C.axis"``.
    content : mapping
        ``prior``: a text such as ``"0 ± 20 arcsec"``; ``bounds``: two numbers, or texts with units. Without a unit in
        those of the machine file.

    Raises
    ------
    UnfitEffectError
        With the key, what was found and what was expected.
    """
    try:
        unit = unit_of(machine, name)
    except RodgenError as error:
        raise UnfitEffectError("", "no such parameter", str(error)) from None
    prior = bounds = None
    if "prior" in content:
        prior = _prior(machine, content["prior"], unit)
    if "bounds" in content:
        bounds = _bounds(machine, content["bounds"], unit)
    if prior is bounds is None:
        raise UnfitEffectError("", "nothing", 'prior = "0 ± 20 arcsec", or bounds = [lowest, highest]')
    if prior and bounds and not bounds[0] <= prior[0] <= bounds[1]:
        raise UnfitEffectError("prior", "a mean beyond the bounds", "one within them")
    return Known(prior, bounds)


def _prior(machine: Machine, value: Any, unit: str) -> tuple[float, float]:
    expected = f'a value and its standard deviation, such as "0 ± 20 {unit}"'
    found = _PRIOR.fullmatch(value) if isinstance(value, str) else None
    parts = [number_and_unit(found[x]) for x in ("mean", "std")] if found else [None]
    if None in parts:
        raise UnfitEffectError("prior", shown(str(value)), expected)
    (mean, own), (std, of) = parts  # type: ignore[misc]
    if not std > NONE:
        raise UnfitEffectError("prior", shown(str(value)), expected.replace("deviation", "deviation above 0"))
    factor = _factor(machine, "prior", of, unit)
    return mean * (_factor(machine, "prior", own, unit) if own else factor), std * factor


def _bounds(machine: Machine, value: Any, unit: str) -> tuple[float, float]:
    expected = f'two values, the lower one first, such as ["0 {unit}", "60 {unit}"]'
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise UnfitEffectError("bounds", shown(str(value)), expected)
    found = []
    for x in value:
        number = number_and_unit(x) if isinstance(x, str) else (float(x), "") if _is_number(x) else None
        if number is None:
            raise UnfitEffectError("bounds", shown(str(x)), expected)
        found.append(number[0] * _factor(machine, "bounds", number[1], unit))
    low, high = found
    if not low < high or (math.isinf(low) and math.isinf(high)):
        raise UnfitEffectError("bounds", shown(str(value)), expected)
    return low, high


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value)


def _factor(machine: Machine, key: str, text: str, own: str) -> float:
    """Return the factor from a unit, or that of the machine file where it is empty, to internal units."""
    _, dimension = unit_factor(own, machine.length_unit)
    if not text:
        return machine.file_factor(dimension)
    try:
        unit = parse_unit(text)
    except UnitError as error:
        raise UnfitEffectError(key, error.found, error.expected) from None
    if not unit.dimension.fits(dimension):
        raise UnfitEffectError(key, f"unit {shown(text)}", f"one such as {own}")
    return unit.factor(machine.length_unit)
