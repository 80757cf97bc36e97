"""Which machine file belongs to which measurements: two folders, one machine file for all, or a table of pairs."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from rodgen.errors import InputFileError, listed, shown
from rodgen.files import decoded, read_input, unreadable

DATA = (".csv", ".csv.gz", ".parquet")
"""Endings of measurement files."""
_FOLDERS = "a folder of machine files (NAME.toml), a machine file, or a table with columns machine and data"


@dataclass(frozen=True)
class Pair:
    """A machine of the fleet.

    Attributes
    ----------
    name : str
    machine, data : str
        The files; empty where there is none.
    """

    name: str
    machine: str
    data: str


def pairs_of(machines: str, data: str | None) -> list[Pair]:
    """Return the machines of a fleet by name.

    Parameters
    ----------
    machines : str
        A folder of machine files, which have the names of their measurements; one machine file for all measurements;
        or, without `data`, a CSV file with the columns ``machine``, ``data`` and, where it is wanted, ``name``, whose
        files are relative to it.
    data : str or None
        A folder of measurement files.

    Raises
    ------
    InputFileError
        When there are none.
    """
    if data is None:
        if os.path.isdir(machines):
            raise InputFileError(
                machines, "file", "a folder", "a folder of measurements, too, or a table of pairs"
            )
        found = [*_of_table(machines)]
    elif os.path.isdir(machines):
        found = [*_matched(_files(machines, (".toml",)), _files(data, DATA))]
    elif not os.path.exists(machines):
        raise unreadable(machines, FileNotFoundError(), "a folder of machine files, or one machine file")
    else:
        files = _files(data, DATA)
        found = [Pair(name, machines, file) for name, file in sorted(files.items())]
    if not found:
        expected = f"measurements, {listed(DATA)}" if data else "a row for each machine"
        raise InputFileError(data or machines, "file", "no machine", expected)
    return found


def _files(folder: str, endings: Iterable[str]) -> dict[str, str]:
    """Return the files of a folder with some endings, by their names without them."""
    found: dict[str, str] = {}
    try:
        names = sorted(os.listdir(folder))
    except OSError as error:
        raise InputFileError(folder, "file", f"cannot be read ({error.strerror})", "a folder") from None
    for name in names:
        ending = next((e for e in sorted(endings, key=len, reverse=True) if name.endswith(e)), None)
        if ending is None or name.startswith("."):
            continue
        stem, file = name.removesuffix(ending), os.path.join(folder, name)
        if stem in found:
            raise InputFileError(file, "file", f"a second file of {shown(stem)}", "one file for each machine")
        found[stem] = file
    return found


def _matched(machines: Mapping[str, str], data: Mapping[str, str]) -> Iterator[Pair]:
    for name in sorted({*machines, *data}):
        yield Pair(name, machines.get(name, ""), data.get(name, ""))


def _of_table(file: str) -> Iterator[Pair]:
    text = decoded(read_input(file, _FOLDERS), file).removeprefix("\ufeff")
    rows = csv.reader(io.StringIO(text))
    try:
        header = [name.strip() for name in next(rows, [])]
        if not {"machine", "data"} <= {*header} <= {"machine", "data", "name"} or len({*header}) < len(
            header
        ):
            raise InputFileError(
                file, "line 1", shown(",".join(header)), "the columns machine, data and, where wanted, name"
            )
        folder, names = os.path.dirname(file), dict[str, int]()
        for row in rows:
            line = rows.line_num
            if not any(cell.strip() for cell in row):
                continue
            if len(row) != len(header):
                raise InputFileError(
                    file, f"line {line}", f"{len(row)} cells", f"{len(header)}, as in the header"
                )
            cells = dict(zip(header, (cell.strip() for cell in row), strict=True))
            machine, data = (os.path.join(folder, cells[k]) if cells[k] else "" for k in ("machine", "data"))
            name = cells.get("name") or _stem(data or machine)
            if name in names:
                found = f"{shown(name)}, as in line {names[name]}"
                raise InputFileError(file, f"line {line}", found, "another name, in a column name")
            names[name] = line
            yield Pair(name, machine, data)
    except csv.Error as error:
        raise InputFileError(
            file, f"line {rows.line_num}", f"not CSV ({error})", "a table of pairs"
        ) from None


def _stem(file: str) -> str:
    name = os.path.basename(file)
    ending = next((e for e in (".csv.gz", ".csv", ".parquet", ".toml") if name.endswith(e)), "")
    return name.removesuffix(ending)
