"""What a linear fit would leave on groups of readings that it did not see, without a refit, and folds to group them by.

With Q, an orthonormal basis of the columns, and e the residuals of the fit to all readings, those of a group g by the
fit to the others are

    eₖ + Qₖ (1 - QₖᵀQₖ)⁻¹ Qₖᵀ eₖ.

The same matrix to the power -½ in place of -1 brings the residuals of a group to the size of its errors, which the fit
has shrunk (Bell and McCaffrey 2002).

Further columns change the small part of the matrix that is theirs: the model's part is decomposed once for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.statistics.decompositions import eigh

ALONE = 1e-6
"""A group whose removal leaves less than this part of the information on a direction is the only one to know it; the
others then predict nothing along it. Far above rounding (1e-13), far below what a pose of many leaves."""


def undo_leverage(hat: Array, residual: Array, power: float, *, cap: float | None = None) -> Array:
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
        that direction, and the result is 0.
    """
    if hat.shape[-1] == 1 and cap is not None:
        return np.asarray(residual / (1 - np.clip(hat[..., 0], 0.0, cap)) ** power)
    values, vectors = eigh(hat)
    if cap is None:
        known = values <= 1 - ALONE
        factor = np.where(known, (1 - np.where(known, values, 0.0)) ** -power, 0.0)
    else:
        factor = (1 - np.clip(values, 0.0, cap)) ** -power
    along = np.einsum("...ji,...j->...i", vectors, residual) * factor
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
        self._parts = [_Part.of(basis[group]) for group in groups]

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
        found = np.empty_like(residual)
        for group, part in zip(self.groups, self._parts, strict=True):
            r = residual[group]
            found[group] = r + part.away(r, None if further is None else further[group])
            if amount is not None and part.alone.shape[1]:
                found[group] += self.basis[group] @ (part.alone @ (amount @ part.alone))
        return found


@dataclass(frozen=True, eq=False)
class _Part:
    """A group's readings of the basis, along the eigenvectors of its share of the information."""

    known: Array
    """Along those that others determine, too, (b, q)."""
    left: Array
    """What remains of the information there without the group, (q,)."""
    alone: Array
    """The other eigenvectors, (r, r - q)."""

    @classmethod
    def of(cls, basis: Array) -> _Part:
        values, vectors = eigh(basis.T @ basis)
        known = values <= 1 - ALONE
        return cls(basis @ vectors[:, known], 1 - values[known], vectors[:, ~known])

    def away(self, residual: Array, further: Array | None) -> Array:
        """Return what the residuals grow by, (b,); of further columns by elimination of the others."""
        pull = (self.known.T @ residual) / self.left
        if further is None or not further.shape[1]:
            return self.known @ pull
        across = self.known.T @ further
        both = across / self.left[:, None]
        inner = np.eye(further.shape[1]) - further.T @ further - across.T @ both
        values, vectors = eigh(inner)
        seen = both @ vectors
        known = values > ALONE * (1 + np.einsum("ij,ij->j", seen, seen))
        side = vectors[:, known].T @ (further.T @ residual + across.T @ pull)
        more = vectors[:, known] @ (side / values[known])
        return np.asarray(self.known @ (pull + both @ more) + further @ more)


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
