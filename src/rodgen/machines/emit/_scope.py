"""Which part of a fitted model is the machine, and which the instrument that measured it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.errors import InputFileError, shown
from rodgen.machines.measured import DIRECTION, ORIENTATION, POINT, POSE, Measurand
from rodgen.machines.model import Model
from rodgen.machines.parts import Effect
from rodgen.machines.structure import row_effects

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine
    from rodgen.machines.parameters import Parameter


@dataclass(frozen=True)
class Scope:
    """The part of a model that is emitted."""

    machine: Machine
    """In machine axes, with the effects that are its own."""
    model: Model
    """Of this machine."""
    left_out: tuple[tuple[str, str], ...]
    """Parts of the fitted model that are not emitted, and why."""


def scope_of(machine: Machine, travel: Any = None) -> Scope:
    """Return the part of a fitted model that belongs to the machine; see :func:`rodgen.machines.emit.emit`."""
    machine = _without_ties(machine, travel)
    left_out = dict(_left_out(machine))
    reasons = [(shown(effect.title), why) for effect, why in left_out.items()]
    measured, measurand = machine.measured, machine.measurand
    seen: Measurand = POSE if measurand.is_pose else POINT
    if not measurand.moving:
        seen = DIRECTION if measurand.is_direction else ORIENTATION
    estimate = machine.estimate
    if measurand.has_zero:
        estimate = tuple(entry for entry in estimate if entry != "target")
        reasons.insert(0, ("the zero of the angles", "that of the instrument"))
        if measured.frame == "free":
            line = "the axis of the angles" if measured.about else "the vertical"
            reasons.insert(0, (line, "how the instrument stood"))
    elif measured.frame == "free":
        reasons.insert(0, ("the free frame", "where the instrument stood"))
    corrected = replace(
        machine,
        measured=replace(measured, kind=seen.kind, frame="machine", correlation=None),
        estimate=estimate,
        effects=tuple(e for e in machine.effects if e not in left_out),
    )
    model = Model(corrected, travel)
    _check_values(model, model.parameters)
    _check_travel(model)
    return Scope(corrected, model, tuple(reasons))


def _left_out(machine: Machine) -> Iterator[tuple[Effect, str]]:
    for effect in machine.effects:
        component = effect.definition.component
        if component in {"factor", "axes"}:
            yield effect, "the instrument's error, not the machine's"
        elif component == "plate":
            yield effect, "the form of the plate, not the machine's error"
        elif component == "target" and machine.measurand.has_zero:
            yield effect, "how the instrument is mounted"
        elif effect.definition.of_all_legs:
            continue
        elif effect.place is None and component != "lift" and machine.measured.frame == "free":
            yield effect, "it moves the measuring frame, which is free"
        elif component == "remounting" or effect.is_per_run(machine.values):
            yield effect, "different for each set-up"


def _without_ties(machine: Machine, travel: Any) -> Machine:
    """Return the machine with the values of parameters that are tied to others, which may be the instrument's."""
    if not machine.ties:
        return machine
    model = Model(machine, travel)
    _check_values(model, [model.parameters[i] for tied in model.tied for i, _ in tied.factors])
    theta = model.start()
    values = {tied.parameter.key: model.tied_value(tied, theta) for tied in model.tied}
    return replace(machine, values={**machine.values, **values}, ties={})


def _check_values(model: Model, parameters: Iterable[Parameter]) -> None:
    machine, start = model.machine, model.start()
    for parameter in parameters:
        value = start[model.keys[parameter.key]]
        has_value = parameter.hold is not None or parameter.key in machine.values or parameter.optional
        if has_value and np.isfinite(value):
            continue
        raise InputFileError(
            machine.file or machine.name,
            parameter.key,
            f"{value}" if has_value else "no value yet",
            "a fitted machine: fit it to measurements first, or hold this parameter",
        )


def _check_travel(model: Model) -> None:
    machine = model.machine
    for effect, term in zip(row_effects(machine), model.structure.terms, strict=True):
        if term.uses_travel and not np.ptp(model.reach[term.joint]) > 0:
            raise InputFileError(
                machine.file or machine.name,
                f"joint {shown(effect.place)}",
                "no travel",
                f"travel = [lowest, highest], because {effect.name} is measured over it",
            )
