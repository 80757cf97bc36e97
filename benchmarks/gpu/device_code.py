"""The kernels as CUDA: the generated C as it stands, and programs over rows by the printer of their C.

Each thread has an element or a row. A block reads its rows in one piece and writes its results in one piece, through
shared memory; a warp sums up the products of its rows' Jacobians by the matrix units for double precision.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rodgen.codegen.program import Program

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

ROWS = """\
extern "C" __global__ void __launch_bounds__(THREADS) rows(
    count_t count, const double *given, const double *in1, const double *in2, double *to) {
  __shared__ double from[THREADS * COLUMNS], results[THREADS * SIZE];
  const count_t start = blockIdx.x * (count_t)THREADS;
  const int here = count - start < THREADS ? (int)(count - start) : THREADS, i = threadIdx.x;
  moved(given + COLUMNS * start, from, COLUMNS * here);
  __syncthreads();
  if (i < here) {
    const double *in0 = from + COLUMNS * i;
    double *result = results + SIZE * i;
    LINES
  }
  __syncthreads();
  moved(results, to + SIZE * start, SIZE * here);
}
"""

GRAM = """\
/* A warp has the vectors of 32 rows, HEIGHT each, of WIDTH <= 32 numbers, and adds their products to sums of 8 by 8. */
#define TILES 4
#define STRIDE 37 /* of a vector, so that lanes use different banks */
extern "C" __global__ void __launch_bounds__(32) gram(
    count_t count, const double *given, const double *in1, const double *in2, double *to) {
  extern __shared__ double joined[];
  double *const from = joined + 32 * HEIGHT * STRIDE;
  const int lane = threadIdx.x;
  double sums[TILES * (TILES + 1) / 2][2] = {};
  for (count_t start = blockIdx.x * 32LL; start < count; start += gridDim.x * 32LL) {
    const int here = count - start < 32 ? (int)(count - start) : 32;
    for (int k = lane; k < COLUMNS * here; k += 32)
      from[k] = given[COLUMNS * start + k];
    __syncwarp();
    {
      const double *in0 = from + COLUMNS * (lane < here ? lane : 0);
      const double own = lane < here ? 1.0 : 0.0;
      double *const result = joined + STRIDE * lane;
      LINES
      for (int h = 0; h < HEIGHT; ++h)
        for (int c = WIDTH; c < 8 * TILES; ++c)
          result[32 * STRIDE * h + c] = 0.0;
    }
    __syncwarp();
    for (int k = 0; k < 32 * HEIGHT; k += 4) {
      double x[TILES];
#pragma unroll
      for (int t = 0; t < TILES; ++t)
        x[t] = joined[STRIDE * (k + lane % 4) + 8 * t + lane / 4];
      int n = 0;
#pragma unroll
      for (int a = 0; a < TILES; ++a)
#pragma unroll
        for (int b = 0; b <= a; ++b, ++n)
          asm("mma.sync.aligned.m8n8k4.row.col.f64.f64.f64.f64 {%0, %1}, {%2}, {%3}, {%0, %1};"
              : "+d"(sums[n][0]), "+d"(sums[n][1]) : "d"(x[a]), "d"(x[b]));
    }
    __syncwarp();
  }
  int n = 0;
  for (int a = 0; a < TILES; ++a)
    for (int b = 0; b <= a; ++b, ++n)
      for (int c = 0; c < 2; ++c) {
        const int i = 8 * a + lane / 4, j = 8 * b + lane % 4 * 2 + c;
        if (i < WIDTH && j <= i)
          to[(WIDTH * i + j) * (count_t)gridDim.x + blockIdx.x] = sums[n][c];
      }
}
"""


def solve_code(real: str) -> str:
    """Return CUDA that solves for each element by generated/c/axis.c."""
    number = {"float64": "double", "float32": "float"}[real]
    code = SOLVE.replace("SOLVE_AXIS", f"axis_solve_axis_f{real[-2:]}").replace("REAL", number)
    return COMMON + code


def rows_code(program: Program) -> str:
    """Return CUDA that evaluates a program with one output."""
    (output,) = program.results.values()
    lines = [*_lines(program, seeded=False), *(f"result[{c}] = {_text(x)};" for c, x in enumerate(output))]
    return COMMON + _filled(ROWS, program, lines, SIZE=len(output))


def gram_code(program: Program) -> str:
    """Return CUDA that adds up the products of residuals and their Jacobian, whose rows seeds make."""
    residual, row = program.results.values()
    lines = [
        *_lines(program, seeded=False),
        *(
            f"result[32 * STRIDE * {h} + {program.columns}] = own * {_text(x)};"
            for h, x in enumerate(residual)
        ),
        "#pragma unroll 1",
        "for (int h = 0; h < HEIGHT; ++h) {",
        *_lines(program, seeded=True),
        *(f"result[32 * STRIDE * h + {c}] = own * {_text(x)};" for c, x in enumerate(row)),
        "}",
    ]
    return COMMON + _filled(GRAM, program, lines, HEIGHT=program.height, WIDTH=program.columns + 1)


def _filled(code: str, program: Program, lines: list[str], **sizes: int) -> str:
    (columns,) = next(iter(program.inputs.values()))
    defined = "".join(f"#define {name} {size}\n" for name, size in {"COLUMNS": columns, **sizes}.items())
    return defined + code.replace("LINES", "\n    ".join(lines))


def _lines(program: Program, *, seeded: bool) -> list[str]:
    """Return the operations that need seeds, which are 1 in row h of the Jacobian, or those that need none."""
    from rodgen.codegen import _rows_source  # needs Jinja2

    ports = list(program.inputs)
    return [
        f"const double t{n} = h == {args[0]};"
        if op == "seed"
        else _rows_source._shared_line(ports, program.shared, n, op, args)
        for n, (op, *args) in enumerate(program.operations)
        if program.seeded[n] is seeded
    ]


def _text(x: float) -> str:
    from rodgen.codegen import _rows_source

    return _rows_source._operand(x)


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


def rows(program: Program) -> Callable[..., Any]:
    """Return a program with one output on arrays of CuPy."""
    import cupy

    kernel, (size,) = compiled(rows_code(program), "rows"), next(iter(program.outputs.values()))

    def call(given: Any, g: Any, e: Any) -> Any:
        found = cupy.empty((len(given), size))
        kernel(((len(given) + 127) // 128,), (128,), (np.int64(len(given)), given, g, e, found))
        return found

    return call


def gram(program: Program) -> Callable[..., Any]:
    """Return [J r]ᵀ[J r] on arrays of CuPy."""
    import cupy

    kernel = compiled(gram_code(program), "gram")
    columns, width = next(iter(program.inputs.values()))[0], program.columns + 1
    shared = 8 * 32 * (program.height * 37 + columns)
    blocks = cupy.cuda.Device().attributes["MultiProcessorCount"] * (220_000 // (shared + 1024))

    def call(given: Any, g: Any, e: Any) -> Any:
        parts = cupy.zeros((width, width, blocks))
        kernel((blocks,), (32,), (np.int64(len(given)), given, g, e, parts), shared_mem=shared)
        lower = parts.sum(axis=2)
        return lower + cupy.tril(lower, -1).T

    return call
