"""The derivation of the Tricept: complete, closed, and right in numbers as well.

The proofs are exact. Here the same statements are held against vectors and matrices in floating point with 40 digits,
differences, and SciPy's rotations, none of which the proofs use.
"""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from lazy import LazyDerivation

from rodgen.kinematics import tricept
from rodgen.kinematics import tricept as public

pytestmark = [pytest.mark.xdist_group("tricept"), pytest.mark.thorough]
paper = LazyDerivation("tricept")


PRINTED = [*(f"eq-{n}" for n in range(1, 24) if n not in (6, 11, 22)), "W33", "W35", "inverse", "table-1"]
SAID = ["Ox", "changes", "dimensionless", "vector-of-4", "after-multiplying-3", "cannot-be-derived"]
TACIT = ["usual-Ox", "units"]


@pytest.mark.thorough("eq-2", "eq-3", "eq-4")
@pytest.mark.parametrize("id", PRINTED)
def test_every_printed_formula_is_an_entry_with_its_place(id):
    entry = paper.derivation.entries[id]
    assert (entry.origin, entry.words) == ("printed", "")
    assert entry.place
    assert entry.verdict == ("refuted" if id in ("eq-8", "table-1") else "proved")


def test_equations_that_share_an_entry_are_named_in_its_place():
    places = " ".join(entry.place for entry in paper.derivation)
    for number in range(1, 24):
        assert f"({number})" in places, number


def test_what_is_said_or_taken_for_granted_is_marked_and_refuted():
    for ids, origin in ((SAID, "said"), (TACIT, "tacit")):
        assert [e.id for e in paper.derivation if e.origin == origin] == [
            e.id for e in paper.derivation if e.id in ids
        ]
        for id in ids:
            assert paper.derivation.entries[id].verdict == "refuted"
            assert bool(paper.derivation.entries[id].words) == (origin == "said")


def test_nothing_is_open_and_all_kernels_carry_the_prefix():
    assert paper.derivation.open == []
    assert len(paper.derivation.kernels) == 10
    assert all(name.startswith("tricept_") for name in paper.derivation.kernels)


@pytest.mark.thorough
def test_the_resultant_has_the_machines_exact_solutions():
    """Each positive root, isolated by exact arithmetic, is z² of a pose, and the other way round."""
    isolated = paper.resultant.intervals(eps=sp.Rational(1, 10**8), inf=0)
    roots = [float((low + high) / 2) for (low, high), _ in isolated]
    poses, count = public.direct_all([650.0, 700.0, 760.0], public.PAPER)
    np.testing.assert_allclose(np.sort(poses[: count // 2, 2] ** 2), roots, rtol=1e-12)  # of 4e5, by 1e-8


def test_the_elimination_has_degree_14_elsewhere_too():
    values = dict(zip((paper.R, paper.r, paper.A0, paper.A1, paper.Am), (5, 3, 7, 8, 6), strict=True))
    resultant, linear = paper.exact_resultant(values)
    resultant, powers_of_w = paper.without(resultant, sp.Poly(resultant.gen, resultant.gen))
    resultant, powers_of_e = paper.without(resultant, linear)
    assert (powers_of_w, powers_of_e, resultant.degree()) == (2, 4, 14)


# What the derivation of the Tricept's uncertainty decides, and that the package names what it names


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
