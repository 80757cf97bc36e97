"""What a diagnosis says of sizes, of odds, and of effects that the data cannot distinguish."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from machine_cases import toml
from made_diagnoses import mount

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
from rodgen.calibration.fitted import Estimate
from rodgen.calibration.words import comparison
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
