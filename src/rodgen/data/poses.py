"""What follows from the order of the rows: directions of approach, poses, and groups of equal rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.statistics.thresholds import EVIDENCE

COPIES = 0.05
"""Share of the rows that may repeat others by chance where readings have few digits; more are taken for copies,
..."""
COPIED_IN_ORDER = 5
"""... where so many in succession repeat others in the same order. Of readings of one component whose noise is as
large as their last digit a quarter repeats an earlier one: five in succession do in one of a thousand places."""
ONE_WAY = 0.9
"""Net over total travel from which on a joint moved one way: its slow effects look like a wandering set-up."""


def approach(coordinate: NDArray[np.float64]) -> NDArray[np.int8]:
    """Return the direction from which a joint approached its position in each row.

    A row that does not move the joint keeps the last direction; rows before its first motion take that
    motion's. A new run is no exception: the machine stood where the run before had left it.

    Parameters
    ----------
    coordinate : ndarray, shape (n,)
        What was commanded, in the order in which the rows were taken.

    Returns
    -------
    ndarray of int8, shape (n,)
        +1 or -1; 0 for a joint that never moves, whose direction is unknown.

    Examples
    --------
    >>> approach(np.array([0.0, 0.0, 90.0, 90.0, 45.0]))
    array([ 1,  1,  1,  1, -1], dtype=int8)
    """
    n = len(coordinate)
    motion = np.zeros(n, np.int8)
    if n > 1:
        np.greater(coordinate[1:], coordinate[:-1], out=motion[1:].view(np.bool_))
        motion[1:] -= coordinate[1:] < coordinate[:-1]
    moved = motion != 0
    if not moved.any():
        return motion
    last = np.where(moved, np.arange(n, dtype=np.int32), np.int32(np.argmax(moved)))
    np.maximum.accumulate(last, out=last)
    return motion[last]


def moved_one_way(q: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which joints moved, and nearly always the same way, (J,).

    Parameters
    ----------
    q : ndarray, shape (n, J)
        Coordinates in the order in which the rows were taken.
    """
    ways = np.diff(q, axis=0)
    return np.asarray(
        (np.ptp(q, axis=0) > 0) & (np.abs(ways.sum(axis=0)) > ONE_WAY * np.abs(ways).sum(axis=0))
    )


def poses(commands: Sequence[NDArray[Any]], run: NDArray[Any]) -> NDArray[np.int32]:
    """Return the number of each row's pose: consecutive rows of a run with equal commands.

    Equal within a thousandth of the way of each joint: an encoder that is read back, or a mount that tracks a star
    while it is logged again, moves a little. Rows of a continuous way are poses of their own.

    Parameters
    ----------
    commands : sequence of ndarray, each of shape (n,)
        What each joint was commanded, and from which side it came where that is stated.
    run : ndarray of int, shape (n,)

    Returns
    -------
    ndarray of int32, shape (n,)
        From 0, in the order of the rows.

    Examples
    --------
    >>> poses([np.array([0.0, 0.001, 5.0, 0.0])], np.array([0, 0, 0, 0]))
    array([0, 0, 1, 2], dtype=int32)
    """
    begins = _begins([*commands, run])
    widths = [EVIDENCE.same_position * np.ptp(column) if len(column) else 0.0 for column in commands]
    far = _begins([run])
    for column, width in zip(commands, widths, strict=True):
        far[1:] |= np.abs(np.diff(column)) > width
    if np.array_equal(far, begins):
        return np.cumsum(begins, dtype=np.int32) - 1
    starts = np.flatnonzero(far)
    narrow = np.ones(len(starts), np.bool_)
    for column, width in zip(commands, widths, strict=True):
        narrow &= np.maximum.reduceat(column, starts) - np.minimum.reduceat(column, starts) <= width
    begins &= far | ~np.repeat(narrow, np.diff(starts, append=len(far)))
    return np.cumsum(begins, dtype=np.int32) - 1


def positions(values: NDArray[Any]) -> NDArray[np.intp]:
    """Return the number of each value's position, (n,): equal where values of a joint are nearly the same.

    A command repeats, though an encoder reads a little off. Where values are so dense that they make a continuous way,
    only those that are the same share a position.

    Examples
    --------
    >>> positions(np.array([0.0, 90.0, 1e-5, 45.0])).tolist()
    [0, 2, 0, 1]
    """
    order = np.argsort(values, kind="stable")
    ascending, width = values[order], EVIDENCE.same_position * np.ptp(values)
    steps = np.diff(ascending, prepend=-np.inf)
    starts = np.flatnonzero(steps > width)
    counts = np.diff(starts, append=len(values))
    dense = ascending[starts + counts - 1] - ascending[starts] > width
    number = np.empty(len(values), np.intp)
    number[order] = np.cumsum(steps > np.where(np.repeat(dense, counts), 0.0, width)) - 1
    return number


