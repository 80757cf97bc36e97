"""Parallel machines: their models against the plain simulator, their files, their fits, and their emitted code.

The simulator closes the loops and balances the forces itself; it shares no code with rodgen. Places are some 1000 mm
away, where a double has steps of 1e-13 mm; a leg's error of rounding grows by the mechanism's amplification, which is
below 10 in these poses: `WITHIN` is a hundred such roundings. `leg_compliance` needs the forces in a pose that is not
known before; one step of Newton's leaves the square of the way to it, (0.2 mm / 200 mm)², of what the load does.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emitted_code import (
    Compiled,
    emit_both,
    loaded,
    passes_in_c,
    passes_in_cpp,
    passes_in_octave,
    passes_in_python,
)
from legged_cases import GEOMETRY, LEGS, TARGETS, Legged, every, legged, legged_file
from machine_cases import effect, frame, toml
from machine_simulator import rotation
from parallel_simulator import Parallel
from scipy import stats
from test_machine_jacobians import columns_off, near

from rodgen.calibration.fit import fit
from rodgen.calibration.problem.binding import bind
from rodgen.cli import main as cli
from rodgen.data.measurements import Measurements
from rodgen.data.units import unit_factor
from rodgen.errors import InputFileError
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.emit._content import content_of
from rodgen.machines.fixed import fixed_machine
from rodgen.machines.machine import Machine

FAMILIES = list(LEGS)
KINDS = ["point", "direction", "distance"]
WITHIN = {"point": 1e-10, "distance": 1e-10, "direction": 1e-12}
GIVES_WAY = 1e-6
QUICK = [("tricept", "point"), ("3-sps-s", "point")]
both = pytest.mark.parametrize("family", FAMILIES)
quickly_tricept = pytest.mark.parametrize(
    "family", [f if f == "tricept" else pytest.param(f, marks=pytest.mark.slow) for f in FAMILIES]
)
all_kinds = pytest.mark.parametrize(
    ("family", "kind"),
    [
        pytest.param(family, kind, marks=[] if (family, kind) in QUICK else pytest.mark.slow)
        for family in FAMILIES
        for kind in KINDS
    ],
)


def off(case: Legged, values: Mapping[str, float]) -> float:
    found = case.predicted(values)
    assert np.isfinite(found).all()
    return float(np.abs(found - case.simulated(values)).max())


# the model -------------------------------------------------------------------------------------------------------


@both
def test_no_effect_of_a_leg_is_left_out(family):
    there = {(e["name"], e.get("joint")) for e in every(family).file["effect"]}
    assert there >= {(d.name, leg) for d in CATALOGUE if "leg" in d.at for leg in LEGS[family]}
    assert len({d.name for d in CATALOGUE if "leg" in d.at}) == 7


@pytest.mark.thorough("3-sps-s-point")
@all_kinds
def test_each_effect_moves_the_readings_as_in_the_simulator(family, kind):
    case = every(family, kind)
    for where in ({}, frame(kind)):
        start = case.predicted(where)
        assert off(case, where) <= WITHIN[kind]
        for block in case.file["effect"]:
            values = case.sizeable(case.keys_of(block)) | where
            assert off(case, values) <= WITHIN[kind], block
            assert np.abs(case.predicted(values) - start).max() > 1e3 * WITHIN[kind], block


@all_kinds
def test_all_effects_at_once_and_a_wrong_geometry_agree_with_the_simulator(family, kind):
    case = every(family, kind)
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    for factor, where in ((1.0, {}), (10.0, frame(kind))):
        values = case.sizeable(keys, factor) | where
        stiff = {key: x for key, x in values.items() if "compliance" not in key}
        assert off(case, stiff) <= 10 * WITHIN[kind]
        reserve = (factor**3 * GIVES_WAY if kind != "direction" else 0.0) + 10 * WITHIN[kind]
        assert off(case, values) <= reserve


@both
def test_the_unit_of_length_makes_no_difference(family):
    case = every(family)
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    values = case.sizeable(keys)
    g = case.file["geometry"]
    small = {key: x if key == "start" else (np.array(x) / 1000).tolist() for key, x in g.items()}
    file = case.file | {
        "units": {"length": "m", "angle": "rad"},
        "geometry": small,
        "target": [t | {"point": [x / 1000 for x in t["point"]]} for t in case.file["target"]],
    }
    in_metres = case.changed(file=file)
    assert in_metres.model.structure == case.model.structure
    units = {key: case.model.parameters[number].unit for key, number in case.model.keys.items()}
    factor = {key: unit_factor(units[key], "m")[0] / unit_factor(units[key], "mm")[0] for key in values}
    moved = 1000 * in_metres.predicted({key: x * factor[key] for key, x in values.items()})
    assert np.abs(moved - case.predicted(values)).max() <= WITHIN["point"]


@pytest.mark.thorough
@all_kinds
def test_each_column_is_the_derivative_of_the_simulator(family, kind):
    case = every(family, kind)
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    values = case.sizeable(keys) | frame(kind)
    values |= {key: 0.0 for key in keys if "compliance" in key}
    rows: Any = slice(None)
    if kind == "direction":
        case = case.changed(data=case.data | near(case, values))
        unlifted = values | dict.fromkeys((*frame(kind), "refraction.a", "tube_flexure.a"), 0.0)
        rows = np.abs(case.simulated(unlifted) @ case.machine.gravity) > 0.1
    off = columns_off(case, values, case.model.keys, rows, within=1e-8)
    # forces in a pose that is known to the square of the way to it
    assert {key: part for key, part in off.items() if "compliance" not in key or part > 1e-4} == {}


@both
def test_many_rows_give_what_each_gives_alone(family):
    case = every(family)
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    values = case.sizeable(keys)
    whole = case.problem.residuals(case.theta(values), case.frame(values))
    for row in range(len(whole)):
        which = np.arange(len(whole)) == row
        # its observations: the poses start where all did, which follow as soon as one row needs it
        alone = type(case.problem)(case.model, case.problem.observations.take(which))
        # blocks of rows are evaluated together, and may be summed in another order
        assert alone.residuals(case.theta(values), case.frame(values))[0] == pytest.approx(
            whole[row], abs=1e-11
        )


@pytest.mark.parametrize("cpu", ["numpy", "c"])
@both
def test_far_legs_that_do_not_close_are_no_number(family, cpu, monkeypatch, compiler):
    monkeypatch.setenv("RODGEN_CPU", "numpy" if cpu == "numpy" else "")
    leg = LEGS[family][0]
    file = legged_file(family, effects=[effect("leg_zero_offset", leg)])
    case = legged(file, 6, np.random.default_rng(1))
    values = {f"{leg}.leg_zero_offset.a": 5000.0}
    assert np.isnan(case.predicted(values)).all()


# assembly modes --------------------------------------------------------------------------------------------------


@both
def test_the_platform_is_the_target_where_none_is_given(family):
    case = legged(legged_file(family, None), 8, np.random.default_rng(2))
    assert [target.name for target in case.machine.targets] == ["platform"]
    assert case.predicted() == pytest.approx(case.simulated(), abs=1e-10)


MODES: dict[tuple[float, ...], np.ndarray] = {}
"""The assembly modes of the 3-SPS-S by the lengths of its legs; tests have the same ones."""


def modes_of(case: Legged, row: int) -> np.ndarray:
    legs = tuple(case.arguments["q"][row].tolist())
    if legs not in MODES:
        MODES[legs] = Parallel(case.file).modes(case.arguments["q"][row], np.random.default_rng(3))
    return MODES[legs]


@pytest.mark.thorough("distance")
@pytest.mark.parametrize("kind", KINDS)
def test_the_assembly_mode_is_the_one_nearest_the_readings(kind):
    """Rows are brought into one mode each; the readings determine it among all others."""
    geometry = {key: x for key, x in GEOMETRY["3-sps-s"].items() if key != "start"}
    case = legged(legged_file("3-sps-s", kind=kind, geometry=geometry), 8, np.random.default_rng(5))
    h = np.array([0, 0, geometry["h"]])
    targets = np.array([np.array(t["point"]) for t in case.file["target"]])
    readings, turns, spare = [], [], 0
    for row in range(8):
        modes = modes_of(case, row)
        spare += len(modes) - 1
        turn = modes[row % len(modes)]
        p = targets[["p", "r"].index(case.data["target"][row])]
        x = turn @ p / np.linalg.norm(p) if kind == "direction" else turn @ p + h
        readings.append(np.linalg.norm(x - [300, -200, 1500]) if kind == "distance" else x)
        turns.append(turn)
    assert spare >= 8
    names = {"point": ["x [mm]", "y [mm]", "z [mm]"], "direction": ["ux", "uy", "uz"], "distance": ["d [mm]"]}
    columns = np.array(readings).reshape(8, -1).T
    told = case.changed(data=case.data | dict(zip(names[kind], columns, strict=True)))
    assert np.abs(told.predicted() - np.array(readings).reshape(8, -1)).max() < 1e-9


def test_the_assembly_mode_is_the_one_nearest_a_given_start():
    case = legged(legged_file("3-sps-s"), 8, np.random.default_rng(5))
    h = np.array([0, 0, GEOMETRY["3-sps-s"]["h"]])
    targets = [np.array(t["point"]) for t in case.file["target"]]
    for start in ([0.0, 0.0, 0.73], [0.0, 0.0, -0.9], [0.0, 2.5, 0.0]):
        file = case.file | {"geometry": GEOMETRY["3-sps-s"] | {"start": start}}
        found = case.changed(file=file).predicted()
        for row in range(8):
            modes = modes_of(case, row)
            nearest = modes[np.argmax(np.einsum("nij,ij->n", modes, rotation(np.array(start))))]
            p = targets[["p", "r"].index(case.data["target"][row])]
            assert found[row] == pytest.approx(nearest @ p + h, abs=1e-9)


def test_a_tricept_is_in_the_one_pose_that_is_not_folded():
    case = legged(legged_file("tricept"), 50, np.random.default_rng(6))
    assert np.abs(case.predicted() - case.simulated()).max() < 1e-10


# fits ------------------------------------------------------------------------------------------------------------

NOISE = 0.002
RNG = np.random.default_rng


@both
def test_a_fit_comes_from_afar(family):
    """The drawing's radii are off by so much that the legs just close: start poses have to go along."""
    estimate = ["R", "r", "target"] + (["h"] if family == "3-sps-s" else [])
    g = GEOMETRY[family]
    true = legged(
        legged_file(family, [*TARGETS, (-60, -80, 100)], geometry=g), 60, np.random.default_rng(16), runs=1
    )
    off = {"tricept": 0.15, "3-sps-s": 0.03}[family]
    wrong = g | {"R": (1 + off) * g["R"], "r": (1 - off) * g["r"]}
    file = legged_file(family, [*TARGETS, (-60, -80, 100)], geometry=wrong, estimate=estimate)
    case = true.changed(file=file)
    found = fit(case.machine, case.observations)
    assert found.solution.converged
    assert found.rms < 1e-9
    assert abs(found.estimates["geometry.R"].value + wrong["R"] - g["R"]) < 1e-6


