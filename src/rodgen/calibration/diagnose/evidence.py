"""What decisions are based on: the columns of all candidates, how readings depend on each other, the selection."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rodgen.array_types import Mask
from rodgen.calibration.checks.gross import gross_errors, unless_neighbours
from rodgen.calibration.diagnose.candidate_space import CandidateSpace
from rodgen.calibration.diagnose.candidates import Candidate, candidates, without_imitated
from rodgen.calibration.diagnose.poses import Blocks, Clusters, stretches_of_time
from rodgen.calibration.diagnose.selection import Selection
from rodgen.calibration.diagnose.sensitivities import Sensitivities
from rodgen.calibration.diagnose.uncatalogued import Contest
from rodgen.calibration.fitted import FittedModel
from rodgen.calibration.noise.correlation import Correlation, estimate_correlation
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.stages import stage
from rodgen.statistics.columns import unchanged

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit


@dataclass(frozen=True, eq=False)
class Screening:
    """The sensitivities of a fit, and the columns of all candidates there."""

    sensitivities: Sensitivities
    candidates: list[Candidate]

    @classmethod
    def at(cls, base: Fit, prefer: Collection[tuple[str, str | None]] = ()) -> Screening:
        """Return those of a fit; preferred effects are named first among equals."""
        with stage("sensitivities of the candidates"):
            effects = catalogue_effects(base.machine, base.observations)
            sensitivities = Sensitivities.of(base, effects)
            found = candidates(sensitivities, effects, prefer)
            return cls(sensitivities, without_imitated(found, sensitivities.model))


@dataclass(frozen=True, eq=False)
class Evidence:
    """The fit without outliers, and the space of all columns with its residual."""

    base: Fit
    sensitivities: Sensitivities
    correlation: Correlation
    space: CandidateSpace
    """Of all candidates."""
    selection: Selection
    """Among those that full fits did not refuse."""
    undecided: tuple[Candidate, ...] = ()
    """Those refused of which more positions of a joint would tell."""

    @property
    def contest(self) -> Contest:
        """Of forms with effects of the catalogue."""
        whiten = unchanged if self.correlation.independent else self.correlation.whiten
        return Contest(self.sensitivities, whiten, self.selection, self.undecided)


def gather_evidence(
    base: Fit,
    screening: Screening,
    refused: Collection[tuple[str, str | None]] = (),
    wander: Collection[tuple[str, str | None]] = (),
) -> tuple[Evidence, list[Candidate]]:
    """Return the evidence, and the effects that are selected by it.

    Parameters
    ----------
    base : Fit
        Without outliers.
    screening : Screening
        Of it.
    refused : collection of (name, place)
        Effects that are not selected.
    wander : collection of (name, place)
        Effects that are taken for a wander of the set-up when that is estimated.
    """
    nuisance = [c for c in screening.candidates if c.key not in wander]
    first = _correlation(screening, nuisance, [])
    evidence, chosen = _selected(base, screening, first, refused)
    known = [c for c in chosen if not c.effect.definition.follows_time]
    # a large effect hides how the set-up wanders, and what is slow must stand against that
    if not known or (len(known) == len(chosen) and not first.independent):
        return evidence, chosen
    correlation = _correlation(screening, nuisance, known)
    if first.independent and correlation.independent:
        return evidence, chosen
    return _selected(base, screening, correlation, refused)


@stage("estimating the correlation")
def _correlation(
    screening: Screening, nuisance: Sequence[Candidate], known: Sequence[Candidate]
) -> Correlation:
    """Return how the readings depend on each other if some effects are there, and others may be."""
    columns, tries = [c.columns for c in nuisance], [c.tries for c in nuisance]
    return estimate_correlation(screening.sensitivities, columns, tries, [c.columns for c in known])


@stage("testing effects")
def _selected(
    base: Fit, screening: Screening, correlation: Correlation, refused: Collection[tuple[str, str | None]]
) -> tuple[Evidence, list[Candidate]]:
    """Return the evidence where readings depend on each other so, and what is selected by it."""
    evidence = _evidence_given(base, screening, correlation, refused)
    selection, chosen = evidence.selection.or_balanced(evidence.selection.run())
    return replace(evidence, selection=selection), chosen


def _evidence_given(
    base: Fit,
    screening: Screening,
    correlation: Correlation,
    refused: Collection[tuple[str, str | None]] = (),
) -> Evidence:
    """Return the evidence where readings depend on each other so."""
    sensitivities = screening.sensitivities
    o, model = sensitivities.observations, sensitivities.model
    space = CandidateSpace(model, screening.candidates, correlation.whiten)
    blocks = Blocks(o, model, sensitivities.residual)
    stretches = None
    if not correlation.independent:
        stretches = Blocks(o, model, sensitivities.residual, stretches_of_time(o))
    clusters = Clusters(sensitivities, correlation.whiten)
    selection = Selection(
        space.without(refused) if refused else space, blocks, base.observations.n, clusters, stretches
    )
    return Evidence(base, sensitivities, correlation, space, selection)


# Rows that are left out as wrong before anything is found: those that no candidate explains.


@stage("looking for outliers")
def gross_rows_of(fitted: FittedModel, screening: Screening) -> Mask:
    """Return the rows, (n,), that no candidate explains.

    Parameters
    ----------
    screening : Screening
        Of it.
    """
    sensitivities = screening.sensitivities
    some = (c.columns for c in _a_few_of_each(screening.candidates))
    every = np.concatenate([sensitivities.model[:, :, :0], *some], axis=2)
    wrong, left = gross_errors(sensitivities.model, every, sensitivities.residual)
    found = np.zeros(fitted.observations.n, bool)
    residual = np.zeros((len(found), left.shape[1]))
    found[sensitivities.rows[wrong]] = True
    residual[sensitivities.rows] = left
    return unless_neighbours(fitted, found, residual)


def _a_few_of_each(found: Iterable[Candidate]) -> list[Candidate]:
    """Return the candidates; of those with a searched parameter at most seven of its values, evenly spread.

    Of those with weights at later joints the one with all of these.
    """
    by_key: dict[tuple[str, str | None], list[Candidate]] = {}
    for candidate in found:
        by_key.setdefault(candidate.key, []).append(candidate)
    return [
        c
        for several in by_key.values()
        for c in (several[-1:] if several[-1].later_weights else several[:: max(len(several) // 4, 1)])
    ]
