"""A mechanism as a table for reading and typing: a row for each joint, with the link after it.

    joint,type,S [mm],theta [deg],pitch [mm/rad],a [mm],alpha [deg]
    base,R,0,,,120,90
    slide,P,,30,,0,-90
    tool,R,15.5,,,,

A cell is empty where the joint has its variable, or where there is nothing: the link after the last joint of an open
chain. With the last link given the loop is closed. Errors of the reader name line and column.
"""

from __future__ import annotations

import csv
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rodgen.errors import InputFileError, in_file, shown
from rodgen.files import decoded, read_input
from rodgen.kinematics.spatial.mechanism import FREEDOMS, Mechanism

_EXAMPLE = "joint,type,S [mm],theta [deg],pitch [mm/rad],a [mm],alpha [deg]"
_COLUMNS = {"joint": "", "type": "", "S": "mm", "theta": "deg", "pitch": "mm/rad", "a": "mm", "alpha": "deg"}
_NEEDED = ("type", "a", "alpha")


@dataclass(frozen=True)
class _Field:
    """A column of the file: its place, its header, and the factor to the mechanism's units."""

    index: int
    header: str
    factor: float
    degrees: bool = False


def _text(file: str) -> str:
    content = read_input(file, "a link table (CSV)", "a link table: a row for each joint")
    text = decoded(content, file).removeprefix("\ufeff")
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise InputFileError(file, f"line {line}", "a zero byte", "a link table (CSV)")
    return text


def _rows(file: str, text: str) -> list[tuple[int, list[str]]]:
    """Return each line that has something on it: its number, and its cells without the blanks around them."""
    rows = []
    for number, line in enumerate(re.split("\r\n|\n|\r", text), 1):
        if not line.strip():
            continue
        try:
            cells = next(csv.reader([line], strict=True, skipinitialspace=True))
        except csv.Error:
            raise InputFileError(
                file, f"line {number}", shown(line), "cells between commas, quotes in pairs"
            ) from None
        rows.append((number, [cell.strip() for cell in cells]))
    if not rows:
        raise InputFileError(file, "file", "an empty file", f"a header such as {_EXAMPLE}")
    return rows


def _fields(file: str, place: str, header: Sequence[str]) -> tuple[dict[str, _Field], str]:
    """Return the columns by name, and the unit of length."""
    if len(header) == 1 and (mark := next((m for m in ";\t|" if m in header[0]), None)):
        what = {";": "semicolons", "\t": "tabs", "|": "bars"}[mark]
        raise InputFileError(file, place, f"{what} between the columns", f"commas: {_EXAMPLE}")
    fields: dict[str, _Field] = {}
    unit = ""
    for index, text in enumerate(header):
        match = re.fullmatch(r"(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?", text)
        name = match["name"] if match else text
        if name not in _COLUMNS:
            what = shown(text) if text else f"column {index + 1} without a name"
            raise InputFileError(file, place, what, f"columns of {_EXAMPLE}")
        where = f"{place}, column {shown(text)}"
        if name in fields:
            raise InputFileError(file, where, f"column {name!r} twice", "it once")
        unit_text = (match["unit"] or "").strip() if match else ""
        example = f"'{name} [{_COLUMNS[name]}]'" if _COLUMNS[name] else f"'{name}'"
        if bool(unit_text) != bool(_COLUMNS[name]):
            what = "no unit" if not unit_text else f"the unit {shown(unit_text)}"
            raise InputFileError(file, where, what, example)
        factor = 1.0
        if name in ("S", "a"):
            unit = unit or unit_text
            factor = _factor(file, where, unit_text, "length", unit)
        elif name in ("theta", "alpha"):
            factor = _factor(file, where, unit_text, "angle", "rad")
        fields[name] = _Field(index, text, factor, unit_text == "deg")
    for name in _NEEDED:
        if name not in fields:
            raise InputFileError(file, place, f"no column {name!r}", f"a header such as {_EXAMPLE}")
    if "pitch" in fields:
        fields["pitch"] = _pitch_field(file, place, fields["pitch"], unit)
    return fields, unit


def _pitch_field(file: str, place: str, field: _Field, unit: str) -> _Field:
    where = f"{place}, column {shown(field.header)}"
    unit_text = field.header.partition("[")[2].rstrip("] ")
    length, mark, angle = unit_text.rpartition("/")
    if not mark:
        raise InputFileError(
            file, where, f"the unit {shown(unit_text)}", "a length per angle, such as 'pitch [mm/rev]'"
        )
    top = _factor(file, where, length.strip(), "length", unit)
    bottom = _factor(file, where, angle.strip(), "angle", "rad")
    return _Field(field.index, field.header, top / bottom)


def _factor(file: str, where: str, unit: str, quantity: str, target: str) -> float:
    from rodgen.data.units import conversion_factor

    with in_file(file, where):
        unit = "turn" if unit == "rev" else unit  # Pint's name of a revolution
        return conversion_factor(unit, quantity, target)  # type: ignore[arg-type]


