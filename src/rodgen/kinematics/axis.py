"""The axis of a rotation from one point before and after it, and the angle.

A point of a body is at ρ before and at ρ′ after a rotation by the known angle χ about an axis through
the origin; the unit axes e with ρ′ = R(e, χ) ρ are wanted. With m = ρ′ + ρ, r = ρ′ - ρ and the perpendicular unit
vectors m̂ = m / |m| and n = m × r / (|m| |r|) there are at most two: e± = n cos b ± m̂ sin b, where
cos b = cot(χ/2) |r| / |m|. Derived, with the form that is computed, in ``derivation/axis.py``; see also
docs/solver_method.md.

Every function works on arrays of any shape, element by element, broadcasts, and passes Dask arrays through.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from rodgen.generated.numpy.axis import AxisStatus
from rodgen.kinematics.backend import call_kernel, kernels

__all__ = [
    "AxisStatus",
    "axis_condition",
    "axis_covariance",
    "axis_jacobian",
    "length_mismatch",
    "solve_axis",
]


def solve_axis(
    rho: ArrayLike,
    rho_prime: ArrayLike,
    angle: ArrayLike,
    *,
    length_tolerance: ArrayLike = 1e-8,
    out: tuple[Any, Any] | None = None,
) -> tuple[Any, Any]:
    """Return the unit axes through the origin that turn `rho` into `rho_prime` by `angle`.

    Parameters
    ----------
    rho, rho_prime : array_like (..., 3)
        Point before and after the rotation, in one length unit.
    angle : array_like (...)
        Angle of the rotation in rad, of any sign and size.
    length_tolerance : array_like (...), optional
        Largest ``abs(length_mismatch(rho, rho_prime))`` that is accepted; below 8 ε it counts as 8 ε, where ε is the
        machine epsilon of the number type. Measured points need about six times their relative uncertainty.
    out : tuple of two arrays, optional
        Where the results go: (..., 2, 3) and (...) int8.

    Returns
    -------
    axes : array (..., 2, 3)
        Two unit axes, the one at an acute angle to `rho` first. Unless there are exactly two, the status says what the
        rows are. NaN exactly where the status is INVALID.
    status : array (...) of int8
        Codes of :class:`AxisStatus`.

    Raises
    ------
    ValueError
        When shapes do not broadcast, or a last axis is not 3 long.
    TypeError
        When an argument is not real.

    Notes
    -----
    Stebulyanin and Pimushkin, "Solution of the Rodriguez Equation in Modeling Volumetric Geometric Accuracy of
    Multi-Coordinate Systems", eq. (1), solved in coordinate-free form; proved in the derivation ``axis``. The
    error of an axis is at most 12 ε times :func:`axis_condition`, certified for the inputs in docs/certified.md.
    The tests find at most 4 ε times it, and up to 10 ε times it where ρ′ is 3 to 9 times as long as ρ. float32 input
    gives float32 results.

    Examples
    --------
    >>> import numpy as np
    >>> import rodgen
    >>> axes, status = rodgen.solve_axis([2.0, 0.0, 1.0], [0.0, 2.0, 1.0], np.pi / 2)
    >>> np.round(axes, 6) + 0.0
    array([[ 0.      ,  0.      ,  1.      ],
           [-0.666667, -0.666667,  0.333333]])
    >>> rodgen.AxisStatus(int(status))
    <AxisStatus.TWO_AXES: 0>
    """
    return call_kernel(kernels.solve_axis, (rho, rho_prime, angle, length_tolerance), out)  # type: ignore[no-any-return]


def length_mismatch(rho: ArrayLike, rho_prime: ArrayLike) -> Any:
    """Return the relative difference of the lengths, ``|rho_prime| / |rho| - 1``.

    Parameters
    ----------
    rho, rho_prime : array_like (..., 3)
        Point before and after the rotation, in one length unit.

    Returns
    -------
    array (...)
        0 for two points at the origin, infinite when only the first is there.

    Examples
    --------
    >>> import rodgen
    >>> round(float(rodgen.length_mismatch([3.0, 0.0, 0.0], [0.0, 3.3, 0.0])), 9)
    0.1
    """
    return call_kernel(kernels.length_mismatch, (rho, rho_prime))


def axis_condition(rho: ArrayLike, rho_prime: ArrayLike, angle: ArrayLike) -> Any:
    """Return the condition number of the axis with respect to the points.

    It is 1 / (2 √(sin(χ/2 - a) sin(χ/2 + a))), where 2a is the angle between the points: a relative error ε of a point
    moves an axis by at most about that times ε.

    Parameters
    ----------
    rho, rho_prime : array_like (..., 3)
        Point before and after the rotation, in one length unit.
    angle : array_like (...)
        Angle of the rotation in rad.

    Returns
    -------
    array (...)
        Infinite where the two axes meet (ONE_AXIS) and where there is none; NaN where a number is not finite.

    Examples
    --------
    >>> import rodgen
    >>> round(float(rodgen.axis_condition([2.0, 0.0, 1.0], [0.0, 2.0, 1.0], 1.5707963267948966)), 6)
    1.581139
    """
    return call_kernel(kernels.axis_condition, (rho, rho_prime, angle))


def axis_jacobian(
    rho: ArrayLike, rho_prime: ArrayLike, angle: ArrayLike, *, length_tolerance: ArrayLike = 1e-8
) -> tuple[Any, Any]:
    """Return the derivatives of both axes with respect to both points and the angle.

    Parameters
    ----------
    rho, rho_prime, angle, length_tolerance
        As for :func:`solve_axis`.

    Returns
    -------
    jacobian : array (..., 2, 3, 7)
        The last axis runs over the components of `rho`, those of `rho_prime` (per length unit) and `angle` (per rad).
        It grows without bound where the two axes meet, and means nothing where the status is neither TWO_AXES,
        PARALLEL nor LENGTHS_DIFFER.
    status : array (...) of int8
        Codes of :class:`AxisStatus`.

    Examples
    --------
    >>> import rodgen
    >>> jacobian, status = rodgen.axis_jacobian([2.0, 0.0, 1.0], [0.0, 2.0, 1.0], 1.5707963267948966)
    >>> jacobian.shape
    (2, 3, 7)
    """
    arguments = (rho, rho_prime, angle, length_tolerance)
    return call_kernel(kernels.axis_jacobian, arguments)  # type: ignore[no-any-return]


def axis_covariance(
    rho: ArrayLike,
    rho_prime: ArrayLike,
    angle: ArrayLike,
    cov_rho: ArrayLike,
    cov_rho_prime: ArrayLike,
    var_angle: ArrayLike = 0.0,
    *,
    length_tolerance: ArrayLike = 1e-8,
) -> tuple[Any, Any]:
    """Return the covariance of both axes from that of the points and the angle, to first order.

    Parameters
    ----------
    rho, rho_prime, angle, length_tolerance
        As for :func:`solve_axis`.
    cov_rho, cov_rho_prime : array_like (..., 3, 3)
        Covariance matrices of the points, in the square of their unit; ``sigma**2 * np.eye(3)`` for equal,
        independent uncertainty.
    var_angle : array_like (...), optional
        Variance of the angle, rad².

    Returns
    -------
    covariance : array (..., 2, 3, 3)
        Covariance matrix of each axis; of rank 2, since an axis keeps its length.
    status : array (...) of int8
        Codes of :class:`AxisStatus`; the covariance is NaN where the axes meet or are not determined.

    Examples
    --------
    >>> import numpy as np
    >>> import rodgen
    >>> noise = 0.001**2 * np.eye(3)
    >>> covariance, status = rodgen.axis_covariance(
    ...     [2.0, 0.0, 1.0], [0.0, 2.0, 1.0], np.pi / 2, noise, noise)
    >>> np.round(np.sqrt(np.diagonal(covariance[0])), 6)
    array([0.000775, 0.000775, 0.      ])
    """
    arguments = (rho, rho_prime, angle, length_tolerance, cov_rho, cov_rho_prime, var_angle)
    return call_kernel(kernels.axis_covariance, arguments)  # type: ignore[no-any-return]
