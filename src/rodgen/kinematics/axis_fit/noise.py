"""The size of the noise, and the pairs that are too far off to be noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.kinematics.axis_fit.pairs import Pairs
from rodgen.kinematics.axis_fit.robust import Loss, chi_cut, median_variance, trimmed_variance

__all__ = ["Noise"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise and outliers at a solution.

    Attributes
    ----------
    variance : float
        Of a coordinate at weight 1, scaled lengths; NaN where unknown.
    sigma : float
        Standard uncertainty in the user's unit; NaN where unknown.
    z : (N,) array
        Residuals in units of their standard deviation; 0 where that is unknown.
    used, outliers, good : (N,) bool arrays
        Pairs with a weight, those too far off, and the others.
    dof : int
        Degrees of freedom of the good pairs.
    chi_square : float or None
        Of the good pairs, where sigma was given.
    """

    variance: float
    sigma: float
    z: Floats
    used: NDArray[np.bool_]
    outliers: NDArray[np.bool_]
    good: NDArray[np.bool_]
    dof: int
    chi_square: float | None

    @classmethod
    def of(cls, pairs: Pairs, loss: Loss, squares: Floats) -> Noise:
        """Judge by half the weighted squares of the residuals."""
        used = pairs.weight > 0
        count, parameters = int(used.sum()), pairs.parameters
        freedoms = 3 * count - parameters
        if pairs.variance is not None:
            variance = pairs.variance
        elif freedoms <= 0:
            variance = math.nan
        elif loss.name == "linear":
            variance = float(squares[used].sum()) / freedoms
        else:
            variance = trimmed_variance(squares[used], parameters, median_variance(squares[used], parameters))

        z, outliers = np.zeros(len(used)), np.zeros(len(used), dtype=bool)
        if not math.isnan(variance):
            # Exact pairs leave residuals of rounding; none of them is an outlier.
            z = np.sqrt(squares / max(variance, (4 * pairs.rounding) ** 2))
            # A pair that alone makes the fit cannot be off it.
            if freedoms > 0:
                outliers = used & (z > chi_cut(count))
        good = used & ~outliers
        if 3 * int(good.sum()) < parameters:
            good = used
        dof = 3 * int(good.sum()) - parameters
        if pairs.variance is not None:
            chi_square = float(squares[good].sum()) / variance
            return cls(variance, pairs.sigma, z, used, outliers, good, dof, chi_square)
        sigma = (
            math.sqrt(variance / pairs.unit_weight) * pairs.scale if not math.isnan(variance) else math.nan
        )
        return cls(variance, sigma, z, used, outliers, good, dof, None)
