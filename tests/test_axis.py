"""`rodgen.solve_axis` against answers that were found in other ways, and what must hold true of any answer.

Oracles: SciPy's root finders on the equation itself, SciPy's rotations, mpmath. Hypothesis looks for inputs that break
what holds true of every answer; families of degenerate inputs must have their status.
"""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from kernel_reference import KERNELS
from kinematics_cases import unit
from scipy.optimize import fsolve, minimize
from scipy.spatial.transform import Rotation

import rodgen
from rodgen import AxisStatus
from rodgen.generated import numpy as generated

EPS = float(np.finfo(float).eps)
LARGEST = float(np.finfo(float).max)
UNIT = 8 * EPS
"""A unit vector's length: three squares, a sum, and what made the components."""

RNG = np.random.default_rng(7)


def solvable(n: int, seed: int, low: float = 0.05, high: float = 3.0) -> tuple[np.ndarray, ...]:
    """Axes, points before and after, angles; nothing near a special case."""
    rng = np.random.default_rng(seed)
    axes, rho, angle = unit(rng.normal(size=(n, 3))), rng.normal(size=(n, 3)), rng.uniform(low, high, n)
    return axes, rho, Rotation.from_rotvec(axes * angle[:, None]).apply(rho), angle


def turn(points: np.ndarray, axes: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    return Rotation.from_rotvec(np.asarray(axes) * np.asarray(angle)[..., None]).apply(points)


# Oracles -------------------------------------------------------------------------------------------------


def test_fsolve_on_the_equation_finds_the_same_axes() -> None:
    """r = tan(χ/2) e x m with |e| = 1.

    fsolve wants three equations for three unknowns, so |e| = 1 takes the place of one component of r. What it finds may
    then be no root of that component: the spurious root. The residual of all four detects it.
    """
    _, rho, rho_prime, angle = solvable(40, 1)
    axes, status = rodgen.solve_axis(rho, rho_prime, angle)
    assert (status == AxisStatus.TWO_AXES).all()
    found = [set() for _ in range(len(rho))]
    spurious = 0
    for k, (x, y, chi) in enumerate(zip(rho, rho_prime, angle, strict=True)):
        m, r = y + x, y - x
        drop = int(np.argmax(np.abs(m)))  # for m . r = 0 its component follows best from the two others

        def equations(
            e: np.ndarray, m: np.ndarray = m, r: np.ndarray = r, t: float = math.tan(chi / 2), d: int = drop
        ):
            return [*np.delete(t * np.cross(e, m) - r, d), e @ e - 1]

        for start in RNG.normal(size=(12, 3)):
            e, _, success, _ = fsolve(equations, unit(start), xtol=1e-14, full_output=True)
            if success != 1 and np.abs(equations(e)).max() > 1e-10:
                continue
            if np.abs(math.tan(chi / 2) * np.cross(e, m) - r).max() > 1e-7 * np.abs(r).max():
                spurious += 1
                continue
            distance = np.linalg.norm(axes[k] - e, axis=1)
            # a simple root found to xtol; near double roots half the digits remain
            assert distance.min() < 1e-6
            found[k].add(int(distance.argmin()))
    assert sum(f == {0, 1} for f in found) >= 36  # from twelve starts fsolve mostly finds both


def test_rows_are_at_acute_and_obtuse_angle() -> None:
    _, rho, rho_prime, angle = solvable(2000, 6)
    sign = np.random.default_rng(6).choice([-1, 1], size=len(angle))
    pairs = (
        np.where(sign[:, None] > 0, rho, rho_prime),
        np.where(sign[:, None] > 0, rho_prime, rho),
        sign * angle,
    )
    axes, _ = rodgen.solve_axis(*pairs)
    along = np.einsum("nij,nj->ni", axes, pairs[0])
    assert (along[:, 0] > 0).all()
    assert (along[:, 1] < 0).all()


# Whatever the input --------------------------------------------------------------------------------------

sizes = st.one_of(
    st.floats(-10, 10),
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from([0.0, -0.0, 1.0, -1.0, 5e-324, 1e-310, 1e-200, 1e200, LARGEST, -LARGEST, 1e-160, 1e160]),
)
vectors = arrays(float, 3, elements=sizes)
angles = st.one_of(
    st.floats(-7, 7),
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from([0.0, -0.0, 5e-324, 1e-300, 1e-160, 1e-12, 1e-8, 1e3, 1e6, 1e15, 1e22, LARGEST]),
    st.integers(-9, 9).map(lambda k: k * math.pi),
    st.tuples(st.integers(-4, 4), st.floats(-1e-6, 1e-6)).map(lambda p: p[0] * math.pi + p[1]),
)
points = arrays(float, 3, elements=st.floats(-4, 4).map(lambda x: round(x, 3))).filter(
    lambda x: np.abs(x).max() > 0.01
)
axes_of_unit_length = points.map(unit)


@given(vectors, vectors, angles)
@settings(max_examples=240, deadline=None)
@example(np.zeros(3), np.zeros(3), 0.0)
@example(np.full(3, LARGEST), np.full(3, -LARGEST), math.pi)
@example(np.full(3, 5e-324), np.full(3, 5e-324), 1.0)
@example(np.full(3, 5e-324), np.full(3, LARGEST), 5e-324)
@example(np.ones(3), np.full(3, 3.0), 0.0)
@example(np.ones(3), np.full(3, 1e-160), 1e-11)
@example(np.full(3, 4e-149), np.full(3, -3.0), 2.0)
@example(np.array([1.0, 2, 3]), np.array([1.0, 2, 3]) * (1 + 3 * EPS), 1e-31)
@example(np.array([1.0, 2, 3]), np.array([-1.1, -2.2, -3.3]), math.pi)
@example(np.array([1.0, 2, 3]), np.array([-1.1, -2.2, -3.3]), 0.1)
def test_finite_input_gives_unit_axes_and_a_status(
    rho: np.ndarray, rho_prime: np.ndarray, angle: float
) -> None:
    axes, status = rodgen.solve_axis(rho, rho_prime, angle)
    assert status != AxisStatus.INVALID
    AxisStatus(int(status))
    assert np.abs(np.linalg.norm(axes, axis=1) - 1).max() <= UNIT


@pytest.mark.parametrize("length", [1.0, 1.1])
def test_nan_length_tolerance_is_invalid(length: float) -> None:
    """With it neither TWO_AXES nor LENGTHS_DIFFER would be true; an infinite one allows any lengths."""
    axes, status = rodgen.solve_axis([1.0, 0, 0], [0, length, 0], 2.0, length_tolerance=np.nan)
    assert status == AxisStatus.INVALID
    assert np.isnan(axes).all()
    axes, status = rodgen.solve_axis([1.0, 0, 0], [0, length, 0], 2.0, length_tolerance=np.inf)
    assert status == AxisStatus.TWO_AXES
    assert np.isfinite(axes).all()


@given(points, axes_of_unit_length, st.floats(-20, 20))
@settings(max_examples=200, deadline=None)
def test_round_trip(rho: np.ndarray, axis: np.ndarray, angle: float) -> None:
    """Both axes turn the point to where the generating axis did, to rounding times the arithmetic's few steps."""
    rho_prime = turn(rho, axis, angle)
    axes, status = rodgen.solve_axis(rho, rho_prime, angle)
    assume(status == AxisStatus.TWO_AXES)
    again = turn(np.array([rho, rho]), axes, np.full(2, angle))
    size = np.linalg.norm(rho)
    # the residual is |m| times the axis' error across m times sin χ/2: cond and sine cancel but for the tangent case,
    # where the root is cond times less exact and cond times less felt
    bound = 32 * EPS * size * (1 + abs(angle)) + 8 * EPS * size * abs(
        math.sin(angle / 2)
    ) * rodgen.axis_condition(rho, rho_prime, angle)
    assert np.abs(again - rho_prime).max() <= bound
    theta, _ = rodgen.rodrigues_vector(axes, np.full(2, angle))
    assert np.abs(rodgen.rotate(rho, theta) - rho_prime).max() <= bound


@given(points, axes_of_unit_length, st.floats(0.05, 3.0), axes_of_unit_length, st.floats(-3, 3))
@settings(max_examples=80, deadline=None)
def test_turned_input_gives_turned_axes(
    rho: np.ndarray, axis: np.ndarray, angle: float, other: np.ndarray, by: float
) -> None:
    rho_prime = turn(rho, axis, angle)
    axes, status = rodgen.solve_axis(rho, rho_prime, angle)
    condition = rodgen.axis_condition(rho, rho_prime, angle)
    assume(status == AxisStatus.TWO_AXES and condition < 1e4)
    q = Rotation.from_rotvec(by * other)
    turned, status = rodgen.solve_axis(q.apply(rho), q.apply(rho_prime), angle)
    assert status in (
        AxisStatus.TWO_AXES,
        AxisStatus.PARALLEL,
    )  # q rounds a motion of one eps away
    assert np.abs(turned - q.apply(axes)).max() <= 32 * EPS * max(condition, 1)


@given(points, axes_of_unit_length, st.floats(-8, 8), st.integers(-300, 300), st.booleans())
@settings(max_examples=120, deadline=None)
def test_unit_of_length_does_not_matter(
    rho: np.ndarray, axis: np.ndarray, angle: float, power: int, exact: bool
) -> None:
    rho_prime = turn(rho, axis, angle)
    factor = 2.0**power if exact else 10.0**power
    scaled = rho * factor, rho_prime * factor
    assume(
        min(np.abs(x[x != 0]).min() for x in scaled) > 1e-290
    )  # no digits are lost below the normal numbers
    axes, status = rodgen.solve_axis(rho, rho_prime, angle)
    others, other_status = rodgen.solve_axis(*scaled, angle)
    condition = rodgen.axis_condition(rho, rho_prime, angle)
    assume(condition < 1e5)
    close = (
        AxisStatus.TWO_AXES,
        AxisStatus.PARALLEL,
    )  # a power of ten rounds, and may move a point that stood still
    assert other_status == status or (not exact and status in close and other_status in close)
    # the shorter program of the usual case rounds in another order, so the last digits may differ
    assert np.abs(axes - others).max() <= 8 * EPS * max(condition, 1)


# Degenerate families -------------------------------------------------------------------------------------


def directions(n: int, seed: int) -> np.ndarray:
    special = [
        [1, 0, 0],
        [0, -1, 0],
        [0, 0, 1],
        [1, 1, 0],
        [0, 1, -1],
        [1, 2, -2],
        [1e-9, 1, 0],
        [1, 0, 1e-200],
    ]
    return np.concatenate(
        [unit(np.array(special, float)), unit(np.random.default_rng(seed).normal(size=(n, 3)))]
    )


LENGTHS = [1.0, 0.37, 1e3, 1e120, 1e-120, 1e-290, 1e300]


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("angle", [0.3, -1.0, math.pi / 2, 3.0, math.pi, -math.pi, 5.0, 40.0, 1e6])
def test_point_that_does_not_move_is_on_the_axis(length: float, angle: float) -> None:
    rho = length * directions(20, 1)
    axes, status = rodgen.solve_axis(rho, rho, angle)
    assert (status == AxisStatus.PARALLEL).all()
    direction = unit(rho / length)
    np.testing.assert_allclose(axes, np.stack([direction, -direction], axis=1), atol=4 * EPS)


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("angle", [math.pi, -math.pi, 3 * math.pi, 7 * math.pi])
def test_half_turn_to_the_opposite_point_leaves_every_axis_across(length: float, angle: float) -> None:
    rho = length * directions(20, 2)
    axes, status = rodgen.solve_axis(rho, -rho, angle)
    assert (status == AxisStatus.PERPENDICULAR).all()
    assert np.abs(np.einsum("nij,nj->ni", axes, rho / length)).max() <= 4 * EPS
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, atol=UNIT)


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("angle", [0.0, -0.0, 2 * math.pi, -4 * math.pi, 20 * math.pi])
def test_no_turn_and_no_motion_leaves_every_axis(length: float, angle: float) -> None:
    rho = length * directions(20, 3)
    axes, status = rodgen.solve_axis(rho, rho, angle)
    assert (status == AxisStatus.EVERY_AXIS).all()
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, atol=UNIT)


