"""Spherical four-bar and five-bar linkages: all joint angles from the twists and the angles of the driven joints.

Quadrilateral: the cosine law Z_41 = c_23 is A cos θ₁ + B sin θ₁ + D = 0 with A = s_12 Y_4, B = s_12 X_4 and
D = c_12 Z_4 - c_23, so there are two ways to close, one or none; θ₂ and θ₃ follow from their sines and cosines. Where
two neighbouring axes coincide, a joint can be at any angle.

Pentagon: the cosine law Z_45 = Z_2 has θ₂ alone, so there are two of opposite signs. Then θ₁ is linear in its sine and
cosine by X_45 = X_21 and Y_45 = -X*_21, and θ₃ follows from its own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.generated.numpy.spherical_polygons import PolygonStatus
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.kernel_call import call_kernel

__all__ = ["PolygonStatus", "spherical_pentagon", "spherical_quadrilateral"]


def spherical_quadrilateral(alpha: ArrayLike, theta_4: ArrayLike) -> tuple[Any, Any]:
    """Return all joint angles of a spherical four-bar linkage.

    Parameters
    ----------
    alpha : array_like (..., 4)
        Twists α12, α23, α34, α41 in rad, of any sign.
    theta_4 : array_like (...)
        Angle of joint 4, between the links 34 and 41, in rad.

    Returns
    -------
    theta : array (..., 2, 4)
        Joint angles 1 to 4 in rad of both ways to close, from -π to π, the last as it was given. NaN where, and only
        where, the status is NONE or INVALID.
    status : array (...) of int8
        Codes of :class:`PolygonStatus`.

    Raises
    ------
    ValueError
        When the shapes do not broadcast, or the last axis of `alpha` is not 4 long.

    Notes
    -----
    Lecture notes "Robot Geometry" after Crane and Duffy, "Spherical Mechanism Equation Toolkit"; proved in the
    derivation ``spherical_polygons``. Angles are from link to link about the joint, so θ is π less the angle inside
    the polygon. Near DOUBLE an angle is right to half of the digits, as for any method.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> theta, status = spatial.spherical_quadrilateral(np.radians([40, 70, 85, 70]), np.radians(75))
    >>> np.degrees(theta).round(4)
    array([[136.543 , -38.2302, 135.7593,  75.    ],
           [ 63.5047,  38.2302,  87.7179,  75.    ]])
    >>> spatial.PolygonStatus(int(status)).name
    'TWO'
    """
    return call_kernel(kernels.polygon_quadrilateral, (alpha, theta_4))  # type: ignore[no-any-return]


def spherical_pentagon(alpha: ArrayLike, theta_4: ArrayLike, theta_5: ArrayLike) -> tuple[Any, Any]:
    """Return all joint angles of a spherical five-bar linkage.

    Parameters
    ----------
    alpha : array_like (..., 5)
        Twists α12, α23, α34, α45, α51 in rad, of any sign.
    theta_4, theta_5 : array_like (...)
        Angles of the joints 4 and 5 in rad.

    Returns
    -------
    theta : array (..., 2, 5)
        Joint angles 1 to 5 in rad of both ways to close, from -π to π, the last two as they were given. NaN where, and
        only where, the status is NONE or INVALID.
    status : array (...) of int8
        Codes of :class:`rodgen.spatial.PolygonStatus`.

    Raises
    ------
    ValueError
        When the shapes do not broadcast, or the last axis of `alpha` is not 5 long.

    Notes
    -----
    Lecture notes "Robot Geometry" after Crane and Duffy, "Spherical Pentagon Example"; proved in the derivation
    ``spherical_polygons``. For other given joints turn or mirror the subscripts.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> alpha = np.radians([60, 80, 70, 50, 65])
    >>> theta, status = spatial.spherical_pentagon(alpha, np.radians(40), np.radians(80))
    >>> np.degrees(theta).round(4)
    array([[ -29.1991,  103.4311,   31.9207,   40.    ,   80.    ],
           [ 146.4949, -103.4311,  154.908 ,   40.    ,   80.    ]])
    """
    given = np.stack(np.broadcast_arrays(theta_4, theta_5), axis=-1)
    return call_kernel(kernels.polygon_pentagon, (alpha, given))  # type: ignore[no-any-return]
