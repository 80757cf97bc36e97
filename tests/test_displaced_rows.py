"""A stretch of stars that lies displaced, as when a mount was pushed and pushed back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hidden_effects import hidden

import rodgen
from rodgen.calibration.diagnose import diagnose

MACHINE = Path(__file__).parent.parent / "examples" / "machines" / "mount" / "machine.toml"
FIRST, COUNT, STARS = 30, 11, 80
ARCSEC = np.pi / 648000


def stars(tmp_path, shift, *, noted=False):
    """Diagnose stars of which eleven, one after the other, are off by `shift` arcsec."""
    rng = np.random.default_rng(1)
    az, el = np.radians(rng.uniform(0, 360, STARS)), np.radians(rng.uniform(20, 85, STARS))
    away = np.zeros((STARS, 3))
    away[FIRST : FIRST + COUNT] = shift * ARCSEC * np.array([0.6, -0.5, 0.62])
    u = np.stack([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)], axis=1)
    u += np.cross(away, u) + 0.8 * ARCSEC * rng.standard_normal(u.shape)
    u /= np.linalg.norm(u, axis=1)[:, None]
    lines = ["AZ [deg],EL [deg],ux,uy,uz" + (",run" if noted else "")]
    for i, (a, e, (x, y, z)) in enumerate(zip(np.degrees(az), np.degrees(el), u, strict=True)):
        run = f",{'B' if FIRST <= i < FIRST + COUNT else 'A'}" if noted else ""
        lines.append(f"{a:.6f},{e:.6f},{x:.9f},{y:.9f},{z:.9f}{run}")
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n")
    return diagnose(rodgen.Machine.load(MACHINE), rodgen.Measurements.load(tmp_path / "data.csv"))


@pytest.mark.parametrize("shift", [3.0, 60.0])
def test_a_displaced_stretch_is_told_with_its_lines(shift, tmp_path):
    found = stars(tmp_path, shift)
    assert found.steps == ()
    assert found.unexplained == ()
    notes = " ".join(found.notes)
    assert "from line 32 to line 42" in notes  # under the header
    assert "Note the set-ups in a column run" in notes
    assert found.outliers == (tuple(range(FIRST, FIRST + COUNT)) if shift > 10 else ())


@pytest.mark.parametrize("shift", [3.0, 60.0])
def test_it_is_a_shift_of_the_frame_once_set_ups_are_noted(shift, tmp_path):
    found = stars(tmp_path, shift, noted=True)
    assert [step.effect.title for step in found.steps] == ["frame_shift"]
    assert found.outliers == ()


@pytest.mark.parametrize("wanders", ["walk", "day"])
def test_a_set_up_that_wanders_is_not_displaced(wanders, tmp_path):
    machine, data = hidden("mount", 2, [], wanders=wanders).write(tmp_path)
    found = diagnose(rodgen.Machine.load(machine), rodgen.Measurements.load(data))
    assert "displaced" not in " ".join(found.notes)
    assert "wanders" in " ".join(found.notes)
