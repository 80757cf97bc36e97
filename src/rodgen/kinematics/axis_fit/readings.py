"""Readings of bodies in several places, of points or of poses, in scaled lengths, and the motions between."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rodgen.array_types import Array, Index, Mask
from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.axis_fit.pairs import demand_finite

_EPS = float(np.finfo(float).eps)
_FEWEST = 3
"""Points that make a body: with fewer its place is not known."""
_NO_ROTATION = 1e-3
"""By how much a matrix with elements of four decimals stretches at most, generously."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of a body's points and directions in its places, in scaled lengths.

    Attributes
    ----------
    value : (n, 3) array
    place, part : (n,) int arrays
        Where the body was, and which of its points or directions it is.
    slides : (n,) bool array
        True of a point, false of a direction.
    first : (P,) bool array
        The places from which angles and slides count, one of each body.
    start, end : (M,) int arrays
        The places between which each motion is.
    angle : (M,) array
        The angle of each motion as it was read; NaN where it was not.
    attitudes : int
        Number of attitudes, each of three directions.
    row : (n,) int array
        The row of the table in which each reading stands first.
    motion : (N,) int array
        The motion of each row; -1 of the first pose, which has none.
    labels : tuple of str
        Of the motions.
    pairs : (2, N, 3) array
        The points of each row before and after; empty of poses.
    centre : (3,) array
    scale : float
        In the user's unit.
    """

    value: Array
    place: Index
    part: Index
    slides: Mask
    first: Mask
    start: Index
    end: Index
    angle: Array
    attitudes: int
    row: Index
    motion: Index
    labels: tuple[str, ...]
    pairs: Array
    centre: Array
    scale: float

    @property
    def parts(self) -> int:
        """Number of points and directions of all bodies."""
        return int(self.part.max()) + 1

    @property
    def dof(self) -> int:
        """Degrees of freedom: an attitude has three, its directions nine."""
        bodies = int(self.first.sum()) if self.attitudes else 0
        readings = 3 * len(self.value) - 6 * self.attitudes + int(np.isfinite(self.angle).sum())
        unknown = 3 * self.parts - 6 * bodies + 2 * int((~self.first).sum()) + 4
        return readings - unknown


def _displacement(before: Array, after: Array) -> tuple[Array, Array]:
    """Return the rotation and the shift y = R x + t that fit two sets of points best (K. S. Arun and others, 1987)."""
    x, y = before.mean(axis=0), after.mean(axis=0)
    u, _, vt = np.linalg.svd((before - x).T @ (after - y))
    turn = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    rotation = (u @ turn @ vt).T
    return rotation, y - rotation @ x


def read_points(rho: ArrayLike, rho_prime: ArrayLike, move: Any, angle: Any) -> tuple[Readings, Array, Array]:
    """Return readings of points, and the displacement of each motion."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    x, y = real_array("rho", rho, (3,)), real_array("rho_prime", rho_prime, (3,))
    if x.ndim != 2 or x.shape != y.shape or not len(x):
        raise RodgenError(
            f"rho {x.shape} and rho_prime {y.shape} do not fit together; expected (N, 3) and (N, 3)"
        )
    demand_finite("rho", x)
    demand_finite("rho_prime", y)
    N = len(x)
    labels, begins, motion = np.unique(
        np.zeros(N, int) if move is None else np.asarray(move), return_index=True, return_inverse=True
    )
    order = np.argsort(begins)  # as they come
    labels, motion = labels[order], np.argsort(order)[motion]
    if motion.shape != (N,):
        raise RodgenError(f"move has the shape {motion.shape}; expected one label a row: ({N},)")
    centre, scale = frame_of(np.concatenate([x, y]))
    values = (np.concatenate([x, y]) - centre) / scale
    side = np.concatenate([2 * motion, 2 * motion + 1])
    for k, label in enumerate(labels):
        some = motion == k
        _check_body(values[:N][some], values[N:][some], label, len(labels) > 1)
    reading = np.unique(values + 0.0, axis=0, return_inverse=True)[1].ravel()
    stands = coo_array((np.ones(2 * N), (side, reading)), (2 * len(labels), reading.max() + 1)).tocsr()
    stands.data[:] = 1
    common = (stands @ stands.T).tocoo()
    alike = (common.data >= _FEWEST) & (common.row // 2 != common.col // 2)
    links = coo_array((common.data[alike], (common.row[alike], common.col[alike])), common.shape)
    place_of_side = connected_components(links, directed=False)[1]
    place = place_of_side[side]
    nodes, row, node = np.unique(
        np.stack([place, reading], axis=1), axis=0, return_index=True, return_inverse=True
    )
    node = node.ravel()
    ties = coo_array((np.ones(N), (node[:N], node[N:])), (len(nodes), len(nodes)))
    part = connected_components(ties, directed=False)[1]
    start, end = place_of_side[0::2], place_of_side[1::2]
    P = int(place.max()) + 1
    body = connected_components(coo_array((np.ones(len(start)), (start, end)), (P, P)), directed=False)[1]
    first = np.zeros(P, bool)
    first[np.unique(body, return_index=True)[1]] = True
    readings = Readings(
        values[row], nodes[:, 0], part, np.ones(len(row), bool), first, start, end,
        _one_a_turn(angle, motion, labels), 0, row % N, motion, tuple(map(str, labels)),
        values.reshape(2, N, 3), centre, scale,
    )  # fmt: skip
    found = [_displacement(values[:N][motion == k], values[N:][motion == k]) for k in range(len(labels))]
    return readings, np.array([r for r, _ in found]), np.array([s for _, s in found])


def read_poses(position: ArrayLike, rotation: ArrayLike) -> tuple[Readings, Array, Array]:
    """Return readings of poses, and the displacement of each from the first."""
    p, R = poses_of(position, rotation)
    if len(p) < 2:
        raise RodgenError("there is one pose; a motion has two at least")
    centre, scale = frame_of(p)
    n, x = len(p), (p - centre) / scale
    values = np.concatenate([x[:, None], R.mT], axis=1).reshape(-1, 3)
    first, others = np.zeros(n, bool), np.arange(1, n)
    first[0] = True
    readings = Readings(
        values, np.repeat(np.arange(n), 4), np.tile(np.arange(4), n), np.tile([True, False, False, False], n),
        first, np.zeros(n - 1, int), others, np.full(n - 1, np.nan), n,
        np.repeat(np.arange(n), 4), np.arange(-1, n - 1), tuple(str(k + 1) for k in others), np.empty((2, 0, 3)),
        centre, scale,
    )  # fmt: skip
    turns = R[1:] @ R[0].T
    return readings, turns, x[1:] - (turns @ x[0])


def poses_of(position: ArrayLike, rotation: ArrayLike) -> tuple[Array, Array]:
    """Return positions and rotations after a check."""
    p, R = real_array("position", position, (3,)), real_array("rotation", rotation, (3, 3))
    if p.ndim != 2 or R.shape[:-2] != p.shape[:-1]:
        raise RodgenError(
            f"position {p.shape} and rotation {R.shape} do not fit together; expected (N, 3) and (N, 3, 3)"
        )
    demand_finite("position", p)
    demand_finite("rotation", R)
    return p, proper_rotations(R)


def proper_rotations(matrix: Array) -> Array:
    """Return the rotations nearest to matrices (n, 3, 3).

    Raises
    ------
    RodgenError
        For the first that is none: farther from one than four decimals of its elements leave.
    """
    u, size, vt = np.linalg.svd(matrix)
    bad = np.flatnonzero((np.abs(size - 1).max(axis=-1) > _NO_ROTATION) | (np.linalg.det(u @ vt) < 0))
    if len(bad):
        raise RodgenError(
            f"rotation, row {bad[0]} (counted from 0) is no rotation; expected an orthogonal matrix"
        )
    return np.asarray(u @ vt)


def _check_body(points: Array, after: Array, label: Any, named: bool) -> None:
    of = f"move {str(label)!r}" if named else "the table"
    count = len(np.unique(points, axis=0))
    if count < _FEWEST:
        raise RodgenError(
            f"{of} has {count} point{'s' * (count != 1)}; without an angle a motion needs three, not on one line"
        )
    if len(np.unique(np.concatenate([points, after], axis=1), axis=0)) > count:
        raise RodgenError(
            f"a reading before the motion stands in several rows of {of} with other readings after it; expected a "
            "label of its motion in each row, move"
        )
    size = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if size[1] <= 64 * _EPS * max(size[0], float(np.abs(points).max())):
        raise RodgenError(
            f"the points of {of} lie on one line; the turn about it is not known: expected three others"
        )


def _one_a_turn(angle: Any, motion: Index, labels: Array) -> Array:
    """Return the angle of each motion that its rows share; NaN where none was read."""
    if angle is None:
        return np.full(len(labels), np.nan)
    angles = np.broadcast_to(real_array("angle", angle), motion.shape)
    demand_finite("angle", angles)
    found = angles[np.unique(motion, return_index=True)[1]]
    other = np.flatnonzero(angles != found[motion])
    if len(other):
        raise RodgenError(
            f"angle, row {other[0]} (counted from 0) differs from that of other rows of move "
            f"{str(labels[motion[other[0]]])!r}; expected one reading of the angle a move"
        )
    return np.asarray(found)


def frame_of(points: Array) -> tuple[Array, float]:
    """Return the middle of points, and a power of two near their size about it."""
    centre = points.mean(axis=0)
    size = float(np.abs(points - centre).max())
    return centre, float(2.0 ** math.frexp(size)[1]) if size > 0 else 1.0
