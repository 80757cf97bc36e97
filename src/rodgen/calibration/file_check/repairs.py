"""What people get wrong in machine files and tables of measurements, each as the change that puts it right."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, permutations, product
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.problem.assembly_modes import closed
from rodgen.calibration.problem.attitudes import attitude_numbers
from rodgen.data.observations import Observations
from rodgen.data.tables.writer import write_columns
from rodgen.data.units import parse_unit
from rodgen.errors import joined
from rodgen.machines.machine import Machine
from rodgen.machines.measured import TURNS
from rodgen.machines.parts import BRANCHES, Joint, Vector

Rows: TypeAlias = Mapping[int, Observations]
"""Observations by row offset: at 2 each reading is given what else stands two rows later."""
State: TypeAlias = tuple[Machine, Rows]

LENGTHS = ("mm", "inch", "m", "cm", "ft", "µm")
ANGLES = ("deg", "rad", "gon", "arcmin", "arcsec", "turn", "mrad")
"""Units that numbers may be in, the likely ones first."""
SAME = 1e-6
"""Relative difference of two names of one unit."""
MOST_TARGETS = 6
"""With more targets no two are exchanged: they are stars, or there are too many pairs."""
PARALLEL = 0.999
"""Cosine between axes of joints that a parallelogram may couple."""
ALONG = 0.9
"""Cosine from which on an axis is one of the machine, written by hand."""


@dataclass(frozen=True)
class Repair:
    """A change of the machine file, or of the data, that may put right what is wrong."""

    words: str
    """What is wrong, and how to write it: ``"A turns the other way: axis = [-1, 0, 0]"``."""
    kind: str
    """Repairs of one kind are alternatives to each other; those of two kinds can be made together."""
    effort: int
    """How much is changed; of repairs that do the same the one with the least is named first."""
    of_data: bool = False
    """Whether the data are changed, not the machine file."""
    machine: Callable[[Machine], Machine] = lambda machine: machine
    """The change of the machine."""
    rows: Callable[[Observations], Observations] = lambda observations: observations
    """The change of the observations."""
    offset: int = 0
    """Rows by which the readings are moved to earlier commands."""
    commands_only: bool = False
    """Whether targets and other columns stay with the readings then."""
    enlarges: float = 1.0
    """By which the readings are multiplied."""

    def __call__(self, state: State) -> State:
        """Return the machine and the observations with the change; the latter are of the new machine.

        Raises
        ------
        InputFileError
            When the legs of a closed chain do not close.
        """
        before, by_offset = state
        machine = self.machine(before)
        names = [joint.name for joint in before.joints]
        order = [names.index(joint.name) for joint in machine.joints]
        shifted = {k: self._shifted(by_offset, k) for k in by_offset if k + self.offset in by_offset}
        found = {}
        for k, observations in shifted.items():
            changed = replace(self.rows(_with_joints(observations, order)), machine=machine)
            found[k] = closed(changed) if machine.kinematics.is_closed and k == 0 else changed
        return machine, found

    def _shifted(self, by_offset: Rows, k: int) -> Observations:
        there = by_offset[k + self.offset]
        if not self.commands_only:
            return there
        return replace(by_offset[k], q=there.q, s=there.s, v=there.v)


def repairs(machine: Machine, observations: Observations) -> list[Repair]:
    """Return the changes that may put right what is wrong with a machine file or its data, the smallest first."""
    moves = np.ptp(observations.q, axis=0) > 0
    read = np.array([joint.is_read for joint in machine.joints])
    made = [
        *(() if machine.kinematics.is_closed else _of_joints(machine, moves)),
        *(_of_legs(machine) if machine.kinematics.is_closed else ()),
        *_of_couplings(machine, moves),
        *_of_readings(machine),
        *_of_units(machine, observations, moves & read),
        *_of_columns(machine, moves & read),
        *_of_targets(machine, observations),
        *(_of_rows(observations) if moves.any() else ()),
    ]
    return sorted(made, key=lambda repair: repair.effort)


# the machine file ------------------------------------------------------------------------------------------


def _with_joint(j: int, change: Callable[[Joint], Joint]) -> Callable[[Machine], Machine]:
    def changed(machine: Machine) -> Machine:
        joints = list(machine.joints)
        joints[j] = change(joints[j])
        return replace(machine, joints=tuple(joints))

    return changed


def _written(vector: Vector) -> str:
    return f"[{', '.join(f'{x + 0.0:.6g}' for x in vector)}]"


def _times(factor: float, vector: Vector) -> Vector:
    x, y, z = (factor * component + 0.0 for component in vector)  # no -0
    return x, y, z


def _of_joints(machine: Machine, moves: NDArray[np.bool_]) -> Iterator[Repair]:
    joints = machine.joints
    for j, joint in enumerate(joints):
        if not moves[j]:
            continue
        verb = "turns" if joint.revolute else "moves"
        opposite = _times(-1, joint.axis)
        yield Repair(
            f"{joint.name} {verb} the other way: axis = {_written(opposite)}",
            f"axis {joint.name}",
            1,
            machine=_with_joint(j, lambda joint: replace(joint, axis=_times(-1, joint.axis))),
        )
        if max(map(abs, joint.axis)) > ALONG:
            for k, sign in product(range(3), (1.0, -1.0)):
                if abs(joint.axis[k]) < ALONG:
                    axis = tuple(sign * float(i == k) for i in range(3))
                    yield Repair(
                        f"{joint.name} {verb} {'about' if joint.revolute else 'along'} another axis: "
                        f"axis = {_written(axis)}",  # type: ignore[arg-type]
                        f"axis {joint.name}",
                        3,
                        machine=_with_joint(j, lambda joint, axis=axis: replace(joint, axis=axis)),  # type: ignore[misc]
                    )
    numbers = range(len(joints))
    for order, effort, words in _orders(len(joints)):
        if any((order[i] < machine.inner) != (i < machine.inner) for i in numbers):
            continue  # a joint stays in its branch
        names = [joints[i].name for i in order]
        if any(moves[i] for i in numbers if order[i] != i):
            yield Repair(
                words.format(*names) + f": the order of the chain is {joined(names, most=len(names))}",
                "order",
                effort,
                machine=_reordered(order),
            )
    if machine.branches:
        (other,) = {*BRANCHES} - {machine.measured.instrument}
        words = f'the instrument is on the {other}, the targets are not: instrument = "{other}"'
        yield Repair(words, "order", 1, machine=lambda machine: _seen_from(machine, other))
    else:
        yield Repair(
            "the chain is written from the tool to the base: reverse the order of the joints and the sign of each axis",
            "order",
            5,
            machine=lambda machine: _inverted(machine),
        )
    for i, j in combinations(numbers, 2):
        a, b = joints[i], joints[j]
        if a.type == b.type and a.axis != b.axis and (moves[i] or moves[j]):
            yield Repair(
                f"the axes of {a.name} and {b.name} are exchanged: {_written(b.axis)} and {_written(a.axis)}",
                "axes",
                4,
                machine=_exchanged_of("joints", "axis", i, j),
            )


def _of_couplings(machine: Machine, moves: NDArray[np.bool_]) -> Iterator[Repair]:
    """Yield couplings with the other sign, joints that are coupled with none, and parallel ones that are coupled."""
    types = machine.quantities
    for (i, first), (j, joint) in pairwise(enumerate(machine.joints)):
        parallel = first.revolute and joint.revolute and abs(np.dot(first.axis, joint.axis)) > PARALLEL
        if parallel and moves[i] and moves[j] and not joint.coordinate and first.branch == joint.branch:
            for sign in "-+":
                text = f"{joint.column} {sign} {first.name}"
                own = {"reading": joint.column, "coordinate": text}
                yield Repair(
                    f'{joint.name} moves with {first.name}, too: reading = "{joint.column}", coordinate = "{text}"',
                    f"axis {joint.name}",
                    2,
                    machine=_with_joint(j, lambda joint, own=own: replace(joint, **own)),  # type: ignore[misc]
                )
    for j, joint in enumerate(machine.joints):
        stated = machine.couplings.stated[j] if machine.couplings else None
        if stated is None:
            continue
        alike = all(types[name] == joint.type for name, _ in stated.factors)
        if alike and not stated.constant and {name for name, _ in stated.factors} != {joint.reading}:
            parts = [(name, x if name == joint.reading else -x) for name, x in stated.factors]
            text = " ".join(_part(name, float(x)) for name, x in parts).removeprefix("+ ")
            text = f"-{text[2:]}" if text.startswith("- ") else text
            yield Repair(
                f'{joint.name} follows the other way: coordinate = "{text}"',
                f"axis {joint.name}",
                1,
                machine=_with_joint(j, lambda joint, text=text: replace(joint, coordinate=text)),  # type: ignore[misc]
            )
        if joint.is_read and len(stated.factors) > 1:
            yield Repair(
                f"{joint.name} moves by its own reading alone: no coordinate",
                f"axis {joint.name}",
                1,
                machine=_with_joint(j, lambda joint: replace(joint, coordinate=None, reading_travel=None)),
            )


def _part(name: str, factor: float) -> str:
    size = "" if abs(factor) == 1 else f"{abs(factor):.12g}*"
    return f"{'-' if factor < 0 else '+'} {size}{name}"


def _orders(n: int) -> Iterator[tuple[tuple[int, ...], int, str]]:
    """Yield orders in which joints may be meant: two exchanged, one elsewhere, all reversed."""
    seen = {tuple(range(n))}
    for i, j in combinations(range(n), 2):
        order = list(range(n))
        order[i], order[j] = j, i
        seen.add(tuple(order))
        yield tuple(order), 3, "joints are in the wrong order"
    for i, j in permutations(range(n), 2):
        order = list(range(n))
        order.insert(j, order.pop(i))
        if tuple(order) not in seen:
            seen.add(tuple(order))
            yield tuple(order), 4, "a joint stands at the wrong place in the chain"
    if tuple(reversed(range(n))) not in seen:
        yield tuple(reversed(range(n))), 4, "the joints are written from the tool to the base"


def _reordered(order: Sequence[int]) -> Callable[[Machine], Machine]:
    return lambda machine: replace(machine, joints=tuple(machine.joints[i] for i in order))


def _seen_from(machine: Machine, instrument: str) -> Machine:
    """Return a machine of two branches with the instrument on one of them."""
    measured = replace(machine.measured, instrument=instrument)
    return replace(machine, joints=machine.joints[::-1], measured=measured)


def _inverted(machine: Machine) -> Machine:
    joints = tuple(replace(joint, axis=_times(-1, joint.axis)) for joint in reversed(machine.joints))
    return replace(machine, joints=joints)


def _exchanged_of(of: str, key: str, i: int, j: int) -> Callable[[Machine], Machine]:
    """Return the change that exchanges a key of two joints, or of two targets."""

    def changed(machine: Machine) -> Machine:
        parts = list(getattr(machine, of))
        first, second = getattr(parts[i], key), getattr(parts[j], key)
        parts[i], parts[j] = replace(parts[i], **{key: second}), replace(parts[j], **{key: first})
        changes: dict[str, Any] = {of: tuple(parts)}
        return replace(machine, **changes)

    return changed


def _of_legs(machine: Machine) -> Iterator[Repair]:
    kinematics = machine.kinematics
    if {"R", "r"} <= set(kinematics.numbers):
        (outer,), (inner,) = kinematics.number("R"), kinematics.number("r")
        yield Repair(
            f"base and platform are exchanged: R = {inner:g}, r = {outer:g}",
            "geometry",
            2,
            machine=lambda machine: replace(
                machine,
                kinematics=replace(machine.kinematics, R=inner, r=outer),  # type: ignore[call-arg]
            ),
        )


def _of_units(machine: Machine, observations: Observations, moves: NDArray[np.bool_]) -> Iterator[Repair]:
    """Yield numbers that are in another unit than is written with them."""
    columns, joints = observations.data.columns, machine.joints
    for revolute in (True, False):
        those = [j for j, joint in enumerate(joints) if joint.revolute == revolute and moves[j]]
        for numbers in [*([j] for j in those), *([those] if len(those) > 1 else [])]:
            subject = joined([joints[j].column for j in numbers])
            verb = "is" if len(numbers) == 1 else "are"
            written = str(columns[joints[numbers[0]].column].unit)
            for unit, factor in _other_units(written, ANGLES if revolute else LENGTHS):
                yield Repair(
                    f"{subject} {verb} in {unit}, not in {written}",
                    f"unit {subject}",
                    1 if len(numbers) == 1 else 2,
                    True,
                    rows=_columns_scaled(numbers, factor),
                )
    if not machine.measurand.moving:
        return
    names = machine.measurand.columns[:3]
    written = str(columns[names[0]].unit)
    for unit, factor in _other_units(written, LENGTHS):
        yield Repair(
            f"{joined(names)} {'are' if len(names) > 1 else 'is'} in {unit}, not in {written}",
            "unit readings",
            1,
            True,
            rows=_readings_scaled(factor),
            enlarges=factor,
        )
    for unit, factor in _other_units(machine.length_unit, LENGTHS):
        yield Repair(
            f"the lengths of the machine file are in {unit}, not in {machine.length_unit}",
            "unit file",
            2,
            machine=lambda machine, factor=factor: _enlarged(machine, factor),  # type: ignore[misc]
        )


def _other_units(written: str, units: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Yield the units that numbers may be in, with the factor that brings them to the unit that is written."""
    one = parse_unit(written).factor()
    for unit in units:
        factor = parse_unit(unit).factor() / one
        if abs(factor - 1) > SAME:
            yield unit, factor


