"""Write the measured table and the pictures of docs/mechanisms/spatial_mechanisms.md.

python docs/mechanisms/make_spatial_mechanisms.py    # and puma_postures.png and rrrcc.svg next to the page

The table holds `rodgen.spatial.reverse` against Newton's method from 300 starts a pose (tests/numeric_reverse.py).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from rodgen import figures, spatial
from rodgen.kinematics.spatial import Mechanism, ReverseStatus

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/mechanisms/spatial_mechanisms.md"
POSES, STARTS = 1000, 300
SAME = 1e-6
"""Angles of one solution, found in two ways."""

sys.path.insert(0, str(ROOT / "tests"))
import numeric_reverse as numeric  # noqa: E402 - the search that the tests use, too


def rows() -> Iterator[str]:
    """A line for each robot."""
    yield "| robot | poses | solutions of the search | of `reverse` | missed | position / reach | angle |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for robot in (spatial.PUMA_560, spatial.GE_P60, spatial.T3_776):
        q = np.random.default_rng(2).uniform(-np.pi, np.pi, (POSES, 6))
        T = numeric.forward(robot, q)
        found = spatial.reverse(robot, T)
        there = found.status <= ReverseStatus.FAMILY
        distance, angle = numeric.errors(
            robot, found.solutions[there], np.broadcast_to(T[:, None], (*there.shape, 4, 4))[there]
        )
        total = missed = 0
        for mine, good, theirs in zip(found.solutions, there, numeric.search(robot, T, STARTS), strict=True):
            total += len(theirs.solutions)
            for one in theirs.solutions:
                off = np.abs(numeric.wrapped(mine[good] - one)).max(axis=1)
                missed += not (off < SAME).any()
        yield (
            f"| {robot.name} | {POSES} | {total} | {there.sum()} | {missed} "
            f"| {distance.max():.1e} | {angle.max():.1e} rad |"
        )


def corners(robot: Mechanism, q: np.ndarray) -> np.ndarray:
    """The arm as a line: along every offset and every length, (points, 3)."""
    frames = spatial.frames(robot, q)
    points = [np.zeros(3)]
    for j, frame in enumerate(frames):
        points.append(frame[:3, 3] - robot.offset[j] * frame[:3, 2])
        points.append(frame[:3, 3])
    return np.array(points)


def postures() -> go.Figure:
    """The eight ways of a Puma to one pose: four of the arm, each with two of the wrist, which look alike."""
    robot = spatial.PUMA_560
    T = spatial.forward(robot, np.radians([50.0, 75.0, -140.0, 60.0, 130.0, 20.0]))
    solutions = spatial.reverse(robot, T).solutions
    arms = np.unique(solutions[:, :3].round(6), axis=0)
    middle = (T[:3, 3] + [0, 0, -6]) / 2
    titles = []
    figure = make_subplots(
        1, 4, specs=[[{"type": "scene"}] * 4], horizontal_spacing=0.01, subplot_titles=[" "] * 4
    )
    for n, arm in enumerate(arms):
        same = solutions[np.abs(solutions[:, :3] - arm).max(axis=1) < 1e-5]
        titles.append(
            "<br>".join(", ".join(f"{x:.0f}°" for x in np.degrees(q)) for q in same).replace("-", "−")
        )
        lines = [(np.array([[0, 0, -14], [0, 0, 0]]), "#bbbbbb", 14), (corners(robot, same[0]), "#0072b2", 7)]
        for axis, colour in zip(T[:3, :3].T, ("#d55e00", "#009e73", "#cc79a7"), strict=True):
            lines.append((np.array([T[:3, 3], T[:3, 3] + 6 * axis]), colour, 5))
        for points, colour, width in lines:
            drawn = go.Scatter3d(
                **dict(zip("xyz", points.T, strict=True)), mode="lines+markers" if colour == "#0072b2" else "lines",
                line={"color": colour, "width": width}, marker={"size": 4, "color": colour},
            )  # fmt: skip
            figure.add_trace(drawn, 1, n + 1)
    limits = {
        f"{name}axis": {"range": [x - 15, x + 15], "visible": False}
        for name, x in zip("xyz", middle, strict=True)
    }
    camera = {"eye": {"x": 0.58, "y": -1.24, "z": 0.44}, "projection": {"type": "orthographic"}}
    figure.update_scenes(**limits, aspectmode="manual", aspectratio=dict.fromkeys("xyz", 1.75), camera=camera)
    for note, title in zip(figure.layout.annotations, titles, strict=True):
        note.update(text=title, font={"size": 12}, y=0.98)
    figure.update_layout(width=1100, height=360, showlegend=False, margin={"l": 4, "r": 4, "t": 44, "b": 4})
    return figure


def main() -> None:
    text = PAGE.read_text(encoding="utf-8")
    start, end = "<!-- table: make_spatial_mechanisms.py -->\n", "<!-- end of table -->"
    head, rest = text.split(start)
    table = "\n".join(rows())
    PAGE.write_text(f"{head}{start}{table}\n{end}{rest.split(end)[1]}", encoding="utf-8")
    figures.save_figure(postures(), PAGE.with_name("puma_postures.png"))
    loop = spatial.load_mechanism(ROOT / "examples/mechanisms/rrrcc.csv")
    figures.save_figure(figures.planar_representation(loop, "R5", "R1"), PAGE.with_name("rrrcc.svg"))


if __name__ == "__main__":
    main()
