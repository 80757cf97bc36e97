"""Measurements: a table as it was written, each column in its own unit, each row with its place in the file.

`rodgen.calibration.problem.binding.bind` checks it against a machine and converts it to internal units. The reference
of file formats describes the columns. Whatever is wrong is a :class:`rodgen.errors.InputFileError`, one sentence with
the file, the line and the column.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.data.tables import open_csv, open_frame, open_table
from rodgen.data.tables.columns import MEASUREMENTS
from rodgen.data.tables.parts import Part, parts_of
from rodgen.data.tables.table import Table, places_of, row_place, values_of
from rodgen.data.units import UnitError, parse_unit
from rodgen.errors import InputFileError, counted, shown
from rodgen.views import data_frame, shown_table

__all__ = ["UNNAMED", "Measurements", "Names", "Numbers", "Places", "Scan", "plain_name"]

UNNAMED = "data"
"""Name of a table in memory that was given none: it tells no table from another."""


@dataclass(frozen=True, eq=False)
class Numbers:
    """A column of numbers.

    Attributes
    ----------
    name : str
    unit : str or None
        As it was written, in brackets; None where there was none.
    values : ndarray of float64, shape (rows,)
        Finite, in that unit; read-only.
    """

    name: str
    unit: str | None
    values: NDArray[np.float64]

    @property
    def text(self) -> str:
        """The column's name with its unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def take(self, rows: Any) -> Numbers:
        """Return some of the rows: a mask, indices or a slice."""
        return Numbers(self.name, self.unit, self.values[rows])

    def after(self, before: Any) -> Numbers:
        """Return the rows of another such column, then these."""
        return Numbers(self.name, self.unit, np.concatenate([before.values, self.values]))


@dataclass(frozen=True, eq=False)
class Names:
    """A column of names: ``target`` or ``run``.

    A whole number is the same name however it is written: ``1`` and ``1.0`` are one run, because a table of numbers
    does not keep the difference.

    Attributes
    ----------
    name : str
    codes : ndarray of int32, shape (rows,)
        Of each row, the index of its name in `names`.
    names : tuple of str
        Each once, in the order in which they first occur.
    unit : None
    """

    name: str
    codes: NDArray[np.int32]
    names: tuple[str, ...]
    unit: None = None

    @property
    def text(self) -> str:
        """The column's name."""
        return self.name

    @property
    def values(self) -> NDArray[np.str_]:
        """The name of each row, as a new array."""
        return np.array(self.names, np.str_)[self.codes]

    def take(self, rows: Any) -> Names:
        """Return some of the rows: a mask, indices or a slice."""
        return Names(self.name, self.codes[rows], self.names)

    def after(self, before: Any) -> Names:
        """Return the rows of another such column, then these."""
        names = {name: i for i, name in enumerate(dict.fromkeys([*before.names, *self.names]))}
        new = np.array([names[name] for name in self.names], np.int32)[self.codes]
        return Names(self.name, np.concatenate([before.codes, new]).astype(np.int32), tuple(names))


