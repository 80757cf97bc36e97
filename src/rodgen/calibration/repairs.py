"""What people get wrong in machine files and tables of measurements, each as the change that puts it right."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial, reduce
from itertools import combinations, pairwise, permutations, product
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.problem.assembly_modes import closed
from rodgen.calibration.problem.attitudes import attitude_numbers
from rodgen.calibration.words import sized, three_digits
from rodgen.data.tables.writer import write_columns
from rodgen.data.units import parse_unit
from rodgen.errors import counted, joined
from rodgen.machines.machine import Machine
from rodgen.machines.measured import TURNS
from rodgen.machines.model import Model
from rodgen.machines.observations import Observations
from rodgen.machines.parts import BRANCHES, Joint, Known, Target, Vector
from rodgen.machines.rigid import rotation_vector
from rodgen.statistics.digits import last_decimal
from rodgen.statistics.thresholds import CHECK
from rodgen.views import plain

LENGTHS = ("mm", "inch", "m", "cm", "ft", "µm")
ANGLES = ("deg", "rad", "gon", "arcmin", "arcsec", "turn", "mrad")
"""Units that numbers may be in, the likely ones first."""
SIMPLE = 2e-3
"""Part by which peaks of a periodogram differ that are equally high."""
STANDARD_ERRORS = 10.0
"""Standard errors of a slope within which the simplest ratio is taken: other errors of an axis slope, too."""
BY_CHANCE = 0.1
"""Probability that an arbitrary number is so near to such a fraction, up to which it is taken for that."""
MOST_SENSES = 6
"""Joints of which each choice of senses is tried: 64 fits."""
MOST_ROWS, MOST_TEETH, LARGEST_RATIO, MOST_TRIED = 500, 1000, 10.0, 10_000
"""Rows by which a ratio is estimated, its largest divisor, how large it is where angles are read, and how many are
tried then."""
RATIOS = {2.0: "twice", 0.5: "half of", 4.0: "four times", 0.25: "a quarter of", 15.0: "15 times"}
"""How far a joint may go of what is commanded: counters count one, two or four edges of a line of an encoder, and an
hour of angle is 15 degrees."""
SAME = 1e-6
"""Relative difference of two names of one unit."""
MOST_TARGETS = 6
"""With more targets no two are exchanged: they are stars, or there are too many pairs."""
PARALLEL = 0.999
"""Cosine between axes of joints that a parallelogram may couple."""
ALONG = 0.9
"""Cosine from which on an axis is one of the machine, written by hand."""
DIRECTIONS: tuple[Vector, ...] = tuple(
    (float(sign * (k == 0)), float(sign * (k == 1)), float(sign * (k == 2)))
    for k in range(3)
    for sign in (1, -1)
)
"""Those along the axes of the machine."""

OfMachine: TypeAlias = Callable[[Machine], Machine]
OfRows: TypeAlias = Callable[[Observations], Observations]
T = TypeVar("T")


@dataclass(frozen=True)
class Repair:
    """A change of the machine file, or of the data, that may put right what is wrong."""

    words: str
    """What is wrong, and how to write it: ``"A turns the other way: axis = [-1, 0, 0]"``."""
    kind: str
    """Repairs of one kind are alternatives to each other; those of two kinds can be made together."""
    effort: int
    """How much is changed; of repairs that are equally probable the one with the least is named first."""
    machine: OfMachine | None = field(default=None, repr=False)
    """The change of the machine; None: it stays."""
    rows: OfRows | None = field(default=None, repr=False)
    """The change of the observations, which are of the changed machine already; None: they stay."""
    offset: int = 0
    """Rows by which the readings are moved to earlier commands."""
    commands_only: bool = False
    """Whether targets and other columns stay with the readings then."""
    enlarges: float = 1.0
    """By which the readings are multiplied."""
    changes: int = 1
    """How many faults are put right."""
    fitted: Callable[[Model, Array], Repair] | None = field(default=None, repr=False)
    """The same with the numbers of a fit with it, given the fit's model and parameters."""

    @property
    def is_order(self) -> bool:
        """Whether joints, or their columns, are in another order."""
        return self.kind.startswith(("order", "columns"))

    @property
    def of_machine(self) -> bool:
        """Whether the machine file is changed."""
        return self.machine is not None

    @property
    def of_data(self) -> bool:
        """Whether the data are changed."""
        return self.rows is not None or self.offset != 0

    def then(self, second: Repair) -> Repair:
        """Return both, one after the other; each finds joints by their names, wherever they are then."""
        return Repair(
            "; and ".join(filter(None, (self.words, second.words))),
            ", ".join(filter(None, (self.kind, second.kind))),
            self.effort + second.effort,
            _both(self.machine, second.machine),
            _both(self.rows, second.rows),
            self.offset + second.offset,
            self.commands_only or second.commands_only,
            self.enlarges * second.enlarges,
            self.changes + second.changes,
        )

    def applied(
        self, machine: Machine, observations: Observations, chosen: NDArray[np.int_] | None = None
    ) -> tuple[Machine, Observations]:
        """Return the machine and the observations after the change, or some rows; without those that are `unpaired`.

        Raises
        ------
        RodgenError
            When there can be no such machine, or its legs do not close.
        """
        rows = np.arange(observations.n) if chosen is None else chosen
        if self.offset:
            rows = rows[(rows + self.offset >= 0) & (rows + self.offset < observations.n)]
        here = observations.take(rows) if self.offset or chosen is not None else observations
        if self.offset:
            there = observations.take(rows + self.offset)
            here = (
                replace(here, q=there.q, s=there.s, v=there.v) if self.commands_only else there.read_as(here)
            )
        changed = machine if self.machine is None else self.machine(machine)
        names = [joint.name for joint in machine.joints]
        here = _with_joints(here, [names.index(joint.name) for joint in changed.joints])
        here = replace(here, machine=changed)
        here = here if self.rows is None else self.rows(here)
        moved = changed.kinematics.is_closed and (self.of_machine or self.of_data)
        return changed, closed(here) if moved else here

    def unpaired(self, observations: Observations) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Return the rows whose commands have no readings any more, and those whose readings have no commands."""
        n, rows = observations.n, np.arange(observations.n)
        commands, readings = (rows + shift for shift in (-self.offset, self.offset))
        return rows[(commands < 0) | (commands >= n)], rows[(readings < 0) | (readings >= n)]

    def to_dict(self, observations: Observations) -> dict[str, Any]:
        """Return it as plain data, with the numbers of the rows that it drops."""
        commands, readings = (observations.given(rows).tolist() for rows in self.unpaired(observations))
        return {
            **plain(self, "change=words of_machine of_data"),
            "rows": observations.n - len(readings),
            "commands_without_readings": commands,
            "readings_without_commands": readings,
        }

    def on_rows(self, observations: Observations) -> str:
        """Return a sentence on how many rows the repaired data have, and which are dropped."""
        commands, readings = self.unpaired(observations)
        left = f"{observations.n - len(readings)} of {observations.n} rows"
        if not len(readings):
            return f"{left}."
        places = observations.data.places
        return f"{left}: the commands of {places(commands)} and the readings of {places(readings)} have no partner."


AS_IS = Repair("", "", 0, changes=0)
"""No repair: the files as they are."""


def _both(first: Callable[[T], T] | None, second: Callable[[T], T] | None) -> Callable[[T], T] | None:
    """Return the change that makes one change after the other; None is no change."""
    return first or second if first is None or second is None else lambda x: second(first(x))


def _with_joints(o: Observations, order: Sequence[int]) -> Observations:
    """Return observations with the columns of the joints in another order."""
    if list(order) == sorted(order):
        return o
    return replace(o, q=o.q[:, order], s=o.s[:, order], v=o.v[:, order], travel=o.travel[order])


def repairs(machine: Machine, observations: Observations, alone: Fraction | None = None) -> list[Repair]:
    """Return the changes that may put right what is wrong with a machine file or its data, the smallest first.

    Parameters
    ----------
    alone : Fraction, optional
        The ratio of the only joint; see `ratio_of_one_axis`.
    """
    moving = [j for j, way in zip(machine.joints, np.ptp(observations.q, axis=0), strict=True) if way > 0]
    commanded = [joint for joint in moving if joint.is_read]
    changes = [
        *(_of_legs(machine) if machine.kinematics.is_closed else _of_joints(machine, moving)),
        *_of_couplings(machine, moving),
        *(() if machine.kinematics.is_closed else _of_zeros(moving)),
        *_of_readings(machine),
        *_of_units(machine, observations, commanded),
        *(() if machine.kinematics.is_closed else _of_ratios(commanded, alone)),
        *_of_columns(machine, commanded),
        *_of_targets(machine, observations),
        *_of_runs(machine, observations),
        *_of_gravity(machine),
        *(_of_rows(observations) if moving else ()),
    ]
    return sorted(changes, key=lambda repair: repair.effort)


# the machine file ------------------------------------------------------------------------------------------


def _with_joint(name: str, sense: float = 1.0, **keys: Any) -> OfMachine:
    """Return the change of some keys of a joint, or of the sense in which it moves."""

    def changed(joint: Joint) -> Joint:
        return replace(joint, **{"axis": _times(sense, joint.axis)} | keys) if joint.name == name else joint

    return lambda machine: replace(machine, joints=tuple(map(changed, machine.joints)))


def _written(vector: Vector) -> str:
    return f"[{', '.join(f'{x + 0.0:.6g}' for x in vector)}]"


def _times(factor: float, vector: Vector) -> Vector:
    x, y, z = (factor * component + 0.0 for component in vector)  # no -0
    return x, y, z


def _of_joints(machine: Machine, moving: Sequence[Joint]) -> Iterator[Repair]:
    joints = machine.joints
    for joint in moving:
        verb, about = ("turns", "about") if joint.revolute else ("moves", "along")
        yield _reversed(joint)
        for axis in DIRECTIONS if max(map(abs, joint.axis)) > ALONG else ():
            if abs(np.dot(axis, joint.axis)) < ALONG:
                words = f"{joint.name} {verb} {about} another axis: axis = {_written(axis)}"
                yield Repair(words, f"axis {joint.name}", 3, _with_joint(joint.name, axis=axis))
    for count in range(2, len(moving) + 1) if len(moving) <= MOST_SENSES else ():
        yield from (reduce(Repair.then, map(_reversed, some)) for some in combinations(moving, count))
    for order, effort in _orders(machine):
        if any(joint in moving for joint, before in zip(order, joints, strict=True) if joint is not before):
            names = [joint.name for joint in order]
            whole = effort > 3 and order == joints[::-1]
            words = (
                "the joints are written from the tool to the base"
                if whole
                else "joints are in the wrong order"
            )
            words += f": the order of the chain is {joined(names, most=len(names))}"
            yield Repair(words, "order", effort, partial(_in_order, names=names))
    if machine.branches:
        (other,) = {*BRANCHES} - {machine.measured.instrument}
        words = f'the instrument is on the {other}, the targets are not: instrument = "{other}"'
        yield Repair(words, "order", 1, partial(_seen_from, instrument=other))
    elif len(joints) > 1:
        words = "the chain is written from the tool to the base: "
        words += "reverse the order of the joints and the sign of each axis"
        yield Repair(words, "order", 5, _inverted)


def _reversed(joint: Joint) -> Repair:
    verb = "turns" if joint.revolute else "moves"
    words = f"{joint.name} {verb} the other way: axis = {_written(_times(-1, joint.axis))}"
    return Repair(words, f"axis {joint.name}", 1, _with_joint(joint.name, -1))


def _orders(machine: Machine) -> Iterator[tuple[tuple[Joint, ...], int]]:
    """Yield orders in which joints may be meant: two exchanged, one elsewhere, all reversed; each in its branch."""
    joints, n = machine.joints, len(machine.joints)
    orders = {joints[::-1]: 4}
    for i, j in permutations(range(n), 2):
        rest = [*joints[:i], *joints[i + 1 :]]
        orders[(*rest[:j], joints[i], *rest[j:])] = 4
    for i, j in combinations(range(n), 2):
        orders[(*joints[:i], joints[j], *joints[i + 1 : j], joints[i], *joints[j + 1 :])] = 3
    inner = {*joints[: machine.inner]}
    yield from (one for one in orders.items() if inner == {*one[0][: machine.inner]})


def _in_order(machine: Machine, names: Sequence[str]) -> Machine:
    return replace(machine, joints=tuple(machine.joint(name) for name in names))


def _seen_from(machine: Machine, instrument: str) -> Machine:
    """Return a machine of two branches with the instrument on one of them."""
    measured = replace(machine.measured, instrument=instrument)
    return replace(machine, joints=machine.joints[::-1], measured=measured)


def _inverted(machine: Machine) -> Machine:
    joints = tuple(replace(joint, axis=_times(-1, joint.axis)) for joint in reversed(machine.joints))
    return replace(machine, joints=joints)


def _exchanged(machine: Machine, first: str, second: str) -> Machine:
    """Return a machine in which two targets have each other's place."""
    points = {target.name: target.point for target in machine.targets}
    points[first], points[second] = points[second], points[first]
    return replace(machine, targets=tuple(replace(t, point=points[t.name]) for t in machine.targets))


