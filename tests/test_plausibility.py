"""What is known of effects before any data decides among what the data cannot tell apart, and no size is absurd."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosis_checks import diagnosis_of
from hidden_effects import Hidden, Sealed, Truth, trunnion

import rodgen
from rodgen.calibration.diagnose import diagnose
from rodgen.cli import main as cli
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Joint, Measured, Target
from rodgen.machines.plausibility import kind_of_machine, plausibility
from rodgen.machines.templates import machine_template

ROOT = Path(__file__).parent.parent
MOUNT = ROOT / "examples" / "machines" / "mount"


def mount(**keys) -> rodgen.Machine:
    machine = rodgen.Machine.load(MOUNT / "machine.toml")
    az, el = machine.joints
    return replace(machine, joints=(az, replace(el, **keys)))


def odds(machine: rodgen.Machine, name: str, place: str = "EL") -> float:
    return math.exp(plausibility(machine, machine.effect(name, place)).log_odds)


def robot() -> rodgen.Machine:
    joints = tuple(
        Joint(f"J{k}", "revolute", (0.0, float(k % 2), float(k % 2 == 0)), (0.0, 0.0, 100.0 * k))
        for k in range(6)
    )
    target = Target("p", (500.0, 0.0, 600.0))
    measured = Measured("point", "free")
    return rodgen.Machine("A robot", "mm", "deg", (0.0, 0.0, -1.0), 20.0, joints, (target,), measured)


def test_every_effect_of_the_catalogue_has_odds_and_the_size_of_each_parameter():
    machines = [robot(), mount(), rodgen.Machine.load(ROOT / "examples/machines/tricept/machine.toml")]
    machines += [
        machine_of(machine_template(kind), kind) for kind in ("linear-delta", "rotary-delta", "hexapod")
    ]
    machines = [replace(machine, estimate=()) for machine in machines]
    machines += [
        rodgen.Machine.load(path) for path in sorted((ROOT / "examples/machines").glob("*/machine.toml"))
    ]
    seen = set()
    for machine in machines:
        for definition in CATALOGUE:
            places = [None] if definition.at & machine.kinds_of(None) else [j.name for j in machine.joints]
            places = [t.name for t in machine.targets] if "target" in definition.at else places
            for place in places:
                if not definition.at & machine.kinds_of(place):
                    continue
                try:
                    effect = machine.effect(definition.name, place)
                    units = set(effect.units(machine)) - set(definition.searched)
                except rodgen.RodgenError:
                    continue
                found = plausibility(machine, effect)
                assert set(found.sizes) == units, (machine.name, effect.title)
                assert all(0 < size.usual < size.largest for size in found.sizes.values())
                seen.add((definition.name, definition.at))
    assert seen >= {(d.name, d.at) for d in CATALOGUE if d.name != "instrument_scale"}


def test_the_kind_of_machine_is_seen_from_its_joints_and_what_is_measured():
    assert kind_of_machine(mount()) == "telescope"
    assert kind_of_machine(robot()) == "robot"
    assert kind_of_machine(rodgen.Machine.load(ROOT / "tests/data/positioner/machine.toml")) == "machine tool"


def test_what_a_joint_s_block_says_changes_the_odds():
    assert odds(mount(), "encoder_eccentricity") > 3 * odds(mount(), "scale")
    assert odds(mount(encoder="axis"), "scale") == 0
    assert odds(mount(encoder="axis"), "backlash") == 0
    assert odds(mount(drive="direct"), "periodic_drive_error") == 0
    assert odds(mount(drive="worm"), "periodic_drive_error") > odds(mount(), "periodic_drive_error")
    assert odds(mount(encoder="motor"), "backlash") > odds(mount(), "backlash")


def test_sizes_are_those_of_the_machine_s_reach_and_units():
    machine = robot()
    windup = plausibility(machine, machine.effect("gravity_windup", "J1")).sizes
    reach = math.dist((0, 0, 0), (500, 0, 600))
    assert windup["k"].largest == pytest.approx(math.radians(2) / reach)
    assert [windup[name].positive for name in ("k", "k_J3", "k2", "k2_J2")] == [True, True, False, False]
    metres = replace(
        machine,
        length_unit="m",
        joints=tuple(replace(j, point=tuple(x / 1000 for x in j.point)) for j in machine.joints),
        targets=(replace(machine.targets[0], point=(0.5, 0.0, 0.6)),),
    )
    same = plausibility(metres, metres.effect("gravity_windup", "J1")).sizes
    assert same["k"].largest == pytest.approx(1000 * windup["k"].largest)
    offset = [plausibility(m, m.effect("axis_offset", "J1")).sizes["a"].usual for m in (machine, metres)]
    assert offset == pytest.approx([0.5, 0.0005])


def test_a_size_costs_what_a_cauchy_distribution_says():
    prior = plausibility(robot(), robot().effect("lateral_windup", "J1"))
    assert prior.size_cost(["a"], [10 * prior.sizes["a"].usual]) == pytest.approx(2 * math.log(101))


@pytest.mark.thorough
def test_the_user_s_word_and_the_joint_s_keys_overrule_the_odds_on_the_telescope(capsys):
    data = rodgen.Measurements.load(MOUNT / "mmt_2021.csv")
    found = diagnose(mount(), data)
    named = [step.effect.identity for step in found.steps]
    assert named == [("tube_flexure", None), ("refraction", None)]  # TPOINT's TF and TX
    sizes = [step.parameters["a"].value for step in found.steps]
    assert sizes == pytest.approx([21.4118, 2.7165], abs=5e-3)
    aliases = [alias for step in found.steps for alias in step.indistinguishable_from]
    assert "scale" in {alias.effect.name for alias in aliases}
    assert max(alias.odds for alias in aliases) <= 1.0  # what is named is the most probable
    preferred = diagnose(mount(), data, prefer=[("scale", "EL")])
    assert preferred.steps[0].effect.identity == ("scale", "EL")
    direct = diagnose(mount(encoder="axis"), data)
    told = {a.effect.identity for step in direct.steps for a in step.indistinguishable_from}
    assert ("scale", "EL") not in told | {step.effect.identity for step in direct.steps}
    assert (
        cli.main(["diagnose", str(MOUNT / "machine.toml"), str(MOUNT / "mmt_2021.csv"), "--prefer", "scal"])
        == 2
    )
    assert "'scale', perhaps" in capsys.readouterr().err


def test_a_preferred_effect_needs_a_place_of_the_machine(capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(MOUNT / "machine.toml"), str(MOUNT / "mmt_2021.csv")]
    assert cli.main(["diagnose", *files, "--prefer", "scale@XX"]) != 0
    assert "--prefer scale@XX: no joint 'XX'" in capsys.readouterr().err


# what the file says ------------------------------------------------------------------------------------------------


def with_table(text: str) -> rodgen.Machine:
    whole = (MOUNT / "machine.toml").read_text(encoding="utf-8")
    return machine_of(f"{whole}\n[plausibility]\n{text}\n", "m.toml")


def test_the_table_of_the_file_overrules_odds_sizes_and_signs():
    machine = with_table(
        'scale = { odds = 0 }\nEL.scale = { odds = 2, usual = "1e-3" }\nEL.gravity_windup = { sign = "positive" }'
    )
    assert odds(machine, "scale", "AZ") == 0
    assert odds(machine, "scale") == pytest.approx(2)
    said = plausibility(machine, machine.effect("scale", "EL")).sizes["k"]
    assert said.usual == 1e-3
    assert said.largest == 0.05
    assert not plausibility(mount(), mount().effect("gravity_windup", "EL")).sizes["k"].positive
    assert plausibility(machine, machine.effect("gravity_windup", "EL")).sizes["k"].positive
    assert machine_of(machine_text(machine), "m.toml") == machine


@pytest.mark.thorough
def test_the_table_of_the_file_decides_what_is_named():
    data = rodgen.Measurements.load(MOUNT / "mmt_2021.csv")
    found = diagnose(with_table("tube_flexure = { odds = 0 }\nEL.scale = { odds = 1000 }"), data)
    assert found.steps[0].effect.identity == ("scale", "EL")
    assert "[plausibility] of the machine file says how likely scale at EL is." in found.summary()


@pytest.mark.parametrize(
    'text',
    [
        "EL.scale = 3",
        "EL.gravity = { odds = 1 }",
        "X.scale = { odds = 1 }",
        "scale = { odd = 1 }",
        "scale = {}",
        "scale = { usual = [] }",
        'scale = { usual = "2e-3", largest = "1e-3" }',
        "scale = { odds = -1 }",
        "scale = { odds = true }",
        'scale = { usual = "3 mm" }',
        'scale = { usual = "3 foo" }',
        "scale = { largest = 3 }",
        'scale = { sign = "minus" }',
        "straightness = { odds = 1 }",
    ],
)  # fmt: skip
def test_what_the_table_cannot_say_is_one_sentence_with_its_place(refuses, text):
    refuses(with_table, text)


def balanced(folder, key=""):
    """Return the diagnosis of a trunnion whose weight turns its A axis upwards."""
    bench = trunnion(np.random.default_rng(3))
    random = np.random.default_rng(4)
    reading = bench.measure({"A.gravity_windup.k": -0.5 / 3600})
    reading = reading + bench.sigma * random.normal(size=reading.shape)
    text = bench.text.replace("{noise}", "").replace('name = "A"\n', f'name = "A"\n{key}')
    case = Hidden(
        "balanced",
        bench,
        {"q": bench.q, "reading": reading, "target": bench.target},
        text,
        Sealed(Truth("none")),
    )
    return diagnosis_of(case, folder)


@pytest.mark.slow
def test_weight_that_turns_a_joint_upwards_is_named_with_what_it_needs(tmp_path):
    said = "k of gravity_windup at A is negative: weight turns A upwards, as only a counterweight"
    found = balanced(tmp_path)
    assert [step.effect.identity for step in found.steps] == [("gravity_windup", "A")]
    assert found.unexplained == ()
    k = found.steps[0].parameters["k"]
    assert k.value == pytest.approx(-0.5, abs=4 * k.std)
    assert any(note.startswith(said) for note in found.notes)
    known = balanced(tmp_path, "counterbalance = true\n")
    assert [step.effect.identity for step in known.steps] == [("gravity_windup", "A")]
    assert not any("counterbalance" in note for note in known.notes)
