"""Legs of a hexapod (6-UPS, Stewart-Gough platform), and the pose of its platform with given legs.

Leg k joins the point B of the base and the point P of the platform, which is at x + R P in base axes. Lengths of legs
have up to forty poses. The one that is found is where the platform comes from a start while its legs grow evenly.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.kinematics.arrays import broadcast_shapes, real_array
from rodgen.kinematics.rotation import matrix_from_rodrigues_vector
from rodgen.views import with_html

__all__ = ["DirectStatus", "Geometry", "by_newton", "direct", "least_singular_value", "legs"]


STAGES, STEPS = 8, 2
"""Parts of the way from the start to the legs, and Newton's steps at the end of each."""
POLISHED = 8
"""Newton's steps at the end of the way. Near a singular pose they halve the distance only."""
CLOSED = 1e-12
"""Error of the legs, over the size of the base, up to which a pose has these legs: some thousand roundings."""
SINGULAR = 1e-6
"""How well legs hold a platform, 1 at best, below which rounding of the legs hides on which side it is."""


class DirectStatus(IntEnum):
    """The result of a search for the pose with given legs.

    CONVERGED: the pose has these legs, and there is no singular pose between the start and it.
    SINGULAR: the pose has these legs, which do not hold the platform there.
    CROSSED: the pose that was found is on the other side of a singular one, and is not given.
    UNREACHABLE: no pose has these legs: two of them differ by more than their joints are apart.
    NOT_CONVERGED: none was found.
    INVALID: a leg is not a positive number.
    """

    CONVERGED = 0
    SINGULAR = 1
    CROSSED = 2
    UNREACHABLE = 3
    NOT_CONVERGED = 4
    INVALID = 5


@with_html
@dataclass(frozen=True)
class Geometry:
    """The joints of a hexapod, in one unit of length.

    Parameters
    ----------
    base, platform : ndarray, shape (6, 3)
        Where the joints of the legs are: on the base in its axes, on the platform in platform axes.
    """

    base: Array
    platform: Array

    @property
    def size(self) -> float:
        """Root mean square distance of the base's joints from their middle."""
        return _radius(self.base)


def legs(position: ArrayLike, rotation: ArrayLike, geometry: Geometry) -> Array:
    """Return the lengths of the legs, (..., 6).

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Where the origin of the platform axes is.
    rotation : array_like, shape (..., 3, 3)
        Rotation matrix of the platform.
    geometry : Geometry

    Raises
    ------
    RodgenError
        For arrays of other shapes.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import hexapod
    >>> at = np.radians([0, 60, 120, 180, 240, 300])
    >>> ring = np.stack([np.cos(at), np.sin(at), 0 * at], axis=1)
    >>> machine = hexapod.Geometry(2 * ring, np.roll(ring, 1, axis=0))
    >>> hexapod.legs([0, 0, 1], np.eye(3), machine)
    array([2., 2., 2., 2., 2., 2.])
    """
    place, turn = real_array("position", position, (3,)), real_array("rotation", rotation, (3, 3))
    broadcast_shapes({"position": (place, 1), "rotation": (turn, 2)})
    return np.asarray(np.linalg.norm(_vectors(place, turn, geometry)[0], axis=-1))


def least_singular_value(position: Array, rotation: Array, geometry: Geometry) -> Array:
    """Return the least singular value, (...), of the derivative of the legs: 0 in a singular pose.

    The platform turns about the middle of its joints; a radian counts as a way of their root mean square distance from
    there.
    """
    d, arms = _vectors(position, rotation, geometry)
    arms = (arms - arms.mean(axis=-2, keepdims=True)) / _radius(geometry.platform)
    along = d / np.linalg.norm(d, axis=-1, keepdims=True)
    slopes = np.concatenate([along, np.cross(arms, along)], axis=-1)
    good = np.isfinite(slopes).all(axis=(-2, -1))
    gains = np.linalg.svd(np.where(good[..., None, None], slopes, 0.0), compute_uv=False)
    return np.asarray(np.where(good, gains[..., -1], np.nan))


