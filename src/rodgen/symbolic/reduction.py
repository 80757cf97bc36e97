"""Does an expression vanish identically? Exact, by polynomial arithmetic.

An expression is brought over one denominator and its numerator is reduced to a normal form. What is not
rational is named and carried with its defining polynomial: a square root s = √A with s² − A, a sine and
cosine of one argument with sin² + cos² − 1. The numerator is divided by these polynomials one after the
other; a remainder of zero is a proof wherever the denominator is not zero. Any other function is an
unknown like a symbol, so a zero remainder is a proof for it, too; a remainder that is not zero is not a
disproof in that case.
"""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp

__all__ = ["remainder"]


class _Algebraic:
    """Names for the parts that are not rational, and the polynomials that define them."""

    def __init__(self) -> None:
        self._names: dict[sp.Expr, sp.Symbol] = {}
        self.relations: list[tuple[sp.Symbol, sp.Expr]] = []

    def name(self, part: sp.Expr) -> sp.Symbol:
        if part not in self._names:
            self._names[part] = sp.Dummy(f"u{len(self._names)}", real=True)
        return self._names[part]

    def rational(self, expr: sp.Expr) -> sp.Expr:
        """Replace every part that is not rational, innermost first."""
        if not expr.args or expr.is_Number:
            return expr
        if expr.is_Pow and expr.exp.is_Rational and not expr.exp.is_Integer:
            return self._root(self.rational(expr.base), int(expr.exp.q)) ** int(expr.exp.p)
        args = [self.rational(arg) for arg in expr.args]
        if isinstance(expr, sp.Add | sp.Mul) or (expr.is_Pow and expr.exp.is_Integer):
            return expr.func(*args)
        if isinstance(expr, sp.sin | sp.cos | sp.tan):
            sine, cosine = self._circle(args[0])
            return {sp.sin: sine, sp.cos: cosine, sp.tan: sine / cosine}[expr.func]
        return self.name(expr.func(*args))

    def _root(self, base: sp.Expr, degree: int) -> sp.Symbol:
        power = sp.Pow(sp.together(base), sp.Rational(1, degree), evaluate=False)
        known = power in self._names
        root = self.name(power)
        if not known:
            self.relations.append((root, root**degree - base))
        return root

    def _circle(self, angle: sp.Expr) -> tuple[sp.Symbol, sp.Symbol]:
        known = sp.sin(angle) in self._names
        sine, cosine = self.name(sp.sin(angle)), self.name(sp.cos(angle))
        if not known:
            self.relations.append((sine, sine**2 + cosine**2 - 1))
        return sine, cosine


def _numerator(expr: sp.Expr) -> sp.Expr:
    numerator, _ = sp.fraction(sp.together(expr))
    return numerator


def remainder(expr: sp.Expr, modulo: Mapping[sp.Symbol, sp.Expr] | None = None) -> sp.Expr:
    """Reduce an expression; the result is exactly 0 only if the expression vanishes identically.

    Parameters
    ----------
    expr : sympy expression
        What should vanish.
    modulo : mapping of symbol to expression, optional
        Side conditions as a triangular system: each symbol with an expression that is zero and has the
        symbol in it, last-eliminated symbol last. Where a leading coefficient is not a number, the proof
        holds where that coefficient is not zero.

    Returns
    -------
    sympy expression
        0, or what is left of the numerator.

    Examples
    --------
    >>> import sympy as sp
    >>> x, y = sp.symbols("x y", real=True)
    >>> remainder((x**2 - y**2) / (x - y) - (x + y))
    0
    >>> remainder(x**4 - 1, {x: x**2 - 1})
    0
    >>> remainder(sp.sqrt(x**2 + y) ** 3 - (x**2 + y) * sp.sqrt(x**2 + y))
    0
    """
    algebraic = _Algebraic()
    left = _numerator(algebraic.rational(expr))
    conditions = [(symbol, algebraic.rational(value)) for symbol, value in (modulo or {}).items()]
    for symbol, condition in [*reversed(algebraic.relations), *conditions]:
        if symbol in left.free_symbols:
            left = sp.prem(left, _numerator(condition), symbol)
    symbols = sorted(left.free_symbols, key=lambda symbol: str(symbol))
    return sp.Poly(left, *symbols).as_expr() if symbols else sp.nsimplify(left)
