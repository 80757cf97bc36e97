"""The residuals of a comparison: against each covariate, over the workspace, in order, and their distribution.

Large data are thinned, and the note of the figure says so.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from rodgen.calibration.reading_motion import error_of_reading
from rodgen.calibration.words import plain, three_digits
from rodgen.data.drivers import order_of_rows
from rodgen.data.units import ARCSEC
from rodgen.output.figures.maps import (
    SKY_NOTE,
    in_machine_axes,
    residuals_in_space,
    residuals_on_the_sky,
    space_note,
)
from rodgen.output.figures.style import (
    BLUE,
    GREY,
    INK,
    LINE,
    OUTLIER,
    Array,
    Index,
    Panel,
    add_trace,
    axes,
    column,
    describe,
    evenly,
    label,
    mark_size,
)

if TYPE_CHECKING:
    from rodgen.calibration.compare.comparison import Comparison
    from rodgen.data.drivers import Driver

__all__ = [
    "comparison",
    "distribution_of_residuals",
    "residuals_against",
    "residuals_in_order",
    "residuals_over_workspace",
]

MOST_DOTS, MOST_ARROWS, MOST_RUNS = 4000, 400, 20
PIECES = 40
"""Number of points of the line that follows the residuals in the order of measurement."""
PANEL = 150
"""Height, in pixels."""
MEAN = {"color": INK, "width": 1.6}
"""The line of a curve or a mean among dots."""


def comparison(comparison: Comparison) -> Iterator[go.Figure]:
    """Yield every figure of a comparison; the name of each is in its ``layout.meta``.

    Parameters
    ----------
    comparison : rodgen.calibration.compare.Comparison
    """
    yield residuals_in_order(comparison)
    yield residuals_over_workspace(comparison)
    yield distribution_of_residuals(comparison)
    used: set[str] = set()
    for covariate in comparison.covariates:
        name = "by_" + (re.sub(r"[^A-Za-z0-9_-]+", "_", covariate.name)[:60] or "column")
        while name.casefold() in used:
            name += "_"
        used.add(name.casefold())
        yield residuals_against(comparison, covariate, name)


def _thinned(drawn: int, count: int) -> str:
    return "" if drawn == count else f" {drawn} of {count} readings are drawn."


def _dots(
    figure: go.Figure, number: int, x: Any, y: Any, count: int, name: str = "reading", **given: Any
) -> None:
    mark = {"symbol": "circle-open", "color": BLUE, "size": mark_size(count), "line": {"width": 1}}
    add_trace(figure, number, name, x=x, y=y, mode="markers", marker=mark, **given)


# against a covariate -----------------------------------------------------------------------------------------------


def residuals_against(comparison: Comparison, covariate: Driver, name: str = "by_covariate") -> go.Figure:
    """Return the residuals against a covariate: dots and a smooth curve, or means where it has categories.

    Curve and means have bands of two standard errors, poses taken as independent.

    Parameters
    ----------
    comparison : rodgen.calibration.compare.Comparison
    covariate : rodgen.data.drivers.Driver
        One of ``comparison.covariates``.
    name : str, optional
        Of the figure's files.
    """
    sample = comparison.sample
    unit = label(comparison.unit)
    values = [
        (f"{c} [{unit}]", r, comparison.unit)
        for c, r in zip(comparison.components, sample.residual.T, strict=True)
    ]
    if covariate.number is not None:
        along, of = _reading(comparison, covariate.number)
        if np.isfinite(along).any():
            joint = label(plain(comparison.fit.machine.joints[covariate.number].name))
            values.append((f"reading of {joint} [{of}]", along, of))
    what = label(plain(covariate.label))
    figure = column(
        [Panel(title, PANEL, what if i + 1 == len(values) else "") for i, (title, _, _) in enumerate(values)]
    )
    x = covariate.values
    if covariate.turn is not None and np.ptp(x) > 1.01 * covariate.turn:
        x = x % covariate.turn
    chosen = evenly(len(x), MOST_DOTS)
    groups = bool(covariate.categories) or covariate.kind == "approach" or covariate.levels <= 2
    for number, (_, y, of) in enumerate(values):
        if groups:
            _groups(figure, number, sample.pose, covariate, y, of)
        else:
            hover = f"%{{x:.6g}}: %{{y:.4g}} {label(of)}"
            _dots(figure, number, x[chosen], y[chosen], len(chosen), hovertemplate=hover)
            _curve(figure, number, sample.pose, covariate, x, y)
        figure.update_layout({f"yaxis{number + 1}": {"zeroline": True}})
    if groups:
        _name_groups(figure, covariate, len(values))
    note = (
        "Means with two standard errors, by pose." if groups else "The band has two standard errors, by pose."
    )
    return describe(
        figure,
        name,
        f"Residuals against {plain(covariate.text)}",
        note=note + ("" if groups else _thinned(len(chosen), len(x))),
    )


def _reading(comparison: Comparison, joint: int) -> tuple[Array, str]:
    """Return the error of a joint's reading that would explain each residual best, and its unit."""
    sample = comparison.sample
    error = error_of_reading(sample.motions[:, :, joint], sample.y)
    if comparison.fit.machine.joints[joint].revolute:
        return error / ARCSEC, "arcsec"
    return error, comparison.fit.machine.length_unit


