"""A machine from a Denavit-Hartenberg table, standard or modified, as CSV or TOML.

Row j of a standard table is joint j and the link after it, Rz(theta) Tz(d) Tx(a) Rx(alpha); of a modified one (Craig's)
the link before it and the joint, Tx(a) Rx(alpha) Tz(d) Rz(theta). A link between nearly parallel axes may have a fifth
number, and ends in Ry(beta) (Hayati). The coordinate of a joint is added to its theta, or to its d where it slides;
with the sign -1 it is subtracted.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.data.measurements import Measurements, Names
from rodgen.data.units import ANGLE, LENGTH, Quantity, conversion_factor
from rodgen.errors import InputFileError, MissingOptionError, in_file, joined, listed, shown
from rodgen.machines.files.read import MOST_JOINTS
from rodgen.machines.files.schema import unit_of
from rodgen.machines.files.toml import NUMBER, PAIR, TEXT, VECTOR, Table, one_of, parse, read_text
from rodgen.machines.imports.imported import Imported, clean, machine_name
from rodgen.machines.machine import Machine
from rodgen.machines.measured import Measured
from rodgen.machines.parts import Joint, Target
from rodgen.machines.rigid import rotation_matrix

CONVENTIONS = {"standard": "Rz(theta) Tz(d) Tx(a) Rx(alpha)", "modified": "Tx(a) Rx(alpha) Tz(d) Rz(theta)"}
_NUMBERS: dict[str, Quantity] = {"a": "length", "alpha": "angle", "d": "length", "theta": "angle"}
_EXAMPLE = "theta [deg],d [mm],a [mm],alpha [deg]"
_LARGEST = 1e12
_COAXIAL = 1e-9
"""Relative distance of axes that is rounding."""
_SIGNS = ("+1", "-1")


@dataclass(frozen=True)
class _Row:
    """A joint and a link: lengths in the table's unit, angles in rad."""

    name: str
    type: str
    theta: float
    d: float
    a: float
    alpha: float
    sign: float
    travel: tuple[float, float] | None
    beta: float = 0.0

    @property
    def screw(self) -> Array:
        """Return Rz(theta) Tz(d)."""
        return _moved([0, 0, self.theta], [0, 0, self.d])

    @property
    def link(self) -> Array:
        """Return Tx(a) Rx(alpha) Ry(beta)."""
        return _moved([self.alpha, 0, 0], [self.a, 0, 0]) @ _moved([0, self.beta, 0], [0, 0, 0])


def is_table(file: str, start: bytes) -> bool:
    """Return whether a file is such a table, by its name and the first bytes of its content."""
    lines = start.decode("utf-8", "replace").lstrip("\ufeff").splitlines()
    if file.lower().endswith(".toml"):
        return any(line.split("=")[0].strip() == "convention" for line in lines)
    header = next((line for line in lines if line.strip()), "")
    return {name.partition("[")[0].strip() for name in header.split(",")} >= _NUMBERS.keys()


