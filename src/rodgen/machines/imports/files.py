"""Import files: find out what each is, and make one machine, with readings where there are some."""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from rodgen.data.units import ANGLE, LENGTH, Dimension, UnitError, conversion_factor, typed_quantity
from rodgen.errors import InputFileError, UnexpectedError, UnfitArgumentError, joined, shown
from rodgen.files import read_start
from rodgen.machines.files.read import column_source, read_machine
from rodgen.machines.imports.denavit_hartenberg import is_table, machine_from_table
from rodgen.machines.imports.imported import Imported
from rodgen.machines.imports.printers import is_printer, is_probe_log, machine_from_klipper, with_probe_log
from rodgen.machines.imports.tables import measurements_of, numbered, with_targets
from rodgen.machines.imports.tpoint_data import is_pointing_run
from rodgen.machines.imports.tpoint_model import is_model, machine_from_tpoint
from rodgen.machines.imports.urdf import is_urdf, machine_from_urdf
from rodgen.machines.measured import NOTATIONS
from rodgen.machines.parts import ColumnSource

__all__ = ["import_files"]

_UNKNOWN = (
    "readings without a machine, as it is no URDF (<robot>), no Denavit-Hartenberg table (theta, d, a, alpha), no "
    "pointing run (:ALTAZ or :EQUAT) and no model (terms, then END) of TPOINT"
)
_URDF, _TABLE, _RUN, _MODEL = "a URDF", "a Denavit-Hartenberg table", "a pointing run", "a model of TPOINT"
_MACHINE, _READINGS = "a machine file", "a table of readings"
_PRINTER, _LOG = "a printer.cfg", "a probe log"


