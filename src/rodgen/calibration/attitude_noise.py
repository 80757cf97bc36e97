"""How much of the noise of poses is in their attitudes: the lever arm at which a turn is as uncertain as a place.

A model that is wrong must not make attitudes look noisy, or they weigh nothing and the model looks right. So what
differs between runs is no noise, such as a target that was mounted anew: each run is fitted by itself. Where poses were
repeated within runs, the model is not asked at all.
"""

from __future__ import annotations

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.fitted import Fit
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.solve.least_squares import minimise
from rodgen.calibration.whitened import Whitened
from rodgen.data.poses import groups

ROUNDING = 1e-12
"""Residuals below this part of the readings are rounding, whose ratio says nothing of the noise."""
ENOUGH = 30
"""Degrees of freedom of positions, and of attitudes, from which on the ratio of their noises is known to a fifth."""
PARTS = slice(0, 3), slice(3, 6)
"""Components of positions and of attitudes."""


def attitude_arm(fit: Fit) -> float:
    """Return the ratio of the standard deviations of positions and attitudes; length unit.

    Parameters
    ----------
    fit : Fit
        To poses.

    Returns
    -------
    float
        By repeated poses; else by the residuals of runs, or of all rows where these are too few; the arm of the
        observations where that is not known.
    """
    arm = fit.observations.arm
    with one_thread_in_blas():
        arm_of_replicates = _of_replicates(fit)
        squares, freedom = (
            np.sum([_redundancy(one) for one in _runs(fit)], axis=0)
            if arm_of_replicates is None
            else arm_of_replicates
        )
    rounding = ROUNDING**2 * fit.problem.scale
    if not (np.isfinite(squares).all() and freedom.min() > 1 and squares.min() > rounding):
        return arm
    place, turn = squares / freedom
    return float(arm * np.sqrt(place / turn))


def _of_replicates(fit: Fit) -> tuple[Array, Array] | None:
    """Return how much equal poses of one run differ from their mean, and the degrees of freedom; None where few are."""
    o, rows = fit.observations, np.flatnonzero(~fit.outliers)
    group = groups([o.replicate[rows], o.run[rows]], len(rows))
    count = int(group.max(initial=-1)) + 1
    if 3 * (len(rows) - count) < ENOUGH or np.any(np.diff(o.pose[rows]) == 0):
        return None  # readings repeated at once do not tell how well a pose is repeated
    residual = fit.problem.residuals(fit.solution.theta, fit.solution.frame, weighted=True)[rows]
    mean = np.zeros((count, residual.shape[1]))
    np.add.at(mean, group, residual)
    residual = residual - (mean / np.bincount(group)[:, None])[group]
    return _squares(residual), np.full(2, 3.0 * (len(rows) - count))


def _runs(fit: Fit) -> list[Fit]:
    """Return the fits of runs by themselves; that of all rows where these are too few."""
    run, is_inlier = fit.observations.run, ~fit.outliers
    runs = [np.flatnonzero(is_inlier & (run == number)) for number in np.unique(run[is_inlier])]
    if len(runs) < 2 or min(6 * len(rows) for rows in runs) < len(fit.free) + 2 * ENOUGH:
        return [fit]
    problems = [fit.problem.take(rows) for rows in runs]
    ends = [minimise(one, fit.solution.theta, fit.solution.frame, fit.free) for one in problems]
    return [
        Fit.of(one, end, fit.free, np.zeros(one.rows, bool)) for one, end in zip(problems, ends, strict=True)
    ]


def _redundancy(fit: Fit) -> tuple[Array, Array]:
    """Return sums of squares, and of each the number of its residuals less the part of the parameters they determine.

    That part is the trace of J (JᵀJ)⁻¹ Jᵀ over them (Helmert 1907; Förstner 1979). Repeated until the ratio stays, this
    is the estimate of restricted maximum likelihood.
    """
    used = np.zeros(2)
    for _, jacobian in Whitened(fit).jacobian_blocks():
        used += [float(np.sum(jacobian[:, of] ** 2)) for of in PARTS]
    residual = fit.problem.residuals(fit.solution.theta, fit.solution.frame, weighted=True)
    return _squares(residual), 3 * fit.rows - used


def _squares(residual: Array) -> Array:
    return np.array([np.sum(residual[:, of] ** 2) for of in PARTS])
