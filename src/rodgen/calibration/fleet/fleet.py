"""The results of many machines: which effects they share, which machines are odd, and what changes by night."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.fleet.changes import Changes, Night
from rodgen.calibration.fleet.store import FleetMachine, Plan, read_plan, read_result, title_of
from rodgen.document import Document, Documented
from rodgen.methods import method
from rodgen.statistics.random_effects import Population, discovery_rates, population
from rodgen.statistics.thresholds import FLEET
from rodgen.views import Result, plain


@dataclass(frozen=True, eq=False)
class FleetParameter:
    """A parameter of machines of one kind.

    Attributes
    ----------
    key, unit : str
    effect : str
        Title of the effect that it is of; empty of one of the machine file.
    machines : tuple of str
        In which it is known, (n,).
    values, std : ndarray, shape (n,)
        Of each machine by itself.
    population : Population
        How they are distributed, and what is known of each given the others.
    """

    key: str
    unit: str
    effect: str
    machines: tuple[str, ...]
    values: Array
    std: Array
    population: Population

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, without the single machines."""
        p = self.population
        return {
            **plain(self, "key unit"),
            "machines": len(self.machines),
            **plain(p, "mean mean_std spread spread_interval"),
            "typical_std": float(np.median(self.std)),
            "odd": [self.machines[i] for i in np.flatnonzero(p.odd)],
        }


@dataclass(frozen=True, eq=False)
class FleetEffect(Result):
    """An effect of machines of one kind.

    Attributes
    ----------
    title : str
    found, alike, of : int
        Machines in which it was found, machines whose data cannot tell it from what was found there, and all.
    parameters : tuple of FleetParameter
        Empty where fewer machines have an estimate than a distribution needs, or where it has a period of each
        machine's own.
    """

    title: str
    found: int
    alike: int
    of: int
    parameters: tuple[FleetParameter, ...]

    _keys = "effect=title found alike of common on_average parameters"

    @property
    def on_average(self) -> bool:
        """Whether no machine shows it by itself, and all together do."""
        return not self.found

    @property
    def common(self) -> bool:
        """Whether so many machines have it that it belongs to their design."""
        return self.found + self.alike >= FLEET.common * self.of and self.found > 1


@dataclass(frozen=True, eq=False)
class Kind:
    """Machines of one design: the same joints, effects in the file, and kind of reading.

    Attributes
    ----------
    title : str
    machines : tuple of FleetMachine
    parameters : tuple of FleetParameter
        Those that enough machines have: of the file, of every effect of the catalogue, and the error.
    effects : tuple of FleetEffect
        Those found in some machine, the commonest first, then those that are there on average only.
    """

    title: str
    machines: tuple[FleetMachine, ...]
    parameters: tuple[FleetParameter, ...]
    effects: tuple[FleetEffect, ...]


@dataclass(frozen=True)
class Odd(Result):
    """A parameter of a machine that is not like that of the others.

    Attributes
    ----------
    machine, key, unit, effect : str
    value, std : float
    mean, mean_std, spread : float
        Of the others.
    p_value : float
        Probability that one of them is as far from the mean.
    """

    machine: str
    key: str
    unit: str
    effect: str
    value: float
    std: float
    mean: float
    mean_std: float
    spread: float
    p_value: float


