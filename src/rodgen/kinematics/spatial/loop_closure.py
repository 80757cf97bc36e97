"""All ways to close a loop with three or four unknown angles, the rest of the six unknowns being slides.

Three angles (group 1): the rotation closes by itself. With Rz(t1) R1 Rz(t2) R2 Rz(t3) R3 = 1 the angle between the axes
3 and 1, which R3 keeps, gives A cos t2 + B sin t2 + D = 0; the other angles and the slides are linear.

Four angles (group 2): the angle between the axes 4 and 1 is an equation in t2 and t3, and the projection of the vector
loop across both slides is the second. Both are bilinear in 1, cos, sin of t2 and t3, whatever the order of the joints,
wherever the first holds: proved in the derivation ``spatial_loops``, whose kernels compute the coefficients.

Elimination loses digits; a few steps of Newton's method on the six equations themselves bring them back. The loop is
Rz(theta_1) G_1 ... Rz(theta_m) G_m = 1 with G_k = (R_k, v_k + sum of S_i d_i). The error is a small rotation and a
vector; its derivative has the joints' screws as columns.

Where axes are parallel or meet, elimination fails: the equations vanish or have common factors. Two questions remain.
Is a solution whose derivative is singular the meeting point of two, or one of a family? It is one of a family when the
loop closes again at a distance along the free direction. And is there a family, or a solution, that no equation shows?
Newton's method from a number of fixed starting points finds it; it cannot prove that there is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.generated.numpy.trig_equation import TrigStatus
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.numerics import angle_between, apart
from rodgen.kinematics.spatial.mechanism import Link, Mechanism, Merged
from rodgen.kinematics.spatial.pair_equations import solve_pair, solve_trig
from rodgen.kinematics.spatial.status import ReverseStatus
from rodgen.kinematics.spatial.transforms import rz

NEWTON_STEPS = 4
"""Newton steps: the error is squared by each, and elimination leaves half of the digits at least, except where two
solutions meet; there each step halves the error, and the rest is lost to the conditioning anyway."""
RANK = 1e-11
"""Singular values below this share of the largest are taken for zero: no step goes along a family of solutions."""


def _chain(links: Sequence[Link], theta: Array) -> tuple[Array, list[Array], list[Array]]:
    """Return the rotation of the whole loop, the rotation before each link (after its joint), and each link's axis."""
    R = np.broadcast_to(np.eye(3), (*theta.shape[:-1], 3, 3))
    before, axes = [], []
    for k, link in enumerate(links):
        axes.append(R[..., 2])
        R = R @ rz(theta[..., k])
        before.append(R)
        R = R @ link.R
    return R, before, axes


def _apply(R: Array, v: Array) -> Array:
    turned: Array = np.einsum("...ij,...j->...i", R, v)
    return turned


def offsets(links: Sequence[Link], theta: Array) -> Array:
    """Return the slides (..., number of them), in the order of the links, that close the vector loop best."""
    _, before, _ = _chain(links, theta)
    columns, rest = [], np.zeros((*theta.shape[:-1], 3))
    for R, link in zip(before, links, strict=True):
        rest = rest + _apply(R, link.v)
        columns += [_apply(R, direction) for _, direction in link.slides]
    directions = np.stack(np.broadcast_arrays(*columns), axis=-1)
    good = np.isfinite(directions).all(axis=(-1, -2)) & np.isfinite(rest).all(axis=-1)
    directions = np.where(good[..., None, None], directions, 0.0)
    inverse = np.linalg.pinv(directions, rcond=RANK)
    shifts: Array = -_apply(inverse, np.where(good[..., None], rest, np.nan))
    return shifts


def closure(links: Sequence[Link], theta: Array, slides: Array) -> tuple[Array, Array, Array]:
    """Return the closure error, a rotation vector (..., 3) and a vector (..., 3), and its derivative (..., 6, 6)."""
    R, before, axes = _chain(links, theta)
    p = np.zeros((*theta.shape[:-1], 3))
    points, columns = [], []
    number = 0
    for R_k, link in zip(before, links, strict=True):
        points.append(p)
        vector = link.v
        for _, direction in link.slides:
            vector = vector + slides[..., number, None] * direction
            columns.append(_apply(R_k, direction))
            number += 1
        p = p + _apply(R_k, vector)
    skew = R - np.swapaxes(R, -1, -2)
    turn = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1) / 2
    # a rotation by nearly pi has a small skew part, too, and is no closure
    far = np.trace(R, axis1=-2, axis2=-1) < 1.0
    turn = np.where(far[..., None], turn + 2.0, turn)
    angular = np.stack(np.broadcast_arrays(*axes, *(np.zeros_like(c) for c in columns)), axis=-1)
    moments = [np.cross(axis, p - point) for axis, point in zip(axes, points, strict=True)]
    linear = np.stack(np.broadcast_arrays(*moments, *columns), axis=-1)
    return turn, p, np.concatenate([angular, linear], axis=-2)


