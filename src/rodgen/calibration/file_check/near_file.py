"""A fit that stays near the numbers of the machine file, and that readings which are grossly wrong do not pull.

Any fit may turn an axis by half a turn if the readings then agree: an axis with the wrong sign looks right. Here the
numbers of the file are worth something: each correction costs as many squares as it is large compared with how well
drawings and assembly usually are (`CHECK`), or as the file's own prior says. It costs little where readings say what is
right, so that a roughly known machine loses nothing; it decides where they leave a choice.

The errors of the readings are taken for t-distributed with few degrees of freedom, whose likelihood is maximised by
weights that fall with the residual (expectation-maximisation: Lange, Little and Taylor 1989). So files are compared by
likelihoods in which a wrong reading costs the logarithm of its error, not its square.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.problem import Problem
from rodgen.calibration.solve.least_squares import minimise
from rodgen.calibration.solve.starting_values import nearest_frames, with_attitudes
from rodgen.data.observations import Observations
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model
from rodgen.machines.plausible import MOST_TARGETS, relative_corrections, stated_deviations, tolerances
from rodgen.statistics.thresholds import CHECK

ROUNDS, STEPS, LAST = 8, 3, 1e-3
"""Times that weights and scale are found anew, Gauss-Newton steps between, and the change of ln(scale) that ends it."""
SCALE_STEPS = 10
"""Steps that bring a scale to 1 % of its limit."""
ROWS_OF_MOTION = 100
"""Rows that the motion is found from at most."""


def motion(problem: Problem, theta: Array) -> float:
    """Return how far the joints move what is measured, rms over rows; internal units.

    Each joint counts by itself: together they may hold a target in its place. Of readings that are places it is no less
    than these scatter.

    Parameters
    ----------
    theta : ndarray, shape (parameters,)
        Internal units.
    """
    o = problem.observations
    readings = o.reading if problem.model.structure.measurand.is_place else o.reading[:, :0]
    if problem.is_closed_chain:
        return _spread(np.hstack([readings, problem.places(theta, Frame.identity())]))
    if problem.rows > ROWS_OF_MOTION:
        problem = problem.take(np.linspace(0, problem.rows - 1, ROWS_OF_MOTION).astype(int))
        o = problem.observations
    here = problem.places(theta, Frame.identity())
    squares = 0.0
    for j in range(o.q.shape[1]):
        held = o.q.copy()
        held[:, j] = held[:, j].mean()
        there = Problem(problem.model, replace(o, q=held)).places(theta, Frame.identity())
        squares += float(np.mean(np.sum((there - here) ** 2, axis=1)))
    return max(float(np.sqrt(squares)), _spread(readings))


def _spread(places: Array) -> float:
    return float(np.sqrt(np.mean(np.sum((places - places.mean(axis=0)) ** 2, axis=1))))


class _NearProblem(Problem):
    """A problem whose cost also counts the squares of the corrections; its weights contain the scale."""

    def __init__(self, model: Model, observations: Observations) -> None:
        super().__init__(model, observations)
        self.price = np.zeros(len(model.parameters))
        stated = super().file_values
        self.centre = stated.centre
        none = np.zeros(len(self.price))
        self.file_values = replace(stated, precision=none, possible=none)  # they are in the price

    def priced(self, theta: Array) -> float:
        """Return what the corrections of the file, or of the means of its priors, cost."""
        return float(self.price @ (theta - self.centre) ** 2)

    def cost(self, theta: Array, frame: Frame) -> float:
        return super().cost(theta, frame) + self.priced(theta)

    def _summed(self, theta: Array, frame: Frame) -> tuple[float, Array, Array]:
        cost, square, gradient = super()._summed(theta, frame)
        return (
            cost + self.priced(theta),
            square + np.diag(self.price),
            gradient + self.price * (theta - self.centre),
        )


@dataclass(frozen=True)
class NearFit:
    """A fit near the file."""

    problem: _NearProblem
    theta: Array
    frame: Frame
    misfit: float
    """Minus the logarithm of the likelihood, with the cost of the corrections."""
    scale: float
    """Of the residuals of most rows, internal units."""
    rms: float
    """Of the rows that are not far out, internal units."""
    motion: float
    """How much what is measured moves, rms."""

    @property
    def corrections(self) -> float:
        """What the corrections of the file cost of the likelihood's logarithm."""
        return 0.5 * self.problem.priced(self.theta)

    @property
    def words(self) -> str:
        """Which number of the file is the farthest off, and where the readings have it."""
        model, worst = self.problem.model, int(np.argmax(self._sizes))
        parameter, kind = model.parameters[worst], model.kinds[worst]
        if kind in {"axis", "point"}:
            j = int(parameter.slot[1])  # type: ignore[call-overload]
            joint = model.machine.joints[j]
            if kind == "axis":
                axis = model.axis(self.theta, j)[0]
                off = np.degrees(
                    np.arctan2(np.linalg.norm(np.cross(axis, joint.axis)), axis @ np.array(joint.axis))
                )
                return f"the readings turn {joint.name} about [{', '.join(f'{x:.4g}' for x in axis)}], {off:.0f}° off"
            point = model.point(self.theta, j)
            off = np.linalg.norm(point - joint.point)
            at = ", ".join(f"{x:.5g}" for x in point)
            return f"the readings put the point of {joint.name} at [{at}], {off:.3g} {model.machine.length_unit} off"
        value = self.theta[worst] / parameter.factor
        return f"{parameter.key} is {value:.4g} {parameter.unit} off"

    @property
    def farthest(self) -> float:
        """The largest correction, relative to what is still plausible."""
        return float(self._sizes.max(initial=0.0))

    @cached_property
    def _sizes(self) -> Array:
        return np.abs(relative_corrections(self.problem.model, self.theta, self.motion))


