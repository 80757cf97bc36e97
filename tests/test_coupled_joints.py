"""Joints whose coordinates follow from readings, against the plain simulator, which gets coordinates by NumPy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emitted_code import COMPILERS, REACHED, Compiled, loaded, passes_in_octave
from machine_cases import ROWS, Case, data_for, effect, frame, joint, machine_file, possible
from test_emit import emitted
from test_machine_jacobians import same_numbers

from rodgen.calibration.check import check
from rodgen.calibration.plan import plan_for
from rodgen.calibration.simulate import simulate
from rodgen.data.measurements import Measurements
from rodgen.machines.emit._geometry import geometry_of
from rodgen.machines.files.read import machine_of
from rodgen.machines.machine import Machine
from rodgen.machines.mechanism import to_mechanism

pytestmark = pytest.mark.xdist_group("coupled")
EXAMPLE = Path(__file__).parents[1] / "examples" / "machines" / "palletiser"
TARGETS = [(120, 30, 40), (-20, 90, 10)]

CHAIN = [
    joint("B", "revolute", [0.3, 0.9, -0.2], [20, -30, 10]),
    joint("A", "revolute", [0.8, 0.1, 0.59], [100, 50, -20]),
    joint("Z", "prismatic", [0.1, -0.2, 0.97], [5, 6, 7], travel=[-100.0, 300.0]),
    joint("C", "revolute", [-0.1, 0.2, -0.97], [-30, 10, 15]),
    joint("D", "revolute", [0.7, -0.3, 0.4], [40, 20, -35]),
]
RULES = {
    "A": {"reading": "Am", "coordinate": "Am - 0.5*B + 10 deg"},
    "Z": {"reading": "Zm", "coordinate": "Zm + 25 mm/rad * (C - A)"},  # C: a spline screw
    "C": {"coordinate": "-(A + B)/2"},  # rods
}


def coordinates(m: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the coordinates that belong to readings."""
    a = m["Am"] - 0.5 * m["B"] + np.radians(10)
    c = -(a + m["B"]) / 2
    return {"B": m["B"], "A": a, "Z": m["Zm"] + 25 * (c - a), "C": c, "D": m["D"]}


def machines(
    kind: str, effects: list[dict[str, Any]], **more: Any
) -> tuple[Case, Case, dict[str, np.ndarray]]:
    """Return the coupled machine, the plain one whose columns are the coordinates, and the readings."""
    plain = machine_file(CHAIN, TARGETS, kind=kind, effects=effects, **more)
    coupled = plain | {"joint": [j | RULES.get(j["name"], {}) for j in CHAIN]}
    data = data_for(plain, ROWS, np.random.default_rng(4))
    m = {"B": data["B [rad]"], "Am": data["A [rad]"] / 2, "Zm": data["Z [mm]"], "D": data["D [rad]"]}
    q = coordinates(m)
    rest = {
        name: x for name, x in data.items() if name.split(" ")[0] not in {*q} and name[:2] not in {"di", "v_"}
    }
    units = {"Zm": "mm", "Z": "mm"}
    read = {f"{name} [{units.get(name, 'rad')}]": x for name, x in m.items()}
    read |= {
        f"T_{new}{unit}": data[f"T_{old}{unit}"]
        for new, old, unit in [("Am", "A", " [degC]"), ("Zm", "Z", " [degC]")]
    }
    moved = {f"{name} [{units.get(name, 'rad')}]": x for name, x in q.items()}
    return Case(coupled, rest | read), Case(plain, rest | moved), m


OF_READING = {
    "zero_offset", "scale", "encoder_eccentricity", "encoder_ellipticity", "encoder_harmonics",
    "periodic_drive_error", "backlash", "backlash_gradient", "servo_lag", "acceleration_lag", "gravity_windup",
    "coupling", "load_windup", "fork_flexure", "thermal_offset", "thermal_expansion", "bearing_waves",
}  # fmt: skip


