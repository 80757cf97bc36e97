"""The steps of a diagnosis, from a fit to the verdict.

Effects are selected by their linear columns in one space (`selection`); what is reported comes from full fits: of the
model as it was, with each effect that was found, and with each alternative in its place.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise, repeat
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.checks.bounds import are_wrong, held_at_bounds
from rodgen.calibration.checks.effect_test import EffectTest, worth_of
from rodgen.calibration.checks.held_out import HeldOut
from rodgen.calibration.diagnose.acceptance import why_empty, why_not_earned
from rodgen.calibration.diagnose.aliases import Equal, equals_of
from rodgen.calibration.diagnose.candidate_space import CandidateSpace
from rodgen.calibration.diagnose.candidates import Candidate, candidates, without_imitated
from rodgen.calibration.diagnose.clusters import Clusters
from rodgen.calibration.diagnose.detectable import Detectable, detectable
from rodgen.calibration.diagnose.diagnosis import (
    DiagnosedEffect,
    Diagnosis,
    Ranked,
    Rms,
    Unexplained,
)
from rodgen.calibration.diagnose.estimates import EffectEstimates
from rodgen.calibration.diagnose.forms import Form
from rodgen.calibration.diagnose.held_out_blocks import Blocks, stretches_of_time
from rodgen.calibration.diagnose.outliers import are_neighbours, gross_errors, on_a_branch
from rodgen.calibration.diagnose.selection import Selection, follows_time
from rodgen.calibration.diagnose.sensitivities import Sensitivities, catalogue_effects
from rodgen.calibration.diagnose.uncatalogued import Contest, Explanation
from rodgen.calibration.diagnose.validation import bind_validation, validation_error
from rodgen.calibration.diagnose.verdict import (
    disagreement,
    displaced,
    displaced_rows,
    jump,
    moved_one_way,
    uneven,
    unknown_approach,
)
from rodgen.calibration.file_check import check
from rodgen.calibration.fitted import FittedModel
from rodgen.calibration.noise.correlation import Correlation, estimate_correlation
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.problem.assembly_modes import weakest
from rodgen.calibration.problem.binding import bind
from rodgen.calibration.progress import Progress, reporting
from rodgen.calibration.solve.robust import gross_rows
from rodgen.calibration.solve.staged_fit import FitError
from rodgen.calibration.summary import contradictions
from rodgen.calibration.words import capitalized, uncapitalized
from rodgen.data.measurements import Measurements
from rodgen.data.observations import Observations
from rodgen.data.poses import groups
from rodgen.errors import InputFileError, joined
from rodgen.machines.effects.plausibility import BALANCED
from rodgen.machines.machine import Machine
from rodgen.stages import each, stage
from rodgen.statistics.columns import unchanged
from rodgen.statistics.f_tests import log_p_of_fall, p_of_log10
from rodgen.statistics.thresholds import DETERMINACY, EVIDENCE, FORMS, VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit

__all__ = ["diagnose"]

WRONG_SIGN = "no machine has it of this sign"

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]


def diagnose(
    fitted: Fit | Machine,
    data: Measurements | Observations | None = None,
    *,
    test: Measurements | None = None,
    prefer: Collection[tuple[str, str | None]] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """Find out which physical effects are missing in a machine's model, from measurements alone.

    Parameters
    ----------
    fitted : Fit or Machine
        The model as it is: fitted, or to be fitted to `data`.
    data : Measurements or Observations, optional
        Needed with a machine.
    test : Measurements, optional
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
        observations = data if isinstance(data, Observations) else bind(fitted, data)
        # Before the fit, which may take long: a fault of the file is reported at once.
        others = None if test is None else bind_validation(fitted, test)
        with reporting(progress):
            fitted = fitted.fit(observations)
    with reporting(progress), one_thread_in_blas():
        known = fitted.machine.known
        diagnosis = _Diagnosing(fitted, others, prefer, doubted=True).run()
        final = diagnosis.final
        if final.machine.known == known:
            return diagnosis
        bounded = final.refit(replace(final.machine, known=known))
        if bounded.without_bounds is None:  # with what was found, the bounds are right
            return _Diagnosing(fitted, others, prefer).run()
        return replace(diagnosis, wrong_bounds=held_at_bounds(bounded, final))


