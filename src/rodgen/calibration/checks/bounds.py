"""Whether a bound of the machine file keeps a fit from the readings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rodgen.calibration.checks.effect_test import effect_test
from rodgen.calibration.words import chance, fall
from rodgen.errors import joined

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel


def are_wrong(bounded: FittedModel, freed: FittedModel) -> bool:
    """Return whether the readings contradict bounds.

    Parameters
    ----------
    bounded, freed : FittedModel
        With bounds that hold it, and the same without these.
    """
    test = effect_test(bounded, freed)
    return test is not None and test.significant


def held_at_bounds(bounded: FittedModel, freed: FittedModel) -> str:
    """Return a sentence on bounds that hold a fit, and what they cost.

    Parameters
    ----------
    bounded, freed : FittedModel
        With bounds that hold it, and the same without these.
    """
    held = [e for e in bounded.estimates.values() if e.at_bound]
    units = ["" if e.unit == "1" else f" {e.unit}" for e in held]
    names = joined([e.key for e in held])
    ends = joined([f"{e.value:.4g}{unit}" for e, unit in zip(held, units, strict=True)])
    free = joined([f"{freed.estimates[e.key].value:.4g}{unit}" for e, unit in zip(held, units, strict=True)])
    is_held, it = ("is held at its bound", "it") if len(held) == 1 else ("are held at their bounds", "these")
    test = effect_test(bounded, freed)
    p = f" ({chance(test.p_value)})" if test else ""
    error = fall(bounded.rms, freed.rms, bounded.unit)
    return f"{names} {is_held}, {ends}; without {it} the error {error}{p}, with {names} = {free}."