def _fitted(columns: Array, y: Array, pose: Index, at: Array) -> tuple[Array, Array]:
    """Return a regression at rows `at` of columns, and its standard errors; poses are independent, rows are not."""
    known = np.isfinite(y)
    columns, y, pose = columns[known], y[known], pose[known]
    inverse = np.linalg.pinv(columns, rcond=1e-8)
    left = y - columns @ (inverse @ y)
    scores = np.zeros((int(pose.max(initial=0)) + 1, len(inverse)))
    np.add.at(scores, pose, (inverse * left).T)
    return at @ (inverse @ y), np.sqrt(np.sum((scores @ at.T) ** 2, axis=0))


def _curve(figure: go.Figure, number: int, pose: Index, covariate: Driver, x: Array, y: Array) -> None:
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
    # The band of a curve at an end without poses would push everything else together.
    size = float(np.nanmax(np.abs(np.concatenate([y, line])))) * 1.08
    if size:
        figure.update_layout({f"yaxis{number + 1}": {"range": [-size, size]}})


def _groups(figure: go.Figure, number: int, pose: Index, covariate: Driver, y: Array, unit: str) -> None:
    shown = np.unique(covariate.values)[:MOST_RUNS]
    random = np.random.default_rng(0)
    xs, ys, means, errors, places = [], [], [], [], []
    for place, code in enumerate(shown):
        inside = np.flatnonzero((covariate.values == code) & np.isfinite(y))
        some = evenly(inside, MOST_DOTS // len(shown))
        xs.append(place + random.uniform(-0.15, 0.15, len(some)))
        ys.append(y[some])
        if not len(inside):
            continue
        ones = np.ones((len(inside), 1))
        mean, error = _fitted(ones, y[inside], pose[inside], ones[:1])
        places.append(place + 0.3)
        means.append(float(mean[0]))
        errors.append(2 * float(error[0]))
    hover = f"%{{y:.4g}} {label(unit)}"
    _dots(figure, number, np.concatenate(xs), np.concatenate(ys), len(y), hovertemplate=hover)
    add_trace(
        figure, number, "mean", x=places, y=means, error_y={"array": errors, "color": INK, "thickness": 1.5},
        mode="markers", marker={"symbol": "square", "size": 8, "color": INK}, hovertemplate=f"mean {hover}",
    )  # fmt: skip


def _name_groups(figure: go.Figure, covariate: Driver, panels: int) -> None:
    shown = np.unique(covariate.values)[:MOST_RUNS]
    names = [plain(covariate.categories[int(c)], 16) if covariate.categories else f"{c:+g}" for c in shown]
    figure.update_layout(
        {
            f"xaxis{number + 1}": {
                "tickvals": list(range(len(shown))),
                "ticktext": [label(name) for name in names],
                "range": [-0.5, len(shown) - 0.4],
            }
            for number in range(panels)
        }
    )


# over the workspace ------------------------------------------------------------------------------------------------


def residuals_over_workspace(comparison: Comparison) -> go.Figure:
    """Return the residuals where they were measured: over the workspace, or on the sky of a machine that points."""
    sample, fit = comparison.sample, comparison.fit
    chosen = evenly(len(sample.pose), MOST_ARROWS)
    residual = sample.residual[chosen]
    note = _thinned(len(chosen), len(sample.pose)).strip()
    if comparison.unit == "arcsec":
        readings = fit.observations.take(sample.first[chosen])
        drawn = residuals_on_the_sky(fit, readings, [("residual", residual)], comparison.unit)
        return describe(drawn, "workspace", "Residuals on the sky", note=f"{SKY_NOTE} {note}".strip())
    residual = in_machine_axes(fit, residual)
    drawn = residuals_in_space(
        sample.places[chosen], [("residual", residual)], fit.machine.length_unit, comparison.unit
    )
    note = f"{space_note(residual)} {note}".strip()
    return describe(drawn, "workspace", "Residuals over the workspace", note=note)


# in order, and as a distribution -----------------------------------------------------------------------------------


def residuals_in_order(comparison: Comparison) -> go.Figure:
    """Return the residuals in the order of measurement, with their mean, outliers, and the runs."""
    fit, o = comparison.fit, comparison.fit.observations
    names, unit = comparison.components, label(comparison.unit)
    order = order_of_rows(o)
    number = order.values
    figure = column([Panel(f"{c} [{unit}]", PANEL, order.label if c is names[-1] else "") for c in names])
    rows = np.flatnonzero(~fit.outliers)
    chosen = evenly(rows, MOST_DOTS)
    bad = np.flatnonzero(fit.outliers)[:MOST_DOTS]
    pieces = [part for part in np.array_split(rows, min(PIECES, max(len(rows) // 4, 1))) if len(part)]
    starts = np.flatnonzero(np.diff(o.run)) + 1
    for c in range(len(names)):
        r = fit.residuals[:, c]
        hover = f"{order.unit} %{{x:d}}: %{{y:.4g}} {unit}"
        _dots(figure, c, number[chosen], r[chosen], len(chosen), hovertemplate=hover)
        means = [r[part].mean() for part in pieces]
        add_trace(
            figure, c, "mean", x=[number[part].mean() for part in pieces], y=means, mode="lines", line=MEAN
        )
        limit = 1.15 * float(np.max(np.abs(r[rows]), initial=0.0)) or 1.0
        if len(bad):
            add_trace(
                figure, c, "outlier", x=number[bad], y=np.clip(r[bad], -limit, limit), customdata=r[bad],
                mode="markers", marker=OUTLIER,
                hovertemplate=f"{order.unit} %{{x:d}}, outlier: %{{customdata:.4g}} {unit}",
            )  # fmt: skip
        figure.update_layout({f"yaxis{c + 1}": {"range": [-1.1 * limit, 1.1 * limit], "zeroline": True}})
        if len(starts) < MOST_RUNS:
            for start in starts:
                figure.add_shape(
                    type="line", x0=number[start] - 0.5, x1=number[start] - 0.5, y0=0, y1=1,
                    line={"color": GREY, "width": 1, "dash": "dash"}, xref=axes(c)["xaxis"],
                    yref=f"{axes(c)['yaxis']} domain",
                )  # fmt: skip
    runs = ""
    if 0 < len(starts) < MOST_RUNS:
        listed = ", ".join(
            f"{plain(o.run_names[int(o.run[s])], 16)} from {o.data.place(s)}" for s in (0, *starts)
        )
        runs = f" Dashed lines separate the runs: {listed}."
    note = f"The line is the mean of neighbours.{runs}{_thinned(len(chosen), len(rows))}"
    return describe(figure, "order", "Residuals in the order of measurement", note=note)


def distribution_of_residuals(comparison: Comparison) -> go.Figure:
    """Return a histogram and a normal quantile plot of the residuals of each component, without outliers."""
    from rodgen.statistics.compiled_scipy import special

    fit, unit = comparison.fit, label(comparison.unit)
    panels = []
    for name in comparison.components:
        panels.append(Panel(f"share per {unit}", PANEL, f"{name} [{unit}]"))
        panels.append(Panel(f"{name} [{unit}]", PANEL, "normal quantile [standard deviations]"))
    figure = column(panels)
    for c in range(len(comparison.components)):
        r = np.sort(fit.residuals[~fit.outliers, c])
        sigma = float(np.std(r)) or 1.0
        share, edges = np.histogram(r, int(np.clip(np.sqrt(len(r)), 8, 60)), density=True)
        first, second = 2 * c, 2 * c + 1
        add_trace(
            figure, first, "residuals", kind=go.Bar, x=(edges[1:] + edges[:-1]) / 2, y=share, width=np.diff(edges),
            marker={"color": LINE, "line": {"color": BLUE, "width": 1}}, hovertemplate=f"%{{x:.4g}} {unit}",
        )  # fmt: skip
        x = np.linspace(-4 * sigma, 4 * sigma, 201) + r.mean()
        normal = np.exp(-0.5 * ((x - r.mean()) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
        line = {"color": INK, "width": 1.5}
        add_trace(figure, first, "normal distribution", "normal", x=x, y=normal, mode="lines", line=line)
        some = evenly(len(r), MOST_DOTS)
        quantile = special.ndtri((some + 0.5) / max(len(r), 1))
        _dots(figure, second, quantile, r[some], len(some), "residuals", hovertemplate=f"%{{y:.4g}} {unit}")
        ends = np.array([quantile[0], quantile[-1]]) if len(r) else np.zeros(2)
        y = r.mean() + sigma * ends
        add_trace(figure, second, "normal distribution", "normal", x=ends, y=y, mode="lines", line=line)
    figure.update_layout(bargap=0)
    return describe(
        figure,
        "distribution",
        "Distribution of the residuals",
        note=f"The line is the normal distribution; rms {three_digits(fit.rms)} {comparison.unit}.",
    )
