"""Tables as other programs write them: text with any separator and decimal sign, Excel workbooks, MATLAB files.

Cells are kept as they are, text or number or time; what a column means is not decided here.
"""

from __future__ import annotations

import csv
import datetime
import io
import math
import os
import re
import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rodgen.data.units import is_unit
from rodgen.errors import InputFileError, counted, joined, shown
from rodgen.files import check_unpacked, decoded, read_input

if TYPE_CHECKING:
    from numpy.typing import NDArray

_EXPECTED = "a table: CSV or other text, .xlsx or .mat"
_UNIT = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\]|\((?P<other>[^()]*)\))")
_LINE_END = re.compile(r"\s*[\r\n]\s*")
_COMMA = re.compile(r"\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*")
_RTL = re.compile(r"^\s*TARGET DATA::\s*$", re.MULTILINE)
_REMARKS = (";", "#", "//", "!", "%")
_BLANK = {"", "nan", "na", "n/a", "-", "--", "none", "null"}
LARGEST = 100_000_000
"""Bytes of a text, and of other files packed and unpacked."""
_PACKED = 15
"""The kind of the parts of MATLAB files that zlib packed."""
_LARGEST_NUMBER = 1e100
"""What nothing measures; its multiples and squares are finite."""
MOST_COLUMNS = 20_000
MOST_PREAMBLE = 60
"""Lines above a header at most."""


@dataclass(frozen=True)
class ForeignColumn:
    """A column."""

    header: str
    """As it is in the file."""
    name: str
    unit: str
    """Its parts; the unit may be empty."""
    cells: tuple[Any, ...]
    """Text, number, time, or None where blank."""


@dataclass(frozen=True)
class ForeignTable:
    """A table as it was written."""

    file: str
    columns: tuple[ForeignColumn, ...]
    places: tuple[str, ...]
    """Of each row, such as ``"line 17"``."""
    notes: tuple[str, ...]
    """How it was read."""
    header: str = "file"
    """Where the names of the columns are, such as ``"line 3"``."""

    def numbers(self, column: ForeignColumn) -> list[float]:
        """Return a column as numbers, NaN where it is blank.

        Raises
        ------
        InputFileError
            At the first cell that is no number.
        """
        numbers = []
        for place, cell in zip(self.places, column.cells, strict=True):
            try:
                value = math.nan if cell is None else float(cell)
            except (TypeError, ValueError):
                value = math.inf
            if abs(value) > _LARGEST_NUMBER:  # 1e400, too
                raise InputFileError(
                    self.file, f"{place}, column {shown(column.header)}", shown(cell), "a number"
                )
            numbers.append(value)
        return numbers


def read_foreign(path: str | os.PathLike[str]) -> ForeignTable:
    """Return a table.

    Parameters
    ----------
    path : str or os.PathLike
        Ends in .xlsx or .mat, or is text.

    Raises
    ------
    InputFileError
        When it cannot be read, or has no header above its rows.
    """
    file = os.fspath(path)
    if file.lower().endswith((".xlsx", ".xlsm")):
        rows, note = _sheet(file)
        return _of_rows(file, rows, "row", (note,))
    if file.lower().endswith(".mat"):
        return _of_mat(file)
    text, coding = _decoded(read_input(file, _EXPECTED, largest=LARGEST), file)
    text = text.removeprefix("\ufeff")
    if _RTL.search(text[:10_000]):
        return _of_rtl(file, text)
    return _of_text(file, text, coding)


