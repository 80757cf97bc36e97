"""Rows of measurements that are set aside: which these are, said by row, by run or by a rule on columns, and why.

A machine file lists entries, and later ones overrule earlier ones. An entry that lists rows is of one file, and has a
check of what was commanded and read in them: it never names other rows when lines were inserted above, and holds while
the file grows. Runs and rules hold for every file, unless they name one.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Mask
from rodgen.data.units import TEMPERATURE, UnitError, number_and_unit, parse_unit
from rodgen.errors import InputFileError, UnexpectedError, joined, listed, nearest_hint, shown

if TYPE_CHECKING:
    from rodgen.data.measurements import Measurements

_ROWS = re.compile(r"\d{1,15}(?:\s*-\s*\d{1,15})?(?:\s*,\s*\d{1,15}(?:\s*-\s*\d{1,15})?)*")
_QUOTED = r"\"[^\"]*\"|'[^']*'"
_NAME = rf"{_QUOTED}|(?:(?!\band\b)[^<>=!\"'])+?"
_COMPARISON = re.compile(
    rf"\s*(?P<name>{_NAME})\s*(?P<sign><=|>=|!=|=|<|>)\s*(?P<value>{_QUOTED}|[^\s\"'].*?)"
    rf"(?:\s*$|\s+and\b(?=\s*(?:{_NAME})\s*[<>=!]))"
)
"""With the `and` after it, which another comparison follows: a value may have an `and` of its own."""
_SIGNS: Mapping[str, Any] = {
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "=": np.equal,
    "!=": np.not_equal,
}
_SUCH_ROWS = 'rows such as "12, 40-43"'
_SUCH_RULE = "a rule such as EL < 20 deg or run = 'day 2', or several joined by and"
LONGEST = 200
"""Characters of a text other than a list of rows."""
MOST_SHOWN = 60
"""Characters of a list of rows in a sentence."""


@dataclass(frozen=True)
class SetAside:
    """An entry: rows that are set aside, or brought back.

    Attributes
    ----------
    rows : str
        As the table counts them: lines of a CSV file from 1, else rows from 0, such as ``"12, 40-43"``.
    run : str
        Or the name of a run.
    where : str
        Or a rule on columns, such as ``"EL < 20 deg and load > 50 N"``.
    file : str
        Name of the only file that it is about; empty: every file.
    check : str
        Of `rows`: that of their content; empty where it was not noted.
    back : bool
        Whether they count, whatever entries before say.
    why : str
    """

    rows: str = ""
    run: str = ""
    where: str = ""
    file: str = ""
    check: str = ""
    back: bool = False
    why: str = ""

    def __post_init__(self) -> None:
        stated = [name for name in ("rows", "run", "where") if getattr(self, name)]
        if len(stated) != 1:
            found = joined(stated) if stated else "neither rows, run nor where"
            raise UnexpectedError(found, "one of rows, run and where")
        for name in ("run", "where", "file", "check", "why"):
            text = getattr(self, name)
            if not text.isprintable() or len(text) > LONGEST:
                raise UnexpectedError(
                    f"{name} {shown(text)}", f"a text on one line, of {LONGEST} characters at most"
                )
        if self.rows and not self.file:
            raise UnexpectedError("rows without a file", "the file that they are of, too")
        if self.rows and not _ROWS.fullmatch(self.rows.strip()):
            raise UnexpectedError(f"rows {shown(self.rows)}", _SUCH_ROWS)
        if turned := next((f"{a}-{b}" for a, b in self._pairs() if b < a), None):
            raise UnexpectedError(f"rows {turned}", "the smaller number first")
        if self.check and not self.rows:
            raise UnexpectedError("a check without rows", "it with rows only")
        _ = self._comparisons()

    def _pairs(self) -> list[tuple[int, int]]:
        """Return the first and last row of each stretch."""
        stretches = (part.partition("-") for part in self.rows.split(",") if part)
        return [(int(first), int(last or first)) for first, _, last in stretches]

    def _comparisons(self) -> list[tuple[str, str, str]]:
        """Return column, sign and value of each comparison of the rule."""
        comparisons, end = [], 0
        while end < len(self.where):
            each = _COMPARISON.match(self.where, end)
            if each is None:
                raise UnexpectedError(f"the rule {shown(self.where)}", _SUCH_RULE)
            name, value = (text[1:-1] if text[0] in "\"'" else text for text in each.group("name", "value"))
            comparisons.append((name, each["sign"], value))
            end = each.end()
        return comparisons

    @property
    def selects(self) -> tuple[Any, ...]:
        """What is alike in entries on the same rows."""
        return self._pairs(), self.run, self.where, self.file

    def to_dict(self) -> dict[str, Any]:
        """Return what it says, as plain data."""
        return {key: value for key, value in asdict(self).items() if value}

    def named(self, counted: str = "row") -> str:
        """Return what its rows are called in a sentence, and why; `counted` is what rows of a table are called."""
        text = self.rows
        if len(text) > MOST_SHOWN:
            text = f"{text[:MOST_SHOWN].rpartition(',')[0]}, …"
        what = f"{counted}{'s' * (not text.isdigit())} {text}" if text else self.where or f"run {self.run}"
        return f"{what} ({self.why})" if self.why else what

    def of(self, data: Measurements, compared: Collection[str]) -> Mask | None:
        """Return which rows of a table it is about, (n,); None where it is about another file.

        Parameters
        ----------
        compared
            Names of the columns of what is commanded and read, which the check is of.

        Raises
        ------
        UnexpectedError
            When there is no such row, run or column, or the rows are others than they were.
        """
        from rodgen.data.measurements import UNNAMED  # there is a table: what reads tables is imported

        name = os.path.basename(data.file)
        ours = not self.file or os.path.basename(self.file) == name
        if not self.rows:
            if not ours:
                return None
            return self._in_run(data) if self.run else self._by_rule(data)
        numbers, pairs = data.numbers(range(data.rows)), np.array(self._pairs())
        there = np.isin(pairs, numbers)
        first, last = pairs[np.argsort(pairs[:, 0], kind="stable")].T
        stretch = np.searchsorted(first, numbers, "right") - 1
        mask = (stretch >= 0) & (np.maximum.accumulate(last)[stretch] >= numbers)
        same = there.all() and (not self.check or self.check == _check(data, mask, compared))
        if same and (ours or self.check):
            return np.asarray(mask)
        if not ours or (self.check and name == UNNAMED):
            return None
        if self.check:
            found = f"{self.named(data.counted)} of {name}, which are not the rows that were set aside"
            expected = "the rows as they were; if this is another file, rodgen exclude --undo --all"
            raise UnexpectedError(found, expected)
        found = f"{data.counted} {pairs[~there][0]} of {name}, which is no measurement"
        raise UnexpectedError(found, f"{data.counted}s that are")

    def _in_run(self, data: Measurements) -> Mask:
        is_there = _compared(data, "run", "=", self.run)
        if not is_there.any():
            names = data.columns["run"].names  # type: ignore[union-attr]
            where = f"no run {shown(self.run)} in {os.path.basename(data.file)}"
            raise UnexpectedError(where, listed(names) if names else "rows")
        return is_there

    def _by_rule(self, data: Measurements) -> Mask:
        masks = [_compared(data, *comparison) for comparison in self._comparisons()]
        return np.asarray(np.logical_and.reduce(masks))


def _compared(data: Measurements, name: str, sign: str, value: str) -> Mask:
    """Return in which rows a column compares with a value as a sign says, (n,)."""
    from rodgen.data.measurements import plain_name  # there is a table: what reads tables is imported

    of = os.path.basename(data.file)
    column: Any = data.columns.get(name)
    if column is None:
        hint = nearest_hint(name, {column_name: c.text for column_name, c in data.columns.items()})
        raise UnexpectedError(f"no column {shown(name)} in {of}{hint}", listed(data.columns))
    if hasattr(column, "codes"):
        names = column.names
        if sign not in {"=", "!="}:
            raise UnexpectedError(f"{shown(sign)} with {name}, which holds names", "= or !=")
        wanted = plain_name(value)  # which another file may not have
        return np.asarray(_SIGNS[sign](column.codes, names.index(wanted) if wanted in names else -1))
    found = number_and_unit(value)
    if found is None:
        raise UnexpectedError(f"{name} {sign} {shown(value)}", "a number, with its unit")
    number, typed = found
    if typed and typed != column.unit:
        try:
            unit, own = parse_unit(typed), parse_unit(column.unit or "1")
        except UnitError as error:
            raise UnexpectedError(error.found, error.expected) from None
        if unit.dimension != own.dimension or own.dimension == TEMPERATURE:  # whose scales begin elsewhere
            expected = f"one such as {column.unit}" if column.unit else "none"
            raise UnexpectedError(f"the unit {shown(typed)} of {name}", expected)
        number *= unit.factor() / own.factor()
    return np.asarray(_SIGNS[sign](column.values, number))


def _check(data: Measurements, mask: Mask, compared: Collection[str]) -> str:
    """Return a check of the content of some rows."""
    digest = hashlib.sha256()
    for name, column in data.columns.items():
        if name in compared:
            values: Any = column.take(mask).values
            names = values.dtype.kind == "U"
            digest.update("\n".join(values).encode() if names else (values + 0.0).astype("<f8").tobytes())
    return digest.hexdigest()[:12]


def rows_text(numbers: Sequence[int]) -> str:
    """Return whole numbers, neighbours as ranges.

    Examples
    --------
    >>> rows_text([3, 4, 5, 9])
    '3-5, 9'
    """
    distinct = np.unique(np.asarray(numbers, np.int64))
    groups = np.split(distinct, np.flatnonzero(np.diff(distinct) > 1) + 1)
    return ", ".join(f"{g[0]}-{g[-1]}" if len(g) > 1 else f"{g[0]}" for g in groups if len(g))


@dataclass(frozen=True, eq=False)
class RowsAside:
    """Which rows of a table are set aside, and why.

    Attributes
    ----------
    mask : ndarray of bool, shape (n,)
    entries : tuple of (SetAside, int or None)
        Each with how many rows it is about; None where it is about another file.
    data : Measurements
        The table.
    """

    mask: Mask
    entries: tuple[tuple[SetAside, int | None], ...]
    data: Measurements

    @property
    def text(self) -> str:
        """A sentence."""
        name, count, counted = os.path.basename(self.data.file), int(self.mask.sum()), self.data.counted
        here = [(entry, n) for entry, n in self.entries if n is not None]
        reasons = "; ".join(
            f"{'but not ' if entry.back else ''}{entry.named(counted)}{'' if n else ', true of no row'}"
            for entry, n in here
        )
        are = "is" if count == 1 else "are"
        first = f"{count} of the {len(self.mask)} rows of {name} {are} set aside: {reasons}."
        elsewhere = "; ".join(f"{entry.named()} of {entry.file}" for entry, n in self.entries if n is None)
        further = f"What the machine file sets aside of other files is not in {name}: {elsewhere}."
        return " ".join(filter(None, [first if here else "", further if elsewhere else ""]))

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data: `rows`, how many, and the `entries`, each with how many it is about, `count`."""
        entries = [entry.to_dict() | {"count": count} for entry, count in self.entries]
        return {"rows": int(self.mask.sum()), "entries": entries}


