"""Classes of effects that some data cannot tell apart by design, and the way from there: plan, measure, fit again.

The measurements, before and after the plan, come from the independent simulator. An effect is distinguished from the
true one when it fits worse by more than 12 + ln(rows) for each parameter that it has less, after a full fit of all
readings.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from machine_cases import ARCSEC, Case, joint, machine_file
from simulated_fits import measure

from rodgen.calibration.diagnosis import Diagnosis
from rodgen.calibration.fit import Fit, fit
from rodgen.calibration.plan import Plan, plan_for
from rodgen.calibration.plan.constraints import Constraints, Region
from rodgen.data.measurements import Measurements
from rodgen.machines.effects.formula import Formula
from rodgen.machines.machine import Machine

Columns = dict[str, Any]
Draw = Callable[[np.random.Generator], dict[str, float]]


@dataclass(frozen=True)
class Loop:
    """A machine, what was measured of it, and the effects that look the same there.

    Attributes
    ----------
    file : mapping
        The machine file.
    columns : mapping
        What was commanded.
    effects : sequence of (name, place, hold)
        The class.
    truth : callable
        Draws what is there: parameters of one effect of the class.
    grid : callable
        Commands of a plain even plan with some number of readings.
    noise : float
    constraints : Constraints, optional
        Of the plan.
    """

    name: str
    file: Mapping[str, Any]
    columns: Columns
    effects: Sequence[tuple[str, str | None, Mapping[str, float]]]
    truth: Draw
    grid: Callable[[int], Columns]
    noise: float
    known: Mapping[str, float] = field(default_factory=dict)
    constraints: Constraints | None = None


@cache
def machine_of(text: str) -> Machine:
    return Case(json.loads(text), {}).machine


def joined(old: Columns, new: Mapping[str, Any]) -> Columns:
    """Return the old commands followed by the new ones."""
    count, more = len(next(iter(old.values()))), len(next(iter(new.values())))
    found = {}
    for name in old:
        added = new.get(name, ["p"] * more if name == "target" else None)
        assert added is not None, f"the plan lacks {name}"
        found[name] = np.concatenate([np.asarray(old[name]), np.asarray(added)])
    assert count + more == len(found["target"])
    return found


class Trial:
    """One machine of a loop: the truth drawn, the old data measured."""

    def __init__(self, loop: Loop, seed: int) -> None:
        self.loop, self.seed = loop, seed
        self.random = np.random.default_rng(seed)
        self.truth = {**loop.known, **loop.truth(self.random)}
        key = next(k for k in self.truth if k not in loop.known)
        self.true = next(
            (name, place)
            for name, place, _ in loop.effects
            if key.startswith(".".join(filter(None, [place, name])) + ".")
        )
        self.data = self.measured(loop.file, loop.columns)
        self.fit = self.fitted(loop.file, self.data)

    def measured(self, file: Mapping[str, Any], columns: Columns) -> Columns:
        random = np.random.default_rng([self.seed, len(columns["target"])])
        return measure(file, columns, self.truth, noise=self.loop.noise, random=random)

    def fitted(self, file: Mapping[str, Any], data: Columns, effect: Any = None) -> Fit:
        machine = machine_of(json.dumps(file))
        if effect is not None:
            name, place, hold = effect
            machine = machine.with_effect(machine.effect(name, place, hold=hold))
        return fit(machine, Measurements.from_frame(data))

    def plan(self, n: int = 12) -> Plan:
        machine = self.fit.machine
        effects = [machine.effect(name, place, hold=hold) for name, place, hold in self.loop.effects]
        return plan_for(self.fit, [effects], n, constraints=self.loop.constraints)

    def after(self, plan: Plan) -> tuple[Mapping[str, Any], Columns]:
        """Return the machine file and all commands once the planned rows are measured."""
        return self.loop.file, joined(self.loop.columns, plan.rows)

    def continued(self, file: Mapping[str, Any], columns: Columns) -> Columns:
        """Measure all of it, the old rows as they were."""
        count = len(self.loop.columns["target"])
        data = self.measured(file, columns)
        for name, values in self.data.items():
            if name not in columns:  # readings stay what they were
                data[name][:count] = values
        return data

    def diagnosed(self, file: Mapping[str, Any], columns: Columns) -> Diagnosis:
        """Measure all of it, and diagnose."""
        return self.fitted(file, self.continued(file, columns)).diagnose()

    def settled(self, found: Diagnosis) -> bool:
        """Whether a diagnosis has the true effect, or what it says does the same, and no other of the class."""
        named = [
            {
                (e.name, e.place)
                for e in (step.effect, *(e for alias in step.indistinguishable_from for e in alias.effects))
            }
            for step in found.steps
        ]
        others = {(name, place) for name, place, _ in self.loop.effects} - {self.true}
        return any(self.true in each for each in named) and not any(each & others for each in named)

    def resolved(self, file: Mapping[str, Any], columns: Columns) -> bool:
        """Measure all of it, and say whether the true effect stands alone among full fits with each of the class."""
        data = self.continued(file, columns)
        fits = {(e[0], e[1]): self.fitted(file, data, e) for e in self.loop.effects}
        true = fits[self.true]
        each = 12 + np.log(len(columns["target"]))
        for place, other in fits.items():
            saved = max(len(true.free) - len(other.free), 1)
            if place != self.true and other.chi_square - true.chi_square < each * saved:
                return False
        return True


# the classes ---------------------------------------------------------------------------------------------------


def _size(random: np.random.Generator, low: float, high: float) -> float:
    return float(random.choice([-1, 1]) * random.uniform(low, high))


def _evenly(low: float, high: float, n: int) -> np.ndarray:
    return np.linspace(low, high, n) if n > 1 else np.array([(low + high) / 2])


TURN = 3.14


def one_radius() -> Loop:
    """A table with one ball measured: an eccentric encoder, or a bearing that moves by as much at this radius."""
    file = machine_file(
        [joint("C", "revolute", (0, 0, 1), travel=[-TURN, TURN])],
        [(120, 0, 40), (-84, 0, 40)],
        estimate=["C.point", "target"],
        noise=0.002,
    )
    n = 300

    def truth(random: np.random.Generator) -> dict[str, float]:
        if random.random() < 0.5:
            return {f"C.encoder_eccentricity.{x}": _size(random, 5, 8) * ARCSEC for x in "ab"}
        a = _size(random, 0.0025, 0.0035)
        return {"C.radial_error_motion.u_s2": -a, "C.radial_error_motion.v_c2": a}

    def grid(n: int) -> Columns:
        return {"C [rad]": _evenly(-3, 3, n), "target": ["p", "r"] * (n // 2) + ["p"] * (n % 2)}

    effects = [("encoder_eccentricity", "C", {}), ("radial_error_motion", "C", {})]
    return Loop(
        "one radius", file, {"C [rad]": _evenly(-3, 3, n), "target": ["p"] * n}, effects, truth, grid, 0.002
    )


def one_side() -> Loop:
    """A joint that was measured from one side only: play, or a wrong zero."""
    file = machine_file(
        [joint("C", "revolute", (0, 0, 1), travel=[-TURN, TURN])],
        [(120, 0, 40)],
        estimate=["C.axis"],
        noise=0.002,
    )

    def truth(random: np.random.Generator) -> dict[str, float]:
        if random.random() < 0.5:
            return {"C.zero_offset.a": _size(random, 2.5, 4) * ARCSEC}
        return {"C.backlash.b": _size(random, 5, 8) * ARCSEC}

    def grid(n: int) -> Columns:  # up, and down again
        up = (n + 1) // 2
        return {
            "C [rad]": np.concatenate([_evenly(-3, 3, up), _evenly(2.8, -3.1, n - up)]),
            "target": ["p"] * n,
        }

    columns = {"C [rad]": _evenly(-3, 3, 300), "target": ["p"] * 300}
    return Loop(
        "one side", file, columns, [("backlash", "C", {}), ("zero_offset", "C", {})], truth, grid, 0.002
    )


def one_load() -> Loop:
    """An arm that was measured with one load only: it winds up under its own weight, or under the load."""
    file = machine_file(
        [joint("A", "revolute", (0, 1, 0), travel=[-1.5, 1.5])],
        [(400, 0, 40)],
        estimate=["target"],
        noise=0.01,
    )

    def truth(random: np.random.Generator) -> dict[str, float]:
        if random.random() < 0.5:
            return {
                "A.load_windup.k": abs(_size(random, 12, 18)) * ARCSEC / 400 / 50
            }  # a compliance is positive
        return {"A.gravity_windup.k": abs(_size(random, 12, 18)) * ARCSEC / 400}

    def grid(n: int) -> Columns:
        return {
            "A [rad]": _evenly(-1.4, 1.4, n),
            "target": ["p"] * n,
            "load [N]": [[0.0, 50.0][i % 2] for i in range(n)],
        }

    columns = {"A [rad]": _evenly(-1.4, 1.4, 300), "target": ["p"] * 300, "load [N]": np.full(300, 50.0)}
    effects = [("load_windup", "A", {}), ("gravity_windup", "A", {"k2": 0.0})]
    return Loop("one load", file, columns, effects, truth, grid, 0.01)


def short_arc() -> Loop:
    """Over 30 degrees to either side a gain, an eccentricity and a second harmonic look the same."""
    file = machine_file(
        [joint("C", "revolute", (0, 0, 1), travel=[-2.0, 2.0])],
        [(120, 0, 40)],
        estimate=["target"],
        noise=0.002,
    )

    def truth(random: np.random.Generator) -> dict[str, float]:
        which = random.integers(3)
        if which == 0:
            return {"C.scale.k": _size(random, 4e-5, 6e-5)}
        name, half = ("encoder_eccentricity", 1) if which == 1 else ("encoder_ellipticity", 2)
        return {f"C.{name}.b": _size(random, 8, 12) / half * ARCSEC}

    def grid(n: int) -> Columns:
        return {"C [rad]": _evenly(-2, 2, n), "target": ["p"] * n}

    columns = {"C [rad]": _evenly(-0.52, 0.52, 400), "target": ["p"] * 400}
    effects = [(name, "C", {}) for name in ("scale", "encoder_eccentricity", "encoder_ellipticity")]
    return Loop("short arc", file, columns, effects, truth, grid, 0.002)


def one_scan() -> Loop:
    """A slide that only went up while time went on: a scale, or the frame drifts."""
    file = machine_file(
        [joint("X", "prismatic", (1, 0, 0), travel=[0, 800])], [(0, 0, 40)], estimate=["target"], noise=0.002
    )

    def truth(random: np.random.Generator) -> dict[str, float]:
        if random.random() < 0.5:
            return {"X.scale.k": _size(random, 0.5e-5, 0.8e-5)}
        return {"linear_drift.x": _size(random, 0.5e-5, 0.8e-5)}

    def grid(n: int) -> Columns:
        return {"X [mm]": _evenly(0, 800, n), "target": ["p"] * n, "t [s]": 800.0 + 4 * np.arange(n)}

    columns = {"X [mm]": _evenly(0, 800, 200), "target": ["p"] * 200, "t [s]": 4.0 * np.arange(200)}
    effects = [("scale", "X", {}), ("linear_drift", None, {})]
    return Loop("one scan", file, columns, effects, truth, grid, 0.002)


def never_moved() -> Loop:
    """A slide that stood still far out: its scale, or its zero."""
    file = machine_file(
        [
            joint("X", "prismatic", (1, 0, 0), travel=[0, 800]),
            joint("Y", "prismatic", (0, 1, 0), travel=[0, 400]),
        ],
        [(0, 0, 40)],
        noise=0.002,
    )

    def truth(random: np.random.Generator) -> dict[str, float]:
        if random.random() < 0.5:
            return {"X.scale.k": _size(random, 0.4e-5, 0.6e-5)}
        return {"X.zero_offset.a": _size(random, 0.0028, 0.0042)}

    def grid(n: int) -> Columns:
        k = max(int(np.sqrt(n)), 1)
        x, y = _evenly(0, 800, k), _evenly(0, 400, -(-n // k))
        both = np.array([(a, b) for b in y for a in x])[:n]
        return {"X [mm]": both[:, 0], "Y [mm]": both[:, 1], "target": ["p"] * n}

    columns = {"X [mm]": np.full(120, 700.0), "Y [mm]": _evenly(0, 400, 120), "target": ["p"] * 120}
    return Loop(
        "never moved", file, columns, [("scale", "X", {}), ("zero_offset", "X", {})], truth, grid, 0.002
    )


def low_stars() -> Loop:
    """A telescope that looked at a band of elevations: its tube droops, or its encoder has a gain."""
    file = machine_file(
        [
            joint("AZ", "revolute", (0, 0, -1), travel=[0, 6.2]),
            joint("EL", "revolute", (1, 0, 0), travel=[0.2, 1.5]),
        ],
        [(0, 1, 0)],
        kind="direction",
        estimate=["AZ.axis", "EL.axis", "target"],
        noise=1.0 * ARCSEC,
    )
    stars = np.random.default_rng(0)

    def truth(random: np.random.Generator) -> dict[str, float]:
        if random.random() < 0.5:
            return {"EL.scale.k": _size(random, 8, 14) * ARCSEC}
        return {"EL.gravity_windup.k": _size(random, 8, 14) * ARCSEC}

    def grid(n: int) -> Columns:
        k = max(int(np.sqrt(n)), 1)
        az, el = _evenly(0, 6.2, -(-n // k)), _evenly(0.2, 1.5, k)
        both = np.array([(a, e) for a in az for e in el])[:n]
        return {"AZ [rad]": both[:, 0], "EL [rad]": both[:, 1], "target": ["p"] * n}

    columns = {
        "AZ [rad]": stars.uniform(0, 6.2, 40),
        "EL [rad]": stars.uniform(0.7, 1.0, 40),
        "target": ["p"] * 40,
    }
    effects = [("gravity_windup", "EL", {"k2": 0.0}), ("scale", "EL", {})]
    altitude = Formula.parse("altitude", file="", place="")
    low = Constraints("", regions=(Region("altitude > 10 deg", altitude, True, np.radians(10)),))
    return Loop("low stars", file, columns, effects, truth, grid, 1.0 * ARCSEC, constraints=low)


LOOPS = (one_radius, one_side, one_load, short_arc, one_scan, never_moved, low_stars)
