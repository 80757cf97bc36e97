"""Fair timing on a noisy machine: everybody once a round, in an order that changes from round to round."""

from __future__ import annotations

import gc
import random
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field

# A sample during which the thread was off the processor for a twentieth of the time is taken again.
UNDISTURBED = 0.95
TRIES = 4


@dataclass
class Entry:
    call: Callable[[], object]
    solves: int  # solved by one call
    repeats: int = 1  # calls in one sample
    threads: int = 1
    samples: list[float] = field(default_factory=list)  # ns per solve, one a round

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

    def once(self) -> float:
        """Time one sample, in ns per solve."""
        call = self.call
        if self.repeats == 1:
            start = time.perf_counter_ns()
            call()
            spent = time.perf_counter_ns() - start
        else:
            loop = range(self.repeats)
            start = time.perf_counter_ns()
            for _ in loop:
                call()
            spent = time.perf_counter_ns() - start
        return spent / (self.repeats * self.solves)


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
                for _ in range(TRIES):
                    begun = time.perf_counter(), time.thread_time()
                    sample = entry.once()
                    spent = time.perf_counter() - begun[0], time.thread_time() - begun[1]
                    if entry.threads > 1 or spent[1] > UNDISTURBED * spent[0]:
                        break
                entry.samples.append(sample)
                if entry.threads == 1:
                    wall += spent[0]
                    processor += spent[1]
    finally:
        gc.enable()
    return processor / wall


def ratio(entry: Entry, base: Entry) -> float:
    """Median over the rounds of entry/base: both sides of a quotient saw the same minute."""
    return statistics.median(a / b for a, b in zip(entry.samples, base.samples, strict=True))
