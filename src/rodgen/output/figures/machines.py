"""The skeleton of a machine in space: its axes and targets at zero, with readings or residuals where they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from rodgen.array_types import Array
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.attitudes import nearest_frame
from rodgen.machines.model import Frame, Model
from rodgen.output.figures.drawn_rows import DrawnRows, planned_rows
from rodgen.output.figures.maps import in_machine_axes, round_size
from rodgen.output.figures.residuals import SIDES
from rodgen.output.figures.style import (
    BLUE,
    GREY,
    INK,
    LINE,
    ORANGE,
    PURPLE,
    Panel,
    column,
    describe,
    evenly,
    label,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from rodgen.calibration.fitted import Fit
    from rodgen.calibration.plan import Plan
    from rodgen.machines.machine import Joint, Machine
    from rodgen.machines.observations import Observations


HEIGHT = 560
MOST_READINGS, MOST_VECTORS = 200, 300
ROOM, CORNER, NUMBERS = 0.05, 0.12, 4
"""Room around all, as a share of its size; part of an axis, at each end, without numbers; how many there are."""
SHARE = 0.08
"""Length of the line of a residual of one rms, as a share of the size of all."""


def skeleton(machine: Machine, observations: Observations | None = None) -> go.Figure:
    """Return a figure of the axes of a chain of joints, its targets, and its first readings.

    Parameters
    ----------
    machine : Machine
        Of a closed chain only the readings are drawn.
    observations : Observations, optional
        Readings in a free frame are moved to where the machine, as the file has it, sees its targets; distances are not
        drawn.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    seen = _seen(machine, observations) if observations is not None else None
    figure, _ = _bones(machine, () if seen is None else seen[0], named=True)
    if seen is not None:
        for marked, name, width, colour, symbol in (
            (seen[0], "where the file sees them", 4, GREY, "circle-open"),
            (seen[1], "readings", 3, PURPLE, "diamond"),
        ):
            marker = {"size": width, "color": colour, "symbol": symbol}
            _add(figure, marked, name, mode="markers", marker=marker)
    note = "Axes and targets with all joints at zero."
    if observations is not None and observations.n > MOST_READINGS:
        note += f" The first {MOST_READINGS} readings."
    if seen is not None and machine.measured.frame == "free":
        note += " The readings are moved to where they fit best: their frame is free."
    _look_at(figure, machine)
    return describe(figure, "skeleton", machine.name, note=note)


def residual_vectors(
    fit: Fit,
    *,
    before: Fit | None = None,
    exaggeration: float = 0.0,
    selected: Collection[int] = (),
    planned: Plan | None = None,
    most: int = MOST_VECTORS,
) -> go.Figure | None:
    """Return residuals as lines in space, from where they were measured, with the machine's axes.

    Those of directions start on a sphere around the machine. The ``customdata`` of every line's start is the number of
    its row, from 0. None where residuals are no vectors: of distances, angles and attitudes.

    Parameters
    ----------
    fit, before, exaggeration, selected, planned, most
        As of :func:`residual_map`, with lines for its arrows.
    """
    machine, measurand = fit.machine, fit.machine.measurand
    if not measurand.is_place or not (measurand.moving or measurand.is_direction):
        return None
    rows = DrawnRows(before or fit, None if before is None else fit, kept=selected)
    known = ~rows.bad & np.isfinite(rows.places).all(axis=1)
    chosen = known & np.isin(rows.chosen, np.asarray([*selected], np.intp))
    some = np.union1d(evenly(np.flatnonzero(known), most), np.flatnonzero(chosen))
    vectors_of = [(name, _vectors(rows, of)[some]) for name, of in rows.sides]
    start = rows.places[some]
    ahead = planned_rows(fit, planned)
    figure, size = _bones(machine, start if ahead is None else np.concatenate([start, ahead.places]))
    rms = float(np.sqrt(np.mean(np.sum(vectors_of[0][1] ** 2, axis=1)))) or 1.0
    times = exaggeration or round_size(SHARE * size / rms)[1]
    figure.update_layout(meta={**(figure.layout.meta or {}), "exaggeration": times})
    for name, vectors in vectors_of:
        ends = np.full((len(some), 3, 3), np.nan)
        ends[:, 0], ends[:, 1] = start, start + times * vectors
        hover = [text for tip in rows.tips_with_residuals(some) for text in (tip, "", "")]
        _add(
            figure, ends.reshape(-1, 3), name, mode="lines+markers", line={"color": SIDES[name]["color"], "width": 4},
            marker={"size": [4, 0, 0] * len(some), "color": SIDES[name]["color"]}, hovertext=hover, hoverinfo="text",
            customdata=np.repeat(rows.chosen[some], 3),
        )  # fmt: skip
    if chosen.any():
        at = np.flatnonzero(chosen)
        mark = {"size": 9, "color": PURPLE, "symbol": "circle-open"}
        _add(figure, rows.places[at], "selected", mode="markers", marker=mark, customdata=rows.chosen[at])
    if ahead is not None:
        mark = {"size": 5, "color": BLUE, "symbol": "diamond-open"}
        _add(
            figure,
            ahead.places,
            "planned",
            mode="markers",
            marker=mark,
            hovertext=ahead.tips,
            hoverinfo="text",
        )
    note = [
        "Measured minus predicted, in machine axes; axes and targets with all joints at zero.",
        f"Lines are {times:,.6g} times as long as the residuals.",
    ]
    if len(some) < rows.total - int(rows.outlier.sum()):
        note.append(f"{len(some)} of {rows.total} rows are drawn.")
    _look_at(figure, machine)
    return describe(figure, "residual_vectors", "Residuals in space", note=" ".join(note))


