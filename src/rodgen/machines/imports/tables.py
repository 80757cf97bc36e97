"""Measurements of a machine from tables as other programs write them.

A column is known by what ``[columns]`` or an option says, else by its name: a joint's; x, y, z (or ux, uy, uz, or d);
az and el, or ha and dec, where directions are measured; x1, y1, z1, x2 … or NAME_x … of several targets in a row;
target, run, load, t, T_… and what else a measurement file knows. Anything else is not taken, and a note says so.
"""

from __future__ import annotations

import contextlib
import datetime
import math
import os
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np

from rodgen.data.tables.foreign import ForeignColumn, ForeignTable, is_number, read_foreign
from rodgen.data.units import ANGLE, LENGTH, TIME, parse_unit
from rodgen.errors import (
    InputFileError,
    MissingOptionError,
    UnexpectedError,
    counted,
    in_file,
    joined,
    listed,
    nearest_name,
    shown,
)
from rodgen.machines.imports.deviations import as_distances, of_ballbar
from rodgen.machines.imports.imported import machine_name
from rodgen.machines.machine import Joint, Machine
from rodgen.machines.measured import NOTATIONS, TURNS
from rodgen.machines.mounts import ALTAZ, EQUATORIAL
from rodgen.machines.parts import ColumnSource

_PAIRS = {("az", "el"): ALTAZ, ("ha", "dec"): EQUATORIAL}
_ANGLES = {"angle", *chain(*_PAIRS), *NOTATIONS["rotation vector"], *NOTATIONS["roll, pitch and yaw"]}
_OTHER_NAMES = {
    "az": ("azimuth", "star_az", "true_az"),
    "el": ("alt", "altitude", "elevation", "star_el", "true_el", "star_alt"),
    "ha": ("hour_angle", "hourangle", "star_ha", "true_ha"),
    "dec": ("declination", "star_dec", "true_dec"),
    "t": ("time", "timestamp", "date", "datetime", "date_time", "utc"),
}
_AXIS_NAMES = ("{}_axis", "axis_{}", "{}_achse", "achse_{}")
_TARGET_NAMES = ("target", "ball", "marker", "reflector", "smr", "point")
"""Of a column that may say which target was read; a point may as well be a pose."""
_KEPT = ("run", "load", "t", "use")
_PREFIXES = ("u_", "dir_", "v_", "T_")
_WIDE = (
    re.compile(r"(?P<axis>[xyzXYZ])[_ .]?(?P<target>\d+)"),
    re.compile(r"(?P<target>.+?)[_ .](?P<axis>[xyzXYZ])"),
)
_FALSE = {"0", "0.0", "false", "no", "n", "bad"}


