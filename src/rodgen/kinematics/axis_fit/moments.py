"""The sums over all pairs on which the likelihood of an axis depends, and the axis that maximises it.

With r = ρ′ - ρ, m = ρ′ + ρ, weights w, κ = 1 - cos χ and s = sin χ, R(e, χ) is quadratic in e, and

    ½ Σ w |ρ′ - p - R(ρ - p)|² = constant - (eᵀ A e + b·e)      for a given point p, taken as the origin,
    A = Σ w κ sym(ρ ρ′ᵀ),   b = Σ w s ρ × ρ′ = Σ w s ρ × r.

A free point drops out in closed form. (I - R)ᵀ(I - R) = 2κ (I - e eᵀ), so that for any e the best point is

    p = (M - e (e·M) + e × S)/D + any multiple of e,   M = Σ w κ m,  S = Σ w s r,  D = 2 Σ w κ,

and putting it back leaves a quadratic in e again:

    A′ = A - (M Mᵀ + S Sᵀ)/(2D),    b′ = b + (S × M)/D.

So the maximum-likelihood axis is the maximum of a quadratic on the sphere in both cases, with nothing to
iterate and no local minimum to fall into; ``derivation/axis_fit.py`` proves it.
The sums are taken about the centre that makes M vanish: then A′ and b′ do not suffer from points far from
the origin.

The maximum of eᵀA e + b·e on the sphere, for symmetric 3×3 A: stationary unit vectors obey 2 A e + b = 2 μ e. With the
eigenvalues λ₁ ≥ λ₂ ≥ λ₃ of A and the components γ = b/2 in its eigenbasis,

    e_k = γ_k / (μ - λ_k),        φ(μ) = Σ γ_k² / (μ - λ_k)² = 1   (the secular equation).

The global maximum is the root μ ≥ λ₁. At most one other local maximum exists; it is the root in
(λ₂, λ₁) nearest λ₁, where φ rises towards λ₁ (J. M. Martínez, SIAM J. Optim. 4 (1994) 159-176). The
hard case, γ₁ = 0 with φ(λ₁) < 1, has two equal maxima: the first component has the size that makes e a
unit vector, and either sign.

Degenerate: A a multiple of the identity and b = 0, every unit vector is a maximum; λ₁ = λ₂ and
γ₁ = γ₂ = 0 in the hard case, a circle of them. One representative comes back; that it is not isolated
is seen in the Hessian 2 (μ I - A), not here.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rodgen.array_types import Array


def dot(a: Array, b: Array) -> Array:
    """Return scalar products (…)."""
    product: Array = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return product


def cross(a: Array, b: Array) -> Array:
    """Return cross products; numpy.cross takes several times as long on (N, 3)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out


