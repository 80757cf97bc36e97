"""The check on files as people have them: what is wrong is named as one would say it, and no right file is accused.

The data are made by a few lines of arithmetic each, without the model. Those of `answers/field` have a folder each.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rodgen.calibration.check import Check, _Search, check
from rodgen.calibration.problem.binding import bind
from rodgen.calibration.repairs import repairs
from rodgen.cli.main import main
from rodgen.data.measurements import Measurements
from rodgen.machines.coupling import CouplingError
from rodgen.machines.imports.denavit_hartenberg import machine_from_table
from rodgen.machines.machine import Machine
from rodgen.machines.observations import Observations

FIELD = Path(__file__).parents[1] / "answers" / "field"


def checked(folder: str, data: str = "data.csv") -> Check:
    return check(Machine.load(FIELD / folder / "machine.toml"), Measurements.load(FIELD / folder / data))


# one axis whose angle is read by an encoder 0.1 degrees eccentric


@pytest.mark.parametrize("data", ["good_full_turn", "good_100_degrees", "one_wrong_reading"])
def test_the_angle_of_one_axis_is_right(data: str, capsys: pytest.CaptureFixture[str]) -> None:
    found = checked("angle_of_one_axis", f"{data}.csv")
    assert not found.wrong
    assert found.before is not None
    assert found.before < 360  # the eccentricity, arcsec
    if data == "one_wrong_reading":
        folder = FIELD / "angle_of_one_axis"
        assert main(["check", str(folder / "machine.toml"), str(folder / f"{data}.csv")]) == 0
        assert "Line 35 of one_wrong_reading.csv is off by" in capsys.readouterr().err


def full_turn_of_the_other_sense(folder: Path) -> Measurements:
    random, q = np.random.default_rng(1), 7.2 * np.arange(50)
    wave = 0.1 * np.sin(np.radians(q + 30)) + random.normal(0, 0.01, 50)
    lines = [f"{a:.2f},{b:.4f}" for a, b in zip(q, (123.4 - q + wave) % 360, strict=True)]
    (folder / "data.csv").write_text("\n".join(["M [deg],angle [deg]", *lines, ""]))
    return Measurements.load(folder / "data.csv")


@pytest.mark.parametrize("data", ["reversed_350_degrees", "reversed_100_degrees", None])
def test_an_axis_that_turns_the_other_way_is_named_by_its_angle_alone(
    data: str | None, tmp_path: Path
) -> None:
    folder = FIELD / "angle_of_one_axis"
    readings = Measurements.load(folder / f"{data}.csv") if data else full_turn_of_the_other_sense(tmp_path)
    found = check(Machine.load(folder / "machine.toml"), readings)
    assert [repair.words for repair in found.repairs] == ["M turns the other way: axis = [0, 0, -1]"]
    assert found.after is not None
    assert found.after < 360


@pytest.mark.thorough
def test_a_ratio_of_a_half_is_named_and_written(tmp_path: Path) -> None:
    folder = FIELD / "angle_of_one_axis"
    files = [str(folder / "machine.toml"), str(folder / "half_ratio_full_turn.csv")]
    assert main(["check", *files, "-o", str(tmp_path / "m.toml")]) == 1
    found = checked("angle_of_one_axis", "half_ratio_full_turn.csv")
    (repair,) = found.repairs
    assert repair.words == 'M turns by half of what its reading says: reading = "M", coordinate = "0.5*M"'
    assert found.after == pytest.approx(36, rel=0.3)  # noise of 0.01 degrees
    assert main(["check", str(tmp_path / "m.toml"), files[1]]) == 0


# what cannot be, and what is not known


@pytest.mark.thorough
def test_noise_of_a_planar_arm_is_no_wrong_file() -> None:
    found = checked("parallel_joints")
    assert not found.wrong  # 40 mm of noise, where the joints move the tool by more than a metre
    assert found.before == pytest.approx(40, rel=0.2)


def planar_arm() -> tuple[Machine, Observations]:
    folder = FIELD / "parallel_joints"
    machine = Machine.load(folder / "machine.toml")
    return machine, bind(machine, Measurements.load(folder / "data.csv"))


def test_repairs_that_exclude_each_other_are_no_candidates() -> None:
    """Joints in another order, and one coupled with the other: some of such machines cannot be built."""
    machine, o = planar_arm()
    search, every, rows = _Search(machine, o), repairs(machine, o), np.arange(o.n)
    couplings = [r for r in every if "moves with" in r.words]
    assert len(couplings) == 4
    for order in (r for r in every if r.kind == "order"):
        for coupling in couplings:
            both = order.then(coupling)
            try:
                built, _ = both.applied(machine, o, rows)
            except CouplingError:
                assert search._fit(both, 1) is None
            else:
                joint = next(j for j in built.joints if j.coordinate)
                assert joint.reading == joint.name


def test_two_repairs_change_the_joints_that_they_name() -> None:
    machine, o = planar_arm()
    every = repairs(machine, o)
    order = next(r for r in every if r.words.endswith("the order of the chain is J2, J1 and J3"))
    unit = next(r for r in every if r.words == "J1 is in rad, not in deg")
    both = order.then(unit).applied(machine, o)[1]
    assert [joint.name for joint in both.machine.joints] == ["J2", "J1", "J3"]
    np.testing.assert_allclose(both.q[:, 1], np.degrees(o.q[:, 0]))
    np.testing.assert_array_equal(both.q[:, [0, 2]], o.q[:, [1, 2]])


@pytest.mark.thorough
def test_guessed_places_of_targets_are_no_fault() -> None:
    found = checked("guessed_markers")
    assert not found.wrong
    assert found.notes == ()


# what was measured


@pytest.mark.thorough
def test_a_marker_that_was_mounted_anew_gets_a_target_in_each_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, machine, data = FIELD / "mounted_anew", tmp_path / "m.toml", tmp_path / "d.csv"
    files = [str(folder / "machine.toml"), str(folder / "data.csv")]
    assert main(["check", *files, "-o", str(machine), "--repaired-data", str(data)]) == 1
    said = capsys.readouterr().out
    assert "each run alone fits: the target sits differently in each run (turned by 20.0° and 38.0°)" in said
    assert main(["check", str(machine), str(data)]) == 0
    first, *others = (Rotation.from_rotvec(target.attitude) for target in Machine.load(machine).targets)
    turned = [np.degrees((other * first.inv()).magnitude()) for other in others]
    assert turned == pytest.approx([20, 38], abs=0.2)


def test_commands_that_were_not_recorded_are_told() -> None:
    found = checked("constant_commands")
    assert found.wrong
    assert found.sentence == (
        "This looks like a wrong file: A and B have the same command in all 12 rows, but the readings move by 187 mm: "
        "the commands were not recorded."
    )
    readings = np.loadtxt(FIELD / "constant_commands" / "data.csv", delimiter=",", skiprows=1)[:, 2:]
    assert round(float(np.std(readings, axis=0) @ np.std(readings, axis=0) / 3) ** 0.5) == 187


def test_a_drift_at_one_pose_is_no_fault(tmp_path: Path) -> None:
    t = np.arange(30.0)
    rows = [f"10,20,{x:.4f},{0.1 * x:.4f},{500 + 0.01 * x:.4f}" for x in 0.001 * t]
    (tmp_path / "data.csv").write_text("A [deg],B [deg],x [mm],y [mm],z [mm]\n" + "\n".join(rows) + "\n")
    found = check(
        Machine.load(FIELD / "constant_commands" / "machine.toml"), Measurements.load(tmp_path / "data.csv")
    )
    assert not found.wrong


# gravity


ARM = """name = "Arm"
units = {{ length = "mm", angle = "deg" }}
environment = {{ gravity = [0, 0, {gravity}] }}
joint = [
  {{ name = "A1", type = "revolute", axis = [0, 1, 0], point = [0, 0, 0] }},
  {{ name = "A2", type = "revolute", axis = [0, 1, 0], point = [600, 0, 0] }},
]
target = [{{ name = "tool", point = [1100, 0, 0] }}]
measured = {{ kind = "point", frame = "machine" }}
estimate = {{ parameters = ["target"] }}
"""


def loaded_arm(sign: float) -> str:
    """Return readings of an arm whose first drive gives way under payloads, downwards in z or upwards."""
    random, rows = np.random.default_rng(5), []
    for load in [0, 50, 100] * 20:
        a, b = math.radians(random.uniform(-60, 60)), math.radians(random.uniform(-90, 90))
        reach = 600 * math.cos(a) + 500 * math.cos(a + b)
        bent = a + sign * 2e-7 * reach * load
        x = 600 * math.cos(bent) + 500 * math.cos(bent + b)
        z = -600 * math.sin(bent) - 500 * math.sin(bent + b)
        noise = random.normal(size=3) * 0.02
        rows.append([math.degrees(a), math.degrees(b), load, x + noise[0], noise[1], z + noise[2]])
    lines = [",".join(f"{number:.5f}" for number in row) for row in rows]
    return "\n".join(["A1 [deg],A2 [deg],load [N],x [mm],y [mm],z [mm]", *lines, ""])


@pytest.mark.thorough("1--1", "1-1")
@pytest.mark.parametrize("gravity", [-1, 1])
@pytest.mark.parametrize("sign", [-1, 1])
def test_gravity_that_is_the_wrong_way_round_is_asked_for(gravity: int, sign: int, tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(ARM.format(gravity=gravity))
    (tmp_path / "d.csv").write_text(loaded_arm(sign))
    machine, data = Machine.load(tmp_path / "m.toml"), Measurements.load(tmp_path / "d.csv")
    for found in (check(machine, data), machine.fit(data).check()):
        assert not found.wrong
        if gravity == -sign:
            assert found.notes == ()
        else:
            (note,) = found.notes
            assert note.startswith("Is gravity the right way round? ")
            assert "A1.load_windup.k = -" in note
            assert note.endswith(f"gravity = [0, 0, {-gravity}].")


@pytest.mark.thorough("-1")
@pytest.mark.parametrize("gravity", [-1, 1])
def test_an_estimated_weight_that_lifts_asks_for_gravity(gravity: int, tmp_path: Path) -> None:
    """Its stiffness is in other units than the places of targets, by many powers of ten."""
    robot = FIELD.parents[1] / "examples" / "machines" / "robot_6r_tracker"
    more = f'[environment]\ngravity = [0, 0, {gravity}]\n[[effect]]\nname = "gravity_windup"\njoint = "J2"\n'
    (tmp_path / "m.toml").write_text(f"{(robot / 'machine.toml').read_text()}\n{more}")
    found = check(Machine.load(tmp_path / "m.toml"), Measurements.load(robot / "data.csv"))
    assert not found.wrong
    assert [note.split("; ")[0] for note in found.notes] == [
        "Is gravity the right way round? With that of the file weight lifts what it should lower, "
        "J2.gravity_windup.k = -0.0341"
    ] * (gravity > 0)


@pytest.mark.thorough
@pytest.mark.parametrize("gravity", [-1, 1])
def test_joints_that_never_move_leave_the_question_for_gravity(gravity: int) -> None:
    folder = FIELD / "two_windups"
    machine = replace(Machine.load(folder / "machine.toml"), gravity=(0.0, 0.0, float(gravity)))
    found = check(machine, Measurements.load(folder / "data.csv"))
    assert not found.wrong
    assert [note[:31] for note in found.notes] == ["Is gravity the right way round?"] * (gravity > 0)


@pytest.mark.thorough
def test_held_weight_against_gravity_names_gravity(tmp_path: Path) -> None:
    held = f"hold = {{ k = {math.degrees(2e-5)} }}"
    text = ARM.format(gravity=1) + f'[[effect]]\nname = "load_windup"\njoint = "A1"\n{held}\n'
    (tmp_path / "m.toml").write_text(text)
    (tmp_path / "d.csv").write_text(loaded_arm(100.0))  # by up to seven degrees
    found = check(Machine.load(tmp_path / "m.toml"), Measurements.load(tmp_path / "d.csv"))
    assert found.wrong
    assert found.repairs[0].words == "weight acts in another direction: gravity = [0, 0, -1]"
    assert found.after == pytest.approx(0.02, rel=0.5)


# tables


def test_joints_about_one_axis_tell_that_a_table_is_of_the_other_convention() -> None:
    note = "J1 and J2 turn about one and the same axis: no robot is built so; this table is most likely modified."
    table = FIELD / "coaxial_dh_table" / "other.csv"
    assert note in machine_from_table(table, "standard").notes
    assert not any("same axis" in note for note in machine_from_table(table, "modified").notes)


@pytest.mark.thorough
def test_no_promise_is_made_that_other_readings_would_do_no_better() -> None:
    """With 60 poses instead of 10 the lengths of these legs are 18 times as sharp."""
    folder = FIELD / "hexapod_geometry"
    fit = Machine.load(folder / "few_geometry.toml").fit(Measurements.load(folder / "few.csv"))
    weak = [direction.text for direction in fit.determinacy.weak]
    assert any("leg_zero_offset" in text for text in weak)
    assert not any("better" in text for text in weak)