def rows_aside(
    entries: Sequence[SetAside], data: Measurements, compared: Collection[str], file: str
) -> RowsAside | None:
    """Return which rows of a table are set aside; None without an entry.

    Parameters
    ----------
    compared
        See `SetAside.of`.
    file
        The machine file, for error messages.

    Raises
    ------
    InputFileError
        When an entry does not fit the table, or no row is left.
    """
    if not entries:
        return None
    mask, counts = np.zeros(data.rows, bool), []
    for number, entry in enumerate(entries, 1):
        try:
            of_entry = entry.of(data, compared)
        except UnexpectedError as error:
            place = f"[measured], set_aside {number}"
            raise InputFileError(file, place, error.found, error.expected) from None
        counts.append(None if of_entry is None else int(of_entry.sum()))
        if of_entry is not None:
            mask = mask & ~of_entry if entry.back else mask | of_entry
    if len(mask) and mask.all():
        found_all = f"all {len(mask)} rows of {os.path.basename(data.file)}"
        raise InputFileError(file, "[measured], set_aside", found_all, "entries that leave some to fit to")
    return RowsAside(mask, tuple(zip(entries, counts, strict=True)), data)


def others(
    entries: Sequence[SetAside], data: Measurements, compared: Collection[str]
) -> tuple[SetAside, ...]:
    """Return the entries that are about other files than this one."""

    def is_other(entry: SetAside) -> bool:
        try:
            return entry.of(data, compared) is None
        except UnexpectedError:
            return False

    return tuple(filter(is_other, entries))


