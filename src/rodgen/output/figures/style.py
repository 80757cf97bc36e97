"""Colours, marks and the arrangement of panels that all figures share.

Every distinction is made by shape as well as by colour, so that a figure survives a black-and-white printer and every
common colour vision. Panels stand below each other, so that a figure is as readable on a telephone as on a desk.
"""

from __future__ import annotations

import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import plotly.graph_objects as go
import plotly.io as pio

from rodgen.array_types import Array, Index

# After Okabe and Ito (2008): distinguishable with every common colour vision, and by lightness in grey; the orange is
# darker than theirs, so that it is legible as text.
BLUE, ORANGE, PURPLE = "#0072b2", "#c04d00", "#aa3377"
INK, SOFT, GREY, LINE, PAPER = "#1b1f24", "#57606a", "#8c959f", "#dfe3e8", "#ffffff"
DARK = {
    BLUE: "#6bb8f0",
    ORANGE: "#ff9d66",
    PURPLE: "#e7a3cb",
    INK: "#e8eaed",
    SOFT: "#a9b3bd",
    GREY: "#7d8690",
    LINE: "#2f363d",
    PAPER: "#14171a",
}
"""What each colour becomes on a dark page."""
FONT = 'system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif'

HEAD = 0.35
"""Half the width of the head of an arrow, for its length."""
OUTLIER = {"symbol": "x", "size": 8, "color": PURPLE}
"""The mark of an outlier."""

SELECTED = {"symbol": "circle-open", "size": 13, "color": PURPLE, "line": {"width": 2}}
"""The mark around what is selected."""

# Heights in pixels.
PANEL_TITLE, LEGEND, TITLE, NOTE_LINE = 26, 30, 40, 17
AXIS, GAP = 46, 10
"""Below a panel with numbers and a title of its x axis, and below one without."""
WRAP, WRAP_AXIS = 104, 44
"""Letters in a line of a note that is drawn into the figure, and of a title of an axis, which a telephone must hold."""


_AXIS = {
    "gridcolor": LINE,
    "linecolor": GREY,
    "tickcolor": GREY,
    "zerolinecolor": GREY,
    "zerolinewidth": 1,
    "showline": True,
    "zeroline": False,
    "automargin": True,
    "title": {"standoff": 8, "font": {"size": 13, "color": INK}},
    "tickfont": {"size": 12, "color": SOFT},
    "ticklabelposition": "outside",
    "exponentformat": "power",
    "minexponent": 4,
    "nticks": 7,
    "layer": "below traces",
}
_LAYOUT: dict[str, Any] = {
    "font": {"family": FONT, "size": 13, "color": INK},
    "paper_bgcolor": PAPER,
    "plot_bgcolor": PAPER,
    "xaxis": _AXIS,
    "yaxis": {**_AXIS, "nticks": 6},
    "hoverlabel": {"bgcolor": PAPER, "bordercolor": GREY, "font": {"size": 12, "color": INK}},
    "hovermode": "closest",
    "legend": {
        "orientation": "h",
        "yref": "container",
        "y": 1,
        "yanchor": "top",
        "x": 0,
        "xanchor": "left",
        "bgcolor": "rgba(0,0,0,0)",
        "font": {"size": 12},
        "itemsizing": "constant",
    },
    "colorscale": {"sequential": "Cividis"},
}
"""The template of every figure: what its layout does not say itself."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes in a column."""

    title: str
    """Above it, at the left: what its y axis shows, with the unit."""
    height: int
    """In pixels."""
    x: str = ""
    """What its x axis shows; empty where the next panel below says so for both."""
    equal: bool = False
    """Whether a unit is as long along both axes."""


