"""A CSV file or pipe as a whole, with the line and column of every fault.

Arrow parses it, the wanted columns as numbers at once. Where it refuses, or a cell is not a finite number, one slow
pass over the lines names the first fault. Arrow does not: it does not count lines when it uses threads or skips empty
ones, and does not say where bytes are not UTF-8.
"""

from __future__ import annotations

import csv
import gzip
import io
import math
import os
import re
import sys
import zlib
from collections.abc import Iterator, Sequence
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from rodgen.data.tables.columns import Column, EveryColumn, Layouts, Match
from rodgen.data.tables.table import READABLE, Rows, Table, in_wanted_unit, values_of
from rodgen.errors import InputFileError, shown
from rodgen.files import unreadable

# What pyarrow.compute calls: that writes 300 functions when it is imported, which takes 15 ms.
try:
    from pyarrow._compute import CastOptions, call_function
except ImportError:
    from pyarrow.compute import CastOptions, call_function

LONGEST_LINE = 1 << 20
BLOCK_BYTES = 4 << 20
"""What Arrow parses at a time: smaller blocks take less memory, and no more time."""
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


_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


class CsvTable(Table):
    """A CSV file or pipe."""

    counted = "line"

    def __init__(
        self, file: str, raw: IO[bytes], columns: Sequence[Column] | Layouts | EveryColumn, keep_text: bool
    ) -> None:
        self.file = file
        self._data = self._content(raw)
        texts = self._read_header()
        self._width = len(texts)
        self.header = f"line {self._first - 1}"
        self._find_wanted(texts, columns, self._words(), numbered=True)
        types = [pa.string()] * self._width
        if not keep_text:
            for match in self.matches:
                types[match.index] = pa.float64()
        self.schema = pa.schema(list(map(pa.field, texts, types)))

    def _content(self, raw: IO[bytes]) -> bytes:
        """Return all bytes, unpacked."""
        packed = hasattr(raw, "peek") and raw.peek(2)[:2] == b"\x1f\x8b"
        stream: Any = gzip.GzipFile(fileobj=raw) if packed else raw
        content = io.BytesIO()
        most = _most_bytes()
        try:
            # By read1, because read() goes back to a stalled pipe without having looked whether Ctrl-C was pressed.
            while part := stream.read1(1 << 20):
                content.write(part)
                if content.tell() > most:
                    expected = "less than memory holds; many Parquet files are read in parts"
                    raise InputFileError(self.file, "file", f"more than {most / 1e9:.1f} GB", expected)
        except (OSError, EOFError, zlib.error) as error:
            if not packed or getattr(error, "errno", None) is not None:
                raise unreadable(self.file, error, READABLE) from None
            found = f"damaged gzip data ({str(error).rstrip('.')})"
            raise InputFileError(self.file, "file", found, "a complete gzip file") from None
        data = content.getvalue()
        if packed and data.startswith(b"PAR1"):
            found, expected = "gzip around Parquet", "the Parquet file itself, or gzip around CSV"
            raise InputFileError(self.file, "file", found, expected)
        if data.startswith(b"PAR1"):
            raise InputFileError(self.file, "file", "Parquet from a pipe", "CSV, or the name of a file")
        for magic, found, expected in _MAGIC:
            if data.startswith(magic):
                raise InputFileError(self.file, "file", found, expected)
        return data

    def _read_header(self) -> list[str]:
        """Return the names of the columns; note where the lines below them begin, and their numbers."""
        data = self._data
        bom = len(b"\xef\xbb\xbf") * data.startswith(b"\xef\xbb\xbf")
        word = re.compile(rb"\S").search(data, bom)
        if not word:
            what = "only empty lines" if len(data) > bom else "an empty file"
            raise InputFileError(self.file, "file", what, "a header with units, then one row a line")
        begin = max(data.rfind(b"\n", 0, word.start()) + 1, bom)
        self._begin = data.find(b"\n", begin) + 1 or len(data)
        line = data[begin : self._begin].removesuffix(b"\n").removesuffix(b"\r")
        self._first = data.count(b"\n", 0, begin) + 2
        unended = self._begin < len(data) and not data.endswith(b"\n")
        self._lines = data.count(b"\n", self._begin) + unended
        self._check_length(line, "file")
        self._check_text(line, self._first - 1)
        return [cell.strip() for cell in _cells(line)]

    def _check_length(self, line: bytes, place: str) -> None:
        """Refuse what has no line end for long."""
        if len(line) <= LONGEST_LINE:
            return
        if b"\0" in line:
            raise InputFileError(self.file, place, "binary data", READABLE)
        if b"\r" in line:
            found, expected = "lines that end with CR alone", "lines that end with LF or CR LF"
            raise InputFileError(self.file, place, found, expected)
        raise InputFileError(
            self.file, place, f"a line longer than {LONGEST_LINE >> 20} MiB", "one row a line"
        )

    def _words(self) -> set[int]:
        """Return the columns whose first cell is a word: neither a number nor the mark of a missing one."""
        start = self._data[self._begin : self._begin + LONGEST_LINE]
        line = next((line for line in start.split(b"\n") if line.strip()), b"")
        try:
            cells = [cell.strip() for cell in _cells(line)]
        except UnicodeDecodeError:
            return set()
        return {i for i, cell in enumerate(cells) if _WORD.match(cell) and cell.lower() not in _NO_VALUE}

    def _refuse_cut(self) -> None:
        """Refuse a last line without a line end whose last number has fewer digits than any other: it may be cut."""
        *lines, last = self._data[max(self._begin, len(self._data) - TAIL_BYTES) :].split(b"\n")
        lines = [line for line in lines[1:] if line.strip()]
        if len(lines) < FEWEST_LINES or last.count(b",") != self._width - 1:
            return
        *digits, left = (_last_digits(line.rpartition(b",")[2].strip()) for line in (*lines, last))
        fewest, most = min(digits), max(digits)
        if fewest < 0 or fewest - left <= most - fewest:
            return
        cell = last.rpartition(b",")[2].strip()
        if fewest >= _WITH_EXPONENT and re.fullmatch(rb"[+-]?0+\.?0*", cell):
            return  # 1.2e-5, wherever it is cut, is not 0
        raise InputFileError(
            self.file,
            f"line {self._first + self._lines - 1}",
            f"{shown(cell.decode(errors='replace'))} at the end of the file, with fewer digits than in any other line "
            "and no line end",
            "a file that was not cut; if this line is whole, end it",
        )

    def _rows_at_most(self) -> int:
        return self._lines

    def _end_place(self) -> str:
        return f"line {self._first + self._lines}"

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
            for number, line in enumerate(data.split(b"\n"), start=first):
                if line.count(b'"') % 2:
                    found = "a quotation mark that is not closed on its line"
                    expected = 'quotation marks in pairs, and "" for one inside a cell'
                    raise InputFileError(self.file, f"line {number}", found, expected)

    def _at_byte(self, data: bytes, first: int, at: int, found: str, expected: str) -> InputFileError:
        start = data.rfind(b"\n", 0, at) + 1
        line = first + data.count(b"\n", 0, at)
        column = data.count(b",", start, at) + 1
        return InputFileError(self.file, f"line {line}, column {column}", found, expected)

    def _read(self) -> Rows:
        self._check_text(self._data, 1)
        if not self._data.endswith(b"\n"):
            self._refuse_cut()
        try:
            return self._rows(self.schema.types)
        except pa.ArrowInvalid:
            pass
        try:  # blanks around numbers, which are common in files written by hand and by Fortran, may be of any kind
            return self._rows([pa.string()] * self._width)
        except pa.ArrowInvalid as error:
            raise self._first_fault(str(error)) from None

    def _rows(self, types: Sequence[pa.DataType]) -> Rows:
        """Return all rows as columns of these types are parsed; raise `ArrowInvalid` where anything is wrong."""
        columns = self._parse(types)
        numbers = self._line_numbers(len(columns[0]))
        values, text = [], []
        for match in self.matches:
            converted = _floats(columns[match.index])
            values.append(in_wanted_unit(values_of(converted), match))
            if not self._accepted(values[-1]).all():
                raise pa.ArrowInvalid("a number that is not finite")
            if self.schema.types[match.index] == pa.float64():
                columns[match.index] = converted
        for match in self.text:
            text.append(call_function("utf8_trim_whitespace", [columns[match.index]]))
            if match.index in self._needed and not values_of(call_function("utf8_length", text[-1:])).all():
                raise pa.ArrowInvalid("an empty name")
        return Rows(tuple(values), tuple(text), numbers, pa.table(columns, schema=self.schema))

    def _parse(self, types: Sequence[pa.DataType]) -> list[pa.ChunkedArray]:
        """Return the columns."""
        if not re.compile(rb"[^\r\n]").search(self._data, self._begin):
            return [pa.chunked_array([], kind) for kind in types]
        names = [str(i) for i in range(self._width)]
        table = pa_csv.read_csv(
            pa.BufferReader(self._data),
            read_options=pa_csv.ReadOptions(
                column_names=names, skip_rows=self._first - 1, use_threads=False, block_size=BLOCK_BYTES
            ),
            convert_options=pa_csv.ConvertOptions(
                column_types=dict(zip(names, types, strict=True)),
                check_utf8=False,  # done above, with the place
                null_values=[],
                strings_can_be_null=False,
            ),
        )
        return list(table.columns)

    def _line_numbers(self, rows: int) -> NDArray[np.int64]:
        """Return the line number of every row."""
        if self._lines == rows and b'"' not in self._data:
            return np.arange(self._first, self._first + rows)
        numbers = np.array([number for number, _ in self._numbered_lines()], np.int64)
        if len(numbers) != rows:
            raise pa.ArrowInvalid("quotation marks inside a cell")
        return numbers

    def _numbered_lines(self) -> Iterator[tuple[int, bytes]]:
        """Yield every line that is a row, with its number; the parser skips empty lines too."""
        rows = io.BytesIO(self._data)
        rows.seek(self._begin)
        for number, line in enumerate(rows, start=self._first):
            row = line.removesuffix(b"\n").removesuffix(b"\r")
            if row:
                yield number, row

    def _first_fault(self, otherwise: str) -> InputFileError:
        """Return the error for the first line that Arrow refuses."""
        wanted = sorted((*self.matches, *self.text), key=lambda match: match.index)
        for number, line in self._numbered_lines():
            self._check_length(line, f"line {number}")
            cells = _cells(line)
            if len(cells) != self._width:
                expected = f"{self._width}, as in the header"
                if b";" in line and len(cells) < self._width:
                    expected += " (commas between the cells, not semicolons)"
                elif len(cells) == 2 * self._width:
                    expected += " (decimal points, not decimal commas)"
                n = "1 cell" if len(cells) == 1 else f"{len(cells)} cells"
                return InputFileError(self.file, f"line {number}", n, expected)
            for match in wanted:
                place = f"line {number}, column {shown(self.schema.names[match.index])}"
                cell = cells[match.index]
                if match.holds_text:
                    if match.index in self._needed and not cell.strip():
                        return InputFileError(self.file, place, "an empty cell", "a name in every row")
                elif not self._is_number(cell.strip(), match):
                    return InputFileError(self.file, place, *self._fault(cell))
        return InputFileError(
            self.file, f"lines from {self._first}", f"no table ({otherwise})", "one row a line"
        )

    def _is_number(self, text: str, match: Match) -> bool:
        if self.gaps and text.lower().lstrip("+-") == "nan":
            return True
        return bool(_NUMBER.fullmatch(text)) and math.isfinite(float(text) * match.factor)

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
        if _NUMBER.fullmatch(stripped):
            return f"{shown(stripped)}, too large for a double", "a finite number"
        if re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*[^\d\s.,;]+", stripped):
            return shown(stripped), "a number alone (its unit is in the header)"
        return shown(stripped), "a number"


