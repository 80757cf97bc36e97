"""Flexures, couplings and instruments: small hidden errors of machines that have them, named by the diagnosis."""

import numpy as np
import pytest
from machine_simulator import Simulated, arcsec

from rodgen.calibration.diagnose import diagnose
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Joint, Machine, Measured, Target

LATITUDE = np.radians(32.0)


def machine(joints, targets, kind, frame, estimate, gravity=(0.0, 0.0, -1.0), noise=None):
    return Machine(
        "A machine", "mm", "deg", gravity, 20.0,
        tuple(Joint(*joint) for joint in joints), tuple(Target(f"p{i}", point) for i, point in enumerate(targets)),
        Measured(kind, frame, noise=noise), tuple(estimate),
    )  # fmt: skip


EQUATORIAL = machine(
    [("HA", "revolute", (0, 0, -1), (0, 0, 0)), ("DEC", "revolute", (0, -1, 0), (0, 0, 0))],
    [(1, 0, 0)], "direction", "machine", ["HA.axis", "DEC.axis", "target"],
    (-float(np.cos(LATITUDE)), 0.0, -float(np.sin(LATITUDE))), noise=np.radians(arcsec(1.0)),
)  # fmt: skip
WRIST = machine(
    [("J1", "revolute", (0, 0, 1), (0, 0, 0)), ("J2", "revolute", (0, 1, 0), (0, 0, 300)),
     ("J3", "revolute", (1, 0, 0), (400, 0, 300))],
    [(520, 60, 330), (500, -80, 290)], "point", "free", ["J2.axis", "J2.point", "J3.axis", "J3.point", "target"],
    noise=0.01,
)  # fmt: skip


def measured(of: Machine, effects: dict[str, float], rows: int, seed: int) -> Measurements:
    """Return readings in poses without an order, with the noise that the machine states."""
    random = np.random.default_rng(seed)
    file = {
        "units": {"length": "mm", "angle": "deg"},
        "environment": {"gravity": list(of.gravity)},
        "joint": [
            {"name": j.name, "type": j.type, "axis": list(j.axis), "point": list(j.point)} for j in of.joints
        ],
        "target": [{"name": t.name, "point": list(t.point)} for t in of.targets],
        "measured": {"kind": of.measured.kind, "frame": of.measured.frame},
    }
    simulated = Simulated(file, effects)
    q = random.uniform(-70, 70, (rows, len(of.joints)))
    if not of.measurand.moving:
        q[:, 1] = random.uniform(-20, 75, rows)
    names = [t.name for t in of.targets]
    target = [names[i % len(names)] for i in range(rows)]
    sigma = of.measured.noise if of.measurand.moving else np.degrees(of.measured.noise)
    y = simulated.with_noise(simulated.measure(q, target=target), sigma, random)
    table = {f"{j.name} [deg]": q[:, i] for i, j in enumerate(of.joints)} | {"target": target}
    table |= (
        {name: y[:, i] for i, name in enumerate(of.measurand.columns)}
        if not of.measurand.moving
        else {f"{name} [mm]": y[:, i] for i, name in enumerate("xyz")}
    )
    return Measurements.from_frame(table)


FRAME = {
    "frame.x": 900.0,
    "frame.y": -400.0,
    "frame.z": 120.0,
    "frame.rx": 20.0,
    "frame.ry": -35.0,
    "frame.rz": 70.0,
}


@pytest.mark.thorough("title1-DEC.axis_flexure.a-same1")
@pytest.mark.parametrize(
    ("title", "key", "same"),
    [
        (("tube_flexure", None), "tube_flexure.a", set()),
        # cos h of the hour angle is what weight does there, and tan of the declination NP
        (("axis_flexure", "DEC"), "DEC.axis_flexure.a", {("gravity_windup", "HA")}),
        (("fork_flexure", "DEC"), "DEC.fork_flexure.a", set()),
    ],
)
def test_each_flexure_of_an_equatorial_mount_is_named(title, key, same):
    found = diagnose(EQUATORIAL, measured(EQUATORIAL, {key: arcsec(12)}, 70, 5))
    assert [(step.effect.name, step.effect.place) for step in found.steps] == [title]
    aliases = {(alias.effect.name, alias.effect.place) for alias in found.steps[0].indistinguishable_from}
    assert same <= aliases
    assert not {"tube_flexure", "axis_flexure", "fork_flexure"} & {name for name, _ in aliases}
    estimate = found.final.estimates[key]
    assert abs(estimate.value - 12) < 3.5 * estimate.std < 6


def test_a_coupling_of_a_wrist_is_named():
    found = diagnose(WRIST, measured(WRIST, FRAME | {"J3.coupling.k": 8e-4}, 120, 6))
    assert [(step.effect.name, step.effect.place) for step in found.steps] == [("coupling", "J3")]
    estimate = found.final.estimates["J3.coupling.k"]
    assert abs(estimate.value - 8e-4) < 3.5 * estimate.std < 2e-4


@pytest.mark.thorough
def test_the_scale_of_one_axis_of_an_instrument_is_named():
    data = measured(WRIST, FRAME | {"instrument_axis_scales.y": 2e-4}, 120, 7)
    found = diagnose(WRIST, data)
    assert [(step.effect.name, step.effect.place) for step in found.steps] == [
        ("instrument_axis_scales", None)
    ]
    assert found.rms.after < 0.7 * found.rms.before
    estimate = found.final.estimates["instrument_axis_scales.y"]
    assert abs(estimate.value - 2e-4) < 3.5 * estimate.std < 1e-4


def test_a_wrist_and_a_mount_without_errors_have_none():
    for of, effects in ((EQUATORIAL, {}), (WRIST, FRAME)):
        assert diagnose(of, measured(of, effects, 100, 8)).steps == ()
