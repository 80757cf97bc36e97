"""All common solutions of two equations in two angles, each linear in (1, cos θ1, sin θ1) and in (1, cos θ2, sin θ2).

Problem: Σ M_e,ij u_i v_j = 0 for e = 1, 2 with u = (1, cos θ1, sin θ1), v = (1, cos θ2, sin θ2). In the tangents of the
half angles these are Crane and Duffy's two biquadratics, with no more than eight common solutions unless they have a
common factor. In angles no solution is at infinity: θ = π is one like every other.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.spatial._pair_eigenvalues import HALF, seconds, starts
from rodgen.spatial._pair_solutions import ROUNDING, apart, basis, newton, quality

__all__ = ["Pair", "PairStatus", "pair_from_biquadratics", "solve_pair"]

EPS = float(np.finfo(float).eps)
SLOTS = 8
REGULAR = 1 / np.sqrt(8 * ROUNDING)
"""Condition number up to which Kantorovich's theorem holds with rounding alone."""
COMMON = 1e-13
"""Distance of the resultant from vanishing, relative, below which it does: rounding leaves some 1e-16."""
NEAR = 1e-6
"""Solutions that meet and are not farther apart are one: rounding moves them by 1e-8 to 1e-7."""
STRETCH = 1e-2
"""As far as this they are one if half way between them the equations hold as well: three solutions meet, or nearly."""


class PairStatus(IntEnum):
    """What one slot of the solutions of a pair of equations is.

    REGULAR: a solution that stands alone.
    DOUBLE: two solutions or more meet here, to rounding; it is given once.
    COMMON_FACTOR: one of a family: the equations have a common factor, and this solves it.
    NONE: there is no solution in this slot; the angles are NaN.
    INCOMPLETE: there is none here, but one may be missing; the angles are NaN.
    INVALID: a coefficient is not finite; the angles are NaN.
    """

    REGULAR = 0
    DOUBLE = 1
    COMMON_FACTOR = 2
    NONE = 3
    INCOMPLETE = 4
    INVALID = 5


class Pair(NamedTuple):
    """Solutions of pairs of equations, those there are first, in the order of theta1."""

    theta1: Any
    theta2: Any
    status: Any


def pair_from_biquadratics(E: ArrayLike) -> Any:
    """Bring two biquadratics to the form that :func:`solve_pair` takes.

    Parameters
    ----------
    E : array_like (..., 2, 3, 3)
        Coefficients: equation, power of x2 = tan(theta2/2), power of x1 = tan(theta1/2), powers ascending.

    Returns
    -------
    M : array (..., 2, 3, 3)
        The same equations divided by (1 + x1²)(1 + x2²).
    """
    given = _coefficients(E, "E")
    back = np.linalg.inv(HALF)
    return np.einsum("jb,ia,...ba->...ij", back, back, given)


def solve_pair(M: ArrayLike, *, method: str = "sylvester") -> Pair:
    """Find every pair of real angles that solves two equations.

    Parameters
    ----------
    M : array_like (..., 2, 3, 3)
        Equation e is ``sum(M[e, i, j] * u[i] * v[j]) = 0`` with u = (1, cos theta1, sin theta1) and
        v = (1, cos theta2, sin theta2).

    Returns
    -------
    Pair
        theta1, theta2 and status, each (..., 8). Angles are in (-π, π].
    """
    given = _coefficients(M, "M")
    flat = given.reshape(-1, 2, 3, 3)
    size = np.abs(flat).max(axis=(-2, -1))
    valid = np.isfinite(size).all(axis=-1)
    _, exponent = np.frexp(np.where(valid[:, None], size, 1.0))
    with np.errstate(all="ignore"):
        scaled = np.ldexp(flat, -exponent[..., None, None])
    angles = np.full((len(flat), SLOTS, 2), np.nan)
    status = np.full((len(flat), SLOTS), PairStatus.INVALID, np.int8)
    rows = np.flatnonzero(valid)
    if len(rows):
        angles[rows], status[rows] = _stable(scaled[rows], method)
    shape = (*given.shape[:-3], SLOTS)
    return Pair(angles[..., 0].reshape(shape), angles[..., 1].reshape(shape), status.reshape(shape))


