"""Every effect that a fit may lack, as a user looks for it: how much it would explain, and how likely it is.

The list is that from which a diagnosis chooses, at one fit: what its selection takes stands first, each followed by
what these data cannot tell from it; then the others by evidence and odds, last what chance explains as well. Full fits
confirm nothing here, so that it takes a fraction of a second, and is made anew after every change of the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.diagnose.aliases import Equal, equals_of, why_alike
from rodgen.calibration.diagnose.candidate_space import Score
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.evidence import Evidence, Screening, gather_evidence
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.machines.machine import Effect
from rodgen.statistics.columns import orthonormal_basis, project_out, unit_columns, visible_part
from rodgen.statistics.decompositions import lstsq
from rodgen.statistics.f_tests import p_of_log10
from rodgen.statistics.thresholds import SELECTION

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit


@dataclass(frozen=True)
class Suspect:
    """An effect that may be missing."""

    effect: Effect
    p_value: float
    log10_p: float
    """Probability that chance explains as much for any of the suspects."""
    statistic: float
    """F."""
    odds: float
    """How likely it is before any data, compared with the commonest effects."""
    possible: bool
    """Whether it would be of a size and a sign that a machine may have; asked of those beyond chance only."""
    rms: float
    """Error that a fit with it would leave, to first order, in the fit's unit."""
    visible: float
    """Part of its change of the readings, 0 to 1, that the model cannot imitate."""
    like: Effect | None = None
    """The effect that stands before it in the list and from which these data cannot tell it."""
    why: str = ""
    """Why they cannot: a sentence; empty without `like`."""


@dataclass(frozen=True, eq=False)
class Suspects:
    """The suspects of a fit, likeliest first; those that these data cannot tell apart follow each other."""

    fit: Fit
    listed: tuple[Suspect, ...]
    rows: NDArray[np.int_]
    """Rows of the fit's observations that this is based on."""
    _evidence: Evidence
    _scores: Sequence[Score]

    def explained(self, effect: Effect) -> Array:
        """Return the part of the residuals of `rows` that an effect would explain, (rows, m), in the fit's unit.

        The model's parameters change with it, to first order.
        """
        candidate = next(s.candidate for s in self._scores if s.candidate.key == effect.identity)
        of = self._evidence.sensitivities
        columns = np.concatenate([of.model, candidate.columns], axis=2)
        flat = unit_columns(columns.reshape(of.residual.size, -1))
        with one_thread_in_blas():
            found = lstsq(flat, of.residual.ravel(), relative=1e-10)
        weight = np.where(of.weight > 0, of.weight, 1.0)
        before = of.residual / weight
        part = (flat @ found).reshape(before.shape) / weight
        error, arm = self.fit.machine.measurand.error, self.fit.observations.arm
        return np.asarray((error(before, arm) - error(before - part, arm)) / self.fit.unit_factor)


def suspects(fit: Fit) -> Suspects:
    """Return every effect of the catalogue that a fit may lack, scored at the fit."""
    with one_thread_in_blas():
        evidence, chosen = gather_evidence(fit, Screening.at(fit))
        selection = evidence.selection
        scores = selection.scores([])
        left = _left(evidence, [s.candidate for s in scores])
        groups = _groups(evidence, fit, chosen, scores)
    log10_tests = float(np.log10(selection.tests(())))
    level = float(np.log10(selection.level))
    listed: list[Suspect] = []
    for group in groups:
        for score, why in group:
            log10 = min(score.log_p / float(np.log(10)) + log10_tests, 0.0)
            candidate = score.candidate
            listed.append(
                Suspect(
                    candidate.effect,
                    p_of_log10(log10),
                    log10,
                    score.statistic,
                    float(np.exp(candidate.prior.log_odds)),
                    log10 > level or candidate not in selection.impossible([candidate], score.left),
                    fit.rms * float(np.sqrt(left[candidate.key])),
                    score.visible,
                    None if score is group[0][0] else group[0][0].candidate.effect,
                    why,
                )
            )
    return Suspects(fit, tuple(listed), evidence.sensitivities.rows, evidence, scores)


def _groups(
    evidence: Evidence, fit: Fit, chosen: Sequence[Candidate], scores: Sequence[Score]
) -> list[list[tuple[Score, str]]]:
    """Return the scores in groups that these data cannot tell apart, the likeliest first, each with why they cannot."""
    selection = evidence.selection
    waiting = {s.candidate.key: s for s in scores}
    kept, groups = list(chosen), []

    def equals(k: int) -> list[Equal]:
        found = equals_of(selection, evidence.sensitivities, fit, kept, k, False, evidence.undecided)
        return [e for e in found if len(e.candidates) == 1 and e.candidates[0].key in waiting]

    for k in range(len(kept)):
        if likelier := [equal for equal in equals(k) if equal.likelier]:
            kept[k] = likelier[0].candidates[0]
        if kept[k].key in waiting:
            group = [(waiting.pop(kept[k].key), "")]
            group += [(waiting.pop(equal.candidates[0].key), equal.alias.why) for equal in equals(k)]
            groups.append(group)
    log10_tests, level = np.log10(selection.tests(())), np.log10(selection.level)
    rest = sorted(
        waiting.values(),
        key=lambda s: (  # last what the model does already, before it what chance explains as well
            not s.dof,
            s.log_p / np.log(10) + log10_tests >= 0,
            s.log_p - s.candidate.prior.log_odds,
        ),
    )
    while rest:
        first = rest.pop(0)
        variance = first.left / max(first.residual_dof, 1)
        like = [
            other
            for other in rest
            if first.dof
            and selection.are_alike((other.left - first.left) / variance, other.parameters - first.parameters)
            and max(first.log_p, other.log_p) / np.log(10) + log10_tests < level
        ]
        rest = [other for other in rest if other not in like]
        whys = [
            why_alike(selection, evidence.sensitivities, first.candidate, kept, [other.candidate])[0]
            for other in like
        ]
        groups.append(list(zip((first, *like), ("", *whys), strict=True)))
    return groups


def _left(evidence: Evidence, found: Sequence[Candidate]) -> dict[tuple[str, str | None], float]:
    """Return the part of the sum of squares that each candidate would leave, as a fit counts readings."""
    of = evidence.sensitivities
    basis = orthonormal_basis(unit_columns(of.model.reshape(of.residual.size, -1)))
    residual = project_out(basis, of.residual.ravel())
    total = float(residual @ residual) or 1.0
    left = {}
    for candidate in found:
        own = unit_columns(candidate.columns.reshape(of.residual.size, -1))
        along = visible_part(basis, own, SELECTION.visible).T @ residual
        left[candidate.key] = max(1 - float(along @ along) / total, 0.0)
    return left
