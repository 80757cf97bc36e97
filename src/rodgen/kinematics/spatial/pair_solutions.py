"""Solutions of two equations in two angles from rough starts: proved to exist, each once.

Newton's method brings a start to a point where both equations hold to rounding. By Kantorovich's theorem, with
S_e the sum of the sizes of the coefficients of equation e, κ the larger component of |J⁻¹| S and η that of J⁻¹ f, there
is exactly one solution within 1/(4κ) of the point where 8 κ η <= 1. So two points that are nearer to each other are the
same solution; and where κ is too large for that, solutions meet to rounding.

There is an independent test. The two equations map the torus of all angle pairs to a plane; a torus has no boundary, so
each value that no singular point has is taken as often with one sign of det J as with the other, zero included. And
the octic changes its sign with θ1 only where a solution is.

The usual pairs are solved fast: all eight roots of the octic at once, with a proof of which are real. The kernels of
the derivation ``biquadratic_pair`` work on blocks of rows. From eight starts that are spread over the sphere of complex
numbers, Ehrlich and Aberth's method brings all roots near. Discs around them prove which are real, and that each of
those stands alone; Newton's method on the two equations makes them right to rounding, and proves that there is a
solution. Rows for which any of this fails are left to the eigenvalue method.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rodgen.generated.numpy.biquadratic_pair import PairRoots
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.numerics import apart, principal
from rodgen.kinematics.spatial.status import ReverseStatus

SLOTS = 8
"""Two equations without a common factor have no more solutions than the octic has roots."""
EPS = float(np.finfo(float).eps)
ROUNDING = 16 * EPS
"""Of an equation, over the sum of the sizes of its coefficients: some ten roundings in a product of three factors, and
a rounding of each angle."""
CALLS = 30
"""Calls of the polishing kernel, two steps each. A regular solution takes two to four; where two meet the distance only
halves in a step, and 27 halvings bring a rough start to where rounding hides the rest."""
PATIENCE = 3
"""Calls without a gain: along a narrow curved valley the equations grow before they become less."""
PROMISING = 1e-6
"""Residual of a start over S up to which it is near solutions that meet, if Newton's method leads away from it."""
DOWNHILL = 50
"""Steps that never lead away; near where solutions meet one gains a bit, as a rule, or finds out that it was too
long."""
BETWEEN = 1e-9
"""Residual over S up to which a place where Newton's method is stuck may be between two solutions."""
SIDES = np.array([-30.0, -4.0, 4.0, 30.0])
"""How far from there to start again, over the root of the residual."""
NEAR = 1e-6
"""Solutions that meet and are not farther apart are one: rounding moves them by 1e-8 to 1e-7."""
STRETCH = 1e-2
"""As far as this they are one if half way between them the equations nearly hold: three solutions meet, or more."""
CLUSTER = 64
"""How nearly, over what rounding leaves. Half way between two places 1e-6 apart where two solutions each meet more is
left than that."""
HALVINGS = 20
"""Steps to a line on which both equations hold; where they do to second order, each halves the distance."""
NEAR_LINE = 1e-3
"""How far, in rad, solutions that meet may be from such a line to be taken for a part of it."""
MEETING = 8
"""Steps of Newton's method for the equations and their determinant together, which are regular where two meet."""
EXPECTED = 1e-3
"""Of an eigenvalue that stands alone, in rad: far more than it is off by, and less than it is from others."""
SAMPLES = 60
"""Points at which the sign of the octic is looked at."""


def regular_below(loss: Any) -> Any:
    """Return the condition number κ up to which Kantorovich's theorem holds with rounding alone."""
    return 1 / np.sqrt(8 * ROUNDING * loss)


def basis(theta: Any) -> Any:
    """Return (1, cos, sin) along a new last axis."""
    return np.stack([np.ones_like(theta), np.cos(theta), np.sin(theta)], axis=-1)


def slope(u: Any) -> Any:
    """Return the derivative of (1, cos, sin) by the angle, of (1, cos, sin) (..., 3)."""
    return u[..., [0, 2, 1]] * [0, -1, 1]


