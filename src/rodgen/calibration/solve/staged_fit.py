"""A fit in stages: the geometry first, then the effects, then the weights at later joints that the data call for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rodgen.calibration.problem import Problem
from rodgen.calibration.solve.least_squares import NEAR, Solution, minimise
from rodgen.calibration.solve.starting_values import linear_falls, placed, searched, thinned
from rodgen.errors import InputFileError, RodgenError, joined, shown
from rodgen.machines.model import Model
from rodgen.machines.plausibility import plausibility
from rodgen.machines.structure import row_effects
from rodgen.stages import step
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.thresholds import COST, DETERMINACY, SELECTION

__all__ = ["FitError", "check_travel", "fit_in_stages", "measured_along"]

LEAST_ROWS, ROWS_A_PARAMETER, MORE_ROWS, SAVES_FROM = 256, 8, 16, 3
"""A fit begins with at least so many rows, and so many for each parameter, and goes on with so many times more, or with
all where these are more by no less than the last factor."""


class FitError(RodgenError):
    """A fit that cannot be done, in one sentence."""


def measured_along(model: Model) -> dict[int, str]:
    """Return the joints along whose travel an effect is measured, with the effect."""
    terms = zip(row_effects(model.machine), model.structure.terms, strict=True)
    return {term.joint: effect.title for effect, term in terms if term.uses_travel and term.joint is not None}


def check_travel(problem: Problem) -> None:
    """Refuse an effect along a way that has no length."""
    model = problem.model
    for j, title in measured_along(model).items():
        if not model.reach[j, 1] > model.reach[j, 0]:
            o, joint = problem.observations.data, model.machine.joints[j].name
            found = (
                f"one coordinate in all rows, and no travel in the machine, along which {title} is measured"
            )
            place = f"{o.header_place}, column {shown(joint)}"
            raise InputFileError(o.file, place, found, f"travel of joint {joint}, or rows in which it moves")


def fit_in_stages(problem: Problem) -> tuple[Solution, list[int]]:
    """Fit the geometry, then the effects: first those that start from zero, then those that need a search.

    Of many rows some bring the fit near its end, more of them nearer, and one or two steps with all of them end it.
    """
    estimated = [i for i, p in enumerate(problem.model.parameters) if p.hold is None]
    some, *more = [thinned(problem, rows) for rows in _numbers_of_rows(problem, estimated)]
    solution, free = _stages_of(some, estimated)
    for rows in more:
        solution = minimise(rows, solution.theta, solution.frame, free, progress=step, damping=NEAR)
    if more and not solution.converged:
        solution, free = _stages_of(problem, estimated)
    solution, free = with_later_weights(problem, solution, free)
    return solution, sorted(free)


def _numbers_of_rows(problem: Problem, estimated: Sequence[int]) -> list[int]:
    """Return with how many rows to begin, and go on; the last number is that of all."""
    searches = any(problem.model.parameters[i].searched for i in estimated)
    least = max(LEAST_ROWS, ROWS_A_PARAMETER * len(estimated))
    numbers = [problem.count]
    if problem.rows < problem.count:  # the others are far away
        numbers.insert(0, problem.rows)
    while not searches and not problem.is_closed_chain and numbers[0] >= SAVES_FROM * least:
        numbers.insert(0, min(max(numbers[0] // MORE_ROWS, least), problem.rows))
    return numbers


def _stages_of(problem: Problem, estimated: Sequence[int]) -> tuple[Solution, list[int]]:
    model = problem.model
    theta = model.start()
    base = [i for i in estimated if model.parameters[i].effect is None]

    solution = placed(problem, theta, base)
    if not np.isfinite(solution.cost):
        raise FitError(_not_finite(problem, solution))
    free, known = list(base), model.machine.values
    for new in _stages(model, estimated):
        if any(model.parameters[i].searched and model.parameters[i].key not in known for i in new):
            solution = searched(problem, solution, free, new)
        free += new
        solution = minimise(problem, solution.theta, solution.frame, free, progress=step)
    return solution, free


def _stages(model: Model, estimated: Sequence[int]) -> list[list[int]]:
    """Group the effects' parameters: all that start from zero at once, then effect by effect.

    A weight at a later joint that the data called for before, of fewer effects, is one of them.
    """
    effects: dict[tuple[str | None, str], list[int]] = {}
    for i in estimated:
        p = model.parameters[i]
        if p.effect is not None and (not p.optional or model.machine.values.get(p.key)):
            effects.setdefault((p.place, p.effect), []).append(i)
    formulas = {e.name for e in model.machine.effects if e.definition.own}
    first, later = [], []
    for (_, name), numbers in effects.items():
        if name in formulas or any(model.parameters[i].searched for i in numbers):
            later.append(numbers)
        else:
            first += numbers
    return [stage for stage in (first, *later) if stage]


def with_later_weights(
    problem: Problem, solution: Solution, free: list[int], *, creeps: bool = True
) -> tuple[Solution, list[int]]:
    """Return the solution with the weights at later joints that the data call for, added one after the other.

    The fall of the cost that a linear step promises decides which is tried, and the fall that a fit brings, whether it
    stays: by more than `SelectionPolicy.parameter_cost` variances, as for a parameter in a diagnosis, and by what its
    size costs there. Those of fewer effects, with which the fit began, go by the same rule first.

    Parameters
    ----------
    creeps : bool
        As of :func:`rodgen.calibration.solve.least_squares.minimise`.
    """
    solution, free = _still_called_for(problem, solution, free, creeps)
    waiting = _with_an_arm(problem, solution, free)
    while waiting:
        promised = linear_falls(problem, solution, free, waiting)
        index = waiting.pop(int(np.argmax(promised)))
        parameters = len(free) + 1
        if max(promised) < _needed(problem, solution, parameters):
            break
        better = minimise(problem, solution.theta, solution.frame, [*free, index], creeps=creeps)
        if solution.cost - better.cost < _needed(problem, solution, parameters, index, better.theta[index]):
            continue
        solution, free = better, [*free, index]
    return solution, free


def _needed(
    problem: Problem, solution: Solution, parameters: int, index: int | None = None, value: float = 0.0
) -> float:
    """Return by how much the cost must fall for the last of so many parameters, of that number and value."""
    left = problem.freedom(parameters)
    variance = 1.0 if problem.observations.sigma is not None else solution.cost / left
    of_size = 0.0 if index is None else _size_cost(problem.model, index, value)
    return variance * (SELECTION.parameter_cost(problem.count) + of_size)


def _size_cost(model: Model, index: int, value: float) -> float:
    """Return what a size of an effect's parameter costs in units of chi-square."""
    machine, key = model.machine, model.parameters[index].key
    effect = next(effect for effect in machine.effects if effect.owns(key))
    return plausibility(machine, effect).size_cost([key.rpartition(".")[2]], [value])


