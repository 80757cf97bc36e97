"""In which order a machine goes through planned readings: a short way, with the directions of approach as planned.

What cannot be changed in passing comes first: the load, the temperature. Then poses are put in an order in which every
joint whose side counts comes from the side that was planned: up through those from below, down through those from
above. Where that cannot be had for all, `as_moved` says what the order makes of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Ints
from rodgen.calibration.plan.rows import Rows
from rodgen.data.poses import approach

WRONG = 100.0
"""What a wrong direction of approach counts, in ways through the whole travel."""
LARGE = 60
"""Poses up to which every move of a pose to another place in the order is tried."""


def wrong_sides(rows: Rows, sides: tuple[int, ...]) -> Ints:
    """Return the numbers of the readings that the order brings from another side than was planned."""
    wrong = np.zeros(rows.n, bool)
    for j in sides:
        made = approach(rows.q[:, j])
        wrong |= (made != 0) & (made != rows.s[:, j])
    return np.flatnonzero(wrong)


def ordered(rows: Rows, sides: tuple[int, ...], span: Array, start: Array) -> Rows:
    """Return readings in the order in which they are to be taken.

    Parameters
    ----------
    sides : tuple of int
        Joints whose direction of approach counts: that of the first reading, too, on the way from the start.
    span : ndarray, shape (J,)
        Way of each joint that counts as one: its travel, or how far it goes in some time; infinite where it costs none.
    start : ndarray, shape (J,)
        Where the machine stands.
    """
    block = np.stack([rows.state, rows.load], axis=1)
    found: list[int] = []
    for kind in np.unique(block, axis=0)[::-1]:  # the temperature of the last rows is met first
        inside = np.flatnonzero(np.all(block == kind, axis=1))
        found += [int(i) for i in inside[_one_block(rows.take(inside), sides, span, start)]]
        start = rows.q[found[-1]]
    return rows.take(np.array(found))


def _one_block(rows: Rows, sides: tuple[int, ...], span: Array, start: Array) -> Ints:
    """Return the order of readings with one load; those of one pose stand together, by target."""
    key = np.concatenate([rows.q, rows.s[:, sides], rows.v], axis=1)
    _, first, pose = np.unique(key, axis=0, return_index=True, return_inverse=True)
    pose = pose.ravel()
    scale = np.where(span > 0, span, 1.0)
    q, s = rows.q[first] / scale, rows.s[first][:, sides]
    order = _poses(q, s, sides, start / scale)
    rank = np.empty(len(first), int)
    rank[order] = np.arange(len(first))
    return np.lexsort((rows.target, rank[pose]))


def _poses(q: Array, s: NDArray[np.int8], sides: tuple[int, ...], start: Array) -> Ints:
    n = len(q)

    def cost(order: Ints) -> float:
        way = np.concatenate([start[None], q[order]])
        total = float(np.abs(np.diff(way, axis=0)).max(axis=1).sum())
        for i, j in enumerate(sides):
            made = approach(np.append(start[j], q[order, j]))[1:]
            total += WRONG * float(np.sum((made != 0) & (made != s[order, i])))
        return total

    starts = [_nearest(q, start)]
    for i, j in enumerate(sides):
        up, down = np.flatnonzero(s[:, i] > 0), np.flatnonzero(s[:, i] < 0)
        rising, falling = up[np.argsort(q[up, j])], down[np.argsort(-q[down, j])]
        starts += [np.concatenate([rising, falling]), np.concatenate([falling, rising])]
    order = min(starts, key=cost)
    best = cost(order)
    for _ in range(4 if n <= LARGE else 0):
        before = best
        for i in range(n):
            rest = np.delete(order, i)
            for k in range(n):
                other = np.insert(rest, k, order[i])
                value = cost(other)
                if value < best - 1e-12:
                    order, best, rest = other, value, np.delete(other, i)
        if best > before - 1e-9:
            break
    return order


def _nearest(q: Array, start: Array) -> Ints:
    """Return the order that goes to the nearest pose each time."""
    left, order, at = list(range(len(q))), [], start
    while left:
        k = min(left, key=lambda i: float(np.abs(q[i] - at).max()))
        left.remove(k)
        order.append(k)
        at = q[k]
    return np.array(order)
