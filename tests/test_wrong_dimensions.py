"""Dimensions that are not those of the file are one answer; effects of a machine that is as drawn are not.

A robot is drawn once. The simulator measures it, with dimensions that are off by what such machines have, or with
drives that give way to the moments of the weights that they carry, which is physics and no formula of the catalogue.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_checks import diagnosis_of
from hidden_effects import Hidden, Sealed, Truth
from machine_simulator import arcsec
from real_machines import arm_6r

WINDUPS = {f"{joint}.weight_windup.c": 2e-4 * arcsec(1) for joint in ("J2", "J3")}
"""1e6 N m/rad, as gears of such a robot have."""


def drawn(seed: int, off: dict[str, float], effects: dict[str, float]) -> Hidden:
    """Return a robot whose file estimates targets only; `off` are its own dimensions, targets and frame."""
    random = np.random.default_rng(seed)
    bench = arm_6r(random)
    text = bench.text.replace("{noise}", "")
    text = text[: text.index("[estimate]")] + '[estimate]\nparameters = ["target"]\n'
    mounted = {key: x for key, x in bench.wrong.items() if key.startswith(("target.", "frame."))}
    bench = replace(bench, text=text, wrong=mounted | off)
    machine = bench.simulator(bench.file)
    reading = machine.with_noise(bench.measure(effects), bench.sigma, random)
    return Hidden(
        "arm", bench, {"q": bench.q, "reading": reading, "target": bench.target}, text, Sealed(Truth("none"))
    )


def tolerances(seed: int) -> dict[str, float]:
    """Return axes off by 100 arcsec and points by 0.2 mm: what machining and mounting leave."""
    random = np.random.default_rng(seed)
    size = {"axis": arcsec(100), "point": 0.2}
    return {
        f"J{j}.{what}.{x}": size[what] * random.normal() for j in range(2, 7) for what in size for x in "ab"
    }


def names(found) -> set[str]:
    return {step.effect.title for step in found.steps}


@pytest.mark.thorough
def test_dimensions_that_are_all_off_are_one_answer(tmp_path):
    found = diagnosis_of(drawn(2, tolerances(2), WINDUPS), tmp_path)
    assert found.geometry is not None
    assert (
        found.geometry.odds > 0.01
    )  # single ones in their place are more causes, and may be equally probable
    assert {"J2.axis", "J6.point", "target"} <= set(found.geometry.estimate)
    assert {"gravity_windup at J2", "gravity_windup at J3"} <= names(found)
    assert not {name.split(" at ")[0] for name in names(found)} & {"axis_tilt", "axis_offset", "zero_offset"}
    assert found.rms.after < 1.1 * arm_6r(np.random.default_rng(2)).sigma


@pytest.mark.thorough
def test_effects_of_a_machine_that_is_as_drawn_are_no_dimensions(tmp_path):
    eccentric = {"J4.encoder_eccentricity.a": arcsec(40), "J4.encoder_eccentricity.b": arcsec(-30)}
    found = diagnosis_of(drawn(2, {}, WINDUPS | eccentric), tmp_path)
    assert found.geometry is None
    assert {"gravity_windup at J2", "gravity_windup at J3", "encoder_eccentricity at J4"} <= names(found)


@pytest.mark.thorough
def test_two_dimensions_that_are_off_are_two(tmp_path):
    off = {"J3.axis.a": arcsec(250), "J5.point.a": 0.6, "J5.point.b": -0.4}
    found = diagnosis_of(drawn(3, off, WINDUPS), tmp_path)
    assert found.geometry is None
    assert {"gravity_windup at J2", "gravity_windup at J3"} <= names(found)
    assert len(names(found)) == 4
