"""``rodgen import`` of a URDF: the machine stands where the robot does."""

from __future__ import annotations

import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rodgen.errors import InputFileError
from rodgen.machines.imports.urdf import machine_from_urdf
from rodgen.machines.machine import Machine
from rodgen.machines.mechanism import to_mechanism

Run = Callable[..., tuple[int, str, str]]
UR10 = Path(__file__).parents[2] / "shared" / "data" / "ur10" / "robot.urdf"
RNG = np.random.default_rng(8)

ROBOT = """<robot name="lift">
  <link name="floor"/><link name="column"/><link name="plate"/><link name="arm"/><link name="hand"/><link name="lamp"/>
  <joint name="lamp_joint" type="fixed"><parent link="floor"/><child link="lamp"/></joint>
  <joint name="slide.1" type="prismatic"><parent link="floor"/><child link="column"/>
    <origin xyz="0.1 -0.2 0.3" rpy="0.1 -0.4 1.2"/><axis xyz="0 1 2"/><limit lower="-0.2" upper="0.5"/></joint>
  <joint name="bolts" type="fixed"><parent link="column"/><child link="plate"/>
    <origin xyz="0 0 0.25" rpy="1.57 0 0.3"/></joint>
  <joint name="turn" type="continuous"><parent link="plate"/><child link="arm"/><axis xyz="0 0 1"/></joint>
  <joint name="nod" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0.4 0 0"/>
    <limit lower="-1.5" upper="2"/><mimic joint="turn" multiplier="-0.5" offset="0.1"/></joint>
</robot>"""


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "lift.urdf"
    path.write_text(ROBOT)
    return path


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' formula as a 4x4 matrix."""
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    T = np.eye(4)
    T[:3, :3] += np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    return T


