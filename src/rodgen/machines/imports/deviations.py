"""Tests of single axes and of circles as distances: deviations at positions (ISO 230-2), and a ballbar (ISO 230-4).

Both say by how much something is off; a distance is what a machine's model predicts. A deviation is added to the
distance that the machine of the file has there. A ballbar's angle is turned into the commands that bring its ball
there.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rodgen.array_types import Array
from rodgen.data.tables.foreign import ForeignColumn, ForeignTable
from rodgen.data.units import Quantity, conversion_factor
from rodgen.errors import InputFileError, in_file, joined, listed, shown
from rodgen.machines.machine import Machine
from rodgen.machines.mechanism import to_mechanism

_POSITION = ("position", "target position", "target", "nominal", "nominal position", "sollposition")
_DEVIATION = ("deviation", "error", "dev", "r-dev", "dr", "radial deviation", "radius deviation")
_ANGLE = ("angle", "theta", "phi")
_RADIUS = ("radius", "r", "d", "length")
_UP, _DOWN = ("↑", "+", "up", "pos", "fwd", "forward"), ("↓", "-", "down", "neg", "rev", "back", "backward")
_PASS = re.compile(
    rf"(?:run|pass|j\s*=)?\s*(?P<run>\d+)\s*[_ ]?\s*(?P<way>{'|'.join(map(re.escape, (*_UP, *_DOWN)))})",
    re.IGNORECASE,
)


def as_distances(machine: Machine, table: ForeignTable, units: Sequence[str] = ()) -> ForeignTable:
    """Return a table of deviations at positions as distances; any other table as it is.

    Parameters
    ----------
    machine : Machine
        That measures distances.
    table : ForeignTable
        A column of positions, called by the joint or ``position`` where there is one joint; and a column ``deviation``,
        or one for each run and direction, such as ``1 ↑``, ``1 ↓``, ``2 ↑``.
    units : sequence of str
        Length, angle, and deviation, of columns that give none.

    Returns
    -------
    ForeignTable
        Runs one after the other, each with its positions in the order in which they are approached. Other joints are at
        zero.
    """
    joints = {joint.name: joint for joint in machine.joints}
    single = _first(table, _DEVIATION)
    passes = [(column, _PASS.fullmatch(column.name)) for column in table.columns]
    passes = [each for each in passes if each[1]] or [(column, None) for column in (single,) if column]
    names = [column for column in table.columns if column.name in joints]
    position = names[0] if len(names) == 1 else _first(table, _POSITION)
    if passes and passes[0][1] and not machine.measurand.has_origin:
        what = f"kind = {machine.measured.kind!r}, and deviations at positions in {table.file}"
        expected = "kind = 'distance' and from = the laser's place, as 'rodgen new linear-axis' writes it"
        raise InputFileError(machine.file or machine.name, "[measured], kind", what, expected)
    if not machine.measurand.has_origin or position is None or not passes or _first(table, ("d",)):
        return table
    if position.name in joints:
        joint = joints[position.name]
    elif len(joints) == 1:
        (joint,) = joints.values()
    else:
        what = f"the column {shown(position.header)} of a machine with the joints {joined(joints)}"
        expected = f"--column JOINT={shown(position.name)}, or the joint's name in its place"
        raise InputFileError(table.file, table.header, what, expected)
    commanded = _numbers(table, position, "angle" if joint.revolute else "length", machine, units)
    rows = np.arange(len(commanded))
    orders, offs, runs, ways = [], [], list[str](), list[float]()
    for column, readings in passes:
        off = _numbers(table, column, "length", machine, units[2:])
        order = rows
        if readings is not None:
            up = readings["way"].lower() in _UP
            order = np.argsort(commanded if up else -commanded, kind="stable")
            runs += [readings["run"]] * len(rows)
            ways += [1.0 if up else -1.0] * len(rows)
        orders.append(order)
        offs.append(off[order])
    order = np.concatenate(orders)
    q = np.zeros((len(order), len(joints)))
    q[:, machine.number_of(joint.name)] = commanded[order]
    columns = _commands(machine, q)
    columns.append(_column("d", machine.length_unit, _distances(machine, q) + np.concatenate(offs)))
    if runs:
        columns.append(ForeignColumn("run", "run", "", tuple(runs)))
        columns.append(ForeignColumn(f"dir_{joint.name}", f"dir_{joint.name}", "", tuple(ways)))
    else:
        used = {id(position), id(single)}
        columns += [column for column in table.columns if id(column) not in used]
    note = f"Deviations at positions of {joint.name}"
    note += f", {len(passes)} runs one after the other" if runs else ""
    note += "; as distances, the deviation more than the file's."
    if len(joints) > 1:
        note += " Other joints are at zero."
    return replace(
        table,
        columns=tuple(columns),
        places=tuple(table.places[k] for k in order),
        notes=(*table.notes, note),
    )


def of_ballbar(
    machine: Machine, table: ForeignTable, plane: str, radius: float, units: Sequence[str] = ()
) -> ForeignTable:
    """Return a ballbar's table as commands and distances.

    Parameters
    ----------
    machine : Machine
        That measures distances from the centre ball, with linear axes that reach the circle.
    table : ForeignTable
        With columns of the angle, and of the radius or its deviation.
    plane : str
        Two machine axes, such as ``"XY"``: the angle is from the first to the second.
    radius : float
        Nominal, in the machine's unit of length.
    units : sequence of str
        Length, angle, and deviation, of columns that give none.

    Raises
    ------
    InputFileError
    """
    if machine.measured.origin is None:
        found = f"kind = {machine.measured.kind!r}"
        expected = (
            "kind = 'distance' and from = the circle's centre, as 'rodgen new 3-axis --ballbar' writes it"
        )
        raise InputFileError(machine.file or machine.name, "[measured], kind", found, expected)
    angle = _first(table, _ANGLE)
    length, off = _first(table, _RADIUS), _first(table, _DEVIATION)
    if angle is None or (length is None and off is None):
        expected = "angle, and radius or deviation"
        raise InputFileError(
            table.file, table.header, f"columns {listed([c.header for c in table.columns])}", expected
        )
    turn = _numbers(table, angle, "angle", machine, units)
    first, second = (np.eye(3)["XYZ".index(axis)] for axis in plane)
    way = np.outer(np.cos(turn), first) + np.outer(np.sin(turn), second)
    places = np.array(machine.measured.origin) + radius * way
    linear = [j for j, joint in enumerate(machine.joints) if not joint.revolute]
    axes = np.array([machine.joints[j].axis for j in linear]).T
    axes = np.where(np.array(linear) < machine.inner, -axes, axes)
    start = np.array(machine.targets[0].point)
    q = np.zeros((len(turn), len(machine.joints)))
    if linear:
        q[:, linear] = np.linalg.lstsq(axes, (places - start).T, rcond=None)[0].T
    missed = float(np.abs(_distances(machine, q) - radius).max())
    if missed > 1e-6 * radius:
        found = f"linear axes that miss the circle by {missed:.3g} {machine.length_unit}"
        raise InputFileError(
            machine.file or machine.name, "[[joint]]", found, f"axes that move in the plane {plane}"
        )
    if length is not None:
        measured = _numbers(table, length, "length", machine, units)
    else:
        assert off is not None
        measured = radius + _numbers(table, off, "length", machine, units[2:])
    used = {id(angle), id(length), id(off)}
    columns = [
        *_commands(machine, q),
        _column("d", machine.length_unit, measured),
        *(column for column in table.columns if id(column) not in used),
    ]
    centre = list(machine.measured.origin)
    note = f"A circle of {radius:g} {machine.length_unit} in {plane} about {centre}: angles are commands."
    return replace(table, columns=tuple(columns), notes=(*table.notes, note))


def _first(table: ForeignTable, names: Sequence[str]) -> ForeignColumn | None:
    return next((column for column in table.columns if column.name.strip().lower() in names), None)


def _numbers(
    table: ForeignTable, column: ForeignColumn, quantity: Quantity, machine: Machine, units: Sequence[str]
) -> Array:
    """Return a column in the machine's length, or in rad; `units` are of length and angle where it gives none."""
    place = f"column {shown(column.header)}"
    unit = column.unit or "".join(units[quantity == "angle" :][:1])
    if not unit:
        expected = (
            "its unit in brackets, such as [um], or --units mm,deg,um: of lengths, angles and deviations"
        )
        raise InputFileError(table.file, place, "no unit", expected)
    with in_file(table.file, place):
        factor = conversion_factor(unit, quantity, "rad" if quantity == "angle" else machine.length_unit)
    return np.array(table.numbers(column)) * factor


def _distances(machine: Machine, q: Array) -> Array:
    """Return the distances of the ideal machine's first target."""
    origin = np.array(machine.measured.origin or (0.0, 0.0, 0.0))
    poses = np.asarray(to_mechanism(replace(machine, effects=())).forward(machine.coordinates(q)))
    seen = poses @ np.array([*machine.targets[0].point, 1.0])
    return np.asarray(np.linalg.norm(seen[:, :3] - origin, axis=1))


def _commands(machine: Machine, q: Array) -> list[ForeignColumn]:
    units = [("rad" if joint.revolute else machine.length_unit) for joint in machine.joints]
    return [
        _column(joint.name, unit, values.round(9))
        for joint, unit, values in zip(machine.joints, units, q.T, strict=True)
    ]


def _column(name: str, unit: str, values: Array) -> ForeignColumn:
    return ForeignColumn(f"{name} [{unit}]", name, unit, tuple(float(x) + 0.0 for x in values))
