"""One rule for every effect that a diagnosis reports: full fits confirm it."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_checks import diagnosis_of, loaded
from hidden_effects import hidden
from real_machines import real

import rodgen
from rodgen.calibration.candidates import Candidate
from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.problem.binding import bind
from rodgen.data.poses import positions


@pytest.mark.thorough
def test_a_pair_is_judged_together(tmp_path):
    """A sagging tube all but undoes refraction: the first of them alone raised the error on poses left out."""
    case = real("altaz", 50)
    found = diagnosis_of(case, tmp_path)
    first, second = found.steps
    assert {first.effect.title, second.effect.title} == {"tube_flexure (TF)", "refraction (TX)"}
    assert second.rms_held_out < found.rms.before_held_out < first.rms_held_out
    said = f"{first.effect.title} lowers the error only together with {second.effect.title}."
    assert said in str(found)


@pytest.mark.thorough
def test_six_positions_show_the_kind_of_a_motion(tmp_path):
    """Four waves along the axis of A go through any six errors; that they all are along the axis is no chance."""
    base, readings = loaded(real("trunnion", 11), tmp_path)
    found = diagnose(base, readings)
    assert [step.effect.title for step in found.steps] == ["axial_error_motion at A"]
    assert found.steps[0].odds > 1e6


@pytest.mark.slow
def test_a_scale_of_a_robots_joint_is_not_claimed_where_its_eccentricity_may_be_there(tmp_path):
    """Few positions of J7 hide its eccentricity; its scale, next to impossible, does nearly the same."""
    found = diagnosis_of(real("7R", 8), tmp_path)
    assert found.steps == ()


@pytest.mark.slow
def test_nothing_is_outside_the_catalogue_that_an_undecided_effect_leaves_nothing_of(tmp_path):
    """Five positions of A leave open whether its axial error motion is there, which a form in A and T_C imitates.

    Nor are the readings at 30 degrees of A displaced, where all 32 of them were taken one after the other.
    """
    found = diagnosis_of(real("trunnion", 20), tmp_path)
    assert {"axial_error_motion at C", "thermal_axis_drift at C"} <= {s.effect.title for s in found.steps}
    assert found.unexplained == ()
    assert not any("lie displaced" in n for n in found.notes)


@pytest.mark.slow
def test_an_effect_that_a_walk_leaves_zero_within_its_error_is_said_but_not_named(tmp_path):
    found = diagnosis_of(real("trunnion", 19), tmp_path)
    steps = {step.effect.title: step for step in found.steps}
    assert steps.keys() == {"thermal_axis_drift at A"}
    assert steps["thermal_axis_drift at A"].odds > 1e4
    assert any(n.startswith("backlash at C is not reported") for n in found.notes)  # it is there, 3.3 arcsec


@pytest.mark.parametrize(("independent", "out"), [(True, "b"), (False, "cb")])
def test_of_effects_that_are_zero_the_least_significant_goes_first(monkeypatch, independent, out):
    """It need not be the last: a robot's effects are in physical order."""
    p_values = {"a": 0.0, "b": 0.9, "c": 0.5}
    module = sys.modules[diagnose.__module__]
    monkeypatch.setattr(module, "EffectEstimates", lambda _: SimpleNamespace(significance=p_values.get))
    chosen = [Candidate(name, (), np.zeros((1, 1, 0)), {}) for name in p_values]
    final = SimpleNamespace(dependence=SimpleNamespace(independent=independent))
    assert "".join(c.effect for c in module._zero(chosen, [final])) == out


@pytest.mark.thorough
def test_the_search_goes_on_without_an_effect_that_full_fits_do_not_confirm(tmp_path, monkeypatch):
    machine, data = loaded(hidden("rotary_table", 11, [("backlash", "C")], raises=1.5), tmp_path)
    first = diagnose(machine, data)
    assert [step.effect.title for step in first.steps] == ["backlash at C"]

    module = sys.modules["rodgen.calibration.diagnose"]
    monkeypatch.setattr(module, "_zero", lambda chosen, _: [c for c in chosen if c.effect.name == "backlash"])
    found = diagnose(machine, data)
    named = {
        e.title
        for s in found.steps
        for e in (s.effect, *(x for a in s.indistinguishable_from for x in a.effects))
    }
    assert "backlash at C" not in named
    assert any(note.startswith("backlash at C is not reported: ") for note in found.notes)
    # it was seen, and is ranked as before
    assert "backlash at C" in {r.effect.title for r in found.ranking[:3] if r.odds > 1e6}


