"""The rows of many that decisions are made on: stretches of whole poses, so that neighbours in time stay neighbours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rodgen.data.observations import Observations

MOST_ROWS = 5_000
"""Rows that decisions are made on: an effect that is worth half a percent of the error lowers chi-square on them by 50,
which chance does with p = 2e-12."""
STRETCHES = 20
"""Number of stretches taken of more rows, so that neighbours in time stay neighbours."""


def sample_of(observations: Observations, believed: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Return the rows that decisions are made on: all but outliers, or stretches of whole poses of many rows."""
    rows = np.flatnonzero(believed)
    if len(rows) <= MOST_ROWS:
        return rows
    pose = observations.pose[rows]
    starts = np.linspace(0, len(rows), STRETCHES, endpoint=False).astype(int)
    taken = []
    for start in starts:
        some = rows[start : start + MOST_ROWS // STRETCHES]
        own = pose[start : start + MOST_ROWS // STRETCHES]
        taken.append(some[(own != own[0]) & (own != own[-1])] if len(np.unique(own)) > 2 else some)
    return np.unique(np.concatenate(taken))
