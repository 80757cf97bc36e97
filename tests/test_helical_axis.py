"""The axis of screws against bodies that SciPy's rotations move, and intervals against repeated draws."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from kinematics_cases import unit
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import f as f_distribution
from scipy.stats import t as student

from rodgen.generated import numpy as generated
from rodgen.kinematics.axis_fit import AxisFit, AxisFitStatus, fit_axis, fit_pose_axis, instantaneous_axes
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.screws import ScrewStatus

EPS = np.finfo(float).eps
AXIS = unit([0.36, -0.48, 0.8])
ACROSS = np.linalg.svd(AXIS[None])[2][1:].T
POINT = np.array([100.0, 20.0, -50.0])
BALLS = np.array([[200.0, 0, 0], [100, 100, 50], [20, -60, 100]])
HOME = Rotation.from_euler("xyz", [10, 20, 30], degrees=True)
TOOL = np.array([150.0, 40.0, 10.0])

Command = Callable[..., tuple[int, str, str]]


def screwed(x: np.ndarray, angle: float, slide: float) -> np.ndarray:
    return POINT + Rotation.from_rotvec(angle * AXIS).apply(x - POINT) + slide * AXIS


def points(
    angles: Any, slides: Any, noise: float = 0.0, seed: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Three balls, all motions from one reading of the first place."""
    rng = np.random.default_rng(seed)
    rest = BALLS + noise * rng.normal(size=BALLS.shape)
    after = [
        screwed(BALLS, a, s) + noise * rng.normal(size=BALLS.shape)
        for a, s in zip(angles, slides, strict=True)
    ]
    return np.tile(rest, (len(after), 1)), np.concatenate(after), np.repeat(np.arange(len(after)), 3)


