"""What a linear fit would leave on groups of readings that it did not see, without a refit, and folds to group them by.

With Q, an orthonormal basis of the columns, and e the residuals of the fit to all readings, those of a group g by the
fit to the others are

    eₖ + Qₖ (1 - QₖᵀQₖ)⁻¹ Qₖᵀ eₖ.

The same matrix to the power -½ in place of -1 brings the residuals of a group to the size of its errors, which the fit
has shrunk (Bell and McCaffrey 2002).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["ALONE", "LeaveOut", "deal", "group_slices", "undo_leverage"]

Array: TypeAlias = NDArray[np.float64]

ALONE = 1e-6
"""A group whose removal leaves less than this part of the information on a direction is the only one to know it; the
others then predict nothing along it. Far above rounding (1e-13), far below what a pose of many leaves."""


def undo_leverage(
    hat: Array, residual: Array, power: float, *, cap: float | None = None, alone: Array | None = None
) -> Array:
    """Return (1 - H)⁻ᵖ r of each group, H its block of the hat matrix.

    Parameters
    ----------
    hat : ndarray, shape (…, b, b)
        H, with eigenvalues between 0 and 1.
    residual : ndarray, shape (…, b)
    power : float
        p: 1 for residuals of a fit without the group, ½ for residuals of the size of errors.
    cap : float, optional
        Eigenvalues of H above it count as it. Left out: where they exceed 1 - :data:`ALONE` the group alone determines
        that direction, and the result is that of `alone`.
    alone : ndarray, shape (b,), optional
        Left out: 0.
    """
    if hat.shape[-1] == 1 and cap is not None:
        return np.asarray(residual / (1 - np.clip(hat[..., 0], 0.0, cap)) ** power)
    values, vectors = np.linalg.eigh(hat)
    if cap is None:
        known = values <= 1 - ALONE
        factor = np.where(known, (1 - np.where(known, values, 0.0)) ** -power, 0.0)
    else:
        factor = (1 - np.clip(values, 0.0, cap)) ** -power
    along = np.einsum("...ji,...j->...i", vectors, residual) * factor
    if alone is not None and cap is None:
        along = np.where(known, along, alone @ vectors)
    return np.asarray(np.einsum("...ij,...j->...i", vectors, along))


class LeaveOut:
    """Residuals on groups of readings that a fit did not see.

    Parameters
    ----------
    basis : ndarray, shape (N, r)
        Orthonormal basis of the model's columns.
    groups : sequence of slice
        Readings of each group.
    """

    def __init__(self, basis: Array, groups: Sequence[slice]) -> None:
        self.basis = basis
        self.groups = groups
        self._squares = [basis[group].T @ basis[group] for group in groups]

    def residuals(
        self, residual: Array, further: Array | None = None, *, amount: Array | None = None
    ) -> Array:
        """Return the residuals of each group by the fit to the others, (N,).

        Parameters
        ----------
        residual : ndarray, shape (N,)
            Of the fit to all readings, with the further columns.
        further : ndarray, shape (N, k), optional
            Orthonormal basis of further columns, outside of the model's.
        amount : ndarray, shape (r,), optional
            What the fit to all readings has along each vector of the basis (without further columns). Given, the fit to
            the others has zero along what a group alone determines; left out, it has there what the fit to all has.
        """
        new = np.zeros((len(residual), 0)) if further is None else further
        found = np.empty_like(residual)
        p, k = self.basis.shape[1], new.shape[1]
        share = np.empty((p + k, p + k))
        for group, square in zip(self.groups, self._squares, strict=True):
            own, more, r = self.basis[group], new[group], residual[group]
            share[:p, :p] = square
            share[:p, p:] = own.T @ more
            share[p:, :p] = share[:p, p:].T
            share[p:, p:] = more.T @ more
            pull = np.concatenate([own.T @ r, more.T @ r])
            away = undo_leverage(share, pull, 1.0, alone=amount)
            found[group] = r + own @ away[:p] + more @ away[p:]
        return found


def group_slices(number: NDArray[np.int_]) -> list[slice]:
    """Return the slice of each group, from the group of each reading, in order."""
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    return [slice(int(a), int(b)) for a, b in pairwise([*starts, len(number)])]


def deal(count: int, folds: int) -> NDArray[np.int_]:
    """Return the fold of each of several things in order, (count,), so that each fold has one of every stretch.

    Within a stretch they are dealt at random, because what is dealt may repeat in any period; always the same.
    """
    random = np.random.default_rng(0)
    stretches = -(-count // folds)
    return np.concatenate([random.permutation(folds) for _ in range(stretches)])[:count]
