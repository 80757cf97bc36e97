"""How long it takes to go from pose to pose and to read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rodgen.array_types import Array


@dataclass(frozen=True, eq=False)
class Pace:
    """Times of moves and readings, in seconds."""

    settle: float
    """From the end of a move to the reading."""
    reading: float
    speed: Array
    """Of each joint, internal units per second; infinite where its move takes no time, (J,)."""

    def move(self, start: Array, end: Array) -> Array:
        """Return how long moves between positions (..., J) take, all joints at once."""
        way = np.abs(end - start)
        return np.asarray(np.max(way / self.speed, axis=-1) + self.settle * np.any(way > 0, axis=-1))

    def intervals(self, start: Array, q: Array) -> Array:
        """Return the time of each reading after the one before, (n,), from a start (J,) on."""
        before = np.concatenate([start[None], q[:-1]])
        return self.move(before, q) + self.reading