@pytest.mark.parametrize("angle", [0.0, 1.0, math.pi, -7.0, 1e10])
def test_two_points_at_the_origin_leave_every_axis(angle: float) -> None:
    axes, status = rodgen.solve_axis(np.zeros(3), np.zeros(3), angle)
    assert status == AxisStatus.EVERY_AXIS
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, atol=UNIT)


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.5, math.pi, -7.0, 1e10])
@pytest.mark.parametrize("length", LENGTHS)
def test_one_point_at_the_origin_has_no_axis(angle: float, length: float) -> None:
    x = length * np.array([1.0, 2.0, -2.0])
    for pair in ((x, np.zeros(3)), (np.zeros(3), x)):
        axes, status = rodgen.solve_axis(*pair, angle)
        assert status == AxisStatus.NO_AXIS
        np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, atol=UNIT)


@pytest.mark.parametrize("angle", [0.0, 2 * math.pi, 1e-300, 1e-160])
def test_no_turn_cannot_move_a_point(angle: float) -> None:
    _, status = rodgen.solve_axis([1.0, 0, 0], [0, 1.0, 0], angle)
    assert status == AxisStatus.NO_AXIS


@pytest.mark.parametrize("angle", [0.2, 1.0, 2.0, 3.0, -1.0, 2 * math.pi - 1.0])
@pytest.mark.parametrize("length", LENGTHS)
def test_tangent_points_have_one_axis(angle: float, length: float) -> None:
    """The point moves on a great circle: angle and angle between the points agree."""
    n = directions(20, 4)
    rho = length * unit(np.cross(n, np.roll(n, 1, axis=0)))
    rho_prime = length * turn(rho / length, n, angle)
    axes, status = rodgen.solve_axis(rho, rho_prime, angle)
    # rounding of the points leaves sin(χ/2 - a) within 4 bands of 0 (ONE_AXIS), or a hair above (two axes, √eps apart)
    assert np.isin(status, (AxisStatus.ONE_AXIS, AxisStatus.TWO_AXES)).all()
    assert (status == AxisStatus.ONE_AXIS).mean() > 0.5
    one = status == AxisStatus.ONE_AXIS
    assert np.array_equal(axes[one, 0], axes[one, 1])
    # the distance from the least-squares axis is the root of the rounding: √(8 eps (1 + χ/2)), over tan χ/2
    assert np.abs(axes - n[:, None]).max() <= 4 * math.sqrt(8 * EPS * (1 + abs(angle))) / abs(
        math.tan(angle / 2)
    )
    assert np.abs(axes[one, 0] - n[one]).max() <= 8 * EPS / abs(math.sin(angle / 2))