@dataclass
class _Columns:
    """The columns of a table that were found, and what is said of them."""

    table: ForeignTable
    found: dict[str, tuple[ForeignColumn, ColumnSource]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    targets: dict[str, str] = field(default_factory=dict)
    """By their labels in the table."""


def measurements_of(
    machine: Machine,
    files: Sequence[str],
    stated: Mapping[str, ColumnSource],
    units: tuple[str, ...] | None = None,
    ballbar: tuple[str, float] | None = None,
    *,
    attitudes: bool = False,
) -> tuple[dict[str, Any], list[str], list[str]]:
    """Return the columns of a measurement file, by names with units; notes on how it was read; and rows' places.

    Parameters
    ----------
    files : sequence of str
        Tables with the same columns; several are one a target, by their names, or one a run.
    stated : mapping of str to ColumnSource
        What is known of columns.
    units : tuple of str, optional
        Length and angle of columns that give none, and of deviations.
    ballbar : tuple of (str, float), optional
        Plane and nominal radius of circles; see :func:`rodgen.machines.imports.deviations.of_ballbar`.
    attitudes : bool
        Whether attitudes are taken though the machine reads points.

    Raises
    ------
    InputFileError
        When a column of the machine is missing, or has no unit.
    """
    notes: list[str] = []
    parts: list[dict[str, list[Any]]] = []
    places: list[str] = []
    targets = [target.name for target in machine.targets]
    tables = _paired(machine, [read_foreign(file) for file in files], stated)
    files = [table.file for table in tables]
    stems = [os.path.splitext(os.path.basename(file))[0] for file in files]
    for table, file, stem in zip(tables, files, stems, strict=True):
        here = stated
        if ballbar:
            table = of_ballbar(machine, table, *ballbar, units or ())
        else:
            named = _named_by_joints(machine, table, stated)
            distances = as_distances(machine, named, units or ())
            if distances is not named:
                joints = {joint.name for joint in machine.joints}
                table, here = distances, {n: source for n, source in stated.items() if n not in joints}
        turns = attitudes or machine.measurand.has_attitude
        columns, remarks, where = _of_table(machine, table, here, units, turns, is_target=stem in targets)
        places += where
        rows = len(next(iter(columns.values())))
        if "target" not in columns and (stem in targets or len(targets) == 1 < len(files)):
            columns["target"] = [stem if stem in targets else targets[0]] * rows
        if len(files) > 1 and not set(stems) <= set(targets):
            columns.setdefault("run", [stem] * rows)
        if parts and columns.keys() != parts[0].keys():
            found = f"columns {joined(columns)}"
            raise InputFileError(file, "file", found, f"those of {files[0]}: {joined(parts[0])}")
        parts.append(columns)
        notes += [note for note in remarks if note not in notes]
    if len(files) > 1:
        what = "target" if set(stems) <= set(targets) else "run"
        notes.append(f"Each of the {len(files)} files is a {what}, by its name.")
    if len(targets) > 1 and "target" not in parts[0]:
        expected = "a column target (--column target=THEIRS), x1, y1, z1, x2 …, "
        expected += f"or a file for each of {listed(targets)}"
        raise InputFileError(files[0], "file", "no targets", expected)
    every = {name: [cell for part in parts for cell in part[name]] for name in parts[0]}
    return (
        {name: cells if name in ("target", "run") else np.array(cells) for name, cells in every.items()},
        notes,
        places,
    )


def _paired(
    machine: Machine, tables: list[ForeignTable], stated: Mapping[str, ColumnSource]
) -> list[ForeignTable]:
    """Return the tables, two of which are one where the first has the commands and the second the readings.

    Rows belong together by a column that both have, in which each row has a value of its own, else by their order.
    """
    joints = [*_commanded(machine)]

    def has(table: ForeignTable) -> list[bool]:
        names = {_plain(column.name) for column in table.columns} | {c.header for c in table.columns}
        return [
            any(_plain(name) in names for name in _names_of_joint(joint))
            or (joint in stated and stated[joint].name in names)
            for joint in joints
        ]

    if len(tables) != 2 or sorted((all(has(t)), any(has(t))) for t in tables) != [
        (False, False),
        (True, True),
    ]:
        return tables
    commands, readings = sorted(tables, key=lambda table: not all(has(table)))
    theirs = {column.name: column for column in commands.columns}
    rows, how = [*range(len(readings.places))], "in their order"
    for column in readings.columns:
        if column.name in theirs:
            at = {str(cell): k for k, cell in enumerate(theirs[column.name].cells)}
            matched_rows = [at.get(str(cell), -1) for cell in column.cells]
            if (
                len(at) == len(commands.places)
                and len({*matched_rows}) == len(matched_rows)
                and min(matched_rows) >= 0
            ):
                rows, how = matched_rows, f"by {shown(column.header)}"
                break
    else:
        if len(commands.places) != len(readings.places):
            what = f"{len(readings.places)} rows, and {len(commands.places)} of commands in {commands.file}"
            expected = "a row for each command, or a column in both that says which row is which"
            raise InputFileError(readings.file, "file", what, expected)
    taken_names = {column.name for column in readings.columns}
    columns = [
        replace(column, cells=tuple(column.cells[k] for k in rows))
        for column in commands.columns
        if column.name not in taken_names
    ]
    note = f"Rows of {os.path.basename(commands.file)}, with the commands, belong to those of "
    note += f"{os.path.basename(readings.file)} {how}."
    notes = (*commands.notes, *readings.notes, note)
    return [replace(readings, columns=(*columns, *readings.columns), notes=notes)]


def _named_by_joints(
    machine: Machine, table: ForeignTable, stated: Mapping[str, ColumnSource]
) -> ForeignTable:
    """Return a table whose columns that are stated to be joints, without sign and offset, have the names of these."""
    names = {
        stated[joint.name].name: (joint.name, stated[joint.name].unit)
        for joint in machine.joints
        if joint.name in stated and (stated[joint.name].sign, stated[joint.name].offset) == (1.0, 0.0)
    }
    columns = []
    for column in table.columns:
        name, unit = names.get(column.name, names.get(column.header, (column.name, "")))
        columns.append(replace(column, name=name, unit=unit or column.unit))
    return replace(table, columns=tuple(columns))


def _names_of_joint(joint: str) -> list[str]:
    return [joint, *(each.format(joint) for each in _AXIS_NAMES)]


def _of_table(
    machine: Machine,
    table: ForeignTable,
    stated: Mapping[str, ColumnSource],
    units: tuple[str, ...] | None,
    attitudes: bool,
    *,
    is_target: bool,
) -> tuple[dict[str, list[Any]], list[str], list[str]]:
    columns = _Columns(table, notes=list(table.notes))
    _take_stated(columns, stated)
    for name in _commanded(machine):
        _take_named(columns, name, _names_of_joint(name), machine)
    if attitudes:
        _take_attitude(columns, machine)
    wide = {} if all(name in columns.found for name in _places(machine)) else _take_readings(columns, machine)
    for column in table.columns:
        if column.name in _KEPT or column.name.startswith(_PREFIXES):
            _take_named(columns, column.name, (), machine)
    _take_named(columns, "t", _OTHER_NAMES["t"], machine)
    _check_all(columns, machine, wide)
    if not wide:
        _take_target(columns, machine, is_stated="target" in stated, is_target=is_target)
    _leave_unreadable_time(columns, stated)
    taken = {id(column) for column, _ in columns.found.values()}
    taken |= {id(column) for each in wide.values() for column in each.values()}
    left = [column.header for column in table.columns if id(column) not in taken]
    if left:
        columns.notes.append(
            f"Not taken: {joined(map(shown, left))}; --column NAME=THEIRS, or [columns], takes a column."
        )
    if attitudes and not any(columns.found.keys() >= set(n) for n in NOTATIONS.values()):
        columns.notes += _perhaps_attitudes(left)
    keep, why = _kept_rows(columns)
    columns.notes += why
    table_of_machine, rows = _converted(columns, machine, keep, wide, units)
    return table_of_machine, columns.notes, [table.places[k] for k in rows]


# what is what ------------------------------------------------------------------------------------------


def _take_stated(columns: _Columns, stated: Mapping[str, ColumnSource]) -> None:
    theirs = {column.name: column for column in columns.table.columns}
    theirs |= {column.header: column for column in columns.table.columns}
    for name, source in stated.items():
        column = theirs.get(source.name)
        if column is None:
            near = nearest_name(source.name, theirs)
            expected = f"{near!r}, perhaps" if near else listed([c.header for c in columns.table.columns])
            found = f"no column {shown(source.name)} for {name}"
            raise InputFileError(columns.table.file, columns.table.header, found, expected)
        columns.found[name] = column, source
        how = "-" if source.sign < 0 else ""
        how += shown(column.header) + (f" {source.offset:+g}" if source.offset else "")
        columns.notes.append(f"{name} is {how}.")


def _take_named(columns: _Columns, name: str, others: Sequence[str], machine: Machine) -> bool:
    """Take the column of a name: as it is, else with small letters for capitals, else one of its other names."""
    if name in columns.found:
        return True
    taken = {id(column) for column, _ in columns.found.values()}
    free = [column for column in columns.table.columns if id(column) not in taken]
    exact = [column for column in free if column.name == name]
    # the sky's az is not the axis AZ
    joints = _commanded(machine).keys()
    alike = [
        column
        for column in free
        if _plain(column.name) in {_plain(name), *map(_plain, others)} and column.name not in joints - {name}
    ]
    for column in (*exact, *alike)[:1]:
        columns.found[name] = column, ColumnSource(column.name)
        if column.name != name:
            columns.notes.append(f"{name} is {shown(column.header)}.")
        return True
    return False


def _leave_unreadable_time(columns: _Columns, stated: Mapping[str, ColumnSource]) -> None:
    """Take no column for the time of rows by its name alone where it has none."""
    if "t" in columns.found and "t" not in stated:
        column, _ = columns.found["t"]
        if all(cell is None or is_number(cell) for cell in column.cells):
            return
        try:
            _seconds(columns.table, column)
        except InputFileError as error:
            del columns.found["t"]
            columns.notes.append(
                f"{shown(column.header)} is no time: {error.found}; expected {error.expected}."
            )


def _take_target(columns: _Columns, machine: Machine, *, is_stated: bool, is_target: bool) -> None:
    """Take the column that says which target was read in each row.

    Its labels are names of targets, the numbers in them, or as many as there are targets, in the order in which they
    occur. A column whose labels name rows or poses is not taken, nor one of a machine with one target unless it has
    two labels at one command.

    Parameters
    ----------
    is_stated : bool
        Whether the column is known already.
    is_target : bool
        Whether all rows are of one target, by the name of their file.
    """
    taken = {id(column) for column, _ in columns.found.values()}
    free = [column for column in columns.table.columns if id(column) not in taken]
    called = [c for name in _TARGET_NAMES[: 1 if is_target else None] for c in free if _plain(c.name) == name]
    if is_stated:
        called, free = [columns.found["target"][0]], []
    names = [target.name for target in machine.targets]
    commanded = [columns.found[name][0].cells for name in _commanded(machine) if name in columns.found]
    commands = [*zip(*commanded, strict=True)] or [()] * len(columns.table.places)
    for column in (*called, *(column for column in free if not is_target and {*column.cells} <= {*names})):
        rows = [k for k, cell in enumerate(column.cells) if cell is not None]
        labels = [_label(column.cells[k]) for k in rows]
        each = [*dict.fromkeys(labels)]
        pairs = {(label, commands[k]) for label, k in zip(labels, rows, strict=True)}
        poses = len(pairs) == len(each) == len({commands[k] for k in rows}) and not is_stated
        if each and (targets_of := _targets(each, names, only_by_name=poses)):
            columns.targets = targets_of
            columns.found["target"] = column, ColumnSource(column.name)
            alternatives = [f"{label} is {name}" for label, name in targets_of.items() if label != name]
            how = f": {joined(alternatives)}" if alternatives else ""
            how = how or ("" if column in called else ", which has names of targets")
            columns.notes.append(f"target is {shown(column.header)}{how}.")
            return
        # of one target, labels that no command has two of are of rows, whatever the column is called
        rows_of = len(names) == 1 and len(pairs) == len({command for _, command in pairs})
        is_label = poses or rows_of or len(each) == len(labels)
        if (each and not (is_label or _plain(column.name) == "point")) or is_stated:
            wrong = next((k for k, label in zip(rows, labels, strict=True) if label not in names), 0)
            place = f"{columns.table.places[wrong]}, column {shown(column.header)}"
            what = "the machine's target" if len(names) == 1 else "one of the machine's targets"
            raise InputFileError(
                columns.table.file, place, shown(column.cells[wrong]), f"{what}, {joined(names)}"
            )


def _targets(labels: Sequence[str], names: Sequence[str], *, only_by_name: bool) -> dict[str, str] | None:
    """Return the targets by their labels, None where these are not all of targets."""
    by_name = {_plain(name): name for name in names}
    if len(by_name) == len(names) and all(_plain(label) in by_name for label in labels):
        return {label: by_name[_plain(label)] for label in labels}
    if {*labels} <= {*names}:
        return {label: label for label in labels}
    if only_by_name and len(names) > 1:
        return None
    numbers = {name: re.search(r"\d+$", name) for name in names}
    by_number = {int(number[0]): name for name, number in numbers.items() if number}
    if all(label.isdecimal() for label in labels):
        labels = sorted(labels, key=int)
        if len(by_number) == len(names) and {*map(int, labels)} <= by_number.keys():
            return {label: by_number[int(label)] for label in labels}
    return dict(zip(labels, names, strict=True)) if len(labels) == len(names) else None


def _label(cell: Any) -> str:
    return "" if cell is None else f"{cell:g}" if isinstance(cell, float) else str(cell)


def _places(machine: Machine) -> tuple[str, ...]:
    """Return the columns of a reading but for those of an attitude."""
    return tuple(name for name in machine.measurand.columns if name not in TURNS)


def _take_attitude(columns: _Columns, machine: Machine) -> None:
    """Take the columns of an attitude, in the first notation that is there."""
    names = {*columns.found, *(_plain(column.name) for column in columns.table.columns)}
    for ending in ("", "1", "_1"):
        for words, notation in NOTATIONS.items():
            theirs = [f"{name}{ending}" for name in notation]
            if set(theirs) <= names and not (ending and f"{notation[0]}{ending[:-1]}2" in names):
                for name, column_name in zip(notation, theirs, strict=True):
                    _take_named(columns, name, (column_name,), machine)
                columns.notes.append(f"{', '.join(notation)} are attitudes: {words}.")
                return


def _perhaps_attitudes(headers: Sequence[str]) -> Iterator[str]:
    """Yield how columns that were not taken, three of a name with x, y and z, are taken for an attitude."""
    for match in filter(None, (re.fullmatch(r"(.*)x(\d*)", header) for header in headers)):
        three = [f"{match[1]}{x}{match[2]}" for x in "xyz"]
        if {*three} <= {*headers}:
            ways = []
            for words in ("roll, pitch and yaw", "rotation vector"):
                named = zip(NOTATIONS[words], three, strict=True)
                ways.append(f"{' '.join(f'--column {name}={theirs}' for name, theirs in named)} ({words})")
            yield f"{', '.join(map(shown, three))} may be an attitude: {' or '.join(ways)}."


def _plain(name: str) -> str:
    return re.sub(r"[\s_.-]+", "_", name.strip().lower())


def _take_readings(columns: _Columns, machine: Machine) -> dict[str, dict[str, ForeignColumn]]:
    """Take the columns of readings; return those of wide rows, by target and axis."""
    readings = _places(machine)
    if machine.measurand.is_direction:
        for pair, mount in _PAIRS.items():
            names = [column.name for column in columns.table.columns]
            known = any(_plain(n) in {_plain(x) for x in (pair[0], *_OTHER_NAMES[pair[0]])} for n in names)
            if (known or pair[0] in columns.found) and all(
                _take_named(columns, name, _OTHER_NAMES[name], machine) for name in pair
            ):
                columns.notes.append(f"{pair[0]} and {pair[1]} are directions: {mount.frame}.")
                return {}
    taken = {id(column) for column, _ in columns.found.values()}
    if readings == ("x", "y", "z") and (wide := _in_a_row(columns.table, taken)):
        return _named_targets(columns, machine, wide)
    for name in readings:
        _take_named(columns, name, (), machine)
    return {}


def _in_a_row(table: ForeignTable, taken: Collection[int] = ()) -> dict[str, dict[str, ForeignColumn]]:
    """Return the columns of x, y and z of each target of a row; empty where these are not in its columns' names.

    Columns x, y and z are those of one target, whatever else has three parts. Those whose id is taken are others.
    """
    if any(column.name in ("x", "y", "z") for column in table.columns):
        return {}
    for pattern in _WIDE:
        wide: dict[str, dict[str, ForeignColumn]] = {}
        for column in table.columns:
            match = pattern.fullmatch(column.name)
            if match and id(column) not in taken:
                wide.setdefault(match["target"], {})[match["axis"].lower()] = column
        if wide := {target: axes for target, axes in wide.items() if len(axes) == 3}:
            return wide
    return {}


def with_targets(machine: Machine, file: str) -> Machine:
    """Return a machine of one target with as many as a row of a table reads, or a column names; all where that is.

    Parameters
    ----------
    machine : Machine
        Its target is estimated.
    file : str
        A table of readings.

    Raises
    ------
    InputFileError
        When the file is no table.
    """
    (target,) = machine.targets
    table = read_foreign(file)
    several = [*_in_a_row(table)] or _labels_of_targets(table)
    if len(several) < 2:
        return machine
    names = list[str]()
    for label in several:
        names.append(machine_name(f"{target.name}_{label}", names))
    return replace(machine, targets=tuple(replace(target, name=name) for name in names))


def _labels_of_targets(table: ForeignTable) -> list[str]:
    """Return the labels of a column of targets; none where they are those of rows or poses: few rows have each."""
    for column in (c for c in table.columns if _plain(c.name) in _TARGET_NAMES[:-1]):
        counts = Counter(_label(cell) for cell in column.cells if cell is not None)
        if 2 * len(counts) < counts.total():  # else the readings say little more than where targets are
            return [*counts]
    return []


def _named_targets(
    columns: _Columns, machine: Machine, wide: dict[str, dict[str, ForeignColumn]]
) -> dict[str, dict[str, ForeignColumn]]:
    targets = [target.name for target in machine.targets]
    if not wide.keys() <= set(targets):
        if len(wide) != len(targets):
            found = f"readings of {len(wide)} targets, {joined(wide)}"
            raise InputFileError(
                columns.table.file, columns.table.header, found, f"those of the machine: {joined(targets)}"
            )
        wide = dict(zip(targets, wide.values(), strict=True))
    assignments = [
        f"{target} is {' '.join(shown(axes[x].header) for x in 'xyz')}" for target, axes in wide.items()
    ]
    columns.notes.append(f"Readings of {counted(len(wide), 'target')} in a row: {joined(assignments)}.")
    return wide


def _commanded(machine: Machine) -> dict[str, Joint]:
    """Return the joints that have a column, by its name."""
    return {joint.column: joint for joint in machine.joints if joint.is_read}


def _check_all(columns: _Columns, machine: Machine, wide: Mapping[str, Any]) -> None:
    headers = [column.header for column in columns.table.columns]
    needed = [*_commanded(machine)]
    pair = any(all(name in columns.found for name in names) for names in _PAIRS)
    needed += [] if wide or pair else _places(machine)
    if machine.measurand.has_attitude and not any(columns.found.keys() >= set(n) for n in NOTATIONS.values()):
        needed += NOTATIONS["rotation vector"]
    for name in needed:
        if name not in columns.found:
            what = f"joint {name}" if name in _commanded(machine) else name
            option, choices = f"--column={name}=", headers
            expected = f"--column {name}=THEIRS, where THEIRS is {listed(headers)}"
            if name in _commanded(machine) and (
                first := _first_of_numbered(columns, len(_commanded(machine)))
            ):
                option, choices = "--joints=", [first]
                expected = f"--joints {first}, where the columns from that on are the joints in their order"
            table, found = columns.table, f"no column of {what}"
            raise MissingOptionError(table.file, table.header, found, expected, option, choices)


def _first_of_numbered(columns: _Columns, count: int) -> str:
    """Return the first of so many columns that are numbered on, such as q1, q2 and q3; empty where none are."""
    names = {column.name for column in columns.table.columns}
    for name in (column.name for column in columns.table.columns):
        with contextlib.suppress(UnexpectedError):
            if numbered(name, count)[-1] in names and {*numbered(name, count)} <= names:
                return name
    return ""


def numbered(first: str, count: int) -> list[str]:
    """Return the names of columns that are numbered on from the first.

    Examples
    --------
    >>> numbered("q1", 3), numbered("axis_0_actual", 2)
    (['q1', 'q2', 'q3'], ['axis_0_actual', 'axis_1_actual'])

    Raises
    ------
    UnexpectedError
        Where the first has no number.
    """
    match = re.fullmatch(r"(.*?)(\d+)(\D*)", first)
    if match is None:
        raise UnexpectedError(
            shown(first), "the name of the first joint's column, with its number, such as q1"
        )
    before, number, after = match.groups()
    return [f"{before}{int(number) + k}{after}" for k in range(count)]


def _kept_rows(columns: _Columns) -> tuple[list[int], list[str]]:
    """Return the numbers of the rows that stay, and why others do not."""
    rows = range(len(columns.table.places))
    notes = []
    if "use" in columns.found:
        cells = columns.found["use"][0].cells
        used = [k for k in rows if cells[k] is not None and str(cells[k]).strip().lower() not in _FALSE]
        if len(used) < len(rows):
            notes.append(f"Rows that are not to be used stay out: {len(rows) - len(used)}.")
        return used, notes
    return list(rows), notes


# values ------------------------------------------------------------------------------------------------


def _converted(
    columns: _Columns,
    machine: Machine,
    keep: list[int],
    wide: Mapping[str, Mapping[str, ForeignColumn]],
    units: tuple[str, ...] | None,
) -> tuple[dict[str, list[Any]], list[int]]:
    """Return the columns of measurements, and of each row its number in the table; rows with a blank cell stay out."""
    table = columns.table
    numbers: dict[str, list[float]] = {}
    words: dict[str, list[str]] = {}
    for name, (column, source) in columns.found.items():
        if name == "use":
            continue
        if name in ("target", "run"):
            words[name] = [columns.targets.get(label, label) for label in map(_label, column.cells)]
        elif name == "t" and not all(c is None or is_number(c) for c in column.cells):
            numbers["t [s]"] = _seconds(table, column)
        else:
            unit, scale = _unit(columns, machine, name, column, source, units)
            values = [scale * (source.sign * x) + source.offset * scale for x in table.numbers(column)]
            numbers[f"{name} [{unit}]" if unit else name] = values
    for pair, mount in _PAIRS.items():
        angles = [next((key for key in numbers if key.partition(" [")[0] == name), "") for name in pair]
        if all(angles) and machine.measurand.is_direction:
            radians = [
                np.array(numbers.pop(key)) * parse_unit(key.partition(" [")[2][:-1]).factor()
                for key in angles
            ]
            numbers |= dict(zip(("ux", "uy", "uz"), mount.direction(*radians).T.tolist(), strict=True))
    targets: list[tuple[str, dict[str, list[float]]]] = [("", {})]
    if wide:
        targets = []
        for target, axes in wide.items():
            seen = {}
            for axis in "xyz":
                source = ColumnSource(axes[axis].name)
                unit, scale = _unit(columns, machine, axis, axes[axis], source, units)
                seen[f"{axis} [{unit}]"] = [scale * x for x in table.numbers(axes[axis])]
            targets.append((target, seen))
    # the targets of a row are one pose: they stay together
    chosen = [
        (k, target, seen)
        for k in keep
        for target, seen in targets
        if all(math.isfinite(values[k]) for values in (*numbers.values(), *seen.values()))
        and ("target" not in words or words["target"][k])
    ]
    if not chosen:
        raise InputFileError(
            table.file, "file", "no row without a blank cell", "rows with commands and readings"
        )
    out = len(keep) * len(targets) - len(chosen)
    if out:
        columns.notes.append(f"Rows or targets with a blank cell stay out: {out}.")
    converted: dict[str, list[Any]] = {
        name: [values[k] for k, _, _ in chosen] for name, values in numbers.items()
    }
    converted |= {name: [seen[name][k] for k, _, seen in chosen] for name in targets[0][1]}
    if len(machine.targets) > 1 and wide:
        converted["target"] = [target for _, target, _ in chosen]
    converted |= {name: [texts[k] for k, _, _ in chosen] for name, texts in words.items()}
    return converted, [k for k, _, _ in chosen]


def _unit(
    columns: _Columns,
    machine: Machine,
    name: str,
    column: ForeignColumn,
    source: ColumnSource,
    units: tuple[str, ...] | None,
) -> tuple[str, float]:
    """Return the unit of a column of measurements, and the factor from theirs; an empty unit where there is none."""
    unit = source.unit or column.unit
    joints = _commanded(machine)
    wanted = joints[name].dimension if name in joints else None
    if name in ("x", "y", "z", "d"):
        wanted = LENGTH
    if name in _ANGLES:
        wanted = ANGLE
    if unit in ("h", "hour", "hours", "hr") and wanted == ANGLE:
        return "deg", 15.0
    if not unit and name == "t":
        return "s", 1.0
    if not unit and wanted in (LENGTH, ANGLE):
        if units is None:
            expected = "--units such as mm,deg for columns without, or the unit in brackets"
            place = f"column {shown(column.header)}"
            raise MissingOptionError(columns.table.file, place, "no unit", expected, "--units=", USUAL_UNITS)
        return units[wanted == ANGLE], 1.0
    if unit:
        with in_file(columns.table.file, f"column {shown(column.header)}"):
            dimension = parse_unit(unit).dimension
        if (wanted is not None and dimension != wanted) or (name == "t" and dimension != TIME):
            expected = f"one of {wanted or TIME}, for {name}"
            raise InputFileError(
                columns.table.file, f"column {shown(column.header)}", f"a unit of {dimension}", expected
            )
    return unit, 1.0


USUAL_UNITS = ("mm,deg", "m,deg", "mm,rad", "m,rad", "in,deg")
"""Of lengths and angles, in which tables are usually written."""
_NO_DATE = datetime.date(1, 1, 1)
"""Of times of the day."""


def _time(cell: Any) -> datetime.datetime:
    """Return a time.

    Raises
    ------
    ValueError
    """
    if isinstance(cell, datetime.datetime):
        return cell
    if isinstance(cell, datetime.time):
        return datetime.datetime.combine(_NO_DATE, cell)
    text = str(cell)
    with contextlib.suppress(ValueError):
        return datetime.datetime.combine(_NO_DATE, datetime.time.fromisoformat(text))
    if german := re.fullmatch(r"(\d\d?)\.(\d\d?)\.(\d{4})[ T](.+)", text):
        day, month, year, rest = german.groups()
        text = f"{year}-{int(month):02}-{int(day):02}T{rest}"
    return datetime.datetime.fromisoformat(text)


def _seconds(table: ForeignTable, column: ForeignColumn) -> list[float]:
    """Return seconds from the first time of a column of times: ISO, day.month.year, or of the day alone."""
    times: list[datetime.datetime | None] = []
    day, last = datetime.timedelta(days=1), None
    for place, cell in zip(table.places, column.cells, strict=True):
        try:
            time = None if cell is None else _time(cell)
        except ValueError:
            where, expected = f"{place}, column {shown(column.header)}", "a time such as 2026-03-01T12:30:00"
            raise InputFileError(table.file, where, shown(cell), expected) from None
        if time and last and last.year == _NO_DATE.year:
            time -= (time - last) // day * day  # past midnight
        last = time or last
        times.append(time)
    aware = [time.tzinfo is not None for time in times if time]
    if any(aware) and not all(aware):
        where = f"column {shown(column.header)}"
        raise InputFileError(table.file, where, "times with and without a zone", "all with, or all without")
    first = next((time for time in times if time), None)
    return [(time - first).total_seconds() if time and first else math.nan for time in times]
