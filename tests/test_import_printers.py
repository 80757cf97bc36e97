"""Printers' own files: the printer.cfg of Klipper and logs of probe heights, of a printer by plain NumPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from delta_cases import PRINTER, L, R, commanded, hung, probed, spiral
from scipy.optimize import brentq

from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.fit import fit
from rodgen.data.measurements import Measurements
from rodgen.machines.imports.imported import Imported
from rodgen.machines.imports.printers import is_printer, is_probe_log, machine_from_klipper, with_probe_log
from rodgen.machines.machine import Machine

Run = Callable[..., tuple[int, str, str]]

STEP = 40 / (200 * 16) / (80 / 16)
ENDSTOP = 297.5
CONFIG = """# a comment
[printer]
kinematics: delta
delta_radius: 140.0   # mm

[stepper_a]
microsteps: 16
rotation_distance = 40
gear_ratio: 80:16
position_endstop: 297.5
arm_length: 290.0
[stepper_b]
microsteps: 16
gear_ratio: 80:16
[stepper_c]
microsteps: 16
gear_ratio: 80:16
angle: 90
[gcode_macro HOME]
gcode:
    {% if printer.toolhead %}
    G28
    {% endif %}
"""
MARK = "#*# <--- SAVE_CONFIG --->\n#*# DO NOT EDIT THIS BLOCK\n#*#\n"


def carriages(count: int = 30) -> np.ndarray:
    rows = probed(count, offset=[0, 0.45, 0], radius=R + 0.8, noise=0.005)
    return np.stack([rows[f"{tower} [mm]"] for tower in "ABC"], axis=1)


def saved(q: np.ndarray, more: str = "") -> str:
    """What Klipper writes: positions in steps down from the endstops."""
    steps = (ENDSTOP + np.sqrt(L**2 - R**2) - q) / STEP
    lines = [f"height{k} = 0.0\nheight{k}_pos = {a:.3f},{b:.3f},{c:.3f}" for k, (a, b, c) in enumerate(steps)]
    text = "\n".join([more, "[delta_calibrate]", *lines, "distance0 = 74.1"])
    return MARK + "".join(f"#*# {line}\n" for line in text.splitlines())


def file(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def check_found(made: Imported) -> None:
    found = fit(made.machine.add("zero_offset", joint="B"), made.measurements())
    for key, value in {"geometry.R": 0.8, "B.zero_offset.a": 0.45}.items():
        assert abs(found.estimates[key].value - value) < 4 * found.estimates[key].std
    assert found.rms < 0.009


def test_heights_that_klipper_saved_are_carriages(tmp_path: Path):
    q = carriages()
    path = file(tmp_path, "printer.cfg", CONFIG + saved(q))
    assert is_printer(path.read_bytes())
    made = machine_from_klipper(path)
    read = np.stack([made.columns[f"{tower} [mm]"] for tower in "ABC"], axis=1)
    assert np.abs(read - q).max() < STEP  # three decimals of a step
    assert not np.any(made.columns["d [mm]"])
    assert (made.machine.kinematics.number("R"), made.machine.kinematics.number("L")) == ((R,), (L,))
    assert not made.machine.effects
    check_found(made)


def test_what_a_calibration_changed_is_the_machines(tmp_path: Path):
    """Saved values overrule those above; rods of their own are held, angles of their own are estimated."""
    more = "[printer]\ndelta_radius = 141.25\n[stepper_b]\nangle = 330.4\narm_length = 290.3"
    made = machine_from_klipper(file(tmp_path, "printer.cfg", CONFIG + saved(carriages(), more)))
    assert made.machine.kinematics.number("R") == (141.25,)
    effects = {effect.title: dict(effect.hold) for effect in made.machine.effects}
    assert effects == {"rod_length at B": {"a": pytest.approx(0.3)}, "delta_angle at B": {}}


def touches(q: np.ndarray) -> list[tuple[float, float, float]]:
    """Where the firmware believes the nozzle is: by SciPy."""
    at = np.radians(PRINTER)
    joints = [np.stack([R * np.cos(at), R * np.sin(at), row], axis=1) for row in q]
    x = [hung(each, L, [0, 0, 0]) for each in joints]
    return [(float(a), float(b), float(c)) for a, b, c in x]


@pytest.mark.parametrize(
    "form", ["probe at {:.4f},{:.4f} is z={:.6f}", "Recv: Bed X: {:.4f} Y: {:.4f} Z: {:.5f}"]
)
def test_a_log_of_touches_becomes_carriages(form, tmp_path: Path):
    q = carriages()
    lines = ["// 12:01", *(form.format(*touch) for touch in touches(q)), "ok"]
    log = file(tmp_path, "probe.log", "\n".join(lines))
    assert is_probe_log(log.read_bytes())
    config = file(tmp_path, "printer.cfg", CONFIG)
    made = with_probe_log(machine_from_klipper(config), log, str(config))
    read = np.stack([made.columns[f"{tower} [mm]"] for tower in "ABC"], axis=1)
    assert np.abs(read - q).max() < 1e-4
    assert made.places[0] == "line 2"
    check_found(made)


def test_a_log_of_touches_becomes_angles_of_arms(tmp_path: Path):
    """By Klipper's published geometry, whose angles are positive upwards, solved by SciPy arm by arm."""
    arms, rods, headings, radius, height = [170.0, 170.6, 170.0], 320.0, [30.0, 151.0, 270.0], 33.9, 412.9
    config = f"[printer]\nkinematics: rotary_delta\nshoulder_radius: {radius}\nshoulder_height: {height}\n"
    for letter, arm, at in zip("abc", arms, headings, strict=True):
        config += f"[stepper_{letter}]\nupper_arm_length: {arm}\nlower_arm_length: {rods}\nangle: {at}\n"
    places = np.random.default_rng(4).uniform([-60, -60, -0.3], [60, 60, 0.3], (12, 3)).round(6)

    def angle(place: np.ndarray, arm: float, at: float) -> float:
        c, s = np.cos(np.radians(at)), np.sin(np.radians(at))
        out, across = place[0] * c + place[1] * s - radius, place[1] * c - place[0] * s

        def left(q: float) -> float:
            return (
                (out - arm * np.cos(q)) ** 2
                + across**2
                + (place[2] - height - arm * np.sin(q)) ** 2
                - rods**2
            )

        return float(np.degrees(brentq(left, -1.5, 1.0)))

    expected = [[-angle(place, arm, at) for arm, at in zip(arms, headings, strict=True)] for place in places]
    printer = file(tmp_path, "printer.cfg", config)
    log = file(
        tmp_path, "probe.log", "\n".join("probe at {:.6f},{:.6f} is z={:.6f}".format(*p) for p in places)
    )
    assert is_printer(printer.read_bytes())
    made = with_probe_log(machine_from_klipper(printer), log, str(printer))
    read = np.stack([made.columns[f"A{k} [deg]"] for k in (1, 2, 3)], axis=1)
    np.testing.assert_allclose(read, expected, atol=1e-6)  # six decimals are written
    assert [effect.title for effect in made.machine.effects] == ["arm_length at A2", "delta_angle at A2"]
    # the nozzle of the machine is on the plate where the log says 0, once the angle of the arm is right
    columns = {**made.columns, "d [mm]": places[:, 2]}
    found = fit(replace(made.machine, estimate=()), Measurements.from_frame(columns))
    assert found.rms < 1e-5
    assert found.estimates["A2.delta_angle.a"].value == pytest.approx(1.0, abs=1e-4)


