"""The simulator of study/physics: machines without a hidden effect reach their noise, and draws come again.

Numbers of parts are those of a hand: an eccentric disc of 10 µm on a radius of 50 mm is off by 41.25″.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "study"))

from physics import parts
from physics.draws import Draw, drawn, error, loaded, named, with_effects

INNOCENT = ["few poses", "runs with remounted targets", "repeated positions"]


def spread(draw: Draw) -> tuple[float, int]:
    """Return the error of a fit of the file to the readings, over the stated noise, and the degrees of freedom."""
    fitted = loaded(draw.machine).fit(draw.data)
    noise = draw.sigma * (np.pi / 180 if fitted.unit == "arcsec" else 1.0)
    share = fitted.residuals.size / fitted.degrees_of_freedom
    return fitted.rms * fitted.unit_factor / noise * np.sqrt(share), fitted.degrees_of_freedom


@pytest.mark.parametrize("group", INNOCENT)
def test_an_innocent_machine_reaches_its_noise(group: str) -> None:
    draw = drawn(*named(f"innocent: {group} 0"))
    over, freedoms = spread(draw)
    assert draw.truth == ()
    assert abs(over - 1) < 4 / np.sqrt(2 * freedoms)  # four standard deviations
    assert 0.8 < error(loaded(draw.machine).fit(draw.data), draw.further, draw) < 1.4


@pytest.mark.parametrize("number", [2, 5])
def test_the_file_lacks_the_hidden_effect_and_nothing_else(number: int) -> None:
    draw = drawn(*named(f"one effect: RMS x 2 {number}"))
    over, freedoms = spread(draw)
    assert abs(over / 2 - 1) < 4 / np.sqrt(2 * freedoms)
    machine = with_effects(loaded(draw.machine), draw.truth)
    fitted = machine.fit(draw.noiseless)
    noise = draw.sigma * (np.pi / 180 if fitted.unit == "arcsec" else 1.0)
    assert fitted.rms * fitted.unit_factor / noise < 0.1
    name, _ = draw.truth[0]
    assert f'name = "{name}"' not in draw.machine
    assert {key.split(".")[-1] for key in draw.values} <= {key.split(".")[-1] for key in fitted.estimates}


def test_a_draw_comes_again() -> None:
    one, again, other = (drawn(*named(f"one effect, wandering: RMS x 2 {k}")) for k in (3, 3, 4))
    assert one.machine == again.machine
    assert all(np.array_equal(one.data[key], again.data[key]) for key in one.data)
    assert other.machine != one.machine


def test_an_eccentric_disc_is_off_once_a_turn() -> None:
    off = parts.eccentric_disc(np.linspace(0, 2 * np.pi, 361), 50.0, 0.01, 0.0) / parts.ARCSEC
    assert np.abs(off).max() == pytest.approx(41.25, abs=0.02)
    assert off[0] == pytest.approx(0, abs=1e-9)


def test_air_lifts_by_a_minute_at_half_height() -> None:
    lifted = parts.air(np.deg2rad(np.array([0.0, 45.0]))) / parts.ARCSEC
    assert lifted == pytest.approx([0, 57.0], abs=0.1)  # (n - 1) tan z less the curvature of the earth


def test_a_part_stays_in_its_play() -> None:
    assert parts.play(np.array([0.0, 1, 0.8, 0.2, 2]), 1.0).tolist() == [0, 0.5, 0.5, 0.5, 1.5]