@pytest.mark.thorough
def test_legs_in_each_other_s_columns_are_not_called_a_fit():
    file = legged_file("3-sps-s", estimate=["R", "r", "h", "target"], noise=NOISE)
    case = legged(file, 60, np.random.default_rng(17), runs=1)
    a, b, _ = (f"{leg} [mm]" for leg in LEGS["3-sps-s"])
    found = fit(case.machine, case.changed(data=case.data | {a: case.data[b], b: case.data[a]}).observations)
    assert not found.solution.converged or found.rms > 1.0


def test_the_target_and_q_of_a_tricept_are_reported_as_one_freedom():
    case = legged(legged_file("tricept", estimate=["geometry", "target"]), 60, np.random.default_rng(9))
    found = fit(case.machine, case.observations)
    loose = {p.key for i, p in enumerate(found.parameters) if found.determinacy.undetermined[i]}
    assert {"geometry.q.x", "target.p.x"} <= loose
    assert not {"geometry.R", "geometry.r"} & loose


LEG_EFFECTS = {
    "leg_zero_offset": "a",
    "leg_scale": "k",
    "leg_thermal_expansion": ("alpha",),
    "leg_backlash": "b",
    "leg_compliance": "c",
    "base_joint_offset": "xyz",
    "platform_joint_offset": "xyz",
}


