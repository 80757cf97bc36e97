"""Write the measured table and the pictures of docs/spatial_mechanisms.md.

python docs/make_spatial_mechanisms.py    # docs/spatial_mechanisms.md, puma_postures.png and rrrcc.svg beside it

The table holds `rodgen.spatial.reverse` against Newton's method from 300 starts a pose (tests/numeric_reverse.py).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rodgen.kinematics import spatial
from rodgen.kinematics.spatial import Mechanism, ReverseStatus

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs/spatial_mechanisms.md"
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


def postures() -> Figure:
    """The eight ways of a Puma to one pose: four of the arm, each with two of the wrist, which look alike."""
    robot = spatial.PUMA_560
    T = spatial.forward(robot, np.radians([50.0, 75.0, -140.0, 60.0, 130.0, 20.0]))
    solutions = spatial.reverse(robot, T).solutions
    arms = np.unique(solutions[:, :3].round(6), axis=0)
    middle = (T[:3, 3] + [0, 0, -6]) / 2
    figure = Figure(figsize=(11, 3.3), layout="constrained")
    for n, arm in enumerate(arms):
        panel = figure.add_subplot(1, 4, n + 1, projection="3d")
        same = solutions[np.abs(solutions[:, :3] - arm).max(axis=1) < 1e-5]
        line = corners(robot, same[0])
        panel.plot([0, 0], [0, 0], [-14, 0], color="0.7", lw=7)
        panel.plot(*line.T, color="#0072b2", lw=3, marker="o", ms=4)
        for axis, colour in zip(T[:3, :3].T, ("#d55e00", "#009e73", "#cc79a7"), strict=True):
            panel.plot(*np.array([T[:3, 3], T[:3, 3] + 6 * axis]).T, color=colour, lw=2)
        panel.set(**{f"{name}lim": (x - 15, x + 15) for name, x in zip("xyz", middle, strict=True)})
        panel.set_axis_off()
        panel.set_title("\n".join(", ".join(f"{x:.0f}°" for x in np.degrees(q)) for q in same), fontsize=9)
        panel.view_init(18, -65)
        panel.set_box_aspect((1, 1, 1), zoom=1.3)
    return figure


def main() -> None:
    text = PAGE.read_text(encoding="utf-8")
    start, end = "<!-- table: make_spatial_mechanisms.py -->\n", "<!-- end of table -->"
    head, rest = text.split(start)
    table = "\n".join(rows())
    PAGE.write_text(f"{head}{start}{table}\n{end}{rest.split(end)[1]}", encoding="utf-8")
    postures().savefig(PAGE.with_name("puma_postures.png"), dpi=110, metadata={"Software": None})
    loop = spatial.load_mechanism(ROOT / "examples/mechanisms/rrrcc.csv")
    spatial.save_planar_svg(PAGE.with_name("rrrcc.svg"), loop, "R5", "R1")


if __name__ == "__main__":
    main()
