"""Figures of the derivations' notebooks: functions of data that return Plotly figures.

No proof imports this package. The cells of a notebook that draw something do, so that a derivation is proved and code
is made from it without a plotting library.
"""

from __future__ import annotations

import json
from itertools import count

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

__all__ = ["BLUE", "GREEN", "ORANGE", "cross_mp", "error_maps", "show"]

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"

_numbers = count(1)


def show(figure: go.Figure) -> None:
    """Display a figure in a notebook: its data, and a page that the first figure brings plotly.js for."""
    from IPython.display import display

    number = next(_numbers)
    figure.update_layout(template="plotly_white", margin={"l": 60, "r": 20, "t": 60, "b": 50})
    page = figure.to_html(full_html=False, include_plotlyjs=number == 1, div_id=f"figure-{number}")
    data = json.loads(figure.to_json())
    display({"application/vnd.plotly.v1+json": data, "text/html": page}, raw=True)


def error_maps(
    x: np.ndarray,
    y: np.ndarray,
    errors: dict[str, np.ndarray],
    bounds: tuple[float, float],
    *,
    labels: tuple[str, str, str],
) -> go.Figure:
    """Return one map of errors for each formula, all axes and the colours logarithmic.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Values along the horizontal axis.
    y : ndarray, shape (m,)
        Values along the vertical axis.
    errors : dict of str to ndarray, shape (m, n)
        Titles and the errors under them.
    bounds : pair of floats
        Errors at both ends of the colour scale.
    labels : three str
        Of the horizontal axis, the vertical axis and the colours.
    """
    figure = make_subplots(1, len(errors), subplot_titles=list(errors), shared_yaxes=True)
    for column, error in enumerate(errors.values(), 1):
        shades = go.Heatmap(
            x=np.log10(x), y=np.log10(y), z=np.log10(np.clip(error, *bounds)), coloraxis="coloraxis"
        )
        figure.add_trace(shades, 1, column)
    figure.update_xaxes(title=labels[0], tickprefix="10<sup>", ticksuffix="</sup>")
    figure.update_yaxes(tickprefix="10<sup>", ticksuffix="</sup>")
    figure.update_yaxes(title=labels[1], col=1)
    low, high = np.log10(bounds)
    scale = {"title": labels[2], "tickprefix": "10<sup>", "ticksuffix": "</sup>"}
    return figure.update_layout(
        coloraxis={"colorscale": "Viridis", "cmin": low, "cmax": high, "colorbar": scale},
        width=950,
        height=420,
    )


def cross_mp(a, b):
    """Return the cross product of two mpmath vectors."""
    import mpmath

    return mpmath.matrix([a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))])
