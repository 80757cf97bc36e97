"""Joint angles of an arm from its two equations: solutions of the pair, and the branches of each.

Where one of the equations holds one angle only (an arm of Pieper whose first axes meet), it is solved by itself; the
pair would have a double root for each of its roots. All other rows go to :func:`solve_pair`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rodgen.kinematics.backend import kernels
from rodgen.kinematics.spatial.arms.plan import Arm
from rodgen.kinematics.spatial.arms.steps import FREE, MEETING, Branch, both_branches
from rodgen.kinematics.spatial.arms.ways import Way
from rodgen.kinematics.spatial.pairs.solve import solve_pair
from rodgen.kinematics.spatial.status import PairStatus, ReverseStatus

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
    there = status <= PairStatus.COMMON_FACTOR
    safe_one, safe_two = np.where(there, one, 0.0), np.where(there, two, 0.0)
    branch = way.complete(arm, R[:, None], P[:, None], safe_one, safe_two)
    codes = np.where(branch.double, ReverseStatus.DOUBLE, ReverseStatus.REGULAR)
    codes = np.maximum(codes, np.where(there, status, 0)[..., None])  # the codes rise in this order
    codes = np.where(branch.free, ReverseStatus.FAMILY, codes)
    codes = np.where(there[..., None] & branch.there, codes, ReverseStatus.NONE)
    n = len(T)
    missing = (status == PairStatus.INCOMPLETE).any(axis=-1)
    return arm.angles(branch.angles).reshape(n, -1, 6), codes.reshape(n, -1).astype(np.int8), missing


def _pairs(M: Any) -> tuple[Any, Any, Any]:
    """Return solutions of pairs (n, 2, 3, 3): angles (n, 8) and (n, 8), and statuses as of :class:`PairStatus`."""
    n = len(M)
    size = np.abs(M).max(axis=(-2, -1), keepdims=True)
    M = M / np.where(size > 0, size, 1.0)
    one, two = np.full((n, 8), np.nan), np.full((n, 8), np.nan)
    status = np.full((n, 8), PairStatus.NONE, np.int8)
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
    other, also, double_2, free_2 = _roots(np.einsum("nki,nij->nkj", u, second))
    status = np.where(double[..., None] | double_2, PairStatus.DOUBLE, PairStatus.REGULAR)
    status = np.where(free[..., None] | free_2, PairStatus.COMMON_FACTOR, status)
    status = np.where(there[..., None] & also, status, PairStatus.NONE)
    n = len(first)
    return np.repeat(theta, 2, axis=-1), other.reshape(n, 4), status.reshape(n, 4)


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