def import_files(
    sources: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    columns: Mapping[str, str] | None = None,
    joints: str | None = None,
    units: str | None = None,
    ballbar: str | None = None,
    base: str | None = None,
    tip: str | None = None,
    convention: str | None = None,
    estimate: str = "target",
    azimuth: str | None = None,
    format: int | None = None,
    latitude: str | None = None,
) -> Imported:
    """Make a machine, and readings, of files that other programs have written: what ``rodgen import`` does.

    Parameters
    ----------
    sources : str, path-like, or sequence of these
        A URDF, a Denavit-Hartenberg table, a pointing run, a model of TPOINT, a printer.cfg with a probe log, or a
        machine file; and tables of readings. What each is is told by its name and what it begins with.
    columns : mapping of str to str, optional
        Of tables: what a column is, with sign, unit and offset, such as ``{"A": "-A_axis [deg] + 90"}``.
    joints : str, optional
        Of tables: the column of the first joint, such as ``"q1"``; q2, q3 … are the others in their order.
    units : str, optional
        Of columns without: of lengths and of angles, such as ``"mm,deg"``; of deviations, too: ``"mm,deg,um"``.
    ballbar : str, optional
        Of a table with angle and radius: the circle, such as ``"XY=150mm"``.
    base, tip : str, optional
        Of a URDF: the links that stand still, and that are measured; default: the root, and the only leaf.
    convention : {"standard", "modified"}, optional
        Of a Denavit-Hartenberg table that does not tell.
    estimate : {"target", "geometry"}
        Of a URDF or a Denavit-Hartenberg table: what a fit adjusts.
    azimuth : {"north", "south"}, optional
        Of a pointing run: where azimuth is 0; it runs through east. Default: what its comments say, else north.
    format : {1, 2, 3, 4}, optional
        Of a pointing run: TPOINT's format of its lines.
    latitude : str, optional
        Of an equatorial mount, where no run gives it, such as ``"31.7deg"``.

    Returns
    -------
    Imported
        `Imported.text` is the machine file, `Imported.measurements` are the readings.

    Raises
    ------
    UnfitArgumentError
        When an argument cannot be read, or does not go with these files.
    InputFileError
        When the files are none that can be imported, or do not go together.
    """
    arguments: tuple[tuple[Any, ...], ...] = (
        ("joints", joints, None, str),
        ("base", base, None, str),
        ("tip", tip, None, str),
        ("convention", convention, None, "standard", "modified"),
        ("estimate", estimate, "target", "geometry"),
        ("azimuth", azimuth, None, "north", "south"),
        ("format", format, None, 1, 2, 3, 4),
        *(("columns", each, str) for pair in _pairs(columns) for each in pair),
    )
    for name, value, *allowed in arguments:
        if value not in allowed and not (str in allowed and isinstance(value, str)):
            words = ("text" if each is str else repr(each) for each in allowed)
            raise UnfitArgumentError(name, repr(value), joined(words, "or"))
    lengths = _units(str(units)) if units else None
    circle = _ballbar(str(ballbar)) if ballbar else None
    angle = None
    if latitude is not None:
        angle = _quantity("latitude", str(latitude), ANGLE, "an angle", "31.7deg")
    kinds: dict[str, list[str]] = {}
    for source in _files(sources):
        kinds.setdefault(_kind(source), []).append(source)
    for kind, files in kinds.items():
        if len(files) > 1 and kind != _READINGS:
            raise InputFileError(files[1], "file", f"{kind}, as is {files[0]}", "one of each kind")
    alone = [kind for kind in (_URDF, _TABLE, _MACHINE, _PRINTER) if kind in kinds]
    others = kinds.keys() - {_READINGS, _LOG} - set(alone[:1])
    if alone and others:
        file = kinds[alone[0]][0]
        raise InputFileError(file, "file", f"{alone[0]} together with {min(others)}", "one of the two")
    if alone == [_URDF]:
        imported = machine_from_urdf(kinds[_URDF][0], base, tip)
    elif alone == [_TABLE]:
        imported = machine_from_table(kinds[_TABLE][0], convention)
    elif alone == [_MACHINE]:
        imported = Imported(read_machine(kinds[_MACHINE][0]), (), is_given=True)
    elif alone == [_PRINTER]:
        imported = machine_from_klipper(kinds[_PRINTER][0])
    elif _RUN in kinds or _MODEL in kinds:
        run, model = (kinds.get(kind, [None])[0] for kind in (_RUN, _MODEL))
        imported = machine_from_tpoint(run, model, latitude=angle, azimuth=azimuth, form=format)
    else:
        file = kinds.get(_READINGS, kinds.get(_LOG, [""]))[0]
        raise InputFileError(file, "file", _UNKNOWN, "a machine file, too: 'rodgen new' makes one")
    if _LOG in kinds:
        imported = with_probe_log(imported, kinds[_LOG][0], *kinds.get(_PRINTER, ()))
    is_robot = alone in ([_URDF], [_TABLE])
    if estimate == "geometry":
        if not is_robot:
            found = "'geometry', and neither a URDF nor a Denavit-Hartenberg table"
            raise UnfitArgumentError("estimate", found, "[estimate] in the machine file")
        imported = _with_geometry(imported)
    elif is_robot:
        note = "Axes and points of joints are taken as they are; --estimate geometry calibrates them, too."
        imported = replace(imported, notes=(*imported.notes, note))
    if _READINGS not in kinds:
        return imported
    tables = kinds[_READINGS]
    if imported.columns:
        raise InputFileError(tables[0], "file", "a table, and a pointing run", "one of the two")
    stated = _stated(imported, columns or {}, joints)
    if is_robot and not {"x", "y", "z"} & stated.keys():
        imported = replace(imported, machine=with_targets(imported.machine, tables[0]))
    of_urdf = _URDF in kinds and not lengths
    imported = _with_readings(imported, tables, stated, ("m", "rad") if of_urdf else lengths, circle)
    note = "Columns without a unit are in m and rad, as the URDF is; --units says otherwise."
    return replace(imported, notes=(*imported.notes, note)) if of_urdf else imported


def _pairs(columns: Mapping[str, str] | None) -> list[tuple[str, str]]:
    """Return what columns are, by their names."""
    try:
        return [*dict(columns or {}).items()]
    except (TypeError, ValueError):
        expected = "a dict, such as {'A': '-A_axis [deg] + 90'}"
        raise UnfitArgumentError("columns", repr(columns), expected) from None


