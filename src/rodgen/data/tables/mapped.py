"""Write a table again with columns of results, row by row: what all table commands do.

The rows are processed in blocks, so that a file of any length needs bounded memory. Lengths are computed and written in
the unit of the table's first length column. Angles are computed in radians and written in the unit of its first angle
column, or in degrees; so are their rates of change.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Literal, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rodgen.data.tables.columns import Column, bare_name
from rodgen.data.tables.reader import Rows, open_table
from rodgen.data.tables.writer import open_sink
from rodgen.data.units import conversion_factor
from rodgen.files import OutputSet

Progress: TypeAlias = Callable[[int | None, str], Callable[[int], object]]
"""Called once with the total (or None) and its unit; returns a function to be called with every advance."""

Answer: TypeAlias = tuple[Sequence[NDArray[Any]], NDArray[np.int64] | None]
"""The result columns, and the row of the block that each result belongs to; None where each row has one result."""


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
    *,
    progress: Progress | None = None,
    whole: bool = False,
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
        from the values of `columns`, one array each, to their arrays. It is called in threads.
    progress : callable, optional
        Called once with the total (or None) and its unit, returns what is called with every advance.
    whole : bool, optional
        Whether the function gets all rows at once, because a result depends on the rows before; the table must then fit
        into memory.

    Returns
    -------
    MapSummary

    Raises
    ------
    InputFileError
        When the input or the output cannot be used. The output is then what it was before.
    """
    keep_text = output is None or not os.fspath(output).lower().endswith(".parquet")
    with OutputSet(), open_table(path, columns, keep_text=keep_text) as table:
        units = table.units()
        length = next((units[c.name] for c in columns if c.quantity == "length"), "")
        angle = next((units[c.name] for c in columns if c.quantity == "angle"), "deg")
        rate = next((units[c.name] for c in columns if c.quantity == "rate"), "deg/s")
        results, function = prepare(length)
        writers = [_Writer(result, {"length": length, "angle": angle, "rate": rate}) for result in results]
        table.gaps = any(bare_name(name) == "status" for name in table.schema.names)
        names = _given(table.schema.names, {bare_name(writer.text) for writer in writers})
        kept = (field.with_name(name) for field, name in zip(table.schema, names, strict=True))
        schema = pa.schema([*kept, *(pa.field(writer.text, writer.kind) for writer in writers)])
        status = next((n for n, writer in enumerate(writers) if writer.names), None)
        counts = np.zeros(len(writers[status].names) if status is not None else 1, np.int64)

        with open_sink(output, schema) as sink:

            def work(rows: Rows) -> tuple[Any, NDArray[np.int64]]:
                arrays, index = function(rows.values)
                batch = rows.batch if index is None else rows.batch.take(pa.array(index))
                made = [writer.column(array) for writer, array in zip(writers, arrays, strict=True)]
                batch = pa.RecordBatch.from_arrays([*batch.columns, *made], schema=schema)
                codes = np.zeros(batch.num_rows, int) if status is None else np.asarray(arrays[status])
                return sink.encode(batch), np.bincount(codes, minlength=len(counts))

            advance = progress(table.total, table.amount_unit) if progress else None

            def write(block: tuple[Any, NDArray[np.int64]]) -> None:
                sink.write(block[0])
                np.add(counts, block[1], out=counts)

            if whole:
                read = []
                for rows, amount in table.map(lambda rows: rows):
                    read.append(rows)
                    if advance:
                        advance(amount)
                write(work(_joined(read)))
            else:
                for block, amount in table.map(work):
                    write(block)
                    if advance:
                        advance(amount)
    names = writers[status].names if status is not None else []
    found_names = {name: int(count) for name, count in zip(names, counts, strict=False) if count}
    return MapSummary(int(counts.sum()), found_names)


def _given(names: Sequence[str], made: Collection[str]) -> list[str]:
    """Return the names of columns that are kept, with a "given" before those that results have, and before older ones.

    Examples
    --------
    >>> _given(["x [mm]", "given x [mm]", "given y [mm]"], {"x", "y"})
    ['given x [mm]', 'given given x [mm]', 'given y [mm]']
    """
    present = {bare_name(name) for name in names}
    renamed = set()
    for name in made:
        while name in present:
            renamed.add(name)
            name = f"given {name}"
    return [f"given {name}" if bare_name(name) in renamed else name for name in names]


def _joined(parts: Sequence[Rows]) -> Rows:
    batch = pa.Table.from_batches([part.batch for part in parts]).combine_chunks().to_batches()[0]
    values = tuple(np.concatenate(columns) for columns in zip(*(part.values for part in parts), strict=True))
    return Rows(values, (), np.concatenate([part.numbers for part in parts]), batch)


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
