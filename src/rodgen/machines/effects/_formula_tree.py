"""The tree of a formula: nodes of Python's `ast`, how a text is parsed, how trees are evaluated, and how written.

Five kinds occur: `ast.Constant` (whose value is a Fraction), `ast.Name`, `ast.Call` of one argument, `ast.UnaryOp` (the
negation) and `ast.BinOp` with one of `OPERATORS`.

Errors are found token by token, then Python's `ast` makes the tree. Nothing of the text is ever run as code. Each kind
of mistake has its own message, with the character where it is.

Constants are worked out here with bounded digits: short ones may have no value, or be expensive to evaluate exactly
(``9**9**9`` has 370 million digits). What varies is evaluated in floating point, where any power costs the same.
"""

from __future__ import annotations

import ast
import difflib
import keyword
import math
import operator
import re
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction
from typing import Any, cast

from rodgen.errors import UnexpectedError, shown
from rodgen.limits import FORMULA


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


# limits ------------------------------------------------------------------------------------------------------------

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
_MOST_BITS = 2048  # of a constant; a 40 digit number down to 1e-300 has 1130
_SMALLEST, _LARGEST = Fraction(1, 10**300), 1e300
_ZERO = 1e-15  # of its parts; what is this small has been rounded: sin(pi) in floating point is 1e-16


def constant(node: ast.expr) -> Fraction | float | None:
    """Return the value of a tree without names: exact, or rounded where a function or a root is in it; else None.

    Raises
    ------
    FormulaError
        Where a part of the tree has no real value, or too many digits.
    """
    match node:
        case ast.Constant():
            return _checked(node, exact(node))
        case ast.Name(name):
            return math.pi if name == "pi" else None
        case ast.UnaryOp(_, operand):
            value = constant(operand)
            return None if value is None else -value
        case ast.Call(ast.Name(function), [argument]):
            value = constant(argument)
            return None if value is None else _checked(node, _called(node, function, value))
        case ast.BinOp(left, symbol, right):
            operation = _power if isinstance(symbol, ast.Pow) else _operation
            a, b = constant(left), constant(right)
            value = operation(node, a, b)
            if value == 0 and a and b and not isinstance(symbol, ast.Add | ast.Sub):  # too small for a float
                raise _beyond(node)
            return None if value is None else _checked(node, value)
    raise TypeError(node)


def _called(node: ast.expr, function: str, argument: Fraction | float) -> float:
    expected = "a function where it is defined"
    try:
        value = FUNCTIONS[function](float(argument))
    except OverflowError:
        raise _beyond(node) from None
    except ValueError:
        raise FormulaError(f"{_quoted(node)}, which is not a number", expected) from None
    if function == "tan" and abs(value) > 1 / _ZERO:
        raise FormulaError(f"{_quoted(node)}, which is infinite", expected)
    if function == "exp" and value == 0:
        raise _beyond(node)
    circular = function in {"sin", "cos", "tan"} and abs(float(argument)) > 1
    return 0.0 if circular and abs(value) < _ZERO else value


def _power(
    node: ast.BinOp, base: Fraction | float | None, power: Fraction | float | None
) -> Fraction | float | None:
    if power is not None and not -_LARGEST_EXPONENT <= power <= _LARGEST_EXPONENT:
        raise FormulaError(
            f"exponent {_quoted(node.right)} in {_quoted(node)}",
            f"one of at most {_LARGEST_EXPONENT} in size",
        )
    if base is not None and power is None and base <= 0:
        raise FormulaError(f"{_quoted(node)}, a power of a number that is not positive", "a positive base")
    if base is None or power is None:
        return None
    whole = isinstance(power, Fraction) and power.denominator == 1
    if (base == 0 and power < 0) or (base < 0 and not whole):
        raise FormulaError(f"{_quoted(node)}, which is not a real number", "a power that is one")
    if isinstance(base, Fraction) and isinstance(power, Fraction) and whole:
        if _bits(base) * abs(power) > _MOST_BITS:
            raise _beyond(node)
        return base**power.numerator
    try:
        return math.pow(base, power)
    except OverflowError:
        raise _beyond(node) from None


def _operation(
    node: ast.BinOp, left: Fraction | float | None, right: Fraction | float | None
) -> Fraction | float | None:
    if isinstance(node.op, ast.Div) and right == 0:
        raise FormulaError(f"{_quoted(node)}, a division by zero", "a divisor that is not zero")
    if left is None or right is None:
        return None
    value = OPERATORS[type(node.op)](left, right)
    largest = max(abs(float(left)), abs(float(right)))
    cancelled = isinstance(node.op, ast.Add | ast.Sub) and abs(value) < _ZERO * largest
    return 0.0 if cancelled and isinstance(value, float) else value


