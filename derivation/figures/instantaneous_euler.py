"""Instantaneous Euler angles: along curves, at the tool of an arm, and all that are possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from rodgen.derivation.figures import BLUE, GREEN, ORANGE

SIZES = (0.4, 0.5, 0.45, 0.15)
"""Of the arm that is drawn: d1, a2, a3, d6."""


def curves(
    parameter: np.ndarray,
    label: str,
    conventional: Sequence[np.ndarray],
    instantaneous: Sequence[np.ndarray],
    colour: str,
    title: str,
) -> go.Figure:
    """Return conventional angles in blue and instantaneous ones in the paper's colour, a panel for each axis.

    Parameters
    ----------
    parameter : ndarray, shape (n,)
        Of the curve.
    label : str
        Of the parameter.
    conventional, instantaneous : three ndarray, shape (n,)
        Angles, rad.
    colour, title : str
        Of the instantaneous angles, and of the figure.
    """
    figure = make_subplots(1, 3, shared_yaxes=True)
    for column, (angle, chi) in enumerate(zip(conventional, instantaneous, strict=True), 1):
        names = "αβγ"[column - 1], f"χ<sub>{'xyz'[column - 1]}</sub>"
        for values, line, name in zip((angle, chi), (BLUE, colour), names, strict=True):
            trace = go.Scatter(x=parameter, y=np.degrees(values), line_color=line, name=name)
            figure.add_trace(trace, 1, column)
    figure.update_xaxes(title=label).update_yaxes(title="degrees", col=1)
    return figure.update_layout(title=title, width=1050, height=340)


def postures(where: Callable[[Sequence[float]], Sequence[np.ndarray]]) -> go.Figure:
    """Return four postures of the arm, with the tool's axes and, dotted, the ridge of each.

    Parameters
    ----------
    where : callable
        The tool's rotation and point, and the wrist, from six joints of an arm with `SIZES`.
    """
    values = (0.0, np.pi / 3, np.pi / 2, np.pi)
    titles = [f"x = {value:.2f}" for value in values]
    figure = make_subplots(1, 4, specs=[[{"type": "scene"}] * 4], subplot_titles=titles)

    def line(points, column, **style):
        coordinates = dict(zip("xyz", np.transpose(points), strict=True))
        figure.add_trace(go.Scatter3d(**coordinates, mode="lines", line=style), 1, column)

    for column, value in enumerate(values, 1):
        posture = [0.2, 0.3, -0.1, np.sin(value), np.cos(value), 0.0]
        turned, point, middle = (np.array(part, float).squeeze() for part in where(posture))
        first = np.array(where([*posture[:3], 0, 0, 0])[0], float)
        upper = np.array([np.cos(0.2) * np.sin(0.3), np.sin(0.2) * np.sin(0.3), np.cos(0.3)]) * SIZES[1]
        chain = [[0, 0, 0], [0, 0, SIZES[0]], np.add(upper, [0, 0, SIZES[0]]), middle, point]
        line(chain, column, color="dimgrey", width=8)
        for i, colour in enumerate((ORANGE, GREEN, BLUE)):
            line([point, point + 0.25 * turned[:, i]], column, color=colour, width=5)
            ridge = np.cross(first[:, i], turned[:, i])
            if np.linalg.norm(ridge) > 1e-9:
                ridge = 0.3 * ridge / np.linalg.norm(ridge)
                line([point - ridge, point + ridge], column, color=colour, width=3, dash="dot")
    ranges = {"xaxis_range": [-0.1, 0.9], "yaxis_range": [-0.5, 0.5], "zaxis_range": [0, 1]}
    figure.update_scenes(aspectmode="cube", **ranges)
    return figure.update_layout(showlegend=False, width=1100, height=380)


def possible_part(vertices: Sequence[Sequence[int]]) -> float:
    """Return the part of 400,000 random triples of angles that are possible."""
    tried = np.cos(np.random.default_rng(1).uniform(0, np.pi, (400_000, 3)))
    return float((1 + tried @ np.array(vertices).T >= 0).all(axis=1).mean())


def possible_cosines(vertices: Sequence[Sequence[int]]) -> go.Figure:
    """Return the cosines of 4000 random rotations in the tetrahedron of all possible ones.

    Parameters
    ----------
    vertices : four triples of int
        Of the tetrahedron.
    """
    vertices = np.array(vertices, float)
    quaternions = np.random.default_rng(1).normal(size=(4000, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    points = dict(zip("xyz", (quaternions**2 @ vertices).T, strict=True))
    figure = go.Figure(go.Scatter3d(**points, mode="markers", marker={"size": 1.5, "color": BLUE}))
    for edge in combinations(vertices, 2):
        ends = dict(zip("xyz", np.transpose(edge), strict=True))
        figure.add_trace(go.Scatter3d(**ends, mode="lines", line={"color": "black", "width": 3}))
    titles = {f"{x}axis_title": f"cos χ<sub>{x}</sub>" for x in "xyz"}
    return figure.update_layout(scene=titles, showlegend=False, width=650, height=560)
