"""Write a measurement file again with more columns; the order of its rows, its columns and their text are kept."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rodgen.data.tables.columns import MEASUREMENTS
from rodgen.data.tables.reader import open_table
from rodgen.data.tables.writer import open_sink
from rodgen.errors import InputFileError, shown
from rodgen.files import OutputSet


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
    open_sink(output, pa.schema([]))


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
    keep_text = output is None or not os.fspath(output).lower().endswith(".parquet")
    with OutputSet(), open_table(source, MEASUREMENTS, keep_text=keep_text) as table:
        for name in columns:
            if name in table.schema.names and name not in instead:
                raise InputFileError(
                    table.file,
                    f"column {shown(name)}",
                    "a result of an earlier run",
                    "a table without results",
                )
        last = [name for name in columns if name not in instead.values()]
        fields = [
            pa.field(instead[f.name], pa.float64()) if f.name in instead else f for f in table.schema
        ] + [pa.field(name, pa.from_numpy_dtype(columns[name].dtype)) for name in last]
        schema = pa.schema(fields)
        with open_sink(output, schema) as sink:
            start = 0
            for batch, _ in table.map(lambda rows: rows.batch, empty=True):
                stop = start + len(batch)
                if any(stop > len(values) for values in columns.values()):
                    raise _changed(table.file)
                new = {name: _array(values[start:stop]) for name, values in columns.items()}
                arrays = [
                    new[instead[name]] if name in instead else batch.column(i)
                    for i, name in enumerate(table.schema.names)
                ]
                arrays += [new[name] for name in last]
                sink.write(sink.encode(pa.RecordBatch.from_arrays(arrays, schema=schema)))
                start = stop
            if any(start != len(values) for values in columns.values()):
                raise _changed(table.file)


def _array(values: NDArray[Any]) -> pa.Array:
    return pa.array(np.ascontiguousarray(np.ma.getdata(values)), mask=np.ma.getmaskarray(values))


def _changed(file: str) -> InputFileError:
    return InputFileError(file, "file", "another number of rows than before", "a file that stays as it is")