@cache
def crowded(family: str) -> tuple[dict[str, Any], Legged]:
    """Return a machine with all effects of its legs, which share one kernel, and data."""
    file = legged_file(family, [*TARGETS, (-60, -80, 100)], frame="free", estimate=["R", "r"], noise=NOISE)
    file["effect"] = [effect(name, leg) for name in LEG_EFFECTS for leg in LEGS[family]]
    return file, legged(file, 90, np.random.default_rng(11), runs=1)


@pytest.mark.parametrize("draws", [1, pytest.param(8, marks=pytest.mark.slow)])
@both
def test_intervals_of_each_leg_s_parameters_hold_the_truth(family, draws):
    random = np.random.default_rng(10)
    inside, chances = [], []
    for number, (name, parameters) in enumerate(LEG_EFFECTS.items()):
        leg = LEGS[family][number % 3]
        file, case = crowded(family)
        blocks = [
            block
            if (block["name"], block["joint"]) == (name, leg)
            else block | {"hold": dict.fromkeys(LEG_EFFECTS[block["name"]], 0.0)}
            for block in file["effect"]
        ]
        one = case.changed(file=file | {"effect": blocks})
        one.observations = replace(case.observations, machine=one.machine)  # the same rows, in the same poses
        sizes = one.sizeable([f"{leg}.{name}.{x}" for x in parameters])
        true = one.simulated(sizes | frame("point"))
        for _ in range(draws):
            reading = true + NOISE * random.normal(size=true.shape)
            found = fit(one.machine, replace(one.observations, reading=reading), compiled=True)
            assert found.solution.converged
            at = [i for i, p in enumerate(found.parameters) if p.key in sizes]
            assert len(at) == len(parameters)
            covariance = found.covariance[np.ix_(at, at)]
            error = np.array([found.values[i] - sizes[found.parameters[i].key] for i in at])
            inside += list(np.abs(error) < stats.norm.ppf(0.975) * np.sqrt(np.diag(covariance)))
            chances.append(stats.chi2.sf(error @ np.linalg.solve(covariance, error), len(at)))
    low, high = stats.binom.ppf([5e-5, 1 - 5e-5], len(inside), 0.95) / len(inside)
    assert low <= np.mean(inside) <= high
    assert stats.kstest(chances, "uniform").pvalue > 1e-4