@pytest.mark.parametrize("length", LENGTHS)
def test_angle_too_small_gives_the_least_squares_axis(length: float) -> None:
    rng = np.random.default_rng(8)
    n = unit(rng.normal(size=(60, 3)))
    rho = unit(np.cross(n, rng.normal(size=(60, 3))))
    between = rng.uniform(0.3, 2.8, 60)
    rho_prime = turn(rho, n, between)
    angle = rng.uniform(0.05, 0.95, 60) * between * rng.choice([-1, 1], size=60)
    axes, status = rodgen.solve_axis(length * rho, length * rho_prime, angle)
    assert (status == AxisStatus.NO_AXIS).all()
    assert np.array_equal(axes[:, 0], axes[:, 1])
    np.testing.assert_allclose(axes[:, 0], np.sign(angle)[:, None] * n, atol=16 * EPS / 0.1)


def test_least_squares_axis_is_the_best_of_all_directions() -> None:
    """Brute force over the sphere, then a local search: nothing beats the returned axis."""
    rng = np.random.default_rng(9)
    k = np.arange(4000) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / 4000), np.pi * (1 + 5**0.5) * k
    sphere = np.stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=1
    )
    for chi in (0.4, -0.9, 1.5, 2 * math.pi - 0.5, -2 * math.pi + 1.0):
        rho, rho_prime = unit(rng.normal(size=3)), unit(rng.normal(size=3))
        folded = abs(math.remainder(chi, 2 * math.pi))
        if folded >= math.acos(rho @ rho_prime):
            rho_prime = unit(-rho + 0.3 * rho_prime)
        axes, status = rodgen.solve_axis(rho, rho_prime, chi)
        assert status == AxisStatus.NO_AXIS

        def miss(
            e: np.ndarray, rho: np.ndarray = rho, rho_prime: np.ndarray = rho_prime, chi: float = chi
        ) -> float:
            return float(np.sum((turn(rho, unit(e), chi) - rho_prime) ** 2))

        ours = miss(axes[0])
        moved = turn(np.tile(rho, (len(sphere), 1)), sphere, np.full(len(sphere), chi)) - rho_prime
        assert ours <= (moved**2).sum(axis=1).min() + 1e-12
        best = minimize(miss, sphere[(moved**2).sum(axis=1).argmin()], method="Nelder-Mead", tol=1e-14)
        assert ours <= best.fun + 1e-12
        residual = math.acos(rho @ rho_prime) - folded  # the angle that is left
        assert ours == pytest.approx(4 * math.sin(residual / 2) ** 2, rel=1e-9)


