"""Open a table for reading: a CSV or Parquet file, or a table in memory; and read measured pairs of points, or poses.

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

from rodgen.data.notations import ANGULAR, NOTATIONS
from rodgen.data.tables._arrow import FrameTable, ParquetTable
from rodgen.data.tables._csv import CsvTable
from rodgen.data.tables.columns import Column, EveryColumn, Layouts
from rodgen.data.tables.table import READABLE, Table, places_of
from rodgen.errors import InputFileError
from rodgen.files import open_input, unreadable

PAIR_COLUMNS = (
    *(Column(f"{point}_{axis}", "length") for point in ("rho", "rho_prime") for axis in "xyz"),
    Column("angle", "angle"),
)


def open_table(
    path: str | os.PathLike[str],
    columns: Sequence[Column] | Layouts | EveryColumn,
    *,
    keep_text: bool = False,
) -> Table:
    """Return a CSV or Parquet file, open for reading; a CSV file is read whole.

    The first bytes of the file decide what it is, not its name.

    Parameters
    ----------
    path : str or os.PathLike
        ``"-"`` reads CSV from standard input.
    columns : sequence of Column, Layouts, or EveryColumn
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


_MOTIONS = Layouts(
    (
        (
            *PAIR_COLUMNS[:-1],
            Column("angle", "angle", optional=True),
            Column("move", "name", optional=True),
        ),
        *(
            (
                *(Column(axis, "length") for axis in "xyz"),
                *(Column(name, "angle" if notation in ANGULAR else "number") for name in names),
                Column("t", "time", optional=True),
            )
            for notation, names in NOTATIONS.items()
        ),
    )
)


@dataclass(frozen=True)
class _Motions:
    """What all tables of motions have."""

    unit: str
    """The unit of the table's first length column."""
    file: str
    counted: str
    """What `numbers` are: ``"line"`` of a CSV file, or ``"row"``."""
    numbers: NDArray[np.int64]
    """Of each row: its line, from 1, or its row, from 0, (n,)."""

    def places(self, chosen: Sequence[int] | NDArray[np.int_]) -> str:
        """Return the places of some rows, one at least, such as ``"lines 4 and 9 of pairs.csv"``."""
        return places_of(self.file, self.counted, chosen, lambda some: self.numbers[some])


@dataclass(frozen=True)
class Pairs(_Motions):
    """Measured pairs."""

    rho: NDArray[np.float64]
    rho_prime: NDArray[np.float64]
    """The points before and after, in `unit`, (n, 3)."""
    angle: NDArray[np.float64] | None
    """The rotations in radians, (n,); None where the table has none."""
    move: NDArray[Any] | None
    """The label of each row's motion, (n,); None where the table has none."""


@dataclass(frozen=True)
class Poses(_Motions):
    """Measured poses of a body."""

    position: NDArray[np.float64]
    """In `unit`, (n, 3)."""
    notation: str
    """How the attitudes are written: a key of `rodgen.data.notations.NOTATIONS`."""
    attitude: NDArray[np.float64]
    """Their numbers, angles in radians, (n, 3), (n, 4) or (n, 9)."""
    time: NDArray[np.float64] | None
    """In seconds, (n,); None where the table has none."""


def read_motions(path: str | os.PathLike[str]) -> Pairs | Poses:
    """Return all pairs of points, or all poses, of a table.

    Parameters
    ----------
    path : str or os.PathLike
        CSV or Parquet with the columns ``rho_x … rho_z``, ``rho_prime_x … rho_prime_z`` and perhaps ``angle`` and
        ``move``, or with ``x … z``, an attitude as in `rodgen.data.notations` and perhaps ``t``, each with its unit
        in brackets; ``"-"`` is CSV on standard input.

    Returns
    -------
    Pairs or Poses

    Raises
    ------
    InputFileError
        When the file cannot be read or a cell in these columns is not a finite number.
    """
    with open_table(path, _MOTIONS) as table:
        rows = table.read()
        values = dict(zip(table.units(), rows.values, strict=True))
        unit = next(iter(table.units().values()))
        place = (unit, table.file, table.counted, rows.numbers)
        if "rho_x" in values:
            rho, rho_prime = (np.column_stack(rows.values[k : k + 3]) for k in (0, 3))
            move = rows.text[0].to_numpy() if rows.text else None
            return Pairs(*place, rho, rho_prime, values.get("angle"), move)
        notation = next(n for n, names in NOTATIONS.items() if set(names) <= set(values))
        attitude = np.column_stack([values[name] for name in NOTATIONS[notation]])
        return Poses(*place, np.column_stack(rows.values[:3]), notation, attitude, values.get("t"))
