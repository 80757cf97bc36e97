"""Significant digits by uncertainty, after the Guide to the Expression of Uncertainty in Measurement (GUM), 7.2.6."""

from __future__ import annotations

import math

import numpy as np

from rodgen.array_types import Array

MANY = 1000
"""Values whose digits are counted."""


def last_decimal(size: Array | float, digits: int) -> Array:
    """Return the decimal of the last of the significant digits of numbers above 0; below 0 it is one of tens.

    Examples
    --------
    >>> last_decimal([0.231, 0.0997, 352.1], 2).tolist()  # 0.23, 0.10, 350
    [2.0, 2.0, -1.0]
    """
    size = np.asarray(size, float)
    first = np.floor(np.log10(size))
    first = first + (np.round(size / 10.0 ** (first - digits + 1)) >= 10**digits)
    return np.asarray(np.clip(digits - 1 - first, -300, 300))


def resolution(values: Array) -> float:
    """Return the power of ten of which all values are multiples; 0 where they have more than ten digits.

    Examples
    --------
    >>> resolution([0.5, 12.25, -3.0]), resolution([1 / 3])
    (0.01, 0.0)
    """
    values = np.asarray(values, float).ravel()[:MANY]
    values = values[np.isfinite(values)]
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0.0:
        return 0.0
    first = math.floor(math.log10(largest))
    for decimals in range(-first, 10 - first):
        scaled = values * 10.0**decimals
        if np.all(np.abs(scaled - np.round(scaled)) <= 1e-15 * 10.0 ** (decimals + first + 1)):
            return 10.0**-decimals
    return 0.0


def round_by(values: Array, u: Array) -> Array:
    """Return values rounded to the decimal of the second significant digit of their uncertainties.

    Values whose uncertainty is 0 or not known stay as they are.

    Examples
    --------
    >>> import numpy as np
    >>> round_by(np.array([12.34567, 1234.5, 0.5]), np.array([0.0123, 99.7, np.nan])).tolist()
    [12.346, 1230.0, 0.5]
    """
    known = np.isfinite(u) & (u > 0)
    decimals = last_decimal(np.where(known, u, 1.0), 2)
    up, down = 10.0 ** np.maximum(decimals, 0), 10.0 ** np.maximum(-decimals, 0)
    rounded = np.round(values * up / down) / up * down
    return np.asarray(np.where(known & np.isfinite(rounded), rounded, values))


def measured(value: float, u: float | None) -> tuple[str, str]:
    """Return a value and its uncertainty as texts: two digits of the uncertainty, and the value as far.

    Examples
    --------
    >>> measured(12.0561, 0.2312), measured(1.23456e-5, 2.5e-7), measured(3.0, None), measured(-0.004, 35.2)
    (('12.06', '0.23'), ('1.235e-05', '2.5e-07'), ('3', '–'), ('0', '35'))
    >>> measured(12.3456, 0.0997), measured(12345.6, 352.1)
    (('12.35', '0.10'), ('12350', '350'))
    """
    if u is None or not math.isfinite(u) or u <= 0:
        return f"{value:.6g}", "–"
    decimals = int(last_decimal(u, 2))
    value, u = (float(x) + 0.0 for x in round_by(np.array([value, u]), np.array(u)))
    largest = max(abs(value), u)
    if largest < 1e-4 or largest >= 1e7:
        digits = max(2, decimals - int(last_decimal(largest, 1)) + 1)
        return f"{value:.{min(digits, 12) - 1}e}", f"{u:.1e}"
    return f"{value:.{max(decimals, 0)}f}", f"{u:.{max(decimals, 0)}f}"
