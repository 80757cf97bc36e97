"""JAX: residuals of one row, differentiated backwards and mapped over rows, compiled by XLA in double precision.

What all rows share (axes, points) is differentiated by itself, forwards, and the two Jacobians are multiplied. XLA
would merge the links of a chain into one loop in which early links are computed again for each later one; a barrier
after each link keeps it from that. This is the fastest of the forms that were tried: jacfwd of all takes 1.5 to 5 times
as long, jacrev of all 7 times, whole arrays with matrix products 7 times, blocks in a scan 60 times.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from fits import formulas
from fits.cases import Case
from fits.driver import Exact


def exact(case: Case, mode: str = "jacrev", barrier: bool = True) -> Exact:
    """Return residuals, and residuals with their Jacobian, compiled."""
    import jax
    import jax.numpy as jnp

    started = time.perf_counter()
    jax.config.update("jax_enable_x64", True)
    columns = [np.atleast_2d(case.columns[c]) for c in formulas.ROW_COLUMNS[case.name]]
    rows = jnp.asarray(np.concatenate(columns))
    row_of = formulas.ROW[case.name]

    def link(x: Any) -> Any:
        return jax.lax.optimization_barrier(jnp.stack(x)) if barrier else x

    def geometry(theta: Any) -> Any:
        return jnp.stack(formulas.GEOMETRY[case.name](theta, case.frame))

    def residual(g: Any, row: Any) -> Any:
        return jnp.stack(row_of(jnp, g, row, link))

    by_geometry = {"jacrev": jax.jacrev, "jacfwd": jax.jacfwd}[mode](residual)

    @jax.jit
    def both(theta: Any) -> tuple[Any, Any]:
        g, slopes = geometry(theta), jax.jacfwd(geometry)(theta)
        r = jax.vmap(residual, (None, 1))(g, rows)
        j = jax.vmap(by_geometry, (None, 1))(g, rows)
        return r.ravel(), j.reshape(-1, j.shape[-1]) @ slopes

    @jax.jit
    def values(theta: Any) -> Any:
        return jax.vmap(residual, (None, 1))(geometry(theta), rows).ravel()

    def residuals_and_jacobian(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, j = both(theta)
        return np.asarray(r), np.asarray(j)

    def residuals(theta: np.ndarray) -> np.ndarray:
        return np.asarray(values(theta))

    residuals(case.start), residuals_and_jacobian(case.start)
    return Exact(residuals, residuals_and_jacobian, time.perf_counter() - started)
