"""Drivers: the recorded quantities of each row, apart from its reading, that an error may depend on.

A driver is a joint's coordinate, its direction of approach, its velocity or its temperature, the load, the time, the
run, the target, or any other column; `Observations.drivers` lists those of a data set. Curves over a driver are of low
order, so that they say that an error depends on it, not how: harmonics where a coordinate goes all the way round, else
polynomials on a scale halfway between the values and their ranks, so that no single value far from the others decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.data.units import ANGLE, ONE, Dimension
from rodgen.machines.parts import MachineData

Kind: TypeAlias = Literal[
    "joint",
    "period",
    "approach",
    "velocity",
    "load",
    "temperature",
    "column",
    "time",
    "order",
    "target",
    "run",
    "place",
]

HARMONICS, DEGREE = 4, 5
"""Harmonics, and degree of the polynomial, of the curve over one driver."""
LOW_HARMONICS, LOW_DEGREE = 2, 3
"""The same of each factor of a product of two."""
NODES = 9
"""Number of quantiles that the curve from values to ranks passes through."""
WIDEST_GAP = np.pi / 2
"""A revolute joint goes all the way round when no gap between its coordinates is wider: a quarter of a turn is a period
of the highest harmonic, which nothing would hold in a wider gap."""


@dataclass(frozen=True, eq=False)
class Driver:
    """Something that an error may depend on."""

    kind: Kind
    name: str
    """The joint or the column; ``"dir_C"``, ``"order"``, ``"run"`` also where there is no such column."""
    values: NDArray[Any] = field(repr=False)
    """Of each row, in internal units; temperatures in kelvins from the machine's reference; or the number of a
    category, (n,)."""
    noted: NDArray[Any] = field(repr=False)
    """The same as the table states it, in `unit`, (n,)."""
    unit: str = ""
    """Unit of the table; empty where there is none."""
    text: str = ""
    """What a sentence calls it."""
    scale: float = 1.0
    """Internal value of one unit of a coordinate."""
    dimension: Dimension = ONE
    joint: str | None = None
    """The joint that it belongs to."""
    number: int | None = None
    """Number of that joint, from 0."""
    coordinate: Driver | None = field(default=None, repr=False)
    """That joint's coordinate, except for a coordinate itself: lost motion of a table shows in x at one angle and in y
    at another."""
    period: float | None = None
    """What a whole turn is, internal units, of what may close on itself."""
    categories: tuple[str, ...] = ()
    """Names of the categories; empty for numbers."""

    @property
    def label(self) -> str:
        """The name with its unit; of the order, what its numbers are."""
        if self.kind == "order":
            return f"{self.counted}, in the order of the file"
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def counted(self) -> str:
        """What the numbers of the order are: lines of a file, or rows of a table in memory."""
        return "row (from 0)" if self.unit == "row" else self.unit

    @property
    def revolute(self) -> bool:
        """Whether it is the coordinate of a revolute joint."""
        return self.kind == "joint" and self.dimension == ANGLE

    @property
    def in_time(self) -> bool:
        """Whether it is the time, or the order of the rows in its place."""
        return self.kind in {"time", "order"}

    def as_noted(self, mean: Callable[[NDArray[Any]], Array], first: NDArray[np.intp]) -> Driver:
        """Return the driver in the units of the table, averaged over groups of rows.

        Parameters
        ----------
        mean : callable
            Takes a number of each row, (n,), to its means over the groups, (N,).
        first : ndarray of int, shape (N,)
            A row of each group. Its category and its direction of approach are those of the group.
        """
        whole = bool(self.categories) or self.kind in {"approach", "run"}
        values = self.noted[first].astype(float) if whole else mean(self.noted)
        coordinate = self.coordinate and self.coordinate.as_noted(mean, first)
        period = None if self.period is None else self.period / self.scale
        return replace(self, values=values, noted=values, coordinate=coordinate, period=period, scale=1.0)

    # values ----------------------------------------------------------------------------------------------------------

    @cached_property
    def distinct(self) -> Array:
        """The different values, sorted."""
        return np.unique(self.values)

    @property
    def low(self) -> float:
        """The lowest value."""
        return float(self.distinct[0])

    @property
    def span(self) -> float:
        """The length of the range."""
        return float(self.distinct[-1] - self.distinct[0])

    @cached_property
    def levels(self) -> int:
        """Number of different values; those closer than 1e-9 of the range count as one."""
        values = self.distinct
        if not len(values) or self.span <= 1e-12 * np.abs(values).max():
            return min(len(values), 1)
        return int(np.sum(np.diff(values) > 1e-9 * self.span)) + 1

    @cached_property
    def turn(self) -> float | None:
        """What a whole turn is, where the values go all the way round; else None."""
        closes = self.period is not None and (
            self.kind == "period" or goes_round(self.values * (2 * np.pi / self.period))
        )
        return self.period if closes else None

    # curves ----------------------------------------------------------------------------------------------------------

    @cached_property
    def columns(self) -> Array:
        """Columns of the curve, (n, k): what the driver may do to one component of a residual."""
        curve = self.curve(self.values)
        if self.coordinate is None:
            return curve
        curve = curve if self.kind == "temperature" else curve[:, :2]
        return np.column_stack([curve, products(curve[:, :1], self.coordinate.low_columns)])

    @cached_property
    def low_columns(self) -> Array:
        """Columns of low order, for products."""
        return self.curve(self.values, low=True)

    def curve(self, x: Array, *, low: bool = False) -> Array:
        """Return the columns of the curve at values x, (len(x), k), without a constant."""
        if self.categories:
            codes = np.arange(1, len(self.categories))
            shares = np.mean(self.values[:, None] == codes, axis=0)
            return np.asarray((x[:, None] == codes) - shares)
        if self.turn is not None:
            order = min(LOW_HARMONICS if low else HARMONICS, (self.levels - 1) // 2)
            angle = 2 * np.pi / self.turn * np.outer(x, np.arange(1, order + 1))
            columns = [np.cos(angle), np.sin(angle)]
            if self.kind == "joint" and not low:  # a scale error does not close
                columns.append(((x - self.values.mean()) / self.turn)[:, None])
            return np.column_stack(columns)
        degree = min(LOW_DEGREE if low else DEGREE, self.levels - 1)
        return np.asarray(np.polynomial.legendre.legvander(self._stretched(x), degree)[:, 1:], float)

    def _stretched(self, x: Array) -> Array:
        """Bring values to -1 … 1, halfway between their own scale and that of their ranks."""
        low, high, shares = self._ranks
        if high == low:
            return np.zeros(len(x))
        return np.asarray((x - low) / (high - low) + shares(np.clip(x, low, high)) - 1)

    @cached_property
    def _ranks(self) -> tuple[float, float, Callable[[Array], Array]]:
        """Lowest and highest value, and the share of values that are below a value, as a smooth curve that rises."""
        from scipy.interpolate import PchipInterpolator  # takes a third of a second to import

        known, count = np.unique(self.values, return_counts=True)
        if len(known) < 2:
            return float(known[0]), float(known[0]), np.zeros_like
        middle = np.cumsum(count) - count / 2
        share = (middle - middle[0]) / max(middle[-1] - middle[0], 1.0)
        nodes = np.unique(np.searchsorted(share, np.linspace(0, 1, NODES)))
        if len(nodes) < 2:
            return float(known[0]), float(known[-1]), np.zeros_like
        curve: Callable[[Array], Array] = PchipInterpolator(known[nodes], share[nodes])
        return float(known[0]), float(known[-1]), curve


def goes_round(angles: Array) -> bool:
    """Return whether angles in radians lie all around the circle, without a gap wider than a quarter of a turn."""
    angle = np.unique(np.round(angles % (2 * np.pi), 9))
    if len(angle) < 5:
        return False
    return bool(np.max(np.diff(angle, append=angle[0] + 2 * np.pi)) < WIDEST_GAP)


def products(a: Array, b: Array) -> Array:
    """Return every column of a times every column of b, (n, k l)."""
    return np.asarray((a[:, :, None] * b[:, None, :]).reshape(len(a), -1))


def drivers_of_place(machine: MachineData, place: Array) -> Iterator[Driver]:
    """Yield where a model puts what was measured, of places (n, 3) in machine axes; of directions, unit vectors.

    Of directions these are the altitude, and the azimuth as formulas have it: with z upwards 0 towards y and 90 degrees
    towards x.
    """
    size = float(np.max(np.abs(place), initial=0.0)) or 1.0
    place = np.round(place / size, 9) * size  # what differs by rounding is the same
    up = -np.asarray(machine.gravity)
    height = place @ up
    level = place - np.outer(height, up)

    def of(name: str, unit: str, values: Array, text: str, period: float | None = None) -> Driver:
        return Driver("place", name, values, values, unit, text, period=period)

    if machine.measurand.is_direction:
        altitude = np.degrees(np.arctan2(height, np.linalg.norm(level, axis=1)))
        yield of("altitude", "deg", altitude, "the altitude")
        east, north = horizontal(up)
        azimuth = np.degrees(np.arctan2(level @ east, level @ north)) % 360
        yield of("azimuth", "deg", azimuth, "the azimuth", 360.0)
    elif machine.measurand.moving:
        unit = machine.length_unit
        for i, x in enumerate("xyz"):
            yield of(f"place {x}", unit, place[:, i], f"the place in {x}")
        yield of("height", unit, height, "the height")
        radius = np.linalg.norm(level, axis=1)
        yield of("radius", unit, radius, "the distance from the vertical through the origin")


def horizontal(up: Array) -> tuple[Array, Array]:
    """Return the horizontal unit vectors at azimuth 90 and 0 degrees: east and north where x and y are so."""
    north = np.array([0.0, 1.0, 0.0]) if abs(up[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    north = north - (north @ up) * up
    north /= np.linalg.norm(north)
    return np.cross(north, up), north
