"""The drivers that residuals are compared with: those of the data, the place of the reading, and pairs of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.compare.sample import Sample
from rodgen.data.drivers import Driver, drivers_of_place, products

SAME = 0.9999
"""Correlation from which two drivers are one: an altitude and the elevation axis that makes it."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two drivers together: what neither explains alone."""

    first: Driver
    second: Driver
    kind: str = field(default="pair", init=False)
    in_time: bool = field(default=False, init=False)

    @property
    def name(self) -> str:
        """Both names."""
        return f"{self.first.name} and {self.second.name}"

    @property
    def text(self) -> str:
        """What a sentence calls it."""
        if self.first.kind == "target":
            return f"{self.second.text}, differently for each target"
        return f"{self.first.text} and {self.second.text} together"

    @property
    def columns(self) -> Array:
        """Products of low order, (N, k)."""
        return products(self.first.low_columns, self.second.low_columns)

    @property
    def alone(self) -> Array:
        """What each does alone, (N, k)."""
        return np.column_stack([self.first.columns, self.second.columns])


def compared(sample: Sample) -> list[Driver | Pair]:
    """Return everything that a sample is compared with; the place last, because joints make it.

    What does not vary is left out; what has the same values as another one becomes a further name of that.
    """
    listed: list[Driver] = []
    given = (driver.as_noted(sample.mean, sample.first) for driver in sample.observations.drivers())
    for driver in (*given, *drivers_of_place(sample.fit.machine, sample.places)):
        if driver.levels < 2:
            continue
        twin = next((i for i, other in enumerate(listed) if _same(driver, other)), None)
        if twin is None:
            listed.append(driver)
        else:
            listed[twin] = replace(listed[twin], same=(*listed[twin].same, driver.text))
    places = [driver for driver in listed if driver.kind == "place"]
    return [*(driver for driver in listed if driver.kind != "place"), *_pairs(listed), *places]


def _same(one: Driver, other: Driver) -> bool:
    """Return whether two drivers are the same numbers, but for their zero, sign and size."""
    if {one.kind, other.kind} & {"approach", "run", "target", "period", "time", "order"}:
        return False
    if one.turn is not None and other.turn is not None:
        a, b = 2 * np.pi * one.values / one.turn, 2 * np.pi * other.values / other.turn
        return bool(max(abs(np.mean(np.exp(1j * (a + sign * b)))) for sign in (1, -1)) > SAME)
    a, b = one.values - one.values.mean(), other.values - other.values.mean()
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return bool(size > 0 and abs(a @ b) > SAME * size)


def _pairs(listed: Sequence[Driver]) -> list[Pair]:
    """Return the pairs worth testing: joints with each other, with load, temperatures, columns and targets."""
    joints = [driver for driver in listed if driver.kind == "joint"]
    others = [d for d in listed if d.kind in {"load", "temperature", "column", "target"}]
    found = [Pair(a, b) for a, b in combinations(joints, 2)]
    return found + [Pair(other, joint) for other in others for joint in joints if other.joint != joint.joint]
