"""A machine from a robot's description in URDF: the chain of joints from one link to another.

Python's own reader of XML is enough: of a URDF a machine needs five elements of its joints. A package that reads all
of it (yourdfpy 0.0.60) brings thirty others for meshes, takes half a second to import, and gives no axes of the chain.
"""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rodgen.array_types import Array
from rodgen.errors import InputFileError, MissingOptionError, joined, listed, shown, suggestion
from rodgen.files import decoded, read_input
from rodgen.machines.coupling import CouplingError
from rodgen.machines.files.read import MOST_JOINTS
from rodgen.machines.imports.imported import Imported, clean, machine_name
from rodgen.machines.machine import Machine
from rodgen.machines.measured import Measured
from rodgen.machines.parts import Joint, Target
from rodgen.machines.rigid import matrix_from_roll_pitch_yaw

_EXPECTED = "a robot in URDF"
MOVING = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}
_MM = 1000.0
_STEP, _NEAR = math.pi / 12, 1e-7
"""An angle that is written nearer than 1e-7 rad (0.1 um at a metre) to a multiple of 15 deg is that multiple."""


def is_urdf(file: str, start: bytes) -> bool:
    """Return whether a file is a URDF, by its name or the first bytes of its content."""
    return file.lower().endswith((".urdf", ".xacro", ".xml")) or start.lstrip().startswith(
        (b"<?xml", b"<robot")
    )


def machine_from_urdf(
    path: str | os.PathLike[str], base: str | None = None, tip: str | None = None
) -> Imported:
    """Return the machine of the chain from one link of a robot to another.

    Parameters
    ----------
    path : str or os.PathLike
        A URDF.
    base : str, optional
        The link in whose frame axes and points are given; default: the robot's root.
    tip : str, optional
        The link whose origin is the target; default: the only link that carries no other.

    Returns
    -------
    Imported
        Lengths in mm. Fixed joints are part of what they join, limits are travels. The readings are points in a free
        frame, and the target is estimated: where the instrument stands, and what it sees on the last link, is not known
        to a URDF.

    Raises
    ------
    InputFileError
        When it is no URDF, or has no such chain.
    """
    file = os.fspath(path)
    robot = _root(file)
    joints = joints_of(file, robot)
    links = [link.get("name", "") for link in robot.iterfind("link")]
    base = _link(file, "--base", base, links, [link for link in links if link not in joints], "roots")
    parents = {joint.parent for joint in joints.values()}
    tip = _link(file, "--tip", tip, links, [link for link in links if link not in parents], "leaf links")
    chain = _chain(file, joints, base, tip)
    return _machine(file, robot.get("name") or "robot", base, tip, chain, joints)


# reading -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class UrdfJoint:
    """A joint as it is in the file: metres and radians, in the frame of its parent."""

    name: str
    type: str
    parent: str
    child: str
    pose: Array
    """Of its frame, (4, 4)."""
    axis: Array
    """A unit vector in its own frame, (3,)."""
    travel: tuple[float, float] | None
    mimic: tuple[str, float, float] | None
    """The joint that it follows, with the factor and the offset; None where it follows none."""
    near: str = ""
    """Angles of its origin that are written as nearly a multiple of 15 deg, and taken as that."""


def _root(file: str) -> ElementTree.Element:
    # robots' parsers take blank lines above the declaration, and read UTF-8 whatever that says
    content = decoded(read_input(file, _EXPECTED), file).removeprefix("\ufeff")
    begun = content.lstrip()
    try:
        root = ElementTree.fromstring(begun)
    except ElementTree.ParseError as error:
        line = error.position[0] + content[: len(content) - len(begun)].count("\n")
        what = str(error).partition(":")[0]
        raise InputFileError(file, f"line {line}", f"no XML ({what})", _EXPECTED) from None
    if any("xacro" in element.tag for element in root.iter()):
        made = f"what 'xacro {file} -o robot.urdf' writes"
        raise InputFileError(file, "file", "a xacro file, from which a URDF is made first", made)
    if root.tag != "robot":
        raise InputFileError(
            file, "file", f"an element {shown(root.tag)}", f"{_EXPECTED}, whose element is <robot>"
        )
    for element in (root, *root.iterfind("link"), *root.iterfind("joint")):
        name = element.get("name", "unnamed")
        if not name or not name.isprintable() or len(name) > 100:
            raise InputFileError(
                file, element.tag, f"the name {shown(name)}", "one line of at most 100 characters"
            )
    return root


