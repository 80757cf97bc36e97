"""What is fitted: three machines with their measurements, and what a peer needs to know of them.

A peer gets plain arrays in radians and millimetres, one vector of parameters in rodgen's order, and a start. Where the
camera stands is not known in the case of the positioner; the frame that the start has by closed form is given to the
peers, and only rodgen finds it within the time that is measured.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.attitudes import nearest_frame
from rodgen.calibration.problem.binding import bind
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model
from rodgen.machines.observations import Observations
from rodgen.machines.rigid import rotation_matrix

HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parent.parent / "examples" / "machines"
NOISE = 0.02  # mm


@dataclass(frozen=True)
class Case:
    name: str
    machine: Machine
    data: Measurements

    @cached_property
    def observations(self) -> Observations:
        return bind(self.machine, self.data)

    @cached_property
    def model(self) -> Model:
        return Model(self.machine, self.observations.travel, self.observations.run_names)

    @cached_property
    def keys(self) -> list[str]:
        """Names of the parameters that a peer adjusts, in the order of its vector."""
        return [p.key for p in self.model.parameters if p.hold is None]

    @cached_property
    def columns(self) -> Mapping[str, np.ndarray]:
        """What differs from row to row, one contiguous array each."""
        o = self.observations
        found = {"q": o.q.T, "sine": np.sin(o.q).T, "cosine": np.cos(o.q).T, "reading": o.reading.T}
        if self.name == "mount":
            found |= {"e1": o.basis[0].T, "e2": o.basis[1].T}
        if self.name == "positioner":
            found |= {"target": np.array(o.target), "one_hot": np.eye(3)[:, o.target]}
        if self.name == "arm":
            found |= {"s": o.s[:, 0].astype(float)}
        return {name: np.ascontiguousarray(values) for name, values in found.items()}

    @cached_property
    def frame(self) -> Frame:
        """The frame that the peers start from; the identity where it is known."""
        if self.machine.measured.frame != "free":
            return Frame.identity()
        problem = Problem(self.model, self.observations)
        places = problem.places(self.model.start(), Frame.identity())
        return nearest_frame(places, self.observations.reading, np.ones(problem.rows), moving=True)

    @property
    def start(self) -> np.ndarray:
        """Zero; a peer's frame is a change of the one it is given."""
        return np.zeros(len(self.keys))


def mount() -> Case:
    """80 stars, eight parameters; real data."""
    machine = Machine.load(str(HERE / "mount.toml"))
    return Case("mount", machine, Measurements.load(str(EXAMPLES / "mount" / "mmt_2021.csv")))


def positioner() -> Case:
    """205 poses of three balls, 19 parameters, in the frame of a camera a metre away."""
    machine = Machine.load(str(HERE / "positioner.toml"))
    rng = np.random.default_rng(615)
    q = np.repeat(np.radians(rng.uniform([-30, -90], [30, 90], (205, 2))), 3, axis=0)
    columns = {"P1 [rad]": q[:, 0], "P2 [rad]": q[:, 1], "target": np.tile(["a", "b", "c"], 205)}
    there = Frame(rotation_matrix([0.4, -2.1, 0.9]), np.array([-600.0, -790.0, 1000.0]))
    return Case("positioner", machine, _measured(machine, columns, rng, there))


def arm(rows: int) -> Case:
    """Random poses of a robot, 30 parameters."""
    machine = Machine.load(str(HERE / "arm.toml"))
    rng = np.random.default_rng(rows)
    q = np.radians(rng.uniform(-120, 120, (6, rows)))
    columns = {f"J{j + 1} [rad]": q[j] for j in range(6)}
    return Case("arm", machine, _measured(machine, columns, rng, Frame.identity()))


def _measured(
    machine: Machine, columns: Mapping[str, np.ndarray], rng: np.random.Generator, frame: Frame
) -> Measurements:
    return Measurements.from_frame(readings(machine, columns, rng, frame))


def readings(
    machine: Machine,
    columns: Mapping[str, np.ndarray],
    rng: np.random.Generator,
    frame: Frame | None = None,
    errors: int | None = None,
) -> dict[str, np.ndarray]:
    """Simulate readings of a machine with small errors in all its parameters (or those of a seed), and noise.

    rodgen's own model makes the readings: nothing is proved with them, and large data come quickly.
    """
    rows = len(next(iter(columns.values())))
    blank = dict(columns) | {f"{x} [mm]": np.broadcast_to(0.0, rows) for x in "xyz"}
    observations = bind(machine, Measurements.from_frame(blank))
    model = Model(machine, observations.travel, observations.run_names)
    size = [0.3 if ".point" in p.key or "target" in p.key else 1e-3 for p in model.parameters]
    draw = (rng if errors is None else np.random.default_rng(errors)).normal(size=len(size))
    truth = np.array(size) * draw * [p.slot[0] != "frame" for p in model.parameters]
    places = Problem(model, observations).places(truth, frame or Frame.identity())
    places += rng.normal(scale=NOISE, size=places.shape)
    return dict(columns) | {f"{x} [mm]": places[:, i] for i, x in enumerate("xyz")}


MAKERS: Mapping[str, Callable[[], Case]] = {
    "mount, 80 rows": mount,
    "positioner, 615 rows": positioner,
    "arm, 1e3 rows": lambda: arm(1_000),
    "arm, 1e4 rows": lambda: arm(10_000),
    "arm, 1e5 rows": lambda: arm(100_000),
}