def poses(
    angles: Any, slides: Any, noise: float = 0.0, turn: float = 0.0, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Poses after screws; the first motion is none."""
    rng = np.random.default_rng(seed)
    both = list(zip([0.0, *angles], [0.0, *slides], strict=True))
    place = np.array([screwed(TOOL[None], a, s)[0] + noise * rng.normal(size=3) for a, s in both])
    attitude = [
        Rotation.from_rotvec(turn * rng.normal(size=3)) * Rotation.from_rotvec(a * AXIS) * HOME
        for a, _ in both
    ]
    return place, np.array([r.as_matrix() for r in attitude])


def from_line(fit: AxisFit) -> float:
    return float(np.linalg.norm(np.cross(fit.point - POINT, AXIS)))


# Kernels ------------------------------------------------------------------------------------------


def exact_screw(x: Any, y: Any, angle: float, slide: float, e: Any, p: Any) -> list[Any]:
    with mpmath.workdps(50):
        x, y, e, p = ([mpmath.mpf(float(c)) for c in v] for v in (x, y, e, p))
        c, s = mpmath.cos(mpmath.mpf(angle)), mpmath.sin(mpmath.mpf(angle))
        a = [x[i] - p[i] for i in range(3)]
        cross = [e[1] * a[2] - e[2] * a[1], e[2] * a[0] - e[0] * a[2], e[0] * a[1] - e[1] * a[0]]
        along = sum(e[i] * a[i] for i in range(3))
        square = sum(c * c for c in e)
        # Rodrigues' formula, whose double cross product has |e|², not 1: a float axis is not quite a unit vector
        double = [e[i] * along - square * a[i] for i in range(3)]
        return [y[i] - x[i] - s * cross[i] - (1 - c) * double[i] - mpmath.mpf(slide) * e[i] for i in range(3)]


@pytest.mark.parametrize("functions", [kernels, generated.ALL], ids=["compiled", "numpy"])
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.3, math.pi - 1e-9, math.pi, -7.0])
def test_screw_residual_agrees_with_50_digits(functions: Any, angle: float) -> None:
    y = screwed(BALLS, angle, 0.3) + np.array([0.01, -0.02, 0.03])
    d, jacobian = functions.screw_residual(BALLS, y, angle, 0.25, AXIS, POINT)
    for k, ball in enumerate(BALLS):
        exact = [float(c) for c in exact_screw(ball, y[k], angle, 0.25, AXIS, POINT)]
        assert d[k] == pytest.approx(exact, abs=8 * EPS * np.abs(BALLS).max())
        alone, alone_jacobian = functions.screw_residual(ball, y[k], angle, 0.25, AXIS, POINT)
        assert alone == pytest.approx(d[k], abs=EPS * 300)
        assert alone_jacobian == pytest.approx(jacobian[k], abs=EPS * 300)
    h = 1e-5  # central differences: h² and eps/h are below 1e-8 of lengths of 300
    start = np.concatenate([BALLS[0], [angle, 0.25], AXIS, POINT])

    def value(v: np.ndarray) -> np.ndarray:
        return functions.screw_residual(v[:3], y[0], v[3], v[4], v[5:8], v[8:])[0]

    slopes = np.stack([(value(start + h * u) - value(start - h * u)) / (2 * h) for u in np.eye(11)], axis=1)
    assert jacobian[0] == pytest.approx(slopes, abs=1e-8 * 300)


# Exact data ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [1e-6, 1e-3, 0.7, 2.0, math.pi - 1e-6, math.pi - 1e-9])
def test_exact_points_and_poses_give_the_screw(angle: float) -> None:
    x, y, move = points([angle], [0.3])
    place, attitude = poses([angle], [0.3])
    chord = 2 * math.sin(angle / 2)
    lost = (
        10 * 300 * EPS / (100 * chord)
    )  # roundings of coordinates of 300, of arms of 100 that move by the chord
    for fit in (
        fit_axis(x, y, move=move, sigma=1e-9),
        fit_pose_axis(place, attitude, sigma=1e-9, sigma_angle=1e-12),
    ):
        assert fit.axis == pytest.approx(AXIS, abs=lost)
        assert from_line(fit) < lost * (300 + 0.3 / chord)  # the slide goes astray with the axis
        assert fit.motions.angles == pytest.approx([angle], abs=100 * EPS)
        assert fit.motions.slides == pytest.approx([0.3], abs=300 * lost)


def test_agrees_with_scipy_on_shared_readings() -> None:
    """All unknowns, the true places of the balls at rest among them, by another solver from the truth."""
    angles, slides = [0.5, 1.0, 1.6], [0.1, 0.0, -0.2]
    x, y, move = points(angles, slides, noise=0.05)
    fit = fit_axis(x, y, move=move, sigma=0.05)

    def misses(v: np.ndarray) -> np.ndarray:
        e = unit(AXIS + ACROSS @ v[:2])
        p = POINT + ACROSS @ v[2:4]
        balls = v[10:].reshape(3, 3)
        after = [
            p + Rotation.from_rotvec(a * e).apply(balls - p) + s * e
            for a, s in zip(v[4:7], v[7:10], strict=True)
        ]
        return np.concatenate([(balls - x[:3]).ravel(), (np.concatenate(after) - y).ravel()]) / 0.05

    truth = np.concatenate([np.zeros(4), angles, slides, BALLS.ravel()])
    best = least_squares(misses, truth, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert fit.chi_square == pytest.approx(2 * best.cost, rel=1e-9)
    assert fit.motions.angles == pytest.approx(best.x[4:7], abs=1e-8)
    assert fit.motions.slides == pytest.approx(best.x[7:10], abs=1e-5)
    covariance = np.linalg.inv(best.jac.T @ best.jac)
    assert fit.motions.angle_uncertainty == pytest.approx(np.sqrt(np.diag(covariance)[4:7]), rel=1e-4)
    assert fit.motions.slide_uncertainty == pytest.approx(np.sqrt(np.diag(covariance)[7:10]), rel=1e-4)
    spread = np.linalg.eigvalsh(covariance[:2, :2])[::-1]
    assert fit.axis_uncertainty == pytest.approx(np.sqrt(spread), rel=1e-4)
    assert fit.dof == len(best.fun) - len(best.x)


# Near nothing, and near half turns ----------------------------------------------------------------


def test_without_a_turn_there_is_no_axis() -> None:
    x, y, move = points([0.0], [0.5], noise=0.01)
    fit = fit_axis(x, y, move=move, sigma=0.01)
    assert fit.status is AxisFitStatus.ANY_AXIS
    assert "no motion turns" in fit.undetermined[0]
    exact = points([0.0], [0.5])
    assert fit_axis(exact[0], exact[1]).status is AxisFitStatus.ANY_AXIS


@pytest.mark.parametrize("moves", ["rests", "slides", "turns where it is read"])
def test_readings_without_any_error_are_fitted(moves: str) -> None:
    turns = moves.startswith("turns")
    attitude = Rotation.from_rotvec(np.outer(np.linspace(0, 1, 5) * turns, [0, 0, 1])).as_matrix()
    place = np.linspace([0, 0, 0], [2.0, 0, 0], 5) * (moves == "slides")
    fit = fit_pose_axis(place, attitude)
    assert fit.rms < 1e-15
    assert fit.status is (AxisFitStatus.DETERMINED if turns else AxisFitStatus.ANY_AXIS)
    assert np.isnan(fit.axis_uncertainty).all() != turns
    assert fit.motions.no_slide == pytest.approx(float(moves != "slides"))


@pytest.mark.parametrize("kind", ["points", "poses"])
def test_half_turns_have_an_axis_without_a_sign(kind: str) -> None:
    if kind == "points":
        x, y, move = points([math.pi], [0.5], noise=0.01)
        fit = fit_axis(x, y, move=move, sigma=0.01)
    else:
        fit = fit_pose_axis(*poses([math.pi], [0.5], 0.01, 1e-4), sigma=0.01, sigma_angle=1e-4)
    assert fit.status is AxisFitStatus.SIGN_FREE
    assert fit.candidate_axes.tolist() == [fit.axis.tolist(), (-fit.axis).tolist()]
    assert abs(fit.axis @ AXIS) == pytest.approx(1, abs=1e-6)
    assert np.abs(fit.motions.slides) == pytest.approx([0.5], abs=0.1)


def test_the_sign_follows_the_first_motion_that_has_one() -> None:
    fit = fit_pose_axis(*poses([math.pi, 1.0, -2.0], [0, 0, 0], 0.01, 1e-4))
    assert fit.status is AxisFitStatus.DETERMINED
    assert fit.axis == pytest.approx(AXIS, abs=1e-3)
    assert fit.motions.angles[1:] == pytest.approx([1.0, -2.0], abs=1e-3)


# Slides -------------------------------------------------------------------------------------------


def test_a_slide_within_its_uncertainty_is_called_zero() -> None:
    x, y, move = points([1.0], [0.0], noise=0.01)
    fit = fit_axis(x, y, move=move, sigma=0.01)
    assert fit.motions.no_slide > 0.05
    assert "zero within its uncertainty" in fit.summary()
    x, y, move = points([1.0], [0.5], noise=0.01)
    moved = fit_axis(x, y, move=move, sigma=0.01)
    assert moved.motions.no_slide < 1e-6
    assert "zero within" not in moved.summary()
    assert moved.motions.slides == pytest.approx([0.5], abs=4 * moved.motions.slide_uncertainty[0])


def test_a_screw_has_one_pitch() -> None:
    angles = np.radians(np.arange(20, 160, 20))
    fit = fit_pose_axis(*poses(angles, 0.8 * angles, 0.02, 1e-4))
    assert fit.slide == pytest.approx(0.8, abs=4 * fit.slide_uncertainty)
    assert fit.motions.one_pitch > 0.01
    assert re.search(r"in proportion to the angles: 0\.[78]\d* ± 0\.0\d+ for each radian", fit.summary())
    bent = fit_pose_axis(*poses(angles, np.where(angles > 1, 0.5, 0.0), 0.02, 1e-4))
    assert bent.motions.one_pitch < 1e-6
    assert "not in proportion" in bent.summary()


# Readings that motions share ----------------------------------------------------------------------


def coverage(
    draw: Callable[[int], AxisFit], angle: float, slide: float, count: int
) -> tuple[float, float, float]:
    """Shares of draws whose 95 % regions hold the line, and intervals the second last motion's angle and slide."""
    line, turned, slid = [], [], []
    for seed in range(count):
        fit = draw(seed)
        dof = 1e9 if fit.sigma_given else fit.dof
        sign = math.copysign(1, fit.axis @ AXIS)
        at = fit.point + ((POINT - fit.point) @ AXIS) / (fit.axis @ AXIS) * fit.axis
        along = float(AXIS @ (fit.point - POINT))
        T = np.zeros((4, 6))
        T[:2, :3], T[2:, :3], T[2:, 3:] = sign * ACROSS.T, -along * sign * ACROSS.T, ACROSS.T
        error = np.concatenate([ACROSS.T @ (sign * fit.axis), ACROSS.T @ (at - POINT)])
        line.append(
            error @ np.linalg.solve(T @ fit.covariance @ T.T, error) < 4 * f_distribution.ppf(0.95, 4, dof)
        )
        off = np.remainder(sign * fit.motions.angles[-1] - angle + math.pi, 2 * math.pi) - math.pi
        turned.append(abs(off) < student.ppf(0.975, dof) * fit.motions.angle_uncertainty[-1])
        slid.append(
            abs(sign * fit.motions.slides[-1] - slide)
            < student.ppf(0.975, dof) * fit.motions.slide_uncertainty[-1]
        )
    return float(np.mean(line)), float(np.mean(turned)), float(np.mean(slid))


CASES: dict[str, Callable[[int], AxisFit]] = {
    "points, one motion": lambda s: _of_points([1.0], [0.3], s, sigma=0.02),
    "points, shared rest": lambda s: _of_points([1.0, 1.1, 1.2, 1.3, 1.4], [0.3] * 5, s),
    "points, small angle": lambda s: _of_points([0.02], [0.3], s, sigma=0.02),
    "points, near half a turn": lambda s: _of_points([math.pi - 1e-3], [0.3], s, sigma=0.02),
    "points, read angles": lambda s: _of_read_angles([1.0, 1.2], s),
    "poses, one motion": lambda s: fit_pose_axis(
        *poses([1.0], [0.3], 0.02, 3e-4, s), sigma=0.02, sigma_angle=3e-4
    ),
    "poses, shared first": lambda s: fit_pose_axis(*poses(np.linspace(1, 2, 10), [0.3] * 10, 0.02, 3e-4, s)),
}


def _of_points(angles: list[float], slides: list[float], seed: int, **options: Any) -> AxisFit:
    x, y, move = points(angles, slides, 0.02, seed)
    return fit_axis(x, y, move=move, **options)


def _of_read_angles(angles: list[float], seed: int) -> AxisFit:
    x, y, move = points(angles, [0.3] * len(angles), 0.02, seed)
    read = np.array(angles) + 1e-4 * np.random.default_rng(seed + 5000).normal(size=len(angles))
    return fit_axis(x, y, move=move, sigma=0.02, angle=np.repeat(read, 3), sigma_angle=1e-4)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "case", [pytest.param(c, marks=[pytest.mark.slow] * (c == "poses, shared first")) for c in CASES]
)
def test_95_percent_intervals_hold_95_percent(case: str) -> None:
    angle = {"shared rest": 1.4, "small": 0.02, "read": 1.2, "half": math.pi - 1e-3, "shared first": 2.0}
    angle_of = next((a for words, a in angle.items() if words in case), 1.0)
    shares = coverage(CASES[case], angle_of, 0.3, 300)
    # 3.29 standard deviations of a share of 300 draws: 99.9 %
    assert shares == pytest.approx([0.95] * 3, abs=3.29 * math.sqrt(0.95 * 0.05 / 300))


