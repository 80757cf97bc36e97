"""Draw a chart with Matplotlib, as PNG: the same marks, lines and words as the page shows."""

from __future__ import annotations

import io
import textwrap
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.output.report.chart import Chart, Panel, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw", "png"]

# Those of the page; told apart with every common colour vision, and by shape without any.
_BEFORE, _AFTER, _INK, _SOFT, _MID = "#a83a00", "#005a9c", "#1b1f24", "#57606a", "#8c959f"
_DPI = 110
_COLOURS_KEPT = 48
_COLOURS = {"before": _BEFORE, "after": _AFTER, "there": _MID, "keyarrow": _INK, "outlier": _INK}
_MARKS: dict[str, dict[str, Any]] = {
    "before": {"marker": "o", "mfc": "none", "mec": _BEFORE, "mew": 0.9},
    "after": {"marker": "o", "mfc": _AFTER, "mec": "white", "mew": 0.3},
    "forward": {"marker": ">", "mfc": _BEFORE, "mec": _BEFORE},
    "backward": {"marker": "<", "mfc": "none", "mec": _BEFORE},
    "forward-after": {"marker": ">", "mfc": _AFTER, "mec": _AFTER},
    "backward-after": {"marker": "<", "mfc": "none", "mec": _AFTER},
    "up": {"marker": "^", "mfc": _BEFORE, "mec": _BEFORE},
    "down": {"marker": "v", "mfc": "none", "mec": _BEFORE},
    "up-after": {"marker": "^", "mfc": _AFTER, "mec": _AFTER},
    "down-after": {"marker": "v", "mfc": "none", "mec": _AFTER},
    "held": {"marker": "s", "mfc": "white", "mec": _BEFORE, "ms": 7},
    "test": {"marker": "D", "mfc": "white", "mec": _INK, "ms": 6},
    "fitted": {"marker": "o", "mfc": _AFTER, "mec": _AFTER, "ms": 7},
    "outlier": {"marker": "x", "mec": _INK, "mew": 1.4, "ms": 6},
    "there": {"marker": "o", "mfc": _MID, "mec": "none", "ms": 3.5},
    "planned": {"marker": "D", "mfc": "white", "mec": _AFTER, "mew": 1.6, "ms": 6},
}
_LINES: dict[str, dict[str, Any]] = {
    "path-fitted": {"color": _AFTER, "lw": 3.5, "solid_capstyle": "butt"},
    "grid": {"color": "0.87", "lw": 0.8},
    "noise": {"color": _SOFT, "ls": "--", "lw": 1.1},
    "limit": {"color": _INK, "ls": (0, (2, 2)), "lw": 1.1},
    "zero": {"color": _MID, "lw": 0.8},
}


def png(chart: Chart) -> bytes:
    """Return a chart as PNG; the same chart gives the same bytes."""
    import matplotlib as mpl

    out = io.BytesIO()
    # What a user's file says is drawn as it is, not as mathematics.
    settings: Any = {"text.parse_math": False, "text.usetex": False, "font.size": 9}
    with mpl.rc_context(settings), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        draw(chart).savefig(out, format="png", dpi=_DPI, metadata={"Software": None})
    return _palette(out)