def _of_rtl(file: str, text: str) -> ForeignTable:
    """Return a file of Renishaw's laser software: targets in mm, then run, number of the target, deviation in um.

    Columns are those of a table by ISO 230-2: the positions, called by the axis that the file names, and the deviations
    of each run, with its direction.
    """
    lines = [line.strip() for line in text.splitlines()]
    targets: list[float] = []
    runs: dict[int, dict[int, float]] = {}
    section = part = axis = ""
    for number, line in enumerate(lines, start=1):
        if line.endswith("::"):
            section, part = line[:-2], ""
            continue
        key, colon, value = line.partition(":")
        if colon:
            part = key.strip().lower()
            axis = value.strip() if part == "axis" else axis
            continue
        cells = line.replace(",", ".").split()
        try:
            if section == "TARGET DATA" and part == "targets":
                targets += [float(cell) for cell in cells]
            elif section == "DEVIATIONS" and cells:
                run, target, off = int(cells[0]), int(cells[1]), float(cells[2])
                if not 1 <= target <= len(targets):
                    raise ValueError
                runs.setdefault(run, {})[target - 1] = off
        except (ValueError, IndexError):
            expected = "a run, the number of a target, and a deviation" if targets else "positions of targets"
            raise InputFileError(file, f"line {number}", shown(line), expected) from None
    if not targets or not runs:
        raise InputFileError(file, "file", "no targets and deviations", "a file of a linear measurement")
    name = axis.removesuffix("axis").strip() or "position"
    columns = [ForeignColumn(f"{name} [mm]", name, "mm", tuple(targets))]
    for run, readings in sorted(runs.items()):
        order = [targets[k] for k in readings]
        header = f"{run} {'↓' if order[-1] < order[0] else '↑'}"
        cells_of = tuple(readings.get(k) for k in range(len(targets)))
        columns.append(ForeignColumn(f"{header} [um]", header, "um", cells_of))
    note = (
        f"{os.path.basename(file)}: linear measurement of Renishaw's software, {len(targets)} targets in mm, "
        f"{len(runs)} runs in um{f', axis {axis}' if axis else ''}."
    )
    places = tuple(f"target {k + 1}" for k in range(len(targets)))
    return ForeignTable(file, tuple(columns), places, (note,))


def _of_text(file: str, text: str, coding: str) -> ForeignTable:
    lines = text.splitlines()
    head = [line for line in lines if line.strip()][:MOST_PREAMBLE]
    head = [line for line in head if not line.lstrip().startswith(_REMARKS)] or head
    if not head:
        raise InputFileError(file, "file", "an empty file", _EXPECTED)

    def width(separator: str) -> int:
        counts = sorted((line.count(separator) for line in head), reverse=True)
        return counts[min(1, len(counts) - 1)]  # of the second widest line: a remark may have commas, too

    separator = next((mark for mark in ";\t" if width(mark)), "," if width(",") else "")
    rows = [
        (number, [cell.strip() for cell in cells])
        for number, cells in (
            _quoted(file, text, separator)
            if separator
            else ((number, line.split()) for number, line in enumerate(lines, start=1))
        )
        if any(cells)
    ]
    decimal = separator != "," and any(_COMMA.fullmatch(cell) for _, cells in rows for cell in cells)
    words = {";": "semicolons", "\t": "tabs", ",": "commas", "": "blanks"}[separator]
    notes = [
        f"{os.path.basename(file)}: text{coding}, {words} between columns{', decimal commas' if decimal else ''}."
    ]
    if decimal:
        rows = [(n, [c.replace(",", ".") if _COMMA.fullmatch(c) else c for c in cells]) for n, cells in rows]
    return _of_rows(file, rows, "line", tuple(notes))


