"""Lines and screws: reciprocal products, reciprocal systems, pitch and axis.

A screw is six numbers: direction S and moment S0. A line through the point p along S has S0 = p × S; a screw of pitch h
about it has S0 = p × S + h S; a couple has S = 0. The reciprocal product S · T0 + T · S0 of two screws is the power of
the wrench on the one in the twist on the other. Lengths and directions do not mix well in a rank: rank and basis of a
reciprocal system are those of the moments in the unit of length that is asked for.

Every function works on arrays of any shape, element by element, and broadcasts. The exact counterparts are in
``rodgen.symbolic``.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rodgen.kinematics.arrays import real_array
from rodgen.views import with_html

__all__ = [
    "ReciprocalSystem",
    "ScrewAxis",
    "ScrewStatus",
    "line_along",
    "line_of_planes",
    "line_through",
    "reciprocal_product",
    "reciprocal_system",
    "screw_axis",
    "transform",
]


class ScrewStatus(IntEnum):
    """The kind of a screw.

    SCREW: a screw of finite pitch that is not zero.
    LINE: a line: its pitch is zero to rounding.
    COUPLE: no direction, to rounding, but a moment: a couple or a translation, of infinite pitch.
    ZERO: all six numbers are zero.
    INVALID: a number is NaN or infinite.
    """

    SCREW = 0
    LINE = 1
    COUPLE = 2
    ZERO = 3
    INVALID = 4


@with_html
class ScrewAxis(NamedTuple):
    """Axis and pitch of screws, of :func:`screw_axis`."""

    direction: Any
    point: Any
    pitch: Any
    status: Any


@with_html
class ReciprocalSystem(NamedTuple):
    """Rank of given screws, and the screws reciprocal to all of them, of :func:`reciprocal_system`."""

    rank: Any
    basis: Any
    margin: Any


def line_through(a: ArrayLike, b: ArrayLike) -> Any:
    """Return the line through two points, from the first to the second.

    Parameters
    ----------
    a, b : array_like (..., 3)
        Points, in one length unit.

    Returns
    -------
    array (..., 6)
        (b - a; a × b): as long as the points are apart, zero where they coincide.

    Examples
    --------
    >>> from rodgen.kinematics.screws import line_through
    >>> line_through([0.0, 1.0, 0.0], [2.0, 1.0, 0.0])
    array([ 2.,  0.,  0.,  0.,  0., -2.])
    """
    start = real_array("a", a, (3,))
    direction = real_array("b", b, (3,)) - start
    # a × (b - a), not a × b: near points far from the origin keep their digits
    return _joined(direction, np.cross(start, direction))


def line_along(point: ArrayLike, direction: ArrayLike, pitch: ArrayLike = 0.0) -> Any:
    """Return the line, or the screw of a pitch, through a point along a direction.

    Parameters
    ----------
    point, direction : array_like (..., 3)
        Point, and direction of any length.
    pitch : array_like (...), optional
        Pitch, in the length unit of the point; 0 is a line.

    Returns
    -------
    array (..., 6)
        (S; p × S + h S).

    Examples
    --------
    >>> from rodgen.kinematics.screws import line_along
    >>> line_along([0.0, 0.0, 2.0], [1.0, 0.0, 0.0], 0.5)
    array([1. , 0. , 0. , 0.5, 2. , 0. ])
    """
    along = real_array("direction", direction, (3,))
    moment = np.cross(real_array("point", point, (3,)), along)
    return _joined(along, moment + np.asarray(pitch, float)[..., None] * along)


def line_of_planes(
    normal: ArrayLike, distance: ArrayLike, other_normal: ArrayLike, other_distance: ArrayLike
) -> Any:
    """Return the line in which the planes n · x = d and m · x = e meet.

    Parameters
    ----------
    normal, other_normal : array_like (..., 3)
        n and m, of any length.
    distance, other_distance : array_like (...)
        d and e.

    Returns
    -------
    array (..., 6)
        (n × m; e n - d m): a couple where the planes are parallel, zero where they coincide (and n = m).

    Examples
    --------
    >>> from rodgen.kinematics.screws import line_of_planes
    >>> line_of_planes([0.0, 0.0, 1.0], 0.0, [1.0, 0.0, 0.0], 3.0)  # z = 0 and x = 3
    array([0., 1., 0., 0., 0., 3.])
    """
    n, m = real_array("normal", normal, (3,)), real_array("other_normal", other_normal, (3,))
    d, e = np.asarray(distance, float)[..., None], np.asarray(other_distance, float)[..., None]
    return _joined(np.cross(n, m), e * n - d * m)


def reciprocal_product(a: ArrayLike, b: ArrayLike) -> Any:
    """Return S · T0 + T · S0 of two screws.

    Parameters
    ----------
    a, b : array_like (..., 6)
        Screws.

    Returns
    -------
    array (...)
        Zero for two lines that meet or are parallel.

    Examples
    --------
    >>> from rodgen.kinematics.screws import line_along, reciprocal_product
    >>> x = line_along([0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    >>> float(reciprocal_product(x, line_along([0.0, 0.0, 5.0], [0.0, 1.0, 0.0])))
    -5.0
    """
    s, t = real_array("a", a, (6,)), real_array("b", b, (6,))
    return np.einsum("...i,...i", s[..., :3], t[..., 3:]) + np.einsum("...i,...i", s[..., 3:], t[..., :3])


def transform(rotation: ArrayLike, origin: ArrayLike) -> Any:
    """Return the 6x6 matrix that writes a moved frame's screws in the fixed frame: [[R, 0], [p^ R, R]].

    Parameters
    ----------
    rotation : array_like (..., 3, 3)
        R: the moved frame's axes are its columns.
    origin : array_like (..., 3)
        p, the moved frame's origin.

    Returns
    -------
    array (..., 6, 6)
        T, with Tᵀ Δ T = Δ: reciprocal products stay.

    Notes
    -----
    Zhou and Zhu, "A Decoupling Method for Successive Robot Rotation Based on Time Domain Instantaneous Euler Angle",
    eq. (5), whose explicit matrix has another lower right block.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen.kinematics.screws import line_along, transform
    >>> T = transform(np.eye(3), [0.0, 0.0, 2.0])
    >>> T @ line_along([0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    array([1., 0., 0., 0., 2., 0.])
    """
    turned = real_array("rotation", rotation, (3, 3))
    at = real_array("origin", origin, (3,))
    matrix = np.zeros((*np.broadcast_shapes(turned.shape[:-2], at.shape[:-1]), 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = turned
    # column by column: p^ R e_i = p × (R e_i)
    matrix[..., 3:, :3] = np.swapaxes(np.cross(at[..., None, :], np.swapaxes(turned, -1, -2)), -1, -2)
    return matrix


def screw_axis(screw: ArrayLike, *, length: float = 1.0) -> ScrewAxis:
    """Return direction, nearest point to the origin, and pitch of screws.

    Parameters
    ----------
    screw : array_like (..., 6)
        Screws of any size.
    length : float, optional
        Unit of length for deciding whether a direction or a pitch is mere rounding: a direction counts as none
        below 8 times the machine epsilon of ``|S0| / length``, and a pitch as zero below 8 times the machine
        epsilon of ``|S0| / |S|`` and of `length`.

    Returns
    -------
    ScrewAxis
        direction (..., 3), unit; of a couple that of its moment. point (..., 3) of the axis, nearest the origin. pitch
        (...), signed, infinite for couples. status (...) int8, codes of :class:`ScrewStatus`. NaN where there is none:
        the point of a couple, and everything of ZERO and INVALID.

    Examples
    --------
    >>> from rodgen.kinematics.screws import line_along, screw_axis
    >>> axis = screw_axis(line_along([1.0, 0.0, 2.0], [0.0, 3.0, 0.0], 0.25))
    >>> axis.direction, axis.point + 0.0, float(axis.pitch)
    (array([0., 1., 0.]), array([1., 0., 2.]), 0.25)
    """
    if not 0 < length < np.inf:
        raise ValueError(f"length is {length}; expected a positive number")
    screw_array = real_array("screw", screw, (6,))
    finite: Any = np.isfinite(screw_array).all(axis=-1)
    size = np.where(finite, np.abs(screw_array).max(axis=-1), 1.0)
    # scaled, so that no square overflows or vanishes
    scaled = np.where(finite[..., None], screw_array, 0.0) / np.where(size > 0, size, 1.0)[..., None]
    direction, moment = scaled[..., :3], scaled[..., 3:]
    across, along = np.linalg.norm(direction, axis=-1), np.linalg.norm(moment, axis=-1)
    rounding = 8 * np.finfo(float).eps
    empty = finite & (size == 0)
    is_couple = finite & ~empty & (across <= rounding * along / length)
    has_axis = finite & ~empty & ~is_couple
    unit = np.where(is_couple[..., None], moment, direction)
    unit = unit / np.where(is_couple, along, np.where(has_axis, across, 1.0))[..., None]
    divisor = np.where(has_axis, across, 1.0)
    pitch = np.einsum("...i,...i", unit, moment) / divisor
    point = np.cross(unit, moment) / divisor[..., None]
    # the moment of a line carries rounding of its own size, and p × S cancels against p
    is_line = has_axis & (np.abs(pitch) <= rounding * np.maximum(along / divisor, length))
    status = np.select(
        [~finite, empty, is_couple, is_line],
        [ScrewStatus.INVALID, ScrewStatus.ZERO, ScrewStatus.COUPLE, ScrewStatus.LINE],
        ScrewStatus.SCREW,
    ).astype(np.int8)
    nothing = ~(is_couple | has_axis)
    return ScrewAxis(
        np.where(nothing[..., None], np.nan, unit),
        np.where(has_axis[..., None], point, np.nan),
        np.where(has_axis, pitch, np.where(is_couple, np.inf, np.nan)),
        status,
    )


def reciprocal_system(
    screws: ArrayLike, *, length: float = 1.0, tolerance: float | None = None
) -> ReciprocalSystem:
    """Return the rank of given screws and all screws reciprocal to every one of them.

    Parameters
    ----------
    screws : array_like (..., n, 6)
        n screws an element.
    length : float, optional
        Moments are divided by it before the singular values are taken; the size of the mechanism is a good one. The
        rank depends on it where the screws are nearly dependent, and so does what is orthogonal.
    tolerance : float, optional
        Singular values up to this part of the largest are zero. Default: 8 max(n, 6) times the machine epsilon,
        which is what rounding of screws that are dependent leaves.

    Returns
    -------
    ReciprocalSystem
        rank (...) int8, 0 to 6, -1 where a number is not finite. basis (..., 6, 6): its first 6 - rank rows are an
        orthonormal basis (moments in units of `length`), the rest NaN. margin (...): the least singular value that
        counts, over the largest; near the tolerance the rank is arbitrary. NaN for rank 0 and -1.

    Examples
    --------
    >>> from rodgen.kinematics.screws import line_along, reciprocal_system
    >>> axes = line_along([0.0, 0.0, 0.0], [[1.0, 0, 0], [0, 1.0, 0], [1.0, 1.0, 0]])
    >>> system = reciprocal_system(axes)
    >>> int(system.rank), system.basis.shape, int((system.basis[:, 0] == system.basis[:, 0]).sum())
    (2, (6, 6), 4)
    """
    if not 0 < length < np.inf:
        raise ValueError(f"length is {length}; expected a positive number")
    screw_array = real_array("screws", screws, (6,))
    if screw_array.ndim < 2:
        raise ValueError(f"screws has the shape {screw_array.shape}; expected (..., n, 6)")
    count = screw_array.shape[-2]
    if tolerance is None:
        tolerance = 8 * max(count, 6) * float(np.finfo(float).eps)
    finite: Any = np.isfinite(screw_array).all(axis=(-2, -1))
    safe = np.where(finite[..., None, None], screw_array, 0.0)
    # the rows of screws times Δ, with moments in units of length: what is reciprocal is their null space
    swapped = np.concatenate([safe[..., 3:] / length, safe[..., :3]], axis=-1)
    # at least six rows, so that there are always six right singular vectors
    padding = np.zeros((*swapped.shape[:-2], max(0, 6 - count), 6))
    _, values, vectors = np.linalg.svd(np.concatenate([swapped, padding], axis=-2), full_matrices=False)
    counts = (values > tolerance * values[..., :1]) & (values > 0)
    rank = counts.sum(axis=-1)
    least = np.take_along_axis(values, np.maximum(rank - 1, 0)[..., None], -1)[..., 0]
    largest = np.where(values[..., 0] > 0, values[..., 0], 1.0)
    free = np.arange(6) < (6 - rank)[..., None]
    basis = vectors[..., ::-1, :] * np.array([1.0] * 3 + [length] * 3)
    keep = free & finite[..., None]
    return ReciprocalSystem(
        np.where(finite, rank, -1).astype(np.int8),
        np.where(keep[..., None], basis, np.nan),
        np.where(finite & (rank > 0), least / largest, np.nan),
    )


def _joined(direction: Any, moment: Any) -> Any:
    return np.concatenate(np.broadcast_arrays(direction, moment), axis=-1)