def machine_from_table(path: str | os.PathLike[str], convention: str | None = None) -> Imported:
    """Return the machine of a Denavit-Hartenberg table.

    Parameters
    ----------
    path : str or os.PathLike
        CSV with the columns theta, d, a, alpha, their units in brackets, and where wanted joint (a name), type (R or
        P), sign (+1 or -1), low and high (the travel of joints that turn); or TOML.
    convention : {"standard", "modified"}, optional
        Left out: what the table tells; a TOML table says it itself.

    Returns
    -------
    Imported
        Axes and points, those of the table's frames, in the frame before the first row; the target is the origin of
        the frame after the last.
        Readings are points in a free frame, and the target is estimated.

    Raises
    ------
    InputFileError
    """
    file = os.fspath(path)
    if file.lower().endswith(".toml"):
        title, convention, unit, rows, tool = _of_toml(file, convention)
    else:
        title, tool = os.path.splitext(os.path.basename(file))[0], (0.0, 0.0, 0.0)
        unit, rows = _of_csv(file)
    if not 0 < len(rows) <= MOST_JOINTS:
        raise InputFileError(file, "file", f"{len(rows)} rows", f"1 to {MOST_JOINTS}, one for each joint")
    largest = max(abs(getattr(row, key)) for row in rows for key in (*_NUMBERS, "beta"))
    if not largest < _LARGEST:
        raise InputFileError(file, "file", f"a number of {largest:g}", "lengths and angles of a usual size")
    told = ""
    if convention is None:
        convention, told = _told(file, rows)
    names: list[str] = []
    for row in rows:
        names.append(machine_name(row.name, names, joint=True))
    joints, frame = [], np.eye(4)
    for name, row in zip(names, rows, strict=True):
        frame = frame @ (row.link @ row.screw if convention == "modified" else np.eye(4))
        axis, point = row.sign * frame[:3, 2], frame[:3, 3]  # of modified rows at the end of d
        kind = "revolute" if row.type == "R" else "prismatic"
        point = point if row.type == "R" else np.zeros(3)
        joints.append(Joint(name, kind, clean(axis, 15), clean(point, 12), travel=row.travel))
        frame = frame @ (row.screw @ row.link if convention == "standard" else np.eye(4))
    targets = (Target("tool", clean((frame @ [*tool, 1.0])[:3], 12)),)
    head = (
        f"{os.path.basename(file)}: a {convention} Denavit-Hartenberg table of {len(rows)} joints, a row is "
        f"{CONVENTIONS[convention]}; lengths in {unit}."
    )
    return Imported(
        Machine(
            title,
            unit,
            "deg",
            (0.0, 0.0, -1.0),
            20.0,
            tuple(joints),
            targets,
            Measured("point", "free"),
            estimate=("target",),
        ),
        (head, *([told] if told else []), *_notes(names, rows), *_on_coaxial(joints, convention)),
    )


def _told(file: str, rows: Sequence[_Row]) -> tuple[str, str]:
    """Return the convention of a table, and a note on what tells it.

    The frame at rest stands on the first axis of a modified table, that of the last joint on its axis in a standard
    one: no link is there. Read the other way, such a link makes two joints turn about one axis.

    Raises
    ------
    InputFileError
        Where both ends have a link, or none has.
    """
    first, last = (not (row.a or row.alpha or row.beta) for row in (rows[0], rows[-1]))
    if first == last:
        found = "a and alpha of the first row and of the last are " + ("all 0" if first else "not 0")
        expected = ", or ".join(f"{name}, {order}" for name, order in CONVENTIONS.items())
        found = f"none, and the table does not tell it: {found}"
        raise MissingOptionError(file, "--convention", found, expected, "--convention=", [*CONVENTIONS])
    convention, end = ("modified", "first") if first else ("standard", "last")
    return (
        convention,
        f"It is {convention}, as a and alpha of the {end} row are 0; --convention says otherwise.",
    )


def _notes(names: list[str], rows: list[_Row]) -> Iterator[str]:
    if back := [name for name, row in zip(names, rows, strict=True) if row.sign < 0]:
        yield f"Turned the other way (sign -1): {joined(back)}."
    for name, row in zip(names, rows, strict=True):
        if name != row.name:
            yield f"Joint {shown(row.name)} is called {name}, as a machine file has it."
    yield "Frame and target are estimated: where the instrument is, and what it sees there, a table does not say."


def _on_coaxial(joints: Sequence[Joint], convention: str) -> Iterator[str]:
    """Yield that successive joints turn about one axis, as where a table is read by the other convention."""
    (other,) = CONVENTIONS.keys() - {convention}
    size = max(float(np.linalg.norm(joint.point)) for joint in joints)
    for a, b in pairwise(joints):
        apart = np.cross(a.axis, np.subtract(b.point, a.point))
        parallel = np.linalg.norm(np.cross(a.axis, b.axis)) < _COAXIAL
        if a.revolute and b.revolute and parallel and np.linalg.norm(apart) <= _COAXIAL * size:
            yield (
                f"{a.name} and {b.name} turn about one and the same axis: no robot is built so; this table is most "
                f"likely {other}."
            )


