"""How many times as probable the readings are with an effect as without it: a view of the evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rodgen.calibration.candidates import Candidate, number_tried
from rodgen.calibration.dependence import FitRows, sample_of
from rodgen.calibration.diagnosis import HasOdds
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.fit import Fit
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.selection import log10_of, worth
from rodgen.calibration.words import comparison
from rodgen.machines.machine import Effect
from rodgen.machines.plausibility import plausibility
from rodgen.statistics.thresholds import COST
from rodgen.views import Result


@dataclass(frozen=True)
class StepOdds(HasOdds, Result):
    """What an effect is worth, given all others.

    Attributes
    ----------
    log10_odds : float
        Logarithm of how many times as probable the readings are with the effect as without it.
    """

    log10_odds: float

    _keys = "log10_odds odds needed"

    @property
    def needed(self) -> bool:
        """Whether that is enough for a claim; see `COST.needed`."""
        return 2 * math.log(10) * self.log10_odds >= COST.needed

    @property
    def text(self) -> str:
        """The odds in words."""
        return f"with it the readings are {comparison(self.odds)}"


def odds_of_steps(smaller: Fit, larger: Fit, effects: Sequence[Effect]) -> list[StepOdds | None]:
    """Return for each effect how many times as probable the readings are with it, given the other ones.

    Parameters
    ----------
    smaller : Fit
        Without any of them.
    larger : Fit
        With all of them, to the same observations; its outliers are left out.
    effects : sequence of Effect
        Of the larger fit.

    Returns
    -------
    list of StepOdds or None
        None where the data determine nothing of an effect, or hold no more readings than the model has parameters.
    """
    if not np.array_equal(smaller.outliers, larger.outliers):
        smaller = smaller.refit(outliers=larger.outliers)
    if larger.degrees_of_freedom < 1:
        return [None for _ in effects]
    with one_thread_in_blas():
        rows = FitRows.at(larger, sample_of(smaller.observations, ~smaller.outliers))
        steps = [_candidate(rows, larger, effect) for effect in effects]
        evidence = Evidence.of(smaller, further=[c for c in steps if c is not None])
        seen = [c for c in steps if c is not None and id(c) in evidence.parts]
        return [
            None if c is None or id(c) not in evidence.parts else StepOdds(log10_of(worth(evidence, seen, c)))
            for c in steps
        ]


def _candidate(rows: FitRows, larger: Fit, effect: Effect) -> Candidate | None:
    """Return an effect with its columns at its fitted value; None where the fit determines none of its parameters."""
    columns = [i for i in larger.moving if effect.owns(larger.parameters[i].key)]
    linear = [i for i in columns if larger.parameters[i].searched is None]
    if not linear or all(larger.determinacy.undetermined[i] for i in columns):
        return None
    keys = [larger.parameters[i].key for i in columns]
    searched = {
        key.rpartition(".")[2]: float(larger.solution.theta[i])
        for key, i in zip(keys, columns, strict=True)
        if i not in linear
    }
    prior = plausibility(larger.machine, effect)
    return Candidate(
        effect,
        tuple(larger.parameters[i].key for i in linear),
        np.ascontiguousarray(rows.columns[:, :, linear]),
        searched,
        tries=number_tried(rows, effect) if searched else 1.0,
        prior=replace(prior, log_odds=max(prior.log_odds, -COST.impossible)),
    )
