"""The geometry of a fitted machine as URDF: corrected axes and origins, the targets as links of their own.

Or a user's own URDF with the origins of joints corrected as a fitted machine has them, and nothing else changed.
A URDF states an axis in the frame of its joint, so that a corrected axis is a corrected frame: the nominal one, turned
and moved by the least that brings its axis onto the fitted one, and then turned about it, or moved along it, by the
zero of the joint. An origin leads from the frame of the link before to that frame, where all coordinates are zero.
"""

from __future__ import annotations

import itertools
import math
import os
import re
import xml.etree.ElementTree as ElementTree
import xml.parsers.expat
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Array
from rodgen.data.units import parse_unit
from rodgen.errors import InputFileError, joined, listed
from rodgen.files import decoded, read_input
from rodgen.machines.emit._geometry import Geometry, geometry_of, located, of_couplings
from rodgen.machines.fixed import fixed_machine
from rodgen.machines.imports.imported import machine_name
from rodgen.machines.imports.urdf import MOVING, UrdfJoint, joints_of
from rodgen.machines.rigid import complete_basis, roll_pitch_yaw, rotation_matrix

if TYPE_CHECKING:
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
    for number, driver in enumerate(machine.joints):
        # a reading is the coordinate of its joint where nothing else is said
        if name == driver.name or (
            name == driver.column and couplings is not None and not couplings.of[number]
        ):
            unit, of = (1.0 if x.revolute else metre for x in (joint, driver))
            scaled = float(factor) * unit / of, float(stated.constant) * unit
            multiplier, offset = (repr(round(x, 15) + 0.0) for x in scaled)
            return {"joint": driver.name, "multiplier": multiplier, "offset": offset}
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


# corrected ---------------------------------------------------------------------------------------------------------

CORRECTED = "Origins corrected by rodgen"
_LARGEST_TILT, _LARGEST_SHIFT = 0.1, 0.1
"""Of an axis, rad, and in parts of the robot's size: corrections are smaller, the axes of another robot differ more."""
_SAME = 1e-12
_ATTRIBUTE = re.compile(rb"""([^\s"'=<>/]+)\s*=\s*(?:"[^"]*"|'[^']*')""")
_TAG = re.compile(rb"""<(?:[^<>"']|"[^"]*"|'[^']*')*>""")


def corrected_urdf(machine: Machine, path: str | os.PathLike[str], travel: Any = None) -> str:
    """Return the text of a URDF in which the origins of joints are those of a fitted machine.

    Parameters
    ----------
    machine : Machine
        Fitted, and made from this file by `rodgen import`.
    travel : array_like, optional
        See :func:`rodgen.machines.emit.emit`.

    Returns
    -------
    str
        A comment at its end says where the targets are on the last link, and what of the fitted model is not in it.

    Raises
    ------
    InputFileError
        When the file is no URDF, is of another robot, or was corrected before.
    """
    file = os.fspath(path)
    text = decoded(read_input(file, "a robot in URDF"), file)
    if CORRECTED in text:
        raise InputFileError(file, "file", "corrected by rodgen already", "the file that it was made from")
    left_out = geometry_of(machine, travel).left_out
    metre = parse_unit(machine.length_unit).factor("m")
    joints = joints_of(file)
    chain = _chain(machine, file, joints)
    axes, points, zeros = located(machine)
    points = [point * metre for point in points]
    base, nominal = _placed(machine, file, joints, chain, axes, points)
    origins: dict[str, Array] = {}
    zeroed, frame, link = np.eye(4), np.eye(4), base
    for joint, start, axis, point, zero in zip(chain, nominal, axes, points, zeros, strict=True):
        parent = frame @ _product(_between(joints, link, joint)[:-1])
        zeroed = zeroed @ _motion(
            joint, axis, point, zero if MOVING[joint.type] == "revolute" else zero * metre
        )
        frame, link = zeroed @ _aligned(joint, start, axis, point), joint.child
        origins[joint.name] = np.linalg.inv(parent) @ frame
    remarks = []
    for target in fixed_machine(machine).targets:
        place = np.array([*target.point, float(machine.measurand.moving)]) * [metre, metre, metre, 1]
        fixed = next(
            (way for way in _fixed_ways(joints, link) if machine_name(way[-1].child) == target.name), []
        )
        tip = nominal[-1] @ _product(fixed)
        if fixed and np.allclose(tip[:, 3], place, atol=1e-9):
            origins[fixed[-1].name] = np.linalg.inv(frame @ _product(fixed[:-1])) @ zeroed @ tip
        else:
            what = "is at" if machine.measurand.moving else "points along"
            x = (np.linalg.inv(frame) @ zeroed @ place)[:3]
            remarks.append(
                f"target {target.name} {what} {numbers_text(x.round(9))} in the frame of link {link}"
            )
    by_name = {joint.name: joint for joint in joints.values()}
    changed = {
        name: pose for name, pose in origins.items() if np.abs(pose - by_name[name].pose).max() > _SAME
    }
    remarks = [f"{CORRECTED}: {', '.join(changed) or 'none, as none differs'}", *remarks]
    remarks += [f"not in it: {what}" for what in left_out]
    comment = "\n     ".join(line.replace("--", "- -") for line in remarks)
    end = "" if text.endswith("\n") else "\n"
    return f"{_edited(file, text.encode(), changed).decode()}{end}<!-- {comment} -->\n"


