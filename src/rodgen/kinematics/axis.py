"""The axis of a rotation from one point before and after it, and the angle.

A point of a body is at ρ before and at ρ′ after a rotation by the known angle χ about an axis through
the origin; the unit axes e with ρ′ = R(e, χ) ρ are wanted. With m = ρ′ + ρ, r = ρ′ - ρ and the perpendicular unit
vectors m̂ = m / |m| and n = m × r / (|m| |r|) there are at most two: e± = n cos b ± m̂ sin b, where
cos b = cot(χ/2) |r| / |m|. Derived, with the form that is computed, in ``derivation/axis.py``; see also
docs/science/solver_method.md.

Every function works on arrays of any shape, element by element, broadcasts, and passes Dask arrays through.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from rodgen.generated.numpy import axis as generated
from rodgen.generated.numpy.axis import AxisStatus
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.ports import documented_by

__all__ = [
    "AxisStatus",
    "axis_condition",
    "axis_covariance",
    "axis_jacobian",
    "length_mismatch",
    "solve_axis",
]


@documented_by(generated.solve_axis)
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
    angle
        It may have any sign and size.
    length_tolerance
        It is the largest ``abs(length_mismatch(rho, rho_prime))``; below 8 ε it counts as 8 ε, where ε is the machine
        epsilon of the number type. Measured points need about six times their relative uncertainty.
    out : tuple of two arrays, optional
        Where the results go: (..., 2, 3) and (...) int8.

    Returns
    -------
    axes
        The one at an acute angle to `rho` is first. Unless there are exactly two, the status says what the rows are.
        NaN exactly where the status is INVALID.

    Notes
    -----
    The paper is "Solution of the Rodriguez Equation in Modeling Volumetric Geometric Accuracy of Multi-Coordinate
    Systems". The error of an axis is at most 12 ε times :func:`axis_condition`, certified for the inputs in
    docs/science/certified.md. The tests find at most 4 ε times it, and up to 10 ε times it where ρ′ is 3 to 9 times
    as long as ρ. float32 input gives float32 results.

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


@documented_by(generated.length_mismatch)
def length_mismatch(rho: ArrayLike, rho_prime: ArrayLike) -> Any:
    """Return the relative difference of the lengths, ``|rho_prime| / |rho| - 1``.

    Returns
    -------
    mismatch
        It is 0 for two points at the origin, infinite when only the first is there.

    Examples
    --------
    >>> import rodgen
    >>> round(float(rodgen.length_mismatch([3.0, 0.0, 0.0], [0.0, 3.3, 0.0])), 9)
    0.1
    """
    return call_kernel(kernels.length_mismatch, (rho, rho_prime))


@documented_by(generated.axis_condition)
def axis_condition(rho: ArrayLike, rho_prime: ArrayLike, angle: ArrayLike) -> Any:
    """Return the condition number of the axis with respect to the points.

    It is 1 / (2 √(sin(χ/2 - a) sin(χ/2 + a))), where 2a is the angle between the points: a relative error ε of a point
    moves an axis by at most about that times ε.

    Returns
    -------
    condition
        Infinite where the two axes meet (ONE_AXIS) and where there is none.

    Examples
    --------
    >>> import rodgen
    >>> round(float(rodgen.axis_condition([2.0, 0.0, 1.0], [0.0, 2.0, 1.0], 1.5707963267948966)), 6)
    1.581139
    """
    return call_kernel(kernels.axis_condition, (rho, rho_prime, angle))


@documented_by(generated.axis_jacobian)
def axis_jacobian(
    rho: ArrayLike, rho_prime: ArrayLike, angle: ArrayLike, *, length_tolerance: ArrayLike = 1e-8
) -> tuple[Any, Any]:
    """Return the derivatives of both axes with respect to both points and the angle.

    Returns
    -------
    axes_jacobian
        It grows without bound where the two axes meet, and means nothing where the status is neither TWO_AXES,
        PARALLEL nor LENGTHS_DIFFER.

    Examples
    --------
    >>> import rodgen
    >>> jacobian, status = rodgen.axis_jacobian([2.0, 0.0, 1.0], [0.0, 2.0, 1.0], 1.5707963267948966)
    >>> jacobian.shape
    (2, 3, 7)
    """
    arguments = (rho, rho_prime, angle, length_tolerance)
    return call_kernel(kernels.axis_jacobian, arguments)  # type: ignore[no-any-return]


@documented_by(generated.axis_covariance)
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
    cov_rho
        It is ``sigma**2 * np.eye(3)`` for equal, independent uncertainty.

    Returns
    -------
    covariance
        It is of rank 2, since an axis keeps its length, and NaN where the axes meet or are not determined.

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
