"""Bounds of a Tricept's covariance matrix U_y over a box, and the largest cube in which a Tricept works.

The paper bounds the influence of each base matrix (one element of U_x) over the box and adds the intervals up. That
encloses the range and is wider, because the influences do not take their extremes at one place. This module computes
both: each element's range itself, and the sum of the influences' ranges; both certified from above by intervals with
branch and bound, and reached from below by points.

The largest edge of an axis-aligned cube, about a given centre, on the axis of the machine, or anywhere, in which all
rods are within their limits, is wanted. Cubes about one centre are nested, so the edge is found by bisection; a rod is
not always shortest in a corner (the rod A is in the middle of an edge), so the result is certified with intervals.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.tricept._geometry import Geometry
from rodgen.kinematics.tricept._intervals import (
    Extremes,
    Jet,
    certified_extremes,
    enclose,
    halved,
    lattice,
)
from rodgen.kinematics.tricept._kinematics import behind
from rodgen.kinematics.tricept._uncertainty import check_covariance
from rodgen.views import with_html

Indices = NDArray[np.int64]

ELEMENTS = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
"""The six elements of U_y, by name."""


@with_html
@dataclass(frozen=True)
class Bounds:
    """Bounds of the six elements of U_y over a box, in the order of ``ELEMENTS``.

    Attributes
    ----------
    low, high : ndarray, shape (3,)
        The box.
    outer : ndarray, shape (6, 2)
        The range, certified: no value is below the first or above the second.
    inner : ndarray, shape (6, 2)
        Least and greatest value that a point of the box reaches.
    points : ndarray, shape (6, 2, 3)
        These points.
    base_outer : ndarray, shape (6, 2)
        The paper's way: sums of the least and greatest influences of the base matrices; an enclosure, certified.
    base_inner : ndarray, shape (6, 2)
        The same sums of influences that points reach: how near `base_outer` is to what the paper's way gives exactly.
    boxes : int
        How many boxes were looked at.
    complete : bool
        Whether the wanted gap was reached everywhere; if not, the bounds are right and wider.
    """

    low: Array
    high: Array
    outer: Array
    inner: Array
    points: Array
    base_outer: Array
    base_inner: Array
    boxes: int
    complete: bool

    @property
    def gap(self) -> Array:
        """Differences (6, 2) of certified and reached values."""
        return np.abs(self.outer - self.inner)

    @property
    def excess(self) -> Array:
        """Ratios (6,) of the widths of the paper's intervals and of the range: lower bounds, by certified numbers."""
        return np.diff(self.base_inner, axis=1)[:, 0] / np.diff(self.outer, axis=1)[:, 0]


