"""The hexapod against plain NumPy: its direct problem, its model, fits, diagnoses and emitted code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emitted_code import Compiled, emit_both, loaded
from hexapod_cases import BASE, HOME, LEGS, PLATFORM, TARGETS, drawn_poses, hexapod_file, lengths, table
from machine_cases import toml
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.fit import fit
from rodgen.calibration.problem.assembly_modes import not_found_by_code
from rodgen.calibration.problem.binding import bind
from rodgen.calibration.problem.problem import Problem
from rodgen.data.measurements import Measurements
from rodgen.kinematics import hexapod
from rodgen.kinematics.hexapod import DirectStatus
from rodgen.machines.families.on_legs import NEWTON_STEPS
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model

GEOMETRY = hexapod.Geometry(BASE, PLATFORM)
ARCSEC = np.pi / 180 / 3600


def machine(**file: Any) -> Machine:
    return machine_of(toml(hexapod_file(**file)), "machine.toml")


def given(built: Machine, values: Mapping[str, float]) -> Machine:
    """Return a machine with values of all its parameters, zero where none is given."""
    return replace(built, values={p.key: 0.0 for p in Model(built).parameters} | dict(values))


def problem_of(built: Machine, columns: Mapping[str, Any]) -> Problem:
    observations = bind(built, Measurements.from_frame(columns))
    return Problem(Model(built, observations.travel, observations.run_names), observations)


# the direct problem ----------------------------------------------------------------------------------------------


def test_the_pose_is_found_from_its_legs():
    position, turn = drawn_poses(300, np.random.default_rng(1))
    legs = lengths(position, turn)
    assert np.abs(hexapod.legs(position, turn, GEOMETRY) - legs).max() < 1e-12
    x, rotation, status = hexapod.direct(legs, GEOMETRY, HOME)
    assert (status == DirectStatus.CONVERGED).all()
    assert np.abs(x - position).max() < 1e-11
    assert np.abs(rotation - turn).max() < 1e-13
    from_there, _, status = hexapod.direct(legs[1:], GEOMETRY, position[:-1], turn[:-1])
    assert (status == DirectStatus.CONVERGED).all()
    assert np.abs(from_there - position[1:]).max() < 1e-11


def test_legs_that_no_pose_has_are_named():
    usual = lengths(HOME[None], np.eye(3)[None])[0]
    apart = np.linalg.norm(BASE[0] - BASE[3]) + np.linalg.norm(PLATFORM[0] - PLATFORM[3])
    one = np.eye(6)[0]
    cases = {
        DirectStatus.CONVERGED: usual,
        DirectStatus.UNREACHABLE: usual + (usual[3] - usual[0] + apart + 1) * one,
        DirectStatus.NOT_CONVERGED: np.full(6, 100.0),  # the base is wider than the platform by 250
        DirectStatus.INVALID: usual - 2 * usual[0] * one,
    }
    x, turn, status = hexapod.direct(np.stack(list(cases.values())), GEOMETRY, HOME)
    assert [DirectStatus(s) for s in status] == list(cases)
    assert np.isfinite(x[0]).all()
    assert np.isnan(x[1:]).all()
    assert np.isnan(turn[1:]).all()


def test_a_platform_that_legs_do_not_hold_is_singular():
    """Similar hexagons hold the platform nowhere: a turn about the vertical does not change the legs at home."""
    similar = hexapod.Geometry(BASE * [1, 1, 0], BASE * [0.5, 0.5, 0])
    legs = hexapod.legs(HOME * [0, 0, 1], np.eye(3), similar)
    _, _, status = hexapod.direct(legs, similar, HOME * [0, 0, 1])
    held = hexapod.least_singular_value(HOME * [0, 0, 1], np.eye(3), similar)
    assert held < 1e-12
    assert status in (DirectStatus.SINGULAR, DirectStatus.NOT_CONVERGED)


def test_the_least_singular_value_is_that_of_differences():
    (position,), (turn,) = drawn_poses(1, np.random.default_rng(2))
    middle = PLATFORM.mean(axis=0)
    radius = np.sqrt(np.mean(np.sum((PLATFORM - middle) ** 2, axis=1)))

    def moved(y: np.ndarray) -> np.ndarray:
        by = Rotation.from_rotvec(y[3:] / radius).as_matrix()
        at = position + y[:3] + turn @ middle - by @ turn @ middle
        return lengths(at[None], (by @ turn)[None])[0]

    slopes = np.stack([(moved(h) - moved(-h)) / 2e-3 for h in 1e-3 * np.eye(6)], axis=1)
    least = np.linalg.svd(slopes, compute_uv=False)[-1]
    assert hexapod.least_singular_value(position, turn, GEOMETRY) == pytest.approx(least, rel=1e-7)


# the model -------------------------------------------------------------------------------------------------------


def solved(
    legs: np.ndarray, base: np.ndarray, platform: np.ndarray, near: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Find the pose of one row by SciPy."""
    position, turn = near

    def gap(y: np.ndarray) -> np.ndarray:
        by = Rotation.from_rotvec(y[3:] / 300).as_matrix() @ turn
        return lengths((position + y[:3])[None], by[None], base, platform)[0] - legs

    y = least_squares(gap, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return position + y[:3], Rotation.from_rotvec(y[3:] / 300).as_matrix() @ turn


def test_the_model_is_the_hexapod_with_its_errors():
    """Joints, offset, scale, warmth, and a leg that gives way, whose tension balances force and moment."""
    random = np.random.default_rng(4)
    position, turn = drawn_poses(6, random)
    seen = position + turn @ np.array(TARGETS["p"])
    q = lengths(position, turn)
    warm, load = random.uniform(15, 35, 6), random.uniform(20, 80, 6)
    names = [
        "leg_zero_offset",
        "leg_scale",
        "leg_thermal_expansion",
        "leg_compliance",
        "platform_joint_offset",
    ]
    effects = [{"name": name, "joint": f"L{k + 1}"} for k, name in enumerate(names)]
    values = {
        "geometry.B6.y": 0.8,
        "L1.leg_zero_offset.a": 0.4,
        "L2.leg_scale.k": 3e-4,
        "L3.leg_thermal_expansion.alpha": 2e-5,
        "L4.leg_compliance.c": 1e-4,
        "L5.platform_joint_offset.x": -0.5,
    }
    built = given(machine(estimate=["B6"], effects=effects), values)
    base, platform, long = BASE.copy(), PLATFORM.copy(), q.copy()
    base[5, 1] += 0.8
    platform[4, 0] -= 0.5
    long[:, 0] += 0.4
    long[:, 1] *= 1 + 3e-4
    long[:, 2] *= 1 + 2e-5 * (warm - 20)
    target = np.array(TARGETS["p"])
    expected = []
    for row in range(6):
        x, R = solved(long[row], base, platform, (position[row], turn[row]))
        joints = x + platform @ R.T
        pull = (base - joints) / np.linalg.norm(base - joints, axis=1, keepdims=True)
        weight = np.array([0, 0, -1.0])
        wrenches = np.concatenate([pull, np.cross(joints, pull) / 500], axis=1).T
        tension = np.linalg.solve(wrenches, -np.concatenate([weight, np.cross(x + R @ target, weight) / 500]))
        stretched = long[row] + 1e-4 * load[row] * tension * np.eye(6)[3]
        x, R = solved(stretched, base, platform, (x, R))
        expected.append(x + R @ target)
    columns: dict[str, Any] = {f"{leg} [mm]": q[:, k] for k, leg in enumerate(LEGS)}
    columns |= {"target": ["p"] * 6, "T_L3 [degC]": warm, "load [N]": load}
    columns |= {f"{x} [mm]": np.array(expected)[:, i] for i, x in enumerate("xyz")}
    problem = problem_of(built, columns)
    place = problem.predicted(problem.model.start(), Frame.identity())
    assert np.abs(place - expected).max() < 1e-6  # forces are those of rigid legs
    assert np.abs(place - seen).max() > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param("point", marks=pytest.mark.slow), "pose"])
