"""Attitudes, angles and inclinations of parallel machines and of branches: data by plain NumPy, fit to emitted code."""

from __future__ import annotations

import runpy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emitted_code import passes_in_c, passes_in_octave, passes_in_python
from hexapod_cases import drawn_poses, hexapod_file, lengths
from legged_cases import legged_file
from machine_cases import joint, machine_file, toml
from machine_simulator import rotation, twist
from parallel_simulator import LEGS, Parallel
from scipy.spatial.transform import Rotation

from rodgen.data.measurements import Measurements
from rodgen.machines.emit import emit
from rodgen.machines.emit._content import content_of
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.write import machine_text
from rodgen.machines.fixed import fixed_machine
from rodgen.machines.machine import Machine
from rodgen.output import figures

pytestmark = pytest.mark.xdist_group("attitudes")
Array = np.ndarray
ARCSEC = np.pi / 648000
NOISE = 2 * ARCSEC
MAPS = {"workspace", "residuals_in_space", "residuals_on_the_sky"}
"""Figures of where readings were taken, which attitudes and angles do not have."""
ABOUT = np.array([0.3, 0.8, 0.5]) / np.linalg.norm([0.3, 0.8, 0.5])
STEEP = np.array([0.1, -0.2, 0.97]) / np.linalg.norm([0.1, -0.2, 0.97])
READ_ABOUT = rotation([0.03, 0.05, 0]) @ ABOUT
"""The axis of an instrument, as the file has it and as it was set up by hand."""
FRAME = rotation([0.02, -0.03, 0.5])
"""How a free frame is turned."""
MOUNTED = {"p": rotation([0.3, -0.2, 0.6]), "r": rotation([-0.1, 0.4, -0.5])}
ZERO = {"p": 0.04, "r": -0.02}
LINES = {"p": np.array([1.0, 0, 0]), "r": np.array([0, 1.0, 0])}
"""What an inclinometer with two axes has, before it is mounted a little askew."""
ASKEW = {"p": rotation([0, 0.01, 0.02]), "r": rotation([-0.015, 0, 0.01])}


