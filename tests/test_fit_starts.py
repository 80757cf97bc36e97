"""A fit ends at the least cost there is, wherever it starts.

Rough starts: the tracker stands anywhere and is turned anyhow, each axis is 5 to 10 degrees off, each target 100 mm.
What is least is known from a fit that starts at the truth. Searches: periods and times of any size. Nested models: one
with more effects never costs more than the one inside it, from scratch or from the smaller one's end. Where geometry
is estimated, directions that the data hardly determine are held where a fit finds them: there the cost is the same but
for what no data could show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from machine_cases import (
    Case,
    data_for,
    effect,
    every,
    frame,
    joint,
    machine_file,
    noisy,
    title,
    with_effects,
)
from scipy.spatial.transform import Rotation

from rodgen.calibration.fit import fit
from rodgen.calibration.problem import Problem
from rodgen.calibration.solve import staged_fit
from rodgen.calibration.solve.starting_values import trilaterated
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

R, P = "revolute", "prismatic"
NOISE = {"point": 0.02, "direction": 1e-5, "distance": 0.02}
"""mm, rad; small, so that the residuals of a wrong local minimum exceed it."""


# rough starts ------------------------------------------------------------------------------------------------


def robot(kind: str) -> dict[str, Any]:
    z, y, x = (0, 0, 1), (0, 1, 0), (1, 0, 0)
    places = [
        (z, (0, 0, 0)),
        (y, (150, 0, 450)),
        (y, (150, 0, 1050)),
        (x, (400, 0, 1200)),
        (y, (800, 0, 1200)),
    ]
    joints = [joint(f"J{n}", R, *place) for n, place in enumerate([*places, (x, (900, 0, 1200))], start=1)]
    return machine_file(
        joints, [(1000, 50, 1200), (1000, -60, 1240), (980, 20, 1130)], kind=kind, frame="free"
    )


def mount(kind: str) -> dict[str, Any]:
    return machine_file(
        [joint("AZ", R, (0, 0, -1)), joint("EL", R, (1, 0, 0))], [(0, 1, 0)], kind=kind, frame="free"
    )


def gantry(kind: str) -> dict[str, Any]:
    slides = {"X": ((1, 0, 0), [0.0, 800.0]), "Y": ((0, 1, 0), [0.0, 600.0]), "Z": ((0, 0, 1), [-400.0, 0.0])}
    joints = [joint(name, P, axis, travel=travel) for name, (axis, travel) in slides.items()]
    joints.append(joint("C", R, (0, 0, 1)))
    return machine_file(joints, [(120, 0, -60), (-40, 85, -90)], kind=kind, frame="free")


def table(kind: str) -> dict[str, Any]:
    return machine_file(
        [joint("C", R, (0, 0, 1))], [(120, 0, 40), (-40, 85, 60), (0, 0, 200)], kind=kind, frame="free"
    )


def positioner(kind: str) -> dict[str, Any]:
    joints = [joint("theta", R, (0, 0, 1)), joint("phi", R, (0, 0, 1), (200, 0, 0))]
    return machine_file(joints, [(400, 0, 40), (360, 85, 60)], kind=kind, frame="free")


ROUGH = [
    pytest.param(robot, "point", 200, id="robot and tracker"),
    pytest.param(mount, "direction", 40, id="mount"),
    pytest.param(gantry, "point", 80, id="gantry"),
    pytest.param(gantry, "distance", 80, id="gantry and ballbar"),
    pytest.param(table, "point", 30, id="table"),
    pytest.param(table, "distance", 50, id="table and distances"),
    pytest.param(positioner, "point", 40, id="positioner"),
    pytest.param(positioner, "distance", 80, id="positioner and distances"),
]


def all_estimated(file: dict[str, Any]) -> dict[str, Any]:
    turns = [j["name"] for j in file["joint"] if j["type"] == R]
    points = [f"{name}.point" for name in turns] if file["measured"]["kind"] != "direction" else []
    axes = [f"{j['name']}.axis" for j in file["joint"]]
    return file | {"estimate": {"parameters": [*axes, *points, "target"]}}


def truth(case: Case, rng: np.random.Generator) -> dict[str, float]:
    """Draw what is wrong with the machine file, and where the frame is."""

    def tilt(key: str) -> dict[str, float]:
        size, towards = np.radians(rng.uniform(5, 10)), rng.uniform(0, 2 * np.pi)
        return {f"{key}.a": size * np.cos(towards), f"{key}.b": size * np.sin(towards)}

    directions = case.kind == "direction"
    values: dict[str, float] = {}
    for entry in case.file["estimate"]["parameters"]:
        if entry.endswith(".axis"):
            values |= tilt(entry)
        elif entry.endswith(".point"):
            values |= {f"{entry}.{x}": rng.normal() * 30 for x in "ab"}
    for target in case.file["target"]:
        if directions:
            values |= tilt(f"target.{target['name']}")
        else:
            away = rng.normal(size=3)
            away *= 100 / np.linalg.norm(away)
            values |= {f"target.{target['name']}.{x}": v for x, v in zip("xyz", away, strict=True)}
    turn = Rotation.from_quat(rng.normal(size=4)).as_rotvec()
    values |= {f"frame.r{x}": v for x, v in zip("xyz", turn, strict=True)}
    if not directions:
        values |= {f"frame.{x}": rng.uniform(-3000, 3000) for x in "xyz"}
    return values


def missed(
    make: Callable[[str], dict[str, Any]], kind: str, rows: int, seeds: Iterable[int]
) -> list[tuple[int, float]]:
    """Return the draws of which a fit from the file misses the least cost, and by how much."""
    file = all_estimated(make(kind))
    worse = []
    for seed in seeds:
        rng = np.random.default_rng([31, seed])
        case = Case(file, data_for(file, rows, rng, runs=1, turn=2.5))
        values = truth(case, rng)
        observations = replace(
            case.observations, reading=noisy(kind, case.simulated(values), NOISE[kind], rng)
        )
        start = {key: value for key, value in values.items() if not key.startswith("frame.")}
        best = fit(case.machine, observations, start=start)
        found = fit(case.machine, observations)
        if not found.chi_square < best.chi_square * (1 + 1e-5):
            worse.append((seed, found.chi_square / best.chi_square))
    return worse


@pytest.mark.thorough("mount-draws0", "gantry-draws0", "positioner-draws0")
@pytest.mark.parametrize("draws", [range(4), pytest.param(range(4, 15), marks=pytest.mark.slow)])
@pytest.mark.parametrize(("make", "kind", "rows"), ROUGH)
def test_rough_starts_end_at_the_least_cost(make, kind, rows, draws):
    assert missed(make, kind, rows, draws) == []


@pytest.mark.slow
@pytest.mark.parametrize(("make", "kind", "rows"), ROUGH)
def test_of_many_rough_starts_99_percent_end_at_the_least_cost(make, kind, rows):
    assert len(missed(make, kind, rows, range(200))) <= 2


@pytest.mark.thorough("mount-direction-linear", "robot-point-linear", "mount-direction-huber")
@pytest.mark.parametrize("loss", ["linear", "huber"])
@pytest.mark.parametrize(("make", "kind"), [(robot, "point"), (mount, "direction"), (table, "distance")])
def test_a_fit_that_begins_with_some_rows_ends_where_one_of_all_rows_ends(monkeypatch, make, kind, loss):
    """Also where three rows alone see a target, and where one in ten is wrong."""
    rng = np.random.default_rng(36)
    file = all_estimated(make(kind))
    columns = data_for(file, 1500, rng, runs=1, turn=2.5)
    names = [target["name"] for target in file["target"]]
    columns["target"] = [names[0] if n < 3 else names[-1] for n in range(1500)]
    case = Case(file, columns)
    reading = noisy(kind, case.simulated(truth(case, rng)), NOISE[kind], rng)
    if loss == "huber":
        reading[::10] = noisy(kind, reading[::10], 50 * NOISE[kind], rng)
    observations = replace(case.observations, reading=reading)
    few = fit(case.machine, observations, loss=loss)
    monkeypatch.setattr(staged_fit, "LEAST_ROWS", 10**9)
    every = fit(case.machine, observations, loss=loss)
    assert few.solution.converged
    assert few.chi_square == pytest.approx(every.chi_square, rel=1e-6)
    assert np.array_equal(few.outliers, every.outliers)
    apart = (few.residuals - every.residuals)[~few.outliers]
    assert np.linalg.norm(apart) < 1e-3 * every.rms  # all parameters together, in standard deviations


def test_groups_of_few_rows_are_evaluated_together_as_each_by_itself(monkeypatch):
    """Several reflectors on a robot, and the legs of a closed chain, on NumPy; at weights that change, too."""
    for name in ("robot_6r_tracker", "three_sps_s"):
        folder = Path(__file__).parent.parent / "examples" / "machines" / name
        made = fit(
            Machine.load(folder / "machine.toml"), Measurements.load(folder / "data.csv"), compiled=False
        )
        some = made.problem.take(np.arange(min(made.problem.rows, 120)))
        theta, frame = made.solution.theta, made.solution.frame

        def evaluated(problem, theta=theta, frame=frame):
            return (
                *problem.normal_equations(theta, frame),
                problem.residuals(theta, frame),
                problem.jacobian(theta, frame),
            )

        for rows_left_out in (0, 5):
            some.leave_out(np.arange(some.rows) < rows_left_out)
            together = [evaluated(some) for _ in range(2)]  # the second time what was kept
            with monkeypatch.context() as patch:
                patch.setattr("rodgen.calibration.problem.problem.TOGETHER", 0)
                together.append(evaluated(some.take(np.arange(some.rows))))  # as few rows of each group
                patch.setattr("rodgen.calibration.problem.problem.OF_EACH", 0)
                alone = Problem(some.model, some.observations)
                alone.leave_out(np.arange(some.rows) < rows_left_out)
                expected = evaluated(alone)
            for found in together:
                for one, other in zip(found, expected, strict=True):
                    np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-9 * np.abs(other).max())


@pytest.mark.parametrize(
    "name", ["ballbar_gantry", "gantry_rotary", "mount", "positioner", "three_sps_s", "trunnion"]
)
def test_equations_at_the_end_of_a_fit_are_those_that_its_last_step_predicts(name):
    """The last step is so small that they are not made again: cost and Gauss-Newton step there agree with new ones."""
    (data,) = (Path(__file__).parent.parent / "examples" / "machines" / name).glob("*.csv")
    made = fit(Machine.load(data.parent / "machine.toml"), Measurements.load(data))
    theta, frame, cost = made.solution.theta, made.solution.frame, made.solution.cost
    assert type(cost) is float
    carried = made.problem.normal_equations(theta, frame)
    made.problem.leave_out(made.outliers)  # forgets them
    exact = made.problem.normal_equations(theta, frame)
    assert carried[0] == pytest.approx(exact[0], rel=1e-6)
    assert cost == pytest.approx(exact[0], rel=1e-6)
    size = np.sqrt(np.diag(exact[1]))
    size[size == 0] = 1
    np.testing.assert_allclose(carried[1] / np.outer(size, size), exact[1] / np.outer(size, size), atol=1e-4)
    sigma = np.sqrt(exact[0] / made.degrees_of_freedom)
    np.testing.assert_allclose(carried[2] / size, exact[2] / size, atol=1e-4 * sigma)


@pytest.mark.parametrize(("make", "kind"), [(mount, "direction"), (table, "distance"), (table, "point")])
def test_a_fitted_machine_knows_where_its_frame_was(make, kind):
    rng = np.random.default_rng(35)
    file = all_estimated(make(kind))
    case = Case(file, data_for(file, 60, rng, runs=1))
    observations = replace(case.observations, reading=case.simulated(truth(case, rng)))
    found = fit(case.machine, observations)
    frame = {key: e.value for key, e in found.estimates.items() if key.startswith("frame.")}
    parameters = {p.key: p for p in found.parameters}
    assert frame == pytest.approx({key: found.machine.values[key] / parameters[key].factor for key in frame})
    again = fit(found.machine, observations)
    assert again.solution.iterations <= 2
    assert again.rms < (1e-6 if kind == "direction" else 1e-9)  # arcsec, mm: nothing but rounding
    shifted = replace(observations, reading=case.simulated(truth(case, rng)))
    assert fit(found.machine, shifted).rms < (1e-6 if kind == "direction" else 1e-9)


def test_distances_tell_where_they_are_measured_from():
    rng = np.random.default_rng(5)
    at = np.array([400.0, -700.0, 900.0])
    places = rng.normal(size=(20, 3)) * [300, 200, 100]
    first, *_ = trilaterated(places, np.linalg.norm(places - at, axis=1))
    assert np.allclose(
        first, at, rtol=0, atol=1e-8
    )  # lengths of 1000, squared and subtracted: 1e-13 * 1e6 / 100
    places[:, 2] = 50.0  # in a plane, a place over it looks as one below
    found = trilaterated(places, np.linalg.norm(places - at, axis=1))[1:]
    assert sorted(p[2] for p in found) == pytest.approx([-800, 900])
    assert np.allclose([p[:2] for p in found], at[:2])


# searches ----------------------------------------------------------------------------------------------------


@pytest.mark.thorough("60-1.3", "60-20", "400-3")
@pytest.mark.parametrize(
    ("rows", "waves"),
    [
        *[(60, 1.3), (60, 20), (400, 3), (400, 100), (3000, 900)],
        *(pytest.param(3000, waves, marks=pytest.mark.slow) for waves in (3.3, 10, 400)),
    ],
)
def test_a_period_is_found_among_many(rows, waves):
    """From one wave over the whole way to a thousand; 3 to 6 µm, seen with a noise of 2 µm."""
    rng = np.random.default_rng([33, rows])
    file = machine_file(
        [joint("C", R, (0, 0, 1)), joint("X", P, (1, 0, 0))],
        [(120, 0, 40), (-40, 85, 60)],
        estimate=["C.axis", "C.point", "target"],
        effects=[effect("periodic_drive_error", "C")],
    )
    case = Case(file, data_for(file, rows, rng, runs=1))
    key = "C.periodic_drive_error"
    values = {f"{key}.a": 4e-5, f"{key}.b": 3e-5, f"{key}.P": 6.0 / waves}
    reading = noisy("point", case.simulated(values), 0.002, rng)
    found = fit(case.machine, replace(case.observations, reading=reading))
    for x, value in values.items():
        estimate = found.estimates[x]
        factor = case.model.parameters[case.model.keys[x]].factor
        assert abs(estimate.value * factor - value) < 5 * estimate.std * factor


@pytest.mark.parametrize("tau", [40.0, 300.0, 2000.0, 8000.0])
def test_a_time_constant_is_found_whether_short_or_long(tau):
    """Over 4000 s, with 80 readings: some readings fall into the warming up, or it goes on to the end."""
    rng = np.random.default_rng(34)
    file = machine_file([joint("C", R, (0, 0, 1))], estimate=["target"], effects=[effect("warm_up_drift")])
    case = Case(file, data_for(file, 80, rng, runs=1))
    values = {
        "warm_up_drift.x": 0.1,
        "warm_up_drift.y": -0.2,
        "warm_up_drift.z": 0.15,
        "warm_up_drift.tau": tau,
    }
    reading = noisy("point", case.simulated(values), 0.002, rng)
    found = fit(case.machine, replace(case.observations, reading=reading))
    best = fit(case.machine, replace(case.observations, reading=reading), start=values)
    assert found.chi_square == pytest.approx(best.chi_square, rel=1e-6)
    assert found.estimates["warm_up_drift.tau"].value == pytest.approx(tau, rel=0.2)


# nested models -----------------------------------------------------------------------------------------------


def climbs(kind: str, seeds: Iterable[int]) -> list[tuple[int, float]]:
    """Return the draws where a larger model costs more than the one inside it, and by which part.

    A machine with six effects is measured; some effects, right or wrong ones, are fitted, then one more.
    """
    worse = []
    titles = [title(block) for block in every(kind).file["effect"]]
    size = {"point": 0.002, "direction": 2e-6, "distance": 0.002}[kind]
    for seed in seeds:
        rng = np.random.default_rng([41, seed])
        data = data_for(every(kind).file, 60, rng)
        true, order = ([titles[i] for i in rng.permutation(len(titles))] for _ in range(2))
        full = Case(every(kind).file, data)
        keys = [
            key for block in full.file["effect"] if title(block) in true[:6] for key in full.keys_of(block)
        ]
        reading = noisy(kind, full.simulated(full.sizeable(keys) | frame(kind)), size, rng)
        known, count = bool(rng.integers(2)), int(rng.integers(5))
        small, large = (with_effects(kind, order[:n], data, geometry_known=known) for n in (count, count + 1))
        inner = fit(small.machine, replace(small.observations, reading=reading))
        end = {inner.parameters[i].key: float(inner.solution.theta[i]) for i in inner.free}
        for start in ({}, end):
            outer = fit(large.machine, replace(large.observations, reading=reading), start=start)
            # a fit ends so near to the least; held directions leave less than a thousandth of a reading's variance
            part = 1e-8 if known else 1e-3 / inner.degrees_of_freedom
            if not outer.chi_square <= inner.chi_square * (1 + part):
                worse.append((seed, outer.chi_square / inner.chi_square - 1))
    return worse


@pytest.mark.thorough
@pytest.mark.quick("direction-draws0")
@pytest.mark.parametrize("draws", [range(2), pytest.param(range(2, 6), marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["point", "direction", "distance"])
def test_a_larger_model_never_fits_worse(kind, draws):
    assert climbs(kind, draws) == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["point", "direction", "distance"])
def test_of_many_larger_models_none_fits_worse(kind):
    assert climbs(kind, range(6, 100)) == []
