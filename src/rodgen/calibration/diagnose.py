"""Which physical effects a machine's model lacks: fit, evidence, the cheapest set, full fits, verdict.

The evidence (`evidence`) weighs sets of effects by linear columns; `selection` finds the cheapest. Full fits have the
last word: what they do not confirm is left out, and the rest is selected anew.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import pairwise, takewhile
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.candidates import Candidate
from rodgen.calibration.decidability import (
    are_wrong,
    held_at_bounds,
    on_few_poses,
    on_unmoved_joints,
    unread_targets,
    why_undecidable,
)
from rodgen.calibration.dependence import FitRows
from rodgen.calibration.detectable import detectable
from rodgen.calibration.diagnosis import (
    Alias,
    DiagnosedEffect,
    Diagnosis,
    Rms,
    SetAlias,
    Unexplained,
    WrongGeometry,
)
from rodgen.calibration.displaced_stretch import DisplacedStretch
from rodgen.calibration.estimates import EffectEstimates
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.fit import Fit, balanced, ended, fit
from rodgen.calibration.forms import propose, sharpened
from rodgen.calibration.geometry import (
    SEVERAL,
    are_most_off,
    gain_of_geometry,
    including_numbers,
    is_dimension,
    with_geometry,
    with_shared_numbers,
)
from rodgen.calibration.held_out import HeldOut
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.problem.blocks import observed
from rodgen.calibration.remarks import (
    aliased,
    disagreement,
    lifted,
    moved_one_way,
    on_preferred,
    uneven,
    unknown_acceleration,
    unknown_approach,
)
from rodgen.calibration.rows import Rows, wrong_rows
from rodgen.calibration.selection import Equal, equals, log10_of, ordered, ranking, select, worth
from rodgen.calibration.sensitivities import NUMBER
from rodgen.calibration.solve.staged_fit import FitError
from rodgen.calibration.summary import contradictions
from rodgen.calibration.validation import bind_validation, on_another_machine, validation_error
from rodgen.calibration.words import NAMES, capitalized, comparison, uncapitalized
from rodgen.errors import InputFileError, joined
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.observations import Observations
from rodgen.stages import Progress, reporting, stage
from rodgen.statistics.columns import orthonormal_basis, project_out
from rodgen.statistics.thresholds import COST, VERDICT
from rodgen.views import plain

ROUNDS = 3
"""Times that effects are selected at most, with the outliers and the dependence of the readings found before."""
MOST_FORMS = 3
"""Times that forms are proposed: each may show when another is taken out."""
MOST_REFUSED = 8
"""Effects that full fits do not confirm, after each of which effects are selected anew."""


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
        The model: fitted, or to be fitted to `data`.
    data : Measurements, Observations or a table in memory, optional
        Needed with a machine.
    test : Measurements or a table in memory, optional
        Others, of which the error is reported, too. Only the frame is fitted to them, where it is free.
    prefer : collection of (name, place), optional
        Effects that are named first among what the data cannot distinguish; place None is every place.
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
    if isinstance(fitted, Fit):
        others = None if test is None else bind_validation(fitted.machine, test)
    else:
        if data is None:
            raise FitError("a machine without measurements; expected both, or a fit")
        observations = observed(fitted, data)
        # Before the fit, which may take long: a fault of the file is reported at once.
        others = None if test is None else bind_validation(fitted, test)
        fitted = fit(fitted, observations, progress=progress)
    with reporting(progress), one_thread_in_blas():
        freed = without_wrong_bounds(fitted)
        diagnosis = _diagnosed(_Subject(freed, others, prefer))
        if diagnosis.final.machine.known == fitted.machine.known:
            return diagnosis
        bounded = diagnosis.final.refit(replace(diagnosis.final.machine, known=fitted.machine.known))
        if bounded.without_bounds is None:  # with what was found, the bounds are right
            return _diagnosed(_Subject(fitted, others, prefer))
        return replace(diagnosis, wrong_bounds=held_at_bounds(bounded, diagnosis.final))


def without_wrong_bounds(fit: Fit) -> Fit:
    """Return a fit without the bounds that its readings contradict."""
    freed = fit.without_bounds
    return fit if freed is None or not are_wrong(fit, freed) else freed


@dataclass(frozen=True, eq=False)
class _Subject:
    """What is diagnosed."""

    fitted: Fit
    others: Observations | None
    """Further measurements, of which the error is reported."""
    prefer: Collection[tuple[str, str | None]]


class Refusal(Enum):
    """Why an effect that the evidence selects is not reported, as its sentence says it."""

    UNSOLVED = "with {} the model has no solution near these readings"
    UNCONVERGED = "the fit with {} does not converge"
    ZERO = "the fit of the whole model, which weighs all readings alike, estimates {} as zero within the uncertainty"
    IDLE = "poses that a fit did not see are predicted no better with {}"


@dataclass(frozen=True, eq=False)
class _State:
    """What is known between two steps.

    Attributes
    ----------
    base : Fit
        Without outliers, and without what was found.
    evidence : Evidence
        Of it.
    chosen : list of Candidate
    fits : list of Fit
        The base, then with one effect after the other.
    refused : dict
        Why effects were not confirmed, by name and place.
    stretch : DisplacedStretch or None
        Rows that lie displaced: what they share competes with the effects.
    gain : float
        By how much a geometry that differs everywhere from the file is cheaper than the effects.
    numbered : Evidence or None
        That with the numbers that all legs share as candidates, of a machine that has some.
    """

    base: Fit
    evidence: Evidence
    chosen: list[Candidate] = field(default_factory=list)
    fits: list[Fit] = field(default_factory=list)
    refused: dict[tuple[str, str | None], Refusal] = field(default_factory=dict)
    stretch: DisplacedStretch | None = None
    gain: float = -math.inf
    numbered: Evidence | None = None

    @property
    def last(self) -> Fit:
        return self.fits[-1]


def _diagnosed(subject: _Subject) -> Diagnosis:
    """Return the diagnosis of a fit."""
    base = subject.fitted
    if reason := why_undecidable(base):
        return _undecided(subject, base, reason)
    geometry: WrongGeometry | None = None
    known = frozenset[tuple[str, str | None]]()
    stretch: DisplacedStretch | None = None
    evidence: Evidence | None = None
    chosen = list[Candidate]()
    for number in range(ROUNDS):
        beside = None if stretch is None else stretch.columns
        evidence = Evidence.of(base, prefer=subject.prefer, known=known, beside=beside, like=evidence)
        if not number and not base.outliers.any():
            outliers = wrong_rows(base, _rows(evidence))
            if outliers.any():
                base = base.refit(outliers=outliers)
                if reason := why_undecidable(base, checked=True):
                    return _undecided(subject, base, reason)
                evidence = Evidence.of(base, prefer=subject.prefer)
        chosen = select(evidence, chosen)
        for _ in range(ROUNDS):  # the dependence of readings must settle before forms and full fits
            if evidence.correlation.independent or (there := _lasting(chosen)) == known:
                break
            known = there
            evidence = Evidence.of(base, prefer=subject.prefer, known=known, beside=beside, like=evidence)
            chosen = select(evidence, chosen)
        whole = _whole(evidence, chosen)
        for _ in range(ROUNDS):
            if whole is None or not whole.is_bent(evidence):
                break
            straight = Evidence.of(base, prefer=subject.prefer, known=known, beside=beside, at=whole.fit)
            before, whole = whole, _whole(straight, anew := select(straight))
            if whole is not None and whole.leaves_more(straight, anew, before.fit):
                break
            evidence, chosen = straight, anew
        selected = _State(base, evidence, chosen, [base], stretch=stretch)
        selected = replace(selected, numbered=_numbered(subject, selected))
        asked = number < ROUNDS - 1
        gain, found = _wrong_geometry(subject, selected) if asked else (-math.inf, None)
        if found is None:
            state = _confirmed(replace(selected, gain=gain))
            if asked and (state.refused or len(selected.chosen) < SEVERAL):
                gain, found = _wrong_geometry(subject, state)
                state = replace(state, gain=gain)
        if found is not None:  # effects are looked for in addition to it
            first, (geometry, base) = geometry, found
            if first is not None:
                estimate, effects = geometry.estimate, (*first.effects, *geometry.effects)
                odds = first.log10_odds + geometry.log10_odds
                more = (*first.alternatives, *geometry.alternatives)
                geometry = replace(
                    first, estimate=estimate, effects=effects, log10_odds=odds, alternatives=more
                )
            subject, known, chosen = replace(subject, fitted=base), frozenset(), []
            continue
        rows = Rows.of(state.last)
        outliers = wrong_rows(state.last, rows)
        chosen, again = state.chosen, _lasting(state.chosen)
        same_rows = np.array_equal(outliers, base.outliers)
        pushed = stretch or _stretch(state, rows)
        if same_rows and pushed is stretch and (again == known or evidence.correlation.independent):
            break
        known, stretch = again, pushed
        if not same_rows:
            base = base.refit(subject.fitted.machine, outliers=outliers)
            if reason := why_undecidable(base, checked=True):
                return _undecided(subject, base, reason)
    answer = _assembled(subject, replace(state, fits=balanced(state.fits)))
    if geometry is None:
        return answer
    verdict = "wrong_geometry" if answer.verdict in {"nothing_missing", "cannot_tell"} else answer.verdict
    rms = replace(
        answer.rms,
        before=geometry.before.rms,
        before_held_out=geometry.rms_held_out,
        before_test=None if subject.others is None else validation_error(geometry.before, subject.others),
        not_held_out=_not_held_out(geometry.before.held_out()) or answer.rms.not_held_out,
    )
    return replace(answer, geometry=geometry, verdict=verdict, rms=rms)


def _lasting(chosen: Sequence[Candidate]) -> frozenset[tuple[str, str | None]]:
    """Return the keys of the effects without drifts: with these the dependence of readings is estimated."""
    return frozenset(c.key for c in chosen if not c.effect.definition.follows_time)


@dataclass(frozen=True, eq=False)
class _Whole:
    """A fit with the chosen effects, what it leaves, (N,), and a basis of their columns and the model's."""

    fit: Fit
    left: Array
    basis: Array

    def is_bent(self, evidence: Evidence) -> bool:
        """Return whether residuals change by more than derivatives explain, and by as much as an effect must."""
        second = project_out(self.basis, self.left - evidence.sensitivities.residual.ravel())
        return bool(second @ second > COST.needed * (self.left @ self.left) / max(evidence.dof, 1))

    def leaves_more(self, evidence: Evidence, chosen: Sequence[Candidate], at: Fit) -> bool:
        """Return whether the fit without some of the effects of another one leaves more than derivatives there say."""
        there = {effect.identity for effect in at.machine.effects[len(evidence.base.machine.effects) :]}
        if there <= {c.key for c in chosen}:
            return False
        predicted = project_out(self.basis, evidence.sensitivities.residual.ravel())
        before = FitRows.at(at, evidence.sensitivities.rows).residual.ravel()
        more = self.left @ self.left - predicted @ predicted
        return bool(more > COST.needed * (before @ before) / max(evidence.dof, 1))


