"""The pairs of a fit: their sums, residuals and slides, and the axis that maximises their likelihood.

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

Pairs are checked and brought to moderate size about a common origin. The residual of a pair against an axis is d = ρ′ -
p - R(e, χ)(ρ - p). With noise of covariance σ² I on both ρ and ρ′, d has covariance 2σ² I whatever the rotation, and
half of Σ |d|²/(2σ²) is the negative log-likelihood of e and p once the true ρ are eliminated. The kernel is derived,
proved and generated in ``derivation/axis.py``; it forms ρ′ - ρ and (R - I)(ρ - p) apart, which keeps the smallest
angles exact.

Pairs may share a slide along the axis, and readings. A slide is that of a screw, an axial run-out, or a body that is
pushed while it turns. A slide of s a pair, or of s for each radian, makes the residual d - a s e, with a = 1 or the
angle. It is one more parameter of the fit: where chance explains it, its estimate is reported and none is taken;
otherwise it is fitted with the axis. Both are least squares of the same likelihood.

A reading may be in several pairs, such as one rest pose against which all others are paired; its errors are in
several residuals. With A_i the derivative of the score by the error of a reading in pair i, the score has the variance
v Σ_g (Σ_i A_i)ᵀ (Σ_i A_i), over readings g and the pairs i in which they stand, where independent readings have
v Σ_g Σ_i A_iᵀ A_i.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.backend import kernels


def cross(a: Array, b: Array) -> Array:
    """Return cross products; numpy.cross takes twenty times as long on single vectors."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
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
    best, second = _global_root(gap, gamma), _local_root(gap, gamma)
    return Maxima((vectors @ best[..., None])[..., 0], (vectors @ second[..., None])[..., 0])


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
        across: Array = self.M - axis * np.vecdot(axis, self.M)[..., None]
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
        mixed = (axis @ M) * np.eye(2) + basis.T @ cross(self.S, np.eye(3)).T @ basis
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


BLOCK = 1 << 16
"""Pairs that are looked at together, so that what is computed of them stays in the cache."""
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


