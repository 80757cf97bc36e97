"""Instantaneous Euler angles of an attitude, their rates along a motion, and conventional angles."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.generated.numpy import instantaneous_euler, instantaneous_euler_motion
from rodgen.generated.numpy.instantaneous_euler_motion import MotionStatus
from rodgen.generated.numpy.rotations import RotationStatus
from rodgen.kinematics.arrays import refuse_masked
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.instantaneous_euler.sequences import sequence_of
from rodgen.kinematics.ports import documented_by
from rodgen.views import with_html


@documented_by(instantaneous_euler.chi_from_matrix)
def angles_from_matrix(matrix: ArrayLike) -> tuple[Any, Any]:
    """Return the instantaneous Euler angles of a rotation matrix.

    Parameters
    ----------
    matrix
        Its columns are the moved axes.

    Returns
    -------
    chi
        χ_x, χ_y, χ_z: the angles between these planes and their images. NaN where, and only where, the status is
        INVALID.

    Notes
    -----
    χ_i = arccos r_ii, by half angles, so that small angles and those near π are right to rounding. The labels are those
    of the definitions; eqs. (18) and (20) exchange x and z.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> chi, status = ie.angles_from_matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> np.degrees(chi), ie.AngleStatus(int(status)).name
    (array([90., 90.,  0.]), 'NO_RIDGE')
    """
    return call_kernel(kernels.chi_from_matrix, (matrix,))  # type: ignore[no-any-return]


@documented_by(instantaneous_euler.chi_from_quaternion)
def angles_from_quaternion(quaternion: ArrayLike) -> tuple[Any, Any]:
    """Return the instantaneous Euler angles of a unit quaternion.

    Parameters
    ----------
    quaternion
        Either of the two of a rotation.

    Returns
    -------
    chi
        χ_x, χ_y, χ_z; NaN where, and only where, the status is INVALID.

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


@with_html
class Rates(NamedTuple):
    """Rates of instantaneous Euler angles.

    Attributes
    ----------
    rate : array (..., 3)
        Rates of χ_x, χ_y, χ_z, in the unit of the angular velocity.
    determinant : array (...)
        Volume of the directions of the ridge lines, 16 q0 qx qy qz; 0 where the rates do not determine the angular
        velocity.
    status : array (...) of int8
        Codes of :class:`MotionStatus`.
    """

    rate: Any
    determinant: Any
    status: Any


@documented_by(instantaneous_euler_motion.chi_rates)
def rates(matrix: ArrayLike, omega: ArrayLike) -> Rates:
    """Return how fast the instantaneous Euler angles of a turning body change.

    Returns
    -------
    Rates
        ``rate``, ``determinant``, ``status``. KINK where an angle is 0 or π: its rate is that towards later times, and
        the opposite of the one before. SINGULAR where the rates are right and do not determine the angular velocity.

    Notes
    -----
    χ̇_i = ω · N_i / |N_i| with N_i = e_i × R e_i.

    Examples
    --------
    >>> from rodgen import instantaneous_euler as ie
    >>> turned, _ = ie.motion_from_euler([0.5, 0.0, 0.0], [0.0, 0.0, 0.0])
    >>> ie.rates(turned, [0.0, 0.0, 2.0]).rate
    array([2., 2., 0.])
    """
    return Rates(*call_kernel(kernels.chi_rates, (matrix, omega)))


@documented_by(instantaneous_euler_motion.chi_angular_velocity)
def angular_velocity(matrix: ArrayLike, rate: ArrayLike) -> tuple[Any, Any]:
    """Return the angular velocity of a body whose instantaneous Euler angles change at given rates.

    Returns
    -------
    omega
        NaN where the rates do not determine it.
    status
        SINGULAR or KINK where the rates do not determine it, NEAR_SINGULAR where they do so badly.

    Notes
    -----
    It is singular where a component of the quaternion is 0, on the boundary of the tetrahedron of the cosines. Near
    it the error is about the machine epsilon over the volume of the ridge lines' unit directions, which is
    `determinant` of :func:`rates` over the three sines; where that leaves fewer than half of the digits the status is
    NEAR_SINGULAR.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> matrix, omega = ie.motion_from_euler([0.3, 0.2, 0.5], [1.0, -2.0, 0.5])
    >>> np.allclose(ie.angular_velocity(matrix, ie.rates(matrix, omega).rate)[0], omega)
    True
    """
    return call_kernel(kernels.chi_angular_velocity, (matrix, rate))  # type: ignore[no-any-return]


