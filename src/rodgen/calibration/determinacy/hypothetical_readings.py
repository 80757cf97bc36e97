"""Readings that were not taken: of other positions, approaches, times, loads, places of targets.

What a combination of parameters would change there shows whether measuring so would determine it, and, where nothing
that can be read changes at all, that it is a choice of coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.assembly_modes import within_reach
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model
from rodgen.machines.observations import Observations
from rodgen.machines.plausibility import reach
from rodgen.statistics.columns import orthonormal_basis, project_out

ROWS = 240
"""Least number of hypothetical readings: what none of them shows, none would."""
FAR = 2.0
"""How far beyond the middle of the data's range readings are placed, in half ranges."""
OF_JOINTS = {
    "s": "approach {} from both sides",
    "q": "measure at other positions of {}",
    "v": "measure at other speeds of {}",
}
OF_NAMES = {
    "temperature": "measure at other temperatures of {}",
    "covariates": "measure at other values of {}",
}
OF_ALL = {"load": "measure with other loads", "t": "measure at other times"}
"""What to do to vary a column of observations."""


@dataclass(frozen=True)
class Kind:
    """Readings that differ from those taken in one thing."""

    jacobian: Array
    """Of these readings, (readings, p)."""
    hint: str
    """What to do to take them: "measure ..."."""
    wanting: bool
    """Whether the data hold one value only of what is varied: then this is what they lack."""
    fresh: bool = False
    """Whether they have parameters of their own, which are not known either."""
    still: str | None = None
    """The joint that moves in these readings only."""


