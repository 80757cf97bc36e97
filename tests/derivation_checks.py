"""Checks of a derivation: its statements hold at random numbers, and its pages are the same bytes in every run."""

import os
import random
import subprocess
import sys

import mpmath
import sympy as sp

DIGITS = 40
TOLERANCE = mpmath.mpf(10) ** -25  # 40 digits, less those that cancel in formulas of at most 1e10


def pages_of_two_runs(name):
    """Errata and pages of a derivation, from two processes.

    Each has its own hash seed, and the order of SymPy's sets differs there.
    """
    code = (
        f"from rodgen.derivation.{name} import derivation as d; from rodgen.symbolic import errata;"
        "print(errata(d), errata(d, form='markdown'), *(e._repr_markdown_() for e in d))"
    )
    return [
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    ]


def sample(symbols, modulo, insert, generator):
    """Random values of the symbols that satisfy the side conditions, the last condition first."""
    point = {symbol: mpmath.mpf(generator.uniform(0.2, 1.2)) for symbol in symbols}
    for symbol, condition in reversed(modulo):
        polynomial = sp.Poly(sp.numer(sp.together(insert(condition))), symbol)
        values = {s: v for s, v in point.items() if s != symbol}
        coefficients = [
            mpmath.mpc(sp.lambdify(list(values), c, "mpmath")(*values.values()))
            for c in polynomial.all_coeffs()
        ]
        point[symbol] = mpmath.polyroots(coefficients, maxsteps=200, extraprec=200)[-1]
    return point


def check_at_random_numbers(entry, given):
    """Evaluate both sides at 40 digits; random inputs between 0.2 and 1.2 satisfy the sign assumptions."""
    insert = entry.derivation.insert(given)
    generator = random.Random(entry.id)
    with mpmath.workdps(DIGITS):
        for claim in entry.claims:
            left, right = (sp.Matrix([insert(side)]) for side in claim.args)
            symbols = left.free_symbols | right.free_symbols
            for symbol, condition in entry.modulo:
                symbols |= insert(condition).free_symbols | {symbol}
            point = sample(sorted(symbols, key=str), entry.modulo, insert, generator)
            sides = sp.lambdify(list(point), [list(left), list(right)], "mpmath", cse=True)
            for a, b in zip(*sides(*point.values()), strict=True):
                a, b = mpmath.mpmathify(a), mpmath.mpmathify(b)
                if isinstance(claim, sp.Eq):
                    assert abs(a - b) <= TOLERANCE * (1 + abs(a) + abs(b)), entry.id
                else:
                    assert claim.func(a, b), entry.id
