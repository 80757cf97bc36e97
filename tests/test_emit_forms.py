"""What others read of a fitted machine: its poses there, by other readers, are those of the model."""

import csv
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from urdf import chain_of

from rodgen.calibration.simulate import simulate
from rodgen.cli import main as cli
from rodgen.data.measurements import Measurements
from rodgen.machines.effects.symbols import symbols
from rodgen.machines.imports.denavit_hartenberg import machine_from_table
from rodgen.machines.imports.tpoint_model import mount_machine, read_model, with_terms
from rodgen.machines.imports.urdf import machine_from_urdf
from rodgen.machines.machine import Joint, Machine, Measured, Target
from rodgen.machines.mounts import ALTAZ, EQUATORIAL

ARC = np.pi / 648000


def arm(**changed):
    """Return an arm with a slide, errors of its geometry held and fitted, and a backlash that no geometry has."""
    joints = (
        Joint("X", "prismatic", (1.0, 0.0, 0.0), travel=(-200.0, 800.0)),
        Joint("A1", "revolute", (0.0, 0.0, 1.0), (0.0, 0.0, 300.0), travel=(-3.0, 3.0)),
        Joint("A2", "revolute", (0.0, 1.0, 0.0), (50.0, 0.0, 400.0)),
        Joint("A3", "revolute", (0.0, 0.6, 0.8), (300.0, 20.0, 450.0), travel=(-2.0, 2.0)),
    )
    targets = (Target("ball", (400.0, 30.0, 500.0)), Target("tip", (420.0, -30.0, 480.0)))
    machine = Machine(
        "Arm", "mm", "deg", (0.0, 0.0, -1.0), 20.0, joints, targets, Measured("point", "machine"),
        estimate=("A3.axis", "A3.point"),
        values={"A3.axis.a": 2e-3, "A3.axis.b": -1e-3, "A3.point.a": 0.2, "A3.point.b": -0.1, **changed},
    )  # fmt: skip
    for name, place, hold in (
        ("zero_offset", "A1", {"a": 0.2}),
        ("zero_offset", "X", {"a": 0.7}),
        ("axis_tilt", "A2", {"a": 0.1, "b": -0.2}),
        ("axis_offset", "A2", {"a": 0.3, "b": 0.5}),
        ("squareness", "X", {"a": -0.05, "b": 0.1}),
        ("target_offset", "tip", {"x": 0.1, "y": -0.2, "z": 0.3}),
    ):
        machine = machine.add(machine.effect(name, place, hold=hold))
    return machine


