"""What a diagnosis computes with: columns of candidates, scores, errors on blocks left out, rows that are wrong.

Columns are held against the Jacobian of a model that has the effects; everything else against plain least squares on
matrices that are made up here, and probabilities against SciPy and mpmath.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from real_machines import real
from scipy import stats

from rodgen.calibration.checks.gross import are_neighbours, gross_errors
from rodgen.calibration.checks.held_out import folds_of_rows
from rodgen.calibration.diagnose import search
from rodgen.calibration.diagnose.candidate_space import CandidateSpace
from rodgen.calibration.diagnose.candidates import Candidate, candidates
from rodgen.calibration.diagnose.evidence import Screening, gather_evidence
from rodgen.calibration.diagnose.poses import Blocks
from rodgen.calibration.diagnose.sensitivities import Sensitivities, is_direct
from rodgen.calibration.fit import Fit, fit
from rodgen.calibration.noise.correlation import MOST_ROWS, sample_of
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind
from rodgen.data.measurements import Measurements
from rodgen.data.observations import Observations
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.machine import Machine
from rodgen.machines.model import Model
from rodgen.statistics.f_tests import log_p_of_fall
from rodgen.statistics.thresholds import EVIDENCE

EXAMPLES = Path(__file__).parent.parent / "examples" / "machines"
QUICK = ("mount", "rotary_table", "positioner", "ballbar_gantry")
SLOW = ("gantry_rotary", "trunnion", "robot_6r_tracker")  # models with many effects take long to derive
slow = pytest.mark.slow
ALL = [*QUICK, *(pytest.param(name, marks=slow) for name in SLOW)]

ROWS = 60


# every candidate's columns -----------------------------------------------------------------------------------


def table_of(name: str) -> dict[str, np.ndarray]:
    """Return some rows of an example, with columns of everything that an effect may use."""
    (path,) = (EXAMPLES / name).glob("*.csv")
    with path.open(encoding="utf-8") as stream:
        header, *body = csv.reader(stream)
    some = [body[int(i)] for i in np.linspace(0, len(body) - 1, ROWS)]
    table = {}
    for key, column in zip(header, zip(*some, strict=True), strict=True):
        text = key in ("target", "run")
        table[key] = np.array(column) if text else np.array(column, float)
    random = np.random.default_rng(1)
    there = {key.split(" ")[0] for key in table}
    for joint in Machine.load(EXAMPLES / name / "machine.toml").joints:
        unit = "deg/s" if joint.type == "revolute" else "mm/s"
        table[f"dir_{joint.name}"] = random.choice([-1.0, 1.0], ROWS)
        table[f"v_{joint.name} [{unit}]"] = random.uniform(-2, 2, ROWS)
        table[f"T_{joint.name} [degC]"] = random.uniform(15, 30, ROWS)
    if "t" not in there:
        table["t [s]"] = np.sort(random.uniform(0, 4000, ROWS))
    table["load [N]"] = random.uniform(0, 80, ROWS)
    return table


@cache
def fitted(name: str) -> Fit:
    machine = Machine.load(EXAMPLES / name / "machine.toml")
    return fit(machine, Measurements.from_frame(table_of(name)), compiled=False)


@cache
def carried(name: str) -> tuple[Sensitivities, list[Candidate]]:
    base = fitted(name)
    effects = catalogue_effects(base.machine, base.observations)
    sensitivities = Sensitivities.of(base, effects)
    return sensitivities, candidates(sensitivities, effects)


def problem_with(base: Fit, machine: Machine) -> Problem:
    """Return the fit's observations and weights, with the model of another machine."""
    model = Model(machine, base.problem.model.travel, base.observations.run_names, compiled=False)
    problem = Problem(model, base.observations)
    problem.set_weight((base.problem.weight / base.problem.base_weight)[:, 0])
    return problem


def jacobian_at(base: Fit, problem: Problem, values: dict[str, float]) -> dict[str, np.ndarray]:
    """Return the column of every parameter, (n, m) each, where the machine is as fitted but for some values."""
    keys = [parameter.key for parameter in problem.model.parameters]
    theta = problem.model.start()
    known = dict(zip((p.key for p in base.parameters), base.solution.theta, strict=True)) | values
    for i, key in enumerate(keys):
        theta[i] = known.get(key, theta[i])
    whole = problem.jacobian(theta, base.solution.frame)
    return {key: whole[:, :, i] for i, key in enumerate(keys)}


