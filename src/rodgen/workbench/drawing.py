"""Figures as the page shows them: without title and legend, which the page writes itself, in its colours and width."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.io as pio

from rodgen.output.figures.style import DARK, LEGEND, ORANGE

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from numpy.typing import NDArray

__all__ = ["CONFIG", "Drawn", "drawn", "overlay"]

CONFIG = {
    "displaylogo": False,
    "responsive": True,
    "doubleClick": "reset+autosize",
    "modeBarButtonsToRemove": ["toImage", "autoScale2d"],
}
NATURAL = 660
"""Width, in pixels, at which a figure is as high as it says."""
SIGNS = {
    "circle": "●",
    "square": "■",
    "diamond": "◆",
    "x": "✕",
    "triangle-up": "▲",
    "arrow": "→",
    "star": "★",
}
EXPLAINED = "would explain"
_DRAWINGS = count()


@dataclass(frozen=True)
class Drawn:
    """A figure of the page.

    Attributes
    ----------
    title, note, alt : str
    legend : tuple of (str, str, str)
        Sign, colour and name.
    content : dict
        For Plotly: data, layout, config.
    """

    title: str
    note: str
    alt: str
    legend: tuple[tuple[str, str, str], ...]
    content: dict[str, Any]


def drawn(figure: go.Figure, *, dark: bool, width: int, revision: str = "") -> Drawn:
    """Return a figure for a page.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
        Of `rodgen.output.figures`.
    dark : bool
        Whether the page is.
    width : int
        Of its place, in pixels.
    revision : str, optional
        While it stays the same a user's zoom stays, too.
    """
    text = pio.to_json(figure, engine="json")
    if dark:
        for light, its in DARK.items():
            text = text.replace(light, its)
    content = json.loads(text)
    layout, meta = content["layout"], figure.layout.meta
    lower = meta["block"] + (LEGEND if figure.layout.showlegend is not False else 0)
    layout["height"] -= lower
    layout.setdefault("margin", {})["t"] = max(layout.get("margin", {}).get("t", lower) - lower, 8)
    for key in ("title", "width", "legend", "template.layout.legend"):
        layout.pop(key, None)
    _shrink(layout, meta, width)
    layout |= {"showlegend": False, "autosize": True, "uirevision": revision or "zoom"}
    layout["selectionrevision"] = next(_DRAWINGS)  # what was dragged over is marked by the figure itself
    if "scene" not in layout:
        layout["dragmode"] = "select"
    return Drawn(
        meta["title"],
        meta["note"],
        meta["alt"],
        tuple(_legend(content["data"])),
        {"data": content["data"], "layout": layout, "config": CONFIG},
    )


def _shrink(layout: dict[str, Any], meta: dict[str, Any], width: int) -> None:
    """Make panels whose units are as long both ways as low as they become narrow."""
    if "scene" in layout:
        _stand_back(layout, width)
        return
    heights, margin = meta.get("heights"), layout["margin"]
    share = min(1.0, (width - margin.get("l", 0) - margin.get("r", 0)) / NATURAL)
    if not heights or share == 1 or not any(meta["equal"]):
        return
    lower = [
        round(high * share) if equal else high for high, equal in zip(heights, meta["equal"], strict=True)
    ]
    inner = sum(lower) + sum(meta["gaps"])
    top = inner
    for i, (high, gap) in enumerate(zip(lower, meta["gaps"], strict=True)):
        layout[f"yaxis{i + 1 if i else ''}"]["domain"] = [(top - high) / inner, top / inner]
        top -= high + gap
    layout["height"] = margin["t"] + margin.get("b", 0) + inner


def _stand_back(layout: dict[str, Any], width: int) -> None:
    """Look at a space from so far that it is seen as a whole in a narrow place, too."""
    layout["margin"] |= {"l": 0, "r": 0, "b": 0}
    share = min(width / layout["height"], 1.0)
    if share < 1:
        layout["height"] = round(layout["height"] * (1 + share) / 2)
        eye = layout["scene"]["camera"]["eye"]
        layout["scene"]["camera"]["eye"] = {k: x / share**0.65 for k, x in eye.items()}


def _legend(traces: list[dict[str, Any]]) -> dict[tuple[str, str, str], None]:
    found: dict[tuple[str, str, str], None] = {}
    for trace in traces:
        if trace.get("showlegend") is False or not trace.get("name"):
            continue
        marker, line = trace.get("marker", {}), trace.get("line", {})
        if "markers" in trace.get("mode", "") or trace.get("type") == "bar":
            symbol, colour = str(marker.get("symbol", "circle")), marker.get("color")
            sign = SIGNS.get(symbol.removesuffix("-open"), "◆")
            sign = {"●": "○", "■": "□", "◆": "◇", "▲": "△"}.get(sign, sign) if "open" in symbol else sign
        else:
            sign, colour = "▬" if trace.get("fill") else "─", line.get("color") or trace.get("fillcolor")
        found[sign, colour if isinstance(colour, str) else "", trace["name"]] = None
    return found


def overlay(
    content: dict[str, Any], explained: NDArray[np.float64], rows: NDArray[np.int_]
) -> list[dict[str, Any]]:
    """Return traces of what an effect would explain, over the marks of the residuals in a figure.

    Parameters
    ----------
    content : dict
        Of a `Drawn`, with a panel for each component; marks have the number of their row as ``customdata``.
    explained : ndarray, shape (rows, m)
        In the unit of the figure.
    rows : ndarray of int
        Numbers of the rows.
    """
    place = {int(row): k for k, row in enumerate(rows)}
    found: dict[str, dict[str, Any]] = {}
    for trace in content["data"]:
        axis = trace.get("yaxis", "y")
        panel = int(axis[1:] or 1) - 1
        known = [(x, place[int(row)]) for x, row in _marks(trace) if int(row) in place]
        if not known or panel >= explained.shape[1] or trace.get("name") == EXPLAINED:
            continue
        one = found.setdefault(
            axis,
            {
                "type": "scatter",
                "mode": "markers",
                "name": EXPLAINED,
                "hoverinfo": "skip",
                "showlegend": False,
                "marker": {"symbol": "line-ew-open", "size": 9, "color": ORANGE, "line": {"width": 2}},
                "x": [],
                "y": [],
                "xaxis": trace.get("xaxis", "x"),
                "yaxis": axis,
            },
        )
        one["x"] += [x for x, _ in known]
        one["y"] += [float(explained[k, panel]) for _, k in known]
    return list(found.values())


def _marks(trace: dict[str, Any]) -> list[tuple[float, int]]:
    rows, x = trace.get("customdata"), trace.get("x")
    return list(zip(_numbers(x), _numbers(rows), strict=False)) if rows is not None and x is not None else []


def _numbers(values: Any) -> list[Any]:
    """Return an array of a figure, which Plotly may have packed."""
    if not isinstance(values, dict):
        return list(values)
    return list(np.frombuffer(base64.b64decode(values["bdata"]), np.dtype(values["dtype"])).tolist())
