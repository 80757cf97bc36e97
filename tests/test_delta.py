"""Deltas against plain NumPy: direct and inverse problem, models, a printer's probe log, emitted code."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from delta_cases import (
    ARM,
    PRINTER,
    R_OF_ROBOT,
    ROBOT,
    ROD,
    TARGET,
    UP,
    L,
    R,
    carriage_joints,
    commanded,
    elbows,
    hung,
    probed,
    spiral,
)
from emitted_code import Compiled, emit_both, loaded, passes_in_python
from machine_cases import toml

from rodgen import delta
from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.fit import fit
from rodgen.calibration.problem.binding import bind
from rodgen.calibration.problem.problem import Problem
from rodgen.data.measurements import Measurements
from rodgen.kinematics.delta import DeltaStatus
from rodgen.machines.emit import emit
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model

# the kernels -----------------------------------------------------------------------------------------------------


def test_a_printers_platform_is_where_the_rods_meet():
    random = np.random.default_rng(1)
    geometry = delta.LinearGeometry((140.0, 141, 139), (290.0, 291, 289), (209.5, 330.5, 90))
    place = np.column_stack([spiral(12, 110), random.uniform(-20, 60, 12)])
    q, status = delta.linear_inverse(place, geometry)
    assert (status == DeltaStatus.SOLVED).all()
    found, residual, status = delta.linear_direct(q, geometry)
    assert (status == DeltaStatus.SOLVED).all()
    assert residual.max() < 1e-12  # a few roundings of 300
    assert np.abs(found - place).max() < 1e-11  # these over the least singular value, 0.3
    joints = carriage_joints(q[0], np.array(geometry.radius), geometry.heading)
    assert np.abs(hung(joints, geometry.rod, [0, 0, -50]) - place[0]).max() < 1e-8


def test_a_robots_platform_is_where_the_rods_meet():
    geometry = delta.RotaryGeometry((140.0, 141, 139), (300.0, 301, 299), (750.0, 751, 749), (0.5, 120, 240))
    q = np.random.default_rng(2).uniform(-0.8, 0.8, (12, 3))
    found, residual, status = delta.rotary_direct(q, geometry)
    assert (status == DeltaStatus.SOLVED).all()
    assert residual.max() < 2e-12
    joints = elbows(q[0], np.array(geometry.radius), np.array(geometry.arm), geometry.heading)
    assert np.abs(hung(joints, geometry.rod, [0, 0, -900]) - found[0]).max() < 1e-7
    back, status = delta.rotary_inverse(found, geometry)
    assert (status == DeltaStatus.SOLVED).all()
    assert np.abs(back - q).max() < 1e-13 * 100  # as above, over an arm


def test_singular_positions_have_a_status():
    printer, robot = delta.LinearGeometry(R, L), delta.RotaryGeometry(R_OF_ROBOT, ARM, ROD)
    level = np.array([L - R, 0.0, 0.0])  # as far from a tower at -x as its rod is long
    cases = {
        DeltaStatus.SOLVED: commanded(0, 0, 0),
        DeltaStatus.UNREACHABLE: commanded(0, 0, 0) + 2 * L * UP,
        DeltaStatus.INVALID: commanded(0, 0, 0) * [1, np.nan, 1],
    }
    place, residual, status = delta.linear_direct(np.stack(list(cases.values())), printer)
    assert [DeltaStatus(s) for s in status] == list(cases)
    assert np.isfinite(place[0]).all()
    assert np.isnan(place[1:]).all()
    assert np.isnan(residual[1:]).all()
    # rods in the plane of the carriages; one above the other; a level rod; an arm in line with its rod
    flat = delta.LinearGeometry(R, R)
    assert delta.linear_direct([5, 5, 5], flat)[2] == DeltaStatus.SINGULAR
    assert np.abs(delta.linear_direct([5, 5, 5], flat)[0] - [0, 0, 5]).max() < 1e-5
    stacked = delta.LinearGeometry(R, L, (90.0, 90.0, 90.0))
    assert delta.linear_direct([0, 10, 20], stacked)[2] == DeltaStatus.COLLINEAR
    turned = delta.LinearGeometry(R, L, (180.0, 300.0, 60.0))
    assert delta.linear_inverse(level, turned)[1] == DeltaStatus.SINGULAR
    assert delta.linear_inverse(level * [1.01, 1, 1], turned)[1] == DeltaStatus.UNREACHABLE
    stretched = np.array([R_OF_ROBOT + (ARM + ROD) / np.sqrt(2), 0.0, -(ARM + ROD) / np.sqrt(2)])
    alone = delta.RotaryGeometry(R_OF_ROBOT, ARM, (ROD, 1200.0, 1200.0))
    angles, status = delta.rotary_inverse(stretched, alone)
    assert status == DeltaStatus.SINGULAR
    assert angles[0] == pytest.approx(np.pi / 4, abs=1e-6)
    assert delta.rotary_inverse(stretched * 1.01, alone)[1] == DeltaStatus.UNREACHABLE
    assert delta.rotary_inverse([np.nan, 0, 0], robot)[1] == DeltaStatus.INVALID


def test_near_a_flat_position_the_residual_stays_small():
    """The platform just below the plane of the carriages: positions lose digits, rods do not."""
    depth = 10.0 ** -np.arange(7)
    geometry = delta.LinearGeometry(R, L)
    for below in depth:
        near = delta.LinearGeometry(R, float(np.hypot(R, below)))
        place, residual, status = delta.linear_direct([0, 0, 0], near)
        assert status in (DeltaStatus.SOLVED, DeltaStatus.SINGULAR)
        assert residual < 1e-13 * R * 10
        # of the square of the height half a rounding of R² is lost
        assert abs(place[2] + below) < 40 * np.finfo(float).eps * R**2 / below
    assert np.linalg.svd(delta.rods([0, 0, 0], geometry))[1][-1] > 0.3


@pytest.mark.parametrize(
    ("family", "numbers"),
    [("linear-delta", {"L": 130.0}), ("rotary-delta", {"R": 900.0, "A": 100.0, "L": 790.0})],
)
def test_rods_that_do_not_reach_the_middle_are_named(refuses, family, numbers):
    """By Pythagoras: an arm drawn in begins R - A from the middle, a tower R."""
    file = machine_file(family, kind="point")
    file["geometry"] |= numbers
    refuses(machine_of, toml(file), "machine.toml")


def test_dimensions_that_are_none_are_named(refuses):
    refuses(delta.LinearGeometry, R, -1)
    refuses(delta.RotaryGeometry, R, float("nan"), ROD)


# the model -------------------------------------------------------------------------------------------------------


def machine_file(family: str, *, kind: str, estimate: Sequence[str] = (), **measured: Any) -> dict[str, Any]:
    effects = measured.pop("effects", [])
    numbers = {"R": R, "L": L} if family == "linear-delta" else {"R": R_OF_ROBOT, "A": ARM, "L": ROD}
    return {
        "name": "Delta",
        "family": family,
        "units": {"length": "mm", "angle": "deg"},
        "geometry": numbers,
        "target": [{"name": "nozzle", "point": [3.0, -2.0, -40.0] if kind == "point" else [0.0, 0.0, 0.0]}],
        "measured": {"kind": kind, "frame": "machine", **measured},
        "estimate": {"parameters": list(estimate)},
        "effect": [{"name": name, "joint": joint} for name, joint in effects],
    }


def machine(family: str = "linear-delta", **file: Any) -> Machine:
    return machine_of(toml(machine_file(family, **file)), "machine.toml")


def given(built: Machine, values: Mapping[str, float]) -> Machine:
    return replace(built, values={p.key: 0.0 for p in Model(built).parameters} | dict(values))


def problem_of(built: Machine, columns: Mapping[str, Any]) -> Problem:
    observations = bind(built, Measurements.from_frame(columns))
    return Problem(Model(built, observations.travel, observations.run_names), observations)


def rows_of(built: Machine, q: np.ndarray, **more: Any) -> dict[str, Any]:
    unit = "rad" if built.joints[0].revolute else "mm"
    columns: dict[str, Any] = {f"{j.name} [{unit}]": q[:, k] for k, j in enumerate(built.joints)}
    return columns | {f"{x} [mm]": np.zeros(len(q)) for x in "xyz"} | more


TOWERS = [
    ("zero_offset", "A"),
    ("scale", "B"),
    ("backlash", "C"),
    ("delta_radius", "A"),
    ("delta_angle", "B"),
    ("rod_length", "C"),
    ("tower_lean", "B"),
]


def test_the_model_is_the_printer_with_its_errors():
    random = np.random.default_rng(3)
    q = np.array([commanded(*p) for p in np.column_stack([spiral(5, 90), random.uniform(0, 60, 5)])])
    side = random.choice([-1.0, 1.0], 5)
    lean = np.radians([0.3, -0.2])
    values = {"geometry.R": 0.7, "geometry.L": -0.5, "A.zero_offset.a": 0.4, "B.scale.k": 1e-3}
    values |= {"C.backlash.b": 0.2, "A.delta_radius.r": -0.6, "B.delta_angle.a": np.radians(0.8)}
    values |= {"C.rod_length.a": 0.3, "B.tower_lean.a": lean[0], "B.tower_lean.b": lean[1]}
    built = given(machine(kind="point", estimate=["R", "L"], effects=TOWERS), values)
    problem = problem_of(built, rows_of(built, q, dir_C=side))
    expected = []
    for row, s in zip(q, side, strict=True):
        moved = row + np.array([0.4, 1e-3 * row[1], -0.1 * s])
        joints = carriage_joints(moved, R + 0.7 + np.array([-0.6, 0, 0]), PRINTER + np.array([0, 0.8, 0]))
        turn = np.radians(330.8)
        out, across = np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0])
        up = np.sqrt(1 - np.sin(lean) @ np.sin(lean))
        joints[1] += row[1] * (np.sin(lean[0]) * out + np.sin(lean[1]) * across + [0, 0, up - 1])
        expected.append(hung(joints, L - 0.5 + np.array([0, 0, 0.3]), [0, 0, 0]) + TARGET)
    place = problem.predicted(problem.model.start(), Frame.identity())
    assert np.abs(place - expected).max() < 1e-7  # of SciPy's solution


ARMS = [
    ("zero_offset", "A1"),
    ("scale", "A2"),
    ("delta_radius", "A3"),
    ("delta_angle", "A1"),
    ("rod_length", "A2"),
    ("arm_length", "A3"),
]


def test_the_model_is_the_robot_with_its_errors():
    q = np.random.default_rng(4).uniform(-0.6, 0.6, (5, 3))
    values = {"geometry.R": 0.7, "geometry.A": -0.4, "geometry.L": 0.5, "A1.zero_offset.a": 0.01}
    values |= {"A2.scale.k": 1e-3, "A3.delta_radius.r": -0.6, "A1.delta_angle.a": 0.012}
    values |= {"A2.rod_length.a": 0.3, "A3.arm_length.a": 0.25}
    built = given(machine("rotary-delta", kind="point", estimate=["geometry"], effects=ARMS), values)
    problem = problem_of(built, rows_of(built, q))
    radius, heading = R_OF_ROBOT + np.array([0.7, 0.7, 0.1]), ROBOT + np.array([np.degrees(0.012), 0, 0])
    arm, rod = ARM - 0.4 + np.array([0, 0, 0.25]), ROD + 0.5 + np.array([0, 0.3, 0])
    expected = [
        hung(elbows(row * [1, 1.001, 1] + [0.01, 0, 0], radius, arm, heading), rod, [0, 0, -800]) + TARGET
        for row in q
    ]
    place = problem.predicted(problem.model.start(), Frame.identity())
    assert np.abs(place - expected).max() < 1e-6


@pytest.mark.parametrize(("family", "effects"), [("linear-delta", TOWERS), ("rotary-delta", ARMS)])
def test_derivatives_are_those_of_differences(family, effects):
    built = machine(family, kind="point", estimate=["geometry", "target"], effects=effects)
    q = np.random.default_rng(5).uniform(-0.5, 0.5, (4, 3))
    if family == "linear-delta":
        q = commanded(0, 0, 0) + 60 * q
    problem = problem_of(built, rows_of(built, q, **({"dir_C": np.ones(4)} if family[0] == "l" else {})))
    theta, frame = problem.model.start(), Frame.identity()
    jacobian = problem.jacobian(theta, frame)
    for k in range(len(theta)):
        h = 1e-5 * np.eye(len(theta))[k]
        slope = (problem.residuals(theta + h, frame) - problem.residuals(theta - h, frame)) / 2e-5
        assert np.abs(jacobian[..., k] - slope).max() < 1e-5 * np.abs(slope).max()


# a printer's probe log -------------------------------------------------------------------------------------------


def printer(estimate: Sequence[str] = ("R",), **measured: Any) -> Machine:
    return machine(kind="height", estimate=estimate, **{"noise": 0.012, **measured})


@pytest.mark.thorough
def test_a_probe_log_shows_endstop_angle_and_radius():
    rows = probed(offset=[0, 0.45, 0], heading=PRINTER + np.array([0, 0.35, 0]), radius=R + 0.8)
    found = diagnose(printer(), Measurements.from_frame(rows))
    steps = {(step.effect.name, step.effect.place): step for step in found.steps}
    assert steps.keys() == {("zero_offset", "B"), ("delta_angle", "B")}
    assert found.fits[-1].rms == pytest.approx(0.012, rel=0.35)  # three deviations of 44 readings
    truth = {"geometry.R": 0.8, "B.zero_offset.a": 0.45, "B.delta_angle.a": 0.35}
    for key, value in truth.items():
        estimate = found.estimates[key]
        assert abs(estimate.value - value) < 4 * estimate.std


@pytest.mark.thorough
def test_one_endstop_alone_is_one_step():
    found = diagnose(printer(), Measurements.from_frame(probed(offset=[-0.3, 0, 0])))
    assert [(step.effect.name, step.effect.place) for step in found.steps] == [("zero_offset", "A")]


@pytest.mark.thorough
def test_a_far_endstop_beside_a_wrong_radius_is_no_scale():
    rows = probed(offset=[0, 3.0, 0], radius=R + 6)
    found = diagnose(machine(kind="height", estimate=("R",)), Measurements.from_frame(rows))
    assert [(step.effect.name, step.effect.place) for step in found.steps] == [("zero_offset", "B")]
    assert found.fits[-1].rms == pytest.approx(0.012, rel=0.35)  # three deviations of 44 readings
    for key, value in {"geometry.R": 6.0, "B.zero_offset.a": 3.0}.items():
        estimate = found.estimates[key]
        assert abs(estimate.value - value) < 4 * estimate.std


@pytest.mark.thorough
@pytest.mark.parametrize(("seed", "off"), [(1, {11: 0.4, 24: -0.4}), (5, {11: -0.4, 24: 0.4})])
def test_wrong_touches_are_no_displaced_stretch(seed, off):
    """All heights are read as zero: a scale of the instrument would explain whatever the model leaves."""
    rows = probed(40, radius=R + 0.5, noise=0.01, seed=seed)
    for row, higher in off.items():
        for name in "ABC":
            rows[f"{name} [mm]"][row] += higher
    found = diagnose(machine(kind="height", estimate=("R",)), Measurements.from_frame(rows))
    assert found.outliers == (11, 24)
    assert found.verdict == "nothing_missing"


def test_a_good_printer_has_no_errors():
    found = diagnose(printer(), Measurements.from_frame(probed(30, seed=4)))
    assert not found.steps
    assert found.geometry is None


def test_heights_tell_the_rods_from_the_radius_only_badly():
    """Both make a dome: with one of them wrong the other is, too, and each alone is ten times as certain."""
    rows = Measurements.from_frame(probed(radius=R + 0.5))
    alone = fit(printer(), rows).estimates["geometry.R"]
    both = fit(printer(["R", "L"]), rows).estimates
    assert abs(alone.value - 0.5) < 4 * alone.std
    assert both["geometry.R"].std > 3 * alone.std
    assert abs(both["geometry.R"].value - 0.5) < 4 * both["geometry.R"].std


def test_a_plate_that_is_not_level_is_found_with_the_rest():
    """Heights over a plate at z = 0.3 that is tilted by 2 and -1 mrad, with the firmware's own places."""
    rows, tilt = [], np.array([2e-3, -1e-3])
    for x, y in spiral(30, 90):
        rows.append([*commanded(x, y, 5.0), 5.0 - 0.3 - tilt @ [x, y]])
    columns = {f"{name} [mm]": c for name, c in zip([*"ABC", "d"], np.array(rows).T, strict=True)}
    found = fit(machine(kind="height", frame="free", noise=0.01), Measurements.from_frame(columns))
    assert found.rms < 1e-4  # what the cosine of the tilt leaves
    values = {key: estimate.value for key, estimate in found.estimates.items()}
    assert values["frame.z"] == pytest.approx(-0.3, abs=1e-4)
    assert set(values) == {"frame.z", "frame.rx", "frame.ry"}


