"""The rows that pictures show: all, or those that tell most, with what is left in them before and after."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.compare.sentences import figure, plain
from rodgen.calibration.diagnose.diagnosis import Diagnosis
from rodgen.calibration.fit import Fit
from rodgen.calibration.observations import Observations
from rodgen.calibration.problem import Problem
from rodgen.output.report.units import Shown

__all__ = ["Driver", "Rows"]

Array: TypeAlias = NDArray[np.float64]
Index: TypeAlias = NDArray[np.intp]

MOST_MARKS = 4000
"""In one chart: a page stays below 2 MB with them, and a picture says no more with more."""
MOST_ROWS = 1000
EXTREMES = 10
"""Largest residuals of each component, before and after, that are always drawn."""
STEP = 1e-5
"""Of the differences that tell where a joint moves the prediction: radians, or a part of the range."""
SMALL_MOTION = 0.1
"""Where a joint moves the target less than this part of what is usual, a residual says nothing of its reading."""
SAME = 0.999
"""Correlation from which two drivers are one."""


@dataclass(frozen=True)
class Driver:
    """What residuals are held against.

    Attributes
    ----------
    name, label : str
        Alone and with its unit.
    values : ndarray, shape (n,)
        Of the rows that are drawn.
    degrees : bool
    joint : int or None
        Whose reading is wrong, where an effect says so.
    approach : ndarray of int, shape (n,), or None
        Direction of approach, where the effect depends on it.
    names : tuple of str
        Of categories.
    """

    name: str
    label: str
    values: Array
    degrees: bool = False
    joint: int | None = None
    approach: NDArray[np.int8] | None = None
    names: tuple[str, ...] = ()


class Rows:
    """Rows for pictures.

    Parameters
    ----------
    diagnosis : Diagnosis
    last : Fit
        With everything that was found.
    shown : Shown
        The unit in which errors are shown.
    """

    def __init__(self, diagnosis: Diagnosis, last: Fit, shown: Shown) -> None:
        self.diagnosis, self.shown = diagnosis, shown
        self.base, self.final = diagnosis.base, last
        self.outlier = self.base.outliers | self.final.outliers
        self.outlier[[row for row in diagnosis.outliers if 0 <= row < len(self.outlier)]] = True
        n, m = self.base.residuals.shape
        self.total = n
        self.components = m
        views = 2 if self.two else 1
        self.chosen = self._chosen(min(MOST_ROWS, MOST_MARKS // ((m + 1) * views)))
        self.bad = self.outlier[self.chosen]
        self.o: Observations = self.base.observations.take(self.chosen)

    @property
    def two(self) -> bool:
        """Whether there is an after beside the before."""
        return self.final is not self.base

    @property
    def thinned(self) -> str:
        """What is said of rows that are not drawn; nothing where all are."""
        if len(self.chosen) == self.total:
            return ""
        return (
            f"{len(self.chosen)} of {self.total} rows are drawn: evenly spread, and the {EXTREMES} largest residuals "
            "of every component."
        )

    def _chosen(self, most: int) -> Index:
        if self.total <= most:
            return np.arange(self.total)
        kept = [np.linspace(0, self.total - 1, most).astype(np.intp)]
        for fit in (self.base, self.final):
            size = np.where(self.outlier[:, None] | ~np.isfinite(fit.residuals), -1.0, np.abs(fit.residuals))
            kept += [np.argpartition(column, -EXTREMES)[-EXTREMES:] for column in size.T]
        kept.append(np.flatnonzero(self.outlier)[:EXTREMES])
        return np.unique(np.concatenate(kept))

    def residuals(self, fit: Fit) -> Array:
        """Return what is left, (chosen, m), in the unit shown."""
        return np.asarray(fit.residuals[self.chosen] * self.shown.factor)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What the components are called."""
        kind = self.base.machine.measured.kind
        return {"point": ("x", "y", "z"), "distance": ("d",), "direction": ("horizontal", "to zenith")}[kind]

    @cached_property
    def tips(self) -> tuple[str, ...]:
        """What each row says when it is pointed at."""
        machine, o = self.base.machine, self.o
        before, after = self.residuals(self.base), self.residuals(self.final)
        found = []
        for i, row in enumerate(self.chosen):
            where = [
                f"{plain(joint.name, 16)} {_short(self._commanded(j)[i])}"
                for j, joint in enumerate(machine.joints)
            ]
            lines = [f"row {row}" + (", outlier, taken out" if self.bad[i] else "")]
            if len(machine.targets) > 1:
                lines[0] += f", {plain(machine.targets[int(o.target[i])].name, 24)}"
            lines.append(", ".join(where))
            for j, name in enumerate(self.names):
                was = f"{name}: {_signed(before[i, j])}"
                lines.append(f"{was} → {_signed(after[i, j])}" if self.two else was)
            lines[-1] += f" {self.shown.unit}"
            found.append("\n".join(lines))
        return tuple(found)

    def _commanded(self, joint: int) -> Array:
        """Return a joint's coordinates in the unit of the machine file."""
        machine = self.base.machine
        return np.asarray(self.o.q[:, joint] / coordinate(machine, joint)[1])

    # where --------------------------------------------------------------------------------------------------------

    @cached_property
    def places(self) -> Array:
        """Where the model puts what was measured, (chosen, 3), in machine axes."""
        fit, frame = self.base, self.base.solution.frame
        found = Problem(fit.problem.model, self.o).places(fit.solution.theta, frame)
        if fit.machine.measured.frame == "free":
            found = (found - frame.position) @ frame.rotation
        return np.asarray(found)

    def in_space(self, fit: Fit) -> Array:
        """Return residuals of points, (chosen, 3), in machine axes."""
        r = self.residuals(fit)
        return np.asarray(r @ fit.solution.frame.rotation if fit.machine.measured.frame == "free" else r)

    def along_reading(self, fit: Fit, joint: int) -> tuple[Array, str]:
        """Return what a joint's reading would have to be off by to explain each residual best, and the unit."""
        o, model = self.o, fit.problem.model
        theta, frame = fit.solution.theta, fit.solution.frame
        turns = fit.machine.joints[joint].type == "revolute"
        step = STEP if turns else STEP * float(np.ptp(o.q[:, joint]) or 1.0)
        sides = []
        for sign in (1, -1):
            q = o.q.copy()
            q[:, joint] += sign * step
            sides.append(Problem(model, replace(o, q=q)).residuals(theta, frame))
        motion = (sides[1] - sides[0]) / (2 * step)
        square = np.sum(motion**2, axis=1)
        left = fit.residuals[self.chosen] * fit.unit_factor
        with np.errstate(invalid="ignore", divide="ignore"):
            along = np.sum(motion * left, axis=1) / square
        enough = square > SMALL_MOTION**2 * np.median(square)
        unit, factor = ("arcsec", 648000 / np.pi) if turns else (self.shown.unit, self.shown.factor)
        return np.where(enough, along * factor, np.nan), unit

    # against what -------------------------------------------------------------------------------------------------

    def drivers(self, most: int = 2) -> list[Driver]:
        """Return what the effects that were found follow, the first first; else the joints that moved."""
        found: list[Driver] = []
        for driver in self._candidates():
            if len(found) == most:
                break
            if np.ptp(driver.values) > 0 and not any(_same(driver, other) for other in found):
                found.append(driver)
        return found

    def _candidates(self) -> Iterator[Driver]:
        machine = self.base.machine
        joints = {joint.name: j for j, joint in enumerate(machine.joints)}
        for step in self.diagnosis.steps:
            place, definition = step.effect.place, step.effect.definition
            names = definition.formula.names
            own = joints.get(str(place)) if place is not None else None
            reading = own if definition.component == "reading" else None
            if own is not None:
                by = {"T": self._temperature(own), "F": self._load(), "v": self._speed(own)}
                for name, driver in by.items():
                    if name in names and driver is not None:
                        yield replace(driver, joint=reading)
                approach = self.o.s[:, own] if "s" in names else None
                yield replace(self._joint(own), joint=reading, approach=approach)
            elif definition.component == "lift":
                yield self._altitude()
            elif definition.component in {"frame", "frame_shift"} and self.o.t is not None:
                yield Driver("time", "t [s]", self.o.t)
            elif definition.component == "target" and len(machine.targets) > 1:
                names_of = tuple(plain(t.name, 10) for t in machine.targets)
                yield Driver("target", "target", self.o.target.astype(float), names=names_of)
            else:
                yield self._order()
        for form in self.diagnosis.unexplained:
            if form.driver in joints:
                j = joints[form.driver]
                yield replace(self._joint(j), joint=j if form.component == "reading" else None)
            elif form.driver in self.o.covariates:
                yield Driver(form.driver, plain(form.driver), self.o.covariates[form.driver])
            elif form.driver in {"t", "time"} and self.o.t is not None:
                yield Driver("time", "t [s]", self.o.t)
            elif form.driver in {"load", "F"} and (load := self._load()) is not None:
                yield load
            elif form.driver.startswith("T_") and form.driver[2:] in joints:
                by_heat = self._temperature(joints[form.driver[2:]])
                if by_heat is not None:
                    yield by_heat
        moved = sorted(range(len(joints)), key=lambda j: -len(np.unique(self.o.q[:, j])))
        for j in moved[:1] if self.diagnosis.steps else moved[:2]:
            yield self._joint(j)
        if not self.diagnosis.steps:
            yield self._order()

    def _joint(self, j: int) -> Driver:
        joint = self.base.machine.joints[j]
        unit, _ = coordinate(self.base.machine, j)
        return Driver(joint.name, f"{plain(joint.name)} [{unit}]", self._commanded(j), degrees=unit == "deg")

    def _temperature(self, j: int) -> Driver | None:
        name = self.base.machine.joints[j].name
        if name not in self.o.temperature:
            return None
        about = f"{self.base.machine.reference_temperature:g} degC"
        label = f"temperature of {plain(name)} above {about} [K]"
        return Driver(f"temperature of {name}", label, self.o.temperature[name])

    def _load(self) -> Driver | None:
        return None if self.o.load is None else Driver("load", "load [N]", self.o.load)

    def _speed(self, j: int) -> Driver:
        machine = self.base.machine
        unit, factor = coordinate(machine, j)
        return Driver(
            f"velocity of {machine.joints[j].name}",
            f"velocity of {plain(machine.joints[j].name)} [{unit}/s]",
            self.o.v[:, j] / factor,
        )

    def _altitude(self) -> Driver:
        up = self.up
        altitude = np.degrees(np.arcsin(np.clip(self.o.reading @ up, -1, 1)))
        return Driver("altitude", "altitude [deg]", altitude, degrees=True)

    @property
    def up(self) -> Array:
        """Against gravity, in the frame of the readings."""
        up = -np.asarray(self.base.machine.gravity)
        if self.base.machine.measured.frame == "free":
            up = self.base.solution.frame.rotation @ up
        return np.asarray(up)

    def _order(self) -> Driver:
        return Driver("row", "row, in the order of the file", self.chosen.astype(float))


def coordinate(machine: object, joint: int) -> tuple[str, float]:
    """Return the unit in which a joint's coordinate is shown, and its internal value."""
    from rodgen.data.units import unit_factor
    from rodgen.machines.machine import Machine

    assert isinstance(machine, Machine)
    if machine.joints[joint].type == "revolute":
        return machine.angle_unit, float(unit_factor(machine.angle_unit)[0])
    return machine.length_unit, 1.0


def _same(one: Driver, other: Driver) -> bool:
    if one.name == other.name:
        return True
    a, b = one.values - one.values.mean(), other.values - other.values.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return size > 0 and abs(float(a @ b)) > SAME * size


def _short(value: float) -> str:
    return f"{value:.6g}".replace("-", "−")


def _signed(value: float) -> str:
    return ("−" if value < 0 else "+") + figure(abs(float(value)))