def direct(
    lengths: ArrayLike, geometry: Geometry, position: ArrayLike, rotation: ArrayLike | None = None
) -> tuple[Any, Any, Any]:
    """Return the pose with given legs that the platform comes to from a start.

    Parameters
    ----------
    lengths : array_like, shape (..., 6)
    geometry : Geometry
    position : array_like, shape (3,) or (..., 3)
        Where the start is: a pose that is not singular, such as the ideal one or the one before.
    rotation : array_like, shape (3, 3) or (..., 3, 3), optional
        Rotation matrix of the start; left out: platform and base have the same axes.

    Returns
    -------
    position : ndarray, shape (..., 3)
    rotation : ndarray, shape (..., 3, 3)
        NaN where the status is neither CONVERGED nor SINGULAR. The legs of a pose differ from those given by at most
        1e-12 of the size of the base.
    status : ndarray of int8, shape (...)
        Codes of :class:`DirectStatus`.

    Raises
    ------
    RodgenError
        For arrays of other shapes.
    """
    wanted, place = real_array("lengths", lengths, (6,)), real_array("position", position, (3,))
    start = np.eye(3) if rotation is None else real_array("rotation", rotation, (3, 3))
    rows = broadcast_shapes({"lengths": (wanted, 1), "position": (place, 1), "rotation": (start, 2)})
    wanted = np.broadcast_to(wanted, (*rows, 6))
    x = np.array(np.broadcast_to(place, (*rows, 3)))
    turn = np.array(np.broadcast_to(start, (*rows, 3, 3)))
    begin = legs(x, turn, geometry)
    side = np.sign(_determinant(x, turn, geometry))
    with np.errstate(all="ignore"):
        for part in [k / STAGES for k in range(1, STAGES + 1) for _ in range(STEPS)] + [1.0] * POLISHED:
            x, turn = _nearer(x, turn, begin + part * (wanted - begin), geometry)
        off = np.abs(legs(x, turn, geometry) - wanted).max(axis=-1)
        closes = off <= CLOSED * geometry.size
        held = least_singular_value(x, turn, geometry)
        crossed = np.sign(_determinant(x, turn, geometry)) != side
        status = np.select(
            [
                ~(np.isfinite(wanted) & (wanted > 0)).all(axis=-1),
                closes & (held < SINGULAR),
                closes & crossed,
                closes,
                _too_different(wanted, geometry),
            ],
            [
                DirectStatus.INVALID,
                DirectStatus.SINGULAR,
                DirectStatus.CROSSED,
                DirectStatus.CONVERGED,
                DirectStatus.UNREACHABLE,
            ],
            DirectStatus.NOT_CONVERGED,
        ).astype(np.int8)
    none = status > DirectStatus.SINGULAR
    return np.where(none[..., None], np.nan, x), np.where(none[..., None, None], np.nan, turn), status


def by_newton(lengths: Array, geometry: Geometry, position: ArrayLike, steps: int) -> tuple[Array, Array]:
    """Return the poses, (n, 3) and (n, 3, 3), after Newton's steps from a position with parallel axes, unchecked.

    Parameters
    ----------
    lengths : ndarray, shape (n, 6)
    geometry : Geometry
    position : array_like, shape (3,)
    steps : int
    """
    x = np.array(np.broadcast_to(np.asarray(position, float), (len(lengths), 3)))
    turn = np.array(np.broadcast_to(np.eye(3), (len(lengths), 3, 3)))
    with np.errstate(all="ignore"):
        for _ in range(steps):
            x, turn = _nearer(x, turn, lengths, geometry)
    return x, turn


def _radius(points: Array) -> float:
    return float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


def _vectors(x: Array, turn: Array, geometry: Geometry) -> tuple[Array, Array]:
    """Return the legs as vectors from base to platform, and the arms R P, each (..., 6, 3)."""
    arms = np.einsum("...ij,kj->...ki", turn, geometry.platform)
    return x[..., None, :] + arms - geometry.base, arms


def _slopes(x: Array, turn: Array, geometry: Geometry) -> tuple[Array, Array]:
    """Return the legs as vectors, and the derivative (..., 6, 6) of half their squares by ways and turns times size."""
    d, arms = _vectors(x, turn, geometry)
    return d, np.concatenate([d, np.cross(arms, d) / geometry.size], axis=-1)


def _determinant(x: Array, turn: Array, geometry: Geometry) -> Array:
    return np.asarray(np.linalg.det(_slopes(x, turn, geometry)[1] / geometry.size))


def _nearer(x: Array, turn: Array, wanted: Array, geometry: Geometry) -> tuple[Array, Array]:
    """Return the pose after one of Newton's steps."""
    d, slopes = _slopes(x, turn, geometry)
    slopes = np.where((np.linalg.det(slopes / geometry.size) == 0)[..., None, None], np.nan, slopes)
    gap = (np.sum(d**2, axis=-1) - wanted**2) / 2
    step = -np.linalg.solve(slopes, gap[..., None])[..., 0]
    by, _ = matrix_from_rodrigues_vector(step[..., 3:] / geometry.size)
    return x + step[..., :3], by @ turn


def _too_different(wanted: Array, geometry: Geometry) -> NDArray[np.bool_]:
    """Return where two legs differ by more than their joints are apart on base and platform together."""
    apart = sum(np.linalg.norm(p[:, None] - p, axis=-1) for p in (geometry.base, geometry.platform))
    differ = np.abs(wanted[..., :, None] - wanted[..., None, :])
    return np.asarray((differ > apart * (1 + CLOSED)).any(axis=(-2, -1)))
