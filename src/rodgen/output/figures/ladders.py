"""How the error falls from effect to effect, with the noise for comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from rodgen.calibration.words import odds_text
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
from rodgen.output.numbers import Shown, noise_name, shown_unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rodgen.calibration.ladder import Ladder

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
    rungs, noise = ladder.rungs, ladder.noise
    drawn = [0, *range(max(1, len(rungs) - most + 1), len(rungs))]
    values = [value for rung in rungs for value in (rung.fit.rms, rung.held_out.rms)]
    shown = shown_unit(rungs[0].fit.unit, [*values, noise.value])
    found = noise.replicates if noise.source == "replicates" else None

    def size(value: float | None) -> float | None:
        return None if value is None else value * shown.factor

    unseen = [size(rungs[i].held_out.rms) for i in drawn]
    note = ["Numbers: fitted / held out."] * any(value is not None for value in unseen)
    if len(drawn) < len(rungs):
        note.append(f"{len(rungs) - len(drawn)} steps after the first model are not drawn.")
    words = "; ".join(
        f"{rungs[i].title} {shown(rungs[i].fit.rms)} (held out {shown(rungs[i].held_out.rms)})" for i in drawn
    )
    return error_ladder(
        [rungs[i].title for i in drawn],
        [rungs[i].fit.rms * shown.factor for i in drawn],
        unseen,
        unit=shown.unit,
        title=rungs[0].fit.machine.name,
        texts=[_numbers(shown, rungs[i].fit.rms, rungs[i].held_out.rms) for i in drawn],
        tests=["" if (step := rungs[i].step) is None else f"odds {odds_text(step.odds)}" for i in drawn],
        numbers=drawn,
        noise=size(noise.value),
        name_of_noise=noise_name(noise.source),
        interval=None if found is None else (found.low * shown.factor, found.high * shown.factor),
        note=" ".join(note),
        alt=f"Rms in {shown.unit}: {words}; noise {'not known' if noise.value is None else shown(noise.value)}.",
    )


def _numbers(shown: Shown, fitted: float, held_out: float | None) -> str:
    return shown(fitted) if held_out is None else f"{shown(fitted)} / {shown(held_out)}"


def error_ladder(
    titles: Sequence[str],
    fitted: Sequence[float],
    held_out: Sequence[float | None],
    *,
    unit: str,
    title: str,
    texts: Sequence[str],
    tests: Sequence[str] = (),
    numbers: Sequence[int] = (),
    further: Sequence[float | None] = (),
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
    fitted, held_out, further : sequence of float or None
        Rms of a reading: on the readings that were fitted, on poses held out, on a test file.
    unit : str
    title : str
        Of the figure.
    texts : sequence of str
        The numbers that are written next to the marks.
    tests : sequence of str, optional
        What is written after the titles.
    numbers : sequence of int, optional
        Of the models, for a page; from 0 where left out.
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
        v
        for v in (*fitted, *held_out, *further, noise, *(interval or ()))
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
    if noise is not None:
        figure.add_trace(
            go.Scatter(
                x=[noise, noise], y=[-0.7, n - 0.5], mode="lines", name=name_of_noise,
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
    said = [f"  {test}" if test else "" for test in tests] or [""] * n
    for place, (words, text, test) in enumerate(zip(titles, texts, said, strict=True)):
        figure.add_annotation(
            x=0, y=place, text=f"<b>{label(words)}</b>{label(test)}", xanchor="left", yanchor="bottom",
            yshift=5, xshift=2, showarrow=False, bgcolor=PAPER, borderpad=0, font={"size": 12},
        )  # fmt: skip
        values = [errors[place] for errors in (fitted, held_out, further) if len(errors)]
        furthest = max(v for v in values if v is not None and np.isfinite(v))
        figure.add_annotation(
            x=furthest, y=place, text=label(text), xanchor="left", yanchor="middle", xshift=10,
            showarrow=False, bgcolor=PAPER, borderpad=1, font={"size": 12, "color": SOFT},
        )  # fmt: skip
    figure.update_yaxes(range=[n - 0.5, -0.75], visible=False)
    figure.update_xaxes(range=[0, 1.32 * most], showgrid=False)
    figure.update_layout(margin_l=20)
    return describe(figure, "ladder", title, note=note, alt=alt)
