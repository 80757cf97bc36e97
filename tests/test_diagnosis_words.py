"""What a diagnosis says of sizes, of odds, and of effects that the data cannot distinguish."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from diagnosis_checks import check_numbers, far_aliases, rms_of
from hidden_effects import hidden
from machine_cases import toml
from made_diagnoses import mount

import rodgen
from rodgen.calibration.decidability import on_few_poses
from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.diagnosis import Alias, DiagnosedEffect, Diagnosis, WrongGeometry
from rodgen.calibration.diagnosis_text import (
    alternatives,
    at_reach,
    far_from_usual,
    headline,
    of_effects,
    only_together,
    rungs,
)
from rodgen.calibration.fit import fit
from rodgen.calibration.fitted import Estimate
from rodgen.calibration.words import comparison
from rodgen.cli import main as cli
from rodgen.data.measurements import Measurements
from rodgen.document import Document
from rodgen.machines.files.read import machine_of
from rodgen.machines.machine import Joint, Machine, Measured, Target
from rodgen.output.report import report_page


def arm() -> Machine:
    """Return a level arm of 800 mm."""
    joint, ball = Joint("J1", "revolute", (0.0, 1.0, 0.0)), Target("ball", (800.0, 0.0, 0.0))
    return Machine(
        "Arm", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (joint,), (ball,), Measured("point", "machine")
    )


def found(machine: Machine, name: str, **estimates: tuple[float, float, str]) -> DiagnosedEffect:
    """Return an effect at the first joint with its parameters: value, standard deviation and unit."""
    parameters = {
        key: Estimate(f"J1.{name}.{key}", unit, value, std, held=False, determined=True)
        for key, (value, std, unit) in estimates.items()
    }
    return DiagnosedEffect(machine.effect(name, machine.joints[0].name), 9.0, 1.0, 1.0, parameters)


def test_a_windup_per_lever_arm_is_compared_with_usual_sizes_at_the_machine_s_reach():
    step = found(arm(), "gravity_windup", k=(0.0345, 0.0005, "arcsec/mm"), k2=(-0.0002, 0.0009, "arcsec/mm"))
    assert at_reach(step, arm()) == "At a lever arm of 800 mm, the machine's reach: k 28 arcsec."
    assert far_from_usual(step, arm()) == ""
    large = replace(arm(), targets=(Target("ball", (2110.0, 0.0, 0.0)),))
    assert at_reach(step, large) == "At a lever arm of 2110 mm, the machine's reach: k 73 arcsec."
    # nothing is per lever arm
    assert at_reach(found(arm(), "encoder_eccentricity", a=(30.0, 1.0, "arcsec")), arm()) == ""


@pytest.mark.parametrize(
    ("value", "std", "unusual"), [(150.0, 1.0, False), (900.0, 20.0, True), (900.0, 200.0, False)]
)
def test_a_size_is_called_unusual_only_where_it_is_surely_ten_times_the_usual(value, std, unusual):
    step = found(arm(), "encoder_eccentricity", a=(value, std, "arcsec"), b=(3.0, std, "arcsec"))
    said = far_from_usual(step, arm())
    assert bool(said) is unusual
    if unusual:
        assert said.startswith("a is 45 times the size that is usual.")


def with_alternatives(*aliases: Alias) -> Diagnosis:
    """Return the telescope's diagnosis with alternatives of its first effect."""
    first, *others = mount().steps
    return replace(mount(), steps=(replace(first, indistinguishable_from=aliases), *others), log10_odds=42.0)


def alias(*names: str, odds: float) -> Alias:
    return Alias(tuple(mount().base.machine.effect(name, "EL") for name in names), odds)