@pytest.mark.thorough
def test_coupled_dimensions_of_a_robot_are_found_by_a_tracker():
    random = np.random.default_rng(6)
    q = random.uniform(-0.6, 0.6, (60, 3))
    wrong = q + np.array([0.004, 0, 0])
    seen = [hung(elbows(row, R_OF_ROBOT, ARM + np.array([0, 0.4, 0])), ROD, [0, 0, -800]) for row in wrong]
    read = np.array(seen) + TARGET + random.normal(scale=0.02, size=(60, 3))
    built = machine("rotary-delta", kind="point", estimate=["target"], noise=0.02)
    columns = rows_of(built, q) | {f"{x} [mm]": c for x, c in zip("xyz", read.T, strict=True)}
    found = diagnose(built, Measurements.from_frame(columns))
    assert {(s.effect.name, s.effect.place) for s in found.steps} == {
        ("zero_offset", "A1"),
        ("arm_length", "A2"),
    }


# files and code --------------------------------------------------------------------------------------------------


def test_touches_with_no_more_rows_than_dimensions_are_weighed():
    """Thirteen touches of a printer with arms, two of which are off, and one wrong touch: by SciPy, arm by arm."""
    q = """48.907115 48.907115 48.907115 41.312862 56.605476 53.344195 41.521111 52.700225 57.056141 44.258820 47.964238
    58.981801 48.633700 43.703628 58.803351 53.288173 41.256732 56.549498 56.956926 41.417370 52.600994 58.758878
    44.018298 47.729766 58.704033 48.529857 43.595287 56.498320 53.237050 41.201257 52.611927 56.967806 41.423905
    47.908374 58.930271 44.202989 43.697902 58.802204 48.632482"""
    angles = np.array(q.split(), float).reshape(-1, 3).T
    text = machine_file("rotary-delta", kind="height", estimate=["R"])
    text |= {
        "geometry": {"R": 33.9, "A": 170.0, "L": 320.0},
        "target": [{"name": "nozzle", "point": [0, 0, 412.9]}],
    }
    arms = machine_of(toml(text), "machine.toml")
    rows = {f"A{k + 1} [deg]": x for k, x in enumerate(angles)} | {"d [mm]": np.zeros(angles.shape[1])}
    assert "A1" in {step.effect.place for step in diagnose(arms, Measurements.from_frame(rows)).steps}


