"""How errors of readings depend on each other: whitening against dense matrices, variances against known ones, and
whether F tests are right with what was estimated.

Errors are drawn here, in linear algebra: the columns of a model and of its candidates are made once, of each draw only
the part that a fit leaves is looked at.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from fuzz import EXAMPLES, TURNTABLE
from machine_simulator import arcsec
from real_machines import real
from scipy import stats
from simulated_fits import fit_to, joint, machine_file, measure
from work import calls_in

import rodgen
from rodgen.calibration import dependence as correlation
from rodgen.calibration.candidates import candidates
from rodgen.calibration.dependence import Correlation, estimate_correlation
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.sensitivities import Sensitivities
from rodgen.statistics import variance_components
from rodgen.statistics.whitening import Moments, MotionDeviations, Poses, SharedMotion, Weighted, Whitener

NOISE = 0.002
ARCSEC = arcsec(1, "rad")


# against dense matrices --------------------------------------------------------------------------------------------


def small(
    m: int, k: int, rows: Sequence[int], random: np.random.Generator
) -> tuple[SharedMotion, np.ndarray, np.ndarray]:
    """Make a motion of poses in two runs; give it, the times and the runs."""
    of = np.repeat(np.arange(len(rows)), rows)
    run = (np.arange(len(rows)) >= len(rows) // 3).astype(int)
    at = np.cumsum(random.uniform(0.5, 2, len(rows)))
    return SharedMotion(Poses._of(of, at, run, True), random.normal(size=(len(of), m, k))), at, run


def dense(motion: SharedMotion, part: MotionDeviations, at: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Form V."""
    n, m, k = motion.columns.shape
    H = np.zeros((n * m, len(at) * k))
    for i, pose in enumerate(motion.poses.of):
        H[i * m : (i + 1) * m, pose * k : (pose + 1) * k] = motion.columns[i]
    alike = np.exp(-np.abs(at[:, None] - at) / part.time) * (run[:, None] == run)
    moves = np.kron(np.eye(len(at)), np.diag(part.shared**2)) + np.kron(alike, np.diag(part.wander**2))
    return np.eye(n * m) + H @ moves @ H.T


