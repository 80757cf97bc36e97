"""``rodgen import`` of a URDF: the machine stands where the robot does."""

from __future__ import annotations

import re
import tomllib
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rodgen.calibration.simulate import simulate
from rodgen.data.measurements import Measurements
from rodgen.machines.files.write import machine_text
from rodgen.machines.imports.urdf import machine_from_urdf
from rodgen.machines.machine import Machine
from rodgen.machines.measured import Measured
from rodgen.machines.mechanism import to_mechanism

Run = Callable[..., tuple[int, str, str]]
UR10 = Path(__file__).parent / "data" / "ur10" / "robot.urdf"
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


def frames_of(urdf: Path) -> list[np.ndarray]:
    """The frames of the moving joints from the first link, at zero, m."""
    frames, T = [], np.eye(4)
    for joint in ElementTree.parse(urdf).getroot().findall("joint")[1:]:
        origin = joint.find("origin")
        xyz, rpy = (
            [float(x) for x in ("0 0 0" if origin is None else origin.get(key, "0 0 0")).split()]
            for key in ("xyz", "rpy")
        )
        x, y, z = np.eye(3)
        T = T @ to(np.array(xyz)) @ about(z, rpy[2]) @ about(y, rpy[1]) @ about(x, rpy[0])
        if joint.get("type") != "fixed":
            frames.append(T)
    return frames


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


def test_blank_lines_may_stand_above_the_declaration(tmp_path, rodgen_command: Run):
    path = tmp_path / "robot.urdf"
    path.write_text("\n \n" + UR10.read_text())
    code, out, err = rodgen_command("import", path, "--tip", "wrist_3_link", "-o", tmp_path / "m.toml")
    assert (code, err) == (0, "")
    assert "wrist_3_joint" in out
    path.write_text("\n\n<robot>\n<link></robot>\n")
    code, _, err = rodgen_command("import", path, "-o", tmp_path / "n.toml")
    assert code == 2
    assert "robot.urdf: line 4: no XML" in err


@pytest.mark.parametrize("exact", [True, False])
def test_ur10_stands_where_its_urdf_says(tmp_path, exact):
    text, path = UR10.read_text(), tmp_path / "ur10.urdf"
    for written, angle in ((r"1\.57079632?[67]?\d*", np.pi / 2), (r"3\.14159265359\d*", np.pi)):
        text = re.sub(written, repr(float(angle)), text) if exact else text
    path.write_text(text)
    imported = machine_from_urdf(path, "world", "tool0")
    machine = imported.machine
    assert [joint.travel for joint in machine.joints][2] == (-np.pi, np.pi)
    assert (
        "Angles of joint robot_joint are taken exactly: -1.5707963 as -90 deg." in imported.notes
    ) != exact
    assert {abs(x) for joint in machine.joints for x in joint.axis} == {0.0, 1.0}
    for q in RNG.uniform(-3, 3, (10, 6)):  # 1e-7 rad at 1.5 m, as the note says
        near = 1e-7 if exact else 1.5e-4
        assert positions(machine, q) == pytest.approx(1000 * seen(path, "world", "tool0", q), abs=near)


def test_it_says_what_was_taken_for_what(robot, tmp_path, rodgen_command: Run):
    code, out, err = rodgen_command("import", robot, "--tip", "hand", "-o", tmp_path / "m.toml")
    assert (code, err) == (0, "")
    assert "lift.urdf: URDF of 'lift', from link floor to link hand; m and rad there." in out
    assert "Joint 'slide.1' is called slide_1" in out
    assert "Joint nod follows, nod = -0.5 * turn + 0.1 (m, rad): it has no column" in out
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


