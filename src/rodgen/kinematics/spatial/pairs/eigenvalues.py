"""Starting values for every solution of a pair, from eigenvalues of Sylvester's or Bezout's matrix polynomial.

With x = tan(θ/2) the equations are two quadratics in x2 whose coefficients are quadratics in x1. They have a common
root where Sylvester's 4 x 4 matrix S0 + S1 x1 + S2 x1² is singular, or Bezout's 2 x 2 matrix of quartics: 8 values x1,
infinite ones among them. θ1 is counted from a direction far from all solutions first, so that the matrix of the highest
power is well conditioned; it is divided by, and an ordinary eigenvalue problem of order 8 is left.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rodgen.kinematics.spatial.links.transforms import rx
from rodgen.kinematics.spatial.pairs.solutions import basis

TURNS = 2 * np.pi / 9 * np.arange(9) + 0.1
"""Directions that θ1 may be counted from: nine, because a resultant that is not identically zero has no more than
eight zeros."""
SOLVABLE = 1e-14
"""Smallest over largest singular value of the matrix that is divided by: below this rounding may make it singular."""
COMPLEX = 0.05
"""Imaginary part of an angle up to which it may be a real one: eight solutions in one lose all but an eighth of sixteen
digits."""
ALONE = 1e-2
"""Distance from other eigenvalues beyond which a real one is that of a real solution: rounding moves those of badly
scaled equations by 1e-6 at most."""
HALF = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, -1.0, 0.0]])
"""(1 + x²) (1, cos θ, sin θ), by powers of x = tan(θ/2)."""


def turned(M: Any, first: Any) -> Any:
    """Return equations whose first angle is counted from `first` (n,): θ1 = first + ψ1."""
    return np.einsum("nki,neij->nekj", rx(-first), M)


def biquadratics(M: Any) -> Any:
    """Return the coefficients (..., 2, 3, 3) of biquadratics: equation, power of x2, power of x1."""
    return np.einsum("bj,ai,...ij->...ba", HALF, HALF, M)


def sylvester(E: Any) -> Any:
    """Return the matrices S0, S1, S2 (n, 3, 4, 4) of the vector (x2³, x2², x2, 1)."""
    S = np.zeros((len(E), 3, 4, 4))
    for row, (equation, shift) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        for power in range(3):
            S[:, :, row, shift + 2 - power] = E[:, equation, power]
    return S


def bezout(E: Any) -> Any:
    """Return the matrices B0 to B4 (n, 5, 2, 2) of the vector (x2, 1)."""

    def bracket(i: int, j: int) -> Any:
        found = np.zeros((len(E), 5))
        for a in range(3):
            for b in range(3):
                found[:, a + b] += E[:, 0, i, a] * E[:, 1, j, b] - E[:, 1, i, a] * E[:, 0, j, b]
        return found

    pq, pr, qr = bracket(2, 1), bracket(2, 0), bracket(1, 0)
    return np.stack([np.stack([pq, pr], -1), np.stack([pr, qr], -1)], -2)


def eigenvalues(M: Any, method: str = "sylvester") -> tuple[Any, Any]:
    """Return angles θ1 (n, 8), complex ones among them, and how far the resultant is from vanishing (n,)."""
    n = len(M)
    form = sylvester if method == "sylvester" else bezout
    smallest = _smallest(M, form)
    best = smallest.argmax(axis=-1)
    # Sylvester's matrix tells a common factor to rounding, Bezout's to the root of that
    distance = (smallest if method == "sylvester" else _smallest(M, sylvester)).max(axis=-1)
    turn = TURNS[best]
    P = form(biquadratics(turned(M, turn)))
    degree, size = P.shape[1] - 1, P.shape[2]
    good = smallest[np.arange(n), best] > SOLVABLE
    last = np.where(good[:, None, None], P[:, -1], np.eye(size))
    companion = np.zeros((n, degree * size, degree * size))
    companion[:, :-size, size:] = np.eye((degree - 1) * size)
    for power in range(degree):
        block = -np.linalg.solve(last, P[:, power])
        companion[:, -size:, power * size : (power + 1) * size] = block
    x = np.linalg.eigvals(companion).astype(complex)
    with np.errstate(all="ignore"):
        psi = 2 * np.arctan(x)
        psi = np.where(np.abs(x.imag) == 0, 2 * np.arctan(x.real), psi)
    return psi + turn[:, None], distance


def _smallest(M: Any, form: Callable[[Any], Any]) -> Any:
    """Return the smallest over the largest singular value of the matrix of the highest power, for nine turns: (n, 9).

    At x = ∞ the matrix polynomial is that matrix, so all turns together ask for it at nine angles.
    """
    leading = np.stack(
        [form(biquadratics(turned(M, np.full(len(M), turn))))[:, -1] for turn in TURNS], axis=1
    )
    singular = np.linalg.svd(leading, compute_uv=False)
    largest = singular[..., :1].max(axis=1)
    return singular[..., -1] / np.where(largest > 0, largest, 1.0)


def starts(M: Any, method: str = "sylvester") -> tuple[Any, Any, Any]:
    """Return angle pairs (n, 24, 2) near every solution, the angles θ1 (n, 8) that stand alone, and the distance (n,).

    Empty slots are NaN. An angle that stands alone is real and far from all other eigenvalues, complex ones included:
    near it there is a solution. The distance is that of :func:`eigenvalues`.
    """
    theta, distance = eigenvalues(M, method)
    with np.errstate(invalid="ignore"):
        # two real solutions that nearly meet may have eigenvalues a ± bi: a ± b is then outside of them, from where
        # Newton's method leads to both, while it stays at a
        first = np.where(np.abs(theta.imag) <= COMPLEX, theta.real + theta.imag, np.nan)
        gap = np.abs(
            theta[:, :, None] - theta[:, None, :] + 2 * np.pi * np.arange(-1, 2)[:, None, None, None]
        )
        gap[1, :, np.arange(8), np.arange(8)] = np.inf
        gap = np.where(np.isnan(gap), np.inf, gap).min(axis=(0, -1))
        alone = np.where((theta.imag == 0) & (gap > ALONE), theta.real, np.nan)
    rows = np.einsum("neij,nki->nkej", M, basis(np.nan_to_num(first)))
    second = np.stack(seconds(rows), axis=-1)
    pairs = np.stack([np.broadcast_to(first[..., None], second.shape), second], axis=-1)
    return pairs.reshape(len(M), -1, 2), alone, distance


def seconds(rows: Any) -> tuple[Any, Any, Any]:
    """Return three θ2 for the rows (..., 2, 3) of the equations at a θ1.

    The first is that of the direction perpendicular to both rows. Where the rows are nearly parallel it means nothing,
    and the other two are those of the one direction that they share.
    """
    n0, n1, n2 = np.moveaxis(np.cross(rows[..., 0, :], rows[..., 1, :]), -1, 0)
    sign = np.where(n0 < 0, -1.0, 1.0)
    common = np.arctan2(sign * n2, sign * n1)
    gram = rows @ rows.swapaxes(-1, -2)
    half = np.arctan2(2 * gram[..., 0, 1], gram[..., 0, 0] - gram[..., 1, 1]) / 2
    t = np.cos(half)[..., None] * rows[..., 0, :] + np.sin(half)[..., None] * rows[..., 1, :]
    radius, centre = np.hypot(t[..., 1], t[..., 2]), np.arctan2(t[..., 2], t[..., 1])
    open_by = np.arccos(np.clip(-t[..., 0] / np.where(radius > 0, radius, 1.0), -1, 1))
    return common, centre + open_by, centre - open_by
