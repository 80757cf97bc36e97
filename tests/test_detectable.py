"""How large an effect could be without being found: as large as simulations say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden_effects import hidden
from linear_evidence import evidence_of

import rodgen
from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.evidence import Evidence
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
    first = next(one for one in found.could_hide if one.possible)
    assert f"{first.effect.title} {first.parameter} = " in text
    assert "e+" not in text  # 4000 arcsec, not 4e+03
    assert not {one.effect.title for one in found.could_hide} & {effect.title for effect in found.unseen}
    printed = found.to_dict()["could_hide"]
    assert len(printed) == len(found.could_hide) > 30
    assert [one["rms"] for one in printed] == sorted((one["rms"] for one in printed), reverse=True)
    assert all(one["size"] > 0 and one["unit"] for one in printed)


def test_sizes_that_no_machine_has_are_no_table_of_what_may_be_there(innocent):
    found = diagnose(innocent)
    first, *others = found.could_hide
    text = " ".join(str(replace(found, could_hide=(replace(first, possible=False), *others))).split())
    assert f"{first.effect.title} {first.parameter} = " not in text
    assert f"only more than any machine has of {first.effect.title}." in text


def test_a_size_is_possible_that_machines_have(innocent):
    by = {(one.effect.title, one.parameter): one for one in diagnose(innocent).could_hide}
    scale = next(one for (title, _), one in by.items() if title == "scale at X")
    assert scale.possible
    assert scale.size < 0.05  # the largest of the table
