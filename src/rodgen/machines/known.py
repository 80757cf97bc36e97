"""What is known of a machine's parameters before it is measured: a prior, bounds, or both; and ties to others."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rodgen.data.units import UnitError, number_and_unit, parse_unit, unit_factor
from rodgen.errors import RodgenError, UnexpectedError, shown, suggestion
from rodgen.machines.linear import Combination, combination
from rodgen.machines.parameters import Parameter, parameters_of
from rodgen.machines.parts import Known, MachineData, belongs
from rodgen.machines.rules import UnfitEffectError, catalogue_effect
from rodgen.machines.structure import structure_of

_PRIOR = re.compile(r"\s*(?P<mean>[^±]+?)\s*(?:±|\+/?-)\s*(?P<std>.+?)\s*")

NONE = 1e-100
"""Standard deviations below this are none: their squares vanish."""


def unit_of(machine: MachineData, name: str) -> str:
    """Return the unit of the parameters of a machine, or of an effect that it may get, that a name stands for.

    Raises
    ------
    RodgenError
        When there are none, or they differ in what they measure.
    """
    units = dict.fromkeys(_units(machine, name))
    if not units:
        some = ", ".join(p.key for p in parameters_of(machine, structure_of(machine), ("",))[:6])
        raise RodgenError(f"the key of a parameter, such as {some or 'C.backlash.b'}")
    if len({unit_factor(unit, machine.length_unit)[1] for unit in units}) > 1:
        raise RodgenError(f"one of its parameters: they are in {', '.join(units)}")
    return next(iter(units))


def _units(machine: MachineData, name: str) -> Iterator[str]:
    units_of = [
        p.unit
        for p in parameters_of(machine, structure_of(machine), ("",))
        if p.slot[0] != "frame" and belongs(p.key, name)
    ]
    yield from units_of
    if units_of:
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


def read_known(machine: MachineData, name: str, content: Mapping[str, Any]) -> Known:
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


def _prior(machine: MachineData, value: Any, unit: str) -> tuple[float, float]:
    expected = f'a value and its standard deviation, such as "0 ± 20 {unit}"'
    match = _PRIOR.fullmatch(value) if isinstance(value, str) else None
    parts = [number_and_unit(match[x]) for x in ("mean", "std")] if match else [None]
    if None in parts:
        raise UnfitEffectError("prior", shown(str(value)), expected)
    (mean, unit_of_mean), (std, of) = parts  # type: ignore[misc]
    if not std > NONE:
        raise UnfitEffectError("prior", shown(str(value)), expected.replace("deviation", "deviation above 0"))
    factor = factor_of(machine, "prior", of, unit)
    return mean * (factor_of(machine, "prior", unit_of_mean, unit) if unit_of_mean else factor), std * factor


def _bounds(machine: MachineData, value: Any, unit: str) -> tuple[float, float]:
    expected = f'two values, the lower one first, such as ["0 {unit}", "60 {unit}"]'
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise UnfitEffectError("bounds", shown(str(value)), expected)
    ends = []
    for x in value:
        number = number_and_unit(x) if isinstance(x, str) else (float(x), "") if _is_number(x) else None
        if number is None:
            raise UnfitEffectError("bounds", shown(str(x)), expected)
        ends.append(number[0] * factor_of(machine, "bounds", number[1], unit))
    low, high = ends
    if not low < high or (math.isinf(low) and math.isinf(high)):
        raise UnfitEffectError("bounds", shown(str(value)), expected)
    return low, high


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value)


def factor_of(machine: MachineData, key: str, text: str, default_unit: str) -> float:
    """Return the factor from a unit, or that of the machine file where it is empty, to internal units.

    Raises
    ------
    UnfitEffectError
        When it does not measure what the own unit of the parameter does.
    """
    _, dimension = unit_factor(default_unit, machine.length_unit)
    if not text:
        return machine.file_factor(dimension)
    try:
        unit = parse_unit(text)
    except UnitError as error:
        raise UnfitEffectError(key, error.found, error.expected) from None
    if not unit.dimension.fits(dimension):
        raise UnfitEffectError(key, f"unit {shown(text)}", f"one such as {default_unit}")
    return unit.factor(machine.length_unit)


# ties --------------------------------------------------------------------------------------------------------------

TIED = {"axis", "point", "geometry", "e"}
"""What may be tied: parts of the machine. Targets, frames and their shifts are of a set-up."""


@dataclass(frozen=True)
class Tied:
    """A parameter that others determine."""

    parameter: Parameter
    text: str
    """The combination as it was stated."""
    factors: tuple[tuple[int, float], ...]
    """Numbers of the others, among the parameters that are not tied, and their factors; internal units."""
    constant: float
    """Internal units."""


def tied_parameters(
    machine: MachineData, parameters: Sequence[Parameter]
) -> tuple[tuple[Parameter, ...], tuple[Tied, ...]]:
    """Return the parameters of a model that are not tied, and those that are.

    A parameter of an effect that the model does not have is zero in a combination: without the effect there is neither.
    """
    free = tuple(p for p in parameters if p.key not in machine.ties)
    number = {p.key: i for i, p in enumerate(free)}
    tied = []
    for p in parameters:
        if tie := machine.ties.get(p.key):
            factors = tuple((number[key], float(x)) for key, x in tie.factors if key in number)
            tied.append(Tied(p, tie.text, factors, float(tie.constant)))
    return free, tuple(tied)


def parameters_to_tie(machine: MachineData) -> dict[str, Parameter]:
    """Return the parameters of a machine that may be tied, and to which others may be, by their keys."""
    parameters = parameters_of(machine, structure_of(machine), ("",))
    return {p.key: p for p in parameters if str(p.slot[0]).partition(".")[0] in TIED}


def read_tie(machine: MachineData, key: str, text: str) -> Combination:
    """Return the tie of a parameter to others, as a machine file says it.

    Raises
    ------
    UnexpectedError
        With what was found and what was expected.
    """
    known = parameters_to_tie(machine)
    units = {name: unit_factor(p.unit, machine.length_unit)[1] for name, p in known.items()}
    if key not in known:
        raise UnexpectedError("no such parameter", suggestion(key, list(known)))
    if known[key].hold is not None:
        raise UnexpectedError("a parameter that is held", "one of the two, hold or a tie")
    if entry := next((name for name in machine.known if belongs(key, name)), None):
        expected = "a free parameter: take that entry out of [known] first"
        raise UnexpectedError(f"given together with {shown(entry)} in [known]", expected)
    if tied_key := next((name for name, tie in machine.ties.items() if key in dict(tie.factors)), None):
        raise UnexpectedError(f"a tie of what {shown(tied_key)} is tied to", "that of another parameter")
    tie_read = combination(text, units, units[key], machine.length_unit, "parameter")
    if not tie_read.factors:
        raise UnexpectedError("a constant", "hold, or another parameter, such as '2 * J3.gravity_windup.k'")
    for name, _ in tie_read.factors:
        if name == key or name in machine.ties:
            what = "itself" if name == key else f"{shown(name)}, which is tied, too"
            raise UnexpectedError(what, "parameters that are not tied")
    return tie_read