@stage("further fits")
def _whole(evidence: Evidence, chosen: Sequence[Candidate]) -> _Whole | None:
    """Return the fit without forms and what is searched; None where it fails, or an effect replaces a freedom."""
    base, rows = evidence.base, evidence.sensitivities
    direct = [c for c in chosen if not (c.driver or c.searched)]
    if not direct:
        return None
    sizes = [size for c, size in zip(chosen, evidence.sizes(chosen), strict=True) if c in direct]
    start = dict(zip([n for c in direct for n in c.names], np.concatenate(sizes).tolist(), strict=True))
    try:
        whole_fit = ended(base.extended([c.effect for c in direct], start, creeps=False))
    except FitError:
        return None
    if not {p.key for p in base.parameters} <= {p.key for p in whole_fit.parameters}:
        return None
    moving = {whole_fit.parameters[i].key for i in whole_fit.moving}
    there = rows.columns[:, :, [i for key, i in rows.index.items() if key in moving]]
    products = [c.columns for c in direct if not rows.index.keys() & {*c.names}]
    columns = np.concatenate([there, *products], axis=2).reshape(rows.residual.size, -1)
    return _Whole(whole_fit, FitRows.at(whole_fit, rows.rows).residual.ravel(), orthonormal_basis(columns))


def _rows(evidence: Evidence) -> Rows:
    """Return the rows of the evidence, with what its candidates may explain."""
    none = evidence.sensitivities.model[:, :, :0]
    columns = np.concatenate([none, *(c.columns for c in evidence.candidates)], axis=2)
    return Rows.of(evidence.base, columns, evidence.sensitivities.rows)


