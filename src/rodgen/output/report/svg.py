"""Draw a chart as SVG by hand: light, told apart by shape, coloured by the page that it stands in.

A view has a width of 420 units, so that its words are about as large as the page's, on a desk and on a telephone.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rodgen.output.report.chart import Arrows, Bars, Chart, Line, Marks, Panel, Rule, View, ticks

__all__ = ["STYLE", "standalone", "view_svg"]

WIDTH = 420
LEFT, RIGHT, TOP, BOTTOM = 54, 14, 10, 36
HEIGHT, GAP = 112, 12
"""Of a panel among others, and between two."""
SINGLE = 230
ROW = 40
HEAD = 24
BETWEEN = 24
LETTER = 6.1
"""Width of a letter at 11 units, about."""

STYLE = """
.chart{font-family:system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif;font-size:11px}
.chart text{fill:var(--ink,#1b1f24);stroke:var(--paper,#fff);stroke-width:3px;stroke-linejoin:round;paint-order:stroke}
.chart .soft{fill:var(--soft,#57606a)}
.chart .name{font-weight:600}
.chart .grid{stroke:var(--line,#dfe3e8);stroke-width:1;fill:none}
.chart .axis{stroke:var(--mid,#8c959f);stroke-width:1;fill:none}
.chart .before{fill:none;stroke:var(--before,#a83a00);stroke-width:1.3}
.chart .after{fill:var(--after,#005a9c);stroke:var(--paper,#fff);stroke-width:.6}
.chart .forward{fill:var(--before,#a83a00);stroke:none}
.chart .backward{fill:none;stroke:var(--before,#a83a00)}
.chart .forward-after{fill:var(--after,#005a9c);stroke:none}
.chart .backward-after{fill:none;stroke:var(--after,#005a9c);stroke-width:1.2}
.chart .up{fill:var(--before,#a83a00);stroke:none}
.chart .down{fill:none;stroke:var(--before,#a83a00);stroke-width:1.2}
.chart .up-after{fill:var(--after,#005a9c);stroke:none}
.chart .down-after{fill:none;stroke:var(--after,#005a9c);stroke-width:1.2}
.chart .held{fill:var(--paper,#fff);stroke:var(--before,#a83a00);stroke-width:1.6}
.chart .test{fill:var(--paper,#fff);stroke:var(--ink,#1b1f24);stroke-width:1.6}
.chart .fitted{fill:var(--after,#005a9c);stroke:none}
.chart .outlier{fill:none;stroke:var(--ink,#1b1f24);stroke-width:1.6}
.chart .there{fill:var(--mid,#8c959f);stroke:none}
.chart .planned{fill:var(--paper,#fff);stroke:var(--after,#005a9c);stroke-width:2}
.chart line.before,.chart path.arrow.before{stroke-width:1.2}
.chart .arrow{fill:none;stroke-linejoin:round}
.chart .arrow.after{stroke:var(--after,#005a9c);fill:none;stroke-width:1.2}
.chart .feet{fill:none;stroke:var(--mid,#8c959f);stroke-width:2.2;stroke-linecap:round}
.chart .keyarrow{stroke:var(--ink,#1b1f24);fill:none;stroke-width:1.4}
.chart .path-fitted{fill:none;stroke:var(--after,#005a9c);stroke-width:4}
.chart .noise{stroke:var(--soft,#57606a);stroke-width:1.2;stroke-dasharray:6 4;fill:none}
.chart .limit{stroke:var(--ink,#1b1f24);stroke-width:1.2;stroke-dasharray:3 3;fill:none}
.chart .zero{stroke:var(--mid,#8c959f);stroke-width:1}
.chart .band{fill:var(--soft,#57606a);opacity:.16;stroke:none}
.chart .bar{fill:var(--mid,#8c959f)}
.chart .bar.strong{fill:var(--after,#005a9c)}
""".strip()
"""Colours of the page where it gives them, else for white paper."""


def view_svg(chart: Chart, number: int, *, ident: str) -> str:
    """Return a view of a chart as an ``<svg>`` for a page.

    Parameters
    ----------
    chart : Chart
    number : int
        Of the view.
    ident : str
        Tells the chart's tips from those of other charts.
    """
    view = chart.views[number]
    height = _height(view)
    label = _text(f"{view.title}. {chart.alt}" if view.title else chart.alt)
    some = f' data-tips="{_text(ident)}" tabindex="0"' if chart.tips else ""
    return (
        f'<svg class="chart" viewBox="0 0 {WIDTH} {_n(height)}" role="img" aria-label="{label}"{some}>'
        f"{''.join(_view(view))}</svg>"
    )


def standalone(chart: Chart) -> str:
    """Return the whole chart as an SVG file: all views side by side, with its titles, on white."""
    chart = replace(chart, views=tuple(_without_tips(view) for view in chart.views), tips=())
    heights = [_height(view) for view in chart.views]
    named = any(view.title for view in chart.views)
    lines = _wrapped(chart.note, int((len(chart.views) * (WIDTH + BETWEEN) - BETWEEN) / LETTER))
    legend = 18 if chart.legend else 0
    top = HEAD + (18 if named else 0) + legend
    width = len(chart.views) * (WIDTH + BETWEEN) - BETWEEN + 2 * BETWEEN
    height = top + max(heights) + 10 + 15 * len(lines) + 2 * 12
    parts = [
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" class="chart" width="{width}" height="{_n(height)}" '
        f'viewBox="0 0 {width} {_n(height)}" role="img"><title>{_text(chart.title)}</title>'
        f"<desc>{_text(chart.alt)}</desc><style>{STYLE}</style>"
        f'<rect width="100%" height="100%" fill="#fff"/>'
        f'<text class="name" x="{BETWEEN}" y="26" font-size="14">{_text(chart.title)}</text>'
    ]
    if chart.legend:
        parts.append(f'<g transform="translate({BETWEEN},42)">{"".join(_legend(chart.legend))}</g>')
    for i, view in enumerate(chart.views):
        x = BETWEEN + i * (WIDTH + BETWEEN)
        if view.title:
            parts.append(f'<text class="soft" x="{x}" y="{HEAD + 18 + legend}">{_text(view.title)}</text>')
        parts.append(f'<g transform="translate({x},{top + 10})">{"".join(_view(view))}</g>')
    for i, line in enumerate(lines):
        parts.append(
            f'<text class="soft" x="{BETWEEN}" y="{_n(top + max(heights) + 28 + 15 * i)}">{_text(line)}</text>'
        )
    return "".join(parts) + "</svg>\n"


def _without_tips(view: View) -> View:
    return replace(
        view,
        panels=tuple(
            replace(
                panel,
                marks=tuple(replace(marks, tips=None) for marks in panel.marks),
                arrows=tuple(replace(arrows, tips=None) for arrows in panel.arrows),
                bars=tuple(replace(bars, tips=None) for bars in panel.bars),
            )
            for panel in view.panels
        ),
    )


def legend_svg(look: str) -> str:
    """Return one mark of a legend as a small ``<svg>``."""
    return f'<svg class="chart key" viewBox="0 0 16 12" aria-hidden="true">{_key(look)}</svg>'


def _legend(legend: tuple[tuple[str, str], ...]) -> Iterator[str]:
    x = 0.0
    for look, words in legend:
        yield f'<g transform="translate({_n(x)},-10)">{_key(look)}</g>'
        yield f'<text x="{_n(x + 20)}" y="0">{_text(words)}</text>'
        x += 20 + LETTER * len(words) + 18


def _key(look: str) -> str:
    if look in {"noise", "limit"}:
        return f'<line class="{look}" x1="0" y1="6" x2="16" y2="6"/>'
    if look == "band":
        return '<rect class="band" x="0" y="1" width="16" height="10"/>'
    if look.startswith("arrow"):
        return f'<path class="{look}" d="{_arrow(1, 9, 15, 3)}"/>'
    return f'<{_mark(look, 8, 6, 1.0)} class="{look}"/>'


# views and panels --------------------------------------------------------------------------------------------------


def _height(view: View) -> float:
    bottom = 4 if view.panels[-1].bare else BOTTOM
    between = sum(GAP + BOTTOM * _ends(view, i) for i in range(len(view.panels) - 1))
    return sum(_heights(view)) + between + TOP + bottom


def _heights(view: View) -> list[float]:
    return [_panel_height(panel, len(view.panels)) for panel in view.panels]


def _panel_height(panel: Panel, of: int) -> float:
    if panel.rows:
        return ROW * len(panel.rows)
    if panel.equal:
        across = panel.xlim[1] - panel.xlim[0]
        left, right = (0, 0) if panel.bare else (LEFT, RIGHT)
        return float((WIDTH - left - right) * (panel.ylim[1] - panel.ylim[0]) / across)
    return HEIGHT if of > 1 else SINGLE


def _view(view: View) -> Iterator[str]:
    y = float(TOP)
    for i, (panel, height) in enumerate(zip(view.panels, _heights(view), strict=True)):
        yield from _Drawn(panel, y, height, _ends(view, i)).parts()
        y += height + GAP + BOTTOM * _ends(view, i)


def _ends(view: View, i: int) -> bool:
    """Tell whether the scale along x of the panels so far stands below this one."""
    return i + 1 == len(view.panels) or view.panels[i + 1].equal or view.panels[i].equal


class _Drawn:
    """A panel with its scales."""

    def __init__(self, panel: Panel, top: float, height: float, last: bool) -> None:
        self.panel, self.top, self.height, self.last = panel, top, height, last
        plain = panel.bare or panel.rows
        self.left = 8.0 if plain else LEFT
        self.right = WIDTH - (RIGHT if not plain else 8.0 if panel.bare else 40.0)
        if panel.bare:
            self.left, self.right = 0.0, float(WIDTH)

    def x(self, value: float) -> float:
        low, high = self.panel.xlim
        return self.left + (value - low) / (high - low) * (self.right - self.left)

    def y(self, value: float) -> float:
        if self.panel.rows:
            return self.top + ROW * (value + 0.68)
        low, high = self.panel.ylim
        return self.top + (high - value) / (high - low) * self.height

    def parts(self) -> Iterator[str]:
        panel = self.panel
        if not panel.bare:
            yield from self._axes()
        for rule in panel.rules:
            yield from self._rule(rule)
        for bars in panel.bars:
            yield from self._bars(bars)
        for line in panel.lines:
            yield self._line(line)
        for arrows in panel.arrows:
            yield from self._arrows(arrows)
        for marks in panel.marks:
            yield from self._marks(marks)
        for x, y, words in panel.words:
            yield f'<text class="soft" x="{_n(self.x(x))}" y="{_n(self.y(y))}">{_text(words)}</text>'

    def _axes(self) -> Iterator[str]:
        panel, bottom = self.panel, self.top + self.height
        places = (
            [float(i) for i in range(len(panel.xnames))]
            if panel.xnames
            else ticks(*panel.xlim, 5, degrees=panel.degrees)
        )
        grid = "".join(f"M{_n(self.x(v))} {_n(self.top)}V{_n(bottom)}" for v in places if not panel.xnames)
        if not panel.rows:
            upwards = ticks(*panel.ylim, 4 if self.height < 2 * HEIGHT else 6)
            grid += "".join(f"M{_n(self.left)} {_n(self.y(v))}H{_n(self.right)}" for v in upwards)
            for v, said in zip(upwards, _numbers(upwards), strict=True):
                at = f'x="{_n(self.left - 6)}" y="{_n(self.y(v) + 4)}"'
                yield f'<text class="soft" {at} text-anchor="end">{said}</text>'
            middle = self.top + self.height / 2
            if panel.y:
                yield (
                    f'<text transform="translate(11,{_n(middle)}) rotate(-90)" text-anchor="middle">'
                    f"{_text(panel.y)}</text>"
                )
        yield f'<path class="grid" d="{grid}"/>'
        if panel.rows:
            for i, name in enumerate(panel.rows):
                at = f'x="{_n(self.left)}" y="{_n(self.top + ROW * (i + 0.32))}"'
                yield f'<text class="name" {at}>{_text(name)}</text>'
                yield f'<path class="axis" d="M{_n(self.left)} {_n(self.y(i))}H{_n(self.right)}" opacity=".45"/>'
        if self.last:
            names = list(panel.xnames) or _numbers(places)
            for v, words in zip(places, names, strict=True):
                yield (
                    f'<text class="soft" x="{_n(self.x(v))}" y="{_n(bottom + 14)}" text-anchor="middle">'
                    f"{_text(words)}</text>"
                )
            if panel.x:
                middle = (self.left + self.right) / 2
                yield f'<text x="{_n(middle)}" y="{_n(bottom + 30)}" text-anchor="middle">{_text(panel.x)}</text>'

    def _rule(self, rule: Rule) -> Iterator[str]:
        bottom = self.top + self.height
        if rule.axis == "x":
            if rule.band:
                a, b = (self.x(min(max(v, self.panel.xlim[0]), self.panel.xlim[1])) for v in rule.band)
                size = f'width="{_n(b - a)}" height="{_n(self.height)}"'
                yield f'<rect class="band" x="{_n(a)}" y="{_n(self.top)}" {size}/>'
            x = self.x(rule.value)
            yield f'<line class="{rule.look}" x1="{_n(x)}" y1="{_n(self.top)}" x2="{_n(x)}" y2="{_n(bottom)}"/>'
            if rule.label:
                right = x > WIDTH * 0.6
                yield (
                    f'<text x="{_n(x + (-4 if right else 4))}" y="{_n(self.top + 2)}"'
                    f"{' text-anchor=' + chr(34) + 'end' + chr(34) if right else ''}>{_text(rule.label)}</text>"
                )
        else:
            y = self.y(rule.value)
            yield f'<line class="{rule.look}" x1="{_n(self.left)}" y1="{_n(y)}" x2="{_n(self.right)}" y2="{_n(y)}"/>'

    def _bars(self, bars: Bars) -> Iterator[str]:
        start = self.x(max(0.0, self.panel.xlim[0]))
        for i, (x, y) in enumerate(zip(bars.x, bars.y, strict=True)):
            tip = f' data-tip="{int(bars.tips[i])}"' if bars.tips is not None else ""
            kind = "bar strong" if bars.strong[i] else "bar"
            width = max(self.x(float(x)) - start, 1.0)
            at = f'x="{_n(start)}" y="{_n(self.y(float(y)) - 7)}"'
            yield f'<rect class="{kind}"{tip} {at} width="{_n(width)}" height="12"/>'

    def _line(self, line: Line) -> str:
        points = " ".join(
            f"{_n(self.x(float(x)))},{_n(self.y(float(y)))}"
            for x, y in zip(line.x, line.y, strict=True)
            if math.isfinite(x) and math.isfinite(y)
        )
        return f'<polyline class="{line.look}" points="{points}"/>'

    def _arrows(self, arrows: Arrows) -> Iterator[str]:
        kind = arrows.look
        feet = []
        if kind != "keyarrow":
            for x, y in zip(arrows.x, arrows.y, strict=True):
                feet.append(f"M{_n(self.x(float(x)))} {_n(self.y(float(y)))}h0")
            yield f'<path class="feet" d="{"".join(feet)}"/>'
        for i in range(len(arrows.x)):
            x, y = self.x(float(arrows.x[i])), self.y(float(arrows.y[i]))
            to_x = self.x(float(arrows.x[i] + arrows.u[i]))
            to_y = self.y(float(arrows.y[i] + arrows.v[i]))
            tip = f' data-tip="{int(arrows.tips[i])}"' if arrows.tips is not None else ""
            name = kind if kind == "keyarrow" else f"arrow {kind}"
            yield f'<path class="{name}"{tip} d="{_arrow(x, y, to_x, to_y)}"/>'

    def _marks(self, marks: Marks) -> Iterator[str]:
        yield f'<g class="{marks.look}">'
        for i, (x, y) in enumerate(zip(marks.x, marks.y, strict=True)):
            if not (math.isfinite(x) and math.isfinite(y)):
                continue
            tip = f' data-tip="{int(marks.tips[i])}"' if marks.tips is not None else ""
            size = 1.0 if marks.size is None else float(marks.size[i])
            yield f"<{_mark(marks.look, self.x(float(x)), self.y(float(y)), size)}{tip}/>"
        yield "</g>"
        for i, words in enumerate(marks.labels):
            x, y = self.x(float(marks.x[i])), self.y(float(marks.y[i]))
            if words and math.isfinite(x) and math.isfinite(y):
                below = marks.look in {"held", "test"}
                yield f'<text x="{_n(x + 7)}" y="{_n(y + (12 if below else -5))}">{_text(words)}</text>'


def _mark(look: str, x: float, y: float, size: float) -> str:
    """Return a shape without its class: what kind a point is shows without colour."""
    kind = look.removesuffix("-after")
    r = 3.0 * size
    if kind in {"before", "there"}:
        return f'circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(r * (0.8 if kind == "there" else 0.93))}"'
    if kind == "after":
        return f'circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(r * 0.93)}"'
    if kind == "fitted":
        return f'circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(1.5 * r)}"'
    if kind == "held":
        s = 1.35 * r
        return f'rect x="{_n(x - s)}" y="{_n(y - s)}" width="{_n(2 * s)}" height="{_n(2 * s)}"'
    a, b, d, w = _n(1.25 * r), _n(2.5 * r), _n(1.7 * r), _n(2 * r)
    diamond = f"M{_n(x)} {_n(y - 1.7 * r)}l{d} {d}l-{d} {d}l-{d} -{d}z"
    paths = {
        "forward": f"M{_n(x - 1.1 * r)} {_n(y - 1.25 * r)}l{b} {a}l-{b} {a}z",
        "backward": f"M{_n(x + 1.1 * r)} {_n(y - 1.25 * r)}l-{b} {a}l{b} {a}z",
        "up": f"M{_n(x - 1.25 * r)} {_n(y + 1.1 * r)}l{a} -{b}l{a} {b}z",
        "down": f"M{_n(x - 1.25 * r)} {_n(y - 1.1 * r)}l{a} {b}l{a} -{b}z",
        "test": diamond,
        "planned": diamond,
        "outlier": f"M{_n(x - r)} {_n(y - r)}l{w} {w}m0 -{w}l-{w} {w}",
    }
    return f'path d="{paths[kind]}"'


def _arrow(x: float, y: float, to_x: float, to_y: float) -> str:
    length = math.hypot(to_x - x, to_y - y)
    if length < 0.3:
        return f"M{_n(x)} {_n(y)}h.1"
    head = min(4.0, 0.5 * length)
    c, s = (to_x - x) / length, (to_y - y) / length
    sides = []
    for turn in (2.6, -2.6):
        cc, ss = math.cos(turn), math.sin(turn)
        sides.append((to_x + head * (c * cc - s * ss), to_y + head * (s * cc + c * ss)))
    (ax, ay), (bx, by) = sides
    return f"M{_n(x)} {_n(y)}L{_n(to_x)} {_n(to_y)}M{_n(ax)} {_n(ay)}L{_n(to_x)} {_n(to_y)}L{_n(bx)} {_n(by)}"


# words and numbers -------------------------------------------------------------------------------------------------


def _text(words: str) -> str:
    return html.escape(words, quote=True)


def _n(value: float) -> str:
    """Write a coordinate to a tenth, as short as it goes."""
    text = f"{float(np.clip(value, -9999, 9999)):.1f}".removesuffix(".0")
    return "0" if text == "-0" else text


def _numbers(values: list[float]) -> list[str]:
    """Write the numbers of an axis, all with as many decimals."""
    if not values:
        return []
    largest = max(abs(v) for v in values)
    if largest >= 1e6 or (0 < largest < 1e-4):
        return [f"{v:g}" for v in values]
    for decimals in range(7):
        if all(abs(round(v, decimals) - v) <= 1e-6 * max(largest, 1e-12) for v in values):
            return [f"{v:.{decimals}f}".replace("-", "−") for v in values]
    return [f"{v:g}" for v in values]


def _wrapped(text: str, width: int) -> list[str]:
    import textwrap

    return textwrap.wrap(text, width) if text else []
