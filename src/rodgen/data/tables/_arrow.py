"""Tables whose columns have types: Parquet files, and tables in memory from any library."""

from __future__ import annotations

import abc
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rodgen.data.tables.columns import Column, EveryColumn, Layouts, bare_name
from rodgen.data.tables.table import READABLE, Rows, Table, in_wanted_unit, row_place, values_of
from rodgen.errors import InputFileError, counted, shown
from rodgen.files import unreadable

BATCH_ROWS = 1 << 15
_ARROW_ERRORS = (pa.ArrowException, OSError, ValueError, KeyError, MemoryError)


class _ArrowTable(Table):
    """A table whose columns have types."""

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
        """Return the error for data that Arrow cannot read."""

    def _rows(self, table: pa.Table, first: int) -> Rows:
        """Return the rows of a table, the first of which has this number in its file."""
        numbers = np.arange(first, first + table.num_rows)
        try:
            values, text = self._convert(table.columns, numbers)
        except _ARROW_ERRORS as error:
            if isinstance(error, InputFileError):
                raise
            raise self._damaged(error) from None
        return Rows(values, text, numbers, table)

    def _convert(
        self, columns: Sequence[pa.ChunkedArray], numbers: NDArray[np.int64]
    ) -> tuple[tuple[NDArray[np.float64], ...], tuple[pa.ChunkedArray, ...]]:
        """Return the wanted columns, those of numbers in the units asked for."""
        values, text = [], []
        faults: list[tuple[int, int]] = []
        for match in self.matches:
            column = values_of(_plain(columns[match.index]).cast(pa.float64(), safe=False))
            column = in_wanted_unit(column, match)
            finite = self._accepted(column)
            if not finite.all():
                faults.append((int(np.argmin(finite)), match.index))
            values.append(column)
        for match in self.text:
            import pyarrow.compute as pc  # takes 15 ms, and most tables hold numbers only

            cells = _plain(columns[match.index])
            names = pc.utf8_trim_whitespace(cells.cast(pa.string())).fill_null("")
            if match.index in self._needed:
                missing = values_of(pc.utf8_length(names)) == 0
                if pa.types.is_floating(cells.type):
                    missing = missing | ~np.isfinite(values_of(cells))
                if missing.any():
                    faults.append((int(np.argmax(missing)), match.index))
            text.append(names)
        if faults:
            row, index = min(faults)
            cell = columns[index][row].as_py()
            found = "an empty cell" if cell is None or cell == "" else shown(cell)
            is_name = index in {match.index for match in self.text}
            expected = (
                "a name in every row" if is_name else "a finite number (leave out rows without a measurement)"
            )
            place = (
                f"{row_place(self.counted, [int(numbers[row])])}, column {shown(self.schema.names[index])}"
            )
            raise InputFileError(self.file, place, found, expected)
        return tuple(values), tuple(text)