def test_opposite_points_and_a_smaller_angle_have_a_least_squares_axis_across() -> None:
    """There is no plane of the two points; every axis across is equally good."""
    rho = directions(20, 5)
    axes, status = rodgen.solve_axis(rho, -rho, 1.0)
    assert (status == AxisStatus.NO_AXIS).all()
    assert np.abs(np.einsum("nij,nj->ni", axes, rho)).max() <= 4 * EPS


@pytest.mark.parametrize("factor", [1 + 1e-7, 1 - 1e-7, 1.1, 3.0, 1e-5, 1e5, 1e100, 1e-100, 1e280])
def test_lengths_that_differ_have_a_status_and_are_solved(factor: float) -> None:
    """The axes are those for the point brought back to the sphere: the nearest that a rotation reaches."""
    _, rho, rho_prime, angle = solvable(100, 10)
    axes, _ = rodgen.solve_axis(rho, rho_prime, angle)
    others, other_status = rodgen.solve_axis(rho, factor * rho_prime, angle)
    assert (other_status == AxisStatus.LENGTHS_DIFFER).all()
    condition = np.maximum(rodgen.axis_condition(rho, rho_prime, angle), 1)
    assert (np.abs(axes - others).max(axis=(1, 2)) <= 8 * EPS * condition).all()
    mismatch = rodgen.length_mismatch(rho, factor * rho_prime)
    np.testing.assert_allclose(mismatch, factor - 1, rtol=1e-14, atol=8 * EPS)


NEAR_ONE = [1 + side * mismatch for mismatch in (1e-12, 1e-8, 1e-3, 0.3) for side in (1, -1)]


