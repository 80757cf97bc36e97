"""Limits of formulas: short ones that are expensive to evaluate, or have no value, are refused before any evaluation.

An exact evaluation is slow for large constants (``9**9**9`` has 370 million digits), for powers of powers
(``((2*x)**20)**20`` holds 2**400, and each further level twenty times the digits) and for roots (``3**-1e-9`` is
written as 3**(999999999/1000000000)/3, by way of 3**999999999). So constants are worked out here with bounded
digits, and the degree and the roots of every product of powers are bounded. What looks like a variable may cancel, as
in ``(2*x)**(10**9*a/a)``: hence the bound on what a part of a formula may come to.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction

from rodgen.errors import shown
from rodgen.machines.effects._formula_tree import OPERATORS, FormulaError, exact, write

FUNCTIONS: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "exp": math.exp,
    "log": math.log,
    "sqrt": math.sqrt,
    "abs": abs,
    "sign": lambda x: float((x > 0) - (x < 0)),
}
"""The functions of formulas, as functions of numbers."""

_LARGEST_EXPONENT = 20
_LARGEST_ROOT = 1000  # three decimals
_LARGEST_DEGREE = 1000
_MOST_DIGITS = 1e7  # binary, of an integer on the way to a root: a millisecond
_MOST_BITS = 2048  # of a constant; a 40 digit number down to 1e-300 has 1130
_LARGEST = 1e300
_ZERO = 1e-15  # what is this small has been rounded: sin(pi) in floating point is 1e-16


@dataclass(frozen=True)
class _Size:
    """Bounds on the cost of an evaluation."""

    value: Fraction | float | None
    """Of a constant: exact, or rounded where a function or a root is in it. None for what varies."""
    degree: float = 0.0
    """As a polynomial, of what varies."""
    reach: float = 1.0
    """Largest numerator or denominator that it could come to if everything with a name canceled."""
    roots: float = 1.0
    """Product of the roots that are taken of numbers in it."""
    logarithm: bool = False
    """Whether there is one in it: the exponential of a logarithm is a power."""


def check_limits(node: ast.expr) -> None:
    """Raise FormulaError where a part of a tree has no real value, or is too costly to evaluate exactly."""
    _size(node)


def _size(node: ast.expr) -> _Size:
    match node:
        case ast.Constant():
            return _checked(node, _Size(exact(node)))
        case ast.Name("pi"):
            return _Size(math.pi)
        case ast.Name():
            return _Size(None, degree=1.0)
        case ast.UnaryOp(_, operand):
            inner = _size(operand)
            return replace(inner, value=None if inner.value is None else -inner.value)
        case ast.Call(ast.Name(function), [argument]):
            return _checked(node, _of_call(node, function, _size(argument)))
        case ast.BinOp(left, ast.Pow(), right):
            return _checked(node, _of_power(node, _size(left), _size(right)))
        case ast.BinOp(left, _, right):
            return _checked(node, _of_operation(node, _size(left), _size(right)))
    raise TypeError(node)


def _of_call(node: ast.expr, function: str, inner: _Size) -> _Size:
    size = replace(inner, logarithm=inner.logarithm or function == "log")
    if function == "exp" and inner.logarithm:
        size = replace(size, degree=max(1.0, inner.degree) * inner.reach, roots=inner.roots * inner.reach)
    if function == "sqrt":
        size = replace(size, roots=2 * inner.roots)
    if inner.value is None:
        return size
    try:
        value = FUNCTIONS[function](float(inner.value))
    except OverflowError:
        raise _beyond(node) from None
    except ValueError:
        raise FormulaError(
            f"{_quoted(node)}, which is not a number", "a function where it is defined"
        ) from None
    if function == "tan" and abs(value) > 1 / _ZERO:
        raise FormulaError(f"{_quoted(node)}, which is infinite", "a function where it is defined")
    return replace(size, value=value)


def _of_power(node: ast.BinOp, base: _Size, exponent: _Size) -> _Size:
    power = exponent.value
    if power is not None and not -_LARGEST_EXPONENT <= power <= _LARGEST_EXPONENT:
        raise FormulaError(
            f"exponent {_quoted(node.right)} in {_quoted(node)}",
            f"one of at most {_LARGEST_EXPONENT} in size",
        )
    if not isinstance(power, Fraction):
        if power is None and base.value is not None and base.value <= 0:
            raise FormulaError(
                f"{_quoted(node)}, a power of a number that is not positive", "a positive base"
            )
        steps = root = exponent.reach
    elif power.denominator > _LARGEST_ROOT:
        raise FormulaError(
            f"exponent {_quoted(node.right)} in {_quoted(node)}", "one of at most three decimals"
        )
    else:
        steps, root = max(1.0, abs(float(power))), float(power.denominator)
    return _Size(
        None if base.value is None or power is None else _power(node, base.value, power),
        degree=max(1.0, base.degree) * steps,
        reach=_float_power(base.reach, steps),
        roots=base.roots * root,
        logarithm=base.logarithm or exponent.logarithm,
    )


def _power(node: ast.BinOp, base: Fraction | float, power: Fraction | float) -> Fraction | float:
    whole = isinstance(power, Fraction) and power.denominator == 1
    if (base == 0 and power < 0) or (base < 0 and not whole):
        raise FormulaError(f"{_quoted(node)}, which is not a real number", "a power that is one")
    if isinstance(base, Fraction) and isinstance(power, Fraction) and whole:
        if _bits(base) * abs(power) > _MOST_BITS:
            raise _beyond(node)
        return base**power.numerator
    return _float_power(float(base), float(power))


def _of_operation(node: ast.BinOp, left: _Size, right: _Size) -> _Size:
    if isinstance(node.op, ast.Div) and right.value == 0:
        raise FormulaError(f"{_quoted(node)}, a division by zero", "a divisor that is not zero")
    value = None
    if left.value is not None and right.value is not None:
        value = OPERATORS[type(node.op)](left.value, right.value)
    logarithm = left.logarithm or right.logarithm
    reach = left.reach * right.reach
    if isinstance(node.op, ast.Add | ast.Sub):
        degree, roots = max(left.degree, right.degree), max(left.roots, right.roots)
        return _Size(value, degree, 2 * reach, roots, logarithm)
    return _Size(value, left.degree + right.degree, reach, left.roots * right.roots, logarithm)


def _checked(node: ast.expr, size: _Size) -> _Size:
    value = size.value
    if isinstance(value, float) and abs(value) < _ZERO:
        value = 0.0
    if value and not 1 / _LARGEST <= (value if value > 0 else -value) <= _LARGEST:
        raise _beyond(node)
    if isinstance(value, Fraction):
        if _bits(value) > _MOST_BITS:
            raise _beyond(node)
        largest = max(abs(value.numerator), value.denominator)
        return _Size(value, reach=float(min(largest, 10**300)))
    if size.degree > _LARGEST_DEGREE or _digits(size) > _MOST_DIGITS:
        steep = f"{_quoted(node)}, a power or root that may reach {max(size.degree, size.roots):.4g}"
        raise FormulaError(steep, f"at most {_LARGEST_DEGREE} in all")
    return replace(size, value=value, reach=min(size.reach, _LARGEST))


def _float_power(base: float, exponent: float) -> float:
    try:
        return math.pow(base, exponent)
    except OverflowError:
        return math.inf


def _digits(size: _Size) -> float:
    """Return the bits of the integers on the way to a root."""
    return size.roots * math.log2(size.reach) if size.roots > 1 else 0.0


def _bits(value: Fraction) -> int:
    return max(value.numerator.bit_length(), value.denominator.bit_length())


def _beyond(node: ast.expr) -> FormulaError:
    return FormulaError(
        f"{_quoted(node)}, a number beyond floating point", "one between 1e-300 and 1e300 in size"
    )


def _quoted(node: ast.expr) -> str:
    return shown(write(node), 40)
