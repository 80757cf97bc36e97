"""Pairs of effects that together do the same as one that was found: listed, and named where they are likelier."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from real_machines import real

import rodgen
from rodgen.calibration.diagnose import diagnose


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    def of(kind, number, **options):
        machine, data = real(kind, number).write(tmp_path_factory.mktemp("machine"))
        return diagnose(rodgen.Machine.load(machine), rodgen.Measurements.load(data), **options)

    return of


def titles(found):
    return [step.effect.title for step in found.steps]


@pytest.mark.thorough
def test_two_usual_effects_of_a_telescope_are_named_for_a_rare_one_that_does_the_same(diagnosed):
    found = diagnosed("altaz", 27)  # it has refraction and lateral_windup at AZ
    assert titles(found) == ["tube_flexure (TF)", "refraction (TX)"]
    rare = {e.title: alias.odds for alias in found.steps[0].indistinguishable_from for e in alias.effects}
    assert 0.001 < rare["lateral_windup at AZ"] < 0.1  # the readings do not distinguish it
    preferred = diagnosed("altaz", 27, prefer=[("lateral_windup", "AZ")])
    assert titles(preferred) == ["lateral_windup at AZ", "refraction (TX)"]
    assert "tube_flexure (TF)" in {a.effect.title for a in preferred.steps[0].indistinguishable_from}
    both = {e.title: one.odds for one in found.indistinguishable_sets for e in one.effects}
    assert 0.01 < both["scale at EL"] < 1
    assert max(both.values()) == both["scale at EL"]


@pytest.mark.slow
def test_two_parameters_of_a_leg_are_named_for_three_that_do_the_same(diagnosed):
    found = diagnosed("3-sps-s", 22)
    assert titles(found) == ["platform_joint_offset at L2", "leg_zero_offset at L1", "leg_scale at L1"]
    legs = [
        a for s in found.steps for a in s.indistinguishable_from if a.effect.name == "platform_joint_offset"
    ]
    assert legs
    sets = found.indistinguishable_sets
    assert {e.title for s in sets for e in s.named} == {"leg_zero_offset at L1", "leg_scale at L1"}
    assert [e.name for s in sets for e in s.effects] == ["platform_joint_offset"]
    said = "Instead of leg_zero_offset at L1 and leg_scale at L1, platform_joint_offset at L"
    assert said in " ".join(found.summary().split())
    assert found.to_dict()["indistinguishable_sets"][0]["effects"][0]["effect"] == "platform_joint_offset"


@pytest.mark.thorough
def test_two_equal_offsets_of_legs_are_found_though_neither_explains_much_alone(diagnosed):
    found = diagnosed("3-sps-s", 39)  # it has offsets of L1 and L2; one of L3 is the best single effect
    named = [
        {step.effect.title, *(a.effect.title for a in step.indistinguishable_from)} for step in found.steps
    ]
    assert len(named) == 2
    for leg in ("L1", "L2"):
        assert any(f"leg_zero_offset at {leg}" in each for each in named)
    assert not any("L3" in title for each in named for title in each)


@pytest.mark.thorough
def test_one_effect_is_not_named_as_two_that_fit_a_little_better(diagnosed):
    found = diagnosed("fork", 40)  # it has gravity_windup at A, squareness at Y and backlash at A
    assert {*titles(found)} == {"encoder_eccentricity at A", "squareness at Y", "backlash at A"}
    assert "gravity_windup at A" in {a.effect.title for a in found.steps[0].indistinguishable_from}


@pytest.mark.slow
def test_an_effect_that_hardly_shows_beside_another_is_listed_in_the_place_of_it(diagnosed):
    found = diagnosed("fork", 5)  # it has squareness at X; at Z, too, which hardly shows
    (square,) = [step for step in found.steps if step.effect.name == "squareness"]
    assert "squareness at X" in {a.effect.title for a in square.indistinguishable_from}


@pytest.mark.slow
def test_lengths_of_two_legs_and_a_scale_are_named_for_a_joint_that_imitates_them(diagnosed):
    found = diagnosed("tricept", 25)  # it has leg_zero_offset at A0, A1 and, seen through these, A-1
    assert {"leg_zero_offset at A0", "leg_zero_offset at A1", "leg_scale at A0"} < set(titles(found))
    assert not any(step.effect.name == "platform_joint_offset" for step in found.steps)


ARM = """name = "Arm"
units = { length = "mm", angle = "deg" }
joint = [
  { name = "J1", type = "revolute", axis = [0, 0, 1], point = [0, 0, 0] },
  { name = "J2", type = "revolute", axis = [0, 1, 0], point = [0, 0, 400] },
  { name = "J3", type = "revolute", axis = [0, 1, 0], point = [0, 0, 1000] },
]
target = [{ name = "tool", point = [0, 0, 1500] }]
measured = { kind = "point", frame = "free" }
estimate = { parameters = ["target"] }
"""


def weighed_arm(folder: Path, bend: float) -> tuple[rodgen.Machine, rodgen.Measurements]:
    """Write 60 poses of two links on soft drives, which bend at the elbow by up to so many degrees; noise 0.01 mm.

    Links of 150 and 120 N yield at the shoulder by 2e-9 and at the elbow by 4e-9 rad/(N mm).
    """
    random = np.random.default_rng(1)
    turns = np.radians([random.uniform(-w, w, 60) for w in (150, 80, bend)])
    a, b, c = turns
    elbow = 120 * 250 * np.sin(b + c)
    shoulder = 150 * 300 * np.sin(b) + 120 * 600 * np.sin(b) + elbow
    upper = b + 2e-9 * shoulder
    lower = upper + c + 4e-9 * elbow
    out, up = 600 * np.sin(upper) + 500 * np.sin(lower), 400 + 600 * np.cos(upper) + 500 * np.cos(lower)
    seen = np.array([out * np.cos(a), out * np.sin(a), up]) + random.normal(0, 0.01, (3, 60))
    header = "J1 [deg],J2 [deg],J3 [deg],x [mm],y [mm],z [mm]"
    np.savetxt(folder / "data.csv", np.r_[np.degrees(turns), seen].T, "%.6f", ",", header=header, comments="")
    (folder / "machine.toml").write_text(ARM)
    return rodgen.Machine.load(folder / "machine.toml"), rodgen.Measurements.load(folder / "data.csv")


@pytest.mark.thorough
def test_two_parallel_joints_share_a_windup_that_a_nearly_straight_arm_does_not_divide(tmp_path):
    found = diagnose(*weighed_arm(tmp_path, 20))
    (step,) = found.steps
    assert step.effect.title == "gravity_windup at J2"
    assert [e.place for e in step.shared_by] == ["J2", "J3"]
    assert found.to_dict()["steps"][0]["shared_by"] == ["J2", "J3"]
    text = " ".join(found.summary().split())
    assert "gravity_windup at J2 (perhaps shared with J3); the error" in text
    assert text.count("Odds of J2 alone to J2 and J3: ") == 1
    assert "Or gravity_windup" not in text
    # the plan asks for what both joints yield by: an arm that is bent at the elbow tells that
    assert {"J2.gravity_windup.k", "J3.gravity_windup.k"} <= {
        key for goal in found.plan(6).goals for key in goal.to_dict()["parameters"]
    }


@pytest.mark.thorough
def test_two_parallel_joints_of_a_bent_arm_have_each_its_own_windup(tmp_path):
    found = diagnose(*weighed_arm(tmp_path, 60))
    assert titles(found) == ["gravity_windup at J2", "gravity_windup at J3"]
    assert not any(step.shares for step in found.steps)
