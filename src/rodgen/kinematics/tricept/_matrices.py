"""Sensitivities of a Tricept's point to rods and radii, its covariance, and singular poses.

With dQ = M33 dpose, and dpose = M35 (dA0, dA1, dA-1, dr, dR) by the implicit equations W33 dpose + W35 d… = 0; so
A35 = M33 M35 = −M33 W33⁻¹ W35 and U_y = A35 U_x A35ᵀ. The rods do not determine the pose where det W33 = 0; the point
does not where det M33 = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.dimensions import length_limits
from rodgen.kinematics.gains import gains_and_condition
from rodgen.kinematics.kernel_call import call_kernel
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept._kinematics import lost_behind
from rodgen.views import html_of


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

    def _repr_html_(self) -> str:
        return html_of(self)


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

    def _repr_html_(self) -> str:
        return html_of(self)


def matrices(pose: ArrayLike, geometry: Geometry) -> Matrices:
    """Return W33, W35, M33, M35 and A35 in a pose.

    Parameters
    ----------
    pose : array_like (..., 3)
        α and β in rad, and z.
    geometry : Geometry
        The machine; its point q counts in M33 and A35.

    Returns
    -------
    Matrices

    Notes
    -----
    Kureková et al., eqs. (5) to (20); proved in the derivation ``tricept``.

    Examples
    --------
    >>> from rodgen import tricept
    >>> tricept.matrices([0.0, 0.0, 600.0], tricept.PAPER).A35[2].round(4)
    array([ 0.3496,  0.3496,  0.3496,  0.3167, -0.3167])
    """
    return Matrices(*call_kernel(kernels.tricept_matrices, (pose, *geometry.radii, *geometry.q)))


def sensitivity(pose: ArrayLike, geometry: Geometry) -> Any:
    """Return A35, the derivatives of the point by A0, A1, A-1, r, R.

    Parameters
    ----------
    pose : array_like (..., 3)
        α and β in rad, and z.
    geometry : Geometry
        The machine.

    Returns
    -------
    array (..., 3, 5)
        NaN where the rods do not determine the pose.

    Notes
    -----
    Kureková et al., eq. (20). The same as ``matrices(pose, geometry).A35``, with less work.

    Examples
    --------
    >>> from rodgen import tricept
    >>> tricept.sensitivity([0.0, 0.0, 600.0], tricept.PAPER)[0, :3].round(4)
    array([-1.2714,  0.6357,  0.6357])
    """
    return call_kernel(kernels.tricept_sensitivity, (pose, *geometry.radii, *geometry.q))


def propagate(
    point: ArrayLike, geometry: Geometry, U_x: ArrayLike, limits: Sequence[float] | None = None
) -> tuple[Any, Any]:
    """Return the covariance of a point from that of the parameters, in the pose of the assembled machine.

    Parameters
    ----------
    point : array_like (..., 3)
        Q, from the base's centre.
    geometry : Geometry
        The machine.
    U_x : array_like (..., 5, 5)
        Covariance of A0, A1, A-1, r, R: symmetric and positive semidefinite, in the square of the unit of length.
    limits : pair of floats, optional
        Least and greatest length of a rod, for the status; none when left out.

    Returns
    -------
    U_y : array (..., 3, 3)
        A35 U_x A35ᵀ.
    status : array (...) of int8
        Codes of :class:`TriceptStatus`. U_y is NaN where it is UNREACHABLE, SINGULAR, NOT_COVARIANCE or INVALID. In
        GIMBAL_LOCK it is that of the pose with the undetermined angle set to 0.

    Notes
    -----
    Kureková et al., eqs. (20) and (21), to first order. From the point to U_y in one kernel, without angles.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> U_x = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
    >>> U_y, status = tricept.propagate([0.0, 0.0, 700.0], tricept.PAPER, U_x)
    >>> (np.sqrt(np.diagonal(U_y)) * 1000).round(2)  # in µm
    array([5.18, 5.18, 2.81])
    """
    arguments = (point, *geometry.radii, *geometry.q, *length_limits(limits, "rod"), U_x)
    U_y, status = call_kernel(kernels.tricept_propagate, arguments)
    lost = lost_behind(point, geometry, status)
    if lost is None:
        return U_y, status
    U_y = np.where(lost[..., None, None], np.nan, U_y)
    return U_y, np.where(lost, np.int8(TriceptStatus.UNREACHABLE), status)


def singularity(pose: ArrayLike, geometry: Geometry) -> Singularity:
    """Return how near a pose is to a singular one.

    Parameters
    ----------
    pose : array_like (..., 3)
        α and β in rad, and z.
    geometry : Geometry
        The machine; its point q counts in det M33 and the gains.

    Returns
    -------
    Singularity
        Gains and condition are infinite where the rods do not determine the pose, and NaN where an input is.

    Notes
    -----
    Kureková et al., after eqs. (10) and (19). The condition number is that of the derivatives by the rods, the only
    square matrix here whose elements all have one unit.

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