def column(panels: Sequence[Panel], *, legend: bool = True, width: int = 760) -> go.Figure:
    """Return an empty figure with panels below each other.

    Panels without a title of their x axis share the x axis of the panel below them.

    Parameters
    ----------
    panels : sequence of Panel
    legend : bool, optional
        Whether room for a legend is left at the top.
    width : int, optional
        Of the figure as an image, in pixels; on a page it is as wide as its place.
    """
    titles = [textwrap.wrap(panel.x, WRAP_AXIS) for panel in panels]
    below = [AXIS + NOTE_LINE * (len(lines) - 1) if lines else GAP for lines in titles]
    gaps = [*(space + PANEL_TITLE for space in below[:-1]), 0]
    inner = sum(panel.height for panel in panels) + sum(gaps)
    above = (PANEL_TITLE if panels[0].title else 8) + (LEGEND if legend else 0)
    layout: dict[str, Any] = {
        "template": _template(pio.templates.default),
        "width": width,
        "height": inner + above + below[-1] + 4,
        "margin": {"l": 56, "r": 18, "t": above, "b": below[-1] + 4},
        "showlegend": legend,
        "annotations": [panel_title(i, panel.title) for i, panel in enumerate(panels) if panel.title],
        "meta": {
            "heights": [panel.height for panel in panels],
            "gaps": gaps,
            "equal": [panel.equal for panel in panels],
        },
    }
    top = inner
    for i, (panel, gap, lines) in enumerate(zip(panels, gaps, titles, strict=True)):
        x, y = axes(i).values()
        low = top - panel.height
        titled = next(k for k in range(i, len(panels)) if titles[k] or k + 1 == len(panels))
        across: dict[str, Any] = {
            "anchor": y,
            "title": {"text": "<br>".join(lines)},
            "showticklabels": titled == i,
            "ticks": "outside" if titled == i else "",
        }
        up: dict[str, Any] = {"anchor": x, "domain": [low / inner, top / inner]}
        if titled != i:
            across["matches"] = axes(titled)["xaxis"]
        if panel.equal:
            across["constrain"] = "domain"
            up |= {"scaleanchor": x, "scaleratio": 1, "constrain": "domain", "automargin": False}
        layout |= {f"xaxis{i + 1}": across, f"yaxis{i + 1}": up}
        top = low - gap
    return go.Figure(layout=layout)


@cache
def _template(default: str | None) -> go.layout.Template:
    """Return the template of every figure, on top of the default one: to merge them takes 60 ms."""
    return go.Figure(layout={"template": default}).update_layout(template={"layout": _LAYOUT}).layout.template


def axes(number: int) -> dict[str, str]:
    """Return what a trace in the panel of this number, from 0, is given."""
    return {"xaxis": f"x{number + 1}" if number else "x", "yaxis": f"y{number + 1}" if number else "y"}


def equal_axes(figure: go.Figure, number: int) -> None:
    """Make a unit as long along both axes of a panel."""
    figure.update_layout(
        {
            f"yaxis{number + 1}": {"scaleanchor": axes(number)["xaxis"], "constrain": "domain"},
            f"xaxis{number + 1}": {"constrain": "domain"},
        }
    )


def panel_title(number: int, text: str) -> dict[str, Any]:
    """Return the annotation that is the title of a panel, above it, at the left."""
    x, y = axes(number).values()
    return {
        "text": text, "x": 0, "y": 1, "xref": f"{x} domain", "yref": f"{y} domain", "xanchor": "left",
        "yanchor": "bottom", "yshift": 4, "showarrow": False, "font": {"size": 13, "color": INK},
    }  # fmt: skip


def add_trace(
    figure: go.Figure, number: int, name: str, group: str = "", kind: Any = go.Scatter, **given: Any
) -> None:
    """Add a trace to a panel; the first panel puts it into the legend, for all of its group.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
    number : int
        Of the panel, from 0.
    name : str
        In the legend.
    group : str, optional
        What the legend switches together; the name where it is left out.
    kind : class of a trace, optional
    given
        All else; without ``hovertemplate`` or ``hovertext`` nothing is said where the pointer is.
    """
    usual: dict[str, Any] = {"showlegend": number == 0}
    if not {"hovertemplate", "hovertext"} & given.keys():
        usual["hoverinfo"] = "skip"
    figure.add_trace(kind(name=name, legendgroup=group or name, **{**usual, **given}, **axes(number)))