def polish(
    links: Sequence[Link],
    theta: Array,
    slides: Array,
    size: Array,
    steps: int = NEWTON_STEPS,
    longest: float = np.inf,
) -> tuple[Array, Array, Array, Array]:
    """Return angles and slides improved by Newton's method, their closure error, and how regular they are.

    Lengths are measured in `size`. The error (...) is the larger of the rotation in rad and of the vector; the last
    result (...) is the smallest singular value of the derivative over the largest. The best of all steps is kept, so
    that a step that makes it worse does no harm.
    """
    m = len(links)
    best = np.full(theta.shape[:-1], np.inf)
    smallest = np.zeros(theta.shape[:-1])
    current, along = theta, slides
    for step in range(steps + 1):
        turn, p, J = closure(links, current, along)
        scaled = np.concatenate([turn, p / size[..., None]], axis=-1)
        error = np.abs(scaled).max(axis=-1)
        better = error < best
        theta = np.where(better[..., None], current, theta)
        slides = np.where(better[..., None], along, slides)
        best = np.where(better, error, best)
        J = J.copy()
        J[..., 3:, :] /= size[..., None, None]
        J[..., :, m:] *= size[..., None, None]
        good = np.isfinite(J).all(axis=(-1, -2)) & np.isfinite(scaled).all(axis=-1)
        J = np.where(good[..., None, None], J, 0.0)
        values = np.linalg.svd(J, compute_uv=False)
        ratio = values[..., -1] / np.where(values[..., 0] > 0, values[..., 0], 1.0)
        smallest = np.where(better, ratio, smallest)
        if step == steps or not good.any():
            break
        left: Array = np.where(good[..., None], scaled, 0.0)
        change: Array = np.einsum("...ij,...j->...i", -np.linalg.pinv(J, rcond=RANK), left)
        change = (
            change * np.minimum(1.0, longest / np.maximum(np.abs(change).max(axis=-1), 1e-300))[..., None]
        )
        current = current + change[..., :m]
        along = along + change[..., m:] * size[..., None]
    return theta, slides, best, smallest


STEP = 1e-2
"""How far along the free direction: two solutions that meet come back to their meeting point from there by halves."""
SEARCH_STEPS = 14
STARTS = 64
LONG_WAY = 30
"""Newton steps from a starting point; more than enough where it converges at all."""
SAME = 1e-5
"""Distance, in rad and in the loop's size, below which two singular solutions are one."""
EQUAL = 1e-9
"""The same for others: two that Newton's method has brought to one point."""


def moves(
    links: Sequence[Link], theta: Array, slides: Array, size: Array, closes: float
) -> NDArray[np.bool_]:
    """Return which solutions (..., m) with a singular derivative can be moved."""
    m = len(links)
    _, _, J = closure(links, theta, slides)
    J = J.copy()
    J[..., 3:, :] /= size[..., None, None]
    J[..., :, m:] *= size[..., None, None]
    free = np.linalg.svd(J)[2][..., -1, :]
    ahead = theta + STEP * free[..., :m], slides + STEP * free[..., m:] * size[..., None]
    moved_theta, moved_slides, error, _ = polish(links, *ahead, size, steps=SEARCH_STEPS)
    away = np.concatenate([moved_theta - theta, (moved_slides - slides) / size[..., None]], axis=-1)
    is_moving: NDArray[np.bool_] = (error <= closes) & (np.abs(away).max(axis=-1) > STEP / 8)
    return is_moving


