"""Where readings can be taken: limits, regions, boxes to keep out of, places or poses, and how many in a session."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Array, Mask
from rodgen.calibration.problem.binding import bind
from rodgen.data.units import (
    ANGLE,
    LENGTH,
    ONE,
    Dimension,
    number_and_unit,
    parse_unit,
    unit_factor,
)
from rodgen.errors import InputFileError, in_file, joined, shown
from rodgen.machines.effects.formula import FUNCTION_NAMES, Formula
from rodgen.machines.files.toml import (
    NUMBER,
    PAIR,
    TEXT,
    VECTOR,
    Kind,
    Table,
    UnfitError,
    parse,
    read_text,
)
from rodgen.machines.mounts import ALTAZ, mount_of

if TYPE_CHECKING:
    from rodgen.data.measurements import Measurements
    from rodgen.machines.machine import Machine
    from rodgen.machines.observations import Observations


MOST_BLOCKS = 100
"""Boxes, regions and places in a file, at most."""
KEYS = ("allowed", "limits", "keep_out", "artefact", "session")
_COMPARISON = re.compile(r"([^<>=]+)([<>])=?([^<>=]+)")
_NUMPY = {name: getattr(np, name) for name in FUNCTION_NAMES}


@dataclass(frozen=True)
class Region:
    """A formula that must stay below or above a bound, such as ``altitude > 20 deg``."""

    text: str
    formula: Formula
    """Of joints' coordinates, of the target's place x, y, z in machine axes, or of the altitude of a direction."""
    above: bool
    bound: float
    """Internal units."""

    def holds(self, names: Mapping[str, Array]) -> Mask:
        """Return where it holds; where the formula is not finite it does not."""
        with np.errstate(all="ignore"):
            value = self.formula.evaluate({**names, "pi": math.pi}, _NUMPY, float)
            return np.asarray(value > self.bound if self.above else value < self.bound)


_ALTITUDE = Formula.parse("altitude", file="", place="")
WELL_SEEN = (
    Region("altitude > 20 deg", _ALTITUDE, True, math.radians(20)),
    Region("altitude < 80 deg", _ALTITUDE, False, math.radians(80)),
)
"""Stars lower down shimmer in the air, and a mount follows higher ones badly."""


def is_altitude(machine: Machine, j: int) -> bool:
    """Return whether a joint goes through the altitudes: its travel is where stars are seen, if none is stated."""
    return mount_of(machine) is ALTAZ and machine.joints[j].name == ALTAZ.joints[1]


@dataclass(frozen=True, eq=False)
class Constraints:
    """What every planned reading must satisfy, in internal units and machine axes.

    Attributes
    ----------
    file : str
    limits : mapping of str to (float, float)
        Of joints' coordinates.
    regions : tuple of Region
    boxes : tuple of ndarray, shape (3, 2)
        That the target must not be in; infinite where a side is not given.
    places : ndarray, shape (k, 3), or None
        Where the target can be read: the balls of an artefact.
    session : int or None
        Readings at most.
    poses : Observations or None
        The commands that can be given; of these, only those of columns that the list has.
    """

    file: str = ""
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    regions: tuple[Region, ...] = ()
    boxes: tuple[Array, ...] = ()
    places: Array | None = None
    session: int | None = None
    poses: Observations | None = None

    def with_poses(self, machine: Machine, poses: Measurements) -> Constraints:
        """Return the same with a list of poses, of which readings are chosen.

        Parameters
        ----------
        machine : Machine
        poses : Measurements
            Without readings.

        Raises
        ------
        InputFileError
            When it is no list of commands of the machine, or has none.
        """
        bare = replace(machine, effects=())  # whose columns a list of poses need not have
        if "target" not in poses.columns:  # then any is read there
            bare = replace(bare, targets=machine.targets[:1])
        found = bind(bare, poses, allow_missing_readings=True)
        found.demand_rows()
        return replace(self, poses=found)

    def of_stars(self, machine: Machine) -> Constraints:
        """Return the same with the altitudes at which a mount sees stars well, unless some are stated."""
        stated = any("altitude" in region.formula.names for region in self.regions)
        if stated or mount_of(machine) is None or self.poses is not None or self.places is not None:
            return self
        return replace(self, regions=(*self.regions, *WELL_SEEN))

    def travel(self, machine: Machine, travel: Array) -> Array:
        """Return the travel within the limits, (J, 2).

        Parameters
        ----------
        machine : Machine
        travel : ndarray, shape (J, 2)
            Internal units; that of the machine file, or of the data.

        Raises
        ------
        InputFileError
            When they lie outside it.
        """
        ranges = np.array(travel)
        for j, joint in enumerate(machine.joints):
            limits = self.limits.get(joint.column)
            limits_of = machine.limits[j]
            if limits_of is None and is_altitude(machine, j):
                low, high = (region.bound for region in WELL_SEEN)
                ranges[j] = min(low, ranges[j, 0]), max(high, ranges[j, 1])
            if self.poses is not None and limits is None and limits_of is None:
                limits = float(self.poses.q[:, j].min()), float(self.poses.q[:, j].max())
            if limits is not None:
                stated = limits_of or limits
                ranges[j] = max(limits[0], stated[0]), min(limits[1], stated[1])
                if ranges[j, 0] > ranges[j, 1]:
                    raise InputFileError(
                        self.file, f"[limits], {joint.name}", "limits outside the travel of the machine file",
                        "limits that overlap it",
                    )  # fmt: skip
        return ranges

    def allowed(self, machine: Machine, q: Array, place: Array) -> Iterator[tuple[str, Mask]]:
        """Yield each condition in words, and which readings satisfy it.

        Parameters
        ----------
        machine : Machine
        q : ndarray, shape (n, J)
        place : ndarray, shape (n, 3)
            Of the target, in machine axes; the direction where directions are measured.
        """
        names = {**dict(zip("xyz", place.T, strict=True)), "altitude": _altitude(machine, place)}
        names |= {joint.column: q[:, j] for j, joint in enumerate(machine.joints)}
        coordinates = machine.coordinates(q)
        names |= {joint.name: coordinates[:, j] for j, joint in enumerate(machine.joints)}
        for region in self.regions:
            yield f"allowed {region.text!r}", region.holds(names)
        for number, box in enumerate(self.boxes, 1):
            inside = np.all((place >= box[:, 0]) & (place <= box[:, 1]), axis=1)
            yield f"keep_out {number}" if len(self.boxes) > 1 else "keep_out", ~inside


def _altitude(machine: Machine, place: Array) -> Array:
    up = -np.asarray(machine.gravity)
    length = np.maximum(np.linalg.norm(place, axis=1), 1e-300)
    return np.asarray(np.arcsin(np.clip(place @ up / length, -1, 1)))


# the file ------------------------------------------------------------------------------------------------------------


def load_constraints(file: str | os.PathLike[str], machine: Machine) -> Constraints:
    """Return the constraints of a TOML file, which is in the units of the machine file.

    Parameters
    ----------
    file : str or os.PathLike
    machine : Machine

    Raises
    ------
    InputFileError
        When it cannot be read, or says what is no constraint of this machine.
    """
    name = os.fspath(file)
    return constraints_of(read_text(name, "a file of constraints"), name, machine)


def constraints_of(text: str, name: str, machine: Machine) -> Constraints:
    """Return the constraints of the text of such a file; see `load_constraints`."""
    top = Table(name, "", parse(text, name), KEYS)
    table = top.sub("limits", [joint.column for joint in machine.joints if joint.is_read])
    artefact = top.sub("artefact", ("balls",))
    session = top.sub("session", ("readings",))
    return Constraints(
        file=name,
        limits={
            joint.name: table.get(joint.name, _scaled(_RANGE, _factor(machine, joint.dimension)))
            for joint in machine.joints
            if joint.name in table
        },
        regions=tuple(_region(machine, top, text) for text in top.get("allowed", _TEXTS, ())),
        boxes=tuple(_box(name, k, block) for k, block in enumerate(top.blocks("keep_out", MOST_BLOCKS), 1)),
        places=_places(machine, artefact.get("balls", _BALLS)) if "artefact" in top else None,
        session=session.get("readings", _COUNT, None),
    )


def _factor(machine: Machine, dimension: Dimension) -> float:
    return unit_factor(machine.angle_unit)[0] if dimension == ANGLE else 1.0


def _ordered(pair: tuple[float, float]) -> tuple[float, float]:
    if not pair[0] <= pair[1]:
        raise UnfitError(None, "the lower number first, then a higher one")
    return pair


def _listed(value: Any) -> list[Any]:
    if not isinstance(value, list) or not 0 < len(value) <= MOST_BLOCKS:
        raise UnfitError
    return value


def _whole(value: float) -> int:
    if value != int(value) or value < 1:
        raise UnfitError
    return int(value)


_RANGE = PAIR.then(_ordered)
_TEXTS = Kind(
    'a list of comparisons, such as ["altitude > 20 deg"]', lambda v: [TEXT.read(x) for x in _listed(v)]
)
_BALLS = Kind(
    "a list of places, such as [[100, 0, 40], [300, 0, 40]]", lambda v: [VECTOR.read(x) for x in _listed(v)]
)
_COUNT = NUMBER.then(_whole, "a whole number from 1 up")


def _scaled(kind: Kind[tuple[float, float]], factor: float) -> Kind[Any]:
    return kind.then(lambda pair: (pair[0] * factor, pair[1] * factor))


def _box(file: str, number: int, block: dict[str, Any]) -> Array:
    table = Table(file, f"keep_out {number}", block, ("x", "y", "z"))
    if not block:
        raise table.error("", "empty", "a range of x, y or z, such as x = [200, 300]")
    return np.array([table.get(axis, _RANGE, (-math.inf, math.inf)) for axis in "xyz"])


def _places(machine: Machine, balls: list[tuple[float, ...]]) -> Array:
    places = np.array(balls)
    return places if machine.measurand.moving else places / np.linalg.norm(places, axis=1, keepdims=True)


def _region(machine: Machine, top: Table, text: str) -> Region:
    expected = "a formula, < or >, and a number with its unit, such as 'altitude > 20 deg'"
    match = _COMPARISON.fullmatch(text)
    if match is None:
        raise top.error("allowed", shown(text), expected)
    place = f"allowed {text!r}"
    formula = Formula.parse(match[1].strip(), file=top.file, place=place)
    dimensions: dict[str, Dimension | None] = dict.fromkeys(
        "xyz", LENGTH if machine.measurand.moving else ONE
    )
    dimensions |= {"pi": ONE, "altitude": ANGLE} | {j.name: j.dimension for j in machine.joints}
    unknown = sorted(formula.names - dimensions.keys())
    if unknown:
        names = joined([n for n in dimensions if n != "pi"], "or")
        raise InputFileError(top.file, place, f"the name {shown(unknown[0])}", names)
    with in_file(top.file, place):
        dimension = formula.dimension(dimensions)
    found = number_and_unit(match[3].strip())
    if found is None or dimension is None:
        raise InputFileError(top.file, place, shown(match[3].strip()), expected)
    value, unit_text = found
    if not unit_text:
        return Region(text, formula, match[2] == ">", value * _factor(machine, dimension))
    with in_file(top.file, place):
        unit = parse_unit(unit_text)
    if unit.dimension not in ({ANGLE, ONE} if dimension in (ANGLE, ONE) else {dimension}):
        raise InputFileError(top.file, place, f"unit {shown(unit_text)}", f"a unit of {dimension}")
    return Region(text, formula, match[2] == ">", value * unit.factor(machine.length_unit))
