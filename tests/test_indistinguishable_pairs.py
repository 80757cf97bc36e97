"""Pairs of effects that together do the same as one that was found: listed, and named where they are likelier."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnosis_checks import diagnosis_of
from hidden_effects import hidden
from machine_simulator import Simulated, arcsec
from real_machines import real

import rodgen
from rodgen.calibration.diagnose import diagnose
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Joint, Machine, Measured, Target


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


# Forms against effects: what the catalogue does as well is never said to lie outside of it


DROOP = {("tube_flexure", None), ("gravity_windup", "EL")}
"""In an alt-azimuth mount they have one formula."""


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("bench", "seed", "effects", "raises", "outliers", "named"),
    [
        pytest.param(
            "mount", 1, [("refraction", None), ("gravity_windup", "EL")], 2, 0.0, [{("refraction", None)}, DROOP],
            id="refraction and windup against a cubic of the elevation",
        ),
        pytest.param(
            "mount", 1, [("gravity_windup", "EL")], 2, 0.27, [DROOP],
            id="windup and misidentified stars",
        ),
        pytest.param(
            "rotary_table", 1, [("radial_error_motion", "C")], 1.5, 0.0, [{("radial_error_motion", "C")}],
            id="radial error motion",
        ),
        pytest.param(
            "robot", 2, [("gravity_windup", "J3")], 1.5, 0.0, [{("gravity_windup", "J3")}],
            id="gravity at an inner joint", marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
def test_a_form_gives_way_to_effects_that_explain_as_much(
    tmp_path, bench, seed, effects, raises, outliers, named
):
    found = diagnosis_of(hidden(bench, seed, effects, raises=raises, outliers=outliers), tmp_path)
    assert found.unexplained == ()
    assert len(found.steps) == len(named)
    assert all(any(step.effect.identity in names for step in found.steps) for names in named)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("bench", "outside"), [("rotary_table", "fifth_harmonic"), ("mount", "azimuth_wave")]
)
def test_a_form_stays_where_no_effects_explain_as_much(tmp_path, bench, outside):
    found = diagnosis_of(hidden(bench, 3, outside=outside, raises=1.5), tmp_path)
    assert found.verdict == "unknown_effect"
    assert found.steps == ()


# Flexures, couplings and instruments: small hidden errors of machines that have them, named by the diagnosis


LATITUDE = np.radians(32.0)


def machine(joints, targets, kind, frame, estimate, gravity=(0.0, 0.0, -1.0), noise=None):
    return Machine(
        "A machine", "mm", "deg", gravity, 20.0,
        tuple(Joint(*joint) for joint in joints), tuple(Target(f"p{i}", point) for i, point in enumerate(targets)),
        Measured(kind, frame, noise=noise), tuple(estimate),
    )  # fmt: skip


EQUATORIAL = machine(
    [("HA", "revolute", (0, 0, -1), (0, 0, 0)), ("DEC", "revolute", (0, -1, 0), (0, 0, 0))],
    [(1, 0, 0)], "direction", "machine", ["HA.axis", "DEC.axis", "target"],
    (-float(np.cos(LATITUDE)), 0.0, -float(np.sin(LATITUDE))), noise=np.radians(arcsec(1.0)),
)  # fmt: skip
WRIST = machine(
    [("J1", "revolute", (0, 0, 1), (0, 0, 0)), ("J2", "revolute", (0, 1, 0), (0, 0, 300)),
     ("J3", "revolute", (1, 0, 0), (400, 0, 300))],
    [(520, 60, 330), (500, -80, 290)], "point", "free", ["J2.axis", "J2.point", "J3.axis", "J3.point", "target"],
    noise=0.01,
)  # fmt: skip


def measured(of: Machine, effects: dict[str, float], rows: int, seed: int) -> Measurements:
    """Return readings in poses without an order, with the noise that the machine states."""
    random = np.random.default_rng(seed)
    file = {
        "units": {"length": "mm", "angle": "deg"},
        "environment": {"gravity": list(of.gravity)},
        "joint": [
            {"name": j.name, "type": j.type, "axis": list(j.axis), "point": list(j.point)} for j in of.joints
        ],
        "target": [{"name": t.name, "point": list(t.point)} for t in of.targets],
        "measured": {"kind": of.measured.kind, "frame": of.measured.frame},
    }
    simulated = Simulated(file, effects)
    q = random.uniform(-70, 70, (rows, len(of.joints)))
    if not of.measurand.moving:
        q[:, 1] = random.uniform(-20, 75, rows)
    names = [t.name for t in of.targets]
    target = [names[i % len(names)] for i in range(rows)]
    sigma = of.measured.noise if of.measurand.moving else np.degrees(of.measured.noise)
    y = simulated.with_noise(simulated.measure(q, target=target), sigma, random)
    table = {f"{j.name} [deg]": q[:, i] for i, j in enumerate(of.joints)} | {"target": target}
    table |= (
        {name: y[:, i] for i, name in enumerate(of.measurand.columns)}
        if not of.measurand.moving
        else {f"{name} [mm]": y[:, i] for i, name in enumerate("xyz")}
    )
    return Measurements.from_frame(table)


FRAME = {
    "frame.x": 900.0,
    "frame.y": -400.0,
    "frame.z": 120.0,
    "frame.rx": 20.0,
    "frame.ry": -35.0,
    "frame.rz": 70.0,
}


@pytest.mark.thorough("title1-DEC.axis_flexure.a-same1")
@pytest.mark.parametrize(
    ("title", "key", "same"),
    [
        (("tube_flexure", None), "tube_flexure.a", set()),
        # cos h of the hour angle is what weight does there, and tan of the declination NP
        (("axis_flexure", "DEC"), "DEC.axis_flexure.a", {("gravity_windup", "HA")}),
        (("fork_flexure", "DEC"), "DEC.fork_flexure.a", set()),
    ],
)
def test_each_flexure_of_an_equatorial_mount_is_named(title, key, same):
    found = diagnose(EQUATORIAL, measured(EQUATORIAL, {key: arcsec(12)}, 70, 5))
    assert [(step.effect.name, step.effect.place) for step in found.steps] == [title]
    aliases = {(alias.effect.name, alias.effect.place) for alias in found.steps[0].indistinguishable_from}
    assert same <= aliases
    assert not {"tube_flexure", "axis_flexure", "fork_flexure"} & {name for name, _ in aliases}
    estimate = found.final.estimates[key]
    assert abs(estimate.value - 12) < 3.5 * estimate.std < 6


def test_a_coupling_of_a_wrist_is_named():
    found = diagnose(WRIST, measured(WRIST, FRAME | {"J3.coupling.k": 8e-4}, 120, 6))
    assert [(step.effect.name, step.effect.place) for step in found.steps] == [("coupling", "J3")]
    estimate = found.final.estimates["J3.coupling.k"]
    assert abs(estimate.value - 8e-4) < 3.5 * estimate.std < 2e-4


@pytest.mark.thorough
def test_the_scale_of_one_axis_of_an_instrument_is_named():
    data = measured(WRIST, FRAME | {"instrument_axis_scales.y": 2e-4}, 120, 7)
    found = diagnose(WRIST, data)
    assert [(step.effect.name, step.effect.place) for step in found.steps] == [
        ("instrument_axis_scales", None)
    ]
    assert found.rms.after < 0.7 * found.rms.before
    estimate = found.final.estimates["instrument_axis_scales.y"]
    assert abs(estimate.value - 2e-4) < 3.5 * estimate.std < 1e-4


def test_a_wrist_and_a_mount_without_errors_have_none():
    for of, effects in ((EQUATORIAL, {}), (WRIST, FRAME)):
        assert diagnose(of, measured(of, effects, 100, 8)).steps == ()
