"""Read a table of any length in bounded memory, and name every fault in it by line and column.

A CSV file is cut into blocks of whole lines, and each block is parsed as *text* columns; the wanted ones
are then cast to numbers. That costs no more than parsing numbers at once (measured: 0.36 s a million rows
either way), keeps the user's cells letter for letter for the output, and leaves the text at hand when a
cell is no number. Only then is the block searched line by line.
"""

from __future__ import annotations

import abc
import contextlib
import csv
import gzip
import os
import re
import sys
import zlib
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import IO, Any, TypeVar, cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from rodgen.data.tables._frame import as_arrow
from rodgen.data.tables.columns import Column, EveryColumn, Match, match_columns
from rodgen.errors import InputFileError, shown

__all__ = ["Rows", "Table", "open_frame", "open_table"]

# Large enough that the fixed cost of a block (about 1 ms) vanishes, small enough that the few blocks in
# flight, each some six times its text, stay below 100 MB.
BLOCK_BYTES = 2 << 20
BLOCK_ROWS = 1 << 15
LONGEST_LINE = 1 << 20

_T = TypeVar("_T")
_READABLE = "a CSV or Parquet file"
_MAGIC = (
    (b"PK\x03\x04", "an Excel workbook or a ZIP archive", "CSV or Parquet (in Excel: save as CSV UTF-8)"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook", "CSV or Parquet (in Excel: save as CSV UTF-8)"),
    (b"\xff\xfe", "UTF-16 text", "UTF-8 text"),
    (b"\xfe\xff", "UTF-16 text", "UTF-8 text"),
    (b"\x89HDF", "an HDF5 file", _READABLE),
    (b"ARROW1", "an Arrow file", _READABLE),
    (b"%PDF", "a PDF document", _READABLE),
)
# Cells with which measuring software says that there is no measurement.
_NO_VALUE = {"nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "?", "inf", "infinity", "#div/0!"}
_WORD = re.compile(r"[^\W\d_]")  # a letter first
_ARROW_ERRORS = (pa.ArrowException, OSError, ValueError, KeyError, MemoryError)


@dataclass(frozen=True)
class Rows:
    """The rows of one block.

    Attributes
    ----------
    values : tuple of ndarray
        Each wanted column of numbers, float64 and finite: lengths in the unit of the first length column,
        angles in radians; among `EveryColumn` as they stand.
    text : tuple of pyarrow.StringArray
        Each wanted column of text, no cell of it blank, without the blanks around it.
    numbers : ndarray of int
        Of each row: its line (CSV, from 1) or its place in the file (Parquet, from 0).
    batch : pyarrow.RecordBatch
        Every column of the file as it stands there; see `open_table` for a CSV file.
    """

    values: tuple[NDArray[np.float64], ...]
    text: tuple[pa.StringArray, ...]
    numbers: NDArray[np.int64]
    batch: pa.RecordBatch


@dataclass(frozen=True)
class _Block:
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
        Where each wanted column of numbers stands, with its unit, and each of text.
    header : str
        Where the names of the columns stand, for error messages.
    counted : str
        What `Rows.numbers` counts: ``"line"`` or ``"row"``.
    schema : pyarrow.Schema
        Of the columns as they are kept.
    total : int or None
        How much there is to read, in `amount_unit`; None for a pipe.
    amount_unit : str
        ``"B"`` or ``" rows"``.
    """

    file: str
    matches: list[Match]
    text: list[Match]
    header: str
    counted: str
    schema: pa.Schema
    total: int | None
    amount_unit: str

    def units(self) -> dict[str, str]:
        """Return the unit of each wanted column, by its name."""
        return {match.name: match.unit for match in self.matches}

    def map(
        self, function: Callable[[Rows], _T], workers: int | None = None, *, empty: bool = False
    ) -> Iterator[tuple[_T, int]]:
        """Apply `function` to every block, in the order of the file, a few blocks at a time.

        Parameters
        ----------
        function : callable
            Of one `Rows`; called in threads.
        workers : int, optional
            Threads; the number of processors, at most 4, when left out.
        empty : bool
            Whether a file without rows will do.

        Yields
        ------
        result, amount
            What `function` returned, and how far the block carries the progress.

        Raises
        ------
        InputFileError
            At the first fault in the file, after the results of the blocks before it; also when the file
            has no rows, unless that will do.
        """
        workers = workers or max(1, min(4, os.cpu_count() or 1))
        rows = 0

        def work(block: _Block) -> tuple[_T | None, int, int]:
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

    def _want(
        self,
        texts: Sequence[str],
        columns: Sequence[Column] | EveryColumn,
        words: Collection[int] = (),
        *,
        numbered: bool = False,
    ) -> None:
        """Find the wanted columns among the names of all; `words` are those that hold words where they may."""
        found = match_columns(texts, columns, self.file, self.header, numbered=numbered)
        names: tuple[str, ...] = ()
        if isinstance(columns, EveryColumn):
            names = columns.text
            found = [replace(m, holds_text=m.holds_text or (m.index in words and not m.unit)) for m in found]
        self.matches = [match for match in found if not match.holds_text]
        self.text = [match for match in found if match.holds_text]
        # a remark may be missing, the name of a target may not
        self._needed = {match.index for match in self.text if match.name in names}

    def __enter__(self) -> Table:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @abc.abstractmethod
    def _blocks(self) -> Iterator[_Block]:
        """Cut the file into blocks of whole rows."""

    @abc.abstractmethod
    def _parse(self, block: _Block) -> Rows:
        """Turn a block into numbers; called in threads."""

    @abc.abstractmethod
    def _end_place(self) -> str:
        """Name the place where the first row was expected."""


def open_table(
    path: str | os.PathLike[str], columns: Sequence[Column] | EveryColumn, *, keep_text: bool = True
) -> Table:
    """Open a CSV or Parquet file for reading in blocks.

    What the file is, is told from its first bytes, not from its name.

    Parameters
    ----------
    path : str or os.PathLike
        ``"-"`` reads CSV from standard input.
    columns : sequence of Column, or EveryColumn
        The columns that are needed, by name and quantity.
    keep_text : bool
        Whether the needed columns of a CSV file stand in `Rows.batch` letter for letter, or as numbers (in
        the unit of the file). All other columns of a CSV file are text there, because nobody read them.

    Returns
    -------
    Table
        A context manager; its `map` reads.

    Raises
    ------
    InputFileError
        When the file cannot be read, or lacks a column, or a unit does not fit.
    """
    file = os.fspath(path)
    if file == "-":
        if sys.stdin is None:
            raise InputFileError("standard input", "file", "closed", "CSV, or the name of a file")
        return _CsvTable("standard input", sys.stdin.buffer, columns, keep_text, closes=False)
    try:
        stream = open(file, "rb")  # noqa: SIM115 - the table closes it
    except FileNotFoundError:
        raise InputFileError(file, "file", "no such file", _READABLE) from None
    except IsADirectoryError:
        raise InputFileError(file, "file", "a folder", _READABLE) from None
    except (OSError, ValueError) as error:
        raise _unreadable(file, error) from None
    try:
        start = stream.peek(8)[:8]
        if start.startswith(b"PAR1"):
            return _ParquetTable(file, stream, columns)
        return _CsvTable(file, stream, columns, keep_text)
    except OSError as error:
        stream.close()
        raise _unreadable(file, error) from None
    except BaseException:
        stream.close()
        raise


def open_frame(frame: Any, columns: EveryColumn, name: str) -> Table:
    """Open a table that is in memory, as `open_table` opens a Parquet file.

    Parameters
    ----------
    frame : mapping, DataFrame or Arrow table
        A mapping from column names to sequences, a DataFrame of pandas or Polars (anything with `columns` and
        columns that `numpy.asarray` takes), or anything with Arrow's interface (``__arrow_c_stream__``).
    columns : EveryColumn
    name : str
        What stands for the file's name in error messages.

    Returns
    -------
    Table

    Raises
    ------
    InputFileError
        When it is no table, or a column does not hold what it should.
    """
    return _FrameTable(name, frame, columns)


def _unreadable(file: str, error: BaseException) -> InputFileError:
    reason = (getattr(error, "strerror", None) or str(error).partition("\n")[0]).rstrip(".")
    return InputFileError(file, "file", f"cannot be read ({reason})", _READABLE)


class _CsvTable(Table):
    """A CSV file or pipe."""

    amount_unit = "B"
    counted = "line"

    def __init__(
        self,
        file: str,
        raw: IO[bytes],
        columns: Sequence[Column] | EveryColumn,
        keep_text: bool,
        *,
        closes: bool = True,
    ) -> None:
        self.file = file
        self._raw = raw
        self._closes = closes
        self._stream: Any = raw
        self._position = 0
        self.total = None
        with contextlib.suppress(OSError):  # a pipe has no length
            if raw.seekable():
                self.total = os.fstat(raw.fileno()).st_size
        start = _peek(raw)
        if start.startswith(b"\x1f\x8b"):
            self._stream = gzip.GzipFile(fileobj=raw)
        self._cut = self._cut_blocks()
        self._next_line = 1
        texts, self._rest = self._read_header()
        self._width = len(texts)
        self.header = f"line {self._next_line - 1}"
        self._want(texts, columns, self._words(), numbered=True)
        self._keep_text = keep_text
        types = [pa.string()] * self._width
        if not keep_text:
            for match in self.matches:
                types[match.index] = pa.float64()
        self.schema = pa.schema(list(map(pa.field, texts, types)))
        self._read_options = [str(i) for i in range(self._width)]

    def close(self) -> None:
        if self._closes:
            self._raw.close()

    def _read_header(self) -> tuple[list[str], bytes]:
        while True:
            data = next(self._cut, None)
            if data is None:
                what = "an empty file" if self._next_line == 1 else "only empty lines"
                raise InputFileError(self.file, "file", what, "a header with units, then one row a line")
            if self._next_line == 1:
                self._check_magic(data)
                data = data.removeprefix(b"\xef\xbb\xbf")
            while data:
                line, _, data = data.partition(b"\n")
                line = line.removesuffix(b"\r")
                number = self._next_line
                self._next_line += 1
                if line.strip():
                    self._check_text(line, number)
                    return [cell.strip() for cell in _cells(line)], data

    def _words(self) -> set[int]:
        """Return the columns that begin with a word: it is no number, and does not stand for one that is missing."""
        line = next((line for line in self._rest[:LONGEST_LINE].split(b"\n") if line.strip()), b"")
        try:
            cells = [cell.strip() for cell in _cells(line)]
        except UnicodeDecodeError:
            return set()
        return {i for i, cell in enumerate(cells) if _WORD.match(cell) and cell.lower() not in _NO_VALUE}

    def _check_magic(self, data: bytes) -> None:
        if self._stream is not self._raw and data.startswith(b"PAR1"):
            raise InputFileError(
                self.file, "file", "gzip around Parquet", "the Parquet file itself, or gzip around CSV"
            )
        if data.startswith(b"PAR1"):
            raise InputFileError(self.file, "file", "Parquet from a pipe", "CSV, or the name of a file")
        for magic, found, expected in _MAGIC:
            if data.startswith(magic):
                raise InputFileError(self.file, "file", found, expected)

    def _cut_blocks(self) -> Iterator[bytes]:
        """Read the file as blocks of whole lines."""
        parts: list[bytes] = []
        held = 0
        while True:
            try:
                chunk = _read(self._stream, BLOCK_BYTES)
            except (OSError, EOFError, zlib.error) as error:
                if self._stream is self._raw:
                    raise _unreadable(self.file, error) from None
                raise InputFileError(
                    self.file, "file", f"damaged gzip data ({str(error).rstrip('.')})", "a complete gzip file"
                ) from None
            if not chunk:
                if parts:
                    yield b"".join(parts)
                return
            end = chunk.rfind(b"\n") + 1
            if end:
                yield b"".join([*parts, chunk[:end]])
                parts, held = [], 0
            if end < len(chunk):
                parts.append(chunk[end:])
                held += len(chunk) - end
                if held > LONGEST_LINE:
                    start = b"".join(parts)
                    if b"\0" in start:
                        raise InputFileError(self.file, "file", "binary data", _READABLE)
                    if b"\r" in start:
                        raise InputFileError(
                            self.file,
                            "file",
                            "lines that end with CR alone",
                            "lines that end with LF or CR LF",
                        )
                    raise InputFileError(
                        self.file, "file", f"a line longer than {LONGEST_LINE >> 20} MiB", "one row a line"
                    )

    def _blocks(self) -> Iterator[_Block]:
        data: bytes | None = self._rest
        self._rest = b""
        while data is not None:
            first = self._next_line
            self._next_line += int(np.count_nonzero(np.frombuffer(data, np.uint8) == 10))
            if data and not data.endswith(b"\n"):
                self._next_line += 1
            position = 0 if self.total is None else self._raw.tell()
            amount, self._position = position - self._position, position
            yield _Block(data, first, amount)
            data = next(self._cut, None)

    def _end_place(self) -> str:
        return f"line {self._next_line}"

    def _check_text(self, data: bytes, first: int) -> None:
        """Refuse what is not lines of UTF-8 text with every quotation closed on its line."""
        zero = data.find(b"\0")
        if zero >= 0:
            raise self._at_byte(data, first, zero, "binary data (a zero byte)", "text")
        if not data.isascii():
            try:
                data.decode("utf-8")
            except UnicodeDecodeError as error:
                byte = data[error.start]
                latin = {0xB0: " (a degree sign in Latin-1)", 0xB5: " (a micro sign in Latin-1)"}.get(
                    byte, ""
                )
                raise self._at_byte(
                    data, first, error.start, f"byte 0x{byte:02x}{latin}, which is no UTF-8", "UTF-8 text"
                ) from None
        if b"\r" in data and data.count(b"\r") != data.count(b"\r\n"):
            alone = re.search(rb"\r(?!\n)", data)
            if alone and alone.end() < len(data):
                raise self._at_byte(
                    data, first, alone.start(), "a carriage return alone", "lines that end with LF or CR LF"
                )
        if b'"' in data:
            # Every line must hold an even number of quotation marks: numpy finds the first that does not.
            chars = np.frombuffer(data, np.uint8)
            quotes = np.flatnonzero(chars == 34)
            ends = np.append(np.flatnonzero(chars == 10), len(data))
            odd = np.flatnonzero(np.searchsorted(quotes, ends) % 2)
            if odd.size:
                raise InputFileError(
                    self.file,
                    f"line {first + int(odd[0])}",
                    "a quotation mark that is not closed on its line",
                    'quotation marks in pairs, and "" for one inside a cell',
                )

    def _at_byte(self, data: bytes, first: int, at: int, found: str, expected: str) -> InputFileError:
        start = data.rfind(b"\n", 0, at) + 1
        line = first + data.count(b"\n", 0, at)
        column = data.count(b",", start, at) + 1
        return InputFileError(self.file, f"line {line}, column {column}", found, expected)

    def _parse(self, block: _Block) -> Rows:
        data: bytes = block.data
        self._check_text(data, block.first)
        try:
            table = pa_csv.read_csv(
                pa.BufferReader(data),
                read_options=pa_csv.ReadOptions(
                    column_names=self._read_options, use_threads=False, block_size=len(data) + 1
                ),
                convert_options=pa_csv.ConvertOptions(
                    column_types=dict.fromkeys(self._read_options, pa.string()),
                    check_utf8=False,  # done above, with the place
                    null_values=[],
                    strings_can_be_null=False,
                ),
            )
        except pa.ArrowInvalid as error:
            if not data.strip(b"\r\n"):
                table = pa.table([pa.array([], pa.string())] * self._width, self._read_options)
            else:
                raise self._ragged(data, block.first, str(error)) from None
        if b'"' in data and table.num_rows != sum(1 for _ in _numbered_lines(data, 0)):
            raise self._ragged(data, block.first, "quotation marks inside a cell")
        numbers, values, text = self._values(table, data, block.first)
        arrays = [column.combine_chunks() for column in table.columns]
        if not self._keep_text:
            for match, column in zip(self.matches, numbers, strict=True):
                arrays[match.index] = pa.array(column)
        batch = pa.RecordBatch.from_arrays(arrays, schema=self.schema)
        return Rows(values, text, _line_numbers(data, block.first, table.num_rows), batch)

    def _values(
        self, table: pa.Table, data: bytes, first: int
    ) -> tuple[list[NDArray[np.float64]], tuple[NDArray[np.float64], ...], tuple[pa.StringArray, ...]]:
        """Return the wanted columns in their own units, in those asked for, and the text."""
        unscaled = []
        values = []
        text = []
        faults: list[tuple[int, int, str]] = []
        for match in self.matches:
            column = table.column(match.index)
            try:
                own = numbers = _numbers(column)
            except _NoNumberError as error:
                faults.append((error.row, match.index, error.text))
                continue
            if match.factor != 1.0:
                with np.errstate(over="ignore"):
                    numbers = numbers * match.factor
            finite = np.isfinite(numbers)
            if not finite.all():
                row = int(np.argmin(finite))
                faults.append((row, match.index, column[row].as_py()))
            unscaled.append(own)
            values.append(numbers)
        for match in self.text:
            stripped = pc.utf8_trim_whitespace(table.column(match.index)).combine_chunks()
            if match.index in self._needed and (row := pc.index(stripped, "").as_py()) >= 0:
                faults.append((row, match.index, ""))
            text.append(stripped)
        if faults:
            row, index, cell = min(faults)
            number = _line_numbers(data, first, table.num_rows)[row]
            found, expected = _cell_fault(cell)
            if index in {match.index for match in self.text}:
                expected = "a name in every row"
            name = self.schema.names[index]
            raise InputFileError(self.file, f"line {number}, column {shown(name)}", found, expected)
        return unscaled, tuple(values), tuple(text)

    def _ragged(self, data: bytes, first: int, otherwise: str) -> InputFileError:
        """Find the line that has another number of cells than the header."""
        for number, line in _numbered_lines(data, first):
            cells = _cells(line)
            if len(cells) != self._width:
                expected = f"{self._width}, as in the header"
                if b";" in line and len(cells) < self._width:
                    expected += " (commas between the cells, not semicolons)"
                elif len(cells) == 2 * self._width:
                    expected += " (decimal points, not decimal commas)"
                n = "1 cell" if len(cells) == 1 else f"{len(cells)} cells"
                return InputFileError(self.file, f"line {number}", n, expected)
        return InputFileError(self.file, f"lines from {first}", f"no table ({otherwise})", "one row a line")


def _cells(line: bytes) -> list[str]:
    text = line.decode()
    try:
        return next(csv.reader([text]))
    except csv.Error:  # a cell longer than the csv module takes
        return text.split(",")


def _numbered_lines(data: bytes, first: int) -> Iterator[tuple[int, bytes]]:
    """Yield every line that is a row, with its number; the parser skips empty lines too."""
    for number, line in enumerate(data.split(b"\n"), start=first):
        line = line.removesuffix(b"\r")
        if line:
            yield number, line


def _line_numbers(data: bytes, first: int, rows: int) -> NDArray[np.int64]:
    """Return the line number of every row."""
    lines = int(np.count_nonzero(np.frombuffer(data, np.uint8) == 10)) + (not data.endswith(b"\n"))
    if lines == rows:
        return np.arange(first, first + rows)
    return np.array([number for number, _ in _numbered_lines(data, first)], np.int64)


class _NoNumberError(Exception):
    def __init__(self, row: int, text: str) -> None:
        self.row = row
        self.text = text


def _numbers(column: pa.ChunkedArray) -> NDArray[np.float64]:
    try:
        return cast("NDArray[np.float64]", column.cast(pa.float64()).to_numpy())
    except pa.ArrowInvalid:
        # Blanks around a number are common in files written by hand and by Fortran.
        column = pc.utf8_trim_whitespace(column)
    try:
        return cast("NDArray[np.float64]", column.cast(pa.float64()).to_numpy())
    except pa.ArrowInvalid:
        # A file has one first fault: halving finds it in the time of one more cast.
        low, high = 0, len(column)
        while high - low > 1:
            middle = (low + high) // 2
            try:
                column.slice(low, middle - low).cast(pa.float64())
                low = middle
            except pa.ArrowInvalid:
                high = middle
        raise _NoNumberError(low, column[low].as_py()) from None


def _cell_fault(text: str) -> tuple[str, str]:
    """Say what is wrong with a cell that is no finite number, and what to write instead."""
    stripped = text.strip()
    if not stripped:
        return "an empty cell", "a number in every row"
    if stripped.lower().lstrip("+-").rstrip() in _NO_VALUE or stripped.lower() in _NO_VALUE:
        return shown(stripped), "a finite number (leave out rows without a measurement)"
    if re.fullmatch(r"[+-]?\d+,\d+([eE][+-]?\d+)?", stripped):
        return shown(stripped), f"a decimal point, {stripped.replace(',', '.')}"
    if "\N{MINUS SIGN}" in stripped or "\N{EN DASH}" in stripped:
        return f"{shown(stripped)}, with a typographic minus sign", "a plain hyphen, '-'"
    if re.fullmatch(r"[+-]?[\d.]+[dD][+-]?\d+", stripped):
        return shown(stripped), f"the exponent after an e, {re.sub('[dD]', 'e', stripped)}"
    if re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", stripped):
        return f"{shown(stripped)}, too large for a double", "a finite number"
    if re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*[^\d\s.,;]+", stripped):
        return shown(stripped), "a number alone (its unit stands in the header)"
    return shown(stripped), "a number"


class _ArrowTable(Table):
    """A table whose columns have types."""

    amount_unit = " rows"
    counted = "row"
    header = "schema"

    def _words(self) -> set[int]:
        """Return the columns of text."""
        kinds = [k.value_type if pa.types.is_dictionary(k) else k for k in self.schema.types]
        return {i for i, kind in enumerate(kinds) if _is_text(kind)}

    def _check_types(self) -> None:
        for match in (*self.matches, *self.text):
            kind = self.schema.field(match.index).type
            kind = kind.value_type if pa.types.is_dictionary(kind) else kind
            if _is_number(kind) or (match.holds_text and _is_text(kind)):
                continue
            expected = "names" if match.holds_text else "numbers"
            place = f"column {shown(match.text)}"
            raise InputFileError(self.file, place, f"the type {shown(str(kind))}", expected)

    def _end_place(self) -> str:
        return "file"

    @abc.abstractmethod
    def _damaged(self, error: BaseException) -> InputFileError:
        """Say that what Arrow was given is none of its data."""

    def _parse(self, block: _Block) -> Rows:
        batch: pa.RecordBatch = block.data
        values = []
        text = []
        faults: list[tuple[int, int, str]] = []
        try:
            for match in self.matches:
                column = batch.column(match.index)
                numbers = _plain(column).cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
                with np.errstate(over="ignore"):
                    numbers = numbers * match.factor if match.factor != 1.0 else numbers
                finite = np.isfinite(numbers)
                if not finite.all():
                    row = int(np.argmin(finite))
                    faults.append((row, match.index, _cell_text(column, row)))
                values.append(numbers)
            for match in self.text:
                column = batch.column(match.index)
                names = pc.utf8_trim_whitespace(_plain(column).cast(pa.string()))
                missing = _is_missing(_plain(column), names)
                names = pc.fill_null(names, "")
                if match.index in self._needed and missing.any():
                    row = int(np.argmax(missing))
                    faults.append((row, match.index, _cell_text(column, row)))
                text.append(names)
        except _ARROW_ERRORS as error:
            raise self._damaged(error) from None
        if faults:
            row, index, found = min(faults)
            expected = "a finite number (leave out rows without a measurement)"
            if index in {match.index for match in self.text}:
                expected = "a name in every row"
            raise InputFileError(
                self.file,
                f"row {block.first + row} (from 0), column {shown(self.schema.names[index])}",
                found,
                expected,
            )
        return Rows(tuple(values), tuple(text), np.arange(block.first, block.first + len(batch)), batch)


def _plain(column: pa.Array) -> pa.Array:
    return column.dictionary_decode() if pa.types.is_dictionary(column.type) else column


def _is_missing(column: pa.Array, names: pa.StringArray) -> NDArray[np.bool_]:
    missing = pc.fill_null(pc.equal(names, ""), True).to_numpy(zero_copy_only=False)
    if pa.types.is_floating(column.type):
        missing = missing | ~np.isfinite(column.to_numpy(zero_copy_only=False))
    return np.asarray(missing)


def _cell_text(column: pa.Array, row: int) -> str:
    cell = column[row].as_py()
    return "an empty cell" if cell is None or cell == "" else shown(cell)


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind))


def _is_text(kind: pa.DataType) -> bool:
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind))


class _ParquetTable(_ArrowTable):
    """A Parquet file."""

    def __init__(self, file: str, raw: IO[bytes], columns: Sequence[Column] | EveryColumn) -> None:
        import pyarrow.parquet as pq

        self.file = file
        self._raw = raw
        self._rows = 0
        try:
            # A small read buffer keeps a row group of any size from being read at once.
            self._parquet = pq.ParquetFile(raw, buffer_size=1 << 20, pre_buffer=False)
            self.schema = self._parquet.schema_arrow.remove_metadata()
            self.total = self._parquet.metadata.num_rows
        except _ARROW_ERRORS as error:
            raise self._damaged(error) from None
        self._want(self.schema.names, columns, self._words())
        self._check_types()

    def close(self) -> None:
        self._raw.close()

    def _blocks(self) -> Iterator[_Block]:
        try:
            for batch in self._parquet.iter_batches(batch_size=BLOCK_ROWS, use_threads=False):
                yield _Block(batch, self._rows, len(batch))
                self._rows += len(batch)
        except _ARROW_ERRORS as error:
            if isinstance(error, InputFileError):
                raise
            raise self._damaged(error) from None

    def _damaged(self, error: BaseException) -> InputFileError:
        reason = str(error).partition("\n")[0].rstrip(".")
        return InputFileError(
            self.file, "file", f"damaged Parquet data ({shown(reason, 120)[1:-1]})", "a complete Parquet file"
        )


class _FrameTable(_ArrowTable):
    """A table that is in memory."""

    header = "columns"

    def __init__(self, name: str, frame: Any, columns: EveryColumn) -> None:
        self.file = name
        self._table = as_arrow(frame, name)
        self.schema = self._table.schema
        self.total = self._table.num_rows
        self._want(self.schema.names, columns, self._words())
        self._check_types()

    def close(self) -> None:
        pass

    def _blocks(self) -> Iterator[_Block]:
        first = 0
        for batch in self._table.to_batches(max_chunksize=BLOCK_ROWS):
            yield _Block(batch, first, len(batch))
            first += len(batch)

    def _damaged(self, error: BaseException) -> InputFileError:
        reason = str(error).partition("\n")[0].rstrip(".")
        return InputFileError(
            self.file, "columns", f"what Arrow cannot read ({reason})", "a table of numbers"
        )


def _read(stream: Any, size: int) -> bytes:
    """Read `size` bytes, fewer only at the end.

    By read1, because read() goes back to a stalled pipe without having looked whether Ctrl-C was pressed.
    """
    parts = []
    while size and (part := stream.read1(size)):
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def _peek(raw: IO[bytes]) -> bytes:
    return bytes(raw.peek(2)[:2]) if hasattr(raw, "peek") else b""
