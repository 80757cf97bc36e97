"""Parse formulas: errors are found token by token, then Python's `ast` makes the tree.

Nothing of the text is ever run as code. Each kind of mistake has its own message, with the character where it is.
"""

from __future__ import annotations

import ast
import difflib
import keyword
import re
import unicodedata
from dataclasses import dataclass
from fractions import Fraction
from typing import cast

from rodgen.errors import shown
from rodgen.limits import FORMULA
from rodgen.machines.effects._formula_limits import FUNCTIONS, check_limits
from rodgen.machines.effects._formula_tree import MOST_DIGITS, OPERATORS, FormulaError, write

MOST_NODES, DEEPEST = 300, 40
_LONGEST_NAME, _LARGEST_POWER_OF_TEN = 60, 300

_TOKEN = re.compile(
    r"(?P<blank>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z][A-Za-z0-9_]*)"
    r"|(?P<operator>\*\*|[-+*/^()])"
)

_MENDED = {
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
    check_limits(tree)
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
        found = _TOKEN.match(text, position)
        if found is None:
            raise _unknown_character(text, position)
        kind = str(found.lastgroup)
        if kind != "blank":
            tokens.append(_Token(kind, "**" if found[0] == "^" else found[0], position))
        position = found.end()
    return [*tokens, _Token("end", "", len(text))]


def _unknown_character(text: str, position: int) -> FormulaError:
    character = text[position]
    found = f"{shown(character)} at character {position + 1}"
    for characters, mended in _MENDED.items():
        if character in characters:
            return FormulaError(found, mended)
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
