"""The two mounts of a telescope: axes, signs, the directions of sky coordinates, and TPOINT's names of their errors.

Azimuth turns from north through east, hour angle from the meridian to the west. The axes are those for which the signs
of TPOINT's terms are stated.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.machines.effects.definition import EffectDefinition
from rodgen.machines.parts import MachineData, Vector


@dataclass(frozen=True)
class Mount:
    """A mount with two axes."""

    name: str
    words: str
    joints: tuple[str, str]
    """The axis that stands on the ground first."""
    axes: tuple[Vector, Vector]
    boresight: Vector
    """With both axes at zero."""
    frame: str
    """What x, y and z are."""

    def gravity(self, latitude: float) -> Vector:
        """Return the direction of gravity at a latitude, rad."""
        if self is ALTAZ:
            return (0.0, 0.0, -1.0)
        return (-math.cos(latitude), 0.0, -math.sin(latitude))

    def direction(self, first: ArrayLike, second: ArrayLike) -> NDArray[np.float64]:
        """Return the unit vectors (n, 3) of azimuth and elevation, or of hour angle and declination, rad."""
        cos, sin = np.cos(first) * np.cos(second), np.sin(first) * np.cos(second)
        x, y = (sin, cos) if self is ALTAZ else (cos, -sin)
        return np.stack([x, y, np.sin(second)], axis=-1)

    def horizontal(self, directions: ArrayLike, gravity: ArrayLike) -> tuple[NDArray[np.float64], ...]:
        """Return altitude and azimuth, from north through east to 2 pi, of unit vectors (n, 3), rad."""
        up, east = -np.asarray(gravity, float), np.array([1.0, 0, 0] if self is ALTAZ else [0, 1.0, 0])
        x, y, z = np.stack([east, np.cross(up, east), up]) @ np.asarray(directions).T
        return np.arcsin(np.clip(z, -1, 1)), np.arctan2(x, y) % (2 * math.pi)


BORESIGHT = "boresight"
"""What the target of a mount is called: that with which its telescope points."""
ALTAZ = Mount(
    "altaz",
    "alt-azimuth mount",
    ("AZ", "EL"),
    ((0.0, 0.0, -1.0), (1.0, 0.0, 0.0)),
    (0.0, 1.0, 0.0),
    "x is east, y north, z up",
)
EQUATORIAL = Mount(
    "equatorial",
    "equatorial mount",
    ("HA", "DEC"),
    ((0.0, 0.0, -1.0), (0.0, -1.0, 0.0)),
    (1.0, 0.0, 0.0),
    "z is the pole, x the meridian at the equator, y east",
)
MOUNTS = {mount.name: mount for mount in (ALTAZ, EQUATORIAL)}
_ALIGNED = 1e-9
"""What axes of a mount may differ by: rounding."""


def mount_of(machine: MachineData) -> Mount | None:
    """Return the mount that a machine of directions is, by its names, axes and boresight; None of others."""
    if not machine.measurand.is_direction or machine.measurand.moving or machine.kinematics.is_closed:
        return None
    vectors = [*(joint.axis for joint in machine.joints), *(target.point for target in machine.targets)]
    names = tuple(joint.name for joint in machine.joints)
    for mount in MOUNTS.values():
        if names == mount.joints and len(machine.targets) == 1:
            there = np.allclose(vectors, [*mount.axes, mount.boresight], atol=_ALIGNED)
            return mount if there else None
    return None


# TPOINT's terms ----------------------------------------------------------------------------------------------------

GEOMETRY = {
    "altaz": ("IA", "IE", "CA", "NPAE", "AN", "AW"),
    "equatorial": ("IH", "ID", "CH", "NP", "MA", "ME"),
}
"""By mount: the terms of its zeros, of its axes and of its boresight; the zeros first."""
OF_NASMYTH = {"NRX": {"ECES": 1.0, "IA": 1.0}, "NRY": {"ECEC": 1.0, "NPAE": -1.0}}
"""Terms that are sums of others: of a Nasmyth telescope's rotator, seen along the elevation axis."""
_AXES = {"altaz": ("azimuth", "elevation"), "equatorial": ("polar", "declination")}
_RELATION = re.compile(
    r"(?P<sign>-?)(?P<parameter>[ab]\d?)(?P<latitude> cos\(latitude\))?(?P<period> \(P = 9 deg\))?"
    r"(?: at the (?P<axis>\w+) axis)?"
)


@dataclass(frozen=True)
class Relation:
    """What a term of TPOINT is of an effect."""

    parameter: str
    sign: float
    place: str | None
    """The joint or the target; None for the whole machine."""
    of_latitude: bool
    """Whether it is the parameter times the cosine of the latitude."""
    has_period: bool
    """Whether it is the parameter at one period alone."""


def relation_of(term: str, definition: EffectDefinition, mount: Mount) -> Relation | None:
    """Return what a term is of the effect of its definition on a mount; None where it is of the other mount."""
    match = _RELATION.fullmatch(definition.tpoint[term])
    assert match is not None
    place = None
    if axis := match["axis"]:
        if axis not in _AXES[mount.name]:
            return None
        place = mount.joints[_AXES[mount.name].index(axis)]
    elif "target" in definition.at:
        if term not in GEOMETRY[mount.name]:
            return None
        place = BORESIGHT
    sign = -1.0 if match["sign"] else 1.0
    return Relation(match["parameter"], sign, place, bool(match["latitude"]), bool(match["period"]))


def names_of_terms(machine: MachineData, definition: EffectDefinition, place: str | None) -> dict[str, str]:
    """Return TPOINT's terms that the parameters of an effect are, by parameter, such as ``{"a": "-TX"}``."""
    mount = mount_of(machine) if definition.tpoint else None
    if mount is None:
        return {}
    return dict(sorted(_names(mount, definition, BORESIGHT if place == machine.targets[0].name else place)))


def _names(mount: Mount, definition: EffectDefinition, place: str | None) -> Iterator[tuple[str, str]]:
    for term in definition.tpoint.keys() - OF_NASMYTH.keys():
        relation = relation_of(term, definition, mount)
        if relation is not None and relation.place == place and not relation.has_period:
            divided = "/cos(latitude)" if relation.of_latitude else ""
            yield relation.parameter, f"{'-' * (relation.sign < 0)}{term}{divided}"
