"""The results of a fleet in a folder: what it consists of, and one file for each machine.

``fleet.json`` says which machines there are, when they were measured, and with which earlier results they are compared;
``machines/NAME.json`` is the result of one. Each file is complete or not there. A result names the contents of the
files that it was made from: what has not changed is not made again.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any
from urllib.parse import quote

from rodgen.calibration.fleet.pairs import Pair
from rodgen.errors import InputFileError
from rodgen.files import make_folder, read_input, write_file
from rodgen.views import finite

PLAN, MACHINES = "fleet.json", "machines"
FORMAT = 1
"""Of a result; those of another one are made anew."""
LARGEST = 50_000_000
_EXPECTED = "results of 'rodgen fleet'"


@dataclass(frozen=True)
class Plan:
    """What a fleet consists of.

    Attributes
    ----------
    date : str
        When it was measured: ``YYYY-MM-DD``, or with a time.
    false_alarms : float
        For the whole fleet, a year.
    history : tuple of str
        Folders of earlier results.
    pairs : tuple of Pair
    """

    date: str
    false_alarms: float
    history: tuple[str, ...]
    pairs: tuple[Pair, ...]


def write_plan(folder: str, plan: Plan) -> None:
    """Write what a fleet consists of; files are named relative to the folder."""
    text = asdict(plan) | {
        "history": [_relative(each, folder) for each in plan.history],
        "pairs": [
            {"name": p.name, "machine": _relative(p.machine, folder), "data": _relative(p.data, folder)}
            for p in plan.pairs
        ],
    }
    _write(os.path.join(folder, PLAN), {"format": 1, **text})


def _relative(file: str, folder: str) -> str:
    with contextlib.suppress(ValueError):  # another drive
        return os.path.relpath(file, folder) if file else ""
    return os.path.abspath(file)


def read_plan(folder: str) -> Plan:
    """Return what a fleet consists of.

    Raises
    ------
    InputFileError
        When the folder has no results of a fleet.
    """
    file = os.path.join(folder, PLAN)
    found = _read(file)
    try:

        def place(name: str) -> str:
            return os.path.normpath(os.path.join(folder, name)) if name else ""

        pairs = tuple(
            Pair(str(p["name"]), place(str(p["machine"])), place(str(p["data"]))) for p in found["pairs"]
        )
        history = tuple(place(str(each)) for each in found["history"])
        return Plan(str(found["date"]), float(found["false_alarms"]), history, pairs)
    except (LookupError, TypeError, ValueError, AttributeError):
        raise InputFileError(file, "file", "no fleet", _EXPECTED) from None


def result_file(folder: str, name: str) -> str:
    """Return the file of the result of a machine."""
    return os.path.join(folder, MACHINES, f"{quote(name, safe=' ()+,=@')}.json")


def read_result(folder: str, name: str) -> dict[str, Any] | None:
    """Return the result of a machine; None where there is none, or none that this version wrote."""
    try:
        found = _read(result_file(folder, name))
        known = found["key"]["format"] == FORMAT and not {"error", "fleet"}.isdisjoint(found)
    except (InputFileError, LookupError, TypeError):
        return None
    return found if known else None


def write_result(folder: str, name: str, result: Mapping[str, Any]) -> None:
    """Write the result of a machine: all of it, or nothing."""
    place = result_file(folder, name)
    make_folder(os.path.dirname(place))
    _write(place, result)


def _read(file: str) -> dict[str, Any]:
    content = read_input(file, _EXPECTED, largest=LARGEST)
    try:
        found = json.loads(content)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise InputFileError(file, "file", "no JSON object", _EXPECTED)
    return found


def _write(file: str, content: Mapping[str, Any]) -> None:
    write_file(file, (json.dumps(finite(content), ensure_ascii=False) + "\n").encode())
