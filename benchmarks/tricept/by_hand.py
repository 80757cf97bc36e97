"""The Tricept in NumPy as who knows both would write it: pose by pose, and for whole arrays at once.

All forms compute the same: from a point the pose of the assembled machine, its rods, A35, and A35 U_x A35ᵀ. None of
them tests its input or gives a status. q is the platform's centre, which saves some terms that rodgen keeps.
"""

from __future__ import annotations

import numpy as np

R, r = 330.0, 140.0
COSINES = np.array([1.0, -0.5, -0.5])
SINES = np.array([0.0, np.sqrt(0.75), -np.sqrt(0.75)])
E = np.stack([COSINES, SINES, np.zeros(3)], axis=1)


def one(Q, U):
    """One point, with 3x3 matrices: how the paper's equations are programmed first."""
    z = np.linalg.norm(Q)
    level = np.hypot(Q[0], Q[2])
    sb, cb = Q[0] / level, Q[2] / level
    sa, ca = Q[1] / z, level / z
    turn = np.array([[cb, -sb * sa, sb * ca], [0.0, ca, sa], [-sb, -cb * sa, cb * ca]])
    along = E @ turn.T
    rods = r * along + z * turn[:, 2] - R * E
    legs = np.sqrt((rods**2).sum(axis=1))
    M33 = np.array(
        [[-z * sb * sa, z * cb * ca, sb * ca], [z * ca, 0, sa], [-z * cb * sa, -z * sb * ca, cb * ca]]
    )
    by_beta = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    by_alpha = turn @ np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    joints = r * along + z * turn[:, 2]
    platform = r * E + [0, 0, z]
    P = np.stack(
        [(rods * (platform @ by_alpha.T)).sum(axis=1), (rods * (joints @ by_beta.T)).sum(axis=1), rods @ turn[:, 2]],
        axis=1,
    )  # fmt: skip
    right = np.column_stack([np.diag(legs), -(rods * along).sum(axis=1), (rods * E).sum(axis=1)])
    A = M33 @ np.linalg.solve(P, right)
    return np.array([np.arctan2(sa, ca), np.arctan2(sb, cb), z]), legs, A @ U @ A.T


def loop(Q, U):
    """Call `one` for every point."""
    n = len(Q)
    poses, legs, U_y = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3))
    for i in range(n):
        poses[i], legs[i], U_y[i] = one(Q[i], U)
    return poses, legs, U_y


def _parts(Q):
    """What both vectorised forms share: sines, rods, and rows P_k, one array a component."""
    x, y, h = Q.T
    level = np.sqrt(x * x + h * h)
    z = np.sqrt(level * level + y * y)
    sb, cb, sa, ca = x / level, h / level, y / z, level / z
    pose = np.stack([np.arctan2(sa, ca), np.arctan2(sb, cb), z], axis=1)
    column = (sb * ca, sa, cb * ca)
    rods, along, rows = [], [], []
    for c, s in zip(COSINES, SINES, strict=True):
        a = (cb * c - sb * sa * s, ca * s, -sb * c - cb * sa * s)
        rod = (r * a[0] + x - R * c, r * a[1] + y - R * s, r * a[2] + h)
        low = -sa * z - ca * r * s
        row = (
            -R * (c * sb * low + s * (ca * z - sa * r * s)),
            -R * c * (r * a[2] + h),
            rod[0] * column[0] + rod[1] * column[1] + rod[2] * column[2],
        )
        rods.append(rod)
        along.append(a)
        rows.append(row)
    M33 = ((-z * sb * sa, h, column[0]), (z * ca, 0 * z, column[1]), (-z * cb * sa, -x, column[2]))
    return pose, rods, along, rows, M33


def with_solve(Q, U):
    """Stacked matrices: matmul and solve."""
    pose, rods, along, rows, M33 = _parts(Q)
    n = len(Q)
    P, M = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    right = np.zeros((n, 3, 5))
    legs = np.empty((n, 3))
    for k in range(3):
        legs[:, k] = np.sqrt(sum(a * a for a in rods[k]))
        right[:, k, k] = legs[:, k]
        right[:, k, 3] = -sum(a * b for a, b in zip(rods[k], along[k], strict=True))
        right[:, k, 4] = COSINES[k] * rods[k][0] + SINES[k] * rods[k][1]
        for j in range(3):
            P[:, k, j] = rows[k][j]
            M[:, k, j] = M33[k][j]
    A = M @ np.linalg.solve(P, right)
    return pose, legs, A @ U @ A.swapaxes(1, 2)


def with_cofactors(Q, U):
    """Component arrays throughout: Cramer's rule instead of solve, one einsum for each product with U."""
    pose, rods, along, P, M33 = _parts(Q)
    n = len(Q)
    cofactor = [
        [
            P[(j + 1) % 3][(i + 1) % 3] * P[(j + 2) % 3][(i + 2) % 3]
            - P[(j + 1) % 3][(i + 2) % 3] * P[(j + 2) % 3][(i + 1) % 3]
            for j in range(3)
        ]
        for i in range(3)
    ]
    inverse = 1 / (P[0][0] * cofactor[0][0] + P[0][1] * cofactor[1][0] + P[0][2] * cofactor[2][0])
    legs = np.empty((n, 3))
    A = np.empty((3, 5, n))
    by_r = [sum(a * b for a, b in zip(rods[k], along[k], strict=True)) for k in range(3)]
    by_R = [COSINES[k] * rods[k][0] + SINES[k] * rods[k][1] for k in range(3)]
    for k in range(3):
        legs[:, k] = np.sqrt(sum(a * a for a in rods[k]))
    for i in range(3):
        N = [
            inverse * (M33[i][0] * cofactor[0][k] + M33[i][1] * cofactor[1][k] + M33[i][2] * cofactor[2][k])
            for k in range(3)
        ]
        for k in range(3):
            A[i, k] = N[k] * legs[:, k]
        A[i, 3] = -(N[0] * by_r[0] + N[1] * by_r[1] + N[2] * by_r[2])
        A[i, 4] = N[0] * by_R[0] + N[1] * by_R[1] + N[2] * by_R[2]
    half = np.einsum("ian,ab->ibn", A, U)
    return pose, legs, np.einsum("ibn,jbn->nij", half, A)


def blocked(function, size):
    """Let a vectorised form work on blocks that stay in the cache."""

    def call(Q, U):
        n = len(Q)
        out = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3))
        for start in range(0, n, size):
            part = slice(start, start + size)
            for target, found in zip(out, function(Q[part], U), strict=True):
                target[part] = found
        return out

    return call
