"""``rodgen import`` of ISO 230-2 tables and of a ballbar's circles: the fit finds what the deviations are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rodgen.data.measurements import Measurements
from rodgen.data.tables.foreign import read_foreign
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


def test_units_of_positions_and_of_deviations_are_one_option(tmp_path, rodgen_command: Run, refuses_command):
    (tmp_path / "m.toml").write_text(machine_template("linear-axis"))
    rows = [(0.0, 0.0), (50.0, 12.0), (100.0, 20.0)]
    files = {}
    for name, header in (("with", "X [cm],deviation [um]"), ("without", "X,deviation")):
        files[name] = tmp_path / f"{name}.csv"
        files[name].write_text(f"{header}\n" + "".join(f"{p},{d}\n" for p, d in rows))
    command = ("import", tmp_path / "m.toml")
    assert rodgen_command(*command, files["with"], "-d", tmp_path / "a.csv")[0] == 0
    code, _, err = rodgen_command(
        *command, files["without"], "-d", tmp_path / "b.csv", "--units", "cm,deg,um"
    )
    assert (code, err) == (0, "")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    for units in ("cm,deg", "cm,deg,s"):
        refuses_command(*command, files["without"], "-d", tmp_path / "c.csv", "--units", units)


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
    ("header", "option"),
    [
        ("angle [deg],length [um]", "XX=150mm"),
        ("angle [deg],height [um]", "XY=150mm"),
        ("angle [mm],radius [mm]", "XY=150mm"),
        ("angle [deg],radius", "XY=150mm"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(header, option, tmp_path, refuses_command):
    (tmp_path / "t.csv").write_text(f"{header}\n0,150\n90,150\n")
    refuses_command("import", BALLBAR, tmp_path / "t.csv", "-d", tmp_path / "d.csv", "--ballbar", option)


RTL = """HEADER::
File type  : rtl
Owner      : Linear

TARGET DATA::
Filetype  : ISO
Target-count: 6
Targets :
0.000  100.000  200.000  300.000  400.000
500.000
Flags: 0 0 2 0

USER-TEXT::
Machine: VMC
Axis:X axis

RUNS::
Run-count:2

DEVIATIONS::
Run Target Data:
{rows}
ENVIRONMENT::
Air temp   : 20.1

EOF::
"""


@pytest.mark.parametrize("form", ["rtl", "text"])
def test_a_laser_s_own_file_is_the_axis_it_was_made_of(form, tmp_path, rodgen_command: Run, refuses_command):
    positions = np.arange(0, 600, 100)
    if form == "rtl":
        order = [(1, k, 1) for k in range(6)] + [(2, k, -1) for k in range(5, -1, -1)]
        rows = "\n".join(
            f"{run}   {k + 1}      {deviations(positions[k], way, run):.3f}" for run, k, way in order
        )
        (tmp_path / "laser.rtl").write_text(RTL.format(rows=rows + "\n"))
    else:
        lines = [f"{p}\t{deviations(p, 1, 1):.3f}\t{deviations(p, -1, 2):.3f}" for p in positions]
        header = "Report\n; made by a laser; do not edit\n\nTarget (mm)\tRun 1 + (µm)\tRun 2 - (µm)\n"
        (tmp_path / "laser.rtl").write_text(header + "\n".join(lines) + "\n")
    (tmp_path / "m.toml").write_text(machine_template("linear-axis"))
    data = tmp_path / "d.csv"
    code, _, err = rodgen_command("import", tmp_path / "m.toml", tmp_path / "laser.rtl", "-d", data)
    assert (code, err) == (0, "")
    table = Measurements.load(data)
    assert table.columns["X"].values.tolist() == [*positions, *positions[::-1]]
    assert table.columns["dir_X"].values.tolist() == [1.0] * 6 + [-1.0] * 6
    off = table.columns["d"].values - 500 - table.columns["X"].values
    assert 1000 * off[:6] == pytest.approx(deviations(positions, 1, 1), abs=1e-3)
    assert 1000 * off[6:] == pytest.approx(deviations(positions[::-1], -1, 2), abs=1e-3)
    (tmp_path / "m.toml").write_text(machine_template("3-axis"))
    refuses_command("import", tmp_path / "m.toml", tmp_path / "laser.rtl", "-d", data)


@pytest.mark.parametrize(("old", "new"), [("1 0.5", "1 x"), ("1 0.5", "7 0.5")])
def test_a_damaged_file_of_a_laser_says_where(refuses, old, new, tmp_path):
    (tmp_path / "laser.rtl").write_text(RTL.format(rows="1 1 0.5\n").replace(old, new))
    refuses(read_foreign, tmp_path / "laser.rtl")


def test_a_machine_tool_for_a_ballbar_needs_no_editor(tmp_path, rodgen_command: Run, refuses_command):
    machine, data = tmp_path / "m.toml", tmp_path / "d.csv"
    assert rodgen_command("new", "3-axis", "--ballbar", "-o", machine)[0] == 0
    angle = np.arange(0, 360, 10)
    x, y = 150 * np.cos(np.radians(angle)), 150 * np.sin(np.radians(angle))
    off = 1000 * (np.hypot(x + 80e-6 * y, y) - 150)
    lines = [f"{a:.1f}       {d:.4f}" for a, d in zip(angle, off, strict=True)]
    (tmp_path / "bar.txt").write_text(
        "; a ballbar; 150 mm\nANGLE     R-DEV\n[deg]     [um]\n" + "\n".join(lines)
    )
    files = machine, tmp_path / "bar.txt", "-d", data
    code, _, err = rodgen_command("import", *files, "--ballbar", "XY=150mm")
    assert (code, err) == (0, "")
    fit = Machine.load(machine).fit(Measurements.load(data))
    assert abs(fit.estimates["Y.axis.a"].value) == pytest.approx(3600 * np.degrees(80e-6), rel=0.01)
    refuses_command("new", "turntable", "--ballbar")


def test_an_option_says_which_axis_the_positions_are_of(tmp_path, rodgen_command: Run, refuses_command):
    (tmp_path / "m.toml").write_text(machine_template("3-axis", ballbar=True))
    (tmp_path / "iso.csv").write_text("Target (mm),1 + (um),1 - (um)\n0,1,2\n100,3,4\n")
    files = "import", tmp_path / "m.toml", tmp_path / "iso.csv", "-d", tmp_path / "d.csv"
    refuses_command(*files)
    code, out, err = rodgen_command(*files, "--column", "Y=Target")
    assert (code, err) == (0, "")
    assert "Deviations at positions of Y, 2 runs" in out
    table = Measurements.load(tmp_path / "d.csv")
    assert table.columns["Y"].values.tolist() == [0, 100, 100, 0]
    assert table.columns["d"].values == pytest.approx([0.001, 100.003, 100.004, 0.002])
