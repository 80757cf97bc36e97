"""Instantaneous and conventional Euler angles along a motion, both made continuous where possible.

An instantaneous angle is never negative: where its plane passes the place where it started, it has a kink, and so it
has at π. Its ridge line's direction turns around there. Followed by the direction, the angle goes on through zero
with the other sign, and beyond π. Conventional angles jump by 2π, and between their two triples; the one nearest to
the last is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence as SequenceOf
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.generated.numpy.instantaneous_euler_motion import MotionStatus
from rodgen.kinematics.arrays import refuse_masked
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.instantaneous_euler._angles import angles_from_quaternion, euler_from_quaternion
from rodgen.kinematics.instantaneous_euler._rotations import ridge_normal
from rodgen.kinematics.instantaneous_euler.sequences import Sequence, sequence_of
from rodgen.views import with_html

_FLAT = 1e-12
"""Sine of an angle below which its ridge line is not followed: its direction is rounded to 1e-16 over that."""


class PathStatus(IntEnum):
    """How an instantaneous Euler angle came from the row before.

    SMOOTH: its ridge line turned by less than 45 degrees, or is the first one.
    TURNED: its ridge line turned around: the plane passed the place where it started, or where it is upside down.
    NO_RIDGE: the angle is 0 or pi, and has no ridge line.
    COARSE: the ridge line turned by 45 to 135 degrees, so that the rows do not determine whether it turned around.
    INVALID: no rotation.
    """

    SMOOTH = 0
    TURNED = 1
    NO_RIDGE = 2
    COARSE = 3
    INVALID = 4


@with_html
class Trajectory(NamedTuple):
    """Angles along a motion of n attitudes.

    Attributes
    ----------
    chi : array (n, 3)
        Instantaneous Euler angles, rad, 0 to π.
    signed : array (n, 3)
        The same, continuous: with a sign, and beyond π.
    status : array (n, 3) of int8
        Codes of :class:`PathStatus`.
    euler : dict of str to array (n, 3)
        Conventional angles of each sequence, in their usual ranges.
    continuous : dict of str to array (n, 3)
        The same, continuous.
    euler_status : dict of str to array (n,) of int8
        Codes of :class:`MotionStatus`; SINGULAR where the sequence is locked.
    """

    chi: Any
    signed: Any
    status: Any
    euler: dict[str, Any]
    continuous: dict[str, Any]
    euler_status: dict[str, Any]


def trajectory(quaternions: ArrayLike, sequences: SequenceOf[str] = ("ZYX", "ZYZ")) -> Trajectory:
    """Return instantaneous and conventional Euler angles along a motion.

    Parameters
    ----------
    quaternions : array_like (n, 4)
        Unit quaternions, scalar part first, in the order of the motion.
    sequences : sequence of str, optional
        Conventional sequences, as for :func:`angles_from_euler`.

    Returns
    -------
    Trajectory
        ``chi``, ``signed``, ``status``, ``euler``, ``continuous``, ``euler_status``.

    Raises
    ------
    RodgenError
        When a sequence is not one of the twelve.
    ValueError
        When `quaternions` is not a table of n rows of 4.

    Notes
    -----
    Between two rows the shortest way is taken: sampling must be so fine that no ridge line turns by more than 45
    degrees unless it turns around (COARSE marks where it was not). In a lock the third angle is held.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import instantaneous_euler as ie
    >>> x = np.linspace(0.5, 6.5, 7)  # the paper's curve 1
    >>> half = np.sin(x) / 2
    >>> found = ie.trajectory(np.stack([np.cos(half), 0 * x, 0 * x, np.sin(half)], axis=-1))
    >>> found.chi[:, 0].round(2)
    array([0.48, 1.  , 0.6 , 0.35, 0.98, 0.71, 0.22])
    >>> found.signed[:, 0].round(2)
    array([ 0.48,  1.  ,  0.6 , -0.35, -0.98, -0.71,  0.22])
    """
    refuse_masked("quaternions", quaternions)
    q = np.asarray(quaternions, float)
    if q.ndim != 2 or q.shape[1] != 4:
        raise ValueError(f"quaternions have the shape {q.shape}; expected (n, 4)")
    chi = np.asarray(angles_from_quaternion(q)[0])
    matrices = kernels.matrix_from_quaternion(q)[0]
    signed, status = np.empty_like(chi), np.empty(chi.shape, np.int8)
    for i in range(3):
        signed[:, i], status[:, i] = _followed(ridge_normal(matrices, i), chi[:, i])
    euler, continuous, locks = {}, {}, {}
    for name in sequences:
        euler[name], locks[name] = euler_from_quaternion(q, name)
        continuous[name] = _continuous(euler[name], locks[name], sequence_of(name))
    return Trajectory(chi, signed, status, euler, continuous, locks)


def _followed(ridge: NDArray[Any], chi: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int8]]:
    """Return an angle about a direction that is followed from row to row, and the status of each row."""
    length = np.linalg.norm(ridge, axis=1)
    valid = np.isfinite(chi)
    there = valid & (length > _FLAT)
    rows = np.flatnonzero(there)
    status = np.full(len(chi), int(PathStatus.NO_RIDGE), np.int8)
    status[~valid] = PathStatus.INVALID
    sign = np.ones(len(chi))
    if len(rows):
        unit = ridge[rows] / length[rows, None]
        cosine = (unit[1:] * unit[:-1]).sum(axis=1)
        turns = np.concatenate([[1.0], np.where(cosine < 0, -1.0, 1.0)])
        code = np.where(cosine < 0, PathStatus.TURNED, PathStatus.SMOOTH)
        code = np.where(np.abs(cosine) < np.sqrt(0.5), PathStatus.COARSE, code)
        status[rows] = np.concatenate([[PathStatus.SMOOTH], code])
        # a row without a ridge line goes on as the last one that has one
        last = np.maximum.accumulate(np.where(there, np.arange(len(chi)), -1))
        followed = np.cumprod(turns)
        sign = np.where(last >= 0, followed[np.searchsorted(rows, np.maximum(last, rows[0]))], 1.0)
    signed = np.full(len(chi), np.nan)
    signed[valid] = np.unwrap((sign * chi)[valid])
    return signed, status


def _continuous(euler: Any, status: Any, sequence: Sequence) -> NDArray[Any]:
    """Return conventional angles, each row nearest to the one before."""
    angles = sequence.angles(euler)
    three = sequence.like == "zyx"
    full = 2 * math.pi
    continuous = np.full_like(angles, np.nan)
    last: tuple[float, ...] | None = None
    # one row depends on the one before: plain floats are five times as fast as small arrays
    for row, (code, (a, b, c)) in enumerate(zip(status.tolist(), angles.tolist(), strict=True)):
        if code == MotionStatus.INVALID:
            continue
        if last is not None:
            if code == MotionStatus.SINGULAR:
                # the sum or the difference of the outer angles is determined; the third stays as it was
                low = math.cos(b + math.pi / 2 if three else b) > 0
                a, c = (a - last[2] if low else a + last[2]), last[2]
            second = (a + math.pi, math.pi - b if three else -b, c + math.pi)
            near = [
                tuple(x - full * round((x - y) / full) for x, y in zip(triple, last, strict=True))
                for triple in ((a, b, c), second)
            ]
            gaps = [sum((x - y) ** 2 for x, y in zip(triple, last, strict=True)) for triple in near]
            a, b, c = near[gaps[1] < gaps[0]]
        last = (a, b, c)
        continuous[row] = last
    return sequence.angles(continuous)
