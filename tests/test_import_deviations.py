"""``rodgen import`` of ISO 230-2 tables and of a ballbar's circles: the fit finds what the deviations are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rodgen.data.measurements import Measurements
from rodgen.machines.fixed import fixed_machine
from rodgen.machines.machine import Machine
from rodgen.machines.templates import machine_template

Run = Callable[..., tuple[int, str, str]]
BALLBAR = Path(__file__).parent.parent / "examples" / "machines" / "ballbar_gantry" / "machine.toml"


def deviations(position, way, run):
    """Of an axis that is 20 ppm long and has 6 um of lost motion, um: half of it is missing on each way."""
    return 0.02 * position - 3.0 * way + 0.01 * run


def test_an_iso_230_2_table_is_the_axis_it_was_made_of(tmp_path, rodgen_command: Run):
    positions = np.linspace(0, 1000, 11)
    header = "No.,Target position [mm]," + ",".join(
        f"{run} {way} [um]" for run in (1, 2, 3) for way in ("↑", "↓")
    )
    lines = [
        f"{k},{p:g}," + ",".join(f"{deviations(p, way, run):.3f}" for run in (1, 2, 3) for way in (1, -1))
        for k, p in enumerate(positions)
    ]
    (tmp_path / "iso.csv").write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    (tmp_path / "m.toml").write_text(machine_template("linear-axis"))
    data = tmp_path / "d.csv"
    code, out, err = rodgen_command("import", tmp_path / "m.toml", tmp_path / "iso.csv", "-d", data)
    assert (code, err) == (0, "")
    assert "Deviations at positions of X, 6 runs one after the other; as distances" in out
    table = Measurements.load(data)
    assert table.columns["X"].values[:11].tolist() == positions.tolist()
    assert table.columns["X"].values[11:22].tolist() == positions[::-1].tolist()
    assert table.columns["run"].values[::11].tolist() == ["1", "1", "2", "2", "3", "3"]
    machine = Machine.load(tmp_path / "m.toml").add("scale", joint="X").add("backlash", joint="X")
    found = machine.fit(table).estimates
    assert found["X.scale.k"].value == pytest.approx(20e-6, abs=1e-9)
    assert (
        1000 * found["X.backlash.b"].value == pytest.approx(6.0, abs=1e-3)
        or found["X.backlash.b"].unit == "um"
    )


@pytest.mark.parametrize("column", ["radius [mm]", "deviation [um]"])
def test_a_ballbar_s_circle_is_the_squareness_it_was_made_of(column, tmp_path, rodgen_command: Run):
    # Y leans towards X by 80 urad: a point that is commanded to (X, Y) is at (X + 80e-6 Y, Y)
    angle = np.radians(np.arange(0, 360, 10))
    x, y = 150 * np.cos(angle), 150 * np.sin(angle)
    radius = np.hypot(x + 80e-6 * y, y)
    cells = radius if column.startswith("radius") else 1000 * (radius - 150)
    text = f"angle [deg],{column}\n" + "".join(
        f"{np.degrees(a):.0f},{c:.9f}\n" for a, c in zip(angle, cells, strict=True)
    )
    (tmp_path / "xy.csv").write_text(text)
    machine = BALLBAR.read_text().replace('parameters = ["target"]', 'parameters = ["Y.axis", "target"]')
    (tmp_path / "m.toml").write_text(machine)
    data = tmp_path / "d.csv"
    code, out, err = rodgen_command(
        "import", tmp_path / "m.toml", tmp_path / "xy.csv", "-d", data, "--ballbar", "XY=150mm"
    )
    assert (code, err) == (0, "")
    assert "A circle of 150 mm in XY about [400.0, 300.0, -200.0]: angles are commands." in out
    table = Measurements.load(data)
    assert table.columns["X"].values == pytest.approx(400 + x, abs=1e-8)
    assert table.columns["Y"].values == pytest.approx(300 + y, abs=1e-8)
    assert set(table.columns["Z"].values) == {-200.0}
    fit = Machine.load(tmp_path / "m.toml").fit(table)
    assert fixed_machine(fit.machine).joint("Y").axis[0] == pytest.approx(80e-6, abs=1e-9)
    assert fit.rms < 1e-6


@pytest.mark.parametrize(
    ("header", "option", "expected"),
    [
        ("angle [deg],length [um]", "XX=150mm", "'XX=150mm' is not two axes and a radius, such as XY=150mm"),
        (
            "angle [deg],height [um]",
            "XY=150mm",
            "header: columns 'angle [deg]' or 'height [um]'; expected angle, and",
        ),
        (
            "angle [mm],radius [mm]",
            "XY=150mm",
            "column 'angle [mm]': unit 'mm', which is not a unit of angle",
        ),
        ("angle [deg],radius", "XY=150mm", "column 'radius': no unit; expected its unit in brackets"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(header, option, expected, tmp_path, rodgen_command: Run):
    (tmp_path / "t.csv").write_text(f"{header}\n0,150\n90,150\n")
    code, _, err = rodgen_command(
        "import", BALLBAR, tmp_path / "t.csv", "-d", tmp_path / "d.csv", "--ballbar", option
    )
    assert code == 2
    assert expected in err
    assert err.count("\n") == 1
