"""Residuals where they were measured: arrows in projections of the workspace, or on the sky."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from rodgen.output.figures.style import (
    BLUE,
    INK,
    LINE,
    ORANGE,
    SOFT,
    Array,
    Panel,
    add_arrows,
    add_trace,
    column,
    from_zenith,
    horizontal,
    label,
    ring,
)

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel
    from rodgen.data.observations import Observations

__all__ = [
    "SKY_NOTE",
    "in_machine_axes",
    "residuals_in_space",
    "residuals_on_the_sky",
    "space_note",
    "up_of",
]

FLAT, TALL = 0.5, 1.1
"""Least and largest height of a map, as a share of its width."""
WIDTH = 660
"""Of a map, in pixels, from which its height follows."""
ARROW = 0.08
"""Length of the arrow of a residual of one rms, as a share of the map's width."""
SKY_ARROW = 8.0
"""The same on a sky, in degrees."""
FLAT_SPACE = 0.02
"""A third dimension below this share of the largest is not drawn for distances."""
COLOURS = {"before": ORANGE, "after": BLUE, "residual": BLUE}
SKY_NOTE = "The zenith is in the middle, circles are of equal altitude."


def space_note(residuals: Array) -> str:
    """Return what to know of a map of residuals (n, 3) or (n, 1) over the workspace."""
    area = "" if residuals.shape[1] == 3 else " The area of a mark follows the size of the residual."
    return f"In machine axes.{area}"


def in_machine_axes(fit: FittedModel, residuals: Array) -> Array:
    """Return residuals of points (n, 3) in machine axes; those of distances (n, 1) as they are."""
    if residuals.shape[1] == 3 and fit.machine.measured.frame == "free":
        return np.asarray(residuals @ fit.solution.frame.rotation)
    return residuals


def up_of(fit: FittedModel) -> Array:
    """Return the unit vector against gravity in the frame of the readings."""
    up = -np.asarray(fit.machine.gravity)
    return np.asarray(fit.solution.frame.rotation @ up if fit.machine.measured.frame == "free" else up)


def residuals_in_space(
    places: Array,
    residuals: Sequence[tuple[str, Array]],
    length_unit: str,
    unit: str,
    hover: Sequence[str] = (),
) -> go.Figure:
    """Return maps of residuals over the workspace in two projections.

    Residuals of points are arrows; those of distances are triangles, upwards where more was measured.

    Parameters
    ----------
    places : ndarray, shape (n, 3)
        Where they were measured, in machine axes.
    residuals : sequence of (str, ndarray)
        Named ``"residual"``, or ``"before"`` and ``"after"``; each (n, 3), in machine axes, or (n, 1). The first one
        gives the scale.
    length_unit, unit : str
        Of places and residuals.
    hover : sequence of str, optional
        Hover text of each place.
    """
    points = residuals[0][1].shape[1] == 3
    spread = np.ptp(places, axis=0) if len(places) else np.ones(3)
    order = np.argsort(-spread, kind="stable")
    first = sorted(int(k) for k in order[:2])
    planes = [(first[0], first[1])]
    if spread[order[2]] > FLAT_SPACE * spread[order[0]] or points:
        planes.append((first[0], int(order[2])))
    rms = float(np.sqrt(np.mean(np.sum(residuals[0][1] ** 2, axis=1)))) if len(places) else 1.0
    size = rms or 1.0
    frames = [_frame(places[:, a], places[:, b]) for a, b in planes]
    panels = [
        Panel(
            f"{'xyz'[b]} [{label(length_unit)}]",
            int(WIDTH * (ylim[1] - ylim[0]) / (xlim[1] - xlim[0])),
            f"{'xyz'[a]} [{label(length_unit)}]",
            equal=True,
        )
        for (a, b), (xlim, ylim) in zip(planes, frames, strict=True)
    ]
    figure = column(panels)
    for number, ((a, b), (xlim, ylim)) in enumerate(zip(planes, frames, strict=True)):
        scale = ARROW * (xlim[1] - xlim[0]) / size
        for name, r in residuals:
            if points:
                start = places[:, [a, b]]
                tip = start + scale * r[:, [a, b]]
                add_arrows(figure, number, start, tip, name, COLOURS[name], hover, legend=number == 0)
            else:
                _signs(figure, number, places[:, [a, b]], r[:, 0], size, name, hover)
        figure.update_layout(
            {
                f"xaxis{number + 1}": {"range": list(xlim)},
                f"yaxis{number + 1}": {"range": list(ylim)},
            }
        )
    if points:
        key, length = _round_size(size)
        _key(figure, ARROW * length / size, f"{key} {unit}")
    return figure


