"""A model and one inside it, on the same readings: what the tests of the further parameters work on."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.noise.correlation import FitRows
from rodgen.calibration.problem import Problem
from rodgen.calibration.solve.least_squares import Solution, minimise

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel


def with_the_same_weights(smaller: FittedModel, larger: FittedModel) -> tuple[FittedModel, FittedModel]:
    """Return both fits with the weights at later joints that either took in: one model is inside the other then.

    Each fit takes in the weights that its data call for, and that of the model without an effect may call for some that
    imitate it.
    """
    weights = smaller.later_weights | larger.later_weights
    return smaller.with_weights(weights), larger.with_weights(weights)


def further_combinations(smaller: FittedModel, larger: FittedModel) -> int:
    """Return how many combinations of parameters the data determine that a larger model has in addition.

    A combination of old parameters may be at the edge of being determined, and be so in one of the fits only: the ranks
    then differ by less than what is new. A new parameter that is determined by itself counts all the same.
    """
    inside, fixed = {smaller.parameters[i].key for i in smaller.moving}, larger.determinacy
    known = [
        i for i in larger.moving if not fixed.undetermined[i] and larger.parameters[i].key not in fixed.held
    ]
    alone = sum(larger.parameters[i].key not in inside for i in known)
    return max(fixed.rank - smaller.determinacy.rank, alone)


class NestedModels:
    """Residuals of two fits on the rows that the larger one believes, and their derivatives.

    Parameters
    ----------
    smaller, larger : FittedModel
        To the same observations, with the same weights at later joints (`with_the_same_weights`).

    Attributes
    ----------
    larger : FittedModel
    fall : float
        By how much the sum of squares is smaller with the larger one.
    rows : FitRows
        Of the larger one.
    residual : ndarray, shape (n, m)
        Of the smaller one, weighted, on these rows.
    model, new, own : ndarray, shape (n, m, parameters)
        Derivatives with respect to the parameters of the smaller one, to the further ones of the larger, and to those
        of the latter that are not searched for.
    further : list of int
        Numbers of the further parameters.
    searched : int
        How many of these are searched for.
    added : list of Effect
        Effects of the larger one only.
    """

    def __init__(self, smaller: FittedModel, larger: FittedModel) -> None:
        problem, solution = _on_the_same_rows(smaller, larger)
        self.larger = larger
        self.fall = max(solution.cost - larger.chi_square, 0.0)
        self.rows = FitRows.of(larger)
        self._smaller, self._problem = smaller, problem
        self._at = solution.theta, solution.frame
        inside = {smaller.parameters[i].key for i in smaller.moving}
        self.further = [i for i in larger.moving if larger.parameters[i].key not in inside]
        self._own = [i for i in self.further if larger.parameters[i].searched is None]
        self.searched = len(self.further) - len(self._own)
        there = {effect.identity for effect in smaller.machine.effects}
        self.added = [effect for effect in larger.machine.effects if effect.identity not in there]

    # derivatives are found where a test asks for them: that of independent readings needs none

    @cached_property
    def _on_rows(self) -> Problem:
        some = Problem(self._problem.model, self.rows.observations)
        some.set_weight((self.rows.weight / some.base_weight)[:, 0])
        return some

    @cached_property
    def residual(self) -> Array:
        """Residuals of the smaller model, weighted."""
        return self._on_rows.residuals(*self._at, weighted=True)

    @cached_property
    def model(self) -> Array:
        """Derivatives by the parameters of the smaller model."""
        return self._on_rows.jacobian(*self._at)[:, :, list(self._smaller.moving)]

    @property
    def new(self) -> Array:
        """Derivatives by the further parameters."""
        return self.rows.jacobian[:, :, self.further]

    @property
    def own(self) -> Array:
        """Those of the further parameters that are not searched for."""
        return self.rows.jacobian[:, :, self._own]

    @property
    def of_time(self) -> bool:
        """Whether all that is new follows the time, as a walk does."""
        return bool(self.added) and all(effect.definition.follows_time for effect in self.added)


def _on_the_same_rows(smaller: FittedModel, larger: FittedModel) -> tuple[Problem, Solution]:
    """Return the smaller model fitted to the rows that the larger one believes."""
    if np.array_equal(smaller.outliers, larger.outliers):
        return smaller.problem, smaller.solution
    problem = Problem(smaller.problem.model, smaller.observations)
    problem.leave_out(larger.outliers)
    return problem, minimise(problem, smaller.solution.theta, smaller.solution.frame, smaller.free)