def _of_couplings(machine: Machine, moving: Sequence[Joint]) -> Iterator[Repair]:
    """Yield parallel joints of which one moves with the other, as in a parallelogram."""
    for first, joint in pairwise(machine.joints):
        parallel = first.revolute and joint.revolute and abs(np.dot(first.axis, joint.axis)) > PARALLEL
        both_move = first in moving and joint in moving and first.branch == joint.branch
        for sign in "-+" if parallel and both_move and not joint.coordinate else "":
            text = f"{joint.column} {sign} {first.name}"
            words = f'{joint.name} moves with {first.name}, too: reading = "{joint.column}", coordinate = "{text}"'
            yield Repair(
                words, f"axis {joint.name}", 2, _with_joint(joint.name, reading=joint.column, coordinate=text)
            )


def _of_zeros(moving: Sequence[Joint]) -> Iterator[Repair]:
    """Yield joints that turn and count from a position that is a quarter or half of a turn away."""
    turning = (joint for joint in moving if joint.revolute and not joint.coordinate)
    for joint, turn in product(turning, ("+ 90", "- 90", "+ 180")):
        name = joint.column
        words = f'{joint.name} counts from another zero: reading = "{name}", coordinate = "{name} {turn} deg"'
        change = _with_joint(joint.name, reading=name, coordinate=f"{name} {turn} deg")
        yield Repair(words, f"unit {name}", 2, change)


