"""Ridge lines: where the coordinate planes meet their images."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.kinematics.backend import kernels
from rodgen.kinematics.kernel_call import call_kernel


def ridge_normal(matrix: Any, axis: int) -> Any:
    """Return e_i × R e_i (..., 3): along the ridge line, as long as the sine of its angle."""
    return np.cross(np.eye(3)[axis], matrix[..., :, axis])


def ridge_lines(matrix: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> tuple[Any, Any]:
    """Return the lines in which the yz, xz and xy planes meet their images.

    Parameters
    ----------
    matrix : array_like (..., 3, 3)
        Rotation R; its columns are the moved axes.
    point : array_like (..., 3), optional
        The moved origin p, in any length unit; the fixed one when left out.

    Returns
    -------
    lines : array (..., 3, 6)
        X_r, Y_r, Z_r as Plücker coordinates: a unit direction, and the moment about the fixed origin in the unit of
        `point`. The rotation by χ_i about the direction brings the plane to its image. NaN where there is no line.
    status : array (..., 3) of int8
        Codes of :class:`RidgeStatus`: where the angle is 0 or π, whether the planes coincide or are parallel.

    Notes
    -----
    Z_r = (e_z × z_3; (z_3 · p) e_z) / sin χ_z, and so on: Zhou and Zhu (2023), eqs. (9), (12), (15), put right in the
    derivation ``instantaneous_euler_ridges``. A line is as exact as its angle is away from 0 and π: the direction to
    the machine epsilon over sin χ_i.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> tilted = [[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]]  # about x
    >>> lines, status = ie.ridge_lines(tilted, [0.0, 0.0, 2.0])
    >>> lines[2]
    array([1. , 0. , 0. , 0. , 0. , 1.5])
    >>> [ie.RidgeStatus(int(code)).name for code in status]
    ['PLANES_COINCIDE', 'LINE', 'LINE']
    """
    lines, *statuses = call_kernel(kernels.chi_ridge_lines, (matrix, point))
    return lines, np.stack(statuses, axis=-1)