def test_a_file_comes_back_as_it_was():
    for family in ("linear-delta", "rotary-delta"):
        built = machine(family, kind="height", estimate=["R"], effects=[])
        assert machine_of(machine_text(built), "machine.toml") == built


def test_carriages_that_no_position_has_name_the_row(refuses):
    rows = probed(3)
    rows["A [mm]"][1] += 2 * L
    refuses(bind, printer(), Measurements.from_frame(rows))


@pytest.mark.thorough
def test_emitted_code_brings_the_nozzle_where_it_should_be(compiler, tmp_path: Path):
    """A controller commands what the code corrects; a printer by plain NumPy carries it out."""
    effects = [("zero_offset", "B"), ("delta_angle", "B")]
    values = {"geometry.R": 0.8, "B.zero_offset.a": 0.45, "B.delta_angle.a": np.radians(0.35)}
    built = given(printer(effects=effects), values)
    emit_both(built, tmp_path, None)
    module, c = loaded(tmp_path), Compiled(compiler, tmp_path)
    wanted = np.column_stack([spiral(8, 90), np.linspace(0, 40, 8)])
    q = np.array([commanded(*place) for place in wanted])
    corrected, status, _ = module.compensate(wanted, q, np.zeros(8, int))
    assert not np.any(status)
    for place, row in zip(wanted, corrected, strict=True):
        joints = carriage_joints(row + np.array([0, 0.45, 0]), R + 0.8, PRINTER + np.array([0, 0.35, 0]))
        assert np.abs(hung(joints, L, place) - place).max() < 1e-6
    target = np.zeros(8, int)
    assert np.abs(c.forward(q, target, {}) - module.forward(q, target)).max() < 1e-10


