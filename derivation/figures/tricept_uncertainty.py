"""Figures 3 to 10 of Kureková et al.: what one element of U_x does to one of U_y over the beams of the workspace."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

COLUMNS = ("A0", "A1", "A-1", "r", "R")
FIGURES = (
    (3, ("A0", "A1"), "xx", "least"),
    (4, ("A0", "r"), "xx", "greatest"),
    (5, ("r", "r"), "xx", "greatest"),
    (6, ("r", "R"), "xx", "least"),
    (7, ("R", "R"), "xx", "greatest"),
    (8, ("r", "r"), "xy", "least"),
    (9, ("r", "r"), "yy", "least"),
    (10, ("R", "R"), "zz", "least"),
)
RADII = 140.0, 330.0
"""r and R of the machine in Table 1, mm."""
LIMITS = 568.0, 858.0
"""Least and greatest length of its rods, mm."""
BEAMS = np.linspace(-39, 39, 40)
"""α and β, degrees."""
PLACES = np.linspace(300, 858, 280)
"""z, mm: no pose within the limits is outside."""


def influences(legs: Callable[..., np.ndarray], sensitivity: Callable[..., np.ndarray]) -> list[np.ndarray]:
    """Return the least or greatest influence of each figure along each beam; NaN where no rod lengths are allowed.

    Parameters
    ----------
    legs, sensitivity : callable
        Kernels ``tricept_legs`` and ``tricept_sensitivity``.
    """
    angles = np.radians(BEAMS)
    pose = np.stack(np.meshgrid(angles, angles, PLACES, indexing="ij"), axis=-1)
    rods, values = legs(pose, *RADII), sensitivity(pose, *RADII, 0.0, 0.0, 0.0)
    allowed = ((rods >= LIMITS[0]) & (rods <= LIMITS[1])).all(axis=-1)
    found = []
    for _, pair, element, end in FIGURES:
        (i, j), (k, m) = map(COLUMNS.index, pair), map("xyz".index, element)
        influence = values[..., k, i] * values[..., m, j]
        if i != j:  # a covariance stands twice in U_x
            influence = influence + values[..., k, j] * values[..., m, i]
        unwanted = np.inf if end == "least" else -np.inf
        extreme = (np.min if end == "least" else np.max)(np.where(allowed, influence, unwanted), axis=-1)
        found.append(np.where(np.isfinite(extreme), extreme, np.nan))
    return found


def surfaces(values: list[np.ndarray]) -> go.Figure:
    """Return a surface over α and β for each figure."""
    titles = [f"{n}: U_x[{', '.join(pair)}], {end} U_y[{element}]" for n, pair, element, end in FIGURES]
    specs = [[{"type": "scene"}] * 4] * 2
    figure = make_subplots(
        2, 4, specs=specs, subplot_titles=titles, horizontal_spacing=0.01, vertical_spacing=0.06
    )
    for n, found in enumerate(values):
        surface = go.Surface(x=BEAMS, y=BEAMS, z=found.T, colorscale="Cividis", showscale=False)
        figure.add_trace(surface, n // 4 + 1, n % 4 + 1)
    angles = {"dtick": 30, "tickfont_size": 10}
    figure.update_scenes(
        xaxis={"title": "α [°]", **angles},
        yaxis={"title": "β [°]", **angles},
        zaxis={"title": "", "tickfont_size": 10},
        camera={"eye": {"x": 1.6, "y": 1.6, "z": 1.1}, "center": {"x": 0, "y": 0, "z": -0.15}},
    )
    return figure.update_layout(width=1200, height=650)
