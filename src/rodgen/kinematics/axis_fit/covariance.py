"""The covariance of the axis and its point.

With H the second derivatives of ½ Σ w |d|² by axis and point, and v the variance of a coordinate at weight 1,
the score's variance is H/(2v) plus, in the direction's block, Σ (1 - cos χ) I: the noise of ρ, turned by
the error of the axis, meets the noise of ρ′. Hence

    cov = 2v H⁻¹ + 4v² H⁻¹ (Σ (1 - cos χ) I) H⁻¹.

The second term matters only where the points lie within some σ of the axis; without it pairs of pure noise
would claim an axis (proved in ``derivation/axis_fit.py``). H holds products ρ ρ′ᵀ of two independent
readings and so is free of the bias that the Gauss-Newton matrix, with ρ ρᵀ, has there. A robust loss
changes H by its mean slope and the score's variance by its mean square, as usual for M-estimates (P. J.
Huber, Robust Statistics, 1981, section 7.6).
"""

from __future__ import annotations

import math

import numpy as np

from rodgen.array_types import Array
from rodgen.data.spool import blocks
from rodgen.kinematics.axis_fit.noise import Noise
from rodgen.kinematics.axis_fit.pairs import Pairs
from rodgen.kinematics.axis_fit.residual import Line
from rodgen.kinematics.axis_fit.robust import Loss


def information_of(pairs: Pairs, noise: Noise, loss: Loss, line: Line, basis: Array) -> tuple[Array, float]:
    """Return the information H on axis and point along the basis, and the factor of the score's variance on it.

    Of a robust loss every good pair gets the mean slope and the mean square of all pairs: pair by pair
    they would follow the noise of a small sample, and claim too much.
    """
    if loss.name == "linear":
        return pairs.moments().hessian(line.axis, line.point, basis), 1.0
    good = noise.good
    # Over the three directions: ψ′ along the residual, ψ/z across it; and E[ψ²] a direction.
    slope = square = 0.0
    for rows in blocks(noise.squares):
        z = np.sqrt(noise.squares[rows][noise.used[rows]] / noise.unit)
        weight = loss.weight(z)
        slope += float(((loss.slope(z) + 2 * weight) / 3).sum()) / int(good.sum())
        square += float(((weight * z) ** 2 / 3).sum()) / int(good.sum())
    H = pairs.weighted(good).moments().hessian(line.axis, line.point, basis)
    # The fit has made the residuals smaller than the errors by its own degrees of freedom.
    count = 3 * int(noise.used.sum())
    return slope * H, square / slope * count / max(count - len(H), 1)


def parameter_covariance(information: Array, score: float, variance: float, versines: float) -> Array:
    """Return the covariance (4, 4) or (2, 2) of axis and point along the basis, by the formula above.

    `information` and `score` are those of :func:`information_of`, `versines` is Σ (1 - cos χ) of the pairs that count.
    """
    inverse = np.linalg.inv(information)
    noise = np.zeros_like(information)
    noise[:2, :2] = versines * np.eye(2)
    covariance = inverse @ (2 * variance * score * information + 4 * variance**2 * noise) @ inverse
    return (covariance + covariance.T) / 2


def joint_covariance(covariance: Array, line: Line, centroid: Array, basis: Array, scale: float) -> Array:
    """Return the covariance (6, 6) of the axis and of its point nearest to the centroid, lengths times `scale`."""
    size = len(covariance)
    jacobian = np.zeros((6, size))
    jacobian[:3, :2] = basis
    if size == 4:
        # The foot of the perpendicular slides along the axis as the axis turns.
        jacobian[3:, :2] = -np.outer(line.axis, (line.point - centroid) @ basis)
        jacobian[3:, 2:] = basis
    units = np.array([1.0, 1.0, 1.0, scale, scale, scale])
    with np.errstate(over="ignore"):  # a length beyond 1e154 has no square; its covariance is infinite
        whole: Array = (jacobian @ covariance @ jacobian.T) * units * units[:, None]
    if size == 2:
        whole[3:], whole[:, 3:] = 0.0, 0.0
    return whole


def condition_number(information: Array, arm: float) -> float:
    """Return the ratio of the extreme uncertainties of direction times arm, and point."""
    units = np.ones(len(information))
    units[:2] = 1 / arm
    values = np.linalg.eigvalsh(information * np.outer(units, units))
    return math.sqrt(values[-1] / values[0]) if values[0] > 0 else math.inf
