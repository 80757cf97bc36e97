"""Draw a fitted axis: the pairs seen along it and from the side, and what the fit leaves of each.

Every distinction is made by shape as well as by colour, so that the picture survives a black-and-white
printer: open circles are points before the rotation, filled ones after it, crosses are outliers.
"""

from __future__ import annotations

import io
import math
import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.errors import InputFileError
from rodgen.files import write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rodgen.data.tables import Pairs
    from rodgen.kinematics.axis_fit import AxisFit

__all__ = ["draw_axis_fit", "save_axis_plot"]

Floats = NDArray[np.float64]

# More arcs than this are a grey disc, more residuals a grey band.
_MOST_ARCS = 200
_MOST_RESIDUALS = 5000
# Okabe and Ito: told apart with every common colour vision, and by lightness in grey.
_BLUE, _ORANGE, _RED, _GREY = "#0072b2", "#e69f00", "#b03000", "#777777"


def save_axis_plot(path: str | os.PathLike[str], pairs: Pairs, fit: AxisFit) -> None:
    """Draw a fit into a file.

    Parameters
    ----------
    path : str or os.PathLike
        Ends in ``.png``, ``.svg`` or ``.pdf``.
    pairs : Pairs
        What was fitted.
    fit : AxisFit
        The result.

    Raises
    ------
    InputFileError
        When the file cannot be written, its name has another ending, or Matplotlib is not installed.
    """
    file = os.fspath(path)
    kind = os.path.splitext(file)[1].lower()
    if kind not in (".png", ".svg", ".pdf"):
        raise InputFileError(
            file, "file", "a name that does not say what to draw", "a name that ends in .png, .svg or .pdf"
        )
    try:
        import matplotlib as mpl
    except ImportError:
        raise InputFileError(
            "command line", "--plot", "no module 'matplotlib'", "it: pip install 'rodgen[plot]'"
        ) from None
    out = io.BytesIO()
    # No date and no random names: the same fit gives the same bytes.
    metadata = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}[kind]
    with mpl.rc_context({"svg.hashsalt": "rodgen"}):
        draw_axis_fit(pairs, fit).savefig(out, format=kind[1:], dpi=150, metadata=metadata)
    write_file(file, out.getvalue())


def draw_axis_fit(pairs: Pairs, fit: AxisFit) -> Figure:
    """Draw a fit.

    Parameters
    ----------
    pairs : Pairs
        What was fitted.
    fit : AxisFit
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        Three panels: the pairs seen along the axis, the same from the side, and the residuals of every
        pair along, away from and around the axis.
    """
    from matplotlib.figure import Figure

    u, v, names = _view(fit.axis)
    before, after = (
        np.stack([(x - fit.point) @ w for w in (u, v, fit.axis)]) for x in (pairs.rho, pairs.rho_prime)
    )
    figure = Figure(figsize=(11, 6.2), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=[1, 1.05], height_ratios=[1, 1.25])
    _draw_along(figure.add_subplot(grid[:, 0]), pairs, fit, before, after, names)
    _draw_side(figure.add_subplot(grid[0, 1]), pairs, fit, before, after)
    _draw_residuals(figure.add_subplot(grid[1, 1]), pairs, fit, after, u, v)
    e = ", ".join(f"{c:.6f}" for c in fit.axis).replace("-", "−")
    spread = fit.axis_uncertainty[0]
    known = f"± {spread * 1e6:.3g} µrad" if math.isfinite(spread) else "uncertainty unknown"
    bad = int(fit.outliers.sum())
    outliers = f", {bad} outlier{'s' * (bad > 1)}" if bad else ""
    figure.suptitle(
        f"Axis ({e}) {known}\n{fit.pairs} pairs, residuals rms {fit.rms:.3g} {pairs.unit}{outliers}",
        fontsize=11,
    )
    return figure


def _view(axis: Floats) -> tuple[Floats, Floats, tuple[str, str]]:
    """Choose the two directions of the picture: as near to machine axes as the view along the axis allows."""
    main = int(np.argmax(np.abs(axis)))
    right = (main + 1) % 3 if axis[main] > 0 else (main + 2) % 3
    u = np.eye(3)[right] - axis * axis[right]
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    up = int(np.argmax(np.abs(v)))
    tilted = abs(axis[main]) < 1 - 1e-4
    return (
        u,
        v,
        tuple(
            ("about " if tilted else "") + ("" if w[i] > 0 else "−") + "xyz"[i]
            for w, i in ((u, right), (v, up))
        ),
    )  # type: ignore[return-value]


