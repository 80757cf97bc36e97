"""The example machines: make_data.py reproduces their data without rodgen, and they lack the effects of ANSWERS.md."""

from __future__ import annotations

import csv
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from parallel_simulator import LEGS

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples" / "machines"
MADE = sorted(path.parent.name for path in EXAMPLES.glob("*/data.csv"))


def read(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    return header, rows


def test_data_are_what_the_script_makes_without_rodgen(tmp_path: Path) -> None:
    script = (
        f"import sys, runpy; sys.modules['rodgen'] = None; sys.argv = ['make_data.py', {str(tmp_path)!r}]\n"
    )
    script += f"runpy.run_path({str(EXAMPLES / 'make_data.py')!r}, run_name='__main__')"
    subprocess.run([sys.executable, "-c", script], check=True)
    for name in MADE:
        header, rows = read(EXAMPLES / name / "data.csv")
        made_header, made = read(tmp_path / name / "data.csv")
        assert made_header == header
        assert len(made) == len(rows)
        for row, made_row in zip(rows, made, strict=True):
            for cell, made_cell in zip(row, made_row, strict=True):
                # another processor's last bit may round a figure the other way
                unit_of_last = 10.0 ** -len(cell.partition(".")[2])
                assert cell == made_cell or abs(float(cell) - float(made_cell)) < 1.5 * unit_of_last


@pytest.mark.parametrize("name", sorted(path.parent.name for path in EXAMPLES.glob("*/machine.toml")))
def test_files_are_small_fit_together_and_do_not_tell(name: str) -> None:
    text = (EXAMPLES / name / "machine.toml").read_text(encoding="utf-8")
    machine = tomllib.loads(text)
    assert text.startswith("# ")
    (data,) = (EXAMPLES / name).glob("*.csv")
    header, rows = read(data)
    assert 80 <= len(rows) <= 600
    for joint in machine.get("joint", []):
        unit = machine["units"]["length" if joint["type"] == "prismatic" else "angle"]
        is_read = "coordinate" not in joint or "reading" in joint
        assert (f"{joint.get('reading', joint['name'])} [{unit}]" in header) == is_read
    for leg in LEGS.get(machine.get("family"), ()):
        assert f"{leg} [{machine['units']['length']}]" in header
    assert {"target", "ux", "d [mm]"} & {*header} or len(machine["target"]) == 1
    assert all(
        effect["name"] == "scale" and set(effect["hold"]) == {"k"} for effect in machine.get("effect", [])
    )
    assert not {
        "eccentric",
        "backlash",
        "warm",
        "drift",
        "windup",
        "squareness",
        "tilt",
        "expansion",
        "offset",
    } & {*text.lower().split()}


FOUND_BY: dict[
    str, dict[str, float]
] = {  # start values of what ANSWERS.md names, in units of the machine file
    "gantry_rotary": {"C.encoder_eccentricity.a": 0, "C.encoder_eccentricity.b": 0},
    "rotary_table": {f"C.tilt_error_motion.{x}": 0 for x in ("u_c2", "u_s2", "v_c2", "v_s2")},
    "trunnion": {**{f"warm_up_drift.{x}": 0.01 for x in "xyz"}, "warm_up_drift.tau": 1000},
    "positioner": {"phi.backlash.b": 0},
    "robot_6r_tracker": {"J2.gravity_windup.k": 0},
    "ballbar_gantry": {"Y.squareness.a": 0, "Y.squareness.b": 0},
    "tricept": {"A1.leg_thermal_expansion.alpha": 0},
    "palletiser": {"J2.backlash.b": 0},
    "three_sps_s": {f"L2.platform_joint_offset.{x}": 0 for x in "xyz"},
}


@pytest.mark.thorough("ballbar_gantry", "positioner")
@pytest.mark.parametrize("name", MADE)
def test_what_is_missing_explains_the_data_to_the_noise(name: str) -> None:
    script = runpy.run_path(str(EXAMPLES / "make_data.py"))
    example = script[name]()
    q, conditions = example.rows()
    header, rows = read(EXAMPLES / name / "data.csv")
    columns = [i for i, cell in enumerate(header) if cell.split(" ")[0] in {"x", "y", "z", "d"}]
    reading = np.array([[float(row[i]) for i in columns] for row in rows])
    sigma = np.broadcast_to(np.asarray(example.noise, dtype=float), reading.shape)
    # A zero offset turns all that follows about its joint, so free axes and targets make it up: it is not estimated.
    fixed = {key: value for key, value in example.drawn_wrong.items() if "zero_offset" in key}
    base = {key: value for key, value in example.drawn_wrong.items() if key not in fixed}

    def chi(effects: dict[str, Any]) -> float:
        """Give the weighted root mean square after a fit of these effects, by Gauss's steps from near the truth."""
        keys = [*base, *effects]
        most = 4 if any(key.endswith("tau") for key in effects) else 1
        x = np.array([*base.values(), *effects.values()])

        def residual(x: np.ndarray) -> np.ndarray:
            machine = script["simulated"](name, fixed | dict(zip(keys, x, strict=True)))
            return ((reading - machine.measure(q, **conditions)) / sigma).ravel()

        for number in range(4):
            r, step = residual(x), 1e-4
            if number < most:  # all but time constants is nearly linear
                jacobian = np.stack(
                    [(residual(x + step * e) - residual(x - step * e)) / (2 * step) for e in np.eye(len(x))],
                    axis=-1,
                )
                size = np.linalg.norm(jacobian, axis=0)
            x = x - np.linalg.lstsq(jacobian / size, r, rcond=1e-4)[0] / size  # none along gauge
        return float(np.sqrt(residual(x) @ residual(x) / (reading.size - len(x))))

    # Of about 500 scalar readings the root mean square scatters by 1 / sqrt(1000) = 3 %.
    assert chi(FOUND_BY[name]) == pytest.approx(1, abs=0.1)
    assert chi({}) > 1.5