@pytest.mark.thorough
@pytest.mark.quick("3-sps-s")
@both
def test_the_covariance_of_a_predicted_place_is_that_of_the_places_that_fits_predict(family):
    """U_y from the fit's covariance, at poses beyond the measured ones, against many fits to other noise."""
    estimate = ["R", "r", "target"] + (["h"] if family == "3-sps-s" else [])
    case = legged(
        legged_file(family, [*TARGETS, (-60, -80, 100)], estimate=estimate, noise=NOISE), 60, RNG(18), runs=1
    )
    far = legged(legged_file(family, [*TARGETS, (-60, -80, 100)]), 6, RNG(19), runs=1)
    truth = {"geometry.R": 0.3, "geometry.r": -0.2, "target.p.x": 0.1}
    true, there = case.simulated(truth), far.simulated(truth)
    random, errors = RNG(20), []
    for _ in range(60):
        reading = true + NOISE * random.normal(size=true.shape)
        made = fit(case.machine, replace(case.observations, reading=reading), compiled=True).predict(
            Measurements.from_frame(far.data)
        )
        assert made.determined.all()
        errors.append(made.place - there)
    error = np.array(errors)
    squares = np.einsum("kni,nij,knj->kn", error, np.linalg.inv(made.covariance), error)
    # the mean of 60 chi-squares of 3 degrees of freedom: 3, give or take 0.32; of 6 places the worst, 4 of these
    assert np.abs(squares.mean(axis=0) - 3).max() < 4 * np.sqrt(6 / 60)
    assert stats.kstest(squares[:, 0], stats.chi2(3).cdf).pvalue > 1e-4


# files -----------------------------------------------------------------------------------------------------------

