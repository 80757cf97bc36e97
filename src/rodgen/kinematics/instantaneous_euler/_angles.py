"""Instantaneous Euler angles of a rotation matrix, a quaternion or conventional Euler angles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.kinematics.backend import kernels
from rodgen.kinematics.instantaneous_euler.sequences import sequence_of
from rodgen.kinematics.kernel_call import call_kernel


def angles_from_matrix(matrix: ArrayLike) -> tuple[Any, Any]:
    """Return the instantaneous Euler angles of a rotation matrix.

    Parameters
    ----------
    matrix : array_like (..., 3, 3)
        Rotation R; its columns are the moved axes.

    Returns
    -------
    chi : array (..., 3)
        χ_x, χ_y, χ_z in rad, 0 to π: the angles between the yz, xz and xy planes and their images.
    status : array (...) of int8
        Codes of :class:`AngleStatus`; NaN where, and only where, it is INVALID.

    Notes
    -----
    Zhou and Zhu (2023), eqs. (10), (13), (16): χ_i = arccos r_ii, by half angles, so that small angles and those near
    π are right to rounding. The labels are those of the definitions; eqs. (18) and (20) exchange x and z.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> chi, status = ie.angles_from_matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> np.degrees(chi), ie.AngleStatus(int(status)).name
    (array([90., 90.,  0.]), 'NO_RIDGE')
    """
    return call_kernel(kernels.chi_from_matrix, (matrix,))  # type: ignore[no-any-return]


def angles_from_quaternion(quaternion: ArrayLike) -> tuple[Any, Any]:
    """Return the instantaneous Euler angles of a unit quaternion.

    Parameters
    ----------
    quaternion : array_like (..., 4)
        Unit quaternion, scalar part first; either of the two of a rotation.

    Returns
    -------
    chi : array (..., 3)
        χ_x, χ_y, χ_z in rad, 0 to π.
    status : array (...) of int8
        Codes of :class:`AngleStatus`; NaN where, and only where, it is INVALID.

    Notes
    -----
    sin²(χ_i/2) = q_j² + q_k²; derivation ``instantaneous_euler``, entry ``half-angles``.

    Examples
    --------
    >>> from rodgen import instantaneous_euler as ie
    >>> ie.angles_from_quaternion([1.0, 0.0, 3e-9, 4e-9])[0]  # no digit is lost
    array([1.e-08, 8.e-09, 6.e-09])
    """
    return call_kernel(kernels.chi_from_quaternion, (quaternion,))  # type: ignore[no-any-return]


def angles_from_euler(angles: ArrayLike, sequence: str = "ZYX") -> tuple[Any, Any]:
    """Return the instantaneous Euler angles of conventional ones.

    Parameters
    ----------
    angles : array_like (..., 3)
        The three angles in the order of the sequence, rad.
    sequence : str, optional
        One of :data:`SEQUENCES` in capitals for intrinsic rotations, each about an axis that the ones before have
        turned, or in small letters for extrinsic ones, about fixed axes. ``"ZYX"`` and ``"ZYZ"`` are the paper's.

    Returns
    -------
    chi : array (..., 3)
        χ_x, χ_y, χ_z in rad, 0 to π.
    status : array (...) of int8
        Codes of :class:`AngleStatus`; NaN where, and only where, it is INVALID.

    Raises
    ------
    RodgenError
        When the sequence is not one of the twelve.
    ValueError
        When the last axis is not 3 long.

    Notes
    -----
    Zhou and Zhu (2023), eqs. (10), (13), (16) and (18) put right, by half angles.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> chi, status = ie.angles_from_euler(np.radians([30.0, 40.0, 50.0]))
    >>> np.degrees(chi).round(3)
    array([48.439, 36.595, 60.501])
    >>> np.degrees(ie.angles_from_euler(np.radians([30.0, 40.0, 50.0]), "ZYZ")[0]).round(3)
    array([87.512, 74.737, 40.   ])
    """
    known = sequence_of(sequence)
    kernel = kernels.chi_from_zyx if known.like == "zyx" else kernels.chi_from_zyz
    chi, status = kernel(known.angles(angles))
    return known.vector(np.asarray(chi)), status