def _plain(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return a column without a dictionary."""
    if not pa.types.is_dictionary(column.type):
        return column
    return pa.chunked_array([chunk.dictionary_decode() for chunk in column.chunks], column.type.value_type)


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind))


def _is_text(kind: pa.DataType) -> bool:
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind))


class ParquetTable(_ArrowTable):
    """A Parquet file, or some of its row groups and columns.

    Parameters
    ----------
    file : str
    raw : file open for reading bytes
    columns : sequence of Column, or EveryColumn
    groups : sequence of int, optional
        Numbers of the row groups that are read; left out, all.
    names : collection of str, optional
        Names of the columns that are read, without their units; left out, all.
    """

    group_rows: list[int]
    _group: int | None = None  # that is being read

    def __init__(
        self,
        file: str,
        raw: Any,
        columns: Sequence[Column] | Layouts | EveryColumn,
        groups: Sequence[int] | None = None,
        names: Collection[str] | None = None,
    ) -> None:
        import pyarrow.parquet as pq

        self.file = file
        self._raw = raw
        try:
            # A small read buffer keeps a row group of any size from being read at once.
            # Pages that have a checksum are checked; few programs write it.
            self._parquet = pq.ParquetFile(
                raw, buffer_size=1 << 20, pre_buffer=False, page_checksum_verification=True
            )
            self.schema = self._parquet.schema_arrow.remove_metadata()
            sizes = [
                self._parquet.metadata.row_group(g).num_rows for g in range(self._parquet.num_row_groups)
            ]
        except _ARROW_ERRORS as error:
            raise self._damaged(error) from None
        self._columns: list[str] | None = None
        if names is not None:
            self.schema = pa.schema([field for field in self.schema if bare_name(field.name) in names])
            self._columns = self.schema.names
        self.group_rows = sizes
        self._groups = range(len(sizes)) if groups is None else groups
        self._first = sum(sizes[: self._groups[0]]) if len(self._groups) else 0
        self._total: int = sum(sizes[g] for g in self._groups)
        self._find_wanted(self.schema.names, columns, self._words())
        self._check_types()

    def batches(self) -> Iterator[tuple[int, pa.RecordBatch]]:
        """Yield the rows as they are in the file, some at a time, with the number of the first among those read."""
        start = 0
        try:
            for group in self._groups:
                self._group = group
                for batch in self._parquet.iter_batches(
                    BATCH_ROWS, [self._group], self._columns, use_threads=False
                ):
                    yield start, batch
                    start += len(batch)
        except _ARROW_ERRORS as error:
            raise self._damaged(error) from None
        self._group = None

    def _rows_at_most(self) -> int:
        return self._total

    def _read(self) -> Rows:
        table = pa.Table.from_batches([batch for _, batch in self.batches()], self.schema)
        return self._rows(table, self._first)

    def _damaged(self, error: BaseException) -> InputFileError:
        if getattr(error, "errno", None) is not None:  # of the disk, not of what it holds
            return unreadable(self.file, error, READABLE)
        reason = shown(str(error).partition("\n")[0].rstrip("."), 120)[1:-1]
        if isinstance(error, MemoryError):
            found, expected = f"needs more memory than there is ({reason})", "a smaller table, or more memory"
        else:
            found, expected = f"damaged Parquet data ({reason})", "a complete Parquet file"
        place = "file" if self._group is None else f"row group {self._group}"
        return InputFileError(self.file, place, found, expected)


class FrameTable(_ArrowTable):
    """A table in memory."""

    header = "columns"

    def __init__(self, name: str, frame: Any, columns: EveryColumn) -> None:
        self.file = name
        self._table = _as_arrow(frame, name)
        self.schema = self._table.schema
        self._find_wanted(self.schema.names, columns, self._words())
        self._check_types()

    def _rows_at_most(self) -> int:
        return int(self._table.num_rows)

    def _read(self) -> Rows:
        rows = self._rows(self._table, 0)
        return replace(rows, values=tuple(map(np.array, rows.values)))  # the frame may change

    def _damaged(self, error: BaseException) -> InputFileError:
        reason = str(error).partition("\n")[0].rstrip(".")
        return InputFileError(
            self.file, "columns", f"what Arrow cannot read ({reason})", "a table of numbers"
        )


def _as_arrow(frame: Any, name: str) -> pa.Table:
    """Return a table's columns as Arrow's; numbers are not copied where their memory is laid out as Arrow's.

    Examples
    --------
    >>> _as_arrow({"C [deg]": [0, 90], "run": ["a", "b"]}, "data").schema.names
    ['C [deg]', 'run']
    """
    if isinstance(frame, pa.RecordBatch):
        return pa.Table.from_batches([frame])
    if isinstance(frame, pa.Table):
        return frame
    if hasattr(frame, "data_vars"):
        frame = _rows_of_dataset(frame)
    elif isinstance(frame, np.ndarray) and frame.dtype.names:
        frame = {text: frame[text] for text in frame.dtype.names}
    index = getattr(getattr(frame, "index", None), "names", None)
    if index and any(text is not None and text not in frame.columns for text in index):
        frame = frame.reset_index()
    # Before Arrow's interface, through which pandas passes its index as one more column.
    if isinstance(frame, Mapping):
        texts = list(frame)
    elif hasattr(frame, "columns") and hasattr(frame, "__getitem__"):
        texts = list(frame.columns)
    elif hasattr(frame, "__arrow_c_stream__"):
        return pa.table(frame)
    else:
        expected = "a mapping from column names to sequences, a DataFrame or an Arrow table"
        raise InputFileError(name, "file", f"an object of type {type(frame).__name__}", expected)
    arrays = []
    for number, text in enumerate(texts):
        if text in texts[:number]:  # a DataFrame hands out both at once
            raise InputFileError(name, "columns", f"column {shown(text)} twice", "every column name once")
        if not isinstance(text, str):
            raise InputFileError(name, "columns", f"{shown(text)} as a column's name", "text")
        arrays.append(_array(frame[text], f"column {shown(text)}", name))
        if len(arrays[-1]) != len(arrays[0]):
            found = counted(len(arrays[-1]), "row")
            expected = f"{len(arrays[0])}, as in the column {shown(texts[0])}"
            raise InputFileError(name, f"column {shown(text)}", found, expected)
    return pa.Table.from_arrays(arrays, names=texts)


def _rows_of_dataset(dataset: Any) -> dict[str, Any]:
    """Return the variables and coordinates of a Dataset of xarray, each laid out over all of its dimensions."""
    rows_of = {}
    for text, values in dataset.variables.items():
        unit = values.attrs.get("units", "")
        known = unit and isinstance(text, str) and "[" not in text and unit != "1"
        name = f"{text} [{unit}]" if known else text
        rows_of[name] = values.set_dims(dict(dataset.sizes)).to_numpy().ravel()
    return rows_of


def _array(values: Any, place: str, name: str) -> Any:
    if isinstance(values, pa.Array | pa.ChunkedArray):
        return values
    try:
        mask = np.ma.getmaskarray(values) if np.ma.isMaskedArray(values) else None
        array = np.asarray(values.to_numpy() if hasattr(values, "to_numpy") else values)
        if array.ndim != 1:
            found = f"an array of shape {array.shape}" if array.ndim else "a single value"
            raise InputFileError(name, place, found, "a sequence of numbers, one for each row")
        # Arrow accepts the native byte order only; FITS files have the other.
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        return pa.array(array, mask=mask, from_pandas=array.dtype.kind == "O")
    except InputFileError:
        raise
    except (pa.ArrowException, TypeError, ValueError, OverflowError) as error:
        reason = str(error).partition("\n")[0].rstrip(".")
        found = f"neither a sequence of numbers nor of names ({shown(reason, 100)[1:-1]})"
        raise InputFileError(name, place, found, "one type in all of its cells") from None