@documented_by(instantaneous_euler_motion.chi_motion_from_zyx)
def motion_from_euler(angles: ArrayLike, angle_rates: ArrayLike, sequence: str = "ZYX") -> tuple[Any, Any]:
    """Return the rotation matrix and the angular velocity of conventional Euler angles and their rates.

    With both, :func:`rates` has those of the instantaneous angles.

    Parameters
    ----------
    sequence : str, optional
        As for :func:`angles_from_euler`.

    Raises
    ------
    RodgenError
        When the sequence is not one of the twelve.
    ValueError
        When the last axes are not 3 long.

    Examples
    --------
    >>> from rodgen import instantaneous_euler as ie
    >>> matrix, omega = ie.motion_from_euler([0.0, 0.0, 0.0], [0.1, 0.2, 0.3], "ZYX")
    >>> omega
    array([0.3, 0.2, 0.1])
    """
    known = sequence_of(sequence)
    kernel = kernels.chi_motion_from_zyx if known.like == "zyx" else kernels.chi_motion_from_zyz
    matrix, omega = kernel(known.angles(angles), known.angles(angle_rates))
    return known.matrix(np.asarray(matrix)), known.sign * known.vector(np.asarray(omega))


def euler_from_quaternion(quaternion: ArrayLike, sequence: str = "ZYX") -> tuple[Any, Any]:
    """Return the conventional Euler angles of a unit quaternion.

    Parameters
    ----------
    quaternion : array_like (..., 4)
        Unit quaternion, scalar part first.
    sequence : str, optional
        As for :func:`angles_from_euler`.

    Returns
    -------
    angles : array (..., 3)
        The three angles in the order of the sequence, rad. The middle one is -π/2 to π/2 for sequences of three axes,
        0 to π for those that begin and end with the same, the others are -π to π.
    status : array (...) of int8
        Codes of :class:`MotionStatus`; SINGULAR for gimbal lock, where the third intrinsic rotation (the first
        extrinsic one) is given as 0.

    Raises
    ------
    RodgenError
        When the sequence is not one of the twelve.

    Notes
    -----
    By atan2 of half angles, well conditioned up to the lock; derivation ``instantaneous_euler_motion``.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> angles, status = ie.euler_from_quaternion([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
    >>> np.degrees(angles).round(6) + 0.0, ie.MotionStatus(int(status)).name
    (array([ 0., 90.,  0.]), 'SINGULAR')
    """
    known = sequence_of(sequence)
    refuse_masked("quaternion", quaternion)
    q = np.asarray(quaternion)
    if q.ndim == 0 or q.shape[-1] != 4:
        raise ValueError(f"a quaternion has the shape {q.shape}; expected a last axis of 4")
    kernel = kernels.chi_zyx_from_quaternion if known.like == "zyx" else kernels.chi_zyz_from_quaternion
    angles, status = kernel(known.quaternion(q))
    angles = np.asarray(angles)
    if known.sign < 0 and known.like == "zyz":  # the second angle stays from 0 to pi: the others turn by pi
        locked = np.asarray(status)[..., None] == MotionStatus.SINGULAR
        turned = np.where(angles > 0, angles - np.pi, angles + np.pi)
        angles = np.where(locked, angles, turned) * [1, 0, 1] - angles * [0, 1, 0]
    return known.angles(angles), status


def euler_from_matrix(matrix: ArrayLike, sequence: str = "ZYX") -> tuple[Any, Any]:
    """Return the conventional Euler angles of a rotation matrix.

    Parameters
    ----------
    matrix : array_like (..., 3, 3)
        Rotation R; its columns are the moved axes.
    sequence : str, optional
        As for :func:`angles_from_euler`.

    Returns
    -------
    angles : array (..., 3)
        As for :func:`euler_from_quaternion`.
    status : array (...) of int8
        Codes of :class:`MotionStatus`.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> matrix, _ = ie.motion_from_euler([0.1, 0.2, 0.3], [0.0, 0.0, 0.0], "XZX")
    >>> ie.euler_from_matrix(matrix, "XZX")[0].round(12)
    array([0.1, 0.2, 0.3])
    """
    quaternion, matrix_status = call_kernel(kernels.quaternion_from_matrix, (matrix,))
    angles, status = euler_from_quaternion(quaternion, sequence)
    abnormal = (matrix_status == RotationStatus.NOT_NORMAL) & (status == MotionStatus.REGULAR)
    return angles, np.where(abnormal, np.int8(MotionStatus.NOT_NORMAL), status)
