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
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import sympy as sp
from sympy.core import random
from sympy.polys.fields import field as field_of_fractions

KEPT_TERMS = 200
"""Number of terms up to which a reduction keeps a polynomial, so that its division can be shown."""


@dataclass(frozen=True)
class Relation:
    """A polynomial that is zero and by which a numerator was divided."""

    symbol: sp.Symbol
    zero: sp.Expr
    """In the names of the reduction; :meth:`Reduction.written_out` writes it in the expression's own parts."""
    of_function: bool
    """Whether it defines a root or a sine and cosine, rather than being a side condition."""


@dataclass(frozen=True)
class Division:
    """One division of a numerator by a relation."""

    relation: Relation
    dividend: Any
    """The polynomial that was divided; None where it has more than KEPT_TERMS terms."""
    divisor: Any
    variable: Any
    degree: int
    """Degree of the dividend in the variable."""

    def multiplier(self) -> Any:
        """Return the factor by which pseudo-division multiplied the dividend."""
        degree = self.divisor.degree(self.variable)
        return self.divisor.coeff_wrt(self.variable, degree) ** (self.degree - degree + 1)

    def quotient(self) -> Any:
        """Return the pseudo-quotient."""  # SymPy 1.14's own, `pdiv`, is wrong in all variables but the first
        rest = self.dividend.prem(self.divisor, self.variable)
        return (self.dividend * self.multiplier() - rest).exquo(self.divisor)


@dataclass(frozen=True)
class Reduction:
    """How an expression was reduced: what was used, and what is left."""

    remainder: sp.Expr
    """0, or the remainder of the numerator."""
    expanded: bool
    """Whether functions of sums and multiples of angles were expanded."""
    divisions: tuple[Division, ...] = ()
    """The relations by which the numerator was divided, in this order."""
    _algebra: _Rational | None = field(default=None, repr=False)
    _denominator: Any = field(default=None, repr=False)

    def written_out(self, expr: sp.Expr) -> sp.Expr:
        """Put roots, sines and cosines in place of the names that the reduction gave them."""
        return expr if self._algebra is None else self._algebra.written_out(expr)

    def denominator(self) -> sp.Expr:
        """Return the common denominator."""
        return sp.S.One if self._denominator is None else self.written_out(self._denominator.as_expr())

    def cofactors(self) -> list[tuple[sp.Expr, sp.Expr]] | None:
        """Return pairs of a cofactor and an expression that is zero, the sum of whose products is the numerator.

        None where the remainder is not zero, or a polynomial was too long to be kept.
        """
        if self.remainder != 0 or any(d.dividend is None for d in self.divisions):
            return None
        cofactors = []
        multiplier = sp.S.One
        for division in self.divisions:
            quotient = division.quotient()
            multiplier *= division.multiplier().as_expr()
            cofactors.append(
                (
                    self.written_out(sp.factor_terms(quotient.as_expr()) / multiplier),
                    self.written_out(division.divisor.as_expr()),
                )
            )
        return cofactors


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
            value = reduce(_sum if expr.is_Add else _product, parts)
        known[expr] = value
    return known[expr]


def _product(f: Any, g: Any) -> Any:
    """Multiply fractions in lowest terms: crosswise, so that common divisors are sought of small polynomials."""
    if not f or not g:
        return f.field.zero
    a, d = _coprime(f.numer, g.denom)
    c, b = _coprime(g.numer, f.denom)
    return f.raw_new(a * c, b * d)


def _sum(f: Any, g: Any) -> Any:
    """Add fractions in lowest terms: a common divisor of the sum is one of both denominators."""
    if f.denom == g.denom:
        return f.raw_new(*_coprime(f.numer + g.numer, f.denom))
    common, b, d = f.denom.cofactors(g.denom)
    numerator, left = _coprime(f.numer * d + g.numer * b, common)
    return f.raw_new(numerator, b * d * left)


def _coprime(numerator: Any, denominator: Any) -> tuple[Any, Any]:
    """Divide two polynomials by what they have in common."""
    if denominator == 1:
        return numerator, denominator
    if not numerator:
        return numerator, denominator.ring.one
    lowest: tuple[Any, Any] = numerator.cancel(denominator)
    return lowest


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
    return reduction(expr, modulo).remainder


def reduction(expr: sp.Expr, modulo: Mapping[sp.Symbol, sp.Expr] | None = None) -> Reduction:
    """Reduce an expression as :func:`remainder` does, and return how that went.

    Examples
    --------
    >>> import sympy as sp
    >>> x, y = sp.symbols("x y", real=True)
    >>> found = reduction(x**4 - 1, {x: x**2 - 1})
    >>> found.remainder, found.cofactors()
    (0, [(x**2 + 1, x**2 - 1)])
    """
    algebra = _Rational()
    one_angle = _one_angle(expr)
    left = algebra.rational(one_angle)
    conditions = [(symbol, algebra.rational(_one_angle(value))) for symbol, value in (modulo or {}).items()]
    relations = [
        *(Relation(symbol, zero, True) for symbol, zero in reversed(algebra.relations)),
        *(Relation(symbol, zero, False) for symbol, zero in conditions),
    ]
    symbols = left.free_symbols.union(*({r.symbol} | r.zero.free_symbols for r in relations))
    expanded = one_angle != expr
    if not symbols:
        number = sp.simplify(left)
        return Reduction(number, expanded)
    fractions, *elements = field_of_fractions(sorted(symbols, key=str), sp.ZZ)
    generators = dict(zip(fractions.symbols, elements, strict=True))
    known: dict[sp.Expr, Any] = {}
    fraction = _fraction(left, generators, known)
    numerator = fraction.numer
    divisions = []
    for relation in relations:
        if numerator == 0:
            break
        divisor = _fraction(relation.zero, generators, known).numer
        variable = generators[relation.symbol].numer
        if numerator.degree(variable) >= divisor.degree(variable) > 0:
            short_numerator = numerator if len(numerator) <= KEPT_TERMS else None
            degree = numerator.degree(variable)
            numerator = numerator.prem(divisor, variable)
            divisions.append(Division(relation, short_numerator, divisor, variable, degree))
    return Reduction(
        algebra.written_out(numerator.as_expr()),
        expanded,
        tuple(divisions),
        algebra,
        fraction.denom,
    )


def _one_angle(expr: sp.Expr) -> sp.Expr:
    return sp.expand_trig(expr) if expr.has(sp.sin, sp.cos, sp.tan) else expr


def factored(expr: sp.Expr) -> Any:
    """Factor a polynomial.

    SymPy lifts factors from random points, and with bad luck it takes minutes where it usually takes milliseconds. Here
    its random numbers are always the same; the factors do not depend on them.

    Examples
    --------
    >>> x, y = sp.symbols("x y")
    >>> factored(x**2 - y**2)
    (x - y)*(x + y)
    """
    state = random.rng.getstate()
    random.seed(0)
    try:
        return sp.factor(expr)
    finally:
        random.rng.setstate(state)