def _columns_scaled(numbers: Sequence[int], factor: float) -> Callable[[Observations], Observations]:
    def changed(o: Observations) -> Observations:
        scale = np.ones(o.q.shape[1])
        scale[list(numbers)] = factor
        travel = o.travel * scale[:, None]
        return replace(o, q=o.q * scale, travel=travel)

    return changed


def _readings_scaled(factor: float) -> Callable[[Observations], Observations]:
    def changed(o: Observations) -> Observations:
        sigma = None if o.sigma is None else o.sigma * factor
        return replace(o, reading=o.reading * factor, sigma=sigma, arm=o.arm * factor)

    return changed


def _enlarged(machine: Machine, factor: float) -> Machine:
    kinematics = machine.kinematics
    numbers = {name: tuple(factor * x for x in kinematics.number(name)) for name in kinematics.numbers}
    changed = {name: x if len(x) > 1 else x[0] for name, x in numbers.items()}
    origin = machine.measured.origin
    return replace(
        machine,
        joints=tuple(replace(joint, point=_times(factor, joint.point)) for joint in machine.joints),
        targets=tuple(replace(target, point=_times(factor, target.point)) for target in machine.targets),
        measured=replace(machine.measured, origin=None if origin is None else _times(factor, origin)),
        kinematics=replace(kinematics, **changed),
    )