def _quoted(file: str, text: str, separator: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of each row, in which quoted ones may hold ends of lines, and the number of its first line."""
    reader, first = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True), 1
    try:
        for cells in reader:
            yield first, cells
            first = reader.line_num + 1
    except csv.Error as error:
        found = "a quotation mark without a second" if '"' in text else str(error)
        raise InputFileError(file, f"line {first}", found, "both, or neither") from None


def _decoded(content: bytes, file: str) -> tuple[str, str]:
    """Return the text of a file, and words on its coding where that is not UTF-8: Windows writes two others."""
    try:
        if content.startswith((b"\xff\xfe", b"\xfe\xff")):
            return content.decode("utf-16"), " in UTF-16"
        return decoded(content, file), ""
    except (InputFileError, UnicodeDecodeError):
        try:
            return content.decode("cp1252"), " in Windows-1252"
        except UnicodeDecodeError:
            return decoded(content, file), ""  # whose error says where


def _sheet(file: str) -> tuple[list[tuple[int, list[Any]]], str]:
    """Return the rows of a workbook's first sheet, with their numbers, and what was read."""
    import openpyxl

    content = read_input(file, _EXPECTED, largest=LARGEST)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            check_unpacked(file, archive, _EXPECTED, LARGEST)
        book = openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True)
        sheet = book.worksheets[0]
        sheet.reset_dimensions()
        rows, cells = [], 0
        for number, row in enumerate(sheet.iter_rows(values_only=True), start=1):
            cells += 1 + len(row)  # a row or a cell far off makes many empty ones
            if cells > LARGEST // 8:
                raise InputFileError(file, f"row {number}", f"more than {LARGEST // 8:,} cells", _EXPECTED)
            if any(cell is not None for cell in row):
                rows.append((number, list(row)))
        others, title = len(book.worksheets) - 1, sheet.title
    except InputFileError:
        raise
    except Exception as error:  # openpyxl answers a damaged file with errors of zip, XML and its own
        raise InputFileError(file, "file", f"no workbook ({type(error).__name__})", _EXPECTED) from None
    more = f"; {counted(others, 'other sheet')} not read" if others else ""
    return rows, f"{os.path.basename(file)}: workbook, sheet {shown(title)}{more}."


def _of_mat(file: str) -> ForeignTable:
    import numpy as np
    import scipy.io

    packed = read_input(file, _EXPECTED, largest=LARGEST)
    try:
        if _unpacked_size(packed) > LARGEST:
            found = f"more than {LARGEST / 1e6:g} MB when unpacked"
            raise InputFileError(file, "file", found, _EXPECTED)
        content = scipy.io.loadmat(io.BytesIO(packed), squeeze_me=False, struct_as_record=True)
    except InputFileError:
        raise
    except Exception as error:
        found = f"no MATLAB file of a version up to 7 ({type(error).__name__})"
        raise InputFileError(file, "file", found, "save -v7 FILE") from None
    arrays: dict[str, NDArray[Any]] = {}
    for name, value in content.items():
        if name.startswith("__"):
            continue
        if (
            not isinstance(value, np.ndarray) or not value.size
        ):  # sparse, or no numbers in columns without end
            continue
        fields = value.dtype.names
        arrays |= (
            {f: np.asarray(value[f].flat[0]) for f in fields} if fields and value.size == 1 else {name: value}
        )
    arrays = {n: a for n, a in arrays.items() if a.dtype.kind in "fiub" and a.ndim >= 2 and a.size}
    flat = {n: a for n, a in arrays.items() if a.ndim == 2}
    # MATLAB has points as rows or as columns: a row of the table is what most arrays have as many of; not one number
    several = [a for a in flat.values() if a.size > 1] or [*flat.values()]
    sizes = Counter(size for a in several for size in ({*a.shape} if min(a.shape) > 1 else {a.size}))
    rows = max(sizes, key=lambda size: (sizes[size], size), default=0)
    left = [name for name, array in arrays.items() if name not in flat or rows not in array.shape]
    turned = [n for n, a in arrays.items() if n not in left and a.shape[0] != rows and min(a.shape) > 1]
    columns: list[ForeignColumn] = []
    for name, array in arrays.items():
        if name in left:
            continue
        by_column = array if array.shape[0] != rows else array.T
        if len(by_column) > MOST_COLUMNS:
            found = f"{len(by_column)} columns in {shown(name)}"
            raise InputFileError(file, "file", found, f"at most {MOST_COLUMNS}")
        axes = "xyz" if len(by_column) == 3 else ""
        for k, cells in enumerate(by_column.astype(float)):
            label = f"{name}_{axes[k] if axes else k + 1}" if len(by_column) > 1 else name
            numbers = tuple(None if math.isnan(x) else float(x) for x in cells)
            columns.append(ForeignColumn(label, label, "", numbers))
    if rows < 1:
        raise InputFileError(
            file, "file", "no arrays of numbers", "columns of one length, or a matrix of them"
        )
    note = f"{os.path.basename(file)}: MATLAB arrays of {rows} rows"
    note += f", which are columns of {joined(turned)}" if turned else ""
    note += f"; of another shape, and not read: {joined(left)}." if left else "."
    return ForeignTable(file, tuple(columns), tuple(f"row {k + 1}" for k in range(rows)), (note,))


