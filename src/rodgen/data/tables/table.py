"""A table that is open for reading: its wanted columns become arrays, and every fault is reported with its place."""

from __future__ import annotations

import abc
import os
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import IO, Any, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rodgen.data.tables.columns import Column, EveryColumn, Layouts, Match, match_columns
from rodgen.errors import InputFileError, joined

READABLE = "a CSV or Parquet file"
MOST_PLACES = 8
"""Rows that a sentence names at most."""
CELLS = 1_000_000_000
"""Of a table that is read as a whole, of 8 B each: it protects from damaged files, and is more than machines need."""


@dataclass(frozen=True)
class Rows:
    """The rows of a table."""

    values: tuple[NDArray[np.float64], ...]
    """Each wanted column of numbers, float64 and finite: lengths in the unit of the first length column, angles in
    radians; with `EveryColumn` unconverted."""
    text: tuple[pa.ChunkedArray, ...]
    """Each wanted column of text, no cell of it blank, without the blanks around it."""
    numbers: NDArray[np.int64]
    """Of each row: its line (CSV, from 1) or its place in the file (Parquet, from 0)."""
    table: pa.Table
    """Every column of the file, unchanged; see `open_table` for a CSV file."""


class Table(abc.ABC):
    """A table that is open for reading; `open_table` makes it.

    Attributes
    ----------
    file : str
        The file as the user named it.
    matches, text : list of Match
        The place of each wanted column of numbers, with its unit, and of each of text.
    header : str
        Place of the names of the columns, for error messages.
    counted : str
        What `Rows.numbers` counts: ``"line"`` or ``"row"``.
    schema : pyarrow.Schema
        Of the columns as they are kept.
    gaps : bool
        Whether NaN may be in a column of numbers.
    """

    file: str
    matches: list[Match]
    text: list[Match]
    header: str
    counted: str
    schema: pa.Schema
    gaps = False
    _raw: IO[bytes] | None = None

    def units(self) -> dict[str, str]:
        """Return the unit of each wanted column, by its name."""
        return {match.name: match.unit for match in self.matches}

    def read(self, *, empty: bool = False) -> Rows:
        """Return all rows.

        Parameters
        ----------
        empty : bool
            Whether a table without rows is accepted.

        Raises
        ------
        InputFileError
            When the file cannot be read, at the first cell that does not hold what it should, when the table has more
            cells than the limit, and when it has no rows, unless that is accepted.
        """
        if self._rows_at_most() * (len(self.matches) + len(self.text)) > CELLS:
            raise InputFileError(self.file, "file", f"more than {CELLS:g} cells", f"at most {CELLS:g} cells")
        rows = self._read()
        if not (len(rows.numbers) or empty):
            raise InputFileError(self.file, self._end_place(), "no rows", "at least one row under the header")
        return rows

    def close(self) -> None:
        """Close the file."""
        if self._raw is not None:
            self._raw.close()

    def _find_wanted(
        self,
        texts: Sequence[str],
        columns: Sequence[Column] | Layouts | EveryColumn,
        words: Collection[int] = (),
        *,
        numbered: bool = False,
    ) -> None:
        """Set the places of the wanted columns from the names of all; `words` are the columns that hold words."""
        matches = match_columns(texts, columns, self.file, self.header, numbered=numbered)
        names: tuple[str, ...] = ()
        if isinstance(columns, EveryColumn):
            names = columns.text
            matches = [
                replace(m, holds_text=m.holds_text or (m.index in words and not m.unit)) for m in matches
            ]
        self.matches = [match for match in matches if not match.holds_text]
        self.text = [match for match in matches if match.holds_text]
        # a remark may be blank, but not the name of a target
        every = isinstance(columns, EveryColumn)
        self._needed = {match.index for match in self.text if match.name in names or not every}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @abc.abstractmethod
    def _rows_at_most(self) -> int:
        """Return how many rows there may be, before they are read."""

    @abc.abstractmethod
    def _read(self) -> Rows:
        """Return all rows."""

    @abc.abstractmethod
    def _end_place(self) -> str:
        """Return the place where the first row was expected."""

    def _accepted(self, values: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which numbers of a column are accepted, (n,)."""
        return np.isfinite(values) | np.isnan(values) if self.gaps else np.isfinite(values)


def in_wanted_unit(values: NDArray[np.float64], match: Match) -> NDArray[np.float64]:
    """Return the numbers of a column in the unit asked for."""
    with np.errstate(over="ignore"):
        return values if match.factor == 1.0 else values * match.factor


def row_place(counted: str, numbers: Sequence[int], more: int = 0) -> str:
    """Return the place of rows, for messages, from their numbers in `Rows.numbers` and what these count."""
    names = [str(number) for number in numbers] + [f"{more} more"] * (more > 0)
    return f"{counted}{'s' * (len(names) > 1)} {joined(names)}{' (from 0)' * (counted == 'row')}"


def places_of(
    file: str,
    counted: str,
    rows: Sequence[int] | NDArray[np.int_],
    numbers: Callable[[Sequence[int] | NDArray[np.int_]], NDArray[np.int64]],
) -> str:
    """Return the places of rows with their file's name; of many only the first are named, and the others counted."""
    named = numbers(rows[:MOST_PLACES]).tolist()
    return f"{row_place(counted, named, len(rows) - len(named))} of {os.path.basename(file)}"


def values_of(column: pa.Array | pa.ChunkedArray) -> NDArray[Any]:
    """Return the numbers of a column, NaN where there is none; they may share its memory."""
    if column.null_count:
        column = column.fill_null(np.nan)
    chunks = column.chunks if isinstance(column, pa.ChunkedArray) else [column]
    # pyarrow's to_numpy imports pandas where it is installed
    arrays = [np.asarray(np.from_dlpack(chunk)) for chunk in chunks]
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays or [np.empty(0)])
