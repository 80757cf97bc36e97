"""The effects that a fit may lack, as a user looks for them, and what each would explain."""

from pathlib import Path

import numpy as np
import pytest

from rodgen.calibration.diagnose.suspects import suspects
from rodgen.calibration.fit import fit
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

MACHINES = Path(__file__).parents[1] / "examples/machines"


@pytest.fixture(scope="module")
def mount():
    machine = Machine.load(MACHINES / "mount/machine.toml")
    return fit(machine, Measurements.load(MACHINES / "mount/mmt_2021.csv"))


def test_what_an_effect_would_leave_is_what_it_leaves(mount):
    found = suspects(mount)
    by_title = {s.effect.title: s for s in found.listed}
    assert len(by_title) == len(found.listed)
    for title in ("tube_flexure", "refraction", "encoder_ellipticity at EL", "scale at EL"):
        suspect = by_title[title]
        after = fit(mount.machine.with_effect(suspect.effect), mount.observations)
        explained = found.explained(suspect.effect)
        # to first order; errors of three arcseconds are far from where that ends
        np.testing.assert_allclose(mount.residuals - explained, after.residuals, atol=0.02)
        assert suspect.p_value < 1e-16
        assert suspect.rms == pytest.approx(after.rms, rel=0.005)
    assert by_title["zero_offset at AZ"].p_value == 1.0
    assert by_title["zero_offset at AZ"].visible < 0.01
    assert by_title["tube_flexure"].odds > 10 * by_title["scale at EL"].odds


def test_those_that_data_cannot_tell_apart_follow_each_other(mount):
    found = suspects(mount).listed
    titles = [s.effect.title for s in found]
    like = {s.effect.title: s.like.title for s in found if s.like is not None}
    assert {"lateral_windup at AZ", "tube_flexure"} <= {*like, *like.values()}
    for follower, leader in like.items():
        between = titles[titles.index(leader) + 1 : titles.index(follower)]
        assert all(like.get(title) == leader for title in between)
    assert all(s.p_value < 0.01 for s in found if s.like is not None)


def test_what_a_diagnosis_would_name_stands_first_and_equals_say_why(mount):
    found = suspects(mount).listed
    assert found[0].effect.title == "tube_flexure"
    assert [s.effect.title for s in found if s.like is None][:2] == ["tube_flexure", "refraction"]
    imitating = next(s for s in found if s.effect.title == "encoder_ellipticity at EL")
    assert imitating.like.title == "tube_flexure"
    assert "does the same to these readings, except for" in imitating.why
    with_flexure = suspects(fit(mount.machine.add("tube_flexure"), mount.observations)).listed
    assert with_flexure[0].effect.title == "refraction"


@pytest.mark.thorough
def test_what_chance_explains_as_well_stands_after_what_it_may_not(mount):
    found = [s for s in suspects(mount).listed if s.like is None]
    certain = [s.p_value == 1.0 for s in found]
    assert certain == sorted(certain)
    imitated = [s.statistic == 0.0 for s in found]  # such as a zero offset, which the boresight is, too
    assert imitated == sorted(imitated)
    assert any(imitated)


def test_effects_outside_the_selection_say_why_they_cannot_be_told_apart():
    table = MACHINES / "gantry_rotary"
    data = next(table.glob("*.csv"))
    found = suspects(fit(Machine.load(table / "machine.toml"), Measurements.load(data))).listed
    backlash = next(s for s in found if s.effect.title == "backlash at C")
    assert backlash.like.title == "radial_error_motion at C"
    assert "explains these readings about as well, though it changes them differently" in backlash.why
    assert all(s.why for s in found if s.like is not None)


def test_with_what_is_missing_in_the_model_little_is_left_to_suspect(mount):
    machine = mount.machine
    for name in ("tube_flexure", "refraction"):
        machine = machine.add(name)
    found = suspects(fit(machine, mount.observations)).listed
    assert min(s.p_value for s in found) > 1e-3
    assert not {"tube_flexure", "refraction"} & {s.effect.title for s in found}
