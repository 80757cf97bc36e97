"""Sensitivities of a Tricept's point, singular poses, and its covariance from all geometrical parameters.

With dQ = M33 dpose, and dpose = M35 (dA0, dA1, dA-1, dr, dR) by the implicit equations W33 dpose + W35 d… = 0; so
A35 = M33 M35 = −M33 W33⁻¹ W35 and U_y = A35 U_x A35ᵀ. The rods do not determine the pose where det W33 = 0; the point
does not where det M33 = 0. So for all ``PARAMETERS``, at held readings of the rods: to first order U_y = S U Sᵀ.

A covariance matrix is symmetric and has no negative eigenvalue. Rounding may leave a little of both; more than that is
an error of the input, and is reported.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.generated.numpy import tricept as generated
from rodgen.generated.numpy import tricept_uncertainty as of_parameters
from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.arrays import broadcast_shapes, length_limits, real_array
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.numerics import gains_and_condition
from rodgen.kinematics.ports import documented_by
from rodgen.kinematics.tricept._geometry import GROUPS, PARAMETERS, Geometry, joints
from rodgen.kinematics.tricept._kinematics import lost_behind, pose
from rodgen.statistics.robust import chi3_quantile
from rodgen.views import with_html

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


@with_html
class Matrices(NamedTuple):
    """The paper's matrices; the parameters are in its order A0, A1, A-1, r, R.

    Attributes
    ----------
    W33 : array (..., 3, 3)
        Derivatives of the equations (7) to (9) by α, β, z.
    W35 : array (..., 3, 5)
        Derivatives of these equations by the parameters.
    M33 : array (..., 3, 3)
        Derivatives of the point by α, β, z.
    M35 : array (..., 3, 5)
        Derivatives of α, β, z by the parameters; NaN where W33 is singular.
    A35 : array (..., 3, 5)
        Derivatives of the point by the parameters; NaN where W33 is singular.
    """

    W33: Any
    W35: Any
    M33: Any
    M35: Any
    A35: Any


@with_html
class Singularity(NamedTuple):
    """How near a pose is to a singular one.

    Attributes
    ----------
    det_w33 : array (...)
        Zero where the rods do not determine the pose; length⁵.
    ratio : array (...)
        det W33 / (8 R² z³), 1 in an upright pose.
    det_m33 : array (...)
        Zero where two of the four poses of the point meet; length².
    gains : array (..., 3)
        Singular values of the derivatives of the point by the three rods, the greatest first: how far the point goes
        for one unit of the rods, at most and at least. They have no unit.
    condition : array (...)
        Greatest over least gain.
    """

    det_w33: Any
    ratio: Any
    det_m33: Any
    gains: Any
    condition: Any


@documented_by(generated.tricept_matrices)
def matrices(pose: ArrayLike, geometry: Geometry) -> Matrices:
    """Return W33, W35, M33, M35 and A35 in a pose.

    Parameters
    ----------
    geometry : Geometry
        The machine; its point q counts in M33 and A35.

    Returns
    -------
    Matrices

    Examples
    --------
    >>> from rodgen import tricept
    >>> tricept.matrices([0.0, 0.0, 600.0], tricept.PAPER).A35[2].round(4)
    array([ 0.3496,  0.3496,  0.3496,  0.3167, -0.3167])
    """
    return Matrices(*call_kernel(kernels.tricept_matrices, (pose, *geometry.radii, *geometry.q)))


@documented_by(generated.tricept_singularity)
def singularity(pose: ArrayLike, geometry: Geometry) -> Singularity:
    """Return how near a pose is to a singular one.

    Parameters
    ----------
    geometry : Geometry
        The machine; its point q counts in det M33 and the gains.

    Returns
    -------
    Singularity
        Gains and condition are infinite where the rods do not determine the pose, and NaN where an input is.

    Notes
    -----
    The condition number is that of the derivatives by the rods, the only square matrix here whose elements all have one
    unit.

    Examples
    --------
    >>> from rodgen import tricept
    >>> found = tricept.singularity([0.0, 0.0, 600.0], tricept.PAPER)
    >>> round(float(found.ratio), 6), round(float(found.condition), 4)
    (1.0, 2.5713)
    """
    arguments = (pose, *geometry.radii, *geometry.q)
    det_w33, ratio, det_m33 = call_kernel(kernels.tricept_singularity, arguments)
    rods = np.asarray(call_kernel(kernels.tricept_sensitivity, arguments))[..., :3]
    gains, condition = gains_and_condition(rods)
    free = np.isnan(condition) & ~np.isnan(det_w33)
    gains, condition = np.where(free[..., None], np.inf, gains), np.where(free, np.inf, condition)
    return Singularity(det_w33, ratio, det_m33, gains, condition[()])


# Below this the rows of the closures are dependent to rounding.
_SINGULAR = 64 * 2.0**-52


@documented_by(of_parameters.tricept_parameter_sensitivity, ["sensitivity", "status"])
def parameter_sensitivity(pose: ArrayLike, geometry: Geometry) -> tuple[Any, Any]:
    """Return the derivatives of the tool's place by every geometrical parameter.

    Parameters
    ----------
    geometry : Geometry
        The machine; its point q counts.

    Returns
    -------
    sensitivity
        In the order of ``PARAMETERS``: the first five are the paper's A35. NaN where the machine is singular.
    status : int8 array (...)
        Codes of :class:`TriceptStatus`: REACHABLE, SINGULAR or INVALID.

    Examples
    --------
    >>> from rodgen import tricept
    >>> S, status = tricept.parameter_sensitivity([0.0, 0.0, 600.0], tricept.PAPER)
    >>> S[:, tricept.PARAMETERS.index("C_z")].round(4)  # a fixed joint is higher
    array([0.6061, 1.0497, 0.3333])
    """
    fixed, moving = joints(geometry)
    _, _, sensitivity, regularity = call_kernel(
        kernels.tricept_parameter_sensitivity, (pose, fixed, moving, geometry.q), None
    )
    regularity = np.asarray(regularity)
    good = np.abs(regularity) > _SINGULAR
    bad = np.isnan(np.asarray(pose, float)).any(axis=-1)
    status = np.where(
        good, TriceptStatus.REACHABLE, np.where(bad, TriceptStatus.INVALID, TriceptStatus.SINGULAR)
    )
    return np.where(good[..., None, None], sensitivity, np.nan), status.astype(np.int8)


@documented_by(generated.tricept_propagate)
def propagate(
    point: ArrayLike, geometry: Geometry, U: ArrayLike, limits: Sequence[float] | None = None
) -> tuple[Any, Any]:
    """Return the covariance of a point from that of the parameters, in the pose of the assembled machine.

    Parameters
    ----------
    geometry : Geometry
        The machine.
    U : array_like (..., 5, 5) or (..., n, n), in the units of the parameters
        Covariance of A0, A1, A-1, r, R, or of all ``PARAMETERS`` (see :func:`covariance`).
    limits : pair of floats, optional
        Least and greatest length of a rod, for the status; none when left out.

    Returns
    -------
    U_y
        A35 U_x A35ᵀ, or S U Sᵀ with the sensitivity S to all parameters, to first order.
    status
        U_y is NaN where it is UNREACHABLE, SINGULAR, NOT_COVARIANCE or INVALID. In
        GIMBAL_LOCK it is that of the pose with the undetermined angle set to 0.

    Notes
    -----
    The paper's five go from the point to U_y in one kernel, without angles.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> U_x = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
    >>> U_y, status = tricept.propagate([0.0, 0.0, 700.0], tricept.PAPER, U_x)
    >>> (np.sqrt(np.diagonal(U_y)) * 1000).round(2)  # in µm
    array([5.18, 5.18, 2.81])
    >>> U = tricept.covariance({"rods": 0.0029, "fixed_joints": 0.01})
    >>> U_y, status = tricept.propagate([0.0, 0.0, 700.0], tricept.PAPER, U)
    >>> (np.sqrt(np.diagonal(U_y)) * 1000).round(1)
    array([18.7, 18.7,  6.2])
    """
    shape = np.shape(U)
    if len(shape) < 2 or shape[-2] != shape[-1] or shape[-1] not in (5, len(PARAMETERS)):
        raise RodgenError(
            f"the covariance has the shape {shape}; expected 5 by 5 or {len(PARAMETERS)} by {len(PARAMETERS)}"
        )
    if shape[-1] == 5:
        arguments = (point, *geometry.radii, *geometry.q, *length_limits(limits, "rod"), U)
        U_y, status = call_kernel(kernels.tricept_propagate, arguments)
        lost = lost_behind(point, geometry, status)
        if lost is None:
            return U_y, status
        U_y = np.where(lost[..., None, None], np.nan, U_y)
        return U_y, np.where(lost, np.int8(TriceptStatus.UNREACHABLE), status)
    matrix = np.asarray(U, float)
    place = real_array("point", point, (3,))
    broadcast_shapes({"point": (place, 1), "U": (matrix, 2)})
    pose_there, _, status = pose(point, geometry, limits)
    S, regular = parameter_sensitivity(pose_there, geometry)
    status = np.asarray(status)
    known = np.isin(status, (TriceptStatus.UNREACHABLE, TriceptStatus.INVALID), invert=True)
    good = np.asarray(is_covariance(matrix))
    status = np.where(known & (regular == TriceptStatus.SINGULAR), TriceptStatus.SINGULAR, status)
    status = np.where((status != TriceptStatus.INVALID) & ~good, TriceptStatus.NOT_COVARIANCE, status)
    status = np.where(~np.isfinite(matrix).all(axis=(-1, -2)), TriceptStatus.INVALID, status).astype(np.int8)
    U_y = S @ np.where(good[..., None, None], matrix, np.nan) @ np.swapaxes(S, -1, -2)
    return (U_y + np.swapaxes(U_y, -1, -2)) / 2, status


NEGATIVE = 1e-12
"""Eigenvalues below zero by more than this part of the greatest are not rounding: the matrix is not a covariance."""


@with_html
class Ellipsoid(NamedTuple):
    """The ellipsoid that holds the tool with a probability.

    Attributes
    ----------
    semi_axes : array (..., 3)
        The greatest first, in the unit of length; NaN where the covariance is.
    directions : array (..., 3, 3)
        Their unit vectors, a column each.
    k : float
        Factor on the standard deviations: the root of the quantile of χ² with three degrees of freedom.
    """

    semi_axes: Any
    directions: Any
    k: float


def ellipsoid(U_y: ArrayLike, probability: float | None = None) -> Ellipsoid:
    """Return the ellipsoid of a covariance matrix.

    Parameters
    ----------
    U_y : array_like (..., 3, 3)
        Covariance matrices of points.
    probability : float, optional
        With which a normally distributed point is inside; when left out the standard ellipsoid (k = 1, 19.9 %).

    Returns
    -------
    Ellipsoid

    Raises
    ------
    RodgenError
        When the probability is not between 0 and 1.

    Examples
    --------
    >>> import numpy as np
    >>> found = ellipsoid(np.diag([1.0, 9.0, 4.0]), 0.95)
    >>> found.semi_axes.round(3), round(found.k, 4)
    (array([8.386, 5.591, 2.795]), 2.7955)
    """
    if probability is not None and not 0 < probability < 1:
        raise RodgenError(f"the probability is {probability}; expected a number between 0 and 1")
    k = 1.0 if probability is None else chi3_quantile(1 - probability)
    matrix = real_array("U_y", U_y, (3, 3))
    good: Any = np.isfinite(matrix).all(axis=(-1, -2))
    safe = np.where(good[..., None, None], matrix, np.eye(3))
    values, vectors = np.linalg.eigh((safe + np.swapaxes(safe, -1, -2)) / 2)
    good &= values[..., 0] >= -NEGATIVE * np.abs(values).max(axis=-1)
    axes = k * np.sqrt(np.maximum(values[..., ::-1], 0.0))
    vectors = vectors[..., ::-1]
    # of two opposite directions the one whose largest part is positive
    largest = np.take_along_axis(vectors, np.abs(vectors).argmax(axis=-2)[..., None, :], axis=-2)
    vectors = vectors * np.where(largest < 0, -1.0, 1.0)
    return Ellipsoid(
        np.where(good[..., None], axes, np.nan), np.where(good[..., None, None], vectors, np.nan), k
    )
