"""What a diagnosis computes with: columns of candidates, probabilities, rows that are wrong.

Columns are held against the Jacobian of a model that has the effects, probabilities against SciPy and mpmath.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rodgen.calibration.candidates import Candidate, candidates
from rodgen.calibration.dependence import MOST_READINGS, sample_of
from rodgen.calibration.fit import Fit, fit
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.problem import Problem
from rodgen.calibration.sensitivities import Sensitivities, is_direct
from rodgen.data.measurements import Measurements
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.machine import Machine
from rodgen.machines.model import Model

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
        table[f"a_{joint.name} [{unit}^2]"] = random.uniform(-2, 2, ROWS)
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
                # gravity turns for no joint of these that measures directions, and nothing was put on again
                bends = definition.formula.names & {"bend", "fork"}
                again = definition.name == "target_remounting" and len(base.observations.run_names) < 2
                assert ((definition.name, place) in keys) == (not bends and not again)


def test_effects_whose_columns_are_not_in_the_data_are_no_candidates():
    table = {
        k: v
        for k, v in table_of("rotary_table").items()
        if not k.startswith(("v_", "a_", "T_", "dir_", "t ", "load"))
    }
    base = fit(
        Machine.load(EXAMPLES / "rotary_table" / "machine.toml"),
        Measurements.from_frame(table),
        compiled=False,
    )
    names = {e.name for e in catalogue_effects(base.machine, base.observations)}
    whole = {e.name for e in catalogue_effects(base.machine, fitted("rotary_table").observations)}
    gone = {
        "servo_lag", "acceleration_lag", "thermal_offset", "thermal_axis_drift", "load_windup", "warm_up_drift",
        "linear_drift",
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
    points = SimpleNamespace(measurand=SimpleNamespace(components=("x", "y", "z")))
    rows = sample_of(SimpleNamespace(pose=pose, n=len(pose), machine=points), believed)  # type: ignore[arg-type]
    assert 0.8 * MOST_READINGS < 3 * len(rows) <= MOST_READINGS
    assert believed[rows].all()
    assert (np.diff(rows) > 0).all()
    taken = np.unique(pose[rows])
    assert np.isin(np.flatnonzero(believed & np.isin(pose, taken)), rows).all()
    few = np.ones(50, bool)
    few[7] = False
    some = SimpleNamespace(pose=np.arange(50), n=50, machine=points)
    assert sample_of(some, few).tolist() == [*range(7), *range(8, 50)]  # type: ignore[arg-type]


# effects that are in the model itself -------------------------------------------------------------------------


EFFECT = Machine.load(EXAMPLES / "rotary_table" / "machine.toml").effect("backlash", "C")


def test_direct_effects_are_those_that_are_no_products():
    names = {d.name for d in CATALOGUE if is_direct(replace(EFFECT, definition=d))}
    assert {"axis_tilt", "gravity_windup", "gravity_sag", "instrument_scale", "target_offset"} <= names
    assert not names & {"backlash", "encoder_eccentricity", "straightness", "warm_up_drift", "linear_drift"}
