"""The statistics on arrays, each against its textbook formula, without a machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import interpolate, optimize, stats

from rodgen.data.drivers import monotone_curve
from rodgen.statistics.columns import ColumnSpace, Coordinates
from rodgen.statistics.leave_out import LeaveOut, group_slices, undo_leverage
from rodgen.statistics.multiple_testing import RATE, effective_tests
from rodgen.statistics.robust import (
    HUBER,
    chi3_quantile,
    chi_share,
    huber_weight,
    kurtosis_tail,
    median_factor,
)
from rodgen.statistics.variance_components import RestrictedLikelihood, VarianceEstimator, _log_ps, climb
from rodgen.statistics.whitening import Moments, MotionDeviations, Poses, SharedMotion

GROUPS = {"t": slice(0, 2), "r": slice(2, 3)}


def unit(columns: np.ndarray) -> np.ndarray:
    return columns / np.linalg.norm(columns, axis=0)


# distributions -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [20, 21, 100, 3000])
def test_tail_of_the_kurtosis_is_that_of_scipy(n: int) -> None:
    """Of draws with short, normal and long tails."""
    rng = np.random.default_rng(n)
    for draw in (
        rng.uniform(size=n),
        rng.normal(size=n),
        rng.standard_t(5, size=n),
        rng.standard_t(2, size=n),
    ):
        expected = stats.kurtosistest(draw, alternative="greater").pvalue
        assert kurtosis_tail(float(stats.kurtosis(draw, fisher=False)), n) == pytest.approx(
            expected, rel=1e-9
        )


@pytest.mark.parametrize("n", [20, 50, 200, 100_000])
def test_errors_that_are_all_about_as_large_have_no_long_tails(n: int) -> None:
    """Of backlash, say: 1 is the least kurtosis that there is."""
    tails = [kurtosis_tail(kurtosis, n) for kurtosis in (1.0, 1.2, 1.5, 1.8, 3.0)]
    assert tails == sorted(tails, reverse=True)
    assert tails[0] > 0.999


@pytest.mark.parametrize("n", [2, 3, 4, 50])
def test_monotone_curve_is_that_of_scipy(n: int) -> None:
    """Also where steps and slopes differ by decades, at the points, and between them."""
    rng = np.random.default_rng(n)
    x, y = (np.cumsum(10 ** rng.uniform(-3, 3, n)) for _ in range(2))
    at = np.concatenate([x, rng.uniform(x[0], x[-1], 1000)])
    there = interpolate.PchipInterpolator(x, y)(at)
    np.testing.assert_allclose(monotone_curve(x, y)(at), there, rtol=0, atol=1e-12 * np.ptp(y))


@pytest.mark.parametrize("dof", [3, 5])
def test_share_of_the_chi_distribution(dof: int) -> None:
    for cut in (0.1, 0.9, 2.0, 5.0):
        assert chi_share(cut, dof) == pytest.approx(stats.chi(dof).cdf(cut), rel=1e-9)  # 1e-16 of 1e-5


def test_quantile_of_the_chi_distribution() -> None:
    for tail in (0.9, 0.5, 1e-3, 1e-12, 1e-200):
        assert chi3_quantile(tail) == pytest.approx(stats.chi(3).isf(tail), rel=1e-12)


@pytest.mark.parametrize("bound", [4.0, 0.5])
def test_a_climb_ends_where_a_search_by_scipy_does(bound: float) -> None:
    def valley(x: np.ndarray) -> float:
        return -float((1 - x[0]) ** 2 + 5 * (x[1] - x[0] ** 2) ** 2 + np.cosh(x[2] - 0.3))

    def derivatives(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first = np.array([-1.0, 0.0, 0.0]), np.array([-2 * x[0], 1.0, 0.0])  # of what is squared
        slope = 2 * (1 - x[0]) * first[0] + 10 * (x[1] - x[0] ** 2) * first[1]
        curvature = 2 * np.outer(first[0], first[0]) + 10 * np.outer(
            first[1], first[1]
        )  # after Gauss and Newton
        slope[2], curvature[2, 2] = np.sinh(x[2] - 0.3), np.cosh(x[2] - 0.3)
        return -slope, curvature

    low, high, start = np.full(3, -4.0), np.full(3, bound), np.array([-1.2, 0.4, 3.0])
    found = climb(lambda x: (valley(x), lambda: derivatives(x)), start, low, high, rise=1e-9)
    known = optimize.minimize(lambda x: -valley(x), start.clip(low, high), bounds=[(-4.0, bound)] * 3)
    assert np.all((low <= found) & (found <= high))
    assert valley(found) == pytest.approx(-known.fun, abs=1e-7)  # SciPy's derivatives are differences
    np.testing.assert_allclose(found, known.x, atol=1e-3)


def test_a_climb_keeps_away_from_where_a_function_is_not_defined() -> None:
    def half(x: np.ndarray) -> tuple:
        value = float(np.log(x[0]) - x[0]) if x[0] > 0 else -np.inf
        return value, lambda: (1 / x - 1, np.diag(1 / x**2))

    found = climb(half, np.array([3.0]), np.array([-5.0]), np.array([5.0]), rise=1e-9)
    assert found == pytest.approx(1.0, abs=1e-3)
    nowhere = climb(half, np.array([-2.0]), np.array([-5.0]), np.array([5.0]), rise=1e-9)
    np.testing.assert_array_equal(nowhere, [-2.0])


def test_a_climb_ends_where_its_bounds_hold_all_variables() -> None:
    corner = climb(
        lambda x: (float(x.sum()), lambda: (np.ones(2), np.zeros((2, 2)))),
        np.zeros(2),
        np.zeros(2),
        np.array([0.5, 7.0]),
        rise=1e-9,
    )
    np.testing.assert_array_equal(corner, [0.5, 7.0])


@pytest.mark.parametrize("slope", [np.nan, np.inf])
def test_a_climb_ends_where_derivatives_are_not_finite(slope: float) -> None:
    start = np.full(2, 0.5)
    found = climb(
        lambda x: (0.0, lambda: (np.array([slope, 1.0]), np.eye(2))), start, start - 1, start + 1, rise=1e-9
    )
    np.testing.assert_array_equal(found, start)


@pytest.mark.thorough
def test_weights_are_those_of_huber() -> None:
    np.testing.assert_allclose(huber_weight(np.array([0.0, 1.0, 2.0, 4.0]), 2.0), [1, 1, 1, 0.5])
    for m, k in HUBER.items():  # the efficiency by which the constants are chosen
        inside = stats.chi2(m).expect(lambda s: s, ub=k**2)
        square = inside + k**2 * stats.chi2(m).sf(k**2)
        slope = stats.chi2(m).cdf(k**2)
        slope += (m - 1) / m * stats.chi2(m).expect(lambda s: k / np.sqrt(s), lb=k**2)  # noqa: B023
        assert slope**2 / (square / m) == pytest.approx(0.95, abs=1e-6)


def test_a_scale_from_few_rows_is_enlarged() -> None:
    assert [median_factor(dof) for dof in (10.0, 1.0, 0.0)] == [1.5, 6.0, 6.0]


@pytest.mark.parametrize(("rows", "columns"), [(9, 4), (4, 9), (5, 5), (6, 0)])
def test_coordinates_are_products_with_an_orthonormal_basis(rows: int, columns: int) -> None:
    random = np.random.default_rng(rows)
    X, y = random.normal(size=(rows, columns)), random.normal(size=rows)
    Q, R = np.linalg.qr(X)
    found = Coordinates(X)
    np.testing.assert_allclose(found.triangle, R, atol=1e-13)
    np.testing.assert_allclose(found.of(y), Q.T @ y, atol=1e-13)


# several tests at once ---------------------------------------------------------------------------------------------


def test_no_test_and_one_test_count_as_one() -> None:
    assert effective_tests([], 20) == 1.0
    assert effective_tests([np.eye(9)[:, :2]], 20) == pytest.approx(1, rel=0.3)  # 20 of 2000 simulations


def test_independent_tests_count_each_and_the_same_test_counts_once() -> None:
    basis = np.linalg.qr(np.random.default_rng(0).normal(size=(60, 20)))[0]
    assert effective_tests(np.split(basis, 20, axis=1), 400) == pytest.approx(20, rel=0.3)
    assert effective_tests([basis[:, :1]] * 20, 400) == effective_tests([basis[:, :1]], 400)


def test_where_the_tests_leave_nothing_one_finds_what_the_other_lacks() -> None:
    # of a direction in a plane, which is uniform, p of the one is 1 - p of the other: the least is uniform below 1/2
    both = effective_tests([np.eye(2)[:, :1], np.eye(2)[:, 1:]], 2)
    assert both == pytest.approx(-np.log1p(-RATE) / (RATE / 2), rel=0.3)


# columns -----------------------------------------------------------------------------------------------------------


def test_score_test_is_the_f_test_of_nested_fits() -> None:
    random = np.random.default_rng(1)
    X, Z, y = random.normal(size=(30, 3)), random.normal(size=(30, 2)), random.normal(size=30)
    space = ColumnSpace.of(X)
    residual = y - X @ np.linalg.lstsq(X, y)[0]
    test = space.score_test(residual, space.visible_part(unit(Z), 1e-6))
    both = np.hstack([X, Z])
    left = float(np.sum((y - both @ np.linalg.lstsq(both, y)[0]) ** 2))
    fall = float(residual @ residual) - left
    assert test is not None
    assert (test.dof, test.residual_dof) == (2, 25)
    assert (test.fall, test.left) == pytest.approx((fall, left), rel=1e-10)
    assert test.statistic == pytest.approx(fall / 2 / (left / 25), rel=1e-10)
    assert test.log_p == pytest.approx(stats.f(2, 25).logsf(test.statistic), rel=1e-9)
    assert space.rank == 3
    hat = X @ np.linalg.pinv(X)
    np.testing.assert_allclose(space.leverage, np.diag(hat), atol=1e-12)


def test_score_test_of_many_columns_is_that_of_their_visible_part() -> None:
    random = np.random.default_rng(2)
    space = ColumnSpace.of(random.normal(size=(60, 3)))
    columns = random.normal(size=(60, 6))
    columns[:, 3] = columns[:, 2] + 1e-4 * columns[:, 3]  # hardly visible beside the one before
    columns[:, 4] = space.basis[:, 0] + 1e-4 * columns[:, 4]  # or outside of the space
    residual, columns = space.project_out(random.normal(size=60)), unit(columns)
    one = space.score_test(residual, space.visible_part(columns, 0.02))
    many = space.score_test_of_many(residual, columns, 0.02)
    assert one is not None
    assert many is not None
    assert (many.dof, many.residual_dof) == (one.dof, one.residual_dof) == (4, 53)
    assert (many.fall, many.left) == pytest.approx((one.fall, one.left), rel=1e-10)
    assert space.score_test_of_many(residual, columns[:, 4:5], 0.02) is None


def test_nothing_is_tested_where_nothing_can_be() -> None:
    space = ColumnSpace.of(np.eye(4)[:, :2])
    residual, u = np.array([0.0, 0, 3, 4]), np.eye(4)[:, 2:3]
    assert space.score_test(residual, u[:, :0]) is None
    assert space.score_test(residual, u, readings=3) is None  # no degree of freedom remains
    assert space.score_test(0 * residual, u) is None
    less = space.score_test(residual, u, readings=10, total=50.0)
    assert less is not None
    assert (less.fall, less.left, less.residual_dof) == (9, 41, 7)


def test_residuals_of_a_group_are_those_of_the_fit_to_the_others() -> None:
    random = np.random.default_rng(2)
    X, y = random.normal(size=(12, 3)), random.normal(size=12)
    groups = group_slices(np.repeat([0, 1, 2], [3, 4, 5]))
    assert groups == [slice(0, 3), slice(3, 7), slice(7, 12)]
    left_out = np.empty(12)
    for group in groups:
        others = np.ones(12, bool)
        others[group] = False
        left_out[group] = y[group] - X[group] @ np.linalg.lstsq(X[others], y[others])[0]
    space, residual = ColumnSpace.of(X), y - X @ np.linalg.lstsq(X, y)[0]
    np.testing.assert_allclose(LeaveOut(space.basis, groups).residuals(residual), left_out, rtol=1e-9)
    first = ColumnSpace.of(X[:, :2])
    further = first.visible_part(unit(X[:, 2:]), 1e-6)
    np.testing.assert_allclose(
        LeaveOut(first.basis, groups).residuals(residual, further), left_out, rtol=1e-9
    )


def test_what_a_group_alone_knows_is_not_divided_by_zero() -> None:
    hat, residual = np.diag([1.0, 0.75]), np.array([2.0, 3.0])
    np.testing.assert_allclose(undo_leverage(hat, residual, 1.0), [0, 12])
    np.testing.assert_allclose(undo_leverage(hat, residual, 0.5), [0, 6])
    np.testing.assert_allclose(undo_leverage(hat, residual, 1.0, cap=0.5), [4, 6])
    np.testing.assert_allclose(undo_leverage(hat[:1, :1], residual[:1], 0.5, cap=0.75), [4])


# poses -------------------------------------------------------------------------------------------------------------


def test_poses_follow_each_other_in_time_within_their_run() -> None:
    pose, run = np.array([7, 3, 7, 5, 4, 9]), np.array([1, 0, 1, 1, 0, 1])
    t = np.array([1010.0, 1000, 1012, 1021, 1003, 1015])  # pose 7 at 1011, its mean
    poses = Poses.among(pose, run, t)
    np.testing.assert_array_equal(poses.of, [2, 0, 2, 4, 1, 3])
    np.testing.assert_array_equal(poses.gap, [np.inf, 3, np.inf, 4, 6])
    assert (poses.count, poses.spacing, poses.duration, poses.timed) == (5, 4, 10, True)
    np.testing.assert_array_equal(poses.total(t), [1000, 1003, 2022, 1015, 1021])
    fewer = poses.taken(np.array([True, True, False, True, False, False]))
    np.testing.assert_array_equal(fewer.of, [1, 0, 2])
    np.testing.assert_array_equal(fewer.gap, [np.inf, np.inf, 10])
    assert (fewer.spacing, fewer.duration) == (4, 10)


def test_poses_without_times_follow_each_other_by_their_numbers() -> None:
    for t in (None, np.full(3, 8.0)):
        poses = Poses.among(np.array([4, 1, 2]), np.zeros(3, int), t)
        np.testing.assert_array_equal(poses.of, [2, 0, 1])
        np.testing.assert_array_equal(poses.gap, [np.inf, 1, 2])
        assert (poses.spacing, poses.duration, poses.timed) == (1.5, 3, False)


# variance components -----------------------------------------------------------------------------------------------


def made(poses: int, random: np.random.Generator) -> tuple[SharedMotion, np.ndarray, np.ndarray]:
    """Make a motion of poses of two readings with three components each; give it, H as a whole, and the times."""
    columns = random.normal(size=(2 * poses, 3, 3))
    at, run = np.arange(poses) * 1.0, (np.arange(poses) >= poses // 2).astype(int)
    of = np.repeat(np.arange(poses), 2)
    H = np.zeros((6 * poses, 3 * poses))
    for i, pose in enumerate(of):
        H[3 * i : 3 * i + 3, 3 * pose : 3 * pose + 3] = columns[i]
    return SharedMotion(Poses.among(of, run[of], at[of]), columns), H, at


def covariance(H: np.ndarray, at: np.ndarray, part: MotionDeviations) -> np.ndarray:
    run = np.arange(len(at)) >= len(at) // 2
    alike = np.exp(-np.abs(at[:, None] - at) / part.time) * (run[:, None] == run)
    moves = np.kron(np.eye(len(at)), np.diag(part.shared**2)) + np.kron(alike, np.diag(part.wander**2))
    return np.eye(len(H)) + H @ moves @ H.T


def test_restricted_likelihood_is_that_of_patterson_and_thompson() -> None:
    random = np.random.default_rng(3)
    motion, H, at = made(8, random)
    N = len(H)
    fixed = np.linalg.qr(random.normal(size=(N, 4)))[0]
    further, y = unit(random.normal(size=(N, 2))), random.normal(size=N)
    whole = np.column_stack([fixed, further, y]).reshape(N // 3, 3, -1)
    found = RestrictedLikelihood(Moments(motion, whole), N, 4, GROUPS, motion.poses)
    names, sizes, time = ("pose t", "wander t", "wander r"), (0.7, 0.4, 1.3), 3.0
    there = found.at(names, sizes, time)
    part = MotionDeviations(np.array([0.7, 0.7, 0]), np.array([0.4, 0.4, 1.3]), 3.0)
    V = covariance(H, at, part)
    X = np.hstack([fixed, further])
    beta = np.linalg.solve(X.T @ np.linalg.solve(V, X), X.T @ np.linalg.solve(V, y))
    left = (y - X @ beta) @ np.linalg.solve(V, y - X @ beta)
    logs = [np.linalg.slogdet(matrix)[1] for matrix in (V, fixed.T @ np.linalg.solve(V, fixed))]
    assert there.variance == pytest.approx(left / (N - 4), rel=1e-9)
    assert there.likelihood == pytest.approx(
        -0.5 * ((N - 4) * np.log(left / (N - 4)) + logs[0] + logs[1]), rel=1e-9
    )
    taken = found.deviations(there)
    np.testing.assert_array_equal(taken.shared, part.shared)
    np.testing.assert_array_equal(taken.wander, part.wander)


@pytest.mark.parametrize(
    ("names", "sizes", "time"),
    [
        (("pose t", "wander t", "wander r"), (0.7, 0.4, 1.3), 3.0),
        (("wander r",), (0.5,), 30.0),
        (("pose t", "pose r"), (0.5, 0.1), np.inf),
        (("wander r", "pose r"), (2.0, 3.0), 0.3),
    ],
)
def test_a_climb_has_the_derivatives_and_the_average_information(
    names: tuple, sizes: tuple, time: float
) -> None:
    random = np.random.default_rng(7)
    motion, H, at = made(8, random)
    N = len(H)
    X, y = np.linalg.qr(random.normal(size=(N, 4)))[0], random.normal(size=N)
    whole = np.column_stack([X, y]).reshape(N // 3, 3, -1)
    likelihood = RestrictedLikelihood(Moments(motion, whole), N, 4, GROUPS, motion.poses)
    there, derivatives = likelihood._evaluated(names, sizes, time)
    slope, information = derivatives()

    def moved(i: int, by: float) -> tuple[tuple, float]:
        x = [*sizes, time]
        x[i] *= np.exp(by)
        return tuple(x[:-1]), x[-1]

    h = 1e-5  # central differences: errors of h² and of rounding over h, 1e-10 both
    count = len(names) + np.isfinite(time)
    for i in range(count):
        up, down = (likelihood.at(names, *moved(i, by)).likelihood for by in (h, -h))
        assert slope[i] == pytest.approx((up - down) / (2 * h), rel=1e-6, abs=1e-7)

    def V(sizes: tuple, time: float) -> np.ndarray:
        deviations = likelihood.deviations(replace(there, names=names, sizes=sizes, time=time))
        return covariance(H, at, deviations)

    inverse = np.linalg.inv(V(sizes, time))
    P = inverse - inverse @ X @ np.linalg.solve(X.T @ inverse @ X, X.T @ inverse)
    changes = [(V(*moved(i, h)) - V(*moved(i, -h))) / (2 * h) @ P @ y for i in range(count)]
    known = np.array([[one @ P @ other for other in changes] for one in changes]) / there.variance
    pulls = np.array([y @ P @ change for change in changes]) / there.variance
    known -= np.outer(pulls, pulls) / (N - 4)  # the variance of the readings' own errors follows
    np.testing.assert_allclose(information, known / 2, rtol=1e-6, atol=1e-7)


def test_columns_that_depend_on_each_other_have_no_likelihood() -> None:
    motion, H, _ = made(8, np.random.default_rng(4))
    N = len(H)
    same = np.zeros((N, 2))
    same[0] = 1.0
    whole = np.column_stack([same, np.arange(N)]).reshape(N // 3, 3, -1)
    none = RestrictedLikelihood(Moments(motion, whole), N, 2, GROUPS, motion.poses).at((), (), np.inf)
    assert none.likelihood == -np.inf


def test_p_values_from_products_are_those_of_f_tests() -> None:
    random = np.random.default_rng(5)
    fixed = np.linalg.qr(random.normal(size=(40, 3)))[0]
    effects = [random.normal(size=(40, k)) for k in (1, 0, 2)]
    y = random.normal(size=40) + effects[2][:, 0]
    whole = np.column_stack([fixed, *effects, y])
    found = _log_ps(whole.T @ whole, 3, effects, 40)
    assert list(found) == [0, 2]
    for i, log_p in found.items():
        sums = [
            float(np.sum((y - X @ np.linalg.lstsq(X, y)[0]) ** 2))
            for X in (fixed, np.hstack([fixed, effects[i]]))
        ]
        k = effects[i].shape[1]
        F = (sums[0] - sums[1]) / k / (sums[1] / (37 - k))
        assert log_p == pytest.approx(stats.f(k, 37 - k).logsf(F), rel=1e-9)


def test_an_effect_is_not_taken_for_wander_nor_wander_for_an_effect() -> None:
    random = np.random.default_rng(6)
    motion, H, at = made(24, random)
    N = len(H)
    own = np.linalg.qr(random.normal(size=(N, 4)))[0]
    # two effects that move the whole set-up slowly, as a drift would, and one that does not
    slow = [(H @ np.kron(np.sin(at * w), axis))[:, None] for w, axis in ((0.12, [1, 0, 0]), (0.2, [0, 0, 1]))]
    effects = [unit(x) for x in (*slow, random.normal(size=(N, 1)))]
    part = MotionDeviations(np.array([0.8, 0.8, 0.8]), np.zeros(3), 1.0)
    error = np.linalg.cholesky(covariance(H, at, part)) @ random.normal(size=N)

    def best(y: np.ndarray, candidates: list[np.ndarray]) -> tuple:
        residual = y - own @ (own.T @ y)
        estimator = VarianceEstimator(
            motion, {"all": slice(0, 3)}, motion.poses, own, candidates, residual, N
        )
        return estimator.best(pose=True)[:2]

    with_effect = error + 60 * effects[1][:, 0]
    found, deviations = best(with_effect, effects)
    assert deviations is not None
    assert found.names == ("pose all",)  # nothing wanders
    np.testing.assert_allclose(deviations.shared, part.shared, rtol=0.5)  # 24 poses
    assert found.variance == pytest.approx(1, rel=0.4)
    unknown, _ = best(with_effect, effects[:1])
    assert any(name.startswith("wander") for name in unknown.names)
    alone, _ = best(random.normal(size=N), effects)
    assert alone.names == ()
