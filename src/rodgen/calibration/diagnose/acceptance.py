"""Whether a step of a diagnosis is earned: one rule for every effect that is reported, by full fits.

Effects are selected by their linear columns. What is reported must hold in the fit of the whole model, too: the fit
converges, the error on poses left out falls, the data determine a parameter of the effect, and chance does not explain
as much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from rodgen.calibration.checks.effect_test import EffectTest
from rodgen.calibration.checks.held_out import HeldOut
from rodgen.calibration.diagnose.candidates import FEWEST_WAVES, WAVES_STEP
from rodgen.calibration.fitted import Estimate
from rodgen.calibration.words import chance
from rodgen.data.observations import Observations
from rodgen.machines.effects.definition import StartSearch
from rodgen.machines.machine import Effect
from rodgen.machines.parameters import Parameter
from rodgen.statistics.thresholds import VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit

__all__ = ["why_empty", "why_not_earned"]


def why_empty(o: Observations, effect: Effect, parameters: Sequence[Parameter], values: ArrayLike) -> str:
    """Return why an effect says nothing at the values that were searched for, as the end of a sentence; else empty.

    A fit may move a time constant or a period to where the effect is a constant, a straight line or a bend, with which
    it has nothing to do.

    Parameters
    ----------
    o : Observations
    effect : Effect
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
    before_rms, after_rms = (h.rms for h in held_out)
    if before_rms is not None and after_rms is not None and not after_rms < before_rms:
        return (
            f"the error on poses left out does not fall with it ({before_rms:.4g} before, {after_rms:.4g} "
            f"{after.unit} after)"
        )
    if worth is None or (
        parameters
        and not any(e.held or (e.std is not None and not e.convention) for e in parameters.values())
    ):
        return "the data do not determine its size"
    if not worth.significant or worth.p_value * tests >= VERDICT.rare:
        return f"chance explains as much ({chance(worth.p_value)})"
    return ""
