"""Parameters that are tied to others, against the plain simulator and against fits without ties."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from machine_cases import Case, data_for, effect, joint, machine_file, toml

from rodgen.calibration.fit import fit
from rodgen.calibration.steps import odds_of_steps
from rodgen.data.measurements import Measurements
from rodgen.machines.emit._scope import scope_of
from rodgen.machines.files.edit import edited_text
from rodgen.machines.files.read import machine_of
from rodgen.machines.machine import Machine

pytestmark = pytest.mark.xdist_group("tied")
JOINTS = [
    joint("B", "revolute", [0, 0, 1]),
    joint("A", "revolute", [0.1, 1, 0], [100, 0, 200]),
    joint("Z", "prismatic", [0, 0.1, 1], travel=[-100.0, 300.0]),
]
EFFECTS = [effect("encoder_eccentricity", "B"), effect("encoder_eccentricity", "A"), effect("scale", "Z")]
TIES = {
    "A.encoder_eccentricity.a": "2*B.encoder_eccentricity.a - B.encoder_eccentricity.b/4",
    "A.encoder_eccentricity.b": "-B.encoder_eccentricity.b + 0.001 rad",
}
ROWS = 60
TRUE = {"B.encoder_eccentricity.a": 4e-3, "B.encoder_eccentricity.b": -2e-3, "Z.scale.k": 5e-4}
FOLLOW = {"A.encoder_eccentricity.a": 8e-3 + 0.5e-3, "A.encoder_eccentricity.b": 2e-3 + 1e-3}


@pytest.fixture(autouse=True)
def on_numpy(monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")


def case(ties: dict[str, str] | None = None, **more: Any) -> Case:
    """Return a machine with ties, and data of an instrument that reads 0.01 mm wrong."""
    file = machine_file(JOINTS, [(300, 40, 250)], effects=EFFECTS, **more)
    if ties is not None:
        file["ties"] = ties
    rng = np.random.default_rng(5)
    made = Case(file, data_for(file, ROWS, rng))
    plain = Case({name: part for name, part in file.items() if name != "ties"}, made.data)
    reading = plain.simulated(TRUE | FOLLOW) + 0.01 * rng.normal(size=(ROWS, 3))
    return made.changed(data=made.data | {f"{x} [mm]": reading[:, i] for i, x in enumerate("xyz")})


def test_tied_parameters_are_none_of_a_fit_and_their_values_are_those_of_the_simulator():
    tied, plain = case(TIES), case()
    assert {*plain.model.keys} - {*tied.model.keys} == {*TIES}
    values = {key: 3 * x for key, x in TRUE.items()}
    follow = {"A.encoder_eccentricity.a": 3 * 8.5e-3, "A.encoder_eccentricity.b": 6e-3 + 1e-3}
    assert np.abs(tied.predicted(values) - plain.simulated(values | follow)).max() < 1e-10


def test_columns_of_the_others_have_those_of_the_tied_in_them():
    tied, plain = case(TIES), case()
    theta, whole = tied.theta(TRUE), plain.theta(TRUE | FOLLOW)
    _, normal, gradient = tied.problem.normal_equations(theta, tied.frame())
    _, full, slope = plain.problem.normal_equations(whole, plain.frame())
    keys, every = list(tied.model.keys), list(plain.model.keys)
    by = np.zeros((len(every), len(keys)))
    for key in keys:
        by[every.index(key), keys.index(key)] = 1
    a, b = (keys.index(f"B.encoder_eccentricity.{x}") for x in "ab")
    by[every.index("A.encoder_eccentricity.a"), [a, b]] = 2, -0.25
    by[every.index("A.encoder_eccentricity.b"), b] = -1
    assert normal == pytest.approx(by.T @ full @ by, rel=1e-12, abs=1e-9 * np.abs(full).max())
    assert gradient == pytest.approx(by.T @ slope, rel=1e-9, abs=1e-9 * np.abs(slope).max())


def test_fit_finds_the_free_ones_and_states_both_with_their_deviations():
    made = case(TIES)
    found = fit(made.machine, made.observations)
    free = fit(case().machine, case().observations)
    assert len(found.free) == 3
    assert found.degrees_of_freedom == free.degrees_of_freedom + 2
    estimates, arcsec = found.estimates, np.pi / 648000
    for key, true in (TRUE | FOLLOW).items():
        unit = 1.0 if "scale" in key else arcsec
        assert abs(estimates[key].value * unit - true) < 4 * estimates[key].std * unit, key
    C, index = found.covariance, [p.key for p in found.parameters]
    a, b = (index.index(f"B.encoder_eccentricity.{x}") for x in "ab")
    variance = 4 * C[a, a] + C[b, b] / 16 - C[a, b]
    assert estimates["A.encoder_eccentricity.a"].std * arcsec == pytest.approx(np.sqrt(variance), rel=1e-12)
    b_std = estimates["B.encoder_eccentricity.b"].std
    assert estimates["A.encoder_eccentricity.b"].std == pytest.approx(b_std, rel=1e-12)
    assert b_std < free.estimates["B.encoder_eccentricity.b"].std  # both encoders tell of it
    line = next(
        line for line in str(found.summary()).splitlines() if line.startswith("A.encoder_eccentricity.b")
    )
    assert line.endswith("arcsec  = -B.encoder_eccentricity.b + 0.001 rad")
    assert (
        found.to_dict()["parameters"]["A.encoder_eccentricity.b"]["tied_to"]
        == TIES["A.encoder_eccentricity.b"]
    )


def test_effects_are_weighed_by_the_parameters_that_they_have():
    made = case(TIES)
    found = fit(made.machine, made.observations)
    nothing = replace(made.machine, effects=(), ties={})
    first, second, _ = odds_of_steps(fit(nothing, made.observations), found, made.machine.effects[:3])
    assert first.needed
    assert second is None  # A's has nothing of its own


def test_what_is_not_determined_is_named_with_what_is_tied_to_it():
    slides = [joint(name, "prismatic", axis) for name, axis in zip("XY", np.eye(3), strict=False)]
    file = machine_file(
        slides, frame="free", effects=[effect("zero_offset", "X"), effect("zero_offset", "Y")]
    )
    file["ties"] = {"Y.zero_offset.a": "2*X.zero_offset.a"}
    made = Case(file, data_for(file, 20, np.random.default_rng(1)))
    reading = {f"{x} [mm]": made.simulated()[:, i] for i, x in enumerate("xyz")}
    found = fit(made.machine, Measurements.from_frame(made.data | reading))
    texts = " ".join(direction.text for direction in found.determinacy.directions)
    assert "X.zero_offset.a (with Y.zero_offset.a, tied to it)" in texts
    assert found.estimates["Y.zero_offset.a"].convention or not found.estimates["Y.zero_offset.a"].determined


def test_fitted_machine_holds_what_was_tied_wherever_it_goes(tmp_path):
    made = case(TIES)
    found = fit(made.machine, made.observations)
    found.machine.save(tmp_path / "fitted.toml", fixed=True)
    again = Machine.load(tmp_path / "fitted.toml")
    assert not again.ties
    held = again.effects[1].hold
    assert held["a"] == pytest.approx(found.machine.values["A.encoder_eccentricity.a"], rel=1e-15)
    scope = scope_of(found.machine)
    assert scope.model.start()[scope.model.keys["A.encoder_eccentricity.b"]] == pytest.approx(
        1e-3 - found.machine.values["B.encoder_eccentricity.b"], rel=1e-12
    )
    found.machine.save(tmp_path / "model.toml")  # the model, without its values
    model = Machine.load(tmp_path / "model.toml")
    assert model.ties == made.machine.ties
    assert fit(model, made.observations).rms == pytest.approx(found.rms, rel=1e-12)


def test_tie_in_python_is_that_of_the_file_and_may_be_written_with_tables(refuses):
    made, plain = case(TIES).machine, case().machine
    built = plain
    for key, text in TIES.items():
        built = built.tying(key, text)
    assert built.ties == made.ties
    text = toml(case().file) + '\n[ties]\nA.encoder_eccentricity = { a = "2 * B.encoder_eccentricity.a" }\n'
    assert [*machine_of(text, "machine.toml").ties] == ["A.encoder_eccentricity.a"]
    assert not made.without_effect("encoder_eccentricity", "A").ties
    refuses(made.knowing, "A.encoder_eccentricity", prior="0 ± 3 arcsec")


A, B = "A.encoder_eccentricity.a", "B.encoder_eccentricity.a"


def test_an_effect_is_removed_from_a_file_with_what_the_file_says_of_its_parameters(refuses, tmp_path):
    blocks = "".join(
        f'[[effect]]\njoint = "{e["joint"]}"\nname = "{e["name"]}"\n'
        for e in [effect("encoder_eccentricity", "B"), effect("encoder_eccentricity", "A")]
    )
    ties = f'[ties]\n# one type of encoder\n"{A}" = "2*{B}"\n\n'
    known = '[known]\n"A.encoder_eccentricity.b" = { bounds = ["-1 rad", "1 rad"] }\n'
    known += '"B.encoder_eccentricity" = { prior = "0 ± 1 rad" }\n'
    path = tmp_path / "machine.toml"
    path.write_text(f"{toml(machine_file(JOINTS))}\n{known}{ties}{blocks}")
    text = edited_text(path, Machine.load(path).without_effect("encoder_eccentricity", "A"))
    found = machine_of(text, "machine.toml")
    assert [effect.place for effect in found.effects] == ["B"]
    assert (found.ties, [*found.known]) == ({}, ["B.encoder_eccentricity"])
    assert "# one type of encoder" in text
    refuses(edited_text, path, Machine.load(path).without_effect("encoder_eccentricity", "B"))


@pytest.mark.parametrize(
    'ties',
    [
        {"A.encoder_eccentricty.a": B},
        {A: "2 * B.encoder_eccentricty.a"},
        {A: f"{B} * {B}"},
        {A: f"{B} + 3"},
        {A: "3 * Z.scale.k"},
        {A: "3 arcsec"},
        {A: A},
        {B: "B.encoder_eccentricity.b", A: B},
        {A: B, B: "B.encoder_eccentricity.b"},
        {A: f"2 {B}"},
    ],
)  # fmt: skip
def test_what_is_no_tie_is_one_sentence(refuses, ties):
    refuses(machine_of, toml(case().file | {"ties": ties}), "machine.toml")


@pytest.mark.parametrize(
    "text", ["[ties]\nA = 3\n", f'[ties]\n"{A}" = "{B}"\n[known]\nA = {{ prior = "0 ± 1 arcsec" }}\n']
)
def test_what_a_file_cannot_say_of_ties_is_one_sentence(refuses, text):
    refuses(machine_of, toml(case().file) + "\n" + text, "machine.toml")


def test_a_held_parameter_is_not_tied_but_others_may_be_tied_to_it(refuses):
    file = dict(case().file)
    file["effect"] = [EFFECTS[0] | {"hold": {"a": 1e-3}}, *EFFECTS[1:]]
    refuses(machine_of, toml(file | {"ties": {B: A}}), "machine.toml")
    machine = machine_of(toml(file | {"ties": {A: f"3*{B}"}}), "machine.toml")
    found = fit(machine, Measurements.from_frame(case().data))
    assert found.machine.values[A] == pytest.approx(3e-3, rel=1e-12)
    assert found.estimates[A].held
