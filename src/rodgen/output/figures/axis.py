"""A fitted axis: its pairs or poses seen along it and from the side, and the residuals of every row."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from rodgen.array_types import Array, Index
from rodgen.errors import counted
from rodgen.output.figures.style import (
    BLUE,
    GREY,
    INK,
    LINE,
    ORANGE,
    PURPLE,
    SOFT,
    Panel,
    add_trace,
    axes,
    column,
    describe,
    evenly,
    label,
    mark_size,
)
from rodgen.output.numbers import minus

if TYPE_CHECKING:
    from rodgen.data.tables import Pairs, Poses
    from rodgen.kinematics.axis_fit import AxisFit

MOST_ARCS, MOST_RESIDUALS = 200, 5000
"""More arcs than this are a grey disc, more residuals a grey band."""


def axis_fit(fit: AxisFit, pairs: Pairs | Poses) -> go.Figure:
    """Return the pairs or poses of a fit along the axis and from the side, and their residuals in three directions.

    Open circles are points before the rotation, or the first pose, filled ones after it, crosses outliers.

    Parameters
    ----------
    fit : rodgen.AxisFit
    pairs : rodgen.data.tables.Pairs or rodgen.data.tables.Poses
        What was fitted.
    """
    points = (
        (np.broadcast_to(pairs.position[0], pairs.position.shape), pairs.position)
        if hasattr(pairs, "position")
        else (pairs.rho, pairs.rho_prime)
    )
    u, v, names = _view(fit.axis)
    before, after = (np.stack([(x - fit.point) @ w for w in (u, v, fit.axis)]) for x in points)
    unit = label(pairs.unit)
    figure = column(
        [
            Panel(
                f"Seen along the axis: {names[1]} [{unit}]",
                430,
                f"across the axis, {names[0]} [{unit}]",
                equal=True,
            ),
            Panel(f"From the side: distance from the axis [{unit}]", 150, f"along the axis [{unit}]"),
            Panel(f"Residuals [{unit}]", 190, f"{pairs.counted} of the file"),
        ]
    )
    chosen = evenly(fit.pairs, MOST_ARCS)
    chosen = np.union1d(chosen, np.flatnonzero(fit.outliers)[:MOST_ARCS])
    _along(figure, pairs, fit, before, after, chosen)
    _side(figure, pairs, before, after, chosen)
    _residuals(figure, pairs, fit, after, u, v, unit)
    e = minus(", ".join(f"{c:.6f}" for c in fit.axis))
    spread = fit.axis_uncertainty[0]
    known = f"± {spread * 1e6:.3g} µrad" if math.isfinite(spread) else "uncertainty unknown"
    bad = int(fit.outliers.sum())
    outliers = f", {counted(bad, 'outlier')}" if bad else ""
    rows = "poses" if hasattr(pairs, "position") else "pairs"
    parts_drawn = (
        ""
        if len(chosen) == fit.pairs
        else f" {len(chosen)} of {fit.pairs} {rows} are drawn in the two views."
    )
    return describe(
        figure,
        "axis_fit",
        f"Axis ({e}) {known}",
        note=f"{fit.pairs} {rows}, residuals rms {fit.rms:.3g} {pairs.unit}{outliers}.{parts_drawn}",
    )


def _view(axis: Array) -> tuple[Array, Array, tuple[str, str]]:
    """Choose the two directions of the view along the axis: as near to machine axes as it allows."""
    main = int(np.argmax(np.abs(axis)))
    right = (main + 1) % 3 if axis[main] > 0 else (main + 2) % 3
    u = np.eye(3)[right] - axis * axis[right]
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    up = int(np.argmax(np.abs(v)))
    about = "about " if abs(axis[main]) < 1 - 1e-4 else ""
    first, second = (about + ("" if w[i] > 0 else "−") + "xyz"[i] for w, i in ((u, right), (v, up)))
    return u, v, (first, second)


_BEFORE = {"symbol": "circle-open", "size": 8, "color": BLUE, "line": {"width": 1.4}}
_AFTER = {"symbol": "circle", "size": 6, "color": ORANGE, "line": {"width": 0.5, "color": INK}}
_OUTLIER = {"symbol": "x", "size": 9, "color": PURPLE, "line": {"width": 0.5, "color": INK}}


def _along(
    figure: go.Figure, pairs: Pairs | Poses, fit: AxisFit, before: Array, after: Array, chosen: Index
) -> None:
    # The path of a point: its circle about the fitted axis, from where it was, by the angle that was given or fitted.
    turn = np.remainder(fit.turns[chosen] + np.pi, 2 * np.pi) - np.pi
    start = np.arctan2(before[1, chosen], before[0, chosen])
    radius = np.hypot(before[0, chosen], before[1, chosen])
    steps = start[:, None] + turn[:, None] * np.append(np.linspace(0, 1, 49), np.nan)
    figure.add_trace(
        go.Scatter(
            x=(radius[:, None] * np.cos(steps)).ravel(), y=(radius[:, None] * np.sin(steps)).ravel(),
            mode="lines", line={"color": GREY, "width": 0.7}, opacity=0.6, hoverinfo="skip", showlegend=False,
            **axes(0),
        )
    )  # fmt: skip
    _both(figure, pairs, 0, before[:2], after[:2], chosen)
    bad = chosen[fit.outliers[chosen]]
    if bad.size:
        add_trace(
            figure, 0, "outlier", "bad", x=after[0, bad], y=after[1, bad], mode="markers", marker=_OUTLIER,
            text=_names(pairs, bad), hovertemplate="%{text}, outlier",
        )  # fmt: skip
    figure.add_trace(
        go.Scatter(
            x=[0], y=[0], mode="markers", name="axis, towards you", hoverinfo="skip",
            marker={"symbol": "circle-open-dot", "size": 13, "color": INK, "line": {"width": 1.5}}, **axes(0),
        )
    )  # fmt: skip


def _names(pairs: Pairs | Poses, chosen: Index) -> list[str]:
    return [f"{pairs.counted} {number}" for number in pairs.numbers[chosen]]


def _both(
    figure: go.Figure, pairs: Pairs | Poses, number: int, before: Array, after: Array, chosen: Index
) -> None:
    """Add the points (2, n) before and after the rotation."""
    text = _names(pairs, chosen)
    for name, points, mark in (("before", before, _BEFORE), ("after", after, _AFTER)):
        add_trace(
            figure, number, name, x=points[0, chosen], y=points[1, chosen], mode="markers", marker=mark, text=text,
            hovertemplate="%{text}<br>%{x:.6g}, %{y:.6g}",
        )  # fmt: skip


def _side(figure: go.Figure, pairs: Pairs | Poses, before: Array, after: Array, chosen: Index) -> None:
    start, end = (np.stack([points[2], np.hypot(points[0], points[1])]) for points in (before, after))
    _both(figure, pairs, 1, start, end, chosen)
    figure.update_layout(
        yaxis2={"rangemode": "tozero", "zeroline": True, "zerolinecolor": INK, "zerolinewidth": 1.5}
    )


def _residuals(
    figure: go.Figure, pairs: Pairs | Poses, fit: AxisFit, after: Array, u: Array, v: Array, unit: str
) -> None:
    chosen = np.union1d(evenly(fit.pairs, MOST_RESIDUALS), np.flatnonzero(fit.outliers)[:MOST_RESIDUALS])
    radius = np.hypot(after[0], after[1])[chosen]
    cos, sin = (
        np.divide(after[i, chosen], radius, out=np.zeros(len(chosen)), where=radius > 0) for i in (0, 1)
    )
    across, up, along = (fit.residuals[chosen] @ w for w in (u, v, fit.axis))
    parts = {
        "along the axis": (along, "square", GREY),
        "away from the axis": (cos * across + sin * up, "circle", BLUE),
        "around the axis": (cos * up - sin * across, "triangle-up", ORANGE),
    }
    good = ~fit.outliers[chosen]
    noise = fit.sigma if hasattr(pairs, "position") else math.sqrt(2) * fit.sigma
    if math.isfinite(noise) and noise > 0:
        figure.add_shape(
            type="rect", x0=0, x1=1, xref="x3 domain", y0=-2 * noise, y1=2 * noise, yref="y3", layer="below",
            line_width=0, fillcolor=LINE, opacity=0.6, name="±2 standard uncertainties", showlegend=True,
        )  # fmt: skip
    for name, (part, symbol, colour) in parts.items():
        figure.add_trace(
            go.Scatter(
                x=pairs.numbers[chosen[good]], y=part[good], mode="markers", name=name,
                marker={"symbol": symbol, "color": colour, "size": mark_size(len(chosen))},
                hovertemplate=f"{pairs.counted} %{{x}}: %{{y:.4g}} {unit}", **axes(2),
            )
        )  # fmt: skip
    # The panel is for the pairs that count; an outlier that is farther off stands at its edge.
    worst = float(np.abs([part[good] for part, _, _ in parts.values()]).max(initial=0)) or fit.rms or 1.0
    bad = chosen[~good]
    if bad.size:
        largest = np.stack([part[~good] for part, _, _ in parts.values()])
        value = np.take_along_axis(largest, np.abs(largest).argmax(axis=0)[None], axis=0)[0]
        add_trace(
            figure, 2, "outlier", "bad", x=pairs.numbers[bad], y=np.clip(value, -1.15 * worst, 1.15 * worst),
            mode="markers", marker=_OUTLIER, customdata=value,
            hovertemplate=f"{pairs.counted} %{{x}}, outlier: %{{customdata:.4g}} {unit}",
        )  # fmt: skip
    limit = 1.3 * max(worst, 2.2 * noise if noise > 0 else 0.0)
    figure.update_layout(
        xaxis3={"tickformat": "d"},
        yaxis3={"range": [-limit, limit], "zeroline": True, "zerolinecolor": SOFT},
    )