_EPS = float(np.finfo(float).eps)
# A half angle's sine at which a turn is rounding of the angle itself, and far below that of the points.
ZERO_TURN = 4 * _EPS
# Sigma and the lengths are kept within this power of two of each other: a ratio that no data have.
_WIDEST = 400


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs in scaled lengths: true length = `origin` + `scale` · length here.

    Sums over many pairs go over them a block at a time.
    """

    rho: Array
    rho_prime: Array
    """Shape (N, 3)."""
    angle: Array
    """All zero where no pair turns by more than rounding, (N,)."""
    weight: Array
    """Relative inverse variances, at most 1; 0 for pairs that are left out, (N,)."""
    point: Array | None
    """The known point (then the origin), or None where it is free, (3,)."""
    variance: float | None
    """Variance of a coordinate of a reading of weight 1, where sigma was given."""
    sigma: float
    """Root mean square of the sigma given, in the user's unit; NaN where none was."""
    unit_weight: float
    """Weight here of a pair to which the user gave weight 1."""
    scale: float
    """A power of two."""
    origin: Array
    """In the user's unit, (3,)."""
    size: float
    """Largest coordinate before the origin was subtracted, scaled."""
    slid: bool = False
    """Whether a slide along the axis was fitted and taken off."""

    @property
    def rounding(self) -> float:
        """Rounding error of a coordinate."""
        return _EPS * max(self.size, 1.0)

    @property
    def parameters(self) -> int:
        """What is fitted: two angles of the axis, two coordinates of a free point, a slide; nothing without a turn."""
        if not self.angle[self.weight > 0].any():
            return 0
        return (4 if self.point is None else 2) + self.slid

    def only(self, rows: Any) -> Pairs:
        """Return some of the pairs; `rows` (S, k) makes sets of them, for :meth:`best_line`."""
        arrays = (self.rho, self.rho_prime, self.angle, self.weight)
        if isinstance(rows, np.ndarray) and rows.dtype == bool:
            if rows.all():
                return self
            rows = np.flatnonzero(rows)
        rho, rho_prime, angle, weight = (array[rows] for array in arrays)
        return replace(self, rho=rho, rho_prime=rho_prime, angle=angle, weight=weight)

    def blocks(self) -> Iterator[tuple[slice, Pairs]]:
        """Yield all pairs, block by block, each with its place."""
        if len(self.angle) <= BLOCK:
            yield slice(None), self
            return
        for rows in blocks(self.angle):
            yield rows, self.only(rows)

    def weighted(self, share: NDArray[Any]) -> Pairs:
        """Return the pairs with their weights multiplied by `share`."""
        return replace(self, weight=self.weight * share)

    def moments(self) -> Moments:
        """Return the sums on which the likelihood depends."""
        if self.angle.ndim > 1 or len(self.angle) <= BLOCK:
            return self._moments_about(self.point)
        centre = self.point
        if centre is None:
            rough = Moments.total(block._moments_about(np.zeros(3)) for _, block in self.blocks())
            centre = rough.M / rough.D if rough.D > 0 else rough.M
        sums = Moments.total(block._moments_about(centre) for _, block in self.blocks())
        return replace(sums, free=self.point is None)

    def _moments_about(self, centre: Array | None) -> Moments:
        return Moments.of(self.rho, self.rho_prime, self.angle, self.weight, centre)

    def best_line(self) -> Line:
        """Return the most likely line, of each set of pairs where these are sets."""
        moments = self.moments()
        axis = global_maximum(*moments.quadratic())
        return Line(axis, moments.point(axis))

    def residuals(self, line: Line) -> Array:
        """Return the residuals (N, 3)."""
        return residual(self.rho, self.rho_prime, self.angle, line.axis, line.point)

    def half_squares(self, line: Line) -> Array:
        """Return w |d|²/2 of every pair: three times the variance of unit weight, in the mean."""
        squares = np.empty(len(self.angle))
        for rows, block in self.blocks():
            d = block.residuals(line)
            squares[rows] = block.weight * (d[:, 0] ** 2 + d[:, 1] ** 2 + d[:, 2] ** 2) / 2
        return squares

    @classmethod
    def of(
        cls,
        rho: ArrayLike,
        rho_prime: ArrayLike,
        angle: ArrayLike,
        point: Any,
        sigma: ArrayLike | None,
        weights: ArrayLike | None,
    ) -> Pairs:
        """Check, broadcast, flatten, shift and scale."""
        x, y = real_array("rho", rho, (3,)), real_array("rho_prime", rho_prime, (3,))
        a = real_array("angle", angle)
        try:
            shape = np.broadcast_shapes(x.shape[:-1], y.shape[:-1], a.shape)
        except ValueError:
            raise RodgenError(
                f"rho {x.shape}, rho_prime {y.shape} and angle {a.shape} do not fit together; "
                "expected (N, 3), (N, 3) and (N,) or one angle for all"
            ) from None
        x = np.broadcast_to(x, (*shape, 3)).reshape(-1, 3)
        y = np.broadcast_to(y, (*shape, 3)).reshape(-1, 3)
        a = np.broadcast_to(a, shape).reshape(-1)
        if len(a) == 0:
            raise RodgenError("rho, rho_prime and angle hold no pairs; at least one is needed")
        for name, values in (("rho", x), ("rho_prime", y), ("angle", a)):
            demand_finite(name, values)
        if (np.abs(np.sin(a / 2)) <= ZERO_TURN).all():
            # No turn at all, rather than a turn about a point that noise puts at infinity.
            a = np.zeros(len(a))
        known = _known_point(point)

        ends = np.concatenate([_ends(x), _ends(y)])
        exponent = _exponent(np.abs(ends if known is None else np.concatenate([ends, known[None]])))
        # The median, not the mean: one gross error must not move the origin to where differences cancel.
        middle = (
            _median(x, exponent) / 2 + _median(y, exponent) / 2
            if known is None
            else np.ldexp(known, -exponent)
        )
        ends = np.ldexp(ends, -exponent)
        size = max(float(np.abs(ends).max()), float(np.abs(middle).max()))
        second = _exponent(np.abs(ends - middle))
        if sigma is not None:
            # Lengths that are negligible against sigma must not make its square overflow.
            second = max(second, _exponent(np.abs(real_array("sigma", sigma))) - exponent - _WIDEST)
        second = min(second, 1023 - exponent)  # so that the scale is a number
        x, y = (_scaled(values, exponent, middle, second) for values in (x, y))

        w, variance, unit, rms_sigma = _weights(sigma, weights, shape, exponent + second)
        return cls(
            rho=x,
            rho_prime=y,
            angle=np.ascontiguousarray(a),
            weight=w,
            point=None if known is None else np.zeros(3),
            variance=variance,
            sigma=rms_sigma,
            unit_weight=unit,
            scale=float(np.ldexp(1.0, exponent + second)),
            origin=np.ldexp(middle, exponent),
            size=float(np.ldexp(size, -second)),
        )