@stage("looking for a displaced stretch")
def _stretch(state: _State, rows: Rows) -> DisplacedStretch | None:
    """Return rows one after the other that lie displaced; None where that is improbable.

    Errors that poses share, or that wander, may be likelier. A stretch may also be likelier than the effects: they are
    then selected anew in addition to it.

    Parameters
    ----------
    rows : Rows
        All rows of the last fit.
    """
    base, last, evidence = state.base, state.last, state.evidence
    likelier = last.dependence.correlation.gain + COST.something
    if state.chosen:
        some = evidence.sensitivities.rows
        worth_of_effects = (
            evidence.dearer(evidence.independent, []) + evidence.cost([]) - evidence.cost(state.chosen)
        )
        alone = Rows.of(base, some=some).stretch(np.zeros(len(some), bool))
        if alone is not None and alone.gain > likelier + worth_of_effects:
            alone = Rows.of(base).stretch(base.outliers)
            if alone is not None and alone.gain > likelier + worth_of_effects * last.rows / len(some):
                return alone
    stretch = rows.stretch(last.outliers)
    return stretch if stretch is not None and stretch.gain > likelier else None


def _numbered(subject: _Subject, state: _State) -> Evidence | None:
    """Return the evidence with the numbers that all legs share as candidates; None where there are none."""
    more = with_shared_numbers(state.base.machine)
    if more is None or (at := _refitted(state.base, more)) is None:
        return None
    beside = None if state.stretch is None else state.stretch.columns
    known = _lasting(state.chosen)
    there = Evidence.of(state.base, prefer=subject.prefer, known=known, beside=beside, at=at)
    return including_numbers(there)