def _vectors(rows: DrawnRows, fit: Fit) -> Array:
    """Return the residuals as vectors in machine axes, (chosen, 3): in the unit of length, or radians of directions."""
    r = np.asarray(fit.residuals[rows.chosen]) * fit.unit_factor
    if fit.machine.measurand.is_direction:
        r = np.einsum("nk,kni->ni", r, np.array(rows.o.basis))
    return in_machine_axes(rows.base, r)


def _bones(machine: Machine, seen: Any, *, named: bool = False) -> tuple[go.Figure, float]:
    """Return a figure of the axes of a machine and its targets, with room for points (n, 3), and its size."""
    figure = column([Panel("", HEIGHT, " ")], legend=True)
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False)
    places = [np.array(target.point) for target in machine.targets]
    joints = () if machine.kinematics.is_closed else machine.joints
    moving = machine.measurand.moving
    points = [np.array(joint.point) if moving else np.zeros(3) for joint in joints]
    cloud = np.array([np.zeros(3), *points, *places, *seen])
    size = float(np.ptp(cloud, axis=0).max()) or 1.0
    if moving and joints:
        way = np.array([np.zeros(3), *points, places[0]])
        _add(figure, way, "body, all joints at zero", mode="lines", line={"color": GREY, "width": 6})
    ends = _axis_ends(joints, points, size / 5)
    for kind, colour, dash in (("revolute", BLUE, "solid"), ("prismatic", ORANGE, "dash")):
        chosen = [(joint, end) for joint, end in zip(joints, ends, strict=True) if joint.type == kind]
        if chosen:
            _add_axes(figure, chosen, f"{kind} axes, positive towards the name", colour, dash)
    names = [label(target.name) for target in machine.targets]
    _add(
        figure, np.array(places), "targets at zero", mode="markers+text" if named else "markers", text=names,
        textposition="bottom center", marker={"size": 5, "color": INK, "symbol": "square"},
    )  # fmt: skip
    figure.update_layout(meta={"heights": None})
    return figure, size


def _look_at(figure: go.Figure, machine: Machine) -> None:
    """Show all that was drawn, with few numbers at the axes, none of them where two axes meet."""
    traces = [np.array([t.x, t.y, t.z], float) for t in figure.data if isinstance(t, go.Scatter3d)]
    cloud = np.concatenate(traces, axis=1)
    low, high = np.nanmin(cloud, axis=1), np.nanmax(cloud, axis=1)
    size = float(np.max(high - low)) or 1.0
    low, high = low - ROOM * size, high + ROOM * size
    step = round_size(size / NUMBERS)[1]
    scene: dict[str, Any] = {
        "aspectmode": "data",
        "camera": {"eye": {"x": 1.22, "y": -1.4, "z": 0.7}, "center": {"x": 0.0, "y": 0.0, "z": -0.1}},
        "domain": {"x": [0, 1], "y": [0, 1]},
    }
    for k, name in enumerate("xyz"):
        corner = CORNER * (high[k] - low[k])
        first, last = np.ceil((low[k] + corner) / step), np.floor((high[k] - corner) / step)
        scene[f"{name}axis"] = {
            "showbackground": False,
            "zerolinecolor": GREY,
            "gridcolor": LINE,
            "range": [low[k], high[k]],
            "tickvals": (step * np.arange(first, last + 1)).tolist(),
            "tickfont": {"size": 11},
            "title": {"text": f"{name}, {machine.length_unit}" if machine.measurand.moving else name},
        }
    figure.update_layout(scene=scene)


def _add(figure: go.Figure, points: Array, name: str, **given: Any) -> None:
    x, y, z = points.T
    figure.add_trace(go.Scatter3d(x=x, y=y, z=z, name=name, **{"hoverinfo": "skip", **given}))


def _axis_ends(joints: Sequence[Joint], points: Sequence[Array], length: float) -> list[tuple[Array, Array]]:
    """Return the ends of the line along each axis, the later ones longer where others end, for their names."""
    ends: list[tuple[Array, Array]] = []
    for joint, at in zip(joints, points, strict=True):
        way = length * np.array(joint.axis)
        while any(np.linalg.norm(at + way - high) < length / 10 for _, high in ends):
            way = way * 1.3
        ends.append((at - way, at + way))
    return ends


def _add_axes(
    figure: go.Figure, chosen: list[tuple[Joint, tuple[Array, Array]]], name: str, colour: str, dash: str
) -> None:
    """Add a line along each axis, with the joint's name at its positive end."""
    gap = np.full(3, np.nan)
    way = np.array([point for _, (low, high) in chosen for point in (low, high, gap)])
    text = [word for joint, _ in chosen for word in ("", label(joint.name), "")]
    _add(
        figure, way, name, mode="lines+text", text=text, textfont={"color": colour, "size": 14},
        line={"color": colour, "width": 5, "dash": dash},
    )  # fmt: skip


def _seen(machine: Machine, observations: Observations) -> tuple[Array, Array] | None:
    """Return where the machine of the file sees its targets, and the readings, both (n, 3) in machine axes."""
    if not machine.measurand.is_place:
        return None
    first = observations.take(np.arange(min(MOST_READINGS, observations.n)))
    model = Model(machine, first.travel, first.run_names, compiled=False)
    predicted = Problem(model, first).places(model.start(), Frame.identity())
    measured = np.array(first.reading[:, :3])
    whole = np.isfinite(measured).all(axis=1) & np.isfinite(predicted).all(axis=1)
    predicted, measured = predicted[whole], measured[whole]
    if machine.measured.frame == "free" and len(measured) > 2:
        moving = machine.measurand.moving
        frame = nearest_frame(predicted, measured, np.ones(len(measured)), moving=moving)
        measured = (measured - frame.position) @ frame.rotation
    return predicted, measured
