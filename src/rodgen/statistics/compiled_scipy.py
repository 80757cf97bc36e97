"""SciPy's special functions, and LAPACK for banded matrices, without the start of the packages around them.

`import scipy.special` and `import scipy.linalg` take half a second of processor time, nearly all of it for modules that
nothing here calls: f2py, the array interfaces of other libraries, sparse matrices, graphs. The two compiled modules
that do the work take 0.02 s. So they are imported by themselves, unless their package is there already or a version of
SciPy has them elsewhere; the functions are the same objects in any case.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import scipy

from rodgen.array_types import Array


def _compiled(package: str, module: str, public: str) -> Any:
    """Import a compiled module without running the `__init__` of its package; the public one where that fails."""
    if package in sys.modules:
        return import_module(public)
    bare = sys.modules[package] = ModuleType(package)
    bare.__path__ = [os.path.join(scipy.__path__[0], package.rpartition(".")[2])]
    try:
        return import_module(module)
    except (ImportError, AttributeError):
        pass
    finally:
        del sys.modules[package]
    return import_module(public)


special = _compiled("scipy.special", "scipy.special._ufuncs", "scipy.special")
_lapack = _compiled("scipy.linalg", "scipy.linalg._flapack", "scipy.linalg.lapack")


def apply_reflectors(reflectors: Array, scales: Array, columns: Array) -> Array:
    """Return Qᵀ columns, (N, K), with Q as `numpy.linalg.qr(..., mode="raw")` returns it."""
    found, _, _ = _lapack.dormqr(
        "L", "T", reflectors[: len(scales)].T, scales, columns, 64 * columns.shape[1]
    )
    return np.asarray(found)


def cholesky_banded(band: Array) -> Array:
    """Return the lower band of the Cholesky factor of a matrix given by its lower band, (b, n)."""
    factor, info = _lapack.dpbtrf(band, lower=1)
    if info:
        raise np.linalg.LinAlgError(f"the leading minor of order {info} is not positive definite")
    return np.asarray(factor)


def solve_triangular_band(factor: Array, side: Array, *, transposed: bool = False) -> Array:
    """Solve with a lower triangular matrix given by its band, (b, n), or with its transpose, for (n, k)."""
    found, _ = _lapack.dtbtrs(factor, np.asfortranarray(side), uplo="L", trans="T" if transposed else "N")
    return np.asarray(found)


def solveh_banded(band: Array, side: Array) -> Array:
    """Solve with a positive definite matrix given by its lower band, (b, n), for (n, k)."""
    _, found, info = _lapack.dpbsv(band, side, lower=1)
    if info:
        raise np.linalg.LinAlgError(f"the leading minor of order {info} is not positive definite")
    return np.asarray(found)


def gesvd(matrix: Array, *, full_matrices: bool) -> tuple[Array, Array, Array]:
    """Return U, s and Vᵀ of a matrix (m, n) by QR iteration."""
    u, s, vt, info = _lapack.dgesvd(matrix, full_matrices=full_matrices)
    if info:
        raise np.linalg.LinAlgError("the singular value decomposition did not converge")
    return u, s, vt


def syev(matrix: Array) -> tuple[Array, Array]:
    """Return the eigenvalues, the least first, and eigenvectors of a symmetric matrix (n, n) by QR iteration."""
    values, vectors, info = _lapack.dsyev(matrix, lower=1)
    if info:
        raise np.linalg.LinAlgError("the eigenvalues did not converge")
    return values, vectors