def _wrong_geometry(subject: _Subject, state: _State) -> tuple[float, tuple[WrongGeometry, Fit] | None]:
    """Return by how much another geometry is cheaper than effects and, where it is, as one cause, with its fit.

    Else with those numbers of a platform on legs that are likelier than effects of single legs.
    """
    base, evidence, chosen = state.base, state.evidence.without(()), state.chosen
    machine, named = base.machine, list[str]()
    cost, numbered = evidence.cost(chosen), state.numbered
    if numbered is not None and numbered.cost(found := select(numbered)) < cost:
        evidence, chosen = numbered, found
        named = [str(c.effect.place) for c in chosen if c.effect.name == NUMBER]
    several = len(chosen) + len(state.refused) >= SEVERAL
    least = -COST.tied if are_most_off(evidence, chosen) else 0.0  # parts are made with tolerances
    gain_of_all = gain_of_geometry(evidence, chosen) if several else -math.inf
    tried = [(gain_of_all, with_geometry(machine), False)]
    tried += [(cost - evidence.cost(chosen), with_shared_numbers(machine, named), True)] if named else []
    for gain, other, by_number in tried:
        whole = _refitted(base, other) if other is not None and gain > least else None
        # predicts poses left out no better
        if whole is not None and not whole.held_out().predicts_no_better_than(base.held_out()):
            effects = whole.machine.effects[len(machine.effects) :]
            odds, held_out = log10_of(gain), base.held_out().rms
            alike = _on_sets(_on_numbers(evidence, chosen) if by_number else ())
            return gain, (WrongGeometry(whole.machine.estimate, effects, odds, base, held_out, alike), whole)
    return gain_of_all, None