def search(
    links: Sequence[Link], size: Array, closes: float
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Return what Newton's method finds for loops (count, ...) from STARTS points each.

    These are angles (count, STARTS, m), slides, the relative smallest singular value of the derivative, and which
    close the loop.
    """
    m, count = len(links), len(size)
    rng = np.random.default_rng(0)
    theta = np.broadcast_to(rng.uniform(-np.pi, np.pi, (STARTS, m)), (count, STARTS, m))
    wide = [link.each(lambda x: x[:, None]) for link in links]
    sizes = np.broadcast_to(size[:, None], (count, STARTS))
    theta, slides, _, _ = polish(wide, theta, offsets(wide, theta), sizes, steps=LONG_WAY, longest=1.0)
    theta, slides, error, smallest = polish(wide, theta, slides, sizes)
    return theta, slides, smallest, error <= closes


def different(
    theta: Array, slides: Array, size: float, known_theta: Array, known_slides: Array
) -> NDArray[np.bool_]:
    """Return which solutions (k, m) are not among the known ones (l, m)."""
    turn = apart(theta[:, None], known_theta[None])
    shift = np.abs(slides[:, None] - known_slides[None]).max(axis=-1) / size
    is_different: NDArray[np.bool_] = (np.maximum(turn, shift) > SAME).all(axis=1)
    return is_different


def repeated(theta: Array, slides: Array, size: Array, singular: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which solutions (count, N) are the same as one in a slot before; singular ones are less certain."""
    turn = apart(theta[:, :, None], theta[:, None])
    shift = np.abs(slides[:, :, None] - slides[:, None]).max(axis=-1) / size[:, None, None]
    same = np.maximum(turn, shift) <= np.where(singular[:, :, None] & singular[:, None], SAME, EQUAL)
    is_repeated: NDArray[np.bool_] = np.tril(same, -1).any(axis=-1)
    return is_repeated


CLOSES = 1e-11
"""Largest error of a loop that is closed, in rad and in the loop's size. Newton's steps leave a few epsilons."""
FAR = 1e6
"""Slides beyond this multiple of the loop's size are at infinity: rounding would leave it open by 1e-10 of its size."""
MEET = 1e-7
"""Relative smallest singular value of the derivative below which solutions meet: there the rounding of the equations
moves a solution by more than its own distance to the next one."""
ODD = 1e-8
"""Sine of a twist, or share of an equation's coefficients, below which the equation determines nothing."""
NOISE = 2e-15
"""Coefficients of an equation below this, in its natural scale, are the rounding of zero: sums of a few dozen terms."""
LINKS = ("12", "23", "34")
"""Names of a ring's links in the kernels; slides are in the first three."""


def solve_merged(
    mechanism: Mechanism,
    merged: Merged,
    count: int,
    size: Array,
    start: tuple[Array, NDArray[np.bool_], NDArray[np.bool_]] | None = None,
) -> tuple[Array, Array, NDArray[np.int8]]:
    """Return all ways to close `count` loops: angles (count, N, m), slides (count, N, 6 - m), statuses (count, N).

    The links of `merged` have an axis of `count` elements or of one, `size` (count) is the unit of length of each loop,
    and `start` has all angles (count, N, m) from a closed form, which of them are there, and for which loops this is
    certain (count).
    """
    links = [_spread(link, count) for link in merged.links]
    theta, status, odd = _starts(mechanism, merged, links, start)
    wide = [link.each(lambda x: x[:, None]) for link in links]
    with np.errstate(invalid="ignore"):
        slides = offsets(wide, theta)
        for _ in range(2):
            # a slide that is far out makes the loop large, and rounding with it; it may come back in the first round
            sizes = np.fmax(size[:, None], np.abs(slides).max(axis=-1))
            theta, slides, error, smallest = polish(wide, theta, slides, sizes)
        there = status < ReverseStatus.NONE
        closed = there & (error <= CLOSES) & (sizes <= FAR * size[:, None])
    status = np.where(there & ~closed, ReverseStatus.NONE, status)
    for n in map(int, np.flatnonzero(odd)):
        _add_searched(links, n, float(size[n]), theta, slides, status, smallest)
    singular = (status < ReverseStatus.NONE) & (smallest <= MEET)
    with np.errstate(invalid="ignore"):
        again = repeated(
            np.where((status < ReverseStatus.NONE)[..., None], theta, np.nan), slides, size, singular
        )
    status[again] = ReverseStatus.NONE
    element, slot = np.nonzero(singular & (status < ReverseStatus.NONE))
    if len(element):
        parts = [_rows(link, element) for link in links]
        movable = moves(parts, theta[element, slot], slides[element, slot], size[element], CLOSES)
        status[element, slot] = np.where(movable, ReverseStatus.FAMILY, ReverseStatus.DOUBLE)
    return theta, slides, status.astype(np.int8)


def _starts(
    mechanism: Mechanism,
    merged: Merged,
    links: list[Link],
    start: tuple[Array, NDArray[np.bool_], NDArray[np.bool_]] | None,
) -> tuple[Array, NDArray[Any], NDArray[np.bool_]]:
    """Return angles (count, N, m), statuses (count, N), and of which loops the equations may not tell all of them."""

    def general(links: list[Link]) -> tuple[Array, NDArray[Any], NDArray[np.bool_]]:
        return _three_angles(links) if len(links) == 3 else _four_angles(mechanism, merged, links)

    if start is None:
        return general(links)
    theta, there, certain = start
    status, odd = np.where(there, ReverseStatus.REGULAR, ReverseStatus.NONE), np.zeros(len(theta), bool)
    rest = np.flatnonzero(~certain)
    if len(rest):
        theta[rest], status[rest], odd[rest] = general([_rows(link, rest) for link in links])
    return theta, status, odd


def _add_searched(
    links: list[Link],
    n: int,
    size: float,
    theta: Array,
    slides: Array,
    status: NDArray[Any],
    smallest: Array,
) -> None:
    """Fill free slots of a loop for which the equations fail with what a search finds; mark the rest incomplete."""
    rows = np.array([n])
    angles, along, ratio, closes = search([_rows(link, rows) for link in links], np.array([size]), CLOSES)
    free = list(np.flatnonzero(status[n] >= ReverseStatus.NONE))
    some_singular = bool(((status[n] < ReverseStatus.NONE) & (smallest[n] <= MEET)).any())
    for k in np.flatnonzero(closes[0]):
        known = status[n] < ReverseStatus.NONE
        if not free or (some_singular and ratio[0, k] <= MEET):
            continue
        if different(angles[0, k : k + 1], along[0, k : k + 1], size, theta[n, known], slides[n, known])[0]:
            slot = free.pop(0)
            theta[n, slot], slides[n, slot], smallest[n, slot] = angles[0, k], along[0, k], ratio[0, k]
            status[n, slot] = ReverseStatus.REGULAR
            some_singular |= bool(ratio[0, k] <= MEET)
    status[n, free] = ReverseStatus.INCOMPLETE


def _spread(link: Link, count: int) -> Link:
    """Return a link whose arrays have the same first axis."""
    slides = tuple((i, np.broadcast_to(d, (count, 3))) for i, d in link.slides)
    return Link(np.broadcast_to(link.R, (count, 3, 3)), np.broadcast_to(link.v, (count, 3)), slides)


def _three_angles(links: list[Link]) -> tuple[Array, NDArray[Any], NDArray[np.bool_]]:
    R = np.stack([link.R for link in links], axis=1)
    sines = np.hypot(R[:, :, 0, 2], R[:, :, 1, 2])
    # the amplitude of an angle's equation is the product of the sines on both sides of it
    first = np.argmax(sines * np.roll(sines, -1, axis=1), axis=1)
    order = (first[:, None] + np.arange(3)) % 3
    R = np.take_along_axis(R, order[:, :, None, None], axis=1)
    row, column = R[:, 0, 2, :], R[:, 1, :, 2]
    A = row[:, 0] * column[:, 0] + row[:, 1] * column[:, 1]
    B = row[:, 1] * column[:, 0] - row[:, 0] * column[:, 1]
    D = row[:, 2] * column[:, 2] - R[:, 2, 2, 2]
    middle, kind = solve_trig(A, B, D)
    whole = R[:, None, 0] @ rz(middle) @ R[:, None, 1]
    rest = R[:, None, 2]
    start, last = _ends(whole, rest)
    parallel = np.hypot(rest[..., 0, 2], rest[..., 1, 2]) <= 8 * np.finfo(float).eps
    # two parallel axes: only the sum or difference of their angles is determined, and the first one is taken for zero
    both = np.swapaxes(whole, -1, -2) @ np.swapaxes(rest, -1, -2)
    start = np.where(parallel, 0.0, start)
    last = np.where(parallel, np.arctan2(both[..., 1, 0], both[..., 0, 0]), last)
    angles = np.stack([start, middle, last], axis=-1)
    theta = np.full_like(angles, np.nan)
    np.put_along_axis(theta, np.broadcast_to(order[:, None], angles.shape), angles, axis=-1)
    status = np.full(middle.shape, ReverseStatus.NONE)
    status[kind == TrigStatus.TWO] = ReverseStatus.REGULAR
    status[kind == TrigStatus.DOUBLE, 0] = ReverseStatus.DOUBLE
    status[kind == TrigStatus.INVALID] = ReverseStatus.INVALID
    amplitude = np.hypot(A, B)
    possible = np.abs(D) <= amplitude + ODD
    return theta, status, possible & ((amplitude <= ODD) | parallel[:, 0])


def _ends(whole: Array, rest: Array) -> tuple[Array, Array]:
    """Return the first and the last angle with Rz(first) whole Rz(last) rest = 1."""
    first = angle_between(whole[..., 0, 2], whole[..., 1, 2], rest[..., 2, 0], rest[..., 2, 1])
    last = angle_between(rest[..., 0, 2], rest[..., 1, 2], whole[..., 2, 0], whole[..., 2, 1])
    return first, last


def _four_angles(
    mechanism: Mechanism, merged: Merged, links: list[Link]
) -> tuple[Array, NDArray[Any], NDArray[np.bool_]]:
    count = len(links[0].v)
    sines = np.stack([np.hypot(link.R[:, 0, 2], link.R[:, 1, 2]) for link in links], axis=1)
    possible = []
    for last in range(4):
        last_slide = (merged.joints[last], "S")
        if all(mechanism.variables[i] == last_slide for i, _ in links[last].slides):
            possible.append(last)
    worth = np.full(sines.shape, -1.0)
    worth[:, possible] = np.nan_to_num(sines[:, possible])
    chosen = np.argmax(worth, axis=1)
    theta = np.full((count, 8, 4), np.nan)
    status = np.full((count, 8), ReverseStatus.NONE)
    odd = (worth.max(axis=1) <= ODD) & _may_turn(links)
    for last in possible:
        rows = np.flatnonzero(chosen == last)
        if not len(rows):
            continue
        order = [(last + 1 + k) % 4 for k in range(4)]
        ring = [_rows(links[k], rows) for k in order]
        # an axis lies in both of its links, so a slide along the fourth one belongs to the third link as well
        moved = tuple((i, ring[2].R[:, :, 2]) for i, _ in ring[3].slides)
        ring[2] = replace(ring[2], slides=ring[2].slides + moved)
        ring[3] = replace(ring[3], slides=())
        angles, kind, strange = _ring(ring)
        part = np.empty_like(angles)
        part[..., order] = angles
        theta[rows], status[rows] = part, kind
        odd[rows] |= strange
    return theta, status, odd


def _may_turn(links: list[Link]) -> NDArray[np.bool_]:
    """Return whether the rotation may close: no twist of the four links is larger than the other three together."""
    twists = np.stack([np.arctan2(np.hypot(k.R[:, 0, 2], k.R[:, 1, 2]), k.R[:, 2, 2]) for k in links], axis=1)
    total = twists.sum(axis=1)
    is_possible: NDArray[np.bool_] = (2 * twists.max(axis=1) <= total + ODD) & (
        total - 2 * twists.min(axis=1) <= 2 * np.pi + ODD
    )
    return is_possible


def _rows(link: Link, rows: NDArray[np.intp]) -> Link:
    return link.each(lambda x: x[rows])


def _ring(ring: list[Link]) -> tuple[Array, NDArray[Any], NDArray[np.bool_]]:
    """Return the angles of four axes in a ring; the last link has no slide."""
    equations = _pair(ring)
    first = equations[:, 0]
    pair = solve_pair(equations)
    theta2, theta3 = pair.theta1, pair.theta2
    R0, R1, R2, R3 = (link.R[:, None] for link in ring)
    whole = R0 @ rz(theta2) @ R1 @ rz(theta3) @ R2
    theta1, theta4 = _ends(whole, R3)
    there = pair.status <= ReverseStatus.FAMILY
    status = np.where(there, ReverseStatus.REGULAR, ReverseStatus.NONE)
    strange = (pair.status == ReverseStatus.FAMILY) | (pair.status >= ReverseStatus.INCOMPLETE)
    # where the constant outweighs all else there is no solution, whatever the second equation is
    rest = np.abs(first).sum(axis=(1, 2)) - np.abs(first[:, 0, 0])
    possible = np.abs(first[:, 0, 0]) <= rest + ODD
    return np.stack([theta1, theta2, theta3, theta4], axis=-1), status, possible & strange.any(axis=-1)


def _pair(ring: list[Link]) -> Array:
    """Return the coefficients (count, 2, 3, 3) of both equations, from the kernel for the links with the slides."""
    slides = [(link, direction) for link in range(3) for _, direction in ring[link].slides]
    (first, p), (second, q) = slides
    kernel = getattr(kernels, f"loop_pair_{LINKS[first]}_{LINKS[second]}")
    rotations = np.stack([link.R for link in ring], axis=1)
    angles: Array = kernel(rotations, np.stack([link.v for link in ring], axis=1), p, q)
    # the first equation has numbers of order 1, the second lengths of the order of the whole loop
    scale = np.stack([np.ones(len(p)), sum(np.linalg.norm(link.v, axis=-1) for link in ring)], axis=1)
    angles = np.where(np.abs(angles) > NOISE * scale[:, :, None, None], angles, 0.0)
    finite = np.isfinite(angles.reshape(len(angles), 18)).sum(axis=1) == 18
    return np.where(finite[:, None, None, None], angles, 0.0)
