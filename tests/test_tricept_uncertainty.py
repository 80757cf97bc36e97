"""Uncertainty of a Tricept's tool: against a solver of its own and SciPy."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy import stats

from rodgen.kinematics import tricept
from rodgen.kinematics.tricept import PAPER, PARAMETERS, Geometry, TriceptStatus
from rodgen.kinematics.tricept._uncertainty import check_covariance

U_PAPER = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
TOOL = Geometry(330.0, 140.0, (20.0, -35.0, 60.0))
POSES = np.array([[0.0, 0.0, 700.0], [0.15, -0.2, 640.0], [-0.3, 0.25, 720.0], [0.02, 0.4, 600.0]])


# A machine of its own: plain rotations with many digits, every error in place, solved by mpmath.


def turn(axis: int, angle: object) -> mpmath.matrix:
    c, s = mpmath.cos(angle), mpmath.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    made = mpmath.eye(3)
    made[i, i] = made[j, j] = c
    made[i, j], made[j, i] = -s, s
    return made


def tool_of(pose: np.ndarray, geometry: Geometry, errors: dict[str, object]) -> list[object]:
    """Where the tool is when the rods are as the nominal machine has them in a pose, and the rest has errors."""

    def error(name: str) -> object:
        return errors.get(name, mpmath.mpf(0))

    def circle(radius: object) -> list[mpmath.matrix]:
        angles = [2 * mpmath.pi * k / 3 for k in (0, 1, -1)]
        return [mpmath.matrix([radius * mpmath.cos(a), radius * mpmath.sin(a), 0]) for a in angles]

    def triple(name: str) -> mpmath.matrix:
        return mpmath.matrix([error(f"{name}_{axis}") for axis in "xyz"])

    def placed(x: mpmath.matrix, pose: object) -> mpmath.matrix:
        alpha, beta, z = pose
        mount = turn(0, error("mount_x")) * turn(1, error("mount_y")) * turn(2, error("mount_z"))
        on_rod = mpmath.matrix([0, 0, z]) + triple("rod") + mount * x
        # the paper's Ox turns the other way round
        at_axes = mpmath.matrix([0, 0, error("axes_gap")]) + turn(2, error("axes_square")) * turn(
            0, -alpha
        ) * (turn(1, error("rod_tilt")) * on_rod)
        return triple("P") + turn(0, error("axis_x")) * turn(2, error("axis_z")) * turn(1, beta) * at_axes

    def length(one: mpmath.matrix, two: mpmath.matrix) -> object:
        return mpmath.norm(one - two)

    R, r = mpmath.mpf(geometry.R), mpmath.mpf(geometry.r)
    start = [mpmath.mpf(float(x)) for x in pose]
    saved = dict(errors)
    errors.clear()
    rods = [length(placed(m, start), f) for f, m in zip(circle(R), circle(r), strict=True)]
    errors.update(saved)
    rods = [
        rod + error(name) + error(f"zero_{name}") for rod, name in zip(rods, ("A0", "A1", "A-1"), strict=True)
    ]
    fixed = [f + triple(n) for f, n in zip(circle(R + error("R")), "ABC", strict=True)]
    moving = [m + triple(f"{n}p") for m, n in zip(circle(r + error("r")), "ABC", strict=True)]

    def closures(*pose: object) -> list[object]:
        return [
            length(placed(m, pose), f) ** 2 - rod**2 for f, m, rod in zip(fixed, moving, rods, strict=True)
        ]

    # Newton with differences for derivatives: each step gains twelve digits; findroot's line search does not end at
    # a start that is the root to rounding
    found, step = mpmath.matrix(start), mpmath.mpf(10) ** -12
    for _ in range(7):
        here = mpmath.matrix(closures(*found))
        slopes = mpmath.matrix(3, 3)
        for n in range(3):
            beside = found.copy()
            beside[n] += step
            slopes[:, n] = (mpmath.matrix(closures(*beside)) - here) / step
        found -= mpmath.lu_solve(slopes, here)
    assert mpmath.norm(mpmath.matrix(closures(*found))) < mpmath.mpf(10) ** -12
    q = mpmath.matrix([mpmath.mpf(x) for x in geometry.q]) + triple("q")
    return list(placed(q, list(found)))


@pytest.mark.thorough
@pytest.mark.parametrize("row", range(len(POSES)))
def test_sensitivity_is_the_derivative_of_the_solved_machine(row: int) -> None:
    pose = POSES[row]
    found, status = tricept.parameter_sensitivity(pose, TOOL)
    assert status == TriceptStatus.REACHABLE
    # a quarter of the columns for each pose: every column has its turn
    names = PARAMETERS[row :: len(POSES)]
    with mpmath.workdps(30):
        step = mpmath.mpf(10) ** -9
        for name in names:
            ends = [tool_of(pose, TOOL, {name: sign * step}) for sign in (1, -1)]
            slope = [float((a - b) / (2 * step)) for a, b in zip(*ends, strict=True)]
            # step² times third derivatives is below 1e-15 of the size, the kernel rounds to 1e-13 of it
            column = found[:, PARAMETERS.index(name)]
            np.testing.assert_allclose(column, slope, rtol=1e-12, atol=1e-12 * max(1, np.abs(slope).max()))


def test_singular_and_missing_poses_are_reported() -> None:
    poses = [[0.0, 0.0, 0.0], [np.nan, 0.0, 700.0], [0.0, 0.0, 700.0]]
    found, status = tricept.parameter_sensitivity(poses, PAPER)
    assert status.tolist() == [TriceptStatus.SINGULAR, TriceptStatus.INVALID, TriceptStatus.REACHABLE]
    assert np.isnan(found[:2]).all()
    assert np.isfinite(found[2]).all()


# covariance --------------------------------------------------------------------------------------------


def test_covariance_of_all_parameters_contains_the_papers() -> None:
    rng = np.random.default_rng(2)
    root = rng.normal(size=(5, 5)) * 0.004
    U_x = root @ root.T
    U = np.zeros((len(PARAMETERS),) * 2)
    U[:5, :5] = U_x
    points = np.column_stack([rng.uniform(-100, 100, (50, 2)), rng.uniform(600, 760, 50)])
    five, five_status = tricept.propagate(points, TOOL, U_x)
    every, status = tricept.propagate(points, TOOL, U)
    np.testing.assert_allclose(every, five, rtol=1e-10, atol=1e-20)
    assert (status == five_status).all()
    assert np.linalg.eigvalsh(every).min() > 0


def test_what_is_no_covariance_has_a_status() -> None:
    n = len(PARAMETERS)
    good = np.eye(n) * 1e-6
    skew, negative, missing = good.copy(), good.copy(), good.copy()
    skew[0, 1] = 1e-7
    negative[0, 1] = negative[1, 0] = 1.1e-6
    missing[3, 3] = np.nan
    U = np.stack([good, skew, negative, missing])
    found, status = tricept.propagate([0.0, 0.0, 700.0], PAPER, U)
    expected = [
        TriceptStatus.REACHABLE,
        TriceptStatus.NOT_COVARIANCE,
        TriceptStatus.NOT_COVARIANCE,
        TriceptStatus.INVALID,
    ]
    assert status.tolist() == expected
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1:]).all()
    # all-zero rows are certain, and a nonzero covariance with one is inconsistent
    assert tricept.is_covariance(np.zeros((5, 5)))
    beside = np.zeros((5, 5))
    beside[0, 1] = beside[1, 0] = 1e-9
    assert not tricept.is_covariance(beside)


def test_points_without_a_pose_are_reported() -> None:
    U = tricept.covariance({"rods": 0.003})
    points = [[0.0, 0.0, 0.0], [0.0, 0.0, 500.0], [np.nan, 0.0, 600.0]]
    found, status = tricept.propagate(points, Geometry(330, 140, (50, 0, 0)), U, tricept.LEG_LIMITS)
    assert status.tolist() == [TriceptStatus.UNREACHABLE, TriceptStatus.OUT_OF_LIMITS, TriceptStatus.INVALID]
    assert np.isnan(found[[0, 2]]).all()
    assert np.isfinite(found[1]).all()


@pytest.mark.parametrize(
    ("uncertainties", "correlations"),
    [
        ({"rod": 1.0}, {}),
        ({"rods": -1.0}, {}),
        ({"rods": np.nan}, {}),
        ({"rods": 1.0}, {("A0", "A1"): 2.0}),
        ({"rods": 1.0}, {("rods", "rods"): -0.9}),
        ({}, {("A0", "A1"): 0.5}),
        ({"rods": 1.0}, {("A0", "q_x"): 0.5}),
        ({"A0": 1.0, "A1": 1.0}, {("rods", "rods"): 0.5}),
    ],
)
def test_bad_uncertainties_are_refused(refuses, uncertainties: dict, correlations: dict) -> None:
    refuses(tricept.covariance, uncertainties, correlations)


def test_wrong_sizes_are_refused(refuses) -> None:
    refuses(tricept.propagate, [0, 0, 700], PAPER, np.eye(4))
    refuses(check_covariance, [[1, 0.5], [0.4, 1]], 2)


# ellipsoid ---------------------------------------------------------------------------------------------


def test_coverage_factor_is_that_of_chi_squared() -> None:
    for p in (1e-6, 0.199, 0.5, 0.6827, 0.95, 0.9973, 1 - 1e-9):
        assert tricept.ellipsoid(np.eye(3), p).k == pytest.approx(np.sqrt(stats.chi2.ppf(p, 3)), rel=1e-7)


# the exact machine --------------------------------------------------------------------------------------


def test_disturbed_point_is_that_of_the_solved_machine() -> None:
    rng = np.random.default_rng(5)
    scale = np.array([5e-3 if name in tricept.ANGLES else 2.0 for name in PARAMETERS])
    errors = rng.normal(size=(3, len(PARAMETERS))) * scale
    found, status = tricept.disturbed_point(POSES[1:], TOOL, errors)
    assert (status == 0).all()
    with mpmath.workdps(25):
        for pose, row, point in zip(POSES[1:], errors, found, strict=True):
            exact = tool_of(
                pose, TOOL, {n: mpmath.mpf(float(x)) for n, x in zip(PARAMETERS, row, strict=True)}
            )
            np.testing.assert_allclose(point, [float(x) for x in exact], atol=1e-10)


def test_disturbed_point_tells_what_cannot_be() -> None:
    errors = np.zeros((3, len(PARAMETERS)))
    errors[0, 0] = -2000.0
    errors[1, 2] = np.nan
    found, status = tricept.disturbed_point(POSES[0], PAPER, errors)
    assert status.tolist() == [TriceptStatus.UNREACHABLE, TriceptStatus.INVALID, TriceptStatus.REACHABLE]
    assert np.isnan(found[:2]).all()
    np.testing.assert_allclose(found[2], [0, 0, 700], atol=1e-12)


def test_draws_of_the_solved_machine_have_the_covariance_of_the_linear_law() -> None:
    U = tricept.covariance({"rods": 0.003, "fixed_joints": 0.005, "guide_angles": 1e-5}, {("A0", "A1"): 0.6})
    point = np.array([50.0, 20.0, 700.0])
    by_law, _ = tricept.propagate(point, TOOL, U)
    errors = np.random.default_rng(3).multivariate_normal(np.zeros(len(U)), U, 10_000)
    places, status = tricept.disturbed_point(tricept.pose(point, TOOL)[0], TOOL, errors)
    assert (status == 0).all()
    # the covariance of n normal draws is off by sqrt(2/n) = 1.4 %; five times that
    size = np.sqrt(np.diag(by_law))
    off = (np.cov(places.T) - by_law) / np.outer(size, size)
    assert np.abs(off).max() < 5 * np.sqrt(2 / 10_000)
    assert (np.abs(places.mean(axis=0) - point) < 5 * size / np.sqrt(10_000)).all()


# maps --------------------------------------------------------------------------------------------------


def test_a_matrix_that_is_no_covariance_has_no_ellipsoid():
    axes = tricept.ellipsoid(np.array([-np.eye(3), np.diag([4.0, 1.0, 0.0])])).semi_axes
    assert np.isnan(axes[0]).all()
    np.testing.assert_allclose(axes[1], [2, 1, 0], atol=1e-12)