@pytest.mark.parametrize("factor", [*NEAR_ONE, 4.9, 7.0, 30.0, 1e5, 1e100, 1e280, 0.1, 1e-5, 1e-300])
def test_length_tolerance_is_the_mismatch_that_is_allowed(factor: float) -> None:
    _, rho, rho_prime, angle = solvable(20, 12)
    rho_prime = factor * rho_prime
    found = np.abs(rodgen.length_mismatch(rho, rho_prime))
    _, allowed = rodgen.solve_axis(rho, rho_prime, angle, length_tolerance=found * (1 + 8 * EPS) + 8 * EPS)
    _, refused = rodgen.solve_axis(rho, rho_prime, angle, length_tolerance=found * (1 - 8 * EPS) - 8 * EPS)
    assert (allowed == AxisStatus.TWO_AXES).all()
    assert (refused == AxisStatus.LENGTHS_DIFFER).all()
    _, any_length = rodgen.solve_axis(rho, rho_prime, angle, length_tolerance=np.inf)
    assert (any_length == AxisStatus.TWO_AXES).all()


@pytest.mark.parametrize("power", [-320, -315, -309, -300])
def test_lengths_below_the_normal_numbers(power: int) -> None:
    """Subnormal components have fewer digits; what they say is solved, and the status is that of the numbers there."""
    _, rho, rho_prime, angle = solvable(100, 12)
    factor = 10.0**power
    rho, rho_prime = rho * factor, rho_prime * factor
    axes, status = rodgen.solve_axis(rho, rho_prime, angle)
    up = 2.0**1000
    others, other_status = rodgen.solve_axis(rho * up, rho_prime * up, angle)
    assert np.array_equal(status, other_status)
    np.testing.assert_allclose(axes, others, atol=1e-12)


TINY = [(np.float64, angle) for angle in (1e-60, 1e-30, 1e-12, 1e-8)]
TINY += [(np.float32, angle) for angle in (3e-28, 1e-26, 1e-24, 1e-22, 1e-21, 1e-15, 1e-7)]


@pytest.mark.parametrize(("real", "angle"), TINY)
@pytest.mark.parametrize("solver", [rodgen.solve_axis, generated.ALL.solve_axis])
def test_tiny_angles(real: Any, angle: float, solver: Any) -> None:
    """The axis is found where the motion can be written as a difference of the points, its square too small or not."""
    rho, rho_prime = real([[0.0, 0.0, 1.0], [angle, 0.0, 1.0]])  # about y
    axes, status = solver(rho, rho_prime, real(2 * angle), length_tolerance=real(1e-6))
    assert axes.dtype == real
    assert status == AxisStatus.TWO_AXES
    # at twice the angle the axis is at 30 degrees from rho: sin γ = 1/2; in the first order of the angle
    room = angle + 4 * float(np.finfo(real).eps)
    np.testing.assert_allclose(axes, [[0, 0.5, 3**0.5 / 2], [0, 0.5, -(3**0.5) / 2]], atol=room)


@pytest.mark.parametrize("angle", [1e-64, 1e-100, 1e-160, 1e-300, 5e-324])
def test_angles_below_the_fourth_power_of_eps_are_no_turn(angle: float) -> None:
    """Their squares would leave the range; the motion they make is far below the machine epsilon of any other point."""
    _, status = rodgen.solve_axis([0.0, 0.0, 1.0], [angle, 0.0, 1.0], 2 * angle)
    assert status == AxisStatus.EVERY_AXIS
    _, status = rodgen.solve_axis([0.0, 0.0, 1.0], [1e-8, 0.0, 1.0], angle)
    assert status == AxisStatus.NO_AXIS


@pytest.mark.parametrize("angle", [1e3, 1e6, 1e15, 1e22])
def test_large_angles_are_taken_as_they_are(angle: float) -> None:
    """The angle is the floating-point number, not what it may have been rounded from."""
    with mpmath.workdps(60):
        folded = float(mpmath.fmod(mpmath.mpf(angle), 4 * mpmath.pi))
    rho = np.array([0.3, -0.2, 0.9])
    axis = unit(np.array([1.0, 2.0, 3.0]))
    rho_prime = turn(rho, axis, folded)
    axes, status = rodgen.solve_axis(rho, rho_prime, angle)
    same, same_status = rodgen.solve_axis(rho, rho_prime, folded)
    np.testing.assert_allclose(axes, same, atol=16 * EPS)
    if angle < 1e12:
        assert status == same_status == AxisStatus.TWO_AXES


# Lengths and condition -----------------------------------------------------------------------------------


def test_length_mismatch_with_many_digits() -> None:
    rng = np.random.default_rng(13)
    rho = rng.normal(size=(200, 3)) * 10.0 ** rng.integers(-150, 150, (200, 1))
    rho_prime = unit(rng.normal(size=(200, 3))) * np.linalg.norm(rho, axis=1, keepdims=True)
    rho_prime *= 1 + 10.0 ** rng.uniform(-16, 2, (200, 1))
    found = rodgen.length_mismatch(rho, rho_prime)
    with mpmath.workdps(50):
        for x, y, mismatch in zip(rho, rho_prime, found, strict=True):
            a, b = (mpmath.sqrt(sum(mpmath.mpf(float(c)) ** 2 for c in v)) for v in (x, y))
            exact = b / a - 1
            # the difference of the squares is a sum of three products, each rounded relative to |ρ|²
            assert abs(float(mismatch - exact)) <= 4 * EPS * (1 + abs(float(exact)))


