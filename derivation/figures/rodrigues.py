"""Both axes that turn a point into another, and how many digits two formulas for them keep."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mpmath
import numpy as np
import plotly.graph_objects as go

from rodgen.derivation.figures import BLUE, ORANGE, error_maps

ANGLE = 1.7
DIGITS = 50


def turned(point: np.ndarray, axis: np.ndarray, angle: float | np.ndarray) -> np.ndarray:
    """Return a point rotated about a unit axis by each of the angles."""
    angle = np.asarray(angle)[..., None]
    along = axis * (axis @ point)
    return along + np.cos(angle) * (point - along) + np.sin(angle) * np.cross(axis, point)


def both_axes(solve: Callable[..., Sequence[float]]) -> go.Figure:
    """Return a picture of two points, both axes for one angle, and the way of the point about each.

    Parameters
    ----------
    solve : callable
        The axis from the components of ρ and ρ′, cot(χ/2) and ±1.
    """
    before = np.array([0.80, -0.35, 0.49])
    before /= np.linalg.norm(before)
    after = turned(before, np.array([0.1, 0.25, 0.963]) / np.linalg.norm([0.1, 0.25, 0.963]), ANGLE)
    axes = [np.array(solve(*before, *after, 1 / np.tan(ANGLE / 2), sign)) for sign in (1, -1)]
    figure = go.Figure()

    def line(points, name=None, at=None, **style):
        labels = [""] * len(points)
        if name:
            labels[at] = name
        figure.add_trace(
            go.Scatter3d(
                **dict(zip("xyz", np.transpose(points), strict=True)),
                mode="lines+text",
                text=labels,
                line=style,
                textfont_color=style["color"],
            )
        )

    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 60), np.linspace(0, np.pi, 30))
    figure.add_trace(
        go.Surface(
            x=np.cos(u) * np.sin(v),
            y=np.sin(u) * np.sin(v),
            z=np.cos(v),
            opacity=0.15,
            showscale=False,
            colorscale=[[0, "grey"], [1, "grey"]],
        )
    )
    middle, normal = after + before, np.cross(before, after)
    middle, normal = middle / np.linalg.norm(middle), normal / np.linalg.norm(normal)
    circle = np.linspace(0, 2 * np.pi, 200)[:, None]
    line(np.cos(circle) * normal + np.sin(circle) * middle, color="grey", width=2)
    for axis, colour, name in zip(axes, (BLUE, ORANGE), ("e₊", "e₋"), strict=True):
        line([0 * axis, 1.3 * axis], name, -1, color=colour, width=5)
        line(turned(before, axis, np.linspace(0, ANGLE, 80)), color=colour, width=6)
        rim = turned(before, axis, np.linspace(0, 2 * np.pi, 120))
        line(rim, color=colour, width=2, dash="dot")
        for spoke in rim[::20]:
            line([0 * spoke, spoke], color=colour, width=1)
    for point, name in ((before, "ρ"), (after, "ρ′")):
        line([point, 1.1 * point], name, -1, color="black", width=6)
    eye = 0.9 * normal + 0.9 * middle - 1.2 * np.cross(normal, middle)
    hidden = {"visible": False}
    return figure.update_layout(
        scene={
            **{f"{x}axis": hidden for x in "xyz"},
            "aspectmode": "data",
            "camera_eye": dict(zip("xyz", eye, strict=True)),
        },
        showlegend=False,
        width=700,
        height=600,
    )


def accuracy(formulas: dict[str, Callable], exact: Callable) -> go.Figure:
    """Return maps of the largest error of each formula over the angle χ and the pivot w₃ / |w|.

    Parameters
    ----------
    formulas : dict of str to callable
        The axis from the components of ρ and ρ′, and |θ|, on arrays.
    exact : callable
        The same for numbers of mpmath.
    """
    angles, pivots = np.logspace(-9, 0.49, 40), np.logspace(-12, -0.05, 40)
    angle, pivot = np.meshgrid(angles, pivots)
    a = np.arctan(0.7 * np.tan(angle / 2))  # tan a = 0.7 tan(χ/2): two well separated solutions
    # w points to (√(1 − q²), 0, q), turned about Oz; q is the pivot. m and r are turned about w.
    level = np.stack([0 * pivot, 1 + 0 * pivot, 0 * pivot])
    steep = np.stack([-pivot, 0 * pivot, np.sqrt(1 - pivot**2)])
    along_m, along_r = np.cos(0.7) * level + np.sin(0.7) * steep, np.cos(0.7) * steep - np.sin(0.7) * level
    about_z = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    before, after = (
        np.einsum("ij,j...->i...", about_z, np.cos(a) * along_m + sign * np.sin(a) * along_r)
        for sign in (-1, 1)
    )
    arguments = [*before, *after, 2 * np.tan(angle / 2)]
    with mpmath.workdps(DIGITS):
        columns = zip(*(argument.ravel().tolist() for argument in arguments), strict=True)
        reference = [[float(part) for part in exact(*map(mpmath.mpf, column))] for column in columns]
    reference = np.array(reference).T.reshape(3, *angle.shape)
    errors = {}
    for title, formula in formulas.items():
        with np.errstate(all="ignore"):
            error = np.abs(np.array(formula(*arguments)) - reference).max(axis=0)
        errors[title] = np.where(np.isfinite(error), error, 1)
    return error_maps(
        angles,
        pivots,
        errors,
        (1e-17, 1),
        labels=("angle χ (rad)", "pivot w₃ / |w|", "largest error of a component of e"),
    )
