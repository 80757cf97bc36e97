"""The trigonometric equation and pairs of equations: rodgen, by hand, and what the machine allows."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable

import clock
import limits
import numpy as np
from contenders import native
from environments import HERE

from rodgen.kinematics import spatial
from spatial.by_hand import (
    all_at_once,
    by_eigenvalues,
    by_pencils,
    by_roots,
    companions,
    eigenvalues_alone,
    trig_vectorised,
)

TRIG = 4_000_000
CACHED = 4_000
PAIRS = 100_000
STABLE_PAIRS = 4_000
LOOPED = 300
COUNT = 256  # trig_limit.c's COUNT
BYTES = 41
"""Three coefficients in, two angles and a status out."""
OWN_TRIG, OWN_CACHED = "rodgen: solve_trig", "rodgen: solve_trig, 4,000 at a time"
OWN_PAIR, OWN_STABLE = "rodgen: solve_pair", "rodgen: solve_pair, eigenvalues throughout"
ARITHMETIC, BANDWIDTH = "limit: arithmetic", "limit: memory"


def measure(*, quick: bool = False) -> dict:
    """Time everything in alternating rounds; check that all answers agree."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    rounds = 3 if quick else 7
    return {
        "trig": _trig(TRIG // 10 if quick else TRIG, rounds),
        "pair": _pair(PAIRS // 10 if quick else PAIRS, rounds),
    }


def _trig(n: int, rounds: int) -> dict:
    rng = np.random.default_rng(1)
    A, B, D = (limits.aligned(n) for _ in range(3))
    A[:], B[:] = rng.normal(size=(2, n))
    D[:] = rng.uniform(-1, 1, size=n) * np.hypot(A, B)
    out = limits.aligned(2 * n).reshape(n, 2), limits.aligned(n, np.int8)
    theta, status = spatial.solve_trig(A, B, D)
    looped = trig_vectorised(A[:CACHED], B[:CACHED], D[:CACHED])
    apart = np.abs(np.remainder(looped - theta[:CACHED] + np.pi, 2 * np.pi) - np.pi)
    g = np.sqrt(1 - (D / np.hypot(A, B))[:CACHED] ** 2)
    if status.any() or (apart * g[:, None]).max() > 1e-14:
        raise AssertionError("the angles by hand are others")
    part = slice(0, CACHED)
    triad = limits.Triad(n)
    contenders: dict[str, tuple[Callable[[], object], int]] = {
        OWN_TRIG: (lambda: spatial.solve_trig(A, B, D, out=out), n),
        OWN_CACHED: (
            lambda: spatial.solve_trig(A[part], B[part], D[part], out=(out[0][part], out[1][part])),
            CACHED,
        ),
        "NumPy, vectorised": (lambda: trig_vectorised(A, B, D), n),
        ARITHMETIC: _arithmetic(A, B, D),
        # as many bytes as a solve moves, at the speed of the triad
        BANDWIDTH: (triad.call("triad_streaming"), triad.bytes // BYTES),
    }
    return _rows(contenders, rounds, OWN_TRIG)


def _arithmetic(
    A: np.ndarray, B: np.ndarray, D: np.ndarray, repeats: int = 400
) -> tuple[Callable[[], None], int]:
    source = (HERE / "spatial" / "trig_limit.c").read_text()
    function = native.shared_library("trig_limit", source, "c", native.FAST).trig_limit
    function.argtypes, function.restype = (ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p), None
    inputs, outputs = limits.aligned(3 * COUNT), limits.aligned(2 * COUNT)
    inputs.reshape(3, COUNT)[:] = A[:COUNT], B[:COUNT], D[:COUNT]

    def call() -> None:
        function(repeats, inputs.ctypes.data, outputs.ctypes.data)

    call()
    theta, _ = spatial.solve_trig(*inputs.reshape(3, COUNT))
    if np.abs(np.remainder(outputs.reshape(2, COUNT).T - theta + np.pi, 2 * np.pi) - np.pi).max() > 1e-6:
        raise AssertionError("the angles of the arithmetic alone are others")
    return call, COUNT * repeats


def _pair(n: int, rounds: int) -> dict:
    M = np.random.default_rng(2).normal(size=(n, 2, 3, 3))
    pair = spatial.solve_pair(M)
    count = (pair.status <= spatial.ReverseStatus.DOUBLE).sum(axis=-1)
    matrices = companions(M[:LOOPED])
    by_hand = {"by_eigenvalues": by_eigenvalues, "by_pencils": by_pencils, "by_roots": by_roots}
    same = {
        name: float(np.mean([len(angles) == c for angles, c in zip(solve(M[:LOOPED]), count, strict=False)]))
        for name, solve in by_hand.items()
    }
    contenders: dict[str, tuple[Callable[[], object], int]] = {
        OWN_PAIR: (lambda: spatial.solve_pair(M), n),
        OWN_STABLE: (lambda: spatial.solve_pair(M[:STABLE_PAIRS], method="sylvester"), STABLE_PAIRS),
        "NumPy, eigenvalues in a loop": (lambda: by_eigenvalues(M[:LOOPED]), LOOPED),
        "NumPy, eigvals alone in a loop, matrices there": (lambda: eigenvalues_alone(matrices), LOOPED),
        "NumPy, roots of the octic in a loop": (lambda: by_roots(M[:LOOPED]), LOOPED),
        "SciPy, generalised eigenvalues in a loop": (lambda: by_pencils(M[:LOOPED]), LOOPED),
        "NumPy, eigenvalues of a stack and nothing else": (
            lambda: all_at_once(M[:STABLE_PAIRS]),
            STABLE_PAIRS,
        ),
    }
    found = _rows(contenders, rounds, OWN_PAIR)
    return {
        **found,
        "same": same,
        "incomplete": int((pair.status == spatial.ReverseStatus.INCOMPLETE).any(axis=-1).sum()),
    }


def _rows(contenders: dict[str, tuple[Callable[[], object], int]], rounds: int, own: str) -> dict:
    entries = {name: clock.Entry(call, solves) for name, (call, solves) in contenders.items()}
    for entry in entries.values():
        clock.calibrate(entry, 0.05)
    share = clock.alternate(entries, rounds)
    rows = [
        {
            "name": name,
            "solved": entry.solves,
            "ns": round(entry.median, 2),
            "spread": round(entry.spread, 3),
            "ratio": round(clock.ratio(entry, entries[own]), 3),
        }
        for name, entry in entries.items()
    ]
    return {"rows": rows, "rounds": len(entries[own].samples), "share": round(share, 3)}