def test_an_angle_reading_that_rows_share_is_one_reading() -> None:
    """Its error moves all balls of its turn alike: with it exact the points know the axis better than they do."""
    x, y, move = points([1.0, 1.2], [0, 0], noise=0.01)
    angle = np.repeat([1.0 + 2e-4, 1.2 - 1e-4], 3)
    free = fit_axis(x, y, move=move, sigma=0.01)
    read = fit_axis(x, y, move=move, sigma=0.01, angle=angle, sigma_angle=1e-6)
    assert read.motions.angles == pytest.approx(angle[[0, 3]], abs=1e-6)
    assert read.motions.angle_uncertainty.max() < 1.01e-6 < free.motions.angle_uncertainty.min()
    assert read.dof == free.dof + 2
    loose = fit_axis(x, y, move=move, sigma=0.01, angle=angle, sigma_angle=1.0)
    assert loose.motions.angles == pytest.approx(free.motions.angles, abs=1e-7)
    assert loose.axis_uncertainty == pytest.approx(free.axis_uncertainty, rel=1e-6)


# Input --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        lambda x, y: ((x[:2], y[:2]), {}),
        lambda x, y: ((np.outer([1, 2, 3], AXIS), np.outer([1, 2, 3], AXIS)), {}),
        lambda x, y: ((x, y[:2]), {}),
        lambda x, y: ((np.tile(x, (2, 1)), np.concatenate([y, y + 1])), {}),
        lambda x, y: ((x, np.where(y == y[1, 1], np.nan, y)), {}),
        lambda x, y: ((x, y), {"angle": [1, 1, 2.0], "sigma": 1.0, "sigma_angle": 1.0}),
        lambda x, y: ((x, y), {"angle": [1, 1, 1.0], "sigma_angle": 1.0}),
        lambda x, y: ((x, y), {"weights": [1, 1, 1.0], "loss": "huber"}),
        lambda x, y: ((x, y), {"sigma_angle": 1.0}),
        lambda x, y: ((x, y), {"move": [1, 2]}),
    ],
)
def test_bad_points_are_refused_in_words(refuses, change: Any) -> None:
    x, y, _ = points([1.0], [0.0])
    arguments, options = change(x, y)
    refuses(fit_axis, *arguments, **options)


