"""Decompositions of real matrices that end in a result for every finite matrix.

NumPy's drivers (divide and conquer: gesdd, gelsd, syevd) are fast, but on some finite matrices, of deficient rank as a
rule, their iteration does not converge. The QR iteration of gesvd and syev does; it takes their place then. All
packages from here upwards decompose by these functions, so that no matrix of measurements ends in a traceback.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rodgen.array_types import Array


def svd(matrix: Array, *, full_matrices: bool = False) -> tuple[Array, Array, Array]:
    """Return the singular value decomposition U, s, Vᵀ of matrices (..., m, n), as `numpy.linalg.svd` does.

    Parameters
    ----------
    matrix : ndarray, shape (..., m, n)
    full_matrices : bool
        Whether U and Vᵀ are square.

    Raises
    ------
    numpy.linalg.LinAlgError
        When an entry is not finite.
    """
    try:
        u, s, vt = np.linalg.svd(matrix, full_matrices=full_matrices)
    except np.linalg.LinAlgError:
        from scipy import linalg

        u, s, vt = _each(
            matrix, lambda one: linalg.svd(one, full_matrices=full_matrices, lapack_driver="gesvd")
        )
    return u, s, vt


def eigh(matrix: Array) -> tuple[Array, Array]:
    """Return eigenvalues, the least first, and eigenvectors of symmetric matrices (..., n, n).

    Raises
    ------
    numpy.linalg.LinAlgError
        When an entry is not finite.
    """
    try:
        values, vectors = np.linalg.eigh(matrix)
    except np.linalg.LinAlgError:
        from scipy import linalg

        values, vectors = _each(matrix, lambda one: linalg.eigh(one, driver="ev"))
    return values, vectors


def lstsq(columns: Array, right: Array, *, relative: float | None) -> Array:
    """Return the shortest least-squares solution x of columns x = right, (k,) or (k, K).

    Parameters
    ----------
    columns : ndarray, shape (N, k)
    right : ndarray, shape (N,) or (N, K)
    relative : float
        Singular values of the columns below this part of the largest count as zero; None: rounding.

    Raises
    ------
    numpy.linalg.LinAlgError
        When an entry is not finite.
    """
    try:
        return np.asarray(np.linalg.lstsq(columns, right, rcond=relative)[0])
    except np.linalg.LinAlgError:
        u, s, vt = svd(columns)
        is_large = s > relative * s.max(initial=0.0)
        return np.asarray((vt[is_large].T / s[is_large]) @ (u[:, is_large].T @ right))


def solve(matrix: Array, right: Array) -> Array:
    """Return the solution x of matrix x = right, (k,); the shortest least-squares one where rounding decides.

    Raises
    ------
    numpy.linalg.LinAlgError
        When an entry is not finite.
    """
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return lstsq(matrix, right, relative=float(np.finfo(float).eps))


def _each(matrix: Array, decompose: Callable[[Array], tuple[Array, ...]]) -> tuple[Array, ...]:
    """Return the decomposition of each matrix of a stack by a slower driver."""
    if not np.isfinite(matrix).all():
        raise np.linalg.LinAlgError("a matrix to decompose has an entry that is not finite")
    stack = matrix.shape[:-2]
    parts = zip(*map(decompose, matrix.reshape(math.prod(stack), *matrix.shape[-2:])), strict=True)
    return tuple(np.stack(part).reshape(*stack, *part[0].shape) for part in parts)
