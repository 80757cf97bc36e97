"""Residuals of pairs against an axis, d = ρ′ - p - R(e, χ)(ρ - p), and their derivatives by e and p.

With noise of covariance σ² I on both ρ and ρ′, d has covariance 2σ² I whatever the rotation, and half of
Σ |d|²/(2σ²) is the negative log-likelihood of e and p once the true ρ are eliminated. The kernel is derived,
proved and generated in ``derivation/axis.py``; it forms ρ′ - ρ and (R - I)(ρ - p) apart, which keeps the
smallest angles exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rodgen.array_types import Array
from rodgen.kinematics.backend import kernels

# Pairs at a time: the derivatives, eighteen numbers a pair, stay in the cache.
_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class Line:
    """An axis and a point on it, scaled lengths; with batch axes, many of them."""

    axis: Array
    point: Array

    def nearest(self, to: Array) -> Line:
        """Return the same line with its point nearest to `to`."""
        return Line(self.axis, self.point + self.axis * (self.axis @ (to - self.point)))


def residual_and_jacobian(
    rho: Array, rho_prime: Array, angle: Array, axis: Array, point: Array
) -> tuple[Array, Array]:
    """Return the residuals (N, 3) of pairs against one axis, and their derivatives (N, 3, 6) by axis and point.

    Of the derivatives by the axis only those perpendicular to it mean anything.
    """
    d, jacobian = kernels.axis_residual(rho, rho_prime, angle, axis, point)
    return d, jacobian


def residual(rho: Array, rho_prime: Array, angle: Array, axis: Array, point: Array) -> Array:
    """Return the residuals (N, 3) alone; arguments as :func:`residual_and_jacobian`."""
    d = np.empty_like(rho)
    for first in range(0, len(d), _BLOCK):
        block = slice(first, first + _BLOCK)
        d[block] = residual_and_jacobian(rho[block], rho_prime[block], angle[block], axis, point)[0]
    return d


def residual_gradient(
    rho: Array, rho_prime: Array, angle: Array, weight: Array, axis: Array, point: Array
) -> tuple[Array, Array]:
    """Return the derivatives of ½ Σ w |d|² by axis (3,) and point (3,); arguments as :func:`residual_and_jacobian`."""
    gradient = np.zeros(6)
    for first in range(0, len(rho), _BLOCK):
        block = slice(first, first + _BLOCK)
        d, jacobian = residual_and_jacobian(rho[block], rho_prime[block], angle[block], axis, point)
        gradient += (weight[block, None] * d).ravel() @ jacobian.reshape(-1, 6)
    return gradient[:3], gradient[3:]