def _still_called_for(
    problem: Problem, solution: Solution, free: list[int], creeps: bool
) -> tuple[Solution, list[int]]:
    """Return the solution without the weights at later joints without which the cost hardly rises."""
    while weights := [k for k, i in enumerate(free) if problem.model.parameters[i].optional]:
        _, square, _ = problem.normal_equations(solution.theta, solution.frame)
        scaled, scale = unit_diagonal(square[np.ix_(free, free)])
        values, vectors = eigh(scaled)
        seen = values > DETERMINACY.nothing**2 * values[-1]
        precision = scale**2 / (vectors[:, seen] ** 2 @ (1 / values[seen]))
        theta = solution.theta.copy()
        rises = (theta[free] ** 2 * precision)[weights]
        needs = [_needed(problem, solution, len(free), free[k], theta[free[k]]) for k in weights]
        least = int(np.argmin(rises - needs))
        index, needed = free[weights[least]], needs[least]
        if rises[least] > needed:
            break
        theta[index] = 0.0
        fewer = [i for i in free if i != index]
        without = minimise(problem, theta, solution.frame, fewer, creeps=creeps)
        if without.cost - solution.cost > needed:
            break
        solution, free = without, fewer
    return solution, free


def _with_an_arm(problem: Problem, solution: Solution, free: Sequence[int]) -> list[int]:
    """Return the other weights at later joints that have a lever arm, of a fiftieth of their effect's longest at least.

    Where a later joint's point lies on the axis but for its misalignment, its weight would have to be absurd to do
    anything, and would follow any small wave of the joint.
    """
    parameters = problem.model.parameters
    _, square, _ = problem.normal_equations(solution.theta, solution.frame)
    size = np.sqrt(np.diag(square))
    longest: dict[tuple[str | None, str | None], float] = {}
    for p, length in zip(parameters, size, strict=True):
        longest[p.place, p.effect] = max(length, longest.get((p.place, p.effect), 0.0))
    return [
        i
        for i, p in enumerate(parameters)
        if p.optional
        and p.hold is None
        and i not in free
        and size[i] > COST.visible * longest[p.place, p.effect]
    ]


def _not_finite(problem: Problem, solution: Solution) -> str:
    bad = ~np.isfinite(problem.residuals(solution.theta, solution.frame)).all(axis=1)
    row = int(np.argmax(bad))
    place = problem.observations.data.place(row)
    file = problem.observations.data.file
    formulas = [effect.title for effect in problem.model.machine.effects if effect.definition.own]
    which = f" (check the formula of {joined(formulas)})" if formulas else ""
    if not problem.model.structure.moving and not formulas:
        which = " (a prediction right opposite to its reading? check the signs of axes and targets)"
    if problem.model.machine.kinematics.is_closed and not formulas:
        which = " (is the pose near a singular one, or the geometry far off?)"
    return f"{file}: {place}: the model is not finite here; expected formulas and numbers that are{which}"
