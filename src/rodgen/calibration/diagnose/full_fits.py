"""Full fits of what explains the residuals: with one effect after the other, then one form after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.subject import Subject, without_wrong_bounds
from rodgen.calibration.diagnose.uncatalogued import Explanation

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit
    from rodgen.machines.machine import Machine


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
