"""The steps of a diagnosis, from a fit to the verdict.

Effects are selected by their linear columns in one space (`evidence`, `selection`); what is reported comes from full
fits (`subject`, `acceptance`): of the model as it was, with each effect that was found, and with each alternative in
its place. `assemble` puts the answer together.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Array, Mask
from rodgen.calibration.checks.effect_test import held_at_bounds
from rodgen.calibration.checks.gross import disagreeing_rows
from rodgen.calibration.diagnose.acceptance import (
    WRONG_SIGN,
    earned_forms,
    insignificant,
    may_be_there,
    unearned_effect,
    weakest_last,
    worths,
)
from rodgen.calibration.diagnose.aliases import Equal, equals_of, imitation
from rodgen.calibration.diagnose.assemble import Confirmed, assemble_diagnosis, undecided
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.diagnosis import Diagnosis
from rodgen.calibration.diagnose.estimates import EffectEstimates
from rodgen.calibration.diagnose.evidence import Evidence, Screening, gather_evidence, gross_rows_of
from rodgen.calibration.diagnose.subject import (
    LEGS_OPEN,
    FittedExplanation,
    Subject,
    on_unmoved_joints,
    why_undecidable,
    with_effects,
    with_forms,
)
from rodgen.calibration.diagnose.uncatalogued import Explanation
from rodgen.calibration.diagnose.validation import bind_validation
from rodgen.calibration.fitted import FittedModel
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.problem.blocks import observed
from rodgen.calibration.solve.staged_fit import FitError, measured_along
from rodgen.machines.machine import Machine
from rodgen.stages import Progress, each, reporting, stage
from rodgen.statistics.thresholds import EVIDENCE

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit
    from rodgen.data.observations import Observations


def diagnose(
    fitted: Fit | Machine,
    data: Any = None,
    *,
    test: Any = None,
    prefer: Collection[tuple[str, str | None]] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """Find out which physical effects are missing in a machine's model, from measurements alone.

    Parameters
    ----------
    fitted : Fit or Machine
        The model as it is: fitted, or to be fitted to `data`.
    data : Measurements, Observations or a table in memory, optional
        Needed with a machine.
    test : Measurements or a table in memory, optional
        Others, of which the error is reported, too. Only the frame is fitted to them, where it is free.
    prefer : collection of (name, place), optional
        Effects that are named first among what the data cannot tell apart; place None is every place.
    progress : callable, optional
        As of :func:`rodgen.calibration.fit.fit`.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputFileError
        When the data do not fit the machine.
    FitError
        When there is nothing to fit, or no data are given with a machine.
    """
    if isinstance(fitted, FittedModel):
        others = None if test is None else bind_validation(fitted.machine, test)
    else:
        if data is None:
            raise FitError("a machine without measurements; expected both, or a fit")
        observations = observed(fitted, data)
        # Before the fit, which may take long: a fault of the file is reported at once.
        others = None if test is None else bind_validation(fitted, test)
        with reporting(progress):
            fitted = fitted.fit(observations)
    with reporting(progress), one_thread_in_blas():
        diagnosis = _diagnosed(fitted, others, prefer)
        travel = _travel_of_good_rows(diagnosis)
        if travel is not None:
            observations = replace(fitted.observations, travel=travel)
            fitted = fitted.refit(observations=observations, outliers=fitted.outliers)
            diagnosis = _diagnosed(fitted, others, prefer)
        for _ in range(EVIDENCE.balanced):
            arm = diagnosis.final_with_forms.noise_arm
            if abs(math.log(arm / diagnosis.base.observations.arm)) < EVIDENCE.same_arm:
                break
            # what was found was in the noise of positions or attitudes before: weights as without it
            fitted = fitted.refit(
                observations=replace(fitted.observations, arm=arm), outliers=fitted.outliers
            )
            diagnosis = _diagnosed(fitted, others, prefer)
        return diagnosis


def _travel_of_good_rows(diagnosis: Diagnosis) -> Array | None:
    """Return the travels of the joints without the outliers, (J, 2); None where nothing is measured along others."""
    final, o = diagnosis.final_with_forms, diagnosis.base.observations
    if not final.outliers.any():
        return None
    good = o.q[~final.outliers]
    travel = np.array(
        [limits or (q.min(), q.max()) for limits, q in zip(o.machine.limits, good.T, strict=True)]
    )
    along = list(measured_along(final.problem.model))
    return None if np.array_equal(travel[along], o.travel[along]) else travel


def _diagnosed(
    fitted: Fit, others: Observations | None, prefer: Collection[tuple[str, str | None]]
) -> Diagnosis:
    """Return the diagnosis of a fit as it weights its readings."""
    known = fitted.machine.known
    diagnosis = _Search(Subject.of(fitted, others, prefer, doubted=True)).run()
    final = diagnosis.final
    if final.machine.known == known:
        return diagnosis
    bounded = final.refit(replace(final.machine, known=known))
    if bounded.without_bounds is None:  # with what was found, the bounds are right
        return _Search(Subject.of(fitted, others, prefer)).run()
    return replace(diagnosis, wrong_bounds=held_at_bounds(bounded, final))


class _Search:
    """The search for what a subject's model misses."""

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        self.notes: list[str] = []
        self.too_many = 0
        """Rows that disagree with the final model where these are more than may be wrong by chance."""
        known = (subject.observations, subject.others)
        self.notes += [sentence for o in known if o is not None for sentence in o.on_rows]

    def run(self) -> Diagnosis:
        """Return the diagnosis."""
        try:
            return self._run()
        except FitError:
            if not self.subject.fitted.problem.is_closed_chain:
                raise
            return undecided(self.subject, LEGS_OPEN, self.notes)

    def _run(self) -> Diagnosis:
        subject, fitted = self.subject, self.subject.fitted
        if reason := why_undecidable(subject, fitted):
            return undecided(subject, reason, self.notes)
        self.notes += on_unmoved_joints(fitted)
        outliers = fitted.outliers
        first = Screening.at(fitted, subject.prefer)
        if not outliers.any():
            outliers = gross_rows_of(fitted, first)
        for last in (*(EVIDENCE.rounds - 1) * [False], True):
            base, screening = fitted, first
            if not np.array_equal(outliers, base.outliers):
                base = subject.fit(fitted.machine, outliers)
                if reason := why_undecidable(subject, base):
                    return undecided(subject, reason, self.notes)
                screening = Screening.at(base, subject.prefer)
            evidence, chosen = gather_evidence(base, screening)
            found = self._settled(evidence, chosen)
            again = outliers if last else self._outliers_of_final(found.last, outliers)
            if np.array_equal(again, outliers):
                break
            # Few rows differ: the same effects, fitted anew.
            if np.count_nonzero(again != outliers) < EVIDENCE.changed_rows * subject.observations.n:
                evidence = replace(evidence, base=subject.fit(fitted.machine, again))
                found = self._fitted(evidence, found.explanation)
                break
            outliers = again
        return self._confirmed(evidence, found)

    @stage("looking for outliers")
    def _outliers_of_final(self, final: Fit, outliers: Mask) -> Mask:
        """Return the outliers of the final model with its forms; the ones given where these would be too many."""
        found = disagreeing_rows(final)
        self.too_many = int(found.sum()) if found.mean() > EVIDENCE.largest_wrong_part else 0
        return outliers if self.too_many else found

    def _settled(self, evidence: Evidence, chosen: Sequence[Candidate]) -> FittedExplanation:
        """Return what explains the residuals, without effects that are insignificant in the full fits.

        Parameters
        ----------
        chosen : sequence of Candidate
            By the selection.
        """
        chosen, fits = tuple(chosen), with_effects(self.subject, [evidence.base], chosen)
        with stage("forms outside the catalogue"):
            explanation = evidence.contest.by_columns(chosen, evidence.sensitivities.residual_of(fits[-1]))
        if [c.key for c in explanation.kept] == [c.key for c in chosen]:
            formed = with_forms(self.subject, fits[-1], explanation)
            found = FittedExplanation(explanation, fits, formed)
        else:
            found = self._fitted(evidence, explanation)
        if explanation.forms:
            found = self._contested(evidence, found, chosen, fits)
        while unsure := insignificant(self.subject, found, not evidence.correlation.independent):
            kept = tuple(c for c in found.explanation.kept if c is not unsure)
            found = self._fitted(evidence, replace(found.explanation, kept=kept))
        return found

    @stage("effects in the place of forms")
    def _contested(
        self,
        evidence: Evidence,
        found: FittedExplanation,
        chosen: tuple[Candidate, ...],
        fits: Sequence[Fit],
    ) -> FittedExplanation:
        """Return it, or effects of the catalogue in the place of its forms that do as well in full fits.

        Parameters
        ----------
        chosen : tuple of Candidate
            What the selection chose.
        fits : sequence of Fit
            With these, one after the other.
        """
        compete = [found]
        for rival in evidence.contest.rivals(found.explanation, chosen):
            begun = fits if rival[: len(chosen)] == chosen else found.fits
            rival_fits = with_effects(self.subject, begun, rival)
            estimates = EffectEstimates(rival_fits[-1])
            if all(estimates.are_possible(c.effect, evidence.selection.prior_of(c)) for c in rival):
                explanation = Explanation(rival, (), evidence.selection, complete=True)
                compete.append(FittedExplanation(explanation, rival_fits, []))
        residual_of = evidence.sensitivities.residual_of
        return compete[evidence.contest.believed([(c.explanation, residual_of(c.last)) for c in compete])]

    def _confirmed(self, evidence: Evidence, found: FittedExplanation) -> Diagnosis:
        """Return the diagnosis of what full fits confirm, with the likeliest of what they do not tell apart."""
        refused = set[tuple[str, str | None]]()
        while True:
            found, equals = self._likeliest(evidence, found, refused)
            unearned = imitation(evidence.undecided, found.explanation.kept, equals)
            if unearned is None:
                held_out = [fit.held_out() for fit in found.fits]
                order = weakest_last(held_out)
                if order != sorted(order):
                    kept = tuple(found.explanation.kept[k] for k in order)
                    found = self._fitted(evidence, replace(found.explanation, kept=kept))
                    equals = [equals[k] for k in order]
                    held_out = [fit.held_out() for fit in found.fits]
                found, unseen = earned_forms(self.subject, found, held_out[-1])
                held_out += unseen
                tests = worths(self.subject, found)
                unearned = unearned_effect(self.subject, evidence.selection, found, held_out, tests)
            if unearned is None:
                confirmed = Confirmed(found, held_out, equals, tests)
                return assemble_diagnosis(self.subject, evidence, confirmed, self.too_many, self.notes)
            candidate, why = unearned
            kept = found.explanation.kept
            selection = evidence.selection
            balanced = selection.balanced_with(candidate, kept) if why == WRONG_SIGN else None
            if not balanced:
                refused.add(candidate.key)
                if may_be_there(why):
                    evidence = replace(evidence, undecided=(*evidence.undecided, candidate))
                self.notes.append(f"{candidate.effect.title} is not reported: {why}.")
            again = balanced or len(refused) < EVIDENCE.most_refused
            if again and candidate.effect.definition.follows_time:
                evidence, found = self._wandering(evidence, refused)
                continue
            evidence = replace(evidence, selection=balanced or selection.without(candidate))
            # after many the others stay
            chosen = evidence.selection.run() if again else [c for c in kept if c is not candidate]
            found = self._settled(evidence, chosen)

    def _wandering(
        self, evidence: Evidence, refused: Collection[tuple[str, str | None]]
    ) -> tuple[Evidence, FittedExplanation]:
        """Return the evidence, and what explains the residuals, where the set-up wanders rather than drifts.

        What wanders was estimated as if effects that are refused were there. Where no other is found that follows the
        time, nothing does but the wander.
        """
        screening = Screening(evidence.sensitivities, evidence.space.candidates)
        of_time = {c.key for c in screening.candidates if c.effect.definition.follows_time}

        def given(wander: Collection[tuple[str, str | None]]) -> tuple[Evidence, list[Candidate]]:
            again, chosen = gather_evidence(evidence.base, screening, refused, wander)
            return replace(again, undecided=evidence.undecided), chosen

        again, chosen = given(refused)
        if not of_time.isdisjoint(c.key for c in chosen):
            found = self._settled(again, chosen)
            if not of_time.isdisjoint(c.key for c in found.explanation.kept):
                return again, found
        again, chosen = given(of_time.union(refused))
        return again, self._settled(again, chosen)

    def _likeliest(
        self, evidence: Evidence, found: FittedExplanation, refused: AbstractSet[tuple[str, str | None]]
    ) -> tuple[FittedExplanation, list[list[Equal]]]:
        """Return it with the likeliest of the effects that full fits do not tell apart, and the others of each.

        What is undecided or refused is among the others at most: an effect that chance explains in addition to what was
        found may be there in the place of it.
        """
        equals = self._equals(evidence, found, refused)
        replaced = set[tuple[str, str | None]]()
        while likelier := [
            (first.cost, k, first.candidates)
            for k, of_one in enumerate(equals)
            for first in [e for e in of_one if e.likelier and not refused & {c.key for c in e.candidates}][:1]
            if not replaced & {c.key for c in first.candidates}
        ]:
            _, k, best = min(likelier, key=lambda one: one[0])
            kept = list(found.explanation.kept)
            replaced.add(kept[k].key)
            kept[k : k + 1] = best
            found = self._fitted(evidence, replace(found.explanation, kept=tuple(kept)))
            equals = self._equals(evidence, found, refused)
        return found, equals

    def _equals(
        self, evidence: Evidence, found: FittedExplanation, refused: Collection[tuple[str, str | None]]
    ) -> list[list[Equal]]:
        """Return what the data cannot distinguish from each effect that was found."""
        explanation, kept = found.explanation, found.explanation.kept
        full = evidence.correlation.independent and not explanation.forms
        selection = explanation.selection.including(
            [c for c in evidence.space.candidates if c.key in refused]
        )
        return [
            equals_of(selection, evidence.sensitivities, found.fits[-1], kept, k, full, evidence.undecided)
            for k, _ in enumerate(each("what else would explain it", kept))
        ]

    def _fitted(self, evidence: Evidence, explanation: Explanation) -> FittedExplanation:
        return FittedExplanation.of(self.subject, evidence.base, explanation)