def test_bad_poses_are_refused_in_words(refuses) -> None:
    place, attitude = poses([1.0], [0.0])
    refuses(fit_pose_axis, place[:1], attitude[:1])
    refuses(fit_pose_axis, place, attitude * [[[1.0]], [[1.1]]])
    refuses(fit_pose_axis, place, attitude, sigma=0.1)


# The command --------------------------------------------------------------------------------------


def pose_table(path: Path, notation: str, angles: Any) -> Path:
    place, attitude = poses(angles, 0.2 * np.asarray(angles), 0.01, 1e-4)
    turns = Rotation.from_matrix(attitude)
    heads, values = {
        "quaternion": ("qw,qx,qy,qz", turns.as_quat(scalar_first=True)),
        "matrix": (",".join(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), attitude.reshape(-1, 9)),
        "vector": ("rx [deg],ry [deg],rz [deg]", np.degrees(turns.as_rotvec())),
    }[notation]
    rows = np.concatenate([place, values], axis=1)
    path.write_text(
        f"x [mm],y [mm],z [mm],{heads}\n"
        + "\n".join(",".join(f"{v:.9f}" for v in row) for row in rows)
        + "\n"
    )
    return path


@pytest.mark.parametrize("notation", ["quaternion", "matrix", "vector"])
def test_the_command_reads_poses(notation: str, tmp_path: Path, rodgen_command: Command) -> None:
    file = pose_table(tmp_path / "poses.csv", notation, np.radians([20, 40, 60, 80, 100, 120]))
    code, text, _ = rodgen_command("fit-axis", file, "--near", "0,0,0")
    assert code == 0
    assert "Helical axis of 6 motions: DETERMINED" in text
    assert "nearest to (0, 0, 0)" in text
    _, printed, _ = rodgen_command("fit-axis", file, "--json", "--sigma", "10um", "--sigma-angle", "0.1mrad")
    found = json.loads(printed)
    assert found["axis"] == pytest.approx(AXIS, abs=1e-3)
    assert found["motions"]["slides"] == pytest.approx(0.2 * np.radians([20, 40, 60, 80, 100, 120]), abs=0.1)
    assert found["unit"] == "mm"