def _key(figure: go.Figure, share: float, text: str) -> None:
    """Add an arrow of known length, as a share of the width, above the first map, at the right."""
    figure.add_annotation(
        x=1 - share - 0.01, y=1, xref="x domain", yref="y domain", xanchor="right", yanchor="bottom", yshift=4,
        text=label(text), showarrow=False, font={"size": 12, "color": SOFT},
    )  # fmt: skip
    figure.add_annotation(
        x=1, y=1, ax=1 - share, ay=1, xref="x domain", yref="y domain", axref="x domain", ayref="y domain", yshift=13,
        showarrow=True, arrowhead=2, arrowsize=1, arrowwidth=1.4, arrowcolor=INK, text="",
    )  # fmt: skip


def _signs(
    figure: go.Figure, number: int, at: Array, r: Array, size: float, name: str, hover: Sequence[str]
) -> None:
    for sign, symbol, words in ((1, "triangle-up", "longer"), (-1, "triangle-down-open", "shorter")):
        some = np.flatnonzero(r * sign > 0)
        title = f"{words} than predicted" if name == "residual" else f"{name}: {words} than predicted"
        areas = 9 * np.sqrt(np.clip(np.abs(r[some]) / size, 0.1, 4.0))
        said = {"hovertext": [hover[int(i)] for i in some], "hoverinfo": "text"} if len(hover) else {}
        add_trace(
            figure, number, title, f"{name} {words}", x=at[some, 0], y=at[some, 1], mode="markers",
            marker={"symbol": symbol, "color": COLOURS[name], "size": areas}, **said,
        )  # fmt: skip


def _frame(x: Array, y: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return limits of a map, with room around, neither too flat nor too tall."""
    (x0, x1), (y0, y1) = ((float(v.min()), float(v.max())) if len(v) else (0.0, 1.0) for v in (x, y))
    wide, high = x1 - x0, y1 - y0
    room = 0.13 * (max(wide, high) or 1.0)
    wide, high = wide + 2 * room, high + 2 * room
    if high < FLAT * wide:
        high = FLAT * wide
    if high > TALL * wide:
        wide = high / TALL
    mx, my = (x0 + x1) / 2, (y0 + y1) / 2
    return (mx - wide / 2, mx + wide / 2), (my - high / 2, my + high / 2)


def _round_size(size: float) -> tuple[str, float]:
    """Return a round number near a size, as text, too."""
    power = 10.0 ** math.floor(math.log10(size))
    value = min((1.0, 2.0, 5.0, 10.0), key=lambda v: abs(math.log(v * power / size))) * power
    return f"{value:.6g}", value


def residuals_on_the_sky(
    fit: FittedModel,
    readings: Observations,
    residuals: Sequence[tuple[str, Array]],
    unit: str,
    hover: Sequence[str] = (),
) -> go.Figure:
    """Return residuals of directions as arrows on the sky: the zenith in the middle, the horizon outside.

    Parameters
    ----------
    fit : FittedModel
        Whose machine and frame say where the zenith is.
    readings : Observations
        n measured directions.
    residuals : sequence of (str, ndarray)
        Named ``"residual"``, or ``"before"`` and ``"after"``; each (n, 2). The first one gives the scale.
    unit : str
    hover : sequence of str, optional
        Hover text of each direction.
    """
    directions, basis, up = readings.reading, readings.basis, up_of(fit)
    x, y = horizontal(up)
    size = float(np.sqrt(np.mean(residuals[0][1] ** 2)) * math.sqrt(2)) or 1.0
    start = from_zenith(directions, x, y, up)
    far = max(104.0, 1.08 * float(np.max(np.abs(start), initial=0.0)))
    figure = column([Panel(" ", 520, " ", equal=True)])
    for radius in (30.0, 60.0, 90.0):
        line, words = ring(radius, f"{90 - radius:.0f}°", 0.11 * far)
        figure.add_trace(go.Scatter(**line))
        figure.add_annotation(**words)
    for c, s, name in ((1, 0, "x"), (0, 1, "y"), (-1, 0, "−x"), (0, -1, "−y")):
        figure.add_shape(
            type="line", x0=0, y0=0, x1=90 * c, y1=90 * s, line={"color": LINE, "width": 1}, layer="below"
        )
        figure.add_annotation(
            x=97 * c, y=97 * s, text=name, showarrow=False, font={"size": 12, "color": SOFT}
        )
    for name, r in residuals:
        move = (r[:, :1] * basis[0] + r[:, 1:] * basis[1]) * (np.radians(SKY_ARROW) / size)
        tip = from_zenith(directions + move, x, y, up)
        add_arrows(figure, 0, start, tip, name, COLOURS[name], hover)
    key, length = _round_size(size)
    figure.update_xaxes(range=[-far, far], visible=False)
    figure.update_yaxes(range=[-far, far], visible=False)
    _key(figure, length / size * SKY_ARROW / (2 * far), f"{key} {unit}")
    figure.update_layout(margin={"l": 12, "r": 12, "b": 8})
    figure.update_layout(height=figure.layout.height - 42)
    return figure
