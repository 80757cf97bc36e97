"""What a diagnosis says of sizes and of effects that do the same: no more than its numbers allow."""

from __future__ import annotations

from dataclasses import replace

import pytest
from made_diagnoses import mount

from rodgen.calibration.diagnose.diagnosis import Alias, DiagnosedEffect, Diagnosis
from rodgen.calibration.diagnose.summary import at_reach, far_from_usual
from rodgen.calibration.fitted import Estimate
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
    return DiagnosedEffect(machine.effect(name, machine.joints[0].name), 1e-9, -9.0, 1.0, 1.0, parameters)


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


@pytest.mark.thorough
def test_what_is_improbable_with_the_data_is_not_said_to_be_indistinguishable():
    machine = mount().base.machine
    likely = Alias((machine.effect("scale", "EL"),), "scale at EL does the same.", 1.0, 0.5, 0.4)
    improbable = Alias((machine.effect("backlash", "EL"),), "backlash at EL does the same.", 2.0, 0.5, 1e-4)

    def with_aliases(*aliases: Alias) -> Diagnosis:
        first, *others = mount().steps
        return replace(mount(), steps=(replace(first, indistinguishable_from=aliases), *others))

    both = with_aliases(likely, improbable)
    text = " ".join(both.summary().split())
    assert "or effects that do the same to these data" in text
    before, _, after = text.partition("Similar, but improbable with these data:")
    assert "cannot distinguish it from: - scale at EL" in before
    assert after.startswith(" backlash at EL.")
    assert "- backlash" not in before
    assert "<h4>Similar, but improbable with these data</h4>" in report_page(both)
    alone = with_aliases(improbable)
    assert "These are missing: gravity_windup at EL and refraction" in alone.summary()
    assert "cannot distinguish" not in alone.summary()


def test_of_many_effects_that_do_the_same_the_likeliest_are_explained_and_the_others_named():
    machine = mount().base.machine
    names = (
        "backlash",
        "scale",
        "encoder_eccentricity",
        "encoder_ellipticity",
        "servo_lag",
        "gravity_windup",
    )
    aliases = [
        Alias((effect := machine.effect(name, "EL"),), f"{effect.title} does the same.", 1.0, 1.0, 0.1 * k)
        for k, name in enumerate(names, 1)
    ]
    first, *others = mount().steps
    step = replace(first, indistinguishable_from=tuple(aliases))
    _, _, said = replace(mount(), steps=(step, *others)).summary().partition("cannot distinguish it from:\n")
    lines = [line.strip() for line in said.splitlines()[:9] if line.startswith("    - ")]
    assert lines[0].startswith("- gravity_windup at EL does the same.")
    assert [line.split()[1] for line in lines[:4]] == list(names[:1:-1])
    assert lines[4] == "- nor from scale at EL and backlash at EL."
