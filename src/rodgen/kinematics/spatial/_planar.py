"""The planar representation of a mechanism: lines are links, letters are joints.

It shows which joint follows which and says nothing of sizes: a loop is drawn as a regular polygon, an open chain as a
row. The fixed link is hatched; the input and the output are marked.
"""

from __future__ import annotations

import os
from html import escape
from math import cos, hypot, pi, sin
from pathlib import Path

import numpy as np

from rodgen.errors import RodgenError
from rodgen.kinematics.spatial._mechanism import Mechanism

__all__ = ["planar_svg", "save_planar_svg"]

RADIUS, MARGIN, SPACING = 15, 70, 110
STYLE = (
    "text{font:14px sans-serif;text-anchor:middle;dominant-baseline:central;fill:#222}"
    ".small{font-size:11px;fill:#555}.link{stroke:#222;stroke-width:2.5}.fixed{stroke:#222;stroke-width:1}"
    ".joint{fill:#fff;stroke:#222;stroke-width:2}.input{fill:#cfe3ff}.output{fill:#ffe1b8}"
)


def planar_svg(
    mechanism: Mechanism,
    input: int | str | None = None,
    output: int | str | None = None,
    *,
    sizes: bool = True,
) -> str:
    """Draw the planar representation of a loop or an open chain.

    Parameters
    ----------
    mechanism : Mechanism
        What to draw. Of a loop the link from the last to the first joint is the fixed one; of an open chain the base.
    input, output : int or str, optional
        Joints to mark, by number (from 0) or name.
    sizes : bool, optional
        Whether to write length and twist beside each link.

    Returns
    -------
    str
        An SVG picture.

    Raises
    ------
    RodgenError
        When there is no such joint.

    Examples
    --------
    >>> from rodgen import spatial
    >>> picture = spatial.planar_svg(spatial.PUMA_560, output=5)
    >>> picture.startswith("<svg"), picture.count('class="joint')
    (True, 6)
    """
    n = len(mechanism.joints)
    marked = {_joint(mechanism, input): "input", _joint(mechanism, output): "output"}
    if mechanism.closed and n > 1:
        size = max(70.0, SPACING / (2 * sin(pi / n)))
        # the fixed link, from the last to the first joint, lies at the bottom
        turns = [pi / 2 + pi / n + 2 * pi * j / n for j in range(n)]
        points = [(size * cos(t), size * sin(t)) for t in turns]
        links = [(j, (j + 1) % n) for j in range(n)]
        centre = True
    else:
        points = [(SPACING * float(j), 0.0) for j in range(n)]
        links = [(j, j + 1) for j in range(n - 1)]
        centre = False
    left, top = min(x for x, _ in points) - MARGIN, min(y for _, y in points) - MARGIN
    width = max(x for x, _ in points) - left + MARGIN
    height = max(y for _, y in points) - top + MARGIN
    points = [(x - left, y - top) for x, y in points]
    middle = (width / 2, height / 2) if centre else (width / 2, height)
    title = escape(mechanism.name or "".join(mechanism.joints))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'width="{width:.0f}" height="{height:.0f}" role="img"><title>{title}</title><style>{STYLE}</style>'
    ]
    for number, (i, j) in enumerate(links):
        fixed = centre and number == n - 1
        parts.append(_link(points[i], points[j], fixed, middle))
        if sizes:
            text = f"{mechanism.a[number]:.4g}, {np.degrees(mechanism.alpha[number]):.4g}°"
            parts.append(_beside(points[i], points[j], middle, text))
    if not centre:
        x, y = points[0]
        parts.append(
            _line((x, y), (x, y + 40), "link") + _hatching((x - 22, y + 40), (x + 22, y + 40), (0, 1))
        )
    for j, (x, y) in enumerate(points):
        mark = marked.get(j, "")
        parts.append(f'<circle class="joint {mark}" cx="{x:.1f}" cy="{y:.1f}" r="{RADIUS}"/>')
        parts.append(f'<text x="{x:.1f}" y="{y:.1f}">{mechanism.joints[j]}</text>')
        away = (x - middle[0], y - middle[1]) if centre else (0.0, -1.0)
        length = hypot(*away) or 1.0
        word = escape(mechanism.names[j]) + (f", {mark}" if mark else "")
        where = (x + 36 * away[0] / length, y + 30 * away[1] / length)
        parts.append(f'<text class="small" x="{where[0]:.1f}" y="{where[1]:.1f}">{word}</text>')
    return "".join(parts) + "</svg>\n"


def save_planar_svg(
    file: str | os.PathLike[str],
    mechanism: Mechanism,
    input: int | str | None = None,
    output: int | str | None = None,
) -> None:
    """Write :func:`planar_svg` to a file."""
    Path(file).write_text(planar_svg(mechanism, input, output), encoding="utf-8")


def _joint(mechanism: Mechanism, which: int | str | None) -> int:
    if which is None:
        return -1
    if isinstance(which, str):
        if which not in mechanism.names:
            raise RodgenError(f"there is no joint {which!r}; expected one of {', '.join(mechanism.names)}")
        return mechanism.names.index(which)
    if not 0 <= which < len(mechanism.joints):
        raise RodgenError(f"there is no joint {which}; expected 0 to {len(mechanism.joints) - 1}")
    return int(which)


def _line(a: tuple[float, float], b: tuple[float, float], kind: str) -> str:
    return f'<line class="{kind}" x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}"/>'


def _link(a: tuple[float, float], b: tuple[float, float], fixed: bool, middle: tuple[float, float]) -> str:
    drawn = _line(a, b, "link")
    if fixed:
        outward = _outward(a, b, middle)
        ends = [(a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])) for t in (0.3, 0.7)]
        drawn += _hatching(ends[0], ends[1], outward)
    return drawn


def _outward(
    a: tuple[float, float], b: tuple[float, float], middle: tuple[float, float]
) -> tuple[float, float]:
    """Return the unit vector across the line, away from the middle."""
    x, y = b[1] - a[1], a[0] - b[0]
    length = hypot(x, y) or 1.0
    side = (a[0] + b[0]) / 2 - middle[0], (a[1] + b[1]) / 2 - middle[1]
    sign = 1.0 if x * side[0] + y * side[1] >= 0 else -1.0
    return sign * x / length, sign * y / length


def _hatching(a: tuple[float, float], b: tuple[float, float], outward: tuple[float, float]) -> str:
    drawn = _line(a, b, "link")
    for k in range(6):
        t = k / 5
        x, y = a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])
        along = (b[0] - a[0]) / 8, (b[1] - a[1]) / 8
        drawn += _line((x, y), (x + 9 * outward[0] - along[0], y + 9 * outward[1] - along[1]), "fixed")
    return drawn


def _beside(a: tuple[float, float], b: tuple[float, float], middle: tuple[float, float], text: str) -> str:
    outward = _outward(a, b, middle)
    # on the inner side, where no names and no hatching are; below a row
    x = (a[0] + b[0]) / 2 - 26 * outward[0]
    y = (a[1] + b[1]) / 2 - 26 * outward[1]
    return f'<text class="small" x="{x:.1f}" y="{y:.1f}">{escape(text)}</text>'