@pytest.mark.thorough
def test_the_verdict_names_the_alternatives_that_are_nearly_as_probable():
    found = with_alternatives(alias("scale", odds=0.4), alias("backlash", odds=0.02))
    assert headline(found) == (
        "These are missing: gravity_windup at EL (here indistinguishable from scale at EL) and refraction (TX); "
        "the error falls from 2.71 to 0.659 arcsec. The odds for that are more than a million to 1."
    )
    assert alternatives(found.steps[0]) == [
        "scale at EL, about as probable",
        "backlash at EL, 50 times less probable",
    ]
    assert "gravity_windup at EL and refraction (TX); " in headline(
        with_alternatives(alias("scale", odds=0.02))
    )
    many = [alias(name, odds=0.1) for name in ("scale", "backlash", "servo_lag")]
    assert "(here indistinguishable from 3 others)" in headline(with_alternatives(*many))


@pytest.mark.thorough
def test_text_report_and_json_have_the_same_alternatives_with_the_same_odds():
    found = with_alternatives(alias("scale", odds=0.02), alias("backlash", "servo_lag", odds=5.0))
    text, page = " ".join(found.summary().split()), report_page(found)
    for title, said in (
        ("scale at EL", "50 times less probable"),
        ("backlash at EL with servo_lag at EL", "5.0 times more probable"),
    ):
        assert f"{title}, {said}" in text
        assert f"<td>{title}, {said}</td>" in page
    assert headline(found).partition("; the error")[0] in page
    (scale, pair) = found.to_dict()["steps"][0]["indistinguishable_from"]
    assert scale == {"effects": [{"effect": "scale", "joint": "EL"}], "odds": 0.02}
    assert [e["effect"] for e in pair["effects"]] == ["backlash", "servo_lag"]


def test_of_many_alternatives_the_most_probable_are_listed_and_the_others_counted():
    names = (
        "backlash",
        "scale",
        "encoder_eccentricity",
        "encoder_ellipticity",
        "servo_lag",
        "lateral_windup",
    )
    found = with_alternatives(*(alias(name, odds=0.1 * k) for k, name in enumerate(names, 1)))
    listed = alternatives(found.steps[0])
    assert [text.split()[0] for text in listed[:4]] == list(names[:1:-1])
    assert listed[4:] == ["2 more, in --json"]


@pytest.mark.thorough
def test_dimensions_that_are_not_those_of_the_file_are_named_first():
    first, second = mount().fits[:2]
    geometry = WrongGeometry(("AZ.axis",), (), 5.0, first, 2.79)
    found = replace(
        mount(), verdict="wrong_geometry", steps=(), fits=(second,), geometry=geometry,
        rms=replace(mount().rms, after=second.rms),
    )  # fmt: skip
    said, fallen = (
        "The dimensions of the machine are not those of the file",
        "ith estimated ones the error falls from 2.71 to",
    )
    assert headline(found).startswith(f"{said}: w{fallen}")
    assert "100 000 times more probable than single effects in its place." in headline(found)
    assert [rung.title for rung in rungs(found)] == ["the file", "+ its dimensions"]
    assert f'<p class="word">{said}</p>\n<p class="say">W{fallen}' in report_page(found)
    beside = replace(
        found,
        verdict="effects_missing",
        steps=mount().steps[1:],
        fits=(second, mount().final),
        rms=mount().rms,
    )
    assert "Apart from that, this is missing: refraction (TX); the error falls from 0." in headline(beside)
    assert len(rungs(beside)) == 3
    assert "+ refraction" in report_page(beside)


def test_one_effect_at_several_places_has_its_meaning_once():
    machine = replace(arm(), joints=(*arm().joints, Joint("J2", "revolute", (0.0, 1.0, 0.0))))
    steps = [
        DiagnosedEffect(
            machine.effect("backlash", joint), 9.0, 1.0, 1.0,
            {"b": Estimate(f"{joint}.backlash.b", "arcsec", 9.0, 1.0, held=False, determined=True)},
        )
        for joint in ("J1", "J2")
    ]  # fmt: skip
    text = str(Document([of_effects(steps, machine)]))
    assert text.startswith(
        "backlash at J1 and J2\n  b at J1      9.0 ± 1.0 arcsec\n  b at J2      9.0 ± 1.0 arcsec\n"
    )
    assert text.count("Meaning") == text.count("Remedy") == 1


