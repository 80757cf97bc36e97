"""The residuals of a comparison: against each covariate, over the workspace, in order, and their distribution.

Large data are thinned, and the note of the figure says so.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from rodgen.array_types import Array, Index
from rodgen.calibration.reading_motion import error_of_reading, motion_with_reading
from rodgen.data.units import ARCSEC
from rodgen.output.figures.distributions import distribution_of_residuals
from rodgen.output.figures.drawn_rows import DrawnRows
from rodgen.output.figures.maps import residual_map
from rodgen.output.figures.residuals import MEAN, MOST_RUNS, components_of, reading_of, residuals_over
from rodgen.output.figures.style import INK, add_trace, label

if TYPE_CHECKING:
    from rodgen.calibration.compare import Comparison
    from rodgen.calibration.sensitivities import Sensitivities
    from rodgen.machines.drivers import Driver


def comparison(comparison: Comparison) -> Iterator[go.Figure]:
    """Yield every figure of a comparison; the name of each is in its ``layout.meta``.

    Parameters
    ----------
    comparison : rodgen.calibration.compare.Comparison
    """
    yield residuals_in_order(comparison)
    figure = residual_map(comparison.fit)
    if figure is not None:
        yield figure
    yield distribution_of_residuals(comparison.fit)
    rows, used = DrawnRows(comparison.fit), set[str]()
    for covariate in comparison.covariates:
        name = "by_" + (re.sub(r"[^A-Za-z0-9_-]+", "_", covariate.name)[:60] or "column")
        while name.casefold() in used:
            name += "_"
        used.add(name.casefold())
        yield _against(rows, comparison.sensitivities, covariate, name)


# against a covariate -----------------------------------------------------------------------------------------------


def _against(rows: DrawnRows, sample: Sensitivities, covariate: Driver, name: str) -> go.Figure:
    panels = components_of(rows)
    cells = [*(rows.base.residuals[sample.rows] * rows.factors).T]
    pose = np.unique(sample.observations.pose, return_inverse=True)[1]
    if covariate.number is not None and (reading := reading_of(rows, covariate.number)):
        panels.append(reading[0])
        cells.append(_reading(rows, sample, covariate.number))
    groups = bool(covariate.categories) or covariate.kind == "approach" or covariate.levels <= 2
    band = "Means with two standard errors" if groups else "The band has two standard errors"
    figure = residuals_over(
        rows,
        rows.driver(covariate.name),
        panels,
        remarks=[f"Measured minus predicted. {band}, by pose."],
        called=name,
    )
    for number, (y, panel) in enumerate(zip(cells, panels, strict=True)):
        if groups:
            _means(figure, number, pose, covariate, y, panel.unit)
        else:
            _curve(figure, number, pose, covariate, y)
    return figure


def _reading(rows: DrawnRows, sample: Sensitivities, joint: int) -> Array:
    """Return the error of a joint's reading that would explain each residual best, in the unit shown."""
    motion = motion_with_reading(sample.fit, sample.observations, joint, weighted=True)
    error = error_of_reading(motion, sample.residual)
    return error / ARCSEC if rows.base.machine.joints[joint].revolute else error * rows.shown.factor


def _fitted(columns: Array, y: Array, pose: Index, at: Array) -> tuple[Array, Array]:
    """Return a regression at rows `at` of columns, and its standard errors; poses are independent, rows are not."""
    known = np.isfinite(y)
    columns, y, pose = columns[known], y[known], pose[known]
    inverse = np.linalg.pinv(columns, rcond=1e-8)
    left = y - columns @ (inverse @ y)
    scores = np.zeros((int(pose.max(initial=0)) + 1, len(inverse)))
    np.add.at(scores, pose, (inverse * left).T)
    return at @ (inverse @ y), np.sqrt(np.sum((scores @ at.T) ** 2, axis=0))


def _curve(figure: go.Figure, number: int, pose: Index, covariate: Driver, y: Array) -> None:
    x = covariate.values
    grid = np.linspace(x.min(), x.max(), 201)
    columns = [np.column_stack([np.ones(len(v)), covariate.curve(v)]) for v in (x, grid)]
    if columns[0].shape[1] + 2 > len(np.unique(pose)):
        return
    line, error = _fitted(columns[0], y, pose, columns[1])
    add_trace(
        figure, number, "two standard errors", "band", mode="none", fill="toself",
        fillcolor="rgba(140,149,159,0.35)", x=np.concatenate([grid, grid[::-1]]),
        y=np.concatenate([line + 2 * error, (line - 2 * error)[::-1]]),
    )  # fmt: skip
    add_trace(figure, number, "smooth curve", "curve", x=grid, y=line, mode="lines", line=MEAN)


def _means(figure: go.Figure, number: int, pose: Index, covariate: Driver, y: Array, unit: str) -> None:
    ones = np.ones((len(y), 1))
    codes = np.unique(covariate.values)[:MOST_RUNS]
    means_of = []
    for code in codes:
        inside = np.flatnonzero((covariate.values == code) & np.isfinite(y))
        if len(inside):
            mean, error = _fitted(ones[inside], y[inside], pose[inside], ones[:1])
            means_of.append((code, float(mean[0]), 2 * float(error[0])))
    at, means, errors = np.array(means_of).T
    beside = 0.3 if covariate.categories or covariate.kind == "approach" else 0.0
    add_trace(
        figure, number, "mean", x=at + beside, y=means, error_y={"array": errors, "color": INK, "thickness": 1.5},
        mode="markers", marker={"symbol": "square", "size": 8, "color": INK},
        hovertemplate=f"mean %{{y:.4g}} {label(unit)}<extra></extra>",
    )  # fmt: skip


# in order -----------------------------------------------------------------------------------


def residuals_in_order(comparison: Comparison) -> go.Figure:
    """Return the residuals in the order of measurement, with their mean, outliers, and the runs."""
    rows = DrawnRows(comparison.fit)
    return residuals_over(rows, rows.driver("order"), components_of(rows), called="order")
