"""Point and rods of a Tricept in a pose, and poses with a given point or given rods, with errors of all parameters.

The platform's centre is at z along the middle rod, which is turned by α and β; the point q of the platform is at Q =
Oy(β) Ox(α) (q + z e₃). Ox is the paper's, the transposed of the right-handed rotation: a positive α moves the centre
towards +y.

With errors of all ``PARAMETERS`` at commanded rods, the three closures |m_k − F_k| = A_k are solved for the pose by
Newton's iteration from the nominal pose. Nothing is linearised.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.generated.numpy import tricept as generated
from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.arrays import broadcast_shapes, length_limits, real_array
from rodgen.kinematics.backend import call_kernel, kernels
from rodgen.kinematics.ports import documented_by
from rodgen.kinematics.tricept._direct import direct_all
from rodgen.kinematics.tricept._geometry import (
    FIXED,
    GUIDE,
    MOVING,
    PARAMETERS,
    RODS,
    TOOL,
    ZEROS,
    Geometry,
    joints,
)


@documented_by(generated.tricept_point, ["point"])
def point(pose: ArrayLike, geometry: Geometry) -> Any:
    """Return the place of the platform's point in a pose.

    Parameters
    ----------
    geometry : Geometry
        The machine; its point q counts.

    Returns
    -------
    point
        NaN where an input is.

    Examples
    --------
    >>> from rodgen import tricept
    >>> tricept.point([0.1, 0.0, 600.0], tricept.PAPER).round(3)
    array([  0.   ,  59.9  , 597.002])
    """
    return call_kernel(kernels.tricept_point, (pose, *geometry.q))[0]


@documented_by(generated.tricept_point, ["rotation"])
def rotation(pose: ArrayLike) -> Any:
    """Return the orientation of the platform in a pose, Oy(β) Ox(α).

    Returns
    -------
    rotation
        Rotation matrix, from the platform's axes to the base's.

    Notes
    -----
    In the usual, right-handed sense the angle about x is −α.

    Examples
    --------
    >>> from rodgen import tricept
    >>> (tricept.rotation([0.1, 0.2, 600.0])[:, 2] * 600).round(3)  # the middle rod
    array([118.606,  59.9  , 585.102])
    """
    return call_kernel(kernels.tricept_point, (pose, 0.0, 0.0, 0.0))[1]


@documented_by(generated.tricept_legs)
def legs(pose: ArrayLike, geometry: Geometry) -> Any:
    """Return the lengths of the three rods in a pose.

    Parameters
    ----------
    geometry : Geometry
        The machine.

    Returns
    -------
    legs
        The rods at 0°, +120° and −120°, from joint to joint, computed as lengths of vectors.

    Examples
    --------
    >>> from rodgen import tricept
    >>> tricept.legs([0.0, 0.0, 456.0], tricept.PAPER)
    array([494., 494., 494.])
    """
    return call_kernel(kernels.tricept_legs, (pose, *geometry.radii))


@documented_by(generated.tricept_inverse)
def inverse(
    point: ArrayLike, geometry: Geometry, limits: Sequence[float] | None = None
) -> tuple[Any, Any, Any]:
    """Return all poses in which the platform's point is at a given point, and the rods they need.

    Parameters
    ----------
    geometry : Geometry
        The machine; its point q is brought to `point`.
    limits : pair of floats, optional
        Least and greatest length of a rod; none when left out.

    Returns
    -------
    poses
        The rows are for the signs (S, K) = (+, +), (+, −), (−, +), (−, −) of the two roots; the
        first is that of the machine as it is assembled, for points before the base. A point behind it, where Qz is
        negative, has no such pose: there cos β is not positive in the first row, either. With K = −1 the platform is
        turned by half a turn about the middle rod, with S = −1 it is below the base; the rods may be within the limits
        there, too.
    status
        REACHABLE, OUT_OF_LIMITS, DOUBLE_POSE where two of the poses meet to rounding,
        GIMBAL_LOCK where an angle is not determined and 0 stands for it. Poses and rods are NaN where it is UNREACHABLE
        or INVALID.

    Notes
    -----
    That there are these four and no others is proved there, too. float32 input gives float32 results.

    Examples
    --------
    >>> from rodgen import tricept
    >>> poses, legs, status = tricept.inverse([100.0, 50.0, 650.0], tricept.PAPER, tricept.LEG_LIMITS)
    >>> legs[0].round(3)
    array([637.318, 689.585, 730.485])
    >>> [tricept.TriceptStatus(code).name for code in status]
    ['REACHABLE', 'REACHABLE', 'REACHABLE', 'REACHABLE']
    """
    arguments = (point, *geometry.radii, *geometry.q, *length_limits(limits, "rod"))
    return call_kernel(kernels.tricept_inverse, arguments)  # type: ignore[no-any-return]


@documented_by(generated.tricept_pose)
def pose(point: ArrayLike, geometry: Geometry, limits: Sequence[float] | None = None) -> tuple[Any, Any, Any]:
    """Return the pose in which the assembled machine has its point at a given one, and its rods.

    Parameters
    ----------
    geometry : Geometry
        As for :func:`inverse`.
    limits : pair of floats, optional
        As for :func:`inverse`.

    Returns
    -------
    pose
        The first row of what :func:`inverse` gives.
    status
        As for :func:`inverse`. UNREACHABLE, too, for points behind the base: there
        neither cosine is positive in the first row, and the assembled machine has no such pose.

    Notes
    -----
    With S = K = +1. It takes a third of the time of all four poses.

    Examples
    --------
    >>> from rodgen import tricept
    >>> pose, legs, status = tricept.pose([100.0, 50.0, 650.0], tricept.PAPER, tricept.LEG_LIMITS)
    >>> legs.round(3)
    array([637.318, 689.585, 730.485])
    """
    arguments = (point, *geometry.radii, *geometry.q, *length_limits(limits, "rod"))
    found, rods, status = call_kernel(kernels.tricept_pose, arguments)
    lost = lost_behind(point, geometry, status)
    if lost is None:
        return found, rods, status
    found, rods = (np.where(lost[..., None], np.nan, x) for x in (found, rods))
    return found, rods, np.where(lost, np.int8(TriceptStatus.UNREACHABLE), status)


def lost_behind(point: ArrayLike, geometry: Geometry, status: Any) -> Any:
    """Return which points have a pose by their status, but lie behind the base, (...); None where none does."""
    lost = (status <= TriceptStatus.OUT_OF_LIMITS) & behind(point, geometry)
    return None if isinstance(lost, np.ndarray | np.bool_) and not lost.any() else lost


def behind(point: Any, geometry: Geometry) -> Any:
    """Return which points are reached by no pose with positive cosines, (...); others may be out of reach, too.

    cos α and cos β have the signs of √(|Q|² − qx² − qy²) g + qy Qy and qx Qx + g Qz, with g = √(Qx² + Qz² − qx²).
    """
    x, y, z = np.moveaxis(np.asarray(point, dtype=float) if np.ndim(point) < 2 else point, -1, 0)
    if geometry.q == (0.0, 0.0, 0.0):
        return z <= 0
    qx, qy, _ = geometry.q
    g = np.sqrt(np.maximum(x * x + z * z - qx * qx, 0))
    root = np.sqrt(np.maximum(x * x + y * y + z * z - qx * qx - qy * qy, 0))
    return (qx * x + g * z <= 0) | (root * g + qy * y <= 0)


@documented_by(generated.tricept_direct)
def direct(legs: ArrayLike, geometry: Geometry) -> tuple[Any, Any]:
    """Return the pose of the machine as it is assembled, from its rods: cos α, cos β and z are positive.

    Parameters
    ----------
    legs
        From joint to joint.
    geometry : Geometry
        The machine.

    Returns
    -------
    status
        REACHABLE, SINGULAR where the pose is not determined to first order; NaN where
        it is UNREACHABLE, because there is no such pose, or INVALID.

    Notes
    -----
    Newton's method. Rods from which it does not come to a pose are solved by :func:`direct_all`, except in Dask arrays;
    so UNREACHABLE is a statement about the equations. Where there are several such poses, which needs rods far from the
    paper's, it is one of them.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> pose, status = tricept.direct([650.0, 700.0, 760.0], tricept.PAPER)
    >>> np.degrees(pose[:2]).round(3), round(float(pose[2]), 3)
    (array([6.379, 9.653]), 677.982)
    """
    pose, status = call_kernel(kernels.tricept_direct, (legs, *geometry.radii))
    if not isinstance(status, np.ndarray | np.generic):
        return pose, status
    lost = np.asarray(status) == TriceptStatus.UNREACHABLE
    if not lost.any():
        return pose, status
    rows = np.broadcast_to(np.asarray(legs), np.shape(pose))[lost]
    poses, count = direct_all(rows, geometry)
    first = poses[:, 0]
    found = (count > 0) & (np.cos(first[:, :2]) > 0).all(axis=1) & (first[:, 2] > 0)
    pose, status = np.array(pose), np.array(status)
    pose[lost] = np.where(found[:, None], first, np.nan)
    status[lost] = np.where(found, TriceptStatus.REACHABLE, TriceptStatus.UNREACHABLE)
    return pose, status


_COLUMNS = {
    name: [PARAMETERS.index(member) for member in members]
    for name, members in (
        ("rods", RODS),
        ("zeros", ZEROS),
        ("fixed", FIXED),
        ("moving", MOVING),
        ("q", TOOL),
        ("guide", tuple(GUIDE)),
    )
}
_r, _R = PARAMETERS.index("r"), PARAMETERS.index("R")

# Quadratic convergence: errors of a thousandth of the machine need four steps.
_MOST_STEPS = 12
_BLOCK = 20_000


def disturbed_point(pose: ArrayLike, geometry: Geometry, errors: ArrayLike) -> tuple[Any, Any]:
    """Return the place of the tool when the rods are commanded for a pose and the parameters have errors.

    Parameters
    ----------
    pose : array_like (..., 3)
        The nominal pose: α and β in rad, and z.
    geometry : Geometry
        The nominal machine.
    errors : array_like (..., n)
        Errors of all ``PARAMETERS``, lengths and rad: true value minus nominal one.

    Returns
    -------
    point : array (..., 3)
        The true place of the tool; NaN where the status is UNREACHABLE or INVALID.
    status : array (...) of int8
        Codes of :class:`TriceptStatus`: REACHABLE; UNREACHABLE where no pose near the nominal one closes; INVALID.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> errors = np.zeros(len(tricept.PARAMETERS))
    >>> errors[tricept.PARAMETERS.index("zero_A0")] = 0.1
    >>> tricept.disturbed_point([0.0, 0.0, 600.0], tricept.PAPER, errors)[0].round(5) + 0.0
    array([-1.2715000e-01,  0.0000000e+00,  6.0003495e+02])
    """
    poses, shifts = real_array("pose", pose, (3,)), real_array("errors", errors, (len(PARAMETERS),))
    shape = broadcast_shapes({"pose": (poses, 1), "errors": (shifts, 1)})
    flat_pose = np.broadcast_to(poses, (*shape, 3)).reshape(-1, 3)
    flat = np.broadcast_to(shifts, (*shape, len(PARAMETERS))).reshape(-1, len(PARAMETERS))
    points, status = np.empty((len(flat), 3)), np.empty(len(flat), np.int8)
    for start in range(0, len(flat), _BLOCK):
        part = slice(start, start + _BLOCK)
        points[part], status[part] = _solved(flat_pose[part], geometry, flat[part])
    return points.reshape(*shape, 3), status.reshape(shape)[()]


def _solved(pose: Array, geometry: Geometry, errors: Array) -> tuple[Array, NDArray[np.int8]]:
    fixed, moving = joints(geometry)
    n = len(errors)
    rods = np.asarray(legs(pose, geometry)) + errors[:, _COLUMNS["rods"]] + errors[:, _COLUMNS["zeros"]]
    base = (
        fixed + errors[:, _R, None, None] * fixed / geometry.R + errors[:, _COLUMNS["fixed"]].reshape(n, 3, 3)
    )
    platform = (
        moving
        + errors[:, _r, None, None] * moving / geometry.r
        + errors[:, _COLUMNS["moving"]].reshape(n, 3, 3)
    )
    tool = np.asarray(geometry.q) + errors[:, _COLUMNS["q"]]
    guide = errors[:, _COLUMNS["guide"]]
    now = pose.copy()
    # α and β act on lengths of the machine's size
    size = np.array([geometry.R, geometry.R, 1.0]) / geometry.R
    left = np.ones(n, bool)
    with np.errstate(all="ignore"):
        for _ in range(_MOST_STEPS):
            some = np.flatnonzero(left)
            if not some.size:
                break
            answer = call_kernel(
                kernels.tricept_closure,
                (now[some], rods[some], base[some], platform[some], tool[some], guide[some]),
            )
            step = _solve(answer[_JACOBIAN], answer[_RESIDUAL])
            now[some] -= step
            # a step this small was the last one: the next would be its square
            left[some] = ~(np.abs(step * size).max(axis=1) <= 1e-9)
        points = np.asarray(
            call_kernel(kernels.tricept_closure, (now, rods, base, platform, tool, guide))[_PLACE]
        )
    invalid = ~(np.isfinite(pose).all(axis=1) & np.isfinite(errors).all(axis=1))
    far = np.abs(now[:, :2] - pose[:, :2]).max(axis=1) > 1.0
    bad = left | far | ~np.isfinite(points).all(axis=1)
    status = np.where(invalid, TriceptStatus.INVALID, np.where(bad, TriceptStatus.UNREACHABLE, 0))
    return np.where((bad | invalid)[:, None], np.nan, points), status.astype(np.int8)


def _solve(matrix: Array, right: Array) -> Array:
    """Return solutions of three equations by cross products: a singular matrix gives infinite steps."""
    a, b, c = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    columns = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
    solved: Array = (columns @ right[..., None])[..., 0] / (a * columns[..., 0]).sum(axis=-1)[:, None]
    return solved


# Order of the kernel's outputs.
_RESIDUAL, _PLACE, _JACOBIAN = 0, 1, 2
