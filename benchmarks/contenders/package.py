"""This package: the gufunc on (N, 3) arrays, the same with two threads, and the NumPy fallback."""

from __future__ import annotations

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from problem import Problem

from contenders.base import OWN, Contender, UnavailableError

GUFUNC = "rodgen gufunc"
FALLBACK = "rodgen NumPy fallback"


def gufunc() -> Contender:
    import rodgen
    from rodgen import backend

    if backend == "numpy":
        raise UnavailableError("rodgen was built without a compiler here, or RODGEN_CPU=numpy is set")

    def bind(problem: Problem):
        out = (problem.axes, np.zeros(len(problem), dtype=np.int8))
        return lambda: rodgen.solve_axis(problem.rho, problem.rho_prime, problem.angle, out=out)

    return Contender(GUFUNC, OWN, bind, f"solve_axis(..., out=...), {backend} kernels")


def measured() -> Contender:
    """The gufunc on points whose second length is off, as measured ones are: the axes stay the same."""
    import rodgen

    gufunc()  # says why where there is none

    def bind(problem: Problem):
        rho_prime = problem.rho_prime * (1 + 1e-6)
        out = (problem.axes, np.zeros(len(problem), dtype=np.int8))
        inputs = (problem.rho, rho_prime, problem.angle)
        return lambda: rodgen.solve_axis(*inputs, length_tolerance=1e-5, out=out)

    note = "every |ρ′| is 1e-6 longer than |ρ|, and length_tolerance=1e-5 says that this is no fault"
    return Contender(f"{GUFUNC}, measured lengths", OWN, bind, note)


def beyond_tolerance() -> Contender:
    """The gufunc where the status of every hundredth element is LENGTHS_DIFFER."""
    exact = gufunc()

    def bind(problem: Problem):
        rho_prime = problem.rho_prime.copy()
        rho_prime[::100] *= 1 + 1e-6
        return exact.bind(dataclasses.replace(problem, rho_prime=rho_prime))

    note = "every hundredth |ρ′| is 1e-6 longer than |ρ|, beyond the tolerance: status LENGTHS_DIFFER"
    return Contender(f"{GUFUNC}, 1 % lengths differ", OWN, bind, note)


def fallback() -> Contender:
    from rodgen.generated.numpy import ALL

    def bind(problem: Problem):
        out = (problem.axes, np.zeros(len(problem), dtype=np.int8))
        arguments = (problem.rho, problem.rho_prime, problem.angle, 1e-8)
        return lambda: ALL.solve_axis(*arguments, out=out)

    note = "the generated NumPy module that runs where there is no compiler; same answers and statuses"
    return Contender(FALLBACK, OWN, bind, note)


def threaded(pool: ThreadPoolExecutor, threads: int) -> Contender:
    """The gufunc releases the GIL, so plain threads on slices of the same arrays are enough."""
    import rodgen

    def bind(problem: Problem):
        status = np.zeros(len(problem), dtype=np.int8)
        # Parts start on a multiple of 64 solves, so that no two threads write to one cache line.
        size = -(-len(problem) // threads)
        size = -(-size // 64) * 64
        parts = [slice(start, start + size) for start in range(0, len(problem), size)]

        def work(part: slice) -> None:
            out = (problem.axes[part], status[part])
            rodgen.solve_axis(problem.rho[part], problem.rho_prime[part], problem.angle[part], out=out)

        return lambda: list(pool.map(work, parts))

    return Contender(f"{GUFUNC}, {threads} threads", OWN, bind)


FACTORIES = (gufunc, measured, beyond_tolerance, fallback)