def stretches(*columns: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where stretches of consecutive rows that are equal in every column begin, and how long they are.

    Examples
    --------
    >>> stretches(np.array([3, 3, 5, 5]), np.array([0, 0, 0, 1]))
    (array([0, 2, 3]), array([2, 1, 1]))
    """
    starts = np.flatnonzero(_begins(columns))
    return starts, np.diff(starts, append=len(columns[0]))


def _begins(columns: Sequence[NDArray[Any]]) -> NDArray[np.bool_]:
    """Return the rows, (n,), that differ from the row before in any column; the first row does."""
    begins = np.zeros(len(columns[0]), np.bool_)
    begins[:1] = True
    for column in columns:
        begins[1:] |= column[1:] != column[:-1]
    return begins


def groups(columns: Sequence[NDArray[Any]], n: int) -> NDArray[np.intp]:
    """Return a number for each row, the same for rows that are equal in every column.

    Parameters
    ----------
    columns : sequence of ndarray, each of shape (n,)
        Without NaN.
    n : int
        Number of rows.

    Returns
    -------
    ndarray of int, shape (n,)
        From 0; equal where and only where the rows are.

    Examples
    --------
    >>> found = groups([np.array([0.0, 1.0, -0.0, 1.0]), np.array([1, 1, 1, 2])], 4)
    >>> bool(found[0] == found[2]), len(set(found.tolist()))
    (True, 3)
    """
    _, first, group = np.unique(hashes(columns, n), return_index=True, return_inverse=True)
    if len(first) == n or all(np.array_equal(column, column[first][group]) for column in columns):
        return group
    # Two different rows share a hash of 64 bits: sort by every column, which takes ten times as long.
    order = np.lexsort(columns)
    group[order] = np.cumsum(_begins([column[order] for column in columns])) - 1
    return group


def originals(columns: Sequence[NDArray[Any]], n: int) -> NDArray[np.intp] | None:
    """Return the row that each row is a copy of, itself where it is none; None where no rows are copies.

    Copies are rows that repeat earlier ones in every column *and in their order*, as those of a file that was pasted
    twice do, or written line by line twice. Readings of few digits repeat by chance, but not in the order of others.

    Parameters
    ----------
    columns : sequence of ndarray, each of shape (n,)
        Without NaN.
    n : int
        Number of rows.

    Returns
    -------
    ndarray of int, shape (n,), or None

    Examples
    --------
    >>> originals([np.array([0.1, 0.7, 0.4, 0.1, 0.7, 0.4])], 6)
    array([0, 1, 2, 0, 1, 2])
    >>> originals([np.array([0.1, 0.7, 0.4, 0.4, 0.1, 0.7])], 6) is None
    True
    """
    mixed = np.sort(hashes(columns, n))
    if not np.any(mixed[1:] == mixed[:-1]):
        return None
    _, first, group = np.unique(groups(columns, n), return_index=True, return_inverse=True)
    order = np.argsort(group, kind="stable")
    time = np.empty(n, np.intp)  # how many rows before this one are equal to it
    starts, counts = stretches(group[order])
    time[order] = np.arange(n) - np.repeat(starts, counts)
    repeats = np.lexsort((np.arange(n), time))[len(first) :]
    number = np.argsort(np.argsort(first))[group[repeats]]  # of the row repeated, among those that differ
    starts, counts = stretches(number - np.arange(len(repeats)), time[repeats])
    copied = np.repeat(counts >= min(COPIED_IN_ORDER, len(first)), counts)
    if copied.sum() <= COPIES * n:
        return None
    first_of = np.arange(n)
    first_of[repeats[copied]] = first[group[repeats[copied]]]
    return first_of


def hashes(columns: Sequence[NDArray[Any]], n: int) -> NDArray[np.uint64]:
    """Return a hash of each row, (n,): equal for rows that are equal in every column."""
    mixed = np.zeros(n, np.uint64)
    for column in columns:
        if column.dtype.kind == "f":
            mixed ^= (column + 0.0).view(np.uint64)  # -0.0 is 0.0
        else:
            mixed ^= column.astype(np.uint64)
        mixed *= np.uint64(0x9E3779B97F4A7C15)  # 2**64 over the golden ratio
        mixed ^= mixed >> np.uint64(29)
    return mixed
