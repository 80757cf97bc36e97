"""How large an effect could be without being found: as large as simulations say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden_effects import hidden

import rodgen
from rodgen.calibration.diagnose import diagnose, search
from rodgen.calibration.diagnose.clusters import Clusters
from rodgen.calibration.diagnose.held_out_blocks import Blocks
from rodgen.calibration.diagnose.selection import Selection
from rodgen.data.units import unit_factor
from rodgen.statistics.columns import unchanged

DRAWS = 20


@pytest.fixture(scope="module")
def innocent(tmp_path_factory):
    machine, data = hidden("gantry", 3, []).write(tmp_path_factory.mktemp("innocent"))
    return rodgen.Machine.load(machine).fit(rodgen.Measurements.load(data))


def share_found(base, one, factor):
    """Return the share of simulated data sets in which an effect of some times the stated size is found."""
    screening = search.Screening.at(base)
    sensitivities = screening.sensitivities
    space = search.CandidateSpace(sensitivities.model, screening.candidates, unchanged)
    own = next(c for c in screening.candidates if c.effect.title == one.effect.title)
    i = [name.rpartition(".")[2] for name in own.names].index(one.parameter)
    size = factor * one.size * unit_factor(one.unit, base.machine.length_unit)[0]
    rng = np.random.default_rng(0)
    scale = np.std(sensitivities.residual)
    count = 0
    for _ in range(DRAWS):
        residual = scale * rng.standard_normal(sensitivities.residual.shape) + size * own.columns[:, :, i]
        seen = replace(sensitivities, residual=residual)
        blocks = Blocks(seen.observations, seen.model, residual)
        selection = Selection(space, blocks, base.observations.n, Clusters(seen, unchanged))
        count += bool(selection.run(*space.residual(residual)))
    return count / DRAWS


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
