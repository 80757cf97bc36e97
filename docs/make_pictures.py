"""Draw the pictures of the README and of the tutorials.

python docs/make_pictures.py        # writes docs/mount.png and docs/axes.png

mount.png: a telescope's model against its measurements, before and after two effects were added. axes.png: the two
axes of one pair of points, and how exactly they are found.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import mpmath
import numpy as np

import rodgen
from rodgen.codegen.compile import compile_kernel
from rodgen.derivation import rodrigues

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "0.6"
SAMPLES = 200  # directions and axes at each angle
DIGITS = 50


def turn(points, axis, angles):
    """Rotate about a unit axis, every point by every angle."""
    theta, _ = rodgen.rodrigues_vector(axis, np.asarray(angles))
    return rodgen.rotate(points, theta)


def draw_axes(panel) -> None:
    angle = 1.7
    truth = np.array([0.1, 0.25, 0.963]) / np.linalg.norm([0.1, 0.25, 0.963])
    before = np.array([0.80, -0.35, 0.49]) / np.linalg.norm([0.80, -0.35, 0.49])
    after = turn(before, truth, angle)
    axes, _ = rodgen.solve_axis(before, after, angle)

    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 60), np.linspace(0, np.pi, 30))
    ball = np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)
    panel.plot_surface(*ball, color="0.9", alpha=0.25, linewidth=0)
    for axis, colour, name in zip(axes, (BLUE, ORANGE), ("$e_+$", "$e_-$"), strict=True):
        panel.plot(*np.array([0 * axis, 1.3 * axis]).T, color=colour, linewidth=2.5)
        panel.text(*(1.42 * axis), name, color=colour, fontsize=14)
        panel.plot(*turn(before, axis, np.linspace(0, angle, 80)).T, color=colour, linewidth=2.5)
        rim = turn(before, axis, np.linspace(-np.pi * 0.999, np.pi * 0.999, 121))
        panel.plot(*rim.T, color=colour, linewidth=0.9, linestyle=":")
        for spoke in rim[::12]:
            panel.plot(*np.array([0 * spoke, spoke]).T, color=colour, linewidth=0.35)
    for point, name, place in ((before, "ρ", (1.0, 1.1, 0.62)), (after, "ρ′", (1.1, 1.14, 1.1))):
        panel.scatter(*point, color="black", s=24, depthshade=False)
        panel.text(*(np.array(place) * point), name, fontsize=14)
    panel.set(xlim=(-0.75, 0.75), ylim=(-0.75, 0.75), zlim=(-0.5, 1.0))
    panel.set_box_aspect((1, 1, 1), zoom=0.95)
    panel.view_init(elev=24, azim=-38)
    panel.set_axis_off()
    panel.set_title("Two axes turn ρ into ρ′ by the known angle", fontsize=11)


def exact_pairs(angle: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give points before, after and the axis between them, each rounded once from 50 digits."""
    rows = []
    for _ in range(SAMPLES):
        axis, point = (mpmath.matrix(random.normal(size=3).tolist()) for _ in range(2))
        axis /= mpmath.norm(axis)
        chi = mpmath.mpf(angle)
        along = axis * mpmath.fdot(axis, point)
        cross = mpmath.matrix(
            [
                axis[(i + 1) % 3] * point[(i + 2) % 3] - axis[(i + 2) % 3] * point[(i + 1) % 3]
                for i in range(3)
            ]
        )
        after = along + mpmath.cos(chi) * (point - along) + mpmath.sin(chi) * cross
        rows.append([[float(x) for x in vector] for vector in (point, after, axis)])
    return tuple(np.array(rows).transpose(1, 0, 2))


