"""Write the numbers and the pictures of docs/mechanisms/tricept.md.

python docs/mechanisms/make_tricept.py        # the table, tricept_map.png and tricept_bounds.png

The table compares the paper's eq. (24) with the sums of influences, the paper's method, and with the true ranges.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from rodgen import figures, tricept

PAGE = Path(__file__).with_name("tricept.md")
U_X = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
BOX = np.array([-80.0, -80.0, 605.0]), np.array([80.0, 80.0, 765.0])
PRINTED = {
    "xx": (18.5, 36.8),
    "yy": (18.5, 37.0),
    "zz": (3.8, 13.8),
    "xy": (-7.0896, 7.0896),
    "xz": (-7.3262, 7.2188),
    "yz": (-7.3394, 7.3394),
}
"""Eq. (24), in 1e-6 mm²."""
GAP = 1e-4


def table(found: tricept.Bounds) -> str:
    """Return the table of eq. (24), the sums, and the ranges: certified, from outside, and reached, from inside."""
    lines = [
        "| element | eq. (24) | sum of influences | its ends off | range, certified | range, reached | sum / range |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for n, name in enumerate(tricept.ELEMENTS):
        low, high = PRINTED[name]
        base, outer, inner = (1e6 * x[n] for x in (found.base_inner, found.outer, found.inner))
        off = [100 * (a / b - 1) for a, b in zip(base, (low, high), strict=True)]
        cells = [f"{low:g} … {high:g}", f"{base[0]:.4f} … {base[1]:.4f}", f"{off[0]:+.2f} %, {off[1]:+.2f} %"]
        cells += [f"{x[0]:.4f} … {x[1]:.4f}" for x in (outer, inner)]
        lines.append(f"| {name} | {' | '.join(cells)} | {found.excess[n]:.2f} |")
    return "\n".join(lines).replace("-", "−").replace("| −−− ", "| --- ")


def draw_bounds(found: tricept.Bounds) -> go.Figure:
    """Return a figure of the paper's intervals, the sums, and the ranges, each relative to the middle of the range."""
    figure = go.Figure()
    kinds = (
        ("eq. (24), as printed", lambda n, name: 1e-6 * np.array(PRINTED[name]), -0.24, "#999999"),
        ("sum of influences, certified", lambda n, name: found.base_outer[n], 0.0, "#d55e00"),
        ("range, certified and reached", lambda n, name: found.outer[n], 0.24, "#0072b2"),
    )
    for label, ends_of, offset, colour in kinds:
        x, y = [], []
        for n, name in enumerate(tricept.ELEMENTS):
            middle, half = found.inner[n].mean(), np.ptp(found.inner[n]) / 2
            x += [*((ends_of(n, name) - middle) / half), None]
            y += [n + offset, n + offset, None]
        figure.add_trace(go.Scatter(x=x, y=y, mode="lines", name=label, line={"color": colour, "width": 7}))
    names = [f"U_y[{name}]" for name in tricept.ELEMENTS]
    figure.update_yaxes(
        tickvals=list(range(6)), ticktext=names, range=[5.6, -0.6], showgrid=False, zeroline=False
    )
    for end in (-1, 1):
        figure.add_vline(end, line={"color": "#bbbbbb", "width": 1}, layer="below")
    figure.update_xaxes(
        title="deviation from the middle of the range / half the range",
        showgrid=False,
        zeroline=False,
        range=[-5.8, 5.8],
    )
    legend = {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0}
    figure.update_layout(
        template="plotly_white",
        width=900,
        height=360,
        legend=legend,
        margin={"l": 70, "r": 20, "t": 40, "b": 50},
    )
    return figure


def main() -> None:
    """Write the table and the pictures."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    found = tricept.bounds(*BOX, tricept.PAPER, U_X, gap=GAP)
    text = PAGE.read_text(encoding="utf-8")
    start, end = "<!-- table: make_tricept.py -->\n", "<!-- end of table -->"
    head, rest = text.split(start)
    PAGE.write_text(f"{head}{start}{table(found)}\n{end}{rest.split(end)[1]}", encoding="utf-8")
    figures.save_figure(draw_bounds(found), PAGE.with_name("tricept_bounds.png"))
    slices = tricept.uncertainty_map(tricept.PAPER, U_X, "y", 0.0, tricept.LEG_LIMITS)
    figures.save_figure(figures.uncertainty_map(slices), PAGE.with_name("tricept_map.png"))


if __name__ == "__main__":
    main()
