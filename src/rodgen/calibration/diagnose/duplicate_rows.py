"""Rows that are copies of others, readings and all: they were measured once, and count once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rodgen.data.observations import Observations
from rodgen.data.poses import groups
from rodgen.statistics.thresholds import EVIDENCE

__all__ = ["without_copies"]


def without_copies(observations: Observations) -> NDArray[np.int_]:
    """Return the rows without those that repeat an earlier one, (n,); all where there are only few such rows.

    Parameters
    ----------
    observations : Observations
    """
    o = observations
    columns = [*o.q.T, *o.reading.T, o.target, o.run]
    columns += [c for c in (o.t, o.load) if c is not None] + [*o.temperature.values(), *o.covariates.values()]
    _, first = np.unique(groups(columns, o.n), return_index=True)
    return np.sort(first) if len(first) < (1 - EVIDENCE.copies) * o.n else np.arange(o.n)
