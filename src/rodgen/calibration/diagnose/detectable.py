"""How large an effect could be without being found: what "nothing is missing" leaves open.

An effect of size a changes the whitened readings by a X; what the model's own parameters cannot imitate of it has the
length a |X⊥|, and the fall of chi-square is a non-central chi-square of that square. The least size is that at which
the fall exceeds what a diagnosis asks for in 95 of 100 data sets.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.selection import Selection
from rodgen.calibration.diagnose.sensitivities import Sensitivities
from rodgen.calibration.words import two_digits
from rodgen.data.units import unit_factor
from rodgen.machines.machine import Effect
from rodgen.statistics.thresholds import SELECTION, VERDICT
from rodgen.views import Result

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit


@dataclass(frozen=True, repr=False)
class Detectable(Result):
    """The least size of an effect that a diagnosis would have found, with `VerdictPolicy.power`.

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
        if not self.possible:
            return "more than any machine has"
        return "more than most machines have" if self.rare else ""

    @property
    def text(self) -> str:
        """The size, such as ``"k = 0.12 arcsec/mm"``."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.parameter} = {two_digits(self.size)}{unit}"


def detectable(base: Fit, sensitivities: Sensitivities, selection: Selection) -> tuple[Detectable, ...]:
    """Return the least size of each effect that would have been found, those that could hide most error first.

    Parameters
    ----------
    base : Fit
        In which nothing was found.
    sensitivities : Sensitivities
        Of it.
    selection : Selection
        Of the candidates there.
    """
    space = selection.space
    own = space.base()
    residual_dof = max(space.readings - own.rank, 1)
    variance = selection.variance([])
    log_level = float(np.log(selection.level / selection.tests(())))
    unweighted = np.where(sensitivities.weight > 0, sensitivities.weight, np.inf) * base.unit_factor
    readings = sensitivities.residual.size
    found: dict[tuple[str, str | None], list[Detectable]] = {}
    for candidate in space.candidates:
        across = own.project_out(space.columns(candidate)) * space.sizes(candidate)
        dof = space.across((), candidate).shape[1]
        if not dof or not variance > 0 or candidate.later_weights:
            continue
        fall = _needed(dof, residual_dof, log_level - float(np.log(candidate.tries))) * variance
        each = []
        for i, (name, unit, factor) in enumerate(_units(base, candidate)):
            seen = float(np.linalg.norm(across[:, i]))
            if seen < SELECTION.visible * float(space.sizes(candidate)[i]) or not seen > 0:
                continue
            size = float(np.sqrt(fall)) / seen
            rms = size * float(np.sqrt(np.sum((candidate.columns[:, :, i] / unweighted) ** 2) / readings))
            known = candidate.prior.sizes.get(name)
            possible = known is None or size <= known.largest
            rare = known is not None and size > VERDICT.unusual * known.usual
            each.append(Detectable(candidate.effect, name, size / factor, unit, rms, possible, rare))
        if each:
            found.setdefault(candidate.key, []).append(max(each, key=_rms))
    # of the values tried for a searched parameter that in the middle: some are all but a constant, and hide anything
    middle = [sorted(several, key=_rms)[len(several) // 2] for several in found.values()]
    return tuple(sorted(middle, key=_rms, reverse=True))


def _rms(one: Detectable) -> float:
    return one.rms


def _needed(dof: int, residual_dof: int, log_level: float) -> float:
    """Return the non-centrality of chi-square that a diagnosis finds with the power asked for.

    The fall must be beyond chance, and the error on poses left out must fall noticeably.
    """
    from scipy import special

    level = max(float(np.exp(log_level)), 1e-300)
    beyond_chance = dof * float(special.fdtri(dof, residual_dof, 1 - level)) if level > 1e-14 else np.inf
    if not np.isfinite(beyond_chance):
        beyond_chance = float(special.chdtri(dof, level))
    noticed = (1 - (1 - SELECTION.noticed) ** 2) * residual_dof + 2 * dof
    return float(special.chndtrinc(max(beyond_chance, noticed), dof, 1 - VERDICT.power))


def _units(base: Fit, candidate: Candidate) -> Iterator[tuple[str, str, float]]:
    """Yield the short name of each parameter of a candidate, its unit, and the internal value of one of these."""
    units = candidate.effect.units(base.machine)
    for key in candidate.names:
        name = key.rpartition(".")[2]
        yield name, units[name], unit_factor(units[name], base.machine.length_unit)[0]