def joints_of(file: str, robot: ElementTree.Element | None = None) -> dict[str, UrdfJoint]:
    """Return the joints of a URDF by the links that they carry.

    Parameters
    ----------
    robot : Element, optional
        The file's root, where it has been read.

    Raises
    ------
    InputFileError
        When it is no URDF.
    """
    return {joint.child: joint for joint in _joints(file, _root(file) if robot is None else robot)}


def _joints(file: str, robot: ElementTree.Element) -> Iterator[UrdfJoint]:
    names: set[str] = set()
    children: dict[str, str] = {}
    links = {link.get("name") for link in robot.iterfind("link")}
    for number, element in enumerate(robot.iterfind("joint"), start=1):
        joint = _joint(file, element, number)
        place = f"joint {joint.name}"
        if joint.name in names:
            raise InputFileError(file, place, "a second joint of this name", "a name of its own for each")
        if joint_there := children.get(joint.child):
            found = f"child {shown(joint.child)}, which is the child of joint {joint_there}, too"
            raise InputFileError(file, place, found, "one joint that carries a link")
        for what, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise InputFileError(
                    file, place, f"{what} {shown(link)}, which is no link", "a link of the file"
                )
        names.add(joint.name)
        children[joint.child] = joint.name
        yield joint


def _joint(file: str, element: ElementTree.Element, number: int) -> UrdfJoint:
    name = element.get("name", "")
    if not name:
        raise InputFileError(file, f"joint {number}", "no name", "name = and type = of a joint")
    place = f"joint {name}"

    def text(tag: str, key: str) -> str | None:
        inner = element.find(tag)
        return None if inner is None else inner.get(key)

    def numbers(tag: str, key: str, default: tuple[float, ...]) -> Array:
        written = text(tag, key)
        if written is None:
            return np.array(default)
        try:
            values = np.array([float(x) for x in written.split()])
        except ValueError:
            values = np.array([math.nan])
        if values.shape != (len(default),) or not np.isfinite(values).all() or np.abs(values).max() > 1e9:
            wanted = "a number" if len(default) == 1 else "three numbers"
            raise InputFileError(file, f"{place}, {tag} {key}", shown(written), wanted)
        return values

    axis = numbers("axis", "xyz", (1.0, 0.0, 0.0))
    angles = numbers("origin", "rpy", (0.0, 0.0, 0.0))
    multiples = np.round(angles / _STEP)
    near = np.abs(angles - multiples * _STEP) < _NEAR
    off = near & (np.abs(angles - multiples * _STEP) > 1e-12)
    pose = np.eye(4)
    pose[:3, :3] = matrix_from_roll_pitch_yaw(np.where(near, multiples * _STEP, angles))
    pose[:3, 3] = numbers("origin", "xyz", (0.0, 0.0, 0.0))
    length = float(np.linalg.norm(axis))
    kind = element.get("type", "")
    if kind in MOVING and length == 0:
        raise InputFileError(file, f"{place}, axis xyz", "no direction", "three numbers, not all zero")
    low, high = (float(numbers("limit", key, (0.0,))[0]) for key in ("lower", "upper"))
    limited = kind in ("revolute", "prismatic") and low < high
    followed, mimic = text("mimic", "joint"), None
    if followed is not None:
        factor, offset = (numbers("mimic", *of)[0] for of in (("multiplier", (1.0,)), ("offset", (0.0,))))
        mimic = followed, float(factor), float(offset)
    return UrdfJoint(
        name=name,
        type=kind,
        parent=text("parent", "link") or "",
        child=text("child", "link") or "",
        pose=pose,
        axis=axis / (length or 1.0),
        travel=(low, high) if limited else None,
        mimic=mimic,
        near=", ".join(
            f"{x!r} as {15 * k:g} deg" for x, k in zip(angles[off].tolist(), multiples[off], strict=True)
        ),
    )


