"""Readings that may be taken: what is commanded, with which load, when; and as observations for a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Ints
from rodgen.calibration.plan.pace import Pace
from rodgen.calibration.problem.assembly_modes import with_commands
from rodgen.data.observations import Observations
from rodgen.data.poses import approach


@dataclass(frozen=True)
class Rows:
    """Readings that may be taken, in internal units."""

    q: Array
    """Shape (n, J)."""
    s: NDArray[np.int8]
    """Direction of approach, (n, J)."""
    v: Array
    """Shape (n, J)."""
    target: Ints
    """Shape (n,)."""
    load: Array
    """Zero where the data have no such column, (n,)."""
    state: Ints
    """The row of the data in which temperatures and further columns were as they are to be now, (n,)."""

    @property
    def n(self) -> int:
        """Number of readings."""
        return len(self.q)

    def take(self, index: Any) -> Rows:
        """Return some of them."""
        return Rows(*(getattr(self, field.name)[index] for field in fields(self)))

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """Return readings one after the other."""
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))

    def as_moved(self, start: Array) -> Rows:
        """Return them with the directions of approach, and signs of speeds, that their order makes from a start on."""
        s = np.stack([approach(column)[1:] for column in np.concatenate([start[None], self.q]).T], axis=1)
        s = np.where(s == 0, self.s, s).astype(np.int8)
        return replace(self, s=s, v=np.abs(self.v) * s)


def usual_by_target(o: Observations, values: Array, targets: int) -> Array:
    """Return the median of the values (n, ...) of each target's readings, of all where it has none, (targets, ...)."""
    every = np.median(values, axis=0)
    of = [values[o.target == k] for k in range(targets)]
    return np.array([np.median(part, axis=0) if len(part) else every for part in of])


class Surroundings:
    """Makes observations of commanded readings: adds times, temperatures and uncertainties.

    Parameters
    ----------
    observations : Observations
        What was measured.
    targets : int
        How many targets there may be; at least those of the machine.
    wait : float
        For how many times the duration of the data the machine waits before; negative: it begins anew, as after a
        night.
    pace : Pace, optional
        How long moves and readings take; left out: as in the data.
    """

    def __init__(
        self, observations: Observations, targets: int, *, wait: float = 0.0, pace: Pace | None = None
    ) -> None:
        self.o = o = observations
        self.pace = pace
        self.sigma = None if o.sigma is None else usual_by_target(o, o.sigma, targets)
        t, pose = o.t, o.pose
        self.step = 0.0
        if t is not None:
            starts = np.flatnonzero(np.diff(pose, prepend=pose[0] - 1))
            steps = np.diff(t[starts])
            steps = steps[steps > 0]
            self.step = float(np.median(steps)) if len(steps) else 0.0
            later = float(t.max()) + self.step + wait * float(np.ptp(t))
            self.begin = float(t.min()) if wait < 0 else later
            self.first = int(np.argmin(t) if wait < 0 else np.argmax(t))

    def times(self, rows: Rows) -> Array | None:
        """Return when each is taken, one pose after the other.

        Until temperatures are others the time passes that it took in the data.
        """
        if self.o.t is None:
            return None
        if self.pace is not None:
            steps = self.pace.intervals(self.o.q[-1], rows.q)
        else:
            steps = self.step * np.any(np.diff(rows.q, axis=0, prepend=rows.q[:1]) != 0, axis=1)
        waited = np.abs(np.diff(self.o.t[rows.state], prepend=self.o.t[self.first]))
        return np.asarray(self.begin + np.cumsum(steps + waited))

    def observations(self, rows: Rows, t: Any = None) -> Observations:
        """Return the rows as observations without readings; at times `t`, or one pose after the other."""
        o, n = self.o, rows.n
        base = o.take(rows.state)
        times = self.times(rows) if t is None or o.t is None else np.broadcast_to(np.asarray(t, float), n)
        made = replace(
            base,
            q=rows.q,
            s=rows.s,
            v=rows.v,
            t=times,
            load=None if o.load is None else rows.load,
            target=rows.target.astype(np.int32),
            run=np.full(n, o.run[-1], np.int32),
            pose=np.arange(n, dtype=np.int32),
            sigma=None if self.sigma is None else self.sigma[rows.target],
            reading=np.ones((n, o.reading.shape[1])),
        )
        return with_commands(made, o)
