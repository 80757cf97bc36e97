"""What the derivation of the Tricept's uncertainty decides, and that the package names what it names."""

from __future__ import annotations

import pytest
from lazy import LazyDerivation

from rodgen.kinematics import tricept

pytestmark = [pytest.mark.xdist_group("tricept_uncertainty"), pytest.mark.thorough]
tricept_uncertainty = LazyDerivation("tricept_uncertainty")


@pytest.mark.thorough
def test_everything_is_decided() -> None:
    assert tricept_uncertainty.derivation.open == []
    refuted = {
        entry.id: entry.refutation.label
        for entry in tricept_uncertainty.derivation
        if entry.refutation is not None
    }
    assert refuted == {
        "item-e": "V1",
        "six-roots": "V2",
        "eq-24-range": "V3",
        "eq-24-corners": "V4",
    }
    proved = {entry.id for entry in tricept_uncertainty.derivation if entry.verdict == "proved"}
    assert {"eq-21", "eq-22", "paper-W33", "paper-W35", "paper-M33", "degrees", "stationary-points"} <= proved


def test_names_are_those_of_the_package() -> None:
    assert tricept_uncertainty.PARAMETERS == tricept.PARAMETERS
    assert tuple(tricept.GUIDE) == tricept_uncertainty.GUIDE