def _checked(node: ast.expr, value: Fraction | float) -> Fraction | float:
    if value and not _SMALLEST <= (value if value > 0 else -value) <= _LARGEST:
        raise _beyond(node)
    if isinstance(value, Fraction) and _bits(value) > _MOST_BITS:
        raise _beyond(node)
    return value


def _bits(value: Fraction) -> int:
    return max(value.numerator.bit_length(), value.denominator.bit_length())


def _beyond(node: ast.expr) -> FormulaError:
    return FormulaError(
        f"{_quoted(node)}, a number beyond floating point", "one between 1e-300 and 1e300 in size"
    )


def _quoted(node: ast.expr) -> str:
    return shown(write(node), 40)


# parser ------------------------------------------------------------------------------------------------------------

MOST_NODES, DEEPEST = 300, 40
_LONGEST_NAME, _LARGEST_POWER_OF_TEN = 60, 300

_TOKEN = re.compile(
    r"(?P<blank>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z][A-Za-z0-9_]*)"
    r"|(?P<operator>\*\*|[-+*/^()])"
)

_CORRECTED = {
    "·⋅∙×∗•": "'*'",
    "−–—‐‑‒": "'-'",
    "÷∕⁄": "'/'",
    "πΠ": "'pi'",
    "²": "'**2'",
    "³": "'**3'",
    "√": "'sqrt(...)'",
    ",;": "one argument for each function, and a point as decimal mark",
    ".": "digits after it, and none in a name",
    "'\"`": "names without quotes",
    "=<>!": "a value, without a comparison: sign() tells one side from the other",
    "[]{}": "parentheses, '(' and ')'",
    "_": "names that begin with a letter",
}

_VALUE = "a number, a name, a function or '('"
_NODES = (ast.BinOp, ast.UnaryOp, ast.Call, ast.Name, ast.Constant, ast.USub, ast.Load, *OPERATORS)


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    start: int

    @property
    def end(self) -> int:
        return self.start + len(self.text)

    @property
    def at(self) -> str:
        return f"at character {self.start + 1}"


def parse(text: str) -> ast.expr:
    """Return the tree of a formula.

    Raises
    ------
    FormulaError
        When the text is not a formula.
    """
    if not text.strip():
        raise FormulaError("an empty formula", "one such as 'a*sin(q)'")
    if len(text) > FORMULA:
        raise FormulaError(f"a formula of {len(text)} characters", f"one of at most {FORMULA} characters")
    tokens = _tokens(text)
    _check(tokens)
    tree = _tree(tokens)
    written = len(write(tree))
    if written > FORMULA:  # a formula may be written back into a file
        raise FormulaError(
            f"a formula of {written} characters with its blanks", f"one of at most {FORMULA} characters"
        )
    constant(tree)
    return tree


def _tree(tokens: list[_Token]) -> ast.expr:
    """Return Python's tree of tokens that make a formula.

    Python sees neither the numbers, which it would round, nor the bare names: lambda, say, is a name in a formula.
    """
    numbers: list[Fraction] = []
    words = []
    for token in tokens:
        if token.kind == "number":
            words.append(str(len(numbers)))
            numbers.append(_number(token))
        else:
            words.append(f"_{token.text}" if token.kind == "name" else token.text)
    tree = ast.parse(" ".join(words).strip(), mode="eval").body
    _Restore(numbers).visit(tree)
    return tree


class _Restore(ast.NodeVisitor):
    """Put the numbers and names back; no kind of node that is not in the white list passes."""

    def __init__(self, numbers: list[Fraction]) -> None:
        self.numbers = numbers

    def visit(self, node: ast.AST) -> None:
        if not isinstance(node, _NODES):
            raise AssertionError(f"{type(node).__name__} in a formula")
        if isinstance(node, ast.Name):
            node.id = node.id.removeprefix("_")
        elif isinstance(node, ast.Constant):
            node.value = self.numbers[cast("int", node.value)]  # type: ignore[assignment]
        self.generic_visit(node)


def _tokens(text: str) -> list[_Token]:
    tokens = []
    position = 0
    while position < len(text):
        token = _TOKEN.match(text, position)
        if token is None:
            raise _unknown_character(text, position)
        kind = str(token.lastgroup)
        if kind != "blank":
            tokens.append(_Token(kind, "**" if token[0] == "^" else token[0], position))
        position = token.end()
    return [*tokens, _Token("end", "", len(text))]


def _unknown_character(text: str, position: int) -> FormulaError:
    character = text[position]
    found = f"{shown(character)} at character {position + 1}"
    for characters, corrected in _CORRECTED.items():
        if character in characters:
            return FormulaError(found, corrected)
    if ord(character) > 126 or not character.isprintable():
        name = unicodedata.name(character, f"U+{ord(character):04X}")
        return FormulaError(f"{found} ({name})", "names of Latin letters a to z, digits and '_'")
    return FormulaError(found, "names, numbers, + - * / **, parentheses and functions")