@dataclass(frozen=True, eq=False)
class Places:
    """The place of each row in the file, from stretches of rows without an empty line between them.

    Attributes
    ----------
    counted : str
        ``"line"`` or ``"row"``.
    first, number : ndarray of int
        Row at which each stretch begins, and the number of its place.
    """

    counted: str
    first: NDArray[np.int64]
    number: NDArray[np.int64]

    def numbers(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the numbers of the places of rows."""
        stretch = np.searchsorted(self.first, rows, "right") - 1
        return np.asarray(rows - self.first[stretch] + self.number[stretch])


@dataclass(frozen=True, eq=False, repr=False)
class Measurements:
    """A table of measurements: what was commanded, what was read, and what else was noted.

    Made by :meth:`load` or :meth:`from_frame`, which read a table whole; of more rows than memory holds, see
    :meth:`scan`.

    Attributes
    ----------
    file : str
        The file as the user named it, or the name given to the frame.
    rows : int
    columns : mapping of str to Numbers or Names
        By name, in the file's order; ``target`` and ``run`` are `Names`.
    header_place : str
        Where the columns' names stand, for messages.
    """

    file: str
    rows: int
    columns: Mapping[str, Numbers | Names]
    header_place: str
    _places: Places
    _row_in_file: range | NDArray[np.int64]

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Measurements:
        r"""Return the measurements of a file.

        Parameters
        ----------
        path : str or os.PathLike
            CSV (UTF-8, gzip or not) or Parquet, with units in brackets in the columns' names; ``"-"`` is CSV on
            standard input. Empty lines are skipped, columns without a name not read.

        Returns
        -------
        Measurements
            Without rows if there is only a header.

        Raises
        ------
        InputFileError
            When it cannot be read, a unit is unknown, or a cell is not a finite number. The columns ``target`` and
            ``run`` hold names, and so may columns without a unit that begin with a word; those are kept, but not used
            in a fit.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> path = pathlib.Path(tempfile.mkdtemp(), "data.csv")
        >>> _ = path.write_text("C [deg],target,d [mm]\n0,ball,100.002\n90,ball,100.004\n")
        >>> data = Measurements.load(path)
        >>> data.columns["C"].unit, data.columns["C"].values, data.place(1)
        ('deg', array([ 0., 90.]), 'line 3')
        """
        with open_table(path, MEASUREMENTS) as table:
            return cls._read(table)

    @classmethod
    def scan(cls, pattern: str | os.PathLike[str]) -> Scan:
        """Return the measurements of many files, which are read only where and when their rows are needed.

        Parameters
        ----------
        pattern : str or os.PathLike
            Such as ``"week/*.parquet"``, a folder, or an address such as ``"s3://bucket/week/*.parquet"``: Parquet
            files.

        Returns
        -------
        Scan
            For `fit`, `compare`, `diagnose` and `predict`.

        Raises
        ------
        InputFileError
            When there is no such file, one cannot be read, or has other columns or units than the first.
        """
        return Scan.of(pattern)

    @classmethod
    def from_lines(cls, header: bytes, lines: bytes, first: int, *, name: str) -> Measurements:
        """Return the measurements of some whole lines of a CSV file.

        Parameters
        ----------
        header : bytes
            The line with the columns' names.
        lines : bytes
        first : int
            Number of the first of them in the file, from 1.
        name : str
            Of the file.

        Raises
        ------
        InputFileError
            As :meth:`load`.
        """
        stream = io.BytesIO(header.rstrip(b"\r\n") + b"\n" + lines)
        try:
            with open_csv(name, stream, MEASUREMENTS) as table:
                measurements = cls._read(table)
        except InputFileError as error:
            line = re.match(r"line (\d+)", error.place)
            if not line or line[1] == "1":
                raise
            place = f"line {int(line[1]) + first - 2}{error.place[line.end() :]}"
            raise InputFileError(name, place, error.found, error.expected) from None
        before = measurements._places
        return replace(measurements, _places=replace(before, number=before.number + (first - 2)))

    @classmethod
    def of(cls, data: Any) -> Measurements:
        """Return measurements as they are, and those of a table in memory as :meth:`from_frame` does."""
        if isinstance(data, Scan):
            raise InputFileError(data.file, "file", "many files", "one, as this is not done in parts")
        return data if isinstance(data, cls) else cls.from_frame(data)

    @classmethod
    def from_frame(cls, frame: Any, *, name: str = UNNAMED) -> Measurements:
        """Return the measurements of a table in memory; its numbers are copied.

        Parameters
        ----------
        frame : mapping, DataFrame, Dataset, structured array or Arrow table
            From names with units in brackets to sequences: a dict, a pandas or Polars DataFrame, an Arrow table, a
            structured array of NumPy. The index of a pandas DataFrame counts where it has a name. A Dataset of xarray
            has a row for each combination of its dimensions; its units may be in brackets or in ``attrs["units"]``.
        name : str
            Name of the table in messages.

        Returns
        -------
        Measurements

        Raises
        ------
        InputFileError
            As :meth:`load`, with the row instead of the line.

        Examples
        --------
        >>> data = Measurements.from_frame({"C [deg]": [0, 90], "d [mm]": [100.002, 100.004]})
        >>> data
        Measurements('data', 2 rows: C [deg], d [mm])
        """
        with open_frame(frame, MEASUREMENTS, name) as table:
            return cls._read(table)

    @classmethod
    def _read(cls, table: Table) -> Measurements:
        _check_units(table)
        rows = table.read(empty=True)
        columns: dict[int, Numbers | Names] = {}
        for match, values in zip(table.matches, rows.values, strict=True):
            columns[match.index] = Numbers(match.name, match.unit or None, _read_only(values))
        for match, names in zip(table.text, rows.text, strict=True):
            coded = names.dictionary_encode().combine_chunks()
            index: dict[str, int] = {}
            written = map(plain_name, coded.dictionary.to_pylist())
            codes = np.array([index.setdefault(name, len(index)) for name in written], np.int32)
            columns[match.index] = Names(
                match.name, _read_only(codes[values_of(coded.indices)]), tuple(index)
            )
        first = np.flatnonzero(np.diff(rows.numbers, prepend=-2) != 1)
        places = Places(table.counted, first, rows.numbers[first])
        ordered = {columns[i].name: columns[i] for i in sorted(columns)}
        count = len(rows.numbers)
        return cls(table.file, count, ordered, table.header, places, range(count))

    def place(self, row: int) -> str:
        """Return the place of a row in the file: ``"line 17"`` in a CSV file, else ``"row 16 (from 0)"``.

        Parameters
        ----------
        row : int
            From 0.
        """
        return row_place(self._places.counted, self.numbers([row]).tolist())

    def places(self, rows: Sequence[int] | NDArray[np.int_]) -> str:
        """Return the places of rows with the file's name, such as ``"lines 17, 18 and 40 of stars.csv"``.

        Parameters
        ----------
        rows : sequence of int
            From 0, one at least; of many only the first are named, and the others counted.
        """
        return places_of(self.file, self.counted, rows, self.numbers)

    def numbers(self, rows: Sequence[int] | NDArray[np.int_]) -> NDArray[np.int64]:
        """Return the numbers of rows that `place` shows: lines of a CSV file from 1, else rows from 0.

        Parameters
        ----------
        rows : sequence of int
            From 0.
        """
        of, index = self._row_in_file, np.asarray(rows, np.int64)
        return self._places.numbers(of.start + of.step * index if isinstance(of, range) else of[index])

    @property
    def counted(self) -> str:
        """What `numbers` are: ``"line"``, or ``"row"``."""
        return self._places.counted

    def take(self, rows: Any) -> Measurements:
        """Return some of the rows, which keep their places in the file.

        Poses and directions of approach follow from the order of the rows: to keep them, take rows of the observations.

        Parameters
        ----------
        rows : ndarray of bool or int, or slice
            A mask, indices or a slice; a slice copies nothing.
        """
        columns = {name: column.take(rows) for name, column in self.columns.items()}
        before = self._row_in_file
        if isinstance(before, range) and not isinstance(rows, slice):
            before = np.arange(before.start, before.stop, before.step)
        row_in_file = before[rows]
        count = len(row_in_file)
        return Measurements(self.file, count, columns, self.header_place, self._places, row_in_file)

    def after(self, before: Measurements) -> Measurements:
        """Return the rows of other measurements, with the same columns, then these; each keeps its place."""
        columns = {name: column.after(before.columns[name]) for name, column in self.columns.items()}
        both = replace(self, rows=before.rows + self.rows, columns=columns)
        return both.placed(np.concatenate([part.numbers(np.arange(part.rows)) for part in (before, self)]))

    def placed(self, numbers: Sequence[int] | NDArray[np.int64], counted: str = "") -> Measurements:
        """Return the measurements with other numbers of their rows, for `place`, and what these count."""
        places = Places(counted or self.counted, np.arange(self.rows), np.asarray(numbers, np.int64))
        return replace(self, _places=places, _row_in_file=range(self.rows))

    def to_pandas(self) -> Any:
        """Return the columns, named with their units, as a DataFrame."""
        return data_frame(self._by_text())

    def _by_text(self) -> dict[str, NDArray[Any]]:
        return {column.text: column.values for column in self.columns.values()}

    def _repr_html_(self) -> str:
        first = self.take(slice(0, 10))._by_text()
        return shown_table(lambda _: first, min(self.rows, 10), repr(self))._repr_html_()

    def __repr__(self) -> str:
        names = ", ".join(column.text for column in self.columns.values())
        return f"Measurements({self.file!r}, {counted(self.rows, 'row')}: {names})"


@dataclass(frozen=True, eq=False, repr=False)
class Scan:
    """Measurements that are read when they are needed; `Measurements.scan` makes it.

    Rows are in the order of the files by name, and in each as they stand there.

    Attributes
    ----------
    file : str
        What was asked for.
    parts : tuple of Part
    columns : tuple of str
        Names of the columns with their units, of every file.
    """

    file: str
    parts: tuple[Part, ...]
    columns: tuple[str, ...]

    @classmethod
    def of(cls, pattern: str | os.PathLike[str]) -> Scan:
        """Return the measurements of files, after a look at the schema of each; see `Measurements.scan`."""
        file = os.fspath(pattern)
        parts, columns = parts_of(file)
        return cls(file, tuple(parts), tuple(columns))

    @staticmethod
    def load(part: Part, names: Collection[str] | None = None) -> Measurements:
        """Return the rows of a part, of all columns or of those of some names; see `Part.open`."""
        with part.open(names) as table:
            return Measurements._read(table)

    @cached_property
    def empty(self) -> Measurements:
        """The columns without rows, by which they are checked before anything is read."""
        return self.load(replace(self.parts[0], file=self.file, groups=()))

    def whole(self) -> Measurements:
        """Return all rows as one table in memory."""
        tables = [self.load(part) for part in self.parts]
        return self.joined(tables, np.arange(self.rows))

    def joined(self, tables: Sequence[Measurements], rows: NDArray[np.int64]) -> Measurements:
        """Return some rows of the scan as one table.

        Parameters
        ----------
        tables : sequence of Measurements
            One at least.
        rows : ndarray of int, shape (n,)
            The number of each row among all rows of the scan; messages show it.
        """
        columns: dict[str, Numbers | Names] = {}
        for name, column in tables[0].columns.items():
            every = [table.columns[name] for table in tables]
            if isinstance(column, Numbers):
                columns[name] = Numbers(
                    name, column.unit, _read_only(np.concatenate([c.values for c in every]))
                )
                continue
            names, codes = np.unique(np.concatenate([c.values for c in every]), return_inverse=True)
            columns[name] = Names(name, _read_only(codes.astype(np.int32)), tuple(names.tolist()))
        places = Places("row", np.arange(len(rows)), rows)
        return Measurements(self.file, len(rows), columns, "schema", places, range(len(rows)))

    @property
    def rows(self) -> int:
        """Number of rows."""
        return sum(part.rows for part in self.parts)

    def __repr__(self) -> str:
        files = len({part.path for part in self.parts})
        return f"Scan({self.file!r}, {counted(files, 'file')}: {', '.join(self.columns)})"


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array


def _check_units(table: Table) -> None:
    for match in table.matches:
        if match.unit:
            try:
                parse_unit(match.unit)
            except UnitError as error:
                place = f"{table.header}, column {shown(match.text)}"
                raise InputFileError(table.file, place, error.found, error.expected) from None


def plain_name(name: str) -> str:
    """Return a name in a form in which a whole number is the same name however it is written.

    A run that was noted as 1 reads 1.0 once a table of numbers has held it.

    Examples
    --------
    >>> plain_name("1.0"), plain_name("01"), plain_name("1.5"), plain_name("ball_1")
    ('1', '01', '1.5', 'ball_1')
    """
    whole = re.fullmatch(r"([+-]?\d+)\.0*", name)
    return whole[1] if whole else name