# the chain in the file -----------------------------------------------------------------------------------------------


def _chain(machine: Machine, file: str, joints: Mapping[str, UrdfJoint]) -> list[UrdfJoint]:
    """Return the moving joints of the robot that are those of the machine, in its order."""
    wanted = [(joint.name, joint.type) for joint in machine.joints]
    moving = [joint for joint in joints.values() if joint.type in MOVING]
    for last in moving:
        way = [joint for joint in _upwards(joints, last) if joint.type in MOVING][: len(wanted)][::-1]
        names: list[str] = []
        for joint in way:
            names.append(machine_name(joint.name, names, joint=True))
        if wanted == [(name, MOVING[joint.type]) for name, joint in zip(names, way, strict=True)]:
            return way
    found = f"no chain of the joints {joined([joint.name for joint in machine.joints], 'and')}"
    raise InputFileError(
        file,
        "joint",
        found,
        f"the URDF of {machine.file or machine.name}; this one has {listed([j.name for j in moving])}",
    )


def _upwards(joints: Mapping[str, UrdfJoint], joint: UrdfJoint) -> Iterator[UrdfJoint]:
    """Yield a joint, and those that carry it."""
    above: UrdfJoint | None = joint
    for _ in joints:
        if above is None:
            return
        yield above
        above = joints.get(above.parent)


def _between(joints: Mapping[str, UrdfJoint], link: str, joint: UrdfJoint) -> list[UrdfJoint]:
    """Return the joints from a link to a joint above which it is, that joint the last."""
    way = list(itertools.takewhile(lambda each: each.child != link, _upwards(joints, joint)))
    return way[::-1]


def _fixed_ways(joints: Mapping[str, UrdfJoint], link: str) -> Iterator[list[UrdfJoint]]:
    """Yield the ways from a link to those that fixed joints connect with it."""
    for joint in joints.values():
        way = _between(joints, link, joint)
        if way and way[0].parent == link and all(each.type == "fixed" for each in way):
            yield way


def _placed(
    machine: Machine,
    file: str,
    joints: Mapping[str, UrdfJoint],
    chain: Sequence[UrdfJoint],
    axes: Sequence[Array],
    points: Sequence[Array],
) -> tuple[str, list[Array]]:
    """Return the link whose frame is that of the machine's axes, and the frames of joints in it.

    It is the one above the first joint in which the axes of the file are nearest to those of the machine.
    """
    placings: list[tuple[float, int, str, list[Array]]] = []
    for above in _upwards(joints, chain[0]):
        if above is not chain[0] and above.type != "fixed":
            break
        frames, frame, link = [], np.eye(4), above.parent
        for joint in chain:
            frame, link = frame @ _product(_between(joints, link, joint)), joint.child
            frames.append(frame)
        size = max(float(np.linalg.norm(at)) for at in (*(f[:3, 3] for f in frames), *points)) or 1.0
        off = []
        for joint, at, axis, point in zip(chain, frames, axes, points, strict=True):
            tilt = _angle(at[:3, :3] @ joint.axis, axis)
            shift = (
                np.linalg.norm(np.cross(at[:3, 3] - point, axis)) if MOVING[joint.type] == "revolute" else 0.0
            )
            off.append(max(tilt / _LARGEST_TILT, float(shift) / (_LARGEST_SHIFT * size)))
        worst = int(np.argmax(off))
        placings.append((off[worst], worst, above.parent, frames))
    least, worst, base, frames = min(placings, key=lambda each: each[0])
    if least > 1:
        what = f"an axis that is not where {machine.file or machine.name} has it"
        raise InputFileError(
            file, f"joint {chain[worst].name}", what, "the URDF that the machine was made from"
        )
    return base, frames


