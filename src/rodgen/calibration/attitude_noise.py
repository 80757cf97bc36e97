"""How much of the noise of poses is in their attitudes: the lever arm at which a turn is as uncertain as a place.

A model that is wrong must not make attitudes look noisy, or they weigh nothing and the model looks right. So what
differs between runs is no noise, such as a target that was mounted anew: each run is fitted by itself. Where poses were
repeated within runs, the model is not asked at all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Mask
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.solve.least_squares import Solution, minimise
from rodgen.data.poses import groups
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.thresholds import DETERMINACY

ROUNDING = 1e-12
"""Residuals below this part of the readings are rounding, whose ratio says nothing of the noise."""
ENOUGH = 30
"""Degrees of freedom of positions, and of attitudes, from which on the ratio of their noises is known to a fifth."""
PARTS = slice(0, 3), slice(3, 6)
"""Components of positions and of attitudes."""


def attitude_arm(problem: Problem, solution: Solution, free: Sequence[int], kept: Mask) -> float:
    """Return the ratio of the standard deviations of positions and attitudes; length unit.

    Parameters
    ----------
    problem : Problem
        Of poses.
    kept : ndarray of bool, shape (n,)
        Rows that are no outliers.

    Returns
    -------
    float
        By repeated poses; else by the residuals of runs, or of all rows where these are too few; the arm of the
        observations where nothing tells.
    """
    arm = problem.observations.arm
    with one_thread_in_blas():
        found = _of_replicates(problem, solution, kept)
        if found is None:
            found = _of_residuals(problem, solution, free, kept)
    squares, freedom = found
    rounding = ROUNDING**2 * problem.scale
    if not (np.isfinite(squares).all() and freedom.min() > 1 and squares.min() > rounding):
        return arm
    place, turn = squares / freedom
    return float(arm * np.sqrt(place / turn))


def _of_replicates(problem: Problem, solution: Solution, kept: Mask) -> tuple[Array, Array] | None:
    """Return how much equal poses of one run differ from their mean, and the degrees of freedom; None where few are."""
    o = problem.observations
    rows = np.flatnonzero(kept)
    group = groups([o.replicate[rows], o.run[rows]], len(rows))
    count = int(group.max(initial=-1)) + 1
    if 3 * (len(rows) - count) < ENOUGH or np.any(np.diff(o.pose[rows]) == 0):
        return None  # readings repeated at once do not tell how well a pose is repeated
    residual = problem.residuals(solution.theta, solution.frame, weighted=True)[rows]
    mean = np.zeros((count, residual.shape[1]))
    np.add.at(mean, group, residual)
    residual = residual - (mean / np.bincount(group)[:, None])[group]
    return _squares(residual), np.full(2, 3.0 * (len(rows) - count))


def _of_residuals(
    problem: Problem, solution: Solution, free: Sequence[int], kept: Mask
) -> tuple[Array, Array]:
    """Return the sums of squares of positions and attitudes, and their redundancies, of each run by itself."""
    run = problem.observations.run
    runs = [np.flatnonzero(kept & (run == number)) for number in np.unique(run[kept])]
    if len(runs) > 1 and min(6 * len(rows) for rows in runs) >= len(free) + 2 * ENOUGH:
        parts = []
        for rows in runs:
            some = problem.take(rows)
            at = minimise(some, solution.theta, solution.frame, free)
            parts.append(_redundancy(some, at, free, np.arange(len(rows))))
        squares, freedom = (np.sum(x, axis=0) for x in zip(*parts, strict=True))
        return squares, freedom
    return _redundancy(problem, solution, free, np.flatnonzero(kept))


def _redundancy(
    problem: Problem, solution: Solution, free: Sequence[int], kept: NDArray[np.int_]
) -> tuple[Array, Array]:
    """Return sums of squares, and of each the number of its residuals less the part of the parameters they determine.

    That part is the trace of J (JᵀJ)⁻¹ Jᵀ over them (Helmert 1907; Förstner 1979). Repeated until the ratio stays, this
    is the estimate of restricted maximum likelihood.
    """
    index = np.asarray(free, int)
    grams = np.zeros((2, len(index), len(index)))
    used = np.zeros(problem.observations.n, bool)
    used[kept] = True
    for rows, block in problem.jacobian_blocks(solution.theta, solution.frame):
        some = used[rows]
        for k, of in enumerate(PARTS):
            flat = block[some][:, of, index].reshape(-1, len(index))
            grams[k] += flat.T @ flat
    scaled, scale = unit_diagonal(grams.sum(axis=0))
    values, vectors = eigh(scaled)
    seen = values > DETERMINACY.nothing**2 * values[-1] if len(values) else np.zeros(0, bool)
    along = vectors[:, seen] / scale[:, None]
    known = [np.sum(along * (gram @ along), axis=0) @ (1 / values[seen]) for gram in grams]
    residual = problem.residuals(solution.theta, solution.frame, weighted=True)[kept]
    return _squares(residual), 3 * len(kept) - np.array(known)


def _squares(residual: Array) -> Array:
    return np.array([np.sum(residual[:, of] ** 2) for of in PARTS])
