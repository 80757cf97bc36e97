"""Positions that are measured several times: the readings there may share an error of the position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.machines.machine import Effect
from rodgen.machines.observations import Observations
from rodgen.statistics.thresholds import EVIDENCE

MOST_POSITIONS = 300
"""Positions times readings beyond which an error that each shares changes little of what is decided."""
COORDINATE = {"q", "zeta", *(f"P{k}" for k in range(1, 5))}
FIXED = {"L", "N", "U", "V", "EX", "EY", "EZ", "pi"}
"""Names in the formula of an effect for its joint's coordinate, and for what the coordinate does not change."""
OF_NO_POSE = {"t", "T", "F", "s", "v"}
"""Names for what a pose does not determine."""


def position_numbers(values: Array) -> NDArray[np.int_]:
    """Return the number of each row's position, (n,): equal where coordinates of a joint are all but the same.

    A position is no wider than that: coordinates close to each other along a continuous way are several.
    """
    order = np.argsort(values, kind="stable")
    ascending, width = values[order], EVIDENCE.same_position * np.ptp(values)
    first = [0]
    while (end := int(np.searchsorted(ascending, ascending[first[-1]] + width, "right"))) < len(values):
        first.append(end)
    number = np.empty(len(values), int)
    number[order] = np.searchsorted(first, np.arange(len(values)), "right") - 1
    return number


def distinct_positions(values: Array, poses: int) -> NDArray[np.int_] | None:
    """Return the number of each row's position, None where these are not far fewer than those of a continuous way.

    As many poses at random along a way share some positions, too: the next position begins a width and the mean
    distance of two poses further on. With half as many positions as these, or more, poses are as good as positions.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Coordinates of a joint, or another column.
    poses : int
        Number of poses.

    Returns
    -------
    ndarray of int, shape (n,), or None
    """
    number = position_numbers(values)
    continuous = poses / (1 + poses * EVIDENCE.same_position)
    return number if int(number.max(initial=0)) + 1 < continuous / 2 else None


def position_of(effect: Effect, observations: Observations) -> str | None:
    """Return the joint of whose coordinate alone an effect is a function; None where there is no such joint.

    It is the effect's own; where only one joint moves, all that depends on the pose depends on that joint.
    """
    definition = effect.definition
    names = definition.formula.names - definition.parameters.keys()
    if names & COORDINATE and names <= COORDINATE | FIXED:
        return str(effect.place)
    moving = np.flatnonzero(np.ptp(observations.q, axis=0) > 0)
    if len(moving) != 1 or definition.own or definition.per_run or names & OF_NO_POSE:
        return None
    return observations.machine.joints[int(moving[0])].name


def places_of_rows(o: Observations) -> NDArray[np.int_]:
    """Return the number of the position of all joints, with the target, of each row, (n,)."""
    moving = np.flatnonzero(np.ptp(o.q, axis=0) > 0)
    found = [position_numbers(o.q[:, j]) for j in moving]
    _, number = np.unique(np.column_stack([o.target, *found]), axis=0, return_inverse=True)
    return np.asarray(number.ravel())


def shared_positions(o: Observations, m: int) -> Array | None:
    """Return indicators of the m readings of each position that is measured in several poses, (n, m, positions m).

    None where no position is read in two poses, or where positions are too many to matter.
    """
    number = places_of_rows(o)
    count = int(number.max(initial=-1)) + 1
    poses = len(np.unique(np.column_stack([number, o.pose]), axis=0))
    if poses == count or count * m > MOST_POSITIONS:
        return None
    found = np.zeros((len(number), m, count, m))
    rows = np.arange(len(number))
    for k in range(m):
        found[rows, k, number, k] = 1.0
    return found.reshape(len(number), m, count * m)
