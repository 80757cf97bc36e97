"""Comparisons: what is there is found and named, what is not there is not, and the numbers are what they say.

Data come from the tests' own simulator; statistics are held against what their errors are known to be.
"""

from __future__ import annotations

import json
import re
import tracemalloc
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hidden_effects import hidden
from machine_simulator import Simulated, arcsec, random_walk
from scipy import stats

from rodgen import figures
from rodgen.calibration.compare import Comparison, compare
from rodgen.calibration.dependence import MOST_READINGS
from rodgen.calibration.fit import Fit, fit
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind
from rodgen.data.measurements import Measurements
from rodgen.machines.drivers import Driver
from rodgen.machines.machine import Machine
from rodgen.machines.observations import Observations

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples" / "machines"
NOISE = 0.002

TABLE = """
name = "Rotary table with a tilt"
units = { length = "mm", angle = "deg" }
joint = [
    { name = "A", type = "revolute", axis = [1, 0, 0], point = [0, 0, 10] },
    { name = "C", type = "revolute", axis = [0, 0, 1], point = [0, 0, 0] },
]
target = [{ name = "p", point = [120, 0, 40] }, { name = "q", point = [-40, 90, 60] }]
measured = { kind = "point", frame = "machine" }
estimate = { parameters = ["A.point", "C.axis", "C.point", "target"] }
"""


class Bench:
    """A machine and its poses; readings are simulated, with errors of one's choice, and compared with the model."""

    def __init__(self, folder: Path, toml: str, q: np.ndarray, **conditions: Any) -> None:
        path = folder / "machine.toml"
        path.write_text(toml, encoding="utf-8")
        self.path, self.q, self.conditions = path, q, conditions
        self.machine = Machine.load(path)
        self.clean = self.measured({})
        known = {
            name: conditions.get(name) for name in ("s", "v", "t", "temperature", "load", "run", "covariates")
        }
        data = folder / "data.csv"
        target = conditions.get("target")
        Simulated(path).write_csv(data, q, self.clean, target=target, **known)
        self.observations: Observations = bind(self.machine, Measurements.load(data))

    def measured(self, effects: Mapping[str, Any]) -> np.ndarray:
        return Simulated(self.path, effects).measure(self.q, **self.conditions)

    def fit(self, error: np.ndarray, effects: Mapping[str, Any] | None = None) -> Fit:
        reading = (self.measured(effects) if effects else self.clean) + error
        return fit(self.machine, replace(self.observations, reading=reading))

    def compare(self, error: np.ndarray, effects: Mapping[str, Any] | None = None) -> Comparison:
        return compare(self.fit(error, effects))


def table_poses(count: int, random: np.random.Generator) -> np.ndarray:
    return np.column_stack([random.uniform(-60, 60, count), random.permutation(count) * 360 / count])


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """60 poses in random order, both targets in each."""
    q = np.repeat(table_poses(60, np.random.default_rng(1)), 2, axis=0)
    t = np.repeat(30.0 * np.arange(60), 2)
    return Bench(tmp_path_factory.mktemp("bench"), TABLE, q, target=["p", "q"] * 60, t=t)


def noise(shape: tuple[int, ...], seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape) * NOISE


# What is not there is not claimed

DRAWS = 120


def most_false_alarms(draws: int) -> int:
    """Give the count that a probability of 1 % exceeds in one of a thousand test runs."""
    return int(stats.binom.ppf(0.999, draws, 0.01))


def independent(shape: tuple[int, int], pose: np.ndarray, random: np.random.Generator) -> np.ndarray:
    return random.normal(size=shape)


