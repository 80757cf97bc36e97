"""The residuals around a joint that goes round, as a ball bar or a spindle analyser draws them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from rodgen.array_types import Array
from rodgen.calibration.reading_motion import directions_about
from rodgen.calibration.words import plain
from rodgen.errors import RodgenError, joined
from rodgen.machines.drivers import goes_round
from rodgen.output.figures.drawn_rows import MOST_MARKS, DrawnRows, PlannedRows, planned_rows
from rodgen.output.figures.residuals import Marks, ResidualPanel, add_rows, components_of, file_name
from rodgen.output.figures.style import (
    GREY,
    LINE,
    PAPER,
    SOFT,
    Panel,
    column,
    describe,
    label,
    ring,
)

if TYPE_CHECKING:
    from collections.abc import Collection

    from rodgen.calibration.fitted import Fit
    from rodgen.calibration.plan import Plan

PANEL = 460
"""Height, in pixels."""
HALF = 0.5
"""Distance of the rings of the largest and the smallest number from that of zero, whose radius is 1."""
PLANES = ("xy", "yz", "zx")
FLAT, ARC = 0.02, 24
"""Part of the distance that a place may be off a plane, and readings in it from which it is drawn."""
ROOM, OUTSIDE = 1.9, 1.72
"""From the middle to the edge, and to the numbers of the angle."""


def joints_that_go_round(fit: Fit) -> list[str]:
    """Return the names of the revolute joints whose readings lie all around the circle.

    Of distances also the planes, ``"xy"``, ``"yz"``, ``"zx"``, in which a ball bar swept an arc around its centre.
    """
    o = fit.observations
    pairs = zip(fit.machine.joints, o.q.T, strict=True)
    names = [joint.name for joint, q in pairs if joint.revolute and goes_round(q)]
    if fit.machine.measured.origin is not None:
        places = fit.places(o)
        names += [plane for plane in PLANES if np.sum(np.isfinite(_in_plane(fit, places, plane))) >= ARC]
    return names


def _in_plane(fit: Fit, places: Array, plane: str) -> Array:
    """Return the angle of places about the centre of distances, (n,), radians; NaN of those off the plane."""
    arm = places - np.array(fit.machine.measured.origin)
    a, b = ("xyz".index(x) for x in plane)
    flat = np.abs(arm[:, 3 - a - b]) < FLAT * np.linalg.norm(arm, axis=1)
    return np.where(flat, np.arctan2(arm[:, b], arm[:, a]), np.nan)


def polar_plot(
    fit: Fit,
    joint: str,
    *,
    before: Fit | None = None,
    selected: Collection[int] = (),
    aside: Collection[int] = (),
    planned: Plan | None = None,
    most: int = MOST_MARKS,
) -> go.Figure:
    """Return residuals around a revolute joint, away from a circle that stands for zero.

    Those of points are split into a part away from the joint's axis (radial), one ahead with its reading (tangential),
    and one along it (axial); those of directions and distances are as they are. Directions of approach differ by marks.
    The ``customdata`` of every mark is the number of its row, from 0.

    Parameters
    ----------
    fit : Fit
    joint : str
        One of `joints_that_go_round`, or another revolute joint. In a plane distances are drawn in their directions.
    before : Fit, optional
        Another model of the same observations, whose residuals are drawn, too.
    selected, aside : collection of int, optional
        Rows that are marked.
    planned : Plan, optional
        Whose readings are marked at the inner circle.
    most : int, optional
        Marks of the figure, from which large data are thinned; its note then says so.

    Raises
    ------
    RodgenError
        When there is no such revolute joint or plane.
    """
    rows = DrawnRows(before or fit, None if before is None else fit, kept=[*selected, *aside], most=most)
    return polar_of(rows, joint, selected=selected, aside=aside, planned=planned_rows(fit, planned))


def polar_of(
    rows: DrawnRows,
    joint: str,
    *,
    selected: Collection[int] = (),
    aside: Collection[int] = (),
    planned: PlannedRows | None = None,
) -> go.Figure:
    """Return the figure of `polar_plot` of rows that are drawn."""
    machine, o = rows.base.machine, rows.o
    revolute = [one.name for one in machine.joints if one.revolute]
    around = f"the reading of {plain(joint)}"
    if joint not in revolute and joint in PLANES and machine.measured.origin is not None:
        angle, approach = _in_plane(rows.base, rows.places, joint), None
        panels = [
            replace(p, values=tuple(np.where(np.isfinite(angle), v, np.nan) for v in p.values))
            for p in components_of(rows)
        ]
        around = f"the direction in the plane {joint}, from {joint[0]} towards {joint[1]}"
    elif joint in revolute:
        j = [one.name for one in machine.joints].index(joint)
        of_points = machine.measurand.is_place and machine.measurand.moving
        panels = _about(rows, j) if of_points else components_of(rows)
        approach = o.s[:, j] if rows.base.observations.approach_known[j] else None
        angle = o.q[:, j]
    else:
        raise RodgenError(f"{joint!r} is no revolute joint: {joined(revolute) or 'there is none'}")
    figure = column([Panel(panel.heading, PANEL, " ", equal=True) for panel in panels])
    marks = Marks(rows, approach, None, aside)
    chosen = np.isin(rows.chosen, np.asarray([*selected], np.intp))
    for number, panel in enumerate(panels):
        inside = np.concatenate([np.abs(values[~marks.out]) for values in panel.values])
        limit = _round_up(float(np.nanmax(inside, initial=0.0)))
        _rings(figure, number, limit, panel.unit)
        hover = f"{label(panel.unit)}, "
        for (name, _), values in zip(rows.sides, panel.values, strict=True):
            x, y = _around(angle, values, limit)
            for words, at, mark in marks.groups(name, np.isfinite(values)):
                add_rows(figure, number, words, rows, at, x, y, mark, hover + name, values)
        x, y = _around(angle, np.clip(panel.values[-1], -1.2 * limit, 1.2 * limit), limit)
        for words, of, mark in marks.apart(chosen):
            at = np.flatnonzero(of & np.isfinite(panel.values[-1]))
            if len(at):
                add_rows(
                    figure, number, words, rows, at, x, y, mark, hover + rows.sides[-1][0], panel.values[-1]
                )
        if planned is not None and joint in revolute:
            ahead = planned.o.q[:, [one.name for one in machine.joints].index(joint)]
            planned.mark(figure, number, *_around(ahead, np.full(planned.o.n, -limit), limit))
        hidden = {"range": [-ROOM, ROOM], "visible": False}
        figure.update_layout({f"xaxis{number + 1}": hidden, f"yaxis{number + 1}": hidden})
    note = [
        "Measured minus predicted.",
        f"The middle circle is zero, the angle {around}.",
        rows.thinned,
    ]
    return describe(
        figure,
        f"around_{file_name(joint)}",
        f"Residuals {'around' if joint in revolute else 'in the plane'} {plain(joint)}",
        note=" ".join(filter(None, note)),
    )


def _about(rows: DrawnRows, joint: int) -> list[ResidualPanel]:
    """Return a panel for the radial, the tangential and the axial part of residuals of points."""
    along = directions_about(rows.base, rows.o, joint)
    along_axis = [np.einsum("nij,nj->ni", along, rows.residuals(fit)[:, :3]) for _, fit in rows.sides]
    words = ("radial, away from the axis", "tangential, ahead", "axial, along the axis")
    return [
        ResidualPanel(w, rows.shown.unit, tuple(r[:, k] for r in along_axis)) for k, w in enumerate(words)
    ]


def _around(angle: Array, values: Array, limit: float) -> tuple[Array, Array]:
    radius = 1 + HALF * values / limit
    return radius * np.cos(angle), radius * np.sin(angle)


def _rings(figure: go.Figure, number: int, limit: float, unit: str) -> None:
    """Add the circles of zero and of the limits, with their numbers, and the angles outside."""
    axes = {"xaxis": f"x{number + 1}" if number else "x", "yaxis": f"y{number + 1}" if number else "y"}
    refs = {"xref": axes["xaxis"], "yref": axes["yaxis"]}
    for sign, text in ((-1, f"−{limit:g}"), (0, ""), (1, f"+{limit:g} {label(unit)}")):
        line, words = ring(1 + sign * HALF, text, bool(text) * (0.1 + 0.055 * len(text)), at=67.5)
        if sign == 0:
            line["line"] = {"color": GREY, "width": 1.3}
        figure.add_trace(go.Scatter(**line, **axes))
        if text:
            figure.add_annotation(**words, bgcolor=PAPER, borderpad=0, **refs)
    for degrees in range(0, 360, 30):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        inner, outer = 1 - HALF, 1 + HALF
        figure.add_shape(
            type="line", x0=inner * c, y0=inner * s, x1=outer * c, y1=outer * s, line={"color": LINE, "width": 1},
            layer="below", **refs,
        )  # fmt: skip
        if degrees % 90 == 0:
            figure.add_annotation(
                x=OUTSIDE * c, y=OUTSIDE * s, text=f"{degrees}°", showarrow=False, font={"size": 12, "color": SOFT},
                **refs,
            )  # fmt: skip


def _round_up(size: float) -> float:
    """Return a round number that is no smaller."""
    if size <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(size))
    return (
        next(step for step in (1.0, 1.5, 2.0, 3.0, 5.0, 7.5, 10.0) if step * power >= size * (1 - 1e-9))
        * power
    )