def exchanged(model: Model, theta: Array) -> str:
    """Return a sentence on a target that was found nearer to where another one should be; empty where there is none.

    Parameters
    ----------
    theta : ndarray, shape (parameters,)
        Internal units.
    """
    if "target" not in model.kinds or not model.structure.moving:
        return ""
    given = np.array([target.point for target in model.machine.targets[:MOST_TARGETS]])
    found = np.array([model.target(theta, k)[0] for k in range(len(given))])
    nearest = np.argmin(np.linalg.norm(found[:, None] - given, axis=-1), axis=1)
    for k, j in enumerate(nearest):
        if j != k and np.linalg.norm(found[k] - given[j]) < np.linalg.norm(found[k] - given[k]):
            names = [target.name for target in model.machine.targets]
            return f"target {names[k]} is found nearer to where the file has {names[j]}"
    return ""


def fit_near(
    machine: Machine,
    observations: Observations,
    *,
    rounds: int = ROUNDS,
    compiled: bool = False,
    enlarged: float = 1.0,
) -> NearFit | None:
    """Return the fit near the file; None where the model is not finite.

    Parameters
    ----------
    machine : Machine
        Without fitted values.
    observations : Observations
        Of this machine.
    rounds : int
        Times at most that weights and scale are found anew.
    compiled : bool
        Whether the model is compiled.
    enlarged : float
        By which the readings were multiplied, so that the likelihood is that of the readings as they were.
    """
    model = Model(machine, observations.travel, observations.run_names, compiled=compiled)
    problem = _NearProblem(model, observations)
    free = [i for i, p in enumerate(model.parameters) if p.hold is None and not (p.searched or p.optional)]
    theta = model.start()
    if observations.attitude is not None:
        theta = with_attitudes(problem, theta, free)
    frame = _first_frame(problem, theta)
    residual = problem.residuals(theta, frame)
    if not np.isfinite(residual).all():
        return None
    moved = motion(problem, theta)
    usual = tolerances(model, moved, usual=True)
    for i, parameter in enumerate(model.parameters):
        if parameter.slot[0] == "e" and i in free:
            usual[i] = _of_effect(problem, theta, frame, i, CHECK.usual_effect * moved)
    stated, is_prior = stated_deviations(model), model.known[1] > 0
    problem.price = 1 / np.where(is_prior, stated, np.maximum(stated, usual)) ** 2
    m = problem.components
    base = problem.base_weight
    known = 1.0 if observations.sigma is not None else 0.0
    per_row = np.sqrt(np.mean(base**2, axis=1))  # a weighted residual of 1 is so small, in units of a reading
    least = max(known, CHECK.unseen * _size(observations) * float(np.median(per_row)))
    squares = np.sum((residual * base) ** 2, axis=1)
    weight, scale = _weights(squares, m, least)
    for _ in range(rounds):
        before = scale
        problem.set_weight(np.sqrt(weight) / scale)
        solution = minimise(problem, theta, frame, free, max_iterations=STEPS)
        if not np.isfinite(solution.cost):
            break
        theta, frame = solution.theta, solution.frame
        squares = np.sum((problem.residuals(theta, frame) * base) ** 2, axis=1)
        weight, scale = _weights(squares, m, least)
        if abs(np.log(scale / before)) < LAST and solution.converged:
            break
    spread = 0.5 * (CHECK.tails + m) * float(np.sum(np.log1p(squares / (CHECK.tails * scale**2))))
    near = squares <= (CHECK.far_out * scale) ** 2 * m
    real = float(np.median(per_row))
    misfit = len(squares) * m * np.log(scale / real / enlarged) + spread + 0.5 * problem.priced(theta)
    rms = float(np.sqrt(np.mean(squares[near]) / m)) if near.any() else np.inf
    return NearFit(problem, theta, frame, float(misfit), scale / real, rms / real, moved)


def _weights(squares: Array, m: int, least: float) -> tuple[Array, float]:
    """Return the weights of rows by their sums of squared residuals, and the scale, no less than `least`."""
    scale = max(float(np.sqrt(np.median(squares) / m)), least)
    for _ in range(SCALE_STEPS):
        weight = (CHECK.tails + m) / (CHECK.tails + squares / scale**2)
        scale = max(float(np.sqrt(np.sum(weight * squares) / (len(squares) * m))), least)
    return weight, scale


def _size(o: Observations) -> float:
    """Return how large the readings are, which no repair but one of their unit changes."""
    return _spread(o.reading) if o.machine.measurand.is_place else float(np.sqrt(np.mean(o.reading**2)))


def _first_frame(problem: Problem, theta: Array) -> Frame:
    if not problem.model.structure.frame:
        return Frame.identity()
    return min(nearest_frames(problem, theta), key=lambda frame: problem.cost(theta, frame))


def _of_effect(problem: Problem, theta: Array, frame: Frame, i: int, change: float) -> float:
    """Return how large a parameter of an effect must be to change the readings by so much, rms."""
    square = problem.normal_equations(theta, frame)[1][i, i]
    weight = np.sum(problem.weight**2) / problem.components
    return change / np.sqrt(square / weight) if square > 0 else 1.0