@dataclass(eq=False)
class Screening:
    """The sensitivities of a fit, and the columns of all candidates there."""

    sensitivities: Sensitivities
    candidates: list[Candidate]

    @classmethod
    def at(cls, base: Fit, prefer: Collection[tuple[str, str | None]] = ()) -> Screening:
        with stage("sensitivities of the candidates"):
            effects = catalogue_effects(base.machine, base.observations)
            sensitivities = Sensitivities.of(base, effects)
            found = candidates(sensitivities, effects, prefer)
            return cls(sensitivities, without_imitated(found, sensitivities.model))


@dataclass(eq=False)
class Evidence:
    """What decisions are based on: the fit without outliers, and the space of all columns with its residual.

    `residual` holds the coordinates of the residuals in `space`, `total` their whole sum of squares.
    """

    base: Fit
    sensitivities: Sensitivities
    candidates: list[Candidate]
    correlation: Correlation
    space: CandidateSpace
    selection: Selection
    residual: Array
    total: float
    chosen: list[Candidate] = field(default_factory=list)
    refused: set[tuple[str, str | None]] = field(default_factory=set)

    @property
    def contest(self) -> Contest:
        """Of forms with effects of the catalogue."""
        whiten = unchanged if self.correlation.independent else self.correlation.whiten
        return Contest(self.sensitivities, whiten, self.selection)

    def refuse(self, candidate: Candidate) -> None:
        """Select anew, without an effect that full fits did not confirm; after many only go without it."""
        self.refused.add(candidate.key)
        self.selection = self.selection.without(candidate)
        if len(self.refused) < EVIDENCE.most_refused:
            self.chosen = self.selection.run(self.residual, self.total)
        else:
            self.chosen.remove(candidate)

    def balance(self, candidate: Candidate) -> bool:
        """Return whether weight turns a joint upwards, which is much likelier than all that is chosen without it.

        It is selected anew then, with weights of any sign.
        """
        balanced = replace(self.selection, balanced=True)
        without = self.selection.without(candidate).run(self.residual, self.total)
        if candidate.effect.name not in BALANCED or not balanced.is_likelier(
            self.residual, self.total, self.chosen, without
        ):
            return False
        self.selection, self.chosen = balanced, balanced.run(self.residual, self.total)
        return True


@dataclass(frozen=True, eq=False)
class FittedExplanation:
    """What explains the residuals, with full fits.

    Attributes
    ----------
    explanation : Explanation
    fits : list of Fit
        Of the model as it was, and with one effect after the other.
    formed : list of Fit
        With one form after the other in addition.
    """

    explanation: Explanation
    fits: list[Fit]
    formed: list[Fit]

    @property
    def last(self) -> Fit:
        """The fit with all effects and forms."""
        return [*self.fits, *self.formed][-1]


