"""How residuals are distributed, and how alike those of successive poses are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from rodgen.array_types import Array, Index
from rodgen.calibration.words import three_digits
from rodgen.data.poses import stretches
from rodgen.output.figures.drawn_rows import MOST_MARKS, DrawnRows
from rodgen.output.figures.residuals import SIDES, add_rows, components_of
from rodgen.output.figures.style import (
    BLUE,
    INK,
    LINE,
    SELECTED,
    SOFT,
    Panel,
    add_trace,
    column,
    describe,
    label,
    mark_size,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from rodgen.calibration.fitted import Fit
    from rodgen.machines.observations import Observations

PANEL = 150
"""Height, in pixels."""
QUANTILE = "normal quantile [standard deviations]"
BAND, BAND_NOTE = "rgba(140,149,159,0.35)", "The band holds 95 % of normal residuals at each place."
NORMAL = {"color": INK, "width": 1.5}
"""The line of the normal distribution."""
MOST_LAGS = 40
LIKELY = 1.96
"""Standard deviations that hold 95 % of a normal distribution."""


def quantiles_of_residuals(
    fit: Fit,
    *,
    before: Fit | None = None,
    whitened: bool = False,
    selected: Collection[int] = (),
    most: int = MOST_MARKS,
) -> go.Figure:
    """Return a normal quantile plot (Q-Q) of each component's residuals, without outliers.

    The line is the normal distribution with their mean and standard deviation; of rows from it, 95 % lie in the band at
    each place. The ``customdata`` of every mark is the number of its row, from 0.

    Parameters
    ----------
    fit : Fit
    before : Fit, optional
        Another model of the same observations, whose residuals are drawn, too.
    whitened : bool, optional
        Whether residuals are in standard deviations, free of a stated correlation.
    selected : collection of int, optional
        Rows that are marked.
    most : int, optional
        Marks of the figure, from which large data are thinned; its note then says so.
    """
    rows = DrawnRows(before or fit, None if before is None else fit, kept=selected, most=most)
    panels = components_of(rows, whitened=whitened)
    figure = column([Panel(panel.heading, PANEL, QUANTILE * (panel is panels[-1])) for panel in panels])
    every = [rows.every(of, whitened=whitened) for _, of in rows.sides]
    units = [panel.unit for panel in panels]
    for number in range(len(panels)):
        _quantiles(figure, number, rows, units[number], [r[:, number] for r in every], selected)
    note = [BAND_NOTE, rows.thinned]
    return describe(
        figure, "quantiles", "Normal quantiles of the residuals", note=" ".join(filter(None, note))
    )


def _quantiles(
    figure: go.Figure,
    number: int,
    rows: DrawnRows,
    unit: str,
    values: Sequence[Array],
    selected: Collection[int],
) -> None:
    """Add the residuals of one component, of all rows, (n,) before and after, over normal quantiles."""
    from scipy import special

    for (name, _), r in zip(rows.sides, values, strict=True):
        good = np.flatnonzero(~rows.outlier & np.isfinite(r))
        n = len(good)
        if not n:
            continue
        rank = np.empty(n, np.intp)
        rank[np.argsort(r[good], kind="stable")] = np.arange(n)
        quantile = np.full(rows.total, np.nan)
        quantile[good] = special.ndtri((rank + 0.5) / n)
        x, y = quantile[rows.chosen], r[rows.chosen]
        known = np.isfinite(x)
        mean, sigma = float(r[good].mean()), float(np.std(r[good]))
        if name != "before":
            place = np.unique(np.linspace(0, n - 1, 101).astype(np.intp))
            ends = special.ndtri((place + 0.5) / n)
            low, high = (
                mean + sigma * special.ndtri(special.betaincinv(place + 1, n - place, p))
                for p in (0.025, 0.975)
            )
            add_trace(
                figure, number, "95 % of normal residuals", "band", mode="none", fill="toself",
                fillcolor=BAND, x=np.concatenate([ends, ends[::-1]]), y=np.concatenate([low, high[::-1]]),
            )  # fmt: skip
            add_trace(
                figure, number, "normal distribution", "normal", x=ends[[0, -1]], y=mean + sigma * ends[[0, -1]],
                mode="lines", line=NORMAL,
            )  # fmt: skip
        mark = SIDES[name] | {"size": mark_size(len(rows.chosen)), "opacity": 1}
        add_rows(figure, number, name, rows, np.flatnonzero(known), x, y, mark, f"{unit}, {name}")
        chosen = np.flatnonzero(np.isin(rows.chosen, np.asarray([*selected], np.intp)) & known)
        if len(chosen) and name != "before":
            add_rows(figure, number, "selected", rows, chosen, x, y, SELECTED, unit)


def distribution_of_residuals(fit: Fit) -> go.Figure:
    """Return a histogram and a normal quantile plot of the residuals of each component, without outliers.

    Parameters
    ----------
    fit : Fit
    """
    rows = DrawnRows(fit)
    parts, every = components_of(rows), rows.every(fit)
    panels = []
    for part in parts:
        panels.append(Panel(f"share per {label(part.unit)}", PANEL, part.heading))
        panels.append(Panel(part.heading, PANEL, QUANTILE))
    figure = column(panels)
    for c, part in enumerate(parts):
        r = every[~rows.outlier, c]
        r = r[np.isfinite(r)]
        sigma = float(np.std(r)) or 1.0
        share, edges = np.histogram(r, int(np.clip(np.sqrt(len(r)), 8, 60)), density=True)
        add_trace(
            figure, 2 * c, "histogram", kind=go.Bar, x=(edges[1:] + edges[:-1]) / 2, y=share, width=np.diff(edges),
            marker={"color": LINE, "line": {"color": BLUE, "width": 1}},
            hovertemplate=f"%{{x:.4g}} {label(part.unit)}<extra></extra>",
        )  # fmt: skip
        x = np.linspace(-4 * sigma, 4 * sigma, 201) + r.mean()
        normal = np.exp(-0.5 * ((x - r.mean()) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
        add_trace(figure, 2 * c, "normal distribution", "normal", x=x, y=normal, mode="lines", line=NORMAL)
        _quantiles(figure, 2 * c + 1, rows, part.unit, [every[:, c]], ())
    figure.update_layout(bargap=0)
    note = [
        f"The line is the normal distribution; rms {three_digits(fit.rms)} {fit.unit}.",
        BAND_NOTE,
        rows.thinned,
    ]
    return describe(
        figure, "distribution", "Distribution of the residuals", note=" ".join(filter(None, note))
    )


def autocorrelation_of_residuals(fit: Fit, *, before: Fit | None = None, against: str = "order") -> go.Figure:
    """Return how alike the mean residuals of successive poses are, against how far apart they were measured.

    Dotted lines hold 95 % of the values of independent residuals. Poses of different runs do not count.

    Parameters
    ----------
    fit : Fit
    before : Fit, optional
        Another model of the same observations.
    against : str, optional
        ``"order"``: the distance is counted in poses; ``"t"``: it is that in time, the median of pairs of poses so many
        poses apart.

    Raises
    ------
    ValueError
        When the time is asked for, and the data have none.
    """
    o = fit.observations
    if against == "t" and o.t is None:
        raise ValueError("the data have no column t")
    sides = [("residual", fit)] if before is None else [("before", before), ("after", fit)]
    gone = np.any([of.outliers for _, of in sides], axis=0)
    rows = np.flatnonzero(~gone & np.isfinite(fit.residuals).all(axis=1))
    starts, sizes = stretches(o.pose[rows])
    first = rows[starts]
    most = max(min(MOST_LAGS, len(first) // 4), 1)
    lag = np.arange(1, most + 1).astype(float)
    what = "poses apart"
    if against == "t":
        what, lag = "apart in time [s]", np.array([np.median(np.abs(_apart(o, first, int(k)))) for k in lag])
    names = fit.machine.measurand.labels
    figure = column(
        [Panel(f"correlation, {label(name)}", PANEL, what * (name is names[-1])) for name in names]
    )
    correlations = []
    for side, of in sides:
        means = np.add.reduceat(np.asarray(of.residuals)[rows], starts, axis=0) / sizes[:, None]
        correlations.append((side, *autocorrelation(means, o.run[first].astype(np.intp), most)))
    for number in range(len(names)):
        for side, correlation, pairs in correlations:
            bound = LIKELY / np.sqrt(np.maximum(pairs, 1))
            if side != "before":
                for sign in (1, -1):
                    add_trace(
                        figure, number, "95 % of independent residuals", "bound", x=lag, y=sign * bound, mode="lines",
                        line={"color": SOFT, "width": 1.3, "dash": "dot"}, showlegend=number == 0 and sign == 1,
                    )  # fmt: skip
            add_trace(
                figure, number, side, x=lag, y=correlation[:, number], mode="lines+markers", line={"width": 0.8},
                marker=SIDES[side] | {"size": 7}, customdata=pairs,
                hovertemplate="%{y:.2f} of %{customdata} pairs, %{x:.4g} " + what + "<extra></extra>",
            )  # fmt: skip
        figure.update_layout({f"yaxis{number + 1}": {"range": [-1.05, 1.05], "zeroline": True}})
    return describe(
        figure,
        "autocorrelation",
        "Autocorrelation of the residuals",
        note="Means of poses, in the order of measurement; poses of different runs do not count.",
    )


def _apart(o: Observations, first: Index, k: int) -> Array:
    """Return how far in time poses k apart in one run are, s."""
    same = o.run[first[k:]] == o.run[first[:-k]]
    assert o.t is not None
    apart = (o.t[first[k:]] - o.t[first[:-k]])[same]
    return np.asarray(apart if len(apart) else [np.nan])


# The autocorrelation of a sequence in parts, such as the mean residuals of successive poses in runs.


def autocorrelation(values: Array, part: NDArray[np.intp], most: int) -> tuple[Array, NDArray[np.intp]]:
    """Return the correlation of values k places apart in one part, and of how many pairs, for k = 1 … `most`.

    Parameters
    ----------
    values : ndarray, shape (n, m)
        In order; their mean is taken out.
    part : ndarray of int, shape (n,)
        Pairs in different parts do not count.

    Returns
    -------
    correlation : ndarray, shape (most, m)
        Mean product of pairs over the mean square; NaN without a pair. Of independent values its standard deviation is
        1/√pairs (Bartlett 1946).
    pairs : ndarray of int, shape (most,)

    Examples
    --------
    >>> wave = np.cos(np.arange(12) * np.pi / 2)[:, None]  # 1, 0, -1, 0, …
    >>> correlation, pairs = autocorrelation(wave, np.zeros(12, int), 4)
    >>> correlation[:, 0].round(6) + 0.0, pairs
    (array([ 0., -1.,  0.,  1.]), array([11, 10,  9,  8]))
    """
    e = values - values.mean(axis=0)
    square = np.mean(e**2, axis=0)
    correlations, pairs = np.full((most, values.shape[1]), np.nan), np.zeros(most, np.intp)
    for k in range(1, min(most, len(e) - 1) + 1):
        same = part[k:] == part[:-k]
        pairs[k - 1] = np.count_nonzero(same)
        if pairs[k - 1]:
            product = np.mean((e[k:] * e[:-k])[same], axis=0)
            correlations[k - 1] = np.divide(
                product, square, out=np.full(len(square), np.nan), where=square > 0
            )
    return correlations, pairs
