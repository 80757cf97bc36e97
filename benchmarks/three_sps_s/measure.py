"""Random orientations; rodgen, a loop and vectorised NumPy on their legs; and the direct problem."""

from __future__ import annotations

import os

import clock
import numpy as np
from scipy.spatial.transform import Rotation

from rodgen.kinematics import three_sps_s
from three_sps_s.by_hand import R, by_roots, h, loop, r, searched, vectorised

N = 1_000_000
LOOPED = 2_000
DIRECT = 20_000
BY_ROOTS = 500
SEARCHED = 4
OWN = "rodgen: legs"
OWN_DIRECT = "rodgen: direct_all, all modes"


def measure(*, quick: bool = False) -> dict:
    """Time everything in alternating rounds; check that all answers agree."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    machine = three_sps_s.Geometry(R, r, h)
    n = N // 10 if quick else N
    rotations = Rotation.random(n, random_state=1).as_matrix()
    legs = three_sps_s.legs(rotations, machine)
    _, count, _ = three_sps_s.direct_all(legs[:BY_ROOTS], machine)
    error = float(np.abs(vectorised(rotations[:LOOPED]) - legs[:LOOPED]).max())
    if error > 1e-14 or np.abs(loop(rotations[:LOOPED]) - legs[:LOOPED]).max() > 1e-14:
        raise AssertionError(f"the legs by hand are off by {error:.1e}")
    roots = np.array([len(modes) for modes in by_roots(legs[:BY_ROOTS])])
    search = np.array([len(modes) for modes in searched(legs[:SEARCHED])])
    contenders = {
        OWN: (lambda: three_sps_s.legs(rotations, machine), n),
        "NumPy, vectorised": (lambda: vectorised(rotations), n),
        "NumPy, a loop over orientations": (lambda: loop(rotations[:LOOPED]), LOOPED),
        OWN_DIRECT: (lambda: three_sps_s.direct_all(legs[:DIRECT], machine), DIRECT),
        "NumPy, a loop with numpy.roots": (lambda: by_roots(legs[:BY_ROOTS]), BY_ROOTS),
        "SciPy, root from 40 starts": (lambda: searched(legs[:SEARCHED]), SEARCHED),
    }
    entries = {name: clock.Entry(call, solves) for name, (call, solves) in contenders.items()}
    for entry in entries.values():
        clock.calibrate(entry, 0.05)
    share = clock.alternate(entries, 3 if quick else 7)
    rows = [
        {
            "name": name,
            "points": entry.solves,
            "ns": round(entry.median, 1),
            "spread": round(entry.spread, 3),
            "ratio": round(clock.ratio(entry, entries[OWN if number < 3 else OWN_DIRECT]), 2),
        }
        for number, (name, entry) in enumerate(entries.items())
    ]
    return {
        "rows": rows,
        "rounds": len(entries[OWN].samples),
        "share": round(share, 3),
        "n": n,
        "same_by_roots": float((roots == count).mean()),
        "same_by_search": float((search == count[:SEARCHED]).mean()),
    }