def _of_csv(file: str) -> tuple[str, list[_Row]]:
    table = Measurements.load(file)
    known = {*_NUMBERS, "beta", "joint", "type", "sign", "low", "high"}
    for name, column in table.columns.items():
        if name not in known:
            place = f"{table.header_place}, column {shown(column.text)}"
            raise InputFileError(file, place, "unknown column", listed(sorted(known)))
    unit = table.columns["a"].unit or ""
    factors = {name: _factor(table, name, quantity, unit) for name, quantity in _NUMBERS.items()}
    both = {"low", "high"} & table.columns.keys()
    factors |= {
        name: _factor(table, name, "angle", unit) for name in both | ({"beta"} & table.columns.keys())
    }
    if len(both) == 1:
        raise InputFileError(file, table.header_place, f"{both.pop()!r} alone", "low and high, the travel")

    def text(name: str, k: int, default: str) -> str:
        column = table.columns.get(name)
        if column is None:
            return default
        return str(column.values[k]) if isinstance(column, Names) else f"{column.values[k]:g}"

    rows = []
    for k in range(table.rows):
        numbers = {name: float(table.columns[name].values[k]) * factors[name] for name in factors}
        kind, sign = text("type", k, "R").upper(), text("sign", k, "1").removeprefix("+")
        for name, stated, options in (("type", kind, ("R", "P")), ("sign", sign, ("1", "-1"))):
            if stated not in options:
                raise InputFileError(file, f"{table.place(k)}, column {name}", shown(stated), listed(options))
        travel = (numbers.pop("low"), numbers.pop("high")) if both else None
        if travel and (kind == "P" or not travel[0] < travel[1]):
            found = (
                "the travel of a joint that slides"
                if kind == "P"
                else f"from {travel[0]:g} to {travel[1]:g} rad"
            )
            raise InputFileError(
                file, f"{table.place(k)}, column 'low'", found, "low and high of joints that turn"
            )
        rows.append(_Row(text("joint", k, f"J{k + 1}"), kind, sign=float(sign), travel=travel, **numbers))
    return unit, rows


def _factor(table: Measurements, name: str, quantity: Quantity, unit: str) -> float:
    """Return the factor of a column to the table's length, or to rad."""
    column = table.columns[name]
    place = f"{table.header_place}, column {shown(column.text)}"
    if isinstance(column, Names) or not column.unit:
        raise InputFileError(table.file, place, "no numbers with a unit", f"a header such as {_EXAMPLE}")
    with in_file(table.file, place):
        return conversion_factor(column.unit, quantity, unit if quantity == "length" else "rad")


def _of_toml(file: str, convention: str | None) -> tuple[str, str, str, list[_Row], Any]:
    top = Table(file, "", parse(read_text(file), file), ("name", "convention", "units", "joint", "tool"))
    stated = top.get("convention", one_of(tuple(CONVENTIONS)))
    if convention not in (None, stated):
        raise InputFileError(file, "convention", shown(stated), f"{convention}, as --convention says")
    units = top.sub("units", ("length", "angle"))
    length = units.get("length", unit_of(LENGTH, "mm"), "mm")
    angle = units.get("angle", unit_of(ANGLE, "deg"), "deg")
    rows = list(_toml_rows(top, conversion_factor(angle, "angle", "rad")))
    return top.get("name", TEXT, "Robot"), stated, length, rows, top.get("tool", VECTOR, (0.0, 0.0, 0.0))


def _toml_rows(top: Table, per_angle: float) -> Iterator[_Row]:
    keys = ("name", "type", "theta", "d", "a", "alpha", "beta", "sign", "travel")
    for number, block in enumerate(
        top.blocks("joint", MOST_JOINTS, missing=f"a block for each: {_EXAMPLE}"), start=1
    ):
        table = Table(top.file, f"[[joint]] {number}", block, keys)
        kind = table.get("type", one_of(("R", "P")), "R")
        of_coordinate = per_angle if kind == "R" else 1.0
        travel = table.get("travel", PAIR, None)
        if travel and not travel[0] < travel[1]:
            raise table.error("travel", f"{list(travel)}", "the lower number first, then a higher one")
        sign = table.get("sign", NUMBER, 1.0)
        if sign not in (1.0, -1.0):
            raise table.error("sign", f"{sign:g}", listed(_SIGNS))
        yield _Row(
            table.get("name", TEXT, f"J{number}"),
            kind,
            table.get("theta", NUMBER, 0.0) * per_angle,
            table.get("d", NUMBER, 0.0),
            table.get("a", NUMBER, 0.0),
            table.get("alpha", NUMBER, 0.0) * per_angle,
            sign,
            (travel[0] * of_coordinate, travel[1] * of_coordinate) if travel else None,
            table.get("beta", NUMBER, 0.0) * per_angle,
        )


def _moved(turn: Sequence[float], shift: Sequence[float]) -> Array:
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = rotation_matrix(turn), shift
    return motion
