"""Residuals where they were measured: arrows in projections of the workspace, or on the sky."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from rodgen.array_types import Array, Index
from rodgen.machines.drivers import horizontal
from rodgen.output.figures.drawn_rows import DrawnRows, PlannedRows, planned_rows
from rodgen.output.figures.style import (
    BLUE,
    INK,
    LINE,
    ORANGE,
    SELECTED,
    SOFT,
    Panel,
    add_arrows,
    add_trace,
    column,
    describe,
    evenly,
    from_zenith,
    label,
    ring,
)

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit
    from rodgen.calibration.plan import Plan
    from rodgen.machines.observations import Observations

FLAT, TALL = 0.5, 1.1
"""Least and largest height of a map, as a share of its width."""
WIDTH = 660
"""Of a map, in pixels, from which its height follows."""
HEAD = 0.012
"""Length of the head of an arrow, as a part of the width of a map."""
ARROW = 0.08
"""Length of the arrow of a residual of one rms, as a share of the map's width."""
SKY_ARROW = 8.0
"""The same on a sky, in degrees."""
FLAT_SPACE = 0.02
"""A third dimension below this share of the largest is not drawn for distances."""
COLOURS = {"before": ORANGE, "after": BLUE, "residual": BLUE}
LONGEST_KEY = 0.3
"""Length of the arrow that is the key, as a share of the map's width."""
MOST_ARROWS = 300
OUTSIDE = 101.0
"""Where azimuths are written, in degrees from the zenith."""
SKY_NOTE = (
    "The zenith is in the middle, circles are of equal altitude; azimuth is 0° towards {} and 90° towards {}."
)


def residual_map(
    fit: Fit,
    *,
    before: Fit | None = None,
    exaggeration: float = 0.0,
    selected: Collection[int] = (),
    planned: Plan | None = None,
    most: int = MOST_ARROWS,
) -> go.Figure | None:
    """Return the residuals where they were measured: as arrows over the workspace or on the sky, of distances as signs.

    None where only angles or attitudes are read.

    The ``customdata`` of every arrow's foot is the number of its row, from 0.

    Parameters
    ----------
    fit : Fit
    before : Fit, optional
        Another model of the same observations, whose residuals are drawn, too.
    exaggeration : float, optional
        How many times as long as residuals their arrows are, which the note says; left out: so that they can be seen.
    selected : collection of int, optional
        Rows that are marked.
    planned : Plan, optional
        Whose readings are marked where the model puts them.
    most : int, optional
        Arrows; of more rows some are drawn, and the note says so.
    """
    rows = DrawnRows(before or fit, None if before is None else fit, kept=selected)
    ahead = planned_rows(fit, planned)
    return map_of(rows, exaggeration=exaggeration, selected=selected, planned=ahead, most=most)


def map_of(
    rows: DrawnRows,
    remark: str = "Measured minus predicted.",
    *,
    exaggeration: float = 0.0,
    selected: Collection[int] = (),
    planned: PlannedRows | None = None,
    most: int = MOST_ARROWS,
) -> go.Figure | None:
    """Return the figure of `residual_map` of rows, with a sentence that its note begins with."""
    sky = rows.base.machine.measurand.is_direction
    if not sky and not rows.base.machine.measurand.moving:
        return None
    known = ~rows.bad if sky else ~rows.bad & np.isfinite(rows.places).all(axis=1)
    chosen = np.isin(rows.chosen, np.asarray([*selected], np.intp))
    some = np.union1d(evenly(np.flatnonzero(known), most), np.flatnonzero(known & chosen))
    marks = Marks(rows.tips_with_residuals(some), rows.chosen[some], chosen[some])
    residuals_of = [rows.residuals(fit)[some] for _, fit in rows.sides]
    names = [name for name, _ in rows.sides]
    if sky:
        pairs = list(zip(names, residuals_of, strict=True))
        figure, times = _on_the_sky(rows, rows.o.take(some), pairs, marks, exaggeration, planned)
        name, title, note = "residuals_on_the_sky", "Residuals on the sky", [_sky_note(rows)]
    else:
        pairs = [(name, in_machine_axes(rows.base, r)) for name, r in zip(names, residuals_of, strict=True)]
        figure, times = _in_space(rows, rows.places[some], pairs, marks, exaggeration, planned)
        name, title, note = "residuals_in_space", "Residuals over the workspace", ["In machine axes."]
    if not times:
        note.append("The area of a mark follows the size of the residual.")
    else:
        note.append(f"Arrows are {times:,.6g} times as long as the residuals.")
    if len(some) < rows.total - int(rows.outlier.sum()):
        note.append(f"{len(some)} of {rows.total} rows are drawn.")
    elif rows.outlier.any():
        note.append("Outliers are left out.")
    figure.update_layout(meta={**figure.layout.meta, "exaggeration": times})
    return describe(figure, name, title, note=" ".join([remark, *note]))


