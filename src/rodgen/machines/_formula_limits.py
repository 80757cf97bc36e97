"""What makes a short formula expensive, or no number at all, found before anything is computed with it.

Whoever evaluates a formula exactly pays for its constants (``9**9**9`` has 370 million digits) and for powers of
powers (``((2*x)**20)**20`` holds 2**400, and each further level twenty times the digits). So constants are
worked out here with bounded digits, and the degree of every product of powers is bounded. An exponent that is no
constant counts with the largest number it could come to when what looks like a variable cancels, as in
``(2*x)**(10**9*a/a)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from rodgen.errors import shown
from rodgen.machines._formula_tree import (
    OPERATORS,
    Call,
    FormulaError,
    Name,
    Negation,
    Node,
    Number,
    Operation,
    write,
)

__all__ = ["FUNCTIONS", "check_limits"]

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
"""The functions of the formula language, with what they do to a number."""

_LARGEST_EXPONENT = 20
_LARGEST_DEGREE = 1000
_MOST_BITS = 2048  # a 40 digit number down to 1e-300 has 1130
_LARGEST = 1e300
_ZERO = 1e-15  # what is this small has been rounded: sin(pi) in floating point is 1e-16


@dataclass(frozen=True)
class _Size:
    """What evaluation may cost.

    Attributes
    ----------
    value : Fraction or float or None
        Of a constant: exact, or rounded where a function is in it. None for what varies.
    degree : float
        As a polynomial, of what varies.
    reach : float
        What it could come to if every name were one, and every quotient as large as its numbers allow.
    logarithm : bool
        Whether there is one in it: the exponential of a logarithm is a power.
    """

    value: Fraction | float | None
    degree: float = 0.0
    reach: float = 1.0
    logarithm: bool = False


def check_limits(node: Node) -> None:
    """Raise FormulaError where a tree holds what is no number, or what is too costly to evaluate exactly."""
    _size(node)


def _size(node: Node) -> _Size:
    match node:
        case Number():
            return _constant(node, node.value)
        case Name("pi"):
            return _Size(math.pi, reach=math.pi)
        case Name():
            return _Size(None, degree=1.0)
        case Negation(operand):
            inner = _size(operand)
            value = None if inner.value is None else -inner.value
            return _Size(value, inner.degree, inner.reach, inner.logarithm)
        case Call(function, argument):
            return _of_call(node, function, _size(argument))
        case Operation("**", left, right):
            return _of_power(node, _size(left), _size(right))
        case Operation(symbol, left, right):
            return _of_operation(node, symbol, _size(left), _size(right))


def _of_call(node: Call, function: str, inner: _Size) -> _Size:
    if inner.value is not None:
        try:
            value = FUNCTIONS[function](float(inner.value))
        except OverflowError:
            raise _beyond(node) from None
        except ValueError:
            raise FormulaError(
                f"{_quoted(node)}, which is no number", "a function where it is defined"
            ) from None
        if function == "tan" and abs(value) > 1 / _ZERO:
            raise FormulaError(f"{_quoted(node)}, which is infinite", "a function where it is defined")
        return _constant(node, value)
    if function == "exp":
        degree = inner.degree * inner.reach if inner.logarithm else inner.degree
        return _variable(node, degree, math.exp(min(inner.reach, 700.0)), inner.logarithm)
    reach = 1.0 if function in {"sin", "cos", "sign"} else inner.reach
    return _variable(node, inner.degree, reach, inner.logarithm or function == "log")


def _of_power(node: Operation, base: _Size, exponent: _Size) -> _Size:
    if exponent.value is None:
        return _of_varying_power(node, base, exponent)
    power = exponent.value
    if not -_LARGEST_EXPONENT <= power <= _LARGEST_EXPONENT:
        raise FormulaError(
            f"exponent {_quoted(node.right)} in {_quoted(node)}",
            f"one of at most {_LARGEST_EXPONENT} in size",
        )
    if base.value is None:
        steps = max(1.0, abs(float(power)))
        return _variable(node, base.degree * steps, _power(base.reach, steps), base.logarithm)
    whole = isinstance(power, Fraction) and power.denominator == 1
    if (base.value == 0 and power < 0) or (base.value < 0 and not whole):
        raise FormulaError(f"{_quoted(node)}, which is no real number", "a power that is one")
    if isinstance(base.value, Fraction) and isinstance(power, Fraction) and whole:
        if _bits(base.value) * abs(power) > _MOST_BITS:
            raise _beyond(node)
        return _constant(node, base.value**power.numerator)
    return _constant(node, _power(float(base.value), float(power)))


def _of_varying_power(node: Operation, base: _Size, exponent: _Size) -> _Size:
    if base.value is not None and base.value <= 0:
        raise FormulaError(f"{_quoted(node)}, a power of a number that is not positive", "a positive base")
    degree = max(1.0, base.degree + exponent.degree) * exponent.reach
    logarithm = base.logarithm or exponent.logarithm
    return _variable(node, degree, _power(base.reach, exponent.reach), logarithm)


def _of_operation(node: Operation, symbol: str, left: _Size, right: _Size) -> _Size:
    if symbol == "/" and right.value == 0:
        raise FormulaError(f"{_quoted(node)}, a division by zero", "a divisor that is not zero")
    if left.value is not None and right.value is not None:
        return _constant(node, OPERATORS[symbol](left.value, right.value))
    logarithm = left.logarithm or right.logarithm
    if symbol in "+-":
        return _variable(node, max(left.degree, right.degree), left.reach + right.reach, logarithm)
    return _variable(node, left.degree + right.degree, left.reach * right.reach, logarithm)


def _constant(node: Node, value: Fraction | float) -> _Size:
    if isinstance(value, float) and abs(value) < _ZERO:
        value = 0.0
    size = value if value >= 0 else -value
    if not (size == 0 or 1 / _LARGEST <= size <= _LARGEST):
        raise _beyond(node)
    if isinstance(value, Fraction) and _bits(value) > _MOST_BITS:
        raise _beyond(node)
    return _Size(value, reach=float(size if size >= 1 else 1 / size) if size else 1.0)


def _variable(node: Node, degree: float, reach: float, logarithm: bool) -> _Size:
    if degree > _LARGEST_DEGREE:
        raise FormulaError(
            f"{_quoted(node)}, a power that may reach {degree:.4g}",
            f"at most {_LARGEST_DEGREE}; exp() has no limit",
        )
    return _Size(None, degree, min(reach, _LARGEST), logarithm)


def _power(base: float, exponent: float) -> float:
    try:
        return math.pow(base, exponent)
    except OverflowError:
        return math.inf


def _bits(value: Fraction) -> int:
    return max(value.numerator.bit_length(), value.denominator.bit_length())


def _beyond(node: Node) -> FormulaError:
    return FormulaError(
        f"{_quoted(node)}, a number beyond floating point", "one between 1e-300 and 1e300 in size"
    )


def _quoted(node: Node) -> str:
    return shown(write(node), 40)
