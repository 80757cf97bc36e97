"""Whether a step of a diagnosis is earned: one rule for every effect that is reported, by full fits.

Effects are selected by their linear columns. What is reported must hold in the fit of the whole model, too: the fit
converges, the error on poses left out falls, the data determine a parameter of the effect, and chance does not explain
as much. An effect that is insignificant in it (`insignificant`) is left out without a note, as the columns promised too
much; one that is significant but not earned (`unearned_effect`) is selected against, and reported as refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from rodgen.calibration.checks.effect_test import (
    EffectTest,
    effect_test,
    further_combinations,
    with_the_same_weights,
    worth_of,
)
from rodgen.calibration.checks.held_out import HeldOut
from rodgen.calibration.checks.positions import few_positions
from rodgen.calibration.diagnose.candidates import FEWEST_WAVES, WAVES_STEP, Candidate
from rodgen.calibration.diagnose.estimates import EffectEstimates
from rodgen.calibration.diagnose.forms import Form
from rodgen.calibration.diagnose.selection import Selection
from rodgen.calibration.diagnose.subject import FittedExplanation, Subject, with_forms
from rodgen.calibration.fitted import Estimate
from rodgen.calibration.words import chance, how_rarely
from rodgen.data.observations import Observations
from rodgen.machines.effects.definition import StartSearch
from rodgen.machines.machine import Effect
from rodgen.machines.parameters import Parameter
from rodgen.stages import stage
from rodgen.statistics.f_tests import log_p_of_fall
from rodgen.statistics.thresholds import FORMS, VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit

WRONG_SIGN = "no machine has it of this sign"
FASTER = "It may be there all the same, and more readings in the same time would tell"
MORE = "it may be there all the same, and more positions would tell"


def may_be_there(why: str) -> bool:
    """Return whether a reason against an effect only says that a joint was in too few positions."""
    return why.endswith(MORE)


@stage("further fits")
def worths(subject: Subject, found: FittedExplanation) -> list[EffectTest | None]:
    """Return the test of each effect, then of each form, given all others, as `rodgen add` makes it."""
    fits, last = [*found.fits, *found.formed], found.last
    tests = [effect_test(found.without(subject, c), last) for c in found.explanation.kept]
    tests += [
        worth_of(last, fit.machine.effects[-1], fits[-2] if fit is last else None) for fit in found.formed
    ]
    return tests


def unearned_effect(
    subject: Subject,
    selection: Selection,
    found: FittedExplanation,
    held_out: Sequence[HeldOut],
    tests: Sequence[EffectTest | None],
) -> tuple[Candidate, str] | None:
    """Return the last effect that full fits do not confirm, and why not; None where they confirm all.

    Where there are forms, an effect is judged with them: it may be large with one, and hardly show without. So is
    one that raises the error on poses left out where it stands, with the effects after it.

    Parameters
    ----------
    held_out : sequence of HeldOut
        Errors on poses left out of all its fits.
    tests : sequence of EffectTest or None
        By `worths`.
    """
    last, estimates = found.last, EffectEstimates(found.last)
    for k, candidate in reversed(list(enumerate(found.explanation.kept))):
        effect, fit, pair = candidate.effect, found.fits[k + 1], (held_out[k], held_out[k + 1])
        # a pair may lower the error that the first of the two alone raises
        together = candidate is not found.explanation.kept[-1] and pair[1].rises_from(pair[0])
        if found.explanation.forms or together:
            fit, pair = last, (found.without(subject, candidate).held_out(), held_out[-1])
        number = found.explanation.tests_of(candidate)
        why = why_not_earned(fit, effect, pair, estimates.of(effect), tests[k], number)
        if not why and not estimates.are_possible(effect, selection.prior_of(candidate)):
            of_any_sign = estimates.are_possible(effect, candidate.prior.of_any_sign)
            why = WRONG_SIGN if of_any_sign else "no machine has so much of it"
        why = why or why_empty(last.observations, effect, last.parameters, last.solution.theta)
        if why:
            return candidate, why
    return None


def earned_forms(
    subject: Subject, found: FittedExplanation, held_out: HeldOut
) -> tuple[FittedExplanation, list[HeldOut]]:
    """Return what was found with the forms that lower the error on poses left out, and these errors.

    Parameters
    ----------
    held_out : HeldOut
        Error on poses left out of the fit without forms.
    """
    kept: list[Form] = []
    fits, errors = [found.fits[-1]], [held_out]
    for number, (form, fit) in enumerate(zip(found.explanation.forms, found.formed, strict=True)):
        if len(kept) < number:  # the fit has one that was refused
            fit = with_forms(subject, fits[0], replace(found.explanation, forms=(*kept, form)))[-1]
        error, unseen = errors[-1].rms, fit.held_out()
        if error is None or unseen.rms is None or unseen.rms**2 < (1 - FORMS.noticeable) * error**2:
            kept.append(form)
            fits.append(fit)
            errors.append(unseen)
    explanation = replace(found.explanation, forms=tuple(kept))
    return FittedExplanation(explanation, found.fits, fits[1:]), errors[1:]


def insignificant(subject: Subject, found: FittedExplanation, dependent: bool) -> Candidate | None:
    """Return an effect that was selected by its columns but is insignificant in the full fit, else None.

    The fit has the forms, too: an effect may be large together with one, and hardly show without it.

    Parameters
    ----------
    dependent : bool
        Whether readings depend on each other: chi-square means little then, and so do estimates of a fit that weighs
        readings as if they were independent. A walk that spoils these leaves differences between neighbours as they
        are, by which `effect_test` sees an effect.
    """
    estimates = EffectEstimates(found.last)
    for candidate in found.explanation.kept:
        if estimates.significance(candidate.effect) >= VERDICT.rare:
            without = found.without(subject, candidate)
            if (_chance_does if dependent else _fits_as_well)(without, found.last):
                return candidate
    return None


def _chance_does(without: Fit, final: Fit) -> bool:
    test = effect_test(without, final)
    return test is None or test.p_value >= VERDICT.rare


def _fits_as_well(without: Fit, final: Fit) -> bool:
    lesser, whole = with_the_same_weights(without, final)
    further = further_combinations(lesser, whole)
    fall = lesser.least_sum - whole.least_sum
    if further < 1 or not fall > 0:
        return True
    log = log_p_of_fall(fall, whole.chi_square, further, max(whole.degrees_of_freedom, 1))
    return bool(log > np.log(VERDICT.rare))


def weakest_last(held_out: Sequence[HeldOut]) -> list[int]:
    """Return an order of effects in which those come last that lower no error on poses left out where they stand.

    As long as a larger effect is missing, its error hides a smaller one; what counts is whether an effect lowers the
    error when the others are there.
    """
    rises = [after.rises_from(before) for before, after in pairwise(held_out)]
    return sorted(range(len(rises)), key=rises.__getitem__)


def why_empty(o: Observations, effect: Effect, parameters: Sequence[Parameter], values: ArrayLike) -> str:
    """Return why an effect says nothing at the values that were searched for, as the end of a sentence; else empty.

    A fit may move a time constant or a period to where the effect is a constant, a straight line or a bend, with which
    it has nothing to do.

    Parameters
    ----------
    parameters : sequence of Parameter
        Of the model that was fitted.
    values : array_like, shape (parameters,)
        Theirs, internal units.
    """
    for parameter, value in zip(parameters, np.asarray(values, float), strict=True):
        if not effect.owns(parameter.key):
            continue
        search = parameter.searched
        if search is StartSearch.TIME_CONSTANT and o.t is not None:
            times = np.unique(o.t)
            if abs(value) > VERDICT.longest * np.ptp(times):
                return "it is so slow that a straight line does the same"
            if abs(value) < VERDICT.shortest * np.diff(times).min(initial=np.inf):
                return "it is over before the second reading"
        elif search is StartSearch.PERIOD:
            q = o.q[:, [joint.name for joint in o.machine.joints].index(str(effect.place))]
            if abs(value) * (FEWEST_WAVES - WAVES_STEP / 2) > np.ptp(q):
                return "its period is longer than half of the travel, which any bend imitates"
    return ""


def why_not_earned(
    after: Fit,
    effect: Effect,
    held_out: tuple[HeldOut, HeldOut],
    parameters: Mapping[str, Estimate],
    worth: EffectTest | None,
    tests: float,
) -> str:
    """Return why an effect is not to be reported, as the end of a sentence; empty where it is.

    Parameters
    ----------
    after : Fit
        Of the model with the effect.
    held_out : tuple of HeldOut
        Errors on poses left out, of the models without and with the effect.
    parameters : mapping of str to Estimate
        The effect's, in the final fit.
    worth : EffectTest or None
        Of the effect, given all others; None where the data determine nothing of it.
    tests : float
        Number of independent tests that all candidates amount to.
    """
    if not after.solution.converged:
        return "the fit with it does not converge"
    before, with_it = held_out
    if with_it.rises_from(before):
        return (
            f"the error on poses left out does not fall with it ({before.rms:.4g} before, {with_it.rms:.4g} "
            f"{after.unit} after)"
        )
    if worth is None or (
        parameters
        and not any(e.held or (e.std is not None and not e.convention) for e in parameters.values())
    ):
        return "the data do not determine its size"
    if not worth.significant or worth.p_value * tests >= VERDICT.rare:
        if worth.as_a_walk:
            return f"a set-up that wanders may do the same ({chance(worth.p_value)}). {FASTER}"
        few = few_positions(effect, after.observations)
        with_few = f" with {few[1]} position{'s' * (few[1] > 1)} of {few[0]}: {MORE}" if few else ""
        of_all = worth.p_value * tests
        rarely = f"{how_rarely(of_all)} ({chance(worth.p_value)})"
        return (rarely if of_all < 0.5 else f"chance explains as much ({chance(worth.p_value)})") + with_few
    return ""
