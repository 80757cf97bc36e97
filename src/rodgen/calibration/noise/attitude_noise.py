"""How much of the noise of poses is in their attitudes: the lever arm at which a turn is as uncertain as a place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.solve.least_squares import Solution
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.thresholds import DETERMINACY


def estimated_arm(
    problem: Problem, solution: Solution, free: Sequence[int], kept: NDArray[np.bool_]
) -> float:
    """Return the ratio of the standard deviations of positions and attitudes, by their residuals; length unit.

    Parameters
    ----------
    problem : Problem
        Of poses.
    kept : ndarray of bool, shape (n,)
        Rows that are no outliers.

    Notes
    -----
    Each variance is a sum of squares by its own redundancy: the number of its residuals less the part of the parameters
    that they determine, the trace of J (JᵀJ)⁻¹ Jᵀ over them (Helmert 1907; Förstner 1979). Repeated until the ratio
    stays, this is the estimate of restricted maximum likelihood.
    """
    index = np.asarray(free, int)
    squares, grams = np.zeros(2), np.zeros((2, len(index), len(index)))
    residual = problem.residuals(solution.theta, solution.frame, weighted=True)
    with one_thread_in_blas():
        for rows, block in problem.jacobian_blocks(solution.theta, solution.frame):
            some = kept[rows]
            for k, of in enumerate((slice(0, 3), slice(3, 6))):
                flat = block[some][:, of, index].reshape(-1, len(index))
                grams[k] += flat.T @ flat
    squares = np.array([np.sum(residual[kept, of] ** 2) for of in (slice(0, 3), slice(3, 6))])
    scaled, scale = unit_diagonal(grams.sum(axis=0))
    values, vectors = eigh(scaled)
    seen = values > DETERMINACY.nothing**2 * values[-1] if len(values) else np.zeros(0, bool)
    along = vectors[:, seen] / scale[:, None]
    used = [np.sum(along * (gram @ along), axis=0) @ (1 / values[seen]) for gram in grams]
    freedom = 3 * np.count_nonzero(kept) - np.array(used)
    arm = problem.observations.arm
    rounding = _ROUNDING**2 * problem.scale
    if not (np.isfinite(squares).all() and freedom.min() > 1 and squares.min() > rounding):
        return arm
    (place, turn) = squares / freedom
    return float(arm * np.sqrt(place / turn))


_ROUNDING = 1e-12
"""Residuals below this part of the readings are rounding, whose ratio says nothing of the noise."""
