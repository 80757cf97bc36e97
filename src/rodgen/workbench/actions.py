"""What is done in a session: each action changes the text of the machine file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar, Protocol

from rodgen.calibration.check import Check
from rodgen.data.measurements import Measurements
from rodgen.data.set_aside import rows_text
from rodgen.errors import InputFileError, RodgenError, counted, shown
from rodgen.machines.files.edit import edited_text
from rodgen.machines.files.read import effect_of
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.observations import Observations

__all__ = [
    "ACTIONS",
    "Action",
    "Add",
    "Aside",
    "Back",
    "Known",
    "Remove",
    "Repair",
    "Tie",
    "Written",
    "action_of",
]


class Edited(Protocol):
    """The state of a session, :class:`rodgen.workbench.session.State`, that an action changes."""

    @property
    def file(self) -> str:
        """The machine file."""

    @property
    def text(self) -> str:
        """Its text."""

    @property
    def machine(self) -> Machine:
        """The machine that it describes."""

    @property
    def data(self) -> Measurements:
        """The measurements, with all rows."""

    @property
    def observations(self) -> Observations:
        """Those that count, bound to the machine."""

    @property
    def check(self) -> Check:
        """Whether the files can be right."""


@dataclass(frozen=True)
class Action:
    """Something that was done, and may be undone.

    Attributes
    ----------
    why : str
        A note of the user, or where a suggestion is from.
    """

    kind: ClassVar[str] = ""
    why: str = field(default="", kw_only=True)

    @property
    def title(self) -> str:
        """What it does, in a few words."""
        raise NotImplementedError

    def text(self, state: Edited) -> str:
        """Return the text of the machine file after it."""
        return state.text

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"do": self.kind} | {key: value for key, value in asdict(self).items() if value}


def _titled(name: str, place: str | None) -> str:
    return f"{name} at {place}" if place else name


@dataclass(frozen=True)
class _OfEffect(Action):
    """An action on the keys of an ``[[effect]]``: of the catalogue, or with a formula of its own."""

    effect: Mapping[str, Any]

    @property
    def place(self) -> str | None:
        """The joint or target; None for the whole machine."""
        return self.effect.get("joint") or self.effect.get("target")

    @property
    def name(self) -> str:
        """The name of the effect."""
        return str(self.effect.get("name", ""))

    def made(self, machine: Machine) -> Effect:
        """Return the effect on a machine that does not have it."""
        return effect_of(machine, self.effect, machine.file or machine.name, f"effect {self.name}")


@dataclass(frozen=True)
class Add(_OfEffect):
    """An effect is added.

    Attributes
    ----------
    effect : mapping
        The keys of an ``[[effect]]`` of a machine file.
    """

    kind = "add"

    @property
    def title(self) -> str:
        """What it does, in a few words."""
        return f"+ {_titled(self.name, self.place)}"

    def text(self, state: Edited) -> str:
        """Return the text of the machine file after it."""
        return edited_text(state.file, state.machine.with_effect(self.made(state.machine)), state.text)


@dataclass(frozen=True)
class Written(_OfEffect):
    """An effect that is there is written anew: other parameters are held, or its formula is another one."""

    kind = "rewrite"

    @property
    def title(self) -> str:
        """What it does, in a few words."""
        held = ", ".join(f"{key} = {value:g}" for key, value in self.effect.get("hold", {}).items())
        what = f"{held} held" if held else "nothing held"
        return f"{_titled(self.name, self.place)}: {what}"

    def text(self, state: Edited) -> str:
        """Return the text of the machine file after it."""
        without = state.machine.without_effect(self.name, self.place)
        written = self.made(without)
        effects = [written if e.identity == written.identity else e for e in state.machine.effects]
        return edited_text(state.file, replace(state.machine, effects=tuple(effects)), state.text)


@dataclass(frozen=True)
class Remove(Action):
    """An effect is removed.

    Attributes
    ----------
    name : str
    place : str or None
    """

    kind = "remove"
    name: str
    place: str | None = None

    @property
    def title(self) -> str:
        """What it does, in a few words."""
        return f"- {_titled(self.name, self.place)}"

    def text(self, state: Edited) -> str:
        """Return the text of the machine file after it."""
        return edited_text(state.file, state.machine.without_effect(self.name, self.place), state.text)


@dataclass(frozen=True)
class Known(Action):
    """A parameter gets a prior or bounds, or loses them.

    Attributes
    ----------
    key : str
        Of a parameter, or of what several belong to.
    content : mapping
        ``prior`` and ``bounds`` as in ``[known]`` of a machine file; empty: nothing is known.
    """

    kind = "know"
    key: str
    content: Mapping[str, Any] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """What it does, in a few words."""
        parts = [f"prior {self.content['prior']}"] if "prior" in self.content else []
        if "bounds" in self.content:
            parts.append("within " + " and ".join(map(str, self.content["bounds"])))
        return f"{self.key}: {', '.join(parts) or 'nothing is known of it'}"

    def text(self, state: Edited) -> str:
        """Return the text of the machine file after it."""
        machine = state.machine
        if self.content:
            changed = machine.knowing(self.key, **self.content)
        else:
            changed = replace(machine, known={k: x for k, x in machine.known.items() if k != self.key})
        return edited_text(state.file, changed, state.text)


@dataclass(frozen=True)
class Tie(Action):
    """A parameter is tied to others, or to none.

    Attributes
    ----------
    key : str
        Of the parameter.
    to : str
        As in ``[ties]`` of a machine file; empty: it is free.
    """

    kind = "tie"
    key: str
    to: str = ""

    @property
    def title(self) -> str:
        """What it does, in a few words."""
        return f"{self.key} = {self.to}" if self.to else f"{self.key}: tied no more"

    def text(self, state: Edited) -> str:
        """Return the text of the machine file after it."""
        machine = state.machine
        if self.to:
            changed = machine.tying(self.key, self.to)
        else:
            changed = replace(machine, ties={k: x for k, x in machine.ties.items() if k != self.key})
        return edited_text(state.file, changed, state.text)


@dataclass(frozen=True)
class _OfRows(Action):
    """An action on rows.

    Attributes
    ----------
    rows : sequence of int
        As the table counts them: lines of a CSV file from 1, else rows from 0.
    run : str
        Or a run.
    where : str
        Or a rule on columns, such as ``"EL < 20 deg"``.
    """

    rows: Sequence[int] = ()
    run: str = ""
    where: str = ""
    _method: ClassVar[str]
    _done: ClassVar[str]

    @property
    def _said(self) -> dict[str, str]:
        keys = {"rows": rows_text(self.rows), "run": self.run, "where": self.where, "why": self.why}
        return {name: text for name, text in keys.items() if text}

    @property
    def title(self) -> str:
        """What it does, in a few words."""
        rows = counted(len(self.rows), "row") if len(self.rows) else "all rows"
        return f"{self.where or (f'run {self.run}' if self.run else rows)} {self._done}"

    def text(self, state: Edited) -> str:
        """Return the text of the machine file after it."""
        changed: Machine = getattr(state.machine, self._method)(state.data, **self._said)
        return edited_text(state.file, changed, state.text)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        rows = {"rows": [int(row) for row in self.rows]} if len(self.rows) else {}
        return super().to_dict() | rows


@dataclass(frozen=True)
class Aside(_OfRows):
    """Rows are excluded: they are shown, but nothing is fitted to them."""

    kind = "set aside"
    _done = "excluded"
    _method = "setting_aside"


@dataclass(frozen=True)
class Back(_OfRows):
    """Rows that were excluded count again; all, where none are named."""

    kind = "bring back"
    _done = "included again"
    _method = "bringing_back"


@dataclass(frozen=True)
class Repair(Action):
    """The machine file is repaired where a check finds it wrong.

    Attributes
    ----------
    words : str
        Which of the changes that repair it, as the check words it.
    """

    kind = "repair"
    words: str

    @property
    def title(self) -> str:
        """What it does, in a few words."""
        return f"repaired: {self.words}"

    def text(self, state: Edited) -> str:
        """Return the text of the machine file after it."""
        for repair in state.check.repairs:
            if repair.words == self.words and not repair.of_data:
                repaired, _ = repair.applied(state.machine, state.observations)
                return edited_text(state.file, repaired, state.text)
        offered = (
            "; ".join(m.words for m in state.check.repairs if not m.of_data) or "nothing is wrong with it"
        )
        raise InputFileError(state.file, "file", f"no change {shown(self.words)}", offered)


ACTIONS: dict[str, Callable[..., Action]] = {
    made.kind: made for made in (Add, Written, Remove, Known, Tie, Aside, Back, Repair)
}
"""What an action of a session file is, by its key ``do``."""


def action_of(content: Any) -> Action:
    """Return an action from plain data, as `Action.to_dict` makes them.

    Raises
    ------
    RodgenError
        When it is none.
    """
    known = ", ".join(ACTIONS)
    if not isinstance(content, dict) or not isinstance(content.get("do"), str):
        raise RodgenError(f"{shown(repr(content)[:80])}; expected an action, such as {{'do': 'remove', …}}")
    make = ACTIONS.get(content["do"])
    if make is None:
        raise RodgenError(f"the action {shown(content['do'])}; expected one of {known}")
    keys = {key: value for key, value in content.items() if key != "do"}
    kinds: dict[str, Any] = {"rows": list, "effect": dict, "content": dict, "place": str | None}
    for key, value in keys.items():
        if not isinstance(value, kinds.get(key, str)):
            raise RodgenError(
                f"{key} of the action {content['do']!r}, {shown(repr(value)[:80])}; expected another kind"
            )
    if not all(type(row) is int for row in keys.get("rows", ())):
        raise RodgenError(f"rows of the action {content['do']!r}; expected whole numbers")
    try:
        return make(**keys)
    except TypeError:
        raise RodgenError(
            f"keys {', '.join(keys)} of the action {content['do']!r}; expected other ones"
        ) from None
