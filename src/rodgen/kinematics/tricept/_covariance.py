"""Covariance matrices of parameters: checks, and construction from standard uncertainties.

A covariance matrix is symmetric and has no negative eigenvalue. Rounding may leave a little of both; more than that is
an error of the input, and is reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.tricept._parameters import GROUPS, PARAMETERS

# Room for a matrix that was multiplied out in double precision, none for a wrong sign in the last printed digit.
_TOLERANCE = 1e-10


def is_covariance(U: ArrayLike) -> Any:
    """Return whether matrices are covariance matrices.

    Parameters
    ----------
    U : array_like (..., n, n)
        Matrices.

    Returns
    -------
    array (...) of bool
        Finite, symmetric and without negative eigenvalues, to 1e-10 of the standard deviations' products.

    Examples
    --------
    >>> is_covariance([[1.0, 2.0], [2.0, 1.0]])
    False
    """
    matrix = real_array("U", U)
    if matrix.ndim < 2 or matrix.shape[-1] != matrix.shape[-2]:
        raise RodgenError(f"U has the shape {matrix.shape}; expected (..., n, n)")
    finite: Any = np.isfinite(matrix).all(axis=(-1, -2))
    safe = np.where(finite[..., None, None], matrix, 0.0)
    scaled, sizes = correlation_of(safe)
    symmetric: Any = (np.abs(scaled - scaled.swapaxes(-1, -2)) <= _TOLERANCE).all(axis=(-1, -2))
    positive = (np.diagonal(safe, axis1=-2, axis2=-1) >= 0).all(axis=-1)
    # a zero variance allows no covariance
    lost: Any = (np.abs(safe) > 0) & ((sizes[..., :, None] == 0) | (sizes[..., None, :] == 0))
    clean = np.where(symmetric[..., None, None], (scaled + scaled.swapaxes(-1, -2)) / 2, 0.0)
    least = np.linalg.eigvalsh(clean)[..., 0] if matrix.shape[-1] else np.zeros(matrix.shape[:-2])
    room = _TOLERANCE * max(matrix.shape[-1], 1)
    good = finite & symmetric & positive & ~lost.any(axis=(-1, -2)) & (least >= -room)
    return bool(good) if good.ndim == 0 else good


def correlation_of(matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return correlations (covariances where a variance is 0) and standard deviations."""
    sizes = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 0.0))
    by = np.where(sizes > 0, sizes, 1.0)
    return matrix / by[..., :, None] / by[..., None, :], sizes


def check_covariance(U: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return one covariance matrix of `count` parameters.

    Raises
    ------
    RodgenError
        When it is not a covariance matrix; the message says why.
    """
    try:
        matrix = np.asarray(U, float)
    except (TypeError, ValueError):
        raise RodgenError(f"the covariance is not an array of numbers; expected {count} by {count}") from None
    if matrix.shape != (count, count):
        raise RodgenError(f"the covariance has the shape {matrix.shape}; expected ({count}, {count})")
    if not np.isfinite(matrix).all():
        raise RodgenError("the covariance has elements that are not finite; expected numbers")
    scaled, _ = correlation_of(matrix)
    if (np.diagonal(matrix) < 0).any():
        n = int(np.argmin(np.diagonal(matrix)))
        raise RodgenError(
            f"the variance {n + 1} of the covariance is {matrix[n, n]:g}; expected none below 0"
        )
    difference = np.abs(scaled - scaled.T)
    if difference.max(initial=0.0) > _TOLERANCE:
        i, j = np.unravel_index(int(difference.argmax()), difference.shape)
        raise RodgenError(
            f"the covariance is not symmetric: {matrix[i, j]:g} at ({i + 1}, {j + 1}) and {matrix[j, i]:g} across; "
            "expected the same number"
        )
    if not is_covariance(matrix):
        least = np.linalg.eigvalsh((scaled + scaled.T) / 2)[0]
        raise RodgenError(
            f"the covariance is not positive semidefinite (its correlations have the eigenvalue {least:.3g}); expected "
            "none below 0"
        )
    clean: NDArray[np.float64] = (matrix + matrix.T) / 2
    return clean


def parameter_covariance(U: ArrayLike) -> NDArray[np.float64]:
    """Return one checked covariance matrix, of the paper's five parameters or of all."""
    return check_covariance(U, 5 if np.shape(U) == (5, 5) else len(PARAMETERS))


def covariance(
    uncertainties: Mapping[str, float], correlations: Mapping[tuple[str, str], float] | None = None
) -> NDArray[np.float64]:
    """Return the covariance matrix of all parameters from standard uncertainties.

    Parameters
    ----------
    uncertainties : mapping of str to float
        Standard uncertainty of a parameter (see ``PARAMETERS``) or of each of a group (see ``GROUPS``), lengths in one
        unit, angles in rad. Every other is 0. A parameter's own takes precedence over its group's.
    correlations : mapping of pairs of str to float, optional
        Correlation of two parameters, or of each pair in a group given twice, such as ``("rods", "rods")``; each must
        have an uncertainty.

    Returns
    -------
    ndarray, shape (n, n)
        In the order of ``PARAMETERS``.

    Raises
    ------
    RodgenError
        When a name is unknown, a number is negative, a parameter without an uncertainty is correlated, or the
        correlations cannot be together.

    Examples
    --------
    >>> import numpy as np
    >>> U = covariance({"rods": 0.003, "A0": 0.005})
    >>> np.sqrt(np.diagonal(U))[:4]
    array([0.005, 0.003, 0.003, 0.   ])
    """
    sizes = np.zeros(len(PARAMETERS))
    for name, value in sorted(uncertainties.items(), key=lambda item: item[0] not in GROUPS):
        if not 0 <= value < np.inf:
            raise RodgenError(f"the uncertainty of {name} is {value}; expected a number from 0 up")
        sizes[_members(name)] = value
    matrix = np.eye(len(PARAMETERS))
    for (one, two), value in (correlations or {}).items():
        if not -1 <= value <= 1:
            raise RodgenError(f"the correlation of {one} and {two} is {value}; expected -1 to 1")
        for n in (*_members(one), *_members(two)):
            if sizes[n] == 0:
                raise RodgenError(
                    f"{one} and {two} are correlated, but the uncertainty of {PARAMETERS[n]} is 0; expected one above 0"
                )
        for i in _members(one):
            for j in _members(two):
                if i != j:
                    matrix[i, j] = matrix[j, i] = value
    return check_covariance(matrix * sizes[:, None] * sizes[None, :], len(PARAMETERS))


def _members(name: str) -> list[int]:
    if name in GROUPS:
        return [PARAMETERS.index(member) for member in GROUPS[name]]
    if name in PARAMETERS:
        return [PARAMETERS.index(name)]
    raise RodgenError(
        f"{name!r} is not a parameter of a Tricept; expected one of {', '.join((*GROUPS, *PARAMETERS))}"
    )
