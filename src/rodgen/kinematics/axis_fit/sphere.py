"""The unit vectors e that maximise eᵀA e + b·e, for symmetric 3×3 A.

Stationary unit vectors obey 2 A e + b = 2 μ e. With the eigenvalues λ₁ ≥ λ₂ ≥ λ₃ of A and the
components γ = b/2 in its eigenbasis,

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

from typing import NamedTuple

import numpy as np

from rodgen.array_types import Array

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