def _check(tokens: list[_Token]) -> None:
    """Raise FormulaError unless values and operators alternate and every parenthesis is closed."""
    if sum(token.text not in {"(", ")", ""} for token in tokens) > MOST_NODES:
        raise FormulaError(
            f"a formula of more than {MOST_NODES} numbers, names and operators", "a shorter one"
        )
    opened: list[tuple[_Token, int, int]] = []
    depth = outer = 1  # of parentheses, signs and powers; of the innermost parentheses alone
    before, wants_value = tokens[-1], True
    for token, after in zip(tokens, [*tokens[1:], tokens[-1]], strict=True):
        if depth > DEEPEST:
            raise FormulaError(f"a formula nested more than {DEEPEST} deep {token.at}", "a flatter one")
        if token.text == "(" and (wants_value or before.text in FUNCTIONS):
            if after.text == ")":
                raise FormulaError(f"'()' {token.at} with nothing inside", _VALUE)
            opened.append((token, depth, outer))
            depth = outer = depth + 1
            wants_value = True
        elif wants_value and token.text == "-":
            depth += 1
        elif wants_value:
            _check_value(token, before, after)
            wants_value = False
        elif token.kind in {"number", "name"} or token.text == "(":
            raise _side_by_side(before, token)
        elif token.text == ")":
            if not opened:
                raise FormulaError(f"')' {token.at} that closes nothing", "as many '(' as ')'")
            _, depth, outer = opened.pop()
        elif token.kind == "operator":
            depth = depth + 1 if token.text == "**" else outer
            wants_value = True
        before = token
    if opened:
        raise FormulaError(f"'(' {opened[-1][0].at} that is never closed", "as many ')' as '('")


def _check_value(token: _Token, before: _Token, after: _Token) -> None:
    """Raise FormulaError unless a token is a number, a name or a function."""
    if token.kind == "end":
        raise FormulaError(f"nothing after {shown(before.text)} at the end", _VALUE)
    if token.kind == "operator":
        raise FormulaError(f"{shown(token.text)} {token.at} where a value should be", _VALUE)
    if token.kind == "number":
        _number(token)
    elif len(token.text) > _LONGEST_NAME:
        raise FormulaError(
            f"a name of {len(token.text)} characters {token.at}", f"one of at most {_LONGEST_NAME}"
        )
    elif token.text in FUNCTIONS:
        if after.text != "(":
            raise FormulaError(f"function {token.text!r} {token.at} without '('", f"'{token.text}(...)'")
    elif after.text == "(":
        near = difflib.get_close_matches(token.text.lower(), FUNCTIONS, n=1, cutoff=0.6)
        product = f"'{token.text[:20]}*(' for a product"
        raise FormulaError(
            f"unknown function {shown(token.text, 20)} {token.at}",
            f"'{near[0]}', or {product}" if near else f"one of {', '.join(FUNCTIONS)}, or {product}",
        )


def _side_by_side(before: _Token, token: _Token) -> FormulaError:
    if before.kind == token.kind == "number":
        return FormulaError(
            f"numbers {shown(before.text, 20)} and {shown(token.text, 20)} side by side {before.at}",
            "one number, or an operator between them",
        )
    if keyword.iskeyword(before.text) or keyword.iskeyword(token.text):
        word = before.text if keyword.iskeyword(before.text) else token.text
        return FormulaError(f"{word!r} {before.at}", "arithmetic alone: sign() tells one side from the other")
    gap = "" if before.end == token.start else " "
    return FormulaError(
        f"{shown(before.text + gap + token.text, 40)} {before.at}, with no operator between",
        shown(f"{before.text}*{token.text}", 40),
    )


def _number(token: _Token) -> Fraction:
    digits, _, exponent = token.text.lower().partition("e")
    significant = len(digits.replace(".", "").lstrip("0"))
    if significant > MOST_DIGITS:
        raise FormulaError(f"a number of {significant} digits {token.at}", f"one of at most {MOST_DIGITS}")
    value, power = Fraction(digits), int(exponent or 0)
    if not value:
        return value
    if abs(power) <= 2 * _LARGEST_POWER_OF_TEN:
        value *= Fraction(10) ** power
        if Fraction(10) ** -_LARGEST_POWER_OF_TEN <= value <= Fraction(10) ** _LARGEST_POWER_OF_TEN:
            return value
    raise FormulaError(f"number {shown(token.text, 20)} {token.at}", "one between 1e-300 and 1e300 in size")