def _files(sources: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> list[str]:
    """Return the names of files; one alone is a list of one."""
    try:
        return [*map(os.fsdecode, [sources] if isinstance(sources, str | os.PathLike) else sources)]
    except TypeError:
        raise UnfitArgumentError("sources", repr(sources), "the name of a file, or several") from None


def _kind(source: str) -> str:
    """Return what a file is, by its name and what it begins with."""
    start = read_start(source, "a file to import")
    tests = {
        _TABLE: is_table(source, start),
        _MACHINE: source.lower().endswith(".toml"),
        _URDF: is_urdf(source, start),
        _RUN: is_pointing_run(start),
        _MODEL: is_model(start),
        _PRINTER: is_printer(start),
        _LOG: is_probe_log(start),
    }
    return next((name for name, fits in tests.items() if fits), _READINGS)


def _with_geometry(imported: Imported) -> Imported:
    """Return what was imported with axes and points to be estimated; those of the first joint are the base."""
    parts = {"revolute": ("axis", "point"), "prismatic": ("axis",)}
    first, *carried = imported.machine.joints
    estimate = tuple(f"{joint.name}.{part}" for joint in carried for part in parts[joint.type])
    machine = replace(imported.machine, estimate=estimate + imported.machine.estimate)
    note = (
        f"Axes and points of all joints but the first, {first.name}, are estimated: a rough geometry will do."
    )
    return replace(imported, machine=machine, notes=(*imported.notes, note))


def _stated(imported: Imported, columns: Mapping[str, str], joints: str | None) -> dict[str, ColumnSource]:
    """Return which columns are what, as the machine file and the arguments say."""
    stated, argument = dict(imported.machine.column_sources), "joints"
    try:
        if joints:
            columns_of_joints = [joint.column for joint in imported.machine.joints if joint.is_read]
            stated |= dict(
                zip(
                    columns_of_joints,
                    map(ColumnSource, numbered(joints, len(columns_of_joints))),
                    strict=True,
                )
            )
        argument = "column"
        stated |= {name.strip(): column_source(theirs) for name, theirs in columns.items()}
    except UnexpectedError as error:
        raise UnfitArgumentError(argument, error.found, error.expected) from None
    return stated


def _with_readings(
    imported: Imported,
    files: Sequence[str],
    stated: Mapping[str, ColumnSource],
    units: tuple[str, ...] | None,
    circle: tuple[str, str] | None,
) -> Imported:
    """Return what was imported with the readings of tables."""
    machine, fresh, ballbar = imported.machine, not imported.is_given, None
    if circle:
        plane, size = circle
        ballbar = plane, _quantity("ballbar", size, LENGTH, "a length", "150mm", machine.length_unit)
    columns, notes, places = measurements_of(machine, files, stated, units, ballbar, attitudes=fresh)
    names = {name.partition(" [")[0] for name in columns}
    if fresh and any(names >= set(notation) for notation in NOTATIONS.values()):
        machine = replace(machine, measured=replace(machine.measured, kind="pose"))
    return replace(
        imported,
        machine=machine,
        columns=columns,
        notes=(*imported.notes, *notes),
        source=", ".join(files),
        places=places if len(files) == 1 else (),
    )


def _quantity(
    argument: str, text: str, dimension: Dimension, words: str, example: str, unit: str = "mm"
) -> float:
    """Return what is typed with its unit, angles in radians."""
    with contextlib.suppress(UnitError):
        value = typed_quantity(text, dimension, unit, own=math.nan)
        if not math.isnan(value):  # as it is without a unit
            return value
    raise UnfitArgumentError(argument, shown(text), f"{words} with its unit, such as {example}")


def _ballbar(text: str) -> tuple[str, str]:
    """Return plane and radius."""
    plane, _, size = text.partition("=")
    expected = "two axes and a radius, such as XY=150mm"
    if not re.fullmatch("[XYZ]{2}", plane) or len(set(plane)) != 2:
        raise UnfitArgumentError("ballbar", shown(text), expected)
    if not _quantity("ballbar", size, LENGTH, "a length", "150mm") > 0:
        raise UnfitArgumentError("ballbar", shown(text), expected)
    return plane, size


def _units(text: str) -> tuple[str, ...]:
    """Return the units of lengths, of angles, and of deviations, where they are named."""
    units = tuple(part.strip() for part in text.split(","))
    kinds: Any = (("length", "mm"), ("angle", "deg"), ("length", "um"))
    try:
        if len(units) not in (2, 3):
            raise UnitError(shown(text), "")
        for unit, kind in zip(units, kinds, strict=False):
            conversion_factor(unit, *kind)
    except UnitError:
        expected = (
            "a unit of length and one of angle, such as mm,deg, or these and one of deviations: mm,deg,um"
        )
        raise UnfitArgumentError("units", shown(text), expected) from None
    return units