def commands(count=12):
    random = np.random.default_rng(5)
    q = random.uniform(-1.5, 1.5, (count, 4)) * [300, 1, 1, 1]
    named = {"X [mm]": q[:, 0]} | {f"A{j} [deg]": np.degrees(q[:, j]) for j in (1, 2, 3)}
    return q, named | {"target": ["ball", "tip"] * (count // 2)}


def places(machine, design):
    made = simulate(machine, design, noise=0.0, seed=1).columns
    return np.stack([made[f"{x} [mm]"] for x in "xyz"], axis=1)


def test_a_urdf_has_the_poses_of_the_model_for_another_reader(tmp_path):
    ikpy = pytest.importorskip("ikpy.chain")
    machine = arm().add("backlash", joint="A1", hold={"b": 0.01})
    (path,) = machine.emit("urdf", tmp_path)
    assert "not in it: backlash at A1" in path.read_text()
    assert '<origin xyz="0 0 0"' in path.read_text()  # what is 0 is written so
    q, design = commands()
    expected = places(arm(), design)
    for k, target in enumerate(("ball", "tip")):
        names = [n for j in ("X", "A1", "A2", "A3") for n in (j, f"{j}_link")]
        elements = ["base_link", *names, f"{target}_fixed", target]
        chain = ikpy.Chain.from_urdf_file(
            str(path), elements, symbolic=False, active_links_mask=[False, *[True] * 4, False]
        )
        for row in range(k, len(q), 2):
            metres = q[row] * [1e-3, 1, 1, 1]
            found = chain.forward_kinematics([0.0, *metres, 0.0])[:3, 3]
            np.testing.assert_allclose(1000 * found, expected[row], atol=1e-6)


def test_a_urdf_is_read_again(tmp_path):
    (path,) = arm().emit("urdf", tmp_path)
    again = machine_from_urdf(path, tip="tip").machine
    _, design = commands()
    design = {**design, "target": ["tip"] * 12}
    joints = {f"{name} [{'mm' if name == 'X' else 'deg'}]": design[key] for name, key in
              zip((j.name for j in again.joints), design, strict=False)}  # fmt: skip
    here = replace(again, measured=Measured("point", "machine"), estimate=())
    np.testing.assert_allclose(places(here, joints), places(arm(), design), atol=1e-6)
    assert again.joints[1].travel == pytest.approx((-3, 3))


def product(path, q, convention):
    """Return where a table has the tool at coordinates (n, joints), by SciPy's rotations."""
    table, lines = tomllib.loads(path.read_text()), path.read_text().splitlines()
    base = np.array([[float(x) for x in line[1:].split()] for line in lines if line.startswith("#   ")])
    found = []
    for values in q:
        T = base
        for value, row in zip(values, table["joint"], strict=True):
            slides, joint, link = row["type"] == "P", np.eye(4), np.eye(4)
            angle = np.radians(row["theta"]) + (0.0 if slides else value)
            joint[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
            joint[2, 3] = row["d"] + (value if slides else 0.0)
            turns = [row["alpha"], row.get("beta", 0.0)]
            link[:3, :3] = Rotation.from_euler("XY", turns, degrees=True).as_matrix()
            link[0, 3] = row["a"]
            T = T @ (joint @ link if convention == "standard" else link @ joint)
        found.append((T @ [*table["tool"], 1])[:3])
    return np.array(found), base


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_a_denavit_hartenberg_table_has_the_poses_of_the_model(tmp_path, convention):
    arm().emit("dh", tmp_path)
    path = tmp_path / f"arm_{convention}_dh.toml"
    q, design = commands()
    found, _ = product(path, q[::2], convention)
    np.testing.assert_allclose(found, places(arm(), design)[::2], atol=1e-6)
    again = machine_from_table(path).machine
    assert [joint.name for joint in again.joints] == ["X", "A1", "A2", "A3"]
    assert again.joints[1].travel == pytest.approx((-3, 3))


@pytest.mark.parametrize("mount", [ALTAZ, EQUATORIAL], ids=lambda mount: mount.name)
@pytest.mark.parametrize("frame", ["machine", "free"])
def test_a_model_of_tpoint_points_as_the_machine(tmp_path, mount, frame):
    machine = mount_machine(mount, "Telescope", 0.6)
    first, second = mount.joints
    keys = [f"{name}.axis.{x}" for name in (first, second) for x in "ab"]
    keys += ["target.boresight.a", "target.boresight.b"]
    values = dict(zip(keys, np.array([30, -20, 15, -10, 25, -35]) * ARC, strict=True))
    turn = {
        "frame.rx": 40 * ARC,
        "frame.ry": -50 * ARC,
        "frame.rz": 60 * ARC,
        "frame.x": 0,
        "frame.y": 0,
        "frame.z": 0,
    }
    values |= turn if frame == "free" else {}
    fitted = replace(machine, measured=Measured("direction", frame), values=values)
    fitted = fitted.add("tube_flexure", hold={"a": 12 / 3600})
    (path,) = fitted.emit("tpoint", tmp_path)
    terms = read_model(path).terms
    assert terms["TF"] == pytest.approx(12, abs=1e-4)
    random = np.random.default_rng(2)
    q = np.column_stack([random.uniform(-3, 3, 40), random.uniform(0.3, 1.2, 40)])
    design = {f"{n} [deg]": np.degrees(x) for n, x in zip(mount.joints, q.T, strict=True)}
    seen = replace(fitted, measured=Measured("direction", "machine"))
    made = simulate(seen, design, noise=0.0, seed=1).columns
    star = np.stack([made[f"u{x}"] for x in "xyz"], axis=1)
    if frame == "free":
        star = star @ Rotation.from_rotvec([turn[f"frame.r{x}"] for x in "xyz"]).as_matrix().T
    from_terms = mount_machine(mount, "Again", 0.6)
    again = with_terms(from_terms, mount, read_model(path), 0.6, str(path))
    read = simulate(again, design, noise=0.0, seed=1).columns
    other = np.stack([read[f"u{x}"] for x in "xyz"], axis=1)
    off = np.linalg.norm(np.cross(star, other), axis=1) / ARC
    assert off.max() < 0.1  # second order: (100 arcsec)², and the last digit of a term


def slide_and_table():
    machine = Machine(
        "Table", "mm", "deg", (0.0, 0.0, -1.0), 20.0,
        (Joint("X", "prismatic", (1.0, 0.0, 0.0), travel=(0.0, 500.0)), Joint("C", "revolute", (0.0, 0.0, 1.0))),
        (Target("ball", (100.0, 0.0, 0.0)),), Measured("point", "machine"),
    )  # fmt: skip
    for name, place, hold in (
        ("scale", "X", {"k": 3e-5}),
        ("backlash", "X", {"b": 0.006}),
        ("straightness", "X", {"u_2": 0.004, "v_3": 0.002, "u_3": 0, "u_4": 0, "v_2": 0, "v_4": 0}),
        ("periodic_drive_error", "X", {"a": 0.002, "b": 0.001, "P": 40.0}),
        ("encoder_eccentricity", "C", {"a": 10 / 3600, "b": 5 / 3600}),
        ("axis_tilt", "C", {"a": 20 / 3600, "b": -30 / 3600}),
        ("axis_offset", "C", {"a": 0.01, "b": 0.02}),
        ("gravity_windup", "C", {"k": 0.001, "k2": 0.0}),
    ):
        machine = machine.add(machine.effect(name, place, hold={x: v for x, v in hold.items()
                              if x in machine.effect(name, place).units(machine)}))  # fmt: skip
    return machine


def columns(path):
    with open(path) as file:
        rows = list(csv.reader(file))
    return {name: np.array([float(row[k]) for row in rows[1:]]) for k, name in enumerate(rows[0])}


def test_error_motions_are_those_of_the_model(tmp_path):
    machine = slide_and_table()
    slide_and_table().emit("iso230", tmp_path)
    assert (
        "gravity_windup at C: it depends on more than the position"
        in (tmp_path / "table_errors.md").read_text()
    )
    table = columns(tmp_path / "table_X.csv")
    bare = replace(machine, effects=())
    only_x = replace(machine, effects=tuple(e for e in machine.effects if e.place == "X"))
    for sign in "+-":
        design = {
            "X [mm]": table["X [mm]"],
            "C [deg]": 0 * table["X [mm]"],
            "dir_X": 0 * table["X [mm]"] + float(f"{sign}1"),
        }
        off = places(only_x, design) - places(bare, design)
        for k, error in enumerate("XYZ"):
            np.testing.assert_allclose(table[f"E{error}X{sign} [um]"], 1000 * off[:, k], atol=1e-5)
    motion = columns(tmp_path / "table_C.csv")
    angle = np.radians(motion["C [deg]"])
    np.testing.assert_allclose(motion["ECC+ [arcsec]"], 10 * np.cos(angle) + 5 * np.sin(angle), atol=1e-6)


def test_location_errors_have_the_signs_of_the_symbols(tmp_path):
    slide_and_table().emit("iso230", tmp_path)
    with (tmp_path / "table_location.csv").open() as file:
        found = {row["symbol"]: float(row["value"]) for row in csv.DictReader(file)}
    parameters = {"axis_tilt": {"a": 20, "b": -30}, "axis_offset": {"a": 10, "b": 20}}  # arcsec, um
    for name in ("A0C", "B0C", "X0C", "Y0C"):
        (symbol,) = symbols(name)
        value = parameters[symbol.definition.name][symbol.relation.split()[0]]
        assert found[name] == pytest.approx(value, rel=1e-3), name
    assert found["B0X"] == found["C0X"] == 0


def test_what_cannot_be_written_is_one_sentence(refuses, tmp_path, capsys):
    refuses(arm().emit, "tpoint", tmp_path)
    refuses(replace(mount_machine(ALTAZ, "Telescope", 0.6), estimate=()).emit, "screw", tmp_path)
    refuses(mount_machine(ALTAZ, "Telescope", 0.6).emit, "tpoint", tmp_path)
    mount = mount_machine(ALTAZ, "Telescope", 0.6).add("backlash", joint="AZ", hold={"b": 0.001})
    fitted = replace(mount, estimate=())
    refuses(fitted.emit, "tpoint", tmp_path)
    tricept = Path("examples/machines/tricept/machine.toml")
    for form in ("urdf", "iso230", "screw"):
        assert cli.main(["emit", str(tricept), "--lang", form, "-o", str(tmp_path), "--force"]) == 2
        (said,) = capsys.readouterr().err.splitlines()
        assert "a machine on legs; expected a chain of joints" in said
    assert not list(tmp_path.iterdir())
    (tmp_path / "arm.urdf").write_text("mine")
    refuses(arm().emit, "urdf", tmp_path)
    slide_and_table().emit("iso230", tmp_path)
    slide_and_table().emit("iso230", tmp_path)  # over its own files
    assert Measurements.load(tmp_path / "table_X.csv").rows > 20


def test_numbers_have_their_expanded_uncertainties(tmp_path):
    """Of one parameter with a standard uncertainty: a scale of 1e-6, a shift of 2 um, a tilt of 3 arcsec."""
    slide = Machine(
        "Slide", "mm", "deg", (0.0, 0.0, -1.0), 20.0,
        (Joint("X", "prismatic", (1.0, 0.0, 0.0), travel=(0.0, 500.0)),),
        (Target("ball", (0.0, 0.0, 0.0)),), Measured("point", "machine"),
    ).add("scale", joint="X")  # fmt: skip
    slide = replace(slide, values={"X.scale.k": 3e-5})
    covariance = ["X.scale.k"], np.array([[1e-12]])
    for form in ("iso230", "screw"):
        slide.emit(form, tmp_path, covariance=covariance)
    rows = list(csv.DictReader((tmp_path / "slide_X.csv").read_text().splitlines()))
    at_end = rows[-1]
    assert (at_end["X [mm]"], at_end["EXX+ [um]"], at_end["U(EXX+) [um]"]) == ("500", "15.0", "1.0")
    assert rows[0]["U(EXX+) [um]"] == ""
    assert "U(EYX+) [um]" not in at_end  # nothing varies it
    for ending in (".comp", "_eec.ini"):
        text = (tmp_path / f"slide_X{ending}").read_text()
        assert "Expanded uncertainty of an error, k = 2: at most 0.0010 mm." in text
    arm().emit("dh", tmp_path, covariance=(["target.tip.z"], np.array([[4e-6]])))
    assert "# U" not in (tmp_path / "arm_standard_dh.toml").read_text().partition("[[joint]]")[2]
    robot = replace(arm(), effects=())
    robot.emit("dh", tmp_path, covariance=(["A3.point.a"], np.array([[4e-6]])))
    text = (tmp_path / "arm_modified_dh.toml").read_text()
    assert "# U is the expanded uncertainty, k = 2" in text
    key = "A3.point.a"
    moved = replace(robot, values={**robot.values, key: robot.values[key] + 0.002})
    moved.emit("dh", tmp_path / "moved")
    tables = [tomllib.loads((tmp_path / at / "arm_modified_dh.toml").read_text()) for at in (".", "moved")]
    changes = [
        abs(b[x] - a[x]) for a, b in zip(*(t["joint"] for t in tables), strict=True) for x in ("a", "d")
    ]
    stated = [
        float(line.partition("# U = ")[2])
        for line in text.splitlines()
        if line[:4] in ("a = ", "d = ") and "#" in line
    ]
    assert stated == pytest.approx([2 * change for change in changes if change > 1e-12], rel=0.05)
    assert len(stated) > 1

    mount = replace(mount_machine(ALTAZ, "Telescope", 0.6), estimate=())
    mount = replace(mount, values={"AZ.axis.a": 30 * ARC, "AZ.axis.b": -20 * ARC})
    (path,) = mount.emit(
        "tpoint",
        tmp_path,
        covariance=(["AZ.axis.a"], np.array([[(3 * ARC) ** 2]])),
        residual=(75, 1.25 * ARC),
    )
    lines = path.read_text().splitlines()
    assert lines[1].split()[:3] == ["T", "75", "1.2500"]
    sigma = {line.split()[0]: float(line.split()[2]) for line in lines[2:-1]}
    assert sigma["AN"] == pytest.approx(3, abs=1e-4)
    assert sigma["AW"] == 0


def test_a_urdf_has_the_attitude_of_a_tool(tmp_path):
    ikpy = pytest.importorskip("ikpy.chain")
    machine = arm()
    turned = replace(machine.targets[1], attitude=(0.3, -0.5, 0.9))
    machine = replace(machine, targets=(turned,), measured=Measured("pose", "machine"))
    machine = machine.remove("target_offset", target="tip")
    machine = machine.add(
        "target_offset", target="tip", hold={"x": 0.1, "y": 0, "z": 0, "rx": 0.2, "ry": 0, "rz": -0.1}
    )
    (path,) = machine.emit("urdf", tmp_path)
    names = [n for j in ("X", "A1", "A2", "A3") for n in (j, f"{j}_link")]
    chain = ikpy.Chain.from_urdf_file(
        str(path), ["base_link", *names, "tip_fixed", "tip"], symbolic=False,
        active_links_mask=[False, *[True] * 4, False],
    )  # fmt: skip
    q, design = commands()
    design = {n: v for n, v in design.items() if n != "target"}
    made = simulate(machine, design, noise="0mm, 0arcsec", seed=1).columns
    place = np.stack([made[f"{x} [mm]"] for x in "xyz"], axis=1)
    vector = np.radians(np.stack([made[f"r{x} [deg]"] for x in "xyz"], axis=1))
    for row in range(len(q)):
        found = chain.forward_kinematics([0.0, *(q[row] * [1e-3, 1, 1, 1]), 0.0])
        np.testing.assert_allclose(1000 * found[:3, 3], place[row], atol=1e-6)
        np.testing.assert_allclose(found[:3, :3], Rotation.from_rotvec(vector[row]).as_matrix(), atol=1e-9)


@pytest.mark.thorough
def test_location_errors_have_expanded_uncertainties_from_a_fit(tmp_path):
    folder = Path("examples/machines/rotary_table")
    files = [str(folder / "machine.toml"), str(folder / "data.csv")]
    assert cli.main(["emit", *files, "--lang", "iso230", "-o", str(tmp_path)]) == 0
    estimates = Machine.load(files[0]).fit(Measurements.load(files[1])).estimates
    (path,) = tmp_path.glob("*_location.csv")
    with path.open() as file:
        found = {row["symbol"]: row for row in csv.DictReader(file)}
    for symbol, key, factor in (("A0C", "C.axis.a", 1), ("B0C", "C.axis.b", 1), ("X0C", "C.point.a", 1000)):
        u = 2 * factor * estimates[key].std
        assert float(found[symbol]["U (k = 2)"]) == pytest.approx(u, abs=0.05)  # two digits
        value, decimals = found[symbol]["value"], len(found[symbol]["U (k = 2)"].partition(".")[2])
        assert value == f"{factor * estimates[key].value:.{decimals}f}"
        assert found[symbol]["note"] == ""
    assert (found["C0C"]["U (k = 2)"], found["C0C"]["note"]) == ("", "not estimated")


TABLE = """joint,theta [deg],d [mm],a [mm],alpha [deg]
J1,0,450,150,-90
J2,-90,0,600,0
J3,0,0,120,-90
J4,0,640,0,90
J5,0,0,0,-90
J6,0,100,0,0
"""


UR5 = """joint,theta [deg],d [mm],a [mm],alpha [deg]
J1,0,89.159,0,90
J2,0,0,-425,0
J3,0,0,-392.25,0
J4,0,109.15,0,90
J5,0,94.65,0,-90
J6,0,82.3,0,0
"""
SCARA = """joint,theta [deg],d [mm],a [mm],alpha [deg]
J1,0,320,225,0
J2,0,-40,175,180
J3,0,60,0,0
"""
PUMA560 = """joint,theta [deg],d [mm],a [mm],alpha [deg]
J1,0,0,0,0
J2,0,243.5,0,-90
J3,0,-93.4,431.8,0
J4,0,433.1,-20.3,90
J5,0,0,0,-90
J6,0,0,0,90
"""


@pytest.mark.parametrize(
    ("table", "convention"),
    [
        pytest.param(TABLE, "standard", id="arm"),
        pytest.param(UR5, "standard", id="UR5"),
        pytest.param(SCARA, "standard", id="SCARA"),
        pytest.param(PUMA560, "modified", id="PUMA 560"),
    ],
)
def test_a_table_comes_back_as_it_came(tmp_path, table, convention):
    """Lengths of either sign, and offsets along parallel axes: of rows that are equal those with the least theta."""
    (tmp_path / "robot.csv").write_text(table)
    machine = machine_from_table(tmp_path / "robot.csv", convention).machine
    replace(machine, measured=Measured("point", "machine"), estimate=()).emit("dh", tmp_path, name="robot")
    rows = tomllib.loads((tmp_path / f"robot_{convention}_dh.toml").read_text())["joint"]
    for row, given in zip(rows, csv.DictReader(table.splitlines()), strict=True):
        for name, value in list(given.items())[1:]:
            assert row[name.partition(" ")[0]] == pytest.approx(float(value), abs=1e-9), given["joint"]


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_a_star_marks_what_the_place_of_the_base_makes_up_for(tmp_path, convention):
    """Of numbers of the first row that vary: another one moves all poses as one body, or the star is wrong."""
    (tmp_path / "robot.csv").write_text(TABLE)
    machine = machine_from_table(tmp_path / "robot.csv", "standard").machine
    keys = [f"J{j}.{part}.{x}" for j in (2, 3, 4) for part in ("axis", "point") for x in "ab"]
    parts = tuple(f"J{j}.{part}" for j in (2, 3, 4) for part in ("axis", "point"))
    machine = replace(machine, estimate=parts, values=dict.fromkeys(keys, 1e-4))
    machine.emit("dh", tmp_path, name="robot", covariance=(keys, np.diag(np.full(len(keys), 1e-10))))
    path = tmp_path / f"robot_{convention}_dh.toml"
    text = path.read_text()
    first = text.split("[[joint]]")[1]
    q = np.random.default_rng(3).uniform(-2, 2, (8, 6))
    before, _ = product(path, q, convention)
    stars = {}
    for key, value, star in re.findall(r"(\w+) = (\S+)  # U = [\d.e-]+(\*?)", first):
        changed = first.replace(f"\n{key} = {value}", f"\n{key} = {float(value) + 1}")
        path.write_text(text.replace(first, changed, 1))
        after, _ = product(path, q, convention)
        far = [np.linalg.norm(places[:, None] - places, axis=-1) for places in (before, after)]
        stars[key] = bool(star)
        assert stars[key] == np.allclose(*far, atol=1e-9), key
    assert stars["theta"]


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("moved", [0.0, 1e-3], ids=["as imported", "moved"])
def test_a_table_has_the_rows_of_the_imported_one_and_the_poses_of_the_fit(tmp_path, convention, moved):
    """Parallel axes that a fit has tilted, and a target off the last axis: a product of rows, and read again."""
    (tmp_path / "robot.csv").write_text(TABLE)
    machine = machine_from_table(tmp_path / "robot.csv", "standard").machine
    random = np.random.default_rng(1)
    parts = ("J2.axis", "J2.point", "J3.axis", "J3.point", "J4.point", "J5.axis", "J6.point")
    keys = [f"{part}.{x}" for part in parts for x in "ab"]
    sizes = [moved if "axis" in key else 300 * moved for key in keys]
    values = dict(zip(keys, random.uniform(-1, 1, len(keys)) * sizes, strict=True))
    values |= {"target.tool.x": 40.0, "target.tool.y": 20.0, "target.tool.z": -20.0}
    fitted = replace(
        machine, measured=Measured("point", "machine"), estimate=(*parts, "target"), values=values
    )
    covariance = keys, np.diag(np.full(len(keys), 1e-10))
    fitted.emit("dh", tmp_path, name="robot", covariance=covariance)
    path = tmp_path / f"robot_{convention}_dh.toml"
    rows = tomllib.loads(path.read_text())["joint"]
    given = list(csv.DictReader(TABLE.splitlines()))
    for row, own in zip(rows, given, strict=True):
        assert row["theta"] == pytest.approx(float(own["theta [deg]"]), abs=200 * moved + 1e-9)
        assert row["d"] == pytest.approx(float(own["d [mm]"]), abs=2000 * moved + 1e-9)
    alphas = [row["alpha"] for row in rows]
    expected = [float(own["alpha [deg]"]) for own in given]
    if convention == "modified":
        expected = expected[-1:] + expected[:-1]
    np.testing.assert_allclose(alphas, expected, atol=200 * moved + 1e-9)
    stated = re.findall(r"# U = (\S+)", path.read_text())
    assert len(stated) > 10
    assert max(map(float, stated)) < 0.02  # of 10 um, and 2 arcsec over 640 mm, k = 2
    q = random.uniform(-2, 2, (8, 6))
    design = {f"J{k + 1} [deg]": np.degrees(x) for k, x in enumerate(q.T)}
    seen = places(fitted, design)
    found, base = product(path, q, convention)
    np.testing.assert_allclose(found, seen, atol=1e-6)
    again = replace(machine_from_table(path).machine, measured=Measured("point", "machine"))
    turn, shift = base[:3, :3], base[:3, 3]
    np.testing.assert_allclose(places(again, design) @ turn.T + shift, seen, atol=1e-6)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_frames_of_a_urdf_are_where_the_table_has_them_but_for_the_fit(tmp_path, convention):
    """Each joint stands in its frame of the table, and moves by no more than its correction, across its axis."""
    (tmp_path / "robot.csv").write_text(TABLE)
    machine = machine_from_table(tmp_path / "robot.csv", convention).machine
    T, frames = np.eye(4), []
    for row in csv.DictReader(TABLE.splitlines()):
        theta, d, a, alpha = (float(x) for name, x in row.items() if name != "joint")
        joint, link = np.eye(4), np.eye(4)
        joint[:3, :3], joint[2, 3] = Rotation.from_euler("z", theta, degrees=True).as_matrix(), d
        link[:3, :3], link[0, 3] = Rotation.from_euler("x", alpha, degrees=True).as_matrix(), a
        frames.append(T if convention == "standard" else T @ link @ joint)
        T = T @ (joint @ link if convention == "standard" else link @ joint)
    machine = replace(machine, joints=tuple(replace(joint, travel=(-3.0, 3.0)) for joint in machine.joints))
    parts = [f"J{j}.{part}" for j in range(2, 7) for part in ("axis", "point")]
    values = {f"{part}.{x}": 2e-3 if "axis" in part else 0.3 for part in parts for x in "ab"}
    fitted = replace(machine, measured=Measured("point", "machine"), estimate=tuple(parts), values=values)
    (path,) = fitted.emit("urdf", tmp_path)
    joints, _ = chain_of(path, "tool")
    for joint, frame in zip(joints, frames, strict=True):
        off = np.array(joint["point"]) - frame[:3, 3]
        assert np.linalg.norm(off) < 0.5
        assert abs(off @ frame[:3, 2]) < 1e-6
        np.testing.assert_allclose(joint["axis"], frame[:3, 2], atol=4e-3)


@pytest.mark.thorough
def test_geometry_that_lowers_no_error_on_poses_left_out_is_said_and_not_emitted(refuses, tmp_path):
    """An arm as its table says: what a fit adds is noise. With an axis off by 2 mrad it is not."""
    (tmp_path / "robot.csv").write_text(TABLE)
    machine = machine_from_table(tmp_path / "robot.csv", "standard").machine
    parts = tuple(f"J{j}.{part}" for j in range(2, 7) for part in ("axis", "point"))
    estimated = replace(machine, estimate=(*parts, "target"))
    still = {f"frame.{x}": 0.0 for x in ("x", "y", "z", "rx", "ry", "rz")}
    q = np.random.default_rng(6).uniform(-100, 100, (40, 6))
    design = {f"J{k + 1} [deg]": x for k, x in enumerate(q.T)}
    said = (
        "Axes and points of joints are estimated, and the rms on poses that the fit did not see does not fall"
    )
    for tilt in (0.0, 2e-3):
        real = replace(machine, estimate=("J3.axis",), values={"J3.axis.a": tilt, "J3.axis.b": 0.0} | still)
        made = simulate(real, design, noise=0.05, seed=4).columns
        data = design | {f"{x} [mm]": np.array(made[f"{x} [mm]"]) for x in "xyz"}
        fit = estimated.fit(data)
        held_out = fit.to_dict()["held_out_geometry"]
        assert held_out["lowers"] == bool(tilt) == (held_out["fitted"] < held_out["nominal"])
        assert (said in fit.summary()) is not held_out["lowers"]
        if tilt:
            fit.emit("dh", tmp_path / "off")
            continue
        refuses(fit.emit, "dh", tmp_path / "right")
        assert not (tmp_path / "right").exists()
        fit.emit("dh", tmp_path / "right", force=True)


def test_numbers_of_a_table_that_are_held_or_undefined_have_no_uncertainty(tmp_path):
    """The zero of a wrist whose axes meet: one angle varies, and not by half a turn where a is 0."""
    (tmp_path / "robot.csv").write_text(TABLE)
    machine = machine_from_table(tmp_path / "robot.csv", "standard").machine
    machine = replace(machine, measured=Measured("point", "machine"), estimate=()).add(
        "zero_offset", joint="J5"
    )
    machine = replace(machine, values={"J5.zero_offset.a": 9e-4})
    machine.emit("dh", tmp_path, name="robot", covariance=(["J5.zero_offset.a"], np.array([[1e-10]])))
    for convention in ("standard", "modified"):
        lines = [
            x for x in (tmp_path / f"robot_{convention}_dh.toml").read_text().splitlines() if "# U = " in x
        ]
        (line,) = lines
        assert line.startswith("theta = 0.0515")
        assert float(line.partition("# U = ")[2]) == pytest.approx(np.degrees(2e-5), rel=0.1)


def test_what_points_is_the_x_axis_of_its_link_in_a_urdf(tmp_path):
    ikpy = pytest.importorskip("ikpy.chain")
    machine = replace(mount_machine(EQUATORIAL, "Telescope", 0.6), estimate=())
    machine = machine.add("zero_offset", joint="HA", hold={"a": 0.2}).add(
        "axis_tilt", joint="DEC", hold={"a": 0.1, "b": 0.2}
    )
    machine = machine.add("target_offset", target="boresight", hold={"a": 0.3, "b": -0.1})
    (path,) = machine.emit("urdf", tmp_path)
    machine.emit("dh", tmp_path)
    q = np.random.default_rng(4).uniform(-1.2, 1.2, (8, 2))
    made = simulate(
        machine, {"HA [deg]": np.degrees(q[:, 0]), "DEC [deg]": np.degrees(q[:, 1])}, noise=0.0, seed=1
    ).columns
    elements = ["base_link", "HA", "HA_link", "DEC", "DEC_link", "boresight_fixed", "boresight"]
    mask = [False, True, True, False]
    chain = ikpy.Chain.from_urdf_file(str(path), elements, symbolic=False, active_links_mask=mask)
    for row, angles in enumerate(q):
        found = chain.forward_kinematics([0.0, *angles, 0.0])[:3, 0]
        np.testing.assert_allclose(found, [made[f"u{x}"][row] for x in "xyz"], atol=1e-9)
    tool = tomllib.loads((tmp_path / "telescope_standard_dh.toml").read_text())["tool"]
    assert np.linalg.norm(tool) == pytest.approx(1)
