"""The tree of a formula: nodes of Python's `ast`, how they are evaluated, and how they are written.

Five kinds occur: `ast.Constant` (whose value is a Fraction), `ast.Name`, `ast.Call` of one argument, `ast.UnaryOp` (the
negation) and `ast.BinOp` with one of `OPERATORS`.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from decimal import Context, Decimal
from fractions import Fraction
from typing import Any, cast

from rodgen.errors import UnexpectedError


class FormulaError(UnexpectedError):
    """A formula that cannot be used: what was found, and what was expected."""


OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


def exact(node: ast.Constant) -> Fraction:
    """Return the number of a leaf; the parser leaves fractions there."""
    return cast(Fraction, node.value)


def fold(
    node: ast.expr,
    names: Mapping[str, Any],
    functions: Mapping[str, Callable[[Any], Any]],
    number: Callable[[Fraction], Any],
) -> Any:
    """Return the value of a tree, given those of its names, functions and numbers."""

    def value(node: ast.expr) -> Any:
        match node:
            case ast.Constant():
                return number(exact(node))
            case ast.Name(name):
                return names[name]
            case ast.Call(ast.Name(function), [argument]):
                return functions[function](value(argument))
            case ast.UnaryOp(_, operand):
                return -value(operand)
            case ast.BinOp(left, symbol, right):
                return OPERATORS[type(symbol)](value(left), value(right))
        raise TypeError(node)

    return value(node)


def nonlinear_parts(node: ast.expr) -> list[ast.expr]:
    """Return the parts of a tree on which its value does not depend linearly: arguments, divisors and powers."""
    match node:
        case ast.Call(_, [argument]):
            return [argument]
        case ast.UnaryOp(_, operand):
            return nonlinear_parts(operand)
        case ast.BinOp(_, ast.Pow(), _):
            return [node]
        case ast.BinOp(left, ast.Div(), right):
            return [*nonlinear_parts(left), right]
        case ast.BinOp(left, _, right):
            return [*nonlinear_parts(left), *nonlinear_parts(right)]
    return []


# how tightly a node holds together; a child that holds less tightly than its place demands gets parentheses
_SUM, _PRODUCT, _SIGN, _POWER, _ATOM = range(5)
_WRITTEN: dict[type[ast.operator], tuple[str, int]] = {
    ast.Add: (" + ", _SUM),
    ast.Sub: (" - ", _SUM),
    ast.Mult: ("*", _PRODUCT),
    ast.Div: ("/", _PRODUCT),
    ast.Pow: ("**", _POWER),
}


MOST_DIGITS = 40
"""Significant digits of a number in a formula."""
_DECIMALS = Context(prec=MOST_DIGITS)


def write(node: ast.expr) -> str:
    """Return the text of a tree, with the fewest parentheses that parse to the same tree."""
    return _write(node)[0]


def _write(node: ast.expr) -> tuple[str, int]:
    """Return the text of a tree, and how tightly it holds together."""
    match node:
        case ast.Constant():
            return _decimal(exact(node)), _ATOM
        case ast.Name(name):
            return name, _ATOM
        case ast.Call(ast.Name(function), [argument]):
            return f"{function}({write(argument)})", _ATOM
        case ast.UnaryOp(_, operand):
            return f"-{_inside(operand, _SIGN)}", _SIGN
        case ast.BinOp(left, ast.Pow(), right):
            return f"{_inside(left, _ATOM)}**{_inside(right, _SIGN)}", _POWER
        case ast.BinOp(left, symbol, right):
            text, strength = _WRITTEN[type(symbol)]
            return f"{_inside(left, strength)}{text}{_inside(right, strength + 1)}", strength
    raise TypeError(node)


def _inside(node: ast.expr, wanted: int) -> str:
    text, strength = _write(node)
    return text if strength >= wanted else f"({text})"


def _decimal(value: Fraction) -> str:
    """Return the decimal text of a number, which has finitely many decimals: no more than a formula may have."""
    number = _DECIMALS.normalize(_DECIMALS.divide(Decimal(value.numerator), Decimal(value.denominator)))
    return f"{number:f}" if -6 < number.adjusted() < 16 else f"{number:e}".replace("e+", "e")
