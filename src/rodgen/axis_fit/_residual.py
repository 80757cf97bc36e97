"""Problem: by how much a pair misses an axis, d = ρ′ - p - R(e, χ)(ρ - p), and how that changes with e and p.

With noise of covariance σ² I on both ρ and ρ′, d has covariance 2σ² I whatever the rotation, and half of
Σ |d|²/(2σ²) is the negative log-likelihood of e and p once the true ρ are eliminated. Source: Rodrigues'
formula, Stebulyanin and Pimushkin, eq. (1), read with a point p on the axis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["_residual", "_residual_and_jacobian"]

Floats = NDArray[np.float64]


def _residual(rho: Floats, rho_prime: Floats, angle: Floats, axis: Floats, point: Floats) -> Floats:
    """Residual (…, 3) alone; as :func:`_residual_and_jacobian`."""
    # R - I is formed without the 1 of R, and 1 - cos χ without cos χ: exact for the smallest angles.
    sine, versine = np.sin(angle)[..., None], 2 * np.sin(angle / 2)[..., None] ** 2
    arm = rho - point
    along = _dot(arm, axis)[..., None]
    return rho_prime - rho - (sine * _cross(axis, arm) + versine * (along * axis - arm))


def _residual_and_jacobian(
    rho: Floats, rho_prime: Floats, angle: Floats, axis: Floats, point: Floats
) -> tuple[Floats, Floats, Floats]:
    """Residual of pairs against one axis, and its derivatives.

    Parameters
    ----------
    rho, rho_prime : (…, 3) arrays
        Points before and after, one length unit.
    angle : (…) array
        Angles in rad.
    axis : (3,) array
        Unit axis.
    point : (3,) array
        Point on the axis.

    Returns
    -------
    residual : (…, 3) array
    by_axis : (…, 3, 3) array
        ∂residual_i/∂axis_j; only directions perpendicular to the axis mean anything.
    by_point : (…, 3, 3) array
        ∂residual_i/∂point_j = R - I.
    """
    sine, versine = np.sin(angle)[..., None, None], 2 * np.sin(angle / 2)[..., None, None] ** 2
    arm = rho - point
    along = _dot(arm, axis)[..., None, None]
    identity = np.eye(3)
    by_axis = sine * _skew(arm) - versine * (along * identity + axis[:, None] * arm[..., None, :])
    by_point = sine * _skew(axis) + versine * (np.outer(axis, axis) - identity)
    return _residual(rho, rho_prime, angle, axis, point), by_axis, by_point


def _dot(a: Floats, b: Floats) -> Floats:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross product; numpy.cross takes several times as long on (N, 3)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out


def _skew(a: Floats) -> Floats:
    """(…, 3, 3) matrix with _skew(a) @ b = a × b."""
    out = np.zeros((*a.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., k, j] = a[..., i]
        out[..., j, k] = -a[..., i]
    return out
