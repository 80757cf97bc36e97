"""Solutions of two equations in two angles that have a common factor.

Where the octic vanishes identically there is a θ2 for every θ1, or the equations are the same but for a factor
that may have no real zero. Without the factor the equations may have isolated solutions as well. There is no polynomial
for those, so they are searched for from a few hundred starts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rodgen.kinematics.angles import apart, principal
from rodgen.kinematics.spatial.pairs.eigenvalues import seconds
from rodgen.kinematics.spatial.pairs.solutions import (
    NEAR,
    ROUNDING,
    SLOTS,
    basis,
    on_lines,
    polished,
    regular_below,
)
from rodgen.kinematics.spatial.status import PairStatus

LINES = 24
"""Angles at which the other one is solved for."""


def grid(n: int, side: int = 12) -> Any:
    """Return angle pairs (n, side², 2) all over."""
    line = 2 * np.pi * (np.arange(side) + 0.3) / side - np.pi
    pairs = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return np.broadcast_to(pairs, (n, *pairs.shape))


def with_common_factor(M: Any) -> tuple[Any, Any]:
    """Return the solutions of one pair (2, 3, 3): angles (8, 2), and statuses (8,)."""
    slots, status = np.full((SLOTS, 2), np.nan), np.full(SLOTS, PairStatus.NONE, np.int8)
    if not M.any():  # every pair of angles
        slots[0], status[0] = 0.0, PairStatus.COMMON_FACTOR
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
    found: list[tuple[Any, PairStatus]] = []
    for k in np.flatnonzero(alone):
        if all(apart(angles[k], other) > 0.25 / condition[k] for other, _ in found):
            found.append((angles[k], PairStatus.REGULAR))
    family = np.flatnonzero(there & ~alone)
    if len(family):
        found += _representatives(M, angles[family], residual[family])
    ordered = sorted(found[-SLOTS:], key=lambda one: (one[0][0], one[0][1]))
    for slot, (pair, kind) in enumerate(ordered):
        slots[slot], status[slot] = pair, kind
    return slots, status


def _representatives(M: Any, angles: Any, residual: Any) -> list[tuple[Any, PairStatus]]:
    """Return, of points (n, 2) of families, one on each line along which one angle is free, and one of other curves."""
    many = np.broadcast_to(M, (len(angles), *M.shape))
    moved, free = on_lines(many, np.full(len(angles), ROUNDING), angles)
    found: list[tuple[Any, PairStatus]] = []
    for which in (1, 2):
        known: list[float] = []
        for pair in moved[free == which]:
            fixed = pair[which - 1]
            if all(abs(principal(fixed - other)) > NEAR for other in known):
                known.append(fixed)
                found.append((pair, PairStatus.COMMON_FACTOR))
    curve = np.flatnonzero(free == 0)
    if len(curve):
        found.append((angles[curve[residual[curve].argmin()]], PairStatus.COMMON_FACTOR))
    return found
