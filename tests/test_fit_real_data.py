"""Fits of real measurements against published figures and independent fits of the same data."""

from __future__ import annotations

from pathlib import Path

import pytest

from rodgen.calibration.fit import fit
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

ROOT = Path(__file__).parent.parent
MOUNT = ROOT / "examples" / "machines" / "mount"
POSITIONER = ROOT / "tests" / "data" / "positioner"
TPOINT = {"TF": 21.4118, "TX": 2.7165}
"""Published with the data, of a fit by TPOINT: see examples/machines/mount/SOURCE.txt."""


def test_telescope_s_error_falls_as_published():
    machine = Machine.load(MOUNT / "machine.toml")
    data = Measurements.load(MOUNT / "mmt_2021.csv")
    rms = [fit(machine, data).rms]
    for name, place, hold in (("gravity_windup", "EL", {"k2": 0.0}), ("refraction", None, {})):
        machine = machine.with_effect(machine.effect(name, place, hold=hold))
        rms.append(fit(machine, data).rms)
    # half a unit of the figures' last digit; the same three from SciPy in test_machine_simulator.py
    assert rms == pytest.approx([2.711, 0.969, 0.659], abs=5e-4)


def test_telescope_s_coefficients_are_those_of_tpoint():
    machine = Machine.load(MOUNT / "machine.toml")
    data = Measurements.load(MOUNT / "mmt_2021.csv")
    machine = machine.with_effect(machine.effect("gravity_windup", "EL", hold={"k2": 0.0}))
    found = fit(machine.with_effect(machine.effect("refraction")), data).estimates
    # TPOINT's model is linear in small angles; that, and no more, separates the two
    assert found["EL.gravity_windup.k"].value == pytest.approx(TPOINT["TF"], abs=0.02)
    assert found["refraction.a"].value == pytest.approx(TPOINT["TX"], abs=0.02)
    assert found["EL.gravity_windup.k2"].held


def test_positioner_is_fitted_as_well_as_by_an_independent_fit():
    found = fit(Machine.load(POSITIONER / "machine.toml"), Measurements.load(POSITIONER / "data.csv"))
    assert found.rms == pytest.approx(0.2355, abs=5e-4)  # SciPy's, in test_machine_simulator.py
    # Two free axes, three free targets and a free frame: six choices of coordinates
    assert len(found.determinacy.directions) == 6
    assert all(direction.gauge for direction in found.determinacy.directions)
