"""How the error falls from effect to effect, with the noise for comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from rodgen.output.figures.style import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    PAPER,
    SOFT,
    Panel,
    column,
    describe,
    label,
)
from rodgen.output.numbers import noise_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rodgen.calibration.ladder import Ladder

__all__ = ["error_ladder", "ladder"]

ROW = 46
"""Height of a model, in pixels."""


def ladder(ladder: Ladder) -> go.Figure:
    """Return the error of each model of a ladder: fitted, on poses held out, and the noise.

    Parameters
    ----------
    ladder : rodgen.calibration.ladder.Ladder
    """
    first, noise = ladder.rungs[0].fit, ladder.noise
    found = noise.replicates if noise.source == "replicates" else None
    return error_ladder(
        [rung.title for rung in ladder.rungs],
        [rung.fit.rms for rung in ladder.rungs],
        [rung.held_out.rms for rung in ladder.rungs],
        unit=first.unit,
        title=first.machine.name,
        texts=[ladder.figure_of(rung.fit.rms) for rung in ladder.rungs],
        noise=noise.value,
        name_of_noise=noise_name(noise.source),
        interval=None if found is None else (found.low, found.high),
    )


def error_ladder(
    titles: Sequence[str],
    fitted: Sequence[float],
    held_out: Sequence[float | None],
    *,
    unit: str,
    title: str,
    texts: Sequence[str],
    test: Sequence[float | None] = (),
    noise: float | None = None,
    name_of_noise: str = "noise",
    interval: tuple[float, float] | None = None,
    note: str = "",
    alt: str = "",
) -> go.Figure:
    """Return the errors of models, one row each, from the top.

    Parameters
    ----------
    titles : sequence of str
        Of the models.
    fitted, held_out, test : sequence of float or None
        Rms of a reading: on the readings that were fitted, on poses held out, on a test file.
    unit : str
    title : str
        Of the figure.
    texts : sequence of str
        The numbers that are written next to the marks.
    noise : float, optional
    name_of_noise : str, optional
    interval : pair of floats, optional
        The 95 % confidence interval of the noise.
    note, alt : str, optional
    """
    n = len(titles)
    figure = column([Panel("", ROW * n + 8, f"rms of a reading [{unit}]")])
    y = np.arange(n)
    known = [
        v for v in (*fitted, *held_out, *test, noise, *(interval or ())) if v is not None and np.isfinite(v)
    ]
    most = max(known, default=1.0) or 1.0
    for row, value in zip(y, fitted, strict=True):
        figure.add_shape(
            type="line", x0=0, x1=value, y0=row, y1=row, line={"color": BLUE, "width": 3}, layer="below", xref="x",
            yref="y",
        )  # fmt: skip
    if interval is not None:
        figure.add_vrect(*interval, fillcolor=GREY, opacity=0.2, line_width=0, layer="below")
        figure.add_trace(
            go.Scatter(
                x=[None], y=[None], mode="markers", name="95 % interval of the noise", hoverinfo="skip",
                marker={"symbol": "square", "size": 12, "color": GREY, "opacity": 0.35},
            )
        )  # fmt: skip
    if noise is not None:
        figure.add_trace(
            go.Scatter(
                x=[noise, noise], y=[-0.7, n - 0.5], mode="lines", name=name_of_noise,
                line={"color": SOFT, "width": 1.3, "dash": "dash"}, hovertemplate=f"%{{x:.4g}} {unit}",
            )
        )  # fmt: skip
    for name, values, symbol, colour in (
        ("on the test file", test, "diamond-open", INK),
        ("held out", held_out, "square-open", ORANGE),
        ("fitted", fitted, "circle", BLUE),
    ):
        if any(value is not None for value in values):
            figure.add_trace(
                go.Scatter(
                    x=[np.nan if v is None else v for v in values], y=y, mode="markers", name=name,
                    marker={"symbol": symbol, "size": 10, "color": colour, "line": {"width": 2, "color": colour}},
                    text=[label(t) for t in titles], hovertemplate=f"%{{text}}<br>%{{x:.4g}} {unit}",
                )
            )  # fmt: skip
    for place, (words, text) in enumerate(zip(titles, texts, strict=True)):
        figure.add_annotation(
            x=0, y=place, text=f"<b>{label(words)}</b>", xanchor="left", yanchor="bottom", yshift=5, xshift=2,
            showarrow=False, bgcolor=PAPER, borderpad=0, font={"size": 12},
        )  # fmt: skip
        values = [errors[place] for errors in (fitted, held_out, test) if len(errors)]
        furthest = max(v for v in values if v is not None and np.isfinite(v))
        figure.add_annotation(
            x=furthest, y=place, text=label(text), xanchor="left", yanchor="middle", xshift=10,
            showarrow=False, bgcolor=PAPER, borderpad=1, font={"size": 12, "color": SOFT},
        )  # fmt: skip
    figure.update_yaxes(range=[n - 0.5, -0.75], visible=False)
    figure.update_xaxes(range=[0, 1.32 * most], showgrid=False)
    figure.update_layout(margin_l=20)
    return describe(figure, "ladder", title, note=note, alt=alt)
