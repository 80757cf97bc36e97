"""The size of the noise, and the pairs that are too far off to be noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.kinematics.axis_fit.pairs import Pairs
from rodgen.kinematics.axis_fit.robust import Loss, chi_cut, median_variance, trimmed_variance


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise and outliers at a solution."""

    variance: float
    """Of a coordinate at weight 1, scaled lengths; NaN where unknown."""
    sigma: float
    """Standard uncertainty in the user's unit; NaN where unknown."""
    squares: Array
    """w |d|²/2 of the residuals, (N,)."""
    unit: float
    """What `squares` are compared with: the variance or that of rounding, infinite where unknown."""
    used: NDArray[np.bool_]
    outliers: NDArray[np.bool_]
    good: NDArray[np.bool_]
    """Pairs with a weight, those too far off, and the others, (N,)."""
    dof: int
    """Degrees of freedom of the good pairs."""
    chi_square: float | None
    """Of the good pairs, where sigma was given."""

    @classmethod
    def of(cls, pairs: Pairs, loss: Loss, squares: Array) -> Noise:
        """Judge by half the weighted squares of the residuals."""
        used = pairs.weight > 0
        count, parameters = int(used.sum()), pairs.parameters
        counted = squares if used.all() else squares[used]
        freedoms = 3 * count - parameters
        if pairs.variance is not None:
            variance = pairs.variance
        elif freedoms <= 0:
            variance = math.nan
        elif loss.name == "linear":
            variance = float(counted.sum()) / freedoms
        else:
            variance = trimmed_variance(counted, parameters, median_variance(counted, parameters))

        # Exact pairs leave residuals of rounding; none of them is an outlier.
        unit = math.inf if math.isnan(variance) else max(variance, (4 * pairs.rounding) ** 2)
        # A pair that alone makes the fit cannot be off it.
        outliers = used & (squares > chi_cut(count) ** 2 * unit) if freedoms > 0 else np.zeros_like(used)
        good = used & ~outliers
        if 3 * int(good.sum()) < max(parameters, 1):
            good = used
        dof = 3 * int(good.sum()) - parameters
        if pairs.variance is not None:
            chi_square = float(squares.sum(where=good)) / variance
            return cls(variance, pairs.sigma, squares, unit, used, outliers, good, dof, chi_square)
        sigma = (
            math.sqrt(variance / pairs.unit_weight) * pairs.scale if not math.isnan(variance) else math.nan
        )
        return cls(variance, sigma, squares, unit, used, outliers, good, dof, None)
