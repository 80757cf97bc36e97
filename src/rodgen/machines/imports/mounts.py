"""The two mounts of a telescope, as machines: axes, signs, and the directions of sky coordinates.

Azimuth turns from north through east, hour angle from the meridian to the west. The axes are those for which the signs
of TPOINT's terms are stated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.machines.machine import Machine
from rodgen.machines.measured import Measured
from rodgen.machines.parts import Joint, Target, Vector


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

    def machine(self, title: str, latitude: float, *, temperature: float = 20.0) -> Machine:
        """Return the ideal machine, whose axes and boresight a base fit adjusts.

        Parameters
        ----------
        latitude : float
            rad.
        temperature : float
            Reference temperature, degrees Celsius.
        """
        return Machine(
            title,
            "mm",
            "deg",
            self.gravity(latitude),
            temperature,
            tuple(Joint(name, "revolute", axis) for name, axis in zip(self.joints, self.axes, strict=True)),
            (Target("boresight", self.boresight),),
            Measured("direction", "machine"),
            estimate=(*(f"{name}.axis" for name in self.joints), "target"),
        )


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
