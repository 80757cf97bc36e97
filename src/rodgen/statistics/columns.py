"""The space that the columns of a linear model span: its orthonormal basis, and projections.

With Q, an orthonormal basis of the columns, a residual r is projected to r - QQᵀr, and further columns c are seen only
as far as c - QQᵀc is not nearly zero.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.statistics.decompositions import eigh, svd

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
    """Return products XᵀX scaled to a unit diagonal, (..., k, k), and the lengths of the columns, (..., k).

    A column of zeros counts as one of length 1. A covariance becomes correlations and standard deviations.
    """
    size = np.sqrt(np.diagonal(products, axis1=-2, axis2=-1))
    size[size == 0.0] = 1.0
    return products / (size[..., :, None] * size[..., None, :]), size


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
    Once leaves 1e-16 of the columns along the space: nothing for their products with what is across it.
    """
    return np.asarray(columns - basis @ (basis.T @ columns))


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
    is_large = values > max(least, relative * float(values.max(initial=0.0)))
    return np.asarray(vectors[:, is_large] / np.sqrt(values[is_large]))


def orthonormalizing(columns: Array, block: int) -> Array:
    """Return W with which columns X become orthonormal, X W, (k, rank); rows are multiplied block by block.

    Parameters
    ----------
    columns : ndarray, shape (N, k)
    block : int
        Rows of a block.
    """
    root = inverse_root(columns.T @ columns, relative=1e-14)
    gram = np.zeros((root.shape[1], root.shape[1]))
    for start in range(0, len(columns), block):
        part = columns[start : start + block] @ root
        gram += part.T @ part
    # once leaves rounding errors as large as the columns are dependent
    return root @ inverse_root(gram, relative=1e-14)


def falls_from_products(gram: Array, pull: Array, *, least: float = 0.0, relative: float = 0.0) -> Array:
    """Return by how much sets of columns X lower a sum of squares rᵀr, (...), from the products XᵀX and Xᵀr alone.

    Parameters
    ----------
    gram : ndarray, shape (..., k, k)
        XᵀX.
    pull : ndarray, shape (..., k)
        Xᵀr.
    least, relative : float
        Of the directions that count; see :func:`inverse_root`.
    """
    values, vectors = eigh(gram)
    limit = np.maximum(least, relative * values.max(axis=-1, initial=0.0, keepdims=True))
    along = np.einsum("...ji,...j->...i", vectors, pull) ** 2
    return np.asarray(
        np.sum(np.where(values > limit, along / np.where(values > limit, values, 1.0), 0.0), axis=-1)
    )
