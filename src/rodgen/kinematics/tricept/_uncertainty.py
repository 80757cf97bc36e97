"""The covariance of the place of a Tricept's tool from all geometrical parameters, and its ellipsoid.

Given the covariance of the parameters, to first order U_y = S U Sᵀ with the sensitivity S of Q to all
``PARAMETERS`` by the implicit function theorem, at held readings of the rods.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.arrays import broadcast_shapes, real_array
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.kernel_call import call_kernel
from rodgen.kinematics.tricept._covariance import is_covariance
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept._kinematics import pose
from rodgen.kinematics.tricept._matrices import propagate
from rodgen.kinematics.tricept._parameters import PARAMETERS, joints
from rodgen.statistics.chi_distribution import chi3_quantile
from rodgen.views import html_of

# Below this the rows of the closures are dependent to rounding.
_SINGULAR = 64 * 2.0**-52


def parameter_sensitivity(pose: ArrayLike, geometry: Geometry) -> tuple[Any, Any]:
    """Return the derivatives of the tool's place by every geometrical parameter.

    Parameters
    ----------
    pose : array_like (..., 3)
        α and β in rad, and z.
    geometry : Geometry
        The machine; its point q counts.

    Returns
    -------
    sensitivity : array (..., 3, n)
        A column for each of ``PARAMETERS``: no unit for lengths, length/rad for angles. The first five are the paper's
        A35. NaN where the machine is singular.
    status : array (...) of int8
        Codes of :class:`TriceptStatus`: REACHABLE, SINGULAR or INVALID.

    Notes
    -----
    Kureková et al., sec. 3 a) to g); proved in the derivation ``tricept_uncertainty``.

    Examples
    --------
    >>> from rodgen import tricept
    >>> S, status = tricept.parameter_sensitivity([0.0, 0.0, 600.0], tricept.PAPER)
    >>> S[:, tricept.PARAMETERS.index("C_z")].round(4)  # a fixed joint is higher
    array([0.6061, 1.0497, 0.3333])
    """
    fixed, moving = joints(geometry)
    _, _, found, regularity = call_kernel(
        kernels.tricept_parameter_sensitivity, (pose, fixed, moving, geometry.q), None
    )
    regularity = np.asarray(regularity)
    good = np.abs(regularity) > _SINGULAR
    bad = np.isnan(np.asarray(pose, float)).any(axis=-1)
    status = np.where(
        good, TriceptStatus.REACHABLE, np.where(bad, TriceptStatus.INVALID, TriceptStatus.SINGULAR)
    )
    return np.where(good[..., None, None], found, np.nan), status.astype(np.int8)


def regular_place(point: ArrayLike, geometry: Geometry) -> tuple[Array, Array, Array]:
    """Return one point as an array (3,), the pose of the assembled machine, and the sensitivity to all ``PARAMETERS``.

    Raises
    ------
    RodgenError
        When it is not a point, or one without a regular pose.
    """
    place = np.asarray(point, float)
    if place.shape != (3,):
        raise RodgenError(f"the point has the shape {place.shape}; expected three coordinates")
    found, _, reached = pose(place, geometry)
    S, status = parameter_sensitivity(found, geometry)
    if reached == TriceptStatus.UNREACHABLE:
        raise RodgenError(
            f"the point {place.tolist()} has no regular pose of the assembled machine; expected one before the base"
        )
    if status != TriceptStatus.REACHABLE or not np.isfinite(S).all():
        raise RodgenError(
            f"the point {place.tolist()} has no regular pose; expected one that the machine reaches"
        )
    return place, found, S


def place_covariance(
    point: ArrayLike, geometry: Geometry, U: ArrayLike, limits: Sequence[float] | None = None
) -> tuple[Any, Any]:
    """Return the covariance of the tool's place from that of the parameters, the paper's five or all.

    Parameters
    ----------
    point : array_like (..., 3)
        Q, from the base's centre.
    geometry : Geometry
        The machine.
    U : array_like (..., 5, 5) or (..., n, n)
        Covariance of A0, A1, A-1, r, R, or of all ``PARAMETERS`` (see `covariance`).
    limits : pair of floats, optional
        Least and greatest length of a rod, for the status; none when left out.

    Returns
    -------
    U_y : array (..., 3, 3)
        Covariance of Qx, Qy, Qz, in the square of the unit of length.
    status : array (...) of int8
        Codes of :class:`TriceptStatus`. U_y is NaN where it is UNREACHABLE, SINGULAR, NOT_COVARIANCE or INVALID.

    Raises
    ------
    RodgenError
        When U has another size.

    Notes
    -----
    Kureková et al., eq. (21).

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> U = tricept.covariance({"rods": 0.0029, "fixed_joints": 0.01})
    >>> U_y, status = tricept.place_covariance([0.0, 0.0, 700.0], tricept.PAPER, U)
    >>> (np.sqrt(np.diagonal(U_y)) * 1000).round(1)  # in µm
    array([18.7, 18.7,  6.2])
    """
    matrix = np.asarray(U, float)
    size = matrix.shape[-1] if matrix.ndim >= 2 else 0
    if matrix.ndim < 2 or matrix.shape[-2] != size or size not in (5, len(PARAMETERS)):
        raise RodgenError(
            f"the covariance has the shape {matrix.shape}; expected 5 by 5 or {len(PARAMETERS)} by {len(PARAMETERS)}"
        )
    if size == 5:
        return propagate(point, geometry, matrix, limits)
    place = real_array("point", point, (3,))
    broadcast_shapes({"point": (place, 1), "U": (matrix, 2)})
    found, _, status = pose(point, geometry, limits)
    S, regular = parameter_sensitivity(found, geometry)
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


class Ellipsoid(NamedTuple):
    """The ellipsoid that holds the tool with a probability.

    Attributes
    ----------
    semi_axes : array (..., 3)
        The greatest first, in the unit of length; NaN where the covariance is.
    directions : array (..., 3, 3)
        Their unit vectors, a column each.
    k : float
        Factor on the standard deviations.
    """

    semi_axes: Any
    directions: Any
    k: float

    def _repr_html_(self) -> str:
        return html_of(self)


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

    Examples
    --------
    >>> import numpy as np
    >>> found = ellipsoid(np.diag([1.0, 9.0, 4.0]), 0.95)
    >>> found.semi_axes.round(3), round(found.k, 4)
    (array([8.386, 5.591, 2.795]), 2.7955)
    """
    k = 1.0 if probability is None else coverage_factor(probability)
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


def coverage_factor(probability: float) -> float:
    """Return the factor on the standard ellipsoid for which it holds a normal point in space with a probability.

    Parameters
    ----------
    probability : float
        Between 0 and 1.

    Returns
    -------
    float
        k, with P = erf(k/√2) − √(2/π) k exp(−k²/2): the root of the quantile of χ² with three degrees of freedom.

    Raises
    ------
    RodgenError
        When the probability is not between 0 and 1.

    Examples
    --------
    >>> round(coverage_factor(0.95), 4)
    2.7955
    """
    if not 0 < probability < 1:
        raise RodgenError(f"the probability is {probability}; expected a number between 0 and 1")
    return chi3_quantile(1 - probability)
