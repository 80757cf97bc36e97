"""What residuals are held against, and the curves that they may follow over it.

A covariate is a joint's coordinate, a direction of approach, a velocity, time, a temperature, any other column, or the
place where the machine was. Curves are of low order, so that they say "depends on", not "how": harmonics all round a
revolute joint, else polynomials of a scale between the coordinate itself and its ranks, on which no single pose far out
has the last word.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.compare.sample import Sample

__all__ = ["Covariate", "Pair", "covariates", "drivers", "pairs"]

Array: TypeAlias = NDArray[np.float64]

HARMONICS, DEGREE = 4, 5
"""Of the curve over one covariate."""
LOW_HARMONICS, LOW_DEGREE = 2, 3
"""Of each factor of a product of two."""
NODES = 9
"""Quantiles through which the curve from values to ranks goes."""
WIDEST_GAP = np.pi / 2
"""A revolute joint is taken as going all round when no gap between its coordinates is wider."""
SAME = 0.9999
"""Correlation from which two covariates are one: an altitude and the elevation axis that makes it."""


@dataclass(frozen=True, eq=False)
class Covariate:
    """Something that residuals may depend on.

    Attributes
    ----------
    name, unit : str
        As in tables; the unit is empty where there is none.
    kind : str
        ``"joint"``, ``"period"``, ``"approach"``, ``"velocity"``, ``"load"``, ``"temperature"``, ``"column"``,
        ``"time"``, ``"run"``, ``"target"`` or ``"place"``.
    values : ndarray, shape (N,)
        In that unit, or the number of a category.
    text : str
        In a sentence.
    turn : float or None
        What a whole turn is, in that unit, where the curve closes on itself.
    categories : tuple of str
        Names of the categories; empty for numbers.
    of : int or None
        Number of the joint that it belongs to.
    joint : Covariate or None
        That joint's coordinate, where it decides how the effect shows: lost motion of a table shows in x at one
        angle and in y at another.
    same : tuple of str
        Further names of the same thing.
    """

    name: str
    unit: str
    kind: str
    values: Array
    text: str = ""
    turn: float | None = None
    categories: tuple[str, ...] = ()
    of: int | None = None
    joint: Covariate | None = None
    same: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The name with its unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @cached_property
    def columns(self) -> Array:
        """The curve's columns, (N, k): what the covariate may do to one component."""
        if self.joint is None or self.kind == "joint":
            return self.curve(self.values)
        own = self.curve(self.values)
        own = own if self.kind == "temperature" else own[:, :2]
        return np.column_stack([own, _products(own[:, :1], self.joint.low)])

    @cached_property
    def low(self) -> Array:
        """Columns of low order, for products."""
        return self.curve(self.values, low=True)

    def curve(self, x: Array, *, low: bool = False) -> Array:
        """Return the columns at values x, (len(x), k), without a constant."""
        if self.categories:
            codes = np.arange(1, len(self.categories))
            shares = np.mean(self.values[:, None] == codes, axis=0)
            return np.asarray((x[:, None] == codes) - shares)
        if self.turn is not None:
            order = min(LOW_HARMONICS if low else HARMONICS, (self.distinct - 1) // 2)
            angle = 2 * np.pi / self.turn * np.outer(x, np.arange(1, order + 1))
            columns = [np.cos(angle), np.sin(angle)]
            if self.kind == "joint" and not low:  # a scale error does not close
                columns.append(((x - self.values.mean()) / self.turn)[:, None])
            return np.column_stack(columns)
        degree = min(LOW_DEGREE if low else DEGREE, self.distinct - 1)
        return np.asarray(np.polynomial.legendre.legvander(self._stretched(x), degree)[:, 1:], float)

    @cached_property
    def distinct(self) -> int:
        """Number of different values, those closer than 1e-9 of the range taken as one."""
        values = np.sort(self.values)
        if not len(values) or values[-1] - values[0] <= 1e-12 * np.abs(values).max():
            return min(len(values), 1)
        return int(np.sum(np.diff(values) > 1e-9 * (values[-1] - values[0]))) + 1

    def _stretched(self, x: Array) -> Array:
        """Bring values to -1 … 1, halfway between their own scale and that of their ranks."""
        low, high, shares = self._ranks
        if high == low:
            return np.zeros(len(x))
        return np.asarray((x - low) / (high - low) + shares(np.clip(x, low, high)) - 1)

    @cached_property
    def _ranks(self) -> tuple[float, float, Callable[[Array], Array]]:
        """Lowest and highest value, and the share of values that are below a value, as a smooth curve."""
        from scipy.interpolate import PchipInterpolator

        known, count = np.unique(self.values, return_counts=True)
        middle = np.cumsum(count) - count / 2
        share = (middle - middle[0]) / max(middle[-1] - middle[0], 1.0)
        nodes = np.unique(np.searchsorted(share, np.linspace(0, 1, NODES)))
        if len(nodes) < 2:
            return float(known[0]), float(known[-1]), np.zeros_like
        return float(known[0]), float(known[-1]), PchipInterpolator(known[nodes], share[nodes])


@dataclass(frozen=True, eq=False)
class Pair:
    """Two covariates together: what neither explains alone.

    Attributes
    ----------
    first, second : Covariate
    """

    first: Covariate
    second: Covariate
    kind: str = field(default="pair", init=False)

    @property
    def name(self) -> str:
        """Both names."""
        return f"{self.first.name} and {self.second.name}"

    @property
    def text(self) -> str:
        """In a sentence."""
        if self.first.kind == "target":
            return f"{self.second.text}, for each target in another way"
        return f"{self.first.text} and {self.second.text} together"

    @property
    def columns(self) -> Array:
        """Products of low order, (N, k)."""
        return _products(self.first.low, self.second.low)

    @property
    def alone(self) -> Array:
        """What each does alone, (N, k)."""
        return np.column_stack([self.first.columns, self.second.columns])


def _products(a: Array, b: Array) -> Array:
    return np.asarray((a[:, :, None] * b[:, None, :]).reshape(len(a), -1))


# what there is -----------------------------------------------------------------------------------------------------


def covariates(sample: Sample) -> list[Covariate]:
    """List what the residuals of a sample can be held against, most of a machine's own first.

    What does not vary is left out; what is the same as another is told as a further name of that.
    """
    listed: list[Covariate] = []
    for covariate in _all(sample):
        if covariate.distinct < 2:
            continue
        twin = next((i for i, other in enumerate(listed) if _same(covariate, other)), None)
        if twin is None:
            listed.append(replace(covariate, text=covariate.text or covariate.name))
        else:
            listed[twin] = replace(listed[twin], same=(*listed[twin].same, covariate.text or covariate.name))
    return listed


def _all(sample: Sample) -> Iterator[Covariate]:
    o, machine = sample.observations, sample.fit.machine
    columns: Mapping[str, Any] = o.data.columns  # a Column, or Names of a target or run
    joints = []
    for j, joint in enumerate(machine.joints):
        q = sample.mean(o.q[:, j])
        column = columns[joint.name]
        values, unit = sample.mean(column.values), column.unit or ""
        turn = None
        if joint.type == "revolute" and _goes_round(q):
            from rodgen.data.units import unit_factor

            turn = 2 * np.pi / unit_factor(unit, machine.length_unit)[0]
        joints.append(Covariate(joint.name, unit, "joint", values, turn=turn, of=j))
    yield from joints
    for j, joint in enumerate(machine.joints):
        if joint.period is not None:
            from rodgen.data.units import unit_factor

            period = joint.period / unit_factor(joints[j].unit, machine.length_unit)[0]
            name = f"{joint.name} within its period"
            yield replace(joints[j], name=name, kind="period", values=joints[j].values % period, turn=period)
    for j, joint in enumerate(machine.joints):
        # A pose has one direction of approach, whatever rows of it did.
        s = o.s[sample.first, j].astype(float)
        name, text = f"dir_{joint.name}", f"the direction of approach of {joint.name}"
        yield Covariate(name, "", "approach", s, text, of=j, joint=joints[j])
    for j, joint in enumerate(machine.joints):
        if (column := columns.get(f"v_{joint.name}")) is not None:
            values, text = sample.mean(column.values), f"the velocity of {joint.name}"
            yield Covariate(column.name, column.unit or "", "velocity", values, text, of=j, joint=joints[j])
    if (column := columns.get("load")) is not None:
        yield Covariate("load", column.unit or "", "load", sample.mean(column.values), "the load")
    for j, joint in enumerate(machine.joints):
        if joint.name in o.temperature:
            column = columns[f"T_{joint.name}"]
            values = sample.mean(column.values)
            yield Covariate(column.name, column.unit or "", "temperature", values, of=j, joint=joints[j])
    for name in o.covariates:
        yield Covariate(name, columns[name].unit or "", "column", sample.mean(columns[name].values))
    if (column := columns.get("t")) is not None:
        yield Covariate("t", column.unit or "", "time", sample.mean(column.values), "time")
    else:
        order = sample.mean(np.arange(o.n, dtype=float))
        yield Covariate("order", "row", "time", order, "the order of measurement")
    names = tuple(target.name for target in machine.targets)
    yield Covariate(
        "target", "", "target", o.target[sample.first].astype(float), "the target", categories=names
    )
    yield Covariate("run", "", "run", o.run[sample.first].astype(float), "the run", categories=o.run_names)
    yield from _places(sample)


def _goes_round(q: Array) -> bool:
    angle = np.unique(np.round(q % (2 * np.pi), 9))
    if len(angle) < 5:
        return False
    return bool(np.max(np.diff(angle, append=angle[0] + 2 * np.pi)) < WIDEST_GAP)


def _places(sample: Sample) -> Iterator[Covariate]:
    """Yield where the model puts what was measured, in machine axes."""
    fit, place = sample.fit, sample.places
    size = float(np.max(np.abs(place), initial=0.0)) or 1.0
    place = np.round(place / size, 9) * size  # what differs by rounding is the same
    up = -np.asarray(fit.machine.gravity)
    height = place @ up
    level = place - np.outer(height, up)
    if fit.problem.model.structure.kind == "direction":
        altitude = np.degrees(np.arctan2(height, np.linalg.norm(level, axis=1)))
        yield Covariate("altitude", "deg", "place", altitude, "the altitude")
        # Azimuth counts from the first machine axis that is level enough, to the right as seen along gravity.
        x = np.eye(3)[int(np.argmin(np.abs(up)))]
        x = x - (x @ up) * up
        azimuth = np.degrees(np.arctan2(level @ np.cross(up, x), level @ x))
        turn = 360.0 if _goes_round(np.radians(azimuth)) else None
        yield Covariate("azimuth", "deg", "place", azimuth, "the azimuth", turn=turn)
        return
    unit = fit.machine.length_unit
    for i, x in enumerate("xyz"):
        yield Covariate(f"place {x}", unit, "place", place[:, i], f"the place in {x}")
    yield Covariate("height", unit, "place", height, "the height")
    radius = np.linalg.norm(level, axis=1)
    yield Covariate("radius", unit, "place", radius, "the distance from the vertical through the origin")


def _same(one: Covariate, other: Covariate) -> bool:
    """Tell whether two covariates are the same numbers, but for their zero, sign and size."""
    if {one.kind, other.kind} & {"approach", "run", "target", "period", "time"}:
        return False
    if one.turn is not None and other.turn is not None:
        a, b = 2 * np.pi * one.values / one.turn, 2 * np.pi * other.values / other.turn
        return bool(max(abs(np.mean(np.exp(1j * (a + sign * b)))) for sign in (1, -1)) > SAME)
    a, b = one.values - one.values.mean(), other.values - other.values.mean()
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return bool(size > 0 and abs(a @ b) > SAME * size)


def pairs(listed: Sequence[Covariate]) -> list[Pair]:
    """List the pairs that are worth a look: joints with each other, with load, temperatures, columns and targets."""
    joints = [c for c in listed if c.kind == "joint"]
    others = [c for c in listed if c.kind in {"load", "temperature", "column", "target"}]
    found = [Pair(a, b) for a, b in combinations(joints, 2)]
    return found + [Pair(other, joint) for other in others for joint in joints if other.of != joint.of]


def drivers(sample: Sample) -> list[Covariate | Pair]:
    """List everything that a sample is held against; the place last, because joints make it."""
    listed = covariates(sample)
    places = [c for c in listed if c.kind == "place"]
    return [*(c for c in listed if c.kind != "place"), *pairs(listed), *places]
