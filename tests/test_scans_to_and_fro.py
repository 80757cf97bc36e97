"""Play shows in a scan to and fro: the order of the rows says from which side each position was approached."""

from pathlib import Path

import numpy as np
import pytest

import rodgen
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.selection import select
from rodgen.machines.machine import Machine

ANTENNA = """name = "Antenna"
units = { length = "mm", angle = "deg" }
joint = [
  { name = "AZ", type = "revolute", axis = [0, 0, -1] },
  { name = "EL", type = "revolute", axis = [1, 0, 0] },
]
target = [{ name = "beam", point = [0, 1, 0] }]
measured = { kind = "direction", frame = "free" }
"""
ARCSEC = np.pi / 648000


def scan(folder: Path, play: float, *, shuffled: bool = False):
    """Write directions of an antenna that sweeps its azimuth to and fro, and stays behind by half of the play."""
    rng = np.random.default_rng(5)
    line = np.linspace(-100, 100, 12)
    az = np.concatenate([line if k % 2 == 0 else line[::-1] for k in range(8)])
    el = np.repeat(10 + 8 * np.arange(8), 12)
    side = np.sign(np.diff(az, prepend=az[0]))
    for i in range(len(side)):  # where only the elevation moved, the azimuth leans to the side of before
        side[i] = side[i] or (side[i - 1] if i else 1)
    a, e = np.radians(az) - side * play / 2 * ARCSEC, np.radians(el)
    u = np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], -1)
    u += rng.normal(size=u.shape) * 2 * ARCSEC
    table = np.column_stack([az, el, u / np.linalg.norm(u, axis=1, keepdims=True)])
    if shuffled:
        rng.shuffle(table)
    (folder / "machine.toml").write_text(ANTENNA)
    np.savetxt(folder / "data.csv", table, "%.9f", ",", header="AZ [deg],EL [deg],ux,uy,uz", comments="")
    data = rodgen.Measurements.load(folder / "data.csv")
    return Machine.load(folder / "machine.toml").fit(data)


def test_play_shows_in_a_scan_of_directions(tmp_path):
    fit = scan(tmp_path, 20.0)
    assert fit.observations.approach_assumed.tolist() == [True, False]
    evidence = Evidence.of(fit)
    assert [c.key for c in select(evidence)] == [("backlash", "AZ")]
    (one,) = (c for c in evidence.candidates if c.key == ("backlash", "AZ"))
    assert one.prior.log_odds == pytest.approx(np.log(0.2 * 0.1))  # of a telescope, as far as the order tells
    assert [c.key for c in select(Evidence.of(scan(tmp_path, 0.0)))] == []


def test_directions_in_any_order_are_no_scan(tmp_path):
    assert not scan(tmp_path, 20.0, shuffled=True).observations.approach_assumed.any()
