"""Positions that are measured several times: the readings there may share an error of the position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.data.poses import groups, positions
from rodgen.machines.observations import Observations


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


def positions_of(o: Observations) -> NDArray[np.intp]:
    """Return the number of the position of all joints of each row, (n,): equal where a pose is read again."""
    _, first, of = np.unique(o.pose, return_index=True, return_inverse=True)
    return np.asarray(groups([positions(column) for column in o.q[first].T], len(first))[of])