def test_derivatives_are_those_of_differences(kind):
    random = np.random.default_rng(6)
    position, turn = drawn_poses(6, random)
    effects = [{"name": "leg_zero_offset", "joint": "L2"}, {"name": "base_joint_offset", "joint": "L3"}]
    built = machine(kind=kind, estimate=["B1", "P4", "target"], effects=effects)
    turned = ARCSEC if kind == "pose" else None
    rows = table(lengths(position, turn), position, turn, random, noise=0.01, turned=turned)
    problem = problem_of(built, rows)
    theta, frame = problem.model.start(), Frame.identity()
    jacobian = problem.jacobian(theta, frame)
    for k in range(len(theta)):
        h = 1e-4 * np.eye(len(theta))[k]
        slope = (problem.residuals(theta + h, frame) - problem.residuals(theta - h, frame)) / 2e-4
        assert np.abs(jacobian[..., k] - slope).max() < 1e-6 * np.abs(slope).max()


# fits and diagnoses ----------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_a_fit_of_poses_finds_joints_and_offsets_of_legs():
    random = np.random.default_rng(3)
    off = random.normal(scale=0.3, size=(12, 3))
    offsets = random.normal(scale=0.5, size=6)
    position, turn = drawn_poses(120, random)
    q = lengths(position, turn, BASE + off[:6], PLATFORM + off[6:]) - offsets
    effects = [{"name": "leg_zero_offset", "joint": leg} for leg in LEGS]
    noise = {"noise": 0.005, "attitude_noise": "2 arcsec"}
    built = machine(kind="pose", estimate=["geometry"], effects=effects, **noise)
    rows = table(q, position, turn, random, noise=0.005, turned=2 * ARCSEC)
    found = fit(built, Measurements.from_frame(rows))
    joints = [f"{of}{k}" for of in "BP" for k in range(1, 7)]
    truth = {
        f"geometry.{joint}.{x}": off[j, i] for j, joint in enumerate(joints) for i, x in enumerate("xyz")
    }
    truth |= {f"{leg}.leg_zero_offset.a": a for leg, a in zip(LEGS, offsets, strict=True)}
    assert found.estimates.keys() == truth.keys()
    away = np.array([(e.value - truth[key]) / e.std for key, e in found.estimates.items()])
    assert np.abs(away).max() < 4
    assert 0.6 < np.sqrt(np.mean(away**2)) < 1.4


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [
        "leg_thermal_expansion",
        pytest.param("leg_zero_offset", marks=pytest.mark.slow),
        pytest.param("leg_scale", marks=pytest.mark.slow),
    ],
)
def test_a_hidden_error_of_a_leg_is_found(name):
    random = np.random.default_rng(5)
    position, turn = drawn_poses(100, random)
    q = lengths(position, turn)
    warm = random.uniform(18, 30, (100, 6))
    q[:, 3] = {
        "leg_zero_offset": q[:, 3] - 0.15,
        "leg_thermal_expansion": q[:, 3] / (1 + 11.5e-6 * (warm[:, 3] - 20)),
        "leg_scale": q[:, 3] / (1 + 1e-4),
    }[name]
    warmth = {f"T_{leg} [degC]": warm[:, k] for k, leg in enumerate(LEGS)}
    rows = table(q, position, turn, random, noise=0.005, **warmth)
    found = diagnose(machine(frame="free", estimate=["target"], noise=0.005), Measurements.from_frame(rows))
    assert [(e.effect.name, e.effect.place) for e in found.found] == [(name, "L4")]


