"""What is diagnosed: a fit, and how it is fitted anew with other effects."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rodgen.array_types import Mask
from rodgen.calibration.checks.effect_test import are_wrong
from rodgen.calibration.file_check import check
from rodgen.calibration.problem.assembly_modes import weakest
from rodgen.data.observations import Observations
from rodgen.errors import joined
from rodgen.machines.machine import Machine
from rodgen.stages import stage
from rodgen.statistics.thresholds import EVIDENCE

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


# Why data allow no diagnosis: the file is wrong, they are too few, or do not determine the model's own parameters.


LEGS_OPEN = "With a further effect the legs no longer close: the geometry, or the order of the legs, is far from right."


def why_undecidable(subject: Subject, base: Fit) -> str:
    """Return why the data allow no answer; empty where they do.

    Parameters
    ----------
    base : Fit
        Without outliers.
    """
    wrong = subject.wrong_file or why_wrong_geometry(base)
    if wrong:
        return wrong
    if base.degrees_of_freedom < EVIDENCE.fewest_residual_dof:
        return (
            f"Only {base.degrees_of_freedom} readings more than parameters that they determine; "
            f"a test needs at least {EVIDENCE.fewest_residual_dof}."
        )
    poses = len(np.unique(base.observations.pose[~base.outliers]))
    if poses < EVIDENCE.fewest_poses:
        return f"Only {poses} pose{'s' * (poses != 1)}; a test needs at least {EVIDENCE.fewest_poses}."
    unread = tuple(f"target.{name}." for name in subject.unread)
    lacking = [
        d.text
        for d in base.determinacy.directions
        if not d.gauge and not d.still and not all(key.startswith(unread) for key, _ in d.parts)
    ]
    return " ".join(lacking[:3])


def on_unmoved_joints(base: Fit) -> list[str]:
    """Return a sentence on joints that never moved though parameters depend on that; nothing without any."""
    names = list(dict.fromkeys(name for d in base.determinacy.directions for name in d.still))
    if not names:
        return []
    moves, it = ("never moves", "it") if len(names) == 1 else ("never move", "they")
    return [
        f"{joined(names)} {moves} in these data: what {it} would determine of the machine is held near the file, and "
        f"effects that show only when {it} move{'s' * (it == 'it')} are not judged. Measure at other positions, too."
    ]


def why_wrong_geometry(base: Fit) -> str:
    """Return why a closed chain is far from what was measured; empty where it is not."""
    if base.problem.is_closed_chain and not base.solution.converged:
        row = weakest(base.observations)
        near = f", as in {base.observations.data.place(row)}" if row is not None else ""
        return f"The fit stopped where legs do not close: near a singular pose{near}, or far from the right geometry."
    return ""