TABLE = """
name = "Table"
[units]
length = "mm"
angle = "deg"
[[joint]]
name = "C"
type = "revolute"
axis = [0, 0, 1]
point = [0, 0, 0]
[[target]]
name = "ball"
point = [200, 0, 50]
[measured]
kind = "point"
frame = "free"
[estimate]
parameters = ["target"]
"""


def turned(tmp_path, errors, replicates=12):
    """Diagnose a table that stops at few angles, wrong by `errors` (arcsec) there in each of the replicates."""
    rng = np.random.default_rng(1)
    command = np.tile(np.arange(len(errors)) * 2 * np.pi / len(errors), replicates)
    angle = command + np.tile(errors, replicates) * np.pi / 648000
    xyz = np.stack([200 * np.cos(angle), 200 * np.sin(angle), np.full_like(angle, 50.0)], axis=1)
    xyz += 0.0002 * rng.standard_normal(xyz.shape)
    order = rng.permutation(len(angle))
    rows = np.column_stack([np.degrees(command), xyz])[order]
    (tmp_path / "machine.toml").write_text(TABLE)
    lines = [f"{c:.6f},ball,{x:.7f},{y:.7f},{z:.7f}" for c, x, y, z in rows]
    (tmp_path / "data.csv").write_text("\n".join(["C [deg],target,x [mm],y [mm],z [mm]", *lines]) + "\n")
    machine = rodgen.Machine.load(tmp_path / "machine.toml")
    return diagnose(machine, rodgen.Measurements.load(tmp_path / "data.csv"))


@pytest.mark.thorough
@pytest.mark.quick("5")
@pytest.mark.parametrize("count", [5, 8, 12, pytest.param(24, marks=pytest.mark.slow)])
def test_errors_of_a_few_positions_are_no_effect_however_often_they_are_measured(count, tmp_path):
    found = turned(tmp_path, np.random.default_rng(2).standard_normal(count))
    assert found.steps == ()
    assert found.unexplained == ()
    assert found.verdict == "cannot_tell"


def test_an_eccentricity_is_found_at_twelve_positions(tmp_path):
    found = turned(tmp_path, np.cos(np.arange(12) * 2 * np.pi / 12 - 1.0))
    assert [step.effect.title for step in found.steps] == ["encoder_eccentricity at C"]
    assert found.steps[0].log10_odds > 15


def test_positions_that_differ_by_a_thousandth_of_the_way_are_one():
    assert positions(np.array([0.0, 90.01, 45.0, 90.0, 0.005])).tolist() == [0, 2, 1, 2, 0]


def test_readings_close_to_each_other_along_a_scan_are_no_single_position():
    scan = np.linspace(-0.5, 0.5, 401)
    assert len(np.unique(positions(np.concatenate([scan, [-2.0, 2.0]])))) > 200


MOUNT = Path(__file__).parent.parent / "examples" / "machines" / "mount"


@pytest.mark.thorough
def test_the_order_of_stars_does_not_tell_from_which_side_a_mount_came():
    machine = rodgen.Machine.load(MOUNT / "machine.toml")
    found = diagnose(machine, rodgen.Measurements.load(MOUNT / "mmt_2021.csv"))
    assert not any(ranked.effect.name.startswith("backlash") for ranked in found.ranking)
    assert any("from which side AZ and EL came is not known" in note for note in found.notes)


@pytest.mark.parametrize(
    ("command", "directions", "known"),
    [
        ([0, 90, 180, 90, 0], None, True),
        ([0, 90, 180, 90, 0], [1, 0, 1, -1, -1], True),
        ([0, 90, 180, 90, 0], [0, 0, 0, 0, 0], False),
        ([0, 90, 90.05, 180, 180.02], None, True),  # trimmed onwards
        ([0, 90, 89.95, 180, 179.98], None, False),  # trimmed
        ([0, 90, 90.05, 180, 180.02], [1, 1, -1, 1, -1], True),
        ([90, 90, 90, 90, 90], None, False),  # it never moved
    ],
)
def test_from_which_side_a_joint_came_is_known(command, directions, known, tmp_path):
    (tmp_path / "machine.toml").write_text(TABLE)
    sides = directions or [""] * len(command)
    comma = "," if directions else ""
    rows = [f"{c},ball,200,0,50{comma}{side}" for c, side in zip(command, sides, strict=True)]
    header = "C [deg],target,x [mm],y [mm],z [mm]" + (",dir_C" if directions else "")
    (tmp_path / "data.csv").write_text("\n".join([header, *rows]) + "\n")
    machine = rodgen.Machine.load(tmp_path / "machine.toml")
    o = bind(machine, rodgen.Measurements.load(tmp_path / "data.csv"))
    assert o.approach_known.tolist() == [known]
    assert any(driver.kind == "approach" for driver in o.drivers()) == known
