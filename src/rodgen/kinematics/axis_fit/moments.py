"""The sums over all pairs on which the likelihood of an axis depends.

With r = ρ′ - ρ, m = ρ′ + ρ, weights w, κ = 1 - cos χ and s = sin χ, R(e, χ) is quadratic in e, and

    ½ Σ w |ρ′ - p - R(ρ - p)|² = constant - (eᵀ A e + b·e)      for a given point p, taken as the origin,
    A = Σ w κ sym(ρ ρ′ᵀ),   b = Σ w s ρ × ρ′ = Σ w s ρ × r.

A free point drops out in closed form. (I - R)ᵀ(I - R) = 2κ (I - e eᵀ), so that for any e the best point is

    p = (M - e (e·M) + e × S)/D + any multiple of e,   M = Σ w κ m,  S = Σ w s r,  D = 2 Σ w κ,

and putting it back leaves a quadratic in e again:

    A′ = A - (M Mᵀ + S Sᵀ)/(2D),    b′ = b + (S × M)/D.

So the maximum-likelihood axis is the maximum of a quadratic on the sphere in both cases, with nothing to
iterate and no local minimum to fall into (:mod:`.sphere`); ``derivation/axis_fit.py`` proves it.
The sums are taken about the centre that makes M vanish: then A′ and b′ do not suffer from points far from
the origin.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from rodgen.array_types import Array
from rodgen.kinematics.axis_fit.vectors import cross, dot, skew


@dataclass(frozen=True, eq=False)
class Moments:
    """Sums over weighted pairs; every field may have leading batch axes."""

    A: Array
    b: Array
    """The quadratic for the point `centre`, (…, 3, 3) and (…, 3)."""
    M: Array
    S: Array
    """Shape (…, 3)."""
    D: Array
    """As in the module's docstring, about `centre`, (…)."""
    centre: Array
    """The known point, or the mean of the points weighted by w κ, (…, 3)."""
    free: bool
    """Whether the point is to be found."""

    @classmethod
    def of(cls, rho: Array, rho_prime: Array, angle: Array, weight: Array, point: Array | None) -> Moments:
        """Return the sums over the second last axis of points (…, N, 3); `point` is None where it is free."""
        by_versine = 2 * weight * np.sin(angle / 2) ** 2
        by_sine = weight * np.sin(angle)
        D = 2 * by_versine.sum(axis=-1)
        if point is None:
            safe = np.where(D > 0, D, 1.0)[..., None]
            centre = (by_versine[..., None, :] @ rho)[..., 0, :] + (by_versine[..., None, :] @ rho_prime)[
                ..., 0, :
            ]
            centre = centre / safe
        else:
            centre = np.broadcast_to(point, (*D.shape, 3))
        x = rho - centre[..., None, :]
        y = rho_prime - centre[..., None, :]
        r = rho_prime - rho
        product = (x * by_versine[..., None]).mT @ y
        turn = (x * by_sine[..., None]).mT @ r
        return cls(
            A=(product + product.mT) / 2,
            b=_axial(turn),
            M=(by_versine[..., None, :] @ (x + y))[..., 0, :],
            S=(by_sine[..., None, :] @ r)[..., 0, :],
            D=D,
            centre=centre,
            free=point is None,
        )

    @staticmethod
    def total(parts: Iterable[Moments]) -> Moments:
        """Return the sums over all parts of the pairs, each about the same centre."""
        first, *others = parts
        for part in others:
            sums = {name: getattr(first, name) + getattr(part, name) for name in ("A", "b", "M", "S", "D")}
            first = replace(first, **sums)
        return first

    def quadratic(self) -> tuple[Array, Array]:
        """Return A and b of the quadratic in the axis, with a free point eliminated."""
        if not self.free:
            return self.A, self.b
        D = np.where(self.D > 0, self.D, 1.0)[..., None]
        lost = self.M[..., :, None] * self.M[..., None, :] + self.S[..., :, None] * self.S[..., None, :]
        return self.A - lost / (2 * D[..., None]), self.b + cross(self.S, self.M) / D

    def point(self, axis: Array) -> Array:
        """Return the point on the axis: the known one, or the best one in the plane through `centre`."""
        if not self.free:
            return self.centre
        D = np.where(self.D > 0, self.D, 1.0)[..., None]
        across = self.M - axis * dot(axis, self.M)[..., None]
        return self.centre + (across + cross(axis, self.S)) / D

    def hessian(self, axis: Array, point: Array, basis: Array) -> Array:
        """Return the second derivatives (4, 4), or (2, 2) for a known point, of ½ Σ w |d|² by axis and point.

        They are along `basis` (3, 2), perpendicular to the axis, at a stationary axis and its point. This is not the
        Gauss-Newton matrix: products ρ ρ′ᵀ are free of the noise bias that ρ ρᵀ has.
        """
        q = point - self.centre
        A = self.A - (np.outer(q, self.M) + np.outer(self.M, q)) / 2 + self.D / 2 * np.outer(q, q)
        b = self.b - cross(q, self.S)
        M = self.M - self.D * q
        multiplier = axis @ (A @ axis + b / 2)
        by_axis = 2 * (multiplier * np.eye(2) - basis.T @ A @ basis)
        if not self.free:
            return by_axis
        mixed = (axis @ M) * np.eye(2) + basis.T @ skew(self.S) @ basis
        return np.block([[by_axis, mixed.T], [mixed, self.D * np.eye(2)]])


def tangents(axis: Array) -> Array:
    """Return two unit vectors (3, 2) that make a right-handed basis (u, v, axis)."""
    start = np.eye(3)[np.argmin(np.abs(axis))]
    u = cross(axis, start)
    u = u / np.sqrt(u @ u)
    return np.stack([u, cross(axis, u)], axis=1)


def _axial(T: Array) -> Array:
    """Return Σ x × r from T = Σ x rᵀ."""
    return np.stack(
        [T[..., 1, 2] - T[..., 2, 1], T[..., 2, 0] - T[..., 0, 2], T[..., 0, 1] - T[..., 1, 0]], axis=-1
    )