def _palette(drawn: io.BytesIO) -> bytes:
    """Return a PNG with few colours, which is all that such a picture has: a third of the size."""
    from PIL import Image

    out = io.BytesIO()
    with Image.open(drawn) as image:
        image.convert("RGB").quantize(_COLOURS_KEPT, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return out.getvalue()


def draw(chart: Chart) -> Figure:
    """Return a chart as a Matplotlib figure."""
    from matplotlib.figure import Figure

    views = chart.views
    heights = [[_height(panel, len(view.panels)) for panel in view.panels] for view in views]
    high = max(sum(column) for column in heights)
    drawn = Figure(figsize=(5.4 * len(views) + 0.4, high + 1.3), layout="constrained")
    outer = drawn.subfigures(1, len(views), squeeze=False)[0]
    for part, view, column in zip(outer, views, heights, strict=True):
        if view.title:
            part.suptitle(view.title, fontsize=9, color=_SOFT)
        axes = part.subplots(len(view.panels), 1, squeeze=False, height_ratios=column)[:, 0]
        for i, (panel, at) in enumerate(zip(view.panels, axes, strict=True)):
            _draw_panel(panel, at, last=_ends(view, i))
    title = chart.title if not chart.note else f"{chart.title}\n" + textwrap.fill(chart.note, 62 * len(views))
    drawn.suptitle(title, fontsize=10)
    if chart.legend:
        drawn.legend(
            handles=[_handle(look, words) for look, words in chart.legend],
            loc="outside lower center",
            ncols=len(chart.legend),
            frameon=False,
        )
    return drawn


def _height(panel: Panel, of: int) -> float:
    if panel.rows:
        return 0.5 * len(panel.rows) + 0.3
    if panel.equal:
        return 4.6 * (panel.ylim[1] - panel.ylim[0]) / (panel.xlim[1] - panel.xlim[0])
    return 1.7 if of > 1 else 3.2


def _ends(view: View, i: int) -> bool:
    return i + 1 == len(view.panels) or view.panels[i + 1].equal or view.panels[i].equal


def _handle(look: str, words: str) -> Any:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if look == "band":
        return Patch(color=_SOFT, alpha=0.16, label=words)
    if look in _LINES:
        return Line2D([], [], label=words, **_LINES[look])
    if look.startswith("arrow"):
        return Line2D(
            [], [], label=words, marker=r"$\rightarrow$", ms=11, color=_COLOURS[look[6:]], ls="none"
        )
    return Line2D([], [], label=words, ls="none", **_MARKS[look])


def _draw_panel(panel: Panel, at: Any, *, last: bool) -> None:
    at.set_xlim(*panel.xlim)
    at.set_axisbelow(True)
    if panel.rows:
        at.set_ylim(len(panel.rows) - 0.4, -0.75)
        at.set_yticks([])
        inset = panel.xlim[0] + 0.01 * (panel.xlim[1] - panel.xlim[0])
        for i, name in enumerate(panel.rows):
            at.text(inset, i - 0.3, name, va="bottom", fontweight="bold", fontsize=8.5)
            at.axhline(i, color="0.8", lw=0.8, zorder=1)
        at.grid(axis="x", color="0.9", lw=0.6)
    elif panel.bare:
        at.set_ylim(*panel.ylim)
        at.axis("off")
    else:
        at.set_ylim(*panel.ylim)
        at.set_ylabel(panel.y)
        at.grid(color="0.9", lw=0.6)
    if panel.equal:
        at.set_aspect("equal")
    at.spines[["top", "right"]].set_visible(False)
    if panel.xnames:
        at.set_xticks(range(len(panel.xnames)), panel.xnames)
    if last:
        at.set_xlabel(panel.x)
    else:
        at.tick_params(labelbottom=False)
    _draw_inside(panel, at)


def _draw_inside(panel: Panel, at: Any) -> None:
    for rule in panel.rules:
        across = at.axvline if rule.axis == "x" else at.axhline
        across(rule.value, zorder=1.2, **_LINES[rule.look])
        if rule.band:
            at.axvspan(*rule.band, color=_SOFT, alpha=0.16, lw=0)
    for bars in panel.bars:
        colours = [_AFTER if strong else _MID for strong in bars.strong]
        at.barh(bars.y, bars.x, height=0.32, color=colours)
    for line in panel.lines:
        at.plot(line.x, line.y, zorder=1.5, **_LINES[line.look])
    for arrows in panel.arrows:
        if arrows.look != "keyarrow":
            at.plot(arrows.x, arrows.y, ".", ms=2, color="0.7")
        at.quiver(
            arrows.x,
            arrows.y,
            arrows.u,
            arrows.v,
            angles="xy",
            scale_units="xy",
            scale=1,
            width=0.0035,
            color=_COLOURS[arrows.look],
        )
    for marks in panel.marks:
        _draw_marks(marks, at)
    for x, y, words in panel.words:
        at.text(x, y, words, color=_SOFT, fontsize=8)


def _draw_marks(marks: Any, at: Any) -> None:
    look = dict(_MARKS[marks.look])
    x, y = np.asarray(marks.x, float), np.asarray(marks.y, float)
    if marks.size is None:
        at.plot(x, y, ls="none", zorder=3, **look)
    else:
        # A few sizes, so that a cloud is a few paths and not thousands.
        size = np.round(np.asarray(marks.size, float) * 4) / 4
        for one in np.unique(size):
            some = size == one
            at.plot(x[some], y[some], ls="none", zorder=2.5, **(look | {"ms": max(4.4 * one, 1.2)}))
    for i, words in enumerate(marks.labels):
        if np.isfinite(x[i]) and np.isfinite(y[i]):
            at.annotate(words, (x[i], y[i]), (6, 5), textcoords="offset points", fontsize=8.5, zorder=4)