def skew(a: Array) -> Array:
    """Return the matrices (…, 3, 3) with skew(a) @ b = a × b."""
    out = np.zeros((*a.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., k, j] = a[..., i]
        out[..., j, k] = -a[..., i]
    return out


def shown(vector: Array) -> str:
    """Return a unit vector as a message shows it, with 0 for rounding."""
    return "(" + ", ".join(f"{c:z.4g}" if abs(c) > 1e-12 else "0" for c in vector) + ")"


# Both iterations converge quadratically after a few steps; the bound only ends them for certain.
_MOST_STEPS = 80


class Maxima(NamedTuple):
    """The maxima of a batch of quadratics on the sphere."""

    best: Array
    """(…, 3) the global maximum."""
    other: Array
    """(…, 3) the other local maximum; NaN where there is none."""


def maximise_on_sphere(A: Array, b: Array) -> Maxima:
    """Return every local maximum of eᵀA e + b·e on the unit sphere, for symmetric A (…, 3, 3) and b (…, 3).

    In the hard case the two are equally good, and `best` is the one along the eigenvector as LAPACK signs it.
    """
    gap, gamma, vectors = _in_eigenbasis(A, b)
    best, other = _global_root(gap, gamma), _local_root(gap, gamma)
    return Maxima((vectors @ best[..., None])[..., 0], (vectors @ other[..., None])[..., 0])


def global_maximum(A: Array, b: Array) -> Array:
    """Return `best` of :func:`maximise_on_sphere` alone, in half the time."""
    gap, gamma, vectors = _in_eigenbasis(A, b)
    best: Array = (vectors @ _global_root(gap, gamma)[..., None])[..., 0]
    return best


def _in_eigenbasis(A: Array, b: Array) -> tuple[Array, Array, Array]:
    """Return λ₁ - λ_k and γ_k, scaled alike, and the eigenvectors; the largest eigenvalue first."""
    eigenvalues, vectors = np.linalg.eigh(A)
    vectors = vectors[..., ::-1]
    gap = eigenvalues[..., -1:] - eigenvalues[..., ::-1]
    gamma = (vectors.mT @ b[..., None])[..., 0] / 2
    scale = np.maximum(gap[..., 2], np.abs(gamma).max(axis=-1))
    scale = np.where(scale > 0, scale, 1.0)[..., None]
    return gap / scale, gamma / scale, vectors


def _quotient(a: Array, b: Array) -> Array:
    """Return a / b; 0 where b is 0: there a is 0 too, or the caller replaces the value."""
    good = b != 0
    if good.all():
        return a / b
    return np.divide(a, b, out=np.zeros(np.broadcast_shapes(a.shape, b.shape)), where=good)


def _unit_with_first(first_sign: Array, t: Array, components: Array) -> Array:
    """Return unit vectors; in the hard case (t = 0) the first component makes up the length."""
    rest = (components[..., 1:] ** 2).sum(axis=-1)
    hard = np.sqrt(np.maximum(1 - rest, 0))
    first = np.where(t > 0, np.abs(components[..., 0]), hard) * first_sign
    e = np.concatenate([first[..., None], components[..., 1:]], axis=-1)
    length: Array = np.sqrt((e**2).sum(axis=-1, keepdims=True))
    unit: Array = e / length
    return unit


def _global_root(gap: Array, gamma: Array) -> Array:
    """Return the maximum for the root t = μ - λ₁ ≥ 0 of Σ (γ_k/(t + gap_k))² = 1."""
    size = np.abs(gamma)
    t = np.maximum((size - gap).max(axis=-1), 0)  # each term alone is at most 1
    for _ in range(_MOST_STEPS):
        shifted = t[..., None] + gap
        q = _quotient(gamma, shifted)
        phi = (q**2).sum(axis=-1)
        # Newton on 1/sqrt(φ) - 1, which is nearly straight and convex: from the left it never overshoots.
        step = _quotient(phi * (np.sqrt(phi) - 1), _quotient(q**2, shifted).sum(axis=-1))
        step = np.where(phi > 1, step, 0)
        t = t + step
        if np.all(step <= np.finfo(float).eps * t):
            break
    sign = np.where(gamma[..., 0] < 0, -1.0, 1.0)
    return _unit_with_first(sign, t, _quotient(gamma, t[..., None] + gap))


def _local_root(gap: Array, gamma: Array) -> Array:
    """Return the maximum for the root t = λ₁ - μ of γ₁²/t² + Σ_{k>1} γ_k²/(gap_k - t)² = 1, least in (0, gap₂)."""
    first = np.abs(gamma[..., 0])
    t = first.copy()
    alive = gap[..., 1] > t
    for _ in range(_MOST_STEPS):
        room = np.where(alive[..., None], gap[..., 1:] - t[..., None], 1.0)
        rest = _quotient(gamma[..., 1:], room) ** 2
        total = rest.sum(axis=-1)
        alive &= total < 1
        # Two lower bounds of the root, both exact there: rest frozen, and Newton on the convex φ.
        frozen = _quotient(first, np.sqrt(np.where(alive, 1 - total, 1.0)))
        head = _quotient(first, t) ** 2
        slope = 2 * (_quotient(rest, room).sum(axis=-1) - _quotient(head, t))
        newton = t - _quotient(head + total - 1, slope)
        better = np.maximum(frozen, np.where((slope < 0) & (t > 0), newton, 0))
        better = np.where(alive, np.maximum(better, t), t)
        alive &= better < gap[..., 1]
        if np.all((better - t <= np.finfo(float).eps * t) | ~alive):
            break
        t = np.where(alive, better, t)
    sign = np.where(gamma[..., 0] < 0, 1.0, -1.0)  # the far side of the equator
    room = np.where(alive[..., None], gap[..., 1:] - t[..., None], 1.0)
    components = np.concatenate([_quotient(first, t)[..., None], _quotient(gamma[..., 1:], room)], axis=-1)
    return np.where(
        alive[..., None], _unit_with_first(sign, t, np.where(alive[..., None], components, 1.0)), np.nan
    )


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
