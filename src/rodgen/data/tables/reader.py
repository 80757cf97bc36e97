"""Open a table for reading: a CSV or Parquet file, or a table in memory; and read measured pairs of points.

A pair is a point before (`rho`) and after (`rho_prime`) a rotation by `angle` about an axis through the origin of the
frame in which both were measured.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.data.tables._arrow import FrameTable, ParquetTable
from rodgen.data.tables._csv import CsvTable
from rodgen.data.tables.columns import Column, EveryColumn
from rodgen.data.tables.table import READABLE, Table, places_of
from rodgen.errors import InputFileError
from rodgen.files import open_input, unreadable

PAIR_COLUMNS = (
    *(Column(f"{point}_{axis}", "length") for point in ("rho", "rho_prime") for axis in "xyz"),
    Column("angle", "angle"),
)


def open_table(
    path: str | os.PathLike[str], columns: Sequence[Column] | EveryColumn, *, keep_text: bool = False
) -> Table:
    """Return a CSV or Parquet file, open for reading; a CSV file is read whole.

    The first bytes of the file decide what it is, not its name.

    Parameters
    ----------
    path : str or os.PathLike
        ``"-"`` reads CSV from standard input.
    columns : sequence of Column, or EveryColumn
        The columns that are needed, by name and quantity.
    keep_text : bool
        Whether `Rows.table` holds the needed columns of a CSV file as their text or as numbers (in the unit of the
        file). All other columns of a CSV file are text there, because they are not parsed.

    Returns
    -------
    Table
        A context manager; its `read` reads.

    Raises
    ------
    InputFileError
        When the file cannot be read, or lacks a column, or a unit does not fit.
    """
    file = os.fspath(path)
    if file == "-":
        if sys.stdin is None:
            raise InputFileError("standard input", "file", "closed", "CSV, or the name of a file")
        return CsvTable("standard input", sys.stdin.buffer, columns, keep_text)
    stream = open_input(file, READABLE)
    try:
        start = stream.peek(8)[:8]
        if start.startswith(b"PAR1"):
            return ParquetTable(file, stream, columns)
        with stream:
            return CsvTable(file, stream, columns, keep_text)
    except OSError as error:
        stream.close()
        raise unreadable(file, error, READABLE) from None
    except BaseException:
        stream.close()
        raise


def open_csv(name: str, stream: IO[bytes], columns: Sequence[Column] | EveryColumn) -> Table:
    """Return CSV from a stream, as `open_table` does; `name` is that of messages."""
    return CsvTable(name, stream, columns, keep_text=False)


def open_frame(frame: Any, columns: EveryColumn, name: str) -> Table:
    """Return a table in memory, as `open_table` opens a Parquet file.

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


@dataclass(frozen=True)
class Pairs:
    """Measured pairs."""

    rho: NDArray[np.float64]
    rho_prime: NDArray[np.float64]
    """The points before and after, in `unit`, (n, 3)."""
    angle: NDArray[np.float64]
    """The rotations in radians, (n,)."""
    unit: str
    """The unit of the table's first length column."""
    file: str
    counted: str
    """What `numbers` are: ``"line"`` of a CSV file, or ``"row"``."""
    numbers: NDArray[np.int64]
    """Of each pair: its line, from 1, or its row, from 0, (n,)."""

    def places(self, chosen: Sequence[int] | NDArray[np.int_]) -> str:
        """Return the places of some pairs, one at least, such as ``"lines 4 and 9 of pairs.csv"``."""
        return places_of(self.file, self.counted, chosen, lambda some: self.numbers[some])


def read_pairs(path: str | os.PathLike[str]) -> Pairs:
    """Return all pairs of a table.

    Parameters
    ----------
    path : str or os.PathLike
        CSV or Parquet with the columns ``rho_x … rho_z``, ``rho_prime_x … rho_prime_z`` and ``angle``,
        each with its unit in brackets; ``"-"`` is CSV on standard input.

    Returns
    -------
    Pairs

    Raises
    ------
    InputFileError
        When the file cannot be read or a cell in these columns is not a finite number.
    """
    with open_table(path, PAIR_COLUMNS) as table:
        rows = table.read()
        rho, rho_prime = (np.column_stack(rows.values[k : k + 3]) for k in (0, 3))
        unit = table.units()["rho_x"]
        return Pairs(rho, rho_prime, rows.values[6], unit, table.file, table.counted, rows.numbers)
