"""The statistics on arrays, each against its textbook formula, without a machine."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import optimize, stats
from scipy.integrate import quad
from scipy.stats import chi, t
from simulated_fits import TRUTH, fit_to, joint, machine_file, measure, on_table

from rodgen.calibration.fit import Fit, FitError, fit
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.words import three_digits, two_digits
from rodgen.data.measurements import Measurements
from rodgen.kinematics.axis_fit.result import vector_text
from rodgen.machines.machine import Machine
from rodgen.output.numbers import shown_unit
from rodgen.statistics.columns import orthonormal_basis
from rodgen.statistics.decompositions import eigh, lstsq, svd
from rodgen.statistics.digits import last_decimal, measured
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
    for times in (None, np.full(3, 8.0)):
        poses = Poses.among(np.array([4, 1, 2]), np.zeros(3, int), times)
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


# Decompositions end in a result where NumPy's drivers do not converge


SOURCE = Path(__file__).parent.parent / "src" / "rodgen"
SHAPES = ((5, 3), (3, 5), (4, 4), (2, 3, 6, 4), (0, 3), (3, 0))


@pytest.fixture
def stubborn(monkeypatch):
    """NumPy, whose decompositions do not converge."""

    def refuse(*_, **__):
        raise np.linalg.LinAlgError("SVD did not converge")

    for name in ("svd", "lstsq", "eigh"):
        monkeypatch.setattr(np.linalg, name, refuse)


def deficient(shape):
    """Return a matrix of rank 2 at most."""
    rng = np.random.default_rng(3)
    *stack, m, n = shape
    return rng.standard_normal((*stack, m, 2)) @ rng.standard_normal((*stack, 2, n))


@pytest.mark.parametrize("shape", SHAPES[:4])
@pytest.mark.parametrize("full", [False, True])
def test_svd_by_the_other_driver(shape, full, stubborn):
    a = deficient(shape)
    u, s, vt = svd(a, full_matrices=full)
    k = min(shape[-2:])
    assert u.shape[-2:] == (shape[-2], shape[-2] if full else k)
    assert vt.shape[-2:] == (shape[-1] if full else k, shape[-1])
    assert np.allclose((u[..., :k] * s[..., None, :]) @ vt[..., :k, :], a, rtol=0, atol=1e-13)
    assert np.all(np.diff(s, axis=-1) <= 0)


def test_eigenvalues_and_least_squares_by_the_other_driver(stubborn):
    a = deficient((6, 4))
    values, vectors = eigh(a.T @ a)
    assert np.all(np.diff(values) >= 0)
    assert np.allclose((vectors * values) @ vectors.T, a.T @ a, rtol=0, atol=1e-13)
    # the shortest of all solutions: it has no part that changes nothing
    right = np.arange(6.0)
    x = lstsq(a, right, relative=1e-9)
    assert np.allclose(a.T @ (a @ x - right), 0, rtol=0, atol=1e-12)
    assert np.linalg.norm(x) == pytest.approx(np.linalg.norm(vectors[:, 2:].T @ x), rel=1e-12)
    assert lstsq(a, np.eye(6), relative=1e-9).shape == (4, 6)


def test_a_basis_of_columns_without_convergence(stubborn):
    assert orthonormal_basis(deficient((50, 8))).shape == (50, 2)


def test_what_is_not_finite_is_an_error():
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        svd(np.array([[1.0, np.nan], [0.0, 1.0]]))


def test_statistics_and_calibration_decompose_in_one_place():
    direct = re.compile(r"np\.linalg\.(svd|lstsq|pinv|eigh)\(")
    for package in ("statistics", "calibration"):
        for file in sorted((SOURCE / package).rglob("*.py")):
            assert file.name == "decompositions.py" or not direct.search(file.read_text()), file


# Digits of numbers that people read: as many where rounding carries into the next decade


@pytest.mark.parametrize("value", [0.9996, 99.96, 0.09996, 9.9951, 0.00099951, 0.231])
def test_digits_stay_as_many_where_rounding_carries(value):
    """Of 0.9996 three digits are 1.00: in a sentence, in a column, and with an uncertainty."""
    three = three_digits(value)
    assert float(three) == float(f"{value:.3g}")
    assert len(three.replace(".", "").lstrip("0")) == 3
    assert shown_unit("deg", [value]).plain(value) == three
    assert float(measured(1.0, value)[1]) == float(two_digits(value)) == float(f"{value:.2g}")
    assert last_decimal(value, 3) == last_decimal(float(three), 3)


def test_coordinates_have_two_digits_of_their_uncertainty():
    import numpy as np

    assert vector_text(np.array([1.23456, -2.0, 0.0]), 0.0996) == "(1.23, -2.00, 0.00)"


# Robust fits: planted gross errors are found and do no harm; intervals hold the truth as often as they say


NOISE = 0.002
BALLBAR = Path(__file__).parent.parent / "examples" / "machines" / "ballbar_gantry"


def columns_of(rows: int, random: np.random.Generator) -> dict[str, Any]:
    return {"C [rad]": np.repeat(random.uniform(-3, 3, rows // 2), 2), "target": ["p", "r"] * (rows // 2)}


def spoilt(data: dict[str, Any], bad: np.ndarray, kind: str, random: np.random.Generator) -> dict[str, Any]:
    """Spoil rows: their readings in all directions, or all alike; their commands within the travel, or far beyond."""
    data = dict(data)
    if kind == "commands":
        data["C [rad]"] = np.where(bad, random.uniform(-3, 3, len(bad)), data["C [rad]"])
    elif kind == "far commands":
        data["C [rad]"] = np.where(bad, 1e4 * random.normal(size=len(bad)), data["C [rad]"])
    else:
        size = random.normal(size=(3, len(bad))) if kind == "readings" else np.full((3, len(bad)), 0.5)
        for name, change in zip("xyz", size, strict=True):
            data[f"{name} [mm]"] = data[f"{name} [mm]"] + np.where(bad, change, 0.0)
    return data


def wrong_by(found: Fit, truth: dict[str, float]) -> float:
    """Return the largest error of a parameter, in its standard deviations."""
    factors = {p.key: p.factor for p in found.parameters}
    return max(
        abs(e.value * factors[e.key] - truth.get(e.key, 0.0)) / (e.std * factors[e.key])
        for e in found.estimates.values()
        if e.std
    )


# gross errors ----------------------------------------------------------------------------------------------------


@pytest.mark.thorough("0.3-readings", "0.3-readings alike", "0.1-readings alike")
@pytest.mark.parametrize("kind", ["readings", "readings alike", "commands", "far commands"])
@pytest.mark.parametrize("share", [0.1, 0.3])
def test_gross_errors_are_named_and_do_no_harm(share: float, kind: str) -> None:
    random = np.random.default_rng(1)
    data = measure(on_table(), columns_of(100, random), TRUTH, noise=NOISE, random=random)
    bad = np.zeros(100, bool)
    bad[random.choice(100, int(100 * share), replace=False)] = True
    found = fit_to(on_table(), spoilt(data, bad, kind, random), loss="huber")
    # An error of a good size may hit the truth by chance: a command within 50 times the noise does so in 1 of 3000.
    assert np.flatnonzero(found.outliers).tolist() == np.flatnonzero(bad).tolist()
    # The result is a fit of the others, as if the outliers were not there.
    alone = fit_to(on_table(), {key: np.asarray(values)[~bad] for key, values in data.items()})
    assert found.rms == pytest.approx(alone.rms, rel=1e-6)
    for key, e in found.estimates.items():
        assert e.value == pytest.approx(alone.estimates[key].value, abs=1e-3 * e.std)
        assert e.std == pytest.approx(alone.estimates[key].std, rel=1e-3)
    assert found.degrees_of_freedom == alone.degrees_of_freedom


@pytest.mark.thorough
def test_gross_errors_in_the_frame_of_a_robot() -> None:
    """A free frame is started from the readings, so that these pull it far off at first."""
    joints = [
        joint("J1", "revolute", (0, 0, 1)),
        joint("J2", "revolute", (0, 1, 0), (175, 0, 495)),
        joint("J3", "revolute", (0, 1, 0), (175, 0, 1390)),
    ]
    estimate = ["J2.axis", "J2.point", "J3.axis", "J3.point", "target"]
    file = machine_file(joints, [(1320, 90, 1565)], frame="free", estimate=estimate)
    truth = {"frame.x": 900.0, "frame.y": -2000.0, "frame.rz": 2.2, "frame.rx": 0.3, "J3.point.b": 0.4}
    random = np.random.default_rng(2)
    columns = {f"J{i} [rad]": random.uniform(-1.4, 1.4, 120) for i in (1, 2, 3)}
    data = measure(file, columns, truth, noise=0.02, random=random)
    bad = np.zeros(120, bool)
    bad[random.choice(120, 36, replace=False)] = True
    for x in "xyz":
        data[f"{x} [mm]"] = data[f"{x} [mm]"] + np.where(bad, 500 * random.normal(size=120), 0.0)
    found = fit_to(file, data, loss="huber")
    assert np.flatnonzero(found.outliers).tolist() == np.flatnonzero(bad).tolist()
    assert found.rms == pytest.approx(0.02, rel=0.1)  # 252 readings: two standard deviations are 9 %


def test_distances_and_directions() -> None:
    random = np.random.default_rng(3)
    slides = [joint(name, "prismatic", np.eye(3)[i]) for i, name in enumerate("XYZ")]
    ball = machine_file(slides, [(0, 0, 0)], kind="distance", estimate=["target"], noise=0.001)
    columns = {f"{name} [mm]": random.uniform(-100, 100, 80) for name in "XYZ"}
    data = measure(ball, columns, noise=0.001, random=random)
    data["d [mm]"] = np.where(np.arange(80) % 5 == 0, data["d [mm]"] + 0.1, data["d [mm]"])
    found = fit_to(ball, data, loss="huber")
    assert np.flatnonzero(found.outliers).tolist() == list(range(0, 80, 5))
    mount = [joint("AZ", "revolute", (0, 0, -1)), joint("EL", "revolute", (1, 0, 0))]
    stars = machine_file(mount, [(0, 1, 0)], kind="direction", estimate=["AZ.axis", "EL.axis", "target"])
    columns = {"AZ [rad]": random.uniform(-3, 3, 80), "EL [rad]": random.uniform(0.3, 1.3, 80)}
    data = measure(stars, columns, noise=1e-5, random=random)
    wrong = {**data, "AZ [rad]": np.where(np.arange(80) % 5 == 0, data["AZ [rad]"] + 0.01, data["AZ [rad]"])}
    found = fit_to(stars, wrong, loss="huber")
    assert np.flatnonzero(found.outliers).tolist() == list(range(0, 80, 5))
    assert wrong_by(found, {}) < 4


def test_a_row_that_alone_tells_of_something_is_no_outlier() -> None:
    """The third ball is seen once: its place is what that row says, and no row contradicts it."""
    random = np.random.default_rng(4)
    columns = columns_of(40, random)
    columns = {"C [rad]": np.append(columns["C [rad]"], 1.0), "target": [*columns["target"], "s"]}
    file = on_table(targets=[(150, 0, 30), (-40, 90, 110), (10, 10, 10)])
    data = measure(file, columns, TRUTH | {"target.s.x": 25.0}, noise=NOISE, random=random)
    found = fit_to(file, data, loss="huber")
    assert not found.outliers.any()
    # Its own noise, carried along by three parameters that nothing else holds.
    assert found.estimates["target.s.x"].value == pytest.approx(25, abs=4 * found.estimates["target.s.x"].std)


def test_a_missing_effect_is_not_taken_for_outliers() -> None:
    """The example's squareness shows in one of the three planes of the ballbar only."""
    machine, data = Machine.load(BALLBAR / "machine.toml"), Measurements.load(BALLBAR / "data.csv")
    assert not fit(machine, data, loss="huber").outliers.any()


