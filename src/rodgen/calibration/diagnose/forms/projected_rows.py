"""Some rows in which terms are tried: sensitivities, residuals, and what the model's parameters can make up for.

Errors have the covariance V. With columns A so that the symmetric form

    P = I - A Aᵀ

is what V⁻¹ leaves when the model's columns are taken out, a column c lowers the sum of squares rᵀPr by (cᵀPr)² / cᵀPc.
Where the rows are whitened, A is an orthonormal basis of the model's columns. Where they are not, a drift of
known size is part of A too, by the identity of Woodbury. Further columns are taken out in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.diagnose.forms.dictionary import Term
from rodgen.statistics.columns import (
    Whiten,
    directions_above,
    fall_from_products,
    inverse_root,
    orthonormal_basis,
    project_out,
    unit_columns,
)
from rodgen.statistics.leave_out import LeaveOut, deal, group_slices
from rodgen.statistics.thresholds import EVIDENCE, FORMS

__all__ = ["PosesLeftOut", "ProjectedRows", "folds_of"]

Array: TypeAlias = NDArray[np.float64]

KEPT_NUMBERS = 2_000_000
"""Number of terms, times rows, whose functions are kept between calls at most."""


class ProjectedRows:
    """Rows in which terms are tried.

    Parameters
    ----------
    sensitivities : ndarray, shape (c, n, m)
        Derivatives of the weighted residuals with respect to each component of each place.
    drivers : sequence of ndarray, shape (n,)
    residual : ndarray, shape (n, m)
        Weighted.
    whiten : callable
        Brings columns (n, m, K) to where their errors are independent.
    drift : ndarray, shape (N, d), optional
        Columns of a drift of variance 1, added to errors of variance 1.
    order : ndarray of int, shape (N,), optional
        In which the whitened readings are taken.

    Attributes
    ----------
    basis : ndarray, shape (N, p)
        A.
    left : ndarray, shape (N,)
        P r.
    total : float
        rᵀ P r.
    dof : int
        Readings less the columns that were taken out.
    """

    def __init__(
        self,
        sensitivities: Array,
        drivers: Sequence[Array],
        residual: Array,
        whiten: Whiten,
        *,
        drift: Array | None = None,
        order: NDArray[np.int_] | None = None,
    ) -> None:
        self.sensitivities = sensitivities
        self.drivers = drivers
        self.whiten = whiten
        self.order = order
        self.plain = drift is None
        self._functions: dict[Term, Array] = {}
        self.left = self.flat(residual[:, :, None])[:, 0]
        self.basis = np.zeros((len(self.left), 0))
        self.dof = len(self.left)
        if drift is not None:
            root = np.linalg.cholesky(np.linalg.inv(np.eye(drift.shape[1]) + drift.T @ drift))
            self.basis = drift @ root
            start = self.left
            self.left = start - self.basis @ (self.basis.T @ start)
            self.total = float(start @ self.left)
        else:
            self.total = float(self.left @ self.left)

    def state(self) -> tuple[Array, Array, float, int]:
        """Return what `take_out` changes, for `restore`."""
        return self.basis, self.left, self.total, self.dof

    def restore(self, state: tuple[Array, Array, float, int]) -> None:
        """Go back to an earlier state."""
        self.basis, self.left, self.total, self.dof = state

    def flat(self, columns: Array) -> Array:
        """Whiten columns (n, m, K) and return them as (N, K)."""
        white = self.whiten(columns)
        white = white.reshape(white.shape[0] * white.shape[1], -1)
        return white if self.order is None else white[self.order]

    def columns(self, term: Term, sensitivity: int) -> Array:
        """Return what a term does at a sensitivity, (n, m, count); not whitened."""
        if term not in self._functions:
            if len(self._functions) * len(self.drivers[0]) > KEPT_NUMBERS:
                self._functions.clear()
            self._functions[term] = term.columns(self.drivers)
        return np.asarray(self.sensitivities[sensitivity][:, :, None] * self._functions[term][:, None, :])

    def new_basis(self, flat: Array) -> Array:
        """Return columns with which A takes out these columns, too, (N, K) or fewer."""
        flat = unit_columns(flat)
        if not self.plain:
            across = flat - self.basis @ (self.basis.T @ flat)
            return np.asarray(across @ inverse_root(flat.T @ across, least=FORMS.visible))
        if not self.basis.shape[1]:
            return orthonormal_basis(flat)
        return directions_above(project_out(self.basis, flat), np.sqrt(FORMS.visible))

    def take_out(self, flat: Array) -> Array:
        """Let the model have further columns (N, K), and return what was added to A."""
        new = self.new_basis(flat)
        pull = new.T @ self.left
        self.left = self.left - new @ pull
        self.total -= float(pull @ pull)
        self.basis = np.concatenate([self.basis, new], axis=1)
        self.dof -= new.shape[1]
        return new

    def falls(self, terms: Sequence[Term], sensitivity: int) -> Array:
        """Return by how much each term lowers the sum of squares at a sensitivity."""
        return self.falls_of([self.columns(term, sensitivity) for term in terms])

    def falls_of(self, blocks: Sequence[Array]) -> Array:
        """Return by how much each block of columns (n, m, k) lowers the sum of squares."""
        found = []
        some: list[Array] = []
        for k, block in enumerate(blocks):
            some.append(block)
            if k == len(blocks) - 1 or sum(b.shape[2] for b in some) >= 64:
                found += self._falls(some)
                some = []
        return np.array(found)

    def _falls(self, blocks: Sequence[Array]) -> list[float]:
        flat = unit_columns(self.flat(np.concatenate(blocks, axis=2)))
        across = self.basis.T @ flat
        pull = flat.T @ self.left
        gram = flat.T @ flat - across.T @ across
        found, start = [], 0
        for block in blocks:
            of = slice(start, start + block.shape[2])
            start = of.stop
            found.append(fall_from_products(gram[of, of], pull[of], least=FORMS.visible))
        return found


def folds_of(pose: NDArray[np.integer]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Return the number of each row's pose, from 0, and of its fold."""
    of = np.unique(pose, return_inverse=True)[1]
    return of, deal(int(of.max()) + 1, EVIDENCE.folds)[of]


class PosesLeftOut:
    """Errors on poses that were left out of the fit, fold by fold.

    Parameters
    ----------
    projected : ProjectedRows
        Whose readings are ordered by fold.
    pose, fold : ndarray of int, shape (N,)
        Of each reading, in that order.
    """

    def __init__(self, projected: ProjectedRows, pose: NDArray[np.int_], fold: NDArray[np.int_]) -> None:
        self.projected = projected
        self.pose = pose
        self.folds = group_slices(fold)
        self.refresh()

    def refresh(self) -> None:
        """Follow the rows, whose basis has changed."""
        self._model = LeaveOut(self.projected.basis, self.folds)

    def squares(self, flat: Array | None = None) -> Array:
        """Return the sum of squares of each pose, with further columns (N, K)."""
        projected = self.projected
        new = np.zeros((len(projected.left), 0)) if flat is None else projected.new_basis(flat)
        errors = self._model.residuals(projected.left - new @ (new.T @ projected.left), new)
        return np.asarray(np.bincount(self.pose, errors**2), float)