class _Row:
    """The row of one joint."""

    def __init__(self, file: str, line: int, cells: Sequence[str], fields: dict[str, _Field]) -> None:
        self.file, self.line, self.cells, self.fields = file, line, cells, fields
        self.kind = self.text("type")
        if self.kind not in FREEDOMS:
            upper = self.kind.upper()
            wanted = upper if upper in FREEDOMS else f"a joint's type, one of {', '.join(FREEDOMS)}"
            raise self.error("type", shown(self.kind) if self.kind else "an empty cell", wanted)

    def text(self, name: str) -> str:
        field = self.fields.get(name)
        return self.cells[field.index] if field and field.index < len(self.cells) else ""

    def error(self, name: str, found: str, expected: str) -> InputFileError:
        header = self.fields[name].header if name in self.fields else name
        return InputFileError(self.file, f"line {self.line}, column {shown(header)}", found, expected)

    def number(self, name: str) -> float:
        text, field = self.text(name), self.fields[name]
        try:
            if "_" in text:  # Python's own "1_000"
                raise ValueError
            value = float(text)
        except ValueError:
            wanted = "a decimal point" if re.fullmatch(r"[-+]?\d+,\d+", text) else "a number"
            raise self.error(name, shown(text), wanted) from None
        if not math.isfinite(value):
            raise self.error(name, shown(text), "a finite number")
        return math.radians(value) if field.degrees else value * field.factor

    def constant(self, name: str, varies: bool) -> float:
        """Return a joint's constant; NaN where it is the variable."""
        text = self.text(name)
        if varies:
            if text:
                raise self.error(name, shown(text), f"an empty cell: {name} varies in a joint {self.kind}")
            return math.nan
        if text:
            return self.number(name)
        if name in self.fields:
            raise self.error(name, "an empty cell", f"a number: {name} is constant in a joint {self.kind}")
        return 0.0


def _mechanism(file: str, table: Sequence[_Row], unit: str) -> Mechanism:
    last = table[-1]
    closed = bool(last.text("a") or last.text("alpha"))
    a: list[float] = []
    alpha: list[float] = []
    for row in table if closed else table[:-1]:
        for name, values in (("a", a), ("alpha", alpha)):
            if not row.text(name):
                expected = (
                    "the other number of the link" if row is last else "a number of the link after the joint"
                )
                raise row.error(name, "an empty cell", expected)
            values.append(row.number(name))
    kinds = [row.kind for row in table]
    # Which of a joint's numbers vary is known to Mechanism: it puts NaN there.
    blank = Mechanism(
        kinds, np.zeros(len(kinds)), np.zeros(len(kinds)), pitch=[float(k == "H") for k in kinds]
    )
    offset = [row.constant("S", math.isnan(x)) for row, x in zip(table, blank.offset, strict=True)]
    angle = [row.constant("theta", math.isnan(x)) for row, x in zip(table, blank.angle, strict=True)]
    pitch = [_pitch(row) for row in table]
    name, names = Path(file).stem, _names(table)
    return Mechanism(kinds, a, alpha, offset, angle, pitch, unit=unit, name=name, names=names)


def _pitch(row: _Row) -> float:
    text = row.text("pitch")
    if row.kind != "H":
        if text and row.number("pitch"):
            raise row.error("pitch", shown(text), f"an empty cell: a joint {row.kind} is not a screw")
        return 0.0
    value = row.number("pitch") if text else 0.0
    if not value:
        found = shown(text) if text else "an empty cell" if "pitch" in row.fields else "no such column"
        raise row.error("pitch", found, "the length per angle of a joint H, not zero")
    return value


def _names(table: Sequence[_Row]) -> list[str]:
    names: list[str] = []
    for number, row in enumerate(table, 1):
        name = row.text("joint") or f"{row.kind}{number}"
        if "[" in name or "]" in name:
            raise row.error("joint", shown(name), "no brackets: tables have units in them")
        if name in names:
            raise row.error("joint", f"a second joint called {shown(name)}", "a name of its own for each")
        names.append(name)
    return names


def load_mechanism(path: str | os.PathLike[str]) -> Mechanism:
    r"""Return the mechanism of a link table.

    Parameters
    ----------
    path : str or os.PathLike
        CSV (UTF-8, commas, decimal points) with the columns ``joint,type,S [mm],theta [deg],pitch [mm/rad],a [mm],
        alpha [deg]`` in any order and with any units; a pitch may be per revolution, ``pitch [mm/rev]``. `type` is R,
        P, C, H, E, T or S. An empty cell is a variable of the joint; `a` and `alpha` are of the link after the joint
        and empty after the last joint of an open chain. The columns `joint` (names), `S`, `theta` and `pitch` may be
        left out: a constant is then zero.

    Returns
    -------
    Mechanism
        Lengths in the unit of the first length column; its name is the file's, without the ending.

    Raises
    ------
    InputFileError
        When the file cannot be read or is not a link table: one sentence with line and column.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from rodgen import spatial
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "planar.csv")
    ...     _ = path.write_text("type,S [in],a [in],alpha [deg]\nR,0,17,0\nR,5.9,,\n")
    ...     arm = spatial.load_mechanism(path)
    >>> arm.name, arm.unit, arm.a.tolist(), arm.offset.tolist()
    ('planar', 'in', [17.0], [0.0, 5.9])
    """
    file = os.fspath(path)
    (place, header), *rows = _rows(file, _text(file))
    fields, unit = _fields(file, f"line {place}", header)
    if not rows:
        raise InputFileError(file, f"line {place + 1}", "no joints", "a row for each")
    table = []
    for line, cells in rows:
        if len(cells) > len(header):
            found = f"{len(cells)} cells under {len(header)} columns"
            raise InputFileError(file, f"line {line}", found, "a cell for each column")
        table.append(_Row(file, line, cells, fields))
    return _mechanism(file, table, unit)
