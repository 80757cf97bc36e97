"""How long each stage of a command took, for ``--timings``."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

OTHER = "other"


def _clock() -> tuple[float, float]:
    """Return wall time and processor time, s; that of compilers which have ended is part of the latter."""
    ended = os.times()
    return time.perf_counter(), time.process_time() + ended.children_user + ended.children_system


class Timings:
    """A listener that adds up the time of each stage, without the stages within it.

    What happens outside of all stages is "other", so that the stages add up to the total.

    Parameters
    ----------
    clock : callable, optional
        Returns wall time and processor time, s.
    """

    def __init__(self, clock: Callable[[], tuple[float, float]] = _clock) -> None:
        self._clock = clock
        self._last = clock()
        self._within = [OTHER]
        self._spent: dict[str, tuple[float, float]] = {}

    def begin(self, what: str, total: int | None) -> None:
        """Note that a stage begins."""
        self._charge()
        self._within.append(what)
        self._spent.setdefault(what, (0.0, 0.0))

    def step(self, done: int) -> None:
        """Do nothing: the steps of a stage are not timed one by one."""

    def end(self) -> None:
        """Note that the innermost stage ends."""
        self._charge()
        self._within.pop()

    def _charge(self) -> None:
        """Add the time since the last event to the innermost stage."""
        now, stage = self._clock(), self._within[-1]
        wall, processor = self._spent.get(stage, (0.0, 0.0))
        self._spent[stage] = (wall + now[0] - self._last[0], processor + now[1] - self._last[1])
        self._last = now

    def to_dict(self) -> dict[str, Any]:
        """Return the times until now as plain data: the total, and the stages in the order in which they began."""
        self._charge()
        stages = {name: self._spent[name] for name in (*(n for n in self._spent if n != OTHER), OTHER)}
        wall, processor = (sum(times) for times in zip(*stages.values(), strict=True))
        return {
            "wall_s": wall,
            "processor_s": processor,
            "stages": [
                {
                    "stage": name,
                    "wall_s": own,
                    "processor_s": of_processor,
                    "share": own / wall if wall else 0.0,
                }
                for name, (own, of_processor) in stages.items()
            ],
        }

    def __str__(self) -> str:
        """Return the times until now as a table."""
        found = self.to_dict()
        rows = [("stage", "wall s", "processor s", "share")]
        rows += [
            (each["stage"], f"{each['wall_s']:.2f}", f"{each['processor_s']:.2f}", f"{each['share']:.0%}")
            for each in (*found["stages"], {"stage": "total", **found, "share": 1.0})
        ]
        width = max(len(name) for name, *_ in rows)
        return "\n".join(f"{name:<{width}}{wall:>9}{of:>13}{part:>7}" for name, wall, of, part in rows)
