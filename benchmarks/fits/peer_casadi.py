"""CasADi: residuals and Jacobian of one row, written as C, compiled, in a loop over rows.

What all rows share (axes, points and their derivatives) is a function of its own, evaluated once an iteration by
CasADi's virtual machine; the function of a row takes its values. JᵀJ is made by BLAS from blocks that stay in the
cache.
"""

from __future__ import annotations

import ctypes
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from contenders import native

from fits import formulas
from fits.cases import Case
from fits.driver import Exact

BLOCK = 512

LOOP = """
void many(long n, const double *g, const double *d, const double *rows, double *r, double *j) {{
  for (long i = 0; i < n; ++i) {{
    const casadi_real *arg[3] = {{g, d, rows + {width} * i}};
    casadi_real *res[2] = {{r + {components} * i, j + {components} * {parameters} * i}};
    casadi_f0(arg, res, 0, 0, 0);
  }}
}}
void many_residuals(long n, const double *g, const double *rows, double *r) {{
  for (long i = 0; i < n; ++i) {{
    const casadi_real *arg[2] = {{g, rows + {width} * i}};
    casadi_real *res[1] = {{r + {components} * i}};
    casadi_f1(arg, res, 0, 0, 0);
  }}
}}
"""


def _compiled(case: Case, width: int, fast: bool) -> tuple[Any, Any, int]:
    """Return the function of what rows share, the library, and how many residuals a row has."""
    import casadi as ca

    theta, row = ca.SX.sym("theta", len(case.start)), ca.SX.sym("row", width)
    geometry = ca.vertcat(*formulas.GEOMETRY[case.name](theta, case.frame))
    by_theta = ca.jacobian(geometry, theta)
    g = ca.SX.sym("g", geometry.numel())
    # Derivatives that are numbers (a point moves along a fixed direction) stay numbers.
    entries, changing, d = [], [], []
    for entry in by_theta.nonzeros():
        if not entry.is_constant():
            changing.append(entry)
            d.append(ca.SX.sym("d"))
            entry = d[-1]
        entries.append(entry)
    slopes = ca.SX(by_theta.sparsity(), ca.vertcat(*entries))
    r = ca.vertcat(*formulas.ROW[case.name](ca, [g[i] for i in range(g.numel())], row))
    jacobian = ca.densify(ca.mtimes(ca.jacobian(r, g), slopes).T)  # CasADi counts down columns
    d = ca.vertcat(*d)
    cse = {"cse": True}
    shared = ca.Function("shared", [theta], [geometry, ca.vertcat(*changing)], cse)
    full = ca.Function("row", [g, d, row], [r, jacobian], cse)
    residual = ca.Function("row_residual", [g, row], [r], cse)
    with tempfile.TemporaryDirectory() as folder:
        before = Path.cwd()
        os.chdir(folder)  # CasADi writes into the current folder only
        try:
            generator = ca.CodeGenerator("row.c")
            generator.add(full)
            generator.add(residual)
            generator.generate()
            code = Path("row.c").read_text()
        finally:
            os.chdir(before)
    sizes = {"width": width, "components": r.numel(), "parameters": len(case.start)}
    flags = native.FAST if fast else native.STRICT
    library = native.shared_library(f"casadi_{case.name}", code + LOOP.format(**sizes), "c", flags)
    library.many.argtypes = (ctypes.c_long, *[ctypes.c_void_p] * 5)
    library.many_residuals.argtypes = (ctypes.c_long, *[ctypes.c_void_p] * 3)
    library.many.restype = library.many_residuals.restype = None
    return shared, library, r.numel()


def exact(case: Case, *, fast: bool) -> Exact:
    """Return residuals, Jacobian and normal equations; `fast`: compiled with -ffast-math."""
    started = time.perf_counter()
    columns = [np.atleast_2d(case.columns[c]) for c in formulas.ROW_COLUMNS[case.name]]
    rows = np.concatenate(columns).T.copy()
    shared, library, components = _compiled(case, rows.shape[1], fast)
    count, parameters = len(rows), len(case.start)
    length = min(BLOCK, count)
    r, j = np.empty(length * components), np.empty((length * components, parameters))
    buffer, trigger = shared.buffer()
    given, g, d = np.empty(parameters), np.empty(shared.numel_out(0)), np.empty(shared.numel_out(1))
    buffer.set_arg(0, memoryview(given))
    buffer.set_res(0, memoryview(g))
    buffer.set_res(1, memoryview(d))
    g_at, d_at, r_at, j_at, rows_at = (a.ctypes.data for a in (g, d, r, j, rows))
    starts = [(rows_at + s * rows.strides[0], min(length, count - s)) for s in range(0, count, length)]

    def normal_equations(theta: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        given[:] = theta
        trigger()
        cost, square, gradient = 0.0, np.zeros((parameters, parameters)), np.zeros(parameters)
        for at, n in starts:
            library.many(n, g_at, d_at, at, r_at, j_at)
            found, flat = r[: n * components], j[: n * components]
            cost += float(found @ found)
            square += flat.T @ flat
            gradient += flat.T @ found
        return cost, square, gradient

    def cost(theta: np.ndarray) -> float:
        given[:] = theta
        trigger()
        total = 0.0
        for at, n in starts:
            library.many_residuals(n, g_at, at, r_at)
            total += float(r[: n * components] @ r[: n * components])
        return total

    def residuals(theta: np.ndarray) -> np.ndarray:
        given[:] = theta
        trigger()
        found = np.empty(count * components)
        library.many_residuals(count, g_at, rows_at, found.ctypes.data)
        return found

    def residuals_and_jacobian(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        given[:] = theta
        trigger()
        found, slopes = np.empty(count * components), np.empty((count * components, parameters))
        library.many(count, g_at, d_at, rows_at, found.ctypes.data, slopes.ctypes.data)
        return found, slopes

    cost.keep_alive = (buffer, shared, library, rows, g, d, given)  # type: ignore[attr-defined]
    return Exact(residuals, residuals_and_jacobian, time.perf_counter() - started, normal_equations, cost)
