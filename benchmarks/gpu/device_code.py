"""The axis solver as CUDA: the generated C as it stands.

Each thread has an element. A block reads its elements in one piece and writes its results in one piece, through shared
memory.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

C_FOLDER = Path(__file__).resolve().parents[2] / "generated/c"

HEADERS = {
    "math.h": "",
    "string.h": "",
    "stddef.h": "",
    "stdint.h": "typedef signed char int8_t; typedef int int32_t; typedef unsigned int uint32_t;\n"
    "typedef long long int64_t; typedef unsigned long long uint64_t;\n",
    "float.h": "#define DBL_EPSILON 2.2204460492503131e-16\n#define DBL_MAX 1.7976931348623157e+308\n"
    "#define FLT_EPSILON 1.19209290e-7f\n#define FLT_MAX 3.40282347e+38f\n",
}
"""What of C's headers the generated C uses, for a compiler that has none."""

COMMON = """\
#ifndef NAN
#define NAN __int_as_float(0x7fffffff)
#endif
#include <stdint.h>
#define THREADS 128
typedef long long count_t;

template <typename T> __device__ void moved(const T *from, T *to, int count) {
  for (int k = threadIdx.x; k < count; k += THREADS)
    to[k] = from[k];
}
"""

SOLVE = """\
#include "axis.c"
extern "C" __global__ void __launch_bounds__(THREADS) solve(
    count_t count, const REAL *rho, const REAL *rho_prime, const REAL *angle, REAL tolerance, REAL *axes,
    int8_t *status) {
  __shared__ REAL before[3 * THREADS], after[3 * THREADS], found[6 * THREADS];
  const count_t start = blockIdx.x * (count_t)THREADS;
  const int here = count - start < THREADS ? (int)(count - start) : THREADS, i = threadIdx.x;
  moved(rho + 3 * start, before, 3 * here);
  moved(rho_prime + 3 * start, after, 3 * here);
  __syncthreads();
  if (i < here)
    SOLVE_AXIS(before + 3 * i, after + 3 * i, angle[start + i], tolerance, found + 6 * i, status + start + i);
  __syncthreads();
  moved(found, axes + 6 * start, 6 * here);
}
"""


def solve_code(real: str) -> str:
    """Return CUDA that solves for each element by generated/c/axis.c."""
    number = {"float64": "double", "float32": "float"}[real]
    code = SOLVE.replace("SOLVE_AXIS", f"axis_solve_axis_f{real[-2:]}").replace("REAL", number)
    return COMMON + code


def compiled(code: str, name: str) -> Any:
    """Return a kernel of CuPy, compiled by NVRTC."""
    import cupy

    with tempfile.TemporaryDirectory() as folder:
        kernel = cupy.RawKernel(code, name, options=options(folder))
        kernel.compile()
    return kernel


def options(folder: str) -> tuple[str, ...]:
    """Write the headers into a folder, and return the options of the compiler."""
    for name, text in HEADERS.items():
        Path(folder, name).write_text(text)
    return ("-default-device", f"-I{folder}", f"-I{C_FOLDER}")


def solve(real: str, tolerance: float) -> Callable[..., Any]:
    """Return solve_axis on arrays of CuPy."""
    import cupy

    kernel, number = compiled(solve_code(real), "solve"), np.dtype(real).type(tolerance)

    def call(rho: Any, rho_prime: Any, angle: Any) -> Any:
        count = len(angle)
        axes, status = cupy.empty((count, 2, 3), real), cupy.empty(count, np.int8)
        kernel(
            ((count + 127) // 128,), (128,), (np.int64(count), rho, rho_prime, angle, number, axes, status)
        )
        return axes, status

    return call