# the data --------------------------------------------------------------------------------------------------


def _of_readings(machine: Machine) -> Iterator[Repair]:
    """Yield the ways in which three columns may be exchanged, or have other signs."""
    if machine.measurand.has_attitude:
        words = "the attitudes are those of the measuring frame in the body, not of the body in the measuring frame"
        yield Repair(words, "attitudes", 2, True, rows=_attitudes_inverted)
    if not machine.measurand.is_place:
        return
    columns = machine.measurand.columns[:3]
    if machine.measured.frame == "free":  # a free frame turns as it likes: only the handedness counts
        x = columns[0]
        yield Repair(
            f"the readings are in a left-handed frame: negate {x}, or exchange two of {joined(columns)}",
            "readings",
            1,
            True,
            rows=_readings_turned([0, 1, 2], [-1, 1, 1]),
        )
        return
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            changed = sum(order[i] != i for i in range(3))
            negative = [columns[i] for i in range(3) if signs[i] < 0]
            if not changed and not negative:
                continue
            if changed + len(negative) > 3:
                continue
            parts = []
            if negative:
                parts.append(f"the sign of {joined(negative)} is wrong")
            if changed:
                named = ", ".join(columns[i] for i in order)
                parts.append(
                    f"the readings are in the order {named}" if not negative else f"the order is {named}"
                )
            yield Repair(
                " and ".join(parts), "readings", 1 + changed + len(negative) - bool(changed), True,
                rows=_readings_turned(order, signs),
            )  # fmt: skip