def test_the_command_reads_points_without_an_angle(
    tmp_path: Path, rodgen_command: Command, refuses_command
) -> None:
    x, y, move = points([0.5, 1.0], [0.3, 0.3], noise=0.01)
    y[4] += 1.0
    heads = ",".join(f"{p}_{c} [mm]" for p in ("rho", "rho_prime") for c in "xyz")
    rows = [",".join(f"{v:.6f}" for v in (*a, *b)) + f",move {k}" for a, b, k in zip(x, y, move, strict=True)]
    file = tmp_path / "turns.csv"
    file.write_text("\n".join([f"{heads},move", *rows]) + "\n")
    code, text, _ = rodgen_command("fit-axis", file, "--sigma", "0.01mm")
    assert code == 0
    assert "move 0" in text
    assert "outliers    1: line 6 of turns.csv" in text  # the ball that moved
    refuses_command("fit-axis", file, "--loss", "huber")
    file.write_text(file.read_text().replace(",move", ",Move", 1))
    refuses_command("fit-axis", file)


@pytest.mark.parametrize("kind", ["poses", "points"])
def test_what_is_drawn_are_the_readings_and_their_residuals(
    kind: str, tmp_path: Path, rodgen_command: Command
) -> None:
    from rodgen.data.tables import read_motions
    from rodgen.output import figures

    if kind == "poses":
        file = pose_table(tmp_path / "t.csv", "quaternion", np.radians([20, 40, 60, 80]))
        table = read_motions(file)
        fit = fit_pose_axis(*poses([0.3, 0.6, 1.0, 1.4], [0.1] * 4, 0.01, 1e-4))
        assert fit.residuals.shape == table.position.shape
        assert fit.turns[0] == 0
    else:
        x, y, move = points([0.5, 1.0], [0.3, 0.3], noise=0.01)
        fit = fit_axis(x, y, move=move)
        back = [
            fit.point + Rotation.from_rotvec(a * fit.axis).apply(b - fit.point) + s * fit.axis
            for a, b, s in zip(fit.turns, x, np.repeat(fit.motions.slides, 3), strict=True)
        ]
        assert fit.residuals == pytest.approx(
            y - np.array(back), abs=1e-12 * 300
        )  # roundings of lengths of 300
        heads = ",".join(f"{p}_{c} [mm]" for p in ("rho", "rho_prime") for c in "xyz")
        rows = [",".join(f"{v:.6f}" for v in (*a, *b)) + f",m{k}" for a, b, k in zip(x, y, move, strict=True)]
        file = tmp_path / "t.csv"
        file.write_text("\n".join([f"{heads},move", *rows]) + "\n")
        table = read_motions(file)
    drawn = {trace.name: trace for trace in figures.axis_fit(fit, table).data}
    assert len(drawn["along the axis"].y) == len(fit.residuals)
    assert drawn["along the axis"].y == pytest.approx(fit.residuals @ fit.axis, abs=1e-9)
    code, _, error = rodgen_command("fit-axis", file, "--plot", tmp_path / "axis.html")
    assert (code, error) == (0, "")
    assert "Residuals [mm]" in (tmp_path / "axis.html").read_text()