def blocks(array: Array) -> Iterator[slice]:
    """Yield slices that cover an array, (n, ...)."""
    for first in range(0, len(array), BLOCK):
        yield slice(first, first + BLOCK)


def demand_finite(name: str, values: Array) -> None:
    """Refuse rows, (n, ...), that have a number that is not finite; the sentence names the first."""
    good = np.isfinite(values)
    bad = np.flatnonzero(~(good.reshape(len(good), -1).all(axis=1)))
    if len(bad):
        row, more = int(bad[0]), len(bad) - 1
        others = f" ({more} more rows are like it)" if more else ""
        raise RodgenError(
            f"{name}, row {row} (counted from 0) is {_shown(values[row])}; expected finite numbers; "
            f"leave such rows out{others}"
        )


def _ends(points: Array) -> Array:
    """Return the least and the largest coordinates, (2, 3)."""
    return np.array([points.min(axis=0), points.max(axis=0)])


def _median(points: Array, exponent: int) -> Array:
    """Return the median of each coordinate, (3,), divided by a power of two."""
    columns = (np.ldexp(column, -exponent) for column in points.T)
    return np.array([np.median(column, overwrite_input=True) for column in columns])


def _scaled(points: Array, exponent: int, middle: Array, second: int) -> Array:
    # in rows, whatever the order of the array that was given: sums over it have the same digits
    return np.ascontiguousarray(np.ldexp(np.ldexp(points, -exponent) - middle, -second))


def _known_point(point: Any) -> Array | None:
    if isinstance(point, str):
        if point == "free":
            return None
        raise RodgenError(
            f"point is {point!r}; expected 'free' or the three coordinates of a point on the axis"
        )
    known = real_array("point", point)
    if known.shape != (3,):
        raise RodgenError(
            f"point has shape {known.shape}; expected 'free' or the three coordinates of a point on the axis"
        )
    if not np.isfinite(known).all():
        raise RodgenError(f"point is {_shown(known)}; expected finite coordinates")
    return known


def _weights(
    sigma: ArrayLike | None, weights: ArrayLike | None, shape: tuple[int, ...], exponent: int
) -> tuple[Array, float | None, float, float]:
    """Relative inverse variances (N,), variance at weight 1 if known, weight of a user's 1, rms sigma."""
    if weights is None and (sigma is None or np.ndim(sigma) == 0):
        # One weight for all, which needs no array of them.
        _, variance, unit, rms = _weights(sigma, np.ones(1), (1,), exponent)
        return np.broadcast_to(1.0, (math.prod(shape),)), variance, unit, rms
    stated = np.ones(shape) if weights is None else _broadcast("weights", weights, shape)
    if (stated < 0).any():
        row = int(np.argmax(stated.ravel() < 0))
        raise RodgenError(f"weights, row {row} (counted from 0) is negative; expected 0 or more")
    used = stated > 0
    if not used.any():
        raise RodgenError("all weights are zero; at least one pair must count")
    if sigma is None:
        largest = float(stated.max())
        return (stated / largest).ravel(), None, 1 / largest, float("nan")
    s = _broadcast("sigma", sigma, shape)
    if not (s > 0).all():
        row = int(np.argmin(s.ravel() > 0))
        raise RodgenError(
            f"sigma, row {row} (counted from 0) is not positive; expected a standard uncertainty"
        )
    scaled = np.ldexp(s, -exponent)
    scaled = np.maximum(scaled, 2.0**-_WIDEST)
    reach = np.where(used, scaled / np.sqrt(np.where(used, stated, 1.0)), np.inf)
    smallest = float(reach.min())
    rms = smallest * float(np.sqrt(np.mean((scaled[used] / smallest) ** 2)))
    return ((smallest / reach) ** 2).ravel(), smallest**2, float("nan"), float(np.ldexp(rms, exponent))


