"""The error of linear models on blocks of poses that they did not see.

Without a block g the residuals there are e_g = (1 - H_g)⁻¹ r_g, H_g the block's part of the hat matrix, so that no fit
is repeated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.checks.held_out import folds_of_rows
from rodgen.data.observations import Observations
from rodgen.statistics.columns import orthonormal_basis, project_out
from rodgen.statistics.leave_out import LeaveOut, group_slices
from rodgen.statistics.thresholds import EVIDENCE

__all__ = ["Blocks"]

Array: TypeAlias = NDArray[np.float64]


class Blocks:
    """Blocks of poses, each of which is left out in turn.

    Parameters
    ----------
    observations : Observations
        The rows.
    model : ndarray, shape (n, m, p)
        Columns of the model.
    residual : ndarray, shape (n, m)
        Weighted residuals.
    stretches : bool
        Whether a block is all that was measured in a stretch of time, instead of poses from everywhere.
    """

    def __init__(
        self, observations: Observations, model: Array, residual: Array, *, stretches: bool = False
    ) -> None:
        self.m = residual.shape[1]
        fold = _stretches(observations) if stretches else folds_of_rows(observations, EVIDENCE.folds)
        fold = np.repeat(fold, self.m)
        self.order = np.argsort(fold, kind="stable")
        self.blocks = group_slices(fold[self.order])
        self.model = model.reshape(len(fold), -1)
        self.residual = residual.ravel()

    def held_out(self, further: Sequence[Array]) -> float:
        """Return the root mean square of the weighted residuals of the model with further columns, each block left out.

        Parameters
        ----------
        further : sequence of ndarray, each of shape (n, m, k)
        """
        return float(np.sqrt(np.mean(self.errors(further) ** 2)))

    def errors(self, further: Sequence[Array]) -> Array:
        """Return the weighted residuals with each block left out, in the order of blocks, (n m,)."""
        columns = [self.model, *(c.reshape(len(self.model), -1) for c in further)]
        basis = orthonormal_basis(np.concatenate(columns, axis=1)[self.order])
        residual = self.residual[self.order]
        amount = basis.T @ residual
        return LeaveOut(basis, self.blocks).residuals(project_out(basis, residual), amount=amount)


def _stretches(observations: Observations) -> NDArray[np.int_]:
    _, number = np.unique(observations.pose, return_inverse=True)
    return np.asarray(number * EVIDENCE.folds // (int(number.max(initial=0)) + 1))