def test_a_bad_quaternion_is_named_by_its_line(refuses_command, tmp_path: Path) -> None:
    file = tmp_path / "poses.csv"
    file.write_text("x [mm],y [mm],z [mm],qw,qx,qy,qz\n0,0,0,1,0,0,0\n1,0,0,1,1,0,0\n")
    refuses_command("fit-axis", file)


# Instantaneous ------------------------------------------------------------------------------------


def test_velocity_axis_moves_along_itself() -> None:
    rng = np.random.default_rng(3)
    omega, speed, at, near = rng.normal(size=(4, 50, 3)) * [[[1]], [[10]], [[100]], [[100]]]
    for functions in (kernels, generated.ALL):
        helical, jacobian = functions.velocity_axis(omega, speed, at, near)
        axis, point, pitch, rate, slide = np.split(helical, [3, 6, 7, 8], axis=1)
        assert axis * rate == pytest.approx(omega, abs=1e-14)
        assert speed + np.cross(omega, point - at) == pytest.approx(pitch * omega, abs=1e-11)
        assert ((point - near) * omega).sum(axis=1) == pytest.approx(np.zeros(50), abs=1e-11)
        assert slide == pytest.approx(pitch * rate, rel=1e-12)
        alone, slopes = functions.velocity_axis(omega[0], speed[0], at[0], near[0])
        assert alone == pytest.approx(helical[0], rel=1e-13)
        start, h = np.concatenate([omega[0], speed[0], at[0]]), 1e-6

        def value(v: np.ndarray, functions: Any = functions) -> np.ndarray:
            return functions.velocity_axis(v[:3], v[3:6], v[6:], near[0])[0]

        differences = np.stack(
            [(value(start + h * u) - value(start - h * u)) / (2 * h) for u in np.eye(9)], axis=1
        )
        assert slopes == pytest.approx(differences, rel=1e-5, abs=1e-6)
        assert jacobian[0] == pytest.approx(slopes, rel=1e-13)


