"""Ties: parameters that are linear combinations of others, so that a fit has fewer to find."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rodgen.data.units import unit_factor
from rodgen.errors import UnexpectedError, shown, suggestion
from rodgen.machines.effects.rules import UnfitEffectError
from rodgen.machines.linear import combination
from rodgen.machines.parameters import Parameter, parameters_of
from rodgen.machines.parts import Tie, belongs

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

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
    machine: Machine, parameters: Sequence[Parameter]
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


def parameters_to_tie(machine: Machine) -> dict[str, Parameter]:
    """Return the parameters of a machine that may be tied, and to which others may be, by their keys."""
    found = parameters_of(machine, machine.structure, ("",))
    return {p.key: p for p in found if str(p.slot[0]).partition(".")[0] in TIED}


def read_tie(machine: Machine, key: str, text: str) -> Tie:
    """Return the tie of a parameter to others, as a machine file says it.

    Raises
    ------
    UnfitEffectError
        With what was found and what was expected.
    """
    known = parameters_to_tie(machine)
    units = {name: unit_factor(p.unit, machine.length_unit)[1] for name, p in known.items()}
    if key not in known:
        raise UnfitEffectError("", "no such parameter", suggestion(key, list(known)))
    if known[key].hold is not None:
        raise UnfitEffectError("", "a parameter that is held", "one of the two, hold or a tie")
    if entry := next((name for name in machine.known if belongs(key, name)), None):
        raise UnfitEffectError(
            "", f"given together with {shown(entry)} in [known]", "that of a free parameter"
        )
    if other := next((name for name, tie in machine.ties.items() if key in dict(tie.factors)), None):
        raise UnfitEffectError("", f"a tie of what {shown(other)} is tied to", "that of another parameter")
    try:
        own = combination(text, units, units[key], machine.length_unit, "parameter")
    except UnexpectedError as error:
        raise UnfitEffectError("", error.found, error.expected) from None
    if not own.factors:
        raise UnfitEffectError(
            "", "a constant", "hold, or another parameter, such as '2 * J3.gravity_windup.k'"
        )
    for name, _ in own.factors:
        if name == key or name in machine.ties:
            what = "itself" if name == key else f"{shown(name)}, which is tied, too"
            raise UnfitEffectError("", what, "parameters that are not tied")
    return Tie(text, own.factors, own.constant)
