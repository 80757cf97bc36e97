"""The derivation of the Rodrigues equation: complete, closed, and right in numbers as well.

The proofs are exact. Here the same statements are held against floating-point numbers, against SciPy's
rotations and against finite differences, none of which the proofs use.
"""

from fractions import Fraction
from functools import cache
from math import isqrt

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


@pytest.mark.thorough("eq-2", "eq-3", "eq-4")
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


def halton(count):
    """Vectors θ and ρ with rational components that fill the cube from -1 to 1 evenly."""
    points = np.empty((count, 6), dtype=object)
    for column, base in enumerate((2, 3, 5, 7, 11, 13)):
        for number in range(1, count + 1):
            value, weight, rest = Fraction(0), Fraction(1, base), number
            while rest:
                rest, digit = divmod(rest, base)
                value += digit * weight
                weight /= base
            points[number - 1, column] = 2 * value - 1
    return points[:, :3], points[:, 3:]


def exact_root(square):
    root = Fraction(isqrt(square.numerator), isqrt(square.denominator))
    assert root * root == square
    return root


def rotated(rho, theta):
    once = np.cross(theta, rho)
    return rho + (once + np.cross(theta, once) / 2) / (1 + (theta * theta).sum(-1, keepdims=True) / 4)


def count_printed(count):
    """Count on how many of `count` inputs the printed algorithm satisfies (1) and returns its input."""
    theta, rho = halton(count)
    rho_prime = rotated(rho, theta)
    usable = np.cross(rho, rho_prime)[:, 2] != 0
    theta, rho, rho_prime = theta[usable], rho[usable], rho_prime[usable]
    root = np.vectorize(exact_root, otypes=[object])
    answer = papers_theta(rho, rho_prime, (theta * theta).sum(-1), 1, lambda w3: 1, root)
    valid, acute = (rotated(rho, answer) == rho_prime).all(-1), (theta * rho).sum(-1) > 0
    return {
        "inputs": len(theta),
        "satisfies (1)": valid.sum(),
        "is the given θ": (answer == theta).all(-1).sum(),
        "γ acute": acute.sum(),
        "acute and satisfies": (valid & acute).sum(),
    }


@pytest.mark.thorough
def test_exact_count_of_the_printed_sign_is_near_one_half_and_one_quarter():
    counts = count_printed(400)
    spread = 4 * np.sqrt(0.25 / counts["inputs"])
    assert abs(counts["satisfies (1)"] / counts["inputs"] - 0.5) < spread
    assert abs(counts["is the given θ"] / counts["inputs"] - 0.25) < spread
    assert abs(counts["acute and satisfies"] / counts["γ acute"] - 0.5) < 2 * spread


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


@cache
def axis_function():
    free = [*paper.rho, *paper.rho_prime, paper.kappa, paper.side]
    return sp.lambdify(free, list(paper.derivation.value(paper.both_axes)), "mpmath")


def unit_axis(values):
    """Axis for directions only: ρ′ is rescaled to the length of ρ."""
    before, after = mpmath.matrix(values[:3]), mpmath.matrix(values[3:6])
    after *= mpmath.norm(before) / mpmath.norm(after)
    return mpmath.matrix(axis_function()(*before, *after, mpmath.cot(values[6] / 2), values[7]))


@pytest.fixture(params=[1, -1], ids=["plus", "minus"])
def case(request):
    """A point, its image and the angle, the axis found, and its derivatives by central differences."""
    with mpmath.workdps(50):
        axis = mpmath.matrix(["0.36", "-0.48", "0.8"])
        values = [mpmath.mpf(x) for x in ("0.7", "0.2", "1.1")]
        angle = mpmath.mpf("1.3")
        rotation = Rotation.from_rotvec(float(angle) * np.array([float(x) for x in axis]))
        after = rotation.apply([float(x) for x in values])
        values += [mpmath.mpf(float(x)) for x in after] + [angle, mpmath.mpf(request.param)]
        step, columns = mpmath.mpf(10) ** -15, []
        for index in range(7):
            ahead, behind = list(values), list(values)
            ahead[index] += step
            behind[index] -= step
            columns.append((unit_axis(ahead) - unit_axis(behind)) / (2 * step))
        difference = np.array([[float(column[i]) for column in columns] for i in range(3)])
        found = unit_axis(values)
    return np.array([float(v) for v in values]), np.array([float(x) for x in found]), difference


def evaluate(letter, values, axis):
    """Value of a matrix of the derivation at a pair of points, the angle's cotangent and the axis found."""
    notes = sensitivity
    formula = sp.Matrix(notes.derivation.value(letter))
    symbols = [*notes.rho, *notes.rho_prime, notes.kappa, *notes.e]
    length = np.linalg.norm(values[:3]) / np.linalg.norm(values[3:6])
    scaled = [*values[:3], *(values[3:6] * length), 1 / np.tan(values[6] / 2), *axis]
    return np.array(sp.lambdify(symbols, formula, "numpy")(*scaled), dtype=float)


@pytest.mark.thorough("plus")
def test_derivatives_agree_with_differences_for_any_direction_of_the_axis(case):
    values, axis, difference = case
    letters = (sensitivity.by_rho, sensitivity.by_rho_prime, sensitivity.by_angle)
    closed = np.hstack([evaluate(letter, values, axis) for letter in letters])
    # Differences at 50 digits with a step of 1e-15 are exact in float64; the inputs' lengths agree to 1e-16.
    np.testing.assert_allclose(closed, difference, rtol=0, atol=1e-13)


def test_covariance_and_condition_hold_for_any_direction_of_the_axis(case):
    values, axis, difference = case
    rho, r, angle = values[:3], values[3:6] - values[:3], values[6]
    cos_gamma = axis @ rho / np.linalg.norm(rho)
    r_hat = r / np.linalg.norm(r)
    across = np.cross(axis, r_hat)
    sigma, sigma_angle, half_sine = 0.3, 0.2, np.sin(angle / 2)
    expected = sigma**2 / (2 * rho @ rho * half_sine**2) * (
        np.outer(r_hat, r_hat) + np.outer(across, across) / cos_gamma**2
    ) + sigma_angle**2 * (1 / cos_gamma**2 - 1) / (4 * half_sine**2) * np.outer(across, across)
    noise = np.diag([sigma] * 6 + [sigma_angle]) ** 2
    np.testing.assert_allclose(difference @ noise @ difference.T, expected, rtol=0, atol=1e-13)
    largest = np.linalg.svd(difference[:, :3])[1][0] * np.linalg.norm(rho)
    assert largest == pytest.approx(1 / (2 * half_sine * abs(cos_gamma)), rel=1e-12)
    half_between = np.arccos(rho @ values[3:6] / (rho @ rho)) / 2
    gap = np.sin(angle / 2 - half_between) * np.sin(angle / 2 + half_between)
    assert largest == pytest.approx(1 / (2 * np.sqrt(gap)), rel=1e-12)


def test_no_axis_comes_closer_than_n_where_the_angle_is_too_small():
    generator = np.random.default_rng(3)
    before, after, angle = np.array([1.0, 0, 0]), np.array([0.0, 1, 0]), 0.9  # a right angle apart
    axes = generator.normal(size=(20000, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    reached = Rotation.from_rotvec(angle * axes).apply(before) @ after
    best = Rotation.from_rotvec([0, 0, angle]).apply(before) @ after
    assert best == pytest.approx(np.cos(np.pi / 2 - angle), rel=1e-12)
    assert reached.max() <= best + 1e-15
