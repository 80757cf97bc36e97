"""How well columns predict poses that they were not fitted to, without a refit."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.diagnose.forms.level import Level
from rodgen.statistics.leave_out import LeaveOut, deal, group_slices
from rodgen.statistics.thresholds import EVIDENCE

__all__ = ["PosesLeftOut", "folds_of"]

Array: TypeAlias = NDArray[np.float64]


def folds_of(pose: NDArray[np.integer]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the number of each row's pose, from 0, and of its fold."""
    of = np.unique(pose, return_inverse=True)[1]
    return of, deal(int(of.max()) + 1, EVIDENCE.folds)[of]


class PosesLeftOut:
    """Errors on poses that were left out of the fit, fold by fold.

    Parameters
    ----------
    level : Level
        Whose readings are ordered by fold.
    pose, fold : ndarray of int, shape (N,)
        Of each reading, in that order.
    """

    def __init__(self, level: Level, pose: NDArray[np.int_], fold: NDArray[np.int_]) -> None:
        self.level = level
        self.pose = pose
        self.folds = group_slices(fold)
        self.refresh()

    def refresh(self) -> None:
        """Follow the level, whose basis has changed."""
        self._model = LeaveOut(self.level.basis, self.folds)

    def squares(self, flat: Array | None = None) -> Array:
        """Return the sum of squares of each pose, with further columns (N, K)."""
        level = self.level
        new = np.zeros((len(level.left), 0)) if flat is None else level.new_basis(flat)
        errors = self._model.residuals(level.left - new @ (new.T @ level.left), new)
        return np.asarray(np.bincount(self.pose, errors**2), float)
