"""The picture of how the time and the memory of diagnoses grow."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from rodgen.errors import InputFileError, joined
from rodgen.output.figures.files import save_figure
from rodgen.output.figures.style import BLUE, GREY, ORANGE

NAME = "diagnosis_growth.png"
PANELS = (("all", "processor [s]", BLUE, "circle"), ("memory", "memory [MiB]", ORANGE, "square"))
"""Of each column, from above: what is drawn, its title, colour and mark."""
DECADES = {"dtick": 1, "exponentformat": "power"}


def alt_text(growth: dict[str, Any]) -> str:
    """Return what the picture shows, for those who do not see it."""
    over = joined([f"{of} ({items[0][of]:,} to {items[-1][of]:,})" for of, items in growth.items()])
    return f"Processor time and memory of a diagnosis, plotted over {over}"


def draw(growth: dict[str, Any], folder: Path) -> None:
    """Draw the picture into a folder; without Chrome or Chromium, say so and keep the picture that is there."""
    try:
        save_figure(figure(growth), folder / NAME)
    except InputFileError as error:
        print(f"The picture is not drawn again. {error}")


def figure(growth: dict[str, Any]) -> go.Figure:
    """Return a figure with a column for each of what grows; axes are logarithmic where rows grow."""
    found = make_subplots(
        len(PANELS), len(growth), shared_xaxes=True, horizontal_spacing=0.07, vertical_spacing=0.06
    )
    for column, (of, items) in enumerate(growth.items(), 1):
        x = [item[of] for item in items]
        for row, (key, title, colour, symbol) in enumerate(PANELS, 1):
            y, at = [item[key] for item in items], {"row": row, "col": column}
            mark = {"symbol": symbol, "color": colour, "size": 7}
            found.add_trace(go.Scatter(x=x, y=y, mode="lines+markers", marker=mark, showlegend=False), **at)
            if of == "rows":
                found.update_xaxes(type="log", **DECADES, **at)
                decades = [math.floor(math.log10(min(y))), math.ceil(math.log10(max(y)))]
                found.update_yaxes(type="log", range=decades, **DECADES, **at)
            else:
                found.update_xaxes(tickvals=x, **at)
                found.update_yaxes(rangemode="tozero", **at)
            if column == 1:
                found.update_yaxes(title=title, **at)
        found.update_xaxes(title=of, row=len(PANELS), col=column)
        if of == "rows":
            seconds = [items[-1]["all"] * rows / x[-1] for rows in x]
            line = {"color": GREY, "dash": "dot"}
            found.add_trace(
                go.Scatter(x=x, y=seconds, mode="lines", line=line, name="proportional"), 1, column
            )
    legend = {"x": 0, "y": 1}
    margin = {"l": 60, "r": 12, "t": 12, "b": 60}
    return found.update_layout(
        template="plotly_white", width=1000, height=440, margin=margin, legend=legend, showlegend=True
    )
