"""What a machine file says of the columns of other people's tables: ``[columns]``."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rodgen.errors import InputFileError, UnexpectedError, in_file, shown
from rodgen.machines.files.toml import NUMBER, TEXT, Table

_SOURCE = re.compile(
    r"(?P<sign>[-+]?)\s*(?P<name>.+?)\s*(?:\[(?P<unit>[^\[\]]*)\])?(?:\s+(?P<op>[-+])\s+(?P<offset>[\d.]+(?:[eE][-+]?\d+)?))?"
)
EXAMPLE = '"-A_axis [deg] + 90"'


@dataclass(frozen=True)
class ColumnSource:
    """Where a column of measurements comes from: sign times theirs, and an offset."""

    name: str
    """Of their column, without its unit."""
    unit: str = ""
    """Where theirs has none, or another; empty: as it says itself."""
    sign: float = 1.0
    offset: float = 0.0
    """In that unit."""


def column_source(text: str) -> ColumnSource:
    """Return what a text such as ``-A_axis [deg] + 90`` says.

    Raises
    ------
    UnexpectedError

    Examples
    --------
    >>> column_source("-A axis [deg] + 90")
    ColumnSource(name='A axis', unit='deg', sign=-1.0, offset=90.0)
    """
    found = _SOURCE.fullmatch(text.strip())
    if found is None:
        raise UnexpectedError(shown(text), f"a column of a table, such as {EXAMPLE}")
    offset = float(found["offset"] or 0) * (-1 if found["op"] == "-" else 1)
    sign = -1.0 if found["sign"] == "-" else 1.0
    return ColumnSource(found["name"], (found["unit"] or "").strip(), sign, offset)


def stated_columns(file: str, content: Mapping[str, Any]) -> dict[str, ColumnSource]:
    """Return what the table ``[columns]`` of a machine file says, by the names of measurements.

    Raises
    ------
    InputFileError
    """
    found = {}
    for name, entry in content.items():
        if isinstance(entry, str):
            with in_file(file, f"[columns], {shown(name)[1:-1]}"):
                found[name] = column_source(entry)
            continue
        if not isinstance(entry, dict):
            raise InputFileError(
                file, f"[columns], {shown(name)[1:-1]}", "no text and no table", f"a text such as {EXAMPLE}"
            )
        table = Table(file, f"[columns], {name}", entry, ("from", "unit", "sign", "offset"))
        sign = table.get("sign", NUMBER, 1.0)
        if abs(sign) != 1.0 or not math.isfinite(sign):
            raise table.error("sign", f"{sign:g}", "1 or -1")
        found[name] = ColumnSource(
            table.get("from", TEXT), table.get("unit", TEXT, ""), sign, table.get("offset", NUMBER, 0.0)
        )
    return found
