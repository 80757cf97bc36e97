"""The derivation of the Rodrigues equation: complete, closed, and right in numbers as well.

The proofs are exact. Here the same statements are held against floating-point numbers, against SciPy's
rotations and against finite differences, none of which the proofs use.
"""

import mpmath
import numpy as np
import pytest
import sympy as sp
from lazy import LazyDerivation
from random_numbers import check_at_random_numbers
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.xdist_group("rodrigues")
paper = LazyDerivation("rodrigues")
sensitivity = LazyDerivation("axis_sensitivity")

PRINTED = [
    *(f"eq-{number}" for number in range(1, 11)),
    *("theta-cross-rho", "theta-prime", "determinant", "bracketed", "expanded-i", "expanded-j", "expanded-k"),
    *("theta-cross-rho-length", "theta-cross-theta-cross-rho-length", "dot-by-gamma", "sin-cos-squared"),
    *("dot-expanded", "system-6-7", "modulus", "brackets", "cosine-law", "c-by-gamma", "c"),
    *("eq-10-collected", "quadratic", "theta-3"),
]
SAID = ["angle-of-the-vector", "eq-3-announced", "axis", "validation", "pairs-of-roots", "any-experiment"]
TACIT = ["triangle-units", "any-modulus", "pivot", "half-turn"]


@pytest.mark.thorough("eq-3", "eq-4")
@pytest.mark.parametrize("id", PRINTED)
def test_every_printed_formula_is_an_entry_with_its_place(id):
    entry = paper.derivation.entries[id]
    assert (entry.origin, entry.words) == ("printed", "")
    assert entry.place
    assert entry.verdict in ("proved", "refuted")


def test_what_the_paper_prints_no_formula_for_is_marked_said_or_tacit():
    said = [entry.id for entry in paper.derivation if entry.origin == "said"]
    assert sorted(said) == sorted(SAID)
    assert [entry.id for entry in paper.derivation if entry.origin == "tacit"] == TACIT
    for id in SAID + TACIT:
        entry = paper.derivation.entries[id]
        assert entry.place
        assert entry.verdict == "refuted"
        assert bool(entry.words) == (id in SAID)


@pytest.mark.thorough
def test_no_entry_of_the_sensitivity_is_open():
    assert sensitivity.derivation.open == []


def test_nothing_is_open_and_no_kernel_is_shipped():
    assert paper.derivation.open == []
    assert not paper.derivation.kernels


@pytest.mark.thorough
@pytest.mark.quick("rodrigues")
@pytest.mark.parametrize("notes", [paper, sensitivity], ids=["rodrigues", "axis_sensitivity"])
def test_what_is_proved_holds_at_random_numbers(notes):
    for entry in notes.derivation:
        if entry.verdict == "proved":
            check_at_random_numbers(entry, dict(entry.given))


# The paper's algorithm in plain NumPy, against SciPy's rotations


def papers_theta(rho, rho_prime, modulus_squared, sign_c, root_sign, root=np.sqrt):
    """Equations (9), (10) and the formulas after them, for arrays of points; root_sign may depend on w3."""
    alpha, r = 1 + modulus_squared / 4, rho_prime - rho
    p1, p2, p3 = np.moveaxis(rho, -1, 0)
    r1, r2, r3 = np.moveaxis(r, -1, 0)
    known = 2 * alpha * (r * rho).sum(-1)
    c = sign_c * root(modulus_squared * (rho * rho).sum(-1) + known)
    w3 = r2 * p1 - r1 * p2
    a1, b1, a2, b2 = r2 * c / w3, (r3 * p2 - r2 * p3) / w3, -r1 * c / w3, -(r3 * p1 - r1 * p3) / w3
    p12, p13, p23 = p1**2 + p2**2, p1**2 + p3**2, p2**2 + p3**2
    L2 = p13 * b2**2 + p23 * b1**2 + p12 - 2 * p1 * p2 * b1 * b2 - 2 * p1 * p3 * b1 - 2 * p2 * p3 * b2
    L1 = 2 * (p13 * a2 * b2 + p23 * a1 * b1 - p1 * p2 * (b2 * a1 + b1 * a2) - p1 * p3 * a1 - p2 * p3 * a2)
    L0 = p13 * a2**2 + p23 * a1**2 - 2 * p1 * p2 * a2 * a1
    t3 = (-L1 + root_sign(w3) * root(np.maximum(L1**2 - 4 * L2 * (L0 + known), 0))) / (2 * L2)
    return np.stack([a1 + b1 * t3, a2 + b2 * t3, t3], -1)


