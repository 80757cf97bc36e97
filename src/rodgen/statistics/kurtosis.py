"""The test of Anscombe and Glynn (1983), whether normal numbers have a kurtosis as large as one that was found.

SciPy's `kurtosistest` is the same test, and takes half a second to import; it finds a small probability, too, where
the kurtosis is far too small (1.2 of 200 numbers, as of errors that are all about as large), which is mended here.
"""

from __future__ import annotations

import math

import numpy as np

from rodgen.array_types import Array
from rodgen.statistics.thresholds import ROBUST


def has_heavy_tails(residuals: Array) -> bool:
    """Return whether residuals of any shape have a kurtosis that normal errors do not reach; of few never."""
    if residuals.size < ROBUST.fewest_for_tails or not np.ptp(residuals) > 0:
        return False
    return kurtosis_tail(kurtosis_of(residuals), residuals.size) < ROBUST.heavy_tails


def kurtosis_of(numbers: Array) -> float:
    """Return the fourth central moment of numbers of any shape by the square of the second."""
    e = numbers - numbers.mean()
    e = e / np.abs(e).max()  # so that powers of small numbers stay numbers
    return float(np.mean(e**4) / np.mean(e**2) ** 2)


def kurtosis_tail(kurtosis: float, n: int) -> float:
    """Return the probability that the kurtosis of n independent normal numbers exceeds a value.

    Parameters
    ----------
    kurtosis : float
        Their fourth central moment by the square of the second: some 3.
    n : int
        20 or more.

    Examples
    --------
    >>> round(kurtosis_tail(4.0, 100), 6)
    0.028166
    """
    mean = 3 * (n - 1) / (n + 1)
    variance = 24 * n * (n - 2) * (n - 3) / ((n + 1) ** 2 * (n + 3) * (n + 5))
    skewness = (
        6
        * (n**2 - 5 * n + 2)
        / ((n + 7) * (n + 9))
        * math.sqrt(6 * (n + 3) * (n + 5) / (n * (n - 2) * (n - 3)))
    )
    a = 6 + 8 / skewness * (2 / skewness + math.sqrt(1 + 4 / skewness**2))
    standard = (kurtosis - mean) / math.sqrt(variance)
    root = 1 + standard * math.sqrt(2 / (a - 4))
    if root <= 0:  # so small a kurtosis that the approximation's distribution has no such value
        return 1.0
    z = (1 - 2 / (9 * a) - math.cbrt((1 - 2 / a) / root)) / math.sqrt(2 / (9 * a))
    return math.erfc(z / math.sqrt(2)) / 2