def _on_sets(sets: Iterable[Equal]) -> tuple[SetAlias, ...]:
    """Return alternatives to sets of effects in the form in which a result has them."""
    return tuple(
        SetAlias(
            tuple(c.effect for c in one.replaced), tuple(c.effect for c in one.candidates), _odds(one.cost)
        )
        for one in sets
    )


def _on_numbers(evidence: Evidence, chosen: Sequence[Candidate]) -> list[Equal]:
    """Return where the readings do not tell numbers that all legs share from other numbers, or from effects."""
    every = ((one, (*one.replaced, *one.candidates)) for one in equals(evidence, chosen))
    return [one for one, both in every if any(c.effect.name == NUMBER for c in both)]


def _instead_of(state: _State) -> list[Equal]:
    """Return the numbers shared by all legs that explain the readings as well as the effects that were found."""
    if state.numbered is None or not state.chosen:
        return []
    there = {(c.key, *c.searched.items()): c for c in state.numbered.candidates}
    effects = [(c.key, *c.searched.items()) for c in state.chosen if not c.driver]
    known = all(effect in there for effect in effects)
    return _on_numbers(state.numbered, [there[effect] for effect in effects]) if known else []


@stage("further fits")
def _refitted(base: Fit, machine: Machine) -> Fit | None:
    """Return the fit with dimensions estimated; None where it fails."""
    try:
        refit = base.refit(machine, outliers=base.outliers)
    except FitError:
        return None
    return refit if refit.solution.converged else None


def _confirmed(state: _State) -> _State:
    """Return the cheapest set of effects of which full fits confirm every one.

    Forms are proposed in addition to the set that was selected, and, where fits refused some of that, to what they
    confirm.
    """
    evidence, chosen, refused = state.evidence, state.chosen, dict(state.refused)
    were, fits, most, again = chosen, state.fits, MOST_FORMS, False
    while True:
        evidence, chosen = _with_forms(evidence, chosen, most)
        fits, failed = _with_effects(fits, were, evidence, chosen)
        zero = [] if failed else _zero(chosen, fits)
        idle = [] if failed or zero else _idle_forms(chosen, fits)
        if failed is None and not zero and not idle and not again:
            fits = [fits[0], *map(ended, fits[1:])]
            return replace(state, evidence=evidence, chosen=chosen, fits=fits, refused=refused)
        refused |= {c.key: Refusal.ZERO for c in zero} | {c.key: Refusal.IDLE for c in idle}
        if failed is not None:
            refused[failed[0].key] = failed[1]
        were, out = chosen, failed is not None or bool(zero or idle)
        most, again = 0 if out else MOST_FORMS, out and Refusal.IDLE not in refused.values()
        if out:
            if idle:  # without a form that predicts nothing there is none, but other waves of drives
                named = [c for c in evidence.candidates if not (c.driver or c in state.evidence.candidates)]
                evidence = state.evidence.including(named)
            evidence = evidence.without(refused)
            remaining = [c for c in chosen if c in evidence.candidates and c.key not in refused]
            chosen = select(evidence, remaining) if len(refused) <= MOST_REFUSED else []


@stage("forms outside the catalogue")
def _with_forms(evidence: Evidence, chosen: list[Candidate], most: int) -> tuple[Evidence, list[Candidate]]:
    """Return the evidence with forms outside the catalogue among its candidates, and the cheapest set of all."""
    if finer := sharpened(evidence, chosen):
        evidence = evidence.including(finer)
        chosen = select(evidence, chosen)
    for _ in range(most):
        proposals = propose(evidence, chosen)
        if not proposals:
            break
        evidence, before = evidence.including(proposals), chosen
        chosen = select(evidence, chosen)
        if all(c in before for c in chosen):
            break
    return evidence, ordered(evidence, chosen)


