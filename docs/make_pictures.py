"""Draw the pictures of the README and of the page on the solver.

python docs/make_pictures.py        # writes docs/slide.png, docs/mount.png and docs/science/axes.png

slide.png: a slide's error over its travel, before and after its thermal expansion is added.
mount.png: a telescope's model against its measurements, before and after the two effects that ``make demo`` adds.
axes.png: the two axes of one pair of points, and how exactly they are found.
"""

from __future__ import annotations

from pathlib import Path

import mpmath
import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

import rodgen
from rodgen import figures
from rodgen.codegen import numpy_function
from rodgen.derivation import rodrigues

BLUE, ORANGE = "#0072b2", "#c04d00"
SAMPLES = 200  # directions and axes at each angle
DIGITS = 50


def turn(points, axis, angles):
    """Rotate about a unit axis, every point by every angle."""
    theta, _ = rodgen.rodrigues_vector(axis, np.asarray(angles))
    return rodgen.rotate(points, theta)


def draw_axes(figure: go.Figure) -> None:
    """Add the two axes of one pair of points to the scene of a figure."""
    angle = 1.7
    truth = np.array([0.1, 0.25, 0.963]) / np.linalg.norm([0.1, 0.25, 0.963])
    before = np.array([0.80, -0.35, 0.49]) / np.linalg.norm([0.80, -0.35, 0.49])
    after = turn(before, truth, angle)
    axes, _ = rodgen.solve_axis(before, after, angle)

    def draw(points: np.ndarray, colour: str, width: float, dash: str = "solid") -> None:
        line = {"color": colour, "width": width, "dash": dash}
        figure.add_trace(go.Scatter3d(**dict(zip("xyz", points.T, strict=True)), mode="lines", line=line))

    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 60), np.linspace(0, np.pi, 30))
    ball = {"x": np.cos(u) * np.sin(v), "y": np.sin(u) * np.sin(v), "z": np.cos(v)}
    grey = [[0, "#dddddd"], [1, "#dddddd"]]
    figure.add_trace(go.Surface(**ball, opacity=0.18, colorscale=grey, showscale=False))
    texts = []
    for axis, colour, name in zip(
        axes, (BLUE, ORANGE), ("<b>e<sub>+</sub></b>", "<b>e<sub>−</sub></b>"), strict=True
    ):
        draw(np.array([0 * axis, 1.3 * axis]), colour, 6)
        draw(turn(before, axis, np.linspace(0, angle, 80)), colour, 6)
        rim = turn(before, axis, np.linspace(-np.pi * 0.999, np.pi * 0.999, 121))
        draw(rim, colour, 2, "dot")
        spokes = np.array([point for spoke in rim[::12] for point in (0 * spoke, spoke, np.full(3, np.nan))])
        draw(spokes, colour, 1)
        texts.append((1.42 * axis, name, colour))
    for point, name, place in ((before, "ρ", (1.0, 1.06, 0.82)), (after, "ρ′", (1.1, 1.14, 1.1))):
        where = dict(zip("xyz", np.atleast_2d(point).T, strict=True))
        figure.add_trace(go.Scatter3d(**where, mode="markers", marker={"color": "black", "size": 4}))
        texts.append((np.array(place) * point, name, "black"))
    notes = [
        {
            **dict(zip("xyz", at, strict=True)),
            "text": name,
            "showarrow": False,
            "font": {"size": 18, "color": colour},
        }
        for at, name, colour in texts
    ]  # fmt: skip
    hidden = {"visible": False}
    figure.update_scenes(
        xaxis=hidden, yaxis=hidden, zaxis=hidden, aspectmode="data", annotations=notes,
        camera={"eye": {"x": 1.05, "y": -0.82, "z": 0.6}, "center": {"x": 0, "y": 0, "z": 0.02}},
    )  # fmt: skip


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


def draw_accuracy(figure: go.Figure) -> None:
    """Add the errors of the paper's formulas and of rodgen, over the angle, to the axes of a figure."""
    random = np.random.default_rng(1)
    far = np.pi - np.logspace(-9, -0.3, 25)
    angles = np.concatenate([np.logspace(-9, 0.3, 30), far[::-1]])
    errors = np.empty((len(angles), 2, SAMPLES))
    solve_axis_paper = numpy_function(rodrigues.paper)
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
    for n, colour, symbol, name in (
        (0, ORANGE, "square", "the paper's formulas"),
        (1, BLUE, "circle", "rodgen"),
    ):
        worst = errors[:, n].max(axis=-1)
        mark = {"symbol": symbol, "color": colour, "size": 6}
        worst = np.clip(worst, 1e-2, 1e17)
        figure.add_trace(go.Scatter(x=x, y=worst, mode="lines+markers", marker=mark, name=name), 1, 2)
    ticks = {0: "1e-9", 10: "1e-6", 19: "1e-3", 29: "2", 41: "π − 1e-5", 54: "π − 1e-9"}
    figure.update_xaxes(
        tickvals=list(ticks), ticktext=list(ticks.values()), title="angle of rotation [rad]", row=1, col=2
    )
    title = "largest error / (condition × machine epsilon)"
    figure.update_yaxes(type="log", exponentformat="power", dtick=3, title=title, row=1, col=2)


