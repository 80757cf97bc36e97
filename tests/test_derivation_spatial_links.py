"""The derivation of links: closed, with its errata, and right in numbers that the proofs do not use."""

from __future__ import annotations

import re

import numpy as np
import pytest
import sympy as sp
from lazy import LazyDerivation
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.xdist_group("spatial_links")
notes = LazyDerivation("spatial_links")


@pytest.mark.thorough
def test_every_formula_is_decided():
    assert notes.derivation.open == []
    assert [entry.id for entry in notes.derivation if entry.verdict == "refuted"] == [
        "rule-3",
        "trace-unit",
        "differences-rule",
        "always-a-vector",
        "offset-without-direction",
        "hooke-joint",
        "very-close",
    ]


@pytest.mark.thorough
def test_the_general_rotation_is_scipys():
    symbols = [*notes.m, notes.theta]
    matrix = sp.lambdify(symbols, notes.about_m)
    for vector in Rotation.random(10, random_state=1).as_rotvec():
        angle = np.linalg.norm(vector)
        found = matrix(*(vector / angle), angle)
        np.testing.assert_allclose(found, Rotation.from_rotvec(vector).as_matrix(), atol=1e-15)


def test_without_the_rules_the_certificates_are_not_zero():
    """For axes that are no frame each rule leaves something: the certificates are no empty identities."""
    point = {
        **dict(zip(notes.along, (1, 2, 3), strict=True)),
        **dict(zip(notes.across, (2, 0, 1), strict=True)),
    }
    point |= {**dict(zip(notes.m, (1, 1, 2), strict=True)), notes.theta: sp.pi / 3}
    for i in range(3):
        for j in range(3):
            rest = notes.certificate[i, j].subs(point)
            assert rest != 0
            assert sp.simplify(notes.products[i, j].subs(point) - notes.about_m[i, j].subs(point) - rest) == 0


def test_the_flow_chart_is_a_drawing_with_all_three_cases():
    chart = pytest.importorskip("rodgen.derivation.figures.spatial_links").flow_chart()
    words = re.sub("</?b>", "", " ".join(note.text or "" for note in chart.layout.annotations))
    assert "special case 1" in words
    assert "special case 2" in words
    assert "S7 = (S1 × P) · a71 / s71" in words
    assert "φ1 = θ1 − γ1" in words
