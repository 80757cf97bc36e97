"""Diagnoses of real measurements, against what is published of them and full refits of what could stand there.

The telescope's figures are in the repository. The positioner's are not; its test is skipped where they are not found.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest
from diagnosis_checks import allowed, far_aliases, format_errors, refitted

import rodgen
from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.fit import fit
from rodgen.calibration.ladder import ladder
from rodgen.cli import main as cli
from rodgen.machines.effects.catalogue import CATALOGUE

ROOT = Path(__file__).parent.parent
MOUNT = ROOT / "examples" / "machines" / "mount"
STARS = MOUNT / "mmt_2021.csv"
ORIGINAL = ROOT.parent / "shared" / "data" / "mmt_2021" / "data.csv"
POSITIONER = ROOT.parent / "shared" / "data" / "positioner" / "data.csv"
NAMES = {definition.name for definition in CATALOGUE}


@cache
def telescope():
    return fit(rodgen.Machine.load(MOUNT / "machine.toml"), rodgen.Measurements.load(STARS)).diagnose()


def same(step) -> set[tuple[str, str | None]]:
    aliases = {(alias.effect.name, alias.effect.place) for alias in step.indistinguishable_from}
    return {(step.effect.name, step.effect.place)} | aliases


def test_the_telescope_s_error_falls_as_far_as_published_and_by_effects_of_the_elevation_first():
    found = telescope()
    assert found.verdict == "effects_missing"
    assert found.rms.before == pytest.approx(2.711, abs=5e-4)
    assert found.steps[0].effect.place == "EL"
    assert all(step.effect.place != "AZ" for step in found.steps)
    # TPOINT's terms, TF (gravity_windup at EL) and TX (refraction), leave 0.659
    assert found.rms.after <= 0.66
    assert len(found.steps) == 2
    assert found.outliers == ()
    assert found.rms.after < found.rms.after_held_out < 0.75


def test_the_error_on_poses_left_out_is_that_which_add_prints():
    found = telescope()
    machine = rodgen.Machine.load(MOUNT / "machine.toml")
    rungs = ladder(machine, rodgen.Measurements.load(STARS), [step.effect for step in found.steps]).rungs
    shown = [found.rms.before_held_out, *(step.rms_held_out for step in found.steps)]
    assert shown == pytest.approx([rung.held_out.rms for rung in rungs], rel=1e-6)


def test_the_published_terms_are_among_what_these_stars_cannot_tell_apart():
    first, second = map(same, telescope().steps)
    # over 70 degrees of elevation a droop, a gain and an eccentric scale bend alike
    assert {(name, "EL") for name in ("gravity_windup", "scale", "encoder_eccentricity")} <= first
    assert ("refraction", None) in first | second
    # a wave that repeats with azimuth, or a joint that was approached from below, is none of them
    assert not {("encoder_eccentricity", "AZ"), ("backlash", "EL"), ("backlash", "AZ")} & (first | second)


def test_the_telescope_s_effects_that_are_said_to_be_the_same_are_the_same_when_fitted():
    machine, data = rodgen.Machine.load(MOUNT / "machine.toml"), rodgen.Measurements.load(STARS)
    assert far_aliases(machine, data, telescope().to_dict()) == []


@pytest.mark.slow
def test_every_other_effect_of_the_elevation_is_told_apart():
    """What stands in no list fits worse than the rule of lists allows."""
    machine, data = rodgen.Machine.load(MOUNT / "machine.toml"), rodgen.Measurements.load(STARS)
    found = telescope()
    first, second = found.steps
    other = machine.with_effect(machine.effect(second.effect.name, second.effect.place))
    (own, variance), many = refitted(other, data, (first.effect.name, first.effect.place), ())
    listed = same(first)
    told = []
    for definition in CATALOGUE:
        title = (definition.name, "EL")
        if "revolute" not in definition.at or title in listed:
            continue
        try:
            (cost, _), few = refitted(other, data, title, ())
        except rodgen.RodgenError:
            continue  # it does nothing to directions, or its columns are not there
        if few <= many:
            assert (cost - own) / variance > allowed(found.rows, many - few), title
            told.append(title)
    assert len(told) >= 2


def test_the_command_names_the_same_effects_from_the_files_of_a_user(capsys):
    data = ORIGINAL if ORIGINAL.exists() else STARS
    assert cli.main(["diagnose", str(MOUNT / "machine.toml"), str(data), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    machine = {
        "joint": [{"name": "AZ"}, {"name": "EL"}],
        "target": [{"name": "boresight"}],
        "measured": {"kind": "direction"},
        "units": {"length": "mm"},
    }
    assert format_errors(printed, machine, 80, NAMES) == []
    steps = [(step["effect"], step["joint"]) for step in printed["steps"]]
    assert steps == [(step.effect.name, step.effect.place) for step in telescope().steps]
    assert printed["rms"]["after"] == pytest.approx(telescope().rms.after, rel=1e-6)


@pytest.mark.slow  # the telescope's stars, above, hold the same of a larger arc
def test_a_gain_an_eccentricity_and_a_second_harmonic_look_the_same_over_a_small_arc():
    if not POSITIONER.exists():
        pytest.skip(f"needs {POSITIONER}, which is not part of this repository")
    machine = rodgen.Machine.load(ROOT / "tests" / "data" / "positioner.toml")
    found = diagnose(machine, rodgen.Measurements.load(POSITIONER))
    # P1 covers +-30 degrees only
    wanted = {(name, "P1") for name in ("scale", "encoder_eccentricity", "encoder_ellipticity")}
    assert any(wanted <= same(step) for step in found.steps)
