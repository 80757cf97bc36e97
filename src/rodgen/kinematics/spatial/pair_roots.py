"""Starts near all solutions of two equations in two angles, from eigenvalues, and equations with a common factor.

With x = tan(θ/2) the equations are two quadratics in x2 whose coefficients are quadratics in x1. They have a common
root where Sylvester's 4 x 4 matrix S0 + S1 x1 + S2 x1² is singular: 8 values x1, infinite ones among them. θ1 is
counted from a direction far from all solutions first, so that the matrix of the highest power is well conditioned; it
is divided by, and an ordinary eigenvalue problem of order 8 is left.

Where the octic vanishes identically there is a θ2 for every θ1, or the equations are the same but for a factor
that may have no real zero. Without the factor the equations may have isolated solutions as well. There is no polynomial
for those, so they are searched for from a few hundred starts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rodgen.kinematics.numerics import apart, principal
from rodgen.kinematics.spatial.pair_solutions import (
    NEAR,
    ROUNDING,
    SLOTS,
    basis,
    on_lines,
    polished,
    regular_below,
)
from rodgen.kinematics.spatial.status import ReverseStatus
from rodgen.kinematics.spatial.transforms import rx

TURNS = 2 * np.pi / 9 * np.arange(9) + 0.1
"""Directions that θ1 may be counted from: nine, because a resultant that is not identically zero has no more than
eight zeros."""
SOLVABLE = 1e-14
"""Smallest over largest singular value of the matrix that is divided by: below this rounding may make it singular."""
COMPLEX = 0.05
"""Imaginary part of an angle up to which it may be a real one: eight solutions in one keep an eighth of sixteen
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


def eigenvalues(M: Any) -> tuple[Any, Any]:
    """Return angles θ1 (n, 8), complex ones among them, and how far the resultant is from vanishing (n,)."""
    n = len(M)
    smallest = _smallest(M)
    best = smallest.argmax(axis=-1)
    turn = TURNS[best]
    P = sylvester(biquadratics(turned(M, turn)))
    good = smallest[np.arange(n), best] > SOLVABLE
    last = np.where(good[:, None, None], P[:, 2], np.eye(4))
    companion = np.zeros((n, 8, 8))
    companion[:, :4, 4:] = np.eye(4)
    companion[:, 4:] = -np.linalg.solve(last, np.concatenate([P[:, 0], P[:, 1]], axis=2))
    x = np.linalg.eigvals(companion).astype(complex)
    with np.errstate(all="ignore"):
        psi = 2 * np.arctan(x)
        psi = np.where(np.abs(x.imag) == 0, 2 * np.arctan(x.real), psi)
    return psi + turn[:, None], smallest.max(axis=-1)


def _smallest(M: Any) -> Any:
    """Return the smallest over the largest singular value of the matrix of the highest power, for nine turns: (n, 9).

    At x = ∞ the matrix polynomial is that matrix, so all turns together ask for it at nine angles.
    """
    turns = [sylvester(biquadratics(turned(M, np.full(len(M), turn))))[:, 2] for turn in TURNS]
    singular = np.linalg.svd(np.stack(turns, axis=1), compute_uv=False)
    largest = singular[..., :1].max(axis=1)
    return singular[..., -1] / np.where(largest > 0, largest, 1.0)


def starts(M: Any) -> tuple[Any, Any, Any]:
    """Return angle pairs (n, 24, 2) near every solution, the angles θ1 (n, 8) that stand alone, and the distance (n,).

    Empty slots are NaN. An angle that stands alone is real and far from all other eigenvalues, complex ones included:
    near it there is a solution. The distance is that of :func:`eigenvalues`.
    """
    theta, distance = eigenvalues(M)
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


LINES = 24
"""Angles at which the other one is solved for."""


def grid(n: int, side: int = 12) -> Any:
    """Return angle pairs (n, side², 2) all over."""
    line = 2 * np.pi * (np.arange(side) + 0.3) / side - np.pi
    pairs = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return np.broadcast_to(pairs, (n, *pairs.shape))


def with_common_factor(M: Any) -> tuple[Any, Any]:
    """Return the solutions of one pair (2, 3, 3): angles (8, 2), and statuses (8,)."""
    slots, status = np.full((SLOTS, 2), np.nan), np.full(SLOTS, ReverseStatus.NONE, np.int8)
    if not M.any():  # every pair of angles
        slots[0], status[0] = 0.0, ReverseStatus.FAMILY
        return slots, status
    lines = 2 * np.pi * np.arange(LINES) / LINES + 0.05
    rows = np.einsum("eij,ki->kej", M, basis(lines))
    columns = np.einsum("eij,kj->kei", M, basis(lines))
    starts = [np.stack([lines, second], axis=-1) for second in seconds(rows)]
    starts += [np.stack([first, lines], axis=-1) for first in seconds(columns)]
    every = np.concatenate([*starts, grid(1)[0]])
    angles, residual, condition, _ = (x[0] for x in polished(M[None], every[None]))
    with np.errstate(invalid="ignore"):
        there = residual <= 4 * ROUNDING
        alone = (residual <= ROUNDING) & (condition <= regular_below(1.0))
    solutions: list[tuple[Any, ReverseStatus]] = []
    for k in np.flatnonzero(alone):
        if all(apart(angles[k], known) > 0.25 / condition[k] for known, _ in solutions):
            solutions.append((angles[k], ReverseStatus.REGULAR))
    family = np.flatnonzero(there & ~alone)
    if len(family):
        solutions += _representatives(M, angles[family], residual[family])
    ordered = sorted(solutions[-SLOTS:], key=lambda one: (one[0][0], one[0][1]))
    for slot, (pair, kind) in enumerate(ordered):
        slots[slot], status[slot] = pair, kind
    return slots, status


def _representatives(M: Any, angles: Any, residual: Any) -> list[tuple[Any, ReverseStatus]]:
    """Return, of points (n, 2) of families, one on each line along which one angle is free, and one of other curves."""
    many = np.broadcast_to(M, (len(angles), *M.shape))
    moved, free = on_lines(many, np.full(len(angles), ROUNDING), angles)
    solutions: list[tuple[Any, ReverseStatus]] = []
    for which in (1, 2):
        known: list[float] = []
        for pair in moved[free == which]:
            fixed = pair[which - 1]
            if all(abs(principal(fixed - known_angle)) > NEAR for known_angle in known):
                known.append(fixed)
                solutions.append((pair, ReverseStatus.FAMILY))
    curve = np.flatnonzero(free == 0)
    if len(curve):
        solutions.append((angles[curve[residual[curve].argmin()]], ReverseStatus.FAMILY))
    return solutions