@pytest.fixture(autouse=True)
def on_numpy(monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")


# what instruments read --------------------------------------------------------------------------------------------


def read(
    kind: str,
    turn: Array,
    place: Array,
    gravity: Array,
    noise: float,
    seed: int = 1,
    about: Array | None = None,
) -> dict[str, Any]:
    """Return columns of readings of bodies that are turned, (n, 3, 3), each of both targets in turn."""
    rng, n = np.random.default_rng(seed), len(turn)
    names = ["pr"[i % 2] for i in range(n)]
    if kind == "angle":
        angle = twist(turn, READ_ABOUT if about is None else about)
    elif kind == "inclination":
        up = -rotation([0.004, -0.003, 0]) @ gravity
        line = np.array([ASKEW[name] @ LINES[name] for name in names])
        angle = np.arcsin(np.einsum("i,nij,nj->n", up, turn, line))
    else:
        attitude = FRAME @ turn @ np.array([MOUNTED[name] for name in names])
        attitude = rotation(noise * rng.normal(size=(n, 3))) @ attitude
        columns = dict(zip(("qx", "qy", "qz", "qw"), Rotation.from_matrix(attitude).as_quat().T, strict=True))
        if kind == "pose":
            seen = (place @ FRAME.T) + [100, -50, 20] + 100 * noise * rng.normal(size=(n, 3))
            columns |= {f"{x} [mm]": seen[:, i] for i, x in enumerate("xyz")}
        return {"target": names, **columns}
    angle = angle + [ZERO[name] for name in names] + noise * rng.normal(size=n)
    return {"target": names, "angle [rad]": angle}


def targets(kind: str) -> list[dict[str, Any]]:
    points = {"p": [60.0, 10.0, 50.0], "r": [-30.0, 70.0, 40.0]} if kind == "pose" else {}
    points = {name: line.tolist() for name, line in LINES.items()} if kind == "inclination" else points
    return [{"name": name, **({"point": points[name]} if points else {})} for name in "pr"]


def of(file: dict[str, Any], kind: str) -> dict[str, Any]:
    """Return a machine file in which this is measured, by an instrument set up by hand."""
    measured: dict[str, Any] = {"kind": kind, "frame": "free", "noise": NOISE}
    measured |= {"about": ABOUT.tolist()} if kind == "angle" else {}
    measured |= {"noise": 100 * NOISE, "attitude_noise": NOISE} if kind == "pose" else {}
    return file | {"target": targets(kind), "measured": measured, "estimate": {"parameters": ["target"]}}


@dataclass(frozen=True)
class Platform:
    """A machine on legs, and poses of its platform: turns (n, 3, 3), places of targets (n, 3), and its legs."""

    file: dict[str, Any]
    turn: Array
    place: Array
    legs: Array

    def data(
        self, kind: str, longer: dict[str, float], noise: float = NOISE, seed: int = 2
    ) -> dict[str, Any]:
        """Return what was commanded, when legs are longer than commanded, and what was read."""
        names = LEGS.get(self.file["family"], tuple(f"L{k}" for k in range(1, 7)))
        commands = self.legs - [longer.get(name, 0.0) for name in names]
        gravity = np.array(self.file["environment"]["gravity"])
        columns = {f"{name} [mm]": commands[:, k] for k, name in enumerate(names)}
        return columns | read(kind, self.turn, self.place, gravity / np.linalg.norm(gravity), noise, seed)


def platform(family: str, kind: str, rows: int = 80, seed: int = 1) -> Platform:
    rng = np.random.default_rng(seed)
    seen = np.array([t.get("point", [0, 0, 0]) for t in targets(kind)])[np.arange(rows) % 2]
    if family == "hexapod":
        position, turn = drawn_poses(rows, rng)
        file = of(hexapod_file() | {"units": {"length": "mm", "angle": "rad"}}, kind)
        return Platform(file, turn, position + np.einsum("nij,nj->ni", turn, seen), lengths(position, turn))
    tilt, around = 0.5 * np.sqrt(rng.uniform(size=rows)), rng.uniform(0, 2 * np.pi, rows)
    last = rng.uniform(560, 810, rows) if family == "tricept" else rng.uniform(0.5, 1.0, rows)
    geometry = {"R": 330.0, "r": 140.0} if family == "tricept" else None
    file = legged_file(family, gravity=(0, 0, 1), geometry=geometry)
    drawn = Parallel(file)
    poses = np.stack([tilt * np.cos(around), tilt * np.sin(around), last], -1)
    pose = drawn.pose(poses)
    place = pose.origin + np.einsum("nij,nj->ni", pose.turn, seen)
    return Platform(of(file, kind), pose.turn, place, drawn.legs(poses))


def machine(file: dict[str, Any]) -> Machine:
    return machine_of(toml(file), "machine.toml")


# parallel machines ------------------------------------------------------------------------------------------------

QUICK = [("tricept", "inclination", "A1"), ("3-sps-s", "orientation", "L2")]
LONG = [
    ("tricept", "pose", "A-1"),
    ("tricept", "orientation", "A0"),
    ("tricept", "angle", "A1"),
    ("3-sps-s", "pose", "L1"),
    ("3-sps-s", "inclination", "L3"),
    ("3-sps-s", "angle", "L1"),
    ("hexapod", "angle", "L4"),
    ("hexapod", "orientation", "L5"),
    ("hexapod", "inclination", "L6"),
]
CASES = [*QUICK, *(pytest.param(*case, marks=pytest.mark.slow) for case in LONG)]


@pytest.mark.slow
@pytest.mark.parametrize(("family", "kind", "leg"), CASES)
def test_a_leg_that_is_off_is_found_by_how_the_platform_is_turned(family, kind, leg):
    bench = platform(family, kind)
    data = Measurements.from_frame(bench.data(kind, {leg: 0.1}))
    fit = machine(bench.file).fit(data)
    found = fit.diagnose()
    for drawn in (figures.comparison(fit.compare()), figures.diagnosis(found)):
        assert {figure.layout.meta["name"] for figure in drawn}.isdisjoint(MAPS) is (kind != "pose")
    named = {other.effect.identity for step in found.steps for other in (step, *step.indistinguishable_from)}
    assert ("leg_zero_offset", leg) in named
    assert len(found.steps) == 1 or kind == "angle"  # about a free axis two legs together imitate a third


@pytest.mark.slow
@pytest.mark.parametrize(("family", "kind", "leg"), [*QUICK, *LONG])
def test_a_platform_as_drawn_misses_nothing(family, kind, leg):
    bench = platform(family, kind)
    fit = machine(bench.file).fit(Measurements.from_frame(bench.data(kind, {})))
    assert 0.8 < np.sqrt(fit.chi_square / fit.degrees_of_freedom) < 1.25
    assert fit.diagnose().verdict == "nothing_missing"


def with_leg(bench: Platform, kind: str, leg: str) -> Any:
    """Return a fit of the machine that has the right effect."""
    model = machine(bench.file)
    model = model.with_effect(model.effect("leg_zero_offset", leg))
    return model.fit(Measurements.from_frame(bench.data(kind, {leg: 0.1})))


@pytest.mark.parametrize(("family", "kind", "leg"), CASES)
def test_size_and_predictions_are_those_of_the_machine(family, kind, leg):
    fit = with_leg(platform(family, kind), kind, leg)
    estimate = fit.estimates[f"{leg}.leg_zero_offset.a"]
    assert abs(estimate.value - 0.1) < 4 * estimate.std < 0.1
    exact = platform(family, kind, rows=12, seed=5).data(kind, {leg: 0.1}, noise=0.0)
    for model in (
        fit,
        fixed_machine(fit.machine).fit(
            Measurements.from_frame(platform(family, kind).data(kind, {leg: 0.1}))
        ),
    ):
        prediction = model.predict(Measurements.from_frame(exact)).columns()
        if kind in {"angle", "inclination"}:
            off = prediction["predicted_angle [arcsec]"] * ARCSEC - exact["angle [rad]"]
        else:
            names = ("qx", "qy", "qz", "qw")
            turned, wanted = (
                Rotation.from_quat(np.stack([columns[prefix + x] for x in names], -1))
                for columns, prefix in ((prediction, "predicted_"), (exact, ""))
            )
            off = (turned * wanted.inv()).as_rotvec()
        assert np.abs(off).max() < 3 * NOISE


@pytest.mark.slow
@pytest.mark.parametrize(("family", "kind", "leg"), [*QUICK, *LONG])
def test_emitted_code_has_the_attitude_of_the_platform(family, kind, leg, tmp_path, compiler):
    fit = with_leg(platform(family, kind), kind, leg)
    code = emitted(fit.machine, tmp_path, compiler)
    if family == "tricept":
        passes_in_octave(content_of(fit.machine, "device"), tmp_path)
    other, target = platform(family, kind, rows=12, seed=5), np.arange(12) % 2
    exact = other.data(kind, {leg: 0.1}, noise=0.0)
    commands = np.stack([exact[f"{name} [mm]"] for name in code["JOINTS"]], -1)
    attitude = code["forward"](commands, target)[:, -9:].reshape(-1, 3, 3)
    is_of_body = kind in {"pose", "orientation"}
    own = np.array([MOUNTED["pr"[i]] for i in target]) if is_of_body else np.eye(3)
    assert np.abs(attitude - other.turn @ own).max() < 20 * NOISE
    corrected, status, _ = code["compensate"](code["ideal"](commands, target), commands, target)
    assert kind == "pose" or (status == code["CONVERGED"]).all()
    assert np.abs(corrected - commands).max() > 0.02


def emitted(fitted: Machine, folder: Path, compiler: str = "") -> dict[str, Any]:
    """Return the emitted module; with a compiler, the tests of all languages hold, too."""
    emit(fitted, "numpy", folder, name="device", force=True)
    if compiler:
        emit(fitted, "c", folder, name="device", force=True)
        passes_in_c("device", folder, compiler)
        passes_in_octave(content_of(fitted, "device"), folder)
        passes_in_python("device", folder)
    return runpy.run_path(str(folder / "device.py"))


def test_an_assembly_mode_that_readings_do_not_tell_is_asked_for(refuses):
    file = platform("3-sps-s", "orientation", 20).file
    bare = file | {"geometry": {k: x for k, x in file["geometry"].items() if k != "start"}}
    data = Measurements.from_frame(platform("3-sps-s", "orientation", 20).data("orientation", {}))
    refuses(machine(bare).fit, data)
    known = [
        t | {"attitude": Rotation.from_matrix(MOUNTED[t["name"]]).as_rotvec().tolist()}
        for t in bare["target"]
    ]
    fit = machine(bare | {"target": known, "estimate": {"parameters": []}}).fit(data)
    assert fit.rms < 4


# branches -------------------------------------------------------------------------------------------------------------


def mill(kind: str) -> dict[str, Any]:
    """Return [w C b X B t]: a table that turns, and a head that slides and tilts."""
    joints = [
        joint("C", "revolute", [0, 0, -1]),
        joint("X", "prismatic", [1, 0, 0]),
        joint("B", "revolute", [0, 1, 0]),
    ]
    file = of(machine_file(joints), kind)
    branches = [{"name": "workpiece", "joints": ["C"]}, {"name": "tool", "joints": ["X", "B"]}]
    more = {"frame": "machine", "about": STEEP.tolist()} if kind == "angle" else {}
    return file | {"branch": branches, "measured": file["measured"] | {"instrument": "workpiece"} | more}


def milled(kind: str, wave: float, seed: int = 2) -> tuple[dict[str, Any], Array]:
    rng, rows = np.random.default_rng(seed), 80
    c, x, b = rng.uniform(-3, 3, rows), rng.uniform(0, 300, rows), rng.uniform(-0.6, 0.6, rows)
    o = np.zeros(rows)
    table, head = rotation(np.stack([o, o, -(c + wave * np.sin(c))], -1)), rotation(np.stack([o, b, o], -1))
    turn = head if kind == "inclination" else table.swapaxes(1, 2) @ head
    columns = {"C [rad]": c, "X [mm]": x, "B [rad]": b}
    return columns | read(kind, turn, 0, np.array([0, 0, -1.0]), NOISE, about=STEEP), turn


@pytest.mark.thorough("angle")
@pytest.mark.parametrize(
    "kind", ["orientation", "angle", pytest.param("inclination", marks=pytest.mark.slow)]
)
def test_a_wave_of_a_table_is_found_by_attitudes_seen_from_it(kind, tmp_path):
    """An inclinometer on the head sees nothing of the table: the vertical stands still.

    Of an angle about an axis that leans by 13 degrees the axis is known: where it is free, the wave is nearly that of
    another lean (tan of half the twist is cos(lean) of that of the turn) and of a scale of B.
    """
    model = machine(mill(kind))
    data, turn = milled(kind, 1e-4)
    fit = model.fit(Measurements.from_frame(data))
    found = fit.diagnose()
    if kind == "inclination":
        assert found.verdict == "nothing_missing"
        return
    assert [step.effect.identity for step in found.steps] == [("encoder_eccentricity", "C")]
    estimate = found.final.estimates["C.encoder_eccentricity.b"]
    assert abs(estimate.value * ARCSEC - 1e-4) < 4 * estimate.std * ARCSEC
    code = emitted(found.final.machine, tmp_path)
    q = np.stack([data[name] for name in ("C [rad]", "X [mm]", "B [rad]")], -1)
    order = [("C", "X", "B").index(name) for name in code["JOINTS"]]
    target = np.arange(len(q)) % 2
    own = np.array([MOUNTED["pr"[i]] for i in target]) if kind == "orientation" else np.eye(3)
    attitude = code["forward"](q[:, order], target).reshape(-1, 3, 3)
    assert np.abs(attitude - turn @ own).max() < 5 * NOISE
    wanted = code["ideal"](q[:, order], target)
    corrected, status, _ = code["compensate"](wanted, q[:, order], target)
    assert (status == code["CONVERGED"]).all()
    off = (q[:, order] - corrected)[:, list(code["JOINTS"]).index("C")] - 1e-4 * np.sin(q[:, 0])
    assert np.abs(off).max() < 5 * NOISE


# the line of an instrument ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["angle", "inclination"])
def test_columns_of_the_line_and_the_mounting_are_derivatives(kind):
    fit = machine(platform("tricept", kind, 20).file).fit(
        Measurements.from_frame(platform("tricept", kind, 20).data(kind, {}))
    )
    problem, theta, frame = fit.problem, fit.solution.theta.copy(), fit.solution.frame
    theta += 0.05 * np.random.default_rng(1).normal(size=len(theta))
    jacobian, h = problem.jacobian(theta, frame), 1e-4
    line = "about" if kind == "angle" else "vertical"
    assert {f"{line}.a", f"{line}.b", "target.p.zero"} <= set(problem.model.keys)

    def weighted(column: int, by: float) -> Array:
        moved = theta.copy()
        moved[column] += by
        return problem.residuals(moved, frame, weighted=True)

    for key, column in problem.model.keys.items():
        ways = ((1, 8), (-1, -8), (2, -1), (-2, 1))
        off = sum(factor * weighted(column, sign * h) for sign, factor in ways) / (12 * h)
        assert np.abs(jacobian[:, :, column] - off).max() < 1e-7 * max(np.abs(off).max(), 1e4), key


def test_what_an_instrument_reads_at_zero_stands_in_the_file(refuses):
    file = mill("angle")
    one = machine(file | {"target": [{"name": "p", "zero": 0.04}, {"name": "r", "zero": -0.02}]})
    assert [target.zero for target in one.targets] == [0.04, -0.02]
    assert machine_of(machine_text(one), "again.toml") == one
    refuses(machine, mill("orientation") | {"target": [{"name": "p", "zero": 1}]})
    about = {"kind": "inclination", "frame": "free", "about": [0, 0, 1]}
    refuses(machine, mill("inclination") | {"measured": about})
