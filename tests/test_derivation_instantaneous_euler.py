"""The derivations of the instantaneous Euler angles: complete, closed, and right in numbers as well.

The proofs are exact. Here the same statements are held against floating-point numbers and against SciPy's rotations.
"""

from __future__ import annotations

import re
from functools import cache

import mpmath
import numpy as np
import pytest
import sympy as sp
from lazy import LazyDerivation
from scipy.spatial.transform import Rotation

from rodgen.symbolic import Derivation, Entry

pytestmark = [pytest.mark.xdist_group("instantaneous_euler"), pytest.mark.thorough]
instantaneous_euler = LazyDerivation("instantaneous_euler")
PARTS = ("", "_ridges", "_inverse", "_motion", "_arm")
RNG = np.random.default_rng(8)

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


def sample(symbols: set[sp.Symbol]) -> dict[sp.Symbol, float]:
    """Random numbers; components of a quaternion and of an axis have the length 1 together."""
    values = {
        s: float(x)
        for s, x in zip(sorted(symbols, key=str), RNG.uniform(0.2, 1.4, len(symbols)), strict=True)
    }
    for family in (("q0", "qx", "qy", "qz"), ("nx", "ny", "nz")):
        members = [s for s in values if s.name in family]
        if len(members) == len(family):
            length = np.linalg.norm([values[s] for s in members])
            values.update({s: values[s] / length for s in members})
    return values


def size_of(residual: sp.Expr) -> float:
    values = sample(residual.free_symbols)
    return abs(complex(residual.evalf(30, subs={s: mpmath.mpf(v) for s, v in values.items()})))


def equations(claims: tuple[sp.Basic, ...]) -> list[sp.Basic]:
    return [claim for claim in claims if isinstance(claim, sp.Eq)]


@pytest.mark.slow
def test_what_is_proved_holds_at_random_numbers() -> None:
    for key, entry in entries().items():
        refuted = entry.refutation
        claims = refuted.correction if refuted else entry.claims
        insert = entry.derivation.insert(dict(entry.given))
        sides = [[sp.Matrix([insert(side)]) for side in claim.args] for claim in equations(tuple(claims))]
        residuals = [residual for left, right in sides for residual in left - right]
        for residual in residuals[:12]:
            assert size_of(sp.sympify(residual)) < 1e-12, key


def angles_of(matrix: np.ndarray) -> np.ndarray:
    return np.arccos(np.clip(np.diagonal(matrix), -1, 1))


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


def test_example_of_the_exchanged_labels() -> None:
    """Z-Y-X at 30, 40, 50 degrees: the definitions, and (20) with x and z exchanged."""
    a, b, c = np.radians([30, 40, 50])
    true = np.degrees(angles_of(Rotation.from_euler("ZYX", [a, b, c]).as_matrix()))
    by_20 = np.degrees(np.arccos([np.cos(b) * np.cos(c), np.cos(np.radians(true[1])), np.cos(a) * np.cos(b)]))
    np.testing.assert_allclose(true, by_20[::-1], atol=1e-9)
    np.testing.assert_allclose(true, [48.439, 36.595, 60.501], atol=5e-4)


def test_zeros_of_figure_6() -> None:
    """Counted on a fine grid that has the multiples of 90 degrees."""
    t = np.radians(np.arange(0, 360, 0.5))
    diagonal = np.diagonal(
        Rotation.from_euler("ZYX", np.stack([t, t, t], axis=1)).as_matrix(), axis1=1, axis2=2
    )
    zeros = (np.abs(diagonal - 1) < 1e-12).sum(axis=0)
    assert zeros.tolist() == [2, 3, 2]
    peaks = np.degrees(np.arccos(np.clip(diagonal, -1, 1))).max(axis=0)
    np.testing.assert_allclose(peaks, [90, 180, 90], atol=1e-5)


def test_nothing_but_the_ridge_is_reciprocal_to_two_planes() -> None:
    """Rank 5 of the six screws of an attitude, by singular values; 3 where the planes coincide."""

    def line(point: np.ndarray, direction: np.ndarray) -> np.ndarray:
        return np.concatenate([direction, np.cross(point, direction)])

    def screws(matrix: np.ndarray, p: np.ndarray) -> np.ndarray:
        e, moved = np.eye(3), matrix.T
        zero = np.zeros(3)
        couples = [np.concatenate([zero, e[2]]), np.concatenate([zero, moved[2]])]
        return np.array([line(zero, e[0]), line(zero, e[1]), line(p, moved[0]), line(p, moved[1]), *couples])

    matrix, p = Rotation.random(random_state=1).as_matrix(), RNG.normal(size=3)
    given = screws(matrix, p)
    assert np.linalg.matrix_rank(given) == 5
    ridge = np.concatenate([np.cross([0, 0, 1], matrix[:, 2]), (matrix[:, 2] @ p) * np.array([0, 0, 1])])
    swapped = np.concatenate([given[:, 3:], given[:, :3]], axis=1)
    assert np.abs(swapped @ ridge).max() < 1e-14
    about_z = Rotation.from_rotvec([0, 0, 0.4]).as_matrix()
    assert np.linalg.matrix_rank(screws(about_z, np.array([1.0, 2, 0]))) == 3