def test_rows_that_emitted_code_does_not_find_are_counted():
    """Far from home Newton's steps alone come to other poses than the platform does."""
    random = np.random.default_rng(9)
    position, turn = drawn_poses(400, random, wider=3.0)
    legs = lengths(position, turn)
    followed, _, status = hexapod.direct(legs, GEOMETRY, HOME)
    kept = (status == DirectStatus.CONVERGED) & (np.abs(followed - position).max(axis=1) < 1e-6)
    legs, position, turn = legs[kept], position[kept], turn[kept]
    stepped, _ = hexapod.by_newton(legs, GEOMETRY, HOME, NEWTON_STEPS)
    lost = ~(np.abs(stepped - position).max(axis=1) < 1)
    assert 0 < lost.sum() < 0.1 * len(lost)
    built = machine(noise=0.01)
    rows = bind(built, Measurements.from_frame(table(legs, position, turn, random, noise=0.01)))
    assert not_found_by_code(built, rows) == pytest.approx(lost.mean())
    assert not_found_by_code(built, rows.take(np.flatnonzero(~lost))) == 0


# files and code --------------------------------------------------------------------------------------------------


def test_a_file_comes_back_as_it_was():
    built = machine(estimate=["B1", "target"])
    assert machine_of(machine_text(built), "machine.toml") == built


