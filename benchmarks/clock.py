"""Fair timing on a noisy machine: each contender once per round, in an order that changes from round to round."""

from __future__ import annotations

import gc
import random
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass
class Entry:
    call: Callable[[], object]
    solves: int  # solved by one call
    repeats: int = 1  # calls in one sample
    threads: int = 1
    processor: Callable[[], int] = time.thread_time_ns  # or process_time_ns: of all threads of a contender
    # ns per solve, one a round: processor time, which leaves out what the system gave to others meanwhile;
    # wall time where there are more threads than one.
    samples: list[float] = field(default_factory=list)
    walls: list[float] = field(default_factory=list)

    @property
    def median(self) -> float:
        return statistics.median(self.samples)

    @property
    def spread(self) -> float:
        """Interquartile range over the median: how noisy this figure is."""
        if len(self.samples) < 4:
            return (max(self.samples) - min(self.samples)) / self.median
        low, _, high = statistics.quantiles(self.samples, n=4)
        return (high - low) / self.median

    def once(self) -> tuple[float, float]:
        """Take one sample: processor time, and wall time, in ns per solve."""
        call, loop, used = self.call, range(self.repeats), self.processor
        wall, processor = time.perf_counter_ns(), used()
        for _ in loop:
            call()
        processor, wall = used() - processor, time.perf_counter_ns() - wall
        solves = self.repeats * self.solves
        return processor / solves, wall / solves


def calibrate(entry: Entry, shortest_s: float) -> None:
    """Choose how many calls make a sample of at least ``shortest_s``; the first call warms up."""
    entry.call()
    start = time.perf_counter()
    entry.call()
    spent = max(time.perf_counter() - start, 1e-7)
    entry.repeats = max(1, round(shortest_s / spent))


def alternate(entries: dict[str, Entry], rounds: int, seed: int = 0, budget_s: float = 120.0) -> float:
    """Take ``rounds`` samples of every entry, each round in another random order.

    After ``budget_s`` seconds no further round begins, once there are three.
    Returns the share of a processor that the samples of one thread had: below 1, others were in the way.
    """
    order = random.Random(seed)
    names = list(entries)
    gc.collect()
    gc.disable()
    wall = processor = 0.0
    end = time.perf_counter() + budget_s
    try:
        for number in range(rounds):
            if number >= 3 and time.perf_counter() > end:
                break
            order.shuffle(names)
            for name in names:
                entry = entries[name]
                own, outside = entry.once()
                entry.samples.append(own if entry.threads == 1 else outside)
                entry.walls.append(outside)
                if entry.threads == 1:
                    processor += own * entry.repeats * entry.solves
                    wall += outside * entry.repeats * entry.solves
    finally:
        gc.enable()
    return processor / wall


def ratio(entry: Entry, base: Entry) -> float:
    """Median over the rounds of entry/base: both sides of a quotient saw the same minute.

    Where either side has several threads, both count wall time.
    """
    pairs = zip(entry.samples, base.samples, strict=True)
    if entry.threads > 1 or base.threads > 1:
        pairs = zip(entry.walls, base.walls, strict=True)
    return statistics.median(a / b for a, b in pairs)
