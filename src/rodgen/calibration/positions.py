"""Positions that are measured several times: the readings there may share an error of the position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.data.poses import groups, positions
from rodgen.machines.machine import Effect
from rodgen.machines.observations import Observations

COORDINATE = {"q", "zeta", *(f"P{k}" for k in range(1, 5))}
FIXED = {"L", "N", "U", "V", "EX", "EY", "EZ", "pi"}
"""Names in the formula of an effect for its joint's coordinate, and for what the coordinate does not change."""
OF_NO_POSE = {"t", "T", "F", "s", "v"}
"""Names for what a pose does not determine."""


def distinct_positions(values: Array, poses: int) -> NDArray[np.intp] | None:
    """Return the number of each row's position, None where these are not far fewer than poses.

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
    number = positions(values)
    return number if int(number.max(initial=0)) + 1 < poses / 2 else None


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


def positions_of(o: Observations) -> NDArray[np.intp]:
    """Return the number of the position of all joints of each row, (n,): equal where a pose is read again."""
    _, first, of = np.unique(o.pose, return_index=True, return_inverse=True)
    return np.asarray(groups([positions(column) for column in o.q[first].T], len(first))[of])