def off(found: np.ndarray, expected: np.ndarray) -> float:
    """Return by which part of its largest number a column is wrong."""
    size = max(np.abs(found).max(), np.abs(expected).max())
    return float(np.abs(found - expected).max() / size) if size else 0.0


@pytest.mark.thorough("mount", "positioner", "ballbar_gantry")
@pytest.mark.parametrize("name", ALL)
def test_columns_are_those_of_a_model_that_has_the_effect(name):
    base = fitted(name)
    sensitivities, found = carried(name)
    effects = {c.key: c.effect for c in found}
    machine = base.machine
    for effect in effects.values():  # all at once: at zero none changes what another does
        machine = machine.with_effect(effect)
    problem = problem_with(base, machine)
    at_zero = jacobian_at(base, problem, {})
    for i, p in zip(base.free, sensitivities.model.transpose(2, 0, 1), strict=True):
        assert off(p, at_zero[base.parameters[i].key]) < 1e-9
    several: dict[tuple, list[Candidate]] = {}
    for candidate in found:
        several.setdefault(candidate.key, []).append(candidate)
    for same in several.values():
        for candidate in same[:: max(len(same) - 1, 1)]:  # of values that are searched the first and the last
            values = {candidate.effect.key(k): v for k, v in candidate.searched.items()}
            expected = jacobian_at(base, problem, values) if values else at_zero
            assert candidate.columns.shape == (*sensitivities.residual.shape, len(candidate.names))
            for key, column in zip(candidate.names, candidate.columns.transpose(2, 0, 1), strict=True):
                # The difference is rounding of the vectors that both are made of, some 1e-13.
                assert off(column, expected[key]) < 1e-9, (key, candidate.searched)


@pytest.mark.parametrize("name", [*QUICK, *SLOW])
def test_every_effect_that_can_stand_is_a_candidate_once(name):
    base = fitted(name)
    effects = catalogue_effects(base.machine, base.observations)
    keys = [(e.name, e.place) for e in effects]
    assert len(set(keys)) == len(keys)
    places = [None, *(j.name for j in base.machine.joints), *(t.name for t in base.machine.targets)]
    for definition in CATALOGUE:
        for place in places:
            if base.machine.kind_of(place) not in definition.at:
                continue
            try:
                base.machine.add(base.machine.effect(definition.name, place))
            except ValueError:
                assert (definition.name, place) not in keys
            else:
                # gravity turns for no joint of these that measures directions
                bends = definition.formula.names & {"bend", "fork"}
                assert ((definition.name, place) in keys) == (not bends)


def test_effects_whose_columns_are_not_in_the_data_are_no_candidates():
    table = {
        k: v
        for k, v in table_of("rotary_table").items()
        if not k.startswith(("v_", "T_", "dir_", "t ", "load"))
    }
    base = fit(
        Machine.load(EXAMPLES / "rotary_table" / "machine.toml"),
        Measurements.from_frame(table),
        compiled=False,
    )
    names = {e.name for e in catalogue_effects(base.machine, base.observations)}
    whole = {e.name for e in catalogue_effects(base.machine, fitted("rotary_table").observations)}
    gone = {
        "servo_lag", "thermal_offset", "thermal_axis_drift", "load_windup", "warm_up_drift", "linear_drift",
    }  # fmt: skip
    assert gone < whole
    assert not gone & names
    assert "backlash" in names  # directions of approach follow from the order of the rows


def test_effects_that_the_machine_has_are_no_candidates():
    base = fitted("mount")
    machine = base.machine.add("refraction")
    names = {(e.name, e.place) for e in catalogue_effects(machine, base.observations)}
    assert ("refraction", None) not in names
    assert len(names) == len(catalogue_effects(base.machine, base.observations)) - 1


def test_errors_of_a_drive_are_no_candidates_at_a_passive_joint():
    base = fitted("mount")
    az, el = base.machine.joints
    machine = replace(base.machine, joints=(replace(az, passive=True), el))
    gone = set(catalogue_effects(base.machine, base.observations)) - set(
        catalogue_effects(machine, base.observations)
    )
    of_drive = {"backlash", "backlash_gradient", "periodic_drive_error", "gravity_windup", "load_windup"}
    assert {(e.name, e.place) for e in gone} == {(name, "AZ") for name in of_drive}
    assert ("lateral_windup", "AZ") in {
        (e.name, e.place) for e in catalogue_effects(machine, base.observations)
    }


