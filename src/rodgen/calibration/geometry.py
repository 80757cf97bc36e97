"""The geometry of the file as one cause: where it is wrong as a whole, many effects would each take a part of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from rodgen.calibration.candidates import Candidate
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.selection import select
from rodgen.errors import RodgenError
from rodgen.machines.machine import Machine

GEOMETRY = frozenset(
    {
        "axis_tilt",
        "axis_offset",
        "zero_offset",
        "target_offset",
        "base_joint_offset",
        "platform_joint_offset",
        "leg_zero_offset",
    }
)
"""Effects that say that a dimension is not that of the file."""
SEVERAL = 3
"""Effects from which on one cause is asked for: two are two."""
PARTS = {"revolute": ("axis", "point"), "prismatic": ("axis",)}


def gain_of_geometry(evidence: Evidence, chosen: Sequence[Candidate]) -> float | None:
    """Return how much dearer the effects that were chosen are than a geometry that differs everywhere from the file.

    None where so few effects were chosen that there is no question. The geometry is one cause, of which the sizes of
    all its dimensions are unknown; each of several effects is a cause of its own. Effects may stand for dimensions, so
    those beside the geometry are selected anew.
    """
    whole = [c for c in evidence.candidates if c.effect.name in GEOMETRY]
    if len(chosen) < SEVERAL or not whole:
        return None
    beside = evidence.holding(whole)
    one = 2 * (evidence.log_choices + math.log(len(evidence.base.machine.joints)))
    return evidence.cost(chosen) - beside.cost(select(beside)) - one


def with_geometry(machine: Machine) -> Machine | None:
    """Return the machine with all its dimensions estimated; None where they are already, or there are none.

    Where the frame is free, axis and point of the first joint are the base.
    """
    if machine.kinematics.is_closed:
        if "geometry" in machine.estimate:
            return None
        found = replace(machine, estimate=("geometry", *machine.estimate))
        for joint in machine.joints:
            try:
                found = found.with_effect(found.effect("leg_zero_offset", joint.name))
            except RodgenError:  # it is there, or no leg
                continue
        return found
    joints = machine.joints[1:] if machine.measured.frame == "free" else machine.joints
    more = tuple(f"{joint.name}.{part}" for joint in joints for part in PARTS.get(joint.type, ()))
    new = tuple(entry for entry in more if entry not in machine.estimate)
    targets = () if "target" in machine.estimate else ("target",)
    return replace(machine, estimate=(*new, *machine.estimate, *targets)) if new else None