def test_a_mimic_joint_follows_and_is_written_back(robot, tmp_path):
    machine = machine_from_urdf(robot, tip="hand").machine
    assert [joint.coordinate for joint in machine.joints] == [None, None, "-0.5 * turn + 0.1 rad"]
    q = RNG.uniform(-1.0, 1.0, (6, 2))
    design = {"slide_1 [m]": q[:, 0], "turn [rad]": q[:, 1]}
    made = simulate(machine, design, noise=0.0, seed=1)
    places = np.transpose([made.columns[f"{x} [mm]"] for x in "xyz"])
    whole = [[slide, turn, -0.5 * turn + 0.1] for slide, turn in q]
    expected = [1000 * seen(robot, "floor", "hand", np.array(values)) for values in whole]
    assert np.abs(places - expected).max() < 1e-8
    replace(machine, estimate=()).emit("urdf", tmp_path, name="lift2")
    written = tmp_path / "lift2.urdf"
    (mimic,) = ElementTree.parse(written).getroot().iter("mimic")
    assert (mimic.get("joint"), float(mimic.get("multiplier")), float(mimic.get("offset"))) == (
        "turn",
        -0.5,
        0.1,
    )
    again = [1000 * seen(written, "base_link", "hand", np.array(values)) for values in whole]
    assert np.abs(again - places).max() < 1e-6
    assert machine_from_urdf(written).machine.couplings == machine.couplings


def test_a_slide_that_mimics_a_turn_has_a_factor_with_a_unit(tmp_path):
    text = ROBOT.replace('<mimic joint="turn" multiplier="-0.5" offset="0.1"/>', "")
    slide = '<limit lower="-0.2" upper="0.5"/>'
    (tmp_path / "lift.urdf").write_text(
        text.replace(slide, slide + '<mimic joint="nod" multiplier="0.02" offset="-0.1"/>')
    )
    machine = machine_from_urdf(tmp_path / "lift.urdf", tip="hand").machine
    assert machine.joints[0].coordinate == "0.02 m/rad * nod - 0.1 m"
    assert machine.coordinates(np.array([0.0, 0.3, 0.5])) == pytest.approx([-90.0, 0.3, 0.5], rel=1e-15)


@pytest.mark.parametrize(
    ("old", "new"),
    [('joint="turn" multiplier="-0.5"', 'joint="nod"'), ('multiplier="-0.5"', 'multiplier="half"')],
)
def test_what_is_no_mimic_is_one_sentence(refuses, tmp_path, old, new):
    (tmp_path / "lift.urdf").write_text(ROBOT.replace(old, new))
    refuses(machine_from_urdf, tmp_path / "lift.urdf", tip="hand")


def test_a_mimic_joint_of_a_joint_elsewhere_is_one_of_its_own(tmp_path):
    (tmp_path / "lift.urdf").write_text(ROBOT.replace('joint="turn"', 'joint="other"'))
    found = machine_from_urdf(tmp_path / "lift.urdf", tip="hand")
    assert found.machine.joints[2].coordinate is None
    assert "the other joint is not of this chain: it is a joint of its own" in " ".join(found.notes)


@pytest.mark.parametrize("end", ["nod", "slide.1", "lift"])
def test_a_joint_follows_none_that_follows_its_chain(refuses, tmp_path, end):
    outside = f'<joint name="lift" type="revolute"><mimic joint="{end}"/><parent link="floor"/>'
    text = ROBOT.replace('joint="turn" m', 'joint="lift" m')
    (tmp_path / "lift.urdf").write_text(
        text.replace('<joint name="lamp_joint" type="fixed"><parent link="floor"/>', outside)
    )
    refuses(machine_from_urdf, tmp_path / "lift.urdf", tip="hand")


def test_joints_that_follow_one_of_another_chain_have_its_column(tmp_path):
    """A column of two stages: a joint that is in no chain counts both."""
    driven = '<joint name="lift" type="prismatic"><parent link="floor"/><child link="lamp"/></joint>'
    stage = '<mimic joint="lift" multiplier="0.5" offset="-0.1"/></joint>'
    text = ROBOT.replace(
        '<joint name="lamp_joint" type="fixed"><parent link="floor"/><child link="lamp"/></joint>', driven
    )
    text = text.replace('upper="0.5"/></joint>', f'upper="0.5"/>{stage}')
    text = text.replace('<joint name="bolts" type="fixed">', '<joint name="bolts" type="prismatic">')
    text = text.replace('rpy="1.57 0 0.3"/></joint>', f'rpy="1.57 0 0.3"/>{stage}')
    (tmp_path / "lift.urdf").write_text(text)
    machine = machine_from_urdf(tmp_path / "lift.urdf", tip="hand").machine
    assert [joint.column for joint in machine.joints if joint.is_read] == ["lift", "turn"]
    assert [joint.coordinate for joint in machine.joints[:2]] == ["0.5 * lift - 0.1 m"] * 2


