"""The error of linear models on blocks of poses that they did not see.

Without a block g the residuals there are e_g = (1 - H_g)⁻¹ r_g, H_g the block's part of the hat matrix, so that no fit
is repeated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.checks.held_out import folds_of_rows
from rodgen.calibration.checks.positions import distinct_positions
from rodgen.data.observations import Observations
from rodgen.statistics.columns import orthonormal_basis, project_out
from rodgen.statistics.leave_out import LeaveOut, deal, group_slices
from rodgen.statistics.thresholds import EVIDENCE


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
    fold : ndarray of int, shape (n,), optional
        Of each row: :func:`stretches_of_time`, or positions of a joint. Left out: poses from everywhere.
    """

    def __init__(
        self,
        observations: Observations,
        model: Array,
        residual: Array,
        fold: NDArray[np.int_] | None = None,
    ) -> None:
        self.observations = observations
        fold = folds_of_rows(observations, EVIDENCE.folds) if fold is None else fold
        fold = np.repeat(fold, residual.shape[1])
        self.order = np.argsort(fold, kind="stable")
        self.blocks = group_slices(fold[self.order])
        self.model = model.reshape(len(fold), -1)
        self.residual = residual.ravel()
        self._by_position: dict[str, Blocks | None] = {}
        self._held_out: dict[frozenset[int], tuple[Sequence[Array], float]] = {}
        """Errors of sets of columns by their ids, and the columns, so that no others get these ids."""

    def by_position(self, joint: str) -> Blocks | None:
        """Return blocks of whole positions of a joint, on which an error of its coordinate is predicted from others.

        None where poses are as good as positions: see `distinct_positions`.
        """
        o = self.observations
        names = [j.name for j in o.machine.joints]
        if joint not in names:
            return None
        if joint not in self._by_position:
            number = distinct_positions(o.q[:, names.index(joint)], len(np.unique(o.pose)))
            self._by_position[joint] = None if number is None else self._of_positions(number)
        return self._by_position[joint]

    def _of_positions(self, number: NDArray[np.int_]) -> Blocks | None:
        count, residual = int(number.max()) + 1, self.residual.reshape(len(number), -1)
        fold = deal(count, min(EVIDENCE.folds, count))[number]
        model = self.model.reshape(*residual.shape, -1)
        return Blocks(self.observations, model, residual, fold) if count > 1 else None

    def held_out(self, further: Sequence[Array]) -> float:
        """Return the root mean square of the weighted residuals of the model with further columns, each block left out.

        Parameters
        ----------
        further : sequence of ndarray, each of shape (n, m, k)
        """
        key = frozenset(map(id, further))
        if key not in self._held_out:
            self._held_out[key] = further, float(np.sqrt(np.mean(self.errors(further) ** 2)))
        return self._held_out[key][1]

    def errors(self, further: Sequence[Array]) -> Array:
        """Return the weighted residuals with each block left out, in the order of blocks, (n m,)."""
        columns = [self.model, *(c.reshape(len(self.model), -1) for c in further)]
        basis = orthonormal_basis(np.concatenate(columns, axis=1)[self.order])
        residual = self.residual[self.order]
        amount = basis.T @ residual
        return LeaveOut(basis, self.blocks).residuals(project_out(basis, residual), amount=amount)


def stretches_of_time(observations: Observations) -> NDArray[np.int_]:
    """Return the block of each row where a block is all that was measured in a stretch of time, (n,)."""
    _, number = np.unique(observations.pose, return_inverse=True)
    return np.asarray(number * EVIDENCE.folds // (int(number.max(initial=0)) + 1))