def edited(
    entries: Sequence[SetAside], new: SetAside, data: Measurements, compared: Collection[str], file: str
) -> tuple[SetAside, ...]:
    """Return the entries with one more, which sets rows aside or brings them back, and without what it replaces.

    Parameters
    ----------
    compared, file
        As of `rows_aside`.
    new
        Of rows of that table.

    Raises
    ------
    UnexpectedError
        When the table has no such rows, or those that are to be brought back are not set aside.
    """
    chosen = new.of(data, compared)
    assert chosen is not None

    def of_rows(entry: SetAside, mask: Mask) -> Iterator[SetAside]:
        if mask.any():
            rows = rows_text(data.numbers(np.flatnonzero(mask)).tolist())
            yield replace(entry, rows=rows, check=_check(data, mask, compared))

    remaining: list[SetAside] = []
    for entry in entries:
        if entry.selects == new.selects:
            continue
        of_entry = entry.of(data, compared) if entry.rows and new.rows else None
        remaining += (
            [entry]
            if of_entry is None or not (of_entry & chosen).any()
            else of_rows(entry, of_entry & ~chosen)
        )
    if new.rows:
        (new,) = of_rows(new, chosen)
    if not new.back:
        last = remaining[-1] if remaining else None
        both = last.of(data, compared) if last and last.rows and new.rows else None
        if last and both is not None and last == replace(new, rows=last.rows, check=last.check):
            remaining.pop()  # one entry for all that is set aside for one reason
            (new,) = of_rows(new, chosen | both)
        return (*remaining, new)
    left = rows_aside(remaining, data, compared, file)
    if left is not None and left.mask[chosen].any():
        remaining.append(new)
    elif remaining == [*entries]:
        found = f"{new.named(data.counted)} of {os.path.basename(data.file)}, not set aside"
        raise UnexpectedError(found, "rows that are")
    return tuple(_needed(remaining, data, compared))


def _needed(entries: Sequence[SetAside], data: Measurements, compared: Collection[str]) -> Iterator[SetAside]:
    """Yield entries without those that bring back rows of this file which no entry before sets aside."""
    mask = np.zeros(data.rows, bool)
    for entry in entries:
        of_entry = entry.of(data, compared)
        if of_entry is None or not entry.back or not entry.file or (mask & of_entry).any():
            yield entry
        if of_entry is not None:
            mask = mask & ~of_entry if entry.back else mask | of_entry
