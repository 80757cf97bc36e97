"""What a machine file says of the plausibility of effects: its table ``[plausibility]``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rodgen.data.units import LENGTH, Dimension, UnitError, number_and_unit, unit_factor
from rodgen.errors import shown
from rodgen.machines.effects.catalogue import NAMES
from rodgen.machines.effects.rules import UnfitEffectError, catalogue_effect, unknown_name
from rodgen.machines.parts import Effect, StatedPlausibility

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

SIGNS = ("any", "positive")
MOST_ODDS = 1e6
"""Odds that a file may state, of which the square is still far from overflow."""
EXAMPLE = 'odds = 0.5, usual = "20 arcsec", largest = "2 deg" or sign = "any"'


def stated_plausibility(machine: Machine, key: str, content: Mapping[str, Any]) -> StatedPlausibility:
    """Return what an entry of ``[plausibility]`` says.

    Parameters
    ----------
    key : str
        An effect of the catalogue, at a place such as ``"J2.gravity_windup"``, or everywhere: ``"gravity_windup"``.
    content : mapping
        ``odds``, ``usual``, ``largest`` and ``sign``, one of them at least.

    Raises
    ------
    UnfitEffectError
        With the key, what was found and what was expected.
    """
    effects = _effects(machine, key)
    for name in content:
        if name not in {"odds", "usual", "largest", "sign"}:
            raise UnfitEffectError(name, "unknown key", EXAMPLE)
    if not content:
        raise UnfitEffectError("", "nothing", EXAMPLE)
    odds, sign = content.get("odds"), content.get("sign")
    is_number = isinstance(odds, int | float) and not isinstance(odds, bool)
    if odds is not None and not (is_number and 0 <= odds <= MOST_ODDS):
        expected = "a number from 0 (it cannot be there) to 1e6; 1 is as likely as the commonest effects"
        raise UnfitEffectError("odds", shown(str(odds)), expected)
    if sign is not None and sign not in SIGNS:
        raise UnfitEffectError("sign", shown(str(sign)), '"any" or "positive"')
    dimensions = {
        dimension
        for effect in effects
        for parameter, unit in effect.units(machine).items()
        if parameter not in effect.definition.searched
        for dimension in size_dimensions(machine, effect, parameter, unit)
    }
    sizes = {
        name: _sizes(machine, name, content[name], dimensions)
        for name in ("usual", "largest")
        if name in content
    }
    for usual in map(number_and_unit, sizes.get("usual", ())):
        for largest in map(number_and_unit, sizes.get("largest", ())):
            if usual and largest and usual[1] == largest[1] and largest[0] < usual[0]:
                found = f"{f'{largest[0]:g} {largest[1]}'.strip()}, less than the usual {usual[0]:g}"
                raise UnfitEffectError("largest", found, "a size that is no less than the usual one")
    return StatedPlausibility(None if odds is None else float(odds), **sizes, sign=sign)


def _effects(machine: Machine, key: str) -> list[Effect]:
    """Return the effect that a key stands for, at each of its places."""
    place, _, name = key.rpartition(".")
    if place:
        return [catalogue_effect(machine, name, place, {})]
    if name not in NAMES:
        raise unknown_name(name)
    found = []
    for at in (*(joint.name for joint in machine.joints), *(target.name for target in machine.targets), None):
        try:
            found.append(catalogue_effect(machine, name, at, {}))
        except UnfitEffectError:
            continue
    if not found:
        raise UnfitEffectError("", "an effect that this machine cannot have", "one that it may have")
    return found


def size_dimensions(machine: Machine, effect: Effect, name: str, unit: str) -> tuple[Dimension, ...]:
    """Return the dimensions in which the size of a parameter may be given, its own first.

    Of one per lever arm also the dimension of what it does at the machine's whole reach.
    """
    _, own = unit_factor(unit, machine.length_unit)
    of_catalogue = effect.definition.parameters.get(name)
    by_arm = of_catalogue is None or (of_catalogue.endswith("/{arm}") and machine.measurand.moving)
    return (own, own * LENGTH) if by_arm else (own,)


def _sizes(machine: Machine, key: str, value: Any, dimensions: set[Dimension]) -> tuple[str, ...]:
    texts = tuple(value) if isinstance(value, list) and value else (value,)
    expected = 'a size with its unit, such as "20 arcsec", or a list of such'
    for text in texts:
        found = number_and_unit(text) if isinstance(text, str) else None
        if found is None or not found[0] > 0:
            raise UnfitEffectError(key, shown(str(text)), expected)
        try:
            _, dimension = unit_factor(found[1] or "1", machine.length_unit)
        except UnitError as error:
            raise UnfitEffectError(key, error.found, error.expected) from None
        if dimension not in dimensions:
            raise UnfitEffectError(key, f"{shown(text)}, which no parameter of the effect is", expected)
    return texts
