"""The derivative of the readings by every component of every joint, from which the columns of candidates are made.

An effect adds a formula to a component of a place: the reading of a joint, a translation or a rotation behind it, the
frame. To first order it changes the readings by the derivative with respect to that component, times the formula. So
one model with a bare parameter at every component, evaluated once, serves all effects that are such products, those
of the catalogue and those outside of it. Effects that are not such a product (moments of the weight, beams,
the geometry, the instrument) are in that model themselves, at zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.dependence import FitRows, sample_of
from rodgen.calibration.possible_effects import bare_effects, bare_key, problem_with
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.machines.effects.catalogue import GEOMETRY
from rodgen.machines.machine import Effect
from rodgen.machines.parameters import Parameter
from rodgen.machines.structure import CLOSED, GRAVITY, TENSION

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit

Place: TypeAlias = str | None

DIRECT = (
    frozenset(
        {"axis", "point", "target", "remounting", "frame_shift", "factor", "axes", "plate", "lift", "sag"}
    )
    | CLOSED
)
"""Components of effects that are in the model themselves, ..."""
NUMBER = "geometry"
"""Name of a number of a closed chain's geometry as a candidate, whose place is the number's own name."""
MOMENTS = frozenset({"M", "M_perp", "M_across", "M_guide"})
"""... as do effects whose formula has one of these."""


@dataclass(frozen=True, eq=False)
class Sensitivities(FitRows):
    """A fit's residuals and their derivatives with respect to everything that an effect may change."""

    index: Mapping[str, int]
    """Number of each parameter's column, by its key."""
    exact: frozenset[tuple[str, Place]] = frozenset()
    """Name and place of the dimensions in the model that is linearised: their columns have no error of higher order."""
    of_exact: Array | float = 0.0
    """What these dimensions explain of the weighted residuals, (n, m)."""
    words: dict[Place, dict[str, Any]] = field(default_factory=dict, repr=False)
    """What formulas may use at each place, once it was asked for."""

    @classmethod
    def of(cls, fit: Fit, effects: Sequence[Effect] = (), at: Fit | None = None) -> Sensitivities:
        """Return the sensitivities at a fit.

        Parameters
        ----------
        effects : sequence of Effect
            Candidates; those that are not such a product are in the model themselves.
        at : Fit, optional
            The fit with some of the candidates in its model, at which all is linearised. The residuals are those that
            its derivatives predict without these candidates.
        """
        about = fit if at is None else at
        there = {effect.identity for effect in about.machine.effects}
        direct = [effect for effect in effects if is_direct(effect) and effect.identity not in there]
        rows = sample_of(fit.observations, ~fit.outliers)
        problem, theta = problem_with(about, [*direct, *bare_effects(fit.machine)], rows)
        with one_thread_in_blas():
            columns = problem.jacobian(theta, about.solution.frame)
            # effects of size zero change no residual
            alone = about.problem.take(rows)
            residual = alone.residuals(about.solution.theta, about.solution.frame, weighted=True)
        columns = np.moveaxis(
            np.ascontiguousarray(np.moveaxis(columns, 2, 0)), 0, 2
        )  # a column is in one piece
        index = {parameter.key: i for i, parameter in enumerate(problem.model.parameters)}
        known = {p.key for p in fit.parameters}
        new = [p for p in about.parameters if p.key not in known]
        exact = [p for p in new if p.effect in {None, *GEOMETRY}]
        names = [(p.effect, p.place) if p.effect else (NUMBER, p.key.split(".")[1]) for p in exact]

        def explained(by: Sequence[Parameter]) -> Array:
            of = [index[p.key] for p in by]
            return np.asarray(-columns[:, :, of] @ theta[of])

        return cls(
            fit,
            rows,
            problem.observations,
            problem.weight,
            residual + explained(new),
            columns,
            index,
            frozenset(names),
            explained(exact),
        )

    @property
    def model(self) -> Array:
        """Derivatives with respect to the parameters that the fit can change, (n, m, p)."""
        moving = [self.index[self.fit.parameters[i].key] for i in self.fit.moving]
        return np.asarray(self.columns[:, :, moving])

    @property
    def middle(self) -> Array:
        """The middle of the places that were measured, (3,)."""
        solution = self.fit.solution
        places = Problem(self.fit.problem.model, self.observations).places(solution.theta, solution.frame)
        return np.asarray(places.mean(axis=0))

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
        key = bare_key(place, component)
        return None if key not in self.index else np.asarray(self.columns[:, :, self.index[key]])


def is_direct(effect: Effect) -> bool:
    """Return whether an effect is in the model itself, because it is not a component times a number per row."""
    definition = effect.definition
    names = definition.formula.names
    return not definition.own and (
        definition.of_all_legs
        or definition.component in DIRECT
        or bool(names & (MOMENTS | GRAVITY | {TENSION}))
    )