def to(x: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x
    return T


def seen(urdf: Path, base: str, tip: str, q: np.ndarray) -> np.ndarray:
    """Where the tip is in the frame of the base, m: the product of all matrices of the URDF, one joint at a time."""
    joints = {j.find("child").get("link"): j for j in ElementTree.parse(urdf).getroot().findall("joint")}
    chain = []
    while tip != base:
        chain.insert(0, joints[tip])
        tip = joints[tip].find("parent").get("link")
    T, moved = np.eye(4), iter(q)
    for joint in chain:
        origin, axis = joint.find("origin"), joint.find("axis")

        def three(element, key, default):
            text = None if element is None else element.get(key)
            return np.array([float(x) for x in (text or default).split()])

        roll, pitch, yaw = three(origin, "rpy", "0 0 0")
        x, y, z = np.eye(3)
        T = T @ to(three(origin, "xyz", "0 0 0")) @ about(z, yaw) @ about(y, pitch) @ about(x, roll)
        if joint.get("type") != "fixed":
            along = three(axis, "xyz", "1 0 0")
            along = along / np.linalg.norm(along)
            value = next(moved)
            T = T @ (to(value * along) if joint.get("type") == "prismatic" else about(along, value))
    return T[:3, 3]


def positions(machine: Machine, q: np.ndarray) -> np.ndarray:
    return np.asarray(to_mechanism(machine).forward(q) @ [*machine.targets[0].point, 1.0])[:3]


@pytest.mark.parametrize("q", RNG.uniform(-1.5, 1.5, (10, 3)).tolist())
def test_the_machine_stands_where_the_robot_does(robot, q):
    machine = machine_from_urdf(robot, tip="hand").machine
    in_mm = np.array(q) * [1000 if joint.type == "prismatic" else 1 for joint in machine.joints]
    # axes are written to 1e-15, points to 1e-9 mm; arms are shorter than 2 m
    assert positions(machine, in_mm) == pytest.approx(
        1000 * seen(robot, "floor", "hand", np.array(q)), abs=1e-8
    )


def test_ur10_stands_where_its_urdf_says():
    if not UR10.exists():
        pytest.skip(f"needs {UR10}, which is not part of this repository")
    machine = machine_from_urdf(UR10, "base_link", "tool0").machine
    assert [joint.travel for joint in machine.joints][2] == (-np.pi, np.pi)
    for q in RNG.uniform(-3, 3, (10, 6)):
        assert positions(machine, q) == pytest.approx(1000 * seen(UR10, "base_link", "tool0", q), abs=1e-7)


def test_it_says_what_was_taken_for_what(robot, tmp_path, rodgen_command: Run):
    code, out, err = rodgen_command("import", robot, "--tip", "hand", "-o", tmp_path / "m.toml")
    assert (code, err) == (0, "")
    assert "lift.urdf: URDF of 'lift', from link floor to link hand; m and rad there." in out
    assert "Joint 'slide.1' is called slide_1" in out
    assert "Joint nod is a mimic joint, nod = -0.5 * turn + 0.1 (m, rad). That is not taken" in out
    assert "part of what they join: bolts." in out
    assert "the travel is that of the readings: turn." in out
    machine = Machine.load(tmp_path / "m.toml")
    assert machine.describe() in out
    assert [(joint.name, joint.type, joint.travel) for joint in machine.joints] == [
        ("slide_1", "prismatic", (-200.0, 500.0)),
        ("turn", "revolute", None),
        ("nod", "revolute", (pytest.approx(-1.5), pytest.approx(2.0))),
    ]
    assert machine.measured.frame == "free"
    assert machine.estimate == ("target",)


def test_a_humanoid_of_300_links_takes_no_second(tmp_path):
    links, joints = ['<link name="pelvis"/>'], []
    for limb in range(10):
        for number in range(30):
            child, parent = f"limb{limb}_{number}", f"limb{limb}_{number - 1}" if number else "pelvis"
            links.append(
                f'<link name="{child}"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'
            )
            joints.append(
                f'<joint name="j_{child}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
                f'<origin xyz="0 0 0.1" rpy="0.1 0.2 {number}"/><limit lower="-1" upper="1"/></joint>'
            )
    path = tmp_path / "humanoid.urdf"
    path.write_text(f'<robot name="h">{"".join(links + joints)}</robot>')
    start = time.process_time()
    machine = machine_from_urdf(path, tip="limb7_29").machine
    assert time.process_time() - start < 1.0
    assert len(machine.joints) == 30
    q = RNG.uniform(-1, 1, 30)
    assert positions(machine, q) == pytest.approx(1000 * seen(path, "pelvis", "limb7_29", q), abs=1e-7)


@pytest.mark.parametrize(
    ("old", "new", "options", "expected"),
    [
        ("</robot>", "", {}, "line 11: no XML (no element found); expected a robot in URDF"),
        ("robot", "sdf", {}, "file: an element 'sdf'; expected a robot in URDF, whose element is <robot>"),
        ("<robot ", '<robot xmlns:xacro="http://ros.org/wiki/xacro" ', {}, "--tip: 2 leaf links, and no --tip;"),
        ("</robot>", '<x:if xmlns:x="http://ros.org/wiki/xacro"/></robot>', {}, "file: a xacro file, from which"),
        (ROBOT, '<robot name="x"/>', {}, "link: no links; expected a robot whose links hang on one of them"),
        ("", "", {}, "--tip: 2 leaf links, and no --tip; expected --tip LINK: 'hand' or 'lamp'"),
        ("", "", {"tip": "hadn"}, "--tip: no link 'hadn'; expected 'hand', perhaps"),
        ("", "", {"base": "arm", "tip": "plate"}, "--base arm: no link above 'plate'; expected 'column' or 'floor'"),
        ("", "", {"tip": "lamp"}, "file: 0 moving joints from 'floor' to 'lamp'; expected 1 to 64"),
        ('xyz="0 1 2"', 'xyz="0 0 0"', {"tip": "hand"}, "joint slide.1, axis xyz: no direction; expected three"),
        ('xyz="0.4 0 0"', 'xyz="0.4 O 0"', {"tip": "hand"}, "joint nod, origin xyz: '0.4 O 0'; expected three numb"),
        ('upper="2"', 'upper="inf"', {"tip": "hand"}, "joint nod, limit upper: 'inf'; expected a number"),
        ("continuous", "planar", {"tip": "hand"}, "joint turn: type 'planar'; expected 'revolute', 'continuous', "),
        ('child link="arm"', 'child link="arn"', {"tip": "hand"}, "joint turn: child 'arn', which is no link;"),
        ('child link="lamp"', 'child link="arm"', {"tip": "hand"}, "joint turn: child 'arm', which is the child of"),
        ('"turn" type', '"bolts" type', {"tip": "hand"}, "joint bolts: a second joint of this name; expected a name"),
        ('name="lift"', 'name="a&#10;b = 1"', {"tip": "hand"}, "robot: the name 'a\\nb = 1'; expected one line"),
        ('name="turn"', 'name=""', {"tip": "hand"}, "joint: the name ''; expected one line"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_one_sentence(robot, old, new, options, expected):
    robot.write_text(ROBOT.replace(old, new) if old else ROBOT)
    with pytest.raises(InputFileError) as error:
        machine_from_urdf(robot, **options)
    assert expected in str(error.value)


def test_nothing_is_written_where_the_robot_is_wrong(robot, tmp_path, rodgen_command: Run):
    code, out, err = rodgen_command("import", robot, "-o", tmp_path / "m.toml")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert not (tmp_path / "m.toml").exists()
    assert rodgen_command("import", robot, "--tip", "hand", "-o", robot)[0] == 2
    assert robot.read_text() == ROBOT