def test_a_height_map_is_read_by_rows(tmp_path: Path):
    head = "RepRapFirmware height map file v2 generated at 2020\n"
    head += (
        "axis0,axis1,min0,max0,min1,max1,radius,spacing0,spacing1,num0,num1\nX,Y,-50,50,-20,20,80,50,40,3,2\n"
    )
    log = file(tmp_path, "heightmap.csv", head + "  0.100, -0.050,      0\n 0.000,  0.020,  0.030\n")
    assert is_probe_log(log.read_bytes())
    made = with_probe_log(machine_from_klipper(file(tmp_path, "p.cfg", CONFIG)), log)
    expected = [commanded(-50, -20, 0.1), commanded(0, -20, -0.05)]
    expected += [commanded(x, 20, z) for x, z in zip((-50, 0, 50), (0, 0.02, 0.03), strict=True)]
    read = np.stack([made.columns[f"{tower} [mm]"] for tower in "ABC"], axis=1)
    assert np.abs(read - expected).max() < 1e-6  # six decimals


@pytest.mark.parametrize(
    "change",
    [
        ("delta_radius: 140.0", "delta_radius: wide"),
        ("arm_length: 290.0", ""),
        ("arm_length: 290.0", "arm_length: 100"),
        ("rotation_distance = 40", ""),
        ("gear_ratio: 80:16", "gear_ratio: 80:0"),
        ("# a comment", "a line alone"),
    ],
)
def test_a_wrong_printer_file_is_one_clear_line(refuses, change, tmp_path: Path):
    path = file(tmp_path, "printer.cfg", CONFIG.replace(*change, 1) + saved(carriages(3)))
    refuses(machine_from_klipper, path)


