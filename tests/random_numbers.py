"""What a derivation has proved, at random numbers: a way that shares nothing with the proofs."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import mpmath
import sympy as sp

DIGITS = 40
TOLERANCE = mpmath.mpf(10) ** -25  # 40 digits, less those that cancel in formulas of at most 1e10


def sample(
    symbols: Iterable[sp.Symbol],
    modulo: Any,
    insert: Callable[[sp.Expr], sp.Expr],
    generator: random.Random,
) -> dict[sp.Symbol, mpmath.mpf]:
    """Return values of the symbols that satisfy the side conditions, the last condition first."""
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


def check_at_random_numbers(entry: Any, given: Mapping[sp.Symbol, sp.Expr]) -> None:
    """Evaluate both sides of all claims; random inputs between 0.2 and 1.2 satisfy the sign assumptions."""
    insert = entry.derivation.insert(given)
    generator = random.Random(entry.id)
    with mpmath.workdps(DIGITS):
        for claim in entry.claims:
            left, right = (sp.Matrix([insert(side)]) for side in claim.args)
            symbols = left.free_symbols | right.free_symbols
            for symbol, condition in entry.modulo:
                symbols |= insert(condition).free_symbols | {symbol}
            point = sample(sorted(symbols, key=str), entry.modulo, insert, generator)
            sides = sp.lambdify(list(point), [list(left), list(right)], "mpmath", cse=True)(*point.values())
            for a, b in zip(*(map(mpmath.mpmathify, side) for side in sides), strict=True):
                if isinstance(claim, sp.Eq):
                    assert abs(a - b) <= TOLERANCE * (1 + abs(a) + abs(b)), entry.id
                else:
                    assert claim.func(a, b), entry.id