def draw_accuracy(panel) -> None:
    random = np.random.default_rng(1)
    far = np.pi - np.logspace(-9, -0.3, 25)
    angles = np.concatenate([np.logspace(-9, 0.3, 30), far[::-1]])
    errors = np.empty((len(angles), 2, SAMPLES))
    solve_axis_paper = compile_kernel(rodrigues.paper)
    with mpmath.workdps(DIGITS):
        for row, angle in zip(errors, angles, strict=True):
            before, after, axis = exact_pairs(angle, random)
            paper = solve_axis_paper(before, after, angle)[0]
            paper = paper / np.linalg.norm(paper, axis=-1, keepdims=True)
            found, _ = rodgen.solve_axis(before, after, angle)
            # What no method can undo: the points are rounded, and the axis feels that by its condition.
            unit = np.finfo(float).eps * rodgen.axis_condition(before, after, angle)
            for n, axes in enumerate((paper, found)):
                error = np.abs(axes - axis[:, None]).max(axis=-1).min(axis=-1)
                row[n] = np.where(np.isfinite(error), error, 1) / unit  # no number is as bad as any axis
    x = np.arange(len(angles))
    for n, colour, marker, name in ((0, ORANGE, "s", "the paper's formulas"), (1, BLUE, "o", "rodgen")):
        worst = errors[:, n].max(axis=-1)
        panel.plot(x, np.clip(worst, 1e-2, 1e17), color=colour, marker=marker, markersize=3.5, label=name)
    ticks = {0: "1e-9", 10: "1e-6", 19: "1e-3", 29: "2", 41: "π − 1e-5", 54: "π − 1e-9"}
    panel.set_xticks(list(ticks), list(ticks.values()))
    panel.set_yscale("log")
    panel.set_xlabel("angle of rotation [rad]")
    panel.set_ylabel("largest error / (condition × rounding unit)")
    panel.grid(color="0.9", linewidth=0.6)
    panel.legend(frameon=False, fontsize=9, loc="upper left")
    panel.set_title("Found to the last digits that the data hold", fontsize=11)


def draw_mount() -> plt.Figure:
    """The residuals of the telescope's mount, and how they fall with two effects."""
    folder = Path(__file__).parent.parent / "examples/machines/mount"
    machine = rodgen.Machine.load(folder / "machine.toml")
    data = rodgen.Measurements.load(folder / "mmt_2021.csv")
    sagging = machine.add("gravity_windup", joint="EL", hold={"k2": 0})
    fits = [m.fit(data) for m in (machine, sagging, sagging.add("refraction"))]

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained", width_ratios=[1.5, 1])
    elevation = np.degrees(fits[0].observations.q[:, 1])
    for fit, style, label in (
        (fits[0], {"marker": "o", "mfc": "none", "mec": ORANGE}, "two axes and a tube"),
        (fits[2], {"marker": ".", "color": BLUE}, "with gravity and refraction"),
    ):
        left.plot(elevation, fit.residuals[:, 1], linestyle="none", label=label, **style)
    left.axhline(0, color=GREY, linewidth=0.8)
    left.set(xlabel="elevation [deg]", ylabel="measured − predicted [arcsec]")
    left.set_title("Towards the zenith, 80 stars", fontsize=11)
    left.legend(frameon=False)

    names = ["base", "+ gravity_windup\nat EL", "+ refraction"]
    right.plot(names, [fit.rms for fit in fits], "o-", color=BLUE, label="fitted")
    right.plot(names, [fit.held_out().rms for fit in fits], "s:", color=BLUE, mfc="white", label="held out")
    for at, fit in enumerate(fits):
        right.annotate(f"{fit.rms:.2f}″", (at, fit.rms), (8, 4), textcoords="offset points")
    right.set(ylim=(0, None), xlim=(-0.3, 2.5), ylabel="rms per reading [arcsec]")
    right.set_title("The error falls", fontsize=11)
    right.legend(frameon=False)
    return figure


def draw_axes_and_accuracy() -> plt.Figure:
    figure = plt.figure(figsize=(10, 4.4), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=[1, 1.15])
    draw_axes(figure.add_subplot(grid[0], projection="3d"))
    draw_accuracy(figure.add_subplot(grid[1]))
    return figure


def main() -> None:
    for name, draw in (("mount.png", draw_mount), ("axes.png", draw_axes_and_accuracy)):
        file = Path(__file__).with_name(name)
        draw().savefig(file, dpi=110, metadata={"Software": None})
        print(file)


if __name__ == "__main__":
    main()
