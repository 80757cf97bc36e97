"""The residuals of each row against anything that was recorded, of one model or before and after another.

Every mark has the number of its row as ``customdata``, so that a page can select in one figure and mark in all others.
Large data are thinned, and the note of the figure says so.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from rodgen.array_types import Array, Index
from rodgen.calibration.words import plain
from rodgen.errors import RodgenError, joined
from rodgen.output.figures.drawn_rows import (
    AT_EDGE,
    DEVIATIONS,
    DrawnRows,
    PlannedRows,
    planned_rows,
)
from rodgen.output.figures.style import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    OUTLIER,
    PURPLE,
    SELECTED,
    SOFT,
    Panel,
    add_trace,
    axes,
    column,
    describe,
    label,
    mark_size,
)

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit
    from rodgen.calibration.plan import Plan
    from rodgen.machines.drivers import Driver

SEVERAL, SINGLE = 140, 260
"""Heights of a panel among others, and alone, in pixels."""
MARGIN = 1.12
"""Of the y axis beyond the largest residual."""
ANGLES = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0, 90.0, 180.0, 360.0, 720.0)
"""Steps between the numbers of an axis that counts degrees."""
MOST_RUNS, PIECES = 20, 40
"""Runs up to which lines part them, and points of the line that follows residuals in time."""
MOST_GROUPS = 10
"""Categories that have a mark of their own."""
JITTER = 0.25
"""Width over which the marks of a category are spread."""
EDGE = 0.04
"""From the lower edge of a panel to planned readings, as a share of its height."""
MEAN = {"color": INK, "width": 1.6}
"""The line of a curve or a mean among marks."""
ASIDE = {"symbol": "square-x-open", "size": 9, "color": SOFT}
SIDES: dict[str, dict[str, Any]] = {
    "before": {"symbol": "circle-open", "color": ORANGE},
    "after": {"symbol": "circle", "color": BLUE},
    "residual": {"symbol": "circle-open", "color": BLUE},
}
"""How models differ: open marks are before, filled ones after."""
DIRECTIONS = {1: "forwards", -1: "backwards", 0: "not known"}
"""Directions of approach."""
SHAPES = "circle square diamond triangle-up triangle-down pentagon hexagram star hexagon cross".split()
GROUPS = list(zip(SHAPES, (BLUE, ORANGE, PURPLE, INK, GREY) * 2, strict=True))


# one figure of rows against anything ------------------------------------------------------------------------------


def residual_plot(
    fit: Fit,
    against: str = "order",
    *,
    before: Fit | None = None,
    parts: str = "apart",
    whitened: bool = False,
    approach: str = "",
    colour: str = "",
    selected: Collection[int] = (),
    aside: Collection[int] = (),
    planned: Plan | None = None,
    least: Sequence[float] = (),
) -> go.Figure:
    """Return the residuals of each row against something that was recorded, of one model or before and after.

    The ``customdata`` of every mark is the number of its row in ``fit.observations``, from 0.

    Parameters
    ----------
    fit : Fit
    against : str, optional
        What the x axis shows: one of `DrawnRows.drivers`: a joint, ``"dir_C"``, a column, ``"t"``, ``"order"``, …
    before : Fit, optional
        Another model of the same observations, whose residuals are drawn, too.
    parts : str, optional
        ``"apart"``: a panel for each component. ``"together"``: the size of the residual. The name of a joint: the
        error of its reading that would explain each residual best, and what is across.
    whitened : bool, optional
        Whether residuals are in standard deviations, free of a stated correlation; not of the reading of a joint.
    approach : str, optional
        A joint whose directions of approach differ by their marks.
    colour : str, optional
        One of `DrawnRows.drivers`, which colours the marks.
    selected, aside : collection of int, optional
        Rows that are marked: chosen by a user, and left out by a user.
    planned : Plan, optional
        Whose readings are marked at the lower edge, where it says what they have of `against`.
    least : sequence of float, optional
        The end of the y axis of each panel, at least: that of another figure, with which this one is compared.

    Raises
    ------
    RodgenError
        When there is no such driver or joint.
    """
    rows = DrawnRows(before or fit, fit if before is not None else None, kept=[*selected, *aside])
    joints = [joint.name for joint in fit.machine.joints]
    for name in {approach, parts} - {"", "apart", "together"}:
        if name not in joints:
            raise RodgenError(f"{name!r} is no joint: {joined(joints)}")
    sides = rows.o.s[:, joints.index(approach)] if approach else None
    panels = _panels(rows, joints.index(parts) if parts in joints else None, parts, whitened)
    return residuals_over(
        rows,
        rows.driver(against),
        panels,
        approach=sides,
        colour=rows.driver(colour) if colour else None,
        selected=selected,
        aside=aside,
        planned=planned_rows(fit, planned),
        least=least,
    )


def explained_marks(
    fit: Fit, against: str, explained: Array, of: Index, *, kept: Collection[int] = ()
) -> list[dict[str, Any]]:
    """Return traces to be added to `residual_plot` of components: what an effect would explain of each.

    Parameters
    ----------
    fit : Fit
    against : str
        As of `residual_plot`.
    explained : ndarray, shape (rows, m)
        In the unit of the fit, of the rows `of`.
    of : ndarray of int, shape (rows,)
        In rising order.
    kept : collection of int, optional
        Rows that are drawn in any case.
    """
    rows = DrawnRows(fit, kept=kept)
    some = np.flatnonzero(np.isin(rows.chosen, of) & ~rows.bad)
    x = _along(rows, rows.driver(against))[rows.sides[-1][0]][some].tolist()
    y = (explained * rows.factors)[np.searchsorted(of, rows.chosen[some])]
    mark = {"symbol": "line-ew-open", "size": 9, "color": ORANGE, "line": {"width": 2}}
    about = {"type": "scatter", "mode": "markers", "marker": mark, "hoverinfo": "skip", "showlegend": False}
    return [about | {"x": x, "y": each.tolist(), **axes(number)} for number, each in enumerate(y.T)]


@dataclass(frozen=True)
class ResidualPanel:
    """What one panel shows."""

    title: str
    unit: str
    values: tuple[Array, ...]
    """Before and after, or of the one model, (chosen,)."""
    size: bool = False
    """Whether values are sizes, never negative."""

    @property
    def heading(self) -> str:
        """The title with its unit, as Plotly draws it."""
        return f"{label(self.title)} [{label(self.unit)}]"


def components_of(rows: DrawnRows, *, whitened: bool = False) -> list[ResidualPanel]:
    """Return a panel for each component of a residual."""
    units = [DEVIATIONS] * rows.components if whitened else rows.units
    values_of = [rows.every(fit, whitened=whitened)[rows.chosen] for _, fit in rows.sides]
    return [
        ResidualPanel(name, unit, tuple(r[:, c] for r in values_of))
        for c, (name, unit) in enumerate(zip(rows.names, units, strict=True))
    ]


def reading_of(rows: DrawnRows, joint: int) -> list[ResidualPanel]:
    """Return the error of a joint's reading that would explain each residual best, and the size of what is across.

    Nothing where the joint does not move what is measured.
    """
    along = [rows.along_reading(fit, joint) for _, fit in rows.sides]
    if not np.isfinite(along[0][0][~rows.bad]).any():
        return []
    name = plain(rows.base.machine.joints[joint].name, 12)
    return [
        ResidualPanel(f"reading of {name}", along[0][1], tuple(one[0] for one in along)),
        ResidualPanel("across its motion", rows.shown.unit, tuple(one[2] for one in along), size=True),
    ]


def _panels(rows: DrawnRows, joint: int | None, parts: str, whitened: bool) -> list[ResidualPanel]:
    if joint is not None:
        return reading_of(rows, joint) or components_of(rows, whitened=whitened)
    if parts == "apart":
        return components_of(rows, whitened=whitened)
    panels = [
        rows.every(fit, whitened=True)[rows.chosen] if whitened else rows.residuals(fit)
        for _, fit in rows.sides
    ]
    unit = DEVIATIONS if whitened else rows.shown.unit
    sizes = tuple(np.linalg.norm(r, axis=1) for r in panels)
    return [ResidualPanel("size of the residual", unit, sizes, size=True)]


def residuals_over(
    rows: DrawnRows,
    driver: Driver,
    panels: Sequence[ResidualPanel],
    *,
    approach: NDArray[np.int8] | None = None,
    colour: Driver | None = None,
    selected: Collection[int] = (),
    aside: Collection[int] = (),
    planned: PlannedRows | None = None,
    remarks: Sequence[str] = (),
    called: str = "",
    least: Sequence[float] = (),
) -> go.Figure:
    """Return panels of residuals over one of ``rows.drivers``, before and after in the same axes.

    Parameters
    ----------
    rows : DrawnRows
    driver : Driver
        Of the rows that are drawn.
    panels : sequence of ResidualPanel
    approach : ndarray of int, shape (chosen,), optional
        Direction of approach, which differs by the marks.
    colour : Driver, optional
        Of the rows that are drawn.
    selected, aside : collection of int
        Rows that are marked.
    planned : PlannedRows, optional
        Which are marked at the lower edge.
    remarks : sequence of str
        Sentences of the note.
    called : str
        The name of the figure's files.
    least : sequence of float
        The end of the y axis of each panel, at least.
    """
    height = SEVERAL if len(panels) > 1 else SINGLE
    below = label(plain(driver.label))
    figure = column([Panel(panel.heading, height, below * (panel is panels[-1])) for panel in panels])
    x, side = _along(rows, driver), rows.sides[-1][0]
    marks = Marks(rows, approach, colour, aside)
    ahead = None if planned is None else planned.along(driver)
    chosen, beyond = np.isin(rows.chosen, np.asarray([*selected], np.intp)), False
    for number, panel in enumerate(panels):
        good = np.concatenate([values[~marks.out] for values in panel.values])
        limit = max([_limit(good), *least[number : number + 1]])
        known_from_tip = driver.kind in {"joint", "order", "approach"} or bool(driver.categories)
        end = "" if known_from_tip else f"<br>{label(plain(driver.name))}: %{{x:.6g}}"
        for (name, fit), values in zip(rows.sides, panel.values, strict=True):
            for words, at, mark in marks.groups(name, np.isfinite(values)):
                legend = (
                    f"{words}: rms {rows.shown(fit.rms)} {label(rows.shown.unit)}" if words == name else words
                )
                add_rows(
                    figure, number, legend, rows, at, x[name], values, mark, f"{panel.unit}, {name}{end}"
                )
        beyond |= bool(np.any(np.abs(panel.values[-1]) > limit))
        last = np.clip(panel.values[-1], -0.95 * limit, 0.95 * limit)
        known = np.isfinite(last)
        for words, of, mark in marks.apart(chosen):
            at = np.flatnonzero(of & known)
            if len(at):
                add_rows(figure, number, words, rows, at, x[side], last, mark, panel.unit, panel.values[-1])
        if driver.in_time:
            _in_time(figure, number, rows, x[side], panel.values[-1], marks.out)
        low = -0.05 * limit if panel.size else -limit
        if planned is not None and ahead is not None:
            planned.mark(figure, number, ahead, np.full(len(ahead), low + EDGE * (limit - low)))
        figure.update_layout({f"yaxis{number + 1}": {"range": [low, limit], "zeroline": True}})
    if marks.bar:
        figure.update_layout(coloraxis=marks.bar)
    _scale(figure, len(panels), driver, x[side] if ahead is None else np.concatenate([x[side], ahead]))
    sizes = ", ".join(f"{name} {rows.shown(fit.rms)} {rows.shown.unit}" for name, fit in rows.sides)
    note = [*(remarks or ["Measured minus predicted."]), rows.thinned]
    if driver.in_time:
        note.append(_runs(rows))
    if beyond:
        note.append("What is left out and beyond the axis is drawn at its edge.")
    if ahead is not None:
        note.append(AT_EDGE)
    return describe(
        figure,
        called or f"residuals_by_{file_name(driver.name)}",
        f"Residuals against {plain(driver.text)}",
        note=" ".join(filter(None, note)),
        alt=f"Measured minus predicted against {plain(driver.text)}; rms {sizes}.",
    )


class Marks:
    """How marks differ: by side, direction of approach, and a column that colours them."""

    def __init__(
        self,
        rows: DrawnRows,
        approach: NDArray[np.int8] | None,
        colour: Driver | None,
        aside: Collection[int],
    ) -> None:
        self.approach, self.colour = approach, colour
        self.aside = np.isin(rows.chosen, np.asarray([*aside], np.intp))
        self.out = rows.bad | self.aside
        self.size = mark_size(len(rows.chosen))
        self.by_number = colour is not None and not colour.categories and colour.kind != "approach"

    @cached_property
    def bar(self) -> dict[str, Any] | None:
        """The axis of colours."""
        if self.colour is None or not self.by_number:
            return None
        title = {"text": label(plain(self.colour.label)), "side": "right", "font": {"size": 12}}
        return {
            "colorscale": "Cividis",
            "colorbar": {
                "title": title,
                "thickness": 10,
                "outlinewidth": 0,
                "tickfont": {"size": 11},
                "nticks": 5,
            },
        }

    def apart(self, chosen: NDArray[np.bool_]) -> list[tuple[str, NDArray[np.bool_], dict[str, Any]]]:
        """Return what rows that are left out, excluded or selected are called, which they are, and their marks."""
        return [
            ("outlier, left out", self.out & ~self.aside, OUTLIER),
            ("excluded", self.aside, ASIDE),
            ("selected", chosen, SELECTED),
        ]

    def groups(self, name: str, known: NDArray[np.bool_]) -> Iterator[tuple[str, Index, dict[str, Any]]]:
        """Yield the rows that have one kind of mark: what a legend calls them, which they are, and the mark."""
        filled, colour = "-open" * (name != "after"), SIDES[name]["color"]
        for words, of, mark in self._shapes(name, filled, colour):
            at = np.flatnonzero(of & known & ~self.out)
            mark = {"size": self.size, "opacity": 1, **mark}
            if self.by_number and self.colour is not None:
                mark |= {"color": np.asarray(self.colour.noted, float)[at], "coloraxis": "coloraxis"}
            yield words, at, mark

    def _shapes(
        self, name: str, filled: str, colour: str
    ) -> Iterator[tuple[str, NDArray[np.bool_], dict[str, Any]]]:
        if self.colour is not None and not self.by_number:
            values, names = self.colour.values, _categories(self.colour)
            for place, (code, words) in enumerate(names.items()):
                symbol, group_colour = GROUPS[min(place, MOST_GROUPS - 1)]
                of = values == code
                if place == MOST_GROUPS - 1 and len(names) > MOST_GROUPS:
                    words, of = "others", np.isin(values, [*names][place:])
                yield f"{name}, {label(words)}", of, {"symbol": symbol + filled, "color": group_colour}
                if words == "others":
                    return
        elif self.approach is not None:
            shapes = {1: "triangle-right", -1: "triangle-left", 0: "circle"}
            for sign, symbol in shapes.items():
                if sign or not self.approach.all():
                    mark = {"symbol": symbol + filled, "color": colour, "size": 1.2 * self.size}
                    yield f"{name}, {DIRECTIONS[sign]}", self.approach == sign, mark
        else:
            yield name, np.ones(len(self.out), bool), {"symbol": f"circle{filled}", "color": colour}


def _categories(driver: Driver) -> dict[int, str]:
    """Return the categories of a driver that occur, with their names."""
    there = np.unique(driver.values).astype(int).tolist()
    if driver.kind == "approach":
        return {code: DIRECTIONS[code] for code in there}
    return {code: plain(driver.categories[code], 16) for code in there}


def add_rows(
    figure: go.Figure,
    number: int,
    name: str,
    rows: DrawnRows,
    at: Index,
    x: Array,
    y: Array,
    mark: dict[str, Any],
    hover: str,
    said: Array | None = None,
) -> None:
    """Add marks of some rows; `said` is what the hover text says where y is drawn elsewhere."""
    if rows.brief:
        x, y = np.asarray(x, np.float32), np.asarray(y, np.float32)
    value = "%{y:.4g}" if said is None else "%{text:.4g}"
    by_number = "coloraxis" in mark
    if by_number and number == 0:  # a legend has no colour for a scale
        plain_mark = {key: mark[key] for key in ("symbol", "size")} | {"color": INK}
        add_trace(figure, number, name, x=[None], y=[None], mode="markers", marker=plain_mark)
    add_trace(
        figure, number, name, x=x[at], y=y[at], mode="markers", marker=mark, customdata=rows.chosen[at],
        hovertext=[rows.tips[i] for i in at], hovertemplate=f"%{{hovertext}}<br>{value} {hover}<extra></extra>",
        text=None if said is None else said[at], showlegend=number == 0 and not by_number,
    )  # fmt: skip


def _along(rows: DrawnRows, driver: Driver) -> dict[str, Array]:
    """Return where rows of each side stand along the x axis; those of a category are spread, so that all are seen."""
    x = np.asarray(driver.noted, float)
    if not driver.categories and driver.kind != "approach":
        return {name: x for name, _ in rows.sides}
    middle = (len(rows.sides) - 1) / 2
    spread = (rows.chosen * 0.6180339887) % 1 - 0.5
    return {name: x + JITTER * (spread + 1.1 * (i - middle)) for i, (name, _) in enumerate(rows.sides)}


def _scale(figure: go.Figure, panels: int, driver: Driver, x: Array) -> None:
    """Give the x axes names of categories, or round numbers of degrees."""
    keys: dict[str, Any] = {}
    known = x[np.isfinite(x)]
    span = float(np.ptp(known)) if len(known) else 0.0
    if driver.categories:
        names = [label(plain(name, 10)) for name in driver.categories]
        keys = {"tickvals": list(range(len(names))), "ticktext": names, "range": [-0.6, len(names) - 0.4]}
    elif driver.kind == "approach":
        there = _categories(driver)
        keys = {"tickvals": [*there], "ticktext": [*there.values()], "range": [-1.5, 1.5]}
    elif driver.unit == "deg" and span >= 5:
        keys = {"dtick": next((step for step in ANGLES if span / step <= 6), span / 6)}
    figure.update_layout({f"xaxis{number + 1}": keys for number in range(panels)})


def _in_time(
    figure: go.Figure, number: int, rows: DrawnRows, x: Array, y: Array, out: NDArray[np.bool_]
) -> None:
    """Add the mean of neighbours, and lines between runs."""
    even = np.flatnonzero(rows.even & ~out & np.isfinite(y))
    even = even[np.argsort(x[even], kind="stable")]
    pieces = [part for part in np.array_split(even, min(PIECES, max(len(even) // 4, 1))) if len(part)]
    add_trace(
        figure, number, "mean of neighbours", x=[x[part].mean() for part in pieces],
        y=[y[part].mean() for part in pieces], mode="lines", line=MEAN,
    )  # fmt: skip
    starts = np.flatnonzero(np.diff(rows.o.run)) + 1
    if len(starts) < MOST_RUNS:
        for start in starts:
            middle = (x[start] + x[start - 1]) / 2
            figure.add_shape(
                type="line", x0=middle, x1=middle, y0=0, y1=1, line={"color": GREY, "width": 1, "dash": "dash"},
                xref=axes(number)["xaxis"], yref=f"{axes(number)['yaxis']} domain",
            )  # fmt: skip


def _runs(rows: DrawnRows) -> str:
    """Return a sentence on the lines between runs."""
    o = rows.base.observations
    starts = np.flatnonzero(np.diff(o.run)) + 1
    if not 0 < len(starts) < MOST_RUNS:
        return ""
    named = ", ".join(f"{plain(o.run_names[int(o.run[s])], 16)} from {o.data.place(s)}" for s in (0, *starts))
    return f"Dashed lines separate the runs: {named}."


def _limit(y: Array) -> float:
    known = np.abs(y[np.isfinite(y)])
    return float(known.max(initial=0.0)) * MARGIN or 1.0


def file_name(name: str) -> str:
    """Return what stands for a name in the name of a file."""
    return re.sub(r"[^A-Za-z0-9]", "_", name)[:40].strip("_") or "column"
