"""From rough angles to solutions of a pair of equations that are proved to be there, each once.

Problem: the equations are f_e(θ1, θ2) = Σ M_e,ij u_i v_j = 0 with u = (1, cos θ1, sin θ1) and v = (1, cos θ2, sin θ2).
Newton's method brings a start to a point where both are rounding. What that is says Kantorovich's theorem: with S_e the
sum of all |M_e,ij|, κ the larger component of |J⁻¹| S and η that of J⁻¹ f, there is exactly one solution within 1/(4κ)
of the point where 8 κ η <= 1, because every second derivative of f_e is less than S_e. Two points nearer than that are
the same solution, and two solutions that are not told apart so, since κ is large, meet to rounding.

There is an independent test. The two equations map the torus of all angle pairs to a plane; that has no boundary, so
each value that no singular point has is taken as often with one sign of det J as with the other, zero included.
"""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["apart", "basis", "newton", "quality", "wrapped"]

EPS = float(np.finfo(float).eps)
ROUNDING = 16 * EPS
"""Of an equation, over the sum of the magnitudes of its coefficients: some ten roundings in a product of three factors,
and a rounding of each angle."""
STEPS = 60
"""A regular solution takes four to eight; where two meet the distance only halves, and 27 halvings bring a rough start
to where rounding hides the rest."""
LARGEST_STEP = 0.5


def basis(theta: Any) -> Any:
    """Return (1, cos, sin) along a new last axis."""
    return np.stack([np.ones_like(theta), np.cos(theta), np.sin(theta)], axis=-1)


def wrapped(theta: Any) -> Any:
    """Bring angles that are less than a turn beyond (-π, π] into it."""
    theta = np.where(theta > np.pi, theta - 2 * np.pi, theta)
    return np.where(theta <= -np.pi, theta + 2 * np.pi, theta)


def apart(one: Any, other: Any) -> Any:
    """Return the larger of the two differences of angle pairs (..., 2)."""
    return np.abs(np.remainder(one - other + np.pi, 2 * np.pi) - np.pi).max(axis=-1)


def equations(M: Any, angles: Any) -> tuple[Any, Any]:
    """Values (n, 2) and derivatives (n, 2, 2) at angles (n, 2), for M (n, 2, 3, 3)."""
    u, v = basis(angles[:, 0]), basis(angles[:, 1])
    row = np.einsum("neij,ni->nej", M, u)
    column = np.einsum("neij,nj->nei", M, v)
    value = (row * v[:, None]).sum(axis=-1)
    by_first = column[..., 2] * u[:, None, 1] - column[..., 1] * u[:, None, 2]
    by_second = row[..., 2] * v[:, None, 1] - row[..., 1] * v[:, None, 2]
    return value, np.stack([by_first, by_second], axis=-1)


def newton(M: Any, angles: Any) -> Any:
    """Bring angles (n, 2) to where the equations are least; M (n, 2, 3, 3) with equations of size 1."""
    angles = angles.copy()
    best = np.full(len(angles), np.inf)
    active = np.flatnonzero(np.isfinite(angles).all(axis=-1))
    now = angles[active]
    for _ in range(STEPS):
        if not len(active):
            break
        value, J = equations(M[active], now)
        size = np.abs(value).max(axis=-1)
        better = size < best[active]
        angles[active[better]], best[active[better]] = now[better], size[better]
        # least squares with a trace of damping, so that a singular derivative gives a finite step
        normal = np.einsum("nki,nkj->nij", J, J)
        trace = normal[:, 0, 0] + normal[:, 1, 1]
        damped = normal + (64 * EPS**2 * trace + 1e-300)[:, None, None] * np.eye(2)
        right = np.einsum("nki,nk->ni", J, value)
        det = damped[:, 0, 0] * damped[:, 1, 1] - damped[:, 0, 1] ** 2
        direct = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
        regular = np.abs(direct) > 1e-6 * trace
        with np.errstate(all="ignore"):
            plain = np.stack([
                J[:, 1, 1] * value[:, 0] - J[:, 0, 1] * value[:, 1],
                J[:, 0, 0] * value[:, 1] - J[:, 1, 0] * value[:, 0],
            ], axis=-1) / direct[:, None]  # fmt: skip
            fitted = np.stack([
                damped[:, 1, 1] * right[:, 0] - damped[:, 0, 1] * right[:, 1],
                damped[:, 0, 0] * right[:, 1] - damped[:, 0, 1] * right[:, 0],
            ], axis=-1) / det[:, None]  # fmt: skip
            step = np.where(regular[:, None], plain, fitted)
            step = np.where(np.isfinite(step), step, 0.0)
            length = np.abs(step).max(axis=-1)
            step = step * np.where(length > LARGEST_STEP, LARGEST_STEP / length, 1.0)[:, None]
        going = (length > EPS) & (better | (length > 1e-7))
        now = (now - step)[going]
        active = active[going]
    return np.where(np.isfinite(best)[:, None], wrapped(np.remainder(angles, 2 * np.pi)), np.nan)


def quality(M: Any, angles: Any) -> tuple[Any, Any, Any]:
    """Tell of angles (n, 2): residual over size, condition number κ, and the sign of the determinant."""
    value, J = equations(M, angles)
    size = np.abs(M).sum(axis=(-2, -1))
    det = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
    with np.errstate(all="ignore"):
        first = np.abs(J[:, 1, 1]) * size[:, 0] + np.abs(J[:, 0, 1]) * size[:, 1]
        second = np.abs(J[:, 1, 0]) * size[:, 0] + np.abs(J[:, 0, 0]) * size[:, 1]
        condition = np.maximum(first, second) / np.abs(det)
        residual = (np.abs(value) / size).max(axis=-1)
    return residual, np.where(det == 0, np.inf, condition), np.sign(det)
