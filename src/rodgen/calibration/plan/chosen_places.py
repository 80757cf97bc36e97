"""Readings at places of the target, or in poses, that were given, and on the way back from those that were measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.plan.rows import Rows
from rodgen.statistics.decompositions import svd

if TYPE_CHECKING:
    from rodgen.data.observations import Observations


STEP = 1e-6
"""Of the derivative of places, as a part of a joint's travel."""
ROUNDS = 15
"""Newton's steps at most."""
REACHED = 1e-6
"""Distance from a place that counts as none, as a part of the distance of the places that are reached at all."""
SAME = 1e-4
"""Positions nearer to each other than this part of the travel are one."""


def brought_to(starts: Rows, place: Array, travel: Array, places: Callable[[Rows], Array]) -> Rows:
    """Return readings whose target is at a place, by Newton's method from other ones: the shortest way in each step.

    Parameters
    ----------
    place : ndarray, shape (3,)
    travel : ndarray, shape (J, 2)
    places : callable
        From readings to the places of their targets, (n, 3).
    """
    span = np.ptp(travel, axis=1)
    rows = starts
    for _ in range(ROUNDS):
        at = places(rows)
        jacobian = np.zeros((rows.n, 3, len(span)))
        for j in np.flatnonzero(span):
            q = rows.q.copy()
            q[:, j] += STEP * span[j]
            jacobian[:, :, j] = (places(replace(rows, q=q)) - at) / STEP
        u, s, vt = svd(jacobian)
        inverse = np.divide(1.0, s, out=np.zeros_like(s), where=s > 1e-6 * s[:, :1])
        step = np.einsum("nij,ni,nki,nk->nj", vt, inverse, u, place - at) * span
        rows = replace(rows, q=np.clip(rows.q + step, travel[:, 0], travel[:, 1]))
    at = places(rows)
    size = max(float(np.abs(at).max(initial=0.0)), float(np.abs(place).max()))
    with np.errstate(invalid="ignore"):
        rows = rows.take(np.linalg.norm(at - place, axis=1) < REACHED * size)
    near = np.round(rows.q / np.where(span > 0, span, 1.0) / SAME)
    kind = np.column_stack([near, rows.s, np.sign(rows.v), rows.target, rows.load, rows.state])
    _, first = np.unique(kind, axis=0, return_index=True)
    return rows.take(np.sort(first))


def listed_readings(pool: Rows, poses: Observations) -> Rows:
    """Return those readings that are in a list of poses, as far as its columns go.

    Parameters
    ----------
    pool : Rows
        In positions of the list.
    """
    given = poses.columns_given
    sides = [j for j, joint in enumerate(poses.machine.joints) if f"dir_{joint.column}" in given]

    def kinds(rows: Rows | Observations) -> Array:
        columns: list[NDArray[Any]] = [rows.q, rows.s[:, sides]]
        columns += [np.asarray(getattr(rows, name)) for name in ("target", "load") if name in given]
        return np.column_stack(columns).astype(float)

    wanted = {tuple(kind) for kind in kinds(poses).tolist()}
    return pool.take(np.array([tuple(kind) in wanted for kind in kinds(pool).tolist()], bool))


def gone_back(pool: Rows, q: Array, way: Array, n: int) -> Rows:
    """Return the readings of a pool that lie next to a way that was gone, from its end to its beginning, n at most.

    Parameters
    ----------
    q : ndarray, shape (rows, J)
        The way.
    way : ndarray, shape (J,)
        Of each joint, what counts as one.
    """
    scale = np.where(way > 0, way, 1.0)
    places = q[np.linspace(len(q) - 1, 0, min(n, len(q))).astype(int)]
    nearest = [int(np.argmin(np.abs((pool.q - place) / scale).max(axis=1))) for place in places]
    return pool.take(np.array(list(dict.fromkeys(nearest)))).as_moved(q[-1])
