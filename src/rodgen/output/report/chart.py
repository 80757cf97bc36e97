"""What a picture of the report shows, apart from how it is drawn: one description for SVG, PNG and the page.

A chart has one or two views side by side (before, after), a view has panels below each other, and a panel has marks,
lines and arrows. What a mark looks like is a word, so that whoever draws can tell kinds apart by shape as well as by
colour.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Arrows", "Bars", "Chart", "Line", "Marks", "Panel", "Rule", "View", "ticks"]

Array: TypeAlias = NDArray[np.float64]
Index: TypeAlias = NDArray[np.intp]

_NICE = (1.0, 2.0, 2.5, 5.0, 10.0)
_ANGLES = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0, 90.0, 180.0, 360.0, 720.0)


@dataclass(frozen=True)
class Marks:
    """Points; `tips` are numbers of the chart's tips, as many as there are points, or nothing.

    `look` is one of ``before``, ``after``, ``forward``, ``backward``, ``up``, ``down``, ``fitted``, ``held``, ``test``,
    ``outlier``, ``there``, ``planned``; those that tell directions apart have one for after, too: ``up-after``.
    """

    x: Array
    y: Array
    look: str
    tips: Index | None = None
    size: Array | None = None
    """Of each, in parts of the usual radius; None: all alike."""
    labels: tuple[str, ...] = ()
    """Written beside the points."""


@dataclass(frozen=True)
class Line:
    """Points that are joined."""

    x: Array
    y: Array
    look: str


@dataclass(frozen=True)
class Arrows:
    """Arrows from (x, y) by (u, v), in the units of the panel."""

    x: Array
    y: Array
    u: Array
    v: Array
    look: str
    tips: Index | None = None


@dataclass(frozen=True)
class Bars:
    """Bars from zero to x, at the heights y."""

    x: Array
    y: Array
    strong: tuple[bool, ...]
    tips: Index | None = None


@dataclass(frozen=True)
class Rule:
    """A line right across, at a value of one axis; with `width`, a band about it."""

    value: float
    axis: str
    look: str
    label: str = ""
    band: tuple[float, float] | None = None


@dataclass(frozen=True)
class Panel:
    """A field with axes.

    Attributes
    ----------
    x, y : str
        What is along the axes; empty: an axis without words.
    xlim, ylim : tuple of float
    rows : tuple of str
        Instead of a scale upwards: names of rows, from the top, at y = 0, 1, ...
    equal : bool
        Whether a unit is as long along both axes.
    degrees : bool
        Whether the axis along x counts degrees.
    bare : bool
        Without axes: a sky.
    """

    x: str
    y: str
    xlim: tuple[float, float]
    ylim: tuple[float, float]
    marks: tuple[Marks, ...] = ()
    lines: tuple[Line, ...] = ()
    arrows: tuple[Arrows, ...] = ()
    bars: tuple[Bars, ...] = ()
    rules: tuple[Rule, ...] = ()
    rows: tuple[str, ...] = ()
    words: tuple[tuple[float, float, str], ...] = ()
    """Text at places of the panel."""
    equal: bool = False
    degrees: bool = False
    bare: bool = False
    xnames: tuple[str, ...] = ()
    """Instead of a scale along x: names at x = 0, 1, ..."""


@dataclass(frozen=True)
class View:
    """Panels below each other, with one title."""

    title: str
    panels: tuple[Panel, ...]
    key: str = ""
    """A word for a button that shows this view alone."""


@dataclass(frozen=True)
class Chart:
    """A picture.

    Attributes
    ----------
    name : str
        Of its files.
    title, note : str
        What it shows; what to know when reading it.
    alt : str
        What it tells, for those who do not see it.
    views : tuple of View
    legend : tuple of (str, str)
        Looks, with what they mean.
    tips : tuple of str
        What a point tells when it is pointed at.
    """

    name: str
    title: str
    alt: str
    views: tuple[View, ...]
    note: str = ""
    legend: tuple[tuple[str, str], ...] = ()
    tips: tuple[str, ...] = field(default=(), repr=False)


def ticks(low: float, high: float, most: int = 5, *, degrees: bool = False) -> list[float]:
    """Return round numbers within a range, at most about `most` of them.

    Examples
    --------
    >>> ticks(-0.3, 2.1)
    [0.0, 0.5, 1.0, 1.5, 2.0]
    >>> ticks(0, 350, degrees=True)
    [0.0, 90.0, 180.0, 270.0]
    """
    span = high - low
    if not np.isfinite(span) or span <= 0:
        return [low] if np.isfinite(low) else []
    if degrees and span >= _ANGLES[0] * most:
        step = next((s for s in _ANGLES if span / s <= most), span / most)
    else:
        size = 10.0 ** float(np.floor(np.log10(span / most)))
        step = next(size * s for s in _NICE if span / (size * s) <= most)
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    return [round(k * step, 12) + 0.0 for k in range(first, last + 1)]
