"""Readings that were not taken: of other positions, approaches, times, loads, places of targets.

What a combination of parameters would change there shows whether measuring so would determine it, and, where nothing
that can be read changes at all, that it is a choice of coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.assembly_modes import within_reach
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model

ROWS = 240
"""Least number of hypothetical readings: what none of them shows, none would."""
FAR = 2.0
"""How far beyond the middle of the data's range readings are placed, in half ranges."""


@dataclass(frozen=True)
class Variation:
    """Readings that differ from those taken in one thing."""

    problem: Problem
    hint: str
    """What to do to take them: "measure ..."."""
    wanting: bool
    """Whether the data hold one value only of what is varied: then this is what they lack."""
    fresh: tuple[int, ...] = ()
    """Numbers of the parameters that have another value in these readings, which is not known either."""
    still: str | None = None
    """The joint that moves in these readings only."""


class _Generator:
    """Draws columns of readings that were not taken; what it does not draw is as in some rows of the data."""

    def __init__(
        self, problem: Problem, theta: Array, frame: Frame, rows: NDArray[np.int_], seed: int
    ) -> None:
        self.o, self.model = problem.observations, problem.model
        self.machine = self.model.machine
        self.theta, self.frame = theta, frame
        self.random = np.random.default_rng(seed)
        self.n = len(rows)
        shape = (self.n, self.o.reading.shape[1])
        self.base = replace(self.o.take(rows), sigma=None, reading=np.ones(shape))

    @property
    def size(self) -> float:
        """How large the machine is; at least 1."""
        points = [t.point for t in self.machine.targets] + [j.point for j in self.machine.joints]
        slides = [j for j, joint in enumerate(self.machine.joints) if joint.type == "prismatic"]
        spans = np.ptp(self.o.q[:, slides], axis=0)
        size = self.machine.kinematics.size
        return float(max(np.linalg.norm(points, axis=1).max(), spans.max(initial=size), 1.0))

    def problem(self, machine: Machine | None = None, **columns: Any) -> Problem:
        """Return a problem with some columns replaced, perhaps of another machine of the same structure."""
        model = self.model
        if machine is not None:
            model = Model(machine, model.travel, self.o.run_names, compiled=model.compiled)
        q = columns.pop("q", None)
        observations = replace(self.base, **columns)
        if q is not None and self.machine.kinematics.is_closed:
            observations = within_reach(observations, q)
        elif q is not None:
            observations = replace(observations, q=q)
        return Problem(model, observations).read_as_predicted(self.theta, self.frame)

    def with_column(self, name: str, j: int, values: Any) -> Problem:
        """Return a problem with one joint's column replaced."""
        matrix = np.array(getattr(self.base, name))
        matrix[:, j] = values
        columns: dict[str, Any] = {name: matrix}
        return self.problem(**columns)

    def around(self, values: Any, least: float) -> Array:
        """Return numbers like some, and beyond."""
        middle, half = (np.max(values) + np.min(values)) / 2, np.ptp(values) / 2
        return np.asarray(middle + FAR * max(half, least) * self.random.uniform(-1, 1, self.n))

    def coordinates(self, j: int) -> Array:
        """Return any angle, or places on a slide and beyond its ends."""
        if self.machine.joints[j].revolute:
            return self.random.uniform(-np.pi, np.pi, self.n)
        if self.machine.joints[j].type == "leg":
            return self.around(self.o.q[:, j], self.size / 4)
        return self.around([*self.model.travel[j], self.o.q[:, j].min(), self.o.q[:, j].max()], self.size)

    def sides(self) -> NDArray[np.int8]:
        """Return directions of approach."""
        return self.random.choice(np.array([-1, 1], np.int8), self.n)

    def speeds(self, j: int) -> Array:
        """Return velocities of a joint."""
        slides = not self.machine.joints[j].revolute
        return self.around([0.0, np.max(np.abs(self.o.v[:, j]))], self.size if slides else 1.0)

    def times(self) -> Array:
        """Return times from the start to beyond the end."""
        latest = 1.0 if self.o.t is None else float(np.max(np.abs(self.o.t)))
        return self.random.uniform(0, FAR * max(latest, 1.0), self.n)

    def place(self) -> tuple[float, float, float]:
        """Return a point within the machine's size, or as good, a direction."""
        x, y, z = self.random.normal(size=3) * self.size
        return float(x), float(y), float(z)

    def elsewhere_on_the_body(self) -> Machine:
        """Return the machine with its targets at other places."""
        directions = not self.machine.measurand.moving
        places = [np.array(self.place()) for _ in self.machine.targets]
        if directions:
            places = [place / np.linalg.norm(place) for place in places]
        targets = (replace(t, point=tuple(p)) for t, p in zip(self.machine.targets, places, strict=True))
        return replace(self.machine, targets=tuple(targets))