def trajectory(
    n: int, seed: int, spin: float = 1.0, kick: float = 3.0, noise: float = 0.2, turn: float = 2e-3
) -> Any:
    """A body whose accelerations wander, in steps twenty times finer than the poses: times, poses, and the truth."""
    rng = np.random.default_rng(seed)
    fine, h = 20, 0.05 / 20
    omega, gain, R = np.array([0.0, 0.0, spin]), np.zeros(3), Rotation.identity()
    x, v, a = np.zeros(3), np.array([30.0, 0, 10]), np.zeros(3)
    truth = []
    for step in range(n * fine):
        if step % fine == 0:
            truth.append((x, v, R.as_matrix(), omega))
        R = Rotation.from_rotvec((omega + gain * h / 2) * h) * R
        x, v, omega = x + v * h + a * h**2 / 2, v + a * h, omega + gain * h
        gain, a = (
            gain + kick * math.sqrt(h) * rng.normal(size=3),
            a + 100 * kick * math.sqrt(h) * rng.normal(size=3),
        )
    place, speed, attitude, omegas = map(np.array, zip(*truth, strict=True))
    turned = Rotation.from_rotvec(turn * rng.normal(size=(n, 3))).as_matrix() @ attitude
    return np.arange(n) * 0.05, place + noise * rng.normal(size=(n, 3)), turned, omegas, speed, place


def shares(spin: float, draws: int, n: int) -> list[float]:
    """Shares of instants whose 95 % intervals hold the truth: rate, slide, point, axis."""
    held = []
    for seed in range(draws):
        t, place, attitude, omega, speed, at = trajectory(n, seed, spin)
        found = instantaneous_axes(t, place, attitude, origin=(0, 0, 0))
        rate = np.linalg.norm(omega, axis=1)
        e = omega / rate[:, None]
        point = at - (at * e).sum(axis=1)[:, None] * e + np.cross(omega, speed) / rate[:, None] ** 2
        some = found.status < ScrewStatus.COUPLE
        z = [
            (found.rate - rate) / found.rate_uncertainty,
            (found.slide_rate - (e * speed).sum(axis=1)) / found.slide_rate_uncertainty,
            (found.point - point) / found.point_uncertainty,
            (found.axis - e) / np.sqrt(np.einsum("nii->ni", found.covariance)[:, :3]),
        ]
        held.append([np.mean(np.abs(part[some]) < 1.96) for part in z])
    return np.mean(held, axis=0).tolist()