@pytest.mark.parametrize(
    ("before", "after", "mismatch"), [(0, 0, 0), (0, 1, np.inf), (1, 0, -1), (2, 3, 0.5)]
)
def test_length_mismatch_of_special_lengths(before: float, after: float, mismatch: float) -> None:
    assert rodgen.length_mismatch([0, before, 0], [after, 0, 0]) == pytest.approx(mismatch, abs=4 * EPS)


def test_condition_is_one_over_twice_the_root_of_the_sines() -> None:
    _, rho, rho_prime, angle = solvable(500, 14)
    a = np.arctan2(np.linalg.norm(rho_prime - rho, axis=1), np.linalg.norm(rho_prime + rho, axis=1))
    expected = 1 / (2 * np.sqrt(np.sin(angle / 2 - a) * np.sin(angle / 2 + a)))
    # the difference h - a loses digits near the tangent, as cond² does
    found = rodgen.axis_condition(rho, rho_prime, angle)
    assert (np.abs(found / expected - 1) <= 16 * EPS * (1 + found**2)).all()


def test_condition_bounds_what_an_error_of_the_points_does() -> None:
    _, rho, rho_prime, angle = solvable(300, 15)
    axes, _ = rodgen.solve_axis(rho, rho_prime, angle)
    condition = rodgen.axis_condition(rho, rho_prime, angle)
    rng = np.random.default_rng(15)
    step = 1e-9
    worst = np.zeros(len(rho))
    for _ in range(40):
        size = step * np.linalg.norm(rho, axis=1, keepdims=True)
        moved, _ = rodgen.solve_axis(
            rho + size * unit(rng.normal(size=rho.shape)), rho_prime, angle, length_tolerance=1e-6
        )
        worst = np.maximum(worst, np.linalg.norm(moved - axes, axis=-1).max(axis=1) / step)
    ok = condition < 1e3  # the second order is cond³ step
    assert (worst[ok] <= 1.01 * condition[ok] + 1e-3).all()
    assert (worst[ok] >= 0.5 * condition[ok]).mean() > 0.9  # and it is no more than twice too large


def test_condition_is_infinite_without_two_axes() -> None:
    assert rodgen.axis_condition([1.0, 0, 0], [0, 1.0, 0], 1.0) == np.inf
    assert rodgen.axis_condition([1.0, 0, 0], [0, 1.0, 0], 0.0) == np.inf


def test_condition_is_infinite_where_the_axes_meet_to_rounding() -> None:
    """Where the status is ONE_AXIS, however rounding falls."""
    rng = np.random.default_rng(16)
    rho = unit(rng.normal(size=(2000, 3)))
    rho_prime = unit(rng.normal(size=(2000, 3)))
    angle = 2 * np.arctan2(
        np.linalg.norm(rho_prime - rho, axis=1), np.linalg.norm(rho_prime + rho, axis=1)
    ) * (1 + EPS * rng.integers(-3, 4, 2000))  # fmt: skip
    _, status = rodgen.solve_axis(rho, rho_prime, angle)
    assert (status == AxisStatus.ONE_AXIS).sum() > 1000
    assert np.isinf(rodgen.axis_condition(rho, rho_prime, angle)[status == AxisStatus.ONE_AXIS]).all()


def test_shapes_that_do_not_fit_together_are_named(refuses) -> None:
    refuses(rodgen.solve_axis, np.ones((3, 3)), np.ones((2, 3)), 1.0, raises=ValueError)


# Derivatives and covariance of the axes: against 50-digit differences, a closed form, and drawn noise