@pytest.mark.thorough
def test_good_data_keep_all_rows() -> None:
    """One of 100 sets may have an outlier; of 20 sets three or more have one with probability 0.001."""
    alarms = 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        data = measure(on_table(), columns_of(24, random), TRUTH, noise=NOISE, random=random)
        found = fit_to(on_table(), data, loss="huber")
        alarms += bool(found.outliers.any())
        if not found.outliers.any():
            # Rounding in the gradient ends a fit at 1e-7 of a standard deviation.
            alone = fit_to(on_table(), data)
            assert (
                wrong_by(found, {k: e.value * _factor(alone, k) for k, e in alone.estimates.items()}) < 1e-3
            )
    assert alarms < 3


def _factor(found: Fit, key: str) -> float:
    return next(p.factor for p in found.parameters if p.key == key)


def test_exact_data_have_no_outliers_but_gross_ones() -> None:
    random = np.random.default_rng(5)
    data = measure(on_table(), columns_of(40, random), TRUTH)
    assert not fit_to(on_table(), data, loss="huber").outliers.any()
    data["x [mm]"] = data["x [mm]"] + np.where(np.arange(40) == 7, 1e-3, 0.0)
    assert np.flatnonzero(fit_to(on_table(), data, loss="huber").outliers).tolist() == [7]