class _Diagnosing:
    """One diagnosis: its data without copies, and its steps."""

    def __init__(
        self,
        fitted: Fit,
        others: Observations | None,
        prefer: Collection[tuple[str, str | None]] = (),
        *,
        doubted: bool = False,
    ) -> None:
        self.doubted = doubted
        """Whether bounds of the machine file that the readings contradict are left out."""
        fitted = self._without_wrong_bounds(fitted)
        self.fitted, self.others, self.prefer = fitted, others, prefer
        self.notes: list[str] = []
        self.too_many = 0
        """Rows that disagree with the final model where these are more than may be wrong by chance."""
        self.given = fitted.observations
        self.kept = _without_copies(self.given)
        if len(self.kept) < self.given.n:
            copies = self.given.n - len(self.kept)
            self.notes.append(
                f"{copies} rows are copies of others, including the readings; each is counted once."
            )
            self.fitted = fitted.refit(
                observations=self.given.take(self.kept), outliers=fitted.outliers[self.kept]
            )
        self.observations = self.fitted.observations

    def _without_wrong_bounds(self, fit: Fit) -> Fit:
        freed = fit.without_bounds if self.doubted else None
        return fit if freed is None or not are_wrong(fit, freed) else freed

    # the steps -----------------------------------------------------------------------------------------------

    def run(self) -> Diagnosis:
        try:
            return self._run()
        except FitError:
            if not self.fitted.problem.is_closed_chain:
                raise
            return self._undecided(
                "With a further effect the legs no longer close: the geometry, or the order of the legs, is far from "
                "right."
            )

    def _run(self) -> Diagnosis:
        reason = self._cannot_tell(self.fitted)
        if reason:
            return self._undecided(reason)
        outliers = self.fitted.outliers
        first = Screening.at(self.fitted, self.prefer)
        if not outliers.any():
            outliers = self._gross_errors(first)
        for last in (*(EVIDENCE.rounds - 1) * [False], True):
            base, screening = self.fitted, first
            if not np.array_equal(outliers, base.outliers):
                base = self._fit(self.fitted.machine, outliers)
                reason = self._cannot_tell(base)
                if reason:
                    return self._undecided(reason)
                screening = Screening.at(base, self.prefer)
            evidence = self._evidence(base, screening)
            found = self._settled(evidence)
            again = outliers if last else self._outliers_of_final(found.last, outliers)
            if np.array_equal(again, outliers):
                break
            # Few rows differ: the same effects, fitted anew.
            if np.count_nonzero(again != outliers) < EVIDENCE.changed_rows * self.observations.n:
                evidence.base = self._fit(self.fitted.machine, again)
                found = self._fitted(evidence, found.explanation)
                break
            outliers = again
        return self._confirmed(evidence, found)

    def _confirmed(self, evidence: Evidence, found: FittedExplanation) -> Diagnosis:
        """Return the diagnosis of what full fits confirm, with the likeliest of what they do not tell apart."""
        while True:
            found, equals = self._likeliest(evidence, found)
            held_out = [fit.held_out() for fit in found.fits]
            order = _weakest_last(held_out)
            if order != sorted(order):
                kept = tuple(found.explanation.kept[k] for k in order)
                found = self._fitted(evidence, replace(found.explanation, kept=kept))
                equals = [equals[k] for k in order]
                held_out = [fit.held_out() for fit in found.fits]
            found, unseen = self._with_earned_forms(found, held_out[-1])
            held_out += unseen
            worths = self._worths(found)
            refused = self._not_earned(evidence, found, held_out, worths)
            if refused is None:
                return self._assemble_diagnosis(evidence, found, held_out, equals, worths)
            candidate, why = refused
            if not (why == WRONG_SIGN and evidence.balance(candidate)):
                evidence.refuse(candidate)
                self.notes.append(f"{capitalized(candidate.effect.title)} is not reported: {why}.")
            found = self._settled(evidence)

    def _likeliest(
        self, evidence: Evidence, found: FittedExplanation
    ) -> tuple[FittedExplanation, list[list[Equal]]]:
        """Return it with the likeliest of the effects that full fits do not tell apart, and the others of each."""
        equals = self._equals(evidence, found)
        replaced = set[tuple[str, str | None]]()
        while likelier := [
            (equal[0].cost, k, equal[0].candidate)
            for k, equal in enumerate(equals)
            if equal and equal[0].cost < 0 and equal[0].candidate.key not in replaced
        ]:
            _, k, best = min(likelier, key=lambda one: one[0])
            kept = list(evidence.chosen)
            replaced.add(kept[k].key)
            kept[k] = best
            found = self._fitted(evidence, replace(found.explanation, kept=tuple(kept)))
            equals = self._equals(evidence, found)
        return found, equals

    def _settled(self, evidence: Evidence) -> FittedExplanation:
        """Return what explains the residuals, without effects that are insignificant in the full fits."""
        chosen, fits = tuple(evidence.chosen), self._fits(evidence)
        explanation = self._explain(evidence, fits[-1])
        if [c.key for c in explanation.kept] == [c.key for c in chosen]:
            found = FittedExplanation(explanation, fits, self._fit_forms(fits[-1], explanation.forms))
        else:
            found = self._fitted(evidence, explanation)
        if explanation.forms:
            found = self._contested(evidence, found, chosen, fits)
        while unsure := self._unsure(evidence, found.last):
            kept = tuple(c for c in evidence.chosen if c is not unsure)
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
        evidence : Evidence
        found : FittedExplanation
        chosen : tuple of Candidate
            What the selection chose.
        fits : sequence of Fit
            With these, one after the other.
        """
        compete = [found]
        for rival in evidence.contest.rivals(found.explanation, chosen):
            begun = fits if rival[: len(chosen)] == chosen else found.fits
            evidence.chosen = list(rival)
            rival_fits = self._fits(evidence, begun)
            estimates = EffectEstimates(rival_fits[-1])
            if all(estimates.are_possible(c.effect, evidence.selection.prior_of(c)) for c in rival):
                explanation = Explanation(rival, (), evidence.selection, complete=True)
                compete.append(FittedExplanation(explanation, rival_fits, []))
        residual_of = evidence.sensitivities.residual_of
        best = compete[evidence.contest.believed([(c.explanation, residual_of(c.last)) for c in compete])]
        evidence.chosen = list(best.explanation.kept)
        return best

    def _equals(self, evidence: Evidence, found: FittedExplanation) -> list[list[Equal]]:
        """Return what the data cannot distinguish from each effect that was found."""
        explanation, kept = found.explanation, found.explanation.kept
        full = evidence.correlation.independent and not explanation.forms
        return [
            equals_of(explanation.selection, evidence.sensitivities, found.fits[-1], kept, k, full)
            for k, _ in enumerate(each("what else would explain it", kept))
        ]

    def _cannot_tell(self, base: Fit) -> str:
        """Return why the data allow no answer; empty where they do."""
        wrong = self._wrong_file or self._wrong_geometry(base)
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
        unread = tuple(f"target.{name}." for name in self._unread)
        lacking = [
            d.text
            for d in base.determinacy.directions
            if not d.gauge and not all(key.startswith(unread) for key, _ in d.parts)
        ]
        return " ".join(lacking[:3])

    @cached_property
    def _unread(self) -> list[str]:
        """Names of targets without a reading: where they are changes nothing here."""
        return [
            t.name
            for k, t in enumerate(self.observations.machine.targets)
            if k not in self.observations.target
        ]

    @cached_property
    def _wrong_file(self) -> str:
        """What is wrong with the machine file or the data; empty where they are plausible."""
        with stage("checking the files"):
            return check(self.fitted).sentence

    def _wrong_geometry(self, base: Fit) -> str:
        """Return why a closed chain is far from what was measured; empty where it is not."""
        if base.problem.is_closed_chain and not base.solution.converged:
            row = weakest(base.observations)
            near = f", as in {base.observations.data.place(row)}" if row is not None else ""
            return (
                f"The fit stopped where legs do not close: near a singular pose{near}, or far from the right "
                "geometry."
            )
        return ""

    def _undecided(self, reason: str) -> Diagnosis:
        base = self.fitted
        # the error on poses left out of a wrong geometry means nothing, and its fits take long
        held_out = None if self._wrong_file or self._wrong_geometry(base) else base.held_out().rms
        rms = Rms(base.rms, base.rms, held_out, held_out, base.noise.value, base.unit)
        outliers = self._rows(base)
        return Diagnosis(
            "cannot_tell",
            reason,
            self.given.n,
            outliers,
            self._with_test(rms, [base]),
            (),
            (),
            (),
            (base,),
            estimates=base.estimates,
        )

    # what decisions are based on -----------------------------------------------------------------------------

    @stage("looking for outliers")
    def _gross_errors(self, screening: Screening) -> Mask:
        sensitivities = screening.sensitivities
        every = np.concatenate(
            [sensitivities.model[:, :, :0], *(c.columns for c in _a_few_of_each(screening.candidates))],
            axis=2,
        )
        wrong, left = gross_errors(sensitivities.model, every, sensitivities.residual)
        found = np.zeros(self.observations.n, bool)
        residual = np.zeros((len(found), left.shape[1]))
        found[sensitivities.rows[wrong]] = True
        residual[sensitivities.rows] = left
        return self._unless_neighbours(found, residual)

    def _unless_neighbours(self, outliers: Mask, residual: Array) -> Mask:
        """Return the outliers, or none where they are neighbours in a driver: then they show a missing effect.

        Where most poses of a stretch are outliers, the others there are displaced as well. Of the rest, those are none
        that lie where rows measured before and after them do.

        Parameters
        ----------
        outliers : ndarray of bool, shape (n,)
        residual : ndarray, shape (n, m)
            What was judged, weighted.
        """
        o, outliers = self.observations, self.fitted.with_bodies(outliers)
        recorded = o.drivers("joint", "time", "temperature", "column", "load")
        # two targets of a pose that were mixed up are no neighbours: a pose counts once
        poses, first = np.unique(o.pose, return_index=True)
        wrong = np.isin(poses, o.pose[outliers])
        if outliers.any() and are_neighbours(wrong, [driver.values[first] for driver in recorded]):
            return np.zeros_like(outliers)
        outliers = outliers | displaced_rows(o, outliers)
        order = np.arange(o.n) if o.t is None else np.argsort(o.t, kind="stable")
        return outliers & ~on_a_branch(outliers, residual, order)

    def _evidence(self, base: Fit, screening: Screening) -> Evidence:
        evidence = self._evidence_given(base, screening, self._correlation(screening, []))
        known = [c for c in evidence.chosen if not follows_time(c)]
        first = evidence.correlation
        # a large effect hides how the set-up wanders, and what is slow must stand against that
        if not known or (len(known) == len(evidence.chosen) and not first.independent):
            return evidence
        correlation = self._correlation(screening, known)
        if first.independent and correlation.independent:
            return evidence
        return self._evidence_given(base, screening, correlation)

    @stage("estimating the correlation")
    def _correlation(self, screening: Screening, known: Sequence[Candidate]) -> Correlation:
        """Return how the readings depend on each other if some effects are there."""
        found = screening.candidates
        columns, tries = [c.columns for c in found], [c.tries for c in found]
        return estimate_correlation(screening.sensitivities, columns, tries, [c.columns for c in known])

    def _evidence_given(self, base: Fit, screening: Screening, correlation: Correlation) -> Evidence:
        """Return the evidence where readings depend on each other so."""
        sensitivities, found = screening.sensitivities, screening.candidates
        model = sensitivities.model
        with stage("testing effects"):
            space = CandidateSpace(model, found, correlation.whiten)
            residual, total = space.residual(sensitivities.residual)
            blocks = Blocks(sensitivities.observations, model, sensitivities.residual)
            stretches = None
            if not correlation.independent:
                o = sensitivities.observations
                stretches = Blocks(o, model, sensitivities.residual, stretches_of_time(o))
            clusters = Clusters(sensitivities, correlation.whiten)
            selection = Selection(space, blocks, self.observations.n, clusters, stretches)
            selection, chosen = selection.or_balanced(residual, total, selection.run(residual, total))
        return Evidence(base, sensitivities, found, correlation, space, selection, residual, total, chosen)

    @stage("forms outside the catalogue")
    def _explain(self, evidence: Evidence, final: Fit) -> Explanation:
        left = evidence.sensitivities.residual_of(final)
        return evidence.contest.by_columns(evidence.chosen, left)

    # full fits -----------------------------------------------------------------------------------------------

    @stage("further fits")
    def _fit(self, machine: Machine, outliers: Mask) -> Fit:
        return self.fitted.refit(machine, self.observations, outliers=outliers)

    def _fitted(self, evidence: Evidence, explanation: Explanation) -> FittedExplanation:
        """Return an explanation with full fits; its effects are those that the evidence speaks for from now on."""
        evidence.chosen = list(explanation.kept)
        fits = self._fits(evidence)
        return FittedExplanation(explanation, fits, self._fit_forms(fits[-1], explanation.forms))

    def _fits(self, evidence: Evidence, begun: Sequence[Fit] = ()) -> list[Fit]:
        """Fit the model with one effect after the other, each from where the one before ended.

        Parameters
        ----------
        evidence : Evidence
        begun : sequence of Fit
            Those with the first of its effects, which are made already.
        """
        fits = list(begun) or [evidence.base]
        for candidate in evidence.chosen[len(fits) - 1 :]:
            machine = fits[-1].machine.with_effect(candidate.effect)
            searched = {candidate.effect.key(name): value for name, value in candidate.searched.items()}
            machine = replace(machine, values={**machine.values, **searched})
            found = self._fit(machine, evidence.base.outliers)
            if not found.solution.converged:  # it crept along a narrow valley: once more, from where it ended
                found = self._fit(found.machine, evidence.base.outliers)
            fits.append(self._without_wrong_bounds(found))
        return fits

    def _unsure(self, evidence: Evidence, final: Fit) -> Candidate | None:
        """Return an effect that was selected by its columns but is insignificant in the full fit, else None.

        The fit has the forms, too: an effect may be large together with one, and hardly show without it.
        """
        estimates = EffectEstimates(final)
        dependent = not evidence.correlation.independent
        for candidate in evidence.chosen:
            if estimates.significance(candidate.effect) < VERDICT.rare:
                continue
            # chi-square means little where readings depend on each other
            if dependent or self._is_as_good_without(final, candidate):
                return candidate
        return None

    @stage("further fits")
    def _worths(self, found: FittedExplanation) -> list[EffectTest | None]:
        """Return what each effect, then each form, is worth given all others, as `rodgen add` tests it."""
        fits = [*found.fits, *found.formed]
        added = [
            *(c.effect for c in found.explanation.kept),
            *(fit.machine.effects[-1] for fit in found.formed),
        ]
        return [worth_of(found.last, effect, fits[-2] if effect is added[-1] else None) for effect in added]

    def _not_earned(
        self,
        evidence: Evidence,
        found: FittedExplanation,
        held_out: Sequence[HeldOut],
        worths: Sequence[EffectTest | None],
    ) -> tuple[Candidate, str] | None:
        """Return the last effect that full fits do not confirm, and why not; None where they confirm all.

        Where there are forms, an effect is judged with them: it may be large with one, and hardly show without.

        Parameters
        ----------
        evidence : Evidence
        found : FittedExplanation
        held_out : sequence of HeldOut
            Errors on poses left out of all its fits.
        worths : sequence of EffectTest or None
            See `_worths`.
        """
        estimates = EffectEstimates(found.last)
        for k, candidate in reversed(list(enumerate(found.explanation.kept))):
            fit, pair = found.fits[k + 1], (held_out[k], held_out[k + 1])
            if found.explanation.forms:
                fit, pair = found.last, (self._without(found.last, candidate).held_out(), held_out[-1])
            tests = _tests(found.explanation, candidate)
            why = why_not_earned(fit, pair, estimates.of(candidate.effect), worths[k], tests)
            if not why and not estimates.are_possible(
                candidate.effect, evidence.selection.prior_of(candidate)
            ):
                of_any_sign = estimates.are_possible(candidate.effect, candidate.prior.of_any_sign)
                why = WRONG_SIGN if of_any_sign else "no machine has so much of it"
            if not why:
                last = found.last
                why = why_empty(last.observations, candidate.effect, last.parameters, last.solution.theta)
            if why:
                return candidate, why
        return None

    def _without(self, final: Fit, candidate: Candidate) -> Fit:
        """Return the fit with an effect held at zero."""
        held = dict.fromkeys(candidate.effect.parameters, 0.0) | dict(candidate.searched)
        effects = tuple(
            replace(effect, hold=held) if effect is candidate.effect else effect
            for effect in final.machine.effects
        )
        return self._fit(replace(final.machine, effects=effects), final.outliers)

    def _is_as_good_without(self, final: Fit, candidate: Candidate) -> bool:
        without = self._without(final, candidate)
        further = final.determinacy.rank - without.determinacy.rank
        fall = without.least_sum - final.least_sum
        if further < 1 or not fall > 0:
            return True
        log = log_p_of_fall(fall, final.chi_square, further, max(final.degrees_of_freedom, 1))
        return bool(log > np.log(VERDICT.rare))

    @stage("looking for outliers")
    def _outliers_of_final(self, final: Fit, outliers: Mask) -> Mask:
        """Return the outliers of the final model with its forms; the ones given where these would be too many."""
        found = gross_rows(final.problem, final.solution, final.free)
        self.too_many = int(found.sum()) if found.mean() > EVIDENCE.largest_wrong_part else 0
        return outliers if self.too_many else self._unless_neighbours(found, final.relative_residuals)

    def _rows(self, base: Fit) -> tuple[int, ...]:
        """Return the outliers as rows of the data that were given."""
        return tuple(self.kept[base.outliers].tolist())

    # the result --------------------------------------------------------------------------------------------

    def _assemble_diagnosis(
        self,
        evidence: Evidence,
        found: FittedExplanation,
        held_out: Sequence[HeldOut],
        equals: Sequence[Sequence[Equal]],
        worths: Sequence[EffectTest | None],
    ) -> Diagnosis:
        """Put together what was found.

        Parameters
        ----------
        evidence : Evidence
        found : FittedExplanation
        held_out : sequence of HeldOut
            Errors on poses left out of all its fits.
        equals : sequence of sequence of Equal
            Of each effect.
        worths : sequence of EffectTest or None
            See `_worths`.
        """
        explanation, fits, final, last = found.explanation, found.fits, found.fits[-1], found.last
        correlation = self._final_correlation(evidence, explanation, last)
        estimates = EffectEstimates(last)
        steps = [
            self._step(found, k, held_out[k + 1], estimates, equals[k], worths[k])
            for k in range(len(explanation.kept))
        ]
        unseen = held_out[len(fits) :]
        of_forms = worths[len(steps) :]
        unexplained = tuple(
            map(_unexplained, explanation.forms, found.formed, unseen, repeat(estimates), of_forms)
        )
        rms = Rms(evidence.base.rms, last.rms, held_out[0].rms, held_out[-1].rms, last.noise.value, last.unit)
        for form in explanation.small:
            self.notes.append(
                f"{capitalized(form.where)} also follows {joined(form.driver.split(' and '))} ({form.formula}), but so "
                "little compared with the effects found there that it may be an imperfection of their formulas."
            )
        with stage("testing the final residuals"):
            moved = [
                jump(evidence.sensitivities, evidence.sensitivities.residual_of(last)),
                moved_one_way(evidence.sensitivities, correlation),
            ]
            verdict, reason = self._verdict(final, correlation, steps, unexplained)
        if reason is not None:
            reason = " ".join(filter(None, [reason, *moved]))
        else:
            self.notes += filter(None, [*moved, correlation.text])
        self.notes += filter(
            None, (_lifted(step, c) for step, c in zip(steps, explanation.kept, strict=True))
        )
        self.notes += filter(None, [_stated(last.machine, steps)])
        outliers = displaced(self.observations, evidence.base.outliers)
        self.notes += filter(None, [outliers, unknown_approach(self.observations)])
        self.notes += contradictions(final)
        if not last.dependence.independent:
            self.notes.append(last.dependence.text)
        if self._unread:
            self.notes.append(f"No row has the target{'s' * (len(self._unread) > 1)} {joined(self._unread)}.")
        if steps and not unexplained and (rest := self._disagreement(final, correlation)):
            self.notes.append(f"This is not all: {uncapitalized(rest)}")
        return Diagnosis(
            verdict,
            reason,
            self.given.n,
            self._rows(evidence.base),
            self._with_test(rms, [*fits, *found.formed]),
            tuple(steps),
            unexplained,
            _ranking(evidence),
            tuple(fits),
            correlation,
            tuple(self.notes),
            last.estimates,
            self._could_hide(evidence) if verdict == "nothing_missing" else (),
        )

    @staticmethod
    def _step(
        found: FittedExplanation,
        k: int,
        held_out: HeldOut,
        estimates: EffectEstimates,
        equals: Sequence[Equal],
        worth: EffectTest | None,
    ) -> DiagnosedEffect:
        """Return an effect that was found, by its number, with the error on poses left out of the fit that adds it."""
        candidate = found.explanation.kept[k]
        log10 = worth.log10_p if worth else 0.0
        tests = _tests(found.explanation, candidate)
        return DiagnosedEffect(
            candidate.effect,
            p_of_log10(log10),
            log10,
            found.fits[k + 1].rms,
            held_out.rms,
            estimates.of(candidate.effect),
            tuple(equal.alias for equal in equals),
            p_of_log10(min(log10 + float(np.log10(tests)), 0.0)),
        )

    @stage("what could hide")
    def _could_hide(self, evidence: Evidence) -> tuple[Detectable, ...]:
        return detectable(
            evidence.base, evidence.sensitivities, evidence.selection, evidence.residual, evidence.total
        )

    def _verdict(
        self,
        final: Fit,
        correlation: Correlation,
        steps: Sequence[DiagnosedEffect],
        forms: Sequence[Unexplained],
    ) -> tuple[str, str | None]:
        if forms:
            return "unknown_effect", None
        if steps:
            return "effects_missing", None
        reason = self._disagreement(final, correlation)
        return ("cannot_tell", reason) if reason else ("nothing_missing", None)

    def _disagreement(self, final: Fit, correlation: Correlation) -> str:
        return uneven(final, self.too_many) or disagreement(final, correlation)

    def _final_correlation(self, evidence: Evidence, explanation: Explanation, final: Fit) -> Correlation:
        """Return the correlation of the residuals of the final model."""
        if evidence.correlation.independent or not (explanation.kept or explanation.forms):
            return evidence.correlation
        return final.dependence.correlation

    def _fit_forms(self, final: Fit, forms: Sequence[Form]) -> list[Fit]:
        """Fit the model with one form after the other."""
        found = [final]
        for form in forms:
            machine = found[-1].machine
            found.append(self._fit(machine.with_effect(form.effect(machine)), final.outliers))
        return found[1:]

    def _with_earned_forms(
        self, found: FittedExplanation, held_out: HeldOut
    ) -> tuple[FittedExplanation, list[HeldOut]]:
        """Return it with the forms that lower the error on poses left out, and these errors.

        Parameters
        ----------
        found : FittedExplanation
        held_out : HeldOut
            Error on poses left out of the fit without forms.
        """
        kept: list[Form] = []
        fits, errors = [found.fits[-1]], [held_out]
        for number, (form, fit) in enumerate(zip(found.explanation.forms, found.formed, strict=True)):
            if len(kept) < number:  # the fit has one that was refused
                fit = self._fit_forms(fits[-1], [form])[0]
            error, unseen = errors[-1].rms, fit.held_out()
            if error is None or unseen.rms is None or unseen.rms**2 < (1 - FORMS.noticeable) * error**2:
                kept.append(form)
                fits.append(fit)
                errors.append(unseen)
        explanation = replace(found.explanation, forms=tuple(kept))
        return FittedExplanation(explanation, found.fits, fits[1:]), errors[1:]

    def _with_test(self, rms: Rms, fits: Sequence[Fit]) -> Rms:
        if self.others is None:
            return rms
        before = validation_error(fits[0], self.others)
        try:
            after = validation_error(fits[-1], self.others)
        except InputFileError as error:  # without a column that an effect needs, which was found only now
            self.notes.append(
                f"The error on the further measurements with these effects is not known: {error}."
            )
            after = None
        return replace(rms, before_test=before, after_test=after)


def _stated(machine: Machine, steps: Sequence[DiagnosedEffect]) -> str:
    """Return which of the effects named and listed the machine file says the odds or sizes of; empty if none."""
    listed = [e for step in steps for e in (step.effect, *(a.effect for a in step.indistinguishable_from))]
    found = list(dict.fromkeys(e.title for e in listed if {e.key(""), e.name} & machine.plausible.keys()))
    are = "is" if len(found) == 1 else "are"
    return f"[plausibility] of the machine file says how likely {joined(found)} {are}." if found else ""


def _lifted(step: DiagnosedEffect, candidate: Candidate) -> str:
    """Return what a weight says that turns a joint upwards, of which the file does not speak; empty where none does."""
    negative = [
        name
        for name, e in step.parameters.items()
        if e.std is not None
        and name in candidate.prior.sizes
        and candidate.prior.sizes[name].positive
        and e.value < -DETERMINACY.certain * e.std
    ]
    if not negative:
        return ""
    title, joint = step.effect.title, step.effect.place
    are = "is" if len(negative) == 1 else "are"
    return (
        f"{joined(negative)} of {title} {are} negative: weight turns {joint} upwards, as only a counterweight or a "
        f"balancing spring does. If the machine has one there, write 'counterbalance = true' in the block of {joint}; "
        "if not, something else acts."
    )


def _tests(explanation: Explanation, candidate: Candidate) -> float:
    """Return as how many independent tests all candidates count, given the other effects; 1 or more.

    Likelier effects before the data have a larger share of the false alarms, as where they were selected.
    """
    selection, others = explanation.selection, [c for c in explanation.kept if c is not candidate]
    return max(selection.tests(others) * float(np.exp(-selection.log_weight(candidate))), 1.0)


def _unexplained(
    form: Form, fit: Fit, held_out: HeldOut, estimates: EffectEstimates, worth: EffectTest | None
) -> Unexplained:
    """Return a form that was found, with the fit that it is added in and that fit's error on poses left out."""
    effect, p = fit.machine.effects[-1], worth.p_value if worth else 1.0
    of_all = max(form.p_value, p)
    return Unexplained(effect, form.driver, p, fit.rms, held_out.rms, estimates.of(effect), fit, of_all)