def draw_slide() -> go.Figure:
    """The error of a slide along its travel, and how it falls with the effect that a diagnosis finds."""
    folder = Path(__file__).parent.parent / "examples/off_by_20_um"
    machine = rodgen.Machine.load(folder / "machine.toml")
    data = rodgen.Measurements.load(folder / "data.csv")
    fits = [m.fit(data) for m in (machine, machine.add("thermal_expansion", joint="X"))]
    titles = ("Along the slide, 51 readings", "The error falls")
    figure = make_subplots(1, 2, column_widths=[0.68, 0.32], horizontal_spacing=0.09, subplot_titles=titles)
    marks = (
        {"symbol": "circle-open", "color": ORANGE, "size": 8},
        {"symbol": "circle", "color": BLUE, "size": 6},
    )
    for fit, mark, name in zip(fits, marks, ("as described", "with thermal expansion"), strict=True):
        x, y = fit.observations.q[:, 0], 1000 * fit.residuals[:, 0]
        figure.add_trace(go.Scatter(x=x, y=y, mode="markers", marker=mark, name=name), 1, 1)
    figure.update_xaxes(title="X [mm]", row=1, col=1)
    figure.update_yaxes(title="measured − predicted [µm]", row=1, col=1)
    sizes = [1000 * fit.rms for fit in fits]
    text = [f"{size:.2f} µm" for size in sizes]
    bars = go.Bar(x=["before", "after"], y=sizes, text=text, marker_color=[ORANGE, BLUE], showlegend=False)
    figure.add_trace(bars, 1, 2)
    figure.update_yaxes(title="rms per reading [µm]", showgrid=False, row=1, col=2)
    figure.update_layout(legend={"x": 0.02, "y": 0.98, "yanchor": "top", "bgcolor": "rgba(255,255,255,0.85)"})
    return styled(figure, 360)


def draw_mount() -> go.Figure:
    """The residuals of the telescope's mount, and how they fall with the effects that a diagnosis finds."""
    folder = Path(__file__).parent.parent / "examples/machines/mount"
    machine = rodgen.Machine.load(folder / "machine.toml")
    data = rodgen.Measurements.load(folder / "mmt_2021.csv")
    sagging = machine.add("tube_flexure")
    fits = [m.fit(data) for m in (machine, sagging, sagging.add("refraction"))]

    titles = ("Towards the zenith, 80 stars", "The error falls")
    figure = make_subplots(1, 2, column_widths=[0.6, 0.4], horizontal_spacing=0.09, subplot_titles=titles)
    elevation = np.degrees(fits[0].observations.q[:, 1])
    for fit, mark, name in (
        (fits[0], {"symbol": "circle-open", "color": ORANGE, "size": 7}, "two axes and a tube"),
        (fits[2], {"symbol": "circle", "color": BLUE, "size": 5}, "with flexure and refraction"),
    ):
        figure.add_trace(
            go.Scatter(x=elevation, y=fit.residuals[:, 1], mode="markers", marker=mark, name=name), 1, 1
        )
    figure.update_xaxes(title="elevation [deg]", row=1, col=1)
    figure.update_yaxes(title="measured − predicted [arcsec]", row=1, col=1)
    names = ["base", "+ tube<br>flexure", "+ refraction"]
    for values, mark, dash, name in (
        ([fit.rms for fit in fits], {"symbol": "circle", "color": BLUE, "size": 9}, "solid", "fitted"),
        (
            [fit.held_out().rms for fit in fits],
            {"symbol": "square-open", "color": ORANGE, "size": 9, "line": {"width": 2}},
            "dot",
            "held out",
        ),
    ):
        line = {"color": mark["color"], "dash": dash, "width": 1.5}
        given = {"mode": "lines+markers", "marker": mark, "line": line, "name": name, "legend": "legend2"}
        figure.add_trace(go.Scatter(x=names, y=values, **given), 1, 2)
    for name, fit in zip(names, fits, strict=True):
        figure.add_annotation(
            x=name, y=fit.rms, text=f"{fit.rms:.2f}″", showarrow=False, xshift=24, yshift=16, bgcolor="white",
            xref="x2", yref="y2",
        )  # fmt: skip
    figure.update_yaxes(title="rms per reading [arcsec]", range=[0, 3.2], showgrid=False, row=1, col=2)
    figure.update_xaxes(range=[-0.35, 2.6], showgrid=False, row=1, col=2)
    legend = {"y": 0.98, "yanchor": "top", "bgcolor": "rgba(255,255,255,0.85)"}
    figure.update_layout(legend={**legend, "x": 0.02}, legend2={**legend, "x": 0.98, "xanchor": "right"})
    figure.update_yaxes(range=[-6.5, 10.5], row=1, col=1)
    return styled(figure, 400)


def draw_axes_and_accuracy() -> go.Figure:
    titles = ("Two axes turn ρ into ρ′ by the known angle", "Found to the last digits that the data hold")
    figure = make_subplots(
        1, 2, specs=[[{"type": "scene"}, {"type": "xy"}]], column_widths=[0.46, 0.54], horizontal_spacing=0.08,
        subplot_titles=titles,
    )  # fmt: skip
    draw_axes(figure)
    figure.update_traces(showlegend=False)
    draw_accuracy(figure)
    figure.update_layout(legend={"x": 0.56, "y": 0.98, "yanchor": "top"})
    return styled(figure, 460)


def styled(figure: go.Figure, height: int) -> go.Figure:
    figure.update_layout(
        template="plotly_white", width=1000, height=height, margin={"l": 60, "r": 12, "t": 40, "b": 60}
    )
    return figure


def main() -> None:
    for name, draw in (
        ("slide.png", draw_slide),
        ("mount.png", draw_mount),
        ("science/axes.png", draw_axes_and_accuracy),
    ):
        file = Path(__file__).parent / name
        figures.save_figure(draw(), file)
        print(file)


if __name__ == "__main__":
    main()