@dataclass(frozen=True, eq=False)
class HypotheticalReadings:
    """Readings that were not taken, by their derivatives; what is not varied is as in some rows of the data.

    Attributes
    ----------
    problem : Problem
    theta, frame : ndarray, Frame
        Where derivatives are taken.
    index : ndarray of int, shape (p,)
        Numbers of the parameters.
    """

    problem: Problem
    theta: Array
    frame: Frame
    index: NDArray[np.int_]

    @cached_property
    def everywhere(self) -> Array:
        """The derivative of readings of anything at all, (readings, p): every target, set-up, position, time, load.

        Once of the targets that there are, and once of targets at other places on the body.
        """
        here, there = self._jacobian(**self._drawn), self._jacobian(self._retargeted, **self._drawn)
        return np.concatenate([here, self._without_targets(there)])

    @cached_property
    def size(self) -> Array:
        """By how much each parameter usually changes a reading: root mean square, (p,)."""
        return np.asarray(np.sqrt(np.sum(self.everywhere**2, axis=0) / max(len(self.everywhere) // 2, 1)))

    @cached_property
    def taken(self) -> Array:
        """The derivative of some of the readings that were taken, (readings, p)."""
        return self._jacobian()

    @cached_property
    def kinds(self) -> list[Kind]:
        """What could be measured further, each alone."""
        o, base, drawn, machine = self.problem.observations, self._base, self._drawn, self._machine
        kinds = []
        for k in sorted(set(range(len(machine.targets))) - set(np.unique(o.target).tolist())):
            there = self._jacobian(target=np.full(base.n, k, np.int32))
            kinds.append(Kind(there, f"measure target {machine.targets[k].name}, which is in no row", True))
        for name, hint in OF_JOINTS.items():
            for j, joint in enumerate(machine.joints):
                one = bool(np.ptp(getattr(o, name)[:, j]) == 0)
                this = np.arange(len(machine.joints)) == j
                there = self._jacobian(**{name: np.where(this, drawn[name], getattr(base, name))})
                still = joint.name if one and name == "q" else None
                hint_of = hint.format(joint.name) + (" (it never moves)" if still else "")
                kinds.append(Kind(there, hint_of, one, still=still))
        for name, hint in OF_NAMES.items():
            for key, values in getattr(o, name).items():
                there = self._jacobian(**{name: {**getattr(base, name), key: drawn[name][key]}})
                kinds.append(Kind(there, hint.format(key), bool(np.ptp(values) == 0)))
        for name, hint in OF_ALL.items():
            if (values := getattr(o, name)) is not None:
                kinds.append(Kind(self._jacobian(**{name: drawn[name]}), hint, bool(np.ptp(values) == 0)))
        there = self._without_targets(self._jacobian(self._retargeted))
        return [*kinds, Kind(there, "measure a target at another place on the body", False, fresh=True)]

    @property
    def _machine(self) -> Machine:
        return self.problem.model.machine

    @cached_property
    def _base(self) -> Observations:
        o = self.problem.observations
        rows = np.linspace(0, o.n - 1, max(ROWS, 4 * len(self.problem.model.parameters))).astype(int)
        return replace(o.take(rows), sigma=None, reading=np.ones((len(rows), o.reading.shape[1])))

    @cached_property
    def _drawn(self) -> dict[str, Any]:
        """Columns of readings of anything at all."""
        o, machine, n = self.problem.observations, self._machine, self._base.n
        random = np.random.default_rng(1)

        def around(values: Any, least: float) -> Array:
            """Return numbers like some, and beyond."""
            middle, half = (np.max(values) + np.min(values)) / 2, np.ptp(values) / 2
            return np.asarray(middle + FAR * max(half, least) * random.uniform(-1, 1, n))

        def coordinates(j: int) -> Array:
            if machine.joints[j].revolute:
                return random.uniform(-np.pi, np.pi, n)
            return around([*self.problem.model.travel[j], *o.q[:, j]], self._size / 4)

        speeds = [1.0 if joint.revolute else self._size for joint in machine.joints]
        return {
            "q": np.stack([coordinates(j) for j in range(len(speeds))], axis=1),
            "s": random.choice(np.array([-1, 1], np.int8), (n, len(speeds))),
            "v": np.stack([around([0, np.abs(o.v[:, j]).max()], x) for j, x in enumerate(speeds)], axis=1),
            "t": None if o.t is None else random.uniform(0, FAR * max(float(np.abs(o.t).max()), 1.0), n),
            "load": None if o.load is None else around(o.load, 10.0),
            "temperature": {name: around(values, 10.0) for name, values in o.temperature.items()},
            "covariates": {name: around(values, 1.0) for name, values in o.covariates.items()},
            "target": random.integers(len(machine.targets), size=n, dtype=np.int32),
            "run": random.integers(len(o.run_names), size=n, dtype=np.int32),
        }

    @property
    def _size(self) -> float:
        """How large the machine is; at least 1."""
        return max(reach(self._machine), self._machine.kinematics.size, 1.0)

    @cached_property
    def _retargeted(self) -> Machine:
        """The machine with its targets at other places on the body."""
        targets = self._machine.targets
        places = np.random.default_rng(2).normal(size=(len(targets), 3)) * self._size
        if not self._machine.measurand.moving:  # directions
            places /= np.linalg.norm(places, axis=1, keepdims=True)
        moved = [replace(t, point=tuple(p)) for t, p in zip(targets, places.tolist(), strict=True)]
        return replace(self._machine, targets=tuple(moved))

    def _jacobian(self, machine: Machine | None = None, /, **columns: Any) -> Array:
        """Return the derivative of readings with some columns replaced, without those that are not finite."""
        model = self.problem.model
        if machine is not None:
            model = Model(machine, model.travel, self._base.run_names, compiled=model.compiled)
        q = columns.pop("q", self._base.q)
        observations = replace(self._base, **columns)
        closed = self._machine.kinematics.is_closed
        observations = within_reach(observations, q) if closed else replace(observations, q=q)
        there = Problem(model, observations).read_as_predicted(self.theta, self.frame)
        rows = there.jacobian(self.theta, self.frame)[:, :, self.index].reshape(-1, len(self.index))
        return np.asarray(rows[np.isfinite(rows).all(axis=1)])

    def _without_targets(self, jacobian: Array) -> Array:
        """Return a derivative of readings of other targets, whose places are not known: these make up for the rest."""
        fresh = np.array([self.problem.model.parameters[i].slot[0] == "target" for i in self.index], bool)
        rest = np.where(fresh, 0.0, jacobian)
        of_targets = jacobian[:, fresh]
        return np.asarray(project_out(orthonormal_basis(of_targets), rest))