# frames --------------------------------------------------------------------------------------------------------------


def _product(joints: Sequence[UrdfJoint]) -> Array:
    product = np.eye(4)
    for joint in joints:
        product = product @ joint.pose
    return product


def _angle(a: Array, b: Array) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def _aligned(joint: UrdfJoint, frame: Array, axis: Array, point: Array) -> Array:
    """Return the frame of a joint, turned and moved by the least that brings its axis onto a line."""
    nominal = frame[:3, :3] @ joint.axis
    across = np.cross(nominal, axis)
    sine = float(np.linalg.norm(across))
    aligned = frame.copy()
    if sine > 0:
        aligned[:3, :3] = rotation_matrix(across / sine * _angle(nominal, axis)) @ frame[:3, :3]
    if MOVING[joint.type] == "revolute":
        aligned[:3, 3] = point + axis * ((frame[:3, 3] - point) @ axis)
    return aligned


def _motion(joint: UrdfJoint, axis: Array, point: Array, value: float) -> Array:
    """Return the motion of a joint by a coordinate."""
    motion = np.eye(4)
    if MOVING[joint.type] == "revolute":
        motion[:3, :3] = rotation_matrix(axis * value)
        motion[:3, 3] = point - motion[:3, :3] @ point
    else:
        motion[:3, 3] = axis * value
    return motion


# the text ------------------------------------------------------------------------------------------------------------


def _edited(file: str, content: bytes, origins: Mapping[str, Array]) -> bytes:
    """Return the text with other numbers in the origins of some joints."""
    starts = _tags(content)
    edits: list[tuple[int, int, bytes]] = []
    for name, pose in origins.items():
        joint, origin = starts[name]
        match = _TAG.match(content, joint if origin is None else origin)
        if match is None:
            raise InputFileError(
                file, f"joint {name}", "an origin in an entity", "elements of joints as they are"
            )
        numbers = {b"xyz": numbers_text(pose[:3, 3]), b"rpy": numbers_text(roll_pitch_yaw(pose[:3, :3]))}
        if origin is None:
            space = re.match(rb"\s*", content[match.end() :])
            tag = (space[0] if space else b"") + b"<origin/>"
            edits.append((match.end(), match.end(), _with(tag, numbers)))
        else:
            edits.append((match.start(), match.end(), _with(match[0], numbers)))
    for start, end, text in sorted(edits, reverse=True):
        content = content[:start] + text + content[end:]
    return content


def _with(tag: bytes, numbers: Mapping[bytes, str]) -> bytes:
    """Return a tag with other values of attributes."""
    new = {key: b'%s="%s"' % (key, value.encode()) for key, value in numbers.items()}
    tag = _ATTRIBUTE.sub(lambda attribute: new.pop(attribute[1], attribute[0]), tag)
    return re.sub(rb"(?=\s*/?>$)", b"".join(b" " + each for each in new.values()), tag, count=1)


def _tags(content: bytes) -> dict[str, tuple[int, int | None]]:
    """Return where the tag of each joint of the robot begins, and that of its origin; None where it has none."""
    parser = xml.parsers.expat.ParserCreate()
    path: list[str] = []
    tags: dict[str, tuple[int, int | None]] = {}
    names: list[str] = []
    begun = content.lstrip()  # as `joints_of` reads it
    blank = len(content) - len(begun)

    def begin(tag: str, attributes: Mapping[str, str]) -> None:
        at = blank + parser.CurrentByteIndex
        if path == ["robot"] and tag == "joint":
            names.append(attributes["name"])
            tags[names[-1]] = at, None
        elif path == ["robot", "joint"] and tag == "origin" and tags[names[-1]][1] is None:
            tags[names[-1]] = tags[names[-1]][0], at
        path.append(tag)

    def end(_: str) -> None:
        path.pop()

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.Parse(begun, True)
    return tags