def test_a_touch_out_of_reach_has_its_line(refuses, tmp_path: Path):
    log = file(tmp_path, "probe.log", "probe at 0,0 is z=0.1\nprobe at 900,0 is z=0.1\n")
    refuses(with_probe_log, machine_from_klipper(file(tmp_path, "p.cfg", CONFIG)), log)


EXAMPLE = Path(__file__).parent.parent / "examples" / "delta_printer"


@pytest.mark.thorough
def test_the_example_is_a_printer_with_three_errors():
    """The log is that of a printer by plain NumPy; a diagnosis finds what is wrong with it."""
    log, config = EXAMPLE / "probe.log", EXAMPLE / "printer.cfg"
    wrong = {"offset": [0, 0.42, 0], "heading": PRINTER + 0.38 * np.eye(3)[1], "radius": R + 0.9}
    rows = probed(40, **wrong, noise=0.012, seed=7)
    made = with_probe_log(machine_from_klipper(config), log, str(config))
    for tower in "ABC":
        key = f"{tower} [mm]"
        assert np.abs(made.columns[key] - rows[key]).max() < 2e-3  # three decimals of x and y
    found = diagnose(made.machine, made.measurements())
    assert {(s.effect.name, s.effect.place) for s in found.steps} == {
        ("zero_offset", "B"),
        ("delta_angle", "B"),
    }
    for key, value in {"geometry.R": 0.9, "B.zero_offset.a": 0.42, "B.delta_angle.a": 0.38}.items():
        assert abs(found.estimates[key].value - value) < 4 * found.estimates[key].std


def test_the_command_makes_both_files(rodgen_command: Run, refuses_command, tmp_path: Path):
    config = file(tmp_path, "printer.cfg", CONFIG)
    log = file(tmp_path, "k.log", "".join(f"probe at {x:.3f},{y:.3f} is z=0.1\n" for x, y in spiral(12, 80)))
    made = ["-o", tmp_path / "m.toml", "-d", tmp_path / "d.csv"]
    code, out, _ = rodgen_command("import", config, log, *made)
    assert code == 0
    assert "12 touches" in out
    assert Machine.load(tmp_path / "m.toml").kinematics.family == "linear-delta"
    assert (tmp_path / "d.csv").read_text().startswith("A [mm],B [mm],C [mm],d [mm]")
    refuses_command("import", log, "-d", tmp_path / "e.csv")
