"""What drifts or has changed from night to night, and alarms at a rate of false ones that holds for a whole fleet.

Nights of a machine are compared under one model: an effect that is found on one of them only would change the other
parameters there. It is that with the effects found where these are the same on all nights, else that of the machine
file, to which each further effect is added alone. Nights with another machine file are not compared.

Each night every parameter of every machine is tested twice, for a trend and for a change of level. An alarm has a
p-value below false alarms a year / (nights a year x tests a night): as many false ones are expected, whatever the tests
have in common. What is merely listed has a rate of false discoveries.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Protocol

import numpy as np

from rodgen.array_types import Array
from rodgen.statistics.drift import Drifts, drifts
from rodgen.statistics.random_effects import discovery_rates
from rodgen.statistics.thresholds import FLEET
from rodgen.views import Result

DAY = 86400.0


class Measured(Protocol):
    """A machine as one night shows it."""

    @property
    def kind(self) -> str:
        """Its design."""

    @property
    def model(self) -> str:
        """The content of its machine file, by the hash."""

    @property
    def found(self) -> list[str]:
        """Titles of the effects that were found."""

    @property
    def degrees_of_freedom(self) -> float:
        """With which standard deviations are known."""

    def estimates(self, which: str = "with_found") -> Mapping[str, tuple[float, float, str]]:
        """Return values, standard deviations and units by key."""


@dataclass(frozen=True, eq=False)
class Night:
    """What was measured on one date.

    Attributes
    ----------
    date : str
    machines : mapping of str to Measured
    """

    date: str
    machines: Mapping[str, Measured]

    @property
    def time(self) -> float:
        """The date in days."""
        return (moment(self.date) - datetime(2000, 1, 1)).total_seconds() / DAY


def moment(date: str) -> datetime:
    """Return a date, which may have a time.

    Raises
    ------
    ValueError
        When it is none.
    """
    found = datetime.fromisoformat(date)
    return found if found.tzinfo is None else found.astimezone(UTC).replace(tzinfo=None)


@dataclass(frozen=True)
class Change(Result):
    """A parameter of a machine that is not the same on all nights.

    Attributes
    ----------
    machine, key, unit : str
    what : {"trend", "change"}
    size, std : float
        Of a trend per day; of a change the difference of the levels.
    since : str
        Date of the first night after a change; of the first night of a trend.
    p_value : float
    rate : float
        Least rate of false discoveries, among all tests, at which it is one.
    alarm, new : bool
        Whether it is beyond the threshold for alarms, and whether it was not the night before.
    """

    machine: str
    key: str
    unit: str
    what: str
    size: float
    std: float
    since: str
    p_value: float
    rate: float
    alarm: bool
    new: bool


@dataclass(frozen=True, eq=False)
class _Rows:
    """One parameter of machines of one kind, by night."""

    key: str
    unit: str
    machines: list[str]
    values: Array
    std: Array
    degrees: Array

    def tests(self, times: Array, nights: int) -> Drifts:
        values = np.where(np.arange(len(times)) < nights, self.values, np.nan)
        return drifts(values, self.std, self.degrees, times)


class Changes:
    """The tests of all nights of a fleet.

    Parameters
    ----------
    nights : sequence of Night
        By date; the last one is that of which alarms are.
    false_alarms : float
        For the whole fleet, a year.
    """

    def __init__(self, nights: Sequence[Night], false_alarms: float) -> None:
        self.nights, self.false_alarms = nights, false_alarms
        self.times = np.array([night.time for night in nights])

    @cached_property
    def rows(self) -> list[_Rows]:
        """What is tested."""
        by: dict[tuple[str, str, str], list[tuple[str, list[tuple[int, float, float, float]]]]] = {}
        for name, tonight in self.nights[-1].machines.items():
            seen = self._nights_of(name)
            which = "with_found" if len({tuple(sorted(m.found)) for _, m in seen}) == 1 else "as_file"
            points: dict[tuple[str, str], list[tuple[int, float, float, float]]] = {}
            for t, machine in seen:
                for key, (value, std, unit) in machine.estimates(which).items():
                    points.setdefault((key, unit), []).append((t, value, std, machine.degrees_of_freedom))
            for (key, unit), some in points.items():
                if len(some) > 1 and some[-1][0] == len(self.nights) - 1:
                    by.setdefault((tonight.kind, key, unit), []).append((name, some))
        return [self._row(key, unit, each) for (_, key, unit), each in by.items()]

    def _nights_of(self, name: str) -> list[tuple[int, Measured]]:
        """Return the nights that have a machine with the file that it has tonight."""
        model = self.nights[-1].machines[name].model
        found = ((t, night.machines.get(name)) for t, night in enumerate(self.nights))
        return [(t, machine) for t, machine in found if machine is not None and machine.model == model]

    def _row(
        self, key: str, unit: str, each: list[tuple[str, list[tuple[int, float, float, float]]]]
    ) -> _Rows:
        arrays = np.full((3, len(each), len(self.nights)), np.nan)
        for i, (_, points) in enumerate(each):
            for t, *numbers in points:
                arrays[:, i, t] = numbers
        return _Rows(key, unit, [name for name, _ in each], *arrays)

    @property
    def tests(self) -> int:
        """Tests of one night."""
        return 2 * sum(len(row.machines) for row in self.rows)

    @property
    def threshold(self) -> float:
        """P-value below which there is an alarm."""
        return self.false_alarms / (FLEET.nights * max(self.tests, 1))

    @cached_property
    def found(self) -> tuple[Change, ...]:
        """What drifts or has changed, the surest first; alarms among them."""
        count = len(self.nights)
        tested = [(row, row.tests(self.times, count)) for row in self.rows]
        if not tested:
            return ()
        p = np.concatenate([np.stack([d.trend_p, d.change_p]) for _, d in tested], axis=1)
        rates = discovery_rates(p)
        found, start = list[Change](), 0
        for row, d in tested:
            own = slice(start, start + len(row.machines))
            start = own.stop
            wanted = (rates[:, own].min(axis=0) < FLEET.false_discoveries) | (
                p[:, own].min(axis=0) < self.threshold
            )
            if wanted.any():
                before = row.tests(self.times, count - 1)
                found += [
                    self._change(row, i, d, before, rates[:, start - len(row.machines) + i])
                    for i in np.flatnonzero(wanted).tolist()
                ]
        return tuple(sorted(found, key=lambda one: (one.p_value, one.machine, one.key)))

    def _change(self, row: _Rows, i: int, d: Drifts, before: Drifts, rates: Array) -> Change:
        trend = bool(d.trend_p[i] < d.change_p[i])
        at = int(np.flatnonzero(np.isfinite(row.values[i]))[0]) if trend else int(d.at[i])
        p = float(min(d.trend_p[i], d.change_p[i]))
        alarm = p < self.threshold
        return Change(
            row.machines[i],
            row.key,
            row.unit,
            "trend" if trend else "change",
            float((d.slope if trend else d.step)[i]),
            float((d.slope_std if trend else d.step_std)[i]),
            self.nights[at].date,
            p,
            float(rates.min()),
            alarm,
            alarm and not min(before.trend_p[i], before.change_p[i]) < self.threshold,
        )

    def series(self, name: str, key: str) -> Iterator[tuple[str, float, float]]:
        """Yield the nights of a parameter: date, value, standard deviation."""
        for row in self.rows:
            if row.key == key and name in row.machines:
                i = row.machines.index(name)
                for t in np.flatnonzero(np.isfinite(row.values[i])).tolist():
                    yield self.nights[t].date, float(row.values[i, t]), float(row.std[i, t])
