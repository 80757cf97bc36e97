"""How large an effect could be without being found: what "nothing is missing" leaves open.

An effect of size a changes the whitened readings by a X, of which a |X| is beyond what the fitted parameters imitate.
The least size is that at which the evidence would have turned in 95 of 100 data sets: where the fall of chi-square
exceeds what the effect costs, by 1.645 standard deviations. The root of the fall varies by 1, and what is needed by the
noise that these data happen to have: that is estimated from them, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from rodgen.calibration.candidates import Candidate
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.fitted import Fit
from rodgen.calibration.words import two_digits
from rodgen.data.units import unit_factor
from rodgen.machines.machine import Effect
from rodgen.stages import stage
from rodgen.statistics.thresholds import COST, VERDICT
from rodgen.views import Result


@dataclass(frozen=True, repr=False)
class Detectable(Result):
    """The least size of an effect that a diagnosis would have found, with a probability of 95 %.

    Attributes
    ----------
    effect : Effect
    parameter : str
        Short name; the one that could hide most, the others zero.
    size : float
        In `unit`.
    unit : str
    rms : float
        What that does to the readings, per scalar reading, before any parameter makes up for it; in the diagnosis'
        unit.
    possible : bool
        Whether there are machines with so much of it.
    """

    effect: Effect
    parameter: str
    size: float
    unit: str
    rms: float
    possible: bool
    rare: bool = False

    _keys = "effect=effect.name joint=effect.place parameter size unit rms possible rare"

    @property
    def how_rare(self) -> str:
        """Which machines have so much of it, in words; empty where many have."""
        return "more than most machines have" if self.rare else ""

    @property
    def text(self) -> str:
        """The size, such as ``"k = 0.12 arcsec/mm"``."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.parameter} = {two_digits(self.size)}{unit}"


ONE_SIDED = 1.645
"""Standard deviations that 95 of 100 are above."""


@stage("what could hide")
def detectable(evidence: Evidence) -> tuple[Detectable, ...]:
    """Return the least size of each effect that would have been found, those that could hide most error first.

    Parameters
    ----------
    evidence : Evidence
        Of a fit in which nothing is missing.
    """
    base, rows = evidence.base, evidence.sensitivities
    unweighted = np.where(rows.weight > 0, rows.weight, np.inf) * base.unit_factor
    variance = evidence.estimated([]).variance
    if base.observations.sigma is not None:  # readings that scatter less than stated do so by chance
        variance = max(variance, 1.0)
    sizes_of: dict[tuple[str, str | None], list[Detectable]] = {}
    for candidate in (c for c in evidence.candidates if c.key not in evidence.refused):
        seen = evidence.lengths(candidate)
        cost = COST.something + evidence.choice([candidate]) + evidence.width(candidate)
        # of the sum of squares, in variances, from which on the effect is worth its cost
        fall = evidence.dof * math.expm1(min(cost / evidence.dof, 50.0))
        spread = math.sqrt(1 + fall / (2 * evidence.dof))
        needed = math.sqrt(variance) * (math.sqrt(fall) + ONE_SIDED * spread)
        each = []
        for i, (name, unit, factor) in enumerate(_units(base, candidate)):
            whole = float(np.linalg.norm(candidate.columns[:, :, i]))
            if seen[i] < COST.visible * whole or not seen[i] > 0:
                continue
            size = needed / float(seen[i])
            moved = candidate.columns[:, :, i] / unweighted
            rms = size * float(np.sqrt(np.sum(moved**2) / rows.residual.size))
            known = candidate.prior.sizes.get(name)
            possible = known is None or size <= known.largest
            rare = known is not None and size > VERDICT.unusual * known.usual
            each.append(Detectable(candidate.effect, name, size / factor, unit, rms, possible, rare))
        if each:
            sizes_of.setdefault(candidate.key, []).append(max(each, key=attrgetter("rms")))
    # of the values tried for a searched parameter that in the middle: some are nearly constant, and hide anything
    middle = [sorted(several, key=attrgetter("rms"))[len(several) // 2] for several in sizes_of.values()]
    return tuple(sorted(middle, key=attrgetter("rms"), reverse=True))


def _units(base: Fit, candidate: Candidate) -> Iterator[tuple[str, str, float]]:
    """Yield the short name of each parameter of a candidate, its unit, and the internal value of one of these."""
    units = candidate.effect.units(base.machine)
    for key in candidate.names:
        name = key.rpartition(".")[2]
        yield name, units[name], unit_factor(units[name], base.machine.length_unit)[0]
