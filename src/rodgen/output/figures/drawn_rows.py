"""The rows that the figures of a diagnosis show, with their residuals before and after."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.diagnose.diagnosis import Diagnosis
from rodgen.calibration.fit import Fit
from rodgen.calibration.plan.words import column_unit
from rodgen.calibration.reading_motion import error_of_reading, motion_with_reading
from rodgen.calibration.words import plain, three_digits
from rodgen.data.drivers import Driver, order_of_rows
from rodgen.data.observations import Observations
from rodgen.data.units import ARCSEC
from rodgen.output.figures.maps import up_of
from rodgen.output.numbers import Shown, minus

__all__ = ["Against", "DrawnRows", "coordinate"]

Array: TypeAlias = NDArray[np.float64]
Index: TypeAlias = NDArray[np.intp]

MOST_MARKS = 4000
"""In one figure: its data stay below 2 MB with them, and it says no more with more."""
MOST_ROWS = 1000
EXTREMES = 10
"""Largest residuals of each component, before and after, that are always drawn."""
SAME = 0.999
"""Drivers that are correlated more than this count as one."""


@dataclass(frozen=True)
class Against:
    """A driver that residuals are drawn against.

    Attributes
    ----------
    driver : Driver
        Of the rows that are drawn.
    joint : int or None
        The joint whose reading is wrong, where an effect says so.
    approach : ndarray of int, shape (n,), or None
        Direction of approach, where the effect depends on it.
    """

    driver: Driver
    joint: int | None = None
    approach: NDArray[np.int8] | None = None


class DrawnRows:
    """The rows of a diagnosis that are drawn.

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
        n, m = self.base.residuals.shape
        self.total = n
        self.components = m
        views = 2 if self.two else 1
        self.chosen = self._chosen(min(MOST_ROWS, MOST_MARKS // ((m + 1) * views)))
        self.bad = self.outlier[self.chosen]
        self.o: Observations = self.base.observations.take(self.chosen)

    @property
    def two(self) -> bool:
        """Whether there is a model after the base."""
        return self.final is not self.base

    @property
    def thinned(self) -> str:
        """A sentence on the rows that are not drawn; empty where all are."""
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
        """Return residuals, (chosen, m), in the unit shown."""
        return np.asarray(fit.residuals[self.chosen] * self.shown.factor)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What the components are called."""
        return self.base.machine.measurand.labels

    @cached_property
    def tips(self) -> tuple[str, ...]:
        """The hover text of each row."""
        machine, o = self.base.machine, self.o
        before, after = self.residuals(self.base), self.residuals(self.final)
        found = []
        for i in range(len(self.chosen)):
            where = [
                f"{plain(joint.name, 16)} {_short(self._commanded(j)[i])}"
                for j, joint in enumerate(machine.joints)
            ]
            lines = [self.o.data.place(i) + (", outlier" if self.bad[i] else "")]
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
        """Return a joint's coordinates in the unit of the data."""
        return np.asarray(self.o.q[:, joint] / coordinate(self.o, joint)[1])

    # where --------------------------------------------------------------------------------------------------------

    @cached_property
    def places(self) -> Array:
        """Where the model puts what was measured, (chosen, 3), in machine axes."""
        return self.base.places(self.o)

    def along_reading(self, fit: Fit, joint: int) -> tuple[Array, str]:
        """Return the error of a joint's reading that would explain each residual best, and its unit."""
        motion = motion_with_reading(fit, self.o, joint)
        error = error_of_reading(motion, fit.residuals[self.chosen] * fit.unit_factor)
        turns = fit.machine.joints[joint].revolute
        unit, factor = ("arcsec", 1 / ARCSEC) if turns else (self.shown.unit, self.shown.factor)
        return error * factor, unit

    # against what -------------------------------------------------------------------------------------------------

    def drivers(self, most: int = 2) -> list[Against]:
        """Return what the effects that were found depend on, in their order; then the joints that moved."""
        found: list[Against] = []
        for one in self._candidates():
            if len(found) == most:
                break
            varies = np.ptp(one.driver.noted) > 0
            if varies and not any(_same(one.driver, other.driver) for other in found):
                found.append(one)
        return found

    def _candidates(self) -> Iterator[Against]:
        machine = self.base.machine
        known = {driver.name: driver for driver in self.o.drivers()}
        joints = self.o.drivers("joint")
        order = order_of_rows(self.o)
        for step in self.diagnosis.steps:
            place, definition = step.effect.place, step.effect.definition
            names = definition.formula.names
            own = next((joint for joint in joints if joint.name == place), None)
            reading = own.number if own and definition.component == "reading" else None
            if own is not None:
                by = {"T": f"T_{place}", "F": "load", "v": f"v_{place}"}
                for name, column in by.items():
                    if name in names and column in known:
                        yield Against(known[column], reading)
                approach = self.o.s[:, own.number] if "s" in names else None
                yield Against(own, reading, approach)
            elif definition.component == "lift":
                yield Against(self._altitude())
            elif definition.component in {"frame", "frame_shift"} and "t" in known:
                yield Against(known["t"])
            elif definition.component == "target" and len(machine.targets) > 1:
                yield Against(known["target"])
            else:
                yield Against(order)
        for form in self.diagnosis.unexplained:
            driver = known.get(form.driver)
            if driver is not None:
                yield Against(driver, driver.number if form.component == "reading" else None)
        moved = sorted(joints, key=lambda driver: -len(driver.distinct))
        for driver in moved[:1] if self.diagnosis.steps else moved[:2]:
            yield Against(driver)
        if not self.diagnosis.steps:
            yield Against(order)

    def _altitude(self) -> Driver:
        altitude = np.degrees(np.arcsin(np.clip(self.o.reading @ up_of(self.base), -1, 1)))
        return Driver("place", "altitude", altitude, altitude, "deg", "the altitude")


def coordinate(o: Observations, joint: int) -> tuple[str, float]:
    """Return the unit in which a joint's coordinate is shown, that of the data, and its internal value."""
    return column_unit(o, o.machine.joints[joint].name)


def _same(one: Driver, other: Driver) -> bool:
    if one.name == other.name:
        return True
    a, b = one.noted - one.noted.mean(), other.noted - other.noted.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return size > 0 and abs(float(a @ b)) > SAME * size


def _short(value: float) -> str:
    return minus(f"{value:.6g}")


def _signed(value: float) -> str:
    return ("−" if value < 0 else "+") + three_digits(abs(float(value)))
