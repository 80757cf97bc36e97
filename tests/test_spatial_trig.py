"""A cos θ + B sin θ + D = 0: both angles, every kind of equation, and how many digits are right.

The reference is the same formula with 50 digits. An angle may be off by a few times the machine epsilon, and by what
a relative change of the coefficients by the machine epsilon makes of it: 1/g times that with g = √(1 - D²/r²).
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from rodgen.kinematics import spatial
from rodgen.kinematics.spatial import TrigStatus

EPS = np.finfo(float).eps


def exact(A: float, B: float, D: float) -> tuple[list[float], float]:
    """γ + h and γ - h, and g."""
    with mpmath.workdps(50):
        a, b, d = (mpmath.mpf(float(x)) for x in (A, B, D))
        r = mpmath.hypot(a, b)
        gamma, half = mpmath.atan2(b, a), mpmath.acos(-d / r)
        angles = [gamma + half, gamma - half]
        return [float(x - 2 * mpmath.pi * mpmath.nint(x / (2 * mpmath.pi))) for x in angles], float(
            mpmath.sqrt(1 - (d / r) ** 2)
        )


def off(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Difference of angles, whole turns apart from each other being none."""
    return np.abs(np.remainder(found - wanted + np.pi, 2 * np.pi) - np.pi)


@pytest.mark.parametrize("gap", [None, 1e-3, 1e-6, 1e-9, 1e-12])
def test_angles_are_right_to_their_condition(gap):
    rng = np.random.default_rng(1)
    A, B = rng.normal(size=(2, 60))
    D = rng.uniform(-1, 1, size=60) * np.hypot(A, B)
    if gap is not None:
        D = np.sign(D) * np.hypot(A, B) * (1 - gap)
    theta, status = spatial.solve_trig(A, B, D)
    assert (status == TrigStatus.TWO).all()
    for found, row in zip(theta, zip(A, B, D, strict=True), strict=True):
        wanted, g = exact(*row)
        assert (off(found, wanted) <= 4 * EPS * (1 + 1 / g)).all()


@pytest.mark.parametrize("gap", [0.0, 1e-15, 1e-12, 1e-9, 1e-6, -1e-15, -1e-9])
def test_a_root_at_infinity_is_an_angle_like_any_other(gap):
    """D = A, and near it: the notes' quadratic divides by D - A; one angle is π, and both keep all their digits."""
    rng = np.random.default_rng(2)
    A, B = rng.normal(size=(2, 40))
    D = A * (1 + gap)
    theta, status = spatial.solve_trig(A, B, D)
    assert (status == TrigStatus.TWO).all()
    for found, row in zip(theta, zip(A, B, D, strict=True), strict=True):
        wanted, g = exact(*row)
        assert (off(found, wanted) <= 4 * EPS * (1 + 1 / g)).all()
    if gap == 0:
        assert (off(theta, np.pi).min(axis=-1) <= 4 * EPS).all()


def test_every_kind_of_equation_has_its_status():
    cases = {
        (1, 2, 0.5): TrigStatus.TWO,
        (3, 4, 5): TrigStatus.DOUBLE,
        (3, 4, -5): TrigStatus.DOUBLE,
        (1, 0, 1): TrigStatus.DOUBLE,
        (-2, 0, 2): TrigStatus.DOUBLE,
        (0, -1, 1): TrigStatus.DOUBLE,
        (3, 4, 5.001): TrigStatus.INFEASIBLE,
        (3, 4, -6): TrigStatus.INFEASIBLE,
        (0, 0, 0): TrigStatus.ALL,
        (0, 0, 1): TrigStatus.NONE,
        (0, 0, -1e-300): TrigStatus.NONE,
        (1e-160, 0, 1e300): TrigStatus.INFEASIBLE,
        (np.nan, 1, 1): TrigStatus.INVALID,
        (1, np.inf, 1): TrigStatus.INVALID,
        (1, 1, np.nan): TrigStatus.INVALID,
    }
    theta, status = spatial.solve_trig(*np.array(list(cases), float).T)
    assert status.tolist() == list(cases.values())
    assert status.dtype == np.int8
    there = np.isin(status, [TrigStatus.TWO, TrigStatus.DOUBLE])
    assert (np.isfinite(theta).all(axis=-1) == there).all()
    assert np.isnan(theta[~there]).all()
    double = theta[status == TrigStatus.DOUBLE]
    assert (double[:, 0] == double[:, 1]).all()
    np.testing.assert_allclose(double[:2, 0], [np.arctan2(-4, -3), np.arctan2(4, 3)], atol=4 * EPS)
    np.testing.assert_allclose(double[2:, 0], [np.pi, 0, np.pi / 2], atol=4 * EPS)


