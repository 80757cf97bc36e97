"""Figures as the page shows them: without title and legend, which the page writes itself, in its colours and width."""

from __future__ import annotations

import html
import json
from itertools import count
from typing import TYPE_CHECKING, Any

import plotly.io as pio

from rodgen.output.figures.style import DARK, LEGEND

if TYPE_CHECKING:
    import plotly.graph_objects as go

__all__ = ["CONFIG", "drawn"]

CONFIG = {
    "displayModeBar": False,
    "responsive": True,
    "doubleClick": "reset+autosize",
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
_DRAWINGS = count()


def drawn(
    figure: go.Figure,
    *,
    dark: bool,
    width: int,
    drag: str | bool,
    revision: str = "",
    on_canvas: bool = False,
) -> tuple[str, str, dict[str, Any]]:
    """Return title, note and legend of a figure as HTML; what it shows, in words; and its content for Plotly.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
        Of `rodgen.output.figures`.
    dark : bool
        Whether the page is.
    width : int
        Of its place, in pixels.
    drag : str or bool
        What dragging over it does: ``"select"``, ``"zoom"``, or nothing.
    revision : str, optional
        While it stays the same a user's zoom stays, too.
    on_canvas : bool, optional
        Whether marks are drawn on a canvas, which takes a third of the time of as many elements of SVG.
    """
    text = pio.to_json(figure, engine="json")
    if dark:
        for light, its in DARK.items():
            text = text.replace(light, its)
    content = json.loads(text)
    layout, meta = content["layout"], figure.layout.meta
    lower = meta["block"] + (LEGEND if figure.layout.showlegend is not False else 0)
    for trace in content["data"] if on_canvas else ():
        if trace["type"] == "scatter" and trace.get("mode") == "markers":
            trace["type"] = "scattergl"
    layout["height"] -= lower
    layout.setdefault("margin", {})["t"] = max(layout.get("margin", {}).get("t", lower) - lower, 8)
    for key in ("title", "width", "legend", "template.layout.legend"):
        layout.pop(key, None)
    _shrink(layout, meta, width)
    layout |= {"showlegend": False, "autosize": True, "uirevision": revision or "zoom"}
    layout |= {"paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)"}
    layout["selectionrevision"] = next(_DRAWINGS)  # what was dragged over is marked by the figure itself
    if "scene" not in layout:
        layout["dragmode"] = drag
    legend = "".join(_legend(content["data"]))
    about = f"<h2>{html.escape(meta['title'])}</h2><div class=soft>{html.escape(meta['note'])}</div>"
    content = {"data": content["data"], "layout": layout, "config": CONFIG}
    return f"{about}<div class=legend>{legend}</div>", meta["alt"], content


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


def _legend(traces: list[dict[str, Any]]) -> dict[str, None]:
    """Return the sign and the name of each kind of trace, as HTML."""
    entries: dict[str, None] = {}
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
        style, name = f' style="color:{colour}"' * isinstance(colour, str), html.unescape(trace["name"])
        entries[f"<span><span aria-hidden=true{style}>{sign}</span> {html.escape(name)}</span>"] = None
    return entries