def _box(low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
    corners = real_array("low", low), real_array("high", high)
    for name, corner in zip(("low", "high"), corners, strict=True):
        if corner.shape != (3,):
            raise RodgenError(f"{name} has the shape {corner.shape}; expected three coordinates")
    if not np.isfinite(corners).all():
        raise RodgenError("a box has two corners of three finite coordinates")
    if (corners[0] > corners[1]).any():
        raise RodgenError(f"the box goes from {corners[0]} to {corners[1]}; expected its lower corner first")
    return corners


def bounds(
    low: ArrayLike, high: ArrayLike, geometry: Geometry, U_x: ArrayLike, *, gap: float = 1e-3
) -> Bounds:
    """Return bounds of the elements of U_y over a box, exact ones and the paper's.

    Parameters
    ----------
    low, high : array_like (3,)
        Opposite corners of the box in which the point Q is; all its points must have a pose of the assembled machine.
    geometry : Geometry
        The machine.
    U_x : array_like (5, 5)
        Covariance of A0, A1, A-1, r, R.
    gap : float, optional
        How far certified and reached values may differ, relative to the greatest magnitude of the element.

    Returns
    -------
    Bounds

    Raises
    ------
    RodgenError
        When the corners make no box, U_x is not a covariance matrix, the gap is not positive, or the box reaches where
        the pose or A35 is not determined, or where the assembled machine has no pose.

    Notes
    -----
    Kureková et al., sec. 4 and eq. (24); that the paper's sums enclose and are no ranges is shown in the derivation
    ``tricept_uncertainty``. The rods' limits play no part: see `rod_bounds`.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import tricept
    >>> U_x = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
    >>> found = tricept.bounds([-80, -80, 605], [80, 80, 765], tricept.PAPER, U_x)
    >>> (found.outer[2] * 1e6).round(2), (found.base_outer[2] * 1e6).round(2)  # u²(Qz) in µm²
    (array([6.8 , 9.64]), array([ 3.79, 13.85]))
    """
    low, high = _box(low, high)
    if not 0 < gap < np.inf:
        raise RodgenError(f"gap is {gap}; expected a positive number, such as 1e-3")
    U = check_covariance(U_x, 5)
    _check_regular(low, high, geometry)
    points = lattice(low, high)
    if np.any(behind(points.T, geometry)):
        raise RodgenError("a part of the box is behind the base; expected a box before the base")
    pairs = np.array(list(ELEMENTS.values()))
    base = np.argwhere(np.triu(U) != 0) if U.any() else np.zeros((1, 2), int)
    weights = U[*base.T]
    members = np.concatenate(np.broadcast_arrays(pairs[:, None], base), axis=-1)  # (6, number of bases, 4)
    sample = enclose(points, points, geometry, False).A.value[0]
    scale = np.abs(np.einsum("kin,ij,mjn->kmn", sample, U, sample)[*pairs.T]).max(axis=1)

    def influences(lower: Array, upper: Array, slopes: bool, which: Indices | None = None) -> Jet:
        each = members.reshape(-1, 4)
        chosen = each.T[..., None] if which is None else each[which].T
        return _influence(enclose(lower, upper, geometry, slopes).A, *chosen)

    def elements(lower: Array, upper: Array, slopes: bool, which: Indices | None = None) -> Jet:
        chosen = np.moveaxis(members, -1, 0)[..., None] if which is None else members[which].T
        parts = _influence(enclose(lower, upper, geometry, slopes).A, *chosen) * Jet((weights[:, None],) * 2)
        return reduce(add, (parts[..., n, :] for n in range(len(base))))

    extremes = certified_extremes(elements, low, high, gap=gap * scale, parts=_parts(low, high))
    base_outer, base_inner = np.zeros((6, 2)), np.zeros((6, 2))
    boxes, complete = extremes.boxes, extremes.complete
    if U.any():
        allowed = (gap * scale)[:, None] / (len(base) * np.abs(weights))
        each = certified_extremes(influences, low, high, gap=allowed.ravel(), parts=_parts(low, high))
        base_outer, base_inner = (
            _weighted(ends.reshape(6, len(base), 2), weights, away)
            for ends, away in ((each.outer, True), (each.inner, False))
        )
        boxes, complete = boxes + each.boxes, complete and each.complete
    return Bounds(
        low, high, extremes.outer, extremes.inner, extremes.points, base_outer, base_inner, boxes, complete
    )


def rod_bounds(low: ArrayLike, high: ArrayLike, geometry: Geometry, *, gap: float = 1e-6) -> Extremes:
    """Return bounds of the lengths of the three rods while the point is anywhere in a box.

    Parameters
    ----------
    low, high : array_like (3,)
        Opposite corners of the box.
    geometry : Geometry
        The machine.
    gap : float, optional
        How far certified and reached lengths may differ, in the unit of length.

    Returns
    -------
    Extremes
        ``outer`` (3, 2): no rod is shorter than the first, or longer than the second; ``inner`` and ``points``: what is
        reached, and where.

    Raises
    ------
    RodgenError
        When the corners make no box, or it reaches where the pose is not determined.

    Examples
    --------
    >>> from rodgen import tricept
    >>> tricept.rod_bounds([-80, -80, 605], [80, 80, 765], tricept.PAPER).outer.round(2)
    array([[597.09, 829.11],
           [586.74, 840.94],
           [586.74, 840.94]])
    """
    low, high = _box(low, high)
    _check_regular(low, high, geometry)

    def rods(lower: Array, upper: Array, slopes: bool, which: Indices | None = None) -> Jet:
        enclosed = enclose(lower, upper, geometry, slopes).rods
        return enclosed if which is None else enclosed[which, np.arange(len(which))]

    return certified_extremes(rods, low, high, gap=np.full(3, float(gap)), parts=_parts(low, high))


def _parts(low: Array, high: Array) -> int:
    """Return the number of parts of each side: of a sixty-fourth of the distance, where derivatives become useful."""
    away = float(np.linalg.norm((low + high) / 2))
    return int(np.clip(np.ceil(64 * (high - low).max() / max(away, 1e-300)), 1, 16))


def _influence(A: Jet, k: Indices, m: Indices, i: Indices, j: Indices) -> Jet:
    """Return an enclosure of the influence A E Aᵀ of the base matrix (i, j) on element (k, m), in each of n boxes.

    The last axis of the numbers is of n elements, or of one.
    """
    n = np.arange(A.value[0].shape[-1])
    one = A[k, i, n] * A[m, j, n]
    # the square of one number is never negative, and the two products of a base off the diagonal may be one
    least = np.where((k == m) & (i == j), np.maximum(one.value[0], 0.0), one.value[0])
    one = Jet((least, one.value[1]), one.slope)
    if (i == j).all():
        return one
    both, alone = one + A[k, j, n] * A[m, i, n], i == j
    value, slope = (
        None if a is None or b is None else tuple(np.where(alone, x, y) for x, y in zip(a, b, strict=True))
        for a, b in ((one.value, both.value), (one.slope, both.slope))
    )
    return Jet(value, slope)  # type: ignore[arg-type]


def _weighted(ends: Array, weights: Array, away: bool) -> Array:
    """Return sums of intervals, rounded outwards (`away`) or as they are."""
    products = ends * weights[None, :, None]
    products.sort(axis=-1)
    total: Array = products.sum(axis=1)
    if away:  # one rounding for a product, one for each sum
        room = (len(weights) + 1) * 2.0**-52 * np.abs(products).sum(axis=1)
        total = total + room * [-1.0, 1.0]
    return total


def _check_regular(low: Array, high: Array, geometry: Geometry) -> None:
    """Raise an error for boxes in which A35 is not bounded: they reach a singularity or a place without a pose."""
    lower, upper = (corner[:, None] for corner in (low, high))
    for _ in range(6):
        enclosed = enclose(lower, upper, geometry, False)
        bad = ~np.isfinite(enclosed.A.value).all(axis=(0, 1, 2))
        if not bad.any():
            return
        lower, upper = lower[:, bad], upper[:, bad]
        for side in range(3):
            lower, upper = halved(lower, upper, side)
    raise RodgenError(
        "the box reaches a place where the machine has no pose, or no determined one; expected a box before the base"
    )
