"""The machine that a fit found, as one whose numbers are known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.errors import InputFileError
from rodgen.machines.model import Model
from rodgen.machines.parts import Effect, Joint, Vector
from rodgen.machines.rigid import rotation_vector, three
from rodgen.machines.structure import row_effects

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine


def fixed_machine(machine: Machine) -> Machine:
    """Return the machine with its fitted numbers in place, and nothing to estimate.

    It predicts what the fitted machine predicts. Axes, points and targets move in place. Only where another effect of a
    joint is written along u and v, which complete the axis *of the file*, the axis stays and its tilt becomes a
    held effect: otherwise those two would turn under it.

    Raises
    ------
    InputFileError
        When an effect is measured over a travel that came from the data.
    """
    terms = list(zip(row_effects(machine), machine.structure.terms, strict=True))
    for effect, term in terms:
        if term.uses_travel and machine.joint(str(effect.place)).travel is None:
            raise InputFileError(
                machine.file or machine.name,
                f"joint {effect.place}, travel",
                f"missing, while {effect.name} is measured over it",
                "the travel that the fitted numbers belong to",
            )
    along_uv = {effect.place for effect, term in terms if term.uses_directions}
    along_uv |= {effect.place for effect in machine.effects if effect.definition.component == "point"}

    freedoms = machine.kinematics.freedoms([joint.name for joint in machine.joints])
    rigid = Model(replace(machine, effects=(), estimate=tuple(freedoms), ties={}))
    theta = rigid.start()
    joints: list[Joint] = []
    tilts: list[Effect] = []
    for j, joint in enumerate(machine.joints):
        if joint.in_loop:
            joints.append(joint)
            continue
        axis = joint.axis
        tilt = {x: rigid.value(theta, f"axis.{x}", j) for x in "ab"}
        if any(tilt.values()) and joint.name in along_uv:
            name = "axis_tilt" if joint.revolute else "squareness"
            tilts.append(Effect(machine.effect(name, joint.name).definition, joint.name, tilt))
        elif any(tilt.values()):
            axis = _unit(rigid.axis(theta, j))
        joints.append(replace(joint, axis=axis, point=three(rigid.point(theta, j))))

    targets = []
    for k, target in enumerate(machine.targets):
        point = rigid.target(theta, k)
        zero = target.zero + rigid.value(theta, "target", k, "zero")
        moves = machine.measurand.moving or any(rigid.value(theta, "target", k, x) for x in "ab")
        scaled = three(point) if machine.measurand.moving else _unit(point)
        attitude = target.attitude
        if machine.measurand.has_attitude:
            attitude = three(rotation_vector(rigid.attitude(theta, k)))
        targets.append(replace(target, point=scaled if moves else target.point, attitude=attitude, zero=zero))

    numbers: dict[str, Any] = {name: rigid.number(theta, name) for name in machine.kinematics.numbers}
    numbers = {name: value if len(value) > 1 else value[0] for name, value in numbers.items()}
    return replace(
        machine,
        joints=tuple(joints),
        kinematics=replace(machine.kinematics, **numbers),
        targets=tuple(targets),
        estimate=(),
        effects=(
            *tilts,
            *(replace(effect, hold=values_to_hold(machine, effect)) for effect in machine.effects),
        ),
        values={},
        known={},
        ties={},
    )


def _unit(vector: np.ndarray) -> Vector:
    return three(vector / np.linalg.norm(vector))


def values_to_hold(machine: Machine, effect: Effect) -> dict[str, float]:
    """Return the values of an effect's parameters to hold; those of each run are left to be found again."""
    if effect.is_per_run(machine.values):
        return dict(effect.hold)
    found = {}
    for name in effect.units(machine):
        value = effect.hold.get(name, machine.values.get(effect.key(name)))
        if value is not None:
            found[name] = value
        elif name not in effect.definition.searched:
            found[name] = 0.0
    return found
