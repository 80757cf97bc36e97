"""The tree of a formula: five kinds of node, what they are worth, and how they are written."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeAlias

from rodgen.errors import UnexpectedError

__all__ = [
    "Call",
    "FormulaError",
    "Name",
    "Negation",
    "Node",
    "Number",
    "Operation",
    "fold",
    "names_in",
    "names_within",
    "write",
]


class FormulaError(UnexpectedError):
    """A formula that cannot be used: what was found, and what was expected."""


@dataclass(frozen=True)
class Number:
    """A number as it was written, exactly."""

    value: Fraction


@dataclass(frozen=True)
class Name:
    """A joint's coordinate, a column, a parameter, a constant."""

    name: str


@dataclass(frozen=True)
class Call:
    """A function of one argument."""

    function: str
    argument: Node


@dataclass(frozen=True)
class Negation:
    """The operand with the other sign."""

    operand: Node


@dataclass(frozen=True)
class Operation:
    """Two operands and what stands between them, one of ``+ - * / **``."""

    operator: str
    left: Node
    right: Node


Node: TypeAlias = Number | Name | Call | Negation | Operation

OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
}


def fold(
    node: Node,
    names: Mapping[str, Any],
    functions: Mapping[str, Callable[[Any], Any]],
    number: Callable[[Fraction], Any],
) -> Any:
    """Return what a tree is worth when its names, functions and numbers are these."""
    match node:
        case Number(value):
            return number(value)
        case Name(name):
            return names[name]
        case Call(function, argument):
            return functions[function](fold(argument, names, functions, number))
        case Negation(operand):
            return -fold(operand, names, functions, number)
        case Operation(symbol, left, right):
            return OPERATORS[symbol](
                fold(left, names, functions, number), fold(right, names, functions, number)
            )


def names_in(node: Node) -> Iterator[str]:
    """List the names in a tree, one as often as it stands there."""
    match node:
        case Name(name):
            yield name
        case Call(_, inner) | Negation(inner):
            yield from names_in(inner)
        case Operation(_, left, right):
            yield from names_in(left)
            yield from names_in(right)


def names_within(node: Node) -> Iterator[str]:
    """List the names on which a tree does not depend linearly: in an argument, a divisor or a power."""
    match node:
        case Call(_, inner):
            yield from names_in(inner)
        case Negation(inner):
            yield from names_within(inner)
        case Operation("**", _, _):
            yield from names_in(node)
        case Operation("/", left, right):
            yield from names_within(left)
            yield from names_in(right)
        case Operation(_, left, right):
            yield from names_within(left)
            yield from names_within(right)


# how tightly a node holds together; a child that holds less than its place asks for is put in parentheses
_SUM, _PRODUCT, _SIGN, _POWER, _ATOM = range(5)
_STRENGTH = {"+": _SUM, "-": _SUM, "*": _PRODUCT, "/": _PRODUCT, "**": _POWER}


def write(node: Node) -> str:
    """Write a tree, with the fewest parentheses that parse to the same tree."""
    match node:
        case Number(value):
            return _decimal(value)
        case Name(name):
            return name
        case Call(function, argument):
            return f"{function}({write(argument)})"
        case Negation(operand):
            return f"-{_inside(operand, _SIGN)}"
        case Operation("**", left, right):
            return f"{_inside(left, _ATOM)}**{_inside(right, _SIGN)}"
        case Operation(symbol, left, right):
            strength = _STRENGTH[symbol]
            space = " " if strength == _SUM else ""
            return f"{_inside(left, strength)}{space}{symbol}{space}{_inside(right, strength + 1)}"


def _inside(node: Node, wanted: int) -> str:
    match node:
        case Operation(symbol, _, _):
            strength = _STRENGTH[symbol]
        case Negation():
            strength = _SIGN
        case _:
            strength = _ATOM
    return write(node) if strength >= wanted else f"({write(node)})"


def _decimal(value: Fraction) -> str:
    """Write a number that has finitely many decimals, exactly."""
    twos = (value.denominator & -value.denominator).bit_length() - 1
    fives, rest = 0, value.denominator >> twos
    while rest > 1:
        fives, rest = fives + 1, rest // 5
    exponent = -max(twos, fives)
    digits = str(value.numerator * 10**-exponent // value.denominator)
    exponent += len(digits) - len(digits.rstrip("0") or digits)
    digits = digits.rstrip("0") or digits
    places = -exponent
    if not -6 < len(digits) - 1 + exponent < 16:
        point = "." if len(digits) > 1 else ""
        return f"{digits[0]}{point}{digits[1:]}e{len(digits) - 1 + exponent}"
    if places <= 0:
        return digits + "0" * exponent
    digits = digits.rjust(places + 1, "0")
    return f"{digits[:-places]}.{digits[-places:]}"