def _coefficients(M: ArrayLike, name: str) -> Any:
    given = np.asarray(M)
    if np.iscomplexobj(given):
        raise TypeError(f"{name} is complex; expected real numbers")
    if given.shape[-3:] != (2, 3, 3):
        raise ValueError(f"{name} has the shape {given.shape}; expected (..., 2, 3, 3)")
    return given.astype(float)


def _stable(M: Any, method: str) -> tuple[Any, Any]:
    """Solve scaled equations (n, 2, 3, 3) by eigenvalues: angles (n, 8, 2), statuses (n, 8)."""
    first, distance = starts(M, method)
    angles, status = _collected(M, first)
    common = distance <= COMMON
    flawed = ~common & ~_consistent(M, angles, status)
    if flawed.any():
        rows = np.flatnonzero(flawed)
        other, _ = starts(M[rows].swapaxes(-1, -2), method)
        more = np.concatenate([first[rows], other[..., ::-1], _grid(len(rows))], axis=1)
        angles[rows], status[rows] = _collected(M[rows], more)
        still = rows[~_consistent(M[rows], angles[rows], status[rows])]
        status[still] = np.where(status[still] == PairStatus.NONE, PairStatus.INCOMPLETE, status[still])
    for row in np.flatnonzero(common):
        angles[row], status[row] = _with_common_factor(M[row])
    return angles, status


def _grid(n: int, side: int = 12) -> Any:
    """Return angle pairs (n, side², 2) all over."""
    line = 2 * np.pi * (np.arange(side) + 0.3) / side - np.pi
    pairs = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return np.broadcast_to(pairs, (n, *pairs.shape))


def _polished(M: Any, pairs: Any) -> tuple[Any, Any, Any, Any]:
    """Bring starts (n, m, 2) to solutions: angles, residual, condition and sign of the determinant, each (n, m)."""
    n, m, _ = pairs.shape
    repeated = np.repeat(M, m, axis=0)
    angles = newton(repeated, pairs.reshape(-1, 2))
    residual, condition, sign = quality(repeated, angles)
    shape = n, m
    return angles.reshape(n, m, 2), residual.reshape(shape), condition.reshape(shape), sign.reshape(shape)


