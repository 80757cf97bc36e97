"""Forms of what no effect of the catalogue explains: the driver, the prediction, and nothing where nothing is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from machine_cases import READINGS, Case, data_for, joint, machine_file, unit
from machine_simulator import Simulated

from rodgen.calibration.diagnose.forms import Form, find_forms
from rodgen.calibration.diagnose.forms.dictionary import dictionary, drivers_of
from rodgen.calibration.diagnose.forms.formula import Piece
from rodgen.calibration.diagnose.forms.projected_rows import PosesLeftOut, ProjectedRows, folds_of
from rodgen.calibration.diagnose.forms.screen import Functions, Screen
from rodgen.calibration.diagnose.sensitivities import Sensitivities
from rodgen.calibration.fit import Fit, fit
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind
from rodgen.data.measurements import Measurements
from rodgen.machines.files.edit import text_with_effects
from rodgen.machines.files.write import effect_text
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model
from rodgen.statistics.columns import unchanged

ARCSEC = np.pi / 648000
NOISE = {"point": 0.004, "distance": 0.004, "direction": 2 * ARCSEC}
BY_A_FIFTH = 0.66
"""With noise of 1 it raises the rms by a fifth."""
ROWS = 250

TABLE = machine_file(
    [joint("C", "revolute", (0, 0, 1))],
    [(150, 0, 30), (-40, 90, 110)],
    estimate=["C.axis", "C.point", "target"],
)
GANTRY = machine_file(
    [
        joint("X", "prismatic", (1, 0, 0), travel=[0.0, 800.0]),
        joint("Y", "prismatic", (0, 1, 0), travel=[0.0, 500.0]),
        joint("B", "revolute", (0, 1, 0), (0, 0, 50)),
        joint("C", "revolute", (0, 0, 1)),
    ],
    [(120, 30, 40), (-60, 20, 90)],
    estimate=["B.axis", "B.point", "C.axis", "C.point", "target"],
    effects=[{"name": "squareness", "joint": "Y"}],
)
TELESCOPE = machine_file(
    [joint("AZ", "revolute", (0, 0, 1)), joint("EL", "revolute", (0, -1, 0))],
    [(1, 0, 0)],
    kind="direction",
    frame="free",
    estimate=["EL.axis", "target"],
)
RANGE = machine_file(
    [joint("X", "prismatic", (1, 0, 0), travel=[0.0, 800.0]), joint("C", "revolute", (0, 0, 1))],
    [(120, 30, 40), (-60, 20, 90)],
    kind="distance",
    estimate=["C.axis", "C.point", "target"],
)

Columns = Mapping[str, Any]


class Kind(NamedTuple):
    """Something that the catalogue does not have, of any size."""

    file: Mapping[str, Any]
    place: str
    value: Callable[[Columns], Any]
    drivers: set[str]


KINDS = {
    "fifth harmonic of a table's height": Kind(
        TABLE, "C.tz", lambda c: np.sin(5 * c["q"]) + np.cos(5 * c["q"]), {"C"}
    ),
    "cubic of a slide": Kind(GANTRY, "X.reading", lambda c: (c["q"] / 800 - 0.5) ** 3, {"X"}),
    "step at an angle": Kind(TABLE, "C.reading", lambda c: ARCSEC * np.sign(c["q"] - 0.7), {"C"}),
    "bump": Kind(GANTRY, "Y.reading", lambda c: np.exp(-(((c["q"] - 200) / 60) ** 2)), {"Y"}),
    "bend": Kind(GANTRY, "X.tz", lambda c: np.abs(c["q"] - 300), {"X"}),
    "direction times sine": Kind(TABLE, "C.reading", lambda c: ARCSEC * c["s"] * np.sin(c["q"]), {"C"}),
    "exponential in time": Kind(GANTRY, "C.reading", lambda c: ARCSEC * (1 - np.exp(-c["t"] / 700)), {"t"}),
    "humidity": Kind(GANTRY, "Y.tx", lambda c: c["humidity"], {"humidity"}),
    "square of a load": Kind(GANTRY, "B.reading", lambda c: ARCSEC * c["F"] ** 2, {"load"}),
    "product of two joints": Kind(GANTRY, "C.reading", lambda c: ARCSEC * c["q"] * c["X"], {"C", "X"}),
    "another joint's angle": Kind(GANTRY, "B.reading", lambda c: ARCSEC * np.sin(3 * c["C"]), {"C"}),
    "square of a velocity": Kind(GANTRY, "X.reading", lambda c: c["v"] * np.abs(c["v"]), {"v_X"}),
    "wave of no whole number": Kind(TABLE, "C.reading", lambda c: ARCSEC * np.sin(3.37 * c["q"]), {"C"}),
    "temperature times sine": Kind(
        TABLE, "C.reading", lambda c: ARCSEC * c["T"] * np.sin(c["q"]), {"T_C", "C"}
    ),
    "load times wave": Kind(
        GANTRY, "C.reading", lambda c: ARCSEC * c["F"] * np.sin(3 * c["q"]), {"load", "C"}
    ),
    "load times cubic": Kind(GANTRY, "X.reading", lambda c: c["F"] * (c["q"] / 400 - 1) ** 3, {"load", "X"}),
    "direction times wave": Kind(TABLE, "C.reading", lambda c: ARCSEC * c["s"] * np.sin(3 * c["q"]), {"C"}),
    "axis that wobbles thrice": Kind(TELESCOPE, "AZ.ry", lambda c: ARCSEC * np.sin(3 * c["q"]), {"AZ"}),
    "column seen by directions": Kind(TELESCOPE, "EL.reading", lambda c: ARCSEC * c["flow"] ** 2, {"flow"}),
    "height seen by distances": Kind(RANGE, "C.tz", lambda c: np.sin(5 * c["q"]), {"C"}),
}
INNOCENT = {"table": TABLE, "gantry": GANTRY, "telescope": TELESCOPE, "range": RANGE}


def commands(file: Mapping[str, Any], random: np.random.Generator, rows: int = ROWS) -> dict[str, Any]:
    turn = 1.4 if file["measured"]["kind"] == "direction" else 3.1
    data = data_for(file, rows, random, runs=1, turn=turn)
    del data["run"]
    data["humidity [%]"] = random.uniform(30, 70, rows)
    data["pressure [hPa]"] = 1000 + 10 * np.cumsum(random.normal(size=rows)) / np.sqrt(rows)
    data["flow"] = random.uniform(0, 4, rows)
    return data


def measured(
    file: Mapping[str, Any],
    columns: Mapping[str, Any],
    effects: Mapping[str, Any],
    noise: float,
    random: np.random.Generator,
) -> dict[str, Any]:
    arguments = dict(Case(file, columns).arguments)
    reading = Simulated({**file, "effect": []}, effects).measure(arguments.pop("q"), **arguments)
    error = noise * random.normal(size=reading.shape)
    kind = file["measured"]["kind"]
    reading = reading + error if kind != "direction" else unit(reading + np.cross(error, reading))
    names = [name if kind == "direction" else f"{name} [mm]" for name in READINGS[kind]]
    return {**columns, **dict(zip(names, reading.T, strict=True))}


def machine_of(file: Mapping[str, Any]) -> Machine:
    return Case(file, {}).machine


def fitted(machine: Machine, columns: Mapping[str, Any]) -> Fit:
    return fit(machine, Measurements.from_frame(columns), compiled=False)


class Told(NamedTuple):
    forms: list[Form]
    base: Fit
    columns: dict[str, Any]
    effects: dict[str, Any]
    noise: float


@cache
def told(name: str, seed: int, size: float) -> Told:
    """Hide an effect that leaves `size` times the noise after the best fit without it, and look for it."""
    kind, random = KINDS[name], np.random.default_rng(seed)
    noise = NOISE[kind.file["measured"]["kind"]]
    columns = commands(kind.file, random)
    alone = measured(kind.file, columns, {kind.place: lambda c: 1e-3 * kind.value(c)}, 0.0, random)
    base = fitted(machine_of(kind.file), alone)
    factor = 1e-3 * size * noise / (base.rms * base.unit_factor)
    effects = {kind.place: lambda c: factor * kind.value(c)}
    columns = measured(kind.file, columns, effects, noise, random)
    base = fitted(machine_of(kind.file), columns)
    sensitivities = Sensitivities.of(base)
    return Told(find_forms(sensitivities, unchanged, sensitivities.model), base, columns, effects, noise)


def error_on(fitted_machine: Machine, columns: Mapping[str, Any]) -> np.ndarray:
    o = bind(fitted_machine, Measurements.from_frame(columns))
    model = Model(fitted_machine, o.travel, o.run_names, compiled=False)
    frame = Frame.fitted(fitted_machine.values) or Frame.identity()
    return Problem(model, o).residuals(model.start(), frame)


@pytest.mark.thorough(
    "temperature times sine-0", "direction times wave-0", "fifth harmonic of a table's height-0"
)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", KINDS)
def test_driver_of_what_raises_the_error_by_a_fifth(name: str, seed: int) -> None:
    forms = told(name, seed, BY_A_FIFTH).forms
    assert forms
    assert set(forms[0].driver.split(" and ")) <= KINDS[name].drivers, forms
    assert forms[0].log10_p < -5
    assert len(forms) == 1


@pytest.mark.thorough("fifth harmonic of a table's height", "direction times wave")
@pytest.mark.parametrize("name", KINDS)
def test_form_predicts_readings_that_it_has_not_seen(name: str) -> None:
    """Within what the noise of the readings makes of the parameters, of which it has more than the truth at times."""
    forms, _, columns, effects, noise = told(name, 2, 3.0)
    machine = machine_of(KINDS[name].file)
    for form in forms:
        machine = machine.with_effect(form.effect(machine))
    better = fitted(machine, columns)
    assert better.rms * better.unit_factor < 1.15 * noise
    random = np.random.default_rng(100)
    fresh = measured(KINDS[name].file, commands(KINDS[name].file, random), effects, 0.0, random)
    error = error_on(better.machine, fresh)
    by_noise = noise * np.sqrt(len(better.free) / (ROWS * error.shape[1]))
    assert np.sqrt(np.mean(error**2)) < 2.0 * by_noise
    for form in forms:  # the coefficients of the search are those of a fit
        for parameter, (value, in_unit) in form.parameters.items():
            key = ".".join(filter(None, [form.place, form.name, parameter]))
            estimate = better.estimates[key]
            assert estimate.unit == in_unit
            assert value == pytest.approx(
                estimate.value, rel=0.1, abs=3 * (estimate.std or 1e-9 * abs(value))
            )


@pytest.mark.thorough("table-seeds0", "range-seeds0")
@pytest.mark.parametrize("seeds", [range(4), pytest.param(range(4, 8), marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", INNOCENT)
def test_nothing_is_found_in_noise(name: str, seeds: range) -> None:
    file = INNOCENT[name]
    for seed in seeds:
        random = np.random.default_rng(seed)
        noise = NOISE[file["measured"]["kind"]]
        rows = (40, 60, 120, 250)[seed % 4]
        base = fitted(machine_of(file), measured(file, commands(file, random, rows), {}, noise, random))
        sensitivities = Sensitivities.of(base)
        assert find_forms(sensitivities, unchanged, sensitivities.model) == []


# two, and what a formula cannot name -----------------------------------------------------------------------------


def test_two_forms_are_found_together() -> None:
    random = np.random.default_rng(5)
    effects = {
        "C.tz": lambda c: 0.004 * np.sin(5 * c["q"]),
        "Y.tx": lambda c: 2e-4 * c["humidity"],
    }
    columns = measured(GANTRY, commands(GANTRY, random), effects, 0.003, random)
    sensitivities = Sensitivities.of(fitted(machine_of(GANTRY), columns))
    forms = find_forms(sensitivities, unchanged, sensitivities.model)
    assert sorted(form.driver for form in forms) == ["C", "humidity"]
    assert 0 < sum(form.explains for form in forms) < 1


def test_terms_at_one_place_are_one_form() -> None:
    random = np.random.default_rng(6)
    effects = {"C.tz": lambda c: 0.006 * np.sin(5 * c["q"]) + 0.006 * np.sin(9 * c["q"])}
    columns = measured(TABLE, commands(TABLE, random), effects, 0.003, random)
    sensitivities = Sensitivities.of(fitted(machine_of(TABLE), columns))
    (form,) = find_forms(sensitivities, unchanged, sensitivities.model)
    assert {"5*q", "9*q"} == {text for text in ("5*q", "9*q") if text in form.formula}
    assert form.columns.shape[2] == 4


def test_columns_that_no_formula_can_name_drive_nothing() -> None:
    random = np.random.default_rng(7)
    columns = commands(TABLE, random)
    columns["rel. humidity"] = columns.pop("humidity [%]")
    columns["a"], columns["b"] = random.normal(size=(2, ROWS))
    effects = {"C.tz": lambda c: 0.006 * np.sin(5 * c["q"])}
    columns = measured(TABLE, columns, effects, 0.003, random)
    base = fitted(machine_of(TABLE), columns)
    assert "rel. humidity" in base.observations.covariates
    sensitivities = Sensitivities.of(base)
    (form,) = find_forms(sensitivities, unchanged, sensitivities.model)
    assert not {"a", "b"} & form.parameters.keys()  # these are columns
    assert form.effect_definition(base.machine).formula.text == form.formula


def test_joints_that_are_called_like_words_of_formulas(tmp_path: Any) -> None:
    file = machine_file(
        [joint("T", "revolute", (0, 0, 1)), joint("q", "prismatic", (0, 0, 1), travel=[0.0, 300.0])],
        [(150, 0, 30), (-40, 90, 110)],
        estimate=["T.axis", "target"],
    )
    random = np.random.default_rng(13)
    noise = 0.003
    columns = measured(file, commands(file, random), {}, noise, random)
    columns["z [mm]"] = columns["z [mm]"] + 0.004 * columns["flow"]
    base = fitted(machine_of(file), columns)
    assert {(d.kind, d.name) for d in drivers_of(base.observations)} & {
        ("joint", "T"),
        ("joint", "q"),
        ("temperature", "T_T"),
    } == set()
    sensitivities = Sensitivities.of(base)
    machine, forms = machine_of(file), find_forms(sensitivities, unchanged, sensitivities.model)
    assert [form.driver for form in forms] == ["flow"]
    for form in forms:
        machine = machine.with_effect(form.effect(machine))
        machine.save(tmp_path / "machine.toml")
        assert Machine.load(tmp_path / "machine.toml") == machine


def test_columns_of_any_size() -> None:
    random = np.random.default_rng(14)
    columns = commands(TABLE, random)
    columns["huge"] = 1e90 * random.uniform(-1, 1, ROWS)
    columns["tiny"] = 1e-90 * random.uniform(-1, 1, ROWS)
    columns["same"] = np.full(ROWS, 3.0)
    columns["two"] = random.choice([0.0, 1e9], ROWS)
    columns["late"] = 1.7e9 + random.uniform(0, 1, ROWS)
    effects = {"C.tz": lambda c: 0.006 * c["tiny"] / 1e-90 + 0.006 * np.sin(5 * c["q"])}
    columns = measured(TABLE, columns, effects, 0.003, random)
    sensitivities = Sensitivities.of(fitted(machine_of(TABLE), columns))
    forms = find_forms(sensitivities, unchanged, sensitivities.model)
    assert sorted(form.driver for form in forms) == ["C", "tiny"]


def test_few_rows_and_no_noise_have_no_form() -> None:
    random = np.random.default_rng(15)
    for rows, noise in ((5, 0.004), (6, 0.004), (8, 0.004), (100, 0.0)):
        columns = measured(TABLE, commands(TABLE, random, rows), {}, noise, random)
        sensitivities = Sensitivities.of(fitted(machine_of(TABLE), columns))
        assert find_forms(sensitivities, unchanged, sensitivities.model) == []


# the block -------------------------------------------------------------------------------------------------------


@pytest.mark.thorough("exponential in time")
@pytest.mark.parametrize(
    "name",
    [
        "bump",
        "cubic of a slide",
        "exponential in time",
        "humidity",
        "step at an angle",
        "square of a velocity",
    ],
)
def test_block_pasted_into_the_machine_file_lowers_the_error_to_the_noise(name: str, tmp_path: Any) -> None:
    forms, base, columns, _, noise = told(name, 2, 3.0)
    bare = machine_of(KINDS[name].file)
    bare.save(tmp_path / "machine.toml")
    text = (tmp_path / "machine.toml").read_text()
    for form in forms:
        text += "\n" + effect_text(bare, form.effect(bare))
    (tmp_path / "more.toml").write_text(text)
    machine = Machine.load(tmp_path / "more.toml")
    assert len(machine.effects) == len(bare.effects) + len(forms)
    better = fitted(machine, columns)
    assert better.rms * better.unit_factor < 1.15 * noise
    assert base.rms * base.unit_factor > 2.5 * noise
    if len(forms) == 1:
        source = tmp_path / "machine.toml"
        source.write_bytes(text_with_effects(source, [forms[0].effect(bare)]).encode())
        added = Machine.load(source)
        assert added == machine


def test_block_has_a_name_of_its_own() -> None:
    forms, base, *_ = told("humidity", 2, 3.0)
    once = base.machine.with_effect(forms[0].effect(base.machine))
    twice = once.with_effect(forms[0].effect(once))
    assert len({(e.name, e.place) for e in twice.effects}) == len(twice.effects)
    assert forms[0].columns.shape[:2] == base.residuals.shape


def test_coefficients_in_their_units() -> None:
    """A percent is a hundredth inside, a pressure far from zero is counted from its middle."""
    forms, _, _, effects, _ = told("humidity", 2, 3.0)
    value, in_unit = forms[0].parameters["a"]
    assert (forms[0].formula, in_unit) == ("a*humidity", "mm")
    assert value == pytest.approx(100 * effects["Y.tx"]({"humidity": 1.0}), rel=0.05)
    random = np.random.default_rng(12)
    effects = {"C.tz": lambda c: 2e-3 * c["pressure"]}
    columns = measured(TABLE, commands(TABLE, random), effects, 0.003, random)
    sensitivities = Sensitivities.of(fitted(machine_of(TABLE), columns))
    (form,) = find_forms(sensitivities, unchanged, sensitivities.model)
    value, in_unit = form.parameters["a"]
    assert (form.driver, in_unit) == ("pressure", "mm/hPa")
    assert form.formula.startswith("a*(pressure - ")
    assert value == pytest.approx(2e-3, rel=0.05)


# readings that depend on each other ------------------------------------------------------------------------------


def test_drift_that_is_whitened_is_no_form() -> None:
    """One component wanders as a random walk; its increments are independent."""
    random = np.random.default_rng(8)
    columns = commands(TABLE, random, 300)
    columns = measured(TABLE, columns, {"C.tz": lambda c: 0.004 * np.sin(5 * c["q"])}, 0.002, random)
    columns["z [mm]"] = columns["z [mm]"] + np.cumsum(0.002 * random.normal(size=300))
    base = fitted(machine_of(TABLE), columns)
    sensitivities = Sensitivities.of(base)
    i = np.arange(300)
    covariance = np.eye(300) + np.minimum.outer(i + 1, i + 1)
    root = np.linalg.inv(np.linalg.cholesky(covariance))

    def whiten(some: np.ndarray) -> np.ndarray:
        white = some.copy()
        white[:, 2] = root @ some[:, 2]
        return white

    (form,) = find_forms(sensitivities, whiten, sensitivities.model)
    assert (form.driver, form.component) == ("C", "tz")
    assert "5*q" in form.formula
    still = replace(sensitivities, residual=sensitivities.residual_of(base))
    with_form = np.concatenate([sensitivities.model, form.columns], axis=2)
    assert find_forms(still, whiten, with_form) == []


# for the contest with effects of the catalogue -------------------------------------------------------------------


def test_a_form_knows_whether_it_is_in_the_catalogue() -> None:
    random = np.random.default_rng(9)
    for effects, own in (
        ({"C.reading": lambda c: 4e-5 * np.sin(c["q"])}, True),
        ({"C.tz": lambda c: 0.006 * np.sin(5 * c["q"])}, False),
    ):
        columns = measured(TABLE, commands(TABLE, random), effects, 0.003, random)
        sensitivities = Sensitivities.of(fitted(machine_of(TABLE), columns))
        (best,) = find_forms(sensitivities, unchanged, sensitivities.model)
        assert best.in_catalogue is own
        assert len(best.parameters) == best.columns.shape[2] == 2
        before, after = (
            np.linalg.lstsq(
                columns.reshape(-1, columns.shape[2]), sensitivities.residual.ravel(), rcond=None
            )[1][0]
            for columns in (
                sensitivities.model,
                np.concatenate([sensitivities.model, best.columns], axis=2),
            )
        )
        assert best.explains == pytest.approx(1 - after / before, rel=1e-6)


# the parts -------------------------------------------------------------------------------------------------------


def _sensitivities() -> Sensitivities:
    random = np.random.default_rng(11)
    columns = commands(GANTRY, random, 60)
    return Sensitivities.of(fitted(machine_of(GANTRY), measured(GANTRY, columns, {}, 0.004, random)))


def test_scores_of_all_terms_are_those_of_least_squares() -> None:
    """In single precision, of columns that the model leaves a visible part of."""
    sensitivities = _sensitivities()
    drivers = drivers_of(sensitivities.observations)
    places = [("C", "reading"), ("C", "tz"), ("X", "tx"), ("B", "ry")]
    C = np.stack([sensitivities.component(*place) for place in places])
    projected = ProjectedRows(C, [d.values for d in drivers], sensitivities.residual, lambda columns: columns)
    projected.take_out(projected.flat(sensitivities.model))
    terms = dictionary(drivers, sensitivities.observations.machine)
    at = {name: [i for i, (place, _) in enumerate(places) if place == name] for name in "XYBC"}
    screen = Screen(projected, Functions.of(terms, projected.drivers), at)
    found = list(screen.best(lambda part, parameters: part))
    random = np.random.default_rng(0)
    for index in random.choice(len(found), 200, replace=False):
        part, term, sensitivity = found[index]
        exact = float(projected.falls([term], sensitivity)[0]) / projected.total
        assert part == pytest.approx(exact, rel=0.02, abs=2e-3), term
    assert screen.tried > 1000


def test_error_on_unseen_poses_is_that_of_refits() -> None:
    sensitivities = _sensitivities()
    pose, fold = folds_of(sensitivities.observations.pose)
    m = sensitivities.residual.shape[1]
    order = np.argsort(np.repeat(fold, m), kind="stable")
    C = sensitivities.component("C", "tz")[None]
    drivers = drivers_of(sensitivities.observations)
    projected = ProjectedRows(
        C, [d.values for d in drivers], sensitivities.residual, lambda columns: columns, order=order
    )
    projected.take_out(projected.flat(sensitivities.model))
    unseen = PosesLeftOut(projected, np.repeat(pose, m)[order], np.repeat(fold, m)[order])
    term = dictionary(drivers, sensitivities.observations.machine)[-1]
    own = projected.columns_of(Piece.whole(term, 0))
    found = unseen.squares(projected.flat(own))
    whole = np.concatenate([sensitivities.model, own], axis=2)
    for k in range(10):
        seen, held = fold != k, fold == k
        A, b = (x[seen].reshape(seen.sum() * m, -1) for x in (whole, sensitivities.residual))
        size = np.linalg.norm(A, axis=0)
        theta = np.linalg.lstsq(A / size, b[:, 0], rcond=1e-12)[0] / size
        rest = sensitivities.residual[held] - whole[held] @ theta
        assert np.bincount(pose[held], np.sum(rest**2, axis=1), len(found))[pose[held]] == pytest.approx(
            found[pose[held]], rel=1e-5
        )


@pytest.mark.slow
def test_the_driver_at_one_of_six_joints_is_found_in_many_rows() -> None:
    file = machine_file(
        [
            joint(f"A{k}", "revolute", axis, (0, 0, 300 * k))
            for k, axis in enumerate([(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)])
        ],
        [(850, 0, 930), (850, 60, 900)],
        frame="free",
        estimate=["A1.axis", "A2.axis", "target"],
    )
    random = np.random.default_rng(3)
    effects = {"A2.reading": lambda c: 5e-6 * c["A4"] * np.sin(c["A3"])}
    columns = measured(file, commands(file, random, 20_000), effects, 0.004, random)
    sensitivities = Sensitivities.of(fitted(machine_of(file), columns))
    forms = find_forms(sensitivities, unchanged, sensitivities.model)
    assert set(forms[0].driver.split(" and ")) == {"A3", "A4"}
