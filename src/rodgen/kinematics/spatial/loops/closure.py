"""The closure error of a loop of rotary joints and links, and Newton's method on it.

The loop is Rz(theta_1) G_1 ... Rz(theta_m) G_m = 1 with G_k = (R_k, v_k + sum of S_i d_i). The error is a small
rotation and a vector; its derivative has the joints' screws as columns. Solutions come from elimination, which loses
digits; a few steps of Newton's method on the six equations themselves bring them back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rodgen.array_types import Array
from rodgen.kinematics.spatial.links.merged import Link
from rodgen.kinematics.spatial.links.transforms import rz

STEPS = 4
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
    found: Array = np.einsum("...ij,...j->...i", R, v)
    return found


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
    found: Array = -_apply(inverse, np.where(good[..., None], rest, np.nan))
    return found


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
    steps: int = STEPS,
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
