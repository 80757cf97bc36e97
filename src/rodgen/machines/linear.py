"""Linear combinations of named quantities, as a machine file writes them: ``J3m - J2m``, ``0.5*J2 + 10 deg``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any, NoReturn

from rodgen.data.units import ONE, Dimension, parse_unit
from rodgen.errors import InputFileError, UnexpectedError, shown, suggestion
from rodgen.machines.effects.formula import FUNCTION_NAMES, Formula

_QUANTITY = re.compile(
    r"(?<![\w.])(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?![eE][+-]?\d)\s*(?P<unit>(?:[^\W\d_]|°)[^\s()*+-]*)"
)
_KEY = re.compile(r"(?<![\w.])[^\W\d][\w-]*(?:\[[^\]]*\])?(?:\.[\w-]+)+")
_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_LARGEST = Fraction(10) ** 9
_LINEAR = "sums of multiples, such as 'a - 2*b + 10 deg'"


@dataclass(frozen=True)
class Combination:
    """A linear combination, internal units."""

    text: str
    """As it was stated."""
    factors: tuple[tuple[str, Fraction], ...]
    """Each name once, with its factor, none of them zero."""
    constant: Fraction


def combination(
    text: str, names: Mapping[str, Dimension], dimension: Dimension, length_unit: str, what: str
) -> Combination:
    """Return the combination that a text stands for; plain numbers are exact.

    Parameters
    ----------
    text : str
        Names, numbers, numbers with a unit, ``+ - * /`` and parentheses.
    names : mapping of str to Dimension
        What each name may be.
    dimension : Dimension
        Of the value.
    length_unit : str
        Of the machine.
    what : str
        What a name is called in an error message.

    Raises
    ------
    UnexpectedError
        When it is no such text, has another name, is not linear, or measures something else.

    Examples
    --------
    >>> from rodgen.data.units import ANGLE
    >>> combination("-(J2m - J3m)/2", {"J2m": ANGLE, "J3m": ANGLE}, ANGLE, "mm", "reading").factors
    (('J2m', Fraction(-1, 2)), ('J3m', Fraction(1, 2)))
    """
    values: dict[str, _Value] = {}
    written: dict[str, str] = {}

    def placeholder(value: _Value, text_there: str) -> str:
        name = f"placeholder{len(written)}"
        values[name], written[name] = value, text_there
        return name

    def quantity(match: re.Match[str]) -> str:
        if match["unit"] in names:  # "2 J2", which the formula's parser knows how to repair
            return match[0]
        unit = parse_unit(match["unit"])
        factor = Fraction(unit.factor(length_unit))
        return placeholder(_Value({"": Fraction(match["number"]) * factor}, unit.dimension), match[0])

    def restored(message: str) -> str:
        for name in reversed(written):
            message = message.replace(name, written[name])
        return message

    given = _QUANTITY.sub(quantity, text)
    odd = sorted((name for name in names if not _IDENTIFIER.fullmatch(name)), key=len, reverse=True)
    for name in odd:  # names that no formula has
        own = partial(placeholder, _Value({name: Fraction(1)}, names[name]))
        given = re.sub(rf"(?<![\w.]){re.escape(name)}(?![\w.])", lambda found, own=own: own(found[0]), given)  # type: ignore[misc]
    if unknown := _KEY.search(given):
        raise UnexpectedError(f"no {what} {shown(restored(unknown[0]))}", suggestion(unknown[0], list(names)))
    try:
        formula = Formula.parse(given, file="", place="")
    except InputFileError as error:
        raise UnexpectedError(restored(error.found), restored(error.expected)) from None
    for name in sorted(formula.names - values.keys()):
        if name not in names:
            raise UnexpectedError(f"no {what} {shown(name)}", suggestion(name, list(names)))
        values[name] = _Value({name: Fraction(1)}, names[name])
    value = formula.evaluate(values, dict.fromkeys(FUNCTION_NAMES, _not_linear), _plain)
    constant = value.terms.pop("", Fraction(0))
    if value.dimension != dimension and (value.terms or constant):
        raise UnexpectedError(f"a value in {value.dimension}", f"one in {dimension}")
    for number in (*value.terms.values(), constant):
        if number and not 1 / _LARGEST < abs(number) < _LARGEST:
            raise UnexpectedError(
                "a factor or a constant of an unusual size", f"one below {float(_LARGEST):g}"
            )
    return Combination(text, tuple((name, x) for name, x in value.terms.items() if x), constant)


def _plain(number: Fraction) -> _Value:
    return _Value({"": number}, ONE)


def _not_linear(*_: Any) -> NoReturn:
    raise UnexpectedError("a formula that is not linear", _LINEAR)


@dataclass(frozen=True)
class _Value:
    """A combination while it is computed: factors by name, the constant by the empty name."""

    terms: dict[str, Fraction]
    dimension: Dimension

    @property
    def is_zero(self) -> bool:
        return not any(self.terms.values())

    def times(self, factor: Fraction, dimension: Dimension) -> _Value:
        return _Value({name: x * factor for name, x in self.terms.items()}, dimension)

    def plus(self, other: _Value) -> _Value:
        if self.dimension != other.dimension and not (self.is_zero or other.is_zero):
            bare = next((x for x in (self, other) if x.dimension == ONE and x.terms.keys() <= {""}), None)
            if bare is not None:
                number = float(bare.terms[""])
                raise UnexpectedError(
                    f"{number:g} without a unit", f"a number with its unit, such as '{abs(number):g} deg'"
                )
            found = f"{self.dimension} and {other.dimension} added"
            raise UnexpectedError(found, "two of one kind; a factor may have a unit, such as '5 mm/rev * J4'")
        terms = {**self.terms}
        for name, x in other.terms.items():
            terms[name] = terms.get(name, Fraction(0)) + x
        return _Value(terms, other.dimension if self.is_zero else self.dimension)

    def __add__(self, other: _Value) -> _Value:
        return self.plus(other)

    def __sub__(self, other: _Value) -> _Value:
        return self.plus(-other)

    def __neg__(self) -> _Value:
        return self.times(Fraction(-1), self.dimension)

    def __mul__(self, other: _Value) -> _Value:
        of, by = (other, self) if self.terms.keys() <= {""} else (self, other)
        if not by.terms.keys() <= {""}:
            _not_linear()
        return of.times(by.terms.get("", Fraction(0)), of.dimension * by.dimension)

    def __truediv__(self, other: _Value) -> _Value:
        if not other.terms.keys() <= {""}:
            _not_linear()
        if other.is_zero:
            raise UnexpectedError("a division by zero", _LINEAR)
        return self.times(1 / other.terms[""], self.dimension / other.dimension)

    __pow__ = _not_linear