def _of_ratios(commanded: Sequence[Joint], alone: Fraction | None) -> Iterator[Repair]:
    """Yield joints that go another way than is commanded by a factor, as of a gear or of counted edges."""
    ratios = [Fraction(ratio) for ratio in RATIOS] if alone is None else [alone] if abs(alone) != 1 else []
    for joint, ratio in product((j for j in commanded if not j.coordinate), ratios):
        verb, name = "turns" if joint.revolute else "moves", joint.column
        size = f"{float(abs(ratio)):.12g}"
        text = size if Fraction(size) == abs(ratio) else str(abs(ratio))
        part = RATIOS.get(float(abs(ratio)), f"{text} of")
        way, sign = ("the other way and by ", "-") if ratio < 0 else ("by ", "")
        words = (
            f"{joint.name} {verb} {way}{part} what its reading says: "
            f'reading = "{name}", coordinate = "{sign}{text}*{name}"'
        )
        change = _with_joint(joint.name, reading=name, coordinate=f"{sign}{text}*{name}")
        yield Repair(words, f"unit {name}", 2 + (ratio < 0), change)


def free_ratios(machine: Machine, observations: Observations) -> Iterator[Repair]:
    """Yield the machine with each choice of senses of its joints, and with a ratio of each joint for a fit to find.

    A fit finds the ratio of a slide whatever its sense. That of a joint it finds from one that is near enough.
    """
    ways, scaled = np.ptp(observations.q, axis=0), {e.place for e in machine.effects if e.name == "scale"}
    moving = [joint for joint, way in zip(machine.joints, ways, strict=True) if way > 0 and joint.is_read]
    names = [joint.name for joint in moving if not joint.coordinate and joint.name not in scaled]
    turning = [name for name in names if machine.joint(name).revolute][:MOST_SENSES]

    def changed(senses: Mapping[str, float], machine: Machine) -> Machine:
        for name in names:
            machine = _with_joint(name, senses.get(name, 1.0))(machine)
            machine = machine.with_effect(machine.effect("scale", name))
        known = {f"{name}.scale.k": Known(prior=(0.0, LARGEST_RATIO)) for name in names}
        return replace(machine, known={**machine.known, **known})

    several = names and not machine.kinematics.is_closed
    for senses in product((1.0, -1.0), repeat=len(turning)) if several else ():
        yield Repair("", "ratios", 0, partial(changed, dict(zip(turning, senses, strict=True))))