@pytest.mark.parametrize("name", ["positioner", "mount"])
def test_a_motion_of_the_frame_is_that_of_all_readings(name):
    """Moving every predicted reading by hand: turns about the middle, which thus shift nothing on average."""
    base = fitted(name)
    sensitivities, _ = carried(name)
    frame = sensitivities.frame
    weight = sensitivities.weight
    if not base.machine.measurand.moving:
        assert frame.shape[2] == 3
        return
    shift = frame[:, :, :3] / weight[:, :, None]
    assert shift == pytest.approx(np.broadcast_to(shift[:1], shift.shape), abs=1e-9)
    assert np.abs(shift[0] @ shift[0].T) == pytest.approx(np.eye(3), abs=1e-9)
    turned = (frame[:, :, 3:] / weight[:, :, None]).mean(axis=0)
    size = np.abs(frame[:, :, 3:] / weight[:, :, None]).max()
    assert np.abs(turned).max() < 1e-9 * size


def test_components_are_what_own_effects_are_made_of():
    """A formula of a user's at a component: its column is the component's, times the formula."""
    from rodgen.machines.effects.custom import own_effect
    from rodgen.machines.machine import Effect

    base = fitted("rotary_table")
    sensitivities, _ = carried("rotary_table")
    q = base.observations.q[:, 0]
    for component, unit in (("tz", "mm"), ("rx", "rad"), ("reading", "rad")):
        definition = own_effect(
            "mine", component, "a*sin(5*q)", {"a": unit}, at="revolute", joints={"C": "revolute"},
            file="test", place="effect",
        )  # fmt: skip
        problem = problem_with(base, base.machine.with_effect(Effect(definition, "C")))
        expected = jacobian_at(base, problem, {})["C.mine.a"]
        column = sensitivities.component("C", component)
        assert column is not None
        assert off(column * np.sin(5 * q)[:, None], expected) < 1e-9
    assert sensitivities.component(None, "reading") is None
    assert sensitivities.component("none", "tx") is None


def test_of_many_rows_whole_poses_are_looked_at():
    pose = np.repeat(np.arange(30_000), 3)
    believed = np.ones(len(pose), bool)
    believed[::11] = False
    rows = sample_of(SimpleNamespace(pose=pose), believed)  # type: ignore[arg-type]
    assert 0.9 * MOST_ROWS < len(rows) <= MOST_ROWS
    assert believed[rows].all()
    assert (np.diff(rows) > 0).all()
    taken = np.unique(pose[rows])
    assert np.isin(np.flatnonzero(believed & np.isin(pose, taken)), rows).all()
    few = np.ones(50, bool)
    few[7] = False
    assert sample_of(SimpleNamespace(pose=np.arange(50)), few).tolist() == [*range(7), *range(8, 50)]  # type: ignore[arg-type]


# spaces of made-up columns -----------------------------------------------------------------------------------

EFFECT = Machine.load(EXAMPLES / "rotary_table" / "machine.toml").effect("backlash", "C")


def made(name: str, columns: np.ndarray) -> Candidate:
    """Return columns (n, m, k) as a candidate of some name; its effect plays no part."""
    effect = replace(EFFECT, place=name)
    return Candidate(effect, tuple(f"{name}.{i}" for i in range(columns.shape[2])), columns, {})


def plain(columns: np.ndarray) -> np.ndarray:
    return columns


def flat(*parts: np.ndarray) -> np.ndarray:
    return np.concatenate([part.reshape(part.shape[0] * part.shape[1], -1) for part in parts], axis=1)


def squares(columns: np.ndarray, residual: np.ndarray) -> float:
    """Return the sum of squares that least squares leaves."""
    columns = columns / np.linalg.norm(columns, axis=0)
    along = np.linalg.lstsq(columns, residual)[0]
    return float(np.sum((residual - columns @ along) ** 2))


def whitener(n: int, m: int) -> np.ndarray:
    """Return a matrix that makes readings that depend on each other independent, (n m, n m)."""
    random = np.random.default_rng(5)
    half = random.normal(size=(n * m, 4))
    return np.linalg.inv(np.linalg.cholesky(np.eye(n * m) + 0.8 * half @ half.T))


