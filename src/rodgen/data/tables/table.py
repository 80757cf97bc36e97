"""A table that is open for reading: blocks of rows become arrays, and every fault is reported with its place."""

from __future__ import annotations

import abc
import os
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar, cast

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rodgen.data.tables.columns import Column, EveryColumn, Match, match_columns
from rodgen.errors import InputFileError, joined, shown

READABLE = "a CSV or Parquet file"
MOST_PLACES = 8
"""Rows that a sentence names at most."""

_T = TypeVar("_T")


@dataclass(frozen=True)
class Rows:
    """The rows of one block."""

    values: tuple[NDArray[np.float64], ...]
    """Each wanted column of numbers, float64 and finite: lengths in the unit of the first length column, angles in
    radians; with `EveryColumn` unconverted."""
    text: tuple[pa.StringArray, ...]
    """Each wanted column of text, no cell of it blank, without the blanks around it."""
    numbers: NDArray[np.int64]
    """Of each row: its line (CSV, from 1) or its place in the file (Parquet, from 0)."""
    batch: pa.RecordBatch
    """Every column of the file, unchanged; see `open_table` for a CSV file."""


@dataclass(frozen=True)
class Block:
    """Rows of a file that are not parsed yet."""

    data: Any
    first: int  # line number (CSV, from 1) or row number (Parquet, from 0) of the first row
    amount: int  # what it adds to the progress


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
    total : int or None
        How much there is to read, in `amount_unit`; None for a pipe.
    amount_unit : str
        ``"B"`` or ``" rows"``.
    gaps : bool
        Whether NaN may stand in a column of numbers.
    """

    file: str
    matches: list[Match]
    text: list[Match]
    header: str
    counted: str
    schema: pa.Schema
    total: int | None
    amount_unit: str
    gaps = False

    def units(self) -> dict[str, str]:
        """Return the unit of each wanted column, by its name."""
        return {match.name: match.unit for match in self.matches}

    def map(
        self, function: Callable[[Rows], _T], workers: int | None = None, *, empty: bool = False
    ) -> Iterator[tuple[_T, int]]:
        """Yield the value of a function for every block, in the order of the file; a few blocks are computed at a time.

        Parameters
        ----------
        function : callable
            Of one `Rows`; called in threads.
        workers : int, optional
            Threads; the number of processors, at most 4, when left out.
        empty : bool
            Whether a file without rows is accepted.

        Yields
        ------
        result, amount
            What `function` returned, and how far the block carries the progress.

        Raises
        ------
        InputFileError
            At the first fault in the file, after the results of the blocks before it; also when the file
            has no rows, unless that is accepted.
        """
        workers = workers or max(1, min(4, os.cpu_count() or 1))
        rows = 0

        def work(block: Block) -> tuple[_T | None, int, int]:
            parsed = self._parse(block)
            n = parsed.batch.num_rows
            return (function(parsed) if n else None), n, block.amount

        pending: deque[Future[tuple[_T | None, int, int]]] = deque()
        blocks = self._blocks()
        fault: InputFileError | None = None
        with ThreadPoolExecutor(workers) as pool:
            try:
                while True:
                    # A fault that ends the reading is reported after those in the blocks before it.
                    try:
                        block = next(blocks, None)
                    except InputFileError as error:
                        fault, block = error, None
                    if block is not None:
                        pending.append(pool.submit(work, block))
                        if len(pending) <= workers:
                            continue
                    if not pending:
                        break
                    result, n, amount = pending.popleft().result()
                    rows += n
                    if n:
                        yield cast("_T", result), amount
            finally:
                for future in pending:
                    future.cancel()
        if fault:
            raise fault
        if not (rows or empty):
            raise InputFileError(self.file, self._end_place(), "no rows", "at least one row under the header")

    @abc.abstractmethod
    def close(self) -> None:
        """Close the file."""

    def _find_wanted(
        self,
        texts: Sequence[str],
        columns: Sequence[Column] | EveryColumn,
        words: Collection[int] = (),
        *,
        numbered: bool = False,
    ) -> None:
        """Set the places of the wanted columns from the names of all; `words` are the columns that hold words."""
        found = match_columns(texts, columns, self.file, self.header, numbered=numbered)
        names: tuple[str, ...] = ()
        if isinstance(columns, EveryColumn):
            names = columns.text
            found = [replace(m, holds_text=m.holds_text or (m.index in words and not m.unit)) for m in found]
        self.matches = [match for match in found if not match.holds_text]
        self.text = [match for match in found if match.holds_text]
        # a remark may be blank, but not the name of a target
        self._needed = {match.index for match in self.text if match.name in names}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @abc.abstractmethod
    def _blocks(self) -> Iterator[Block]:
        """Cut the file into blocks of whole rows."""

    @abc.abstractmethod
    def _parse(self, block: Block) -> Rows:
        """Return the rows of a block; called in threads."""

    @abc.abstractmethod
    def _end_place(self) -> str:
        """Return the place where the first row was expected."""

    def _convert(
        self, columns: Sequence[pa.Array], numbers: NDArray[np.int64]
    ) -> tuple[tuple[NDArray[np.float64], ...], tuple[pa.StringArray, ...]]:
        """Return the wanted columns of a block, those of numbers in the units asked for.

        Parameters
        ----------
        columns : sequence of pyarrow.Array
            Every column of the file.
        numbers : ndarray of int
            The line or the row of the file that each row is.
        """
        values, text = [], []
        faults: list[tuple[int, int]] = []
        for match in self.matches:
            try:
                column = self._floats(columns[match.index])
            except NoNumberError as error:
                faults.append((error.row, match.index))
                continue
            if match.factor != 1.0:
                with np.errstate(over="ignore"):
                    column = column * match.factor
            finite = np.isfinite(column)
            if self.gaps:
                finite |= np.isnan(column)
            if not finite.all():
                faults.append((int(np.argmin(finite)), match.index))
            values.append(column)
        for match in self.text:
            import pyarrow.compute as pc  # takes 15 ms, and most tables hold numbers only

            column = plain(columns[match.index])
            names = pc.utf8_trim_whitespace(column.cast(pa.string()))
            if names.null_count:
                names = pc.fill_null(names, "")
            if match.index in self._needed:
                missing = values_of(pc.utf8_length(names)) == 0
                if pa.types.is_floating(column.type):
                    missing = missing | ~np.isfinite(values_of(column))
                if missing.any():
                    faults.append((int(np.argmax(missing)), match.index))
            text.append(names)
        if faults:
            row, index = min(faults)
            found, expected = self._fault(columns[index][row].as_py())
            if index in {match.index for match in self.text}:
                expected = "a name in every row"
            place = (
                f"{row_place(self.counted, [int(numbers[row])])}, column {shown(self.schema.names[index])}"
            )
            raise InputFileError(self.file, place, found, expected)
        return tuple(values), tuple(text)

    @abc.abstractmethod
    def _floats(self, column: pa.Array) -> NDArray[np.float64]:
        """Return a column as numbers, in its own unit; raise `NoNumberError` at the first cell that is not one."""

    @abc.abstractmethod
    def _fault(self, cell: Any) -> tuple[str, str]:
        """Return what is wrong with a cell that is not a finite number, and what is expected instead."""


class NoNumberError(Exception):
    """A cell that is not a number.

    Parameters
    ----------
    row : int
        Of the block, from 0.
    """

    def __init__(self, row: int) -> None:
        super().__init__(row)
        self.row = row


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


def values_of(column: pa.Array) -> NDArray[Any]:
    """Return the numbers of a column, NaN where there is none; they may share its memory."""
    if column.null_count:
        column = column.fill_null(np.nan)
    return np.asarray(np.from_dlpack(column))  # pyarrow's to_numpy imports pandas where it is installed


def plain(column: pa.Array) -> pa.Array:
    """Return a column without a dictionary."""
    return column.dictionary_decode() if pa.types.is_dictionary(column.type) else column
