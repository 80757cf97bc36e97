"""What drifts or has changed from night to night: alarms at a rate of false ones that holds for a whole fleet.

Nights of a machine are compared under one model: an effect that is found on one of them only would change the other
parameters there. It is that with the effects found where these are the same on all nights, else that of the machine
file, to which each further effect is added alone. Nights with another machine file are not compared.

Each night every parameter of every machine is tested twice, for a trend and for a change of level. An alarm has a
p-value below false alarms a year / (nights a year x tests a night): as many false ones are expected, whatever the tests
have in common.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.fleet.store import FleetMachine
from rodgen.statistics.drift import drifts
from rodgen.statistics.thresholds import FLEET
from rodgen.views import Result

DAY = 86400.0


class Night(NamedTuple):
    """What was measured on one date.

    Attributes
    ----------
    date : str
    machines : mapping of str to FleetMachine
    """

    date: str
    machines: Mapping[str, FleetMachine]

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
    time = datetime.fromisoformat(date)
    return time if time.tzinfo is None else time.astimezone(UTC).replace(tzinfo=None)


@dataclass(frozen=True)
class Change(Result):
    """An alarm: a parameter of a machine is not the same on all nights.

    Attributes
    ----------
    machine, key, unit : str
    what : {"trend", "change"}
    size, std : float
        Of a trend per day; of a change the difference of the levels.
    since : str
        Date of the first night after a change; of the first night of a trend.
    p_value : float
    """

    machine: str
    key: str
    unit: str
    what: str
    size: float
    std: float
    since: str
    p_value: float


class _Rows(NamedTuple):
    """One parameter of machines of one kind, by night: values, their standard deviations and degrees of freedom."""

    key: str
    unit: str
    machines: list[str]
    numbers: Array  # (N, 3, T)


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
        by: dict[tuple[str, str, str], dict[str, Array]] = {}
        for name, tonight in self.nights[-1].machines.items():
            changes = [
                (t, night.machines[name]) for t, night in enumerate(self.nights) if name in night.machines
            ]
            seen = [(t, machine) for t, machine in changes if machine.model == tonight.model]
            which = "with_found" if len({tuple(sorted(m.found)) for _, m in seen}) == 1 else "as_file"
            for t, machine in seen:
                for key, (value, std, unit) in machine.estimates(which).items():
                    of = by.setdefault((tonight.kind, key, unit), {})
                    row = of.setdefault(name, np.full((3, len(self.nights)), np.nan))
                    row[:, t] = value, std, machine.degrees_of_freedom
        rows = []
        for (_, key, unit), of in by.items():
            known = {name: np.isfinite(row[0]) for name, row in of.items()}
            names = [name for name, there in known.items() if there[-1] and there.sum() > 1]
            rows += [_Rows(key, unit, names, np.stack([of[name] for name in names]))] if names else []
        return rows

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
        """What drifts or has changed, the surest first."""
        alarms = []
        for row in self.rows:
            values, std, degrees = np.moveaxis(row.numbers, 1, 0)
            d = drifts(values, std, degrees, self.times)
            for i in np.flatnonzero(d.p_value.min(axis=0) < self.threshold).tolist():
                k = int(d.p_value[:, i].argmin())
                at = int(d.at[i]) if k else int(np.flatnonzero(np.isfinite(values[i]))[0])
                size, std, p = (float(x[k, i]) for x in (d.size, d.std, d.p_value))
                what, since = ("trend", "change")[k], self.nights[at].date
                alarms.append(Change(row.machines[i], row.key, row.unit, what, size, std, since, p))
        return tuple(sorted(alarms, key=lambda one: (one.p_value, one.machine, one.key)))

    def series(self, name: str, key: str) -> Iterator[tuple[str, float, float]]:
        """Yield the nights of a parameter: date, value, standard deviation."""
        for row in self.rows:
            if row.key == key and name in row.machines:
                values, std, _ = row.numbers[row.machines.index(name)]
                for t in np.flatnonzero(np.isfinite(values)).tolist():
                    yield self.nights[t].date, float(values[t]), float(std[t])