def found_ratios(observations: Observations, model: Model, theta: Array, std: Array) -> Iterator[Repair]:
    """Yield the senses and ratios of joints that a fit of `free_ratios` found, as one change; large ones are units.

    Other errors of the machine change ratios, too: first with the simplest numbers so near, then with these digits.

    Parameters
    ----------
    observations : Observations
        Before the change.
    model : Model
        Of the fit.
    theta, std : ndarray, shape (parameters,)
        Its parameters and their standard deviations, internal units.
    """
    machine, at = observations.machine, model.keys
    scaled = [joint for joint in machine.joints if f"{joint.name}.scale.k" in at]
    for margin in (CHECK.imperfect, 0.0):
        parts, others = [AS_IS], dict[tuple[bool, float], list[Joint]]()
        for joint in scaled:
            i = at[f"{joint.name}.scale.k"]
            sense = np.sign(np.dot(joint.axis, model.machine.joint(joint.name).axis))
            ratio_of_fit = float(sense * (1 + theta[i]))
            for factor in _in_other_units([joint], observations):
                far = max(factor, 1 / factor) > LARGEST_RATIO
                if far and abs(abs(ratio_of_fit) / factor - 1) < CHECK.imperfect:
                    others.setdefault((joint.revolute, factor), []).append(joint)
                    ratio_of_fit /= abs(ratio_of_fit)
            ratio = as_written(ratio_of_fit, float(std[i]), margin)
            parts += [_reversed(joint)] if ratio == -1 else _of_ratios([joint], ratio)
        parts += [_in_other_units(some, observations)[factor] for (_, factor), some in others.items()]
        yield reduce(Repair.then, parts)


