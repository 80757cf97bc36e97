"""Change what a machine file says without changing any other byte.

The text is not written again. What `machine_text` writes of the machine before and after is compared, block by block
and key by key, and only what differs is replaced, put in or taken out. Statements are the shortest stretches of lines
that are TOML by themselves; and the result must read as the intended machine.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeAlias

from rodgen import limits
from rodgen.errors import InputFileError, shown
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.toml import read_text
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Machine

__all__ = ["edited_text", "unused_name"]

Source: TypeAlias = str | os.PathLike[str]

_FORMS = {
    "effect": (
        "effect",
        "effects that are not blocks of their own",
        "[[effect]] blocks, which can be edited",
    ),
    "measured": ("[measured]", "a table or a key set_aside in another form", "both as rodgen writes them"),
    "known": ("[known]", "entries in another form", "one a line, as rodgen writes them"),
    "ties": ("[ties]", "entries in another form", "one a line, as rodgen writes them"),
}
"""What is said of tables that cannot be edited; where others cannot, the file is written anew."""


def unused_name(file: str, words: Sequence[str]) -> str:
    """Return a name that no file has, for a copy of a machine file which words tell from it.

    Examples
    --------
    >>> unused_name("mount.toml", ("backlash", "AZ"))
    'mount_backlash_AZ.toml'
    """
    stem, ending = os.path.splitext(file)
    stem += "".join("_" + re.sub(r"\W", "_", word) for word in words if word)
    names = itertools.chain([stem + ending], (f"{stem}_{number}{ending}" for number in itertools.count(2)))
    return next(name for name in names if not os.path.lexists(name))


def edited_text(source: Source, machine: Machine, text: str | None = None) -> str:
    """Return the text of a machine file that says another machine; what both say alike stays as it is.

    Effects that are new come after the others, in their order. The block of an effect that differs is written anew; one
    that is gone is cut out with the comments inside it, and with what ``[known]`` says of its parameters. In other
    tables values are replaced, and keys put in or taken out. Blocks of joints in another order are moved with the
    comments in them and right above them; those of branches, which list their joints, stay where they are.

    Parameters
    ----------
    source : str or os.PathLike
        A machine file.
    machine : Machine
        That of the file with another geometry, other effects, or another ``[estimate]``, ``[known]``, ``[ties]`` or
        `set_aside`. Fitted numbers are not written.
    text : str, optional
        The content of the file, or what will be written to it; left out, the file is read.

    Raises
    ------
    InputFileError
        When `source` is not a machine file, parameters are tied to those of an effect that is gone, the text is too
        long, or effects, priors, ties or rows that are set aside stand there in a form that cannot be edited. A file
        whose geometry cannot, such as joints in one inline list, is written anew.
    """
    file = os.fspath(source)
    text = read_text(file) if text is None else text
    before = machine_of(text, file)
    machine = replace(_without_rest_of_effects(before, machine, file), file=before.file)
    edited, ordered = _with_joints_in_order(text, before, machine)
    new_text = machine_text(machine)
    old, new = _blocks(machine_text(ordered)), _blocks(new_text)
    edited = _with_edits(edited, _edits(edited, old, new, new_text))
    if len(edited.encode()) > limits.FILE:  # could not be read any more
        found = f"rows that make a file of more than {limits.FILE / 1e6:g} MB"
        raise InputFileError(source, "[measured], set_aside", found, "a rule, or longer stretches of rows")
    with contextlib.suppress(InputFileError):
        if _outline(machine_of(edited, file)) == _outline(machine):
            return edited
    for table, fault in _FORMS.items():
        was, now = ({of: x.values for of, x in each.items() if of[0] == table} for each in (old, new))
        if was != now:
            raise InputFileError(source, *fault)
    return new_text


def _without_rest_of_effects(before: Machine, machine: Machine, file: str) -> Machine:
    """Return a machine without what is known of effects that are gone; to these nothing may be tied."""
    there = {effect.identity for effect in machine.effects}
    for gone in (effect for effect in before.effects if effect.identity not in there):
        for key, tie in machine.ties.items():
            if any(gone.owns(key_of) for key_of, _ in tie.factors):
                found, expected = f"a tie to {shown(gone.title)}, which is to be removed", "no such tie"
                raise InputFileError(file, f"[ties], {key}", found, expected)
        known = {k: x for k, x in machine.known.items() if not gone.owns(k) and k != gone.key("")}
        machine = replace(machine, known=known)
    return machine


def _outline(machine: Machine) -> tuple[Any, ...]:
    """Return what must be as intended: everything but the last bits of numbers that are held or known."""
    rest = replace(machine, effects=(), values={}, known={})
    return rest, sorted(machine.known), [e.identity for e in machine.effects]


def _with_joints_in_order(text: str, before: Machine, machine: Machine) -> tuple[str, Machine]:
    """Return a text, and the machine that it says, with the blocks of joints in the order of another machine."""
    names = [joint.name for joint in before.joints]
    order = [names.index(joint.name) for joint in machine.joints]
    joints = [block for (table, *_), block in _blocks(text).items() if table == "joint"]
    if order == sorted(order) or len(joints) != len(order) or before.branches:
        return text, before
    places = [_with_comments_above(text, block.parts) for block in joints]
    moved = [(place, text[places[k]]) for place, k in zip(places, order, strict=True)]
    return _with_edits(text, moved), replace(before, joints=tuple(before.joints[k] for k in order))


# what differs --------------------------------------------------------------------------------------------------------


class _Entry(NamedTuple):
    """A key with its value."""

    place: slice
    """Whole lines."""
    value_at: slice
    value: str
    """As it is written, without a comment behind it."""
    is_whole: bool
    """Whether the value is that of the key, not a part of it as in ``a.prior = ...``, and nothing around it."""
    before: tuple[slice, ...]
    """The lines of its other parts."""


@dataclass
class _Block:
    """A table: its header, its keys, and its own tables, wherever these are."""

    parts: list[slice] = field(default_factory=list)
    end: int | None = None
    """Where a further key comes; None where there is no header of its own."""
    content: dict[str, Any] = field(default_factory=dict)
    entries: dict[str, _Entry] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, str]:
        """The values of its keys."""
        return {key: entry.value for key, entry in self.entries.items()}


_Blocks: TypeAlias = dict[tuple[str, ...], _Block]
"""By the name of the table, and of blocks their own names, those of effects with their places."""


def _edits(text: str, old: _Blocks, new: _Blocks, new_text: str) -> Iterator[tuple[slice, str]]:
    """Yield the places of a text that change, and what stands there then."""
    there = _blocks(text)
    effects = [part for of, block in there.items() if of[0] == "effect" for part in block.parts]
    first = min((_with_comments_above(text, [part]).start for part in effects), default=len(text))
    last = max((part.stop for part in effects), default=len(text))
    further = ""
    for of in {**old, **new}:
        block, was, now = there.get(of), *(x[of].values if of in x else {} for x in (old, new))
        written = new_text[new[of].parts[0]].rstrip("\n") + "\n" if of in new else ""
        if was == now:
            continue
        if of[0] == "effect":
            further += "" if of in old else f"\n{written}"
            for part in block.parts if block else ():
                yield (part if written else _with_blank_lines(text, part)), written
                written = ""
        elif block is None or block.end is None:
            gap = "" if not first or text[:first].endswith(("\n\n", "\r\n\r\n")) else "\n"
            yield slice(first, first), f"{gap}{written}" + "\n" * bool(text[first:])
        else:
            for key, entry in block.entries.items():
                if was.get(key) == now.get(key):
                    continue
                yield from ((place, "") for place in entry.before)
                if key not in now:
                    yield entry.place, ""
                elif entry.is_whole:
                    yield entry.value_at, now[key]
                else:  # its value is that of another key
                    line = new_text[new[of].entries[key].place].rstrip()
                    yield slice(entry.place.start, entry.value_at.stop), line
            lines = [new_text[new[of].entries[key].place] for key in now if key not in was | block.values]
            gap = "\n" * (bool(lines) and not text[: block.end].endswith("\n"))
            yield slice(block.end, block.end), gap + "".join(lines)
    if further:
        gap = "\n" * (bool(text[:last]) and not text[:last].endswith("\n"))
        end = "" if text[last : last + 1] in {"", "\n", "\r"} else "\n"
        yield slice(last, last), f"{gap}{further}{end}"


def _with_edits(text: str, edits: Iterable[tuple[slice, str]]) -> str:
    """Return a text with other pieces in some places."""
    new_line = "\r\n" if "\r\n" in text else "\n"
    in_order = sorted(edits, key=lambda edit: (edit[0].start, edit[0].stop))
    for place, piece in in_order[::-1]:
        piece = piece.replace("\r\n", "\n").replace("\n", new_line)
        text = text[: place.start] + piece + text[place.stop :]
    return text


# where statements are ------------------------------------------------------------------------------------------------

_HEADER = re.compile(r"^[ \t]*(\[.*\])[ \t]*(?:#.*)?\r?$\n?", re.MULTILINE)
_KEY = re.compile(r"^\ufeff?[ \t]*[^\s#\[\]{}=,][^=\n]*=[ \t]*", re.MULTILINE)


def _parts(
    text: str, start: int, stop: int, begins: re.Pattern[str]
) -> Iterator[tuple[int, int, dict[str, Any]]]:
    """Yield the stretches of a text that begin where a line matches, if each is TOML by itself, and what it says."""
    for end in [*(header_match.start() for header_match in begins.finditer(text, start, stop)), stop]:
        try:
            content = tomllib.loads(text[start:end].removeprefix("\ufeff"))
        except tomllib.TOMLDecodeError:  # the line is within a value
            continue
        yield start, end, content
        start = end


def _statements(text: str) -> Iterator[tuple[str, dict[str, Any] | None, slice]]:
    """Yield the table, such as ``[[effect]]``, what its key says, None of its header, and the lines of each statement.

    Blanks and quotes are not in the name of the table.
    """
    for start, stop, _ in _parts(text, 0, len(text), _HEADER):
        header, opened = "", start
        if match := _HEADER.match(text, start, stop):
            header, opened = re.sub(r"[\s\"']", "", match[1]), match.end()
            yield header, None, slice(start, opened)
        for begin, end, content in _parts(text, opened, stop, _KEY):
            lines = text[begin:end].splitlines(keepends=True)
            while lines and re.match(r"\s*(#|\Z)", lines[-1]):
                lines.pop()
            if lines and content:
                yield header, content, slice(begin, begin + len("".join(lines)))


def _blocks(text: str) -> _Blocks:
    """Return the tables of a text."""
    blocks: list[tuple[str, _Block]] = []
    before: _Block | None = None
    for header, content, place in _statements(text):
        table, _, inner = header.strip("[]").partition(".")
        block = next((block for name, block in reversed(blocks) if name == table), None)
        if block is None or (content is None and header == f"[[{table}]]"):
            block = _Block()
            blocks.append((table, block))
        if block is before:
            block.parts[-1] = slice(block.parts[-1].start, place.stop)
        else:
            block.parts.append(place)
        before = block
        block.end = block.end if inner else place.stop
        if content is not None:
            block.content |= {} if inner else content
            key, value = _entry_key(table, content)
            block.entries[inner + key] = _entry(text, content, value, place, block.entries.get(inner + key))
    for _, block in blocks:
        block.parts = [_with_comments(text, part) for part in block.parts]
    return {(table, *_name(table, block.content)): block for table, block in blocks}


_STATED = {"prior", "bounds"}


def _name(table: str, content: dict[str, Any]) -> list[str]:
    keys = {"joint": ["name"], "target": ["name"], "branch": ["name"], "effect": ["name", "joint", "target"]}
    return [str(content.get(key)) for key in keys.get(table, ())]


def _entry_key(table: str, content: dict[str, Any]) -> tuple[str, Any]:
    """Return an entry's key and value; the key of ``[known]`` and ``[ties]``, perhaps with dots, is the whole of it."""
    ((name, value),) = content.items()
    while (
        table in {"known", "ties"}
        and isinstance(value, dict)
        and len(value) == 1
        and not value.keys() & _STATED
    ):
        ((inner, value),) = value.items()
        name = f"{name}.{inner}"
    return str(name), value