@dataclass(frozen=True, repr=False, eq=False)
class Fleet(Documented, Result):
    """The results of a fleet.

    Attributes
    ----------
    folder : str
    plan : Plan
    machines : tuple of FleetMachine
    """

    folder: str
    plan: Plan
    machines: tuple[FleetMachine, ...]

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Fleet:
        """Return the results in a folder, also of a run that goes on.

        Raises
        ------
        InputFileError
            When it has none.
        """
        name = os.fspath(folder)
        plan = read_plan(name)
        return cls(
            name, plan, tuple(FleetMachine(each, read_result(name, each) or {}) for each in plan.machines)
        )

    @property
    def failed(self) -> list[FleetMachine]:
        """Machines that could not be diagnosed."""
        return [machine for machine in self.machines if machine.error]

    @property
    def pending(self) -> list[FleetMachine]:
        """Machines that were not diagnosed yet."""
        return [machine for machine in self.machines if not machine.result]

    @property
    def diagnosed(self) -> list[FleetMachine]:
        """Machines that were."""
        return [machine for machine in self.machines if "fleet" in machine.result]

    @cached_property
    def kinds(self) -> tuple[Kind, ...]:
        """Machines by design, the largest group first."""
        by: dict[str, list[FleetMachine]] = {}
        for machine in self.diagnosed:
            by.setdefault(machine.kind, []).append(machine)
        return tuple(
            _kind(title, some) for title, some in sorted(by.items(), key=lambda one: (-len(one[1]), one[0]))
        )

    @cached_property
    def odd(self) -> tuple[Odd, ...]:
        """What does not fit the other machines, the farthest first."""
        found = (one for kind in self.kinds for one in _odd(kind))
        return tuple(sorted(found, key=lambda one: (one.p_value, one.machine)))

    @cached_property
    def changes(self) -> Changes:
        """The tests of the earlier nights and this one.

        Raises
        ------
        InputFileError
            When earlier results cannot be read, or two have the same date.
        """
        earlier = [Fleet.load(folder) for folder in self.plan.history]
        nights = [Night(fleet.plan.date, {m.name: m for m in fleet.diagnosed}) for fleet in (*earlier, self)]
        return Changes(sorted(nights, key=lambda night: night.time), self.plan.false_alarms)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, as ``rodgen fleet --json`` prints it."""
        return {
            "date": self.plan.date,
            "machines": len(self.machines),
            "verdicts": Counter(str(machine.result["verdict"]) for machine in self.diagnosed),
            "failed": {machine.name: machine.error for machine in self.failed},
            "pending": [machine.name for machine in self.pending],
            "kinds": [
                {
                    "kind": kind.title,
                    "machines": [machine.name for machine in kind.machines],
                    **plain(kind, "effects"),
                    "parameters": [p.to_dict() for p in kind.parameters if not p.effect],
                }
                for kind in self.kinds
            ],
            **plain(self, "odd"),
            "nights": [night.date for night in self.changes.nights],
            **plain(self, "changes=changes.found"),
            "alarms": {
                "false_alarms_per_year": self.plan.false_alarms,
                "tests": self.changes.tests,
                "threshold": self.changes.threshold,
                "machines": sorted({change.machine for change in self.changes.found}),
            },
        }

    document = cast("Callable[..., Document]", method())


def _kind(title: str, machines: Sequence[FleetMachine]) -> Kind:
    counts_of = Counter(effect for machine in machines for effect in machine.found)
    alike = Counter(
        effect
        for machine in machines
        for effect in {o for others in machine.alike.values() for o in others}.difference(machine.found)
    )
    titles: dict[str, str] = {}
    columns: dict[tuple[str, str], list[tuple[str, float, float]]] = {}
    for machine in machines:
        for start, (name, place) in machine.result["fleet"]["with_found"]["effects"].items():
            titles[start] = title_of(name, place)
        taken = {
            effect
            for effect, others in machine.alike.items()
            if any(counts_of[o] > counts_of[effect] for o in others)
        }
        for key, (value, std, unit) in machine.estimates().items():
            if titles.get(key.rpartition(".")[0]) in taken:
                continue
            columns.setdefault((key, unit), []).append((machine.name, value, std))
    parameters = tuple(
        _parameter(key, unit, titles.get(key.rpartition(".")[0], ""), some)
        for (key, unit), some in columns.items()
        if len(some) >= FLEET.fewest
    )
    counts = {p.effect: 0 for p in _there_on_average(parameters)} | counts_of
    effects = tuple(
        FleetEffect(
            effect, n, alike[effect], len(machines), tuple(p for p in parameters if p.effect == effect)
        )
        for effect, n in sorted(counts.items(), key=lambda one: (-one[1], -alike[one[0]], one[0]))
    )
    return Kind(title, tuple(machines), parameters, effects)


def _there_on_average(parameters: Sequence[FleetParameter]) -> list[FleetParameter]:
    """Return the parameters of effects whose mean over all machines is beyond chance."""
    from scipy import special

    some = [p for p in parameters if p.effect]
    sizes = np.array([abs(p.population.mean) / p.population.mean_std for p in some])
    degrees = np.array([len(p.machines) - 1.0 for p in some])
    rates = discovery_rates(2 * special.stdtr(degrees, -sizes))
    return [p for p, rate in zip(some, rates, strict=True) if rate < FLEET.false_discoveries]


def _parameter(key: str, unit: str, effect: str, some: Sequence[tuple[str, float, float]]) -> FleetParameter:
    names, values, std = zip(*some, strict=True)
    arrays = np.array(values), np.array(std)
    return FleetParameter(key, unit, effect, names, *arrays, population(*arrays))


def _odd(kind: Kind) -> Iterator[Odd]:
    """Yield what is odd among all parameters of machines of one kind."""
    if not kind.parameters:
        return
    rates = discovery_rates(np.concatenate([p.population.p_value for p in kind.parameters]))
    ends = np.cumsum([len(p.machines) for p in kind.parameters])
    for p, rates_of in zip(kind.parameters, np.split(rates, ends[:-1]), strict=True):
        of = p.population
        for i in np.flatnonzero(rates_of < FLEET.false_discoveries):
            yield Odd(
                p.machines[i], p.key, p.unit, p.effect, float(p.values[i]), float(p.std[i]), of.mean, of.mean_std,
                of.spread, float(of.p_value[i]),
            )  # fmt: skip
