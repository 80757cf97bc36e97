"""Calls of compiled code with every size that can be zero or one; ``test_memory.py`` runs them with a checked heap.

Each array is a heap block of its own, and results are compared: a write beyond a block is an error or a wrong number.
"""

from __future__ import annotations

import itertools
import math
import os
from typing import Any

import numpy as np

from rodgen.codegen import rows
from rodgen.codegen.program import Program
from rodgen.codegen.tape import Tape
from rodgen.kinematics.backend import kernels
from rodgen.statistics import whitening
from rodgen.statistics.decompositions import eigh, lstsq, svd

FEW = (0, 1, 2, 9)
"""Rows: none, one, fewer than the lanes of a vector, and more."""


def random(*shape: int) -> Any:
    """Return numbers between 1/2 and 1, the same in each run."""
    return 0.5 + 0.5 * (0.6180339887498949 * np.arange(1, 1 + math.prod(shape)) % 1).reshape(shape)


def agree(found: Any, expected: Any) -> None:
    """Compare shapes, and numbers but for rounding."""
    assert np.shape(found) == np.shape(expected)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


# LAPACK ------------------------------------------------------------------------------------------------------------


def bands() -> None:
    """Solve with bands of any width, of any number of unknowns and of columns."""
    for n, width, k in itertools.product((1, 2, 40, 300), (1, 2, 4), (0, 1, 3)):
        band = -0.1 * random(width, n)
        band[0] = 2.0
        for d in range(1, width):
            band[d, max(n - d, 0) :] = 0.0
        factor, side = whitening._triangle(band), random(n, k)
        lower = sum(np.diag(factor[d, : n - d], -d) for d in range(min(width, n)))
        agree(lower @ whitening._forward(factor, side), side)
        agree(lower.T @ whitening._forward(factor, side, "T"), side)
        chain = whitening._Chain.of(np.array([np.inf, *[1.0] * (n - 1)]), 2.0)
        assert whitening._forward(whitening._triangle(chain.band(1)), random(n, k)).shape == (n, k)


def decompositions() -> None:
    """Decompose matrices by SciPy's drivers, as where NumPy's do not converge."""

    def refuse(*_: Any, **__: Any) -> Any:
        raise np.linalg.LinAlgError

    saved = {name: getattr(np.linalg, name) for name in ("svd", "lstsq", "eigh")}
    try:
        for name in saved:
            setattr(np.linalg, name, refuse)
        for m, n in itertools.product((0, 1, 2, 30), repeat=2):
            for full in (False, True):
                u, s, vt = svd(random(m, n), full_matrices=full)
                agree((u[:, : len(s)] * s) @ vt[: len(s)], random(m, n))
            values, vectors = eigh(random(n, n) + random(n, n).T)
            agree((vectors * values) @ vectors.T, random(n, n) + random(n, n).T)
            assert lstsq(random(m, n), random(m), relative=1e-9).shape == (n,)
    finally:
        for name, function in saved.items():
            setattr(np.linalg, name, function)


# kernels over rows -------------------------------------------------------------------------------------------------

PROGRAMS = {
    f"of_{n}_{m}_to_{k}_{j}": (n, m, k, j)
    for (n, m), (k, j) in itertools.product(
        ((0, 0), (0, 1), (1, 0), (1, 1), (2, 9)), ((0, 0), (0, 2), (1, 0), (1, 1), (2, 9))
    )
}
"""Numbers of a row, shared numbers, residuals, and columns of their Jacobian."""


def program(name: str) -> Program:
    """Return a program that has residuals and a Jacobian of any size."""
    n, m, k, j = PROGRAMS[name]
    tape = Tape()
    row, shared = tape.inputs("x", n, same=False), tape.inputs("p", m)
    terms = [*row, *shared]
    total: Any = sum(term * term for term in terms) if terms else 0.25
    outputs = {
        "residual": ((k,), [total + float(i) for i in range(k)]),
        "jacobian": ((k, j), [total * float(i + 1) for i in range(k * j)]),
    }
    return tape.program(name, {"x": (n,), "p": (m,)}, outputs)


SEEDED = ((2, 1), (2, 3), (20, 24))
"""Residuals, and columns of their Jacobian, of which one row is computed at a time."""