def shared(shape: tuple[int, int], pose: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Give errors most of which the readings of a pose have in common."""
    return random.normal(size=(pose.max() + 1, shape[1]))[pose] + 0.3 * random.normal(size=shape)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("rows", "errors", "draws"),
    [
        pytest.param(1, independent, DRAWS, id="one", marks=pytest.mark.slow),
        pytest.param(4, independent, DRAWS, id="four", marks=pytest.mark.slow),
        pytest.param(4, shared, 30, id="four that share"),
        pytest.param(4, shared, DRAWS, id="four that share, often", marks=pytest.mark.slow),
    ],
)
def test_data_of_which_nothing_is_missing_claim_anything_once_in_a_hundred(
    tmp_path: Path, rows: int, errors: Callable[..., np.ndarray], draws: int
) -> None:
    random = np.random.default_rng(7)
    q = np.repeat(table_poses(40, random), rows, axis=0)
    one_target = re.sub(r",\s*\{ name = \"q\".*?\}", "", TABLE)
    temperature = {"C": np.repeat(20 + np.sin(np.arange(40) / 9), rows)}
    toml, more = (one_target, {}) if rows == 1 else (TABLE, {"target": ["p", "q", "p", "q"] * 40})
    bench = Bench(tmp_path, toml, q, temperature=temperature, **more)
    claims = []
    for _ in range(draws):
        error = NOISE * errors(bench.clean.shape, bench.observations.pose, random)
        claims.append(bench.compare(error).claims)
    assert sum(map(bool, claims)) <= most_false_alarms(draws), [c for c in claims if c]


# What is there is named

HIDDEN = {  # what ANSWERS.md says is missing, and how a comparison without any catalogue names it
    "ballbar_gantry": r"depend on X and Y together: 9\d %",
    "gantry_rotary": r"depend on C: 8\d % .*, along the motion of C \(more than a million to 1\)",
    "mount": r"depend on EL: 9\d % of their variance, along the motion of EL",
    "positioner": r"depend on the direction of approach of phi: 7\d % .*along the motion of phi",
    "robot_6r_tracker": r"depend on J2 and J3 together: 8\d % of their variance, along the motion of J2",
    "rotary_table": r"depend on C, differently for each target: 5\d % of their variance",
    "trunnion": r"depend on time: 9\d % of their variance \(more than",
}


@pytest.fixture(scope="module")
def examples() -> Callable[[str], Comparison]:
    done: dict[str, Comparison] = {}

    def example(name: str) -> Comparison:
        if name not in done:
            (data,) = (EXAMPLES / name).glob("*.csv")
            machine = Machine.load(EXAMPLES / name / "machine.toml")
            done[name] = compare(fit(machine, Measurements.load(data)))
        return done[name]

    return example


@pytest.mark.thorough("mount")
@pytest.mark.parametrize("name", sorted(HIDDEN))
def test_examples_say_what_the_missing_effect_depends_on(
    name: str, examples: Callable[[str], Comparison]
) -> None:
    comparison = examples(name)
    first = next(s for s in comparison.sentences if s.startswith("The residuals"))
    assert re.search(HIDDEN[name], first), comparison.sentences
    assert comparison.claims == [s for s in comparison.sentences if s in comparison.claims]


def test_what_is_explained_is_what_a_fit_with_the_effect_explains(bench: Bench) -> None:
    f = bench.fit(
        noise(bench.clean.shape, 1),
        {"C.encoder_ellipticity.a": arcsec(6), "C.encoder_ellipticity.b": arcsec(4)},
    )
    (found,) = compare(f).found
    assert found.trial.name == "C"
    effect = bench.machine.effect("encoder_ellipticity", "C")
    better = fit(bench.machine.with_effect(effect), f.observations)
    # A curve of nine columns instead of two: each explains one 340th of the variance by chance, which is taken off,
    # and scatters by as much.
    assert found.explained == pytest.approx(1 - (better.rms / f.rms) ** 2, abs=4 * np.sqrt(2 * 9) / 340)


@pytest.mark.thorough("effects7-None-None")
@pytest.mark.parametrize(
    ("effects", "driver", "joint"),
    [
        ({"A.backlash.b": arcsec(12)}, "dir_A", "A"),
        ({"C.backlash.b": arcsec(12)}, "dir_C", "C"),
        ({"C.servo_lag.tau": 2e-4}, "v_C", "C"),
        ({"C.thermal_offset.k": arcsec(8)}, "T_C", "C"),
        ({"A.load_windup.k": arcsec(0.006)}, "load and C", "A"),
        ({"C.tx": lambda c: 0.003 * np.sign(c["humidity"])}, "humidity", None),
        ({"frame_shift[2].x": 0.005, "frame_shift[2].z": -0.004}, "run", None),
        ({}, None, None),
    ],
)
def test_each_kind_of_covariate_is_found(
    tmp_path: Path, effects: dict[str, Any], driver: str | None, joint: str | None
) -> None:
    random = np.random.default_rng(5)
    count = 80
    q = np.repeat(table_poses(count, random), 2, axis=0)
    by_pose = {
        "v": np.column_stack([np.zeros(count), random.choice([-20.0, -5.0, 5.0, 20.0], count)]),
        "load": random.choice([0.0, 50.0, 100.0], count),
        "run": np.repeat([1, 2], count // 2),
    }
    conditions: dict[str, Any] = {name: np.repeat(values, 2, axis=0) for name, values in by_pose.items()}
    conditions["temperature"] = {"C": np.repeat(20 + random.uniform(-2, 2, count), 2)}
    conditions["covariates"] = {"humidity": np.repeat(random.uniform(-1, 1, count), 2)}
    bench = Bench(tmp_path, TABLE, q, target=["p", "q"] * count, **conditions)
    comparison = bench.compare(noise(bench.clean.shape, 2), effects)
    found = comparison.found
    if driver is None:
        assert not comparison.claims
        return
    if driver == "run" and not found:  # or a walk, which a step is
        assert "wanders" in comparison.claims[0]
        return
    assert driver in {found[0].trial.name, *found[0].instead}, comparison.sentences
    if joint and found[0].trial.name == driver:
        assert found[0].trial.joint == joint
    rows = comparison.to_dict()["table"]
    assert any(driver in row["covariate"] and row["log10_odds"] > 3 for row in rows)


# Time


@pytest.mark.thorough
@pytest.mark.parametrize("draws", [10, pytest.param(50, marks=pytest.mark.slow)])
def test_a_wandering_set_up_is_reported_and_joints_are_not_blamed(tmp_path: Path, draws: int) -> None:
    # C goes round slowly, again and again, and A up and down: both are alike in successive poses, as a walk is.
    random = np.random.default_rng(11)
    count = 60
    q = np.column_stack([40 * np.sin(np.arange(count) / 11), (np.arange(count) * 360 / 20) % 360])
    t = 60.0 * np.arange(count)
    bench = Bench(tmp_path, TABLE, q, t=t, target=["p"] * count)
    blamed = told = 0
    for _ in range(draws):
        walk = random_walk(t, 2 * NOISE / np.sqrt(60), random)
        comparison = bench.compare(random.normal(size=bench.clean.shape) * NOISE, walk)
        in_time = [one.trial.drivers[0].in_time for one in comparison.found]
        blamed += not all(in_time)
        told += any(in_time) or any("wander" in claim for claim in comparison.claims)
    assert told >= 0.95 * draws
    assert blamed <= most_false_alarms(draws)


# Where


def test_a_region_with_larger_errors_is_reported_with_its_range(bench: Bench) -> None:
    C = bench.q[:, 1]
    error = noise(bench.clean.shape, 3) * np.where(C > 250, 4, 1)[:, None]
    comparison = bench.compare(error)
    worst = comparison.worst[0]
    assert worst.covariate.name == "C"
    assert worst.low == pytest.approx(250, abs=30)
    inside = worst.low < C
    rms = np.sqrt(np.mean(comparison.fit.residuals[inside] ** 2))
    assert worst.rms == pytest.approx(rms, rel=1e-9)
    assert (
        comparison.claims[0] == f"The model is worst where {worst.text}: {1000 * rms:.2f} um there, "
        f"{1000 * comparison.fit.rms:.2f} um overall."
    )


def test_regions_go_over_the_seam_of_a_joint_that_goes_round(bench: Bench) -> None:
    C = bench.q[:, 1]
    comparison = bench.compare(noise(bench.clean.shape, 3) * np.where((C > 320) | (C < 40), 4, 1)[:, None])
    region = comparison.worst[0]
    assert region.covariate.name == "C"
    assert region.low is not None
    assert region.high is not None
    assert region.low > 250 > 90 > region.high


def test_a_row_far_out_is_reported(bench: Bench) -> None:
    error = noise(bench.clean.shape, 9)
    error[37, 1] += 20 * NOISE
    far = bench.compare(error)
    assert any(
        re.match(r"Line 39 of .* is off by .* in y, all other rows by", said) for said in far.sentences
    )
    assert [one["row"] for one in far.to_dict()["gross"]] == [37]


def test_rows_that_a_fit_does_not_believe_are_left_out(bench: Bench) -> None:
    error = noise(bench.clean.shape, 9)
    error[::20] += 1.0
    reading = bench.clean + error
    robust = fit(bench.machine, replace(bench.observations, reading=reading), loss="huber")
    assert np.flatnonzero(robust.outliers).tolist() == list(range(0, 120, 20))
    comparison = compare(robust)
    assert not set(comparison.sensitivities.rows) & set(range(0, 120, 20))
    assert comparison.claims == []
    assert comparison.rms.max() < 2 * NOISE


# Few data, many data, exact data


@pytest.mark.thorough("1", "2", "9")
@pytest.mark.parametrize("rows", [1, 2, 3, 6, 9, 14])
def test_few_rows_say_that_they_are_few(tmp_path: Path, rows: int) -> None:
    random = np.random.default_rng(1)
    bench = Bench(tmp_path, TABLE, table_poses(rows, random), target=["p"] * rows)
    comparison = bench.compare(noise(bench.clean.shape, 1))
    assert comparison.claims == []
    assert str(comparison)
    json.dumps(comparison.to_dict(), allow_nan=False)


def test_a_driver_that_never_varies_has_no_curve() -> None:
    """A comparison raised an IndexError for a table that never turned, and a temperature that never changed."""
    for kind in ("temperature", "load", "joint"):
        still = Driver(kind, "C", np.full(9, 0.3), np.full(9, 20.3), "degC")
        assert still.columns.shape == still.low_columns.shape == (9, 0)


def test_a_model_that_meets_the_data_says_so(bench: Bench) -> None:
    comparison = bench.compare(np.zeros_like(bench.clean))
    assert comparison.sentences == ["The model fits the data to rounding: there is nothing to explain."]
    json.dumps(comparison.to_dict(), allow_nan=False)


@pytest.mark.slow
def test_many_rows_are_looked_at_in_bounded_memory(bench: Bench) -> None:
    random = np.random.default_rng(1)
    rows = 200_000
    A, C = random.uniform(-60, 60, rows), random.uniform(0, 360, rows)
    frame = {"A [deg]": A, "C [deg]": C, "target": ["p"] * rows, "t [s]": np.arange(float(rows))}
    none = {f"{x} [mm]": np.zeros(rows) for x in "xyz"}
    observations = bind(bench.machine, Measurements.from_frame(frame | none))
    model = bench.fit(noise(bench.clean.shape, 1))
    places = Problem(model.problem.model, observations).places(model.solution.theta, model.solution.frame)
    error = random.normal(size=(rows, 3)) * NOISE
    error[:, 2] += NOISE * np.cos(np.radians(3 * C))
    f = fit(bench.machine, replace(observations, reading=places + error))
    f.residuals  # noqa: B018 - of all rows, and the fit's
    tracemalloc.start()
    comparison = compare(f)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert comparison.sensitivities.residual.size <= MOST_READINGS
    assert peak < 300e6
    found = comparison.found[0]
    assert found.trial.name == "C"
    # Half of NOISE² compared with three times NOISE²; of 5000 rows the share's standard error is below 0.01.
    assert found.explained == pytest.approx(0.5 / 3.5, abs=0.03)
    assert f"of {rows} rows" in comparison.sentences[-1]


# What comes out


@pytest.mark.thorough
def test_names_of_a_user_s_file_are_drawn_as_they_are(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    covariates = {name: random.normal(size=40) for name in ("a$b_{c}$", "../x", "A$B_{C}$", "<b>d</b>")}
    runs = ["$r_1$", "<i>r"] * 20
    bench = Bench(
        tmp_path, TABLE, table_poses(40, random), target=["p"] * 40, covariates=covariates, run=runs
    )
    found = bench.compare(noise(bench.clean.shape, 1))
    drawn = {figure.layout.meta["name"]: figure for figure in figures.comparison(found)}
    assert len(drawn) == 3 + len(found.covariates) == len({name.casefold() for name in drawn})
    assert {"by_a_b_c_", "by_x", "by_A_B_C_", "by_b_d_b_", "by_run"} <= {
        re.sub("_+", "_", name) for name in drawn
    }
    assert drawn["by_a_b__c_"].layout.meta["title"] == "Residuals against a$b_{c}$"
    assert "&lt;b&gt;d&lt;/b&gt;" in str(drawn["by__b_d_b_"].layout.xaxis3.title.text)
    assert list(drawn["by_run"].layout.xaxis3.ticktext) == ["$r_1$", "&lt;i&gt;r"]
    files = figures.save_figures(drawn.values(), tmp_path / "plots.html")
    assert files == [str(tmp_path / "plots.html")]
    assert "<b>d</b>" not in (tmp_path / "plots.html").read_text(encoding="utf-8")


@pytest.mark.thorough
def test_temperature_and_scale_of_the_tutorial() -> None:
    folder = Path(__file__).parent.parent / "examples/off_by_20_um"
    comparison = compare(fit(Machine.load(folder / "machine.toml"), Measurements.load(folder / "data.csv")))
    assert [one.trial.name for one in comparison.found] == ["X", "T_X"]
    assert sum(one.explained for one in comparison.found) == pytest.approx(0.88, abs=0.03)
    said, _, table = str(comparison).partition("\n\n")
    assert "cannot distinguish that from a dependence on place x." in said
    rows = {line.split(" [")[0]: line.split() for line in table.splitlines()}
    assert rows["T_X"][2] == "x"


@pytest.mark.thorough
def test_time_is_not_denied_where_a_wander_would_look_the_same(tmp_path: Path) -> None:
    """A day's cycle in the set-up of a telescope, which a temperature follows."""
    machine, data = hidden("mount", 7, wanders="day").write(tmp_path)
    comparison = compare(fit(Machine.load(machine), Measurements.load(data)))
    assert any("wander" in said or "T_AZ" in said or "time" in said for said in comparison.claims)


@pytest.mark.thorough
def test_what_varies_too_fast_for_the_curves_is_not_denied(tmp_path: Path) -> None:
    """A comparison said that the residuals depend on nothing, where a wave of C doubles them."""
    machine, data = hidden("rotary_table", 28, outside="fifth_harmonic", raises=2.0).write(tmp_path)
    comparison = compare(fit(Machine.load(machine), Measurements.load(data)))
    assert not comparison.claims
    assert any(
        said.startswith("The residuals are 1.92 times the noise all the same")
        for said in comparison.sentences
    )


@pytest.mark.thorough
def test_what_may_be_there_is_neither_claimed_nor_denied(bench: Bench) -> None:
    for seed in range(4):
        comparison = bench.compare(noise(bench.clean.shape, seed))
        likely = {one.trial.text for one in comparison.alone if one.log10_odds > 0}
        denied = any(said.startswith("No dependence") for said in comparison.sentences)
        assert not (likely and denied)
