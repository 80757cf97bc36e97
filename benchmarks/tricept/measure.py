"""Points in the workspace; rodgen, a loop and vectorised NumPy on them; and the direct problem."""

from __future__ import annotations

import os

import clock
import numpy as np

from rodgen.kinematics import tricept
from tricept.by_hand import blocked, loop, with_cofactors, with_solve

N = 1_000_000
LOOPED = 2_000
DIRECT = 200_000
"""Rods within the limits, of which all are solved; the bar is 1e5 a second in one thread."""
OWN = "rodgen: pose and propagate"
FUSED = "rodgen: propagate alone"
U_X = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)


def points(n: int, seed: int = 1) -> np.ndarray:
    """Points of the paper's machine within its limits."""
    rng = np.random.default_rng(seed)
    box = np.array([[-402.4, 430.7], [-373.5, 373.5], [501.7, 836.7]])
    found = np.zeros((0, 3))
    while len(found) < n:
        drawn = rng.uniform(box[:, 0], box[:, 1], (2 * n, 3))
        found = np.concatenate([found, drawn[tricept.reachable(drawn, tricept.PAPER, tricept.LEG_LIMITS)]])
    return found[:n].copy()


def both(Q: np.ndarray) -> tuple:
    pose, legs, _ = tricept.pose(Q, tricept.PAPER, tricept.LEG_LIMITS)
    U_y, _ = tricept.propagate(Q, tricept.PAPER, U_X, tricept.LEG_LIMITS)
    return pose, legs, U_y


def measure(*, quick: bool = False) -> dict:
    """Time everything in alternating rounds; check that all answers agree."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    n = N // 10 if quick else N
    Q = points(n)
    few = Q[:LOOPED]
    legs = tricept.inverse(Q[:DIRECT], tricept.PAPER)[1][:, 0].copy()
    contenders = {
        OWN: (lambda: both(Q), n),
        "rodgen: inverse, all four poses": (
            lambda: tricept.inverse(Q, tricept.PAPER, tricept.LEG_LIMITS),
            n,
        ),
        FUSED: (lambda: tricept.propagate(Q, tricept.PAPER, U_X, tricept.LEG_LIMITS), n),
        "NumPy, matmul and solve": (lambda: with_solve(Q, U_X), n),
        "NumPy, matmul and solve, blocks of 4096": (lambda: blocked(with_solve, 4096)(Q, U_X), n),
        "NumPy, Cramer's rule on components": (lambda: with_cofactors(Q, U_X), n),
        "NumPy, Cramer's rule on components, blocks of 4096": (lambda: blocked(with_cofactors, 4096)(Q, U_X), n),
        "NumPy, a loop over points": (lambda: loop(few, U_X), len(few)),
        "rodgen: direct, the assembled machine's pose": (lambda: tricept.direct(legs, tricept.PAPER), len(legs)),
        "rodgen: direct_all, all real poses": (lambda: tricept.direct_all(legs[:500], tricept.PAPER), 500),
    }  # fmt: skip
    reference = both(few)
    errors = {}
    for name, function in (
        ("NumPy, matmul and solve", with_solve),
        ("NumPy, Cramer's rule on components", with_cofactors),
        ("NumPy, a loop over points", loop),
    ):
        errors[name] = max(
            float(np.abs(a - b).max() / np.abs(b).max())
            for a, b in zip(function(few, U_X), reference, strict=True)
        )
        if errors[name] > 1e-9:
            raise AssertionError(f"{name} computes something else: off by {errors[name]:.1e}")
    entries = {name: clock.Entry(call, solves) for name, (call, solves) in contenders.items()}
    for entry in entries.values():
        clock.calibrate(entry, 0.05)
    share = clock.alternate(entries, 3 if quick else 9)
    rows = [
        {
            "name": name,
            "points": entry.solves,
            "ns": round(entry.median, 1),
            "spread": round(entry.spread, 3),
            "ratio": round(clock.ratio(entry, entries[OWN]), 2),
        }
        for name, entry in entries.items()
    ]
    return {
        "rows": rows,
        "rounds": len(entries[OWN].samples),
        "share": round(share, 3),
        "n": n,
        "errors": errors,
    }
