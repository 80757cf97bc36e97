"""All joint angles that bring the end of an arm with six revolute joints to a pose.

The q with T_F6(q) = T are wanted; there are up to 16. Three axes that follow each other and meet in one
point or are parallel make the problem small: then a closed form, or a pair of equations in two angles, has them all.
Where one of the two equations holds one angle only (an arm of Pieper whose first axes meet), it is solved by itself;
the pair would have a double root for each of its roots. All other rows go to :func:`solve_pair`.

Arms without special geometry are solved by ssik: Raghavan and Roth's 16 solutions of any six revolute joints. ssik is
an optional dependency (``pip install 'rodgen[ik]'``). The first pose of an arm costs it up to a minute and a
half of preparation, which it keeps on disk; each further pose costs milliseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from rodgen.errors import RodgenError
from rodgen.kinematics.backend import kernels, often_single
from rodgen.kinematics.numerics import principal
from rodgen.kinematics.spatial.arm_plan import (
    FREE,
    MEETING,
    WAYS,
    Arm,
    Branch,
    Plan,
    Way,
    both_branches,
    plan,
    reach,
    scaled_jacobian,
)
from rodgen.kinematics.spatial.forward_analysis import forward, link_transform
from rodgen.kinematics.spatial.mechanism import Mechanism
from rodgen.kinematics.spatial.pair_equations import solve_pair
from rodgen.kinematics.spatial.status import Reverse, ReverseStatus, solutions_first
from rodgen.kinematics.spatial.transforms import is_pose

ABSENT = 1e-14
"""An equation does not depend on an angle whose coefficients, relative to the others, are below this."""


def solved(way: Way, arm: Arm, T: Any) -> tuple[Any, Any, Any]:
    """Return all candidates for poses (n, 4, 4): angles (n, m, 6), statuses (n, m), and whether one may be missing (n).

    The angles are those of the mechanism that the arm was made of.
    """
    T = arm.pose(T)
    R, P = T[:, :3, :3], T[:, :3, 3] - np.array([0.0, 0.0, arm.offset[0]])
    M = getattr(kernels, way.equations)(T, arm.a, arm.cosine, arm.sine, arm.offset)
    one, two, status = _pairs(M)
    there = status <= ReverseStatus.FAMILY
    safe_one, safe_two = np.where(there, one, 0.0), np.where(there, two, 0.0)
    branch = way.complete(arm, R[:, None], P[:, None], safe_one, safe_two)
    codes = np.where(branch.double, ReverseStatus.DOUBLE, ReverseStatus.REGULAR)
    codes = np.maximum(codes, np.where(there, status, 0)[..., None])  # the codes rise in this order
    codes = np.where(branch.free, ReverseStatus.FAMILY, codes)
    codes = np.where(there[..., None] & branch.there, codes, ReverseStatus.NONE)
    n = len(T)
    missing = (status == ReverseStatus.INCOMPLETE).any(axis=-1)
    return arm.angles(branch.angles).reshape(n, -1, 6), codes.reshape(n, -1).astype(np.int8), missing


def _pairs(M: Any) -> tuple[Any, Any, Any]:
    """Return solutions of pairs (n, 2, 3, 3): angles (n, 8) and (n, 8), and statuses as of :class:`ReverseStatus`."""
    n = len(M)
    size = np.abs(M).max(axis=(-2, -1), keepdims=True)
    M = M / np.where(size > 0, size, 1.0)
    one, two = np.full((n, 8), np.nan), np.full((n, 8), np.nan)
    status = np.full((n, 8), ReverseStatus.NONE, np.int8)
    left = np.ones(n, bool)
    for swapped in (False, True):
        N = M.swapaxes(-1, -2) if swapped else M
        alone = (
            np.abs(N[..., 1:]).max(axis=(-2, -1)) <= ABSENT
        )  # (n, 2): the second angle is not in the equation
        for equation in (0, 1):
            rows = np.flatnonzero(left & alone[:, equation])
            if len(rows):
                left[rows] = False
                first, second, codes = _one_by_one(N[rows, equation, :, 0], N[rows, 1 - equation])
                if swapped:
                    first, second = second, first
                one[rows, :4], two[rows, :4], status[rows, :4] = first, second, codes
    rows = np.flatnonzero(left)
    if len(rows):
        pair = solve_pair(M[rows])
        one[rows], two[rows], status[rows] = pair
    return one, two, status


def _one_by_one(first: Any, second: Any) -> tuple[Any, Any, Any]:
    """Return solutions of an equation (n, 3) in one angle, and then the other (n, 3, 3) in the other angle."""
    theta, there, double, free = _roots(first)
    u = np.stack([np.ones_like(theta), np.cos(theta), np.sin(theta)], axis=-1)
    second_root, also, double_2, free_2 = _roots(np.einsum("nki,nij->nkj", u, second))
    status = np.where(double[..., None] | double_2, ReverseStatus.DOUBLE, ReverseStatus.REGULAR)
    status = np.where(free[..., None] | free_2, ReverseStatus.FAMILY, status)
    status = np.where(there[..., None] & also, status, ReverseStatus.NONE)
    n = len(first)
    return np.repeat(theta, 2, axis=-1), second_root.reshape(n, 4), status.reshape(n, 4)


def _roots(u: Any) -> Branch:
    """Return the angles (..., 2) with u · (1, cos, sin) = 0, and whether each exists, is double, is free.

    `u` (..., 3) is of size one.
    """
    D, A, B = u[..., 0], u[..., 1], u[..., 2]
    r = np.hypot(A, B)
    room = r - np.abs(D)
    free = (r <= FREE) & (np.abs(D) <= FREE)
    double = (np.abs(room) <= MEETING) & ~free
    there = free | ((room >= -MEETING) & (r > 0))
    q = np.sqrt(np.where((room > 0) & ~double, room * (r + np.abs(D)), 0.0))
    half = np.arctan2(q, -D)
    middle = np.arctan2(B, A)
    theta = np.stack([middle + half, middle - half], axis=-1)
    theta = np.where(free[..., None], 0.0, theta)
    return both_branches(theta, there, double, free, double | free)


SLOTS = 16


@lru_cache(maxsize=16)
def general(mechanism: Mechanism) -> Callable[[Any], tuple[Any, Any, Any]]:
    """Return the function that solves an arm for poses (n, 4, 4).

    It returns candidates: angles (n, 16, 6), statuses (n, 16), and whether one may be missing (n).

    Raises
    ------
    RodgenError
        When ssik is not installed.
    """
    try:
        import ssik
    except ImportError:
        raise RodgenError(
            "no three consecutive axes of this arm meet in one point or are parallel; expected such an arm, or the "
            "package ssik, which solves every arm: pip install 'rodgen[ik]'"
        ) from None
    # ssik's tolerances are for lengths near 1
    unit = reach(mechanism) or 1.0
    a, alpha = np.append(0.0, mechanism.a), np.append(0.0, mechanism.alpha)
    links = link_transform(a / unit, alpha, mechanism.offset / unit, 0.0)
    arm = ssik.Manipulator.from_transforms([*links, np.eye(4)])
    scale = np.ones((4, 4))
    scale[:3, 3] = 1 / unit

    def solve(T: Any) -> tuple[Any, Any, Any]:
        angles = np.zeros((len(T), SLOTS, 6))
        status = np.full((len(T), SLOTS), ReverseStatus.NONE, np.int8)
        missing = np.zeros(len(T), bool)
        for row, pose in enumerate(T * scale):
            solutions = arm.solve(pose, respect_limits=False, enumerate_windings=False, allow_refinement=True)
            missing[row] = len(solutions) % 2  # solutions come and go in pairs
            for slot, solution in enumerate(solutions[:SLOTS]):
                angles[row, slot] = solution.q
                status[row, slot] = ReverseStatus.REGULAR
        return angles, status, missing

    return solve


CHUNK = 2048
"""Poses that are solved at a time by pairs of equations: their arrays stay in the cache."""
CLOSES = 1e-11
"""Largest distance of a solution's pose from the one wanted, in rad and relative to the reach; rounding leaves 1e-14,
and near solutions that meet 1e-13."""
SETTLED = 1e-14
TRIES = 72
"""First angles to try where the first angle is free."""
_CLOSED = {
    "wrist": often_single("robot_wrist_reverse"),
    "parallel": often_single("robot_parallel_reverse"),
}
_DOUBLE, _FAMILY, _NONE = int(ReverseStatus.DOUBLE), int(ReverseStatus.FAMILY), int(ReverseStatus.NONE)


def solve_arm(mechanism: Mechanism, pose: Any) -> Reverse:
    """Return every set of joint angles that brings an arm of six revolute joints to poses (..., 4, 4).

    Raises
    ------
    RodgenError
        As for :func:`rodgen.kinematics.spatial.arm_plan.plan`, and when the arm needs `ssik`, which is not installed.
    """
    chosen = plan(mechanism)
    if chosen.way in _CLOSED:
        return _closed(mechanism, chosen, pose)
    flat = pose.reshape(-1, 4, 4)
    if chosen.way == "general":
        solve, slots = general(mechanism), 16
    else:
        slots = chosen.slots

        def solve(part: Any) -> Any:
            return solved(WAYS[chosen.way], chosen.arm, part)

    angles = np.full((len(flat), slots, 6), np.nan)
    status = np.full((len(flat), slots), ReverseStatus.INVALID, np.int8)
    rows = np.flatnonzero(is_pose(flat))
    for first in range(0, len(rows), CHUNK):
        part = rows[first : first + CHUNK]
        candidates = solve(flat[part])
        angles[part], status[part] = _proved(mechanism, flat[part], *candidates, slots=slots)
    shape = pose.shape[:-2]
    return Reverse(angles.reshape(*shape, slots, 6), status.reshape(*shape, slots))


def _closed(mechanism: Mechanism, chosen: Plan, pose: Any) -> Reverse:
    """Return the solutions of a kernel; those near a degenerate pose are checked by forward analysis and polished."""
    arm = chosen.arm
    turned, status = _CLOSED[chosen.way](arm.pose(pose), arm.a, arm.cosine, arm.sine, arm.offset)
    angles = np.ascontiguousarray(arm.angles(turned))  # written into, row by row
    listed = status.tobytes()  # searched in less time than it takes to call NumPy, where there is one pose
    none_first = chosen.way == "parallel" and _NONE in listed[::8]
    if not none_first and _DOUBLE not in listed and _FAMILY not in listed:
        return Reverse(angles, status)
    flat, codes = angles.reshape(-1, 8, 6), status.reshape(-1, 8)
    poses = pose.reshape(-1, 4, 4)
    if none_first:
        _free_first_angle(chosen, poses, flat, codes)
    row, column = np.nonzero((codes == ReverseStatus.DOUBLE) | (codes == ReverseStatus.FAMILY))
    better, error = _polished(mechanism, poses[row], flat[row, column], steps=40)
    flat[row, column] = better
    lost = error > CLOSES
    flat[row[lost], column[lost]] = np.nan
    codes[row[lost], column[lost]] = ReverseStatus.NONE
    rows = np.unique(row[lost])
    flat[rows], codes[rows] = solutions_first(flat[rows], codes[rows])
    return Reverse(angles, status)


def _free_first_angle(chosen: Plan, pose: Any, angle_rows: Any, status: Any) -> None:
    """Try other first angles where any is possible but zero has no solution, for arms with three parallel axes.

    The point where axes 5 and 6 meet lies on the first axis then; the pose turned about that axis is such a pose, too.
    """
    arm = chosen.arm
    rows = np.flatnonzero(status[:, 0] == ReverseStatus.NONE)
    if not len(rows):
        return
    T = arm.pose(pose[rows])
    W = T[:, :3, 3] - arm.offset[5] * T[:, :3, 2]
    height = arm.cosine[0] * (W[:, 2] - arm.offset[0]) - arm.offset[1:4].sum() - arm.cosine[3] * arm.offset[4]
    size = 1e-12 * (reach(arm) + np.abs(T[:, :3, 3]).sum(axis=-1))
    free = (np.hypot(W[:, 0], W[:, 1]) <= size) & (np.abs(height) <= size)
    rows, T = rows[free], T[free]
    for angle in np.linspace(0, 2 * np.pi, TRIES + 1)[1:-1]:
        if not len(rows):
            return
        c, s = np.cos(angle), np.sin(angle)
        back = np.array([[c, s, 0, 0], [-s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        q, codes = kernels.robot_parallel_reverse(back @ T, arm.a, arm.cosine, arm.sine, arm.offset)
        q[..., 0] = principal(q[..., 0] + angle)
        there = codes[:, 0] <= ReverseStatus.FAMILY
        angle_rows[rows[there]], status[rows[there]] = arm.angles(q[there]), codes[there]
        rows, T = rows[~there], T[~there]


def _proved(
    mechanism: Mechanism, T: Any, angles: Any, status: Any, missing: Any, *, slots: int
) -> tuple[Any, Any]:
    """Return polished candidates that meet the pose, first in (n, slots, 6), and their statuses (n, slots)."""
    n, m, _ = angles.shape
    there = status <= ReverseStatus.FAMILY
    row, column = np.nonzero(there)
    polished, error = _polished(mechanism, T[row], angles[row, column])
    good = error <= CLOSES
    missing = missing.copy()
    missing[row[~good & (status[row, column] == ReverseStatus.REGULAR)]] = True
    there[row[~good], column[~good]] = False
    angles = np.full((n, max(m, slots), 6), np.nan)
    angles[row[good], column[good]] = polished[good]
    codes = np.full((n, max(m, slots)), ReverseStatus.NONE, np.int8)
    codes[:, :m] = np.where(there, status, ReverseStatus.NONE)
    codes = np.where(missing[:, None] & (codes == ReverseStatus.NONE), ReverseStatus.INCOMPLETE, codes)
    angles, codes = solutions_first(angles, codes)
    return angles[:, :slots], codes[:, :slots]


def _polished(mechanism: Mechanism, T: Any, q: Any, steps: int = 3) -> tuple[Any, Any]:
    """Return angles (k, 6) after Newton steps, and the relative errors of their poses."""
    size = reach(mechanism) or 1.0
    q = principal(q)
    off, error = _off(forward(mechanism, q), T, size)
    for _ in range(steps):
        rows = np.flatnonzero((error > SETTLED) & (error < 1e-3))
        if not len(rows):
            break
        J = scaled_jacobian(mechanism, q[rows], size)
        # near a singular pose only the determined directions are moved
        step = np.linalg.pinv(J, rcond=1e-7) @ off[rows][..., None]
        moved = q[rows] + step[..., 0]
        now, better = _off(forward(mechanism, moved), T[rows], size)
        helps = better < error[rows]
        rows_helped = rows[helps]
        q[rows_helped], off[rows_helped], error[rows_helped] = moved[helps], now[helps], better[helps]
        if not len(rows_helped):
            break
    return principal(q), error


def _off(reached: Any, wanted: Any, size: float) -> tuple[Any, Any]:
    """Return the small displacement (k, 6) from a pose to the one wanted, lengths over `size`, and how large it is."""
    R, Q = reached[..., :3, :3], wanted[..., :3, :3]
    turn = np.cross(R, Q, axis=-2).sum(axis=-1) / 2
    # opposite axes have no cross product either
    turn_size = np.sqrt(np.square(R - Q).sum(axis=(-2, -1)) / 2)
    shift = (wanted[..., :3, 3] - reached[..., :3, 3]) / size
    return np.concatenate([turn, shift], axis=-1), np.maximum(turn_size, np.abs(shift).max(axis=-1))
