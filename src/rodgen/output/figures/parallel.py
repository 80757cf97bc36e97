"""Maps of parallel machines: the uncertainty of a Tricept's tool, and the attitudes of a 3-SPS-S."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from rodgen.array_types import Array
from rodgen.kinematics.three_sps_s import OrientationStatus, Workspace
from rodgen.output.figures.style import (
    GREY,
    INK,
    LINE,
    SOFT,
    Panel,
    axes,
    column,
    describe,
    equal_axes,
    label,
    panel_title,
    ring,
)
from rodgen.output.numbers import minus

if TYPE_CHECKING:
    from rodgen.kinematics.tricept import UncertaintyMap

QUANTITIES = ("u(Qx)", "u(Qy)", "u(Qz)", "largest semi-axis")
WIDTH = 900
NARROWEST = 700
"""Maps in columns scroll on a page that is narrower."""
PANELS = 6
SIDE = 161
"""Points along each side of a map of attitudes."""
JOINED = "#3182bd"
COLOURS = {
    OrientationStatus.ALLOWED: "#9ecae1",
    OrientationStatus.TOO_SHORT: "#d9d9d9",
    OrientationStatus.TOO_LONG: "#bdbdbd",
    OrientationStatus.NEAR_SINGULAR: "#d62728",
    OrientationStatus.OTHER_SIDE: "#fdd0a2",
    OrientationStatus.NOT_NORMAL: "#9ecae1",
    OrientationStatus.INVALID: "#ffffff",
}


def uncertainty_map(found: UncertaintyMap, unit: str = "mm") -> go.Figure:
    """Return u(Qx), u(Qy), u(Qz) and the largest semi-axis over a slice of a Tricept's workspace, with contours.

    Parameters
    ----------
    found : rodgen.tricept.UncertaintyMap
    unit : str, optional
        The unit of length.
    """
    factor, small = (1000.0, "µm") if unit == "mm" else (1.0, unit)
    layers = [*np.moveaxis(found.u, -1, 0), found.largest]
    shape = np.ptp(found.up) / (np.ptp(found.across) or 1.0)
    figure = _grid(
        [f"{title} [{label(small)}]" for title in QUANTITIES],
        [f"Q{found.names[0]} [{label(unit)}]", f"Q{found.names[1]} [{label(unit)}]"],
        columns=2,
        height=int(np.clip(300 * shape, 100, 400)),
        bars=True,
    )
    for number, values in enumerate(layers):
        _shade(figure, number, found.across, found.up, factor * values, small)
        equal_axes(figure, number)
    return describe(
        figure,
        "uncertainty_map",
        f"Standard uncertainty of the tool where Q{found.names[2]} = {found.value:g} {unit}",
        width=NARROWEST,
    )


def orientation_workspace(found: Workspace) -> go.Figure:
    """Return maps of the attitudes that a 3-SPS-S machine can take up, one for each of up to six torsions.

    The tilt is the distance from the middle, the azimuth the direction; the black line is the singularity.

    Parameters
    ----------
    found : rodgen.three_sps_s.Workspace
    """
    count = min(PANELS, len(found.torsion))
    # middles of equal parts, so that a torsion and its opposite are both there
    chosen = ((np.arange(count) + 0.5) * len(found.torsion) / count).astype(int)
    columns = min(3, count)
    titles = [minus(f"torsion {np.degrees(found.torsion[n]):.0f}°") for n in chosen]
    figure = _grid(
        titles, ["", ""], columns=columns, height=(WIDTH - 60) // 3 if count > 1 else 480, bars=False
    )
    at = np.linspace(-180, 180, SIDE)
    radius, angle = np.hypot(*np.meshgrid(at, at)), np.arctan2(*np.meshgrid(at, at)[::-1])
    tilt = np.clip((radius / 180 * len(found.tilt)).astype(int), 0, len(found.tilt) - 1)
    start = found.azimuth[0] - np.pi / len(found.azimuth)
    azimuth = ((angle - start) % (2 * np.pi) / (2 * np.pi) * len(found.azimuth)).astype(int) % len(
        found.azimuth
    )
    last = len(COLOURS)
    steps = [colour for colour in (*COLOURS.values(), JOINED) for _ in range(2)]
    edges = np.repeat(np.arange(last + 2) / (last + 1), 2)[1:-1]
    scale = [[float(edge), colour] for edge, colour in zip(edges, steps, strict=True)]
    for number, n in enumerate(chosen):
        codes = np.where(found.joined[n], last, found.status[n])[azimuth, tilt].astype(float)
        codes[radius > 180] = np.nan
        determinant = np.where(
            radius > 180, np.nan, _interpolated(found.determinant[n], angle - start, radius)
        )
        figure.add_trace(
            go.Heatmap(
                x=at, y=at, z=codes, zmin=-0.5, zmax=last + 0.5, colorscale=scale, showscale=False, hoverinfo="skip",
                **axes(number),
            )
        )  # fmt: skip
        figure.add_trace(
            go.Contour(
                x=at, y=at, z=determinant, contours={"start": 0, "end": 0, "size": 1, "coloring": "none"},
                line={"color": INK, "width": 1.4, "smoothing": 1}, showscale=False, showlegend=False, hoverinfo="skip",
                **axes(number),
            )
        )  # fmt: skip
        for around in (45.0, 90.0, 135.0, 180.0):
            line, words = ring(around, f"{around:.0f}°", 0.0 if around == 180 else 46.0, at=67.5)
            figure.add_trace(go.Scatter(**{**line, "line": {"color": GREY, "width": 0.7}}, **axes(number)))
            if around < 180:
                words["font"]["color"] = INK
                figure.add_annotation(**words, xref=axes(number)["xaxis"], yref=axes(number)["yaxis"])
        equal_axes(figure, number)
    limits: dict[str, Any] = {"range": [-186, 186], "visible": False}
    figure.update_xaxes(**limits)
    figure.update_yaxes(**limits)
    present = set(np.unique(found.status).tolist())
    names = [("allowed, joined to the best", JOINED)]
    names += [
        (code.name.lower().replace("_", " "), colour) for code, colour in COLOURS.items() if code in present
    ]
    for name, colour in names:
        mark = {"symbol": "square", "size": 12, "color": colour, "line": {"width": 0.5, "color": GREY}}
        figure.add_trace(go.Scatter(x=[None], y=[None], mode="markers", marker=mark, name=name))
    figure.update_layout(showlegend=True)
    return describe(
        figure,
        "orientation_workspace",
        "Attitudes of a 3-SPS-S machine",
        note="The tilt is the distance from the middle, the azimuth the direction. Black: the singularity.",
        width=NARROWEST if columns > 1 else 0,
    )


def _interpolated(cells: Array, azimuth: Array, tilt: Array) -> Array:
    """Return values between the middles of cells, at azimuths from the first edge [rad] and tilts [deg]."""
    a = (azimuth % (2 * np.pi)) / (2 * np.pi) * cells.shape[0] - 0.5
    t = np.clip(tilt / 180 * cells.shape[1] - 0.5, 0, cells.shape[1] - 1 - 1e-9)
    i, j = np.floor(a).astype(int), t.astype(int)
    p, q = a - i, t - j
    i, further = i % cells.shape[0], (i + 1) % cells.shape[0]
    near, far = ((1 - p) * cells[i, k] + p * cells[further, k] for k in (j, j + 1))
    return np.asarray((1 - q) * near + q * far)


def _grid(titles: Sequence[str], names: Sequence[str], *, columns: int, height: int, bars: bool) -> go.Figure:
    """Return an empty figure with panels in columns, the first row on top, with room for colour bars."""
    rows = -(-len(titles) // columns)
    below = 50 if names[0] else 8
    figure = column([Panel("", rows * height + (rows - 1) * (below + 30))], legend=not bars, width=WIDTH)
    inner = rows * height + (rows - 1) * (below + 30)
    bar = 0.075 if bars else 0.0
    gap = 0.075 if names[0] else 0.02
    wide = (1 - gap * (columns - 1)) / columns - bar
    for i, title in enumerate(titles):
        row, at = divmod(i, columns)
        left, top = at * (wide + bar + gap), inner - row * (height + below + 30)
        x, y = axes(i).values()
        figure.update_layout(
            {
                f"xaxis{i + 1}": {"anchor": y, "domain": [left, left + wide], "title": {"text": names[0]}},
                f"yaxis{i + 1}": {
                    "anchor": x,
                    "domain": [(top - height) / inner, top / inner],
                    "title": {"text": names[1] if at == 0 else ""},
                },
            }
        )
        figure.add_annotation(panel_title(i, title))
    figure.update_xaxes(showticklabels=True, ticks="outside")
    figure.update_layout(
        margin_t=figure.layout.margin.t + 24,
        margin_b=below,
        margin_r=40 if bars else 12,
        meta={"heights": None},
    )
    figure.update_layout(height=inner + figure.layout.margin.t + below)
    return figure


def _shade(figure: go.Figure, number: int, x: Array, y: Array, values: Array, unit: str) -> None:
    known = values[np.isfinite(values)]
    panel, sides = figure.layout[f"xaxis{number + 1}"].domain, figure.layout[f"yaxis{number + 1}"].domain
    figure.update_layout(plot_bgcolor=LINE)
    figure.update_xaxes(showgrid=False)
    figure.update_yaxes(showgrid=False)
    if not known.size:
        return
    low, high = float(known.min()), float(known.max())
    bar = {
        "x": panel[1] + 0.01,
        "xanchor": "left",
        "y": (sides[0] + sides[1]) / 2,
        "len": sides[1] - sides[0],
        "thickness": 12,
        "outlinewidth": 0,
        "tickfont": {"size": 11, "color": SOFT},
        "nticks": 6,
    }
    keys = {"x": x, "y": y, "z": values, "colorscale": "Cividis", "zmin": low, "zmax": high, "colorbar": bar}
    hover = f"%{{x:.4g}}, %{{y:.4g}}: %{{z:.4g}} {label(unit)}<extra></extra>"
    if high - low > 1e-9 * max(abs(high), abs(low)):
        lines = {"coloring": "heatmap", "showlabels": True, "labelfont": {"size": 10, "color": "white"}}
        figure.add_trace(
            go.Contour(
                **keys, contours=lines, ncontours=9, line={"color": "white", "width": 0.7}, hovertemplate=hover,
                **axes(number),
            )
        )  # fmt: skip
    else:
        figure.add_trace(go.Heatmap(**keys, hovertemplate=hover, **axes(number)))
