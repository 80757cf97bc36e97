"""The geometry of the file as one cause: where it is wrong as a whole, many effects would each take a part of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

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
        "delta_radius",
        "delta_angle",
        "rod_length",
        "arm_length",
    }
)
"""Effects that say that a dimension is not that of the file."""
SEVERAL = 3
"""Effects from which on a geometry is asked for: two are two."""
TRIED = 3
"""Dimensions, those that seem to be worth least, without each of which a geometry is weighed."""
PARTS = {"revolute": ("axis", "point"), "prismatic": ("axis",)}


def gain_of_geometry(evidence: Evidence, chosen: Sequence[Candidate]) -> float:
    """Return how much dearer the effects that were chosen are than a geometry that differs everywhere from the file.

    The geometry is one cause; where dimensions trade, full fits may confirm none of them alone. Given it, a dimension
    is as likely off as not, by its usual size. Effects may stand for dimensions, so those beside the geometry are
    selected anew.
    """
    off = [c for c in evidence.candidates if c.effect.name in GEOMETRY]
    if not off:
        return 0.0
    price = 2 * (evidence.log_choices + math.log(len(evidence.base.machine.joints)) + len(off) * math.log(2))
    rest = select(evidence.beside(off))
    given = evidence.choice(rest)

    def cost(off: Sequence[Candidate]) -> float:
        return evidence.cost([*rest, *off]) - evidence.choice([*rest, *off]) + given

    while off:
        whole = [*off, *rest]
        dearer = np.array(evidence.dearer_without(whole)[: len(off)]) + evidence.choice(whole)
        dearer -= [evidence.choice([c for c in whole if c is not one]) for one in off]
        fewer = [[*off[:k], *off[k + 1 :]] for k in np.argsort(dearer, kind="stable")[:TRIED].tolist()]
        evidence.weighed([*rest, *some] for some in fewer)
        best = min(fewer, key=cost)
        if cost(best) > cost(off):
            break
        off = best
    return evidence.cost(chosen) - cost(off) - price


def with_geometry(machine: Machine) -> Machine | None:
    """Return the machine with all its dimensions estimated; None where they are already, or there are none.

    Where the frame is free, axis and point of the first joint are the base.
    """
    if machine.kinematics.is_closed:
        if "geometry" in machine.estimate:
            return None
        found = replace(machine, estimate=("geometry", *machine.estimate))
        for name in machine.kinematics.dimensions:
            for joint in machine.joints:
                try:
                    found = found.with_effect(found.effect(name, joint.name))
                except RodgenError:  # it is there
                    continue
        return found
    joints = machine.joints[1:] if machine.measured.frame == "free" else machine.joints
    more = tuple(f"{joint.name}.{part}" for joint in joints for part in PARTS.get(joint.type, ()))
    new = tuple(entry for entry in more if entry not in machine.estimate)
    targets = () if "target" in machine.estimate else ("target",)
    return replace(machine, estimate=(*new, *machine.estimate, *targets)) if new else None
