"""Solve chains and loops by Newton's method from many starts, in plain NumPy: nothing of rodgen is used.

A chain is anything that has `joints`, `a`, `alpha`, `offset`, `angle`, `pitch`, as `rodgen.spatial.Mechanism` has:
joints of the types R, P, C and H, links as in Crane and Duffy's notes. The product

    Z(S_1, theta_1) X(a_12, alpha_12) Z(S_2, theta_2) ... Z(S_n, theta_n) [X(a_n1, alpha_n1) of a loop]

of Z(S, theta) = translation by S and rotation by theta along z, and X(a, alpha) along x, is the pose of an open chain,
and the identity for a loop. Arrays hold one start a column, (3, m), so that a product touches whole rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Chain", "Search", "errors", "forward", "reach", "search", "variables", "wrapped"]

Array = NDArray[np.float64]


class Geometry(Protocol):
    """What this module reads of a mechanism."""

    joints: Any
    a: Any
    alpha: Any
    offset: Any
    angle: Any
    pitch: Any


@dataclass(frozen=True)
class Chain:
    """A chain or loop from plain numbers: rad and one length; NaN where a joint has its variable."""

    joints: str
    a: ArrayLike
    alpha: ArrayLike
    offset: ArrayLike
    angle: ArrayLike
    pitch: ArrayLike = 0.0


class Search(NamedTuple):
    """What `search` found for one pose.

    Attributes
    ----------
    solutions : ndarray, shape (k, v)
        The different solutions, angles in (-pi, pi].
    hits : ndarray, shape (k,)
        From how many starts each was reached.
    condition : ndarray, shape (k,)
        Condition of the Jacobian there, lengths relative to the chain's.
    """

    solutions: Array
    hits: NDArray[np.int64]
    condition: Array


def variables(chain: Geometry) -> list[tuple[int, str]]:
    """Return the joint and the kind of each variable, a C's angle before its offset."""
    kinds = {"R": ["theta"], "H": ["theta"], "P": ["S"], "C": ["theta", "S"]}
    return [(j, kind) for j, joint in enumerate(chain.joints) for kind in kinds[joint]]


def wrapped(angle: Array) -> Array:
    """Return angles in (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)


def reach(chain: Geometry) -> float:
    """Return the length by which positions are measured: that of all links and constant offsets together."""
    total = float(np.nansum(np.abs(chain.a)) + np.nansum(np.abs(chain.offset)))
    return total if total > 0 else 1.0


def _joint_numbers(chain: Geometry, q: Array) -> tuple[Array, Array]:
    """Return offsets and angles of all joints, each (n, m), for variables (v, m)."""
    n, m = len(chain.joints), q.shape[1]
    S = np.broadcast_to(np.asarray(chain.offset, float)[:, None], (n, m)).copy()
    theta = np.broadcast_to(np.asarray(chain.angle, float)[:, None], (n, m)).copy()
    pitch = np.broadcast_to(np.asarray(chain.pitch, float), (n,))
    for row, (j, kind) in enumerate(variables(chain)):
        if kind == "S":
            S[j] = q[row]
            continue
        theta[j] = q[row]
        if chain.joints[j] == "H":
            S[j] = S[j] + pitch[j] * q[row]
    return S, theta


def _walk(chain: Geometry, q: Array) -> tuple[Array, Array, Array, Array]:
    """Return the last frame, (3, 3, m) and (3, m), and directions and points of the joints' axes, (n, 3, m)."""
    n, m = len(chain.joints), q.shape[1]
    a, alpha = np.asarray(chain.a, float), np.asarray(chain.alpha, float)
    S, theta = _joint_numbers(chain, q)
    x, y, z = (np.repeat(column[:, None], m, axis=1) for column in np.eye(3))
    p = np.zeros((3, m))
    axes, points = np.empty((2, n, 3, m))
    for j in range(n):
        axes[j], points[j] = z, p
        p = p + S[j] * z
        c, s = np.cos(theta[j]), np.sin(theta[j])
        x, y = c * x + s * y, c * y - s * x
        if j < len(a):
            p = p + a[j] * x
            c, s = np.cos(alpha[j]), np.sin(alpha[j])
            y, z = c * y + s * z, c * z - s * y
    return np.stack([x, y, z], axis=1), p, axes, points