@pytest.fixture(scope="module")
def pairs():
    generator = np.random.default_rng(7)
    axis = generator.normal(size=(4000, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle, rho = generator.uniform(0.1, 3.0, 4000), generator.normal(size=(4000, 3))
    return axis, angle, rho, Rotation.from_rotvec(angle[:, None] * axis).apply(rho)


def misses(theta, angle, rho, rho_prime):
    """Distance of the rotated points from where they should be, by SciPy's rotations."""
    axis = theta / (2 * np.tan(angle / 2))[:, None]
    turned = Rotation.from_rotvec(angle[:, None] * axis).apply(rho)
    return np.linalg.norm(turned - rho_prime, axis=1) + abs(np.linalg.norm(axis, axis=1) - 1)


def test_root_sign_follows_third_component_of_rho_cross_r(pairs):
    axis, angle, rho, rho_prime = pairs
    modulus = 2 * np.tan(angle / 2)
    for sign_c in (1, -1):
        theta = papers_theta(rho, rho_prime, modulus**2, sign_c, np.sign)
        # Rounding of the quadratic by a small pivot: median 1e-15, and 1 in 4000 near 1e-6.
        assert np.median(misses(theta, angle, rho, rho_prime)) < 1e-13
        assert np.mean(misses(theta, angle, rho, rho_prime) < 1e-6) > 0.99
    given = np.where(((axis * rho).sum(1) > 0)[:, None], 1, -1)
    found = papers_theta(rho, rho_prime, modulus**2, given[:, 0], np.sign) / modulus[:, None]
    assert np.mean(abs(found - axis).max(1) < 1e-6) > 0.99


def test_printed_plus_fails_for_half_of_all_inputs(pairs):
    _, angle, rho, rho_prime = pairs
    theta = papers_theta(rho, rho_prime, 4 * np.tan(angle / 2) ** 2, 1, lambda w3: 1)
    valid = np.mean(misses(theta, angle, rho, rho_prime) < 1e-6)
    assert abs(valid - 0.5) < 4 * 0.5 / np.sqrt(len(angle))  # four standard deviations of the count


# The printed algorithm in exact arithmetic, on a Halton sequence


def test_the_kernel_gives_both_solutions_in_exact_arithmetic():
    kernel = paper.paper
    theta, rho = sp.Matrix([1, -2, 2]) / 3, sp.Matrix([3, 4, 12])
    rho_prime = paper.rodrigues(rho, theta)
    with mpmath.workdps(60):
        exact = {"rho": rho, "rho_prime": rho_prime}
        values = {name: [mpmath.mpf(int(x.p)) / int(x.q) for x in vector] for name, vector in exact.items()}
        values["angle"] = 2 * mpmath.atan(mpmath.mpf(1) / 2)  # |θ| = 1
        rows = kernel.evaluate(values, digits=50)["theta"]
        solutions = [sp.Matrix([sp.Float(str(part), 50) for part in row]) for row in rows]
    for solution in solutions:
        assert (paper.rodrigues(rho, solution) - rho_prime).norm() < 1e-45  # 50 digits, less five
    assert min((solution - theta).norm() for solution in solutions) < 1e-45


# Derivatives and uncertainty
