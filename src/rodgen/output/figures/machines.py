"""The skeleton of a machine in space: its axes and targets at zero, and where its first readings are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.nearest_frame import nearest_frame
from rodgen.machines.model import Frame, Model
from rodgen.output.figures.style import BLUE, GREY, INK, ORANGE, PURPLE, Panel, column, describe, label

if TYPE_CHECKING:
    from rodgen.data.observations import Observations
    from rodgen.machines.machine import Machine

__all__ = ["skeleton"]

Array = NDArray[np.float64]

HEIGHT = 560
MOST_READINGS = 200


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
    figure = column([Panel("", HEIGHT, " ")], legend=True)
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False)
    seen = _seen(machine, observations) if observations is not None else None
    places = [np.array(target.point) for target in machine.targets]
    joints = () if machine.kinematics.is_closed else machine.joints
    moving = machine.measurand.moving
    points = [np.array(joint.point) if moving else np.zeros(3) for joint in joints]
    cloud = np.array([np.zeros(3), *points, *places, *([] if seen is None else seen[0])])
    size = float(np.ptp(cloud, axis=0).max()) or 1.0
    if moving and joints:
        way = np.array([np.zeros(3), *points, places[0]])
        _add(figure, way, "body, all joints at zero", mode="lines", line={"color": GREY, "width": 6})
    for kind, colour, dash in (("revolute", BLUE, "solid"), ("prismatic", ORANGE, "dash")):
        chosen = [(joint, at) for joint, at in zip(joints, points, strict=True) if joint.type == kind]
        if chosen:
            _add_axes(figure, chosen, size / 5, f"{kind} axes, positive towards the name", colour, dash)
    names = [label(target.name) for target in machine.targets]
    _add(
        figure, np.array(places), "targets at zero", mode="markers+text", text=names, textposition="bottom center",
        marker={"size": 5, "color": INK, "symbol": "square"},
    )  # fmt: skip
    if seen is not None:
        for marked, name, width, colour, symbol in (
            (seen[0], "where the file sees them", 4, GREY, "circle-open"),
            (seen[1], "readings", 3, PURPLE, "diamond"),
        ):
            marker = {"size": width, "color": colour, "symbol": symbol}
            _add(figure, marked, name, mode="markers", marker=marker)
    figure.update_layout(scene=_scene(f", {machine.length_unit}" if moving else ""), meta={"heights": None})
    note = "Axes and targets with all joints at zero."
    if observations is not None and observations.n > MOST_READINGS:
        note += f" The first {MOST_READINGS} readings."
    if seen is not None and machine.measured.frame == "free":
        note += " The readings are moved to where they fit best: their frame is free."
    return describe(figure, "skeleton", machine.name, note=note)


def _scene(unit: str) -> dict[str, Any]:
    """Return how the space looks, with the unit behind the names of its axes."""
    axis = {"showbackground": False, "zerolinecolor": GREY}
    return {
        "aspectmode": "data",
        "camera": {"eye": {"x": 1.5, "y": -1.7, "z": 0.9}},
        "domain": {"x": [0, 1], "y": [0, 1]},
        **{f"{x}axis": {**axis, "title": {"text": f"{x}{unit}"}} for x in "xyz"},
    }


def _add(figure: go.Figure, points: Array, name: str, **given: Any) -> None:
    x, y, z = points.T
    figure.add_trace(go.Scatter3d(x=x, y=y, z=z, name=name, hoverinfo="skip", **given))


def _add_axes(
    figure: go.Figure, chosen: list[tuple[Any, Array]], length: float, name: str, colour: str, dash: str
) -> None:
    """Add a line along each axis, with the joint's name at its positive end."""
    ends = [(at - length * np.array(joint.axis), at + length * np.array(joint.axis)) for joint, at in chosen]
    gap = np.full(3, np.nan)
    way = np.array([point for low, high in ends for point in (low, high, gap)])
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