@pytest.mark.slow
@pytest.mark.parametrize("spin", [1.0, 10.0])
def test_instantaneous_95_percent_intervals_hold_95_percent(spin: float) -> None:
    # Errors of neighbours are alike: 40 draws of 80 poses have some 40 * 20 independent ones. The noise and the
    # roughness are estimated from the poses as well, which takes a share of up to 1 %.
    assert shares(spin, 40, 80) == pytest.approx([0.95] * 4, abs=0.01 + 3.29 * math.sqrt(0.95 * 0.05 / 800))


@pytest.mark.thorough
def test_a_body_at_rest_and_one_that_only_slides_have_no_axis() -> None:
    t = np.linspace(0, 1, 50)
    for slide, status in ((0.0, ScrewStatus.ZERO), (50.0, ScrewStatus.COUPLE)):
        shares = []
        for seed in range(4):
            rng = np.random.default_rng(seed)
            attitude = Rotation.from_rotvec(1e-3 * rng.normal(size=(50, 3))).as_matrix()
            place = slide * t[:, None] * [1, 0, 0] + 0.01 * rng.normal(size=(50, 3))
            found = instantaneous_axes(t, place, attitude)
            shares.append(np.mean(found.status == status))
            none = found.status >= ScrewStatus.COUPLE
            assert np.isnan(found.axis[none]).all()
            assert np.isnan(found.pitch[none]).all()
            assert np.isfinite(found.rate).all()
        # An axis by chance (χ² of 3 above 9: 3 %), a slide by chance (5 %); all instants of a draw are alike, so that
        # shares of draws spread by some tenth.
        assert np.mean(shares) > 0.75
    still = instantaneous_axes(t, np.ones((50, 3)), np.broadcast_to(np.eye(3), (50, 3, 3)))
    assert set(still.status.tolist()) == {ScrewStatus.ZERO}


@pytest.mark.parametrize(
    "change",
    [
        lambda t, p, r: (t[:4], p[:4], r[:4]),
        lambda t, p, r: (np.where(t == t[2], t[1], t), p, r),
        lambda t, p, r: (t[:-1], p, r),
    ],
)
def test_bad_trajectories_are_refused_in_words(refuses, change: Any) -> None:
    t, place, attitude, *_ = trajectory(8, 0)
    refuses(instantaneous_axes, *change(t, place, attitude))


def test_the_command_writes_the_axis_of_each_instant(
    tmp_path: Path, rodgen_command: Command, refuses_command
) -> None:
    t, place, attitude, *_ = trajectory(30, 1)
    quaternions = Rotation.from_matrix(attitude).as_quat(scalar_first=True)
    rows = np.column_stack([1e3 * t, place, quaternions])
    file, output = tmp_path / "trajectory.csv", tmp_path / "axes.csv"
    heads = "t [ms],x [mm],y [mm],z [mm],qw,qx,qy,qz"
    file.write_text(heads + "\n" + "\n".join(",".join(f"{v:.9f}" for v in row) for row in rows) + "\n")
    code, text, _ = rodgen_command("fit-axis", file, "--instantaneous", "-o", output, "--near", "0,0,0")
    assert code == 0
    assert "Instantaneous helical axes of 30 poses" in text
    head, *lines = output.read_text().splitlines()
    assert head.startswith("t [s],axis_x,axis_y,axis_z,u_axis [rad],point_x [mm]")
    assert len(lines) == 30
    assert float(lines[-1].split(",")[0]) == pytest.approx(1.45)
    for options in (["-o", str(output)], ["--instantaneous", "--loss", "huber"]):
        refuses_command("fit-axis", file, *options)
    file.write_text(file.read_text().replace("t [ms]", "time [ms]"))
    refuses_command("fit-axis", file, "--instantaneous")
