"""Every effect that a fit may lack, as a user looks for it: a view of the table of evidence.

What the evidence selects stands first, each followed by what these data cannot distinguish from it; then the others,
the most probable first. Full fits confirm nothing here, so that the list takes a fraction of a second, and is made anew
after every change of the model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.candidates import Candidate
from rodgen.calibration.diagnosis import odds_of
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.fit import Fit
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.selection import equals, ranking, select
from rodgen.calibration.sensitivities import Sensitivities
from rodgen.machines.machine import Effect
from rodgen.statistics.columns import unit_columns
from rodgen.statistics.decompositions import lstsq


@dataclass(frozen=True)
class Suspect:
    """An effect that may be missing.

    Attributes
    ----------
    effect : Effect
    log10_odds : float
        Logarithm of how many times as probable the model is with it as without.
    rms : float
        Error that a fit with it would leave, to first order, in the fit's unit.
    visible : float
        Part of its change of the readings, 0 to 1, that the model cannot imitate.
    chosen : bool
        Whether it is among those that the evidence selects.
    like : Effect or None
        The one before it in the list from which these data cannot distinguish it.
    """

    effect: Effect
    log10_odds: float
    rms: float
    visible: float
    chosen: bool = False
    like: Effect | None = None

    @property
    def odds(self) -> float:
        """How many times as probable the model is with it as without, at most 1e300."""
        return odds_of(self.log10_odds)


@dataclass(frozen=True, eq=False)
class Suspects:
    """The suspects of a fit, the most probable first; those that these data cannot distinguish follow each other."""

    fit: Fit
    listed: tuple[Suspect, ...]
    rows: NDArray[np.int_]
    """Rows of the fit's observations that this is based on."""
    _sensitivities: Sensitivities
    _candidates: Mapping[tuple[str, str | None], Candidate]

    def explained(self, effect: Effect) -> Array:
        """Return the part of the residuals of `rows` that an effect would explain, (rows, m), in the fit's unit.

        The model's parameters change with it, to first order.
        """
        of, candidate = self._sensitivities, self._candidates[effect.identity]
        columns = np.concatenate([of.model, candidate.columns], axis=2)
        flat = unit_columns(columns.reshape(of.residual.size, -1))
        with one_thread_in_blas():
            theta = lstsq(flat, of.residual.ravel(), relative=1e-10)
        weight = np.where(of.weight > 0, of.weight, 1.0)
        before = of.residual / weight
        part = (flat @ theta).reshape(before.shape) / weight
        error, arm = self.fit.machine.measurand.error, self.fit.observations.arm
        return np.asarray((error(before, arm) - error(before - part, arm)) / self.fit.unit_factor)


def suspects(fit: Fit) -> Suspects:
    """Return every effect of the catalogue that a fit may lack, weighed at the fit."""
    with one_thread_in_blas():
        evidence = Evidence.of(fit)
        chosen = select(evidence)
        equal_sets = equals(evidence, chosen)
        table = {one.effect.identity: one for one in ranking(evidence)}
        of, best = evidence.sensitivities, {c.key: c for c in evidence.unseen}
        best |= {c.key: c for c in sorted(evidence.candidates, key=lambda c: -evidence.cost([c]))}
        fits = evidence.independent
        left = {
            key: 1 - evidence.explained([c] if id(c) in evidence.parts else [], fits) / fits.square
            for key, c in best.items()
        }
    order: dict[tuple[str, str | None], Effect | None] = {}
    for c in chosen:
        order.setdefault(c.key, None)
        for one in equal_sets:
            if one.replaced == (c,) and len(one.candidates) == 1:
                order.setdefault(one.candidates[0].key, c.effect)
    order |= {key: None for key in table if key not in order}
    keys = {c.key for c in chosen}
    listed = [
        Suspect(
            table[key].effect,
            table[key].log10_odds,
            fit.rms * math.sqrt(max(left[key], 0.0)),
            table[key].visible,
            key in keys,
            like,
        )
        for key, like in order.items()
    ]
    return Suspects(fit, tuple(listed), of.rows, of, best)
