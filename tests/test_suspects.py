"""The effects that a fit may lack, as a user looks for them, and what each would explain."""

from pathlib import Path

import numpy as np
import pytest

from rodgen.calibration.fit import fit
from rodgen.calibration.suspects import suspects
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
    for title in (
        "tube_flexure (TF)",
        "refraction (TX)",
        "encoder_ellipticity at EL (HECE2, HESE2)",
        "scale at EL",
    ):
        suspect = by_title[title]
        after = fit(mount.machine.with_effect(suspect.effect), mount.observations)
        explained = found.explained(suspect.effect)
        # to first order; errors of three arcseconds are far from where that ends
        np.testing.assert_allclose(mount.residuals - explained, after.residuals, atol=0.02)
        assert suspect.log10_odds > 16
        assert suspect.rms == pytest.approx(after.rms, rel=0.005)
    assert by_title["zero_offset at AZ (IA)"].odds == 0.0
    assert by_title["zero_offset at AZ (IA)"].visible < 0.01
    assert by_title["tube_flexure (TF)"].chosen
    assert by_title["refraction (TX)"].chosen


def test_those_that_data_cannot_tell_apart_follow_each_other(mount):
    found = suspects(mount).listed
    titles = [s.effect.title for s in found]
    like = {s.effect.title: s.like.title for s in found if s.like is not None}
    assert {"encoder_eccentricity at EL (ECEC, ECES)", "tube_flexure (TF)"} <= {*like, *like.values()}
    for follower, leader in like.items():
        between = titles[titles.index(leader) + 1 : titles.index(follower)]
        assert all(like.get(title) == leader for title in between)
    assert all(s.odds > 100 for s in found if s.like is not None)


def test_what_a_diagnosis_would_name_stands_first(mount):
    found = suspects(mount).listed
    assert found[0].effect.title == "tube_flexure (TF)"
    assert [s.effect.title for s in found if s.like is None][:2] == ["tube_flexure (TF)", "refraction (TX)"]
    imitating = next(s for s in found if s.effect.title == "encoder_ellipticity at EL (HECE2, HESE2)")
    assert imitating.like.title == "tube_flexure (TF)"
    with_flexure = suspects(fit(mount.machine.add("tube_flexure"), mount.observations)).listed
    assert with_flexure[0].effect.title == "refraction (TX)"


def test_what_is_no_better_than_nothing_stands_last(mount):
    alone = [s.odds for s in suspects(mount).listed if not s.chosen and s.like is None]
    assert alone == sorted(alone, reverse=True)
    assert alone[-1] == 0.0  # such as of a zero offset, which the boresight is, too


def test_with_what_is_missing_in_the_model_little_is_left_to_suspect(mount):
    machine = mount.machine
    for name in ("tube_flexure", "refraction"):
        machine = machine.add(name)
    found = suspects(fit(machine, mount.observations)).listed
    assert max(s.odds for s in found) < 100
    assert not any(s.chosen for s in found)
    assert not {"tube_flexure (TF)", "refraction (TX)"} & {s.effect.title for s in found}
