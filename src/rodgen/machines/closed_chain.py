"""Closed chains: named families of machines whose platform stands on legs.

A coordinate is the length of a leg, from its joint on the base to its joint on the platform. Where the platform is,
follows from all of them together (the direct problem), and may have several answers, the assembly modes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

__all__ = ["FAMILIES", "FROM_AFAR", "ClosedChain", "Family"]

FROM_AFAR = 8
"""Newton's steps from where the platform may be to where it is, all over the workspace."""


@dataclass(frozen=True)
class Family:
    """What the machines of a family have in common.

    Attributes
    ----------
    legs : mapping of str to int
        Name of each leg, and the direction of its joints from the middle, degrees about z.
    numbers : mapping of str to tuple of str
        What ``[geometry]`` gives, each with the names of its components; ``""`` of a plain number.
    start : int
        How many numbers tell a pose of the platform, for a solver to start from.
    words : str
        What people call it.
    """

    legs: Mapping[str, int]
    numbers: Mapping[str, tuple[str, ...]]
    start: int
    words: str


FAMILIES: Mapping[str, Family] = MappingProxyType(
    {
        "tricept": Family(
            legs={"A0": 0, "A1": 120, "A-1": -120},
            numbers={"R": ("",), "r": ("",), "q": ("x", "y", "z")},
            start=3,
            words="Tricept: three legs, and a passive one that turns about the origin and slides",
        ),
        "3-sps-s": Family(
            legs={"L1": -30, "L2": 90, "L3": 210},
            numbers={"R": ("",), "r": ("",), "h": ("",)},
            start=9,
            words="3-SPS-S: three legs, and a pivot about which the platform turns",
        ),
    }
)
"""All families, by their names in a machine file."""


@dataclass(frozen=True)
class ClosedChain:
    """The geometry of a machine of a family; lengths in the machine file's unit.

    Attributes
    ----------
    family : {"tricept", "3-sps-s"}
    R, r : float
        Radii of the circles of the joints on the base and on the platform.
    q : tuple of float, length 3
        Of a tricept: from the middle of the platform's joints to its centre, in platform axes.
    h : float
        Of a 3-sps-s: height of the pivot above the base.
    start : tuple of float, length 3, or None
        Of a 3-sps-s: rotation vector in radians; the assembly mode is the one nearest to it, else nearest the readings.
    seen : tuple of tuple of float
        Of a 3-sps-s that was measured: further rotation vectors of that mode, from which all that were measured are
        found; for code that finds poses by itself. They stand in no file.
    """

    family: str
    R: float
    r: float
    q: tuple[float, float, float] = (0.0, 0.0, 0.0)
    h: float = 0.0
    start: tuple[float, float, float] | None = None
    seen: tuple[tuple[float, float, float], ...] = field(default=(), compare=False, repr=False)

    @property
    def of(self) -> Family:
        """What the family has in common."""
        return FAMILIES[self.family]

    def number(self, name: str) -> tuple[float, ...]:
        """Return one of the numbers of ``[geometry]``, as its components."""
        value = getattr(self, name)
        return value if isinstance(value, tuple) else (value,)