FAULTS: dict[str, tuple[str, str]] = {
    "a family that is none": ('family = "tricept"', 'family = "heptapod"'),
    "joints with a family": ("[measured]", '[[joint]]\nname = "X"\naxis = [1, 0, 0]\n[measured]'),
    "no geometry": ("[geometry]\nR = 330\nr = 140\nq = [0, 0, 120]", ""),
    "no R": ("R = 330\n", ""),
    "a radius of 0": ("R = 330", "R = 0"),
    "a negative radius": ("r = 140", "r = -140"),
    "a radius that is not a number": ("R = 330", "R = nan"),
    "a radius that is text": ("R = 330", 'R = "330"'),
    "h of a Tricept": ("R = 330", "R = 330\nh = 3"),
    "a start of a Tricept": ("R = 330", "R = 330\nstart = [0, 0, 1]"),
    "q of two numbers": ("q = [0, 0, 120]", "q = [0, 0]"),
    "an estimate of a joint": ('["R", "r"]', '["A0.axis"]'),
    "an estimate of another family's number": ('["R", "r"]', '["h"]'),
    "an estimate twice": ('["R", "r"]', '["R", "R"]'),
    "an estimate that is in geometry": ('["R", "r"]', '["geometry", "R"]'),
    "an effect of chains": ("[measured]", '[[effect]]\nname = "scale"\njoint = "A0"\n[measured]'),
    "another family's leg": ("[measured]", '[[effect]]\nname = "leg_scale"\njoint = "L1"\n[measured]'),
    "an effect of a leg at no leg": ("[measured]", '[[effect]]\nname = "leg_scale"\n[measured]'),
    "an error motion of a leg": (
        "[measured]",
        '[[effect]]\nname = "mine"\njoint = "A0"\ncomponent = "tx"\nformula = "a*q"\nparameters = { a = "1" }\n'
        'meaning = "m"\n[measured]',
    ),
    "a target that is called like a leg": ('name = "p"', 'name = "A-1"'),
}  # fmt: skip
PLAIN = """\
name = "T"
family = "tricept"
[units]
length = "mm"
angle = "deg"
[geometry]
R = 330
r = 140
q = [0, 0, 120]
[[target]]
name = "p"
point = [0, 0, 0]
[measured]
kind = "point"
frame = "machine"
[estimate]
parameters = ["R", "r"]
"""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_file_is_one_clear_line(refuses, fault, tmp_path):
    old, new = FAULTS[fault]
    assert old in PLAIN
    (tmp_path / "machine.toml").write_text(PLAIN.replace(old, new))
    refuses(Machine.load, tmp_path / "machine.toml")


def test_files_of_the_families_come_back_as_they_were(tmp_path):
    for family in FAMILIES:
        path = tmp_path / "machine.toml"
        path.write_text(
            toml(legged_file(family, estimate=["geometry"], effects=[effect("leg_scale", LEGS[family][2])]))
        )
        machine = Machine.load(path)
        machine.save(tmp_path / "again.toml")
        assert replace(Machine.load(tmp_path / "again.toml"), file=None) == replace(machine, file=None)


def test_a_fitted_machine_is_written_with_the_geometry_that_was_found(tmp_path):
    file = legged_file("tricept", [*TARGETS, (-60, -80, 100)], estimate=["R", "r", "target"], noise=NOISE)
    case = legged(file, 60, np.random.default_rng(12))
    told = case.measured({"geometry.R": 0.8, "geometry.r": -0.5})
    found = fit(told.machine, told.observations)
    again = fixed_machine(found.machine)
    assert again.estimate == ()
    assert abs(again.kinematics.R - 330.8) < 1e-6
    assert fit(again, told.observations.data).rms < 1e-6


# data ------------------------------------------------------------------------------------------------------------


def refused(case: Legged, **columns: Any) -> str:
    data = {k: x for k, x in (case.data | columns).items() if x is not None}
    with pytest.raises(InputFileError) as caught:
        bind(case.machine, Measurements.from_frame(data))
    return str(caught.value)


@both
def test_error_for_legs_that_do_not_close_names_the_row(family):
    case = legged(legged_file(family), 6, np.random.default_rng(13))
    leg = LEGS[family][1]
    wrong = case.data[f"{leg} [mm]"].copy()
    wrong[3] *= 4
    said = refused(case, **{f"{leg} [mm]": wrong})
    assert "close" in said
    assert "3" in said
    assert "\n" not in said


@both
def test_a_leg_that_is_missing_is_an_error(family):
    case = legged(legged_file(family), 6, np.random.default_rng(13))
    leg = LEGS[family][2]
    assert leg in refused(case, **{f"{leg} [mm]": None})


def test_lengths_in_another_unit_are_the_same(tmp_path):
    case = legged(legged_file("tricept"), 6, np.random.default_rng(13))
    metres = {name.replace("mm", "m"): x / 1000 for name, x in case.data.items() if name.endswith("[mm]")}
    others = {name: x for name, x in case.data.items() if not name.endswith("[mm]")}
    assert case.changed(data=case.data).predicted() == pytest.approx(
        Legged(case.file, case.data, case.brought).predicted()
    )
    o = bind(case.machine, Measurements.from_frame(others | metres))
    assert o.q == pytest.approx(case.observations.q, rel=1e-12)


# the singular home pose ----------------------------------------------------------------------------------------------


def test_a_platform_at_home_is_reported_as_singular():
    """At home the legs do not change with a pure torsion: no leg shows it, and no fit should claim to."""
    file = legged_file("3-sps-s", geometry=GEOMETRY["3-sps-s"] | {"start": [0.0, 0.0, 0.0]})
    case = legged(file, 4, np.random.default_rng(14))
    home = Parallel(file).legs(np.zeros((4, 3)))
    legs = {f"{leg} [mm]": home[:, k] for k, leg in enumerate(LEGS["3-sps-s"])}
    assert "singular" in refused(case, **legs)


