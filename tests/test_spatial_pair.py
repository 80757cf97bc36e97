"""Two equations in two angles, and one in one: all solutions, with the right status, whatever the equations.

What is found is compared with all roots of the octic at 60 digits (pair_reference), and with equations made for chosen
solutions: nine coefficients, so two equations through seven points have an eighth solution, and all eight are real.

A cos θ + B sin θ + D = 0 is compared with the same formula with 50 digits. An angle may be off by a few times the
machine epsilon, and by what a relative change of the coefficients by the machine epsilon makes of it: 1/g times that
with g = √(1 - D²/r²).
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from pair_reference import all_angles

from rodgen.kinematics import spatial
from rodgen.kinematics.spatial import ReverseStatus, TrigStatus, pair_equations
from rodgen.kinematics.spatial.pair_solutions import certain_solutions

EPS = np.finfo(float).eps
methods = pytest.mark.parametrize("method", ["fast", "sylvester"])


def basis(angle):
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=-1)


def slope(angle):
    return np.stack([np.zeros_like(angle), -np.sin(angle), np.cos(angle)], axis=-1)


def products(u, v):
    return (u[..., :, None] * v[..., None, :]).reshape(*u.shape[:-1], 9)


def values(M, pair):
    """Both equations at every slot."""
    u, v = basis(pair.theta1), basis(pair.theta2)
    return np.einsum("...eij,...ki,...kj->...ke", M, u, v)


def angles_of(pair):
    return np.stack([pair.theta1, pair.theta2], axis=-1)


def off(found, wanted):
    return np.abs(np.remainder(found - wanted + np.pi, 2 * np.pi) - np.pi)


def through(rng, points, tangents=0):
    """Two random equations (n, 2, 3, 3) that hold at points (n, k, 2), and at the first ones along a direction, too."""
    a, b = points[..., 0], points[..., 1]
    rows = products(basis(a), basis(b))
    if tangents:
        a, b = a[:, :tangents], b[:, :tangents]
        direction = rng.normal(size=(2, *a.shape, 1))
        along = products(direction[0] * slope(a), basis(b)) + products(basis(a), direction[1] * slope(b))
        rows = np.concatenate([rows, along], axis=1)
    null = np.linalg.svd(rows)[2][:, rows.shape[1] :]
    return (rng.normal(size=(len(rows), 2, null.shape[1])) @ null).reshape(-1, 2, 3, 3)


def nearest(pair, points):
    """How far the nearest solution is from each point (n, k, 2)."""
    distance = off(angles_of(pair)[:, None], points[:, :, None]).max(axis=-1)
    return np.nan_to_num(distance, nan=9.0).min(axis=-1)


# all solutions, and no others ---------------------------------------------------------------------------------------


@pytest.mark.thorough("random-fast")
@methods
@pytest.mark.parametrize("spread", [0, 3], ids=["random", "badly scaled"])
def test_all_solutions_are_those_with_60_digits(method, spread):
    rng = np.random.default_rng(1)
    M = rng.normal(size=(12, 2, 3, 3)) * 10.0 ** rng.uniform(-spread, spread, size=(12, 2, 3, 3))
    pair = spatial.solve_pair(M, method=method)
    for m, found, status in zip(M, angles_of(pair), pair.status, strict=True):
        wanted = all_angles(m)
        there = status == ReverseStatus.REGULAR
        assert there.sum() == len(wanted)
        assert (status[~there] == ReverseStatus.NONE).all()
        assert np.isnan(found[~there]).all()
        # condition numbers are up to 1e3 here
        assert (off(found[there], wanted) <= 1e3 * EPS).all()


@methods
def test_eight_real_solutions(method):
    rng = np.random.default_rng(2)
    points = rng.uniform(-np.pi, np.pi, size=(200, 7, 2))
    M = through(rng, points)
    pair = spatial.solve_pair(M, method=method)
    assert (pair.status == ReverseStatus.REGULAR).all()
    # equations through seven points are ill conditioned; a null space in float64 is, too
    assert nearest(pair, points).max() < 1e-8
    assert np.abs(values(M, pair)).max() < 1e-14


def test_every_double_root_of_the_octic():
    """Equations that hold for θ2 and for -θ2: the octic is a square, with real roots at which no θ2 is real."""
    rng = np.random.default_rng(5)
    M = rng.normal(size=(300, 2, 3, 3))
    M[..., 2] = 0
    pair = spatial.solve_pair(M)
    count = (pair.status == ReverseStatus.REGULAR).sum(axis=-1)
    assert (count % 2 == 0).all()
    assert {0, 2, 4} <= set(count.tolist())
    assert not (pair.status == ReverseStatus.INCOMPLETE).any()
    mirrored = np.stack([pair.theta1, -pair.theta2], axis=-1)
    there = pair.status == ReverseStatus.REGULAR
    assert nearest(pair, mirrored)[there].max() < 1e-9
    # cos θ2 by Cramer's rule on a fine grid of θ1: as many zeros as pairs of solutions
    grid = np.linspace(-np.pi, np.pi, 4001)
    rows = np.einsum("neij,ki->nkej", M[..., :2], basis(grid))
    det = rows[..., 0, 0] * rows[..., 1, 1] - rows[..., 0, 1] * rows[..., 1, 0]
    change = det[:, 1:] * det[:, :-1] < 0
    cosine = -rows[..., 0, 0] / rows[..., 0, 1]
    zeros = (change & (np.abs(cosine[:, 1:]) < 1) & (np.abs(rows[:, 1:, 0, 1]) > 1e-2)).sum(axis=-1)
    clear = (np.abs(np.abs(cosine[:, 1:]) - 1) > 0.02) | ~change
    settled = clear.all(axis=-1) & ((np.abs(rows[:, 1:, 0, 1]) > 1e-2) | ~change).all(axis=-1)
    assert settled.sum() > 200
    np.testing.assert_array_equal(count[settled], 2 * zeros[settled])


# solutions that meet ------------------------------------------------------------------------------------------------


@methods
def test_two_solutions_that_meet_are_one_double(method):
    rng = np.random.default_rng(6)
    points = rng.uniform(-np.pi, np.pi, size=(100, 4, 2))
    pair = spatial.solve_pair(through(rng, points, tangents=1), method=method)
    double = pair.status == ReverseStatus.DOUBLE
    assert (double.sum(axis=-1) >= 1).all()
    assert (nearest(pair, points)[:, 1:] < 1e-8).mean() > 0.99
    # rounding of the coefficients moves a double solution by the root of that, times the condition of the equations
    assert np.quantile(nearest(pair, points)[:, 0], 0.95) < 1e-6
    assert not (pair.status == ReverseStatus.INCOMPLETE).any()


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-8])
def test_nearly_double_solutions_are_not_lost(distance):
    rng = np.random.default_rng(7)
    points = rng.uniform(-np.pi, np.pi, size=(100, 5, 2))
    points[:, 1] = points[:, 0] + distance * rng.normal(size=(100, 2))
    pair = spatial.solve_pair(through(rng, points))
    assert not (pair.status == ReverseStatus.INCOMPLETE).any()
    assert np.quantile(nearest(pair, points), 0.99) < max(1e-6, 4 * distance)
    assert ((pair.status <= ReverseStatus.DOUBLE).sum(axis=-1) >= 4).all()


@pytest.mark.thorough("fast")
@methods
def test_no_solution_is_counted_twice(method):
    """Small whole coefficients, where three and more solutions meet in many rows."""
    M = np.random.default_rng(22).integers(-1, 2, size=(800, 2, 3, 3)).astype(float)
    pair = spatial.solve_pair(M, method=method)
    family = (pair.status == ReverseStatus.FAMILY).any(axis=-1)
    alone, double = (
        (pair.status[~family] == kind).sum(axis=-1) for kind in (ReverseStatus.REGULAR, ReverseStatus.DOUBLE)
    )
    assert double.any()
    assert (alone + 2 * double <= 8).all()
    # where four meet, rounding parts them by up to the fourth root of eps, and two doubles may be left
    parted = np.zeros(len(M), bool)
    expected = spatial.solve_pair(M)
    for found in (pair, expected):
        angles = angles_of(found)
        distance = off(angles[:, :, None], angles[:, None]).max(axis=-1) + 9 * np.eye(8)
        row, k, j = np.nonzero(distance < 1e-4)
        assert (found.status[row, [k, j]] == ReverseStatus.DOUBLE).all()
        parted[row] = True
    assert parted.sum() <= 4
    np.testing.assert_array_equal(np.sort(pair.status[~parted]), np.sort(expected.status[~parted]))


def test_signs_of_the_determinants_balance():
    """A torus has no boundary: regular solutions come with either sign of the determinant equally often."""
    M = np.random.default_rng(8).normal(size=(3000, 2, 3, 3))
    pair = spatial.solve_pair(M)
    u, v = basis(pair.theta1), basis(pair.theta2)
    a = np.einsum("neij,nki,nkj->nke", M, slope(pair.theta1), v)
    b = np.einsum("neij,nki,nkj->nke", M, u, slope(pair.theta2))
    signs = np.sign(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
    assert (np.nansum(signs, axis=-1) == 0).all()


# common factors -----------------------------------------------------------------------------------------------------


def outer(a, b):
    return np.einsum("...i,...j->...ij", a, b)


def holds_on_family(M, pair):
    """At a representative the equations hold, and the derivatives are dependent."""
    slots = pair.status == ReverseStatus.FAMILY
    u, v = basis(pair.theta1), basis(pair.theta2)
    a = np.einsum("neij,nki,nkj->nke", M, slope(pair.theta1), v)
    b = np.einsum("neij,nki,nkj->nke", M, u, slope(pair.theta2))
    determinant = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.abs(values(M, pair)[slots]).max() < 1e-13 and np.abs(determinant[slots]).max() < 1e-12


def test_a_factor_of_one_angle():
    """(α·u)(β_e·v): every θ2 at two θ1, or nothing; and the same with the angles exchanged."""
    rng = np.random.default_rng(9)
    a, b = rng.normal(size=(40, 3)), rng.normal(size=(40, 2, 3))
    solvable = np.hypot(a[:, 1], a[:, 2]) > np.abs(a[:, 0])
    M = outer(a[:, None], b)
    for case in (M, M.swapaxes(-1, -2)):
        pair = spatial.solve_pair(case)
        told = (pair.status == ReverseStatus.FAMILY).sum(axis=-1)
        np.testing.assert_array_equal(told, 2 * solvable)
        assert (pair.status[~solvable] == ReverseStatus.NONE).all()
        assert holds_on_family(case, pair)


@pytest.mark.parametrize("shape", [(2, 2), (1, 2), (2, 1)], ids=["of both", "of x1", "of x2"])
def test_a_factor_of_the_biquadratics(shape):
    """A common factor that is bilinear in the tangents, or linear in one, times cofactors in one tangent alone."""
    rng = np.random.default_rng(10)
    factor = rng.normal(size=(20, *shape))
    rest = rng.normal(size=(20, 2, 4 - shape[0], 4 - shape[1]))
    E = np.zeros((20, 2, 3, 3))
    for i in range(shape[0]):
        for j in range(shape[1]):
            E[:, :, i : i + 4 - shape[0], j : j + 4 - shape[1]] += (
                factor[:, None, i : i + 1, j : j + 1] * rest
            )
    M = spatial.pair_from_biquadratics(E)
    pair = spatial.solve_pair(M)
    assert (pair.status == ReverseStatus.FAMILY).any(axis=-1).all()
    assert holds_on_family(M, pair)
    alone = pair.status == ReverseStatus.REGULAR
    assert alone.any()
    # they solve the remaining equations
    x1, x2 = np.tan(pair.theta1 / 2), np.tan(pair.theta2 / 2)
    left = sum(
        rest[:, None, :, i, j] * (x2**i * x1**j)[..., None]
        for i in range(rest.shape[2])
        for j in range(rest.shape[3])
    )
    scale = ((1 + x1**2) * (1 + x2**2))[..., None]
    assert np.abs(left / scale)[alone].max() < 1e-9


def test_dependent_and_empty_equations():
    rng = np.random.default_rng(11)
    one = rng.normal(size=(3, 3))
    one[0, 0] = 0.1  # so that it has solutions
    for m in ([one, -3 * one], [one, np.zeros((3, 3))], [np.zeros((3, 3)), one], [np.zeros((3, 3))] * 2):
        M = np.array([m])
        pair = spatial.solve_pair(M)
        assert pair.status[0, 0] == ReverseStatus.FAMILY
        assert (pair.status[0, 1:] == ReverseStatus.NONE).all()
        assert np.abs(values(M, pair)[0, 0]).max() < 1e-14
    nothing = np.zeros((1, 2, 3, 3))
    nothing[0, :, 0, 0] = 1.0
    assert (spatial.solve_pair(nothing).status == ReverseStatus.NONE).all()


def test_nearly_dependent_equations_are_not_dependent():
    """They are solved to what their difference is known to."""
    rng = np.random.default_rng(12)
    one, other = rng.normal(size=(2, 100, 3, 3))
    plain = spatial.solve_pair(np.stack([one, other], axis=1))
    for share in (1e-3, 1e-6, 1e-9):
        pair = spatial.solve_pair(np.stack([one, one + share * other], axis=1))
        np.testing.assert_array_equal(pair.status, plain.status)
        there = plain.status == ReverseStatus.REGULAR
        assert off(angles_of(pair), angles_of(plain))[there].max() < 1e5 * EPS / share


# what no row may depend on ------------------------------------------------------------------------------------------


def test_size_of_an_equation_does_not_matter():
    M = np.random.default_rng(13).normal(size=(50, 2, 3, 3))
    pair = spatial.solve_pair(M)
    scaled = spatial.solve_pair(M * np.array([2.0**500, -(2.0**-500)])[:, None, None])
    np.testing.assert_array_equal(scaled.status, pair.status)
    np.testing.assert_allclose(scaled.theta1, pair.theta1, atol=1e-12)


def test_interface(refuses):
    M = np.random.default_rng(17).normal(size=(2, 3, 2, 3, 3))
    pair = spatial.solve_pair(M)
    assert pair.theta1.shape == pair.theta2.shape == pair.status.shape == (2, 3, 8)
    assert pair.status.dtype == np.int8
    one = spatial.solve_pair(M[1, 2].tolist())
    np.testing.assert_array_equal(one.theta1, pair.theta1[1, 2])
    assert spatial.solve_pair(np.zeros((0, 2, 3, 3))).theta1.shape == (0, 8)
    refuses(spatial.solve_pair, np.zeros((3, 3)))
    refuses(spatial.solve_pair, M, method="newton", raises=ValueError)
    refuses(spatial.solve_pair, M + 0j)


def test_biquadratics_are_the_same_equations():
    rng = np.random.default_rng(18)
    E = rng.normal(size=(2, 3, 3))
    M = spatial.pair_from_biquadratics(E)
    for x1, x2 in rng.normal(size=(5, 2)):
        direct = np.einsum("eba,b,a->e", E, x2 ** np.arange(3), x1 ** np.arange(3))
        u, v = basis(2 * np.arctan(x1)), basis(2 * np.arctan(x2))
        np.testing.assert_allclose(
            np.einsum("eij,i,j->e", M, u, v) * (1 + x1**2) * (1 + x2**2),
            direct,
            atol=1e-12 * np.abs(direct).max(),
        )


# the two ways -------------------------------------------------------------------------------------------------------


def test_the_fast_way_is_the_usual_way_and_agrees():
    """Of random equations hardly any needs eigenvalues; where it is certain it is right."""
    M = np.random.default_rng(19).normal(size=(4000, 2, 3, 3))
    one, two, loss = pair_equations.kernels.pair_prepared(M[:, 0], M[:, 1])
    angles, certain = certain_solutions(one, two, loss)
    assert certain.mean() > 0.99
    by_eigenvalues = spatial.solve_pair(M[:1000], method="sylvester")
    some = np.flatnonzero(certain[:1000])
    np.testing.assert_array_equal(
        np.isfinite(angles[some, :, 0]), by_eigenvalues.status[some] == ReverseStatus.REGULAR
    )
    assert np.nanmax(off(angles[some], angles_of(by_eigenvalues)[some])) < 1e-10


@pytest.mark.parametrize("lost", [1, 2])
def test_lost_starts_are_made_up_for_or_reported(lost, monkeypatch):
    """Where starts near some solutions are taken away everywhere, either the others lead there or a slot says so."""
    rng = np.random.default_rng(20)
    points = rng.uniform(-np.pi, np.pi, size=(60, 7, 2))
    M = through(rng, points)
    complete = spatial.solve_pair(M, method="sylvester")
    taken = angles_of(complete)[:, :lost]

    def without(M, loss, starts, collected=pair_equations.collected):
        angles, status = collected(M, loss, starts)
        rows = [np.flatnonzero((complete_M == m).all(axis=(-1, -2, -3)))[0] for m in M]
        near = (off(angles[:, :, None], taken[rows][:, None]).max(axis=-1) < 1e-6).any(axis=-1)
        return np.where(near[..., None], np.nan, angles), np.where(near, ReverseStatus.NONE, status)

    one, two, _ = pair_equations.kernels.pair_prepared(M[:, 0], M[:, 1])
    complete_M = np.stack([one, two], axis=1)
    monkeypatch.setattr(pair_equations, "collected", without)
    told = spatial.solve_pair(M, method="sylvester").status == ReverseStatus.INCOMPLETE
    assert told.any(axis=-1).mean() > 0.95


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


def test_interface_of_one_equation(refuses):
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
    refuses(spatial.solve_trig, 1j, 2.0, 0.5, raises=TypeError)
    refuses(spatial.solve_trig, 1.0, ["x"], 0.5, raises=TypeError)
    refuses(spatial.solve_trig, np.ones(3), 2.0, np.ones(2))
