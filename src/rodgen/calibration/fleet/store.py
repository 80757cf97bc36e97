"""The results of a fleet in a folder: what it consists of, and one file for each machine.

``fleet.json`` says which machines there are, when they were measured, and with which earlier results they are compared;
``machines/NAME.json`` is the result of one. Each file is complete or not there. A result names the contents of the
files that it was made from: what has not changed is not made again.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any
from urllib.parse import quote

from rodgen.errors import InputFileError
from rodgen.files import make_folder, read_input, write_file
from rodgen.views import to_json

PLAN, MACHINES = "fleet.json", "machines"
FORMAT = 2
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
    machines : tuple of str
        Their names.
    """

    date: str
    false_alarms: float
    history: tuple[str, ...]
    machines: tuple[str, ...]


RMS = "rms"
"""Key of the error that the model with all effects leaves, which is compared like a parameter."""


@dataclass(frozen=True, eq=False)
class FleetMachine:
    """A machine of a fleet, and its result.

    Attributes
    ----------
    name : str
    result : mapping
        As of ``rodgen diagnose --json``, with ``"fleet"``; or with ``"error"``. Empty until it is diagnosed.
    """

    name: str
    result: Mapping[str, Any]

    @property
    def error(self) -> str:
        """Why it could not be diagnosed: a sentence; empty where it was, or was not yet."""
        return str(self.result.get("error", ""))

    @property
    def model(self) -> str:
        """The content of its machine file, by the hash."""
        return str(self.result["key"]["sha256"]["machine"])

    @property
    def kind(self) -> str:
        """What it has in common with machines of one design: joints, effects of the file, and what is measured."""
        return str(self.result["fleet"]["kind"])

    @property
    def found(self) -> list[str]:
        """Titles of the effects that were found."""
        return [title_of(step["effect"], step["joint"]) for step in self.result["steps"]]

    @property
    def alike(self) -> dict[str, list[str]]:
        """By the titles of effects that were found, those of others that its data cannot tell from them."""
        return {
            title_of(step["effect"], step["joint"]): [
                title_of(**alias["effects"][0])
                for alias in step["indistinguishable_from"]
                if len(alias["effects"]) == 1
            ]
            for step in self.result["steps"]
        }

    def estimates(self, which: str = "with_found") -> dict[str, tuple[float, float, str]]:
        """Return values, standard deviations and units by key; "with_found" or "as_file" says of which model."""
        estimates = {key: tuple(each) for key, each in self.result["fleet"][which]["values"].items()}
        if which == "with_found":
            rms = self.result["rms"]
            dof = self.result["fleet"]["residual_dof"]
            if rms["after"] and dof > 0:
                estimates[RMS] = rms["after"], rms["after"] / math.sqrt(2 * dof), rms["unit"]
        return estimates

    @property
    def degrees_of_freedom(self) -> float:
        """With which the standard deviations are known; infinite where the noise is stated."""
        found = self.result["fleet"]["degrees_of_freedom"]
        return math.inf if found is None else float(found)


def title_of(effect: str, joint: str | None) -> str:
    """Return an effect and its place."""
    return f"{effect} at {joint}" if joint else effect


def write_plan(folder: str, plan: Plan) -> None:
    """Write what a fleet consists of; folders are named relative to the folder."""
    history = [_relative(each, folder) for each in plan.history]
    _write(os.path.join(folder, PLAN), {"format": FORMAT, **asdict(plan), "history": history})


def _relative(file: str, folder: str) -> str:
    with contextlib.suppress(ValueError):  # another drive
        return os.path.relpath(file, folder)
    return os.path.abspath(file)


def read_plan(folder: str) -> Plan:
    """Return what a fleet consists of.

    Raises
    ------
    InputFileError
        When the folder has no results of a fleet.
    """
    file = os.path.join(folder, PLAN)
    content = _read(file)
    try:
        history = tuple(os.path.normpath(os.path.join(folder, each)) for each in content["history"])
        machines = tuple(map(str, content["machines"]))
        return Plan(str(content["date"]), float(content["false_alarms"]), history, machines)
    except (LookupError, TypeError, ValueError):
        raise InputFileError(file, "file", "no fleet", _EXPECTED) from None


def result_file(folder: str, name: str) -> str:
    """Return the file of the result of a machine."""
    return os.path.join(folder, MACHINES, f"{quote(name, safe=' ()+,=@')}.json")


def read_result(folder: str, name: str) -> dict[str, Any] | None:
    """Return the result of a machine; None where there is none, or none that this version wrote."""
    try:
        content = _read(result_file(folder, name))
        known = content["key"]["format"] == FORMAT and not {"error", "fleet"}.isdisjoint(content)
    except (InputFileError, LookupError, TypeError):
        return None
    return content if known else None


def write_result(folder: str, name: str, result: Mapping[str, Any]) -> None:
    """Write the result of a machine: all of it, or nothing."""
    place = result_file(folder, name)
    make_folder(os.path.dirname(place))
    _write(place, result)


def _read(file: str) -> dict[str, Any]:
    content = read_input(file, _EXPECTED, largest=LARGEST)
    try:
        parsed = json.loads(content)
    except (ValueError, RecursionError):
        parsed = None
    if not isinstance(parsed, dict):
        raise InputFileError(file, "file", "no JSON object", _EXPECTED)
    return parsed


def _write(file: str, content: Mapping[str, Any]) -> None:
    write_file(file, f"{to_json(content)}\n".encode())
