"""Numeric helpers of several mechanisms: angles less whole turns, singular values, polynomials of many rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def principal(angles: Any) -> Any:
    """Return angles in (-π, π]; those that are there already come back as they are, to the last bit."""
    within = angles - 2 * np.pi * np.round(np.asarray(angles) / (2 * np.pi))
    return np.where(within <= -np.pi, np.pi, within)


def apart(one: Any, second: Any) -> Any:
    """Return the largest difference (...) of sets of angles (..., n), whole turns not counted."""
    return np.abs(principal(one - second)).max(axis=-1)


def angle_between(x: Any, y: Any, u: Any, v: Any) -> Any:
    """Return the angle from the direction (x, y) to (u, v)."""
    return np.arctan2(x * v - y * u, x * u + y * v)


def gains_and_condition(jacobian: Any) -> tuple[Any, Any]:
    """Return singular values (..., 3), largest first, and the condition (...) of square matrices (..., 3, 3).

    The condition is infinite where the smallest gain is zero; both are NaN where the matrix is not finite.
    """
    good = np.isfinite(jacobian).all(axis=(-2, -1))
    gains = np.linalg.svd(np.where(good[..., None, None], jacobian, 0.0), compute_uv=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = np.where(gains[..., 2] > 0, gains[..., 0] / gains[..., 2], np.inf)
    return np.where(good[..., None], gains, np.nan), np.where(good, condition, np.nan)


class Polynomials:
    """Polynomials of n rows (or one for all rows), coefficients along the last axis, the constant first."""

    def __init__(self, values: NDArray[Any]) -> None:
        self.values = values

    def __add__(self, other: Any) -> Polynomials:
        a, b = self.values, other.values if isinstance(other, Polynomials) else np.full((1, 1), other)
        size = max(a.shape[1], b.shape[1])
        a, b = (np.pad(x, ((0, 0), (0, size - x.shape[1]))) for x in (a, b))
        return Polynomials(a + b)

    __radd__ = __add__

    def __sub__(self, other: Polynomials) -> Polynomials:
        return self + other * -1.0

    def __mul__(self, other: Any) -> Polynomials:
        if not isinstance(other, Polynomials):
            return Polynomials(self.values * other)
        a, b = self.values, other.values
        product = np.zeros((max(len(a), len(b)), a.shape[1] + b.shape[1] - 1), np.result_type(a, b))
        for power in range(a.shape[1]):
            product[:, power : power + b.shape[1]] += a[:, power, None] * b
        return Polynomials(product)

    __rmul__ = __mul__


def roots(coefficients: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return all complex roots (n, m) of polynomials (n, m + 1), the constant first.

    They are eigenvalues of companion matrices; a row whose leading coefficient is zero, or with one that is not finite,
    has NaN.
    """
    degree = coefficients.shape[-1] - 1
    with np.errstate(all="ignore"):
        last = -coefficients[:, :-1] / coefficients[:, -1:]
    good: Any = np.isfinite(last).all(axis=-1)
    companion = np.zeros((len(coefficients), degree, degree))
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    companion[:, :, -1] = np.where(good[:, None], last, 0.0)
    eigenvalues = np.linalg.eigvals(companion) if len(companion) else np.zeros((0, degree))
    return np.where(good[:, None], eigenvalues, np.nan + 0j)