def describe(
    figure: go.Figure, name: str, title: str, *, note: str = "", alt: str = "", width: int = 0
) -> go.Figure:
    """Give a figure its name, title and note.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
    name : str
        Of its files.
    title : str
    note : str, optional
        What to know when reading it.
    alt : str, optional
        What it shows, for those who do not see it; the title and the note where it is left out.
    width : int, optional
        Pixels below which a page does not make it narrower, but lets it scroll.

    Returns
    -------
    plotly.graph_objects.Figure
        The same figure, with name, title, note and alt in ``layout.meta``: a page writes them itself, and takes the
        block of pixels that they need away from the figure.
    """
    lines = textwrap.wrap(note, WRAP * (figure.layout.width or 760) // 760)
    block = TITLE + NOTE_LINE * len(lines)
    height = figure.layout.height + block
    figure.update_layout(
        height=height,
        margin_t=figure.layout.margin.t + block,
        legend_y=1 - block / height,
        title={
            "text": label(title),
            "x": 0,
            "xref": "container",
            "pad": {"l": 14, "t": 12},
            "y": 1,
            "yref": "container",
            "yanchor": "top",
            "font": {"size": 16, "color": INK},
            "subtitle": {"text": "<br>".join(map(label, lines)), "font": {"size": 12, "color": SOFT}},
        },
        meta={
            **figure.layout.meta,
            "name": name,
            "title": title,
            "note": note,
            "alt": alt or f"{title}. {note}".strip(),
            "width": width,
            "block": block,
        },
    )
    return figure


def label(text: str) -> str:
    """Return text that Plotly draws as it is: what it would read as a tag stays text."""
    return html.escape(text, quote=False)


def evenly(index: Index | int, most: int) -> Index:
    """Return at most `most` of some indices, evenly spread."""
    index = np.arange(index) if isinstance(index, int | np.integer) else index
    if len(index) <= most:
        return index
    return np.asarray(index[np.unique(np.linspace(0, len(index) - 1, most).astype(np.intp))])


def mark_size(count: int) -> float:
    """Return the diameter of a mark among `count` marks, in pixels."""
    return float(np.clip(70 / max(count, 1) ** 0.5, 3.0, 7.0))


def add_arrows(
    figure: go.Figure,
    number: int,
    start: Array,
    tip: Array,
    name: str,
    colour: str,
    hover: Sequence[str],
    row: Index,
    *,
    head: float,
) -> None:
    """Add arrows from `start` to `tip`, both (n, 2), with a dot at each start.

    All arrows are one line, heads and all: a browser draws that much faster than a mark for each.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
    number : int
        Of the panel, from 0.
    start, tip : ndarray, shape (n, 2)
    name, colour : str
        In the legend.
    hover : sequence of str
        Hover text of each arrow.
    row : ndarray of int, shape (n,)
        Their numbers, which a page finds as ``customdata``.
    head : float
        Length of a head in the unit of the axes; an arrow shorter than twice that has a smaller one.
    """
    along = tip - start
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along *= np.divide(np.minimum(head, length / 2), length, out=np.zeros_like(length), where=length > 0)
    across = along[:, ::-1] * [-HEAD, HEAD]
    base, end = tip - along, np.full_like(tip, np.nan)
    x, y = np.stack([start, tip, base + across, base - across, tip, end], axis=1).reshape(-1, 2).T
    add_trace(
        figure, number, name, x=x, y=y, mode="lines", line={"color": colour, "width": 1.3}, showlegend=False
    )
    add_trace(
        figure, number, name, x=start[:, 0], y=start[:, 1], mode="markers", marker={"color": colour, "size": 4},
        customdata=row, hovertext=hover, hoverinfo="text", showlegend=False,
    )  # fmt: skip
    if number == 0:
        mark = {"symbol": "arrow", "angle": 90, "size": 12, "color": colour}
        add_trace(figure, number, name, x=[None], y=[None], mode="markers", marker=mark)


# the sky -----------------------------------------------------------------------------------------------------------


def from_zenith(direction: Array, x: Array, y: Array, up: Array) -> Array:
    """Return directions as points, (n, 2): degrees from the zenith, at their azimuth."""
    level = np.column_stack([direction @ x, direction @ y])
    size = np.linalg.norm(level, axis=1, keepdims=True)
    angle = np.degrees(np.arctan2(size[:, 0], direction @ up))[:, None]
    return np.asarray(angle * np.divide(level, size, out=np.zeros_like(level), where=size > 0))


def ring(radius: float, text: str, gap: float, at: float = 45.0) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a circle as a line trace, open where its text stands, and the annotation.

    Parameters
    ----------
    radius : float
    text : str
    gap : float
        Length of the opening, in the unit of the axes.
    at : float, optional
        Where the text stands, in degrees.
    """
    half = np.degrees(min(gap / radius / 2, 1.5))
    angle = np.radians(np.linspace(at + half, at + 360 - half, 145))
    line = {
        "x": radius * np.cos(angle),
        "y": radius * np.sin(angle),
        "mode": "lines",
        "line": {"color": LINE, "width": 1},
        "hoverinfo": "skip",
        "showlegend": False,
    }
    words = {
        "x": radius * np.cos(np.radians(at)),
        "y": radius * np.sin(np.radians(at)),
        "text": text,
        "showarrow": False,
        "font": {"size": 11, "color": SOFT},
    }
    return line, words
