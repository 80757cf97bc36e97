"""A diagnosis finds what was hidden in a machine on legs, says nothing where nothing is, and knows what it cannot say.

The machines come from the plain simulator of closed chains, and the truth opens only for a finished diagnosis: see
hidden_effects. Every second one is seen by an instrument that stands anywhere.
"""

from __future__ import annotations

import csv
import json
from typing import Any

import numpy as np
import pytest
from diagnosis_checks import check_numbers, diagnosed, groups
from hidden_effects import Hidden, UnhiddenError, hidden
from hidden_parallel import BENCHES, FAMILY, at
from parallel_simulator import LEGS

from rodgen.cli import main as cli

T, S = "tricept", "three_sps_s"
slow = pytest.mark.slow


def made(bench: str, seed: int, effects: Any = (), **more: Any) -> Hidden:
    random = np.random.default_rng([seed, 9])
    return hidden(
        BENCHES[bench](random, frame="free" if seed % 2 else "machine"),
        seed,
        effects,
        **{"raises": 1.5, **more},
    )


EFFECTS = [
    (S, ("leg_zero_offset", "L3")),
    pytest.param(T, ("leg_thermal_expansion", "A1"), marks=slow),
    pytest.param(S, ("leg_compliance", "L2"), marks=slow),
    pytest.param(T, ("base_joint_offset", "A-1"), marks=slow),
    pytest.param(T, ("leg_zero_offset", "A1"), marks=slow),
    pytest.param(T, ("leg_scale", "A0"), marks=slow),
    pytest.param(T, ("leg_backlash", "A-1"), marks=slow),
    pytest.param(T, ("leg_compliance", "A0"), marks=slow),
    pytest.param(S, ("leg_thermal_expansion", "L1"), marks=slow),
    pytest.param(S, ("leg_scale", "L2"), marks=slow),
    pytest.param(S, ("leg_backlash", "L1"), marks=slow),
    pytest.param(S, ("base_joint_offset", "L2"), marks=slow),
    pytest.param(S, ("platform_joint_offset", "L1"), marks=slow),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("bench", "title"), EFFECTS)
def test_an_effect_of_a_leg_is_found(bench, title, tmp_path):
    found, truth = diagnosed(made(bench, 11, [title]), tmp_path)
    assert found.verdict == "effects_missing"
    assert len(found.steps) == 1
    assert truth.effects[0] in groups(found)[0]
    assert found.rms.after < 1.1 * found.rms.before / truth.raises
    assert found.rms.after_held_out < 1.15 * found.rms.before_held_out / truth.raises


@pytest.mark.parametrize(
    ("bench", "effects"),
    [
        pytest.param(T, [("leg_thermal_expansion", "A0"), ("leg_backlash", "A1")], marks=slow),
        pytest.param(T, [("leg_zero_offset", "A1"), ("leg_compliance", "A-1")], marks=slow),
        pytest.param(T, [("leg_thermal_expansion", "A1"), ("base_joint_offset", "A-1")], marks=slow),
        pytest.param(S, [("leg_thermal_expansion", "L2"), ("base_joint_offset", "L3")], marks=slow),
        pytest.param(S, [("leg_zero_offset", "L2"), ("leg_compliance", "L3")], marks=slow),
    ],
)
def test_two_effects_are_found(bench, effects, tmp_path):
    found, truth = diagnosed(made(bench, 13, effects), tmp_path)
    assert found.verdict == "effects_missing"
    assert len(found.steps) == 2
    for title in truth.effects:
        assert any(title in group for group in groups(found)), title


INNOCENT = [{}, {"wanders": "pose"}, {"outliers": 0.02}, {"covariates": True}]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("bench", "what"),
    [
        (S, {}),
        (T, {"wanders": "pose"}),
        *(pytest.param(S, what, marks=slow) for what in INNOCENT[1:]),
        *(pytest.param(T, what, marks=slow) for what in INNOCENT if "wanders" not in what),
    ],
)
def test_nothing_is_claimed_where_nothing_is(bench, what, tmp_path):
    found, truth = diagnosed(made(bench, 22, **what), tmp_path)
    assert (found.verdict, found.steps, found.unexplained) == ("nothing_missing", (), ())
    assert truth.outliers <= set(found.outliers)


@pytest.mark.parametrize(
    ("bench", "what"),
    [
        pytest.param(T, "leg_wave", marks=slow),
        pytest.param(S, "leg_wave", marks=slow),
        pytest.param(T, "leg_bend", marks=slow),
        pytest.param(S, "humidity", marks=slow),
    ],
)
def test_what_lies_outside_the_catalogue_is_said_to(bench, what, tmp_path):
    found, truth = diagnosed(made(bench, 41, outside=at(what, LEGS[FAMILY[bench]][1]), raises=2.0), tmp_path)
    assert found.verdict == "unknown_effect"
    assert found.unexplained[0].driver in truth.drivers
    assert len(found.steps) <= 1


@slow
@pytest.mark.parametrize("physics", ["play", "spring"])
def test_real_physics_has_the_name_of_the_nearest_effect(physics, tmp_path):
    found, truth = diagnosed(made(T, 14, [(physics, "A1")], raises=3.0), tmp_path)
    assert truth.effects[0] in groups(found)[0]
    assert len(found.steps) <= 2


def test_what_the_base_fit_absorbs_cannot_hide():
    with pytest.raises(UnhiddenError):
        made(T, 1, [("target_offset", "m1")])


@pytest.mark.parametrize(
    ("bench", "title"),
    [
        pytest.param(T, ("leg_thermal_expansion", "A1"), marks=slow),
        pytest.param(S, ("leg_backlash", "L1"), marks=slow),
    ],
)
def test_the_way_of_a_user(bench, title, tmp_path, capsys):
    """Diagnose by the command line with poses set aside, add what was found, and fit again."""
    case = made(bench, 51, [title])
    machine, data = case.write(tmp_path)
    header, *rows = csv.reader(data.read_text(encoding="utf-8").splitlines())
    files = {"first.csv": rows[:126], "other.csv": rows[126:]}  # whole poses, of three rows
    for name, some in files.items():
        (tmp_path / name).write_text(
            "\n".join(",".join(row) for row in [header, *some]) + "\n", encoding="utf-8"
        )
    first, other = (str(tmp_path / name) for name in files)
    assert cli.main(["diagnose", str(machine), first, "--test", other, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    check_numbers(found, 126)
    truth = case.sealed.open(found)
    (step,) = found["steps"]
    assert (step["effect"], step["joint"]) == truth.effects[0]
    for key, true in truth.values.items():
        p = step["parameters"][key.rsplit(".", 1)[1]]
        assert abs(p["value"] - true) < 4.5 * p["std"]
    rms = found["rms"]
    assert rms["after_test"] < 0.8 * rms["before_test"]
    assert rms["after_held_out"] < 0.8 * rms["before_held_out"]

    better = str(tmp_path / "better.toml")
    assert cli.main(["diagnose", str(machine), first, "-o", better]) == 0
    capsys.readouterr()
    assert cli.main(["fit", better, other, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rms"] == pytest.approx(truth.sigma, rel=0.2)
    assert cli.main(["diagnose", better, first, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "nothing_missing"
