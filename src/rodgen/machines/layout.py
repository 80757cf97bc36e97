"""The layout of a machine's geometry: a record of each part of the vector ``g`` that its kernels read.

``g`` is made of the numbers of a closed chain, of parts of each joint, and of parts of the whole machine. A further
part, or a further freedom of one, is a record here. How a fit changes the parts is in :mod:`rodgen.machines.model`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rodgen.machines.measured import TURNS

AB = ("a", "b")
"""Freedoms of a unit vector, and of a point on an axis: along u and v, which complete the vector or axis."""
XYZ = ("x", "y", "z")


@dataclass(frozen=True)
class Part:
    """A part of ``g``.

    Its functions have two arguments: the machine's `Structure` or `Model`, and the number of the joint or term.
    """

    name: str
    length: int
    words: str = ""
    """What it is, for emitted code."""
    value: Callable[[Any, int], Any] = lambda *_: 0.0
    """Of a model: what the machine file says, (length,), or of each target, (targets, length)."""
    there: Callable[[Any, int], bool] = lambda *_: True
    """Of a structure: whether its kernels read it."""
    free: Callable[[Any, int], bool] = lambda *_: False
    """Of a structure: whether a fit changes it; then its freedoms are slots, ..."""
    freedoms: Callable[[Any], Sequence[str]] = lambda _: AB
    """... in these components, ..."""
    slot: str = ""
    """... and this is what they are called before the component, where not as the part."""


def _unit_vector(name: str, words: str, value: Any, there: Any, free: Any) -> tuple[Part, ...]:
    """Return the parts of a unit vector: itself, and where it is free its derivatives by its two freedoms."""
    return (Part(name, 3, words, value, there, free), *(Part(f"{name}_by_{x}", 3, there=free) for x in AB))


def _across(s: Any, j: int) -> bool:
    return bool(s.joints[j].point) or any(term.joint == j and term.uses_directions for term in s.terms)


def _has_travel(s: Any, j: int) -> bool:
    return any(term.joint == j and term.uses_travel for term in s.terms)


# fmt: off
OF_JOINTS = (
    *_unit_vector(
        "axis", "axis of {joint}", lambda m, j: m.machine.joints[j].axis,
        lambda s, j: True, lambda s, j: s.joints[j].axis,
    ),
    Part(
        "point", 3, "point of {joint}, {length}", lambda m, j: m.machine.joints[j].point,
        lambda s, _: s.moving or s.weights, lambda s, j: s.joints[j].point,
    ),
    Part("u", 3, "first direction across the axis of {joint}", lambda m, j: m.bases[j][0], _across),
    Part("v", 3, "second direction across the axis of {joint}", lambda m, j: m.bases[j][1], _across),
    Part("start", 1, "lowest coordinate of {joint}, {coordinate}", lambda m, j: m.reach[j, 0], _has_travel),
    Part("length", 1, "travel of {joint}, {coordinate}", lambda m, j: np.ptp(m.reach[j]), _has_travel),
)
"""Parts of each joint of a chain."""


def _tilts(s: Any, _: int) -> bool:
    return bool(s.target) and "a" in s.measurand.freedoms


def _turns(s: Any, _: int) -> bool:
    return bool(s.target and s.measurand.has_attitude)


def _turns_again(s: Any, _: int) -> bool:
    return bool(s.remounting and s.measurand.has_attitude)


def _sky(s: Any, _: int) -> bool:
    return any(term.sky for term in s.terms)


def _shift(s: Any, _: int) -> bool:
    return bool(s.shift)


def _frame(s: Any, _: int) -> bool:
    return bool(s.frame)


def _line(name: str) -> tuple[Part, ...]:
    """Return the parts of the axis about which angles are read, or of the vertical."""
    return _unit_vector(
        name, "", lambda m, _: m.line_of_file,
        lambda s, _: s.measurand.line == name, lambda s, _: s.line and s.measurand.line == name,
    )


OF_MACHINE = (
    Part(
        "target", 3, "target {target}", lambda m, _: m.points,
        free=lambda s, _: s.target, freedoms=lambda s: s.measurand.freedoms,
    ),
    *(Part(f"target_by_{x}", 3, there=_tilts) for x in AB),
    Part(
        "target_rotation", 9, "attitude of target {target}", lambda m, _: m.attitudes.reshape(-1, 9),
        lambda s, _: s.measurand.has_attitude,
    ),
    Part("target_turns", 9, there=_turns),
    Part(
        "remounting_turns", 9, there=_turns_again,
        free=_turns_again, freedoms=lambda _: TURNS, slot="remounting",
    ),
    Part(
        "centre", 3, "mean of the targets", there=lambda s, _: s.centre,
        free=lambda s, _: s.centre and s.target, freedoms=lambda _: XYZ,
    ),
    Part(
        "gravity", 3, "direction of gravity", lambda m, _: m.machine.gravity,
        lambda s, _: s.centre or any(term.uses_gravity for term in s.terms),
    ),
    Part("level_u", 3, "level direction at an azimuth of 90 degrees", lambda m, _: m.level[0], _sky),
    Part("level_v", 3, "level direction at an azimuth of 0", lambda m, _: m.level[1], _sky),
    Part(
        "shift_rotation", 9, "frame shift, rotation", there=_shift,
        free=_shift, freedoms=lambda s: s.measurand.rigid, slot="shift",
    ),
    Part("shift_turns", 9, there=_shift),
    Part("shift", 3, "frame shift, {length}", there=lambda s, _: s.shift and s.moving),
    Part("frame_rotation", 9, there=_frame, free=_frame, freedoms=lambda s: s.measurand.rigid, slot="frame"),
    Part("frame", 3, there=lambda s, _: s.frame and s.moving),
    Part("origin", 3, "", lambda m, _: m.machine.measured.origin, lambda s, _: s.measurand.has_origin),
    *_line("about"),
    *_line("vertical"),
    Part("target_zero", 1, "", lambda m, _: m.zeros, lambda s, _: s.measurand.has_zero),
)
"""Parts of the whole machine: its targets, gravity, frames, and what is measured."""
# fmt: on

ACTS = Part("acts", 1, "", lambda m, n: m.acts(n), lambda s, n: s.terms[n].target)
"""On which targets an effect at a target acts."""

WORDS = {part.name: part.words for part in (*OF_JOINTS, *OF_MACHINE)}


def layout(s: Any) -> tuple[tuple[Part, int], ...]:
    """Return the parts of the geometry of a structure in their order, each with the number of its joint or term."""
    joints = () if s.kinematics.is_closed else range(len(s.joints))
    return (
        *((_number(name, x, name in s.numbers), 0) for name, x in s.kinematics.numbers.items()),
        *((part, j) for j in joints for part in OF_JOINTS),
        *((part, 0) for part in OF_MACHINE),
        *((ACTS, n) for n in range(len(s.terms))),
    )


def _number(name: str, components: Sequence[str], free: bool) -> Part:
    """Return the part that is a number of a closed chain."""
    return Part(
        name,
        len(components),
        value=lambda m, _: m.machine.kinematics.number(name),
        free=lambda *_: free,
        freedoms=lambda _: [f"{name}{x}" for x in components],
        slot="geometry",
    )