def _unpacked_size(content: bytes) -> int:
    """Return how many bytes the packed parts of a MATLAB file hold; counting ends above the largest."""
    order, at, size = "<" if content[126:128] == b"IM" else ">", 128, 0
    while at + 8 <= len(content):
        kind, length = struct.unpack(f"{order}II", content[at : at + 8])
        part, unpacking = content[at + 8 : at + 8 + length], zlib.decompressobj()
        while kind == _PACKED and part and size <= LARGEST:
            size += len(unpacking.decompress(part, 1 << 20))
            part = unpacking.unconsumed_tail
        at += 8 + length
    return size


def _of_rows(
    file: str, rows: Sequence[tuple[int, list[Any]]], called: str, notes: tuple[str, ...]
) -> ForeignTable:
    """Find the header: the first line as wide as most, with names, above a line with a number."""
    widths = [len(cells) for _, cells in rows]
    usual = max(set(widths), key=lambda width: (widths.count(width), width), default=0)
    at = next(
        (
            k
            for k, (_, cells) in enumerate(rows[:MOST_PREAMBLE])
            if len(cells) == usual
            and cells
            and not any(is_number(cell) or isinstance(cell, datetime.date) for cell in cells)
            and sum(map(_is_name, cells)) > usual / 2
        ),
        None,
    )
    if at is None:
        raise InputFileError(
            file, "file", "no header of names", "a line with the names of the columns above the rows"
        )
    header, body = [_LINE_END.sub(" ", str(cell or "").strip()) for cell in rows[at][1]], rows[at + 1 :]
    units = [""] * usual
    if body and len(body[0][1]) <= usual and all(not c or is_unit(str(c).strip("[]() ")) for c in body[0][1]):
        units = [str(c or "").strip("[]() ") for c in body[0][1]] + [""] * (usual - len(body[0][1]))
        body = body[1:]
        notes += (f"Line {rows[at + 1][0]} has the units.",)
    if at:
        notes += (f"Above the header, and not read: {counted(at, 'line')}.",)
    for number, cells in body:
        if len(cells) > usual:
            found = f"{len(cells)} cells under {usual} columns"
            raise InputFileError(file, f"{called} {number}", found, "a cell for each column")
    if not body:
        raise InputFileError(file, f"{called} {rows[at][0] + 1}", "no rows", "rows under the header")
    columns = []
    for k, text in enumerate(header):
        column = tuple(_cell(row[k] if k < len(row) else None) for _, row in body)
        name, unit = text, units[k]
        if (parts := _UNIT.fullmatch(text)) and is_unit(
            written := (parts["unit"] or parts["other"] or "").strip()
        ):
            name, unit = parts["name"].strip(), written
        if text:
            columns.append(ForeignColumn(text, name, unit, column))
    return ForeignTable(
        file, tuple(columns), tuple(f"{called} {n}" for n, _ in body), notes, f"{called} {rows[at][0]}"
    )


def _cell(cell: Any) -> Any:
    if isinstance(cell, str):
        return None if cell.strip().lower() in _BLANK else cell.strip()
    return cell


def is_number(cell: Any) -> bool:
    """Return whether a cell is a number, or a text that is one."""
    try:
        float(cell)
    except (TypeError, ValueError):
        return False
    return True


def _is_name(cell: Any) -> bool:
    return isinstance(cell, str) and bool(re.search(r"[^\W\d_]|[↑↓]", cell))  # a letter, or a run: "1 ↑"
