"""Forms of what no effect of the catalogue explains: the driver, the prediction, and nothing where nothing is."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from machine_cases import READINGS, Case, data_for, joint, machine_file, unit
from machine_simulator import Simulated

from rodgen.calibration.candidates import Candidate
from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.fit import Fit, fit
from rodgen.calibration.fitted import Estimate
from rodgen.calibration.form_terms import Factor, Term, drivers_of, effect_of, terms
from rodgen.calibration.forms import propose, sharpened
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind
from rodgen.calibration.selection import select
from rodgen.data.measurements import Measurements
from rodgen.machines.effects.formula import ARRAY_FUNCTIONS
from rodgen.machines.files.edit import edited_text
from rodgen.machines.files.write import effect_text
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model

ARCSEC = np.pi / 648000
NOISE = {"point": 0.004, "distance": 0.004, "direction": 2 * ARCSEC}
BY_A_HALF = 1.1
"""With noise of 1 it raises the rms by a half."""
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
FEW = (
    "fifth harmonic of a table's height", "step at an angle", "exponential in time", "product of two joints",
    "load times wave", "height seen by distances", "column seen by directions",
)  # fmt: skip
"""A kind of each driver and of each reading; `make test-slow` has the others, which take the same way."""
OF_EACH_READING = ("step at an angle", "height seen by distances", "column seen by directions")


def every_kind(few: Sequence[str]) -> pytest.MarkDecorator:
    """Repeat a test for every kind, of which all but a few are slow."""
    return pytest.mark.parametrize(
        "name", [k if k in few else pytest.param(k, marks=pytest.mark.slow) for k in KINDS]
    )


LIKE = {"axis that wobbles thrice": ("tilt_error_motion", "AZ")}
"""Effects of the catalogue that say the same with other harmonics: over half a turn they may explain as much."""
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


def selected(base: Fit) -> list[Candidate]:
    """Return what is selected among forms and the effects of the catalogue."""
    evidence = Evidence.of(base)
    chosen = select(evidence)
    return select(evidence.including(propose(evidence, chosen)))


def forms_of(base: Fit) -> list[Candidate]:
    return [c for c in selected(base) if c.effect.definition.own]


def text_of(form: Candidate) -> str:
    return form.effect.definition.formula.text


class Told(NamedTuple):
    forms: list[Candidate]
    catalogued: list[tuple[str, str | None]]
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
    chosen = selected(base)
    forms = [c for c in chosen if c.effect.definition.own]
    return Told(forms, [c.key for c in chosen if c not in forms], base, columns, effects, noise)


def error_on(fitted_machine: Machine, columns: Mapping[str, Any]) -> np.ndarray:
    o = bind(fitted_machine, Measurements.from_frame(columns))
    model = Model(fitted_machine, o.travel, o.run_names, compiled=False)
    frame = Frame.fitted(fitted_machine.values) or Frame.identity()
    return Problem(model, o).residuals(model.start(), frame)


def drivers_in(form: Candidate) -> set[str]:
    """Return what a formula names, by the names of columns."""
    place = form.effect.place
    called = {"q": place, "s": place, "v": f"v_{place}", "T": f"T_{place}", "F": "load", "t": "t"}
    used = form.effect.definition.formula.names - form.effect.definition.parameters.keys() - {"pi"}
    return {str(called.get(name, name)) for name in used}


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
@every_kind(FEW)
def test_driver_of_what_raises_the_error_by_a_half(name: str, seed: int) -> None:
    forms, catalogued, *_ = told(name, seed, BY_A_HALF)
    if not forms:
        assert catalogued == [LIKE[name]]
        return
    assert drivers_in(forms[0]) <= KINDS[name].drivers, [text_of(form) for form in forms]


@pytest.mark.thorough
@every_kind(OF_EACH_READING)  # a driver that is found predicts by the same functions, whatever it is
def test_form_predicts_readings_that_it_has_not_seen(name: str) -> None:
    """Within what the noise of the readings makes of the parameters, of which it has more than the truth at times."""
    forms, _, _, columns, effects, noise = told(name, 2, 3.0)
    machine = machine_of(KINDS[name].file)
    for form in forms:
        machine = machine.with_effect(form.effect)
    better = fitted(machine, columns)
    assert better.rms * better.unit_factor < 1.15 * noise
    random = np.random.default_rng(100)
    fresh = measured(KINDS[name].file, commands(KINDS[name].file, random), effects, 0.0, random)
    error = error_on(better.machine, fresh)
    by_noise = noise * np.sqrt(len(better.free) / (ROWS * error.shape[1]))
    assert np.sqrt(np.mean(error**2)) < 2.5 * by_noise


@pytest.mark.thorough
@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 8), marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", INNOCENT)
def test_nothing_is_found_in_noise(name: str, seeds: range) -> None:
    file = INNOCENT[name]
    for seed in seeds:
        random = np.random.default_rng(seed)
        noise = NOISE[file["measured"]["kind"]]
        rows = (40, 60, 120, 250)[seed % 4]
        base = fitted(machine_of(file), measured(file, commands(file, random, rows), {}, noise, random))
        assert forms_of(base) == []


# two, and what a formula cannot name -----------------------------------------------------------------------------


@pytest.mark.thorough
def test_two_forms_are_found_together() -> None:
    random = np.random.default_rng(5)
    effects = {
        "C.tz": lambda c: 0.004 * np.sin(5 * c["q"]),
        "Y.tx": lambda c: 2e-4 * c["humidity"],
    }
    columns = measured(GANTRY, commands(GANTRY, random), effects, 0.003, random)
    forms = forms_of(fitted(machine_of(GANTRY), columns))
    assert sorted(map(sorted, map(drivers_in, forms))) == [["C"], ["humidity"]]


@pytest.mark.thorough
def test_columns_that_no_formula_can_name_drive_nothing() -> None:
    random = np.random.default_rng(7)
    columns = commands(TABLE, random)
    columns["rel. humidity"] = columns.pop("humidity [%]")
    columns["a"], columns["b"] = random.normal(size=(2, ROWS))
    effects = {"C.tz": lambda c: 0.006 * np.sin(5 * c["q"])}
    base = fitted(machine_of(TABLE), measured(TABLE, columns, effects, 0.003, random))
    assert "rel. humidity" in base.observations.covariates
    (form,) = forms_of(base)
    assert not {"a", "b"} & form.effect.definition.parameters.keys()  # these are columns
    assert "sin(5*q)" in text_of(form)


@pytest.mark.thorough
def test_columns_of_any_size() -> None:
    random = np.random.default_rng(14)
    columns = commands(TABLE, random)
    columns["huge"] = 1e90 * random.uniform(-1, 1, ROWS)
    columns["tiny"] = 1e-90 * random.uniform(-1, 1, ROWS)
    columns["same"] = np.full(ROWS, 3.0)
    columns["two"] = random.choice([0.0, 1e9], ROWS)
    columns["late"] = 1.7e9 + random.uniform(0, 1, ROWS)
    effects = {"C.tz": lambda c: 0.006 * c["tiny"] / 1e-90 + 0.006 * np.sin(5 * c["q"])}
    forms = forms_of(fitted(machine_of(TABLE), measured(TABLE, columns, effects, 0.003, random)))
    assert sorted(map(sorted, map(drivers_in, forms))) == [["C"], ["tiny"]]


@pytest.mark.thorough
def test_few_rows_and_no_noise_have_no_form() -> None:
    random = np.random.default_rng(15)
    for rows, noise in ((5, 0.004), (8, 0.004), (100, 0.0)):
        columns = measured(TABLE, commands(TABLE, random, rows), {}, noise, random)
        assert forms_of(fitted(machine_of(TABLE), columns)) == []


@pytest.mark.thorough
def test_a_joint_that_stands_still_drives_nothing() -> None:
    random = np.random.default_rng(16)
    columns = commands(GANTRY, random, 60)
    columns["B [rad]"] = 0.5 + 1e-5 * random.normal(size=60)
    base = fitted(machine_of(GANTRY), measured(GANTRY, columns, {}, 0.004, random))
    assert {d.name for d in drivers_of(base.observations) if d.kind == "joint"} == {"X", "Y", "C"}


# what is no form ---------------------------------------------------------------------------------------------------


SLIDE = machine_file(
    [joint("X", "prismatic", (1, 0, 0), travel=[0.0, 800.0])], [(0, 0, 0)], kind="distance", estimate=[]
)


def along(x: np.ndarray, error: np.ndarray, **more: Any) -> Fit:
    """Return a fit of a slide whose distance from the origin is measured."""
    file = {
        **SLIDE,
        "measured": {**SLIDE["measured"], "from": [0, 0, 0]},
        "effect": [{"name": "zero_offset", "joint": "X"}],
    }
    return fitted(machine_of(file), {"X [mm]": x, "d [mm]": x + error, **more})


def test_scale_and_backlash_are_no_form() -> None:
    random = np.random.default_rng(1)
    x, s = np.tile(np.linspace(50, 600, 12), 4), np.repeat([1, -1, 1, -1], 12)
    x = np.where(s > 0, x, x[::-1])
    error = 2e-5 * x + 1.2e-3 * s + 1e-4 * random.normal(size=len(x))
    base = along(x, error, dir_X=s)
    chosen = select(evidence := Evidence.of(base))
    assert {c.key for c in chosen} == {("scale", "X"), ("backlash", "X")}
    for given in (chosen, []):
        found = [text_of(form) for form in propose(evidence, given)]
        assert not {"a*s", "a*q", "a*q*s"} & set(found), found


def test_one_pose_aside_is_no_step() -> None:
    random = np.random.default_rng(2)
    x = np.linspace(50, 600, 12)
    error = np.where(x < 60, 0.05, 0.0) + 1e-3 * random.normal(size=12)
    assert not [form for form in forms_of(along(x, error)) if "sign" in text_of(form)]


def test_few_positions_show_no_curve() -> None:
    """An error of each of six positions, read four times, is no wave of searched period, nor a quintic."""
    random = np.random.default_rng(3)
    x = np.repeat(np.linspace(50, 600, 6), 4)
    error = np.repeat(0.02 * random.normal(size=6), 4) + 1e-3 * random.normal(size=24)
    assert forms_of(along(x, error)) == []


@pytest.mark.thorough
def test_a_chosen_period_is_sharpened() -> None:
    random = np.random.default_rng(4)
    columns = commands(GANTRY, random)
    effects = {"X.reading": lambda c: 0.2 * np.sin(2 * np.pi * c["q"] / 47.3)}
    base = fitted(machine_of(GANTRY), measured(GANTRY, columns, effects, 0.004, random))
    evidence = Evidence.of(base)
    (best,) = sharpened(evidence, select(evidence))
    assert best.effect.name == "periodic_drive_error"
    assert best.searched["P"] == pytest.approx(47.3, rel=1e-4)


@pytest.mark.thorough
def test_two_waves_of_one_screw_are_effects_of_its_drive_and_no_forms() -> None:
    random = np.random.default_rng(5)
    columns = commands(GANTRY, random)
    waves = [
        0.2 * np.sin(2 * np.pi * columns["X [mm]"] / 47.3),
        0.1 * np.cos(2 * np.pi * columns["X [mm]"] / 31.7),
    ]
    base = fitted(
        machine_of(GANTRY), measured(GANTRY, columns, {"X.reading": lambda c: sum(waves)}, 0.004, random)
    )
    chosen = selected(base)
    assert {c.key for c in chosen} == {("periodic_drive_error", "X"), ("periodic_drive_error_2", "X")}
    assert [c.driver for c in chosen] == ["", ""]
    periods = sorted(p for c in chosen for p in c.searched.values())
    # a full fit refines them: within a twentieth of a wave over the 17 that the slide has
    assert periods == pytest.approx([31.7, 47.3], rel=0.05 / 17)


SCREW = machine_file([joint("X", "prismatic", (1, 0, 0), travel=[0.0, 800.0])], [(100, 0, 0)])
WAVES = {47.3: (20e-3, 0.0), 31.7: (0.0, 12e-3), 61.3: (8e-3 * np.cos(1), 8e-3 * np.sin(1))}
"""Periods of a screw, mm, with a and b."""


def of_a_screw(seed: int) -> dict[str, Any]:
    random = np.random.default_rng(seed)
    q = np.sort(random.uniform(0, 800, 150))
    change = sum(a * np.sin(2 * np.pi * q / p) + b * np.cos(2 * np.pi * q / p) for p, (a, b) in WAVES.items())
    reading = np.stack([100 + q + change, 0 * q, 0 * q], axis=1) + 1e-3 * random.normal(size=(len(q), 3))
    return {"X [mm]": q, **dict(zip(["x [mm]", "y [mm]", "z [mm]"], reading.T, strict=True))}


def assert_waves(found: Sequence[Mapping[str, Estimate]]) -> None:
    """Within four standard deviations, of which nine values are beyond once in 1800 times."""
    assert len(found) == len(WAVES)
    for parameters in found:
        period = min(WAVES, key=lambda p: abs(p - parameters["P"].value))
        truth = dict(zip("abP", (*WAVES[period], period), strict=True))
        for name, estimate in parameters.items():
            assert estimate.std is not None
            assert abs(estimate.value - truth[name]) < 4 * estimate.std


@pytest.mark.thorough
def test_waves_of_a_screw_are_as_they_are_and_found_again_in_the_saved_file(tmp_path: Any) -> None:
    machine, data = machine_of(SCREW), Measurements.from_frame(of_a_screw(3))
    found = diagnose(machine, data)
    assert_waves([step.parameters for step in found.steps])
    first, *further = found.to_dict()["steps"]
    assert "definition" not in first
    # the file says what, and no number: a fit searches the periods anew
    machine.save(tmp_path / "machine.toml")
    for step in found.steps:
        machine = machine.with_effect(step.effect)
    text = edited_text(tmp_path / "machine.toml", machine)
    (tmp_path / "more.toml").write_text(text)
    blocks = tomllib.loads(text)["effect"]
    assert [step["definition"] for step in further] == blocks[1:]
    again = fit(Machine.load(tmp_path / "more.toml"), data)
    of_effects = [{p: again.estimates[e.key(p)] for p in "abP"} for e in again.machine.effects]
    assert_waves(of_effects)


@pytest.mark.thorough
@pytest.mark.parametrize("hold", [{}, {"P": 47.3}])
def test_further_waves_of_a_screw_whose_first_is_in_the_file(hold: dict[str, float]) -> None:
    there = machine_file(
        SCREW["joint"], [(100, 0, 0)], effects=[{"name": "periodic_drive_error", "joint": "X", "hold": hold}]
    )
    found = diagnose(machine_of(there), Measurements.from_frame(of_a_screw(3)))
    assert (found.verdict, len(found.steps), found.unexplained) == ("effects_missing", 2, ())
    first = {p: found.estimates[f"X.periodic_drive_error.{p}"] for p in ("a", "b", *("P" * (not hold)))}
    if hold:
        first["P"] = replace(found.steps[0].parameters["P"], value=47.3)
    assert_waves([first, *(step.parameters for step in found.steps)])


@pytest.mark.thorough
def test_further_waves_stay_without_a_form_that_predicts_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = of_a_screw(3)
    columns["y [mm]"] = columns["y [mm]"] + 0.02 * np.exp(-(((columns["X [mm]"] - 200) / 60) ** 2))
    idle = list[str]()

    def idle_forms(chosen: Sequence[Candidate], fits: Sequence[Fit]) -> list[Candidate]:
        forms = [c for c in chosen if c.driver]
        idle.extend(c.effect.name for c in forms)
        return forms

    monkeypatch.setattr("rodgen.calibration.diagnose._idle_forms", idle_forms)
    found = diagnose(machine_of(SCREW), Measurements.from_frame(columns))
    assert idle
    names = [step.effect.name for step in found.steps]
    assert {"periodic_drive_error", "periodic_drive_error_2", "periodic_drive_error_3"} <= {*names}


# the block -------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_coefficients_in_their_units() -> None:
    """A percent is a hundredth inside, a pressure far from zero is counted from its middle."""
    forms, _, _, columns, effects, _ = told("humidity", 2, 3.0)
    machine = machine_of(KINDS["humidity"].file).with_effect(forms[0].effect)
    estimate = fitted(machine, columns).estimates[forms[0].names[0]]
    assert (text_of(forms[0]), estimate.unit) == ("a*humidity", "mm")
    assert estimate.value == pytest.approx(100 * effects["Y.tx"]({"humidity": 1.0}), rel=0.05)
    random = np.random.default_rng(12)
    columns = commands(TABLE, random)
    columns = measured(TABLE, columns, {"C.tz": lambda c: 2e-3 * c["pressure"]}, 0.003, random)
    (form,) = forms_of(fitted(machine_of(TABLE), columns))
    better = fitted(machine_of(TABLE).with_effect(form.effect), columns)
    assert better.estimates[form.names[0]].unit == "mm/hPa"
    assert text_of(form).startswith("a*(pressure - ")
    assert better.estimates[form.names[0]].value == pytest.approx(2e-3, rel=0.05)


@pytest.mark.thorough
def test_names_of_forms_differ() -> None:
    _, _, base, *_ = told("humidity", 2, 3.0)
    evidence = Evidence.of(base)
    proposed = propose(evidence, [])
    again = propose(evidence.including(proposed[:1]), [])
    assert len({c.key for c in proposed}) == len(proposed)
    assert not {c.key for c in again} & {proposed[0].key}


# terms -----------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_every_term_is_what_its_formula_says() -> None:
    random = np.random.default_rng(11)
    base = fitted(machine_of(GANTRY), measured(GANTRY, commands(GANTRY, random, 60), {}, 0.004, random))
    o = base.observations
    drivers = drivers_of(o)
    every = terms(drivers)
    for number in random.choice(len(every), 60, replace=False):
        term = every[number]
        own = {drivers[f.driver].joint for f in term.factors if drivers[f.driver].kind != "joint"} - {None}
        place = own.pop() if own else None
        effect = effect_of(term, (place, "tx"), drivers, o)
        words: dict[str, Any] = {"pi": np.pi, "t": o.t, "F": o.load, **o.covariates}
        words |= {joint.name: o.q[:, j] for j, joint in enumerate(o.machine.joints)}
        if place is not None:
            j = o.machine.number_of(place)
            words |= {"q": o.q[:, j], "s": o.s[:, j], "v": o.v[:, j], "T": o.temperature.get(place)}
        linear = [name for name in effect.definition.parameters if name not in effect.hold]
        size = dict(zip(linear, random.normal(size=len(linear)), strict=True))
        value = effect.definition.formula.evaluate({**words, **size, **effect.hold}, ARRAY_FUNCTIONS, float)
        expected = term.functions(drivers) @ np.array([size[name] for name in linear])
        np.testing.assert_allclose(value, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_searched_values_have_few_digits() -> None:
    random = np.random.default_rng(11)
    base = fitted(machine_of(GANTRY), measured(GANTRY, commands(GANTRY, random, 60), {}, 0.004, random))
    drivers = drivers_of(base.observations)
    x = next(i for i, driver in enumerate(drivers) if driver.name == "X")
    term = Term((Factor(x, "bump", 1, (312.345, 61.234)),))
    assert term.rounded(2, drivers).searched == (310.0, 61.0)
    assert term.follows(drivers) == "X"


@pytest.mark.thorough
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
    forms, _, base, columns, _, noise = told(name, 2, 3.0)
    bare = machine_of(KINDS[name].file)
    bare.save(tmp_path / "machine.toml")
    text = (tmp_path / "machine.toml").read_text()
    for form in forms:
        text += "\n" + effect_text(bare, form.effect)
    (tmp_path / "more.toml").write_text(text)
    machine = Machine.load(tmp_path / "more.toml")
    assert len(machine.effects) == len(bare.effects) + len(forms)
    better = fitted(machine, columns)
    assert better.rms * better.unit_factor < 1.15 * noise
    assert base.rms * base.unit_factor > 2.5 * noise
    if len(forms) == 1:
        source = tmp_path / "machine.toml"
        source.write_bytes(edited_text(source, Machine.load(source).with_effect(forms[0].effect)).encode())
        assert Machine.load(source) == machine
