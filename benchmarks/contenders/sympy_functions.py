"""SymPy's own ways from an expression to numbers: lambdify with its CSE, and ufuncify."""

from __future__ import annotations

import os

import numpy as np
from environments import PEERS, site_packages
from problem import Problem

from contenders.base import Contender, UnavailableError, columns


def compact_form(maximum):
    """The seven input symbols and the six components of e+ and e-, with ``maximum`` for max."""
    import sympy as sp

    symbols = sp.symbols("a1:4 b1:4 chi", real=True)
    rho, rho_prime, chi = sp.Matrix(symbols[:3]), sp.Matrix(symbols[3:6]), symbols[6]
    r, m = rho_prime - rho, rho_prime + rho
    kappa, m_squared = 1 / sp.tan(chi / 2), m.dot(m)
    normal = kappa / m_squared * m.cross(r)
    along = sp.sqrt(maximum(m_squared - kappa**2 * r.dot(r), 0)) / m_squared * m
    return symbols, [*(normal + along), *(normal - along)]


def _lambdified():
    import sympy as sp

    # SymPy prints Max as a reduction over a stack; np.maximum is what it should be.
    maximum = sp.Function("maximum")
    symbols, components = compact_form(maximum)
    function = sp.lambdify(symbols, components, modules=[{"maximum": np.maximum}, "numpy"], cse=True)

    def solve(problem: Problem) -> None:
        parts = function(*columns(problem.rho), *columns(problem.rho_prime), problem.angle)
        for position, part in enumerate(parts):
            problem.axes[:, position // 3, position % 3] = part

    return solve


def lambdify() -> Contender:
    return Contender(
        "sympy lambdify(cse=True)",
        "NumPy",
        Contender.blocked(10**9, _lambdified()),
        "whole arrays",
        3_000_000,
    )


def lambdify_blocked() -> Contender:
    return Contender(
        "sympy lambdify(cse=True), blocked", "NumPy", Contender.blocked(4096, _lambdified()), "blocks of 4096"
    )


def ufuncify() -> Contender:
    import sympy as sp
    from sympy.utilities.autowrap import ufuncify

    symbols, components = compact_form(sp.Max)
    before = {name: os.environ.get(name) for name in ("CFLAGS", "PYTHONPATH")}
    os.environ["CFLAGS"] = "-O3 -march=native"
    os.environ["PYTHONPATH"] = str(site_packages(PEERS))  # setuptools, for the subprocess that builds
    try:
        function = ufuncify(symbols, components, backend="numpy")
    except Exception as error:
        raise UnavailableError(f"ufuncify: {type(error).__name__}: {error}") from error
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})

    def bind(problem: Problem):
        inputs = (*problem.rho.T, *problem.rho_prime.T, problem.angle)
        outputs = tuple(problem.axes[:, i, j] for i in range(2) for j in range(3))
        return lambda: function(*inputs, out=outputs)

    return Contender(
        "sympy ufuncify", "C/C++", bind, "backend numpy, -O3 -march=native, out= into the answer"
    )


FACTORIES = (lambdify, lambdify_blocked, ufuncify)
