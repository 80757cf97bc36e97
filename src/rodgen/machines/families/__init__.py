"""Families of machines: how joints carry the target, one after the other or together as the legs of a platform.

A family is a class: the numbers of its geometry, its assembly modes, the steps of its model, its words and where code
starts. :mod:`rodgen.machines.closed_chain` solves for the pose of a platform with the steps of any of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rodgen.machines.families.delta import LinearDelta, RotaryDelta
from rodgen.machines.families.hexapod import Hexapod
from rodgen.machines.families.on_legs import OnLegs
from rodgen.machines.families.three_sps_s import ThreeSpsS
from rodgen.machines.families.tricept import Tricept

FAMILIES: Mapping[str, type[OnLegs]] = MappingProxyType(
    {made.family: made for made in (Tricept, ThreeSpsS, Hexapod, LinearDelta, RotaryDelta)}
)
"""All families of closed chains, by their names in a machine file."""