def _entry(
    text: str, content: dict[str, Any], says: Any, place: slice, entry_before: _Entry | None
) -> _Entry:
    key = _KEY.match(text, place.start, place.stop)
    start = key.end() if key else place.start
    value = text[start : place.stop].rstrip()
    for comment in re.finditer("#", value):
        with contextlib.suppress(tomllib.TOMLDecodeError):  # the sign is within the value
            if tomllib.loads(text[place.start : start + comment.start()].removeprefix("\ufeff")) == content:
                value = value[: comment.start()].rstrip()
                break
    is_whole = False
    with contextlib.suppress(tomllib.TOMLDecodeError):  # the sign = is within the key
        is_whole = tomllib.loads(f"value = {value}") == {"value": says}
    before = (*entry_before.before, entry_before.place) if entry_before else ()
    return _Entry(place, slice(start, start + len(value)), value, is_whole, before)


def _with_comments(text: str, part: slice) -> slice:
    """Extend a slice by the comments right below, unless they stand right above something else."""
    below = re.compile(r"(?:[ \t]*#[^\n]*(?:\n|\Z))*").match(text, part.stop)
    assert below is not None
    rest = text[below.end() :]
    return slice(part.start, below.end() if not rest or re.match(r"[ \t]*\r?\n", rest) else part.stop)


def _with_comments_above(text: str, parts: list[slice]) -> slice:
    """Return the slice of a block with the comments right above it."""
    above = re.search(r"(?:^[ \t]*#[^\n]*\n)*\Z", text[: parts[0].start], re.MULTILINE)
    assert above is not None
    return slice(above.start(), parts[-1].stop)


def _with_blank_lines(text: str, part: slice) -> slice:
    """Extend a slice that is cut out by the blank lines below it; at the end of a text by those above."""
    blank = re.compile(r"(?:[ \t]*\r?\n)*").match(text, part.stop)
    assert blank is not None
    if blank.end() < len(text):
        return slice(part.start, blank.end())
    above = re.search(r"(?<=\n)(?:[ \t]*\r?\n)+\Z", text[: part.start])
    return slice(above.start() if above else part.start, len(text))
