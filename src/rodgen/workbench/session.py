"""A session: a machine file, measurements, and what was done one after the other, undone and done again.

The state after each action is kept, so that undo and redo take no time. A session file holds the text of the machine
file as it was, the hashes of both files and the actions; reading it does them again, to the same state.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.error_table import THE_FILE
from rodgen.calibration.fit import Fit, fit
from rodgen.calibration.ladder import Ladder, Rung, first_rung, fit_after, next_rung
from rodgen.calibration.problem.binding import bind_once
from rodgen.data.measurements import Measurements
from rodgen.errors import InputFileError, RodgenError, shown
from rodgen.files import open_input, read_input, write_file
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.toml import read_text
from rodgen.machines.machine import Machine
from rodgen.machines.observations import Observations
from rodgen.views import to_json
from rodgen.workbench.actions import Action, action_of

if TYPE_CHECKING:
    from rodgen.calibration.check import Check
    from rodgen.calibration.suspects import Suspects

__all__ = ["ENDING", "Session", "State"]

ENDING = ".rodgen"
"""Of the names of session files."""
FORMAT = 1
LARGEST = 50_000_000
"""Bytes of a session file at most."""
AGREE = 1e-6
"""Relative difference of an error from the one that was saved above which another model was fitted."""
_EXPECTED = "a session as rodgen open saves it"


@dataclass(frozen=True, eq=False)
class State:
    """What a session is after an action.

    Attributes
    ----------
    file, text : str
        Name of the machine file, and what it is to say.
    machine : Machine
        That it describes.
    data : Measurements
    observations : Observations
        All of them.
    aside : ndarray of bool, shape (n,)
        Which of them do not count.
    fit : Fit
        To all others; those are its outliers.
    action : Action or None
        That led here; None at the beginning.
    before : State or None
    """

    file: str
    text: str
    machine: Machine
    data: Measurements = field(repr=False)
    observations: Observations = field(repr=False)
    aside: NDArray[np.bool_] = field(repr=False)
    fit: Fit = field(repr=False)
    action: Action | None = None
    before: State | None = field(default=None, repr=False)

    @classmethod
    def first(cls, file: str, text: str, data: Measurements) -> State:
        """Return the state of a machine file and measurements, before anything was done."""
        machine = machine_of(text, file)
        observations = _all_of(machine, data)
        aside = _aside(machine, data, observations)
        return cls(file, text, machine, data, observations, aside, fit(machine, observations, outliers=aside))

    def after(self, action: Action) -> State:
        """Return the state after an action.

        Raises
        ------
        RodgenError
            When it cannot be done.
        """
        text, data = action.text(self), self.data
        machine = self.machine if text == self.text else machine_of(text, self.file)
        observations, aside = self.observations, self.aside
        if machine.measured.set_aside != self.machine.measured.set_aside:
            aside = _aside(machine, data, observations)
        if _carriers(machine) == _carriers(self.machine):
            refit = fit_after(self.fit, machine, aside)
        else:
            observations = _all_of(machine, data)
            refit = fit(machine, observations, outliers=aside)
        return State(self.file, text, machine, data, observations, aside, refit, action, self)

    @property
    def title(self) -> str:
        """What the action does, in a few words; a mount's effects have TPOINT's names."""
        title = self.action.title if self.action else THE_FILE
        for effect in (*self.machine.effects, *(self.before.machine.effects if self.before else ())):
            name = f"{effect.name} at {effect.place}" if effect.place else effect.name
            if title.partition(":")[0].lstrip("+- ") == name:
                return title.replace(name, effect.title)
        return title

    @cached_property
    def rung(self) -> Rung:
        """The model on the ladder of errors, tested against that before."""
        if self.before is None or self.action is None:
            return first_rung(self.fit)
        return next_rung(self.before.fit, self.fit, self.title)

    @cached_property
    def suspects(self) -> Suspects | None:
        """The effects that the model may lack; None where candidates cannot be evaluated where the fit is."""
        from rodgen.calibration.suspects import suspects

        with suppress(RodgenError):
            return suspects(self.fit)
        return None

    @property
    def numbers(self) -> NDArray[np.int64]:
        """What the table calls each row, (n,): lines of a CSV file from 1, else rows from 0."""
        return self.observations.data.numbers(range(self.observations.n))

    @cached_property
    def check(self) -> Check:
        """Whether the files can be right."""
        checked: Check = self.fit.check()
        return checked


def _carriers(machine: Machine) -> tuple[Any, ...]:
    """Return what the observations depend on."""
    return machine.joints, machine.targets, _all_rows(machine).measured, machine.kinematics


def _all_rows(machine: Machine) -> Machine:
    return replace(machine, measured=replace(machine.measured, set_aside=()))


def _all_of(machine: Machine, data: Measurements) -> Observations:
    """Return the observations with those that are set aside, which are shown, too."""
    return bind_once(_all_rows(machine), data)


def _aside(machine: Machine, data: Measurements, observations: Observations) -> NDArray[np.bool_]:
    """Return which of all observations are set aside, (n,): of copies all."""
    excluded = machine.aside(data)
    return np.zeros(observations.n, bool) if excluded is None else ~observations.counted(~excluded.mask)


class Session:
    """What was done to a machine, one after the other; see `open` and `load`.

    Attributes
    ----------
    data_file : str
    file : str or None
        Where the session is saved: from the first time on after every action, undo and redo.
    states : list of State
        The first, then one after each action, those that were undone among them.
    at : int
        Number of the state that holds now.
    remarks : list of str
        What differs from a session that was read.
    """

    def __init__(self, first: State, data_file: str) -> None:
        self.data_file = data_file
        self.file: str | None = None
        self.states = [first]
        self.at = 0
        self.remarks: list[str] = []
        self._hashes = {"machine": _hash(first.text.encode()), "data": _hash_of_file(data_file)}

    @classmethod
    def open(cls, machine: str | os.PathLike[str], data: str | os.PathLike[str]) -> Session:
        """Return the session of a machine file and a measurement file.

        Nothing was done in it yet.

        Raises
        ------
        RodgenError
            When one cannot be read, they do not belong together, or there is nothing to fit.
        """
        file, of = os.fspath(machine), os.fspath(data)
        return cls(State.first(file, read_text(file), Measurements.load(of)), of)

    # what is done ------------------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """What holds now."""
        return self.states[self.at]

    @property
    def done(self) -> list[State]:
        """The states that led here, the first among them."""
        return self.states[: self.at + 1]

    def do(self, action: Action) -> State:
        """Do something; what was undone before is forgotten.

        Raises
        ------
        RodgenError
            When it cannot be done; then the session is as it was.
        """
        state = self.state.after(action)
        self.states[self.at + 1 :] = [state]
        self.at += 1
        self._saved()
        return state

    def undo(self) -> State:
        """Take the last action back; at the beginning there is none."""
        return self.go(self.at - 1)

    def redo(self) -> State:
        """Do again what was undone last."""
        return self.go(self.at + 1)

    def go(self, at: int) -> State:
        """Undo or redo actions until the state of a number holds, or the nearest there is."""
        self.at = min(max(at, 0), len(self.states) - 1)
        self._saved()
        return self.state

    # what it shows -----------------------------------------------------------------------------------------------

    @property
    def ladder(self) -> Ladder:
        """The errors of the models that led here, each tested against that before."""
        return Ladder(tuple(state.rung for state in self.done))

    # what is kept ------------------------------------------------------------------------------------------------

    def save_machine(self, file: str | os.PathLike[str]) -> None:
        """Write the machine file.

        Raises
        ------
        InputFileError
            When it cannot be written.
        """
        write_file(file, self.state.text.encode())

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the session, now and after everything that is done from now on.

        Raises
        ------
        InputFileError
            When it cannot be written.
        """
        before, self.file = self.file, os.fspath(file)
        try:
            self._saved()
        except RodgenError:
            self.file = before
            raise

    def _saved(self) -> None:
        if self.file is not None:
            write_file(self.file, f"{to_json(self._to_dict(self.file), indent=1)}\n".encode())

    def _to_dict(self, file: str) -> dict[str, Any]:
        first, folder = self.states[0], os.path.dirname(os.path.abspath(file))
        return {
            "format": FORMAT,
            "versions": {"rodgen": version("rodgen"), "python": platform.python_version()},
            "machine": {
                "file": _from(folder, first.file),
                "sha256": self._hashes["machine"],
                "text": first.text,
            },
            "data": {"file": _from(folder, self.data_file), "sha256": self._hashes["data"]},
            "at": self.at,
            "actions": [
                {**state.action.to_dict(), "rms": state.fit.rms} for state in self.states if state.action
            ],
        }

    @classmethod
    def load(cls, file: str | os.PathLike[str]) -> Session:
        """Return a session that was saved: everything in it is done again.

        Raises
        ------
        RodgenError
            When it is none, its measurements are not those of the session, by their hash, or something cannot be done.
        """
        name = os.fspath(file)
        folder = os.path.dirname(name)
        try:
            content = json.loads(read_input(name, _EXPECTED, largest=LARGEST))
            if content["format"] != FORMAT:
                raise InputFileError(name, "format", shown(str(content["format"])), str(FORMAT))
            machine, data = content["machine"], content["data"]
            text, at = str(machine["text"]), int(content["at"])
            files = [os.path.join(folder, str(of["file"])) for of in (machine, data)]
            actions: Sequence[Mapping[str, Any]] = content["actions"]
            doing = [({k: v for k, v in each.items() if k != "rms"}, each.get("rms")) for each in actions]
            hashes = machine["sha256"], data["sha256"]
        except InputFileError:
            raise
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
            found = shown(f"{type(error).__name__}: {error}"[:200])
            raise InputFileError(name, "file", found, _EXPECTED) from None
        if _hash(text.encode()) != hashes[0]:
            raise InputFileError(
                name, "machine, text", "not the text of its hash", "the text as it was saved"
            )
        if _hash_of_file(files[1]) != hashes[1]:
            raise InputFileError(
                files[1], "file", f"not the measurements of {name}, by their hash", "the file as it was"
            )
        session = cls(State.first(files[0], text, Measurements.load(files[1])), files[1])
        for number, (each, rms) in enumerate(doing, 1):
            try:
                state = session.do(action_of(each))
            except RodgenError as error:
                raise InputFileError(name, f"action {number}", str(error), _EXPECTED) from None
            if isinstance(rms, float) and not math.isclose(state.fit.rms, rms, rel_tol=AGREE, abs_tol=1e-12):
                writer = content["versions"]["rodgen"] if "versions" in content else "another version"
                session.remarks.append(
                    f"After {state.title} the error is {state.fit.rms:.6g} "
                    f"{state.fit.unit}; rodgen {writer} had {rms:.6g}."
                )
        session.go(at)
        session.file = name
        return session


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _hash_of_file(file: str) -> str:
    with open_input(file, "the measurements of the session") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _from(folder: str, file: str) -> str:
    """Return the name of a file as seen from a folder, if it is below it or near."""
    try:
        near = os.path.relpath(os.path.abspath(file), folder)
    except ValueError:  # another drive
        return os.path.abspath(file)
    return near if near.count("..") <= 3 else os.path.abspath(file)