def test_what_a_file_says_ends_no_comment_of_the_machine_file(robot):
    """A line feed in an attribute, after which text of the machine file would follow."""
    robot.write_text(
        ROBOT.replace('mimic joint="turn"', 'mimic joint="turn&#10;[environment]&#10;gravity = 9"')
    )
    made = machine_from_urdf(robot, base="floor", tip="hand")
    assert any("turn [environment] gravity = 9" in note for note in made.notes)
    assert tomllib.loads(made.text)["environment"]["gravity"] != 9


@pytest.mark.thorough
def test_a_chain_of_thousands_of_links_is_followed_to_its_end(refuses, tmp_path):
    parts = ["<link name='l0'/>"]
    for n in range(1, 9000):
        parts.append(
            f"<link name='l{n}'/><joint name='j{n}' type='fixed'><parent link='l{n - 1}'/><child link='l{n}'/></joint>"
        )
    (tmp_path / "chain.urdf").write_text(f"<robot name='r'>{''.join(parts)}</robot>")
    refuses(machine_from_urdf, tmp_path / "chain.urdf")


@pytest.mark.parametrize(
    ("old", "new", "options"),
    [
        ("</robot>", "", {}),
        ("robot", "sdf", {}),
        ("<robot ", '<robot xmlns:xacro="http://ros.org/wiki/xacro" ', {}),
        ("</robot>", '<x:if xmlns:x="http://ros.org/wiki/xacro"/></robot>', {}),
        (ROBOT, '<robot name="x"/>', {}),
        ("", "", {}),
        ("", "", {"tip": "hadn"}),
        ("", "", {"base": "arm", "tip": "plate"}),
        ("", "", {"tip": "lamp"}),
        ('xyz="0 1 2"', 'xyz="0 0 0"', {"tip": "hand"}),
        ('xyz="0.4 0 0"', 'xyz="0.4 O 0"', {"tip": "hand"}),
        ('upper="2"', 'upper="inf"', {"tip": "hand"}),
        ("continuous", "planar", {"tip": "hand"}),
        ('child link="arm"', 'child link="arn"', {"tip": "hand"}),
        ('child link="lamp"', 'child link="arm"', {"tip": "hand"}),
        ('"turn" type', '"bolts" type', {"tip": "hand"}),
        ('name="lift"', 'name="a&#10;b = 1"', {"tip": "hand"}),
        ('name="turn"', 'name=""', {"tip": "hand"}),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(refuses, robot, old, new, options):
    robot.write_text(ROBOT.replace(old, new) if old else ROBOT)
    refuses(machine_from_urdf, robot, **options)


def test_nothing_is_written_where_the_robot_is_wrong(robot, tmp_path, rodgen_command: Run):
    code, out, err = rodgen_command("import", robot, "-o", tmp_path / "m.toml")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert not (tmp_path / "m.toml").exists()
    assert rodgen_command("import", robot, "--tip", "hand", "-o", robot)[0] == 2
    assert robot.read_text() == ROBOT


# the correction, in the user's own file ------------------------------------------------------------------------------


def other_reader(urdf: Path, base: str, tip: str) -> Callable[[np.ndarray], np.ndarray]:
    """Return the forward kinematics of ikpy, (4, 4) in metres, from the moving joints' coordinates."""
    ikpy = pytest.importorskip("ikpy.chain")
    joints = {j.find("child").get("link"): j for j in ElementTree.parse(urdf).getroot().findall("joint")}
    elements, moving, link = [tip], [], tip
    while link != base:
        elements = [joints[link].find("parent").get("link"), joints[link].get("name"), *elements]
        moving = [joints[link].get("type") != "fixed", *moving]
        link = elements[0]
    chain = ikpy.Chain.from_urdf_file(str(urdf), elements, symbolic=False)  # which goes on below the tip

    def forward(q: np.ndarray) -> np.ndarray:
        values = np.zeros(len(chain.links))
        values[1 : len(moving) + 1][moving] = q
        return np.asarray(chain.forward_kinematics(values, full_kinematics=True)[len(moving)])

    return forward


def tool_in(urdf: Path) -> np.ndarray:
    """Return where a corrected URDF says that the target is on the last link, m."""
    return np.array(
        [*map(float, re.search(r"is at (\S+ \S+ \S+) in the frame", urdf.read_text())[1].split()), 1]
    )


def with_errors(machine: Machine) -> Machine:
    """Return a machine with an error of every kind that a geometry has, and one that it has not."""
    for joint in machine.joints:
        machine = machine.add("zero_offset", joint=joint.name, hold={"a": 0.3})
        tilt = "axis_tilt" if joint.revolute else "squareness"
        machine = machine.add(tilt, joint=joint.name, hold={"a": 0.2, "b": -0.1})
        if joint.revolute:
            machine = machine.add("axis_offset", joint=joint.name, hold={"a": 0.4, "b": -0.7})
    return machine.add("scale", joint="turn", hold={"k": 0.001})


@pytest.mark.filterwarnings("ignore:Link .* is of type .fixed.")  # of ikpy, where no mask is given
@pytest.mark.parametrize("base", ["floor", "world"])
@pytest.mark.parametrize("tip", ["hand", "tool.0"])
def test_a_users_own_urdf_is_corrected_in_its_origins_alone(robot, tmp_path, base, tip):
    """Another reader finds in the corrected file the places that the model predicts, without what no origin can be."""
    text = ROBOT.replace("0 1 2", "0 0.6 0.8").replace("</robot>", """  <!-- the hand's tool -->
  <link name="world"/>
  <link name="tool.0"><visual><geometry><mesh filename="package://a b/ü.stl"/></geometry></visual></link>
  <joint name='to tool' type='fixed'><child link='tool.0'/><parent link='hand'/><origin rpy='0.1 0 0.2' xyz='0 0
    0.1'/></joint>
  <joint name="pedestal" type="fixed"><parent link="world"/><child link="floor"/><origin rpy="0 0 1"/></joint>
</robot>""")  # fmt: skip
    robot.write_text(text)
    machine = replace(with_errors(machine_from_urdf(robot, base, tip).machine), estimate=())
    (path,) = machine.emit("urdf", tmp_path / "out", into=robot)
    made, _, comment = path.read_text().partition("\n<!-- Origins corrected by rodgen: slide.1, turn, nod")
    assert path.name == robot.name
    assert re.sub(r"\s*<origin[^>]*>", "", made) == re.sub(r"\s*<origin[^>]*>", "", text)
    assert "not in it: scale at turn" in comment
    local = tool_in(path) if tip == "hand" else [0, 0, 0, 1]
    forward = other_reader(path, base, tip)
    machine = replace(machine.remove("scale", joint="turn"), measured=Measured("point", "machine"))
    q = RNG.uniform(-1, 1, (6, 3))
    q[:, 2] = -0.5 * q[:, 1] + 0.1  # nod follows
    design = {"slide_1 [m]": q[:, 0], "turn [rad]": q[:, 1]}
    found = simulate(machine, design, noise=0.0, seed=1).columns
    for row, values in enumerate(q):
        expected = [found[f"{x} [mm]"][row] for x in "xyz"]
        assert 1000 * (forward(values) @ local)[:3] == pytest.approx(expected, abs=1e-5)  # 1e-9 m are written


@pytest.mark.parametrize(
    ("above", "declared", "ends"),
    [("", "ISO-8859-1", "\n"), ("\N{BYTE ORDER MARK}", "UTF-8", "\r\n"), ("\r\n\r\n", "utf-8", "\r\n")],
)
def test_a_users_own_urdf_keeps_each_byte_outside_of_corrected_origins(
    robot, tmp_path, above, declared, ends
):
    """Byte order mark, declaration, ends of lines, quotes, blanks, references, and what only looks like an origin."""
    turned = """rpy = '0  0 0'
      xyz='0.4 0
        0' """
    text = f"""<?xml version='1.0' encoding="{declared}" ?>
<!-- für <joint name="nod"><origin xyz="9 9 9"/></joint> -->
<robot version = '1'  name='lift'
    about="a>b&#10;&quot;">
  <link name='floor'/><link name='arm' /><link name="hand"></link>
  <joint
    type = 'continuous'
    name='turn' >
    <!-- <origin xyz='5 5 5'/> -->
    <child link='arm'/><parent link='floor'/><axis xyz='0 0 1'/></joint>
  <joint name='nod' type='continuous'><parent link='arm'/><child link='hand'/>
    <origin note="a>b xyz='7'"
      {turned}></origin></joint>
  <transmission name='t'><joint name='nod'><origin xyz='8 8 8'/></joint></transmission>
</robot>
"""  # of which the text is UTF-8, whatever it declares
    corrected = text.replace(turned, f"""rpy="{np.radians(0.3):.12f} 0 0"\n      xyz="0.4 0 0" """)
    robot.write_bytes((above + text.replace("\n", ends)).encode())
    machine = replace(machine_from_urdf(robot, "floor", "hand").machine, estimate=())
    off = machine.add("zero_offset", joint="nod", hold={"a": 0.3})
    for name, fitted, expected in (("none", machine, text), ("nod", off, corrected)):
        (path,) = fitted.emit("urdf", tmp_path / name, into=robot)
        made, _, comment = path.read_bytes().partition(b"<!-- Origins corrected by rodgen: ")
        assert made == (above + expected.replace("\n", ends)).encode()
        assert comment.startswith(name.encode())


@pytest.mark.parametrize("encoding", ["ISO-8859-1", "UTF-16"])
def test_a_urdf_that_could_not_be_corrected_is_not_imported(refuses, robot, encoding):
    text = f'<?xml version="1.0" encoding="{encoding}"?>\n<!-- für -->\n{robot.read_text()}'
    machine = machine_from_urdf(robot, "floor", "hand").machine
    robot.write_bytes(text.encode(encoding))
    emit = machine.emit
    for read in (
        lambda: machine_from_urdf(robot, "floor", "hand"),
        lambda: emit("urdf", robot.parent, into=robot),
    ):
        refuses(read)


def test_frames_of_a_corrected_urdf_move_by_the_correction_alone(robot, tmp_path):
    """Neither along an axis nor about it, where no zero is corrected."""
    machine = machine_from_urdf(robot, "floor", "hand").machine
    names = [joint.name for joint in machine.joints]
    parts = [f"{names[0]}.axis", *(f"{name}.{part}" for name in names[1:] for part in ("axis", "point"))]
    values = {f"{part}.{x}": 2e-3 if "axis" in part else 0.3 for part in parts for x in "ab"}
    fitted = replace(machine, measured=Measured("point", "machine"), estimate=tuple(parts), values=values)
    (path,) = fitted.emit("urdf", tmp_path / "out", into=robot)
    old, new = (frames_of(urdf) for urdf in (robot, path))
    for joint, before, after in zip(machine.joints, old, new, strict=True):
        shift, turn = after[:3, 3] - before[:3, 3], (after @ np.linalg.inv(before))[:3, :3]
        vector = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
        assert np.linalg.norm(vector) == pytest.approx(2e-3 * 2**0.5, rel=1e-3)
        assert abs(vector @ joint.axis) < 4e-6
        assert np.linalg.norm(shift) < 0.5e-3
        assert abs(shift @ joint.axis) < 1e-6


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:Link .* is of type .fixed.")  # of ikpy, where no mask is given
def test_ur10s_own_urdf_has_the_places_that_its_measurements_say(refuses, tmp_path):
    """23 poses by a camera: the fitted axes and zeros, in the file that the robot came with, by another reader."""
    machine = machine_from_urdf(UR10, "base_link", "wrist_3_link").machine
    names = [joint.name for joint in machine.joints]
    table = np.genfromtxt(UR10.with_name("calibration.csv"), delimiter=",", names=True)
    columns = {f"{x} [m]": table[f"{x}1"] for x in "xyz"} | {f"{name} [rad]": table[name] for name in names}
    for name in names[1:5]:
        machine = machine.add("zero_offset", joint=name)
    machine = replace(machine, estimate=("target", *(f"{name}.axis" for name in names[1:5])))
    fit = machine.fit(columns)
    refuses(fit.machine.emit, "urdf", tmp_path, into=UR10)  # axes, of 23 poses
    (path,) = fit.machine.emit("urdf", tmp_path, into=UR10, force=True)
    text = path.read_text()
    strip = re.compile(r"<origin[^>]*>")
    assert strip.sub("", text).startswith(strip.sub("", UR10.read_text()))
    assert strip.findall(text) != strip.findall(UR10.read_text())
    here = replace(fit.machine, measured=Measured("point", "machine"))
    found = simulate(
        here, {name: columns[name] for name in columns if "rad" in name}, noise=0.0, seed=1
    ).columns
    expected = np.stack([found[f"{x} [mm]"] for x in "xyz"], axis=1)
    forward, nominal = (other_reader(urdf, "base_link", "wrist_3_link") for urdf in (path, UR10))
    q = np.stack([table[name] for name in names], axis=1)
    assert [1000 * (forward(row) @ tool_in(path))[:3] for row in q] == pytest.approx(expected, abs=1e-5)
    assert np.abs([1000 * (nominal(row) @ tool_in(path))[:3] for row in q] - expected).max() > 1


@pytest.mark.slow
def test_a_board_of_any_attitude_does_not_turn_the_robot(tmp_path, rodgen_command: Run):
    """Where all axes are estimated the board, whose attitude is in no file, takes up how the whole is turned."""
    machine, data = tmp_path / "m.toml", tmp_path / "d.csv"
    named = [f"--column={name}=phi{x}1" for name, x in zip(("roll", "pitch", "yaw"), "xyz", strict=True)]
    files = (UR10, UR10.with_name("calibration.csv"), "-o", machine, "-d", data)
    assert rodgen_command("import", *files, "--tip", "tool0", "--estimate", "geometry", *named)[0] == 0
    fit = Machine.load(machine).fit(Measurements.load(data))
    tilts = [np.radians(e.value / 3600) for key, e in fit.estimates.items() if ".axis." in key]
    assert len(tilts) == 12
    assert np.abs(tilts).max() < 0.02
    code, _, err = rodgen_command("emit", machine, data, "--lang", "urdf", "--into", UR10, "-o", tmp_path)
    assert code == 0, err


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('name="nod"', 'name="nid"'),
        ('xyz="0.4 0 0"', 'xyz="0.1 0 0.3"'),
        ('rpy="1.57 0 0.3"', 'rpy="-1.57 0 0.3"'),
        ("</robot>", "</robot><!-- Origins corrected by rodgen: nod -->"),
        ("</robot>", ""),
    ],
)
def test_a_urdf_of_another_robot_is_not_corrected(
    robot, tmp_path, rodgen_command: Run, refuses_command, old, new
):
    machine = with_errors(machine_from_urdf(robot, tip="hand").machine)
    path = tmp_path / "m.toml"
    path.write_text(machine_text(replace(machine, estimate=())))
    robot.write_text(ROBOT.replace(old, new))
    emit = "emit", path, "--lang", "urdf", "--into", robot, "-o", tmp_path / "out"
    refuses_command(*emit)
    robot.write_text(ROBOT)
    assert not (tmp_path / "out").exists()
    assert rodgen_command(*emit)[0] == 0
    assert rodgen_command(*emit)[0] == 0  # over its own file
    assert rodgen_command(*emit[:-1], tmp_path)[0] == 2  # not over the user's
    assert robot.read_text() == ROBOT
    refuses_command(*emit[:3], "dh", *emit[4:])