def test_a_file_without_home_is_one_clear_line(refuses):
    file = hexapod_file()
    del file["geometry"]["home"]
    refuses(machine_of, toml(file), "machine.toml")


@pytest.mark.parametrize("wrong", ["one leg twice", "alike hexagons"])
def test_joints_that_do_not_hold_the_platform_are_named(refuses, wrong):
    """Two legs that are one; similar hexagons, upright one above the other (Fichter 1986)."""
    base, platform = BASE.copy(), PLATFORM.copy()
    if wrong == "one leg twice":
        base[1], platform[1] = base[0], platform[0]
    else:
        platform = 0.5 * base * [1, 1, 0]
        base[:, 2] = 0
    refuses(machine_of, toml(hexapod_file(base=base, platform=platform)), "machine.toml")


@pytest.mark.parametrize("wrong", ["radius", "shift", "zeros"])
def test_one_freedom_twice_is_refused(refuses, wrong):
    zeros = [{"name": "leg_zero_offset", "joint": f"L{k}"} for k in range(1, 7)]
    estimate = ["geometry"] if wrong == "radius" else [f"P{k}" for k in range(1, 7)] * (wrong == "shift")
    of_all = {"radius": "base_radius", "shift": "platform_radius", "zeros": "common_zero_offset"}[wrong]
    file = hexapod_file(estimate=estimate)
    before = machine_of(
        toml(file | {"effect": [{"name": of_all}] * (not estimate) + zeros[1:]}), "machine.toml"
    )
    assert len(before.effects) == 6 - bool(estimate)
    file["effect"] = [*zeros[1:], {"name": of_all}, *zeros[:1]]
    refuses(machine_of, toml(file), "machine.toml")


def test_two_legs_may_share_a_joint_of_the_base():
    base = BASE.copy()
    base[1] = base[0]
    assert machine_of(toml(hexapod_file(base=base)), "machine.toml").kinematics.fault is None


def test_legs_that_do_not_close_name_the_row(refuses):
    random = np.random.default_rng(7)
    position, turn = drawn_poses(4, random)
    q = lengths(position, turn)
    q[2] = 100.0
    refuses(bind, machine(), Measurements.from_frame(table(q, position, turn, random, noise=0.01)))


@pytest.mark.slow
def test_emitted_code_is_the_model(compiler, tmp_path: Path):
    random = np.random.default_rng(8)
    position, turn = drawn_poses(20, random)
    base = BASE.copy()
    base[0, 0] += 0.5
    legs = lengths(position, turn, base)
    effect = {"name": "leg_zero_offset", "joint": "L3"}
    built = given(
        machine(estimate=["B1"], effects=[effect]), {"geometry.B1.x": 0.5, "L3.leg_zero_offset.a": 0.7}
    )
    q = legs - 0.7 * np.eye(6)[2]
    emit_both(built, tmp_path, None)
    module, c = loaded(tmp_path), Compiled(compiler, tmp_path)
    target = np.zeros(20, int)
    expected = position + turn @ np.array(TARGETS["p"])
    assert np.abs(module.forward(q, target) - expected).max() < 1e-9
    assert np.abs(c.forward(q, target, {}) - module.forward(q, target)).max() < 1e-10