@stage("further fits")
def _with_effects(
    known: Sequence[Fit], were: Sequence[Candidate], evidence: Evidence, chosen: Sequence[Candidate]
) -> tuple[list[Fit], tuple[Candidate, Refusal] | None]:
    """Fit the model with one effect after the other; an effect with which there is no fit is returned, with why.

    The fits of a set before, `were`, are known as far as it begins with the same effects.
    """
    alike = takewhile(lambda pair: pair[0] is pair[1], zip(were, chosen, known[1:], strict=False))
    fits = [known[0], *(fit for *_, fit in alike)]
    base, first = fits[0], len(fits) - 1
    for c, size in [*zip(chosen, evidence.sizes(chosen), strict=True)][first:]:
        start = {c.effect.key(name): value for name, value in c.searched.items()}
        if not c.driver:
            start |= dict(zip(c.names, size.tolist(), strict=True))
        try:
            fit = fits[-1].extended([c.effect], start, creeps=False)
            if not fit.solution.converged:  # slow along a narrow valley: once more, from where it ended
                fit = base.refit(fit.machine, outliers=base.outliers)
        except FitError:
            return fits, (c, Refusal.UNSOLVED)
        if not fit.solution.converged:
            return fits, (c, Refusal.UNCONVERGED)
        fits.append(without_wrong_bounds(fit))
    return fits, None


def _zero(chosen: Sequence[Candidate], fits: Sequence[Fit]) -> list[Candidate]:
    """Return effects that the full fit estimates as zero within their uncertainty.

    The least significant alone where readings are independent: another may be determined without it.
    """
    estimates = EffectEstimates(fits[-1])
    p_values = {c: estimates.significance(c.effect) for c in reversed(chosen)}
    zeros = [c for c, p_value in p_values.items() if p_value > VERDICT.zero]
    return [max(zeros, key=p_values.__getitem__)] if zeros and fits[-1].dependence.independent else zeros


def _idle_forms(chosen: Sequence[Candidate], fits: Sequence[Fit]) -> list[Candidate]:
    """Return forms with which poses left out are predicted no better."""
    pairs = zip(chosen, pairwise(fits), strict=True)
    return [
        c for c, (one, more) in pairs if c.driver and more.held_out().predicts_no_better_than(one.held_out())
    ]


# The answer ------------------------------------------------------------------------------------------------------


def _undecided(subject: _Subject, base: Fit, reason: str) -> Diagnosis:
    """Return the diagnosis of data that allow no answer, for a reason."""
    # the error on poses left out of a wrong geometry means nothing, and its fits take long
    why = {"reason": "undecidable", "text": "The data allow no answer, so no poses were held out."}
    rms = Rms(base.rms, base.rms, None, None, base.noise.value, base.unit, not_held_out=why)
    rms, _ = _tested(subject, rms, [base])
    return Diagnosis(
        "cannot_tell",
        reason,
        base.problem.count,
        tuple(base.outlier_numbers),
        rms,
        (),
        (),
        (),
        (base,),
        notes=tuple(_on_rows(subject)),
        estimates=base.estimates,
    )


def _on_rows(subject: _Subject) -> list[str]:
    known = (subject.fitted.observations, subject.others)
    return [sentence for o in known if o is not None for sentence in o.on_rows]


def _not_held_out(*fits: HeldOut) -> dict[str, Any] | None:
    """Return why the first of these has no error that has none."""
    return next((plain(one, "reason text") for one in fits if one.reason is not None), None)


