"""How large an effect could be without being found: as large as simulations say."""

from __future__ import annotations

import numpy as np
import pytest
from hidden_effects import hidden
from linear_evidence import evidence_of
from simulated_fits import fit_to, joint, machine_file, measure

import rodgen
from rodgen.calibration.dependence import Correlation
from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.remaining_error import disagreement
from rodgen.calibration.selection import select
from rodgen.data.units import unit_factor

DRAWS = 20


@pytest.fixture(scope="module")
def innocent(tmp_path_factory):
    machine, data = hidden("gantry", 3, []).write(tmp_path_factory.mktemp("innocent"))
    return rodgen.Machine.load(machine).fit(rodgen.Measurements.load(data))


def share_found(base, one, factor):
    """Return the share of simulated data sets in which an effect of some times the stated size is found."""
    evidence = Evidence.of(base)
    rows = evidence.sensitivities
    own = next(c for c in evidence.candidates if c.effect.title == one.effect.title)
    i = own.short_names.index(one.parameter)
    size = factor * one.size * unit_factor(one.unit, base.machine.length_unit)[0]
    rng = np.random.default_rng(0)
    scale = np.std(rows.residual)
    count = 0
    for _ in range(DRAWS):
        residual = scale * rng.standard_normal(rows.residual.shape) - size * own.columns[:, :, i]
        count += bool(select(evidence_of(evidence.candidates, -residual, rows.model, base)))
    return count / DRAWS


@pytest.mark.thorough
@pytest.mark.parametrize(
    "title", ["squareness at Y", pytest.param("gravity_sag at X", marks=pytest.mark.slow)]
)
def test_an_effect_of_the_stated_size_is_found_in_95_of_100_data_sets(innocent, title):
    found = diagnose(innocent)
    one = next(one for one in found.could_hide if one.effect.title == title)
    assert share_found(innocent, one, 1.0) > 0.8  # 0.95, and three standard deviations of 20 draws
    assert share_found(innocent, one, 0.5) < 0.5


def test_text_and_json_say_what_could_hide(innocent):
    found = diagnose(innocent)
    assert found.verdict == "nothing_missing"
    text = " ".join(str(found).split())
    assert "How much of it is noise is not known" in " ".join(
        text.split()
    )  # none is stated, and no pose was repeated
    assert f"{found.could_hide[0].effect.title} {found.could_hide[0].parameter} = " in text
    assert "e+" not in text  # 4000 arcsec, not 4e+03
    assert not {one.effect.title for one in found.could_hide} & {effect.title for effect in found.unseen}
    printed = found.to_dict()["could_hide"]
    assert len(printed) == len(found.could_hide) > 30
    assert [one["rms"] for one in printed] == sorted((one["rms"] for one in printed), reverse=True)
    assert all(one["size"] > 0 and one["unit"] for one in printed)


def test_a_size_is_possible_that_machines_have(innocent):
    by = {(one.effect.title, one.parameter): one for one in diagnose(innocent).could_hide}
    scale = next(one for (title, _), one in by.items() if title == "scale at X")
    assert scale.possible
    assert scale.size < 0.05  # the largest of the table


@pytest.mark.parametrize("repeats", [True, False])
def test_residuals_that_repeat_at_few_positions_are_said_to(repeats):
    """Each of ten positions of a table has an error of its own, as of a bad divided circle; or each reading has."""
    random = np.random.default_rng(1)
    joints = [joint("X", "prismatic", (1, 0, 0)), joint("C", "revolute", (0, 0, 1))]
    file = machine_file(joints, [(150, 20, 30)], estimate=["C.axis", "C.point", "target"], noise=0.002)
    number = random.integers(0, 10, 120)
    columns = {"X [mm]": random.uniform(-200, 200, 120), "C [rad]": 0.6 * number - 3}
    data = measure(file, columns, {}, noise=0.002, random=random)
    own = 0.006 * random.normal(size=(3, 120))
    for axis, errors in zip("xyz", own, strict=True):
        data[f"{axis} [mm]"] = data[f"{axis} [mm]"] + errors[number if repeats else np.arange(120)]
    independent = Correlation(1.0)
    said = disagreement(fit_to(file, data), independent)
    assert said.startswith("The residuals are ")
    assert ("repeat at the 10 positions of C" in said) is repeats
    assert ("several effects act that are too small to be found" in said) is not repeats
