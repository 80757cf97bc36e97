"""Forms against effects: what the catalogue does as well is never said to lie outside of it."""

from __future__ import annotations

import pytest
from diagnosis_checks import diagnosis_of
from hidden_effects import hidden

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
