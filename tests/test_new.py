"""``rodgen new``: each file is right, can be simulated, and is found by a fit; machine tools turn as built."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rodgen
from rodgen.calibration.check import check
from rodgen.data.measurements import Measurements
from rodgen.machines.files.read import machine_of
from rodgen.machines.machine import Machine
from rodgen.machines.mechanism import to_mechanism
from rodgen.machines.templates import CODES, KINDS, machine_template

Run = Callable[..., tuple[int, str, str]]
EXAMPLES = Path(__file__).parent.parent / "examples" / "machines"
LATITUDE = np.radians(48.1)


def made(kind: str, code: str | None = None) -> Machine:
    latitude = LATITUDE if kind.startswith("equatorial") else None
    return machine_of(machine_template(kind, code=code, latitude=latitude), f"{kind}.toml")


def design(kind: str, machine: Machine) -> Measurements:
    """Return commands all over the travel."""
    if kind in {"tricept", "3-sps-s"}:
        return Measurements.load(EXAMPLES / kind.replace("3-sps-s", "three_sps_s") / "data.csv")
    rng = np.random.default_rng(6)
    poses = 80
    targets = [target.name for target in machine.targets]
    columns = {}
    for k, joint in enumerate(machine.joints):
        usual = machine.kinematics.usual_travel(k) if machine.kinematics.is_closed else (-2.6, 2.6)
        low, high = joint.travel or usual
        unit = "rad" if joint.revolute else machine.length_unit
        columns[f"{joint.name} [{unit}]"] = np.repeat(rng.uniform(low, high, poses), len(targets))
    return Measurements.from_frame(columns | {"target": targets * poses})


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_is_simulated_and_found_again(kind):
    machine = made(kind)
    commands = design(kind, machine)
    noise = "0.5arcsec" if machine.measured.kind in {"direction", "angle"} else "2um"
    simulated = rodgen.simulate(machine, commands, noise=noise, seed=1)
    columns = {column.text: column.values for name, column in commands.columns.items()}
    columns = {
        name: values
        for name, values in columns.items()
        if not name.startswith(("x ", "y ", "z ", "u", "angle"))
    }
    data = Measurements.from_frame({**columns, **simulated.columns})
    found = check(machine, data)
    assert not found.wrong, found.summary()
    fitted = machine.fit(data)
    size = 0.5 if noise == "0.5arcsec" else 0.002
    assert fitted.rms == pytest.approx(size, rel=3 / np.sqrt(2 * data.rows))  # three deviations


@pytest.mark.parametrize("kind", [*CODES, "table-table BC"])
def test_a_machine_tool_is_its_two_branches(kind):
    """Table and head by plain matrices: by ISO 841 a table turns against the sign of its axis."""
    code = "[w C' B' b X Y Z (C1) t]" if kind.endswith("BC") else CODES[kind]
    machine = made(kind.split()[0], code)
    parts = code.replace("'", "").replace("(C1)", "").strip("[]").split()
    bed = parts.index("b")
    unit = {"X": [1, 0, 0], "Y": [0, 1, 0], "Z": [0, 0, 1], "A": [1, 0, 0], "B": [0, 1, 0], "C": [0, 0, 1]}

    def motion(axis, value, pivot):
        T = np.eye(4)
        e = np.array(unit[axis], float)
        if axis in "XYZ":
            T[:3, 3] = value * e
            return T
        K = np.cross(np.eye(3), e)
        T[:3, :3] += np.sin(value) * K + (1 - np.cos(value)) * K @ K
        T[:3, 3] = pivot - T[:3, :3] @ pivot
        return T

    names = [joint.name for joint in machine.joints]
    assert names == [part for part in parts if part not in "wbt"]
    rng = np.random.default_rng(2)
    for _ in range(4):
        q = {name: rng.uniform(-2, 2) * (1 if name in "ABC" else 100) for name in names}
        table, head = np.eye(4), np.eye(4)
        for axis in reversed(parts[1:bed]):  # from the bed to the workpiece, which moves the other way
            table = table @ motion(axis, -q[axis], np.zeros(3))
        for axis in parts[bed + 1 : -1]:
            head = head @ motion(axis, q[axis], np.array([0, 0, 150.0]))
        expected = np.linalg.inv(table) @ head @ [0, 0, 0, 1]
        seen = to_mechanism(machine).forward([q[name] for name in names]) @ [*machine.targets[0].point, 1]
        assert seen == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("code", ["[w C A b X Y Z t]", "[w C' B' b X Y Z t]", "[w A X b Z Y t]"])
def test_balls_on_the_table_are_where_the_tool_meets_them(code):
    """The tool at the place of a ball is, in the workpiece's axes, where the ball is with all joints at zero."""
    probed = machine_of(machine_template("table-table", code=code, balls=2), "m.toml")
    tool = made("table-table", code)
    rng = np.random.default_rng(3)
    for ball in probed.targets:
        q = dict(zip((joint.name for joint in probed.joints), rng.uniform(-2, 2, 2), strict=False))
        place = to_mechanism(probed).forward(list(q.values())) @ [*ball.point, 1]
        q |= dict(zip("XYZ", place, strict=False))
        chain = to_mechanism(tool).forward([q[joint.name] for joint in tool.joints])
        assert chain @ [*tool.targets[0].point, 1] == pytest.approx([*ball.point, 1], abs=1e-9)


def test_the_command_writes_and_lists(tmp_path, rodgen_command: Run):
    code, out, err = rodgen_command("new")
    assert (code, err) == (0, "")
    assert [line.split()[0] for line in out.splitlines()] == list(KINDS)
    path = tmp_path / "m.toml"
    code, out, err = rodgen_command("new", "equatorial-german", "--latitude", "-31.5deg", "-o", path)
    assert (code, err) == (0, "")
    assert Machine.load(path).describe() in out
    assert Machine.load(path).gravity == pytest.approx(
        (-np.cos(np.radians(31.5)), 0, np.sin(np.radians(31.5)))
    )
    _, out, _ = rodgen_command("new", "turntable")
    assert out == machine_template("turntable")


@pytest.mark.parametrize(
    "arguments",
    [
        ["turn-table"],
        ["equatorial-fork"],
        ["equatorial-fork", "--latitude", "95deg"],
        ["turntable", "--code", "[w b X t]"],
        ["3-axis", "--code", "[w X Y Z t]"],
        ["3-axis", "--code", "[w X b X Z t]"],
        ["3-axis", "--code", "w b t"],
        ["turntable", "--balls", "2"],
        ["head-table", "--balls", "2"],
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(arguments, refuses_command):
    refuses_command("new", *arguments)


def test_a_kind_that_is_not_there_has_no_file(refuses):
    refuses(machine_template, "../machine")