def _assembled(subject: _Subject, state: _State) -> Diagnosis:
    """Return the diagnosis of what full fits confirm."""
    evidence, chosen, fits, last = state.evidence, state.chosen, state.fits, state.last
    estimates = EffectEstimates(last)
    held_out = [fit.held_out() for fit in fits]
    steps, sets = _steps(state, estimates, held_out)
    forms = _forms(state, estimates, held_out)
    first, final = held_out[0], held_out[-1]
    why = _not_held_out(first, final)
    rms = Rms(fits[0].rms, last.rms, first.rms, final.rms, last.noise.value, last.unit, not_held_out=why)
    correlation = evidence.correlation
    if correlation.independent and chosen:
        correlation = evidence.correlation_for(chosen)
    if not correlation.independent and chosen:
        correlation = last.dependence.correlation
    # candidates that are not there may hide a wander, and a wander what is there
    seen = last.dependence.correlation if correlation.independent and not chosen else correlation
    if state.stretch is not None and state.stretch.creeps and not last.machine.measurand.moving:
        state = replace(state, stretch=None)  # of angles and directions a wander says the same
    with stage("testing the final residuals"):
        moved = [
            _on_stretch(subject, state),
            moved_one_way(evidence.sensitivities, seen),
        ]
        rest = uneven(last) or disagreement(last, correlation)
        # a displaced stretch looks like a wander
        is_told = state.stretch is not None or (rest and seen is correlation)
        shared = "" if is_told else seen.text
        if not (rest or chosen) and moved[1] and seen.size("wander") > VERDICT.wander * seen.white:
            rest, shared = seen.text, ""
    refused = _on_refused(state)
    unsolved = {Refusal.UNSOLVED, Refusal.UNCONVERGED} & {*state.refused.values()}
    if (len(state.refused) > MOST_REFUSED and not rest) or (unsolved and not (steps or forms)):
        rest, refused = " ".join(refused), []
    verdict, reason = "nothing_missing", None
    if steps or forms:
        verdict = "unknown_effect" if forms else "effects_missing"
    elif rest or state.stretch is not None:
        verdict, reason = "cannot_tell", " ".join(filter(None, [rest, *moved]))
    notes = [*_on_rows(subject), *on_unmoved_joints(state.base)]
    notes += on_few_poses(state.base) if verdict == "nothing_missing" else ()
    notes += refused
    notes += [*([] if reason else moved), shared]
    if evidence.unusable:
        names = joined(list(dict.fromkeys(c.effect.title for c in evidence.unusable)))
        notes.append(f"Left out, because its formula has no value in some row: {names}.")
    notes += [
        _stated(last.machine, steps),
        unknown_approach(subject.fitted.observations),
        unknown_acceleration(subject.fitted.observations) if rest else "",
        *contradictions(last),
    ]
    if not last.dependence.independent:
        notes.append(last.dependence.text)
    if unread := unread_targets(subject.fitted.observations):
        notes.append(f"No row has the target{'s' * (len(unread) > 1)} {joined(unread)}.")
    notes += map(capitalized, lifted(last.machine, [step.effect for step in steps], last.estimates))
    notes += aliased(last, [step.effect for step in steps])
    notes += on_preferred(evidence, chosen, subject.prefer)
    if -COST.tied < state.gain <= 0 and sum(map(is_dimension, chosen)) >= SEVERAL:
        than = comparison(_odds(-state.gain), than=" than these")
        notes.append(f"That all dimensions differ a little from the file is {than}.")
    if steps and rest:
        notes.append(f"This is not all: {uncapitalized(rest)}")
    rms, unknown = _tested(subject, rms, fits)
    return Diagnosis(
        verdict,
        reason,
        subject.fitted.problem.count,
        tuple(state.base.outlier_numbers),
        rms,
        tuple(steps),
        tuple(forms),
        ranking(evidence),
        tuple(fits[: 1 + len(steps)]),
        seen,
        tuple(filter(None, [*notes, unknown])),
        last.estimates,
        detectable(evidence) if verdict == "nothing_missing" else (),
        tuple(sets),
        log10_of(evidence.cost([]) - evidence.cost(chosen)),
    )


def _odds(cost: float) -> float:
    return math.exp(-max(min(cost, 1000.0), -1000.0) / 2)


def _steps(
    state: _State, estimates: EffectEstimates, held_out: Sequence[HeldOut]
) -> tuple[list[DiagnosedEffect], list[SetAlias]]:
    """Return the effects that were found, and what may be there instead of several of them."""
    evidence, chosen = state.evidence, state.chosen
    replacements = sorted([*equals(evidence, chosen), *_instead_of(state)], key=lambda one: one.cost)
    steps = []
    for k, c in enumerate(c for c in chosen if not c.driver):
        of_effect = [one for one in replacements if [x.key for x in one.replaced] == [c.key]]
        aliases = [Alias(tuple(x.effect for x in one.candidates), _odds(one.cost)) for one in of_effect]
        steps.append(
            DiagnosedEffect(
                c.effect,
                log10_of(worth(evidence, chosen, c)),
                state.fits[k + 1].rms,
                held_out[k + 1].rms,
                estimates.of(c.effect),
                tuple(aliases),
            )
        )
    return steps, [*_on_sets(one for one in replacements if len(one.replaced) > 1)]


