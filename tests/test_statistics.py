"""The statistics on arrays, each against its textbook formula, without a machine."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, stats

from rodgen.calibration.problem import one_thread_in_blas
from rodgen.statistics.leave_out import undo_leverage
from rodgen.statistics.robust import (
    HUBER,
    chi3_quantile,
    chi_share,
    huber_weight,
    median_factor,
)
from rodgen.statistics.variance_components import RestrictedLikelihood, VarianceEstimator, _falls
from rodgen.statistics.whitening import Moments, MotionDeviations, Poses, SharedMotion

GROUPS = {"t": slice(0, 2), "r": slice(2, 3)}


def unit(columns: np.ndarray) -> np.ndarray:
    return columns / np.linalg.norm(columns, axis=0)


# distributions -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dof", [3, 5])
def test_share_of_the_chi_distribution(dof: int) -> None:
    for cut in (0.1, 0.9, 2.0, 5.0):
        assert chi_share(cut, dof) == pytest.approx(stats.chi(dof).cdf(cut), rel=1e-9)  # 1e-16 of 1e-5


def test_quantile_of_the_chi_distribution() -> None:
    for tail in (0.9, 0.5, 1e-3, 1e-12, 1e-200):
        assert chi3_quantile(tail) == pytest.approx(stats.chi(3).isf(tail), rel=1e-12)


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


# several tests at once ---------------------------------------------------------------------------------------------


# columns -----------------------------------------------------------------------------------------------------------


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
    found = RestrictedLikelihood(Moments(motion, whole), N, 4, GROUPS)
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
    taken = there.deviations(GROUPS, 3)
    np.testing.assert_array_equal(taken.shared, part.shared)
    np.testing.assert_array_equal(taken.wander, part.wander)


@pytest.mark.parametrize("least", [0.0, 4.0])
@pytest.mark.parametrize(
    "names",
    [
        ("pose t",),
        ("wander r",),
        ("run r", "position t"),
        ("pose r", "wander t", "wander r", "position r", "run t"),
    ],
)
def test_the_slope_of_the_likelihood_is_that_of_differences(names: tuple[str, ...], least: float) -> None:
    random = np.random.default_rng(len(names))
    pose = np.repeat(np.arange(40), 2)
    poses = Poses.among(pose, pose // 13, random.uniform(0.9, 1.1, 80).cumsum(), pose % 7)
    motion = SharedMotion(poses, random.normal(size=(80, 3, 3)))
    X = np.linalg.qr(random.normal(size=(240, 5)))[0]
    columns = np.column_stack([X, random.normal(size=(240, 3))]).reshape(80, 3, -1)
    likelihood = RestrictedLikelihood(Moments(motion, columns), 240, 5, GROUPS, least)
    sizes = random.uniform(0.3, 1.5, len(names))
    now = likelihood.at(names, sizes, 4.0 if any(n.startswith("wander") for n in names) else np.inf)
    x = np.log([*sizes, *[4.0] * now.wanders])
    steps = 1e-5 * np.eye(len(x))
    ends = [[likelihood._moved(now, x + sign * step)[0].likelihood for sign in (1, -1)] for step in steps]
    slope, information = likelihood._derivatives(*likelihood._moved(now, x))
    np.testing.assert_allclose(slope, np.diff(ends)[:, 0] / -2e-5, rtol=1e-6, atol=1e-6)
    assert np.linalg.eigvalsh(information)[0] > 0


def test_the_average_information_is_that_of_gilmour_thompson_and_cullis() -> None:
    random = np.random.default_rng(7)
    motion, H, at = made(8, random)
    N = len(H)
    X, y = np.linalg.qr(random.normal(size=(N, 4)))[0], 3 * random.normal(size=N)
    likelihood = RestrictedLikelihood(
        Moments(motion, np.column_stack([X, y]).reshape(N // 3, 3, -1)), N, 4, GROUPS
    )
    now = likelihood.at(("pose t", "wander r"), (0.7, 1.3), 3.0)

    def matrix(x: np.ndarray) -> np.ndarray:
        shared, wander = np.array([x[0], x[0], 0]), np.array([0, 0, x[1]])
        return covariance(
            H,
            at,
            MotionDeviations(np.exp(shared) * (shared != 0), np.exp(wander) * (wander != 0), np.exp(x[2])),
        )

    x, V = np.log([0.7, 1.3, 3.0]), matrix(np.log([0.7, 1.3, 3.0]))
    changes = [(matrix(x + step) - matrix(x - step)) / 2e-5 for step in 1e-5 * np.eye(3)] + [V]
    inverse = np.linalg.inv(V)
    P = inverse - inverse @ X @ np.linalg.solve(X.T @ inverse @ X, X.T @ inverse)
    f = np.stack([change @ P @ y for change in changes], axis=1) / np.sqrt(now.variance)
    whole = f.T @ P @ f / 2
    expected = whole[:3, :3] - np.outer(whole[:3, 3], whole[:3, 3]) / whole[3, 3]
    found = likelihood._derivatives(*likelihood._weighed(now))[1]
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)


def test_a_climb_ends_where_a_search_by_scipy_does() -> None:
    random = np.random.default_rng(8)
    motion, H, at = made(40, random)
    N = len(H)
    X = np.linalg.qr(random.normal(size=(N, 4)))[0]
    part = MotionDeviations(np.array([0.8, 0.8, 0.0]), np.array([0.0, 0.0, 1.5]), 6.0)
    y = np.linalg.cholesky(covariance(H, at, part)) @ random.normal(size=N)
    moments = Moments(motion, np.column_stack([X, y]).reshape(N // 3, 3, -1))
    likelihood = RestrictedLikelihood(moments, N, 4, GROUPS)
    names = ("pose t", "wander r")
    found = likelihood.climbed(likelihood.at(names, (0.3, 0.3), 2.0))

    def against(x: np.ndarray) -> float:
        return -likelihood.at(names, np.exp(x[:2]), float(np.exp(x[2]))).likelihood

    best = optimize.minimize(against, np.log([0.5, 0.5, 5.0]), method="Nelder-Mead", options={"xatol": 1e-6})
    assert found.likelihood == pytest.approx(-best.fun, abs=0.01)
    np.testing.assert_allclose(np.log([*found.sizes, found.time]), best.x, atol=0.05)
    assert found.information is not None
    steps = 0.02 * np.eye(3)
    curvature = [
        [
            against(best.x + a + b)
            - against(best.x + a - b)
            - against(best.x - a + b)
            + against(best.x - a - b)
            for a in steps
        ]
        for b in steps
    ]
    expected = np.array(curvature) / (4 * 0.02**2)
    np.testing.assert_allclose(found.information, expected, atol=0.25 * np.diag(expected).max())


@pytest.mark.parametrize(
    ("part", "kind"),
    [
        (MotionDeviations(np.full(3, 0.5), np.zeros(3), np.inf), "pose"),
        (MotionDeviations(np.zeros(3), np.full(3, 0.8), 12.0), "wander"),
        (MotionDeviations(np.zeros(3), np.zeros(3), np.inf, np.full(3, 0.5)), "position"),
        (MotionDeviations(np.zeros(3), np.zeros(3), np.inf, np.zeros(0), np.full(3, 0.8)), "run"),
    ],
)
def test_the_cheapest_component_is_what_there_is(part: MotionDeviations, kind: str) -> None:
    right, kinds = 0, ("pose", "position", "run", "wander")
    for seed in range(4):
        random = np.random.default_rng(seed)
        pose = np.repeat(np.arange(120), 2)
        poses = Poses.among(pose, pose // 20, pose * 1.0, pose % 12)
        motion = SharedMotion(poses, random.normal(size=(240, 3, 3)))
        X = np.linalg.qr(random.normal(size=(720, 6)))[0]
        y = np.linalg.cholesky(motion.covariance_of(part, np.eye(720).reshape(240, 3, 720)))
        y = y @ random.normal(size=720)
        y -= X @ (X.T @ y)
        with one_thread_in_blas():
            found = VarianceEstimator(motion, {"all": slice(0, 3)}, X, [], y, 720).best(kinds)
        right += found.names == (f"{kind} all",)
        assert f"{kind} all" in found.names
    assert right >= 3


def test_a_sign_is_what_a_component_is_worth_in_a_balanced_design() -> None:
    random = np.random.default_rng(8)
    pose = np.repeat(np.arange(12), 5)
    motion = SharedMotion(Poses.among(pose, np.zeros(60, int), None), np.ones((60, 1, 1)))
    y = (random.normal(size=60) + random.normal(size=12)[pose])[:, None, None]
    likelihood = RestrictedLikelihood(Moments(motion, y), 60, 0, {"all": slice(0, 1)})
    ((worth, name, size, _),) = likelihood.signs(("pose",))
    there = [likelihood.at((name,), (part * size,), np.inf).likelihood for part in (0.99, 1.0, 1.01)]
    assert there[1] > max(there[0], there[2])
    assert worth == pytest.approx(2 * (there[1] - likelihood.independent.likelihood), rel=1e-9)
    assert worth > 1


def test_independent_readings_have_no_component() -> None:
    random = np.random.default_rng(4)
    motion, H, _ = made(60, random)
    X = np.linalg.qr(random.normal(size=(len(H), 4)))[0]
    found = 0
    for _ in range(40):
        y = random.normal(size=len(H))
        y -= X @ (X.T @ y)
        found += bool(VarianceEstimator(motion, GROUPS, X, [], y, len(H)).best(("pose", "wander")).names)
    assert found <= 4


def test_the_own_error_is_not_below_the_least_one() -> None:
    random = np.random.default_rng(5)
    motion, H, at = made(40, random)
    part = MotionDeviations(np.zeros(3), np.full(3, 3.0), 4.0)
    y = np.linalg.cholesky(covariance(H, at, part)) @ random.normal(size=len(H))
    X = np.linalg.qr(random.normal(size=(len(H), 2)))[0]
    y -= X @ (X.T @ y)
    free = VarianceEstimator(motion, GROUPS, X, [], y, len(H)).best(("wander",))
    assert free.variance == pytest.approx(1, rel=0.3)
    held = VarianceEstimator(motion, GROUPS, X, [], y, len(H), least=4.0).best(("wander",))
    assert held.variance == 4.0
    assert held.likelihood < free.likelihood


def test_columns_that_depend_on_each_other_have_no_likelihood() -> None:
    motion, H, _ = made(8, np.random.default_rng(4))
    N = len(H)
    same = np.zeros((N, 2))
    same[0] = 1.0
    whole = np.column_stack([same, np.arange(N)]).reshape(N // 3, 3, -1)
    none = RestrictedLikelihood(Moments(motion, whole), N, 2, GROUPS, motion.poses).at((), (), np.inf)
    assert none.likelihood == -np.inf


def test_what_effects_explain_is_that_of_least_squares() -> None:
    random = np.random.default_rng(9)
    sizes = np.array([2, 0, 1, 3])
    columns, y = random.normal(size=(30, 6)), random.normal(size=30)
    columns[:, 5] = columns[:, 4]  # twice the same
    ends = np.cumsum(sizes)[:-1]
    expected = [y @ y - np.sum((y - c @ np.linalg.pinv(c) @ y) ** 2) for c in np.split(columns, ends, axis=1)]
    np.testing.assert_allclose(_falls(columns, y, sizes), expected, rtol=1e-9, atol=1e-12)


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
        estimator = VarianceEstimator(motion, {"all": slice(0, 3)}, own, candidates, residual, N)
        found = estimator.best(("pose", "wander"))
        return found, found.deviations({"all": slice(0, 3)}, 3)

    with_effect = error + 60 * effects[1][:, 0]
    found, deviations = best(with_effect, effects)
    assert found.names == ("pose all",)  # nothing wanders
    np.testing.assert_allclose(deviations.shared, part.shared, rtol=0.5)  # 24 poses
    assert found.variance == pytest.approx(1, rel=0.4)
    unknown, _ = best(with_effect, effects[:1])
    assert any(name.startswith("wander") for name in unknown.names)
    alone, _ = best(random.normal(size=N), effects)
    assert alone.names == ()
