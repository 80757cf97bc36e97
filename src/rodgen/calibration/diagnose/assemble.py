"""The diagnosis that full fits confirm: its verdict, effects, forms and notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.checks.effect_test import EffectTest, worth_of
from rodgen.calibration.checks.held_out import HeldOut
from rodgen.calibration.diagnose.aliases import Equal
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.detectable import Detectable, detectable
from rodgen.calibration.diagnose.diagnosis import (
    DiagnosedEffect,
    Diagnosis,
    Ranked,
    Rms,
    SetAlias,
    Unexplained,
)
from rodgen.calibration.diagnose.estimates import EffectEstimates
from rodgen.calibration.diagnose.evidence import Evidence
from rodgen.calibration.diagnose.subject import FittedExplanation, Subject, why_wrong_geometry, with_effects
from rodgen.calibration.diagnose.validation import on_another_machine, validation_error
from rodgen.calibration.diagnose.verdict import (
    disagreement,
    displaced,
    jump,
    moved_one_way,
    uneven,
    unknown_approach,
)
from rodgen.calibration.noise.correlation import Correlation
from rodgen.calibration.summary import contradictions
from rodgen.calibration.words import NAMES, capitalized, how_rarely, uncapitalized
from rodgen.errors import InputFileError, joined
from rodgen.machines.machine import Machine
from rodgen.stages import stage
from rodgen.statistics.f_tests import p_of_log10
from rodgen.statistics.thresholds import DETERMINACY, SELECTION, VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit


@dataclass(frozen=True, eq=False)
class Confirmed:
    """What full fits confirm."""

    found: FittedExplanation
    held_out: Sequence[HeldOut]
    """Errors on poses left out of all its fits."""
    equals: Sequence[Sequence[Equal]]
    """What the data cannot distinguish from each effect."""
    tests: Sequence[EffectTest | None]
    """Of each effect, then of each form."""

    def effects(self, estimates: EffectEstimates) -> list[DiagnosedEffect]:
        """Return the effects, each with the errors of the fit that adds it."""
        return [self._effect(k, estimates) for k in range(len(self.found.explanation.kept))]

    def sets(self) -> tuple[SetAlias, ...]:
        """Return what the data cannot distinguish from two of the effects together, the likeliest of each two.

        What is listed for each of the two alone is left out, and so are forms, of which columns say little.
        """
        explanation = self.found.explanation
        kept = explanation.kept
        alone = {
            c.key: {e.candidates[0].key for e in of_one} for c, of_one in zip(kept, self.equals, strict=True)
        }
        found = dict[tuple[Candidate, ...], tuple[float, tuple[Candidate, ...]]]()
        for gone, new, cost in explanation.selection.sets_like(kept) if not explanation.forms else ():
            each_alone = new[1:] and any(
                all(n.key in alone[g.key] for n, g in zip(order, gone, strict=True))
                for order in (new, new[::-1])
            )
            if not each_alone and cost < found.get(gone, (np.inf, new))[0]:
                found[gone] = cost, new
        return tuple(
            SetAlias(tuple(c.effect for c in gone), tuple(c.effect for c in new), float(np.exp(-cost / 2)))
            for gone, (cost, new) in sorted(found.items(), key=lambda one: one[1][0])
        )

    def _effect(self, k: int, estimates: EffectEstimates) -> DiagnosedEffect:
        candidate, test = self.found.explanation.kept[k], self.tests[k]
        log10 = test.log10_p if test else 0.0
        tests = self.found.explanation.tests_of(candidate)
        return DiagnosedEffect(
            candidate.effect,
            p_of_log10(log10),
            log10,
            self.found.fits[k + 1].rms,
            self.held_out[k + 1].rms,
            estimates.of(candidate.effect),
            tuple(equal.alias for equal in self.equals[k] if not equal.candidates[1:]),
            p_of_log10(min(log10 + float(np.log10(tests)), 0.0)),
            tuple(equal.alias for equal in self.equals[k] if equal.candidates[1:]),
        )

    def forms(self, estimates: EffectEstimates) -> list[Unexplained]:
        """Return the forms, each with the errors of the fit that adds it."""
        found = self.found
        unseen, tests = self.held_out[len(found.fits) :], self.tests[len(found.explanation.kept) :]
        forms = []
        for form, fit, held_out, test in zip(
            found.explanation.forms, found.formed, unseen, tests, strict=True
        ):
            effect, p = fit.machine.effects[-1], test.p_value if test else 1.0
            own, of_all = estimates.of(effect), max(form.p_value, p)
            forms.append(Unexplained(effect, form.driver, p, fit.rms, held_out.rms, own, fit, of_all))
        return forms


def undecided(subject: Subject, reason: str, notes: Sequence[str] = ()) -> Diagnosis:
    """Return the diagnosis of data that allow no answer, for a reason."""
    base = subject.fitted
    # the error on poses left out of a wrong geometry means nothing, and its fits take long
    held_out = None if subject.wrong_file or why_wrong_geometry(base) else base.held_out().rms
    rms = Rms(base.rms, base.rms, held_out, held_out, base.noise.value, base.unit)
    rms, _ = _with_test(subject, rms, [base])
    return Diagnosis(
        "cannot_tell",
        reason,
        subject.fitted.problem.count,
        tuple(base.outlier_numbers),
        rms,
        (),
        (),
        (),
        (base,),
        notes=tuple(notes),
        estimates=base.estimates,
    )


def assemble_diagnosis(
    subject: Subject, evidence: Evidence, confirmed: Confirmed, too_many: int, notes: Sequence[str]
) -> Diagnosis:
    """Return the diagnosis with its verdict.

    Parameters
    ----------
    too_many : int
        Rows that disagree with the final model where these are more than may be wrong by chance.
    notes : sequence of str
        Of the search.
    """
    found, notes = confirmed.found, list(notes)
    final, last = found.fits[-1], found.last
    estimates, correlation = EffectEstimates(last), _final_correlation(evidence, found)
    steps, forms = confirmed.effects(estimates), confirmed.forms(estimates)
    before, after = (confirmed.held_out[i].rms for i in (0, -1))
    rms = Rms(evidence.base.rms, last.rms, before, after, last.noise.value, last.unit)
    notes += [
        f"{capitalized(form.where)} also follows {joined(form.driver.split(' and '))} ({form.formula}), but so "
        "little compared with the effects found there that it may be an imperfection of their formulas."
        for form in found.explanation.small
    ]
    with stage("testing the final residuals"):
        moved = [
            jump(evidence.sensitivities, evidence.sensitivities.residual_of(last)),
            moved_one_way(evidence.sensitivities, correlation),
        ]
        rest = "" if forms else uneven(final, too_many)
        if evidence.undecided and not (rest or steps or forms):
            open_ = [c.effect.title for c in evidence.undecided]
            are = "are" if open_[1:] else "is"
            rest = f"More positions of a joint would tell whether {joined(open_, most=NAMES)} {are} there."
        rest = rest or ("" if forms else disagreement(final, correlation))
    if not (rest or steps or forms):
        rest = _impossible(found.explanation.selection.too_large(found.explanation.kept))
    verdict, reason = "nothing_missing", None
    if forms or steps:
        verdict = "unknown_effect" if forms else "effects_missing"
    elif rest:
        verdict, reason = "cannot_tell", " ".join(filter(None, [rest, *moved]))
    if reason is None:
        notes += [*moved, correlation.text]
    notes += map(_lifted, steps, found.explanation.kept)
    tests = confirmed.tests[: len(steps)]  # those of forms follow
    notes += [test.on_shape(step.effect) for step, test in zip(steps, tests, strict=True) if test]
    notes += [
        _stated(last.machine, steps),
        displaced(subject.observations, evidence.base.outliers),
        unknown_approach(subject.observations),
    ]
    notes += [_suspected(subject, found), *contradictions(final)]
    if not last.dependence.independent:
        notes += [last.dependence.text, _sharper_than_estimates(steps, estimates)]
    if subject.unread:
        notes.append(f"No row has the target{'s' * (len(subject.unread) > 1)} {joined(subject.unread)}.")
    if steps and rest:
        notes.append(f"This is not all: {uncapitalized(rest)}")
    rms, unknown = _with_test(subject, rms, [*found.fits, *found.formed])
    return Diagnosis(
        verdict,
        reason,
        subject.fitted.problem.count,
        tuple(evidence.base.outlier_numbers),
        rms,
        tuple(steps),
        tuple(forms),
        _ranking(evidence),
        tuple(found.fits),
        correlation,
        tuple(filter(None, [*notes, unknown])),
        last.estimates,
        _could_hide(evidence) if verdict == "nothing_missing" else (),
        confirmed.sets(),
        tuple(c.effect for c in evidence.undecided),
    )


def _impossible(candidate: Candidate | None) -> str:
    """Return a sentence on an effect that would explain the readings if machines had so much of it; empty without."""
    if candidate is None:
        return ""
    return (
        f"{candidate.effect.title} would explain the readings only with a size or a sign that no machine "
        "has: something else acts in the same way, or the machine file is wrong."
    )


@stage("further fits")
def _suspected(subject: Subject, found: FittedExplanation) -> str:
    """Return which effect was refused by a hair, and how often chance does as much; empty where none was."""
    explanation = found.explanation
    candidate = None if explanation.forms else explanation.selection.suspected(explanation.kept)
    if candidate is None:
        return ""
    fit = with_effects(subject, found.fits, (*explanation.kept, candidate))[-1]
    test = worth_of(fit, candidate.effect, found.last)
    p_of_all = test.p_value * explanation.tests_of(candidate) if test else 1.0
    if not (fit.solution.converged and p_of_all < SELECTION.suspected):
        return ""
    too = ", too" if explanation.kept else ""
    rarely = how_rarely(max(p_of_all, SELECTION.family_wise))
    return f"{candidate.effect.title} may be there{too}: {rarely}."


@stage("what could hide")
def _could_hide(evidence: Evidence) -> tuple[Detectable, ...]:
    return detectable(evidence.base, evidence.sensitivities, evidence.selection)


def _final_correlation(evidence: Evidence, found: FittedExplanation) -> Correlation:
    """Return the correlation of the residuals of the final model."""
    if evidence.correlation.independent or not found.explanation.size:
        return evidence.correlation
    return found.last.dependence.correlation


def _with_test(subject: Subject, rms: Rms, fits: Sequence[Fit]) -> tuple[Rms, str]:
    """Return the errors with those on further measurements, and a sentence where these are not known, or far larger."""
    if subject.others is None:
        return rms, ""
    before = validation_error(fits[0], subject.others)
    try:
        tested = replace(rms, before_test=before, after_test=validation_error(fits[-1], subject.others))
        return tested, on_another_machine(tested, fits, subject.others)
    except InputFileError as error:  # without a column that an effect needs, which was found only now
        unknown = f"The error on the further measurements with these effects is not known: {error}."
        return replace(rms, before_test=before), unknown


def _ranking(evidence: Evidence) -> tuple[Ranked, ...]:
    """Return every candidate, scored on the model as it was."""
    selection = evidence.selection
    total = selection.left([])
    scores = evidence.space.scores(selection.residual, total)
    tests = np.log(selection.tests(()))
    found = []
    for s in scores:
        log10 = min((s.log_p + tests) / np.log(10), 0.0)
        dof = (float(s.dof), float(s.residual_dof))
        explains = s.fall / total if total > 0 else 0.0
        p = p_of_log10(log10)
        found.append(Ranked(s.candidate.effect, p, float(log10), s.statistic, dof, s.visible, explains))
    return tuple(found)


def _stated(machine: Machine, steps: Sequence[DiagnosedEffect]) -> str:
    """Return which of the effects named and listed the machine file says the odds or sizes of; empty if none."""
    listed = [e for step in steps for e in (step.effect, *(a.effect for a in step.indistinguishable_from))]
    found = list(dict.fromkeys(e.title for e in listed if {e.key(""), e.name} & machine.plausible.keys()))
    are = "is" if len(found) == 1 else "are"
    return f"[plausibility] of the machine file says how likely {joined(found)} {are}." if found else ""


def _sharper_than_estimates(steps: Sequence[DiagnosedEffect], estimates: EffectEstimates) -> str:
    """Return why effects have a p far smaller than their standard deviations say; empty where none has."""
    titles = [
        step.effect.title
        for step in steps
        if estimates.significance(step.effect) > max(VERDICT.sharper * step.p_value, VERDICT.beyond_doubt)
    ]
    if not titles:
        return ""
    return (
        f"p of {joined(titles)} is far smaller than the standard deviations say: it compares readings that share "
        "errors, such as those of successive poses, with each other; the fit weighs all readings alike."
    )


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