@pytest.mark.parametrize(("m", "k"), [(3, 6), (2, 3), (1, 6), (3, 3)])
@pytest.mark.parametrize(
    ("shared", "wander", "kept"), [(1, 1, 9), (0, 1, 9), (1, 0, 9), (0.3, 30, 1), (0, 0, 9)]
)
def test_whitening_and_likelihood_are_those_of_the_dense_matrix(
    m: int, k: int, shared: float, wander: float, kept: int
) -> None:
    random = np.random.default_rng(m * 10 + k)
    motion, at, run = small(m, k, random.integers(1, 4, 12), random)
    part = MotionDeviations(
        shared * random.uniform(0.5, 2, k), wander * random.uniform(0.5, 2, k) * (np.arange(k) != kept), 5.0
    )
    V = dense(motion, part, at, run)
    N = len(V)
    L = np.linalg.cholesky(V)
    turned = Whitener(motion, part)(L.reshape(-1, m, N)).reshape(N, N)
    np.testing.assert_allclose(turned @ turned.T, np.eye(N), atol=1e-10)  # condition numbers up to 1e5
    C = random.normal(size=(N // m, m, 4))
    weighted = Weighted(Moments(motion, C), part)
    products, flat = weighted.triangle @ weighted.triangle.T, C.reshape(N, 4)
    np.testing.assert_allclose(products, flat.T @ np.linalg.solve(V, flat), atol=1e-9, rtol=1e-9)
    assert weighted.log_determinant == pytest.approx(np.linalg.slogdet(V)[1], abs=1e-9)
    covariance = flat.T @ V @ flat
    np.testing.assert_allclose(motion.covariance_of(part, C), covariance, rtol=1e-9)
    np.testing.assert_allclose(motion.variances_of(part, C), covariance.diagonal(), rtol=1e-9)


def test_where_a_pose_is_one_number_whitening_is_by_the_cholesky_factor() -> None:
    random = np.random.default_rng(1)
    motion, at, run = small(1, 1, [1] * 9, random)
    part = MotionDeviations(np.zeros(1), np.ones(1), 3.0)
    L = np.linalg.cholesky(dense(motion, part, at, run))
    np.testing.assert_allclose(Whitener(motion, part)(L[:, None, :])[:, 0], np.eye(9), atol=1e-12)


def test_rows_may_come_in_any_order_of_time_and_runs() -> None:
    random = np.random.default_rng(2)
    motion, _, _ = small(2, 3, [2, 1, 3, 1, 2, 2], random)
    part = MotionDeviations(np.ones(3), np.ones(3), 2.0)
    shuffled = random.permutation(len(motion.poses.of))
    other = SharedMotion(replace(motion.poses, of=motion.poses.of[shuffled]), motion.columns[shuffled])
    C = random.normal(size=(len(shuffled), 2, 3))
    np.testing.assert_allclose(
        Whitener(other, part)(C[shuffled]), Whitener(motion, part)(C)[shuffled], atol=1e-12
    )


def test_whitening_takes_few_calls_a_row() -> None:
    def calls(n: int) -> int:
        random = np.random.default_rng(3)
        poses = Poses._of(np.arange(n), np.arange(n) * 30.0, np.zeros(n, int), True)
        motion, columns = SharedMotion(poses, random.normal(size=(n, 3, 3))), random.normal(size=(n, 3, 60))
        return calls_in(lambda: Whitener(motion, MotionDeviations(np.zeros(3), np.ones(3), 600.0))(columns))

    assert calls(1000) - calls(500) <= 20 * 500  # 15; each further row, however many there are


# machines whose columns are made once ------------------------------------------------------------------------------


class Bench:
    """Columns of a machine's model and of all candidates.

    Parameters
    ----------
    file : mapping
        The machine.
    columns : mapping
        Commands, times and what else is noted.
    noise : float
        What one standard deviation is, internal units.
    """

    def __init__(self, file: Any, columns: Any, noise: float) -> None:
        random = np.random.default_rng(0)
        fitted = fit_to(file, measure(file, columns, {}, noise=noise, random=random))
        effects = catalogue_effects(fitted.machine, fitted.observations)
        self.sensitivities = Sensitivities.of(fitted, effects)
        self.noise = noise
        found = {c.key: c.columns for c in candidates(self.sensitivities, effects)}
        self.effects = {key: c for key, c in found.items() if np.linalg.norm(c) > 0}
        J = self.sensitivities.model.reshape(self.sensitivities.residual.size, -1)
        u, s, _ = np.linalg.svd(J / np.linalg.norm(J, axis=0), full_matrices=False)
        self.own = u[:, s > 1e-9 * s[0]]
        frame = self.sensitivities.frame
        some = frame[:, :, :3]
        self.moves = some / np.sqrt(np.mean(np.sum(some**2, axis=2)))
        turns = frame[:, :, -3:]
        self.turns = turns / np.sqrt(np.mean(np.sum(turns**2, axis=2)))
        o = self.sensitivities.observations
        self.pose, self.run, self.n = o.pose, o.run, o.n
        self.at = np.arange(o.n) * 1.0 if o.t is None else o.t

    def off(self, error: np.ndarray) -> np.ndarray:
        flat = error.reshape(len(self.own), -1)
        return (flat - self.own @ (self.own.T @ flat)).reshape(error.shape)

    def white(self, random: np.random.Generator) -> np.ndarray:
        return random.normal(size=self.sensitivities.residual.shape)

    def shared(self, random: np.random.Generator, *, turns: bool = False) -> np.ndarray:
        path = random.normal(size=(self.pose.max() + 1, 3))[self.pose]
        return np.einsum("nmk,nk->nm", self.turns if turns else self.moves, path)

    def wander(self, random: np.random.Generator, part: float) -> np.ndarray:
        """Let the frame wander; `part` of the whole time is the correlation time."""
        first = np.unique(self.pose, return_index=True)[1]
        at, run, path = self.at[first], self.run[first], random.normal(size=(len(first), 3))
        for i in range(1, len(first)):
            if run[i] == run[i - 1]:
                keeps = np.exp(-(at[i] - at[i - 1]) / (part * np.ptp(at)))
                path[i] = keeps * path[i - 1] + np.sqrt(1 - keeps**2) * path[i]
        return np.einsum("nmk,nk->nm", self.moves, path[self.pose])

    def effect(self, key: Any, raises: float, random: np.random.Generator) -> np.ndarray:
        """Draw an effect that raises the rms of errors of size 1 by a factor."""
        c = self.effects[key]
        size = np.linalg.norm(c.reshape(-1, c.shape[2]), axis=0)
        seen = self.off((c / np.where(size > 0, size, 1.0)) @ random.normal(size=c.shape[2]))
        return seen * np.sqrt((raises**2 - 1) * seen.size) / np.linalg.norm(seen)

    def estimate(self, error: np.ndarray, nuisance: Any = ()) -> tuple[Correlation, np.ndarray]:
        left = self.off(error) * (
            1.0 if self.sensitivities.fit.observations.sigma is not None else self.noise
        )
        return estimate_correlation(replace(self.sensitivities, residual=left), nuisance), left

    def p_value(self, how: Correlation, left: np.ndarray, columns: np.ndarray) -> float:
        """Return the F test of columns in addition to the model."""
        k = columns.shape[2]
        whole = np.concatenate([self.sensitivities.model, columns, left[:, :, None]], axis=2)
        white = how.whiten(whole).reshape(left.size, -1)
        J, c, y = white[:, : -k - 1], white[:, -k - 1 : -1], white[:, -1]
        u, s, _ = np.linalg.svd(J / np.linalg.norm(J, axis=0), full_matrices=False)
        u = u[:, s > 1e-9 * s[0]]
        c, y = c / np.linalg.norm(c, axis=0), y - u @ (u.T @ y)
        q, s, _ = np.linalg.svd(c - u @ (u.T @ c), full_matrices=False)
        q = q[:, s > 1e-3]
        if not q.shape[1]:
            return 1.0
        fall, spare = np.sum((q.T @ y) ** 2), len(y) - u.shape[1] - q.shape[1]
        return float(stats.f.sf(fall / q.shape[1] / ((y @ y - fall) / spare), q.shape[1], spare))


@cache
def table(poses: int = 60, balls: int = 2, runs: int = 1, order: str = "random") -> Bench:
    """A rotary table with balls, one turn."""
    angle = np.linspace(0, 2 * np.pi, poses, endpoint=False)
    if order == "random":
        np.random.default_rng(poses).shuffle(angle)
    targets = [(150, 0, 30), (-40, 90, 110), (30, -130, -50)][:balls]
    file = machine_file(
        [joint("C", "revolute", (0, 0, 1))], targets, estimate=["C.axis", "C.point", "target"]
    )
    rows = poses * balls
    columns = {
        "C [rad]": np.repeat(angle, balls),
        "target": list("prs"[:balls]) * poses,
        "t [s]": np.repeat(np.arange(poses) * 40.0, balls),
        "run": [f"r{runs * i // rows}" for i in range(rows)],
    }
    return Bench(file, columns, NOISE)


@cache
def mount(stars: int = 80) -> Bench:
    """A telescope's mount and stars anywhere in the sky; no times are noted, but the noise is."""
    random = np.random.default_rng(1)
    joints = [joint("AZ", "revolute", (0, 0, -1)), joint("EL", "revolute", (1, 0, 0))]
    file = machine_file(
        joints, [(0, 1, 0)], kind="direction", frame="free", estimate=["EL.axis", "target"], noise=ARCSEC
    )
    columns = {"AZ [rad]": random.uniform(0, 6, stars), "EL [rad]": random.uniform(0.3, 1.4, stars)}
    return Bench(file, columns, ARCSEC)


@cache
def gantry(poses: int = 80) -> Bench:
    """Three linear axes and one ball, anywhere in the volume, seen by a tracker."""
    random = np.random.default_rng(2)
    axes = {"X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1)}
    joints = [joint(name, "prismatic", axis, travel=[0, 600]) for name, axis in axes.items()]
    file = machine_file(joints, [(50, 20, -100)], frame="free", estimate=["Y.axis", "Z.axis"])
    columns = {f"{name} [mm]": random.uniform(0, 600, poses) for name in axes}
    return Bench(file, {**columns, "t [s]": np.arange(poses) * 30.0}, NOISE)


# variances ---------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("bench", "draws"),
    [
        (mount, 60),
        (gantry, 40),
        *(pytest.param(bench, 120, marks=pytest.mark.slow) for bench in (table, mount, gantry)),
    ],
    ids=["mount", "gantry", "table-120", "mount-120", "gantry-120"],
)
def test_white_data_call_themselves_independent(bench: Any, draws: int) -> None:
    random = np.random.default_rng(5)
    b = bench()
    found = [b.estimate(b.white(random))[0] for _ in range(draws)]
    alone = np.mean([how.independent for how in found])
    assert alone >= 0.79  # 0.85 and more are wanted, less two standard deviations of a share of 120
    of_these = [how.white for how in found if how.independent]
    size = 1.0 if b is mount() else NOISE
    assert np.mean(of_these) == pytest.approx(size, rel=0.02)
    assert all(how.text == "" and how.time == np.inf for how in found if how.independent)
    assert np.mean([how.claimed for how in found]) <= 0.02  # allowed for more often than claimed


@pytest.mark.parametrize("draws", [6, pytest.param(12, marks=pytest.mark.slow)])
def test_what_poses_share_is_estimated(draws: int) -> None:
    random = np.random.default_rng(6)
    b = table(60, 3)
    found = [b.estimate(b.white(random) + 1.5 * b.shared(random))[0] for _ in range(draws)]
    assert np.mean([how.white for how in found]) == pytest.approx(NOISE, rel=0.03)
    assert np.mean([how.size("pose t") for how in found]) == pytest.approx(1.5 * NOISE, rel=0.1)
    assert np.mean([how.size("wander t") > 0 or how.size("wander r") > 0 for how in found]) <= 0.3
    turned = [b.estimate(b.white(random) + 1.5 * b.shared(random, turns=True))[0] for _ in range(draws)]
    assert np.mean([how.size("pose r") for how in turned]) == pytest.approx(1.5 * NOISE, rel=0.12)
    assert np.mean([how.size("pose t") for how in turned]) < 0.3 * NOISE


def test_of_many_targets_some_tell_what_poses_share(monkeypatch: Any) -> None:
    random = np.random.default_rng(16)
    b = table(60, 3)
    errors = [b.white(random) + 1.5 * b.shared(random) for _ in range(6)]
    monkeypatch.setattr(correlation, "MOST_TARGETS", 2)
    found = [b.estimate(error)[0] for error in errors]
    assert np.mean([how.white for how in found]) == pytest.approx(NOISE, rel=0.05)
    assert np.mean([how.size("pose t") for how in found]) == pytest.approx(1.5 * NOISE, rel=0.12)
    columns = b.sensitivities.model
    assert found[0].whiten(columns).shape == columns.shape  # of all targets


@pytest.mark.parametrize("between", [1e-2, 1e-4])
def test_markers_of_one_body_share_the_error_of_its_pose_however_little_else_they_have(
    between: float,
) -> None:
    """Three points of a body of which the pose was measured: nine readings, and six errors."""
    random = np.random.default_rng(8)
    b = table(60, 3)
    found = []
    for _ in range(6):
        body = b.shared(random) + b.shared(random, turns=True)
        found.append(b.estimate(between * b.white(random) + body)[0])
    assert np.mean([how.white for how in found]) == pytest.approx(between * NOISE, rel=0.03)
    assert ("single readings have no error of their own" in found[0].text) == (between < 1e-2)
    assert ("in addition to an independent error" in found[0].text) == (between >= 1e-2)
    for of in (
        "t",
        "r",
    ):  # with independent errors of a 300th: 0.82; what wanders from pose to pose is shared as well
        sizes = [np.hypot(how.size(f"pose {of}"), how.size(f"wander {of}")) for how in found]
        assert np.mean(sizes) == pytest.approx(NOISE, rel=0.08)


@pytest.mark.parametrize("draws", [5, pytest.param(10, marks=pytest.mark.slow)])
def test_a_wander_is_estimated_together_with_what_poses_share(draws: int) -> None:
    random = np.random.default_rng(7)
    b = table(150, 2)
    drawn = [b.white(random) + b.shared(random) + 2 * b.wander(random, 0.05) for _ in range(draws)]
    found = [b.estimate(error)[0] for error in drawn]
    assert np.mean([how.white for how in found]) == pytest.approx(NOISE, rel=0.04)
    assert np.mean([how.size("pose t") for how in found]) == pytest.approx(NOISE, rel=0.15)
    assert np.mean([how.size("wander t") for how in found]) == pytest.approx(2 * NOISE, rel=0.12)
    assert np.median([how.time for how in found]) == pytest.approx(0.05 * np.ptp(b.at), rel=0.4)


@pytest.mark.thorough("40-1.0")
@pytest.mark.parametrize(
    ("poses", "part"), [(40, 0.1), (40, 1.0), pytest.param(200, 1.0, marks=pytest.mark.slow)]
)
def test_a_drift_of_one_sigma_is_found(poses: int, part: float) -> None:
    random = np.random.default_rng(poses)
    b = gantry(poses)
    some = [*b.effects.values()]
    assert sum(c.shape[2] for c in some) > 60
    found = [b.estimate(b.white(random) + b.wander(random, part), some)[0] for _ in range(10)]
    missed = np.mean([how.independent for how in found])
    assert missed <= (0.7 if part == 1.0 and poses == 40 else 0.2)  # a slow one has hardly moved in 40 poses


def test_runs_wander_by_themselves() -> None:
    random = np.random.default_rng(9)
    b = table(80, 2, runs=8)
    found = [b.estimate(b.white(random) + 1.5 * b.wander(random, 1.0))[0] for _ in range(8)]
    # what runs differ by may be taken for itself, or for a wander that begins anew
    sizes = [np.hypot(how.size("wander t"), how.size("run t")) for how in found]
    assert np.mean(sizes) == pytest.approx(1.5 * NOISE, rel=0.3)  # 8 runs: few sizes
    assert not any(how.independent for how in found)


# tests of effects --------------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("bench", "error", "draws"),
    [
        (lambda: table(40), lambda b, r: b.white(r) + b.wander(r, 0.1), 25),
        (mount, lambda b, r: b.white(r) + b.wander(r, 0.3), 60),
        *(
            pytest.param(bench, error, 60, marks=pytest.mark.slow)
            for bench, error in (
                (lambda: table(40), lambda b, r: b.white(r) + b.wander(r, 0.1)),
                (lambda: table(40), lambda b, r: b.white(r) + b.shared(r)),
                (gantry, lambda b, r: b.white(r) + b.wander(r, 1.0)),
            )
        ),
    ],
)
def test_p_values_of_columns_that_follow_nothing_are_uniform(bench: Any, error: Any, draws: int) -> None:
    random = np.random.default_rng(10)
    b = bench()
    # columns of the kinds that are tested: of each pose by itself, and of the joints
    some = [b.sensitivities.frame[:, :, :1] * random.normal(size=b.pose.max() + 1)[b.pose][:, None, None]]
    some += [b.effects[key] for key in sorted(b.effects, key=str) if key[1] is not None][:5]
    p = []
    for _ in range(draws):
        how, left = b.estimate(error(b, random))
        p += [b.p_value(how, left, columns) for columns in some]
    p = np.array([x for x in p if x < 1])  # 360 at most, in sixes from one draw; some columns are the model's
    assert np.mean(p < 0.01) <= 0.03
    assert np.mean(p < 0.1) <= 0.16
    assert np.mean(p < 0.5) == pytest.approx(0.5, abs=0.12)


@pytest.mark.thorough("shared-7")
@pytest.mark.parametrize("draws", [7, pytest.param(15, marks=pytest.mark.slow)])
@pytest.mark.parametrize("error", ["wander", "shared"])
def test_a_drift_is_not_taken_for_an_effect(error: str, draws: int) -> None:
    random = np.random.default_rng(11)
    b = table(40, 2)
    claims = naive = 0
    for _ in range(draws):
        drawn = b.white(random) + (b.wander(random, 0.2) if error == "wander" else b.shared(random))
        how, left = b.estimate(drawn, list(b.effects.values()))
        alone = replace(how, components=None)
        claims += min(b.p_value(how, left, c) for c in b.effects.values()) * len(b.effects) < 0.01
        naive += min(b.p_value(alone, left, c) for c in b.effects.values()) * len(b.effects) < 0.01
    assert claims <= 1
    if error == "wander":
        assert naive >= draws // 2


@pytest.mark.thorough("encoder_eccentricity-36-1.5")
@pytest.mark.parametrize(
    ("name", "poses", "raises"),
    [
        ("encoder_eccentricity", 36, 1.5),
        pytest.param("encoder_eccentricity", 36, 20.0, marks=pytest.mark.slow),
        pytest.param("encoder_eccentricity", 100, 1.3, marks=pytest.mark.slow),
        ("radial_error_motion", 36, 2.0),
    ],
)
def test_an_effect_scanned_once_round_is_not_taken_for_a_drift(name: str, poses: int, raises: float) -> None:
    random = np.random.default_rng(poses)
    b = table(poses, 2, order="one turn")
    found = 0
    for _ in range(5):
        error = b.white(random) + b.effect((name, "C"), raises, random)
        how, left = b.estimate(error, list(b.effects.values()))
        found += b.p_value(how, left, b.effects[name, "C"]) * len(b.effects) < 0.01
    assert found >= 4


# what the fits' standard deviations become ---------------------------------------------------------------------------


def test_a_wander_does_not_take_what_two_effects_do_together(tmp_path) -> None:
    """An eccentricity and a backlash at a joint in four positions passed for turns of the set-up, which only moves."""
    machine, data = real("trunnion", 37).write(tmp_path)
    fitted = rodgen.Machine.load(machine).fit(rodgen.Measurements.load(data))
    effects = catalogue_effects(fitted.machine, fitted.observations)
    sensitivities = Sensitivities.of(fitted, effects)
    alone = estimate_correlation(sensitivities, ())
    assert alone.size("wander r") > 1e-3
    assert alone.size("wander t") > 1e-3
    found = candidates(sensitivities, effects)
    together = estimate_correlation(sensitivities, [c.columns for c in found], [c.tries for c in found])
    assert together.size("wander r") == 0
    assert together.size("wander t") < alone.size("wander t")


def test_the_covariance_of_a_fit_is_that_of_least_squares_under_the_dense_covariance_of_readings() -> None:
    random = np.random.default_rng(12)
    b = table(40, 2)
    fitted = b.sensitivities.fit
    read = fitted.observations.reading + NOISE * (b.white(random) + 2 * b.wander(random, 0.2))
    fitted = fitted.refit(observations=replace(fitted.observations, reading=read))
    how = fitted.dependence.correlation
    assert how._motion is not None
    assert how.size("wander t") > how.white
    flat = fitted.problem.jacobian(fitted.solution.theta, fitted.solution.frame).reshape(240, -1)
    pseudo = np.linalg.pinv(flat / (size := np.linalg.norm(flat, axis=0)), rcond=1e-9) / size[:, None]

    def of(deviations: MotionDeviations) -> np.ndarray:
        white = Whitener(how._motion, deviations)(np.eye(240).reshape(-1, 3, 240)).reshape(240, 240)
        return how.white**2 * pseudo @ np.linalg.inv(white.T @ white) @ pseudo.T

    # of V, and of how uncertain its variances are: the variance of t with as many degrees of freedom
    assert len(how._errors()) == 2
    logs = [[np.log(np.diag(of(how._moved(end)))) for end in (step, -step)] for step in how._errors()]
    freedom = np.maximum(2 / np.sum([((one - other) / 2) ** 2 for one, other in logs], axis=0), 3)
    larger = np.sqrt(freedom / (freedom - 2))
    assert np.ptp(larger) > 0.05
    expected = of(how.deviations) * np.outer(larger, larger)
    np.testing.assert_allclose(fitted.covariance, expected, rtol=1e-5, atol=1e-16)
    std = {p.key: np.sqrt(v) / p.factor for p, v in zip(fitted.parameters, np.diag(expected), strict=True)}
    assert {key: e.std for key, e in fitted.estimates.items()} == pytest.approx(std, rel=1e-5)
    factor = np.sqrt(np.max(np.diag(expected) / np.diag(fitted.independent_covariance)))
    assert fitted.dependence.factor == pytest.approx(factor, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("bench", "most"), [(table, 0.75), (gantry, 0.94)])
@pytest.mark.parametrize(("size", "part"), [(1.0, 0.1), (2.0, 0.1), (1.0, 0.5), (3.0, 0.5)])
def test_intervals_of_a_fit_hold_the_truth_where_the_set_up_wanders(
    bench: Any, most: float, size: float, part: float
) -> None:
    """Of 60 sets each; with the standard deviations of independent readings fewer than `most` are held."""
    random, b = np.random.default_rng(5), bench()
    base = b.sensitivities.fit
    exact = base.observations.reading - base.problem.residuals(base.solution.theta, base.solution.frame)
    off, alone = [], []
    for _ in range(60):
        read = exact + NOISE * (b.white(random) + size * b.wander(random, part))
        fitted = base.refit(observations=replace(base.observations, reading=read))
        std, single = (np.sqrt(np.diag(C)) for C in (fitted.covariance, fitted.independent_covariance))
        known = [i for i in fitted.free if std[i] > 0 and not fitted.determinacy.undetermined[i]]
        off.append(((fitted.values - base.values) / std)[known])
        alone.append(((fitted.values - base.values) / single)[known])
    held, too_sure = (np.mean(np.abs(x) < 1.96) for x in (off, alone))
    # parameters of a set go together: 60 sets tell the share to 2 %
    assert held == pytest.approx(0.95, abs=0.03)
    assert too_sure < most


# where there is little or nothing ------------------------------------------------------------------------------------


def test_what_there_is_too_little_of_is_independent() -> None:
    b = table(7, 1)
    how, _ = b.estimate(b.wander(np.random.default_rng(13), 0.5))
    assert how.independent
    assert how.white > 0
    columns = np.ones((b.n, 3, 2))
    assert how.whiten(columns) is columns


def test_data_without_noise() -> None:
    b = table(40, 2)
    how, left = b.estimate(np.zeros_like(b.sensitivities.residual))
    assert (how.independent, how.white, how.text) == (True, 0.0, "")
    tiny, _ = b.estimate(1e-13 * b.white(np.random.default_rng(1)))
    assert tiny.independent
    only, left = b.estimate(b.wander(np.random.default_rng(14), 0.1))  # nothing is a reading's own
    assert only.white < 0.2 * NOISE < np.hypot(only.size("wander t"), only.size("wander r"))
    assert np.isfinite(only.whiten(left[:, :, None])).all()


def test_rows_that_are_not_believed_tell_nothing() -> None:
    random = np.random.default_rng(15)
    b = table(60, 2)
    error = b.white(random) + b.wander(random, 0.1)
    gone = random.permutation(b.n)[:10]
    weight = np.array(np.broadcast_to(b.sensitivities.weight, error.shape))
    weight[gone] = 1e-100
    left = b.off(error) * NOISE
    left[gone] = 1e-95
    how = estimate_correlation(replace(b.sensitivities, weight=weight, residual=left), [])
    assert how.size("wander t") > 0
    assert how.white == pytest.approx(NOISE, rel=0.2)
    assert how._motion is not None
    assert not how._motion.columns[gone].any()


def test_it_is_said_in_a_sentence() -> None:
    random = np.random.default_rng(16)
    b = table(100, 2)
    how, _ = b.estimate(b.white(random) + 2 * b.wander(random, 0.1) + 2 * b.shared(random))
    assert re.search(r"[Rr]eadings of one pose share an error of [345]\.\d um", how.text)
    assert re.search(r"the set-up wanders by [345]\.\d um", how.text)
    assert "minutes" in how.text
    stars = mount(80)
    how, _ = stars.estimate(stars.white(random) + 2 * stars.wander(random, 0.05))
    assert " arcsec" in how.text
    assert "poses" in how.text


def test_components_that_take_turns_end(tmp_path, monkeypatch):
    """An axis of the wrong sign leaves residuals of decimetres, with which two sets of components cost the same."""
    likelihood = variance_components.RestrictedLikelihood
    weighed, count = likelihood._weighed, []
    monkeypatch.setattr(likelihood, "_weighed", lambda *args: count.append(1) or weighed(*args))
    (tmp_path / "machine.toml").write_bytes(TURNTABLE.replace(b"[0, 0, 1]", b"[0, 0, -1]", 1))
    fit = rodgen.Machine.load(tmp_path / "machine.toml").fit(
        rodgen.Measurements.load(EXAMPLES / "machines/rotary_table/data.csv")
    )
    assert not fit.dependence.independent
    assert len(count) < 1000