@pytest.fixture(autouse=True)
def on_numpy(monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")


# kernels -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["point", "direction"])
def test_effects_of_joints_act_at_coordinates_and_their_columns_are_derivatives(kind):
    """Every effect but those of readings, at joints with and without one; the simulator knows coordinates alone."""
    more: dict[str, Any] = {"estimate": ["B.axis", "D.axis"], "frame": "free", "gravity": (0.6, 0, -0.8)}
    bare = machine_file(CHAIN, TARGETS, kind=kind, **more)
    effects = [block for block in possible(bare, places=["A", "Z", "C"]) if block["name"] not in OF_READING]
    case, plain, _ = machines(kind, effects, **more)
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    values = case.sizeable(keys, 30.0) | frame(kind)
    found = case.predicted(values)
    assert np.abs(found - plain.simulated(values)).max() < (1e-12 if kind == "direction" else 1e-9)
    assert np.abs(found - case.predicted(frame(kind))).max() > 1e-3
    if kind == "point":
        columns_are_differences(case, values, keys[::4])


def columns_are_differences(case: Case, values: dict[str, float], keys: list[str]) -> None:
    """Hold columns of the Jacobian against differences of what the kernel for values alone gives."""
    theta, at = case.theta(values), case.frame(values)
    _, normal, _ = case.problem.normal_equations(theta, at)
    for key in keys:
        i, step = case.model.keys[key], np.zeros(len(theta))
        step[i] = 1e-4 * (abs(values[key]) or 1.0)
        low, high = (case.problem.residuals(theta + side * step, at, weighted=True) for side in (-1, 1))
        slope = (high - low) / (2 * step[i])
        assert np.vdot(slope, slope) == pytest.approx(normal[i, i], rel=1e-6), key


def test_effects_of_a_reading_act_in_every_coordinate_that_follows_it():
    blocks = [effect(name, "A") for name in ("encoder_eccentricity", "coupling", "backlash")]
    case, plain, m = machines("point", [*blocks, effect("scale", "Z"), effect("zero_offset", "C")])
    values = {
        "A.encoder_eccentricity.a": 0.01, "A.encoder_eccentricity.b": -0.02, "A.coupling.k": 0.03, "A.backlash.b": 0.02,
        "Z.scale.k": 1e-3, "C.zero_offset.a": 0.03,
    }  # fmt: skip
    angle = m["Am"]  # by its own angle: the encoder is on the motor
    wrong = angle + 0.01 * np.cos(angle) - 0.02 * np.sin(angle) + 0.03 * m["B"]
    wrong = wrong - 0.01 * case.observations.s[:, case.machine.number_of("A")]
    q = coordinates(m | {"Am": wrong, "Zm": m["Zm"] * 1.001})
    q["C"] = q["C"] + 0.03  # the rods are off, which the slide does not feel
    assert np.abs(case.predicted(values) - bare_places(plain, q)).max() < 1e-9
    columns_are_differences(case, values, list(values))


def bare_places(plain: Case, q: dict[str, np.ndarray]) -> np.ndarray:
    """Return where the simulator of the plain chain without errors is at coordinates."""
    data = {name: q.get(name.split(" ")[0], x) for name, x in plain.data.items()}
    return Case(plain.file | {"effect": []}, data).simulated()


def test_a_drive_bears_the_moment_that_does_the_work_of_its_reading():
    """The sum of both targets' heights by the reading of A, which turns A and C and moves Z, by differences."""
    case, plain, m = machines("point", [effect("gravity_windup", "A")], gravity=(0.6, 0, -0.8))
    compliance, step = 2e-6, 1e-5

    def energy(angle: np.ndarray) -> np.ndarray:
        found = []
        for target in "pr":
            seen = Case(plain.file, plain.data | {"target": np.array([target] * ROWS)})
            found.append(bare_places(seen, coordinates(m | {"Am": angle})) @ [0.6, 0, -0.8])
        return np.mean(found, axis=0)

    moment = (energy(m["Am"] + step) - energy(m["Am"] - step)) / (2 * step)
    assert np.abs(moment).max() > 30
    expected = bare_places(plain, coordinates(m | {"Am": m["Am"] + compliance * moment}))
    assert np.abs(case.predicted({"A.gravity_windup.k": compliance}) - expected).max() < 1e-7


def test_windup_behind_a_gear_that_reverses_gives_way_downwards():
    """A joint follows its motor alone: a compliant drive lets it sink, whichever way the gear turns."""
    arm = joint("A", "revolute", [0, 1, 0])
    more: dict[str, Any] = {"effects": [effect("gravity_windup", "A")], "targets": [(500, 0, 0)]}
    seen = {f"{x} [mm]": np.zeros(2) for x in "xyz"}
    plain = Case(machine_file([arm], **more), seen | {"A [rad]": np.array([0.0, 0.3])})
    sunk = plain.predicted({"A.gravity_windup.k": 1e-6})[:, 2] - plain.predicted()[:, 2]
    assert sunk.max() < -0.1
    rule = {"reading": "Am", "coordinate": "-0.5*Am"}
    geared = Case(machine_file([arm | rule], **more), seen | {"Am [rad]": np.array([0.0, -0.6])})
    found = geared.predicted({"A.gravity_windup.k": 1e-6})[:, 2] - geared.predicted()[:, 2]
    assert found == pytest.approx(sunk / 4, rel=1e-3)  # half the moment, half the turn


@pytest.mark.parametrize("where", ["k_D", "k_C"])
def test_a_weight_at_a_later_joint_bears_on_a_drive_by_the_work_that_it_does(where):
    case, _, m = machines("point", [effect("gravity_windup", "A")])
    compliance, step = 2e-6, 1e-5
    name = where.removeprefix("k_")
    place = next(j["point"] for j in CHAIN if j["name"] == name)
    before = CHAIN[: [j["name"] for j in CHAIN].index(name)]
    carrier = machine_file(before, [place])  # the weight as the target of the joints that carry it

    def height(angle: np.ndarray) -> np.ndarray:
        q = coordinates(m | {"Am": angle})
        data = data_for(carrier, ROWS, np.random.default_rng(1))
        data |= {column: q[column.split(" ")[0]] for column in data if column.split(" ")[0] in q}
        return Case(carrier, data).simulated() @ [0, 0, -1.0]

    moment = (height(m["Am"] + step) - height(m["Am"] - step)) / (2 * step)
    found = case.predicted({f"A.gravity_windup.{where}": compliance})
    moved = machines("point", [])[1]
    expected = bare_places(moved, coordinates(m | {"Am": m["Am"] + compliance * moment}))
    assert np.abs(moment).max() > 10
    assert np.abs(found - expected).max() < 1e-7


def test_c_and_numpy_give_the_same_numbers_to_rounding(compiler, monkeypatch):
    monkeypatch.delenv("RODGEN_CPU")
    blocks = [effect("encoder_eccentricity", "A"), effect("load_windup", "A")]
    same_numbers(machines("point", blocks, frame="free")[0], monkeypatch)


@pytest.mark.parametrize(("reading", "rule"), [("Am", None), ("Am", "Am"), ("Am", "2*Am - Am + 0 deg")])
def test_a_coordinate_that_is_the_reading_changes_no_bit(reading, rule):
    effects = [effect("encoder_eccentricity", "A"), effect("gravity_windup", "B"), effect("backlash", "A")]
    file = machine_file(CHAIN, TARGETS, effects=effects, frame="free", estimate=["A.axis", "target"])
    plain = Case(file, data_for(file, ROWS, np.random.default_rng(1)))
    more = {"reading": reading} | ({} if rule is None else {"coordinate": rule})
    renamed = {f"{name} ".replace("A ", f"{reading} ", 1).strip(): x for name, x in plain.data.items()}
    named = Case(file | {"joint": [j | (more if j["name"] == "A" else {}) for j in CHAIN]}, renamed)
    assert named.machine.structure == plain.machine.structure
    assert named.observations.q.tobytes() == plain.observations.q.tobytes()
    assert named.observations.s.tobytes() == plain.observations.s.tobytes()
    values = plain.sizeable(key for key in plain.model.keys if not key.startswith("frame"))
    assert named.predicted(values).tobytes() == plain.predicted(values).tobytes()


# what is done with them ----------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_play_behind_a_motor_is_found_where_it_is_though_two_joints_move():
    machine, data = Machine.load(EXAMPLE / "machine.toml"), Measurements.load(EXAMPLE / "data.csv")
    found = machine.fit(data).diagnose()
    assert [step.effect.title for step in found.steps] == ["backlash at J2"]
    (estimate,) = found.steps[0].parameters.values()
    assert abs(estimate.value - 0.024 * 3600) < 3 * estimate.std
    assert estimate.std < 2


def test_plan_keeps_motors_and_joints_within_their_travels_and_names_columns_of_motors(tmp_path):
    machine = Machine.load(EXAMPLE / "machine.toml")
    text = (EXAMPLE / "data.csv").read_text().splitlines()
    (tmp_path / "few.csv").write_text("\n".join(text[:40]) + "\n")
    found = plan_for(machine.fit(Measurements.load(tmp_path / "few.csv")), n=8, wanted=["J3.gravity_windup"])
    columns = {name: np.array(x) for name, x in found.rows.items()}
    assert [*columns] == ["J1 [deg]", "J2m [deg]", "J3m [deg]", "J5 [deg]", "target"]
    j3 = columns["J3m [deg]"] - columns["J2m [deg]"]
    assert j3.min() >= -120
    assert j3.max() <= 60
    assert columns["J3m [deg]"].max() > 60  # which J3 itself could not
    assert columns["J2m [deg]"].min() >= -50


@pytest.mark.thorough
@pytest.mark.parametrize("compiler", COMPILERS[:1])
def test_emitted_code_commands_the_motors(compiler, tmp_path):
    effects = [effect("encoder_eccentricity", "A"), effect("tilt_error_motion", "C"), effect("scale", "Z")]
    case, plain, m = machines("point", effects)
    values = case.sizeable(case.model.keys)
    device = emitted(case, tmp_path, values)
    module, compiled, o = loaded(tmp_path), Compiled(compiler, tmp_path), case.observations
    passes_in_octave(device.content, tmp_path)
    assert "not used, as it follows: revolute joint 'C'" in (tmp_path / "device.h").read_text()
    wanted = bare_places(plain, coordinates(m))
    assert np.abs(module.ideal(o.q, target=o.target) - wanted).max() < 1e-9
    commands, status, left = compiled.compensate(wanted, o.q, o.target, device.conditions())
    again, *_ = module.compensate(wanted, o.q, o.target, **device.conditions())
    assert (status == module.CONVERGED).all()
    assert np.abs(commands - again).max() < 1e-9
    assert left.max() < REACHED
    read = {"B [rad]": 0, "Am [rad]": 1, "Zm [mm]": 2, "D [rad]": 4}
    reached = Case(case.file, case.data | {name: commands[:, j] for name, j in read.items()}).predicted(
        values
    )
    assert np.abs(case.predicted(values) - wanted).max() > 0.01
    assert np.abs(reached - wanted).max() < REACHED


def test_geometry_moves_by_coordinates_and_zeros_of_motors_are_in_all_joints_that_follow(refuses, tmp_path):
    machine = replace(Machine.load(EXAMPLE / "machine.toml"), estimate=())
    values = {"J2": 0.3, "J3": -0.2, "J4": 0.5}  # degrees
    for name, value in values.items():
        machine = machine.add("zero_offset", joint=name, hold={"a": value})
    geometry = geometry_of(machine).machine
    assert not geometry.effects
    m = np.radians([[20.0, 30.0, -25.0, 0.0, 40.0], [-50.0, -10.0, 15.0, 0.0, 10.0]])
    design = {
        "J1 [rad]": m[:, 0],
        "J2m [rad]": m[:, 1],
        "J3m [rad]": m[:, 2],
        "J5 [rad]": m[:, 4],
        "target": ["reflector_1"] * 2,
    }
    columns = simulate(machine, design, noise=0.0, seed=1).columns
    places = np.transpose([columns[f"{x} [mm]"] for x in "xyz"])
    chain = replace(
        geometry, joints=tuple(replace(j, coordinate=None, reading=None) for j in geometry.joints)
    )
    q = np.stack([m[:, 0], m[:, 1], m[:, 2] - m[:, 1], -m[:, 2], m[:, 4]], axis=-1)
    poses = to_mechanism(chain).forward(q)
    assert np.abs((poses @ [*geometry.targets[0].point, 1.0])[:, :3] - places).max() < 1e-8
    with_play = machine.add("backlash", joint="J3", hold={"b": 0.02}).add(
        "scale", joint="J5", hold={"k": 1e-4}
    )
    with_play.emit("iso230", tmp_path, name="arm")
    assert "backlash at J3: it follows J3m, not the position of J3" in "".join(
        path.read_text() for path in tmp_path.glob("*.md")
    )
    (path,) = machine.emit("urdf", tmp_path, name="arm")
    assert (
        "not in it: how J3 follows, J3m - J2m: what is given here moves by its coordinate" in path.read_text()
    )
    refuses(machine.emit, "linuxcnc", tmp_path, name="arm")


@pytest.mark.slow
def test_motors_of_a_parallelogram_in_a_file_that_knows_none_are_found(tmp_path):
    text = (EXAMPLE / "machine.toml").read_text()
    for old in ('reading = "J2m"', 'reading = "J3m"', 'coordinate = "J3m - J2m"', "travel = [-120, 60]"):
        text = text.replace(f"{old}\n", "")
    (tmp_path / "machine.toml").write_text(text.replace("-(J2 + J3)", "-J2 - J3"))
    header, _, rows = (EXAMPLE / "data.csv").read_text().partition("\n")
    (tmp_path / "data.csv").write_text(header.replace("J2m", "J2").replace("J3m", "J3") + "\n" + rows)
    found = check(Machine.load(tmp_path / "machine.toml"), Measurements.load(tmp_path / "data.csv"))
    assert found.wrong
    words = 'J3 moves with J2, too: reading = "J3", coordinate = "J3 - J2"'
    assert words in " ".join(found.summary().split())


def test_a_coupled_joint_may_have_the_name_of_its_column():
    text = (EXAMPLE / "machine.toml").read_text().replace('"J2m"', '"J2"').replace('"J3m"', '"J3"')
    own = machine_of(text.replace('"J3m - J2m"', '"J3 - J2"'), "machine.toml")
    other = Machine.load(EXAMPLE / "machine.toml")
    assert own.structure == other.structure
    data = Measurements.load(EXAMPLE / "data.csv")
    renamed = {column.text.replace("m [", " ["): column.values for column in data.columns.values()}
    a, b = own.fit(renamed), other.fit(data)
    assert a.rms == b.rms
    assert "J3" not in a.observations.covariates


def test_what_is_made_up_comes_back_with_the_effect():
    machine = Machine.load(EXAMPLE / "machine.toml")
    design = Measurements.load(EXAMPLE / "data.csv")
    made = simulate(machine, design, ["zero_offset@J4:a=0.2deg"], noise=0.0, seed=1)
    assert {*made.columns} == {"x [mm]", "y [mm]", "z [mm]"}
    plain = simulate(machine, design, [], noise=0.0, seed=1)
    moved = max(np.abs(made.columns[x] - plain.columns[x]).max() for x in made.columns)
    assert 1.0 < moved < 2.0  # 0.2 degrees at the arm from J4 to the reflectors


# files ---------------------------------------------------------------------------------------------------------


def test_file_reads_back_equal_and_says_the_coupling(tmp_path):
    machine = Machine.load(EXAMPLE / "machine.toml")
    machine.save(tmp_path / "again.toml")
    assert Machine.load(tmp_path / "again.toml") == machine
    text = machine.describe()
    assert "coordinate J3m - J2m, read as J3m" in text
    assert machine.joint("J4").column == "J4"
    assert not machine.joint("J4").is_read
    low, high = (x / np.pi * 180 for x in machine.limits[2])
    assert (low, high) == pytest.approx((-170, 145))


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ("J3m - J2m", "J3m - J2M"),
        ("J3m - J2m", "J3m * J2m"),
        ("J3m - J2m", "sin(J3m)"),
        ("J3m - J2m", "J3m + 90"),
        ("J3m - J2m", "J3m + 90 mm"),
        ("J3m - J2m", "J3m - 2 J2m"),
        ("J3m - J2m", "J3m - 1e20*J2m"),
        ("J3m - J2m", "J2m"),
        ("J3m - J2m", "J3m - J4"),
        ('reading = "J3m"', 'reading = "J3"'),
        ('reading = "J3m"', 'reading = "J2m"'),
        ('reading = "J3m"', 'reading = "J5"'),
        ('reading = "J3m"', 'reading = "x"'),
        ('"-(J2 + J3)"', '"12 deg"'),
        ('"-(J2 + J3)"', '"-(J2 + J3)"\nreading_travel = [0, 1]'),
        ("[estimate]", '[[effect]]\nname = "encoder_eccentricity"\njoint = "J4"\n[estimate]'),
    ],
)  # fmt: skip
def test_what_is_no_coupling_is_one_sentence(refuses, tmp_path, old, new):
    text = (EXAMPLE / "machine.toml").read_text()
    assert old in text
    (tmp_path / "machine.toml").write_text(text.replace(old, new, 1))
    refuses(Machine.load, tmp_path / "machine.toml")


def test_a_missing_column_of_a_motor_is_said_by_its_name(refuses):
    machine, data = Machine.load(EXAMPLE / "machine.toml"), Measurements.load(EXAMPLE / "data.csv")
    columns = {c.text.replace("J3m", "J3"): c.values for c in data.columns.values()}
    refuses(machine.fit, columns)
