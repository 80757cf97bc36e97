"""All joint angles of an arm with six revolute joints that bring its end to a pose.

Problem: find every q with T_F6(q) = T. There are up to 16 solutions. Three axes that follow each other and meet in one
point or are parallel make the problem small: then a closed form, or a pair of equations in two angles, has them all.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.errors import RodgenError
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.spatial._angles import nearest_turn, principal
from rodgen.kinematics.spatial._forward import forward, jacobian
from rodgen.kinematics.spatial._mechanism import Mechanism
from rodgen.kinematics.spatial._placement import Placement
from rodgen.kinematics.spatial._reverse_pairs import WAYS
from rodgen.kinematics.spatial._reverse_plan import Plan, plan
from rodgen.kinematics.spatial._reverse_solve import solved
from rodgen.kinematics.spatial._status import ReverseStatus, there_first

__all__ = ["Reverse", "reverse", "reverse_method"]

CHUNK = 2048
"""Poses that are solved at a time by pairs of equations: their arrays stay in the cache."""
POSE = 1e-6
"""How far a matrix may be from a rotation; as in the kernels."""
CLOSES = 1e-11
"""Largest distance of a solution's pose from the one wanted, in rad and relative to the reach; rounding leaves 1e-14,
and near solutions that meet 1e-13."""
SETTLED = 1e-14
TRIES = 72
"""First angles that are tried where it is free."""


class Reverse(NamedTuple):
    """Joint angles of every solution, and what each slot holds.

    Attributes
    ----------
    solutions : array (..., N, 6)
        Angles in rad, in (-π, π]; those there are come first. NaN where there is none. N is 8 or 16.
    status : array (..., N) of int8
        Codes of :class:`ReverseStatus`.
    """

    solutions: Any
    status: Any


def reverse(mechanism: Mechanism | Placement, T: ArrayLike) -> Reverse:
    """Find every set of joint angles that brings the end of an arm to a pose.

    Parameters
    ----------
    mechanism : Mechanism
        Open chain of six revolute joints. A chain with two or three slides is handed to :func:`reverse_sliding`; of a
        :class:`Placement` the pose and the angles are the robot's own.
    T : array_like (..., 4, 4)
        Pose of the last joint's frame in the fixed frame F, as :func:`forward` returns it.

    Returns
    -------
    Reverse
        ``solutions`` (..., N, 6) and ``status`` (..., N). N is 8 where a closed form or a wrist's centre says that
        there are no more, else 16. Where the angles of one solution are not determined (a wrist that is singular, an
        elbow folded onto its shoulder, a wrist's centre on S_1), the status is FAMILY, and the free angle of the
        representative is zero wherever zero leaves a solution. Two solutions that meet (an elbow that is straight) are
        given once, as DOUBLE. What meets is decided by rounding: within about 1e-6 rad of a degenerate pose either
        status may be told.

    Raises
    ------
    RodgenError
        When the mechanism is no open chain of six freedoms, or its freedoms depend on each other in every position;
        when `T` has another shape or is not real; and when no three consecutive axes meet or are parallel and `ssik`,
        which solves such arms, is not installed.

    Notes
    -----
    Crane and Duffy, reverse analysis of the Puma 560, the GE P60 and the Cincinnati T3-776; proved in the derivation
    ``robots_6r``. :func:`reverse_method` tells which way is taken. Regular solutions of a closed form meet the pose to
    some 1e-14 of the reach; all others have been put back into the forward analysis, and meet it to 1e-11 and better.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> pose = spatial.forward(spatial.PUMA_560, [0.3, 0.2, -0.4, 0.5, 0.6, -0.7])
    >>> solutions, status = spatial.reverse(spatial.PUMA_560, pose)
    >>> solutions.shape, status
    ((8, 6), array([0, 0, 0, 0, 0, 0, 0, 0], dtype=int8))
    >>> bool(np.abs(spatial.forward(spatial.PUMA_560, solutions) - pose).max() < 1e-12)
    True
    """
    if isinstance(mechanism, Placement):
        return mechanism.reverse(T)
    pose = _checked(T)
    if not mechanism.closed and set(mechanism.joints) & set("PC") and sum(mechanism.freedoms) == 6:
        from rodgen.kinematics.spatial._loops import reverse_sliding

        slid = reverse_sliding(mechanism, pose)
        return Reverse(slid.values, slid.status)
    chosen = plan(mechanism)
    if chosen.way in ("wrist", "parallel"):
        return _closed(mechanism, chosen, pose)
    flat = pose.reshape(-1, 4, 4)
    if chosen.way == "general":
        from rodgen.kinematics.spatial._reverse_general import general

        solve, slots = general(mechanism), 16
    else:
        slots = chosen.slots

        def solve(part: Any) -> Any:
            return solved(WAYS[chosen.way], chosen.arm, part)

    angles = np.full((len(flat), slots, 6), np.nan)
    status = np.full((len(flat), slots), ReverseStatus.INVALID, np.int8)
    rows = np.flatnonzero(_is_pose(flat))
    for first in range(0, len(rows), CHUNK):
        part = rows[first : first + CHUNK]
        candidates = solve(flat[part])
        angles[part], status[part] = _proved(mechanism, flat[part], *candidates, slots=slots)
    shape = pose.shape[:-2]
    return Reverse(angles.reshape(*shape, slots, 6), status.reshape(*shape, slots))


def reverse_method(mechanism: Mechanism | Placement) -> str:
    """Tell how :func:`reverse` solves an arm.

    Parameters
    ----------
    mechanism : Mechanism
        Open chain of six revolute joints.

    Returns
    -------
    str
        ``"closed form: ..."``, ``"pair of equations: ..."`` or ``"general: ssik"``, with the special axes.

    Examples
    --------
    >>> from rodgen import spatial
    >>> spatial.reverse_method(spatial.GE_P60)
    'closed form: axes 2, 3, 4 are parallel, axes 5, 6 meet'
    """
    chosen = plan(mechanism.mechanism if isinstance(mechanism, Placement) else mechanism)
    words = _WORDS[chosen.way]
    if chosen.arm.backwards:  # the axes as the given chain counts them
        kind, _, axes = words.partition(":")
        swapped = "".join(str(7 - int(c)) if c.isdigit() else c for c in axes)
        parts = [_in_order(part) for part in swapped.split(" and ")]
        return f"{kind}:{' and '.join(parts)}".replace(" and axes 1, 2 meet", ", axes 1, 2 meet")
    return words.replace(" and axes 5, 6 meet", ", axes 5, 6 meet")


_WORDS = {
    "wrist": "closed form: axes 2, 3 are parallel and axes 4, 5, 6 meet",
    "parallel": "closed form: axes 2, 3, 4 are parallel and axes 5, 6 meet",
    "meet 456": "pair of equations: axes 4, 5, 6 meet",
    "parallel 234": "pair of equations: axes 2, 3, 4 are parallel",
    "meet 234": "pair of equations: axes 2, 3, 4 meet",
    "parallel 123": "pair of equations: axes 1, 2, 3 are parallel",
    "general": "general: ssik",
}


def _in_order(words: str) -> str:
    """Write the digits of one phrase in rising order."""
    digits = iter(sorted(c for c in words if c.isdigit()))
    return "".join(next(digits) if c.isdigit() else c for c in words)


def _checked(T: ArrayLike) -> Any:
    pose = np.asarray(T)
    if pose.dtype.kind not in "fiu":
        raise RodgenError("the pose is not of real numbers; expected an array (..., 4, 4)")
    if pose.shape[-2:] != (4, 4):
        raise RodgenError(f"the pose has the shape {pose.shape}; expected (..., 4, 4)")
    return pose.astype(float, copy=False)


def _is_pose(T: Any) -> Any:
    with np.errstate(all="ignore"):
        R = T[..., :3, :3]
        rough = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).sum(axis=(-2, -1))
        rough += np.abs(T[..., 3, :] - [0.0, 0.0, 0.0, 1.0]).sum(axis=-1)
        handed = (np.cross(R[..., :, 0], R[..., :, 1]) * R[..., :, 2]).sum(axis=-1)
        return (rough <= POSE) & (handed > 0) & np.isfinite(T[..., :3, 3]).all(axis=-1)


def _closed(mechanism: Mechanism, chosen: Plan, pose: Any) -> Reverse:
    """Solve by a kernel; what lies near a degenerate pose is put back into the forward analysis and polished."""
    found, status = _by_kernel(chosen, pose)
    flat, codes = found.reshape(-1, 8, 6), status.reshape(-1, 8)
    poses = pose.reshape(-1, 4, 4)
    if chosen.way == "parallel":
        _free_first_angle(chosen, poses, flat, codes)
    row, column = np.nonzero((codes == ReverseStatus.DOUBLE) | (codes == ReverseStatus.FAMILY))
    if len(row):
        better, error = _polished(mechanism, poses[row], flat[row, column], steps=40)
        flat[row, column] = better
        lost = error > CLOSES
        flat[row[lost], column[lost]] = np.nan
        codes[row[lost], column[lost]] = ReverseStatus.NONE
        rows = np.unique(row[lost])
        flat[rows], codes[rows] = there_first(flat[rows], codes[rows])
    return Reverse(found, status)


def _by_kernel(chosen: Plan, pose: Any) -> tuple[Any, Any]:
    arm = chosen.arm
    kernel = {"wrist": kernels.robot_wrist_reverse, "parallel": kernels.robot_parallel_reverse}[chosen.way]
    found, status = kernel(arm.pose(pose), arm.a, arm.cosine, arm.sine, arm.offset)
    return np.ascontiguousarray(arm.angles(found)), status  # written into, row by row


def _free_first_angle(chosen: Plan, pose: Any, found: Any, status: Any) -> None:
    """Try other first angles where any is possible, but zero leaves no solution, with the three parallel axes.

    The point where axes 5 and 6 meet lies on the first axis then; the pose turned about that axis is such a pose, too.
    """
    arm = chosen.arm
    rows = np.flatnonzero(status[:, 0] == ReverseStatus.NONE)
    if not len(rows):
        return
    T = arm.pose(pose[rows])
    W = T[:, :3, 3] - arm.offset[5] * T[:, :3, 2]
    height = arm.cosine[0] * (W[:, 2] - arm.offset[0]) - arm.offset[1:4].sum() - arm.cosine[3] * arm.offset[4]
    size = 1e-12 * (arm.reach + np.abs(T[:, :3, 3]).sum(axis=-1))
    free = (np.hypot(W[:, 0], W[:, 1]) <= size) & (np.abs(height) <= size)
    rows, T = rows[free], T[free]
    for angle in np.linspace(0, 2 * np.pi, TRIES + 1)[1:-1]:
        if not len(rows):
            return
        c, s = np.cos(angle), np.sin(angle)
        back = np.array([[c, s, 0, 0], [-s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        q, codes = kernels.robot_parallel_reverse(back @ T, arm.a, arm.cosine, arm.sine, arm.offset)
        q[..., 0] = nearest_turn(q[..., 0] + angle)
        there = codes[:, 0] <= ReverseStatus.FAMILY
        found[rows[there]], status[rows[there]] = arm.angles(q[there]), codes[there]
        rows, T = rows[~there], T[~there]


def _proved(
    mechanism: Mechanism, T: Any, angles: Any, status: Any, missing: Any, *, slots: int
) -> tuple[Any, Any]:
    """Polish candidates (n, m, 6), keep those that meet the pose, and put them first: (n, slots, 6), (n, slots)."""
    n, m, _ = angles.shape
    there = status <= ReverseStatus.FAMILY
    row, column = np.nonzero(there)
    found, error = _polished(mechanism, T[row], angles[row, column])
    good = error <= CLOSES
    missing = missing.copy()
    missing[row[~good & (status[row, column] == ReverseStatus.REGULAR)]] = True
    there[row[~good], column[~good]] = False
    angles = np.full((n, max(m, slots), 6), np.nan)
    angles[row[good], column[good]] = found[good]
    codes = np.full((n, max(m, slots)), ReverseStatus.NONE, np.int8)
    codes[:, :m] = np.where(there, status, ReverseStatus.NONE)
    codes = np.where(missing[:, None] & (codes == ReverseStatus.NONE), ReverseStatus.INCOMPLETE, codes)
    angles, codes = there_first(angles, codes)
    return angles[:, :slots], codes[:, :slots]


def _polished(mechanism: Mechanism, T: Any, q: Any, steps: int = 3) -> tuple[Any, Any]:
    """Take Newton steps while they help: angles (k, 6) and how far their poses are off, relative."""
    reach = np.abs(mechanism.a).sum() + np.abs(mechanism.offset).sum() or 1.0
    q = nearest_turn(q)
    off, error = _off(forward(mechanism, q), T, reach)
    for _ in range(steps):
        rows = np.flatnonzero((error > SETTLED) & (error < 1e-3))
        if not len(rows):
            break
        J = jacobian(mechanism, q[rows]) / np.array([1.0, 1.0, 1.0, reach, reach, reach])[:, None]
        # near a singular pose only the determined directions are moved
        step = np.linalg.pinv(J, rcond=1e-7) @ off[rows][..., None]
        moved = q[rows] + step[..., 0]
        now, better = _off(forward(mechanism, moved), T[rows], reach)
        helps = better < error[rows]
        kept = rows[helps]
        q[kept], off[kept], error[kept] = moved[helps], now[helps], better[helps]
        if not len(kept):
            break
    return principal(q), error


def _off(found: Any, wanted: Any, reach: float) -> tuple[Any, Any]:
    """Return the small displacement (k, 6) from a pose to the one wanted, in rad and over the reach, and its size."""
    R, Q = found[..., :3, :3], wanted[..., :3, :3]
    turn = np.cross(R, Q, axis=-2).sum(axis=-1) / 2
    # opposite axes have no cross product either
    turn_size = np.sqrt(np.square(R - Q).sum(axis=(-2, -1)) / 2)
    shift = (wanted[..., :3, 3] - found[..., :3, 3]) / reach
    size = np.maximum(turn_size, np.abs(shift).max(axis=-1))
    return np.concatenate([turn, shift], axis=-1), size
