"""How well columns predict poses that they were not fitted to, without a refit.

The poses are dealt into folds at random. X being an orthonormal basis of all columns and e the residuals, those of a
fold that the fit did not see are eₖ + Xₖ (I - XₖᵀXₖ)⁻¹ Xₖᵀ eₖ. What only the fold itself tells is left out.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.diagnose.forms.level import Level

__all__ = ["Unseen", "folds_of"]

Array: TypeAlias = NDArray[np.float64]

FOLDS = 10
ALONE = 1e-6
"""A fold that leaves the others less than this part of what is known of something is alone in knowing it."""


def folds_of(pose: NDArray[np.integer]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the number of each row's pose, from 0, and of its fold."""
    of = np.unique(pose, return_inverse=True)[1]
    count = int(of.max()) + 1
    random = np.random.default_rng(0)
    stretches = -(-count // FOLDS)
    dealt = np.concatenate([random.permutation(FOLDS) for _ in range(stretches)])[:count]
    return of, dealt[of]


class Unseen:
    """Errors on poses that were not seen.

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
        starts = np.flatnonzero(np.diff(fold, prepend=-1, append=FOLDS + 1))
        self.folds = [slice(int(a), int(b)) for a, b in pairwise(starts)]
        self.refresh()

    def refresh(self) -> None:
        """Follow the level, whose basis has changed."""
        basis = self.level.basis
        self._squares = [basis[fold].T @ basis[fold] for fold in self.folds]

    def squares(self, flat: Array | None = None) -> Array:
        """Return the sum of squares of each pose, with further columns (N, K)."""
        level = self.level
        new = np.zeros((len(level.left), 0)) if flat is None else level.new_basis(flat)
        left = level.left - new @ (new.T @ level.left)
        errors = np.empty_like(left)
        p, k = level.basis.shape[1], new.shape[1]
        share = np.empty((p + k, p + k))
        for fold, square in zip(self.folds, self._squares, strict=True):
            own, further = level.basis[fold], new[fold]
            share[:p, :p] = square
            share[:p, p:] = own.T @ further
            share[p:, :p] = share[:p, p:].T
            share[p:, p:] = further.T @ further
            pull = np.concatenate([own.T @ left[fold], further.T @ left[fold]])
            values, vectors = np.linalg.eigh(share)
            known = values < 1 - ALONE
            away = vectors[:, known] @ ((vectors[:, known].T @ pull) / (1 - values[known]))
            errors[fold] = left[fold] + own @ away[:p] + further @ away[p:]
        return np.asarray(np.bincount(self.pose, errors**2), float)