def _forms(state: _State, estimates: EffectEstimates, held_out: Sequence[HeldOut]) -> list[Unexplained]:
    """Return the forms outside the catalogue that were found."""
    return [
        Unexplained(
            fit.machine.effects[-1],
            c.driver,
            log10_of(worth(state.evidence, state.chosen, c)),
            fit.rms,
            unseen.rms,
            estimates.of(c.effect),
            fit,
        )
        for c, fit, unseen in zip(state.chosen, state.fits[1:], held_out[1:], strict=True)
        if c.driver
    ]


def _on_refused(state: _State) -> list[str]:
    """Return why effects that the evidence selects are not reported, in a sentence for each reason."""
    missing, titles = [], dict[Refusal, dict[str, None]]()
    for c in state.evidence.candidates:  # a refused form has no name that a reader knows
        if c.key in state.refused and not c.driver:
            titles.setdefault(state.refused[c.key], {})[c.effect.title] = None
    for why, out in titles.items():
        are, it = ("is", "it") if len(out) == 1 else ("are", "them")
        missing.append(f"{joined([*out], most=NAMES)} {are} not reported: {why.value.format(it)}.")
    return missing


def _on_stretch(subject: _Subject, state: _State) -> str:
    """Return a sentence on rows that lie displaced; empty where none do."""
    stretch = state.stretch
    if stretch is None:
        return ""
    place = subject.fitted.observations.data.place
    first, last = place(stretch.first), place(stretch.last)
    targets = "targets" if len(subject.fitted.machine.targets) > 1 else "target"
    dearer, speed = stretch.gain - stretch.rival, "sudden" if stretch.creeps else "slow"
    near = stretch.of_target and dearer < COST.tied
    instead = f" A {speed} motion of the {targets} instead is {comparison(_odds(dearer))}." * near
    if stretch.creeps:
        return (
            f"The {targets} may creep, moving slowly against the machine from {first} to {last}.{instead} Fasten the "
            f"{targets}, let the machine warm up, and measure again."
        )
    remedy = (
        f"{targets} may have been mounted another way"
        if stretch.of_target
        else "set-up may have been another"
    )
    return (
        f"The readings from {first} to {last} lie displaced against the others: the {remedy} there.{instead} Note the "
        "set-ups in a column run, and diagnose again."
    )


def _tested(subject: _Subject, rms: Rms, fits: Sequence[Fit]) -> tuple[Rms, str]:
    """Return the errors with those on further measurements, and a sentence where these are not known, or far larger."""
    if subject.others is None:
        return rms, ""
    before = validation_error(fits[0], subject.others)
    try:
        tested = replace(rms, before_test=before, after_test=validation_error(fits[-1], subject.others))
        return tested, on_another_machine(tested)
    except InputFileError as error:  # without a column that an effect needs, which was found only now
        unknown = f"The error on the further measurements with these effects is not known: {error}."
        return replace(rms, before_test=before), unknown


def _stated(machine: Machine, steps: Sequence[DiagnosedEffect]) -> str:
    """Return which of the effects named and listed the machine file says the odds or sizes of; empty if none."""
    listed: list[Effect] = [
        e
        for step in steps
        for e in (step.effect, *(x for a in step.indistinguishable_from for x in a.effects))
    ]
    titles = list(dict.fromkeys(e.title for e in listed if {e.key(""), e.name} & machine.plausible.keys()))
    are = "is" if len(titles) == 1 else "are"
    return f"[plausibility] of the machine file says how likely {joined(titles)} {are}." if titles else ""
