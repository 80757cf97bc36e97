"""The whole way, from a paper's equations to the axis of a real machine: derive, generate, solve, fit, draw.

Run by ``make demo``. It uses the rotary positioner's measurements where they are beside this checkout, and the
invented example in this folder elsewhere.
"""

from __future__ import annotations

import contextlib
import csv
import io
import os
import textwrap
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rodgen
from rodgen import cli
from rodgen._scripts import load_derivation, packaged_derivations
from rodgen.codegen.project import write_kernels

HERE = Path(os.path.relpath(Path(__file__).resolve().parent))
POSITIONER = HERE / "../../shared/data/positioner/data.csv"
OUTPUT = HERE / "../build/demo"
STEP = 4  # poses apart: a quarter turn of the positioner's second axis


@dataclass
class Moves:
    """Readings of three points of a body, before and after each of its moves about one axis."""

    before: np.ndarray  # (moves, 3 points, 3), mm
    after: np.ndarray
    angle: np.ndarray  # (moves,), rad

    def pairs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Give points before, points after, angles: what `fit_axis` takes."""
        return self.before.reshape(-1, 3), self.after.reshape(-1, 3), np.repeat(self.angle, 3)

    def directions(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Give the differences between points of the body: the place of the axis drops out of them."""
        before, after = (x[:, 1:] - x[:, :1] for x in (self.before, self.after))
        return before.reshape(-1, 3), after.reshape(-1, 3), np.repeat(self.angle, 2)


def derive_and_generate() -> None:
    print("1. Derive: every statement is proved exactly, or refuted by an exact counterexample")
    start = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):  # what they show is for the notebooks
        derivations = [load_derivation(name) for name in packaged_derivations()]
    seconds = time.perf_counter() - start
    for derivation in derivations:
        count = {verdict: sum(e.verdict == verdict for e in derivation) for verdict in ("proved", "refuted")}
        print(f"   {derivation.name:10} {count['proved']:3} proved, {count['refuted']:2} refuted")
        for entry in derivation:
            if entry.refutation:
                line = f"{entry.refutation.label:4} {entry.place}: {entry.refutation.because}"
                print(f"     {textwrap.shorten(line, 108, placeholder=' ...')}")
    print(f"   all in {seconds:.1f} s; in full: rodgen derive NAME, rodgen errata\n")

    print("2. Generate: NumPy, C and NumPy extension from the derivations")
    start = time.perf_counter()
    changed = write_kernels(derivations, HERE / "../generated", extension=True)
    what = "byte for byte what is there" if not changed else f"new: {', '.join(p.name for p in changed)}"
    kernels = sum(len(d.kernels) for d in derivations)
    print(f"   {kernels} kernels in {time.perf_counter() - start:.1f} s, {what}")
    print(f"   in use now: {rodgen.backend}\n")


def read_positioner() -> Iterator[tuple[float, Moves]]:
    """Give the moves about the second axis, for each angle of the first axis, which carries it.

    No reading stands in two pairs, so that the errors of pairs are independent.
    """
    with POSITIONER.open(newline="") as file:
        rows = list(csv.DictReader(file))
    first, second = (np.array([float(row[f"{name} [rad]"]) for row in rows[::3]]) for name in ("P1", "P2"))
    points = np.array([[float(row[f"{axis} [mm]"]) for axis in "xyz"] for row in rows]).reshape(-1, 3, 3)
    for run in np.split(np.arange(len(first)), np.flatnonzero(np.abs(np.diff(first)) > 1e-3) + 1):
        free = list(run)
        moves = []
        for pose in run[:-STEP]:
            if pose in free and pose + STEP in free:
                moves.append((pose, pose + STEP))
                free.remove(pose)
                free.remove(pose + STEP)
        start, end = np.array(moves).T
        yield first[run].mean(), Moves(points[start], points[end], second[end] - second[start])


def read_example() -> Moves:
    with (HERE / "pairs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    before, after = (
        np.array([[float(row[f"{point}_{axis} [mm]"]) for axis in "xyz"] for row in rows]).reshape(-1, 3, 3)
        for point in ("rho", "rho_prime")
    )
    return Moves(before, after, np.radians([float(row["angle [deg]"]) for row in rows[::3]]))


