"""Effects that may be added to a machine, and the problem with them: the catalogue's, and a bare parameter anywhere."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem import Problem
from rodgen.errors import RodgenError
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.effects.custom import own_effect
from rodgen.machines.effects.definition import OF_A_LOOP, TURNING
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.model import Model
from rodgen.machines.observations import Observations
from rodgen.machines.rules import check_effect
from rodgen.machines.structure import GRAVITY
from rodgen.statistics.thresholds import SELECTION

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit

BARE = "bare_"
"""Prefix of the names of the bare parameters."""
TURNS = ("rx", "ry", "rz")
MOTIONS = ("tx", "ty", "tz", *TURNS)
"""Components of the motion of what a joint carries."""


def catalogue_effects(machine: Machine, observations: Observations) -> list[Effect]:
    """Return every effect of the catalogue, at every place, that may be added and whose columns are in the data.

    Parameters
    ----------
    machine : Machine
        The effects that it has are left out.
    """
    return [
        effect
        for definition in CATALOGUE
        for place in _places(machine, definition.at)
        for effect in _added(machine, definition.name, place)
        if _varies_in(machine, effect, observations)
    ]


def _places(machine: Machine, at: frozenset[str]) -> Iterator[str | None]:
    if at & machine.kinds_of(None):
        yield None
    yield from (joint.name for joint in machine.joints if joint.type in at)
    if "target" in at:
        yield from (target.name for target in machine.targets)


def _added(machine: Machine, name: str, place: str | None) -> Iterator[Effect]:
    try:
        effect = machine.effect(name, place)
        check_effect(machine, effect)
    except RodgenError:  # it cannot stand there
        return
    yield effect


def _varies_in(machine: Machine, effect: Effect, o: Observations) -> bool:
    """Return whether the columns that an effect uses are in the data, and vary where they must."""
    names = frozenset[str]().union(*(f.names for f in effect.definition.formulas))
    kind = machine.kind_of(effect.place)
    if kind in {"revolute", "prismatic", *OF_A_LOOP}:
        j = machine.number_of(str(effect.place))
        if "T" in names and effect.place not in o.temperature:
            return False
        if "v" in names and not np.any(o.v[:, j]):
            return False
        if "acc" in names and not np.ptp(o.covariates.get(f"a_{machine.joints[j].column}", 0.0)) > 0:
            return False
        if "s" in names and not (o.approach_known[j] or o.approach_assumed[j]):
            return False
        if "q_before" in names and not np.ptp(o.q[:, machine.carriers(j)[-1]]) > 0:
            return False
        if names & GRAVITY and not _gravity_turns(machine, o, j):
            return False
        if names & {"zeta", "L", "P1", "P2", "P3", "P4"} and not o.travel[j, 1] > o.travel[j, 0]:
            return False
    if kind == "target" and effect.definition.per_run:
        number = [target.name for target in machine.targets].index(str(effect.place))
        return len(np.unique(o.run[o.target == number])) > 1
    if effect.definition.component in {"factor", "axes"} and not np.ptp(o.reading) > 0:
        return False  # a touch is read as zero, whatever the model says there
    if "t" in names and (o.t is None or np.ptp(o.t) == 0):
        return False
    return not ("F" in names and o.load is None)


def _gravity_turns(machine: Machine, o: Observations, j: int) -> bool:
    """Return whether gravity turns as a joint sees it; else what it bends is bent once and for all."""
    return any(
        machine.joints[k].revolute
        and np.ptp(o.coordinates[:, k]) > 0
        and np.linalg.norm(np.cross(machine.joints[k].axis, machine.gravity)) > SELECTION.weightless
        for k in machine.carriers(j)
    )


def bare_effects(machine: Machine) -> Iterator[Effect]:
    """Yield a bare parameter at every component of every place, and of the whole machine, as effects."""
    measurand = machine.measurand
    motions = MOTIONS if measurand.moving else TURNS
    joints = {joint.name: joint.type for joint in machine.joints}

    def bare(place: str | None, at: str, component: str) -> Effect:
        angle = component in TURNS or (component == "reading" and at in TURNING)
        more: dict[str, Any] = {
            "joints": joints,
            "measurand": measurand,
            "file": machine.name,
            "place": "component",
        }
        units = {"a": "rad" if angle else machine.length_unit}
        return Effect(own_effect(f"{BARE}{component}", component, "a", units, at=at, **more), place)

    for component in motions:
        yield bare(None, "machine", component)
    for name, at in joints.items():
        for component in ("reading", *(() if at in OF_A_LOOP else motions)):
            if at in OF_A_LOOP or measurand.moving or component != "reading" or at == "revolute":
                yield bare(name, at, component)


def bare_key(place: str | None, component: str) -> str:
    """Return the key of the bare parameter at a component of a place; None is the whole machine."""
    return f"{BARE}{component}.a" if place is None else f"{place}.{BARE}{component}.a"


def problem_with(
    fit: Fit, effects: Iterable[Effect], rows: NDArray[np.int_]
) -> tuple[Problem, NDArray[np.float64]]:
    """Return the problem of a fit with further effects, and its parameters there, these at zero.

    Parameters
    ----------
    rows : ndarray of int, shape (n,)
        Rows of the fit's observations.

    Returns
    -------
    (Problem, ndarray of shape (parameters,))
    """
    o = fit.observations if len(rows) == fit.observations.n else fit.observations.take(rows)
    model, theta = model_with(fit, effects)
    problem = Problem(model, o)
    problem.set_weight((fit.problem.weight / fit.problem.base_weight)[rows, 0])
    return problem, theta


def model_with(
    fit: Fit, effects: Iterable[Effect], *, compiled: bool = False
) -> tuple[Model, NDArray[np.float64]]:
    """Return the model of a fit with further effects, and its parameters there, these at zero."""
    whole = replace(fit.machine, effects=(*fit.machine.effects, *effects))
    model = Model(whole, fit.problem.model.travel, fit.observations.run_names, compiled=compiled)
    values = dict(zip((p.key for p in fit.parameters), fit.solution.theta, strict=True))
    start = model.start()
    return model, np.array(
        [values.get(p.key, value) for p, value in zip(model.parameters, start, strict=True)]
    )
