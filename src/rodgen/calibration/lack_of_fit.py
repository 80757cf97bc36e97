"""Whether the residuals are larger than the noise, that is, whether the model misses something.

Where poses were repeated, the squares of the residuals split into those from the mean of the replicates (pure error)
and those of that mean from the model, and their ratio is held against F. Where a noise is stated, their sum is held
against chi-square with it. A stated noise may be too small, and replicates that follow each other share errors and
scatter too little: so where both are known the residuals exceed the noise only if they exceed either. Readings of one
pose depend on each other, so the degrees of freedom are those of as many independent readings as scatter alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.noise_floor import FEW_POSES, Replicates, independent_share, replicates
from rodgen.calibration.words import chance
from rodgen.statistics.f_tests import f_tail
from rodgen.statistics.thresholds import LACK_OF_FIT, SMALLEST_P
from rodgen.views import Result

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit


@dataclass(frozen=True)
class LackOfFit(Result):
    """Whether the residuals are larger than the noise.

    Attributes
    ----------
    p_value : float
        Probability of residuals as large, were the model right; at least 1e-300.
    ratio : float
        Residuals over noise, as standard deviations with their degrees of freedom.
    against : {"replicates", "stated"}
        What the noise is known from.
    statistic : float
        F against replicates, chi-square against the stated noise.
    degrees_of_freedom : tuple of float
        Of F, or one of chi-square; effective ones.
    text : str
        One sentence.
    """

    p_value: float
    ratio: float
    against: str
    statistic: float
    degrees_of_freedom: tuple[float, ...]

    _keys = "p_value ratio against statistic degrees_of_freedom text"

    @property
    def misses(self) -> bool:
        """Whether the model misses something."""
        return self.p_value < LACK_OF_FIT.rare

    @property
    def text(self) -> str:
        """One sentence."""
        noise = "the stated noise" if self.against == "stated" else "the noise"
        p = chance(self.p_value)
        if self.misses:
            return f"The residuals are {self.ratio:.3g} times {noise}: the model misses something ({p})."
        if self.against == "stated" and self.p_value > 1 - LACK_OF_FIT.rare / 2:
            return f"The residuals are only {self.ratio:.3g} times {noise}: the noise is less than stated."
        return f"The residuals agree with {noise} ({self.ratio:.3g} times it, {p})."


def lack_of_fit(fit: Fit) -> LackOfFit | None:
    """Return the test of the residuals against the noise.

    Returns
    -------
    LackOfFit or None
        None where the noise is not known or zero, or no degree of freedom is left.
    """
    stated = fit.observations.sigma is not None
    pure = replicates(fit, weighted=stated)
    if not stated:
        return _against_replicates(fit, pure)
    by_stated = _against_stated(fit)
    found = _against_replicates(fit, pure) if pure.differences >= FEW_POSES else None
    if found is None or by_stated is None:
        return by_stated
    # a noise that the residuals contradict says nothing
    too_large = by_stated.p_value > 1 - LACK_OF_FIT.rare / 2
    return found if too_large or found.p_value > by_stated.p_value else by_stated


def _against_replicates(fit: Fit, pure: Replicates) -> LackOfFit | None:
    cells = pure.cells * fit.problem.components - fit.determinacy.rank
    residual_dof = cells - pure.count
    if pure.count < 1 or residual_dof < 1 or not pure.variance > 0:
        return None
    squares = max(pure.squares - pure.variance * pure.count, 0.0)
    dof = (max(pure.share * residual_dof, 1.0), max(pure.share * pure.count, 1.0))
    statistic = squares / residual_dof / pure.variance
    ratio = float(np.sqrt(pure.squares / cells / pure.variance))
    return LackOfFit(max(f_tail(statistic, *dof), SMALLEST_P), ratio, "replicates", statistic, dof)


def _against_stated(fit: Fit) -> LackOfFit | None:
    """Return the test of the residuals against the stated noise; None where no degree of freedom is left."""
    from scipy import special

    left = fit.degrees_of_freedom
    if left < 1:
        return None
    dof, ratio = max(independent_share(fit) * left, 1.0), fit.chi_square / left
    p = max(float(special.chdtrc(dof, dof * ratio)), SMALLEST_P)
    return LackOfFit(p, float(np.sqrt(ratio)), "stated", dof * ratio, (dof,))