@pytest.mark.parametrize(
    ("odds", "words"),
    [
        (1.0, "about as probable"), (0.4, "about as probable"), (0.2, "5.0 times less probable"),
        (123.0, "120 times more probable"), (1 / 4321, "4 300 times less probable"),
        (1e7, "more than a million times more probable"), (0.0, "more than a million times less probable"),
    ],
)  # fmt: skip
def test_odds_in_words(odds, words):
    assert comparison(odds) == words


def test_the_noise_by_replicates_is_shown_with_its_interval_and_what_is_stated():
    """The interval itself is tested with the noise."""
    q = np.tile(np.arange(0.0, 360, 30), 2)
    read = q + np.random.default_rng(1).normal(scale=10 / 3600, size=24)
    file = {
        "name": "table",
        "units": {"length": "mm", "angle": "deg"},
        "joint": [{"name": "C", "type": "revolute", "axis": [0.0, 0, 1], "point": [0.0, 0, 0]}],
        "target": [{"name": "encoder", "zero": 0.0}],
        "measured": {"kind": "angle", "frame": "machine", "about": [0.0, 0, 1], "noise": 20 / 3600},
        "estimate": {"parameters": ["target"]},
    }
    rows = Measurements.from_frame({"C [deg]": q, "angle [deg]": read})
    found = diagnose(machine_of(toml(file), "table.toml"), rows)
    noise = found.final.noise.replicates
    (line,) = (line.split() for line in str(found).splitlines() if line.startswith("noise"))
    value, low, high = (f"{x:#.3g}" for x in (noise.value, noise.low, noise.high))
    assert line == ["noise,", "by", "replicates", value]
    said = f"By replicates the noise is between {low} and {high} arcsec (95 %); 20.0 arcsec is stated."
    assert said in " ".join(str(found).split())


def test_plain_errors_do_not_speak_against_an_effect_where_the_fit_weighs_what_poses_share():
    found = mount()
    weighed = replace(found, fits=tuple(replace(fit, weighed=True) for fit in found.fits))
    said = "The fit weighs readings by the error that those of a pose share."
    assert only_together(weighed).startswith(said)
    assert said not in only_together(found)


@pytest.mark.thorough
def test_few_poses_of_a_robot_cannot_show_its_dimensions():
    """Beyond its base the robot has 20 dimensions; 9 poses of one reflector are 27 numbers, 40 poses are enough."""
    folder = Path(__file__).parents[1] / "examples" / "machines" / "robot_6r_tracker"
    machine = replace(Machine.load(folder / "machine.toml"), estimate=("target",))
    data = Measurements.load(folder / "data.csv")
    few, many = (on_few_poses(machine.fit(data.take(np.arange(0, 3 * n, 3)))) for n in (9, 40))
    assert few == [
        "Whether the dimensions are those of the file 9 poses cannot show: estimated ones are 20 numbers more. "
        "Measure at more postures."
    ]
    assert many == []


# What `rodgen diagnose --json` prints is what the file formats say, and its figures are those of the data


CASES = {
    "one effect": ("rotary_table", 1, {"effects": [("encoder_eccentricity", "C")], "raises": 2.0}),
    "two effects": (
        "gantry",
        2,
        {"effects": [("squareness", "Y"), ("backlash", "X")], "raises": 1.6, "state_noise": True},
    ),
    "nothing": ("trunnion", 3, {}),
    "directions": ("mount", 4, {"effects": [("refraction", None)], "raises": 1.5}),
    "distances": ("ballbar", 5, {"effects": [("scale", "X")], "raises": 1.5}),
    "outliers": ("rotary_table", 6, {"effects": [("backlash", "C")], "raises": 2.0, "outliers": 0.03}),
    "a target": ("gantry_rotary", 7, {"effects": [("scale", "Y")], "raises": 1.5, "spread": "stated"}),
    "outside": ("rotary_table", 8, {"outside": "fifth_harmonic", "raises": 2.0}),
}


QUICK = {"one effect", "nothing", "directions", "outliers"}
every_case = pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CASES]
)


