"""The rows that figures show, with the residuals of one fit, or of two before and after an effect."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from rodgen.array_types import Array, Index
from rodgen.calibration.problem.binding import bind
from rodgen.calibration.reading_motion import error_of_reading, motion_with_reading
from rodgen.calibration.words import plain, three_digits
from rodgen.data.tables.table import row_place
from rodgen.data.units import ARCSEC
from rodgen.errors import InputFileError, RodgenError, joined
from rodgen.machines.drivers import Driver, drivers_of_place
from rodgen.machines.observations import Observations, order_of_rows
from rodgen.output.figures.style import BLUE, add_trace, evenly, label
from rodgen.output.numbers import Shown, minus, shown_unit

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit
    from rodgen.calibration.plan import Plan


MOST_MARKS = 4000
"""In one figure: its data stay below 2 MB with them, and it says no more with more."""
MOST_ROWS = 1000
EXTREMES = 10
"""Largest residuals of each component, before and after, that are always drawn."""
SAME_PLACE = 1e-4
"""Part of the size of the workspace, or of a turn, over which places do not vary."""
MOST_GROUPS, LEAST_IN_GROUP = 12, 4
"""Groups of neighbours along a driver, and rows of each at least."""
SAME_SHARE = 0.01
"""Part of a sum of squares by which two drivers that explain it do not differ."""
DEVIATIONS = "standard deviations"
"""The unit of whitened residuals."""


class DrawnRows:
    """The rows of observations that are drawn: all of few, of many some evenly spread and those with extremes.

    Parameters
    ----------
    last : Fit, optional
        Another model of the same observations, drawn as "after".
    shown : Shown, optional
        The unit in which errors are shown; left out: one in which both have few digits.
    kept : collection of int, optional
        Rows that are drawn in any case, such as those that are selected.
    most : int, optional
        Marks of a figure.
    brief : bool, optional
        Whether hover texts are without commanded coordinates, and numbers have seven digits: a figure half as large.
    """

    def __init__(
        self,
        base: Fit,
        last: Fit | None = None,
        shown: Shown | None = None,
        *,
        kept: Collection[int] = (),
        most: int = MOST_MARKS,
        brief: bool = False,
    ) -> None:
        self.brief = brief
        self.base, self.final = base, base if last is None else last
        self.shown = shown or shown_unit(base.unit, [base.rms, self.final.rms])
        self.outlier = self.base.outliers | self.final.outliers
        self.total, self.components = self.base.residuals.shape
        views = 2 if self.two else 1
        self.most = min(MOST_ROWS, most // ((self.components + 1) * views))
        self.chosen = self._chosen(kept)
        self.bad = self.outlier[self.chosen]
        self.even = np.isin(self.chosen, self._evenly())
        self.o: Observations = self.base.observations.take(self.chosen)

    @property
    def two(self) -> bool:
        """Whether there is a model after the base."""
        return self.final is not self.base

    @property
    def sides(self) -> list[tuple[str, Fit]]:
        """The models with what their residuals are called."""
        return [("before", self.base), ("after", self.final)] if self.two else [("residual", self.base)]

    @property
    def thinned(self) -> str:
        """A sentence on the rows that are not drawn; empty where all are."""
        if len(self.chosen) == self.total:
            return ""
        return (
            f"{len(self.chosen)} of {self.total} rows are drawn: evenly spread, and the {EXTREMES} largest residuals "
            "of every component."
        )

    def _evenly(self) -> Index:
        return evenly(self.total, self.most)

    def _chosen(self, wanted: Collection[int]) -> Index:
        rows = [self._evenly(), np.asarray([*wanted], np.intp)]
        if self.total <= self.most:
            return rows[0]
        for _, fit in self.sides:
            size = np.where(self.outlier[:, None] | ~np.isfinite(fit.residuals), -1.0, np.abs(fit.residuals))
            rows += [np.argpartition(column, -EXTREMES)[-EXTREMES:] for column in size.T]
        rows.append(np.flatnonzero(self.outlier)[:EXTREMES])
        return np.unique(np.concatenate(rows))

    @property
    def units(self) -> list[str]:
        """What components of a residual are shown in."""
        return [self.shown.unit if unit == self.base.unit else unit for unit in self.base.units]

    @property
    def factors(self) -> Array:
        """What brings components of residuals to `units`, (m,)."""
        is_base = np.array([unit == self.base.unit for unit in self.base.units])
        return np.where(is_base, self.shown.factor, self.base.in_units)

    def residuals(self, fit: Fit) -> Array:
        """Return residuals, (chosen, m), in the unit shown."""
        return np.asarray(fit.residuals[self.chosen] * self.shown.factor)

    def every(self, fit: Fit, *, whitened: bool = False) -> Array:
        """Return the residuals of all rows, (n, m), in `units`; or whitened, in standard deviations.

        Whitened: in stated standard deviations, less what a stated correlation explains; where none is stated, in those
        of the last model's residuals.
        """
        if not whitened:
            return np.asarray(fit.residuals * self.factors)
        size = fit.relative_residuals
        if fit.observations.sigma is None:
            size /= np.sqrt(np.mean(self.final.relative_residuals[~self.final.outliers] ** 2)) or 1.0
        return size

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What the components are called."""
        return self.base.machine.measurand.labels

    @cached_property
    def tips(self) -> tuple[str, ...]:
        """The hover text of each row: its place in the file, its target, its commanded coordinates."""
        machine, o = self.base.machine, self.o
        numbers = o.data.numbers(np.arange(o.n)).tolist()
        targets = [plain(target.name, 24) for target in machine.targets]
        joints = [plain(joint.column, 16) for joint in machine.joints]
        commanded = np.transpose([o.q[:, j] / coordinate(o, j)[1] for j in range(len(joints))]).tolist()
        tips = []
        for number, target, bad, row in zip(
            numbers, o.target.tolist(), self.bad.tolist(), commanded, strict=True
        ):
            first = row_place(o.data.counted, [number]) + (", outlier" if bad else "")
            if len(targets) > 1:
                first += f", {targets[target]}"
            if self.brief:
                tips.append(label(first))
                continue
            where = ", ".join(f"{name} {value:.6g}" for name, value in zip(joints, row, strict=True))
            tips.append(label(f"{first}\n{minus(where)}").replace("\n", "<br>"))
        return tuple(tips)

    def tips_with_residuals(self, some: Index) -> list[str]:
        """Return the hover texts of some of the rows with their residuals, before and after."""
        before, after = (self.residuals(fit)[some].tolist() for fit in (self.base, self.final))
        unit, texts = label(self.shown.unit), []
        for row, old, new in zip(some.tolist(), before, after, strict=True):
            lines = [self.tips[row]]
            for name, was, now in zip(self.names, old, new, strict=True):
                lines.append(f"{name}: {_signed(was)}" + (f" → {_signed(now)}" if self.two else ""))
            texts.append(f"{'<br>'.join(lines)} {unit}")
        return texts

    # where --------------------------------------------------------------------------------------------------------

    @cached_property
    def places(self) -> Array:
        """Where the model puts what was measured, (chosen, 3), in machine axes."""
        return self.base.places(self.o)

    def along_reading(self, fit: Fit, joint: int) -> tuple[Array, str, Array]:
        """Return the error of a joint's reading that would explain each residual best, its unit, and what is across.

        The part across is the size of the residual without it, in the unit shown.
        """
        motion = motion_with_reading(fit, self.o, joint)
        residual = np.asarray(fit.residuals[self.chosen]) * fit.unit_factor
        error = error_of_reading(motion, residual)
        across = np.linalg.norm(residual - np.nan_to_num(error)[:, None] * motion, axis=1)
        turns = fit.machine.joints[joint].revolute
        unit, factor = ("arcsec", 1 / ARCSEC) if turns else (self.shown.unit, self.shown.factor)
        return error * factor, unit, across / fit.unit_factor * self.shown.factor

    # against what -------------------------------------------------------------------------------------------------

    @cached_property
    def drivers(self) -> dict[str, Driver]:
        """What residuals can be drawn against, by name, as far as it varies; of the rows that are drawn.

        Joints, their directions of approach, velocities and temperatures, the load, further columns, the time, the
        order of measurement, target and run, and where the model puts what was measured.
        """
        o = self.base.observations
        every = [taken(driver, self.chosen) for driver in (*o.drivers(), order_of_rows(o))]
        size = np.max(np.abs(self.places), initial=0.0)
        places = drivers_of_place(self.base.machine, self.places)
        # what a rotation leaves as it is differs by rounding, and by errors
        every += [d for d in places if np.ptp(d.values) > SAME_PLACE * (360 if d.unit == "deg" else size)]
        return {d.name: d for d in every if d.kind == "order" or np.ptp(d.values) > 0}

    @property
    def main_driver(self) -> str:
        """The driver on which the residuals depend most; the first where they depend on none beyond chance.

        A driver is judged by the means of groups of neighbours along it, by their share of the sum of squares. Of
        white residuals in m components k groups of n rows have k/n of it, with a standard deviation of √(2k/m)/n.
        Places in space repeat what joints say, and joints come first: so does the first within `SAME_SHARE`.
        """
        good = np.flatnonzero(self.even & ~self.bad)
        residual = self.every(self.final, whitened=True)[self.chosen[good]]
        n, m = residual.shape
        k = min(MOST_GROUPS, n // LEAST_IN_GROUP)
        total = float(np.sum(residual**2))
        shares = dict.fromkeys(self.drivers, 0.0)
        for name, driver in self.drivers.items() if k > 1 and 0 < total < np.inf else ():
            order = np.argsort(driver.values[good], kind="stable")
            groups = (residual[part] for part in np.array_split(order, k))
            shares[name] = float(sum(np.sum(r.sum(axis=0) ** 2) / len(r) for r in groups)) / total
        best = max(shares.values())
        least = best - SAME_SHARE if n and best > (k + 3 * np.sqrt(2 * k / m)) / n else 0.0
        return next(name for name, share in shares.items() if share >= least)

    def driver(self, name: str) -> Driver:
        """Return one of `drivers`.

        Raises
        ------
        RodgenError
            When there is none of this name.
        """
        if name not in self.drivers:
            raise RodgenError(f"{name!r} is none of {joined(self.drivers)}")
        return self.drivers[name]


def taken(driver: Driver, rows: Index) -> Driver:
    """Return a driver of some of its rows."""
    coordinate = None if driver.coordinate is None else taken(driver.coordinate, rows)
    return replace(driver, values=driver.values[rows], noted=driver.noted[rows], coordinate=coordinate)


def coordinate(o: Observations, joint: int) -> tuple[str, float]:
    """Return the unit in which a joint's coordinate is shown, that of the data, and its internal value."""
    return o.unit_of(o.machine.joints[joint].column)


def _signed(value: float) -> str:
    return ("−" if value < 0 else "+") + three_digits(abs(float(value)))


# planned rows ------------------------------------------------------------------------------------------------------

PLANNED: dict[str, Any] = {"symbol": "diamond-open", "size": 9, "color": BLUE, "line": {"width": 2}}
"""How they look."""
AT_EDGE = "Planned readings, which have no residual yet, are at the lower edge."


class PlannedRows:
    """The rows of a plan, as a model that was fitted sees them.

    Parameters
    ----------
    fit : Fit
    plan : Plan
        With rows.
    """

    def __init__(self, fit: Fit, plan: Plan) -> None:
        self.fit = fit
        self.o = bind(fit.machine, plan.rows, allow_missing_readings=True)
        self.tips = [f"planned, no. {i + 1}" for i in range(self.o.n)]

    def mark(self, figure: go.Figure, number: int, x: Array, y: Array) -> None:
        """Add their marks to a panel."""
        add_trace(
            figure, number, "planned", x=x, y=y, mode="markers", marker=PLANNED, hovertext=self.tips, hoverinfo="text"
        )  # fmt: skip

    @cached_property
    def places(self) -> Array:
        """Where the model puts them, (n, 3), in machine axes."""
        return self.fit.places(self.o)

    def along(self, driver: Driver) -> Array | None:
        """Return where they stand on an axis that shows a driver of measured rows, (n,); None if that is not known."""
        if driver.kind == "order":
            return np.asarray(np.max(driver.noted) + 1.0 + np.arange(self.o.n))
        every = [*self.o.drivers()]
        if driver.kind == "place":
            every += drivers_of_place(self.fit.machine, self.places)
        driver_there = next((d for d in every if d.name == driver.name), None)
        if driver_there is None or driver_there.unit != driver.unit:
            return None
        if driver.categories:
            names = [driver_there.categories[int(code)] for code in driver_there.values]
            return np.array([driver.categories.index(x) if x in driver.categories else np.nan for x in names])
        return np.asarray(driver_there.noted, float)


def planned_rows(fit: Fit, plan: Plan | None) -> PlannedRows | None:
    """Return the rows of a plan; None without any, and of a plan for another machine."""
    if plan is None or not plan.count:
        return None
    with suppress(InputFileError):
        return PlannedRows(fit, plan)
    return None