def _readings_turned(order: Sequence[int], signs: Sequence[int]) -> Callable[[Observations], Observations]:
    def changed(o: Observations) -> Observations:
        sigma = None if o.sigma is None else o.sigma[:, [*order, *range(3, o.sigma.shape[1])]]
        return replace(o, reading=o.reading[:, list(order)] * np.array(signs, float), sigma=sigma)

    return changed


def _attitudes_inverted(o: Observations) -> Observations:
    assert o.attitude is not None
    return replace(o, attitude=np.ascontiguousarray(o.attitude.swapaxes(1, 2)))


def _of_columns(machine: Machine, moves: NDArray[np.bool_]) -> Iterator[Repair]:
    joints = machine.joints
    for i, j in combinations(range(len(joints)), 2):
        if joints[i].dimension == joints[j].dimension and (moves[i] or moves[j]):
            a, b = joints[i].column, joints[j].column
            yield Repair(f"the columns {a} and {b} are exchanged", "columns", 2, True, rows=_exchanged(i, j))


def _exchanged(i: int, j: int) -> Callable[[Observations], Observations]:
    def changed(o: Observations) -> Observations:
        order = list(range(o.q.shape[1]))
        order[i], order[j] = j, i
        return _with_joints(o, order)

    return changed


def _with_joints(o: Observations, order: Sequence[int]) -> Observations:
    """Return observations with the columns of the joints in another order."""
    if list(order) == sorted(order):
        return o
    return replace(o, q=o.q[:, order], s=o.s[:, order], v=o.v[:, order], travel=o.travel[order])