@pytest.mark.parametrize("sign", [1, -1])
def test_one_angle_near_d_equal_a(sign):
    """B so small that the two angles near π, or near 0, are one to rounding: whatever rounding makes of D - A."""
    rng = np.random.default_rng(6)
    B = np.concatenate([10.0 ** rng.uniform(-20, -9, size=300) * rng.choice([-1, 1], size=300), [0.0, 0.0]])
    A = 1 + EPS * rng.integers(-1, 2, size=302)
    D = sign * (1 + EPS * rng.integers(-1, 2, size=302))
    theta, status = spatial.solve_trig(A, B, D)
    double = status == TrigStatus.DOUBLE
    assert double.mean() > 0.5
    assert (theta[double, 0] == theta[double, 1]).all()
    # the angles are within √(D² - A² + B²) of π or 0, and the equation holds to rounding
    assert off(theta[double, 0], np.pi if sign > 0 else 0.0).max() < 1e-7
    miss = A[:, None] * np.cos(theta) + B[:, None] * np.sin(theta) + D[:, None]
    assert np.abs(miss[double]).max() <= 8 * EPS


def test_rounding_does_not_make_a_tangent_case_infeasible():
    """|D| = r up to rounding, of many sizes: one angle, of either rounding of r."""
    rng = np.random.default_rng(3)
    A, B = rng.normal(size=(2, 2000)) * 10.0 ** rng.uniform(-20, 20, size=2000)
    r = np.hypot(A, B)
    for D in (r, -r, np.nextafter(r, 0), np.nextafter(r, np.inf)):
        theta, status = spatial.solve_trig(A, B, D)
        assert (status == TrigStatus.DOUBLE).all()
        miss = A * np.cos(theta[:, 0]) + B * np.sin(theta[:, 0]) + D
        assert (np.abs(miss) <= 8 * EPS * r).all()


def test_size_of_the_coefficients_does_not_matter():
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(3, 200))
    rows[2] *= 0.5
    theta, status = spatial.solve_trig(*rows)
    for power in (-1000, -500, 500, 1000):
        again, its = spatial.solve_trig(*np.ldexp(rows, power))
        np.testing.assert_array_equal(its, status)
        np.testing.assert_array_equal(again, theta)


def test_both_angles_are_continuous():
    # along a line through the plane of (A, B) both angles move without a jump
    t = np.linspace(0, 2 * np.pi, 20_001)
    theta, _ = spatial.solve_trig(np.cos(t), np.sin(t), 0.9 * np.sin(3 * t))
    assert off(theta[1:], theta[:-1]).max() < 0.01


def test_interface():
    theta, status = spatial.solve_trig(np.ones((2, 1)), 2.0, [0.0, 0.5, 1.0])
    assert theta.shape == (2, 3, 2)
    assert status.shape == (2, 3)
    out = np.empty((3, 2)), np.empty(3, np.int8)
    found = spatial.solve_trig(1.0, 2.0, [0.0, 0.5, 1.0], out=out)
    assert found[0] is out[0]
    assert found[1] is out[1]
    np.testing.assert_array_equal(out[0], theta[0])
    single, _ = spatial.solve_trig(*(np.float32(x) for x in (1.0, 2.0, 0.5)))
    assert single.dtype == np.float32
    with pytest.raises(TypeError, match="A has type complex128; expected real numbers"):
        spatial.solve_trig(1j, 2.0, 0.5)
    with pytest.raises(TypeError, match="B has type <U1; expected real numbers"):
        spatial.solve_trig(1.0, ["x"], 0.5)
    with pytest.raises(ValueError, match=r"A \(3,\) and D \(2,\) do not fit together"):
        spatial.solve_trig(np.ones(3), 2.0, np.ones(2))