def forward(chain: Geometry, q: ArrayLike) -> Array:
    """Return the pose, (..., 4, 4), for variables (..., v)."""
    q = np.asarray(q, float)
    R, p, _, _ = _walk(chain, q.reshape(-1, q.shape[-1]).T)
    T = np.zeros((R.shape[2], 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = R.transpose(2, 0, 1), p.T, 1.0
    return T.reshape(*q.shape[:-1], 4, 4)


def errors(chain: Geometry, q: ArrayLike, T: ArrayLike) -> tuple[Array, Array]:
    """Return how far the pose of q is off T: distance relative to the reach, and angle, each (...)."""
    found, T = forward(chain, q), np.asarray(T, float)
    distance = np.linalg.norm(found[..., :3, 3] - T[..., :3, 3], axis=-1) / reach(chain)
    R = np.swapaxes(found[..., :3, :3], -1, -2) @ T[..., :3, :3]
    w = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1)
    angle = np.arctan2(np.linalg.norm(w, axis=-1), np.trace(R, axis1=-2, axis2=-1) - 1)
    return distance, angle


def _residual(R: Array, p: Array, target_R: Array, target_p: Array, length: float) -> Array:
    """Return the remaining error, (6, m): displacement relative to `length`, and rotation vector."""
    D = np.einsum("ikm,jkm->ijm", target_R, R)
    w = np.stack([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
    size = np.sqrt((w * w).sum(axis=0))
    angle = np.arctan2(size, np.trace(D) - 1)
    factor = np.where(size > 1e-9, angle / np.where(size > 1e-9, size, 1.0), 0.5)
    return np.concatenate([(target_p - p) / length, factor * w])


def _jacobian(chain: Geometry, free: list[int], walk: tuple[Array, ...], length: float) -> Array:
    """Return, (m, 6, f), the derivatives of the pose by the free variables: lengths relative to `length`."""
    _, p, axes, points = walk
    pitch = np.broadcast_to(np.asarray(chain.pitch, float), (len(chain.joints),))
    kinds = variables(chain)
    J = np.zeros((6, len(free), p.shape[1]))
    for column, index in enumerate(free):
        j, kind = kinds[index]
        d = axes[j]
        if kind == "S":
            J[:3, column] = d
            continue
        J[:3, column] = np.cross(d, p - points[j], axis=0) / length
        J[3:, column] = d
        if chain.joints[j] == "H":
            J[:3, column] += pitch[j] / length * d
    return J.transpose(2, 0, 1)


def search(
    chain: Geometry,
    T: ArrayLike,
    starts: int = 300,
    seed: int = 0,
    given: dict[int, float] | None = None,
    iterations: int = 60,
) -> list[Search]:
    """Find solutions by Newton's method, damped while it is far off, from random starts.

    Parameters
    ----------
    chain : Geometry
    T : array_like, shape (k, 4, 4)
        Poses; the identity for a loop.
    starts : int
        For each pose.
    seed : int
    given : dict, optional
        Numbers of variables that are inputs, and their values; the others are found.
    iterations : int

    Returns
    -------
    list of Search
        One for each pose.
    """
    T = np.asarray(T, float).reshape(-1, 4, 4)
    kinds, given = variables(chain), given or {}
    free = [v for v in range(len(kinds)) if v not in given]
    is_angle = np.array([kinds[v][1] == "theta" for v in free])
    length = reach(chain)
    rng = np.random.default_rng(seed)
    per_block = max(1, 6000 // starts)
    found: list[Search] = []
    for first in range(0, len(T), per_block):
        poses = T[first : first + per_block]
        target = np.repeat(np.arange(len(poses)), starts)
        q = np.empty((len(kinds), target.size))
        for v, value in given.items():
            q[v] = value
        scale = np.where(is_angle, np.pi, length)[:, None]
        q[free] = rng.uniform(-1.0, 1.0, (len(free), target.size)) * scale
        done = _newton(chain, poses, target, q, free, is_angle, length, iterations)
        for k in range(len(poses)):
            found.append(_different(chain, q[:, done & (target == k)], free, is_angle, length))
    return found


def _newton(
    chain: Geometry,
    poses: Array,
    target: NDArray[np.int64],
    q: Array,
    free: list[int],
    is_angle: NDArray[np.bool_],
    length: float,
    iterations: int,
) -> NDArray[np.bool_]:
    """Improve q in place; tell which of its columns are solutions."""
    R, p = poses[:, :3, :3].transpose(1, 2, 0), poses[:, :3, 3].T
    scale = np.where(is_angle, 1.0, length)
    done = np.zeros(q.shape[1], bool)
    left = np.arange(q.shape[1])
    quiet = np.zeros(q.shape[1], np.int64)
    for _ in range(iterations):
        walk = _walk(chain, q[:, left])
        e = _residual(walk[0], walk[1], R[:, :, target[left]], p[:, target[left]], length)
        size = np.sqrt((e * e).sum(axis=0))
        quiet[left] = np.where(size < 1e-12, quiet[left] + 1, 0)
        # Two more steps after the error is that of rounding: Newton's last doubling of the digits.
        over = quiet[left] > 2
        done[left[over]] = True
        keep = ~over
        left, e, size = left[keep], e[:, keep], size[keep]
        if not left.size:
            break
        walk = tuple(part[..., keep] for part in walk)
        J = _jacobian(chain, free, walk, length)
        # Levenberg-Marquardt with the squared error as damping (Sugihara 2011), which dies out as fast as Newton
        # converges. What stays, the rounding of the matrix, keeps a step in a singular place short.
        normal = np.swapaxes(J, 1, 2) @ J
        normal += ((0.5 * size**2 + 1e-14)[:, None, None]) * np.eye(len(free))
        right = np.einsum("mij,im->mj", J, e)
        step = np.linalg.solve(normal, right[..., None])[..., 0].T
        largest = np.abs(step).max(axis=0)
        step *= np.minimum(1.0, 1.0 / np.maximum(largest, 1e-300))
        q[np.ix_(free, left)] += step * scale[:, None]
    return done


def _different(
    chain: Geometry, q: Array, free: list[int], is_angle: NDArray[np.bool_], length: float
) -> Search:
    """Return those that differ, in the order of their first variable."""
    angle_rows = np.array([kind == "theta" for _, kind in variables(chain)])
    q = np.where(angle_rows[:, None], wrapped(q), q)
    apart = np.where(is_angle, 1.0, length)[:, None]
    chosen: list[Array] = []
    hits: list[int] = []
    while q.shape[1]:
        one = q[:, 0]
        d = (q - one[:, None])[free]
        d = np.where(is_angle[:, None], wrapped(d), d) / apart
        same = np.abs(d).max(axis=0) < 1e-6
        chosen.append(one)
        hits.append(int(same.sum()))
        q = q[:, ~same]
    if not chosen:
        return Search(np.empty((0, len(angle_rows))), np.empty(0, np.int64), np.empty(0))
    solutions = np.array(chosen)
    order = np.lexsort(solutions.T[::-1])
    J = _jacobian(chain, free, _walk(chain, solutions.T), length)
    return Search(solutions[order], np.array(hits)[order], np.linalg.cond(J)[order])
