"""Open a table for reading in blocks: a CSV or Parquet file of any length, or a table in memory."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import IO, Any

from rodgen.data.tables._arrow import FrameTable, ParquetTable
from rodgen.data.tables._csv import CsvTable
from rodgen.data.tables.columns import Column, EveryColumn
from rodgen.data.tables.table import READABLE, Rows, Table
from rodgen.errors import InputFileError
from rodgen.files import open_input, unreadable

__all__ = ["Rows", "Table", "open_csv", "open_frame", "open_table"]


def open_table(
    path: str | os.PathLike[str], columns: Sequence[Column] | EveryColumn, *, keep_text: bool = True
) -> Table:
    """Return a CSV or Parquet file, open for reading in blocks.

    The first bytes of the file decide what it is, not its name.

    Parameters
    ----------
    path : str or os.PathLike
        ``"-"`` reads CSV from standard input.
    columns : sequence of Column, or EveryColumn
        The columns that are needed, by name and quantity.
    keep_text : bool
        Whether `Rows.batch` holds the needed columns of a CSV file as their text or as numbers (in the unit of the
        file). All other columns of a CSV file are text there, because they are not parsed.

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
        return CsvTable("standard input", sys.stdin.buffer, columns, keep_text, closes=False)
    stream = open_input(file, READABLE)
    try:
        start = stream.peek(8)[:8]
        if start.startswith(b"PAR1"):
            return ParquetTable(file, stream, columns)
        return CsvTable(file, stream, columns, keep_text)
    except OSError as error:
        stream.close()
        raise unreadable(file, error, READABLE) from None
    except BaseException:
        stream.close()
        raise


def open_csv(name: str, stream: IO[bytes], columns: Sequence[Column] | EveryColumn) -> Table:
    """Return CSV from a stream, open for reading in blocks, as `open_table` does; `name` is that of messages."""
    return CsvTable(name, stream, columns, keep_text=True)


def open_frame(frame: Any, columns: EveryColumn, name: str) -> Table:
    """Return a table in memory, open for reading in blocks as `open_table` opens a Parquet file.

    Parameters
    ----------
    frame : mapping, DataFrame or Arrow table
        A mapping from column names to sequences, a DataFrame of pandas or Polars (anything with `columns` and
        columns that `numpy.asarray` takes), or anything with Arrow's interface (``__arrow_c_stream__``).
    columns : EveryColumn
    name : str
        Name of the table in error messages.

    Returns
    -------
    Table

    Raises
    ------
    InputFileError
        When it is not a table, or a column does not hold what it should.
    """
    return FrameTable(name, frame, columns)