@pytest.mark.parametrize("white", [False, True])
@pytest.mark.parametrize("also", [False, True])
def test_scores_are_those_of_least_squares_with_and_without(white, also):
    n, m = 40, 3
    random = np.random.default_rng(3)
    model = random.normal(size=(n, m, 5)) * np.array([1, 1e3, 1e-4, 1, 1])
    found = [made(f"c{k}", random.normal(size=(n, m, k)) * 10.0 ** (3 * k - 5)) for k in (1, 2, 3, 4)]
    residual = random.normal(size=(n, m)) + 5e-8 * found[3].columns[:, :, 0]
    whiten = whitener(n, m) if white else np.eye(n * m)
    space = CandidateSpace(model, found, lambda c: (whiten @ c.reshape(n * m, -1)).reshape(c.shape))
    coordinates, total = space.residual(residual)
    y = whiten @ residual.ravel()
    assert total == pytest.approx(y @ y, rel=1e-12)
    included = [found[1]] if also else []
    without = whiten @ flat(model, *(c.columns for c in included))
    left = squares(without, y)
    scores = space.scores(coordinates, left, included)
    assert {s.candidate.key for s in scores} == {c.key for c in found if c not in included}
    assert [s.log_p for s in scores] == sorted(s.log_p for s in scores)
    for score in scores:
        k = score.candidate.columns.shape[2]
        after = squares(np.concatenate([without, whiten @ flat(score.candidate.columns)], axis=1), y)
        spare = n * m - without.shape[1] - k
        assert (score.dof, score.residual_dof) == (k, spare)
        assert score.fall == pytest.approx(left - after, rel=1e-8)
        assert score.left == pytest.approx(after, rel=1e-9)
        f = (left - after) / k / (after / spare)
        assert score.statistic == pytest.approx(f, rel=1e-8)
        assert score.log_p == pytest.approx(stats.f.logsf(f, k, spare), rel=1e-6)


def test_what_the_model_imitates_is_not_seen():
    n, m = 30, 2
    random = np.random.default_rng(0)
    model = random.normal(size=(n, m, 3))
    inside = model @ random.normal(size=(3, 2))
    nearly = inside[:, :, :1] + 1e-5 * random.normal(size=(n, m, 1))
    half = np.concatenate([inside[:, :, :1], random.normal(size=(n, m, 1))], axis=2)
    nothing = np.zeros((n, m, 2))
    found = [
        made(name, c) for name, c in (("inside", inside), ("nearly", nearly), ("half", half), ("no", nothing))
    ]
    space = CandidateSpace(model, found, plain)
    residual = random.normal(size=(n, m))
    coordinates, total = space.residual(residual)
    scores = {s.candidate.effect.place: s for s in space.scores(coordinates, total)}
    for name in ("inside", "nearly", "no"):
        assert (scores[name].dof, scores[name].log_p, scores[name].fall) == (0, 0.0, 0.0)
        assert scores[name].visible < 1e-4
    assert scores["half"].dof == 1
    across = half[:, :, 1] - (flat(model) @ np.linalg.lstsq(flat(model), half[:, :, 1].ravel())[0]).reshape(
        n, m
    )
    share = np.linalg.norm(across) / np.linalg.norm(half[:, :, 1])
    assert scores["half"].visible == pytest.approx(share / np.sqrt(2), rel=1e-6)


def test_of_values_that_are_searched_the_best_is_reported_and_the_others_count():
    n, m = 60, 1
    random = np.random.default_rng(2)
    t = np.linspace(0, 1, n)
    several = [
        replace(made("P", np.sin(w * t)[:, None, None]), searched={"P": float(w)}, tries=5.5)
        for w in range(3, 40, 4)
    ]
    residual = (np.sin(19 * t) + 0.1 * random.normal(size=n))[:, None]
    space = CandidateSpace(np.ones((n, m, 1)), several, plain)
    coordinates, _ = space.residual(residual)
    left = squares(np.ones((n, 1)), residual.ravel())
    (score,) = space.scores(coordinates, left)
    assert score.candidate.searched == {"P": 19.0}
    alone = stats.f.logsf(score.statistic, 1, score.residual_dof)
    assert score.log_p == pytest.approx(alone + np.log(5.5), rel=1e-9)


def test_a_residual_of_nothing_and_too_few_readings_give_no_scores():
    random = np.random.default_rng(0)
    model, columns = random.normal(size=(4, 1, 3)), random.normal(size=(4, 1, 1))
    space = CandidateSpace(model, [made("a", columns)], plain)
    for residual in (np.zeros((4, 1)), random.normal(size=(4, 1))):
        (score,) = space.scores(*space.residual(residual))
        assert (score.log_p, score.dof) == (0.0, 0)
        assert space.tests([score]) == 1.0


