"""How a parameter differs between the machines of a fleet, and by night."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from rodgen.calibration.fleet.summary import parameter_cells
from rodgen.data.units import readable
from rodgen.output.figures.style import (
    BLUE,
    GREY,
    ORANGE,
    PURPLE,
    SOFT,
    Panel,
    add_trace,
    column,
    describe,
    label,
)

if TYPE_CHECKING:
    from rodgen.calibration.fleet.changes import Change, Changes
    from rodgen.calibration.fleet.fleet import FleetParameter


ROW, LEAST, MOST = 9, 160, 420
"""Height of a machine in pixels, and of the panel at least and at most."""
WITH_BARS = 150
"""Machines up to which each has a bar for its uncertainty."""


def fleet_parameter(parameter: FleetParameter) -> go.Figure:
    """Return a parameter of all machines that have it, the least first: alone, and given the others.

    Parameters
    ----------
    parameter : rodgen.calibration.fleet.fleet.FleetParameter
    """
    p, n = parameter.population, len(parameter.machines)
    order = np.argsort(parameter.values)
    factor, unit = readable(parameter.unit, float(np.abs(parameter.values).max()))
    names = [parameter.machines[i] for i in order]
    name = f"{parameter.key}{'' if unit == '1' else f' [{unit}]'}"
    figure = column([Panel("", int(np.clip(ROW * n, LEAST, MOST)), name)])
    y = np.arange(n)
    mean, spread = p.mean * factor, p.spread * factor
    if spread:
        figure.add_vrect(
            mean - spread, mean + spread, fillcolor=GREY, opacity=0.2, line_width=0, layer="below"
        )
        square = {"symbol": "square", "size": 12, "color": GREY, "opacity": 0.35}
        add_trace(figure, 0, "spread between machines", x=[None], y=[None], mode="markers", marker=square)
    add_trace(
        figure,
        0,
        "mean",
        x=[mean, mean],
        y=[-1, n],
        mode="lines",
        line={"color": SOFT, "width": 1.3, "dash": "dash"},
    )
    hover = "%{text}<br>%{x:.4g}"
    for words, values, symbol, colour, some in (
        ("one machine alone", parameter.values, "circle-open", ORANGE, ~p.odd),
        ("given the others", p.shrunk, "circle", BLUE, ~p.odd),
        ("odd", parameter.values, "x", PURPLE, p.odd),
    ):
        drawn = np.flatnonzero(some[order])
        if not len(drawn):
            continue
        chosen = order[drawn]
        bars: dict[str, Any] = {}
        if words != "given the others" and n <= WITH_BARS:
            bars = {
                "error_x": {
                    "array": parameter.std[chosen] * factor,
                    "width": 0,
                    "thickness": 1,
                    "color": colour,
                }
            }
        add_trace(
            figure, 0, words, x=values[chosen] * factor, y=y[drawn], mode="markers",
            marker={"symbol": symbol, "size": 6, "color": colour},
            text=[label(names[i]) for i in drawn],
            hovertemplate=f"{hover} {unit}, {words}<extra></extra>", **bars,
        )  # fmt: skip
    figure.update_yaxes(visible=False, range=[-1, n])
    mean_text, spread_text, alone = parameter_cells(parameter)
    note = f"{n} machines: mean {mean_text}, spread {spread_text}; one machine alone is known to {alone}."
    title = f"{parameter.effect}: {parameter.key.rpartition('.')[2]}" if parameter.effect else parameter.key
    return describe(figure, f"fleet_{parameter.key}", title, note=note)


def fleet_nights(changes: Changes, change: Change) -> go.Figure:
    """Return a parameter of a machine by night, with its trend or change.

    Parameters
    ----------
    changes : rodgen.calibration.fleet.changes.Changes
    change : rodgen.calibration.fleet.changes.Change
        One of those found.
    """
    points = [*changes.series(change.machine, change.key)]
    dates = [date for date, _, _ in points]
    values, std = (np.array([point[i] for point in points]) for i in (1, 2))
    factor, unit = readable(change.unit, float(np.abs(values).max()))
    name = f"{change.key}{'' if unit == '1' else f' [{unit}]'}"
    figure = column([Panel(name, 180, "night")], legend=False)
    figure.update_xaxes(type="date")
    add_trace(
        figure, 0, name, x=dates, y=values * factor, mode="markers",
        marker={"symbol": "circle", "size": 7, "color": BLUE},
        error_y={"array": std * factor, "width": 0, "thickness": 1, "color": BLUE},
        hovertemplate=f"%{{x}}<br>%{{y:.4g}} {unit}<extra></extra>",
    )  # fmt: skip
    if change.what == "change":
        figure.add_vline(change.since, line={"color": ORANGE, "width": 1.3, "dash": "dash"})
    return describe(
        figure, f"nights_{change.machine}_{change.key}", f"{change.machine}: {change.key}", note="An alarm."
    )