# the chain -----------------------------------------------------------------------------------------------------------


def _link(
    file: str, option: str, stated: str | None, links: list[str], natural: list[str], words: str
) -> str:
    """Return the link that is given, or the only one that it may be."""
    if stated is not None:
        if stated in links:
            return stated
        raise InputFileError(file, option, f"no link {shown(stated)}", suggestion(stated, links))
    if not natural:
        found = "links in a circle" if links else "no links"
        raise InputFileError(file, "link", found, "a robot whose links hang on one of them")
    if len(natural) != 1:
        found = f"{len(natural)} {words}, and no {option}"
        raise MissingOptionError(
            file, option, found, f"{option} LINK: {listed(natural)}", f"{option}=", natural
        )
    return natural[0]


def _chain(file: str, joints: Mapping[str, UrdfJoint], base: str, tip: str) -> list[UrdfJoint]:
    """Return the joints from one link to another."""
    chain: list[UrdfJoint] = []
    link, met = tip, {tip}
    while link != base:
        joint = joints.get(link)
        if joint is None or joint.parent in met:
            above = [each.parent for each in chain]
            found = f"no link above {shown(tip)}"
            raise InputFileError(file, f"--base {base}", found, listed(above) if above else "another --tip")
        if joint.type not in MOVING and joint.type != "fixed":
            found = f"type {shown(joint.type)}" if joint.type else "no type"
            raise InputFileError(file, f"joint {joint.name}", found, listed([*MOVING, "fixed"]))
        chain.append(joint)
        link = joint.parent
        met.add(link)
    chain.reverse()
    moving = sum(joint.type in MOVING for joint in chain)
    if not 0 < moving <= MOST_JOINTS:
        found = f"{moving} moving joints from {shown(base)} to {shown(tip)}"
        raise InputFileError(file, "file", found, f"1 to {MOST_JOINTS}; --base and --tip choose other links")
    return chain


def _machine(
    file: str, robot: str, base: str, tip: str, chain: list[UrdfJoint], every: Mapping[str, UrdfJoint]
) -> Imported:
    frame = np.eye(4)
    joints: list[Joint] = []
    names: dict[str, str] = {}
    notes = [
        f"{os.path.basename(file)}: URDF of {shown(robot)}, from link {base} to link {tip}; m and rad there."
    ]
    for joint in chain:
        frame = frame @ joint.pose
        if joint.type == "fixed":
            continue
        kind = MOVING[joint.type]
        name = machine_name(joint.name, [each.name for each in joints], joint=True)
        scale = 1.0 if kind == "revolute" else _MM
        travel = None if joint.travel is None else (joint.travel[0] * scale, joint.travel[1] * scale)
        joints.append(
            Joint(name, kind, clean(frame[:3, :3] @ joint.axis, 15), clean(_MM * frame[:3, 3], 9), travel)
        )
        if name != joint.name:
            notes.append(f"Joint {shown(joint.name)} is called {name}, as a machine file has it.")
        names[joint.name] = name
    notes += [
        f"Angles of joint {joint.name} are taken exactly: {joint.near}." for joint in chain if joint.near
    ]
    followers = {names[joint.name]: joint.mimic for joint in chain if joint.mimic and joint.name in names}
    joint_of, inside = {joint.name: joint for joint in every.values()}, {*names}
    for k, joint_of_chain in enumerate(joints):
        followed, factor, _ = followers.get(joint_of_chain.name) or ("", 0.0, 0.0)
        outside = joint_of.get(followed) if factor and followed not in names else None
        if outside is not None and MOVING.get(outside.type) == joint_of_chain.type:
            # that joint is not of this chain: its reading is the first follower's
            _check_way(file, joint_of_chain.name, followed, joint_of, inside)
            names[followed] = machine_name(followed, [each.name for each in joints], joint=True)
            joints[k] = replace(joint_of_chain, reading=names[followed], coordinate=names[followed])
    joints = [_following(joint, followers.get(joint.name), names, joints, notes) for joint in joints]
    notes += _on_fixed_and_limits(chain)
    target = Target(machine_name(tip, [joint.name for joint in joints]), clean(_MM * frame[:3, 3], 9))
    machine = Machine(
        f"{robot}, {base} to {tip}"[:200],
        "mm",
        "deg",
        (0.0, 0.0, -1.0),
        20.0,
        tuple(joints),
        (target,),
        Measured("point", "free"),
        estimate=("target",),
    )
    try:
        _ = machine.couplings
    except CouplingError as error:
        raise InputFileError(file, f"joint {error.joint}, mimic", error.found, error.expected) from None
    notes.append(
        "Frame and target are estimated: where the instrument is, and what it sees there, a URDF does not say."
    )
    return Imported(machine, tuple(notes))


