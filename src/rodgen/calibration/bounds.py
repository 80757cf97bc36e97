"""Bounds of the machine file that keep a fit from the readings."""

from __future__ import annotations

import math

from rodgen.array_types import Array
from rodgen.calibration.dependence import FitRows
from rodgen.calibration.fitted import Fit
from rodgen.calibration.words import comparison, fall
from rodgen.errors import joined
from rodgen.statistics.thresholds import COST


def are_wrong(bounded: Fit, freed: Fit) -> bool:
    """Return whether the readings contradict bounds: it is likelier that the file is wrong there.

    Parameters
    ----------
    bounded, freed : Fit
        With bounds that hold it, and the same without these.
    """
    held = sum(bool(e.at_bound) for e in bounded.estimates.values())
    return cost_of_bounds(bounded, freed) > 2 * COST.impossible * held


def cost_of_bounds(bounded: Fit, freed: Fit) -> float:
    """Return by how much the bounds raise -2 ln of the likelihood, with the noise that the readings show."""
    correlation = freed.dependence.correlation

    def squares(fit: Fit) -> float:
        residual: Array = correlation.whiten(FitRows.of(fit).residual[:, :, None])
        return float((residual**2).sum())

    before, after = squares(bounded), squares(freed)
    count = min(freed.degrees_of_freedom, FitRows.of(freed).residual.size)
    if count < 1 or not before > after:
        return 0.0
    return count * math.log(before / after) if after > 0 else math.inf


def held_at_bounds(bounded: Fit, freed: Fit) -> str:
    """Return a sentence on bounds that hold a fit, and what they cost.

    Parameters
    ----------
    bounded, freed : Fit
        With bounds that hold it, and the same without these.
    """
    held = [e for e in bounded.estimates.values() if e.at_bound]
    units = ["" if e.unit == "1" else f" {e.unit}" for e in held]
    names = joined([e.key for e in held])
    ends = joined([f"{e.value:.4g}{unit}" for e, unit in zip(held, units, strict=True)])
    free = joined([f"{freed.estimates[e.key].value:.4g}{unit}" for e, unit in zip(held, units, strict=True)])
    is_held, it = ("is held at its bound", "it") if len(held) == 1 else ("are held at their bounds", "these")
    odds = math.exp(min(cost_of_bounds(bounded, freed) / 2, 100.0))
    error = fall(bounded.rms, freed.rms, bounded.unit)
    return (
        f"{names} {is_held}, {ends}; without {it} the error {error}, with {names} = {free}, and the readings are "
        f"{comparison(odds)}."
    )