# emitted code --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def device(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[str], tuple[Legged, dict[str, float], Path]]:
    """The machine of a family, its parameters, and the folder of its code, emitted when first asked for."""

    @cache
    def made(family: str) -> tuple[Legged, dict[str, float], Path]:
        a, b, c = LEGS[family]
        file = legged_file(family, estimate=["R", "r", "target"])
        file["effect"] = [
            effect("leg_zero_offset", a),
            effect("leg_thermal_expansion", b),
            effect("leg_compliance", c),
            effect("leg_backlash", a),
            effect("base_joint_offset", b),
            effect("platform_joint_offset", c),
            effect("linear_drift"),
        ]
        case = legged(file, 30, np.random.default_rng(15), runs=1)
        values = case.sizeable(case.model.keys)
        folder = tmp_path_factory.mktemp("emitted")
        machine = replace(case.machine, values=values)
        emit_both(machine, folder, case.observations.travel)
        return case, values, folder

    return made


def conditions(case: Legged, folder: Path) -> dict[str, np.ndarray]:
    o = case.observations
    header = next(folder.glob("*.h")).read_text()
    struct = re.search(r"typedef struct \{(.*?)\}", header, re.DOTALL)
    fields = re.findall(r"^  double (\w+)", struct[1], re.MULTILINE)[1:]
    known = {"s": o.s, "v": o.v, "t": o.t, "load": o.load}
    known["T"] = np.stack([o.temperature[leg] for leg in case.joints], -1)
    return {name: np.asarray(known[name], float) for name in fields}


@pytest.mark.slow
@quickly_tricept
def test_emitted_code_passes_its_own_tests_alone(family, device, compiler, cpp_compiler, tmp_path):
    case, values, folder = device(family)
    passes_in_c("device", folder, compiler, "-O2")
    content = content_of(replace(case.machine, values=values), "device", case.observations.travel)
    passes_in_cpp(content, cpp_compiler, tmp_path)
    passes_in_octave(content, tmp_path)
    passes_in_python("device_np", folder)


@pytest.mark.thorough
@quickly_tricept
def test_emitted_code_is_what_the_simulator_measures(family, device, compiler):
    case, values, folder = device(family)
    o, given = case.observations, conditions(case, folder)
    module, c = loaded(folder), Compiled(compiler, folder)
    expected = case.simulated(values)
    assert np.abs(module.forward(o.q, o.target, **given) - expected).max() <= GIVES_WAY
    assert np.abs(c.forward(o.q, o.target, given) - module.forward(o.q, o.target, **given)).max() <= 1e-10
    mounted = case.simulated({key: value for key, value in values.items() if "target" in key})
    assert np.abs(module.ideal(o.q, o.target) - mounted).max() <= 1e-10
    assert np.abs(expected - case.simulated()).max() > 0.05


@pytest.mark.thorough
@quickly_tricept
def test_compensated_commands_bring_the_simulated_machine_where_it_should_be(family, device):
    case, values, folder = device(family)
    o, module = case.observations, loaded(folder)
    wanted = case.simulated()
    corrected, status, _ = module.compensate(wanted, o.q, o.target, **conditions(case, folder))
    legs = {f"{leg} [mm]": corrected[:, k] for k, leg in enumerate(case.joints)}
    reached = case.changed(data=case.data | legs).simulated(values)
    left = reached - wanted
    if family == "3-sps-s":
        # it only turns: errors along the radius remain
        assert (status == module.NEAREST).all()
        drift = np.outer(o.t, [values[f"linear_drift.{x}"] for x in "xyz"])
        radius = reached - drift - [0, 0, GEOMETRY[family]["h"]]
        left -= (
            radius * np.sum(left * radius, axis=1, keepdims=True) / np.sum(radius**2, axis=1, keepdims=True)
        )
    else:
        assert (status == module.CONVERGED).all()
    assert np.abs(left).max() < 5e-6
    assert np.abs(case.simulated(values) - wanted).max() > 0.05


def test_the_command_line_says_what_a_leg_has(capsys):
    assert cli.main(["effects"]) == 0
    said = capsys.readouterr().out
    for definition in CATALOGUE:
        if "leg" in definition.at:
            assert definition.name in said