def polished(M: Any, angles: Any) -> tuple[Any, Any, Any, Any]:
    """Return starts (n, m, 2) polished to where the equations M (n, 2, 3, 3) hold, and how well they do.

    After the angles come the residual over S, the condition number κ and the determinant, each (n, m).
    """
    n, m, _ = angles.shape
    now = angles.reshape(-1, 2).copy()
    results = [np.full(n * m, np.nan) for _ in range(3)]
    active = np.flatnonzero(np.isfinite(now).all(axis=-1))
    first = _missed(M[active // m], now[active])
    promising = active[first <= PROMISING]
    starts = now[promising]
    at, best, stuck = now[active], np.full(len(active), np.inf), np.zeros(len(active), int)
    for _ in range(CALLS):
        if not len(active):
            break
        of = active // m
        at, *quality = kernels.pair_polish(M[of, 0], M[of, 1], at)
        better = quality[0] < best
        rows = active[better]
        now[rows] = at[better]
        for result, value in zip(results, quality, strict=True):
            result[rows] = value[better]
        best = np.where(better, quality[0], best)
        # done, or no better for long: that is rounding, or the least that the equations have near here
        stuck = np.where(better, 0, stuck + 1)
        going = (quality[0] > EPS / 4) & (stuck < PATIENCE)
        active, at, best, stuck = active[going], at[going], best[going], stuck[going]
    # near solutions that meet a step may lead far away; there it is kept so short that it makes the equations less
    astray = results[0][promising] > ROUNDING
    if astray.any():
        rows = promising[astray]
        of = rows // m
        now[rows] = _downhill(M[of], starts[astray])
        for result, value in zip(results, _quality(M[of], now[rows]), strict=True):
            result[rows] = value
    residual, condition, determinant = (result.reshape(n, m) for result in results)
    return principal(now).reshape(n, m, 2), residual, condition, determinant


def _missed(M: Any, angles: Any) -> Any:
    """Return the residual over S of equations (n, 2, 3, 3) at angles (n, 2)."""
    size = np.abs(M).sum(axis=(-2, -1))
    return (np.abs(_values(M, angles)) / size).max(axis=-1, initial=0.0)


def _quality(M: Any, angles: Any) -> tuple[Any, Any, Any]:
    """Return residual over S, condition number κ and determinant of equations (n, 2, 3, 3) at angles (n, 2)."""
    size = np.abs(M).sum(axis=(-2, -1))
    J = _derivatives(M, angles)
    return _missed(M, angles), condition_number(J, size), _determinant(J)


def _determinant(J: Any) -> Any:
    return J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]


def condition_number(J: Any, size: Any) -> Any:
    """Return κ, the larger component of |J⁻¹| S, for derivatives (..., 2, 2) and sizes S (..., 2)."""
    determinant = np.abs(_determinant(J))
    first = np.abs(J[..., 1, 1]) * size[..., 0] + np.abs(J[..., 0, 1]) * size[..., 1]
    second = np.abs(J[..., 1, 0]) * size[..., 0] + np.abs(J[..., 0, 0]) * size[..., 1]
    flat = determinant == 0
    return np.where(flat, np.inf, np.maximum(first, second) / np.where(flat, 1.0, determinant))


def newton_step(J: Any, value: Any, singular: float) -> Any:
    """Return J⁻¹ f for derivatives (..., 2, 2) and values (..., 2); `singular` replaces a determinant of zero."""
    determinant = _determinant(J)
    determinant = np.where(determinant == 0, singular, determinant)
    first = J[..., 1, 1] * value[..., 0] - J[..., 0, 1] * value[..., 1]
    second = J[..., 0, 0] * value[..., 1] - J[..., 1, 0] * value[..., 0]
    return np.stack([first, second], axis=-1) / determinant[..., None]


def _derivatives(M: Any, angles: Any) -> Any:
    """Return the derivatives (n, 2, 2) of equations (n, 2, 3, 3) at angles (n, 2)."""
    u, v = basis(angles[:, 0]), basis(angles[:, 1])
    by_first = np.einsum("neij,ni,nj->ne", M, slope(u), v)
    by_second = np.einsum("neij,ni,nj->ne", M, u, slope(v))
    return np.stack([by_first, by_second], axis=-1)


def _downhill(M: Any, angles: Any) -> Any:
    """Return angles after Newton's method with steps so short that each makes the equations less."""
    angles = angles.copy()
    longest = np.full(len(angles), 0.01)
    value = _values(M, angles)
    for _ in range(DOWNHILL):
        J = _derivatives(M, angles)
        step = newton_step(J, value, 1e-300)
        length = np.abs(step).max(axis=-1)
        step *= (longest / np.maximum(longest, length))[:, None]
        trial = angles - step
        reached = _values(M, trial)
        better = np.square(reached).sum(axis=-1) < np.square(value).sum(axis=-1)
        angles[better], value[better] = trial[better], reached[better]
        longest = np.maximum(np.where(better, 2 * longest, np.minimum(longest, length) / 4), EPS**2)
    return angles


def _values(M: Any, angles: Any) -> Any:
    """Return equations (n, 2, 3, 3) at angles (n, 2)."""
    return np.einsum("neij,ni,nj->ne", M, basis(angles[:, 0]), basis(angles[:, 1]))


def collected(M: Any, loss: Any, starts: Any) -> tuple[Any, Any]:
    """Return each solution that starts (n, m, 2) lead to, once: angles (n, 8, 2), in order, and statuses (n, 8)."""
    n = len(M)
    limit = ROUNDING * loss
    angles, residual, condition, _ = _with_both_sides(M, limit, polished(M, starts))
    with np.errstate(invalid="ignore"):
        there = residual <= limit[:, None]
        regular = there & (condition <= regular_below(loss)[:, None])
    free = np.zeros(there.shape, int)
    of, which = np.nonzero(there & ~regular)
    if len(of):
        met = _where_they_meet(M[of], limit[of], angles[of, which])
        angles[of, which], free[of, which] = on_lines(M[of], limit[of], met)
    kind = np.select(
        [regular, free > 0, there],
        [ReverseStatus.REGULAR, ReverseStatus.FAMILY, ReverseStatus.DOUBLE],
        ReverseStatus.NONE,
    )
    # the best first: it represents those that are equal to it
    order = np.argsort(np.where(there, kind + residual, 9.0), axis=-1, kind="stable")
    angles = np.take_along_axis(angles, order[..., None], axis=1)
    kind, condition, free = (np.take_along_axis(x, order, axis=1) for x in (kind, condition, free))
    solutions = np.full((n, SLOTS, 2), np.nan)
    status, known = np.full((n, SLOTS), ReverseStatus.NONE, np.int8), np.full((n, SLOTS), np.nan)
    lines = np.zeros((n, SLOTS), int)
    count = np.zeros(n, int)
    width = int(there.sum(axis=-1).max(initial=0))
    for k in range(width):
        rows = np.flatnonzero((kind[:, k] != ReverseStatus.NONE) & (count < SLOTS))
        same = _known(
            M[rows], limit[rows], angles[rows, k], kind[rows, k], solutions[rows], status[rows], known[rows]
        )
        same |= _line_known(angles[rows, k], free[rows, k], solutions[rows], lines[rows])
        rows = rows[~same]
        place = rows, count[rows]
        solutions[place], status[place], known[place] = angles[rows, k], kind[rows, k], condition[rows, k]
        lines[place] = free[rows, k]
        count[rows] += 1
    order = np.lexsort((solutions[..., 1], solutions[..., 0]), axis=-1)
    return np.take_along_axis(solutions, order[..., None], axis=1), np.take_along_axis(status, order, axis=1)


def _where_they_meet(M: Any, limit: Any, angles: Any) -> Any:
    """Return angles (n, 2) of solutions that meet, moved to where the determinant vanishes, as nearly as possible."""
    now, value = angles.copy(), _values(M, angles)
    best = angles.copy()
    lowest = np.full(len(now), np.inf)
    for _ in range(MEETING):
        u, v = basis(now[:, 0]), basis(now[:, 1])
        du, dv = slope(u), slope(v)
        ddu, ddv = -u * [0, 1, 1], -v * [0, 1, 1]
        value = np.einsum("neij,ni,nj->ne", M, u, v)
        a, b = np.einsum("neij,ni,nj->ne", M, du, v), np.einsum("neij,ni,nj->ne", M, u, dv)
        aa, bb = np.einsum("neij,ni,nj->ne", M, ddu, v), np.einsum("neij,ni,nj->ne", M, u, ddv)
        ab = np.einsum("neij,ni,nj->ne", M, du, dv)
        det = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        by_first = aa[:, 0] * b[:, 1] + a[:, 0] * ab[:, 1] - aa[:, 1] * b[:, 0] - a[:, 1] * ab[:, 0]
        by_second = ab[:, 0] * b[:, 1] + a[:, 0] * bb[:, 1] - ab[:, 1] * b[:, 0] - a[:, 1] * bb[:, 0]
        missed = np.abs(value).max(axis=-1) / np.abs(M).sum(axis=(-2, -1)).max(axis=-1)
        better = (missed <= limit) & (np.abs(det) < lowest)
        best[better], lowest[better] = now[better], np.abs(det)[better]
        three = np.concatenate([value, det[:, None]], axis=1)
        J = np.stack([np.column_stack([a, by_first]), np.column_stack([b, by_second])], axis=-1)
        step = (np.linalg.pinv(J, rcond=1e-5) @ three[..., None])[..., 0]
        now = now - np.clip(step, -1e-3, 1e-3)
    return principal(best)


def _with_both_sides(M: Any, limit: Any, solutions: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return polished starts, and more on both sides of places between two solutions where Newton's method is stuck."""
    angles, residual = solutions[:2]
    with np.errstate(invalid="ignore"):
        stuck = (residual > limit[:, None]) & (residual <= BETWEEN)
    rows = np.flatnonzero(stuck.any(axis=-1))
    if not len(rows):
        return solutions
    some = M[rows]
    row, column = np.nonzero(stuck[rows])
    along = np.linalg.svd(_derivatives(some[row], angles[rows[row], column]))[2][:, 1]
    # the equations grow with the square of the distance along it
    distance = np.sqrt(residual[rows[row], column])[:, None] * along
    around = np.full((len(rows), angles.shape[1], len(SIDES), 2), np.nan)
    around[row, column] = angles[rows[row], column][:, None] + SIDES[:, None] * distance[:, None]
    more = polished(some, around.reshape(len(rows), -1, 2))
    added = []
    for old, new in zip(solutions, more, strict=True):
        padded = np.full((len(old), new.shape[1], *old.shape[2:]), np.nan)
        padded[rows] = new
        added.append(np.concatenate([old, padded], axis=1))
    return tuple(added)


def on_lines(M: Any, limit: Any, angles: Any) -> tuple[Any, Any]:
    """Return angles (n, 2) moved to lines on which both equations hold, if one is near, and which angle is free.

    The second is 0 for none, 1 where the first angle alone makes the equations hold, 2 where the second does.
    """
    angles, free = angles.copy(), np.zeros(len(angles), int)
    size = np.abs(M).sum(axis=(-2, -1))
    for which, m in enumerate((M, M.swapaxes(-1, -2))):
        now = angles[:, which].copy()
        for _ in range(HALVINGS):  # least squares of all six remaining coefficients
            u = basis(now)
            rest = np.einsum("neij,ni->nej", m, u)
            steep = np.einsum("neij,ni->nej", m, slope(u))
            square = np.square(steep).sum(axis=(-2, -1))
            now = now - (steep * rest).sum(axis=(-2, -1)) / np.where(square > 0, square, 1.0)
        rest = np.abs(np.einsum("neij,ni->nej", m, basis(now))).sum(axis=-1) / size
        near = np.abs(principal(now - angles[:, which])) <= NEAR_LINE
        there = near & (rest <= 4 * limit[:, None]).all(axis=-1) & (free == 0)
        angles[there, which], free[there] = now[there], which + 1
    return principal(angles), free


def _line_known(angles: Any, free: Any, solutions: Any, lines: Any) -> Any:
    """Return which candidates (n, 2) are on one of the lines found (n, 8, 2)."""
    off = np.abs(principal(angles[:, None] - solutions))
    with np.errstate(invalid="ignore"):
        on = [(free == which)[:, None] & (lines == which) & (off[..., which - 1] <= NEAR) for which in (1, 2)]
    return (on[0] | on[1]).any(axis=-1)


def _known(M: Any, limit: Any, angles: Any, kind: Any, solutions: Any, status: Any, condition: Any) -> Any:
    """Return which candidates (n, 2) are among those found (n, 8, 2)."""
    distance = apart(angles[:, None], solutions)
    with np.errstate(invalid="ignore"):
        both = (kind == ReverseStatus.REGULAR)[:, None] & (status == ReverseStatus.REGULAR)
        same = distance <= np.where(both, 0.25 / condition, NEAR)
        rows, slots = np.nonzero(~same & ~both & (distance <= STRETCH))
    if len(rows):
        turn = principal(angles[rows] - solutions[rows, slots])
        half_way = solutions[rows, slots] + turn / 2
        for _ in range(2):  # solutions that meet lie along a curve: go across, back to it
            across = np.linalg.pinv(_derivatives(M[rows], half_way), rcond=1e-2)
            half_way = half_way - (across @ _values(M[rows], half_way)[..., None])[..., 0]
        near = apart(half_way, solutions[rows, slots]) <= distance[rows, slots]
        same[rows, slots] = near & (_missed(M[rows], half_way) <= CLUSTER * limit[rows])
    return same.any(axis=-1)


def consistent(M: Any, angles: Any, status: Any, expected: Any) -> Any:
    """Return where the signs of the determinants balance, and the octic changes its sign at solutions only.

    Each of the angles θ1 that are `expected` (n, m), NaN for none, must be there as well.
    """
    n = len(M)
    flat = np.nan_to_num(angles).reshape(-1, 2)
    of = np.repeat(np.arange(n), SLOTS)
    _, _, _, determinant = kernels.pair_polish(M[of, 0], M[of, 1], flat)
    alone = status == ReverseStatus.REGULAR
    meeting = (status == ReverseStatus.DOUBLE).sum(axis=-1)
    family = (status == ReverseStatus.FAMILY).any(axis=-1)
    balance = np.where(alone, np.sign(determinant).reshape(n, SLOTS), 0.0).sum(axis=-1)
    good = np.abs(balance) <= meeting
    # between solutions, that is at samples and half way between neighbours, the sign changes with the count
    first = np.where(alone, angles[..., 0], np.pi)
    first = np.sort(first, axis=-1)
    # solutions at one θ1 have none between them
    neighbours = np.where(np.diff(first, axis=-1) > 2 * NEAR, (first[:, 1:] + first[:, :-1]) / 2, np.pi)
    samples = np.broadcast_to(np.linspace(-np.pi, np.pi, SAMPLES, endpoint=False) + 0.01, (n, SAMPLES))
    at = np.concatenate([samples, neighbours], axis=1)
    rows = np.einsum("neij,nki->nkej", M, basis(at))
    normal = np.cross(rows[:, :, 0], rows[:, :, 1])
    octic = (normal[..., 1] - normal[..., 0]) * (normal[..., 1] + normal[..., 0]) + normal[..., 2] ** 2
    size = np.square(np.linalg.norm(rows, axis=-1).prod(axis=-1))
    passed = ((angles[..., 0][:, None] < at[..., None]) & alone[:, None]).sum(axis=-1)
    turned = np.where(passed % 2, -1.0, 1.0) * octic
    clear = np.abs(octic) > 1e-10 * size
    up, down = (clear & (turned > 0)).any(axis=-1), (clear & (turned < 0)).any(axis=-1)
    good &= ~(up & down) | (meeting > 0)
    with np.errstate(invalid="ignore"):
        off = np.abs(principal(angles[:, None, :, 0] - expected[..., None]))
        missing = ~(off <= EXPECTED).any(axis=-1) & np.isfinite(expected)
    return good & ~missing.any(axis=-1) | family


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
        roots_there, _, status = kernels.pair_real_roots(octic, size[left], roots)
        done = status == PairRoots.CERTAIN
        tangents[left[done]], certain[left[done]] = roots_there[done], True
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