def _some(n: int, most: int, always: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Choose at most `most` pairs, evenly, and every one of `always`."""
    if n <= most:
        return np.arange(n)
    return np.union1d(np.linspace(0, n - 1, most).astype(np.intp), np.flatnonzero(always)[:most])


def _draw_along(
    panel: Any, pairs: Pairs, fit: AxisFit, before: Floats, after: Floats, names: tuple[str, str]
) -> None:
    from matplotlib.collections import LineCollection

    chosen = _some(fit.pairs, _MOST_ARCS, fit.outliers)
    # The way of the point: its circle about the fitted axis, from where it was by the angle that was given.
    turn = np.remainder(pairs.angle[chosen] + np.pi, 2 * np.pi) - np.pi
    start = np.arctan2(before[1, chosen], before[0, chosen])
    radius = np.hypot(before[0, chosen], before[1, chosen])
    steps = start[:, None] + turn[:, None] * np.linspace(0, 1, 49)
    arcs = radius[:, None, None] * np.stack([np.cos(steps), np.sin(steps)], axis=-1)
    panel.add_collection(LineCollection(arcs, colors=_GREY, linewidths=0.6, alpha=0.6, zorder=1))
    panel.plot(*before[:2, chosen], "o", ms=5, mfc="white", mec=_BLUE, label="before", zorder=3)
    panel.plot(*after[:2, chosen], "o", ms=4, mfc=_ORANGE, mec="black", mew=0.4, label="after", zorder=4)
    bad = chosen[fit.outliers[chosen]]
    if bad.size:
        panel.plot(*after[:2, bad], "X", ms=8, mfc=_RED, mec="black", mew=0.5, label="outlier", zorder=5)
    panel.plot(0, 0, "o", ms=11, mfc="white", mec="black", zorder=6)
    panel.plot(0, 0, "o", ms=3, color="black", zorder=7, label="axis, towards you")
    panel.set_aspect("equal", adjustable="datalim")
    panel.margins(0.08)
    panel.set_xlabel(f"across the axis, {names[0]} [{pairs.unit}]")
    panel.set_ylabel(f"across the axis, {names[1]} [{pairs.unit}]")
    shown = "" if len(chosen) == fit.pairs else f" ({len(chosen)} of {fit.pairs} pairs)"
    panel.set_title(f"Seen along the axis{shown}", fontsize=10)
    panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=4, fontsize=8, frameon=False)
    panel.grid(color="0.9", lw=0.6)
    panel.set_axisbelow(True)


def _draw_side(panel: Any, pairs: Pairs, fit: AxisFit, before: Floats, after: Floats) -> None:
    chosen = _some(fit.pairs, _MOST_ARCS, fit.outliers)
    for points, style, order in (
        (before, {"ms": 5, "mfc": "white", "mec": _BLUE}, 2),
        (after, {"ms": 3.5, "mfc": _ORANGE, "mec": "black", "mew": 0.4}, 3),
    ):
        panel.plot(
            points[2, chosen], np.hypot(points[0, chosen], points[1, chosen]), "o", zorder=order, **style
        )
    panel.axhline(0, color="black", lw=1.2, zorder=1)
    panel.annotate(
        "",
        (1, 0),
        (0.93, 0),
        xycoords=panel.get_yaxis_transform(),
        arrowprops={"arrowstyle": "-|>", "color": "black"},
    )
    panel.set_ylim(bottom=min(0.0, -0.06 * panel.get_ylim()[1]))
    panel.set_xlabel(f"along the axis [{pairs.unit}]")
    panel.set_ylabel(f"away from the axis [{pairs.unit}]")
    panel.set_title("Seen from the side", fontsize=10)
    panel.grid(color="0.9", lw=0.6)
    panel.set_axisbelow(True)


def _draw_residuals(panel: Any, pairs: Pairs, fit: AxisFit, after: Floats, u: Floats, v: Floats) -> None:
    chosen = _some(fit.pairs, _MOST_RESIDUALS, fit.outliers)
    radius = np.hypot(after[0], after[1])[chosen]
    cos, sin = (
        np.divide(after[i, chosen], radius, out=np.zeros(len(chosen)), where=radius > 0) for i in (0, 1)
    )
    across, up, along = (fit.residuals[chosen] @ w for w in (u, v, fit.axis))
    parts = {
        "along the axis": (along, "s", _GREY),
        "away from the axis": (cos * across + sin * up, "o", _BLUE),
        "around the axis": (cos * up - sin * across, "^", _ORANGE),
    }
    size = float(np.clip(200 / len(chosen) ** 0.75, 1.5, 5))
    good = ~fit.outliers[chosen]
    for name, (part, marker, colour) in parts.items():
        panel.plot(
            chosen[good],
            part[good],
            marker,
            ms=size,
            mfc=colour,
            mec="black",
            mew=0.3 * (size > 2),
            label=name,
        )
    # The picture is for the pairs that count; an outlier that is farther off stands at its edge.
    worst = float(np.abs([part[good] for part, _, _ in parts.values()]).max(initial=0)) or fit.rms or 1.0
    bad = chosen[~good]
    if bad.size:
        largest = np.stack([part[~good] for part, _, _ in parts.values()])
        value = np.take_along_axis(largest, np.abs(largest).argmax(axis=0)[None], axis=0)[0]
        edge = 1.15 * worst
        panel.plot(
            bad,
            np.clip(value, -edge, edge),
            "X",
            ms=8,
            mfc=_RED,
            mec="black",
            mew=0.5,
            label="outlier, farther off" if (np.abs(value) > edge).any() else "outlier",
        )
    noise = math.sqrt(2) * fit.sigma
    if math.isfinite(noise) and noise > 0:
        panel.axhspan(-2 * noise, 2 * noise, color="0.92", zorder=0, label="±2 standard uncertainties")
    panel.axhline(0, color="black", lw=0.8)
    limit = 1.3 * max(worst, 2.2 * noise if noise > 0 else 0.0)
    panel.set_ylim(-limit, limit)
    panel.locator_params(axis="x", integer=True)
    panel.set_xlabel("pair, in the order of the file (from 0)")
    panel.set_ylabel(f"residual [{pairs.unit}]")
    panel.set_title("What the fit leaves", fontsize=10)
    panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3, fontsize=8, frameon=False)
    panel.grid(color="0.9", lw=0.6)
    panel.set_axisbelow(True)