@cache
def files(name: str) -> tuple[Path, Path]:
    bench, seed, more = CASES[name]
    return hidden(bench, seed, **more).write(mkdtemp())


@cache
def diagnosed(name: str) -> Diagnosis:
    machine, data = files(name)
    return fit(rodgen.Machine.load(machine), rodgen.Measurements.load(data)).diagnose()


def rows_of(data: Path) -> int:
    return len(data.read_text().splitlines()) - 1


@pytest.mark.thorough
@every_case
def test_a_diagnosis_is_written_as_the_formats_say(name):
    found = diagnosed(name).to_dict()
    check_numbers(found, rows_of(files(name)[1]))


@pytest.mark.thorough
def test_further_measurements_are_predicted(tmp_path, capsys):
    machine, data = files("one effect")
    _, other = hidden("rotary_table", 1001, raises=2.0).write(tmp_path)
    # the other data are of the same machine without the effect and with other errors: only the format is looked at
    assert cli.main(["diagnose", str(machine), str(data), "--json", "--test", str(other)]) == 0
    printed = json.loads(capsys.readouterr().out)
    check_numbers(printed, rows_of(data))
    assert min(printed["rms"][f"{when}_test"] for when in ("before", "after")) > 0


@pytest.mark.thorough("directions")
@every_case
def test_errors_are_those_of_the_plain_simulator_with_the_fitted_numbers(name):
    machine, data = files(name)
    found = diagnosed(name)
    after = found.steps[-1].rms if found.steps else found.rms.before  # the simulator has no formulas of users
    for rms, model in ((found.rms.before, found.base), (after, found.final)):
        assert rms == pytest.approx(rms_of(machine, data, model, found.outliers), rel=1e-5)
    for step, model in zip(found.steps, found.fits[1:], strict=True):
        assert step.rms == pytest.approx(rms_of(machine, data, model, found.outliers), rel=1e-5)


@pytest.mark.thorough("directions")
@every_case
def test_errors_held_out_are_larger_than_fitted(name):
    rms = diagnosed(name).rms
    for fitted, held_out in ((rms.before, rms.before_held_out), (rms.after, rms.after_held_out)):
        if held_out is not None:
            assert fitted < held_out < 1.5 * fitted


@pytest.mark.thorough
def test_outliers_are_row_numbers_of_the_file():
    found = diagnosed("outliers")
    case = hidden(*CASES["outliers"][:2], **CASES["outliers"][2])
    truth = case.sealed.open(found)
    assert set(found.outliers) >= truth.outliers
    assert (
        len(set(found.outliers) - truth.outliers) <= 2
    )  # a good reading beyond 4 sigma is believed to be one


@pytest.mark.thorough
def test_parameters_are_those_of_the_final_model():
    found = diagnosed("two effects")
    estimates = found.final.estimates
    for step in found.steps:
        for name, parameter in step.parameters.items():
            assert parameter.value == estimates[step.effect.key(name)].value
            assert parameter.unit == estimates[step.effect.key(name)].unit


@pytest.mark.thorough("one effect", "directions")
@pytest.mark.parametrize(
    "name",
    [
        *("one effect", "two effects", "directions"),
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("distances", "a target")),
    ],
)
def test_effects_said_to_be_the_same_fit_as_well_when_fitted_anew(name):
    machine, data = files(name)
    found = diagnosed(name).to_dict()
    assert far_aliases(rodgen.Machine.load(machine), rodgen.Measurements.load(data), found) == []


@pytest.mark.thorough
def test_odds_end_at_1e300_and_ranking_goes_on():
    # one reading a pose: errors that the readings of a pose share would explain much of it
    case = hidden("trunnion", 9, [("encoder_eccentricity", "C")], raises=400.0, size=2.0)
    machine, data = case.write(mkdtemp())
    found = fit(rodgen.Machine.load(machine), rodgen.Measurements.load(data)).diagnose()
    assert found.steps[0].odds == 1e300
    assert found.steps[0].log10_odds > 300
    odds = [ranked.log10_odds for ranked in found.ranking]
    assert odds == sorted(odds, reverse=True)
