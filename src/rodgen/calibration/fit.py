"""Fit a machine's model to measurements, and fit it again."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Mask
from rodgen.calibration.attitude_noise import attitude_arm
from rodgen.calibration.dependence import as_one_body
from rodgen.calibration.fitted import Estimate, Fit
from rodgen.calibration.noise_floor import is_one_body
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.problem.blocks import observed, problem_of
from rodgen.calibration.rows import Rows, wrong_in
from rodgen.calibration.solve.least_squares import NEAR, Solution, minimise, nearest
from rodgen.calibration.solve.staged_fit import FitError, check_travel, fit_in_stages, with_later_weights
from rodgen.errors import shown
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.model import model_of
from rodgen.machines.observations import Observations
from rodgen.stages import Progress, reporting, stage

__all__ = [
    "Estimate",
    "Fit",
    "FitError",
    "ended",
    "extended",
    "fit",
    "fitted",
    "refit",
    "with_bodies",
    "without_bounds",
]

LOSSES = ("linear", "huber")

BALANCED = 30
"""Times at most that the lever arm of poses is estimated anew: usually five."""
SAME_ARM = 1e-5
"""Relative change of a lever arm that changes no estimate by as much as the last step of a fit does."""
COMPILE_FROM = 20_000
"""Rows from which on a fit by least squares is done with compiled kernels. NumPy needs some 15 evaluations of few rows,
0.002 to 0.04 s, where the compiler works for 0.2 to 1.3 s; with 20 000 rows both take as long. The rule counts rows,
not seconds, and does not ask what is in the cache: the same data give the same digits."""
JUDGEMENTS = 10
"""Times at most that a fit without outliers is judged anew: usually two or three."""


def fit(
    machine: Machine,
    data: Any,
    *,
    loss: str = "linear",
    start: Mapping[str, float] | None = None,
    outliers: NDArray[np.bool_] | None = None,
    compiled: bool | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Adjust a machine's parameters until the model meets the measurements best.

    Parameters
    ----------
    machine : Machine
        Its ``estimate`` and the parameters of its effects are adjusted; fitted values that it carries are the start.
    data : Measurements, Observations or a table in memory
        Such as a DataFrame, whose columns are named as those of a measurement file; see
        :meth:`rodgen.data.measurements.Measurements.from_frame`.
    loss : {"linear", "huber"}
        Sum of squares, of all rows or without outliers: rows that are likelier with an error of their own than by what
        the model leaves elsewhere (:mod:`rodgen.calibration.rows`). They are named.
    start : mapping of str to float, optional
        Further values to start from, by key, internal units.
    outliers : ndarray of bool, shape (n,), optional
        Rows of `data` that are known not to be believed; only with the linear loss.
    compiled : bool, optional
        Whether the model is compiled: it pays for many rows, or many fits of one model. Left out: from 20 000 rows on.
    progress : callable, optional
        Called with the stage, such as "fitting", how many of its steps are done, and of how many; None where that is
        not known.

    Returns
    -------
    Fit

    Raises
    ------
    InputFileError
        When the data do not fit the machine.
    FitError
        When the loss is another one, there is nothing to fit, or the model is not finite at the start.
    """
    if loss not in LOSSES:
        raise FitError(f"loss {shown(loss)}; expected one of {', '.join(LOSSES)}")
    with reporting(progress), stage("fitting"):
        observations = observed(machine, data)
        if outliers is not None and not isinstance(data, Observations):  # those of all rows
            outliers = observations.counted(outliers)
        if start:
            machine = replace(machine, values={**machine.values, **start})
        if loss == "linear":
            return fitted(machine, observations, outliers, compiled)
        return replace(_without_wrong_rows(machine, observations, compiled), loss=loss)


def fitted(
    machine: Machine, observations: Observations, outliers: Mask | None = None, compiled: bool | None = None
) -> Fit:
    """Return the fit to all rows but outliers."""
    if compiled is None:
        compiled = observations.n >= COMPILE_FROM or observations.blocks is not None
    model = model_of(machine, observations.travel, observations.run_names, compiled=compiled)
    problem = problem_of(model, observations)
    check_travel(problem)
    gone = np.zeros(observations.n, bool) if outliers is None else outliers
    with one_thread_in_blas():
        if gone.any():
            problem.leave_out(gone)
        solution, free = fit_in_stages(problem)
        return _balanced(_finished(problem, solution, free, gone))


def _without_wrong_rows(machine: Machine, observations: Observations, compiled: bool | None) -> Fit:
    """Return the fit without the rows that are likelier to have an error of their own, whatever their cause.

    Each fit begins anew, since such rows may have led the one before into another valley. Of a scan they are found in
    the sample first, then in all rows that are far from the fit to that.
    """
    fit = _settled(fitted(machine, replace(observations, blocks=None), compiled=compiled))
    if observations.blocks is None:
        return fit
    from scipy import special

    deviation = math.sqrt(fit.chi_square / max(fit.degrees_of_freedom, 1))
    # of good rows one is as far off by chance
    limit = deviation * math.sqrt(special.chdtri(fit.problem.components, 1 / observations.blocks.rows))
    place = fit.solution.theta, fit.solution.frame
    every = observations.blocks.with_rows_beyond(observations, fit.problem.model, place, limit)
    outliers = np.pad(fit.outliers, (0, every.n - observations.n), constant_values=True)
    return _settled(fitted(machine, every, outliers, compiled))


def _settled(fit: Fit) -> Fit:
    """Return the fit that judges wrong rows as the one before did."""
    machine = fit.problem.model.machine
    for _ in range(JUDGEMENTS):
        with one_thread_in_blas():
            wrong = with_bodies(fit, wrong_in(Rows.of(fit), many=True).wrong)
        if np.array_equal(wrong, fit.outliers):
            break
        fit = fitted(machine, fit.observations, wrong, fit.problem.model.compiled)
    return fit


