"""The geometry of a fitted machine: its axes, points and targets with what a fit changed in them, and nothing else.

What is a constant of the geometry is part of it: tilts and offsets of axes, zeros of joints, offsets of targets. All
other effects, which depend on where the machine is, are named as left out: the forms that hold a geometry have no
place for them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Array
from rodgen.errors import InputFileError
from rodgen.machines.emit._scope import scope_of
from rodgen.machines.fixed import fixed_machine
from rodgen.machines.measured import TURNS
from rodgen.machines.rigid import complete_basis, rotation_matrix, rotation_vector, three, tilted

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine


CONSTANT = {"axis_tilt", "squareness", "axis_offset", "zero_offset", "target_offset"}
"""Effects that are constants of the geometry."""

ALONG = 1e-6
"""Sine between the first axis and gravity that a rounded file has."""


@dataclass(frozen=True)
class Geometry:
    """A machine without effects, and what it lacks of the fitted one."""

    machine: Machine
    """A chain: of two branches that from the body of the instrument to the targets."""
    nominal: Machine
    """The same chain as the file has it, without what was fitted."""
    left_out: tuple[str, ...]
    """A sentence for each part of the model that is not in it."""
    slides: bool
    """Whether the base may be anywhere along the first axis: readings are the same, as their frame is free."""
    turns: bool
    """Whether the base may be turned about the first axis, too, which nothing that weighs must see."""


def geometry_of(machine: Machine, travel: Any = None) -> Geometry:
    """Return the geometry of a fitted machine.

    Raises
    ------
    InputFileError
        When it is on legs, or a parameter has no value.
    """
    if machine.kinematics.is_closed:
        raise InputFileError(machine.file or machine.name, "family", "a machine on legs", "a chain of joints")
    scope = scope_of(machine, travel)
    left_out = [f"{what}: {why}" for what, why in scope.left_out]
    corrected = replace(
        scope.machine,
        effects=tuple(e for e in scope.machine.effects if e.name in CONSTANT and not e.definition.own),
    )
    left_out += [
        f"{effect.title}: it depends on where the machine is, and how it came there"
        for effect in scope.machine.effects
        if effect not in corrected.effects
    ]
    fixed, lines = fixed_machine(corrected), located(corrected)
    axes, points, zeros = lines
    targets = [np.array(target.point, float) for target in fixed.targets]
    attitudes = [rotation_matrix(target.attitude) for target in fixed.targets]
    held = _held(fixed)
    moving = machine.measurand.moving
    for k, target in enumerate(fixed.targets):
        offset = held.get(target.name, {}).get("target_offset", {})
        if moving:
            targets[k] = targets[k] + [offset.get(x, 0.0) for x in "xyz"]
            attitudes[k] = rotation_matrix([offset.get(x, 0.0) for x in TURNS]) @ attitudes[k]
        else:
            tilt = [offset.get(x, 0.0) for x in "ab"]
            targets[k] = tilted(targets[k], *complete_basis(targets[k]), tilt)[0]
    if machine.branches:
        axes = [-axis if j < machine.inner else axis for j, axis in enumerate(axes)]
        left_out.append(f"the bed as base: the chain begins at the {machine.measured.instrument}")
    for j in reversed(range(len(axes))):  # a joint's zero moves what it carries
        turn: Array = np.eye(3)
        way: Array = zeros[j] * axes[j]
        if fixed.joints[j].revolute:
            turn = rotation_matrix(way)
            way = points[j] - turn @ points[j]
        axes[j + 1 :] = [turn @ axis for axis in axes[j + 1 :]]
        points[j + 1 :] = [turn @ point + way for point in points[j + 1 :]]
        targets = [turn @ point + way if moving else turn @ point for point in targets]
        attitudes = [turn @ attitude for attitude in attitudes]
    rigid = replace(
        fixed,
        joints=tuple(
            replace(joint, axis=three(axis), point=three(point), branch="")
            for joint, axis, point in zip(fixed.joints, axes, points, strict=True)
        ),
        targets=tuple(
            replace(target, point=three(point), attitude=three(rotation_vector(attitude)))
            for target, point, attitude in zip(fixed.targets, targets, attitudes, strict=True)
        ),
        effects=(),
    )
    nominal = replace(
        rigid,
        joints=tuple(
            replace(
                joint,
                axis=three((-1.0 if j < machine.inner else 1.0) * np.array(joint.axis, float)),
                branch="",
            )
            for j, joint in enumerate(scope.machine.joints)
        ),
        targets=scope.machine.targets,
    )
    slides = machine.measured.frame == "free" and not machine.branches
    upright = np.linalg.norm(np.cross(machine.joints[0].axis, machine.gravity)) < ALONG
    return Geometry(
        rigid, nominal, tuple(left_out), slides, slides and bool(upright or not scope.machine.effects)
    )


def of_couplings(machine: Machine, names: Sequence[str]) -> list[str]:
    """Return that some coupled joints are given by their coordinates, and how these follow from readings."""
    return [
        f"how {name} follows, {machine.joint(name).coordinate}: what is given here moves by its coordinate"
        for name in names
    ]


def located(machine: Machine) -> tuple[list[Array], list[Array], list[float]]:
    """Return the fitted axes, points and zeros of joints, as they stand with the joints before at their own zeros."""
    fixed = fixed_machine(
        replace(
            machine, effects=tuple(e for e in machine.effects if e.name in CONSTANT and not e.definition.own)
        )
    )
    held = _held(fixed)
    axes: list[Array] = []
    points: list[Array] = []
    zeros: list[float] = []
    for joint in fixed.joints:
        of = held.get(joint.name, {})
        axis = np.array(joint.axis, float)
        u, v = complete_basis(axis)
        shift = of.get("axis_offset", {})
        points.append(np.array(joint.point, float) + shift.get("a", 0.0) * u + shift.get("b", 0.0) * v)
        tilt = of.get("axis_tilt", of.get("squareness", {}))
        axes.append(tilted(axis, u, v, [tilt.get("a", 0.0), tilt.get("b", 0.0)])[0])
        zeros.append(of.get("zero_offset", {}).get("a", 0.0))
    if fixed.couplings is not None:  # that of a reading is in every joint that follows it
        read = np.array([joint.is_read for joint in fixed.joints])
        zeros = (fixed.couplings.rates(np.where(read, zeros, 0.0)) + np.where(read, 0.0, zeros)).tolist()
    return axes, points, zeros


def _held(fixed: Machine) -> dict[str, dict[str, dict[str, float]]]:
    held: dict[str, dict[str, dict[str, float]]] = {}
    for effect in fixed.effects:
        held.setdefault(str(effect.place), {})[effect.name] = dict(effect.hold)
    return held