def sample(n: int, seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    axes, rho, angle = unit(rng.normal(size=(n, 3))), rng.normal(size=(n, 3)), rng.uniform(-3, 3, n)
    return rho, Rotation.from_rotvec(axes * angle[:, None]).apply(rho), angle


def with_inputs(name: str, numbers: np.ndarray | list) -> dict[str, object]:
    return {"rho": numbers[:3], "rho_prime": numbers[3:6], "angle": numbers[6], "length_tolerance": 1e-8}


def differences(numbers: np.ndarray, step: float = 1e-20) -> np.ndarray:
    """Central differences of the expression trees; with 50 digits only step² times the third derivative is left."""
    columns = []
    with mpmath.workdps(50):
        for k in range(7):
            values = []
            for sign in (1, -1):
                moved = [mpmath.mpf(float(x)) for x in numbers]
                moved[k] += sign * mpmath.mpf(step)
                values.append(KERNELS["solve_axis"].evaluate(with_inputs("solve_axis", moved))["axes"])
            columns.append((values[0] - values[1]) / (2 * mpmath.mpf(step)))
    return np.stack([c.astype(float) for c in columns], axis=-1)


@pytest.mark.thorough
def test_jacobian_is_that_of_the_solver() -> None:
    rho, rho_prime, angle = sample(5, 1)
    jacobian, status = rodgen.axis_jacobian(rho, rho_prime, angle)
    assert (status == AxisStatus.TWO_AXES).all()
    condition = rodgen.axis_condition(rho, rho_prime, angle)
    for k in range(len(rho)):
        exact = differences(np.array([*rho[k], *rho_prime[k], angle[k]]))
        # the derivatives have cond² in them, and rounding is felt once more
        assert np.abs(jacobian[k] - exact).max() <= 16 * EPS * max(condition[k], 1) ** 2 * np.abs(exact).max()


def test_jacobian_near_special_angles() -> None:
    """Angles near 0 and half turns; the closed form of the derivative, in many digits, is the other side."""
    rng = np.random.default_rng(3)
    for chi in (1e-6, 1e-3, math.pi - 1e-6, math.pi, -math.pi + 1e-9, 2 * math.pi + 1e-3, 50.0):
        e, rho = unit(rng.normal(size=3)), rng.normal(size=3)
        rho_prime = Rotation.from_rotvec(e * chi).apply(rho)
        jacobian, _ = rodgen.axis_jacobian(rho, rho_prime, chi)
        exact = differences(np.array([*rho, *rho_prime, chi]), 1e-25)
        condition = float(rodgen.axis_condition(rho, rho_prime, chi))
        assert np.abs(jacobian - exact).max() <= 32 * EPS * max(condition, 1) ** 2 * np.abs(exact).max()


def closed_form(
    rho: np.ndarray, rho_prime: np.ndarray, angle: float, axis: np.ndarray, sigma: float, of_angle: float
):
    """Covariance for equal, independent noise: two directions across the axis, r̂ and d = e x r̂."""
    r_hat = unit(rho_prime - rho)
    d = np.cross(axis, r_hat)
    sine, cosine = math.sin(angle / 2), axis @ unit(rho)
    points = sigma**2 / (2 * (rho @ rho) * sine**2) * (np.outer(r_hat, r_hat) + np.outer(d, d) / cosine**2)
    return points + of_angle**2 * (1 / cosine**2 - 1) / (4 * sine**2) * np.outer(d, d)


def test_covariance_is_the_closed_form_for_equal_noise() -> None:
    rho, rho_prime, angle = sample(100, 7)
    sigma, of_angle = 1e-3, 2e-4
    noise = sigma**2 * np.eye(3)
    covariance, _ = rodgen.axis_covariance(rho, rho_prime, angle, noise, noise, of_angle**2)
    axes, _ = rodgen.solve_axis(rho, rho_prime, angle)
    condition = np.maximum(rodgen.axis_condition(rho, rho_prime, angle), 1)
    for k in range(len(rho)):
        for row in range(2):
            expected = closed_form(rho[k], rho_prime[k], angle[k], axes[k, row], sigma, of_angle)
            bound = 64 * EPS * condition[k] ** 2 * np.abs(expected).max()
            assert np.abs(covariance[k, row] - expected).max() <= bound


def test_covariance_is_what_drawn_noise_makes() -> None:
    rng = np.random.default_rng(8)
    rho = np.array([2.0, 0.5, 1.0])
    angle = 1.1
    rho_prime = Rotation.from_rotvec(angle * unit(np.array([1.0, 2, 3]))).apply(rho)
    roots = 1e-4 * rng.normal(size=(2, 3, 3))
    cov_rho, cov_rho_prime = roots @ roots.swapaxes(1, 2)
    of_angle = 1e-4
    n = 200_000
    axes, status = rodgen.solve_axis(
        rng.multivariate_normal(rho, cov_rho, n),
        rng.multivariate_normal(rho_prime, cov_rho_prime, n),
        rng.normal(angle, of_angle, n),
        length_tolerance=0.01,
    )
    assert (status == AxisStatus.TWO_AXES).all()
    covariance, _ = rodgen.axis_covariance(rho, rho_prime, angle, cov_rho, cov_rho_prime, of_angle**2)
    for row in range(2):
        drawn = np.cov(axes[:, row].T)
        # an entry of a covariance from n draws is off by √(2/n) of the variances, 0.3 %; 5 of these
        scale = np.sqrt(np.outer(np.diag(covariance[row]), np.diag(covariance[row])))
        assert (np.abs(drawn - covariance[row]) <= 5 * math.sqrt(2 / n) * scale).all()


@pytest.mark.parametrize("of_angle", [0.0, 0.1])
def test_exact_points_have_no_covariance_but_the_angles(of_angle: float) -> None:
    covariance, _ = rodgen.axis_covariance(
        [2.0, 0, 1], [0, 2.0, 1], 1.0 + math.pi / 2, np.zeros((3, 3)), np.zeros((3, 3)), of_angle
    )
    assert (np.trace(covariance, axis1=-2, axis2=-1) > 0).all() == (of_angle > 0)


# The accuracy that the documentation promises, family by family: its bound, in cond eps, on every backend


PROMISE = 4
SCRIPT = Path(__file__).parents[1] / "docs/science/make_accuracy.py"


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


accuracy = load(SCRIPT)
every_family = pytest.mark.parametrize("family", accuracy.FAMILIES, ids=lambda f: f.name)
COUNT = 200


@pytest.mark.thorough("\\u03c7 ~ 1e-160", "\\u03c7 ~ 1e-4", "\\u03c1 within 1e-8 of the axis")
@every_family
def test_compiled_kernels_keep_the_promise(family: object) -> None:
    assert accuracy.measure(accuracy.gufunc, family.name, count=COUNT).worst <= family.bound


@pytest.mark.thorough("\\\\u03c7 ~ 1e-4", "\\\\u03c7 ~ 1e-160", "\\\\u03c1 within 1e-8 of the axis")
@every_family
def test_numpy_keeps_the_promise(family: object) -> None:
    assert accuracy.measure(accuracy.numpy_module, family.name, count=COUNT).worst <= family.bound


@pytest.mark.thorough("avx512")
@pytest.mark.parametrize("level", ["baseline", "avx2", "avx512"])
def test_every_instruction_set_keeps_the_promise(level: str, gufuncs: dict[str, ModuleType]) -> None:
    if level not in gufuncs:
        pytest.skip(f"this processor or build has no {level}")

    def solve(rho: np.ndarray, rho_prime: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        axes, status = gufuncs[level].solve_axis(rho, rho_prime, angle, 1e-8)
        return axes, ~np.isin(status, (1, 2))

    worst = {f.name: accuracy.measure(solve, f.name, count=COUNT).worst / f.bound for f in accuracy.FAMILIES}
    assert {name: w for name, w in worst.items() if not w <= 1} == {}


@pytest.mark.thorough
def test_emitted_c_keeps_the_promise(compiler: str, tmp_path: Path) -> None:
    solve = accuracy.emitted_c(tmp_path)
    worst = {f.name: accuracy.measure(solve, f.name, count=COUNT).worst / f.bound for f in accuracy.FAMILIES}
    assert {name: w for name, w in worst.items() if not w <= 1} == {}


@pytest.mark.thorough("numpy_module")
@pytest.mark.parametrize("solver", ["gufunc", "numpy_module"])
def test_float32_keeps_the_promise(solver: str) -> None:
    solve, families = getattr(accuracy, solver), [f for f in accuracy.FAMILIES if f.float32]
    worst = {f.name: accuracy.measure(solve, f.name, 32, COUNT).worst / f.bound for f in families}
    assert {name: w for name, w in worst.items() if not w <= 1} == {}


@every_family
def test_nearly_every_input_has_its_two_axes(family: object) -> None:
    """The promise is not kept by calling inputs tangent.

    Only near tangent the rounding of the angle decides: where the half angles of rotation and of the points differ by
    less than eps (1 + χ/2), a condition of more than 1/√(2 eps (1 + χ/2)) / 2. Those are few, and none are others.
    """
    (_, _, angle), _, condition = accuracy.sample(family.name, 64, COUNT)
    _, two = accuracy.gufunc(*accuracy.sample(family.name, 64, COUNT)[0])
    # cond² = 1/(4 sin(h - a) sin(h + a)), and the band is sin(h - a) <= eps (1 + |h|) with h + a < 2 h
    half = np.abs(angle / 2)
    limit = 1 / np.sqrt(32 * 2.0**-52 * (1 + half) * np.maximum(np.abs(np.sin(half) * np.cos(half)), 1e-300))
    assert (two | (condition > limit)).all()


def test_the_worst_known_input_keeps_the_bound_of_its_family() -> None:
    """Twice the promise of other families: ρ′ is eight times as long, which still shares the power of two of ρ."""
    rho = np.array([-0.17720370258564225, 0.9956020377467981, 0.8309719457767204])
    rho_prime, angle = (
        np.array([4.968331747251806, -9.062944462197933, -1.6791693686925002]),
        3.022925442674012,
    )
    (family,) = (f for f in accuracy.FAMILIES if f.bound != PROMISE)
    exact, condition = accuracy.exact_axes(rho, rho_prime, angle)
    axes, _ = accuracy.gufunc(rho, rho_prime, angle)
    assert np.linalg.norm(axes - exact, axis=-1).max() <= family.bound * condition * 2.0**-52


@pytest.mark.slow
def test_paper_form_loses_digits_where_the_facts_say() -> None:
    """The reference and the measure are not blind: the published formulas fail where they must."""
    worst = {
        name: accuracy.measure(accuracy.paper, name, count=COUNT, any_order=True).median
        for name in ("generic", "χ ~ 1e-4", "χ ~ 1e-8", "χ = π - 1e-8")
    }
    assert worst["generic"] < 20
    assert worst["χ ~ 1e-4"] > 1e6
    assert worst["χ ~ 1e-8"] > 1e14
    assert worst["χ = π - 1e-8"] > 1e6
