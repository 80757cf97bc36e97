"""A machine's own errors: location errors by their ISO names and signs, and the error over its workspace."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rodgen import Machine, Measurements
from rodgen.calibration.fit import Fit
from rodgen.calibration.volumetric import volumetric_error
from rodgen.data.units import ARCSEC
from rodgen.machines.emit.own_errors import LocationError, location_errors
from rodgen.machines.machine import Joint, Measured, Target

MACHINES = Path(__file__).parent.parent / "examples/machines"
NOISE = 0.001


def machine(*joints: Joint, estimate: tuple[str, ...] = (), frame: str = "machine") -> Machine:
    targets = (Target("ball", (100.0, 0.0, 50.0)),)
    measured = Measured("point", frame, noise=NOISE)
    return Machine(
        "Machine", "mm", "deg", (0.0, 0.0, -1.0), 20.0, joints, targets, measured, estimate=estimate
    )


X = Joint("X", "prismatic", (1.0, 0.0, 0.0), travel=(0.0, 400.0))
Y = Joint("Y", "prismatic", (0.0, 1.0, 0.0), travel=(0.0, 200.0))
C = Joint("C", "revolute", (0.0, 0.0, 1.0))


def gantry(squareness: float = 100 * ARCSEC, noise: int | None = None) -> Fit:
    """A gantry whose Y axis is turned about z, of which X from 0 to 200 was measured."""
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(0, 200, 5), np.linspace(0, 200, 5)))
    place = np.stack([100 + x - squareness * y, y, np.full(len(x), 50.0)], axis=1)
    if noise is not None:
        place = place + NOISE * np.random.default_rng(noise).normal(size=place.shape)
    columns = {"X [mm]": x, "Y [mm]": y} | {f"{k} [mm]": v for k, v in zip("xyz", place.T, strict=True)}
    model = machine(X, Y)
    model = model.with_effect(model.effect("squareness", "Y"))
    return model.fit(Measurements.from_frame(columns))


def table(tilt: tuple[float, float], shift: tuple[float, float], target: tuple[float, float] = (0, 0)) -> Fit:
    """A table whose axis is tilted about x and y and shifted in x and y, exactly."""
    axis = np.array([tilt[1], -tilt[0], 1.0])
    axis /= np.linalg.norm(axis)
    angle = np.radians(np.arange(0, 360, 10.0))
    arm = np.array([100.0 + target[0], target[1], 50.0]) - [*shift, 0.0]
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    place = c * arm + s * np.cross(axis, arm) + (1 - c) * (axis @ arm) * axis + [*shift, 0.0]
    columns = {"C [deg]": np.degrees(angle)} | {f"{k} [mm]": v for k, v in zip("xyz", place.T, strict=True)}
    model = machine(C, estimate=("C.axis", "C.point", "target"))
    return model.fit(Measurements.from_frame(columns))


def locations(fit: Fit) -> dict[str, LocationError]:
    keys = [p.key for p in fit.parameters]
    found = location_errors(
        fit.machine, fit.observations.travel, (keys, fit.covariance), fit.determinacy.null
    )
    return {one.symbol: one for one in found}


def test_location_errors_have_the_names_and_signs_of_iso_230() -> None:
    found = locations(gantry())
    assert found.keys() == {"EA0Y", "EC0Y"}
    # Y is turned from x towards -x, about +z by the right-hand rule
    assert found["EC0Y"].value == pytest.approx(100, abs=1e-3)
    assert found["EA0Y"].value == pytest.approx(0, abs=1e-3)
    assert found["EC0Y"].meaning == "squareness of Y about z"
    found = locations(table((30 * ARCSEC, -50 * ARCSEC), (0.02, -0.01)))
    expected = {"EA0C": 30, "EB0C": -50, "EX0C": 20, "EY0C": -10}
    assert {name: one.value for name, one in found.items()} == pytest.approx(expected, abs=0.02)
    assert [found[x].meaning for x in ("EA0C", "EY0C")] == ["tilt of C about x", "position of C in y"]
    assert [found[x].unit for x in ("EA0C", "EY0C")] == ["arcsec", "um"]


def test_uncertainty_of_a_location_error_is_twice_the_standard_deviation() -> None:
    found = [locations(gantry(noise=seed))["EC0Y"] for seed in range(20)]
    # x = -squareness * y, of 5 rows at each y
    expected = 2 * NOISE / np.sqrt(np.sum(np.repeat(np.linspace(0, 200, 5), 5) ** 2)) / ARCSEC
    assert 2 * np.std([one.value for one in found]) == pytest.approx(expected, rel=0.35)
    assert np.median([one.u for one in found]) == pytest.approx(expected, rel=0.1)
    estimate = gantry(noise=1).estimates["Y.squareness.b"]
    assert estimate.std is not None
    assert found[1].u == pytest.approx(2 * estimate.std, rel=1e-6)


def test_choice_of_coordinates_is_marked() -> None:
    model = machine(C, estimate=("C.axis", "C.point", "target"), frame="free")
    data = table((0, 0), (0.02, 0)).observations.data
    found = locations(model.fit(data))
    assert all(one.by_choice for one in found.values())
    assert not any(one.by_choice for one in locations(table((0, 0), (0.02, 0))).values())
    assert locations(Machine.load(MACHINES / "tricept/machine.toml").fit(_data("tricept"))) == {}


def _data(name: str) -> Measurements:
    return Measurements.load(MACHINES / name / "data.csv")


def test_volumetric_error_is_that_over_the_whole_travel() -> None:
    """Y is off by squareness * y in x, up to 200 mm: a mean of nothing can be taken out, as the target is known."""
    found = volumetric_error(gantry())
    assert found is not None
    assert found.largest == pytest.approx(100 * ARCSEC * 200, rel=1e-4)
    assert found.most == pytest.approx(100 * ARCSEC * 0.95 * 200, rel=0.03)  # 33 positions of Y
    assert (found.at[1], found.positions, found.unit, found.free) == (200.0, 33**2, "mm", ())
    np.testing.assert_allclose(found.ranges, [[0, 400], [0, 200]])
    every = [volumetric_error(gantry(noise=seed)) for seed in range(20)]
    expected = 2 * NOISE * 200 / np.sqrt(np.sum(np.repeat(np.linspace(0, 200, 5), 5) ** 2))
    assert 2 * np.std([one.largest for one in every]) == pytest.approx(expected, rel=0.35)
    assert np.median([one.largest_u for one in every]) == pytest.approx(expected, rel=0.1)


def test_mounting_is_no_error_of_the_machine() -> None:
    """The axis of a table is 20 µm from its place; of a target that is set up anew 20 µm remain, all around."""
    for target in ((0, 0), (0.5, -0.3)):
        found = volumetric_error(table((0, 0), (0.02, 0), target))
        assert found is not None
        assert found.free == ("target",)
        np.testing.assert_allclose([found.largest, found.most], 0.02, rtol=0.02)
    still = volumetric_error(table((0, 0), (0, 0), (0.5, -0.3)))
    assert still is not None
    assert still.largest < 1e-6


def test_volumetric_error_of_real_families() -> None:
    for name, unit, measured_only in (("tricept", "mm", True), ("mount", "arcsec", False)):
        model = Machine.load(MACHINES / name / "machine.toml")
        data = _data(name) if name == "tricept" else Measurements.load(MACHINES / "mount/mmt_2021.csv")
        found = volumetric_error(model.fit(data))
        assert found is not None
        assert (found.unit, found.measured_only) == (unit, measured_only)
        assert 0 < found.most < found.largest
        assert found.largest_u is not None
        assert 0 < found.largest_u < found.largest


def test_volumetric_error_is_at_positions_that_coupled_joints_can_reach() -> None:
    machine = Machine.load(MACHINES / "palletiser/machine.toml")
    found = volumetric_error(machine.fit(_data("palletiser")))
    assert found is not None
    j3, j4 = machine.number_of("J3"), machine.number_of("J4")
    low, high = np.radians([-120, 60])  # the motor of J3 alone could turn from -170 to 145 degrees
    assert low <= machine.coordinates(found.at)[j3] <= high
    assert found.at[j4] == pytest.approx(-found.at[j3])  # J4 is level by rods: -(J2 + J3), J3 = J3m - J2m
    np.testing.assert_allclose(found.ranges[j4], -found.ranges[j3][::-1])


def test_machine_file_notes_date_instrument_and_conditions(refuses, tmp_path: Path) -> None:
    text = (MACHINES / "rotary_table/machine.toml").read_text(encoding="utf-8")
    path = tmp_path / "machine.toml"
    path.write_text(text + '\n[record]\ndate = 2026-05-17\ninstrument = "CMM 7"\n', encoding="utf-8")
    found = Machine.load(path)
    assert found.record == {"date": "2026-05-17", "instrument": "CMM 7"}
    again = tmp_path / "again.toml"
    found.save(again)
    assert Machine.load(again).record == found.record
    for wrong in ("operator = 1", "date = 17"):
        path.write_text(f"{text}\n[record]\n{wrong}\n", encoding="utf-8")
        refuses(Machine.load, path)