def test_where_nothing_is_estimated_outliers_are_still_named() -> None:
    random = np.random.default_rng(5)
    file = on_table(estimate=[], effects=[])
    data = measure(file, columns_of(40, random), noise=NOISE, random=random)
    data["x [mm]"] = data["x [mm]"] + np.where(np.arange(40) == 7, 0.1, 0.0)
    assert np.flatnonzero(fit_to(file, data, loss="huber").outliers).tolist() == [7]


def test_too_few_rows_to_tell_are_fitted_by_least_squares() -> None:
    random = np.random.default_rng(6)
    data = measure(on_table(), columns_of(4, random), TRUTH, noise=NOISE, random=random)
    assert not fit_to(on_table(), data, loss="huber").outliers.any()


@pytest.mark.parametrize(("m", "k"), HUBER.items())
def test_tuning_constants_have_95_percent_efficiency(m: int, k: float) -> None:
    density = chi(m).pdf
    slope = quad(density, 0, k)[0] + (m - 1) / m * quad(lambda z: density(z) * k / z, k, 40)[0]
    square = quad(lambda z: density(z) * z * z, 0, k)[0] + k * k * chi(m).sf(k)
    assert slope**2 / (square / m) == pytest.approx(0.95, abs=1e-6)


def test_other_losses_are_refused() -> None:
    data = measure(on_table(), columns_of(8, np.random.default_rng(0)))
    with pytest.raises(FitError, match=r"^loss 'cauchy'; expected one of linear, huber$"):
        fit_to(on_table(), data, loss="cauchy")


