"""What is diagnosed: a fit, whether its data allow an answer, and its full fits with further effects and forms."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Mask
from rodgen.calibration.checks.effect_test import are_wrong
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.uncatalogued import Explanation
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


# Full fits of what explains the residuals: with one effect after the other, then one form after the other.


@dataclass(frozen=True, eq=False)
class FittedExplanation:
    """What explains the residuals, with full fits."""

    explanation: Explanation
    fits: list[Fit]
    """Of the model as it was, and with one effect after the other."""
    formed: list[Fit]
    """With one form after the other in addition."""

    @classmethod
    def of(cls, subject: Subject, base: Fit, explanation: Explanation) -> FittedExplanation:
        """Fit the effects and forms of an explanation."""
        fits = with_effects(subject, [base], explanation.kept)
        return cls(explanation, fits, with_forms(subject, fits[-1], explanation))

    @property
    def last(self) -> Fit:
        """The fit with all effects and forms."""
        return [*self.fits, *self.formed][-1]

    def without(self, subject: Subject, candidate: Candidate) -> Fit:
        """Return the fit without one of the effects, begun from where the last one ended."""
        kept, forms, last = self.explanation.kept, self.explanation.forms, self.last
        if candidate is kept[-1] and not forms:
            return self.fits[-2]
        machine = last.machine.without_effect(candidate.effect.name, candidate.effect.place)
        made = partial(subject.fit, machine, last.outliers)
        return subject.once(last.outliers, (*kept, *forms, "without", candidate), made)


def with_effects(subject: Subject, begun: Sequence[Fit], chosen: Sequence[Candidate]) -> list[Fit]:
    """Fit the model with one effect after the other, each from where the one before ended.

    Parameters
    ----------
    begun : sequence of Fit
        Of the model as it was, and with the first of the effects, as far as they are made already.
    """
    fits = list(begun)
    outliers = fits[0].outliers
    for k, candidate in enumerate(chosen[len(fits) - 1 :], len(fits)):
        made = partial(_with_effect, subject, fits[-1].machine, candidate, outliers)
        fits.append(subject.once(outliers, tuple(chosen[:k]), made))
    return fits


def _with_effect(
    subject: Subject, machine: Machine, candidate: Candidate, outliers: NDArray[np.bool_]
) -> Fit:
    machine = machine.with_effect(candidate.effect)
    searched = {candidate.effect.key(name): value for name, value in candidate.searched.items()}
    machine = replace(machine, values={**machine.values, **searched})
    found = subject.fit(machine, outliers)
    if not found.solution.converged:  # it crept along a narrow valley: once more, from where it ended
        found = subject.fit(found.machine, outliers)
    return without_wrong_bounds(found) if subject.doubted else found


def with_forms(subject: Subject, final: Fit, explanation: Explanation) -> list[Fit]:
    """Fit the model with all effects and one form of an explanation after the other.

    Parameters
    ----------
    final : Fit
        With its effects.
    """
    found = [final]
    for k, form in enumerate(explanation.forms, 1):
        machine = found[-1].machine
        made = partial(subject.fit, machine.with_effect(form.effect(machine)), final.outliers)
        found.append(subject.once(final.outliers, (*explanation.kept, *explanation.forms[:k]), made))
    return found[1:]
