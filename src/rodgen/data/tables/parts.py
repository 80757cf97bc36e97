"""The parts of tables in many files, which together may be larger than memory.

A part is a stretch of rows of one Parquet file: some of its row groups. A few words say how it is read, so that another
process, or another computer that sees the files, can read it.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from glob import glob, has_magic
from typing import Any

from rodgen.data.tables._arrow import ParquetTable
from rodgen.data.tables.columns import MEASUREMENTS
from rodgen.errors import InputFileError, shown
from rodgen.files import open_input, unreadable

__all__ = ["Part", "is_many", "parts_of"]

PART_ROWS = 1 << 17
"""Small row groups are read together until they have so many rows: a task should take longer than its way there."""
MOST_PARTS = 512
"""And of very many rows so many that there are about as many parts."""
OPEN_AT_ONCE = 16
"""Files whose schemas are read at a time."""
SUFFIX = ".parquet"


@dataclass(frozen=True)
class Part:
    """A stretch of rows of one file.

    Attributes
    ----------
    number : int
        Of the part among all.
    file : str
        As messages name it.
    path : str
        As the file system names it.
    filesystem : pyarrow.fs.FileSystem or None
        None for files of this computer.
    groups : tuple of int, or None
        Row groups; None is all.
    rows : int
        How many rows they have.
    """

    number: int
    file: str
    path: str
    filesystem: Any
    groups: tuple[int, ...] | None
    rows: int

    def open(self, names: Collection[str] | None = None) -> ParquetTable:
        """Return the part as a table that is open for reading.

        Parameters
        ----------
        names : collection of str, optional
            Of the columns that are read, where the file has them, without units; left out, all.

        Raises
        ------
        InputFileError
            When it cannot be read; damage in a Parquet file is named by its row group.
        """
        expected, here = "a Parquet file", self.filesystem is None
        try:
            stream: Any = (
                open_input(self.path, expected) if here else self.filesystem.open_input_file(self.path)
            )
        except OSError as error:
            raise unreadable(self.file, error, expected) from None
        try:
            return ParquetTable(self.file, stream, MEASUREMENTS, self.groups, names)
        except BaseException:
            stream.close()
            raise


def is_many(text: str) -> bool:
    """Return whether the name of a file is rather that of many: a pattern, a folder, or an address."""
    return "://" in text or (not os.path.isfile(text) and (has_magic(text) or os.path.isdir(text)))


def parts_of(pattern: str) -> tuple[list[Part], list[str]]:
    """Return the parts of files, and the names of their columns, with units.

    Parameters
    ----------
    pattern : str
        As of `Measurements.scan`.

    Raises
    ------
    InputFileError
        When there is no such file, one cannot be read, or has other columns or units than the first.
    """
    filesystem, files = _files(pattern)
    if not files:
        what = "a folder without Parquet files" if os.path.isdir(pattern) else "no such file"
        raise InputFileError(pattern, "file", what, "Parquet files")
    wholes = [Part(0, file, path, filesystem, None, 0) for file, path in files]
    with ThreadPoolExecutor(OPEN_AT_ONCE) as pool:
        schemas = list(pool.map(_schema, wholes))
    first = schemas[0]
    least = max(PART_ROWS, sum(sum(schema.sizes) for schema in schemas) // MOST_PARTS)
    parts: list[Part] = []
    for whole, schema in zip(wholes, schemas, strict=True):
        _check_same(whole.file, schema, wholes[0].file, first)
        parts += [
            replace(whole, number=len(parts) + k, groups=groups, rows=sum(schema.sizes[g] for g in groups))
            for k, groups in enumerate(_together(schema.sizes, least))
        ]
    return parts, list(first.texts.values())


@dataclass(frozen=True)
class _Schema:
    texts: dict[str, str]  # by name, the name with the unit
    units: dict[str, str | None]  # None of a column of names
    sizes: list[int]  # of the row groups


def _schema(whole: Part) -> _Schema:
    with whole.open() as table:
        units: dict[str, str | None] = {m.name: m.unit for m in table.matches}
        texts = {m.index: (m.name, m.text) for m in (*table.matches, *table.text)}
        named = dict(texts[i] for i in sorted(texts))
        return _Schema(named, units | dict.fromkeys(m.name for m in table.text), table.group_rows)


def _together(sizes: Sequence[int], least: int) -> list[tuple[int, ...]]:
    """Return the numbers of row groups, small ones together.

    Examples
    --------
    >>> _together([200_000, 90_000, 90_000, 5, 0], 100_000)
    [(0,), (1, 2), (3, 4)]
    """
    groups: list[list[int]] = []
    rows = least
    for number, size in enumerate(sizes):
        if rows >= least:
            groups.append([])
            rows = 0
        groups[-1].append(number)
        rows += size
    return [tuple(numbers) for numbers in groups]


def _check_same(file: str, schema: _Schema, of: str, first: _Schema) -> None:
    """Refuse a file whose columns or units are others than those of the first."""
    for name, text in {**first.texts, **schema.texts}.items():
        if name not in schema.texts or name not in first.texts:
            has, lacks = (of, file) if name in first.texts else (file, of)
            raise InputFileError(lacks, "schema", f"no column {shown(text)}", f"it, as in {has}")
        if schema.units[name] != first.units[name]:
            found = f"unit {shown(schema.units[name])}" if schema.units[name] else "no unit"
            if schema.units[name] is None or first.units[name] is None:
                found = "names" if schema.units[name] is None else "numbers"
            place = f"schema, column {shown(schema.texts[name])}"
            raise InputFileError(file, place, found, f"{shown(first.texts[name])}, as in {of}")


def _files(pattern: str) -> tuple[Any, list[tuple[str, str]]]:
    """Return the file system, None for that of this computer, and names and paths of the files, in order."""
    if "://" not in pattern:
        names = glob(pattern, recursive=True) if has_magic(pattern) else [pattern]
        paths = sorted(path for name in names for path in _in_folder(name))
        return None, [(path, path) for path in paths if os.path.isfile(path)]
    return _remote_files(pattern)


def _in_folder(name: str) -> list[str]:
    if not os.path.isdir(name):
        return [name]
    return [entry.path for entry in os.scandir(name) if entry.name.endswith(SUFFIX)]


def _remote_files(pattern: str) -> tuple[Any, list[tuple[str, str]]]:
    import pyarrow as pa
    import pyarrow.fs as pafs

    scheme, _, rest = pattern.partition("://")
    before = rest[: min((rest.index(mark) for mark in "*?[" if mark in rest), default=len(rest))]
    folder = rest if before == rest else before.rpartition("/")[0]
    try:
        try:
            filesystem, base = pafs.FileSystem.from_uri(f"{scheme}://{folder}")
        except pa.ArrowInvalid:  # a scheme that Arrow does not know
            from fsspec.core import url_to_fs

            file_system, base = url_to_fs(f"{scheme}://{folder}")
            filesystem = pafs.PyFileSystem(pafs.FSSpecHandler(file_system))
        wanted = base + rest[len(folder) :]
        if filesystem.get_file_info(base).type == pafs.FileType.File:
            return filesystem, [(pattern, base)]
        entries = filesystem.get_file_info(pafs.FileSelector(base, recursive=wanted != base))
    except (ImportError, OSError, ValueError, pa.ArrowException) as error:
        reason = str(error).partition("\n")[0].rstrip(".")
        expected = "an address of files that can be read, and what reads it installed (fsspec)"
        raise InputFileError(pattern, "file", f"cannot be read ({reason})", expected) from None
    paths = sorted(
        entry.path
        for entry in entries
        if entry.type == pafs.FileType.File
        and (fnmatch(entry.path, wanted) if wanted != base else entry.path.endswith(SUFFIX))
    )
    return filesystem, [
        (f"{scheme}://{path.lstrip('/') if scheme != 'file' else path}", path) for path in paths
    ]
