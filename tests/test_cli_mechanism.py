"""``rodgen mechanism``: forward and reverse, tables in and out, held to the library."""

from __future__ import annotations

import csv
import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from numeric_reverse import errors, search

from rodgen import Machine, matrix_from_axis_angle, matrix_from_quaternion
from rodgen.cli import main as cli
from rodgen.kinematics import spatial

EXAMPLES = Path(__file__).parent.parent / "examples/mechanisms"
JOINTS = [f"R{n} [deg]" for n in range(1, 7)]
POSE = ["x", "y", "z"]
QUATERNION = ["q0", "qx", "qy", "qz"]


def run(capsys: Any, *arguments: str) -> tuple[list[dict[str, str]], str]:
    code = cli.main(["mechanism", *arguments])
    out, err = capsys.readouterr()
    assert code == 0, err
    return list(csv.DictReader(io.StringIO(out))), err


def complaint(capsys: Any, *arguments: str) -> str:
    assert cli.main(["mechanism", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    return str(err)


def write(path: Path, header: list[str], rows: Any) -> str:
    lines = [",".join(header), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def numbers(rows: list[dict[str, str]], names: list[str]) -> np.ndarray:
    return np.array([[float(row[name]) for name in names] for row in rows])


def poses(rows: list[dict[str, str]], unit: str) -> np.ndarray:
    T = np.zeros((len(rows), 4, 4))
    T[:, :3, :3] = matrix_from_quaternion(numbers(rows, QUATERNION))[0]
    T[:, :3, 3] = numbers(rows, [f"{axis} [{unit}]" for axis in POSE])
    T[:, 3, 3] = 1
    return T


@pytest.fixture
def angles(tmp_path: Path) -> str:
    degrees = np.random.default_rng(1).integers(-170, 170, (5, 6))
    return write(tmp_path / "angles.csv", JOINTS, degrees)


# forward and reverse -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["puma_560", "ge_p60", "t3_776"])
def test_forward_and_reverse_go_round(name: str, angles: str, tmp_path: Path, capsys: Any) -> None:
    forward, err = run(capsys, "forward", name, angles)
    assert err == f"{angles}: 5 rows written\n"
    mechanism = spatial.load_mechanism(EXAMPLES / f"{name}.csv")
    given = numbers(forward, JOINTS)
    T = poses(forward, mechanism.unit)
    np.testing.assert_allclose(T, spatial.forward(mechanism, np.radians(given)), atol=1e-12)

    header = ["number", *(f"{axis} [{mechanism.unit}]" for axis in POSE), *QUATERNION]
    table = write(
        tmp_path / "poses.csv", header, [[n, *(row[x] for x in header[1:])] for n, row in enumerate(forward)]
    )
    back, err = run(capsys, "reverse", str(EXAMPLES / f"{name}.csv"), table)
    assert err.startswith(f"{table}: {len(back)} rows written: ")
    number = np.array([int(row["number"]) for row in back])
    found = numbers(back, JOINTS)
    distance, angle = errors(mechanism, np.radians(found), T[number])
    assert max(distance.max(), angle.max()) < 1e-10
    for n in range(5):
        here = number == n
        assert [int(row["solution"]) for row in np.array(back)[here]] == list(range(1, here.sum() + 1))
        off = (found[here] - given[n] + 180) % 360 - 180
        assert np.abs(off).max(axis=1).min() < 1e-9
    assert len(back) == (spatial.reverse(mechanism, T).status <= 2).sum()


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_commands_take_what_the_other_writes(ending: str, angles: str, tmp_path: Path, capsys: Any) -> None:
    """Columns that a result is called by are kept under another name: what was given is not lost."""
    first, second = (str(tmp_path / f"{name}.{ending}") for name in ("poses", "joints"))
    run(capsys, "forward", "puma_560", angles, "-o", first)
    run(capsys, "reverse", "puma_560", first, "-o", second)
    rows, _ = run(capsys, "forward", "puma_560", second)
    given, found = (numbers(rows, [f"{word}{name}" for name in JOINTS]) for word in ("given ", ""))
    off = np.abs((found - given + 180) % 360 - 180).max(axis=1)
    assert (off < 1e-9).sum() == 5
    place = [f"{axis} [in]" for axis in POSE]
    np.testing.assert_allclose(
        numbers(rows, [f"given {name}" for name in place]), numbers(rows, place), atol=1e-9
    )
    again, _ = run(capsys, "reverse", "puma_560", second)
    assert numbers(again[:1], [f"given given {name}" for name in JOINTS]) == pytest.approx(given[:1])


def test_units_parquet_and_tool(angles: str, tmp_path: Path, capsys: Any) -> None:
    first, second = str(tmp_path / "poses.parquet"), str(tmp_path / "angles.parquet")
    run(capsys, "forward", "ge_p60", angles, "-o", first, "--tool", "20,30,50mm")
    made = pq.read_table(first)
    rows = [{k: str(v) for k, v in row.items()} for row in made.to_pylist()]
    T = spatial.forward(spatial.GE_P60, np.radians(numbers(rows, JOINTS)))
    np.testing.assert_allclose(poses(rows, "cm")[:, :3, 3], (T @ [2, 3, 5, 1])[:, :3], atol=1e-11)

    # The same poses in metres and as matrices of six digits, for the tool in inches.
    R = T[:, :3, :3].reshape(-1, 9).round(6)
    header = [*(f"{axis} [m]" for axis in POSE), *(f"r{i}{j}" for i in "123" for j in "123")]
    place = numbers(rows, [f"{axis} [cm]" for axis in POSE]) / 100
    table = write(tmp_path / "matrices.csv", header, np.column_stack([place, R]))
    tool = ",".join(str(x / 2.54) for x in (2, 3, 5)) + "in"
    run(capsys, "reverse", "ge_p60", table, "--from", "matrix", "--tool", tool, "-o", second)
    back = pq.read_table(second).to_pylist()
    found = np.array([[row[f"R{n} [deg]"] for n in range(1, 7)] for row in back])
    wanted = numbers(rows, JOINTS)
    for n in range(5):
        off = (found - wanted[n] + 180) % 360 - 180
        assert np.abs(off).max(axis=1).min() < 0.05  # what six digits leave


def test_rows_without_a_solution_stay(tmp_path: Path, capsys: Any) -> None:
    header = ["id", "x [cm]", "y [cm]", "z [cm]", *QUATERNION]
    rows = [["far", 5000, 0, 0, 1, 0, 0, 0], ["no rotation", 80, 80, 18, 0, 0, 0, 0]]
    found, err = run(capsys, "reverse", "ge_p60", write(tmp_path / "poses.csv", header, rows))
    assert [(row["id"], row["solution"], row["R1 [deg]"], row["status"]) for row in found] == [
        ("far", "0", "nan", "none"),
        ("no rotation", "0", "nan", "invalid"),
    ]
    assert err.endswith("2 rows written: 1 none, 1 invalid\n")


def test_machine_file_keeps_its_axes_zeros_and_targets(tmp_path: Path, capsys: Any) -> None:
    """A point given in machine axes at zero, carried by the product of exponentials of a machine with six joints."""
    file = EXAMPLES.parent / "machines/robot_6r_tracker/machine.toml"
    machine = Machine.load(file)
    degrees = np.random.default_rng(2).uniform(-100, 100, (4, 6))
    names = [joint.name for joint in machine.joints]
    table = write(tmp_path / "joints.csv", [f"{name} [deg]" for name in names], degrees.tolist())
    point = np.array(machine.targets[0].point)
    tool = ",".join(map(str, point)) + "mm"
    rows, _ = run(capsys, "forward", str(file), table, "--tool", tool)
    expected = np.array([_carried(machine, q, point) for q in np.radians(degrees)])
    np.testing.assert_allclose(poses(rows, "mm")[:, :3, 3], expected, atol=1e-9)

    header = [*(f"{axis} [mm]" for axis in POSE), *QUATERNION]
    table = write(tmp_path / "poses.csv", header, [[row[x] for x in header] for row in rows])
    back, _ = run(capsys, "reverse", str(file), table, "--tool", tool)
    found = numbers(back, [f"{name} [deg]" for name in names])
    carried = np.array([_carried(machine, q, point) for q in np.radians(found)])
    assert np.abs(carried[:, None] - expected).max(axis=2).min(axis=1).max() < 1e-7
    for q in degrees:
        assert np.abs((found - q + 180) % 360 - 180).max(axis=1).min() < 1e-8


def _carried(machine: Machine, q: np.ndarray, point: np.ndarray) -> np.ndarray:
    for joint, angle in reversed(list(zip(machine.joints, q, strict=True))):
        axis, centre = np.array(joint.axis), np.array(joint.point)
        point = centre + matrix_from_axis_angle(axis, angle)[0] @ (point - centre)
    return point


@pytest.mark.parametrize(("name", "input"), [("rccc", "R1"), ("rrrcc", "R5")])
def test_loops(name: str, input: str, tmp_path: Path, capsys: Any) -> None:
    file = str(EXAMPLES / f"{name}.csv")
    loop = spatial.load_mechanism(file)
    table = write(tmp_path / "inputs.csv", [f"{input} [deg]"], [[75], [110], [0]])
    rows, _ = run(capsys, "reverse", file, table, "--given", input)
    names = [f"{loop.names[j]}.{k}" if loop.joints[j] == "C" else loop.names[j] for j, k in loop.variables]
    columns = [
        f"{column} [{'deg' if kind == 'theta' else 'mm'}]"
        for column, (_, kind) in zip(names, loop.variables, strict=True)
    ]
    is_angle = np.array([kind == "theta" for _, kind in loop.variables])
    for degrees in (75, 110, 0):
        here = [row for row in rows if row[f"{input} [deg]"] == str(degrees) and row["solution"] != "0"]
        numeric = search(loop, np.eye(4), given={names.index(input): np.radians(degrees)})[0].solutions
        assert len(here) == len(numeric)
        for q in np.where(is_angle, np.degrees(numeric), numeric):
            off = numbers(here, columns) - q
            off = np.where(is_angle, (off + 180) % 360 - 180, off)
            assert np.abs(off).max(axis=1).min() < 1e-8
    assert [row["status"] for row in rows if row["solution"] == "0"] == ["none"]


def test_robot_with_slides(tmp_path: Path, capsys: Any) -> None:
    """A gantry with three slides and a wrist: both ways of the wrist, held to the search."""
    header = ["joint", "type", "S [mm]", "theta [deg]", "a [mm]", "alpha [deg]"]
    rows = [["X", "P", "", 0, 0, 90], ["Y", "P", "", 90, 0, 90], ["Z", "P", "", 30, 20, 40]]
    rows += [["A", "R", 5, "", 10, 60], ["B", "R", 0, "", 0, 90], ["C", "R", 15, "", "", ""]]
    file = write(tmp_path / "gantry.csv", header, rows)
    gantry = spatial.load_mechanism(file)
    given = ["X [mm]", "Y [mm]", "Z [mm]", "A [deg]", "B [deg]", "C [deg]"]
    table = write(tmp_path / "in.csv", given, [[100, -50, 30, 10, 40, 70]])
    made, _ = run(capsys, "forward", file, table)
    header = [*(f"{axis} [mm]" for axis in POSE), *QUATERNION]
    table = write(tmp_path / "poses.csv", header, [[row[x] for x in header] for row in made])
    back, err = run(capsys, "reverse", file, table)
    found = numbers(back, given)
    assert err.endswith("2 rows written: 2 regular\n")
    numeric = search(gantry, poses(made, "mm"))[0].solutions
    numeric[:, 3:] = np.degrees(numeric[:, 3:])
    np.testing.assert_allclose(found[np.argsort(found[:, 0])], numeric[np.argsort(numeric[:, 0])], atol=1e-8)


def test_link_tables_of_the_examples_are_the_robots() -> None:
    for name in ("puma_560", "ge_p60", "t3_776"):
        robot = getattr(spatial, name.upper())
        found = spatial.load_mechanism(EXAMPLES / f"{name}.csv")
        assert (found.joints, found.unit) == (robot.joints, robot.unit)
        for key in ("a", "alpha", "offset", "angle", "pitch"):
            np.testing.assert_array_equal(getattr(found, key), getattr(robot, key))


# bad input ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [
        ["forward", "nothing.csv", "ANGLES"],
        ["forward", "ANGLES", "ANGLES"],
        ["forward", "RCCC", "ANGLES"],
        ["forward", "puma_560", "POSES"],
        ["forward", "puma_560", "ANGLES", "--tool", "1,2,3"],
        ["forward", "puma_560", "ANGLES", "--tool", "1,2,3kg"],
        ["reverse", "puma_560", "ANGLES"],
        ["reverse", "puma_560", "POSES", "--given", "R1"],
        ["reverse", "RCCC", "ANGLES", "--given", "R7"],
        ["reverse", "RCCC", "ANGLES", "--given", "R1,R1"],
        ["reverse", "RCCC", "ANGLES", "--from", "matrix"],
        ["reverse", "RCCC", "ANGLES", "--tool", "1,2,3mm"],
        ["reverse", "H", "INPUT"],
        ["reverse", "PR", "POSES"],
    ],
)
def test_bad_input_is_one_line(refuses_command, arguments: list[str], angles: str, tmp_path: Path) -> None:
    files = {"ANGLES": angles, "RCCC": str(EXAMPLES / "rccc.csv")}
    header = ["x [in]", "y [in]", "z [in]", *QUATERNION]
    files["POSES"] = write(tmp_path / "poses.csv", header, [[10, 10, 10, 1, 0, 0, 0]])
    link = ["type", "a [mm]", "alpha [deg]"]
    files["INPUT"] = write(tmp_path / "input.csv", ["R1 [deg]"], [[30]])
    screw = ["type", "S [mm]", "pitch [mm/rev]", "a [mm]", "alpha [deg]"]
    rows = [["R", 0, "", 1, 60], ["H", 0, 5, 2, 50], *([["C", "", "", 3, 40]] * 2), ["R", 0, "", 1, 70]]
    files["H"] = write(tmp_path / "screw.csv", screw, rows)
    files["PR"] = write(tmp_path / "two.csv", link, [["P", 1, 90], ["R", "", ""]])
    refuses_command("mechanism", *(files.get(word, word) for word in arguments))


def test_arm_without_special_geometry_says_what_is_missing(
    tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ssik", None)
    rows = [["R", 100 + 7 * n, 50 + 9 * n, 20 * n] for n in range(5)]
    arm = write(tmp_path / "arm.csv", ["type", "a [mm]", "alpha [deg]", "S [mm]"], [*rows, ["R", "", "", 40]])
    poses = write(
        tmp_path / "poses.csv", [*(f"{x} [mm]" for x in POSE), *QUATERNION], [[9, 9, 9, 1, 0, 0, 0]]
    )
    told = complaint(capsys, "reverse", arm, poses)
    assert told.startswith(f"{arm}: mechanism: no three consecutive axes of this arm meet")
    assert "pip install 'rodgen[ik]'" in told