def _check_way(
    file: str, joint: str, followed: str, joint_of: Mapping[str, UrdfJoint], inside: Collection[str]
) -> None:
    """Raise where what a joint outside a chain follows at last is in the chain, or the joint itself."""
    way, above = [joint], joint_of.get(followed)
    while above is not None and above.mimic and above.mimic[1]:
        way.append(above.name)
        if above.mimic[0] in {*inside, *way}:
            found = " follows ".join([*way, above.mimic[0]])
            raise InputFileError(
                file, f"joint {joint}, mimic", found, "a joint that follows none of this chain"
            )
        above = joint_of.get(above.mimic[0])


def _following(
    joint: Joint,
    mimic: tuple[str, float, float] | None,
    names: Mapping[str, str],
    joints: Sequence[Joint],
    notes: list[str],
) -> Joint:
    """Return a joint with its coordinate where it follows another one of the chain; what was done goes to the notes."""
    if mimic is None:
        return joint
    followed, factor, offset = mimic
    rule = f"{joint.name} = {factor!r} * {followed} + {offset!r} (m, rad)"
    if followed not in names or factor == 0:
        why = "the other joint is not of this chain" if factor else "it follows nothing"
        notes.append(
            f"Joint {joint.name} is a mimic joint, {rule}. That is not taken, as {why}: it is a joint of its own here, "
            "and needs its own column."
        )
        return joint
    name = names[followed]
    read = next(x for x in joints if name in (x.name, x.reading))
    unit_of, unit_read = ("rad" if x.revolute else "m" for x in (joint, read))
    unit = "" if unit_of == unit_read else f" {unit_of}/{unit_read}"
    text = f"{factor!r}{unit} * {name}"
    text = {1.0: name, -1.0: f"-{name}"}.get(factor, text) if not unit else text
    if offset:
        text += f" {'-' if offset < 0 else '+'} {abs(offset)!r} {unit_of}"
    column = f"its column is {joint.reading}" if joint.reading else "it has no column"
    notes.append(f"Joint {joint.name} follows, {rule}: {column}, and its coordinate is {text}.")
    return replace(joint, coordinate=text)


def _on_fixed_and_limits(chain: list[UrdfJoint]) -> Iterator[str]:
    fixed = [joint.name for joint in chain if joint.type == "fixed"]
    if fixed:
        yield f"Fixed joints are part of what they join: {joined(fixed)}."
    endless = [joint.name for joint in chain if joint.type in MOVING and joint.travel is None]
    if endless:
        yield f"Without limits, so that the travel is that of the readings: {joined(endless)}."
