"""The space that the columns of a linear model span: its orthonormal basis, projections, score tests, leverage.

With Q, an orthonormal basis of the columns, a residual r is projected to r - QQᵀr, and further columns c are seen only
as far as c - QQᵀc is not nearly zero. Columns of readings whose errors depend on each other are whitened first: a
:data:`Whiten` brings columns (n, m, K) to where errors are independent and alike, as `whiten(x)` of statsmodels does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.statistics.decompositions import eigh, svd
from rodgen.statistics.f_tests import log_p_of_fall

__all__ = [
    "DEPENDENT",
    "ColumnSpace",
    "Coordinates",
    "ScoreTest",
    "Whiten",
    "directions_above",
    "directions_of_each",
    "fall_from_products",
    "falls_from_products",
    "inverse_root",
    "orthonormal_basis",
    "pair_falls",
    "project_out",
    "unchanged",
    "unit_columns",
    "unit_diagonal",
    "visible_part",
]

Array: TypeAlias = NDArray[np.float64]
Whiten: TypeAlias = Callable[[Array], Array]

DEPENDENT = 1e-9
"""Singular value, relative to the largest, below which a direction of columns of length 1 is rounding: parameters that
differ so little change the readings by less than the precision of a double."""


def unchanged(columns: Array) -> Array:
    """Return columns as they are: the :data:`Whiten` of readings whose errors are independent and alike."""
    return columns


def unit_columns(columns: Array) -> Array:
    """Return columns of length 1, (..., N, k); those that are zero stay zero."""
    size = np.sqrt(np.einsum("...ij,...ij->...j", columns, columns))  # a third of the time of np.linalg.norm
    return np.asarray(columns / np.where(size > 0, size, 1.0)[..., None, :])


def unit_diagonal(products: Array) -> tuple[Array, Array]:
    """Return products XᵀX scaled to a unit diagonal, (k, k), and the lengths of the columns, (k,).

    A column of zeros counts as one of length 1. A covariance becomes correlations and standard deviations.
    """
    size = np.sqrt(products.diagonal())
    size[size == 0.0] = 1.0
    return products / (size[:, None] * size), size


def orthonormal_basis(columns: Array, *, relative: float = DEPENDENT) -> Array:
    """Return an orthonormal basis of the space that columns span, (N, rank).

    Parameters
    ----------
    columns : ndarray, shape (N, k)
        Of any length; a column of zeros spans nothing.
    relative : float
        Singular values of the columns, scaled to length 1, below this part of the largest are left out.
    """
    return directions_above(unit_columns(columns), 1e-300, relative=relative)


def project_out(basis: Array, columns: Array) -> Array:
    """Return columns less their projection onto a space: (1 - QQᵀ) X.

    Parameters
    ----------
    basis : ndarray, shape (N, r)
        Q, orthonormal.
    columns : ndarray, shape (N,) or (N, k)

    Notes
    -----
    Done twice: once leaves 1e-16 of the projection, which matters where little else remains (Parlett's "twice is
    enough").
    """
    return _projected_out(basis, _projected_out(basis, columns))


def _projected_out(basis: Array, columns: Array) -> Array:
    return columns - basis @ (basis.T @ columns)


def visible_part(basis: Array, columns: Array, least: float) -> Array:
    """Return an orthonormal basis of what columns span outside of a space, (N, rank).

    Parameters
    ----------
    basis : ndarray, shape (N, r)
        Orthonormal.
    columns : ndarray, shape (N, k)
        Of length 1.
    least : float
        Singular value of the projected columns below which a direction counts as part of the space.

    Notes
    -----
    Projected once before the directions are found, and once after, which takes out what rounding left the first time.
    """
    return _projected_out(basis, directions_above(_projected_out(basis, columns), least))


def directions_above(columns: Array, least: float, *, relative: float = 0.0) -> Array:
    """Return the left singular vectors of columns, (N, rank), that belong to large enough singular values.

    Parameters
    ----------
    columns : ndarray, shape (N, k)
    least, relative : float
        Singular values must exceed the one, and the other times the largest of them.
    """
    if not columns.shape[1]:
        return np.zeros((len(columns), 0))
    basis, triangle = np.linalg.qr(columns)
    u, values, _ = svd(triangle)
    return np.asarray(basis @ u[:, values > max(least, relative * values[0])])


def directions_of_each(columns: Array, blocks: NDArray[np.int_], least: float) -> list[Array]:
    """Return orthonormal bases of what blocks of columns span, each (N, rank), as `directions_above` does of one.

    Parameters
    ----------
    columns : ndarray, shape (N, k)
        Of length 1 at most.
    blocks : ndarray of int, shape (n, p)
        Numbers of the columns of each block.
    least : float
        Far above the root of the rounding: these are eigenvectors of the blocks' products.
    """
    parts = columns.T[blocks]
    values, vectors = eigh(parts @ parts.transpose(0, 2, 1))
    kept = values > least**2
    found = vectors.transpose(0, 2, 1) @ parts / np.sqrt(np.where(kept, values, 1.0))[:, :, None]
    return [directions[seen].T for directions, seen in zip(found, kept, strict=True)]


def inverse_root(gram: Array, *, least: float = 0.0, relative: float = 0.0) -> Array:
    """Return W with WᵀGW = 1, (k, rank), along the directions that G, of products of columns, determines.

    Parameters
    ----------
    gram : ndarray, shape (k, k)
        G, symmetric.
    least, relative : float
        Eigenvalues of G must exceed the one, and the other times the largest of them.
    """
    values, vectors = eigh(gram)
    kept = values > max(least, relative * float(values.max(initial=0.0)))
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))


def fall_from_products(gram: Array, pull: Array, *, relative: float) -> float:
    """Return by how much columns X lower a sum of squares rᵀr, from the products XᵀX and Xᵀr alone.

    Parameters
    ----------
    gram : ndarray, shape (k, k)
        XᵀX.
    pull : ndarray, shape (k,)
        Xᵀr.
    relative : float
        Of the directions that count; see :func:`inverse_root`.
    """
    return float(falls_from_products(gram, pull, relative=relative))


def falls_from_products(gram: Array, pull: Array, *, least: float = 0.0, relative: float = 0.0) -> Array:
    """Return the falls of several sets of columns, (...), as :func:`fall_from_products` does of one.

    Parameters
    ----------
    gram : ndarray, shape (..., k, k)
    pull : ndarray, shape (..., k)
    least, relative : float
    """
    values, vectors = eigh(gram)
    limit = np.maximum(least, relative * values.max(axis=-1, initial=0.0, keepdims=True))
    along = np.einsum("...ji,...j->...i", vectors, pull) ** 2
    return np.asarray(
        np.sum(np.where(values > limit, along / np.where(values > limit, values, 1.0), 0.0), axis=-1)
    )


def pair_falls(bases: Sequence[Array], residual: Array, *, least: float) -> Array:
    """Return by how much each two of several spaces together lower a sum of squares rᵀr, (n, n).

    Parameters
    ----------
    bases : sequence of ndarray, each of shape (N, k)
        Orthonormal.
    residual : ndarray, shape (N,)
        r.
    least : float
        Sine of the angle between two spaces below which a direction of the one counts as part of the other.

    Notes
    -----
    For a pair it is |a|² + (b - Cᵀa)ᵀ(1 - CᵀC)⁻¹(b - Cᵀa), with the falls a = Aᵀr and b = Bᵀr of either, and C = AᵀB.
    """
    sizes = np.array([basis.shape[1] for basis in bases])
    starts = np.cumsum(sizes) - sizes
    whole = np.concatenate(bases, axis=1)
    products, pulls = whole.T @ whole, whole.T @ residual
    found = np.zeros((len(bases), len(bases)))
    for p in np.unique(sizes):
        first = np.flatnonzero(sizes == p)
        rows = starts[first][:, None] + np.arange(p)
        for q in np.unique(sizes[sizes <= p]):
            second = np.flatnonzero(sizes == q)
            columns = starts[second][:, None] + np.arange(q)
            cross = products[rows[:, None, :, None], columns[None, :, None, :]]
            rest = pulls[columns] - np.einsum("rcpq,rp->rcq", cross, pulls[rows])
            seen = (1 + least**2) * np.eye(q) - np.einsum("rcpq,rcps->rcqs", cross, cross)
            more = np.einsum("rcq,rcq->rc", rest, np.linalg.solve(seen, rest[..., None])[..., 0])
            falls = np.sum(pulls[rows] ** 2, axis=1)[:, None] + more
            found[np.ix_(first, second)] = falls
            found[np.ix_(second, first)] = falls.T
    np.fill_diagonal(found, 0.0)
    return found


class Coordinates:
    """An orthonormal basis Q of the space that columns span, as far as coordinates in it are asked for.

    Q itself, which takes two thirds of a decomposition of many rows, is not formed.

    Parameters
    ----------
    columns : ndarray, shape (N, k)

    Attributes
    ----------
    triangle : ndarray, shape (min(N, k), k)
        Coordinates of the columns: columns = Q triangle.
    """

    def __init__(self, columns: Array) -> None:
        self._reflectors, self._scales = np.linalg.qr(columns, mode="raw")
        self.triangle = np.triu(self._reflectors.T[: len(self._scales)])

    def of(self, values: Array) -> Array:
        """Return the coordinates Qᵀ values, (min(N, k),), of values (N,).

        Raises
        ------
        ValueError
            When the values are not N: LAPACK reads and writes by their number.
        """
        from scipy.linalg.lapack import dormqr

        count, rows = len(self._scales), self._reflectors.shape[1]
        if values.shape != (rows,):
            raise ValueError(f"values have shape {values.shape}; expected ({rows},)")
        if not count:
            return values[:0]
        found, _, _ = dormqr("L", "T", self._reflectors[:count].T, self._scales, values[:, None], 64)
        return np.asarray(found[:count, 0])


@dataclass(frozen=True)
class ScoreTest:
    """What further columns would explain of a residual (Rao 1948): F of the fall of the sum of squares.

    Attributes
    ----------
    fall : float
        By how much the columns lower the sum of squares.
    left : float
        Sum of squares that remains.
    dof, residual_dof : int
        Degrees of freedom of the two.
    """

    fall: float
    left: float
    dof: int
    residual_dof: int

    @property
    def statistic(self) -> float:
        """F."""
        return self.fall / self.dof / max(self.left / self.residual_dof, 1e-300)

    @property
    def log_p(self) -> float:
        """Natural logarithm of the probability that chance does as much."""
        return log_p_of_fall(self.fall, self.left, self.dof, self.residual_dof)


@dataclass(frozen=True, eq=False)
class ColumnSpace:
    """The space that the columns of a model span.

    Attributes
    ----------
    basis : ndarray, shape (N, r)
        Orthonormal.
    """

    basis: Array

    @classmethod
    def of(cls, columns: Array | Sequence[Array]) -> ColumnSpace:
        """Return the space of columns (N, k), or of several such blocks together."""
        whole = columns if isinstance(columns, np.ndarray) else np.concatenate(columns, axis=1)
        return cls(orthonormal_basis(whole))

    @property
    def rank(self) -> int:
        """Number of dimensions."""
        return int(self.basis.shape[1])

    @property
    def leverage(self) -> Array:
        """Diagonal of the hat matrix QQᵀ, (N,)."""
        return np.asarray(np.einsum("ij,ij->i", self.basis, self.basis))

    def project_out(self, columns: Array) -> Array:
        """Return columns less their projection onto the space; see :func:`project_out`."""
        return project_out(self.basis, columns)

    def visible_part(self, columns: Array, least: float) -> Array:
        """Return a basis of what columns of length 1 span outside of the space; see :func:`visible_part`."""
        return visible_part(self.basis, columns, least)

    def joined(self, basis: Array) -> ColumnSpace:
        """Return the space together with an orthonormal basis of directions outside of it."""
        return ColumnSpace(np.concatenate([self.basis, basis], axis=1))

    def score_test(
        self,
        residual: Array,
        directions: Array,
        *,
        readings: int | None = None,
        total: float | None = None,
    ) -> ScoreTest | None:
        """Return the score test of directions outside of the space.

        Parameters
        ----------
        residual : ndarray, shape (N,)
            With its projection onto the space taken out.
        directions : ndarray, shape (N, k)
            Orthonormal; see :meth:`visible_part`.
        readings : int, optional
            Number of readings, where rows are coordinates in a smaller space; left out: N.
        total : float, optional
            Sum of squares of the residuals, where the rows do not show all of it.

        Returns
        -------
        ScoreTest or None
            None where no direction is visible, no degree of freedom remains, or the residual is zero.
        """
        before = float(residual @ residual)
        before = before if total is None else max(total, before)
        k = directions.shape[1]
        residual_dof = (len(self.basis) if readings is None else readings) - self.rank - k
        if k == 0 or residual_dof < 1 or not before > 0:
            return None
        fall = float(np.sum((directions.T @ residual) ** 2))
        return ScoreTest(fall, before - fall, k, residual_dof)

    def score_test_of_many(self, residual: Array, columns: Array, least: float) -> ScoreTest | None:
        """Return the score test of what columns span outside of the space, from their products.

        Where columns are hundreds this takes a fraction of the time of a basis; it needs `least` far above 1e-8.

        Parameters
        ----------
        residual : ndarray, shape (N,)
            With its projection onto the space taken out.
        columns : ndarray, shape (N, k)
            Of length 1.
        least : float
            See :func:`visible_part`.

        Returns
        -------
        ScoreTest or None
            See :meth:`score_test`.
        """
        across = _projected_out(self.basis, columns)
        along = inverse_root(across.T @ across, least=least**2).T @ (across.T @ residual)
        total = float(residual @ residual)
        return self.score_test(along, np.eye(len(along)), readings=len(columns), total=total)