# as how many tests all candidates count ----------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 5, 40])
def test_orthogonal_candidates_count_each(count):
    basis, _ = np.linalg.qr(np.random.default_rng(count).normal(size=(300, count + 2)))
    found = [made(f"c{i}", basis[:, None, [i]]) for i in range(count)]
    space = CandidateSpace(basis[:, None, count:], found, plain)
    tests = space.tests(space.scores(*space.residual(np.ones((300, 1)))))
    # 2000 simulations tell the hundredth part to a fifth (one standard deviation).
    assert count / 1.7 < tests < count * 1.7


def test_candidates_that_are_the_same_count_once():
    random = np.random.default_rng(0)
    columns = random.normal(size=(200, 1, 2))
    found = [made(f"c{i}", columns @ random.normal(size=(2, 2))) for i in range(30)]
    space = CandidateSpace(np.ones((200, 1, 1)), found, plain)
    tests = space.tests(space.scores(*space.residual(random.normal(size=(200, 1)))))
    assert tests < 1.7


def test_chance_passes_as_often_as_it_may():
    """500 innocent residuals, 30 candidates that hang together: one in a hundred is claimed."""
    n = 80
    random = np.random.default_rng(1)
    t = np.linspace(-1, 1, n)
    found = [
        made(f"c{w}", np.stack([np.sin(w * t), np.cos(w * t)], -1)[:, None, :])
        for w in np.linspace(0.5, 15, 30)
    ]
    space = CandidateSpace(np.ones((n, 1, 1)), found, plain)
    tests = None
    claims = 0
    for _ in range(500):
        y = random.normal(size=n)
        y -= y.mean()
        scores = space.scores(*space.residual(y[:, None]))
        tests = space.tests(scores) if tests is None else tests
        claims += scores[0].log_p + np.log(tests) < np.log(0.01)
    assert stats.binomtest(claims, 500, 0.01).pvalue > 1e-3


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "place"), [("rotary_table", "C"), pytest.param("positioner", "phi", marks=slow)]
)
def test_searching_a_period_claims_no_more_than_it_may(name, place):
    """Noise alone: of 200 data sets the best period is called real in one of ten at the most, at that level."""
    sensitivities, found = carried(name)
    wave = next(c.effect for c in found if c.key == ("periodic_drive_error", place))
    drift = next(c.effect for c in found if c.key == ("warm_up_drift", None))
    model = flat(sensitivities.model)
    random = np.random.default_rng(0)
    claims = dict.fromkeys((wave.name, drift.name), 0)
    for _ in range(200):
        y = random.normal(size=len(model))
        y -= model @ np.linalg.lstsq(model, y)[0]
        noise = replace(sensitivities, residual=y.reshape(sensitivities.residual.shape))
        several = candidates(noise, [wave, drift])
        space = CandidateSpace(sensitivities.model, several, plain)
        for score in space.scores(*space.residual(noise.residual)):
            claims[score.candidate.effect.name] += score.log_p < np.log(0.1)
    for claimed in claims.values():
        assert stats.binomtest(claimed, 200, 0.1, alternative="greater").pvalue > 0.01


# probabilities that a double does not hold -------------------------------------------------------------------


@pytest.mark.parametrize("freedoms", [1, 2, 7, 40])
@pytest.mark.parametrize("spare", [3, 30, 500, 60_000])
def test_log_p_where_scipy_has_it(freedoms, spare):
    for part in (0.0, 1e-6, 0.001, 0.1, 0.5, 0.9):
        f = part / freedoms / ((1 - part) / spare)
        expected = stats.f.logsf(f, freedoms, spare)
        if expected > -600:
            # SciPy takes the logarithm of 1 - cdf where p is near 1
            assert log_p_of_fall(part * 7.3, 7.3 - part * 7.3, freedoms, spare) == pytest.approx(
                expected, rel=1e-8, abs=1e-9
            )


@pytest.mark.parametrize(
    ("freedoms", "spare", "part"),
    [
        (1, 200, 0.9995),
        (2, 400, 0.98),
        (3, 500, 0.9999999),
        (12, 1000, 0.9),
        (40, 5000, 0.3),
        (2, 60_000, 0.05),
        (40, 5000, 0.27),
        (1, 60_000, 0.999),
        (300, 3000, 0.7),
    ],
)
def test_log_p_where_it_underflows(freedoms, spare, part):
    with mpmath.workdps(50):
        x, a, b = 1 - mpmath.mpf(part), mpmath.mpf(spare) / 2, mpmath.mpf(freedoms) / 2
        whole = mpmath.hyp2f1(a + b, 1, a + 1, x, maxterms=10**6)
        exact = (
            a * mpmath.log(x) + b * mpmath.log1p(-x) - mpmath.log(a * mpmath.beta(a, b)) + mpmath.log(whole)
        )
        integral = mpmath.log(mpmath.betainc(a, b, 0, x, regularized=True)) if spare <= 1000 else exact
    assert exact == pytest.approx(integral, rel=1e-20)
    assert exact < -645  # below 1e-280
    assert log_p_of_fall(part, 1.0 - part, freedoms, spare) == pytest.approx(float(exact), rel=1e-9)


