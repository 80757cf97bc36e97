"""Whether a step of a diagnosis is earned: one rule for every effect that is reported, by full fits.

Effects are selected by their linear columns. What is reported must hold in the fit of the whole model, too: the fit
converges, the error on poses left out falls, the data determine a parameter of the effect, and chance does not explain
as much.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rodgen.calibration.checks.held_out import HeldOut
from rodgen.calibration.fitted import Estimate
from rodgen.statistics.f_tests import p_of_log10
from rodgen.statistics.thresholds import VERDICT

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit

__all__ = ["why_not_earned"]


def why_not_earned(
    after: Fit,
    held_out: tuple[HeldOut, HeldOut],
    parameters: Mapping[str, Estimate],
    log10_p: float,
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
    log10_p : float
        Logarithm of the probability that chance explains as much, given all other effects.
    """
    if not after.solution.converged:
        return "the fit with it does not converge"
    before_rms, after_rms = (h.rms for h in held_out)
    if before_rms is not None and after_rms is not None and not after_rms < before_rms:
        return (
            f"the error on poses left out does not fall with it ({before_rms:.4g} before, {after_rms:.4g} "
            f"{after.unit} after)"
        )
    if parameters and not any(
        e.held or (e.std is not None and not e.convention) for e in parameters.values()
    ):
        return "the data do not determine its size"
    if p_of_log10(log10_p) >= VERDICT.rare:
        return f"chance explains as much (p = {p_of_log10(log10_p):.2g})"
    return ""