@dataclass(frozen=True)
class Marks:
    """What belongs to the rows of a map."""

    hover: Sequence[str]
    row: Index
    """Their numbers, (n,)."""
    chosen: NDArray[np.bool_]
    """Which are selected, (n,)."""


def in_machine_axes(fit: Fit, residuals: Array) -> Array:
    """Return residuals of points, also of poses, (n, 3), in machine axes; those of distances, (n, 1), as they are."""
    residuals = residuals[:, :3]
    if residuals.shape[1] == 3 and fit.machine.measured.frame == "free":
        return np.asarray(residuals @ fit.solution.frame.rotation)
    return residuals


def up_of(fit: Fit) -> Array:
    """Return the unit vector against gravity in the frame of the readings."""
    up = -np.asarray(fit.machine.gravity)
    return np.asarray(fit.solution.frame.rotation @ up if fit.machine.measured.frame == "free" else up)


def _in_space(
    rows: DrawnRows,
    places: Array,
    residuals: Sequence[tuple[str, Array]],
    marks: Marks,
    exaggeration: float,
    planned: PlannedRows | None,
) -> tuple[go.Figure, float]:
    """Return maps of residuals over the workspace in two projections, and by how much arrows are too long.

    Residuals of points are arrows, (n, 3) in machine axes; those of distances, (n, 1), are triangles, upwards where
    more was measured. The first of them gives the scale.
    """
    points = residuals[0][1].shape[1] == 3
    length_unit, unit = rows.base.machine.length_unit, rows.shown.unit
    spread = np.ptp(places, axis=0) if len(places) else np.ones(3)
    order = np.argsort(-spread, kind="stable")
    first = sorted(int(k) for k in order[:2])
    planes = [(first[0], first[1])]
    if spread[order[2]] > FLAT_SPACE * spread[order[0]] or points:
        planes.append((first[0], int(order[2])))
    size = _rms(residuals[0][1])
    seen = places if planned is None else np.concatenate([places, planned.places])
    frames = [_frame(seen[:, a], seen[:, b]) for a, b in planes]
    wide = [xlim[1] - xlim[0] for xlim, _ in frames]
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
    # one scale for all projections, in units of length for one unit of residuals
    times = exaggeration or round_size(ARROW * wide[0] / size * rows.shown.factor)[1]
    scale = times / rows.shown.factor
    for number, ((a, b), (xlim, ylim)) in enumerate(zip(planes, frames, strict=True)):
        at = places[:, [a, b]]
        for name, r in residuals:
            if points:
                tip, head = at + scale * r[:, [a, b]], HEAD * (xlim[1] - xlim[0])
                add_arrows(figure, number, at, tip, name, COLOURS[name], marks.hover, marks.row, head=head)
            else:
                _signs(figure, number, at, r[:, 0], size, name, marks)
        _selected(figure, number, at, marks)
        if planned is not None:
            planned.mark(figure, number, planned.places[:, a], planned.places[:, b])
        figure.update_layout(
            {
                f"xaxis{number + 1}": {"range": list(xlim)},
                f"yaxis{number + 1}": {"range": list(ylim)},
            }
        )
    if points:
        _key(figure, scale / wide[0], size, unit)
    return figure, times if points else 0.0


def _rms(residuals: Array) -> float:
    """Return the root mean square of the lengths of residuals, (n, m); 1 where there are none."""
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1)))) or 1.0 if len(residuals) else 1.0


def _selected(figure: go.Figure, number: int, at: Array, marks: Marks) -> None:
    some = np.flatnonzero(marks.chosen)
    if len(some):
        add_trace(
            figure, number, "selected", x=at[some, 0], y=at[some, 1], mode="markers", marker=SELECTED,
            customdata=marks.row[some],
        )  # fmt: skip


def _key(figure: go.Figure, scale: float, size: float, unit: str) -> None:
    """Add an arrow of known length above the first map, at the right.

    Its length is a round number near `size`, no longer than a third of the map; `scale` is the share of the width that
    one unit has.
    """
    text, length = round_size(min(size, LONGEST_KEY / scale))
    share, text = scale * length, f"{text} {unit}"
    figure.add_annotation(
        x=1 - share - 0.01, y=1, xref="x domain", yref="y domain", xanchor="right", yanchor="bottom", yshift=4,
        text=label(text), showarrow=False, font={"size": 12, "color": SOFT},
    )  # fmt: skip
    figure.add_annotation(
        x=1, y=1, ax=1 - share, ay=1, xref="x domain", yref="y domain", axref="x domain", ayref="y domain", yshift=13,
        showarrow=True, arrowhead=2, arrowsize=1, arrowwidth=1.4, arrowcolor=INK, text="",
    )  # fmt: skip