def write_table(name: str, pairs: tuple[np.ndarray, np.ndarray, np.ndarray]) -> str:
    OUTPUT.mkdir(parents=True, exist_ok=True)
    columns = [f"{point}_{axis} [mm]" for point in ("rho", "rho_prime") for axis in "xyz"]
    file = OUTPUT / name
    table = np.column_stack(pairs)
    np.savetxt(
        file, table, fmt="%.9g", delimiter=",", header=",".join([*columns, "angle [rad]"]), comments=""
    )
    return os.path.relpath(file)


def run(*arguments: str) -> None:
    print(f"   $ rodgen {' '.join(arguments)}", flush=True)
    if code := cli.main(arguments):
        raise SystemExit(code)


def solve_and_fit(moves: Moves) -> None:
    pairs, directions = (
        write_table("pairs.csv", moves.pairs()),
        write_table("directions.csv", moves.directions()),
    )
    axes = os.path.relpath(OUTPUT / "axes.csv")
    run("solve", directions, "--length-tolerance", "0.01", "-o", axes)
    fit = rodgen.fit_axis(*moves.pairs(), loss="huber")
    with open(axes, newline="") as file:
        found = np.array([[float(r[f"e{n}_{c}"]) for n in "12" for c in "xyz"] for r in csv.DictReader(file)])
    miss = np.linalg.norm(np.cross(found.reshape(-1, 2, 3), fit.axis), axis=-1).min(axis=-1)
    print(
        f"   One of the two axes of a pair is the machine's: {1e3 * np.median(miss):.2f} mrad in the median, at most "
        f"{1e3 * miss.max():.2f} mrad,\n   from the one axis that fits all pairs best:\n"
    )
    run("fit-axis", pairs, "--loss", "huber", "--plot", os.path.relpath(OUTPUT / "axis.png"))
    print(f"\n   drawn in {os.path.relpath(OUTPUT / 'axis.png')}")


def positioner() -> None:
    print(f"3. Measured: a two-axis rotary positioner seen by a camera, {os.path.relpath(POSITIONER)}")
    print(
        "   The axis of P2 for each angle of P1, which carries it; three points at poses a quarter turn apart:\n"
    )
    print("   P1 [deg]   axis in the camera's frame         uncertainty [mrad]   rms [mm]   outliers")
    runs = list(read_positioner())
    fits = [rodgen.fit_axis(*moves.pairs(), loss="huber") for _, moves in runs]
    for (angle, _), fit in zip(runs, fits, strict=True):
        print(
            f"   {np.degrees(angle):7.2f}   ({', '.join(f'{x:8.5f}' for x in fit.axis)})   "
            f"{'   '.join(f'{1e3 * u:.2f}' for u in fit.axis_uncertainty):>18}   {fit.rms:8.3f}   "
            f"{fit.outliers.sum():5} of {fit.pairs}"
        )
    print("\n   The last of them, by the command line:\n")
    solve_and_fit(runs[-1][1])

    # The axis of P1 turns the axis of P2 into that of the next run: pairs of directions, each used once.
    angles, axes = np.array([angle for angle, _ in runs]), np.array([fit.axis for fit in fits])
    half = len(runs) // 2
    carrier = rodgen.fit_axis(
        axes[:half], axes[half : 2 * half], angles[half : 2 * half] - angles[:half], point=(0, 0, 0)
    )
    between = np.degrees(np.arccos(axes @ carrier.axis))
    print(
        f"\n   P1 turns those axes about ({', '.join(f'{x:.4f}' for x in carrier.axis)}): P1 and P2 make an angle of "
        f"{between.mean():.3f} deg,\n   {between.std(ddof=1) / len(between) ** 0.5:.3f} standard uncertainty of the "
        f"mean of {len(between)}. The three points of a pose share errors, so the\n   uncertainties above are up to √3 "
        "too small."
    )


def main() -> None:
    derive_and_generate()
    if POSITIONER.is_file():
        positioner()
    else:
        print("3. Solve and fit: an invented example (make_pairs.py says its noise and its one gross error)")
        solve_and_fit(read_example())


if __name__ == "__main__":
    main()
