"""From the text of a formula to its tree: a tokenizer, and a parser by binding strength (Pratt).

Nothing of the text is ever run as code. Each slip of the pen has a sentence of its own, with the character where
it stands.
"""

from __future__ import annotations

import difflib
import keyword
import re
import unicodedata
from dataclasses import dataclass
from fractions import Fraction

from rodgen.errors import shown
from rodgen.machines.effects._formula_limits import FUNCTIONS, check_limits
from rodgen.machines.effects._formula_tree import (
    Call,
    FormulaError,
    Name,
    Negation,
    Node,
    Number,
    Operation,
    write,
)

__all__ = ["parse"]

LONGEST, MOST_NODES, DEEPEST = 2000, 300, 40
_LONGEST_NAME, _MOST_DIGITS, _LARGEST_POWER_OF_TEN = 60, 40, 300

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

_BINDING = {"+": 10, "-": 10, "*": 20, "/": 20, "**": 40}
_SIGN = 30
_VALUE = "a number, a name, a function or '('"


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


def parse(text: str) -> Node:
    """Return the tree of a formula; FormulaError says what is wrong with it."""
    if not text.strip():
        raise FormulaError("an empty formula", "one such as 'a*sin(q)'")
    if len(text) > LONGEST:
        raise FormulaError(f"a formula of {len(text)} characters", f"one of at most {LONGEST}")
    tree = _Parser(_tokens(text)).whole()
    if len(write(tree)) > LONGEST:  # a formula may be written back into a file
        raise FormulaError(
            f"a formula of {len(write(tree))} characters with its blanks", f"one of at most {LONGEST}"
        )
    check_limits(tree)
    return tree


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


class _Parser:
    def __init__(self, tokens: list[_Token]) -> None:
        self.tokens = tokens
        self.index = 0
        self.nodes = 0

    @property
    def token(self) -> _Token:
        return self.tokens[self.index]

    def take(self) -> _Token:
        token = self.token
        self.index += 1
        return token

    def made(self, node: Node) -> Node:
        self.nodes += 1
        if self.nodes > MOST_NODES:
            raise FormulaError(
                f"a formula of more than {MOST_NODES} numbers, names and operators", "a shorter one"
            )
        return node

    def whole(self) -> Node:
        node = self.expression(0, 1)
        if self.token.text == ")":
            raise FormulaError(f"')' {self.token.at} that closes nothing", "as many '(' as ')'")
        return node

    def expression(self, binding: int, depth: int) -> Node:
        """Parse as far as operators hold tighter than `binding`."""
        if depth > DEEPEST:
            raise FormulaError(f"a formula nested more than {DEEPEST} deep {self.token.at}", "a flatter one")
        left = self.value(depth)
        while True:
            token = self.token
            if token.kind in {"number", "name"} or token.text == "(":
                raise self.side_by_side()
            strength = _BINDING.get(token.text, 0)
            if strength <= binding:
                return left
            self.take()
            # a power is taken from the right, and its exponent may have a sign: a**-b**c = a**(-(b**c))
            right = self.expression(_SIGN - 1 if token.text == "**" else strength, depth + 1)
            left = self.made(Operation(token.text, left, right))

    def value(self, depth: int) -> Node:
        token = self.take()
        if token.kind == "number":
            return self.made(Number(_number(token)))
        if token.kind == "name":
            return self.named(token, depth)
        if token.text == "-":
            return self.made(Negation(self.expression(_SIGN, depth + 1)))
        if token.text == "(":
            return self.bracketed(token, depth)
        if token.kind == "end":
            last = self.tokens[self.index - 2]
            raise FormulaError(f"nothing after {shown(last.text)} at the end", _VALUE)
        raise FormulaError(f"{shown(token.text)} {token.at} where a value should be", _VALUE)

    def named(self, token: _Token, depth: int) -> Node:
        if len(token.text) > _LONGEST_NAME:
            raise FormulaError(
                f"a name of {len(token.text)} characters {token.at}", f"one of at most {_LONGEST_NAME}"
            )
        called = self.token.text == "("
        if token.text in FUNCTIONS:
            if not called:
                raise FormulaError(f"function {token.text!r} {token.at} without '('", f"'{token.text}(...)'")
            return self.made(Call(token.text, self.bracketed(self.take(), depth)))
        if called:
            near = difflib.get_close_matches(token.text.lower(), FUNCTIONS, n=1, cutoff=0.6)
            product = f"'{token.text[:20]}*(' for a product"
            raise FormulaError(
                f"unknown function {shown(token.text, 20)} {token.at}",
                f"'{near[0]}', or {product}" if near else f"one of {', '.join(FUNCTIONS)}, or {product}",
            )
        return self.made(Name(token.text))

    def bracketed(self, opened: _Token, depth: int) -> Node:
        if self.token.text == ")":
            raise FormulaError(f"'()' {opened.at} with nothing inside", _VALUE)
        node = self.expression(0, depth + 1)
        if self.token.text != ")":
            raise FormulaError(f"'(' {opened.at} that is never closed", "as many ')' as '('")
        self.take()
        return node

    def side_by_side(self) -> FormulaError:
        before, token = self.tokens[self.index - 1], self.token
        if before.kind == token.kind == "number":
            return FormulaError(
                f"numbers {shown(before.text, 20)} and {shown(token.text, 20)} side by side {before.at}",
                "one number, or an operator between them",
            )
        if keyword.iskeyword(before.text) or keyword.iskeyword(token.text):
            word = before.text if keyword.iskeyword(before.text) else token.text
            return FormulaError(
                f"{word!r} {before.at}", "arithmetic alone: sign() tells one side from the other"
            )
        gap = "" if before.end == token.start else " "
        return FormulaError(
            f"{shown(before.text + gap + token.text, 40)} {before.at}, with no operator between",
            shown(f"{before.text}*{token.text}", 40),
        )


def _number(token: _Token) -> Fraction:
    digits, _, exponent = token.text.lower().partition("e")
    power = int(exponent or 0)
    significant = len(digits.replace(".", "").lstrip("0"))
    if significant > _MOST_DIGITS:
        raise FormulaError(f"a number of {significant} digits {token.at}", f"one of at most {_MOST_DIGITS}")
    value = Fraction(digits)
    size = abs(power) + len(digits)
    if value and (abs(power) > 2 * _LARGEST_POWER_OF_TEN or not _in_range(value, power, size)):
        raise FormulaError(
            f"number {shown(token.text, 20)} {token.at}", "one between 1e-300 and 1e300 in size"
        )
    return value * Fraction(10) ** power if value else Fraction(0)


def _in_range(value: Fraction, power: int, size: int) -> bool:
    if size < _LARGEST_POWER_OF_TEN:
        return True
    exact = value * Fraction(10) ** power
    return Fraction(10) ** -_LARGEST_POWER_OF_TEN <= exact <= Fraction(10) ** _LARGEST_POWER_OF_TEN
