"""Where a 3-SPS-S machine is singular."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

TORSIONS = (0, 30, 90)


def singularities(determinant: Callable[..., np.ndarray]) -> go.Figure:
    """Return the normed determinant over azimuth and tilt, polar, with its zeros black, for three torsions.

    Parameters
    ----------
    determinant : callable
        Of azimuth, half the tilt and half the torsion, rad.
    """
    line = np.linspace(-180, 180, 241)
    x, y = np.meshgrid(line, line)
    tilt = np.hypot(x, y)
    inside = np.where(tilt <= 180, np.radians(tilt), np.nan)
    titles = [f"torsion {torsion}°" for torsion in TORSIONS]
    figure = make_subplots(1, len(TORSIONS), subplot_titles=titles, shared_yaxes=True)
    for column, torsion in enumerate(TORSIONS, 1):
        found = determinant(np.arctan2(y, x), inside / 2, np.radians(torsion) / 2)
        levels = {"start": -1, "end": 1, "size": 0.1}
        shades = go.Contour(x=line, y=line, z=found, coloraxis="coloraxis", contours=levels, line_width=0)
        zero = {"type": "constraint", "operation": "=", "value": 0}
        zeros = go.Contour(x=line, y=line, z=found, contours=zero, line_color="black", showlegend=False)
        figure.add_traces([shades, zeros], 1, column)
        figure.update_yaxes(scaleanchor=f"x{column if column > 1 else ''}", row=1, col=column)
    figure.update_xaxes(title="tilt towards 0° [°]", tickvals=[-180, -90, 0, 90, 180])
    figure.update_yaxes(title="tilt towards 90° [°]", tickvals=[-180, -90, 0, 90, 180], col=1)
    scale = {"colorscale": "RdBu", "cmin": -1, "cmax": 1, "colorbar_title": "normed determinant"}
    return figure.update_layout(coloraxis=scale, width=1100, height=430)
