"""What `rodgen diagnose --json` prints is what the file formats say, and its figures are those of the data.

The RMS come from the plain simulator with the fitted numbers, and effects that are said to be the same are fitted anew.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import pytest
from diagnosis_checks import check_numbers, far_aliases, rms_of
from hidden_effects import hidden

import rodgen
from rodgen.calibration.diagnosis import Diagnosis
from rodgen.calibration.fit import fit
from rodgen.cli import main as cli

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
