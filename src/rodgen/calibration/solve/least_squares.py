"""Damped least squares (Levenberg 1944, Marquardt 1963; update of the damping after Nielsen 1999).

The normal equations are scaled to a unit diagonal. A direction that the data do not determine has the eigenvalue zero
there; the damping keeps the step in it at zero.

Where readings hardly determine a direction, a fit still goes where the cost is least: a pull towards the machine file
on the way there, as strong as the residuals are large, makes it creep. The values nearest to the file are taken from
there (:func:`nearest`). Only where no way leads back, since noise alone led a fit so far that the model bends, it
begins anew and goes nowhere for noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.file_values import CHANCE, Pull, pulled
from rodgen.machines.effects.definition import StartSearch
from rodgen.machines.model import Frame
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.decompositions import solve

__all__ = [
    "NEAR",
    "NearFile",
    "Solution",
    "minimise",
    "moved",
    "nearest",
]

Array: TypeAlias = NDArray[np.float64]
Equations: TypeAlias = tuple[float, Array, Array]
"""Cost, JᵀJ and Jᵀr."""

MAX_ITERATIONS = 200
SMALL_STEP = 1e-4
"""Steps below this part of a standard deviation, in any direction, are far below what the data can show."""
CLOSE, LIGHTLY = 1e-3, 1e-6
"""A step below this part of a standard deviation, with no more damping than that, is the last one where steps shrink so
fast that the next would be small: it is taken, and the equations are carried there instead of being made again."""
DAMPING, NEAR = 1e-3, 1e-9
"""The first damping: far from the minimum, and near it."""
GROWTH = 2.0
"""Factor on the damping when a step is refused; it doubles with each that follows."""
LEAST_DAMPING, LEAST_FACTOR = 1e-12, 1e-2
"""Steps that do what was predicted lower the damping, by this factor at most; it hinders the last ones otherwise."""
ROUNDING = 1e-13
"""A predicted fall of the cost below this part of it is rounding: sums of many squares are good to about that."""
PATIENCE = 40
"""Iterations of a fit that goes anywhere; with fewer steps a fit ends unless it creeps where only noise leads it."""
CREEPING = 0.25
"""Variances that as many iterations bring together at least where a fit need not creep on: half a standard deviation,
where `CHANCE` is two. A valley that bends allows short steps only, along which the cost may fall for hundreds."""
SHRINKS = 0.1
"""Part that a step leaves of a time constant at least."""
LARGE = 0.1
"""Part of the largest size of a machine that effects have before their sizes count at all: most never get there."""
TOWARDS_FILE, FARTHEST, ARRIVING = 20, 4.0, 1e-4
"""Steps towards the file at most, how far one of them goes, and how short the last one is, in largest deviations."""
STIFFEST = 1e100
"""Entries of such rows are no larger, so that their squares can be summed."""
AS_GOOD = 1e-6
"""Part by which the cost may be larger after them."""
HALVINGS = 6
"""Times that a step is halved on which the legs of a closed chain do not close; then the damping grows."""
EXACT = 1e-30
"""Cost, relative to the sum of squares of the weighted readings, at which data without noise are met."""


@dataclass(frozen=True)
class Solution:
    """Where the cost is least.

    Attributes
    ----------
    theta : ndarray, shape (parameters,)
        Values, internal units; those of the frame are in `frame`.
    frame : Frame
    cost : float
        Sum of squares of the weighted residuals.
    iterations : int
    converged : bool
    crept : bool
        Whether the cost still fell a little, and the fit was not to go on; see :func:`minimise`.
    """

    theta: Array
    frame: Frame
    cost: float
    iterations: int = 0
    converged: bool = True
    crept: bool = False


def minimise(
    problem: Problem,
    theta: Array,
    frame: Frame,
    free: Sequence[int],
    *,
    progress: Callable[[int], object] | None = None,
    max_iterations: int = MAX_ITERATIONS,
    damping: float = DAMPING,
    kept: Array | None = None,
    creeps: bool = True,
) -> Solution:
    """Adjust some parameters until the cost falls no more.

    Parameters
    ----------
    problem : Problem
    theta, frame : ndarray, Frame
        Where to start.
    free : sequence of int
        Numbers of the parameters that are adjusted.
    progress : callable, optional
        Called with the number of each iteration.
    max_iterations : int
        Jacobians at most.
    damping : float
        The first; `NEAR` where the start is so near that the whole step will do.
    kept : ndarray, shape (w, free), optional
        Combinations of the free parameters that stay as they are; see :meth:`NearFile.idle`. Such a fit does not creep.
    creeps : bool
        Whether a fit goes on that creeps along a narrow valley, where the readings hardly tell one place from another.

    Returns
    -------
    Solution
        Its cost is never above that of the start.
    """
    creeps &= kept is None

    def search(patience: int) -> Solution:
        return _descended(
            problem, theta, frame, free, progress, max_iterations, damping, kept, patience, creeps
        )

    begun = problem.starts
    solution = search(PATIENCE)
    ended = problem.starts
    runs_away = NearFile(problem, np.asarray(free, int)).ran_away(solution)
    if runs_away and not _towards_file(problem, solution, free):
        # no way leads back from where noise may have led it: begin anew, and go nowhere for noise
        problem.start_from(begun)
        held = search(0)
        if held.cost - solution.cost < CHANCE * solution.cost / problem.freedom(len(free)):
            return held
    problem.start_from(ended)
    return solution


def _descended(
    problem: Problem,
    theta: Array,
    frame: Frame,
    free: Sequence[int],
    progress: Callable[[int], object] | None,
    max_iterations: int,
    damping: float,
    kept: Array | None,
    patience: int,
    creeps: bool,
) -> Solution:
    """Return where the cost is least; after `patience` iterations no step goes far for what noise may bring."""
    index = np.asarray(free, int)
    block = index[:, None], index
    near = NearFile(problem, index)
    theta = near.within(theta)
    cost, square, gradient = problem.normal_equations(theta, frame)
    if not np.isfinite(cost) and problem.follow(theta, frame):
        cost, square, gradient = problem.normal_equations(theta, frame)
    if not np.isfinite(cost):
        return Solution(theta, frame, np.inf, 0, False)
    if not len(index):
        return Solution(theta, frame, cost)
    floor = EXACT * problem.scale
    left = problem.freedom(len(index))
    small, close = (max(part**2 / left, ROUNDING) for part in (SMALL_STEP, CLOSE))
    growth, iteration = GROWTH, 0
    unit = np.eye(len(index))
    refused = False  # a step, because a closed chain did not close there
    before = 0.0  # what the step before was predicted to bring
    costs = [cost]
    for iteration in range(1, max_iterations + 1):
        scaled, scale = unit_diagonal(square[block])
        downhill = -gradient[index] / scale
        prior = near.stated(cost / left)
        if near.knows_sizes:
            whole = np.linalg.solve(scaled + damping * unit, downhill)
            promised = max(cost - float(2 * whole @ downhill - whole @ scaled @ whole), 0.0)
            prior = np.concatenate([prior, near.sizes(theta[index] + whole / scale, promised / left)])
        if len(prior):
            near.add(prior, scaled, downhill, theta, scale)
        if kept is not None and len(kept):
            across = _across(kept / scale)
            scaled, downhill = across @ scaled @ across + unit - across, across @ downhill
        if iteration > patience:
            whole = solve(scaled + damping * unit, downhill)
            promised = max(cost - float(2 * whole @ downhill - whole @ scaled @ whole), 0.0)
            across = near.across_idle(square, downhill, scale, promised / left)
            scaled, downhill = across @ scaled @ across + unit - across, across @ downhill
        if near.is_bounded and (stopped := near.stopped(theta, downhill)).any():
            downhill[stopped] = scaled[stopped] = scaled[:, stopped] = 0.0
            scaled[stopped, stopped] = 1.0
        held = pulled(prior, near.away(theta)) if len(prior) else 0.0  # what the priors add to the cost
        starts = problem.starts
        while True:
            scaled_step = solve(scaled + damping * unit, downhill)
            predicted = 2 * scaled_step @ downhill - scaled_step @ scaled @ scaled_step
            if predicted <= small * cost or cost <= floor:
                return Solution(theta, frame, cost, iteration, not refused)
            step = np.zeros(len(theta))
            step[index] = scaled_step / scale
            new_theta, new_frame = moved(problem, theta, frame, step)
            new_theta = near.within(new_theta, theta)
            last = growth == GROWTH and damping <= LIGHTLY and predicted <= close * cost
            if last and not near.is_bounded and predicted**2 <= small * cost * before:
                carried = _carried((cost, square, gradient), step)
                problem.keep_equations(new_theta, new_frame, carried)
                return Solution(new_theta, new_frame, carried[0], iteration, not refused)
            new_cost, square, gradient = problem.normal_equations(new_theta, new_frame)
            if problem.is_closed_chain and not np.isfinite(new_cost):
                new_theta, new_frame = _as_far_as_legs_close(problem, theta, frame, step)
                new_cost, square, gradient = problem.normal_equations(new_theta, new_frame)
                refused |= not np.isfinite(new_cost)
            now_held = pulled(prior, near.away(new_theta)) if len(prior) else 0.0
            if new_cost + now_held < cost + held:
                break
            problem.start_from(starts)
            damping *= growth
            growth *= GROWTH
            if damping > 1e20:
                return Solution(theta, frame, cost, iteration, True)
        gain, before = (cost + held - new_cost - now_held) / predicted, predicted
        damping = max(damping * max(LEAST_FACTOR, 1 - (2 * gain - 1) ** 3), LEAST_DAMPING)
        growth, refused = GROWTH, False
        theta, frame, cost = new_theta, new_frame, new_cost
        costs.append(cost)
        if not creeps and iteration > PATIENCE and costs[-1 - PATIENCE] - cost < CREEPING * cost / left:
            return Solution(theta, frame, cost, iteration, crept=True)
        if problem.follow(theta, frame):
            cost, square, gradient = problem.normal_equations(theta, frame)
        if progress:
            progress(iteration)
    return Solution(theta, frame, cost, iteration, False)


class NearFile:
    """Some parameters of a fit, and how the machine file holds them.

    Parameters
    ----------
    problem : Problem
    index : ndarray of int, shape (k,)
        Numbers of the parameters that are adjusted.
    """

    def __init__(self, problem: Problem, index: NDArray[np.int_]) -> None:
        self.problem, self.index, self.file = problem, index, problem.file_values
        self.farthest, self.centre = FARTHEST * self.file.largest[index], self.file.centre[index]
        self.is_bounded = self.file.is_bounded
        parameters = problem.model.parameters
        self.times = [i for i in index if parameters[i].searched is StartSearch.TIME_CONSTANT]

    def away(self, theta: Array) -> Array:
        """Return how far the parameters are from the file, or from the means of their priors, (k,)."""
        return np.asarray(theta[self.index] - self.centre)

    def within(self, theta: Array, before: Array | None = None) -> Array:
        """Return values within their bounds, (parameters,); time constants shrink to a part of those before at most.

        One that passed zero would be the rate of an explosion, from where no step leads back.
        """
        if not self.is_bounded and (before is None or not self.times):
            return theta
        clipped = theta.copy()
        if before is not None:
            clipped[self.times] = np.maximum(theta[self.times], SHRINKS * before[self.times])
        clipped[self.index] = np.clip(
            theta[self.index], self.file.lowest[self.index], self.file.highest[self.index]
        )
        return clipped

    def stopped(self, theta: Array, downhill: Array) -> NDArray[np.bool_]:
        """Return which parameters are at a bound that a step downhill, (k,), would cross, (k,)."""
        at, low, high = theta[self.index], self.file.lowest[self.index], self.file.highest[self.index]
        return np.asarray(((at <= low) & (downhill < 0)) | ((at >= high) & (downhill > 0)))

    def stated(self, variance: float) -> Array:
        """Return the rows of the priors that the file states, (q, k), where readings have that variance."""
        if not self.file.is_prior:
            return np.zeros((0, len(self.index)))
        return self._rows(self.file.precision[self.index], variance)

    def _rows(self, precision: Array, variance: float) -> Array:
        """Return the rows of a prior, (q, k), from the reciprocals of its standard deviations; 0 is no prior."""
        deviation = 1.0 if self.problem.knows_noise else np.sqrt(variance)
        return np.asarray(np.diag(precision)[precision > 0] * deviation)

    @property
    def knows_sizes(self) -> bool:
        """Whether it is known of any of the parameters which size no machine exceeds."""
        return bool(self.file.possible[self.index].any())

    def sizes(self, values: Array, variance: float) -> Array:
        """Return rows of a prior, (q, k), that keeps effects within the sizes of machines; none of small values."""
        possible = self.file.possible[self.index]
        if not np.any(np.abs(values) * possible > LARGE):
            return np.zeros((0, len(self.index)))
        return self._rows(possible, variance)

    @np.errstate(over="ignore", invalid="ignore")  # of a step that goes far too far
    def add(self, rows: Array, scaled: Array, downhill: Array, theta: Array, scale: Array) -> None:
        """Add rows of priors, (q, k), to the scaled equations, in place."""
        seen = np.clip(rows / scale, -STIFFEST, STIFFEST)
        scaled += seen.T @ seen
        downhill -= seen.T @ (seen @ (scale * self.away(theta)))

    def largest(self, square: Array) -> Array:
        """Return the largest deviation of each parameter from the file, (k,)."""
        return self.file.largest_deviations(square.diagonal(), self.problem.total_weight)[self.index]

    def ran_away(self, solution: Solution) -> bool:
        """Return whether a solution is far from the file along directions that the readings hardly determine."""
        away = self.away(solution.theta)
        if not (np.isfinite(solution.cost) and np.any(np.abs(away) > self.farthest)):
            return False
        _, square, _ = self.problem.normal_equations(solution.theta, solution.frame)
        pull = self.pull(square, solution.cost / self.problem.freedom(len(self.index)))
        return pull is not None and bool(np.any(np.abs(pull.unit @ away) > FARTHEST))

    def across_idle(self, square: Array, downhill: Array, scale: Array, variance: float) -> Array:
        """Return the projector of scaled steps, (k, k), across directions along which noise alone would lead far."""
        idle = self.idle(square, variance, downhill * scale) / scale
        if not np.isfinite(idle).all():  # numbers that no machine gives
            return np.eye(len(scale))
        return _across(idle)

    @np.errstate(over="ignore", invalid="ignore")  # of readings that no machine gives
    def idle(self, square: Array, variance: float, downhill: Array | float = 0.0) -> Array:
        """Return the directions along which noise alone would lead far, (w, k): rows, in largest deviations.

        Where nothing leads downhill, those of which the readings say less than the file.
        """
        rows = self.stated(variance)
        block = square[self.index[:, None], self.index] + rows.T @ rows
        return self.file.idle(
            block, self.largest(square), np.broadcast_to(downhill, len(self.index)), variance
        )

    def pull(self, square: Array, variance: float) -> Pull | None:
        """Return the pull towards the file, None where the readings hold all.

        Parameters
        ----------
        square : ndarray, shape (parameters, parameters)
            Normal equations of all parameters.
        variance : float
            Of a weighted reading.
        """
        if not np.isfinite(square).all():
            return None
        rows = self.stated(variance)
        block = square[self.index[:, None], self.index] + rows.T @ rows
        return self.file.pull(block, self.largest(square), self.file.anchored[self.index], variance)


def _carried(equations: Equations, step: Array) -> Equations:
    """Return the equations after a step, to first order."""
    cost, square, gradient = equations
    there = square @ step
    return max(cost + float(step @ (2 * gradient + there)), 0.0), square, gradient + there


def _across(rows: Array) -> Array:
    """Return the projector, (k, k), of steps that change nothing of some combinations, (w, k)."""
    basis, _ = np.linalg.qr(rows.T)
    return np.asarray(np.eye(len(basis)) - basis @ basis.T)


def nearest(problem: Problem, solution: Solution, free: Sequence[int]) -> Solution:
    """Return the values nearest to the machine file, of those that fit as well as a solution does.

    Parameters
    ----------
    problem : Problem
    solution : Solution
        Where a fit ended.
    free : sequence of int
        Numbers of the parameters that were adjusted.

    Returns
    -------
    Solution
        The same where the readings determine all.
    """
    return _towards_file(problem, solution, free) or solution


def _towards_file(problem: Problem, solution: Solution, free: Sequence[int]) -> Solution | None:
    """Return the values nearest to the machine file, None where steps from a solution do not lead there."""
    index = np.array([i for i in free if i not in problem.at_bounds(solution.theta)], int)
    near = NearFile(problem, index)
    left = problem.freedom(len(free))
    nearest_solution, started, starts = solution, np.inf, problem.starts
    for number in range(TOWARDS_FILE if len(index) and np.isfinite(solution.cost) else 0):
        cost, square, gradient = problem.normal_equations(nearest_solution.theta, nearest_solution.frame)
        if not np.isfinite(cost):  # the legs of a closed chain do not close there
            break
        pull = near.pull(square, cost / left)
        if pull is None:
            return nearest_solution if nearest_solution.cost <= started * (1 + AS_GOOD) else None
        sizes = near.sizes(nearest_solution.theta[index], cost / left)
        prior = np.concatenate([near.stated(cost / left), sizes, pull.prior])
        if number == 0:
            started = cost + pulled(prior, near.away(nearest_solution.theta))
        scaled, scale = unit_diagonal(square[index[:, None], index])
        downhill, rows = -gradient[index] / scale, np.concatenate([prior, pull.gauge])
        near.add(rows, scaled, downhill, nearest_solution.theta, scale)
        step = np.zeros(len(nearest_solution.theta))
        try:
            step[index] = np.linalg.solve(scaled + LEAST_DAMPING * np.eye(len(index)), downhill) / scale
        except np.linalg.LinAlgError:  # numbers that no machine gives
            break
        length = float(np.max(np.abs(step[index]) / near.largest(square)))
        theta, frame = moved(
            problem, nearest_solution.theta, nearest_solution.frame, FARTHEST / max(length, FARTHEST) * step
        )
        theta = near.within(theta, nearest_solution.theta)
        if length < ARRIVING:  # it ends so near that the equations are as good as those made again
            carried = _carried((cost, square, gradient), step)
            if not carried[0] + pulled(prior, near.away(theta)) <= started * (1 + AS_GOOD):
                break
            problem.keep_equations(theta, frame, carried)
            return replace(nearest_solution, theta=theta, frame=frame, cost=carried[0])
        problem.follow(theta, frame)
        nearest_solution = replace(
            nearest_solution, theta=theta, frame=frame, cost=problem.normal_equations(theta, frame)[0]
        )
    problem.start_from(starts)
    return None


def _as_far_as_legs_close(problem: Problem, theta: Array, frame: Frame, step: Array) -> tuple[Array, Frame]:
    """Return where a step, or a half of it and so on, leads to poses that a closed chain has.

    A pose may be too far from where it starts, or near a fold, where two modes meet and beyond which there is none.
    """
    starts = problem.starts
    for halving in range(HALVINGS):
        tried = moved(problem, theta, frame, 0.5**halving * step)
        problem.start_from(starts)
        problem.follow(*tried)
        if np.isfinite(problem.cost(*tried)):
            break
    return tried


def moved(problem: Problem, theta: Array, frame: Frame, step: Array) -> tuple[Array, Frame]:
    """Add a step; the frame turns by what is not added to its values."""
    values = theta + step
    if "frame" not in problem.model.kinds:
        return values, frame
    change = {}
    for i, parameter in enumerate(problem.model.parameters):
        if parameter.slot[0] == "frame":
            change[str(parameter.slot[1])] = float(step[i])
            values[i] = 0.0
    return values, frame.moved(change)