def elsewhere(problem: Problem, theta: Array, frame: Frame) -> tuple[Problem, Variation]:
    """Return readings of anything at all: of every target in every set-up at random positions, times and loads.

    Once of the targets that there are, and once of targets at other places on the body.
    """
    o, machine = problem.observations, problem.model.machine
    count = max(ROWS, 4 * len(problem.model.parameters))
    draw = _Generator(problem, theta, frame, np.arange(count) % o.n, 1)
    joints, turn = range(len(machine.joints)), np.arange(count)
    columns: dict[str, Any] = {
        "q": np.stack([draw.coordinates(j) for j in joints], axis=1),
        "s": np.stack([draw.sides() for _ in joints], axis=1),
        "v": np.stack([draw.speeds(j) for j in joints], axis=1),
        "t": None if o.t is None else draw.times(),
        "load": None if o.load is None else draw.around(o.load, 10.0),
        "temperature": {name: draw.around(values, 10.0) for name, values in o.temperature.items()},
        "covariates": {name: draw.around(values, 1.0) for name, values in o.covariates.items()},
        "target": (turn % len(machine.targets)).astype(np.int32),
        "run": (turn // len(machine.targets) % len(o.run_names)).astype(np.int32),
    }
    return draw.problem(**columns), _other_targets(draw, problem, columns)


def _other_targets(draw: _Generator, problem: Problem, columns: dict[str, Any]) -> Variation:
    fresh = tuple(i for i, p in enumerate(problem.model.parameters) if p.slot[0] == "target")
    there = draw.problem(draw.elsewhere_on_the_body(), **columns)
    return Variation(there, "measure a target at another place on the body", False, fresh)


def variations(problem: Problem, theta: Array, frame: Frame) -> Iterator[Variation]:
    """Yield readings that differ in one thing from those taken, after some of those taken themselves."""
    o, model = problem.observations, problem.model
    joints, targets = model.machine.joints, model.machine.targets
    some = np.linspace(0, o.n - 1, min(o.n, ROWS)).astype(int)
    draw = _Generator(problem, theta, frame, some[np.arange(ROWS) % len(some)], 2)
    yield Variation(draw.problem(), "", False)
    for k in sorted(set(range(len(targets))) - set(np.unique(o.target).tolist())):
        there = draw.problem(target=np.full(draw.n, k, np.int32))
        yield Variation(there, f"measure target {targets[k].name}, which is in no row", True)
    for j, joint in enumerate(joints):
        one = bool(np.all(o.s[:, j] == o.s[0, j]))
        side = "from the other side, too" if one else "from both sides at more places"
        yield Variation(draw.with_column("s", j, draw.sides()), f"approach {joint.name} {side}", one)
    for j, joint in enumerate(joints):
        still = bool(np.ptp(o.q[:, j]) == 0)
        where = f"{joint.name}, which never moves" if still else f"{joint.name}"
        hint = f"measure at other positions of {where}"
        there = draw.with_column("q", j, draw.coordinates(j))
        yield Variation(there, hint, still, still=joint.name if still else None)
    for j, joint in enumerate(joints):
        hint = f"measure at other speeds of {joint.name}"
        yield Variation(draw.with_column("v", j, draw.speeds(j)), hint, np.ptp(o.v[:, j]) == 0)
    if o.load is not None:
        there = draw.problem(load=draw.around(o.load, 10.0))
        yield Variation(there, "measure with other loads", np.ptp(o.load) == 0)
    for name, values in o.temperature.items():
        there = draw.problem(temperature={**draw.base.temperature, name: draw.around(values, 10.0)})
        yield Variation(there, f"measure at other temperatures of {name}", np.ptp(values) == 0)
    if o.t is not None:
        yield Variation(draw.problem(t=draw.times()), "measure at other times", np.ptp(o.t) == 0)
    for name, values in o.covariates.items():
        there = draw.problem(covariates={**draw.base.covariates, name: draw.around(values, 1.0)})
        yield Variation(there, f"measure at other values of {name}", np.ptp(values) == 0)
    yield _other_targets(draw, problem, {})