def ratio_of_one_axis(machine: Machine, observations: Observations) -> Fraction | None:
    """Return the simplest ratio of what is read of the only joint to what it is commanded; None of another machine.

    One where it differs from that by no more than an error of scale.
    """
    joint = machine.joints[0]
    if len(machine.joints) > 1 or machine.measured.kind != ("angle" if joint.revolute else "distance"):
        return None
    ratio = _ratio(observations.q[:, 0], observations.reading[:, 0], moving=machine.measurand.moving)
    return ratio * (-1 if _falls(machine) else 1)


def _ratio(q: Array, reading: Array, *, moving: bool) -> Fraction:
    """Return the simplest ratio of what is read to what one axis is commanded; zeros do not count.

    Of distances the median slope. Of angles, of which whole turns do not count, the lowest frequency among the highest
    peaks of the periodogram of the unit vectors, and the slope of what is left.
    """
    q, reading = q[:MOST_ROWS] - q[0], reading[:MOST_ROWS]
    if moving:
        i, j = np.triu_indices(len(q), 1)
        apart = np.abs(q[j] - q[i]) > np.ptp(q) / 4
        slope_of_all = float(np.median((reading[j] - reading[i])[apart] / (q[j] - q[i])[apart]))
        left = reading - slope_of_all * q - np.median(reading - slope_of_all * q)
    else:
        step = 0.25 / float(np.ptp(q))  # phases differ by an eighth of a radian at most
        tried = step * np.arange(1, min(LARGEST_RATIO / step, MOST_TRIED))
        tried = np.stack([tried, -tried], axis=1).ravel()
        sums = np.exp(1j * (reading - np.outer(tried, q))).sum(axis=1)
        best = int(np.argmax(np.abs(sums) > (1 - SIMPLE) * np.max(np.abs(sums))))
        left = np.angle(np.exp(1j * (reading - tried[best] * q)) / sums[best])
        slope, start = np.polyfit(q, left, 1)
        slope_of_all, left = float(tried[best] + slope), left - slope * q - start
    return as_written(slope_of_all, float(np.median(np.abs(left)) / np.std(q) / np.sqrt(len(q))))


def as_written(ratio: float, std: float, margin: float = 0.0) -> Fraction:
    """Return the simplest ratio that an estimate may be; 1 or -1 where it differs by no more than an error of scale.

    Other errors change it by a part `margin`, too: a simple ratio may be so far.
    """
    near, sign = max(std * STANDARD_ERRORS, 1e-6 * abs(ratio)), -1 if ratio < 0 else 1
    if abs(abs(ratio) - 1) < max(CHECK.imperfect, near):
        return Fraction(sign)
    simple = simplest(abs(ratio), max(near, margin * abs(ratio))) or simplest(abs(ratio), near)
    return sign * (simple or Fraction(digits_of(abs(ratio), near / STANDARD_ERRORS)) or Fraction(1))


