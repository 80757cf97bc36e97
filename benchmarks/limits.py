"""The limits set by this machine's memory and arithmetic, measured in the same run.

One solve reads 56 bytes (two points and an angle) and writes 49 (two axes and a status). With
non-temporal stores these 105 bytes are all that crosses the bus, so the limit is 105 bytes divided
by the bandwidth of STREAM's triad with such stores.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from contenders import native
from environments import HERE

BYTES_A_SOLVE = 105
TRIAD_BYTES = 24


def aligned(count: int, dtype: type = np.float64) -> np.ndarray:
    """Touched memory that starts on a cache line, as streaming stores want it."""
    size = count * np.dtype(dtype).itemsize
    raw = np.zeros(size + 64, dtype=np.uint8)
    start = -raw.ctypes.data % 64
    values = raw[start : start + size].view(dtype)
    values[:] = 1
    return values


def _library() -> ctypes.CDLL:
    return native.shared_library("bandwidth", (HERE / "bandwidth.c").read_text(), "c", native.STRICT)


class Triad:
    """a = b + s c on three arrays of ``count`` numbers, each thread on a part of its own."""

    def __init__(self, count: int):
        self.count = count // 128 * 128
        self.arrays = [aligned(self.count) for _ in range(3)]
        self.library = _library()

    def call(self, name: str, pool: ThreadPoolExecutor | None = None, threads: int = 1) -> Callable[[], None]:
        function = getattr(self.library, name)
        function.argtypes = (*[ctypes.c_void_p] * 3, ctypes.c_double, ctypes.c_ssize_t)
        part = self.count // threads // 64 * 64
        bases = [array.ctypes.data for array in self.arrays]

        def work(index: int) -> None:
            if function(*(base + 8 * part * index for base in bases), 3.0, part):
                raise native.UnavailableError("this machine has no streaming stores that the benchmark knows")

        if pool is None:
            return lambda: work(0)
        return lambda: list(pool.map(work, range(threads)))

    @property
    def bytes(self) -> int:
        return TRIAD_BYTES * self.count


def traffic(problem, name: str) -> Callable[[], None]:
    """Move what solve_axis moves, computing next to nothing: where would a free formula be?"""
    function = getattr(_library(), name)
    function.argtypes = (*[ctypes.c_void_p] * 5, ctypes.c_ssize_t)
    n = len(problem) // 64 * 64
    axes, status = aligned(6 * n), aligned(n // 8)
    pointers = [a.ctypes.data for a in (problem.rho, problem.rho_prime, problem.angle, axes, status)]

    def call() -> None:
        if function(*pointers, n):
            raise native.UnavailableError("this machine has no streaming stores that the benchmark knows")

    call.keep_alive = (problem, axes, status)
    return call


def arithmetic(problem, repeats: int = 400) -> tuple[Callable[[], None], int]:
    """The compact form on a few problems that stay in the first cache; returns the call and its solves."""
    count = 256  # compact.c's COUNT
    source = (HERE / "compact.c").read_text()
    function = native.shared_library("compact", source, "c", native.FAST).compact
    function.argtypes = (ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p)
    function.restype = None
    head = problem.head(count)
    inputs, outputs = aligned(7 * count), aligned(6 * count)
    inputs.reshape(7, count)[:] = np.vstack([head.rho.T, head.rho_prime.T, head.angle])
    arguments = (repeats, inputs.ctypes.data, outputs.ctypes.data)

    def call() -> None:
        function(*arguments)

    call.keep_alive = (inputs, outputs)
    return call, count * repeats
