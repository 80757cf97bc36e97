"""A CSV file or pipe, read in bounded memory, with the line and column of every fault.

The file is cut into blocks of whole lines, and Arrow parses each as *text* columns; those wanted are then cast to
numbers. That takes no longer than parsing numbers at once (measured: 0.36 s a million rows either way), keeps the
user's cells unchanged for the output, and keeps the text at hand when a cell is not a number. Only then is the
block searched line by line. Arrow's own streaming reader is not a substitute: it does not count lines when it uses
threads or skips empty ones, and does not say where bytes are not UTF-8.
"""

from __future__ import annotations

import contextlib
import csv
import gzip
import os
import re
import zlib
from collections.abc import Iterator, Sequence
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from rodgen.data.tables.columns import Column, EveryColumn
from rodgen.data.tables.table import READABLE, Block, NoNumberError, Rows, Table, values_of
from rodgen.errors import InputFileError, shown
from rodgen.files import unreadable

# What `Array.cast` and pyarrow.compute call: that writes 300 functions when it is imported, which takes 15 ms.
try:
    from pyarrow._compute import CastOptions, call_function
except ImportError:
    from pyarrow.compute import CastOptions, call_function

# Large enough that the fixed cost of a block (about 1 ms) vanishes, small enough that the few blocks in
# flight, each some six times its text, stay below 100 MB.
BLOCK_BYTES = 2 << 20
LONGEST_LINE = 1 << 20
TAIL_BYTES = 1 << 16
FEWEST_LINES = 10
"""The last line, without a line end, is compared with those in so many bytes before it, which are so many at least."""

_MAGIC = (
    (b"PK\x03\x04", "an Excel workbook or a ZIP archive", "CSV or Parquet (in Excel: save as CSV UTF-8)"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook", "CSV or Parquet (in Excel: save as CSV UTF-8)"),
    (b"\xff\xfe", "UTF-16 text", "UTF-8 text"),
    (b"\xfe\xff", "UTF-16 text", "UTF-8 text"),
    (b"\x89HDF", "an HDF5 file", READABLE),
    (b"ARROW1", "an Arrow file", READABLE),
    (b"%PDF", "a PDF document", READABLE),
)
# Cells by which measuring software marks a missing measurement.
_NO_VALUE = {"nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "?", "inf", "infinity", "#div/0!"}
_WORD = re.compile(r"[^\W\d_]")  # a letter first


class CsvTable(Table):
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
        self._find_wanted(texts, columns, self._words(), numbered=True)
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
                blank = data[: len(data) - len(data.lstrip())]
                empty = blank.rfind(b"\n") + 1  # at once: a block may hold millions of empty lines
                self._next_line += blank.count(b"\n")
                line, _, data = data[empty:].partition(b"\n")
                if not line:
                    break
                line = line.removesuffix(b"\r")
                number = self._next_line
                self._next_line += 1
                if line.strip():
                    self._check_text(line, number)
                    return [cell.strip() for cell in _cells(line)], data

    def _words(self) -> set[int]:
        """Return the columns whose first cell is a word: neither a number nor the mark of a missing one."""
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
                if self._stream is self._raw or getattr(error, "errno", None) is not None:
                    raise unreadable(self.file, error, READABLE) from None
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
                        raise InputFileError(self.file, "file", "binary data", READABLE)
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

    def _blocks(self) -> Iterator[Block]:
        data: bytes | None = self._rest
        self._rest = tail = b""
        while data is not None:
            first = self._next_line
            self._next_line += int(np.count_nonzero(np.frombuffer(data, np.uint8) == 10))
            if data and not data.endswith(b"\n"):
                self._refuse_cut(tail, data)
                self._next_line += 1
            tail = data[-TAIL_BYTES:]
            if data.strip(b"\r\n"):  # Arrow takes seconds for millions of empty lines
                position = 0 if self.total is None else self._raw.tell()
                amount, self._position = position - self._position, position
                yield Block(data, first, amount)
            data = next(self._cut, None)

    def _refuse_cut(self, before: bytes, last: bytes) -> None:
        """Refuse a last line without a line end whose last number has fewer digits than any other: it may be cut."""
        lines = [line for line in before.split(b"\n")[1:] if line.strip()]
        cell = last.rpartition(b",")[2].strip()
        if len(lines) < FEWEST_LINES or last.count(b",") != self._width - 1:
            return
        digits = [_last_digits(line.rpartition(b",")[2].strip()) for line in lines]
        fewest, most = min(digits), max(digits)
        if fewest < 0 or fewest - _last_digits(cell) <= most - fewest:
            return
        if fewest >= _WITH_EXPONENT and re.fullmatch(
            rb"[+-]?0+\.?0*", cell
        ):  # 1.2e-5, wherever it is cut, is not 0
            return
        raise InputFileError(
            self.file,
            f"line {self._next_line}",
            f"{shown(cell.decode(errors='replace'))} at the end of the file, with fewer digits than in any other line "
            "and no line end",
            "a file that was not cut; if this line is whole, end it",
        )

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
                    data, first, error.start, f"byte 0x{byte:02x}{latin}, which is not UTF-8", "UTF-8 text"
                ) from None
        if b"\r" in data and data.count(b"\r") != data.count(b"\r\n"):
            alone = re.search(rb"\r(?!\n)", data)
            if alone and alone.end() < len(data):
                raise self._at_byte(
                    data, first, alone.start(), "a carriage return alone", "lines that end with LF or CR LF"
                )
        if b'"' in data:
            # Every line must hold an even number of quotation marks; NumPy finds the first that does not.
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

    def _parse(self, block: Block) -> Rows:
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
        arrays = [column.combine_chunks() for column in table.columns]
        numbers = _line_numbers(data, block.first, table.num_rows)
        values, text = self._convert(arrays, numbers)
        if not self._keep_text:
            for match, column in zip(self.matches, values, strict=True):
                own = column if match.factor == 1.0 else self._floats(arrays[match.index])
                arrays[match.index] = pa.array(own)
        batch = pa.RecordBatch.from_arrays(arrays, schema=self.schema)
        return Rows(values, text, numbers, batch)

    def _floats(self, column: pa.StringArray) -> NDArray[np.float64]:
        try:
            return _numbers(column)
        except pa.ArrowInvalid:
            # Blanks around a number are common in files written by hand and by Fortran.
            column = call_function("utf8_trim_whitespace", [column])
        try:
            return _numbers(column)
        except pa.ArrowInvalid:
            # A file has one first fault: halving finds it in the time of one more cast.
            low, high = 0, len(column)
            while high - low > 1:
                middle = (low + high) // 2
                try:
                    _numbers(column.slice(low, middle - low))
                    low = middle
                except pa.ArrowInvalid:
                    high = middle
            raise NoNumberError(low) from None

    def _fault(self, cell: str) -> tuple[str, str]:
        stripped = cell.strip()
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

    def _ragged(self, data: bytes, first: int, otherwise: str) -> InputFileError:
        """Return the error for the first line whose number of cells is not that of the header."""
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


_WITH_EXPONENT = 100


def _last_digits(cell: bytes) -> int:
    """Return how many digits are after the decimal point, or 100 and those of the exponent; -1 of what is no number."""
    found = re.fullmatch(rb"[+-]?\d*\.?(\d*)(?:[eE]([+-]?\d*))?", cell)
    if not found or not cell:
        return -1
    return len(found[1]) if found[2] is None else _WITH_EXPONENT + len(found[2])


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


def _numbers(column: pa.StringArray) -> NDArray[np.float64]:
    return values_of(call_function("cast", [column], CastOptions.safe(pa.float64())))
