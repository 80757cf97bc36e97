"""Models of one machine that differ in the effects that they have, each fitted to the data.

All have one structure, that of the machine with every effect in question: what a model does not have is held at zero.
So one set of kernels serves all of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.fit import fitted
from rodgen.calibration.fitted import Fit
from rodgen.calibration.plan.design import Linearized
from rodgen.calibration.problem import Problem
from rodgen.errors import InputFileError
from rodgen.machines.model import Model
from rodgen.machines.structure import row_effects

if TYPE_CHECKING:
    from rodgen.machines.machine import Effect, Machine
    from rodgen.machines.observations import Observations
    from rodgen.machines.parts import EffectIdentity

LARGEST_TURN = 0.1
"""Angle of an effect, in radians, that no machine has: a loose mount is off by a hundredth of it, and a fit that
ends there has turned an axis round."""
FEWEST_RESIDUAL_DOF = 10
"""Degrees of freedom from which residuals larger than the stated noise replace it: with fewer, chance alone makes
their mean square half as large again (its relative standard deviation is the square root of 2/10)."""


@dataclass(frozen=True, eq=False)
class Rival:
    """A model that may be the true one."""

    effects: tuple[Effect, ...]
    """Those in question that it has."""
    fit: Fit
    own: int
    """Number of its free parameters that belong to these effects."""

    @property
    def plausible(self) -> bool:
        """Whether every angle of an effect is as small as on a machine: a fit may end where all is turned round."""
        found = self.fit
        turns = [i for i in found.free if found.parameters[i].effect and found.parameters[i].unit == "arcsec"]
        return all(abs(found.values[i]) < LARGEST_TURN for i in turns)

    @cached_property
    def index(self) -> NDArray[np.int_]:
        """Numbers of the free parameters."""
        return np.asarray(self.fit.free, int)

    @cached_property
    def information(self) -> Array:
        """JᵀJ of the data, (p, p)."""
        solution = self.fit.solution
        _, square, _ = self.fit.problem.normal_equations(solution.theta, solution.frame)
        return np.asarray(square[np.ix_(self.index, self.index)])


class Rivals:
    """Models with different ones of some effects.

    Parameters
    ----------
    machine : Machine
        With the effects that all of them have.
    observations : Observations
        The data without outliers.
    effects : sequence of Effect
        All that are in question. What the machine cannot have together with the others is left out, see `refused`.

    Attributes
    ----------
    machine : Machine
        With all effects.
    refused : list of str
        Sentences on the effects that were left out.
    """

    def __init__(self, machine: Machine, observations: Observations, effects: Sequence[Effect]) -> None:
        self.observations = observations
        self.refused: list[str] = []
        self.asked: dict[EffectIdentity, Effect] = {}
        for effect in effects:
            try:
                machine = machine.with_effect(effect)
            except InputFileError as error:
                self.refused.append(f"{effect.title} is left out: {error.found}.")
                continue
            self.asked[effect.identity] = effect
        self.machine = machine
        self._made: dict[frozenset[EffectIdentity], Rival] = {}

    def rival(self, places: Iterable[EffectIdentity]) -> Rival:
        """Return the model with some of the effects, fitted."""
        key = frozenset(places)
        if key not in self._made:
            self._made[key] = self._fitted(key)
        return self._made[key]

    def _fitted(self, key: frozenset[EffectIdentity]) -> Rival:
        effects = [
            e if e.identity in key or e.identity not in self.asked else self._silent(e)
            for e in self.machine.effects
        ]
        found = fitted(replace(self.machine, effects=tuple(effects)), self.observations)
        own = sum(
            (found.parameters[i].effect, found.parameters[i].place) in key
            for i in found.free
            if found.parameters[i].effect
        )
        return Rival(tuple(e for place, e in self.asked.items() if place in key), found, own)

    def _silent(self, effect: Effect) -> Effect:
        """Return an effect that does nothing."""
        hold = {}
        for name in effect.units(self.machine):
            if effect.given(self.machine, name) is None:
                search = effect.definition.searched.get(name)
                hold[name] = search.before if search else 0.0
        return replace(effect, hold=hold)

    def variance(self, rivals: Sequence[Rival]) -> float:
        """Return the variance of a weighted residual: 1 where the noise is stated, or what the best model says."""
        left = [(r.fit.chi_square, r.fit.degrees_of_freedom) for r in rivals]
        cost, residual_dof = min(left, key=lambda x: x[0] / max(x[1], 1))
        stated = self.observations.sigma is not None
        if residual_dof < (FEWEST_RESIDUAL_DOF if stated else 1):
            return 1.0
        return max(cost / residual_dof, 1.0) if stated else cost / residual_dof

    def uses(self, kind: str, places: Iterable[EffectIdentity]) -> list[int]:
        """Return the joints of which some effects use a column of a kind (``"s"``, ``"v"``, ``"T"``, ...)."""
        chosen = set(places)
        model = Model(self.machine, self.observations.travel, self.observations.run_names)
        found = set()
        for effect, term in zip(row_effects(self.machine), model.structure.terms, strict=True):
            if effect.identity in chosen:
                found |= {of for _, (k, of) in term.columns if k == kind}
        return sorted(x for x in found if isinstance(x, int))

    def linearized(self, rivals: Sequence[Rival], planned: Observations, variance: float) -> list[Linearized]:
        """Return each model linearized at its fit, for readings that are as the first model predicts them."""
        first = rivals[0].fit
        problem = Problem(first.problem.model, planned)
        planned = problem.predicted_observations(first.solution.theta, first.solution.frame)
        found = []
        for rival in rivals:
            solution = rival.fit.solution
            problem = Problem(rival.fit.problem.model, planned)
            residual = problem.residuals(solution.theta, solution.frame, weighted=True)
            jacobian = problem.jacobian(solution.theta, solution.frame)[:, :, rival.index]
            found.append(Linearized(residual / np.sqrt(variance), jacobian / np.sqrt(variance)))
        return found
