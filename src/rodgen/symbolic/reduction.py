"""Decide whether an expression vanishes identically: exactly, by polynomial arithmetic.

An expression is brought over one denominator and its numerator is reduced to a normal form. What is not
rational is named and carried with its defining polynomial: a square root s = √A with s² − A, a sine and
cosine of one argument with sin² + cos² − 1. The numerator is divided by these polynomials one after the
other; a remainder of zero is a proof wherever the denominator is not zero. Any other function is an
unknown like a symbol, so a zero remainder is a proof for it, too; a remainder that is not zero is not a
disproof in that case.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import Any

import sympy as sp
from sympy.polys.fields import field

__all__ = ["remainder"]


class _Rational:
    """Expressions as rational functions of symbols and of names for what is not rational."""

    def __init__(self) -> None:
        self.relations: list[tuple[sp.Symbol, sp.Expr]] = []
        self._names: dict[sp.Expr, sp.Symbol] = {}
        self._known: dict[sp.Expr, sp.Expr] = {}

    def rational(self, expr: sp.Expr) -> sp.Expr:
        """Replace every part that is not rational by its name, innermost first."""
        if expr.is_Symbol or expr.is_Rational:
            return expr
        if expr not in self._known:
            self._known[expr] = self._rational(expr)
        return self._known[expr]

    def _rational(self, expr: sp.Expr) -> sp.Expr:
        if expr.is_Float:
            raise ValueError(f"a proof needs exact numbers, not {expr}")
        if expr.is_Pow and expr.exp.is_Rational and not expr.exp.is_Integer:
            return self._root(self.rational(expr.base), int(expr.exp.q)) ** int(expr.exp.p)
        args = [self.rational(arg) if isinstance(arg, sp.Expr) else arg for arg in expr.args]
        if expr.is_Add or expr.is_Mul or (expr.is_Pow and expr.exp.is_Integer):
            return expr.func(*args)
        if isinstance(expr, sp.sin | sp.cos | sp.tan):
            sine, cosine = self._circle(args[0])
            return {sp.sin: sine, sp.cos: cosine, sp.tan: sine / cosine}[expr.func]
        return self._name(expr.func(*args) if args else expr)

    def written_out(self, expr: sp.Expr) -> sp.Expr:
        """Put the parts back in place of their names, outermost first."""
        for part, name in reversed(self._names.items()):
            expr = expr.xreplace({name: part})
        return expr

    def _name(self, part: sp.Expr) -> sp.Symbol:
        return self._names.setdefault(part, sp.Dummy(f"u{len(self._names)}", real=True))

    def _root(self, base: sp.Expr, degree: int) -> sp.Symbol:
        power = sp.Pow(sp.factor(base), sp.Rational(1, degree), evaluate=False)
        known = power in self._names
        root = self._name(power)
        if not known:
            self.relations.append((root, root**degree - base))
        return root

    def _circle(self, angle: sp.Expr) -> tuple[sp.Symbol, sp.Symbol]:
        known = sp.sin(angle) in self._names
        sine, cosine = self._name(sp.sin(angle)), self._name(sp.cos(angle))
        if not known:
            self.relations.append((sine, sine**2 + cosine**2 - 1))
        return sine, cosine


def _fraction(expr: sp.Expr, generators: Mapping[sp.Symbol, Any], known: dict[sp.Expr, Any]) -> Any:
    """Evaluate in the field of fractions: much faster than to bring a nested formula together at once."""
    if expr.is_Symbol:
        return generators[expr]
    if expr not in known:
        unit = next(iter(generators.values())) ** 0
        if expr.is_Rational:
            value = unit * int(expr.p) / int(expr.q)
        elif expr.is_Pow:
            value = _fraction(expr.base, generators, known) ** int(expr.exp)
        else:
            parts = [_fraction(arg, generators, known) for arg in expr.args]
            value = sum(parts, 0 * unit) if expr.is_Add else prod(parts, start=unit)
        known[expr] = value
    return known[expr]


def remainder(expr: sp.Expr, modulo: Mapping[sp.Symbol, sp.Expr] | None = None) -> sp.Expr:
    """Return the remainder of an expression: exactly 0 only if the expression vanishes identically.

    Parameters
    ----------
    expr : sympy expression
        What should vanish.
    modulo : mapping of symbol to expression, optional
        Side conditions as a triangular system: each symbol with an expression that is zero and has the
        symbol in it; a condition may hold the symbols of later ones, not of earlier ones. Where a
        leading coefficient is not a number, the proof holds where that coefficient is not zero.

    Returns
    -------
    sympy expression
        0, or the remainder of the numerator.

    Raises
    ------
    ValueError
        When a floating-point number is in the expression.

    Examples
    --------
    >>> import sympy as sp
    >>> x, y = sp.symbols("x y", real=True)
    >>> remainder((x**2 - y**2) / (x - y) - (x + y))
    0
    >>> remainder(x**4 - 1, {x: x**2 - 1})
    0
    >>> remainder(sp.sin(2 * x) - 2 * sp.sin(x) * sp.cos(x))
    0
    >>> remainder(x**2 - y, {x: x**2 - 1})
    1 - y
    """
    algebra = _Rational()
    left = algebra.rational(_one_angle(expr))
    conditions = [(symbol, algebra.rational(_one_angle(value))) for symbol, value in (modulo or {}).items()]
    conditions = [*reversed(algebra.relations), *conditions]
    symbols = left.free_symbols.union(*(value.free_symbols | {symbol} for symbol, value in conditions))
    if not symbols:
        return sp.simplify(left)
    fractions, *elements = field(sorted(symbols, key=str), sp.ZZ)
    generators = dict(zip(fractions.symbols, elements, strict=True))
    known: dict[sp.Expr, Any] = {}
    numerator = _fraction(left, generators, known).numer
    for symbol, value in conditions:
        divisor = _fraction(value, generators, known).numer
        variable = generators[symbol].numer
        if numerator != 0 and numerator.degree(variable) >= divisor.degree(variable) > 0:
            numerator = numerator.prem(divisor, variable)
    return algebra.written_out(numerator.as_expr())


def _one_angle(expr: sp.Expr) -> sp.Expr:
    return sp.expand_trig(expr) if expr.has(sp.sin, sp.cos, sp.tan) else expr
