"""Write the numbers and the pictures of docs/tricept.md.

python docs/make_tricept.py        # the table in docs/tricept.md, docs/tricept_map.png and docs/tricept_bounds.png

The table stands beside the paper's eq. (24): the sums of influences, which are the paper's way, and the true ranges.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rodgen.kinematics import tricept

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
    """Eq. (24), the sums, and the ranges: certified, which is outwards of what is reached."""
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


def draw_bounds(found: tricept.Bounds) -> Figure:
    """The paper's intervals, the sums, and the ranges, each relative to the middle of the range."""
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    panel = figure.subplots()
    for n, name in enumerate(tricept.ELEMENTS):
        middle, half = found.inner[n].mean(), np.ptp(found.inner[n]) / 2
        for ends, offset, colour, width in (
            (1e-6 * np.array(PRINTED[name]), 0.22, "0.55", 5),
            (found.base_outer[n], 0.0, "#e69f00", 5),
            (found.outer[n], -0.22, "#0072b2", 5),
        ):
            panel.plot(
                (ends - middle) / half, [-n + offset] * 2, color=colour, lw=width, solid_capstyle="butt"
            )
    for colour, label in (
        ("0.55", "eq. (24), as printed"),
        ("#e69f00", "sum of influences, certified"),
        ("#0072b2", "range, certified and reached"),
    ):
        panel.plot([], [], color=colour, lw=5, label=label)
    panel.set_yticks(-np.arange(6), [f"U_y[{name}]" for name in tricept.ELEMENTS])
    panel.set_xlabel("deviation from the middle of the range / half the range")
    panel.axvline(-1, color="0.8", lw=0.8, zorder=0)
    panel.axvline(1, color="0.8", lw=0.8, zorder=0)
    panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    return figure


def main() -> None:
    found = tricept.bounds(*BOX, tricept.PAPER, U_X, gap=GAP)
    text = PAGE.read_text(encoding="utf-8")
    start, end = "<!-- table: make_tricept.py -->\n", "<!-- end of table -->"
    head, rest = text.split(start)
    PAGE.write_text(f"{head}{start}{table(found)}\n{end}{rest.split(end)[1]}", encoding="utf-8")
    tricept.save_figure(PAGE.with_name("tricept_bounds.png"), draw_bounds(found))
    slices = tricept.uncertainty_map(tricept.PAPER, U_X, "y", 0.0, tricept.LEG_LIMITS)
    tricept.save_figure(PAGE.with_name("tricept_map.png"), tricept.draw_uncertainty_map(slices))


if __name__ == "__main__":
    main()
