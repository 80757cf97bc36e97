"""Find the wanted columns of a file, and the factor that converts each to the unit asked for.

A column's name is ``name [unit]``. Lengths are converted to the unit of the first length column, so that a file in
millimetres is computed in millimetres, without rounding; angles are converted to radians. Where every column is wanted
(`EveryColumn`), each keeps its own unit.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from rodgen.data.units import Quantity, conversion_factor, is_unit
from rodgen.errors import InputFileError, in_file, nearest_hint, shown

_NAME_AND_UNIT = re.compile(r"(?P<name>[^\[\]]*?)\s*\[(?P<unit>[^\[\]]*)\]")

_UNITS = {"length": " [mm]", "angle": " [deg]", "rate": " [deg/s]", "time": " [s]", "number": "", "name": ""}
"""Units of the columns in an example of a header."""
_TARGETS = {"angle": "rad", "rate": "rad/s", "time": "s"}


@dataclass(frozen=True)
class Column:
    """A column that a table must have."""

    name: str
    """Its name, without the unit."""
    quantity: Quantity | Literal["number", "name"]
    """What its numbers measure. A length is read in the unit of the table's first length column, an angle in radians,
    its rate of change in radians a second, a time in seconds; a plain number has no unit, nor has a name: text."""
    optional: bool = False
    """Whether a table may be without it; its name in other letters, capital or small, is then an error."""


@dataclass(frozen=True)
class Layouts:
    """Several sets of columns: a table has that of which most of the needed columns are there, else the first."""

    sets: tuple[tuple[Column, ...], ...]

    def of(self, texts: Sequence[str]) -> tuple[Column, ...]:
        """Return the set of a table with these columns."""
        names = {bare_name(text) for text in texts}

        def share(some: tuple[Column, ...]) -> float:
            there = [column.name in names for column in some if not column.optional]
            return sum(there) / len(there) if 2 * sum(there) > len(there) else 0.0

        return max(self.sets, key=share)


@dataclass(frozen=True)
class EveryColumn:
    """Every column of a table that has a name, each in its own unit or in none.

    A column without a unit that begins with a word holds words, such as an operator's name; all others but `text`
    hold numbers.
    """

    text: tuple[str, ...]
    """The names of columns that hold a name in every row; a table need not have them."""
    example: str
    """A header, for the error messages."""


MEASUREMENTS = EveryColumn(("target", "run"), "X [mm],C [deg],x [mm],y [mm],z [mm]")
"""The columns of a measurement file."""


@dataclass(frozen=True)
class Match:
    """The place of a wanted column in a file, and the factor of its numbers.

    Among `EveryColumn` the unit may be empty, and a column may hold text.
    """

    name: str
    index: int
    text: str
    unit: str
    factor: float
    holds_text: bool = False


def match_columns(
    texts: Sequence[str],
    columns: Sequence[Column] | Layouts | EveryColumn,
    file: str,
    place: str,
    *,
    numbered: bool,
) -> list[Match]:
    """Find the wanted columns among the column names of a file.

    Parameters
    ----------
    texts : sequence of str
        Every column name of the file, with its unit, in order.
    columns : sequence of Column, Layouts, or EveryColumn
        Those wanted; the result is in this order, of every column in the file's.
    file, place : str
        For the error message.
    numbered : bool
        Whether to refer to a column without a name by its number (a CSV header; a Parquet schema has names).

    Raises
    ------
    InputFileError
        When one is missing, occurs twice, or has no unit or one that does not fit.
    """
    if isinstance(columns, Layouts):
        columns = columns.of(texts)
    example = columns.example if isinstance(columns, EveryColumn) else _header_example(columns)
    _check_is_header(texts, example, file, place)
    _check_unique(texts, file, place)
    if isinstance(columns, EveryColumn):
        return _match_every(texts, columns, file, place, numbered=numbered)
    named: dict[str, list[tuple[int, str | None]]] = {}
    for index, text in enumerate(texts):
        name, unit = _split(text)
        named.setdefault(name, []).append((index, unit))
    matches: list[Match] = []
    reference: str | None = None
    for column in columns:
        matching = named.get(column.name, [])
        if not matching:
            error, near = _missing(column, texts, columns, file, place, numbered=numbered)
            if column.optional and not near:
                continue
            raise error
        if len(matching) > 1:
            raise _twice(column.name, [texts[i] for i, _ in matching[:2]], file, place)
        index, unit = matching[0]
        where = f"{place}, column {shown(texts[index])}"
        example = f"{column.name}{_UNITS[column.quantity]}"
        if column.quantity == "number" or column.quantity == "name":
            if unit not in (None, "", "1"):
                raise InputFileError(
                    file, where, f"the unit {shown(unit)}", f"{example!r}, which has no unit"
                )
            matches.append(Match(column.name, index, texts[index], "", 1.0, column.quantity == "name"))
            continue
        if not unit:
            raise InputFileError(file, where, "no unit", f"one in brackets, such as '{example}'")
        if column.quantity == "length":
            reference = target = reference or unit
        else:
            target = _TARGETS[column.quantity]
        with in_file(file, where):
            factor = conversion_factor(unit, column.quantity, target)
        matches.append(Match(column.name, index, texts[index], unit, factor))
    return matches


def _match_every(
    texts: Sequence[str], columns: EveryColumn, file: str, place: str, *, numbered: bool
) -> list[Match]:
    seen: dict[str, str] = {}
    matches: list[Match] = []
    for index, text in enumerate(texts):
        name, unit = _split(text.strip())
        where = f"{place}, column {index + 1}" if numbered else f"{place}, column {shown(text)}"
        if not text.strip() or text.startswith("__index_level_"):
            continue  # a comma at the end of every line, or the row numbers of a pandas table
        if not name:
            raise InputFileError(file, where, f"{shown(text)}, a unit without a name", "a name before it")
        if unit is None and (meant := _other_brackets(text)):
            raise InputFileError(file, where, f"{shown(text)}, a unit in {meant[0]}", f"brackets, {meant[1]}")
        if name in seen:
            raise _twice(name, [seen[name], text], file, place)
        seen[name] = text
        slip = next((t for t in columns.text if t.casefold() == name.casefold()), name)
        if slip != name:
            raise InputFileError(file, where, shown(text), f"{slip!r}, in this spelling")
        if unit and name in columns.text:
            raise InputFileError(file, where, f"{shown(text)}, a unit of names", f"{name!r} alone")
        matches.append(Match(name, index, text, unit or "", 1.0, name in columns.text))
    if not matches:
        raise InputFileError(file, place, "no columns", f"columns such as {columns.example}")
    return matches


def _other_brackets(text: str) -> tuple[str, str] | None:
    """Return, for a name that ends in a unit that is not in brackets, what it is in and the correct name; else None."""
    bare, mark, rest = re.sub(r"[(\[{]", "[", text, count=1).partition("[")
    if not mark:
        return ("brackets that do not match", "one before the unit, too") if "]" in text else None
    unit = re.sub(r"[)\]}].*", "", rest).strip()
    meant = f"'{bare.strip()} [{unit}]'"
    if "[" in text or "]" in text:
        return "brackets that do not match", meant
    # "mean (of 5)" is a name: only a known unit counts as one.
    if (
        bare.strip()
        and re.fullmatch(r".*[)}]\s*", text)
        and (not unit or (not unit[0].isdigit() and is_unit(unit)))
    ):
        return "parentheses" if "(" in text else "braces", meant
    return None


def _twice(name: str, texts: Sequence[str], file: str, place: str) -> InputFileError:
    both = " and ".join(map(shown, texts))
    return InputFileError(file, place, f"column {name!r} twice, {both}", "it once")


def bare_name(text: str) -> str:
    """Return the name of a column without its unit."""
    return _split(text)[0]


def _split(text: str) -> tuple[str, str | None]:
    match = _NAME_AND_UNIT.fullmatch(text)
    return (match["name"].strip(), match["unit"].strip()) if match else (text, None)


def _check_unique(texts: Sequence[str], file: str, place: str) -> None:
    twice = [text for text, count in Counter(texts).items() if count > 1]
    if twice:
        name = f"column {shown(twice[0])} twice" if twice[0] else "two columns without a name"
        raise InputFileError(file, place, name, "every column name once")


def _check_is_header(texts: Sequence[str], example: str, file: str, place: str) -> None:
    wanted = f"a header such as {example}"
    if len(texts) == 1:
        for mark, name in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
            if mark in texts[0]:
                raise InputFileError(
                    file, place, f"{name} between the columns", "commas, and a point as decimal mark"
                )
    # One cell may be a number; a table with many such names (wavelengths of a spectrum, say) has others with units.
    numbers = sum(_is_number(text) for text in texts)
    if 2 * numbers > len(texts) and not any("[" in text for text in texts):
        raise InputFileError(file, place, "numbers where the header should be", wanted)
    if texts and texts[0].startswith("#"):
        raise InputFileError(file, place, "a comment", wanted)


def _missing(
    column: Column,
    texts: Sequence[str],
    columns: Sequence[Column],
    file: str,
    place: str,
    *,
    numbered: bool,
) -> tuple[InputFileError, bool]:
    """Return the error, and whether a column was meant to be the missing one."""
    example = f"{column.name}{_UNITS[column.quantity]}"
    for number, text in enumerate(texts, start=1):
        where = f"{place}, column {number}" if numbered else place
        bare, _, rest = re.sub(r"[(\[{]", "[", text, count=1).partition("[")
        if bare.strip() == column.name:
            what = "parentheses" if "(" in text else "braces" if "{" in text else "brackets that do not match"
            unit = re.sub(r"[)\]}].*", "", rest).strip()
            found = f"{shown(text)}, a unit in {what}"
            return InputFileError(file, where, found, f"brackets, '{column.name} [{unit}]'"), True
    taken = {c.name for c in columns}
    hint = nearest_hint(
        column.name, {_split(text)[0]: text for text in texts if _split(text)[0] not in taken}
    )
    # one letter in another case, as T for a temperature and t for a time, is another name
    meant = len(column.name) > 1 and column.name.casefold() in (_split(text)[0].casefold() for text in texts)
    expected = f"one such as '{example}'" if example != column.name else f"all of {_header_example(columns)}"
    return InputFileError(file, place, f"no column {column.name!r}{hint}", expected), meant


def _header_example(columns: Sequence[Column]) -> str:
    return ",".join(
        f"{c.name}{_UNITS[c.quantity]}" for c in columns if not c.optional or c.quantity == "angle"
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