def simplest(ratio: float, near: float) -> Fraction | None:
    """Return the simplest fraction so near to a ratio; None where one may be so near by chance.

    Up to a divisor d there are 3 d²/π² fractions in a unit (Hardy and Wright, theorem 330).
    """
    whole = (Fraction(round(ratio * d), d) for d in range(1, MOST_TEETH))
    fraction = next((x for x in whole if x and abs(float(x) - ratio) < near), None)
    by_chance = 0.0 if fraction is None else 2 * near * 3 * fraction.denominator**2 / math.pi**2
    return None if by_chance > BY_CHANCE else fraction


def digits_of(value: float, std: float) -> str:
    """Return a number as far as two digits of its standard deviation go, without an exponent; at most 12 decimals."""
    decimals = int(last_decimal(std, 2)) if std > 0 else 12
    return f"{value:.{min(max(decimals, 0), 12)}f}"


def _falls(machine: Machine) -> bool:
    """Return whether what is read falls while the only joint of a machine moves on."""
    (joint,), measured = machine.joints, machine.measured
    if machine.measurand.moving:
        along = np.subtract(machine.targets[0].point, measured.origin or (0.0, 0.0, 0.0))
    else:
        along = np.array(measured.about or joint.axis)
    return bool(np.dot(along, joint.axis) < 0)


def _of_legs(machine: Machine) -> Iterator[Repair]:
    kinematics = machine.kinematics
    if {"R", "r"} <= set(kinematics.numbers):
        (outer,), (inner,) = kinematics.number("R"), kinematics.number("r")
        changed = replace(kinematics, R=inner, r=outer)  # type: ignore[call-arg]
        words = f"base and platform are exchanged: R = {inner:g}, r = {outer:g}"
        yield Repair(words, "geometry", 2, partial(_changed, kinematics=changed))


def _changed(machine: Machine, **keys: Any) -> Machine:
    return replace(machine, **keys)


def _of_gravity(machine: Machine) -> Iterator[Repair]:
    """Yield other directions of gravity, where weight does anything in the model."""
    if any(term.uses_gravity or term.uses_moment for term in machine.structure.terms):
        for direction in sorted(DIRECTIONS, key=lambda d: float(np.dot(d, machine.gravity))):
            if (along := np.dot(direction, machine.gravity)) < ALONG:
                words = f"weight acts in another direction: gravity = {_written(direction)}"
                yield Repair(
                    words, "gravity", 1 if along < -ALONG else 2, partial(_changed, gravity=direction)
                )


# units -----------------------------------------------------------------------------------------------------


def _of_units(machine: Machine, observations: Observations, commanded: Sequence[Joint]) -> Iterator[Repair]:
    """Yield numbers that are in another unit than is written with them."""
    columns = observations.data.columns
    for revolute in (True, False):
        those = [joint for joint in commanded if joint.revolute == revolute]
        for some in [*([joint] for joint in those), *([those] if len(those) > 1 else [])]:
            yield from _in_other_units(some, observations).values()
    if not machine.measurand.moving:
        return
    readings, length = machine.measurand.columns[:3], machine.length_unit
    for words, factor in _other_units(joined(readings), columns[readings[0]].unit, LENGTHS):
        rows = _readings(range(len(readings)), factor)
        yield Repair(words, "unit readings", 1, rows=rows, enlarges=factor)
    for words, factor in _other_units("the lengths of the machine file", length, LENGTHS):
        yield Repair(words, "unit file", 2, partial(_enlarged, factor=factor))


def _in_other_units(joints: Sequence[Joint], observations: Observations) -> dict[float, Repair]:
    """Return by factor that commands of joints, all of them angles or all lengths, are in another unit."""
    names, units = [joint.column for joint in joints], ANGLES if joints[0].revolute else LENGTHS
    by_factor = {}
    for words, factor in _other_units(joined(names), observations.data.columns[names[0]].unit, units):
        rows = _commands({joint.name: (joint.name, factor) for joint in joints})
        by_factor[factor] = Repair(words, f"unit {joined(names)}", min(len(names), 2), rows=rows)
    return by_factor