def _cells(line: bytes) -> list[str]:
    text = line.decode()
    try:
        return next(csv.reader([text]))
    except csv.Error:  # a cell longer than the csv module takes
        return text.split(",")


_WITH_EXPONENT = 100


def _last_digits(cell: bytes) -> int:
    """Return how many digits are after the decimal point, or 100 and those of the exponent; -1 of what is no number."""
    match = re.fullmatch(rb"[+-]?\d*\.?(\d*)(?:[eE]([+-]?\d*))?", cell)
    if not match or not cell:
        return -1
    return len(match[1]) if match[2] is None else _WITH_EXPONENT + len(match[2])


def _floats(column: pa.ChunkedArray) -> pa.Array:
    """Return a column of numbers or their texts as numbers."""
    if not pa.types.is_floating(column.type):
        try:
            column = call_function("cast", [column], CastOptions.safe(pa.float64()))
        except pa.ArrowInvalid:
            column = call_function("utf8_trim_whitespace", [column])
            column = call_function("cast", [column], CastOptions.safe(pa.float64()))
    return column.combine_chunks()


def _most_bytes() -> int:
    """Return the size of the largest table that is read, which takes up to four times as much memory.

    That is a quarter of the memory of the computer, where it is known.
    """
    if not hasattr(os, "sysconf"):
        return sys.maxsize
    return int(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")) // 4