def _broadcast(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = real_array(name, values)
    try:
        array = np.broadcast_to(array, shape)
    except ValueError:
        raise RodgenError(
            f"{name} has shape {array.shape}; expected one number, or one a pair: {shape}"
        ) from None
    demand_finite(name, array.ravel())
    return array


def _exponent(sizes: Array) -> int:
    """Exponent of two that brings the largest size to between 1/2 and 1; 0 for all zero."""
    largest = float(sizes.max(initial=0.0))
    return int(np.frexp(largest)[1]) if np.isfinite(largest) else 0


def _shown(value: Array) -> str:
    return np.array2string(np.ravel(value), separator=", ", max_line_width=1000)


CHANCE = 1e-5
"""Probability below which a better fit is not taken for luck."""
_MOST_SLIDE_STEPS = 30
_SETTLED = 1e-13
_ROUNDING = 1e-12
"""Of a relative information: 64 times rounding, for a hundred roundings in its sums."""


@dataclass(frozen=True, eq=False)
class Slide:
    """A slide of `size` times `amount` along the axis.

    Attributes
    ----------
    size : float
        Scaled length, of each pair or of each radian.
    by_angle : bool
        Whether it is in proportion to the angle.
    line : Line
    """

    size: float
    by_angle: bool
    line: Line

    def amount(self, pairs: Pairs) -> Array:
        """Return by what the size is multiplied in each pair, (n,)."""
        return pairs.angle if self.by_angle else np.ones(len(pairs.angle))

    def without(self, pairs: Pairs) -> Pairs:
        """Return the pairs less the slide, which have one parameter more."""
        moved = pairs.rho_prime - self.size * self.amount(pairs)[:, None] * self.line.axis
        return replace(pairs, rho_prime=moved, slid=True)

    def information(self, pairs: Pairs, basis: Array, alone: Array) -> tuple[Array, float]:
        """Return the information by axis, point and slide, and the slope of half the squares by the slide.

        `pairs` are those without the slide; `alone` is the information by axis and point where there is none.
        """
        normal, without, gradient = self._normal(pairs, basis)
        normal[:-1, :-1] += alone - without
        return normal, float(gradient[-1])

    def gain(self, pairs: Pairs) -> float:
        """Return by what half the squares fall by a step to the least squares, of pairs without the slide."""
        normal, _, gradient = self._normal(pairs, tangents(self.line.axis))
        return float(gradient @ np.linalg.lstsq(normal, gradient, rcond=None)[0]) / 2

    @staticmethod
    def is_determined(information: Array) -> bool:
        """Return whether the slide changes the residuals otherwise than axis and point, by more than rounding."""
        diagonal = np.diag(information)
        if not (diagonal > 0).all():
            return False
        return bool(np.linalg.eigvalsh(information / np.sqrt(np.outer(diagonal, diagonal)))[0] > _ROUNDING)

    def _normal(self, pairs: Pairs, basis: Array) -> tuple[Array, Array, Array]:
        """Return Σ w JᵀJ by axis, point and slide, that of a slide of none by axis and point, and Σ w Jᵀd."""
        size = 2 if pairs.point is not None else 4
        normal, without = np.zeros((size + 1, size + 1)), np.zeros((size, size))
        gradient = np.zeros(size + 1)
        for _, block in pairs.blocks():
            d, jacobian = residual_and_jacobian(
                block.rho, block.rho_prime, block.angle, self.line.axis, self.line.point
            )
            w, amount = block.weight, self.amount(block)[:, None, None]
            by = np.concatenate([jacobian[:, :, :3] @ basis, jacobian[:, :, 3:] @ basis], axis=2)[:, :, :size]
            without += np.einsum("n,nip,niq->pq", w, by, by)
            by[:, :, :2] -= self.size * amount * basis
            by = np.concatenate([by, -amount * self.line.axis[:, None]], axis=2)
            normal += np.einsum("n,nip,niq->pq", w, by, by)
            gradient += np.einsum("n,nip,ni->p", w, by, d)
        return normal, without, gradient

    @classmethod
    def fitted(cls, pairs: Pairs, line: Line, *, by_angle: bool) -> Slide:
        """Return the least squares of axis, point and slide, from those without a slide."""
        slide = cls(0.0, by_angle, line)
        for _ in range(_MOST_SLIDE_STEPS):
            basis = tangents(slide.line.axis)
            normal, _, gradient = slide._normal(slide.without(pairs), basis)
            step = -np.linalg.lstsq(normal, gradient, rcond=None)[0]
            axis = slide.line.axis + basis @ step[:2]
            point = slide.line.point + (basis @ step[2:4] if pairs.point is None else 0.0)
            slide = cls(slide.size + float(step[-1]), by_angle, Line(axis / math.sqrt(axis @ axis), point))
            if np.abs(step).max() < _SETTLED:
                break
        return slide


def chance_of(slide: float, variance: float, freedoms: int, *, known: bool) -> float:
    """Return an upper bound of the logarithm of the probability of a slide so far from none, by chance.

    `variance` is that of the slide, known or estimated with `freedoms` degrees of freedom.
    """
    z = slide**2 / variance if variance > 0 else math.inf
    return -z / 2 if known else -freedoms / 2 * math.log1p(z / freedoms)


_MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
"""Odd numbers with bits that look random: sums of multiples of coordinates rarely agree by chance."""


@dataclass(frozen=True, eq=False)
class SharedReadings:
    """Readings that are in more than one of the pairs that count.

    Attributes
    ----------
    pair, reading : (k,) int arrays
        The pair and the reading of each place where one stands.
    before : (k,) bool array
        Whether it is a point before the turn.
    """

    pair: NDArray[np.intp]
    reading: NDArray[np.intp]
    before: NDArray[np.bool_]

    @classmethod
    def of(cls, pairs: Pairs) -> SharedReadings | None:
        """Return those of the pairs with a weight; None where each reading is in one pair."""
        counted = np.flatnonzero(pairs.weight > 0)
        points = np.concatenate([pairs.rho[counted], pairs.rho_prime[counted]]) + 0.0  # no zero with a sign
        bits = points.view(np.uint64)
        mixed = ((bits ^ (bits >> np.uint64(32))) * _MIX).sum(axis=1)
        order = np.argsort(mixed, kind="stable")
        alike = np.diff(mixed[order]) == 0
        if not alike.any():
            return None
        place = order[np.r_[alike, False] | np.r_[False, alike]]
        reading = np.unique(points[place], axis=0, return_inverse=True)[1].ravel()
        pair = place % len(counted)
        several = np.zeros(reading.max() + 1, bool)
        first = np.full(len(several), -1)
        first[reading[::-1]] = pair[::-1]
        several[reading[pair != first[reading]]] = True  # one at rest is alike before and after
        inside = several[reading]
        if not inside.any():
            return None
        reading = np.unique(reading[inside], return_inverse=True)[1]
        return cls(counted[pair[inside]], reading, place[inside] < len(counted))

    @property
    def text(self) -> str:
        """A sentence for users."""
        number, most = int(self.reading.max()) + 1, int(np.bincount(self.reading).max())
        stand = "readings stand" if number > 1 else "reading stands"
        return (
            f"{number} {stand} in several pairs, one in {most}: the uncertainties allow for the errors that "
            "pairs share."
        )

    def excess(self, pairs: Pairs, share: Array, basis: Array, slide: Slide) -> Array:
        """Return by how much the score's variance exceeds that of independent readings, in units of the noise's.

        `pairs` are those without the slide, `basis` (3, 2) directions across its axis; the result is by axis, a free
        point, and slide: (5, 5) or (3, 3).
        """
        i, line = self.pair, slide.line
        some = pairs.only(i)
        jacobian = residual_and_jacobian(some.rho, some.rho_prime, some.angle, line.axis, line.point)[1]
        parts = [jacobian[:, :, :3] @ basis] + ([jacobian[:, :, 3:] @ basis] if pairs.point is None else [])
        parts.append(-slide.amount(some)[:, None, None] * line.axis[:, None])
        by = np.concatenate(parts, axis=2) * (np.sqrt(some.weight) * share[i])[:, None, None]
        cosine, sine = (f(some.angle)[:, None, None] for f in (np.cos, np.sin))
        along = line.axis[:, None] * np.einsum("j,njp->np", line.axis, by)[:, None, :]
        back = cosine * by - sine * np.cross(line.axis[None, :, None], by, axis=1) + (1 - cosine) * along
        by = np.where(self.before[:, None, None], -back, by)
        total = np.zeros((int(self.reading.max()) + 1, *by.shape[1:]))
        np.add.at(total, self.reading, by)
        excess: Array = np.einsum("njp,njq->pq", total, total) - np.einsum("njp,njq->pq", by, by)
        return excess
