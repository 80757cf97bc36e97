"""Fast solution of the usual pairs: all eight roots of the octic at once, with a proof of which are real.

The kernels of the derivation ``biquadratic_pair`` work on blocks of rows. From eight starts that are spread over the
sphere of complex numbers, Ehrlich and Aberth's method brings all roots near. Discs around them prove which are real,
and that each of those stands alone; Newton's method on the two equations makes them right to rounding, and proves that
there is a solution. Rows for which any of this fails are left to the eigenvalue method.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rodgen.generated.numpy.biquadratic_pair import PairRoots
from rodgen.kinematics.angles import principal
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.spatial.pairs.solutions import ROUNDING, regular_below

CHUNK = 1024
"""Rows a pass: their coefficients and roots, 300 bytes a row, stay in the second cache."""
STEPS = 7, 5, 8
"""Steps of the method before each look at the discs. Most rows are done after the first or second; the others have
roots that meet, and are done after the third or not at all."""
POLISHED = 2
"""Further calls of the polishing kernel for what is not right after the first: an octic may be ill conditioned."""
APART = 1e-7
"""Solutions are different beyond this: a regular one is right to 5e-8 at its worst, times the root of the loss."""


def _starts() -> Any:
    """Return eight points all over the sphere, none of them mirrored at the real axis."""
    polar = np.repeat([0.96, np.pi - 0.96], 4)
    around = 0.3 + np.pi / 2 * np.arange(8) + np.repeat([0, np.pi / 4], 4)
    return np.tan(polar / 2)[:, None] * np.stack([np.cos(around), np.sin(around)], axis=-1)


STARTS = _starts()


def certain_solutions(one: Any, two: Any, loss: Any) -> tuple[Any, Any]:
    """Return the solutions (n, 8, 2) of prepared equations (n, 3, 3) where they are certain, and where that is (n,).

    The solutions are regular and in the order of the first angle, with NaN after them, and NaN where they are not all.
    """
    n = len(one)
    angles, certain = np.full((n, 8, 2), np.nan), np.zeros(n, bool)
    for first in range(0, n, CHUNK):
        part = slice(first, first + CHUNK)
        angles[part], certain[part] = _block(one[part], two[part], loss[part])
    return angles, certain


def _block(one: Any, two: Any, loss: Any) -> tuple[Any, Any]:
    octic, turn, size = kernels.pair_octic(one, two)
    size = size * loss
    n = len(one)
    roots = np.broadcast_to(STARTS, (n, 8, 2))
    tangents, left = np.full((n, 8), np.nan), np.arange(n)
    certain = np.zeros(n, bool)
    for steps in STEPS:
        for _ in range(steps):
            roots, _ = kernels.pair_aberth(octic, roots)
        found, _, status = kernels.pair_real_roots(octic, size[left], roots)
        done = status == PairRoots.CERTAIN
        tangents[left[done]], certain[left[done]] = found[done], True
        left, octic, roots = left[~done], octic[~done], roots[~done]
        if not len(left):
            break
    tangents.sort(axis=-1)  # NaN last
    rows, slots = np.nonzero(np.isfinite(tangents))
    a, b = one[rows], two[rows]
    angles = kernels.pair_angles(a, b, turn[rows], tangents[rows, slots])
    angles, residual, condition, _ = kernels.pair_polish(a, b, angles)
    limit = ROUNDING * loss[rows]
    for _ in range(POLISHED):
        rough = np.flatnonzero(residual > limit)
        if not len(rough):
            break
        again = kernels.pair_polish(a[rough], b[rough], angles[rough])
        angles[rough], residual[rough], condition[rough] = again[:3]
    good = (residual <= limit) & (condition <= regular_below(loss[rows]))
    certain[rows[~good]] = False
    result = np.full((n, 8, 2), np.nan)
    result[rows, slots] = principal(angles)
    # the order of the tangents is that of the angles but for where it starts
    order = np.argsort(result[..., 0], axis=-1, kind="stable")
    result = np.take_along_axis(result, order[..., None], axis=1)
    with np.errstate(invalid="ignore"):
        last = np.nanmax(result[..., 0], axis=-1, initial=-np.inf)
        around = result[:, :1, 0] + 2 * np.pi - last[:, None]
        gaps = np.concatenate([np.diff(result[..., 0], axis=-1), around], axis=-1)
        certain &= ~(gaps <= APART * np.sqrt(loss)[:, None]).any(axis=-1)
    result[~certain] = np.nan
    return result, certain
