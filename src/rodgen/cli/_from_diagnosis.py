"""Read the effects of a diagnosis from the output of ``rodgen diagnose --json``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from rodgen.cli._console import refused
from rodgen.errors import InputFileError, shown
from rodgen.files import read_input

if TYPE_CHECKING:
    from rodgen.data.set_aside import SetAside
    from rodgen.machines.machine import Effect, Machine

LARGEST = 50_000_000
_EXPECTED = "a diagnosis, as 'rodgen diagnose --json' writes it"
_NONE = {
    "nothing_missing": ("nothing is missing", "a diagnosis that found effects"),
    "effects_missing": ("there is nothing to add", "a diagnosis that found effects"),
    "unknown_effect": ("its forms have no formula with units", "a diagnosis by this version of rodgen"),
    "cannot_tell": ("those data cannot tell", "a diagnosis that found effects"),
}
"""By verdict: why there are no steps, and what was expected."""


@dataclass(frozen=True)
class ReadDiagnosis:
    """The parts of a diagnosis that matter to ``rodgen add``."""

    file: str
    steps: tuple[tuple[str, str | None], ...]  # name and place of each effect, in the order of adding
    verdict: str
    forms: tuple[dict[str, Any], ...]  # outside the catalogue: the keys of their [[effect]], or none
    outliers: int  # number of outlying rows
    exclude: tuple[SetAside, ...]  # the entries that exclude these in a machine file

    def effects(self, machine: Machine, chosen: Sequence[int] = ()) -> tuple[Effect, ...]:
        """Return the effects, then the forms, or the chosen of these steps, counted from 1, in the order of adding.

        Raises
        ------
        InputFileError
            When there are none, or one cannot be added after those before it.
        """
        from rodgen.machines.effects.rules import UnfitEffectError, catalogue_effect, check_effect
        from rodgen.machines.files.read import effect_of

        steps: list[tuple[str, str | None] | dict[str, Any]] = [*self.steps, *self.forms]
        count = len(steps)
        if not self.steps and not any(self.forms):
            why, expected = _NONE[self.verdict]
            raise InputFileError(self.file, "steps", f"none: {why}", expected)
        for number in chosen:
            if number > count:
                some = "1, the only step" if count == 1 else f"1 to {count}"
                raise refused("--step", f"{number}", f"{some} of {self.file}")
        effects: list[Effect] = []
        there = {effect.identity for effect in machine.effects}
        for number, step in enumerate(steps, 1):
            if (chosen and number not in chosen) or not step:
                continue
            try:
                name, place = (str(step.get("name")), step.get("joint")) if isinstance(step, dict) else step
                if (name, place) in there:
                    title = f"{name} at {place}" if place else name
                    known = f"{title}, which {machine.file or machine.name} has already"
                    raise UnfitEffectError("name", known, "an effect that is new; --step N chooses")
                if isinstance(step, dict):
                    effect = effect_of(machine, step, self.file, f"step {number}, a form")
                else:
                    effect = catalogue_effect(machine, *step, {})
                check_effect(machine, effect)
            except UnfitEffectError as error:
                key = "effect" if error.key == "name" else "joint"
                raise InputFileError(
                    self.file, f"step {number}, {key}", error.found, error.expected
                ) from None
            effects.append(effect)
            machine = machine.with_effect(effect)
        return tuple(effects)

    def excluding(self, machine: Machine) -> Machine:
        """Return a machine with the outliers of the diagnosis set aside."""
        there = machine.measured.set_aside
        entries = (*there, *(entry for entry in self.exclude if entry not in there))
        return replace(machine, measured=replace(machine.measured, set_aside=entries), file=machine.file)

    def remarks(self) -> list[str]:
        """Return remarks on parts of the diagnosis that the new machine lacks."""
        found = []
        if left_out := sum(not form for form in self.forms):
            several = f"{left_out} forms" if left_out > 1 else "1 form"
            found.append(f"{self.file}: {several} left out, written without units; diagnose again to add")
        if self.outliers and not self.exclude:
            several = f"{self.outliers} outliers" if self.outliers > 1 else "1 outlier"
            found.append(
                f"{self.file}: {several} in the diagnosis, not set aside; diagnose one whole file to do it"
            )
        return found


def read_diagnosis(file: str) -> ReadDiagnosis:
    """Return the diagnosis in a file; ``"-"`` is standard input."""
    name = "standard input" if file == "-" else file
    data = _parsed(read_input(file, _EXPECTED, largest=LARGEST, pipe=True), name)
    from rodgen.machines.files.read import entries_of

    verdict = data.get("verdict")
    if not isinstance(verdict, str) or verdict not in _NONE:
        raise InputFileError(name, "verdict", _found(data, "verdict"), _EXPECTED)
    steps = tuple(_step(each, number, name) for number, each in enumerate(_list(data, "steps", name), 1))
    forms = tuple(
        _form(each, number, name) for number, each in enumerate(_list(data, "unexplained", name), 1)
    )
    outliers = _list(data, "outliers", name)
    exclude = _list(data, "exclude", name) if "exclude" in data else []
    if wrong := [entry for entry in exclude if not isinstance(entry, dict)]:
        raise InputFileError(name, "exclude", shown(json.dumps(wrong[0])), "entries of set_aside")
    return ReadDiagnosis(name, steps, verdict, forms, len(outliers), entries_of(exclude, name, "exclude"))


def _parsed(content: bytes, name: str) -> Mapping[str, Any]:
    if not content.strip():
        raise InputFileError(name, "file", "empty", _EXPECTED)
    try:
        data = json.loads(content)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise InputFileError(name, place, f"not JSON ({error.msg})", _EXPECTED) from None
    except (ValueError, RecursionError):  # no text, or numbers and nesting beyond measure
        raise InputFileError(name, "file", "unreadable JSON", _EXPECTED) from None
    if not isinstance(data, dict):
        raise InputFileError(name, "file", f"JSON that is {_kind(data)}", _EXPECTED)
    return data


def _kind(data: object) -> str:
    return "a list" if isinstance(data, list) else shown(json.dumps(data))


def _list(data: Mapping[str, Any], key: str, name: str) -> list[Any]:
    found = data.get(key)
    if not isinstance(found, list):
        raise InputFileError(name, key, _found(data, key), _EXPECTED)
    return found


def _step(data: object, number: int, name: str) -> tuple[str, str | None]:
    where = f"step {number}"
    if not isinstance(data, dict):
        raise InputFileError(name, where, shown(json.dumps(data)), "an effect and its joint")
    effect, joint = data.get("effect"), data.get("joint")
    if not isinstance(effect, str):
        raise InputFileError(name, f"{where}, effect", _found(data, "effect"), "the name of an effect")
    if "joint" not in data or not (joint is None or isinstance(joint, str)):
        found, expected = _found(data, "joint"), "the name of a joint or target, or null"
        raise InputFileError(name, f"{where}, joint", found, expected)
    return effect, joint


def _form(data: object, number: int, name: str) -> dict[str, Any]:
    """Return the keys of a form's [[effect]]; none of a diagnosis that did not write them."""
    found = data.get("effect", {}) if isinstance(data, dict) else None
    if not isinstance(found, dict):
        raise InputFileError(
            name, f"unexplained {number}", shown(json.dumps(data)), "a form and its effect, a table"
        )
    return found


def _found(data: Mapping[str, Any], key: str) -> str:
    return shown(json.dumps(data[key])) if key in data else "missing"