def _signs(figure: go.Figure, number: int, at: Array, r: Array, size: float, name: str, marks: Marks) -> None:
    for sign, symbol, words in ((1, "triangle-up", "longer"), (-1, "triangle-down-open", "shorter")):
        some = np.flatnonzero(r * sign > 0)
        title = f"{words} than predicted" if name == "residual" else f"{name}: {words} than predicted"
        areas = 9 * np.sqrt(np.clip(np.abs(r[some]) / size, 0.1, 4.0))
        add_trace(
            figure, number, title, f"{name} {words}", x=at[some, 0], y=at[some, 1], mode="markers",
            marker={"symbol": symbol, "color": COLOURS[name], "size": areas}, customdata=marks.row[some],
            hovertext=[marks.hover[int(i)] for i in some], hoverinfo="text",
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


def round_size(size: float) -> tuple[str, float]:
    """Return a round number near a size, as text, too."""
    power = 10.0 ** math.floor(math.log10(size))
    value = min((1.0, 2.0, 5.0, 10.0), key=lambda v: abs(math.log(v * power / size))) * power
    return f"{value:.6g}", value


def _on_the_sky(
    rows: DrawnRows,
    readings: Observations,
    residuals: Sequence[tuple[str, Array]],
    marks: Marks,
    exaggeration: float,
    planned: PlannedRows | None,
) -> tuple[go.Figure, float]:
    """Return residuals of directions as arrows on the sky, and by how much they are too long.

    The zenith is in the middle, the horizon outside, azimuth 0 above and 90 degrees at the right, as on a map. The
    first of the residuals, (n, 2), gives the scale.
    """
    directions, basis, up = readings.reading, readings.basis, up_of(rows.base)
    x, y = horizontal(up)
    size = _rms(residuals[0][1])
    times = exaggeration or round_size(SKY_ARROW / size * 3600)[1]
    scale = times / 3600  # degrees for an arcsec
    start = from_zenith(directions, x, y, up)
    far = max(116.0, 1.08 * float(np.max(np.abs(start), initial=0.0)))
    figure = column([Panel(" ", 520, " ", equal=True)])
    for radius in (30.0, 60.0, 90.0):
        line, words = ring(radius, f"alt {90 - radius:.0f}°", 0.2 * far)
        figure.add_trace(go.Scatter(**line))
        figure.add_annotation(**words)
    for azimuth in range(0, 360, 45):
        to = _on_a_map(90.0, azimuth)
        figure.add_shape(
            type="line", x0=0, y0=0, x1=to[0], y1=to[1], line={"color": LINE, "width": 1}, layer="below"
        )
        if azimuth % 90 == 0:
            at = _on_a_map(OUTSIDE, azimuth)
            figure.add_annotation(
                x=at[0], y=at[1], text=f"az {azimuth}°", showarrow=False, font={"size": 12, "color": SOFT}
            )
    for name, r in residuals:
        move = (r[:, :1] * basis[0] + r[:, 1:] * basis[1]) * np.radians(scale)
        tip = from_zenith(directions + move, x, y, up)
        add_arrows(figure, 0, start, tip, name, COLOURS[name], marks.hover, marks.row, head=2 * HEAD * far)
    _selected(figure, 0, start, marks)
    if planned is not None:
        turned = rows.base.machine.measured.frame == "free"  # what is read is in axes of its own
        ahead = planned.places @ rows.base.solution.frame.rotation.T if turned else planned.places
        planned.mark(figure, 0, *from_zenith(ahead, x, y, up).T)
    figure.update_xaxes(range=[-far, far], visible=False)
    figure.update_yaxes(range=[-far, far], visible=False)
    _key(figure, scale / (2 * far), size, rows.shown.unit)
    figure.update_layout(margin={"l": 12, "r": 12, "b": 8})
    figure.update_layout(height=figure.layout.height - 42)
    return figure, times


def _on_a_map(zenith_angle: float, azimuth: float) -> tuple[float, float]:
    angle = math.radians(azimuth)
    return zenith_angle * math.sin(angle), zenith_angle * math.cos(angle)


def _sky_note(rows: DrawnRows) -> str:
    """Return what to know of a sky; azimuth counts as in formulas."""
    up = -np.asarray(rows.base.machine.gravity)
    east, north = horizontal(up)
    return SKY_NOTE.format(_axis_name(north), _axis_name(east))


def _axis_name(vector: Array) -> str:
    """Return the name of the machine axis that a level direction is along, or whose horizontal part is."""
    k = int(np.argmax(np.abs(vector)))
    name = ("−" if vector[k] < 0 else "") + "xyz"[k]
    return name if abs(vector[k]) > 1 - 1e-9 else f"the horizontal part of {name}"
