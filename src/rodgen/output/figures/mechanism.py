"""The planar representation of a mechanism: lines are links, letters are joints.

It shows which joint follows which and says nothing of sizes: a loop is drawn as a regular polygon, an open chain as a
row. The fixed link is hatched; the input and the output are marked.
"""

from __future__ import annotations

from math import cos, hypot, pi, sin
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from rodgen.errors import RodgenError, listed
from rodgen.output.figures.style import BLUE, INK, ORANGE, PAPER, SOFT, Panel, column, describe, label
from rodgen.output.numbers import minus

if TYPE_CHECKING:
    from rodgen.kinematics.spatial import Mechanism

RADIUS, MARGIN, SPACING = 15, 75, 120
"""Of a joint, around the whole, and between joints, in pixels of a figure that is as wide as it asks for."""
Point = tuple[float, float]


def planar_representation(
    mechanism: Mechanism,
    input: int | str | None = None,
    output: int | str | None = None,
    *,
    sizes: bool = True,
) -> go.Figure:
    """Return the planar representation of a loop or an open chain.

    Parameters
    ----------
    mechanism : rodgen.spatial.Mechanism
        Of a loop the link from the last to the first joint is the fixed one; of an open chain the base.
    input, output : int or str, optional
        Joints to mark, by number (from 0) or name.
    sizes : bool, optional
        Whether to write length and twist at each link.

    Raises
    ------
    RodgenError
        When there is no such joint.

    Examples
    --------
    >>> from rodgen import spatial
    >>> figure = planar_representation(spatial.PUMA_560, output=5)
    >>> list(figure.data[-1].text)
    ['R', 'R', 'R', 'R', 'R', 'R']
    """
    n = len(mechanism.joints)
    marked = {_joint(mechanism, input): "input", _joint(mechanism, output): "output"}
    closed = mechanism.closed and n > 1
    if closed:
        size = max(70.0, SPACING / (2 * sin(pi / n)))
        # the fixed link, from the last to the first joint, lies at the bottom
        turns = [-pi / 2 - pi / n - 2 * pi * j / n for j in range(n)]
        points = [(size * cos(t), size * sin(t)) for t in turns]
        links = [(j, (j + 1) % n) for j in range(n)]
    else:
        points = [(SPACING * float(j), 0.0) for j in range(n)]
        links = [(j, j + 1) for j in range(n - 1)]
    middle = (0.0, 0.0) if closed else (SPACING * (n - 1) / 2, -1e6)
    ends = [(min(v) - MARGIN, max(v) + MARGIN) for v in zip(*points, strict=True)]
    wide, high = (b - a for a, b in ends)
    figure = column([Panel("", int(high), " ", equal=True)], legend=False, width=int(max(wide, 360)) + 24)
    segments: list[list[Point]] = [[points[i], points[j]] for i, j in links]
    hatching: list[list[Point]] = []
    if closed:
        i, j = links[-1]
        hatching = _hatching(
            _between(points[i], points[j], 0.3), _between(points[i], points[j], 0.7), (0.0, -1.0)
        )
    else:
        x, y = points[0]
        segments += [[(x, y), (x, y - 40)], [(x - 22, y - 40), (x + 22, y - 40)]]
        hatching = _hatching((x - 22, y - 40), (x + 22, y - 40), (0.0, -1.0))
    for drawn, width in ((hatching, 1.0), (segments, 2.5)):
        figure.add_trace(_lines(drawn, width))
    if sizes:
        for number, (i, j) in enumerate(links):
            text = minus(f"{mechanism.a[number]:.4g}, {np.degrees(mechanism.alpha[number]):.4g}°")
            outward = _outward(points[i], points[j], middle)
            x, y = _between(points[i], points[j], 0.5)
            # on the inner side, where no names and no hatching are; below a row
            _write(figure, x - 26 * outward[0], y - 26 * outward[1], text)
    for j, (x, y) in enumerate(points):
        away = (x - middle[0], y - middle[1]) if closed else (0.0, 1.0)
        length = hypot(*away) or 1.0
        word = mechanism.names[j] + (f", {marked[j]}" if j in marked else "")
        _write(figure, x + 40 * away[0] / length, y + 32 * away[1] / length, word)
    colours = [{"input": BLUE, "output": ORANGE}.get(marked.get(j, ""), INK) for j in range(n)]
    figure.add_trace(
        go.Scatter(
            x=[x for x, _ in points], y=[y for _, y in points], mode="markers+text", text=list(mechanism.joints),
            marker={"size": 2 * RADIUS, "color": PAPER, "opacity": 1, "line": {"color": colours, "width": 2.5}},
            textfont={"size": 14, "color": colours}, hoverinfo="skip",
        )
    )  # fmt: skip
    figure.update_xaxes(range=list(ends[0]), visible=False)
    figure.update_yaxes(range=list(ends[1]), visible=False)
    figure.update_layout(margin={"l": 12, "r": 12, "b": 8}, height=int(high) + 16, meta={"heights": None})
    title = mechanism.name or "".join(mechanism.joints)
    alt = f"{title}: {'loop' if closed else 'open chain'} of the joints {', '.join(mechanism.names)}"
    return describe(figure, "planar_representation", title, alt=alt, width=int(wide) + 40)


def _joint(mechanism: Mechanism, which: int | str | None) -> int:
    if which is None:
        return -1
    if isinstance(which, str):
        if which not in mechanism.names:
            raise RodgenError(f"there is no joint {which!r}; expected {listed(mechanism.names)}")
        return mechanism.names.index(which)
    if not 0 <= which < len(mechanism.joints):
        raise RodgenError(f"there is no joint {which}; expected 0 to {len(mechanism.joints) - 1}")
    return int(which)


def _write(figure: go.Figure, x: float, y: float, text: str) -> None:
    figure.add_annotation(x=x, y=y, text=label(text), showarrow=False, font={"size": 12, "color": SOFT})


def _lines(segments: list[list[Point]], width: float) -> go.Scatter:
    points = [point for a, b in segments for point in (a, b, (np.nan, np.nan))]
    return go.Scatter(
        x=[x for x, _ in points],
        y=[y for _, y in points],
        mode="lines",
        line={"color": INK, "width": width},
        hoverinfo="skip",
    )


def _between(a: Point, b: Point, share: float) -> Point:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def _outward(a: Point, b: Point, middle: Point) -> Point:
    """Return the unit vector across the line, away from the middle."""
    x, y = b[1] - a[1], a[0] - b[0]
    length = hypot(x, y) or 1.0
    side = (a[0] + b[0]) / 2 - middle[0], (a[1] + b[1]) / 2 - middle[1]
    sign = 1.0 if x * side[0] + y * side[1] >= 0 else -1.0
    return sign * x / length, sign * y / length


def _hatching(a: Point, b: Point, outward: Point) -> list[list[Point]]:
    """Return short slanted lines along one side of a line."""
    along = (b[0] - a[0]) / 8, (b[1] - a[1]) / 8
    return [
        [(x, y), (x + 9 * outward[0] - along[0], y + 9 * outward[1] - along[1])]
        for x, y in (_between(a, b, k / 5) for k in range(6))
    ]
