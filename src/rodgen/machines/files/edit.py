"""Change a machine file's effects, or its geometry, without changing any other byte.

The text is not written again: blocks are inserted, cut out or moved between two statements, and values are replaced.
Statements are the shortest stretches of lines that are TOML by themselves; and the result must read as the intended
machine.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

from rodgen import limits
from rodgen.data.set_aside import SetAside
from rodgen.errors import InputFileError, shown
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.schema import toml_string
from rodgen.machines.files.toml import read_text
from rodgen.machines.files.write import effect_text, known_line, machine_text, set_aside_text
from rodgen.machines.machine import Machine
from rodgen.machines.parts import Effect

__all__ = [
    "name_with",
    "text_with_effect",
    "text_with_effects",
    "text_with_geometry",
    "text_with_known",
    "text_with_set_aside",
    "text_with_tie",
    "text_without_effect",
]

Source: TypeAlias = str | os.PathLike[str]


def name_with(file: str, words: Sequence[str]) -> str:
    """Return the name of a machine file's copy that words tell from it.

    Examples
    --------
    >>> name_with("mount.toml", ("backlash", "AZ"))
    'mount_backlash_AZ.toml'
    """
    stem, ending = os.path.splitext(file)
    return stem + "".join("_" + re.sub(r"\W", "_", word) for word in words if word) + ending


def text_with_effects(source: Source, effects: Sequence[Effect], text: str | None = None) -> str:
    """Return the text of a machine file with more ``[[effect]]`` blocks, after those that it has.

    Parameters
    ----------
    source : str or os.PathLike
        A machine file.
    effects : sequence of Effect
        See :meth:`Machine.effect`.
    text : str, optional
        Here and below: what stands in the file, or is to stand there; left out, the file is read.

    Raises
    ------
    InputFileError
        When `source` is not a machine file, or an effect cannot stand there.
    """
    text, changed = _read(source, text)
    for effect in effects:
        changed = changed.with_effect(effect)
    new_line = "\r\n" if "\r\n" in text else "\n"
    blocks = _blocks(text, "effect")
    end = max((part.stop for parts in blocks for part in parts), default=len(text))
    before, after = text[:end], text[end:]
    if before and not before.endswith("\n"):
        before += new_line
    added = "".join("\n" + effect_text(changed, effect) for effect in effects).replace("\n", new_line)
    if after and not after.startswith(("\n", "\r")):
        added += new_line
    return _checked(before + added + after, changed, source)


def text_with_effect(source: Source, effect: Effect, text: str | None = None) -> str:
    """Return the text of a machine file with the block of an effect that it has written anew: what is held differs.

    Raises
    ------
    InputFileError
        When `source` is not a machine file, has no such effect, or the block cannot be edited.
    """
    text, before = _read(source, text)
    number = [e.identity for e in before.effects].index(effect.identity)
    changed = replace(
        before, effects=(*before.effects[:number], effect, *before.effects[number + 1 :]), file=before.file
    )
    blocks = _blocks(text, "effect")
    for k, part in reversed(list(enumerate(blocks[number] if number < len(blocks) else []))):
        written = "" if k else effect_text(changed, effect)
        text = text[: part.start] + written + text[part.stop :]
    return _checked(text, changed, source)


def text_with_known(source: Source, key: str, content: Mapping[str, Any], text: str | None = None) -> str:
    """Return the text of a machine file that says other things, or nothing more, of a parameter in ``[known]``.

    Parameters
    ----------
    source : str or os.PathLike
    key : str
        Of a parameter, or of what several belong to; see :meth:`Machine.knowing`.
    content : mapping
        ``prior`` and ``bounds``, as that method takes them; empty: nothing is known.
    text : str, optional

    Raises
    ------
    InputFileError
        When `source` is not a machine file, or the entry cannot be right.
    """
    text, before = _read(source, text)
    changed = replace(before, known={k: v for k, v in before.known.items() if k != key})
    if content:
        changed = changed.knowing(key, **content)
    line = known_line(changed, key, changed.known[key]) if content else ""
    return _checked(_with_entry(text, "known", key, line), changed, source)


def text_with_tie(source: Source, key: str, to: str, text: str | None = None) -> str:
    """Return the text of a machine file whose ``[ties]`` tie a parameter to others, or to none.

    Parameters
    ----------
    source : str or os.PathLike
    key : str
        Of the parameter.
    to : str
        A linear combination of others, as :meth:`Machine.tying` takes it; empty: it is free.
    text : str, optional

    Raises
    ------
    InputFileError
        When `source` is not a machine file, or the tie cannot be right.
    """
    text, before = _read(source, text)
    changed = replace(before, ties={k: v for k, v in before.ties.items() if k != key}, file=before.file)
    if to:
        changed = changed.tying(key, to)
    line = f"{toml_string(key)} = {toml_string(to)}" if to else ""
    return _checked(_with_entry(text, "ties", key, line), changed, source)


def _with_entry(text: str, table: str, key: str, line: str) -> str:
    """Return a text with a line on a key at the head of a table, in place of another; an empty one is none."""
    entries, after = _entries(text, table)
    new_line = "\r\n" if "\r\n" in text else "\n"
    line += new_line * bool(line)
    text = _without(text, [part for name, part in entries if name == key])
    if after is None and line:
        first = min((part.start for parts in _blocks(text, "effect") for part in parts), default=len(text))
        gap = "" if not first or text[:first].endswith(("\n\n", "\r\n\r\n")) else new_line
        text = f"{text[:first]}{gap}[{table}]{new_line}{line}{new_line if text[first:] else ''}{text[first:]}"
    elif line:
        text = text[:after] + line + text[after:]
    return text


def text_with_set_aside(source: Source, entries: Sequence[SetAside], text: str | None = None) -> str:
    """Return the text of a machine file with other rows of measurements set aside, or none.

    Parameters
    ----------
    source : str or os.PathLike
        A machine file.
    entries : sequence of SetAside
        All of them; see :meth:`Machine.setting_aside`.
    text : str, optional

    Raises
    ------
    InputFileError
        When `source` is not a machine file, its table ``[measured]`` cannot be edited, or the text is too long.
    """
    text, before = _read(source, text)
    changed = replace(before, measured=replace(before.measured, set_aside=tuple(entries)), file=before.file)
    lines, after = _entries(text, "measured")
    new_line = "\r\n" if "\r\n" in text else "\n"
    there = [part for key, part in lines if key == "set_aside"]
    end = lines[-1][1].stop if lines else after or len(text)
    (place,) = there or [slice(end, end)]
    said = f"{set_aside_text(entries)}\n".replace("\n", new_line) if entries else ""
    gap = new_line if said and not text[: place.start].endswith("\n") else ""
    text = text[: place.start] + gap + said + text[place.stop :]
    if len(text.encode()) > limits.FILE:  # could not be read any more
        found = f"rows that make a file of more than {limits.FILE / 1e6:g} MB"
        raise InputFileError(source, "[measured], set_aside", found, "a rule, or longer stretches of rows")
    faults = ("[measured]", "a table or a key set_aside in another form", "both as rodgen writes them")
    return _checked(text, changed, source, faults)


def text_without_effect(source: Source, name: str, place: str | None, text: str | None = None) -> str:
    """Return the text of a machine file without the block of an effect.

    What stands inside the block goes with it, comments included, and what ``[known]`` and ``[ties]`` say of its
    parameters; comments above it stay.

    Parameters
    ----------
    source : str or os.PathLike
        A machine file.
    name : str
        The effect.
    place : str or None
        Its joint or target; None for the whole machine.

    Raises
    ------
    InputFileError
        When `source` is not a machine file, has no such effect, or parameters of others are tied to it.
    """
    text, machine = _read(source, text)
    changed = machine.without_effect(name, place)
    gone = next(e for e in machine.effects if e.identity == (name, place))
    for key, tie in changed.ties.items():
        if any(gone.owns(other) for other, _ in tie.factors):
            found, expected = f"a tie to {shown(gone.title)}, which is to be removed", "no such tie"
            raise InputFileError(os.fspath(source), f"[ties], {key}", found, expected)

    def is_own(key: str) -> bool:
        return gone.owns(key) or key == gone.key("")

    for table in ("known", "ties"):
        text = _without(text, [part for key, part in _entries(text, table)[0] if is_own(key)])
    known = {key: entry for key, entry in changed.known.items() if not is_own(key)}
    changed = replace(changed, known=known, file=changed.file)
    number = [e.identity for e in machine.effects].index((name, place))
    blocks = _blocks(text, "effect")
    for part in reversed(blocks[number] if number < len(blocks) else []):
        before, after = text[: part.start], text[part.stop :]
        blank = re.match(r"(?:[ \t]*\r?\n)*", after)
        assert blank is not None
        after = after[blank.end() :]
        text = before + after if after else re.sub(r"(\n)(?:[ \t]*\r?\n)+\Z", r"\1", before)
    return _checked(text, changed, source)


def text_with_geometry(source: Source, machine: Machine, text: str | None = None) -> str:
    """Return the text of a machine file with the joints, targets and lengths of another machine, comments included.

    Blocks of joints are moved with the comments in them and right above them; joints of branches, which list them, stay
    where they are. A file whose form cannot be edited, such
    as joints in one inline list, is written anew.

    Parameters
    ----------
    source : str or os.PathLike
        A machine file.
    machine : Machine
        What the file is to say: that machine but for the order of its joints and for numbers of its geometry.

    Raises
    ------
    InputFileError
        When `source` is not a machine file.
    """
    text, before = _read(source, text)
    names = [joint.name for joint in before.joints]
    order = [names.index(joint.name) for joint in machine.joints]
    blocks = [_with_comments_above(text, parts) for parts in _blocks(text, "joint")]
    if order != sorted(order) and len(blocks) == len(order) and not before.branches:
        pieces = [text[block] for block in blocks]
        for place, number in reversed(list(zip(blocks, order, strict=True))):
            text = text[: place.start] + pieces[number] + text[place.stop :]
        before = replace(before, joints=tuple(before.joints[i] for i in order))
    old, new = (_values(machine_text(m)) for m in (before, machine))
    spans = {key: span for key, (_, span) in _values(text).items()}
    changed = [key for key in new if key not in old or old[key][0] != new[key][0]]
    if all(key in spans for key in changed):
        for key in sorted(changed, key=lambda key: spans[key].start, reverse=True):
            text = text[: spans[key].start] + new[key][0] + text[spans[key].stop :]
    try:
        return _checked(text, machine, source)
    except InputFileError:
        return machine_text(machine)


def _read(source: Source, text: str | None) -> tuple[str, Machine]:
    file = os.fspath(source)
    text = read_text(file) if text is None else text
    return text, machine_of(text, file)


_NO_BLOCKS = ("effect", "effects that are not blocks of their own", "[[effect]] blocks, which can be edited")


def _checked(text: str, meant: Machine, source: Source, faults: tuple[str, str, str] = _NO_BLOCKS) -> str:
    """Return the text, which must read as the machine that is meant; else `faults` say what cannot be edited."""
    try:
        found: Machine | None = machine_of(text, os.fspath(source))
    except InputFileError:
        found = None
    if found is None or _outline(found) != _outline(meant):
        raise InputFileError(source, *faults)
    return text


def _outline(machine: Machine) -> tuple[Any, ...]:
    """Return what must be as intended: everything but the last bits of numbers that are held or known."""
    rest = replace(machine, effects=(), values={}, known={})
    return rest, sorted(machine.known), [e.identity for e in machine.effects]


def _entries(text: str, table: str) -> tuple[list[tuple[str, slice]], int | None]:
    """Return the entries of a table, each with its key and place; and where its header ends, None without one."""
    found: list[tuple[str, slice]] = []
    after = None
    for statement in _statements(text):
        if statement.header == f"[{table}]":
            if statement.content is None:
                after = statement.place.stop
            else:
                found.append((_entry_key(statement.content), statement.place))
    return found, after


def _without(text: str, parts: Sequence[slice]) -> str:
    for part in reversed(parts):
        text = text[: part.start] + text[part.stop :]
    return text


def _entry_key(content: Any) -> str:
    """Return the key of an entry of ``[known]`` or ``[ties]``."""
    names: list[str] = []
    while isinstance(content, dict) and len(content) == 1 and not content.keys() & {"prior", "bounds"}:
        ((name, content),) = content.items()
        names.append(name)
    return ".".join(names)


# where statements are ------------------------------------------------------------------------------------------------

_HEADER = re.compile(r"^[ \t]*(\[.*\])[ \t]*(?:#.*)?\r?$\n?", re.MULTILINE)
_KEY = re.compile(r"^[ \t]*[^\s#\[\]{}=,][^=\n]*=", re.MULTILINE)
_PLAIN = re.compile(r"[ \t]*([A-Za-z0-9_-]+)[ \t]*=[ \t]*")


class _Statement(NamedTuple):
    """A header, or a key with its value: whole lines."""

    header: str
    """Of the table that it opens, or is in, without blanks and quotes: ``[[effect]]``."""
    content: dict[str, Any] | None
    """What a key says; None of a header."""
    place: slice


def _parts(
    text: str, start: int, stop: int, begins: re.Pattern[str]
) -> Iterator[tuple[int, int, dict[str, Any]]]:
    """Yield the stretches of a text that begin where a line matches, if each is TOML by itself, and what it says."""
    for end in [*(found.start() for found in begins.finditer(text, start, stop)), stop]:
        try:
            content = tomllib.loads(text[start:end].removeprefix("\ufeff"))
        except tomllib.TOMLDecodeError:  # the line is within a value
            continue
        yield start, end, content
        start = end


def _statements(text: str) -> Iterator[_Statement]:
    for start, stop, _ in _parts(text, 0, len(text), _HEADER):
        header, opened = "", start
        if found := _HEADER.match(text, start, stop):
            header, opened = re.sub(r"[\s\"']", "", found[1]), found.end()
            yield _Statement(header, None, slice(start, opened))
        for begin, end, content in _parts(text, opened, stop, _KEY):
            lines = text[begin:end].splitlines(keepends=True)
            while lines and re.match(r"\s*(#|\Z)", lines[-1]):
                lines.pop()
            if lines:
                yield _Statement(header, content, slice(begin, begin + len("".join(lines))))


def _blocks(text: str, name: str) -> list[list[slice]]:
    """Return the slices of each ``[[name]]``: its header, its keys and its own tables, wherever these are."""
    blocks: list[list[slice]] = []
    before = False  # whether the statement before was of a block
    for header, content, place in _statements(text):
        inside = header.strip("[]").split(".")[0] == name
        if header == f"[[{name}]]" and content is None:
            blocks.append([place])
        elif inside and before:
            blocks[-1][-1] = slice(blocks[-1][-1].start, place.stop)
        elif inside and blocks:
            blocks[-1].append(place)
        before = inside and bool(blocks)
    return [[_with_comments(text, part) for part in parts] for parts in blocks]


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


def _values(text: str) -> dict[tuple[str, int | str, str], tuple[str, slice]]:
    """Return the values of plain keys, as they are written and where.

    By table, number of its block or the name of the joint, target or branch that it is of, and key.
    """
    found: dict[tuple[str, int | str, str], tuple[str, slice]] = {}
    counts = Counter[str]()
    names: dict[tuple[str, int | str], str] = {}
    for header, content, place in _statements(text):
        if content is None:
            counts[header] += 1
        elif key := _PLAIN.match(text, place.start, place.stop):
            block = header.strip("[]"), counts[header]
            if key[1] == "name" and block[0] in {"joint", "target", "branch"}:
                names[block] = content["name"]
            written = _value(text[place].rstrip(), content, key.end() - place.start)
            found[*block, key[1]] = written, slice(key.end(), key.end() + len(written))
    return {(table, names.get((table, n), n), key): value for (table, n, key), value in found.items()}


def _value(statement: str, content: dict[str, Any], start: int) -> str:
    """Return the value of a statement as it is written, without a comment behind it."""
    for comment in re.finditer("#", statement):
        try:
            if tomllib.loads(statement[: comment.start()]) == content:
                return statement[start : comment.start()].rstrip()
        except tomllib.TOMLDecodeError:  # the sign is within the value
            continue
    return statement[start:]
