"""The derivations of the instantaneous Euler angles: complete, closed, and right in numbers as well.

The proofs are exact. Here the same statements are held against floating-point numbers and against SciPy's rotations.
"""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
import sympy as sp
from lazy import LazyDerivation
from scipy.spatial.transform import Rotation

from rodgen.symbolic import Derivation, Entry

pytestmark = [pytest.mark.xdist_group("instantaneous_euler"), pytest.mark.thorough]
instantaneous_euler = LazyDerivation("instantaneous_euler")
PARTS = ("", "_ridges", "_inverse", "_motion", "_arm")

EQUATIONS = {
    "": [
        "1-first",
        "1-instants",
        "1-final",
        "6",
        "10",
        "13",
        "16",
        "17",
        "18-x",
        "18-y",
        "18-z",
        "20",
        "20-y",
    ],
    "_ridges": [
        *("3", "4", "5", "5-written-out", "7", "8", "9", "9-reciprocal", "11-x3", "11-x0", "11-Qy"),
        *("12", "12-reciprocal", "14-axes", "14-Qx", "15", "15-reciprocal"),
    ],
}
"""Equation (2) are names; (19) is (6); (21) to (23) are those of the 3-SPS-S machine."""


def derivation_of(part: str) -> Derivation:
    return LazyDerivation(f"instantaneous_euler{part}").derivation


@cache
def entries() -> dict[tuple[str, str], Entry]:
    return {(part, entry.id): entry for part in PARTS for entry in derivation_of(part)}


@pytest.mark.parametrize("part", PARTS)
def test_nothing_is_open_and_kernels_are_handed_over(part: str) -> None:
    derivation = derivation_of(part)
    assert derivation.open == []
    assert derivation.kernels
    assert all(entry.place for entry in derivation if entry.origin != "own")


@pytest.mark.parametrize(("part", "number"), [(part, n) for part, ns in EQUATIONS.items() for n in ns])
def test_every_printed_equation_is_an_entry(part: str, number: str) -> None:
    entry = entries()[part, f"eq-{number}"]
    assert entry.origin in ("printed", "said")
    assert f"({re.match('[0-9]+', number)[0]})" in entry.place


def test_every_row_of_the_tables_is_an_entry_with_its_remark_on_ridges() -> None:
    for section, table in (("4.1", instantaneous_euler.TABLE_41), ("4.2", instantaneous_euler.TABLE_42)):
        assert len(table) == 6  # three of one rotation, three of two
        for name in (*table, "three"):
            assert ("", f"table-{section}-{name}") in entries()
        for name in table:
            assert ("_ridges", f"ridges-{section}-{name}") in entries()


def test_verdicts() -> None:
    """What is wrong in the paper, at a glance."""
    tables = {
        "4.1": {
            "alpha": 1,
            "beta": 1,
            "gamma": 1,
            "beta-gamma": 1,
            "alpha-beta": 1,
            "alpha-gamma": 1,
            "three": 0,
        },
        "4.2": {"phi": 0, "theta": 1, "psi": 0, "theta-psi": 0, "phi-theta": 1, "phi-psi": 0, "three": 0},
    }
    for section, rows in tables.items():
        for name, good in rows.items():
            assert entries()["", f"table-{section}-{name}"].verdict == ("proved" if good else "refuted")
    figures = {
        "figure-6-do-not-follow": 1,
        "figure-6-peaks": 1,
        "figure-6-tend-to-zero": 1,
        "figure-6-zeros": 1,
        "independent-of-others": 0,
        "figure-8-x": 1,
        "figure-8-y": 1,
        "figure-8-z": 1,
        "figure-8-coupling": 1,
        "figure-9-x": 0,
        "figure-9-y": 0,
        "figure-9-z": 0,
        "figure-9-jointly": 0,
        "state-quantity": 1,
    }
    for name, good in figures.items():
        assert entries()["_arm", name].verdict == ("proved" if good else "refuted")


# the same in numbers -----------------------------------------------------------------------------------


@pytest.mark.parametrize("section", ["4.1", "4.2"])
def test_rows_of_the_tables_against_scipy(section: str) -> None:
    table = instantaneous_euler.TABLE_41 if section == "4.1" else instantaneous_euler.TABLE_42
    sequence = "ZYX" if section == "4.1" else "ZYZ"
    names = ("alpha", "beta", "gamma") if section == "4.1" else ("phi", "theta", "psi")
    values = dict(zip((sp.Symbol(n, real=True) for n in names), (0.5, 0.7, 0.4), strict=True))
    for name, (angles, printed) in table.items():
        numbers = [float(sp.sympify(a).subs(values)) for a in angles]
        true = np.diagonal(Rotation.from_euler(sequence, numbers).as_matrix())
        row = np.cos([float(sp.sympify(c).subs(values)) for c in printed])
        right = entries()["", f"table-{section}-{name}"].verdict == "proved"
        assert np.allclose(row, true, atol=1e-14) == right, name


def test_printed_matrix_17_differs_in_one_element_only() -> None:
    angles = (0.3, 0.5, 0.7)
    values = dict(zip((sp.Symbol(n, real=True) for n in ("phi", "theta", "psi")), angles, strict=True))
    printed = np.array(instantaneous_euler.printed_zyz.subs(values), float)
    differs = ~np.isclose(printed, Rotation.from_euler("ZYZ", angles).as_matrix(), atol=1e-14)
    assert np.argwhere(differs).tolist() == [[1, 1]]