def refit(
    fit: Fit,
    machine: Machine | None = None,
    observations: Observations | None = None,
    *,
    outliers: NDArray[np.bool_] | None = None,
) -> Fit:
    """Return a fit of another machine, or to other observations, without outliers if these are known.

    Parameters
    ----------
    machine : Machine, optional
        Left out: the one that was fitted.
    observations : Observations, optional
        Left out: those of this fit.
    outliers
        As of :func:`rodgen.calibration.fit.fit`.
    """
    if observations is None:
        same = outliers is None or np.array_equal(outliers, fit.outliers)
        observations = fit.observations if same else _with_unknown_arm(fit.observations)
    return fitted(fit.machine if machine is None else machine, observations, outliers)


def _balanced(fit: Fit) -> Fit:
    """Return the fit of poses in which positions and attitudes count by their own noise, estimated apart.

    Itself where that is known.
    """
    if fit.observations.arm_is_known:
        return fit
    for _ in range(BALANCED):
        arm = attitude_arm(fit)
        if abs(np.log(arm / fit.observations.arm)) < SAME_ARM:
            break
        fit = _with_arm(fit, arm)
    known = replace(fit.observations, arm_is_known=True)
    if any(p.optional for p in fit.parameters):  # what the data call for depends on the weights
        return refit(fit, observations=known, outliers=fit.outliers)
    return replace(fit, observations=known)


def balanced(fits: Sequence[Fit]) -> list[Fit]:
    """Return fits in which positions and attitudes count by their noise about the last one, as in a fit of that alone.

    So do shifts and turns of one body. Where the noise is stated, and of other readings, they are the same.
    """
    body = fits[-1]
    if is_one_body(body) and body.dependence.weighed:
        return [*(as_one_body(one, body.dependence.correlation) for one in fits[:-1]), body]
    o = _with_unknown_arm(fits[-1].observations)
    if o.arm_is_known:
        return [*fits]
    last = _balanced(replace(fits[-1], observations=o))
    arm = last.observations.arm
    return [*fits] if arm == o.arm else [*(_with_arm(one, arm) for one in fits[:-1]), last]


def _with_unknown_arm(o: Observations) -> Observations:
    """Return observations whose lever arm is to be estimated, where it is not stated."""
    return replace(o, arm_is_known=not o.machine.measurand.is_pose or o.sigma is not None)


def _with_arm(fit: Fit, arm: float) -> Fit:
    """Return the fit of poses in which attitudes count by another lever arm."""
    problem = Problem(fit.problem.model, replace(fit.observations, arm=arm))
    if fit.outliers.any():
        problem.leave_out(fit.outliers)
    solution = minimise(problem, fit.solution.theta, fit.solution.frame, fit.free, damping=NEAR)
    return _finished(problem, solution, fit.free, fit.outliers)


def _finished(problem: Problem, solution: Solution, free: Sequence[int], outliers: NDArray[np.bool_]) -> Fit:
    return as_one_body(Fit.of(problem, nearest(problem, solution, free), free, outliers))


def with_bodies(fit: Fit, rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return rows that are wrong, (n,), with the others of their poses where these were measured as poses."""
    if not rows.any() or not is_one_body(fit):
        return rows
    pose = fit.observations.pose
    return np.isin(pose, pose[rows])


def extended(fit: Fit, effects: Sequence[Effect], start: Mapping[str, float], *, creeps: bool = True) -> Fit:
    """Return the fit with further effects in the model, begun where this one ended.

    Where that does not converge, a fit from the beginning.

    Parameters
    ----------
    start : mapping of str to float
        Values of the effects' parameters to begin with, by key, internal units.
    creeps : bool
        Whether it goes on along a narrow valley; see :func:`rodgen.calibration.solve.least_squares.minimise`. Where
        not, :func:`rodgen.calibration.fit.ended` brings it to the end.
    """
    machine = fit.machine
    for effect in effects:
        machine = machine.with_effect(effect)
    machine = replace(machine, values={**machine.values, **start})
    o = fit.observations
    problem = problem_of(model_of(machine, o.travel, o.run_names, compiled=o.n >= COMPILE_FROM), o)
    if fit.outliers.any():
        problem.leave_out(fit.outliers)
    parameters = problem.model.parameters
    there = {fit.parameters[i].key for i in fit.free}
    free = [
        i
        for i, p in enumerate(parameters)
        if p.key in there
        or (
            p.hold is None
            and any(effect.owns(p.key) for effect in effects)
            and (not p.optional or machine.values.get(p.key))
        )
    ]
    with one_thread_in_blas():
        solution = minimise(problem, problem.model.start(), fit.solution.frame, free, creeps=creeps)
        if not solution.converged:
            return refit(fit, machine, outliers=fit.outliers)
        solution, free = with_later_weights(problem, solution, free, creeps=creeps)
        return _finished(problem, solution, sorted(free), fit.outliers)


def ended(fit: Fit) -> Fit:
    """Return the fit where its cost is least: itself, unless it ended on a way along a narrow valley."""
    if not fit.solution.crept:
        return fit
    with one_thread_in_blas():
        solution = minimise(fit.problem, fit.solution.theta, fit.solution.frame, fit.free)
        return _finished(fit.problem, solution, fit.free, fit.outliers)


def without_bounds(fit: Fit) -> Fit | None:
    """Return the fit without the bounds of the machine file that hold it; None where none does."""
    held = [fit.parameters[i].key for i in set(fit.free).difference(fit.moving)]
    return refit(fit, fit.machine.without_bounds(held), outliers=fit.outliers) if held else None
