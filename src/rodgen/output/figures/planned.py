"""Readings that a plan proposes, to be drawn among those that were measured."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from rodgen.array_types import Array
from rodgen.calibration.problem.binding import bind
from rodgen.data.drivers import Driver, drivers_of_place
from rodgen.errors import InputFileError
from rodgen.output.figures.style import BLUE, add_trace

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.calibration.plan import Plan

PLANNED: dict[str, Any] = {"symbol": "diamond-open", "size": 9, "color": BLUE, "line": {"width": 2}}
"""How they look."""
AT_EDGE = "Planned readings, which have no residual yet, are at the lower edge."


class PlannedRows:
    """The rows of a plan, as a model that was fitted sees them.

    Parameters
    ----------
    fit : FittedModel
    plan : Plan
        With rows.
    """

    def __init__(self, fit: FittedModel, plan: Plan) -> None:
        self.fit = fit
        machine = replace(fit.machine, targets=(*fit.machine.targets, *plan.new_targets))
        self.o = bind(machine, plan.rows, allow_missing_readings=True)
        self.tips = [f"planned, no. {i + 1}" for i in range(self.o.n)]

    def mark(self, figure: go.Figure, number: int, x: Array, y: Array) -> None:
        """Add their marks to a panel."""
        add_trace(
            figure, number, "planned", x=x, y=y, mode="markers", marker=PLANNED, hovertext=self.tips, hoverinfo="text"
        )  # fmt: skip

    @cached_property
    def places(self) -> Array:
        """Where the model puts them, (n, 3), in machine axes; NaN at targets that the fit does not know."""
        known = self.o.target < len(self.fit.machine.targets)
        found = np.full((self.o.n, 3), np.nan)
        rows = replace(self.o.take(known), machine=self.fit.machine)
        found[known] = self.fit.places(rows)
        return found

    @property
    def known_places(self) -> Array:
        """Those of `places` that are known."""
        return self.places[np.isfinite(self.places).all(axis=1)]

    def along(self, driver: Driver) -> Array | None:
        """Return where they stand on an axis that shows a driver of measured rows, (n,); None if that is not known."""
        if driver.kind == "order":
            return np.asarray(np.max(driver.noted) + 1.0 + np.arange(self.o.n))
        every = [*self.o.drivers()]
        if driver.kind == "place":
            every += drivers_of_place(self.fit.machine, self.places)
        own = next((d for d in every if d.name == driver.name), None)
        if own is None or own.unit != driver.unit:
            return None
        if driver.categories:
            names = [own.categories[int(code)] for code in own.values]
            return np.array([driver.categories.index(x) if x in driver.categories else np.nan for x in names])
        return np.asarray(own.noted, float)


def planned_rows(fit: FittedModel, plan: Plan | None) -> PlannedRows | None:
    """Return the rows of a plan; None without any, and of a plan for another machine."""
    if plan is None or not plan.count:
        return None
    with suppress(InputFileError):
        return PlannedRows(fit, plan)
    return None
