"""Search for solutions of loops that elimination cannot solve, because axes are parallel or meet.

The equations vanish there or have common factors. Two questions remain. Is a solution whose derivative is singular the
meeting point of two, or one of a family? It is one of a family when the loop closes again at a distance along the free
direction. And is there a family, or a solution, that no equation shows? Newton's method from a number of fixed starting
points finds it; it cannot prove that there is none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.kinematics.angles import apart
from rodgen.kinematics.spatial.links.merged import Link
from rodgen.kinematics.spatial.loops.closure import closure, offsets, polish

STEP = 1e-2
"""How far along the free direction: two solutions that meet come back to their meeting point from there by halves."""
STEPS = 14
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
    moved_theta, moved_slides, error, _ = polish(links, *ahead, size, steps=STEPS)
    away = np.concatenate([moved_theta - theta, (moved_slides - slides) / size[..., None]], axis=-1)
    found: NDArray[np.bool_] = (error <= closes) & (np.abs(away).max(axis=-1) > STEP / 8)
    return found


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
    found: NDArray[np.bool_] = (np.maximum(turn, shift) > SAME).all(axis=1)
    return found


def repeated(theta: Array, slides: Array, size: Array, singular: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which solutions (count, N) are the same as one in a slot before; singular ones are less certain."""
    turn = apart(theta[:, :, None], theta[:, None])
    shift = np.abs(slides[:, :, None] - slides[:, None]).max(axis=-1) / size[:, None, None]
    same = np.maximum(turn, shift) <= np.where(singular[:, :, None] & singular[:, None], SAME, EQUAL)
    found: NDArray[np.bool_] = np.tril(same, -1).any(axis=-1)
    return found