def test_the_emitted_test_of_a_robot_allows_the_roundings_of_its_arms_and_rods(tmp_path: Path):
    """Places are sums of radius, arm and rod: 4096 roundings of the target alone were less than doubles have."""
    held = {"A1.zero_offset.a": np.radians(0.1)}
    built = given(machine("rotary-delta", kind="point", effects=[("zero_offset", "A1")]), held)
    emit(built, "numpy", tmp_path)
    passes_in_python("delta", tmp_path)


def entered(text: str, radius: float = R) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Radius, rods, angles and changes of position_endstop that the lines for Klipper have."""
    numbers = {key: re.findall(rf"^(?:# )?{key}: ([+-]?[0-9.]+)", text, re.MULTILINE) for key in KLIPPER}
    (radius,) = map(float, numbers["delta_radius"])
    return radius, *(np.array(numbers[key], float) for key in KLIPPER[1:])


KLIPPER = ("delta_radius", "arm_length", "angle", "position_endstop")


def test_firmware_with_the_emitted_numbers_prints_on_the_plate(tmp_path: Path):
    """Endstops stay where they are; carriages are counted from them. A printer by plain NumPy carries it out."""
    effects = [("zero_offset", "B"), ("delta_angle", "B"), ("delta_radius", "C"), ("rod_length", "A")]
    values = {"geometry.R": 0.8, "B.zero_offset.a": 0.45, "B.delta_angle.a": np.radians(0.35)}
    values |= {"target.nozzle.z": -0.7, "C.delta_radius.r": -0.6, "A.rod_length.a": 0.2}
    built = given(printer(["R", "target"], effects=effects), values)
    (file,) = emit(built, "printer", tmp_path)
    text = file.read_text()
    heading, radii, true = (
        PRINTER + np.array([0, 0.35, 0]),
        R + 0.8 - 0.6 * np.eye(3)[2],
        L + 0.2 * np.eye(3)[0],
    )
    at_endstop = 300 + np.sqrt(L**2 - R**2)  # believed, of each
    real = at_endstop + np.array([0, 0.45, 0])
    radius, rods, angles, changes = entered(text)
    middle = np.array(re.search(r"where x = ([-0-9.]+), y = ([-0-9.]+) is now", text).groups(), float)  # type: ignore[union-attr]
    towers = carriage_joints(np.zeros(3), radius, angles)[:, :2]
    below_endstop = 300 + changes + np.sqrt(rods**2 - radius**2)

    def printed(x: float, y: float) -> np.ndarray:
        carriages = np.sqrt(rods**2 - np.sum((towers - [x, y]) ** 2, axis=1))
        moved = real - (below_endstop - carriages)
        return hung(carriage_joints(moved, radii, heading), true, [x, y, 0]) - 0.7 * UP

    for x, y in spiral(6, 95):
        assert np.abs(printed(x, y) - [middle[0] + x, middle[1] + y, 0]).max() < 3e-4  # of four decimals
    # Marlin moves each carriage down from its endstop and then counts all as at the height H
    down = np.array(
        re.findall(r"[XYZ] ([+-][0-9.]+)", text.partition("; M666:")[2].partition("to what")[0]), float
    )
    height = float(re.findall(r"; M665 H: ([+-][0-9.]+)", text)[0])
    assert np.abs(height - down - changes).max() < 2e-4
    assert down.max() < 1e-4


def test_a_robot_has_no_numbers_for_a_printer(refuses, tmp_path: Path):
    refuses(emit, machine("rotary-delta", kind="point"), "printer", tmp_path)
