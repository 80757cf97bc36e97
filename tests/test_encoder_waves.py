"""Several waves of one encoder beside a lag are found together."""

import numpy as np

import rodgen
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.selection import select
from rodgen.machines.machine import Machine

TABLE = """name = "Table"
units = { length = "mm", angle = "deg" }
joint = [{ name = "C", type = "revolute", axis = [0, 0, 1], point = [0, 0, 0] }]
target = [{ name = "ball", point = [200, 0, 50] }]
measured = { kind = "point", frame = "free" }
"""
WAVES = {1: (60, 30), 2: (20, -12), 4: (8, 9), 8: (6, -5)}
ARCSEC = np.pi / 648000


def test_one_two_four_and_eight_waves_a_turn_beside_a_lag(tmp_path):
    rng = np.random.default_rng(1)
    q, v = rng.uniform(-np.pi, np.pi, 300), np.radians(rng.choice([-10, -5, 0, 5, 10], 300))
    off = sum(a * np.cos(k * q) + b * np.sin(k * q) for k, (a, b) in WAVES.items()) * ARCSEC - 0.003 * v
    place = np.stack([200 * np.cos(q + off), 200 * np.sin(q + off), np.full(300, 50.0)], -1)
    table = np.column_stack([np.degrees(q), np.degrees(v), place + rng.normal(0, 0.001, place.shape)])
    (tmp_path / "machine.toml").write_text(TABLE)
    header = "C [deg],v_C [deg/s],x [mm],y [mm],z [mm]"
    np.savetxt(tmp_path / "data.csv", table, "%.7f", ",", header=header, comments="")
    fit = Machine.load(tmp_path / "machine.toml").fit(rodgen.Measurements.load(tmp_path / "data.csv"))
    names = {c.effect.name for c in select(Evidence.of(fit))}
    assert names == {"servo_lag", "encoder_eccentricity", "encoder_ellipticity", "encoder_harmonics"}