def _other_units(subject: str, written: str | None, units: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Yield that numbers are in other units, with the factor that brings them to the unit that is written."""
    verb = "are" if " " in subject else "is"
    for unit in units:
        factor = parse_unit(unit).factor() / parse_unit(str(written)).factor()
        if abs(factor - 1) > SAME:
            yield f"{subject} {verb} in {unit}, not in {written}", factor


def _enlarged(machine: Machine, factor: float) -> Machine:
    kinematics, origin = machine.kinematics, machine.measured.origin
    numbers = {name: tuple(factor * x for x in kinematics.number(name)) for name in kinematics.numbers}
    return replace(
        machine,
        joints=tuple(replace(joint, point=_times(factor, joint.point)) for joint in machine.joints),
        targets=tuple(replace(target, point=_times(factor, target.point)) for target in machine.targets),
        measured=replace(machine.measured, origin=None if origin is None else _times(factor, origin)),
        kinematics=replace(kinematics, **{name: x if len(x) > 1 else x[0] for name, x in numbers.items()}),
    )


# the data --------------------------------------------------------------------------------------------------


def _commands(sources: Mapping[str, tuple[str, float]]) -> OfRows:
    """Return the change by which some joints take the commands of another joint, times a factor."""

    def changed(o: Observations) -> Observations:
        names = [joint.name for joint in o.machine.joints]
        those, factors = zip(*(sources.get(name, (name, 1.0)) for name in names), strict=True)
        o, scale = _with_joints(o, [names.index(name) for name in those]), np.array(factors)
        return replace(o, q=o.q * scale, travel=o.travel * scale[:, None])

    return changed


def _readings(order: Sequence[int], factor: float, signs: Sequence[int] = (1, 1, 1)) -> OfRows:
    """Return the change of the order, the size and the signs of the first columns of readings."""

    def changed(o: Observations) -> Observations:
        several = range(0 if o.sigma is None else o.sigma.shape[1])
        sigma = None if o.sigma is None else o.sigma[:, [*order, *several[len(order) :]]] * factor
        turned = o.reading[:, list(order)] * factor * np.array(signs[: len(order)], float)
        return replace(o, reading=turned, sigma=sigma, arm=o.arm * factor)

    return changed


def _of_readings(machine: Machine) -> Iterator[Repair]:
    """Yield the ways in which three columns may be exchanged, or have other signs."""
    if machine.measurand.has_attitude:
        words = "the attitudes are those of the measuring frame in the body, not of the body in the measuring frame"
        yield Repair(words, "attitudes", 2, rows=_attitudes_inverted)
    if not machine.measurand.is_place:
        return
    columns = machine.measurand.columns[:3]
    if machine.measured.frame == "free":  # a free frame turns as it likes: only the handedness counts
        words = f"the readings are in a left-handed frame: negate {columns[0]}, or exchange two of {joined(columns)}"
        yield Repair(words, "readings", 1, rows=_readings(range(3), 1.0, [-1, 1, 1]))
        return
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        changed = sum(order[i] != i for i in range(3))
        negative = [columns[i] for i in range(3) if signs[i] < 0]
        parts = [f"the readings are in the order {', '.join(columns[i] for i in order)}"] if changed else []
        parts += [f"the sign of {joined(negative)} is wrong"] if negative else []
        if 0 < changed + len(negative) <= 3:
            effort = 1 + changed + len(negative) - bool(changed)
            yield Repair(" and ".join(parts), "readings", effort, rows=_readings(order, 1.0, signs))


def _attitudes_inverted(o: Observations) -> Observations:
    assert o.attitude is not None
    return replace(o, attitude=np.ascontiguousarray(o.attitude.swapaxes(1, 2)))


def _of_columns(machine: Machine, commanded: Sequence[Joint]) -> Iterator[Repair]:
    for a, b in combinations(machine.joints, 2):
        if a.dimension == b.dimension and (a in commanded or b in commanded):
            words = f"the columns {a.column} and {b.column} are exchanged"
            kind = f"columns {a.column} {b.column}"
            yield Repair(words, kind, 2, rows=_commands({a.name: (b.name, 1.0), b.name: (a.name, 1.0)}))


def _of_targets(machine: Machine, observations: Observations) -> Iterator[Repair]:
    targets = machine.targets
    measured = [targets[k] for k in np.unique(observations.target)]
    for a, b in combinations(targets, 2) if len(targets) <= MOST_TARGETS else ():
        if a in measured or b in measured:
            words = f"the targets {a.name} and {b.name} are exchanged"
            yield Repair(words, "targets", 2, partial(_exchanged, first=a.name, second=b.name))


def _of_runs(machine: Machine, observations: Observations) -> Iterator[Repair]:
    """Yield that a target was mounted anew between runs: each run has one of its own."""
    runs, count = observations.run_names, len(machine.targets)
    seen = np.unique(observations.target * len(runs) + observations.run)
    if len(runs) == 1 or len(seen) == len(np.unique(observations.target)) or len(seen) > MOST_TARGETS * count:
        return
    names = [f"{target.name}_{run}" for target in machine.targets for run in runs]
    targets = tuple(replace(machine.targets[k // len(runs)], name=names[k]) for k in seen)
    estimate = tuple(dict.fromkeys((*machine.estimate, "target")))

    def rows(o: Observations) -> Observations:
        return replace(o, target=np.searchsorted(seen, o.target * len(runs) + o.run).astype(np.int32))

    words = (
        "each run alone fits: the target sits differently in each run{}; give each run its own target, "
        + joined([target.name for target in targets])
    )

    def fitted(model: Model, theta: Array) -> Repair:
        figures, targets_of_runs = _mounted(model, theta)
        return replace(repair, words=words.format(figures), machine=partial(change, targets=targets_of_runs))

    change = partial(_changed, estimate=estimate)
    repair = Repair(words.format(""), "targets", 2, partial(change, targets=targets), rows, fitted=fitted)
    yield repair


def _mounted(model: Model, theta: Array) -> tuple[str, tuple[Target, ...]]:
    """Return by how much the targets of later runs are turned, or moved, and the targets as they were fitted."""
    numbers, targets = range(len(model.machine.targets)), model.machine.targets
    if model.structure.moving:
        points: list[Array] = [model.target(theta, k) for k in numbers]
        targets = tuple(replace(t, point=tuple(x.tolist())) for t, x in zip(targets, points, strict=True))
        unit = model.machine.length_unit
        ways = [sized(float(np.linalg.norm(x - points[0])), unit) for x in points[1:]]
        figures = f" (moved by {joined(ways)})"
    if model.structure.measurand.has_attitude:
        turns = [model.attitude(theta, k) for k in numbers]
        vectors = [tuple(rotation_vector(turn).tolist()) for turn in turns]
        targets = tuple(replace(t, attitude=x) for t, x in zip(targets, vectors, strict=True))
        ways = [
            f"{three_digits(float(np.degrees(np.linalg.norm(rotation_vector(turn @ turns[0].T)))))}°"
            for turn in turns[1:]
        ]
        figures = f" (turned by {joined(ways)})"
    return figures, targets


def far_offsets(observations: Observations) -> tuple[int, ...]:
    """Return by how many rows readings may be shifted against commands: 1 and 2, and the targets of a pose."""
    targets = len(np.unique(observations.target))
    far = {1, 2} | ({targets} if targets <= MOST_TARGETS else set())
    return tuple(sign * k for k in sorted(far) for sign in (1, -1))


def _of_rows(observations: Observations) -> Iterator[Repair]:
    several_targets = len(np.unique(observations.target)) > 1
    offsets = far_offsets(observations)
    for offset in offsets if observations.n > 4 * max(offsets) else ():
        rows = f"{counted(abs(offset), 'row')} {'later' if offset > 0 else 'earlier'}"
        words = f"the readings are shifted against the commands: each belongs to those {rows}"
        yield Repair(words + ", with its target" * several_targets, "rows", 2, offset=offset)
        if several_targets:
            words += ", while its target is right"
            yield Repair(words, "rows", 2, offset=offset, commands_only=True)


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
    motions: dict[str, NDArray[Any]] = {"": repaired.q, "v_": repaired.v, "dir_": repaired.s}
    changed: dict[str, NDArray[Any]] = {
        prefix + joint.column: values[:, j]
        for prefix, values in motions.items()
        for j, joint in enumerate(repaired.machine.joints)
    }
    changed |= dict(zip(machine.measurand.columns, repaired.reading.T, strict=False))
    if repaired.sigma is not None:
        for name, values in zip(machine.measurand.columns, repaired.sigma.T, strict=True):
            changed[f"u_{name}"] = values / (repaired.arm if name in TURNS else 1.0)
    if repaired.attitude is not None:
        changed |= attitude_numbers(repaired.attitude, data)
    columns: dict[str, Any] = {}
    for name, column in data.columns.items():
        columns[column.text] = column.values
        if name in changed:
            factor = parse_unit(column.unit).factor(machine.length_unit) if column.unit else 1.0
            new = np.array([float(f"{x:.12g}") for x in changed[name] / factor])
            if not np.allclose(new, column.values, rtol=1e-11, atol=0):
                columns[column.text] = new
    if len(repaired.machine.targets) != len(machine.targets):
        names = np.array([target.name for target in repaired.machine.targets])
        columns["target"] = names[repaired.target]
    write_columns(path, columns)
