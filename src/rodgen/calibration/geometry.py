"""The geometry of the file as one cause: where it is wrong as a whole, many effects would each take a part of it.

So they would where a number that all legs of a platform share is wrong, such as the length of the rods of a delta.
These numbers compete with the effects, each as likely as the commonest.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from rodgen.calibration.candidates import Candidate
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.selection import select
from rodgen.calibration.sensitivities import NUMBER
from rodgen.errors import RodgenError
from rodgen.machines.effects.catalogue import GEOMETRY, OFFSETS
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.plausibility import Plausibility, plausibility
from rodgen.statistics.thresholds import COST

SEVERAL = 3
"""Effects from which on a geometry is asked for: two are two."""
PARTS = {"revolute": ("axis", "point"), "prismatic": ("axis",)}


def with_shared_numbers(machine: Machine, names: Sequence[str] = ()) -> Machine | None:
    """Return the machine with the numbers estimated that all legs share, or some of them; None if it has no more."""
    kinematics, there = machine.kinematics, {*machine.estimate}
    shared = names or (kinematics.numbers if kinematics.are_shared else ())
    new = [name for name in shared if not {"geometry", name} & there]
    return replace(machine, estimate=(*new, *machine.estimate)) if new else None


def including_numbers(evidence: Evidence) -> Evidence:
    """Return the evidence linearised at a fit with shared numbers, with these as candidates.

    Each is one cause, as large as the dimension of a single leg is.
    """
    rows, machine = evidence.sensitivities, evidence.base.machine
    of_leg = machine.effect(machine.kinematics.dimensions[-1], machine.joints[0].name)
    (size, *_), numbers = plausibility(machine, of_leg).sizes.values(), list[Candidate]()
    for name in (name for name in machine.kinematics.numbers if (NUMBER, name) in rows.exact):
        keys = tuple(key for key in rows.index if key.split(".")[:2] == [NUMBER, name])
        meaning = f"{name} in [geometry] is not that of the file."
        number = replace(of_leg.definition, name=NUMBER, component=NUMBER, meaning=meaning, own=True)
        effect = Effect(number, name)
        prior = Plausibility(0.0, {key.rpartition(".")[2]: size for key in keys})
        columns = rows.columns[:, :, [rows.index[key] for key in keys]]
        numbers.append(Candidate(effect, keys, columns, {}, prior=prior))
    return evidence.including(numbers)


def is_dimension(candidate: Candidate) -> bool:
    """Return whether a candidate says that a dimension is not that of the file."""
    return candidate.effect.name in {*GEOMETRY, NUMBER}


def gain_of_geometry(evidence: Evidence, chosen: Sequence[Candidate]) -> float:
    """Return how much dearer the effects that were chosen are than a geometry that differs everywhere from the file.

    Of single dimensions also which joints have them is chosen: the first one of a kind is among all choices, of n among
    N the number is uniform, and all sets of n are alike. Minus infinity where zeros of the joints alone do as well.
    """
    single = evidence.base.machine.kinematics.one_by_one
    off = [c for c in evidence.candidates if is_dimension(c) and not (single and c.effect.name == NUMBER)]
    off = [c for c in off if not c.effect.definition.of_all_legs]
    zeros = [c for c in off if c.effect.name in OFFSETS]
    if not off:
        return -math.inf
    geometry = _cost(evidence, chosen, off)
    kinds, places = (Counter(c.effect.name for c in some if c in off) for some in (chosen, off))
    which = sum(2 * math.log(math.comb(places[name], n)) for name, n in kinds.items() if n > 1)
    gain = evidence.cost(chosen) + which - geometry
    if gain > -COST.tied and zeros and _cost(evidence, chosen, zeros) < geometry + COST.needed:
        return -math.inf
    return gain


def are_most_off(evidence: Evidence, chosen: Sequence[Candidate]) -> bool:
    """Return whether dimensions are chosen at most of the places that have them, of several kinds together."""
    off, every = (
        {c.key for c in some if c.effect.name in GEOMETRY} for some in (chosen, evidence.candidates)
    )
    kinds = {name for name, _ in off}
    return len(off) >= SEVERAL and 2 * len(off) > sum(name in kinds for name, _ in every)


def _cost(evidence: Evidence, chosen: Sequence[Candidate], off: Sequence[Candidate]) -> float:
    """Return the cost of dimensions as one cause, with the effects that are selected in addition.

    None is chosen. Those with the same usual size are distributed with the same width, or each as usual or wider: where
    the readings hardly determine them, a common width shrinks with the sizes. Effects may stand for dimensions, so
    the other effects are selected again, if dimensions leave any degree of freedom.
    """
    beside = evidence.beside(off)
    others = select(beside) if beside.dof > 0 else []
    rests = ([c for c in some if not is_dimension(c)] for some in (chosen, others))
    ways = itertools.product((evidence.as_one_cause(off), evidence), rests)
    costs = (way.cost([*rest, *off]) - way.choice([*rest, *off]) + way.choice(rest) for way, rest in ways)
    return min(costs) + 2 * evidence.log_choices


def with_geometry(machine: Machine) -> Machine | None:
    """Return the machine with all its dimensions estimated; None where they are already, or there are none.

    Where the frame is free, axis and point of the first joint are the base.
    """
    if machine.kinematics.is_closed:
        freed, numbers = machine, machine.kinematics.numbers
        if not (machine.kinematics.one_by_one or "geometry" in machine.estimate):
            others = (entry for entry in machine.estimate if entry not in numbers)
            freed = replace(machine, estimate=("geometry", *others))
        for name, joint in itertools.product(machine.kinematics.dimensions, machine.joints):
            with suppress(RodgenError):  # it is there
                freed = freed.with_effect(freed.effect(name, joint.name))
        return None if freed is machine else freed
    joints = machine.joints[1:] if machine.measured.frame == "free" else machine.joints
    more = tuple(f"{joint.name}.{part}" for joint in joints for part in PARTS.get(joint.type, ()))
    new = tuple(entry for entry in more if entry not in machine.estimate)
    targets = () if "target" in machine.estimate else ("target",)
    return replace(machine, estimate=(*new, *machine.estimate, *targets)) if new else None
