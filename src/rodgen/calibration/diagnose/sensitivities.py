"""The derivative of the readings by every component of every joint, from which the columns of candidates are made.

An effect adds a formula to a component of a place: the reading of a joint, a translation or a rotation behind it, the
frame. To first order it changes the readings by the derivative with respect to that component, times the formula. So
one model with a bare parameter at every component, evaluated once, serves all effects that are such products, those
of the catalogue and those outside of it. Effects that are not such a product (moments of the weight, beams,
the geometry, the instrument) are in that model themselves, at zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.noise.frame_motion import frame_motion
from rodgen.calibration.noise.sampled_rows import sample_of
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.data.observations import Observations
from rodgen.errors import RodgenError
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.effects.custom import own_effect
from rodgen.machines.effects.rules import check_effect
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.model import Model
from rodgen.machines.structure import CLOSED, GRAVITY, TENSION
from rodgen.statistics.thresholds import SELECTION

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel

__all__ = ["MOMENTS", "Place", "Sensitivities", "catalogue_effects"]

Array: TypeAlias = NDArray[np.float64]
Place: TypeAlias = str | None

BARE = "bare_"
"""Prefix of the names of the bare parameters."""
TURNS = ("rx", "ry", "rz")
MOTIONS = ("tx", "ty", "tz", *TURNS)
DIRECT = frozenset({"axis", "point", "target", "frame_shift", "factor", "factors", "lift", "sag"}) | CLOSED
"""Components of effects that are in the model themselves, ..."""
MOMENTS = frozenset({"M", "M_perp", "M_across", "M_guide"})
"""... as do effects whose formula has one of these."""


def catalogue_effects(machine: Machine, observations: Observations) -> list[Effect]:
    """Return every effect of the catalogue, at every place, that may be added and whose columns are in the data.

    Parameters
    ----------
    machine : Machine
        The effects that it has are left out.
    observations : Observations
    """
    return [
        effect
        for definition in CATALOGUE
        for place in _places(machine, definition.at)
        for effect in _added(machine, definition.name, place)
        if _varies_in(machine, effect, observations)
    ]


def _places(machine: Machine, at: frozenset[str]) -> Iterator[Place]:
    if "machine" in at:
        yield None
    yield from (joint.name for joint in machine.joints if joint.type in at)
    if "target" in at:
        yield from (target.name for target in machine.targets)


def _added(machine: Machine, name: str, place: Place) -> Iterator[Effect]:
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
    if kind in {"revolute", "prismatic", "leg"}:
        j = machine.number_of(str(effect.place))
        if "T" in names and effect.place not in o.temperature:
            return False
        if "v" in names and not np.any(o.v[:, j]):
            return False
        if "s" in names and not o.approach_known[j]:
            return False
        if "q_before" in names and not np.ptp(o.q[:, j - 1]) > 0:
            return False
        if names & GRAVITY and not _gravity_turns(machine, o, j):
            return False
        if names & {"zeta", "L", "P1", "P2", "P3", "P4"} and not o.travel[j, 1] > o.travel[j, 0]:
            return False
    if "t" in names and (o.t is None or np.ptp(o.t) == 0):
        return False
    return not ("F" in names and o.load is None)


def _gravity_turns(machine: Machine, o: Observations, j: int) -> bool:
    """Return whether gravity turns as a joint sees it; else what it bends is bent once and for all."""
    return any(
        joint.revolute
        and np.ptp(o.q[:, k]) > 0
        and np.linalg.norm(np.cross(joint.axis, machine.gravity)) > SELECTION.weightless
        for k, joint in enumerate(machine.joints[:j])
    )


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """A fit's residuals and their derivatives with respect to everything that an effect may change.

    Attributes
    ----------
    fit : FittedModel
        At whose parameters the derivatives are taken.
    rows : ndarray of int, shape (n,)
        Rows of the fit's observations that decisions are made on; no outliers.
    observations : Observations
        These rows.
    weight, residual : ndarray, shape (n, m)
        Weights, and weighted residuals.
    columns : ndarray, shape (n, m, parameters)
        Derivatives of the weighted residuals.
    index : mapping of str to int
        Number of each parameter's column, by its key.
    words : dict
        What formulas may use at each place, once it was asked for.
    """

    fit: FittedModel
    rows: NDArray[np.int_]
    observations: Observations
    weight: Array
    residual: Array
    columns: Array
    index: Mapping[str, int]
    words: dict[Place, dict[str, Any]] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, fit: FittedModel, effects: Sequence[Effect] = ()) -> Sensitivities:
        """Return the sensitivities at a fit.

        Parameters
        ----------
        fit : FittedModel
        effects : sequence of Effect
            Candidates; those that are not such a product are in the model themselves.
        """
        machine = fit.machine
        direct = [effect for effect in effects if is_direct(effect)]
        whole = replace(machine, effects=(*machine.effects, *direct, *_bare(machine)))
        rows = sample_of(fit.observations, ~fit.outliers)
        o = fit.observations if len(rows) == fit.observations.n else fit.observations.take(rows)
        model = Model(whole, fit.problem.model.travel, o.run_names, compiled=False)
        problem = Problem(model, o)
        problem.set_weight((fit.problem.weight / fit.problem.base_weight)[rows, 0])
        theta, found = (
            model.start(),
            dict(zip((p.key for p in fit.parameters), fit.solution.theta, strict=True)),
        )
        for i, parameter in enumerate(model.parameters):
            theta[i] = found.get(parameter.key, theta[i])
        with one_thread_in_blas():
            columns = problem.jacobian(theta, fit.solution.frame)
            residual = problem.residuals(theta, fit.solution.frame, weighted=True)
        columns = np.moveaxis(
            np.ascontiguousarray(np.moveaxis(columns, 2, 0)), 0, 2
        )  # a column is in one piece
        index = {parameter.key: i for i, parameter in enumerate(model.parameters)}
        return cls(fit, rows, o, problem.weight, residual, columns, index)

    @property
    def model(self) -> Array:
        """Derivatives with respect to the parameters that the fit can change, (n, m, p)."""
        moving = [self.index[self.fit.parameters[i].key] for i in self.fit.moving]
        return np.asarray(self.columns[:, :, moving])

    @cached_property
    def frame(self) -> Array:
        """Derivatives with respect to a motion of the whole frame, (n, m, 6), or (n, m, 3) of directions."""
        model, solution = self.fit.problem.model, self.fit.solution
        return frame_motion(model, self.observations, solution.theta, solution.frame, self.weight)

    def component(self, place: Place, component: str) -> Array | None:
        """Return the derivative with respect to a component of a place, (n, m); None where the place lacks it.

        A leg of a closed chain has a reading only.

        Parameters
        ----------
        place : str or None
            A joint; None for the whole machine.
        component : str
            ``"reading"`` of a joint, or one of ``tx ty tz rx ry rz``.
        """
        key = f"{BARE}{component}.a" if place is None else f"{place}.{BARE}{component}.a"
        return None if key not in self.index else np.asarray(self.columns[:, :, self.index[key]])

    def residual_of(self, fit: FittedModel) -> Array:
        """Return the weighted residuals, (n, m), of another fit to the same observations in the same rows."""
        found = fit.problem.residuals(fit.solution.theta, fit.solution.frame, weighted=True)
        return np.asarray(found[self.rows])


def is_direct(effect: Effect) -> bool:
    """Return whether an effect is in the model itself, because it is not a component times a number per row."""
    definition = effect.definition
    names = definition.formula.names
    return not definition.own and (
        definition.component in DIRECT or bool(names & (MOMENTS | GRAVITY | {TENSION}))
    )


def _bare(machine: Machine) -> Iterator[Effect]:
    measurand = machine.measurand
    motions = MOTIONS if measurand.moving else TURNS
    joints = {joint.name: joint.type for joint in machine.joints}

    def bare(place: Place, at: str, component: str) -> Effect:
        angle = component in TURNS or (component == "reading" and at == "revolute")
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
        for component in ("reading", *(() if at == "leg" else motions)):
            if at == "leg" or measurand.moving or component != "reading" or at == "revolute":
                yield bare(name, at, component)
