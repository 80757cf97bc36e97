"""The geometry of a fitted machine as URDF: corrected axes and origins, the targets as links of their own."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rodgen.data.units import parse_unit
from rodgen.machines.emit._geometry import of_couplings
from rodgen.machines.rigid import complete_basis, roll_pitch_yaw, rotation_matrix

if TYPE_CHECKING:
    from rodgen.machines.emit._geometry import Geometry
    from rodgen.machines.machine import Joint, Machine

NOTHING = 1e-10
"""Metres or radians that are rounding: a tenth of a nanometre."""
_UNLIMITED = 1000.0
"""Limits, in m, that a slide without a travel gets: URDF demands some."""


def urdf_text(geometry: Geometry, name: str, note: str) -> str:
    """Return the file: metres; the frames of joints are parallel to the machine's axes where all joints are zero."""
    machine = geometry.machine
    metre = parse_unit(machine.length_unit).factor("m")
    robot = ElementTree.Element("robot", name=name)
    rules = {joint.name: _mimic(machine, joint) for joint in machine.joints if joint.coordinate}
    left_out = [
        *geometry.left_out,
        *of_couplings(machine, [name for name, rule in rules.items() if not rule]),
    ]
    for line in (note, *(f"not in it: {what}" for what in left_out)):
        robot.append(ElementTree.Comment(f" {line.replace('--', '- -')} "))
    ElementTree.SubElement(robot, "link", name="base_link")
    parent, place = "base_link", np.zeros(3)
    for joint in machine.joints:
        link = f"{joint.name}_link"
        ElementTree.SubElement(robot, "link", name=link)
        turns = joint.revolute
        kind = ("revolute" if joint.travel else "continuous") if turns else "prismatic"
        element = _joined(robot, joint.name, kind, parent, link, (np.array(joint.point) - place) * metre)
        axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
        ElementTree.SubElement(element, "axis", xyz=numbers_text(axis))
        if kind != "continuous":
            scale = 1.0 if turns else metre
            low, high = (x * scale for x in joint.travel) if joint.travel else (-_UNLIMITED, _UNLIMITED)
            ElementTree.SubElement(
                element,
                "limit",
                lower=numbers_text([low]),
                upper=numbers_text([high]),
                effort="1000",
                velocity="10",
            )
        if rule := rules.get(joint.name):
            ElementTree.SubElement(element, "mimic", rule)
        parent, place = link, np.array(joint.point, float)
    for target in machine.targets:
        ElementTree.SubElement(robot, "link", name=target.name)
        where = (np.array(target.point) - place) * metre
        turn = rotation_matrix(np.array(target.attitude, float))
        if not machine.measurand.moving:  # what points has a direction, and no place: x of its link
            direction = np.array(target.point, float)
            where, turn = np.zeros(3), np.stack([direction, *complete_basis(direction)], axis=1)
        _joined(robot, f"{target.name}_fixed", "fixed", parent, target.name, where, turn)
    ElementTree.indent(robot)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'


def _mimic(machine: Machine, joint: Joint) -> dict[str, str]:
    """Return the rule of a joint that follows one other, in metres and radians; empty where a URDF cannot say it."""
    couplings = machine.couplings
    stated = None if couplings is None else couplings.stated[machine.number_of(joint.name)]
    if joint.is_read or stated is None or len(stated.factors) != 1:
        return {}
    ((name, factor),) = stated.factors
    metre = parse_unit(machine.length_unit).factor("m")
    for number, other in enumerate(machine.joints):
        # a reading is the coordinate of its joint where nothing else is said
        if name == other.name or (
            name == other.column and couplings is not None and not couplings.of[number]
        ):
            own, of = (1.0 if x.revolute else metre for x in (joint, other))
            scaled = float(factor) * own / of, float(stated.constant) * own
            multiplier, offset = (repr(round(x, 15) + 0.0) for x in scaled)
            return {"joint": other.name, "multiplier": multiplier, "offset": offset}
    return {}


def _joined(
    robot: ElementTree.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    origin: np.ndarray,
    turn: np.ndarray | None = None,
) -> ElementTree.Element:
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    ElementTree.SubElement(
        joint,
        "origin",
        xyz=numbers_text(origin),
        rpy="0 0 0" if turn is None else numbers_text(roll_pitch_yaw(turn)),
    )
    return joint


def numbers_text(values: Sequence[float] | np.ndarray) -> str:
    """Return metres, radians or parts of a direction as an attribute has them.

    Examples
    --------
    >>> numbers_text([0.1 + 0.2, 2.4e-11, -1.0])
    '0.3 0 -1'
    """
    return " ".join(f"{x:.12f}".rstrip("0").rstrip(".") if abs(x) > NOTHING else "0" for x in values)