def _collected(M: Any, pairs: Any) -> tuple[Any, Any]:
    """Take each solution that starts (n, m, 2) lead to once."""
    n = len(M)
    angles, residual, condition, _ = _polished(M, pairs)
    with np.errstate(invalid="ignore"):
        there = residual <= ROUNDING
        regular = there & (condition <= REGULAR)
    meeting = there & ~regular
    # a family of solutions at one angle: the other is free
    u, v = basis(np.nan_to_num(angles[..., 0])), basis(np.nan_to_num(angles[..., 1]))
    size = np.abs(M).sum(axis=(-2, -1))
    row = np.abs(np.einsum("neij,nmi->nmej", M, u)).sum(axis=-1) / size[:, None]
    column = np.abs(np.einsum("neij,nmj->nmei", M, v)).sum(axis=-1) / size[:, None]
    free = meeting & ((row <= ROUNDING * 4).all(axis=-1) | (column <= ROUNDING * 4).all(axis=-1))
    kind = np.select(
        [regular, free, meeting],
        [PairStatus.REGULAR, PairStatus.COMMON_FACTOR, PairStatus.DOUBLE],
        PairStatus.NONE,
    )
    order = np.argsort(np.where(there, np.where(regular, 0.0, 1.0) + residual, 9.0), axis=-1, kind="stable")
    angles = np.take_along_axis(angles, order[..., None], axis=1)
    kind, condition = np.take_along_axis(kind, order, axis=1), np.take_along_axis(condition, order, axis=1)
    found = np.full((n, SLOTS, 2), np.nan)
    found_kind = np.full((n, SLOTS), PairStatus.NONE, np.int8)
    found_condition = np.full((n, SLOTS), np.nan)
    count = np.zeros(n, int)
    for k in range(angles.shape[1]):
        rows = np.flatnonzero(kind[:, k] != PairStatus.NONE)
        if not len(rows):
            continue
        candidate, its_kind = angles[rows, k], kind[rows, k]
        same = np.zeros(len(rows), bool)
        for slot in range(SLOTS):
            distance = apart(candidate, found[rows, slot])
            with np.errstate(invalid="ignore"):
                both = (its_kind == PairStatus.REGULAR) & (found_kind[rows, slot] == PairStatus.REGULAR)
                radius = np.where(both, 0.25 / found_condition[rows, slot], NEAR)
                close = distance <= radius
                stretch = ~close & ~both & (distance <= STRETCH)
                family = (its_kind == PairStatus.COMMON_FACTOR) & (
                    found_kind[rows, slot] == PairStatus.COMMON_FACTOR
                )
            if stretch.any():
                some = np.flatnonzero(stretch)
                half = (
                    found[rows[some], slot]
                    + (np.remainder(candidate[some] - found[rows[some], slot] + np.pi, 2 * np.pi) - np.pi) / 2
                )
                between, _, _ = quality(M[rows[some]], half)
                close[some] |= between <= 2 * ROUNDING
            same |= close | family
        new = ~same & (count[rows] < SLOTS)
        put = rows[new]
        found[put, count[put]], found_kind[put, count[put]] = candidate[new], its_kind[new]
        found_condition[put, count[put]] = condition[put, k]
        count[put] += 1
    order = np.lexsort((found[..., 1], found[..., 0]), axis=-1)
    return np.take_along_axis(found, order[..., None], axis=1), np.take_along_axis(found_kind, order, axis=1)


def _consistent(M: Any, angles: Any, status: Any) -> Any:
    """Tell whether the signs of the determinants balance, as far as solutions stand alone."""
    n = len(M)
    repeated = np.repeat(M, SLOTS, axis=0)
    _, _, sign = quality(repeated, angles.reshape(-1, 2))
    signed = np.where(status == PairStatus.REGULAR, sign.reshape(n, SLOTS), 0.0).sum(axis=-1)
    loose = (status == PairStatus.DOUBLE).sum(axis=-1) + 8 * (status == PairStatus.COMMON_FACTOR).any(axis=-1)
    return np.abs(signed) <= loose


def _with_common_factor(M: Any) -> tuple[Any, Any]:
    """Solve one pair with a common factor: what stands alone, and a representative of the family."""
    lines = np.linspace(-np.pi, np.pi, 24, endpoint=False) + 0.05
    rows = np.einsum("eij,ki->kej", M, basis(lines))
    columns = np.einsum("eij,kj->kei", M, basis(lines))
    pairs = [np.stack([lines, second], axis=-1) for second in seconds(rows)]
    pairs += [np.stack([first, lines], axis=-1) for first in seconds(columns)]
    every = np.concatenate([*pairs, _grid(1)[0]])
    angles, residual, condition, _ = (x[0] for x in _polished(M[None], every[None]))
    with np.errstate(invalid="ignore"):
        there = residual <= ROUNDING
        alone = there & (condition <= REGULAR)
    found: list[tuple[Any, PairStatus]] = []
    for k in np.flatnonzero(alone):
        if all(apart(angles[k], other) > 1 / REGULAR for other, _ in found):
            found.append((angles[k], PairStatus.REGULAR))
    family = np.flatnonzero(there & ~alone)
    if len(family):
        found.append((angles[family[residual[family].argmin()]], PairStatus.COMMON_FACTOR))
    found = sorted(found[-SLOTS:], key=lambda one: (one[0][0], one[0][1]))
    slots = np.full((SLOTS, 2), np.nan)
    status = np.full(SLOTS, PairStatus.NONE, np.int8)
    for slot, (pair, kind) in enumerate(found):
        slots[slot], status[slot] = pair, kind
    return slots, status
