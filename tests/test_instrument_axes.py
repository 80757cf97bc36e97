"""The squareness of an instrument's own axes: told from errors of the joints where joints cannot imitate it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hidden_effects import BENCHES
from machine_simulator import arcsec

from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

SQUARENESS = ("instrument_squareness", None)


def diagnosis(folder: Path, bench: str, seed: int, truth: dict[str, float]) -> Any:
    """Diagnose a machine that an instrument with errors of its axes has measured."""
    of = BENCHES[bench](np.random.default_rng(seed), 0.6)
    machine = of.simulator(of.file, {**of.wrong, **truth})
    reading = machine.with_noise(
        machine.measure(of.q, target=of.target), of.sigma, np.random.default_rng(seed)
    )
    (folder / "machine.toml").write_text(of.text.replace("{noise}", ""), encoding="utf-8")
    machine.write_csv(folder / "data.csv", q=of.q, reading=reading, target=of.target)
    fit = Machine.load(folder / "machine.toml").fit(Measurements.load(folder / "data.csv"))
    return fit.diagnose()


@pytest.mark.thorough("rotary_table-xy")
@pytest.mark.parametrize("angle", ["xy", pytest.param("xz", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "bench",
    [
        "rotary_table",
        "trunnion",
        *(pytest.param(b, marks=pytest.mark.slow) for b in ("robot", "gantry_rotary")),
    ],
)
def test_turning_joints_do_not_imitate_an_instrument_that_is_not_square(bench, angle, tmp_path):
    """A circle is read as an ellipse: no error motion of the joint does that at every radius and height."""
    found = diagnosis(tmp_path, bench, 1, {f"instrument_squareness.{angle}": arcsec(20)})
    assert [step.effect.identity for step in found.steps] == [SQUARENESS]
    assert not found.steps[0].indistinguishable_from
    for key, estimate in found.final.estimates.items():
        if key.startswith("instrument_squareness."):
            true = 20.0 if key.endswith(angle) else 0.0
            assert abs(estimate.value - true) < 4 * estimate.std < 8, key


def test_where_the_machines_own_axes_do_the_same_both_are_said(tmp_path):
    found = diagnosis(tmp_path, "gantry", 1, {"instrument_squareness.xy": arcsec(20)})
    (step,) = found.steps
    assert step.effect.identity == ("squareness", "Y")
    assert SQUARENESS in {other.effect.identity for other in step.indistinguishable_from}
