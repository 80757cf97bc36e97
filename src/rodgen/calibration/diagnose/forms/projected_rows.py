"""Some rows in which terms are tried: sensitivities, residuals, and what the model's parameters can make up for.

Errors have the covariance V. With columns A so that the symmetric form

    P = I - A Aᵀ

is what V⁻¹ leaves when the model's columns are taken out, a column c lowers the sum of squares rᵀPr by (cᵀPr)² / cᵀPc.
Where the rows are whitened, A is an orthonormal basis of the model's columns. Where they are not, a drift of
known size is part of A too, by the identity of Woodbury. Further columns are taken out in the same way.

A column is a sensitivity, a vector for every row, times a function of drivers, a number for every row. Where rows are
not whitened, its products with A and r are those of the function with sums over the vector's components, which all
functions at a sensitivity share.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.diagnose.forms.dictionary import Term
from rodgen.calibration.diagnose.forms.formula import Piece
from rodgen.statistics.columns import (
    Whiten,
    directions_above,
    falls_from_products,
    inverse_root,
    orthonormal_basis,
    project_out,
    unchanged,
    unit_columns,
)
from rodgen.statistics.leave_out import LeaveOut, deal, group_slices
from rodgen.statistics.thresholds import EVIDENCE, FORMS

KEPT_NUMBERS = 2_000_000
"""Number of terms, times rows, whose functions are kept between calls at most."""
AT_ONCE = 64
"""Columns in one product of matrices, so that few are held at a time."""
WORTH_SUMMING = 6
"""Columns at one sensitivity from which on the sums cost less than they save."""


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
        self._summed: tuple[int, Array, Array] | None = None
        readings = sensitivities[0].size
        self.basis = np.zeros((readings, 0))
        self.dof: int = readings
        if drift is not None:
            root = np.linalg.cholesky(np.linalg.inv(np.eye(drift.shape[1]) + drift.T @ drift))
            self.basis = drift @ root
        self._residual = self.flat(residual[:, :, None])[:, 0]
        self._follow()

    def _follow(self) -> None:
        """Work out what depends on A and the residuals."""
        r, A = self._residual, self.basis
        self.left = project_out(A, r) if self.plain else r - A @ (A.T @ r)
        self.total: float = float(r @ self.left)
        self._summed = None

    def state(self) -> tuple[Array, int]:
        """Return what `take_out` changes, for `restore`."""
        return self.basis, self.dof

    def restore(self, state: tuple[Array, int]) -> None:
        """Go back to an earlier state."""
        self.basis, self.dof = state
        self._follow()

    def flat(self, columns: Array) -> Array:
        """Whiten columns (n, m, K) and return them as (N, K)."""
        white = self.whiten(columns)
        white = white.reshape(white.shape[0] * white.shape[1], -1)
        return white if self.order is None else white[self.order]

    def columns_of(self, piece: Piece) -> Array:
        """Return what the functions of a piece do, (n, m, kept); not whitened."""
        return np.asarray(
            self.sensitivities[piece.sensitivity][:, :, None] * self._functions_of(piece)[:, None, :]
        )

    def _functions_of(self, piece: Piece) -> Array:
        """Return the functions of a piece, (n, kept)."""
        term = piece.term
        if term not in self._functions:
            if len(self._functions) * len(self.drivers[0]) > KEPT_NUMBERS:
                self._functions.clear()
            self._functions[term] = term.columns(self.drivers)
        found = self._functions[term]
        return found if len(piece.kept) == found.shape[1] else found[:, list(piece.kept)]

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
        self.basis = np.concatenate([self.basis, new], axis=1)
        self.dof -= new.shape[1]
        self._follow()
        return new

    def falls(self, terms: Sequence[Term], sensitivity: int) -> Array:
        """Return by how much each term lowers the sum of squares at a sensitivity."""
        return self.falls_of([Piece.whole(term, sensitivity) for term in terms])

    def falls_of(self, pieces: Sequence[Piece]) -> Array:
        """Return by how much each piece lowers the sum of squares."""
        made: dict[int, list[tuple[int, Array, Array]]] = {}  # by their numbers of columns
        for numbers, shared in self._together(pieces):
            some = [pieces[i] for i in numbers]
            gram, pull = self._products_at(some) if shared else self._products(some)
            stop = 0
            for i, piece in zip(numbers, some, strict=True):
                own, stop = slice(stop, stop + len(piece.kept)), stop + len(piece.kept)
                made.setdefault(len(piece.kept), []).append((i, gram[own, own], pull[own]))
        found = np.zeros(len(pieces))
        for several in made.values():
            alike, grams, pulls = zip(*several, strict=True)
            found[list(alike)] = falls_from_products(np.stack(grams), np.stack(pulls), least=FORMS.visible)
        return found

    def _together(self, pieces: Sequence[Piece]) -> Iterator[tuple[list[int], bool]]:
        """Yield numbers of pieces of about as many columns as are held, and whether all are at one sensitivity."""
        others = list(range(len(pieces)))
        if self.whiten is unchanged:
            by: dict[int, list[int]] = {}
            for i, piece in enumerate(pieces):
                by.setdefault(piece.sensitivity, []).append(i)
            many = {s: own for s, own in by.items() if sum(len(pieces[i].kept) for i in own) >= WORTH_SUMMING}
            for own in many.values():
                yield from ((some, True) for some in self._parted(pieces, own))
            others = [i for i in others if pieces[i].sensitivity not in many]
        yield from ((some, False) for some in self._parted(pieces, others))

    def _parted(self, pieces: Sequence[Piece], numbers: list[int]) -> Iterator[list[int]]:
        some: list[int] = []
        count = 0
        for i in numbers:
            some.append(i)
            count += len(pieces[i].kept)
            if count >= AT_ONCE:
                yield some
                some, count = [], 0
        if some:
            yield some

    def _products(self, pieces: Sequence[Piece]) -> tuple[Array, Array]:
        """Return cᵀPc and cᵀPr of the columns c of pieces, taken at length 1."""
        flat = unit_columns(self.flat(np.concatenate([self.columns_of(piece) for piece in pieces], axis=2)))
        across = self.basis.T @ flat
        return flat.T @ flat - across.T @ across, flat.T @ self.left

    def _products_at(self, pieces: Sequence[Piece]) -> tuple[Array, Array]:
        """Return the same of pieces at one sensitivity, of rows that are not whitened."""
        weight, sums = self._sums(pieces[0].sensitivity)
        functions = np.concatenate([self._functions_of(piece) for piece in pieces], axis=1)
        size = np.sqrt(weight @ functions**2)
        functions = functions / np.where(size > 0, size, 1.0)
        along = sums.T @ functions
        across = along[:-1]
        return functions.T @ (weight[:, None] * functions) - across.T @ across, along[-1]

    def _sums(self, sensitivity: int) -> tuple[Array, Array]:
        """Return a sensitivity's squares, (n,), and its products with A and the residuals in each row, (n, p + 1)."""
        if self._summed is None or self._summed[0] != sensitivity:
            n, m = self.sensitivities.shape[1:]
            rows = (
                slice(None) if self.order is None else self.order[::m] // m
            )  # a row's readings stay together
            vectors = self.sensitivities[sensitivity][rows]
            basis, left = self.basis.reshape(n, m, -1), self.left.reshape(n, m)
            sums = np.empty((n, basis.shape[2] + 1))
            sums[rows, :-1] = sum(vectors[:, k, None] * basis[:, k] for k in range(m))
            sums[rows, -1] = np.sum(vectors * left, axis=1)
            weight = np.sum(self.sensitivities[sensitivity] ** 2, axis=1)
            self._summed = sensitivity, weight, sums
        return self._summed[1:]


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