def _weakest_last(held_out: Sequence[HeldOut]) -> list[int]:
    """Return an order of effects in which those come last that lower no error on poses left out where they stand.

    As long as a larger effect is missing, its error hides a smaller one; what counts is whether an effect lowers the
    error when the others are there.
    """
    pairs = pairwise(h.rms for h in held_out)
    rises = [before is not None and after is not None and not after < before for before, after in pairs]
    return sorted(range(len(rises)), key=rises.__getitem__)


def _without_copies(o: Observations) -> NDArray[np.int_]:
    """Return the rows that do not repeat an earlier one, its readings included; all rows where few do."""
    columns = [*o.q.T, *o.reading.T, o.target, o.run]
    columns += [c for c in (o.t, o.load) if c is not None] + [*o.temperature.values(), *o.covariates.values()]
    _, first = np.unique(groups(columns, o.n), return_index=True)
    return np.sort(first) if len(first) < (1 - EVIDENCE.copies) * o.n else np.arange(o.n)


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


def _ranking(evidence: Evidence) -> tuple[Ranked, ...]:
    total = evidence.selection.left(evidence.residual, evidence.total, [])
    scores = evidence.space.scores(evidence.residual, total)
    tests = np.log(evidence.selection.tests(()))
    found = []
    for s in scores:
        log10 = min((s.log_p + tests) / np.log(10), 0.0)
        dof = (float(s.dof), float(s.residual_dof))
        explains = s.fall / total if total > 0 else 0.0
        p = p_of_log10(log10)
        found.append(Ranked(s.candidate.effect, p, float(log10), s.statistic, dof, s.visible, explains))
    return tuple(found)
