"""How the error falls from effect to effect, with the noise for comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from rodgen.calibration.error_table import noise_name
from rodgen.calibration.words import plain
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
from rodgen.output.numbers import Shown, shown_unit

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rodgen.calibration.error_table import Model
    from rodgen.calibration.ladder import Ladder
    from rodgen.calibration.noise_floor import NoiseFloor

ROW, MOST_ROWS = 46, 12
"""Height of a model, in pixels, and how many are drawn."""


def ladder(ladder: Ladder, *, most: int = MOST_ROWS) -> go.Figure:
    """Return the error of each model of a ladder: fitted, on poses held out, and the noise.

    The ``customdata`` of every mark is the number of its model, from 0.

    Parameters
    ----------
    ladder : rodgen.calibration.ladder.Ladder
        It may grow: of a long one the first model and the last ones are drawn, and the note says so.
    most : int, optional
        Models that are drawn.
    """
    models = ladder.models
    drawn = [0, *range(max(1, len(models) - most + 1), len(models))]
    values = [value for model in models for value in (model.rms, model.rms_held_out)]
    unit_drawn = shown_unit(ladder.rungs[0].fit.unit, [*values, ladder.noise.value])
    title = ladder.rungs[0].fit.machine.name
    return error_ladder(
        [models[i] for i in drawn], unit_drawn, ladder.noise, title, drawn, len(models) - len(drawn)
    )


def error_ladder(
    models: Sequence[Model],
    shown: Shown,
    noise: NoiseFloor,
    title: str,
    numbers: Sequence[int] = (),
    not_drawn: int = 0,
) -> go.Figure:
    """Return the errors of models, one row each, from the top: fitted, on poses held out, on a test file, the noise.

    Parameters
    ----------
    models : sequence of Model
    shown : Shown
        The unit.
    noise : NoiseFloor
    title : str
        Of the figure.
    numbers : sequence of int, optional
        Of the models, for a page; from 0 where left out.
    not_drawn : int, optional
        How many models there are besides.
    """
    titles, unit = [plain(model.title, 60) for model in models], shown.unit

    def sizes(values: Iterable[float | None]) -> list[float | None]:
        return [None if value is None else value * shown.factor for value in values]

    fitted = [model.rms * shown.factor for model in models]
    held_out, further = sizes(m.rms_held_out for m in models), sizes(m.rms_test for m in models)
    (floor,) = sizes([noise.value])
    replicates = noise.replicates if noise.source == "replicates" else None
    interval = None if replicates is None else (replicates.low * shown.factor, replicates.high * shown.factor)
    texts = [
        shown(m.rms) if m.rms_held_out is None else f"{shown(m.rms)} / {shown(m.rms_held_out)}"
        for m in models
    ]
    note = ["Numbers: fitted / held out."] * any(value is not None for value in held_out)
    note += [f"{not_drawn} steps after the first model are not drawn."] * bool(not_drawn)
    words = "; ".join(
        f"{name} {shown(m.rms)} (held out {shown(m.rms_held_out)})"
        for name, m in zip(titles, models, strict=True)
    )
    n = len(titles)
    figure = column([Panel("", ROW * n + 8, f"rms of a reading [{unit}]")])
    y = np.arange(n)
    known = [
        v
        for v in (*fitted, *held_out, *further, floor, *(interval or ()))
        if v is not None and np.isfinite(v)
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
    if floor is not None:
        figure.add_trace(
            go.Scatter(
                x=[floor, floor], y=[-0.7, n - 0.5], mode="lines", name=noise_name(noise.source),
                line={"color": SOFT, "width": 1.3, "dash": "dash"}, hovertemplate=f"%{{x:.4g}} {unit}",
            )
        )  # fmt: skip
    for name, values, symbol, colour in (
        ("on the test file", further, "diamond-open", INK),
        ("held out", held_out, "square-open", ORANGE),
        ("fitted", fitted, "circle", BLUE),
    ):
        if any(value is not None for value in values):
            figure.add_trace(
                go.Scatter(
                    x=[np.nan if v is None else v for v in values], y=y, mode="markers", name=name,
                    marker={"symbol": symbol, "size": 10, "color": colour, "line": {"width": 2, "color": colour}},
                    text=[label(t) for t in titles], customdata=[*numbers] or [*range(n)],
                    hovertemplate=f"%{{text}}<br>%{{x:.4g}} {unit}, {name}<extra></extra>",
                )
            )  # fmt: skip
    odds = [f"  odds {model.odds}" if model.odds else "" for model in models]
    for place, (words, text, test) in enumerate(zip(titles, texts, odds, strict=True)):
        figure.add_annotation(
            x=0, y=place, text=f"<b>{label(words)}</b>{label(test)}", xanchor="left", yanchor="bottom",
            yshift=5, xshift=2, showarrow=False, bgcolor=PAPER, borderpad=0, font={"size": 12},
        )  # fmt: skip
        values = [errors[place] for errors in (fitted, held_out, further)]
        furthest = max(v for v in values if v is not None and np.isfinite(v))
        figure.add_annotation(
            x=furthest, y=place, text=label(text), xanchor="left", yanchor="middle", xshift=10,
            showarrow=False, bgcolor=PAPER, borderpad=1, font={"size": 12, "color": SOFT},
        )  # fmt: skip
    figure.update_yaxes(range=[n - 0.5, -0.75], visible=False)
    figure.update_xaxes(range=[0, 1.32 * most], showgrid=False)
    figure.update_layout(margin_l=20)
    known_noise = "not known" if floor is None else shown.plain(floor)
    alt = f"Rms in {unit}: {words}; noise {known_noise}."
    return describe(figure, "ladder", title, note=" ".join(note), alt=alt)
