"""What is diagnosed: a fit, and how it is fitted anew with other effects."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from rodgen.array_types import Mask
from rodgen.calibration.checks.bounds import are_wrong
from rodgen.calibration.file_check import check
from rodgen.data.observations import Observations
from rodgen.machines.machine import Machine
from rodgen.stages import stage

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit


@dataclass(frozen=True, eq=False)
class Subject:
    """A fit to be diagnosed."""

    fitted: Fit
    others: Observations | None
    """Further measurements, of which the error is reported."""
    prefer: Collection[tuple[str, str | None]]
    """As of :func:`diagnose`."""
    doubted: bool
    """Whether bounds of the machine file that the readings contradict are left out."""
    made: dict[tuple[bytes, tuple[object, ...]], Fit] = field(default_factory=dict, repr=False)
    """Fits by the outliers and by effects and forms; see `once`."""

    @classmethod
    def of(
        cls,
        fitted: Fit,
        others: Observations | None,
        prefer: Collection[tuple[str, str | None]] = (),
        *,
        doubted: bool = False,
    ) -> Subject:
        """Return what is to be diagnosed of a fit, as the attributes say."""
        if doubted:
            fitted = without_wrong_bounds(fitted)
        return cls(fitted, others, prefer, doubted)

    @property
    def observations(self) -> Observations:
        """Those of the fit."""
        return self.fitted.observations

    @stage("further fits")
    def fit(self, machine: Machine, outliers: Mask) -> Fit:
        """Fit another machine to the same observations without some outliers."""
        return self.fitted.refit(machine, self.observations, outliers=outliers)

    def once(self, outliers: Mask, which: tuple[object, ...], make: Callable[[], Fit]) -> Fit:
        """Return the fit without outliers of what `which` says, made the first time: rounds and tests ask again."""
        key = outliers.tobytes(), which
        if key not in self.made:
            self.made[key] = make()
        return self.made[key]

    @cached_property
    def unread(self) -> list[str]:
        """Names of targets without a reading: where they are changes nothing here."""
        o = self.observations
        return [t.name for k, t in enumerate(o.machine.targets) if k not in o.target]

    @cached_property
    def wrong_file(self) -> str:
        """What is wrong with the machine file or the data; empty where they are plausible."""
        with stage("checking the files"):
            return check(self.fitted).sentence


def without_wrong_bounds(fit: Fit) -> Fit:
    """Return a fit without the bounds that its readings contradict."""
    freed = fit.without_bounds
    return fit if freed is None or not are_wrong(fit, freed) else freed
