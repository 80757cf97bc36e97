"""Write a table again with columns of results, or with columns that are known.

The order of its rows, its columns and their text are kept. Lengths are computed and written in the unit of the table's
first length column. Angles are computed in radians and written in the unit of its first angle column, or in degrees; so
are their rates of change.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Literal, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rodgen.data.tables.columns import MEASUREMENTS, Column, bare_name
from rodgen.data.tables.parts import parts_of
from rodgen.data.tables.reader import open_table
from rodgen.data.tables.writer import check_table_name, write_table
from rodgen.data.units import conversion_factor
from rodgen.errors import InputFileError, shown
from rodgen.files import OutputSet, new_folder
from rodgen.schedulers import workers

Answer: TypeAlias = tuple[Sequence[NDArray[Any]], NDArray[np.int64] | None]
"""The result columns, and the row of the table that each result belongs to; None where each row has one result."""


@dataclass(frozen=True)
class Result:
    """A column that is added."""

    name: str
    """Its name; the unit is added."""
    quantity: Literal["length", "angle", "rate", "number", "count"] | type[IntEnum]
    """What it holds: numbers with the table's unit of length, angles in radians, their rates in radians a second, plain
    numbers, whole ones, or codes that are written as the names of the enumeration in lower case."""


@dataclass
class MapSummary:
    """Counts of a `map_table`."""

    rows: int = 0
    """Rows written."""
    counts: dict[str, int] = field(default_factory=dict)
    """Rows with each code of the first status column, by its name in lower case; only those that occur."""


def map_table(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str] | None,
    columns: Sequence[Column],
    prepare: Callable[[str], tuple[Sequence[Result], Callable[[Sequence[NDArray[np.float64]]], Answer]]],
) -> MapSummary:
    """Write a table again with columns of results.

    Parameters
    ----------
    path : str or os.PathLike
        CSV (gzip or not) or Parquet; ``"-"`` is CSV on standard input.
    output : str or os.PathLike, optional
        ``.csv``, ``.csv.gz`` or ``.parquet``; CSV on standard output when left out or ``"-"``. It gets every column of
        the input unchanged, then the results. A column of the table whose name is also that of a result, such as one of
        an earlier command, is kept as ``given NAME``.
    columns : sequence of Column
        Those that are read; every cell must hold a finite number. A table of results, which has a column ``status``,
        may have NaN in rows without a result.
    prepare : callable
        Called once with the unit of length (``""`` where no column has one); returns the result columns, and a function
        from the values of `columns`, one array each, to their arrays.

    Returns
    -------
    MapSummary

    Raises
    ------
    InputFileError
        When the input or the output cannot be used. The output is then unchanged.
    """
    with OutputSet(), open_table(path, columns, keep_text=_keeps_text(output)) as table:
        units = table.units()
        length = next((units[c.name] for c in columns if c.quantity == "length"), "")
        angle = next((units[c.name] for c in columns if c.quantity == "angle"), "deg")
        rate = next((units[c.name] for c in columns if c.quantity == "rate"), "deg/s")
        results, function = prepare(length)
        writers = [_Writer(result, {"length": length, "angle": angle, "rate": rate}) for result in results]
        table.gaps = any(bare_name(name) == "status" for name in table.schema.names)
        rows = table.read()
        arrays, index = function(rows.values)
        table_used = rows.table if index is None else rows.table.take(pa.array(index))
        names = _given(table.schema.names, {bare_name(writer.text) for writer in writers})
        new_columns = [writer.column(array) for writer, array in zip(writers, arrays, strict=True)]
        columns_of = [*table_used.columns, *new_columns]
        write_table(output, pa.table(columns_of, names=[*names, *(writer.text for writer in writers)]))
    status = next((n for n, writer in enumerate(writers) if writer.names), None)
    counts = {}
    if status is not None:
        of_code = np.bincount(np.asarray(arrays[status]), minlength=len(writers[status].names)).tolist()
        counts = {name: n for name, n in zip(writers[status].names, of_code, strict=True) if n}
    return MapSummary(table_used.num_rows, counts)


def _given(names: Sequence[str], new_names: Collection[str]) -> list[str]:
    """Return the names of columns that are kept, with a "given" before those that results have, and before older ones.

    Examples
    --------
    >>> _given(["x [mm]", "given x [mm]", "given y [mm]"], {"x", "y"})
    ['given x [mm]', 'given given x [mm]', 'given y [mm]']
    """
    present = {bare_name(name) for name in names}
    renamed = set()
    for name in new_names:
        while name in present:
            renamed.add(name)
            name = f"given {name}"
    return [f"given {name}" if bare_name(name) in renamed else name for name in names]


class _Writer:
    """Name, type and conversion of a result column."""

    def __init__(self, result: Result, units: dict[str, str]) -> None:
        quantity = result.quantity
        self.names: list[str] = []
        self._factor = 1.0
        unit = units.get(str(quantity), "")
        self.text = f"{result.name} [{unit}]" if unit else result.name
        if quantity == "angle" or quantity == "rate":
            self._factor = 1.0 / conversion_factor(unit, quantity, "rad" if quantity == "angle" else "rad/s")
        self.kind = pa.int64() if quantity == "count" else pa.float64()
        if isinstance(quantity, type):
            codes = [int(code) for code in quantity]
            if codes != list(range(len(codes))):
                raise AssertionError(f"{quantity.__name__} must count from zero: its values index the names")
            self.names = [code.name.lower() for code in quantity]
            self.kind = pa.string()

    def column(self, values: NDArray[Any]) -> pa.Array:
        if self.names:
            return pa.array(self.names, pa.string()).take(pa.array(np.asarray(values)))
        if self.kind == pa.int64():
            return pa.array(np.asarray(values, np.int64))
        return pa.array(np.ascontiguousarray(values, np.float64) * self._factor)


# columns that are known -------------------------------------------------------------------------------------


def map_files(table: str, output: str | None, map_one: Callable[[str, str], MapSummary]) -> MapSummary:
    """Add results to many files, each where it is read, and write them into a new folder; count all of them.

    Parameters
    ----------
    map_one : callable
        Does it for one file, given its name and that of the output.
    """
    if output in {None, "-"}:
        raise InputFileError(table, "file", "standard output for many files", "a new folder: -o FOLDER")
    parts, _ = parts_of(table)
    if parts[0].filesystem is not None:
        raise InputFileError(table, "file", "an address", "files of this computer")
    total = MapSummary()
    with new_folder(str(output)) as into, workers() as some:
        files = list(dict.fromkeys(part.path for part in parts))
        outputs = [str(into / f"{k:05d}-{os.path.basename(file)}") for k, file in enumerate(files)]
        pairs = list(zip(files, outputs, strict=True))
        for _, mapped in some.each("files", lambda pair: map_one(*pair), pairs):
            total.rows += mapped.rows
            for name, count in mapped.counts.items():
                total.counts[name] = total.counts.get(name, 0) + count
    return total


def check_output(source: str, output: str | os.PathLike[str] | None) -> None:
    """Raise early the errors of `copy_with` that follow from the names alone.

    Raises
    ------
    InputFileError
        When the input is not a file, or the output cannot be one.
    """
    if source in ("-", "standard input"):
        expected = "the name of a file: it is read twice"
        raise InputFileError("standard input", "file", "a pipe, whose rows are to be written again", expected)
    check_table_name(output)


def copy_with(
    source: str,
    output: str | os.PathLike[str] | None,
    columns: Mapping[str, NDArray[Any]],
    *,
    replaced: Mapping[str, str] | None = None,
) -> None:
    """Copy a table with further columns.

    Parameters
    ----------
    source : str
        A file, not standard input: it is read a second time.
    output : str, os.PathLike or None
        ``.csv``, ``.csv.gz`` or ``.parquet``; None or ``"-"`` is CSV on standard output.
    columns : mapping of str to ndarray, each of shape (rows,)
        By their names; masked elements become empty cells.
    replaced : mapping of str to str, optional
        Names of columns of the file, and which of `columns` stands there instead.

    Raises
    ------
    InputFileError
        When the output cannot be written, the file already has a column of one of the names, or has another number of
        rows than the columns.
    """
    check_output(source, output)
    instead = dict(replaced or {})
    with OutputSet(), open_table(source, MEASUREMENTS, keep_text=_keeps_text(output)) as table:
        for name in columns:
            if name in table.schema.names and name not in instead:
                raise InputFileError(
                    table.file,
                    f"column {shown(name)}",
                    "a result of an earlier run",
                    "a table without results",
                )
        whole = table.read(empty=True).table
        if any(len(values) != whole.num_rows for values in columns.values()):
            expected = "a file that stays as it is"
            raise InputFileError(table.file, "file", "another number of rows than before", expected)
        new = {name: _array(values) for name, values in columns.items()}
        new_columns = {instead.get(name, name): whole[name] for name in whole.column_names} | new
        write_table(output, pa.table(new_columns))


def _keeps_text(output: str | os.PathLike[str] | None) -> bool:
    """Return whether cells are written letter for letter: in CSV."""
    return output is None or not os.fspath(output).lower().endswith(".parquet")


def _array(values: NDArray[Any]) -> pa.Array:
    return pa.array(np.ascontiguousarray(np.ma.getdata(values)), mask=np.ma.getmaskarray(values))