def test_log_p_at_the_ends():
    assert log_p_of_fall(0.0, 1.0, 2, 50) == 0.0
    assert log_p_of_fall(1.0, 0.0, 2, 50) == -np.inf
    values = [log_p_of_fall(part, 1.0 - part, 2, 1300) for part in np.linspace(0.3, 0.8, 200)]
    assert (np.diff(values) < 0).all()  # also where one way of computing it takes over from the other


# errors on blocks left out -----------------------------------------------------------------------------------


def observed(n: int, rows: int = 1) -> Observations:
    """Return observations of a joint in n poses with the given number of rows each."""
    machine = Machine.load(EXAMPLES / "rotary_table" / "machine.toml")
    c = np.repeat(np.random.default_rng(0).uniform(0, 360, n), rows)
    zero = np.zeros(n * rows)
    names = np.resize([t.name for t in machine.targets], n * rows)
    return bind(
        machine,
        Measurements.from_frame(
            {"C [deg]": c, "target": names, "x [mm]": zero, "y [mm]": zero, "z [mm]": zero}
        ),
    )


def left_out(o: Observations, columns: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Return the errors (n, m) of fits to all other blocks."""
    fold = folds_of_rows(o, EVIDENCE.folds)
    found = np.empty_like(residual)
    for block in np.unique(fold):
        out = fold == block
        inside = columns[~out].reshape(-1, columns.shape[2])
        along = np.linalg.lstsq(inside, residual[~out].ravel(), rcond=1e-10)[0]
        found[out] = residual[out] - columns[out] @ along
    return found


@pytest.mark.parametrize("rows", [1, 3])
def test_errors_are_those_of_fits_without_each_block(rows):
    o = observed(40, rows)
    n = o.n
    random = np.random.default_rng(7)
    model, further = random.normal(size=(n, 3, 4)), [random.normal(size=(n, 3, k)) * 1e3 for k in (1, 3)]
    residual = random.normal(size=(n, 3)) + 1e-3 * further[0][:, :, 0]
    blocks = Blocks(o, model, residual)
    for some in ([], further[:1], further):
        expected = left_out(o, np.concatenate([model, *some], axis=2), residual)
        found = np.empty(n * 3)
        found[blocks.order] = blocks.errors(some)
        assert found.reshape(n, 3) == pytest.approx(expected, rel=1e-8, abs=1e-9)
        assert blocks.held_out(some) == pytest.approx(np.sqrt(np.mean(expected**2)), rel=1e-9)


def test_poses_stay_whole():
    o = observed(25, 4)
    fold = folds_of_rows(o, EVIDENCE.folds)
    blocks = Blocks(o, np.ones((o.n, 3, 1)), np.ones((o.n, 3)))
    assert len(blocks.blocks) == EVIDENCE.folds
    assert all(len(set(fold[o.pose == pose])) == 1 for pose in np.unique(o.pose))


def test_what_one_block_alone_tells_is_not_known_without_it():
    """A column in one block only explains that block, but nothing predicts it: the error stays as it was."""
    o = observed(40)
    random = np.random.default_rng(1)
    model = random.normal(size=(o.n, 3, 2))
    residual = random.normal(size=(o.n, 3))
    residual[17] *= 10
    residual -= (flat(model) @ np.linalg.lstsq(flat(model), residual.ravel())[0]).reshape(residual.shape)
    alone = np.zeros((o.n, 3, 1))
    alone[17, :, 0] = residual[17]
    blocks = Blocks(o, model, residual)
    assert blocks.held_out([alone]) > 0.99 * blocks.held_out([])


# rows that are wrong -----------------------------------------------------------------------------------------


def design(n: int, m: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return smooth columns of a model and of candidates, and the way along which they go."""
    q = np.sort(np.random.default_rng(0).uniform(0, 2 * np.pi, n))
    waves = np.stack([f(k * q) for k in range(1, 6) for f in (np.sin, np.cos)], -1)
    model = np.stack([np.broadcast_to(np.eye(m)[i], (n, m)) for i in range(m)], -1)
    every = np.stack([wave[:, None] * np.eye(m)[i] for wave in waves.T for i in range(m)], -1)
    return model, every, q


@pytest.mark.parametrize("effect", [0.0, 5.0])
def test_gross_errors_are_found_and_nothing_else(effect):
    """5 % of the rows are off by 20 standard deviations, in clean data and where an effect is missing."""
    model, every, _ = design(200)
    missed = wrongly = 0
    for seed in range(10):
        random = np.random.default_rng(seed)
        residual = random.normal(size=(200, 3)) + effect * every[:, :, 4] * 2
        bad = random.choice(200, 10, replace=False)
        residual[bad] += 20 * random.choice([-1, 1], size=(10, 3))
        found, _ = gross_errors(model, every, residual)
        missed += 10 - int(found[bad].sum())
        wrongly += int(found.sum() - found[bad].sum())
    assert missed == 0
    assert wrongly <= 2


@pytest.mark.parametrize("effect", [0.0, 5.0, 500.0])
def test_clean_data_have_no_gross_errors(effect):
    """A false alarm in at most a few of a hundred data sets; the size of what is missing plays no part."""
    model, every, _ = design(150)
    alarms = 0
    for seed in range(60):
        random = np.random.default_rng(100 + seed)
        residual = random.normal(size=(150, 3)) + effect * every[:, :, [1, 7]].sum(axis=2)
        alarms += bool(gross_errors(model, every, residual)[0].any())
    assert alarms <= 4


def test_an_effect_apart_from_what_most_candidates_have_in_common_makes_no_gross_errors():
    """Hundreds of waves fill the directions that candidates have in common; the effect is a bump of its own."""
    n = 600
    alarms = 0
    for seed in range(10):
        random = np.random.default_rng(seed)
        q = np.sort(random.uniform(-2, 2, n))
        model = np.stack([np.broadcast_to(np.eye(3)[i], (n, 3)) for i in range(3)], -1)
        phase, turns = random.uniform(0, 6, 400), random.uniform(5, 60, 400)
        waves = np.sin(turns * q[:, None] + phase)[:, None, :] * random.normal(size=(1, 3, 400))
        bend = (np.exp(-4 * q**2) * np.array([[1.0], [0.5], [-1.0]])).T[:, :, None]
        residual = random.normal(size=(n, 3)) + 20 * bend[:, :, 0]
        alarms += bool(gross_errors(model, np.concatenate([waves, bend], axis=2), residual)[0].any())
    assert alarms <= 1


@pytest.mark.thorough
@pytest.mark.parametrize("wrong", [0.5, -5.0])
def test_a_gross_error_is_found_where_all_candidates_together_could_follow_it(wrong, tmp_path):
    """One reading of the first row of a trunnion, after which its warm-up begins, is off by so many mm."""
    header, first, *others = (EXAMPLES / "trunnion" / "data.csv").read_text().splitlines()
    cells = first.split(",")
    cells[6] = repr(float(cells[6]) + wrong)
    file = tmp_path / "data.csv"
    file.write_text("\n".join([header, ",".join(cells), *others]))
    found = fit(Machine.load(EXAMPLES / "trunnion" / "machine.toml"), Measurements.load(file)).diagnose()
    assert [step["effect"] for step in found.to_dict()["steps"]] == ["warm_up_drift"]
    assert list(found.outliers) == [0]


def test_candidates_that_the_model_imitates_play_no_part_in_gross_errors():
    """Their residual is rounding, which differs between machines and would give columns of noise."""
    model, every, _ = design(60)
    random = np.random.default_rng(3)
    inside = model @ random.normal(size=(3, 30))
    for seed in range(20):
        random = np.random.default_rng(seed)
        residual = random.normal(size=(60, 3))
        residual[random.choice(60, 3, replace=False)] *= 3.5  # on the edge
        alone, _ = gross_errors(model, every[:, :, :12], residual)
        found, _ = gross_errors(model, np.concatenate([inside, every[:, :, :12]], axis=2), residual)
        assert found.tolist() == alone.tolist()


def test_gross_errors_of_few_or_perfect_rows_are_none():
    model, every, _ = design(150)
    assert not gross_errors(model, every, np.zeros((150, 3)))[0].any()
    assert not gross_errors(model[:5], every[:5], np.ones((5, 3)))[0].any()
    # readings to the last digit, but for one
    one = np.zeros((150, 3))
    one[3] = 1.0
    assert gross_errors(model, every, one)[0].sum() <= 1


def test_rows_side_by_side_are_no_outliers():
    n = 300
    random = np.random.default_rng(4)
    q, t = random.uniform(0, 360, n), np.arange(n, dtype=float)
    scattered = np.zeros(n, bool)
    scattered[random.choice(n, 15, replace=False)] = True
    assert not are_neighbours(scattered, [q, t])
    one_place = (q > 40) & (q < 55)
    assert are_neighbours(one_place, [q, t])
    assert are_neighbours((t > 100) & (t < 112), [q, t])
    two = np.zeros(n, bool)
    two[[5, 6]] = True
    assert not are_neighbours(two, [q, t])
    assert not are_neighbours(one_place, [np.zeros(n)])
    false = [are_neighbours(np.random.default_rng(s).random(n) < 0.05, [q, t]) for s in range(300)]
    assert sum(false) <= 3


def test_direct_effects_are_those_that_are_no_products():
    names = {d.name for d in CATALOGUE if is_direct(replace(EFFECT, definition=d))}
    assert {"axis_tilt", "gravity_windup", "gravity_sag", "instrument_scale", "target_offset"} <= names
    assert not names & {"backlash", "encoder_eccentricity", "straightness", "warm_up_drift", "linear_drift"}


# what does the same ------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_good_rows_that_looked_wrong_at_first_change_nothing(monkeypatch):
    """A second round has all rows again: its answer is that of a diagnosis in which none looked wrong."""
    folder = EXAMPLES / "mount"
    fitted = fit(Machine.load(folder / "machine.toml"), Measurements.load(folder / "mmt_2021.csv"))
    known = fitted.diagnose()
    suspected = np.zeros(fitted.observations.n, bool)
    suspected[[7, 30, 55]] = True
    monkeypatch.setattr(search, "gross_rows_of", lambda *_: suspected)
    found = fitted.diagnose()
    assert found.outliers == known.outliers == ()
    assert found.to_dict() == known.to_dict()


# which set is the likelier -------------------------------------------------------------------------------------------


@cache
def leg_machine():
    """Return the evidence on a Tricept with four effects, two of which hide behind a third, and what was chosen."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        machine, data = real("tricept", 15).write(Path(folder))
        base = Machine.load(machine).fit(Measurements.load(data))
    return gather_evidence(base, Screening.at(base))


@pytest.mark.thorough
def test_a_zero_offset_does_not_stand_for_three_effects_of_other_kinds():
    """With a price of 17 for each of five parameters one offset was cheaper, though chi-square was larger by 44."""
    _, chosen = leg_machine()
    assert {c.effect.title for c in chosen} == {
        "leg_thermal_expansion at A-1",
        "leg_scale at A1",
        "leg_compliance at A1",
        "platform_joint_offset at A0",
    }


@pytest.mark.thorough
def test_what_a_set_costs_is_its_likelihood_over_all_sizes():
    """The readings are normal, with the covariance that effects of normal sizes of these widths give them."""
    evidence, chosen = leg_machine()
    selection, space = evidence.selection, evidence.selection.space
    variance = selection.variance(chosen)
    across = space.base().project_out(np.concatenate([space.columns(c) for c in chosen], axis=1))
    sizes = selection.estimates(variance, chosen)
    larger = [c.prior.size_cost(c.short_names, x) / 2 for c, (x, _) in zip(chosen, sizes, strict=True)]
    usual = [
        c.prior.usual(c.short_names) * space.sizes(c) * np.exp(more / 2)
        for c, more in zip(chosen, larger, strict=True)
    ]
    columns = across * np.concatenate(usual)
    residual = space.base().project_out(selection.residual)

    def log_likelihood(covariance):
        return stats.multivariate_normal(cov=covariance).logpdf(residual)

    plain = variance * np.eye(len(residual))
    gained = 2 * (log_likelihood(plain + columns @ columns.T) - log_likelihood(plain))
    fall = selection.cost_of_any_size(variance, []) - selection.cost_of_any_size(variance, chosen)
    assert fall == pytest.approx(gained + sum(larger) - selection.choice_cost(chosen), rel=1e-9)
    # and what one of them costs in addition to the others is no more than that it has all values to choose from
    for candidate in chosen:
        others = [c for c in chosen if c is not candidate]
        (price,) = selection.price_of_each(variance, others, [candidate])
        whole = selection.price_of_each(variance, [], [candidate])[0]
        assert selection.choice_cost([candidate]) < price <= whole + 1e-9