# coverage --------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("stated", "loss", "sets", "share"),
    [
        pytest.param(False, "linear", 250, 0.0, marks=pytest.mark.slow),
        pytest.param(True, "linear", 250, 0.0, marks=pytest.mark.slow),
        (True, "linear", 100, 0.0),
        (False, "huber", 25, 0.2),
        pytest.param(True, "huber", 25, 0.2, marks=pytest.mark.slow),
    ],
)
def test_intervals_of_95_percent_hold_the_truth_in_93_to_97_of_100_sets(
    stated: bool, loss: str, sets: int, share: float
) -> None:
    """The simulator draws, the fit states intervals; twelve parameters each, which depend on each other somewhat."""
    file = on_table(**({"noise": NOISE} if stated else {}))
    hits = []
    for seed in range(sets):
        random = np.random.default_rng(1000 + seed)
        data = measure(file, columns_of(30, random), TRUTH, noise=NOISE, random=random)
        found = fit_to(file, spoilt(data, random.random(30) < share, "readings", random), loss=loss)
        reach = 1.959964 if stated else t.ppf(0.975, found.degrees_of_freedom)
        for e in found.estimates.values():
            hits.append(abs(e.value - TRUTH.get(e.key, 0.0) / _factor(found, e.key)) < reach * e.std)
    # three standard deviations: of 25 sets of 12 parameters 3.7 %, of 100 sets 1.9 %
    assert np.mean(hits) == pytest.approx(0.95, abs=0.037 if sets == 25 else 0.02)
