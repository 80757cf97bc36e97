"""Whether an effect of the catalogue has the same form as a term: what the catalogue explains is not outside of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rodgen.calibration.diagnose.forms.dictionary import Factor, Term
from rodgen.data.drivers import Driver
from rodgen.machines.machine import Machine

_OF_ANY_READING = {
    (("joint", "power", 1),),
    (("approach", "power", 1),),
    (("approach", "power", 1), ("joint", "power", 1)),
    (("velocity", "power", 1),),
    (("temperature", "power", 1),),
}
_COUPLED = (("joint", "power", 1),)
_EXPANSION = (("joint", "power", 1), ("temperature", "power", 1))
_OF_A_LEG = {
    (("joint", "power", 1),),
    (("approach", "power", 1),),
    (("temperature", "power", 1),),
    _EXPANSION,
}
"""A leg's length changes by a small part of itself, so that what grows by T alone is what grows by T q."""
_OF_FRAME = {(("time", "power", 1),), (("time", "decay", 1),)}
_HARMONICS = 2
"""Of an encoder, and of error motions."""
_STRAIGHTNESS, _ANGULAR = 4, 3
"""Degrees of a slide's errors."""
_ACROSS = 0.7
"""Cosine of the angle to the axis of what is still across it: a slide has no straightness along its way."""
_SAME = 0.02
"""Relative difference of two frequencies that are taken for one."""


def is_catalogued(
    term: Term, place: str | None, component: str, drivers: Sequence[Driver], machine: Machine
) -> bool:
    """Return whether an effect of the catalogue is this term at this place, along some direction."""
    parts = tuple(sorted((drivers[f.driver].kind, f.kind, f.order) for f in term.factors))
    others = {drivers[f.driver].joint for f in term.factors} - {None, place}
    if others:
        return component == "reading" and parts == _COUPLED and others == _before(place, machine)
    if place is None:
        return parts in _OF_FRAME
    if machine.kind_of(place) == "leg":
        return parts in _OF_A_LEG
    turns = machine.kind_of(place) == "revolute"
    waves = len(parts) == 1 and parts[0][:2] in {("joint", "harmonic"), ("joint", "wave")}
    if component == "reading":
        if waves:
            return _is_wave_of_reading(term.factors[0], place, turns, machine)
        return parts in _OF_ANY_READING or (parts == _EXPANSION and not turns)
    if parts == (("temperature", "power", 1),):
        return turns and component[0] == "t"
    if len(parts) != 1 or parts[0][0] != "joint":
        return False
    _, kind, order = parts[0]
    if turns:
        return kind == "harmonic" and order <= _HARMONICS
    if component[0] == "t":
        along = abs(machine.joint(place).axis["xyz".index(component[1])])
        return kind in {"power", "series"} and order <= _STRAIGHTNESS and along < _ACROSS
    return kind in {"power", "series"} and order <= _ANGULAR


def _before(place: str | None, machine: Machine) -> set[str | None]:
    """Return the joint that a joint may be coupled with, if there is one."""
    if place is None or machine.kind_of(place) != "revolute":
        return set()
    before = [machine.joints[k] for k in machine.carriers(machine.number_of(place))[-1:]]
    return {joint.name for joint in before if joint.revolute}


def _is_wave_of_reading(factor: Factor, place: str, turns: bool, machine: Machine) -> bool:
    """Return whether it is of an encoder, or of a drive of the period that is given, or of any where none is."""
    if turns and factor.kind == "harmonic" and factor.order <= _HARMONICS:
        return True
    period = machine.joint(place).period
    frequency = float(factor.order) if factor.kind == "harmonic" else factor.values[0]
    return period is None or abs(frequency * period / (2 * np.pi) - 1) < _SAME