def _of_targets(machine: Machine, observations: Observations) -> Iterator[Repair]:
    targets = machine.targets
    seen = np.unique(observations.target)
    if len(targets) <= MOST_TARGETS:
        for i, j in combinations(range(len(targets)), 2):
            if i in seen or j in seen:
                yield Repair(
                    f"the targets {targets[i].name} and {targets[j].name} are exchanged",
                    "targets",
                    2,
                    machine=_exchanged_of("targets", "point", i, j),
                )
    if len(targets) == 1 and machine.measurand.is_direction:
        for k, sign in product(range(3), (1.0, -1.0)):
            point = tuple(sign * float(i == k) for i in range(3))
            if np.dot(point, targets[0].point) < ALONG:
                yield Repair(
                    f"{targets[0].name} looks elsewhere: point = {_written(point)}",  # type: ignore[arg-type]
                    "targets",
                    3,
                    machine=lambda machine, point=point: replace(  # type: ignore[misc]
                        machine, targets=(replace(machine.targets[0], point=point),)
                    ),
                )


def offsets(observations: Observations) -> tuple[int, ...]:
    """Return by how many rows readings may be shifted against commands: 1 and 2, and the targets of a pose."""
    targets = len(np.unique(observations.target))
    far = {1, 2} | ({targets} if targets <= MOST_TARGETS else set())
    return tuple(sign * k for k in sorted(far) for sign in (1, -1))


def _of_rows(observations: Observations) -> Iterator[Repair]:
    several_targets = len(np.unique(observations.target)) > 1
    for offset in offsets(observations):
        rows = f"{abs(offset)} row{'s' * (abs(offset) > 1)} {'later' if offset > 0 else 'earlier'}"
        words = f"the readings are shifted against the commands: each belongs to those {rows}"
        if not several_targets:
            yield Repair(words, "rows", 2, True, offset=offset)
            continue
        yield Repair(f"{words}, with its target", "rows", 2, True, offset=offset)
        yield Repair(
            f"{words}, while its target is right", "rows", 2, True, offset=offset, commands_only=True
        )


def write_repaired_data(
    repaired: Observations, observations: Observations, path: str | os.PathLike[str]
) -> None:
    """Write the table of repaired observations; what was not changed keeps its digits.

    Parameters
    ----------
    repaired, observations : Observations
        After and before the change.
    path : str or os.PathLike
        Ends in ``.csv``, ``.csv.gz`` or ``.parquet``.

    Raises
    ------
    InputFileError
        When it cannot be written.
    """
    machine, data = observations.machine, repaired.data
    changed: dict[str, NDArray[np.float64]] = {}
    for j, joint in enumerate(machine.joints):
        changed[joint.column] = repaired.q[:, j]
        changed[f"v_{joint.column}"] = repaired.v[:, j]
        changed[f"dir_{joint.column}"] = repaired.s[:, j].astype(float)
    for i, name in enumerate(machine.measurand.columns):
        if i < repaired.reading.shape[1]:
            changed[name] = repaired.reading[:, i]
        if repaired.sigma is not None:
            changed[f"u_{name}"] = repaired.sigma[:, i] / (repaired.arm if name in TURNS else 1.0)
    if repaired.attitude is not None:
        changed |= attitude_numbers(repaired.attitude, data)
    columns: dict[str, Any] = {}
    for name, column in data.columns.items():
        values = column.values
        if name in changed:
            factor = parse_unit(column.unit).factor(machine.length_unit) if column.unit else 1.0
            new = np.array([float(f"{x:.12g}") for x in changed[name] / factor])
            if not np.allclose(new, values, rtol=1e-11, atol=0):
                values = new
        columns[column.text] = values
    write_columns(path, columns)
