"""Draw how the error falls from effect to effect, beside the noise.

Distinctions are made by shape as well as by colour: filled points are the error on poses that a fit saw, open ones that
on poses that it did not see, the band is the noise.
"""

from __future__ import annotations

import io
import os
from typing import TYPE_CHECKING

from rodgen.errors import InputFileError
from rodgen.files import write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rodgen.calibration.ladder import Ladder

__all__ = ["draw_ladder", "save_ladder"]

# Okabe and Ito: told apart with every common colour vision, and by lightness in grey.
_BLUE, _ORANGE, _GREY = "#0072b2", "#e69f00", "#777777"
_WIDE = 10.0
"""Ratio of the largest to the smallest error from which on the axis is logarithmic."""


def save_ladder(ladder: Ladder, path: str | os.PathLike[str]) -> None:
    """Draw a ladder into a file; see :meth:`Ladder.plot`."""
    file = os.fspath(path)
    kind = os.path.splitext(file)[1].lower()
    if kind not in (".png", ".svg", ".pdf"):
        raise InputFileError(
            file, "file", "a name that does not say what to draw", "a name that ends in .png, .svg or .pdf"
        )
    import matplotlib as mpl

    out = io.BytesIO()
    # No date and no random names: the same ladder gives the same bytes.
    metadata = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}[kind]
    with mpl.rc_context({"svg.hashsalt": "rodgen"}):
        draw_ladder(ladder).savefig(out, format=kind[1:], dpi=150, metadata=metadata)
    write_file(file, out.getvalue())


def draw_ladder(ladder: Ladder) -> Figure:
    """Return the picture of a ladder."""
    from matplotlib.figure import Figure

    rungs, noise = ladder.rungs, ladder.noise
    places = range(len(rungs))
    unit = rungs[0].fit.unit
    figure = Figure(figsize=(max(4.5, 1.6 * len(rungs) + 2), 4.2), layout="constrained")
    axes = figure.add_subplot()
    if noise.value is not None:
        label = {"stated": "noise, as stated", "replicates": "noise, by replicates"}.get(
            str(noise.source), "noise"
        )
        axes.axhline(noise.value, color=_GREY, linestyle="--", linewidth=1, label=label)
        if noise.source == "replicates" and noise.replicates is not None:
            between = (noise.replicates.low, noise.replicates.high)
            axes.axhspan(*between, color=_GREY, alpha=0.15, linewidth=0, label="95 % of it")
    fitted = [rung.fit.rms for rung in rungs]
    axes.plot(places, fitted, "o-", color=_BLUE, label="fitted")
    unseen = [float("nan") if rung.held_out.rms is None else rung.held_out.rms for rung in rungs]
    axes.plot(
        places, unseen, "s:", color=_ORANGE, markerfacecolor="white", label="poses that the fit did not see"
    )
    for place, rung in zip(places, rungs, strict=True):
        axes.annotate(
            ladder.figure_of(rung.fit.rms),
            (place, rung.fit.rms),
            xytext=(9, 6),
            textcoords="offset points",
            fontsize=9,
        )
    shown = [value for value in (*fitted, noise.value) if value]
    if shown and max(shown) > _WIDE * min(shown):
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0)
    axes.set_xlim(-0.5, len(rungs) - 0.5)
    axes.set_xticks(list(places), [rung.title.replace(" at ", "\nat ") for rung in rungs])
    axes.set_ylabel(f"rms of a reading / {unit}")
    axes.set_title(rungs[0].fit.machine.name)
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return figure