def seeded(k: int, j: int) -> Program:
    """Return a program whose residuals no operation makes."""
    tape = Tape()
    row, total = tape.inputs("x", k, same=False), sum(s * float(i + 1) for i, s in enumerate(tape.seeds(k)))
    outputs = {"residual": ((k,), row), "jacobian": ((k, j), [total * float(i + 1) for i in range(j)])}
    return tape.program(f"seeded_{k}_{j}", {"x": (k,), "p": (1,)}, outputs)


def row_kernels() -> None:
    """Evaluate kernels with ports of any size on any number of rows, in C and on NumPy, by every method."""
    made = [program(name) for name in PROGRAMS] + [seeded(k, j) for k, j in SEEDED]
    compiled, on_numpy = (
        rows.row_kernels("sizes", lambda: made, compiled=is_compiled) for is_compiled in (True, False)
    )
    assert {k.target for k in compiled.values()} == {"c"}
    sizes = PROGRAMS | {f"seeded_{k}_{j}": (k, 1, k, j) for k, j in SEEDED}
    for name, (n, m, k, j) in sizes.items():
        for count in FEW:
            x, p = random(count, n), random(m)
            c, numpy = compiled[name], on_numpy[name]
            expected = numpy(x, p)
            for found, other in zip(c(x, p), expected, strict=True):
                agree(found, other)
            out = tuple(np.full((count, *shape), np.nan) for shape in c.outputs.values())
            c(x, p, out=out)
            agree(out[1], expected[1])
            for kernel in (c, numpy):
                for sets in (0, 1, 3):
                    many = kernel.in_sets(random(sets * count, n), [count] * sets, random(sets, m))
                    assert [a.shape for a in many] == [(sets * count, k), (sets * count, k, j)]
            assert c.has_jacobian is numpy.has_jacobian
            if c.has_jacobian:
                joined = np.concatenate([expected[1], expected[0][:, :, None]], axis=2).reshape(-1, j + 1)
                for kernel in (c, numpy):
                    agree(kernel.gram(x, p), joined.T @ joined)


LOOPS: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...] = (
    ((), ()), ((0,), ()), ((), (0,)), ((0,), (1,)), ((1,), (0,)), ((1,), (1,)), ((2,), (1,)), ((1,), (9,)),
    ((3, 0), (1, 1)), ((0, 3), (3,)), ((1, 1), ()), ((2, 1), (1, 3)),
)  # fmt: skip
"""Shapes that are broadcast against each other."""


# the extension -----------------------------------------------------------------------------------------------------


def extension() -> None:
    """Call each gufunc with no element, one and few, broadcast in any way, and with shapes that do not fit."""
    names = [name for name, kernel in vars(kernels).items() if isinstance(kernel, np.ufunc)]
    assert names or os.environ.get("RODGEN_CPU") == "numpy"
    for name in names:
        gufunc, single = getattr(kernels, name), kernels.one_element[name]
        inputs, outputs = (
            [tuple(map(int, filter(None, port.split(",")))) for port in side[1:-1].split("),(")]
            for side in gufunc.signature.split("->")
        )
        one = [random(*core) for core in inputs]
        expected = gufunc(*one)
        expected = expected if isinstance(expected, tuple) else (expected,)
        found = single(*one)
        for a, b in zip(found if isinstance(found, tuple) else (found,), expected, strict=True):
            np.testing.assert_array_equal(a, b)
        for (first, others), real in itertools.product(LOOPS, (np.float64, np.float32)):
            loops = [first, *[others] * (len(inputs) - 1)]
            loop = np.broadcast_shapes(*loops)
            arguments = [
                np.array(np.broadcast_to(value, (*each, *core)), real)
                for value, each, core in zip(one, loops, inputs, strict=True)
            ]
            for function in (gufunc, single):
                results = function(*arguments)
                results = results if isinstance(results, tuple) else (results,)
                assert [np.shape(r) for r in results] == [(*loop, *core) for core in outputs]
        for port, core in enumerate(inputs):
            for wrong in [core[:-1], *((*core[:-1], size) for size in (0, 1, core[-1] + 1))] if core else []:
                if wrong == core:
                    continue
                arguments = [*one[:port], random(*wrong), *one[port + 1 :]]
                for function in (gufunc, single):
                    try:
                        function(*arguments)
                    except ValueError:
                        continue
                    raise AssertionError(f"{name} took {wrong} for {core}")


CALLS = (bands, decompositions, row_kernels, extension)

if __name__ == "__main__":
    rows.FLAGS = tuple("-O0" if flag == "-O2" else flag for flag in rows.FLAGS)
    for call in CALLS:
        call()
    print(len(CALLS))
