"""Products of exponentials, to and from mechanisms, and links on the common perpendiculars of axes.

A robot is given by the screws of its joints where all coordinates are zero, and by its end frame there, T(q) = exp(q_1
[xi_1]) ... exp(q_n [xi_n]) M; its links are wanted. A screw is (omega; v): the axis is along omega through omega × v,
the pitch is omega · v, and omega = 0 is a translation along v.

Joints are then lines in space, and links are wanted in Crane and Duffy's convention. Two axes that are neither parallel
nor meet have one common perpendicular. Where they meet, it is the direction across both that counts; where they are
parallel, it may stand anywhere, and where they are one, it may have any direction, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.spatial.forward_analysis import frames, screws
from rodgen.kinematics.spatial.mechanism import Mechanism
from rodgen.kinematics.spatial.placement import Placement, mechanism_at, placed
from rodgen.kinematics.spatial.transforms import inverse_transform, one_frame, transform
from rodgen.views import with_html

PARALLEL = 1e-8
"""Largest sine between axes that count as parallel. The feet of a common perpendicular are known to the machine
epsilon times the distance over that sine; to take the axes for parallel is off by distance times sine. At 1e-8 both are
alike."""

MEETING = 64 * np.finfo(float).eps
"""Distance between axes, or along one, relative to the size of the chain, that counts as zero: the rounding of its
computation."""

FAR = 100.0
"""Height of a foot, relative to the size of the chain, beyond which nothing else is put there: where axes that are
nearly parallel have theirs, it would take the digits of all that follows."""


class Links(NamedTuple):
    """Links with the joints at zero, and where the first one's system is."""

    a: NDArray[np.float64]
    alpha: NDArray[np.float64]
    offset: NDArray[np.float64]
    angle: NDArray[np.float64]
    base: NDArray[np.float64]


def links_from_axes(
    kinds: Sequence[str], directions: NDArray[Any], points: NDArray[Any], tolerance: float = PARALLEL
) -> Links:
    """Return the links on the common perpendiculars of axes.

    Parameters
    ----------
    kinds : sequence of str, length n
        Kinds of the joints; a P has a direction only, and stands where the joint before it ends.
    directions : array (n, 3)
        Unit vectors.
    points : array (n, 3)
        A point on each axis; without meaning for a P.
    tolerance : float, optional
        Largest sine between axes that count as parallel.

    Returns
    -------
    Links
        a is never negative. The link between parallel axes stands where the one before it does, so that S_j = 0;
        between axes that are one it keeps that one's direction, so that theta_j = 0.
    """
    count = len(kinds)
    turning = [j for j in range(count) if kinds[j] != "P"]
    size = float(np.abs(points[turning]).max(initial=0.0))
    point = (
        points[turning[0]] if turning else np.zeros(3)
    )  # the point of this axis that heights are counted from
    here = 0.0  # the height at which the last perpendicular meets it
    x = _across(directions[0])
    a, alpha = np.zeros(count - 1), np.zeros(count - 1)
    offset, angle = np.zeros(count), np.zeros(count)
    base: NDArray[Any] | None = None
    for j in range(count):
        z = directions[j]
        near = here if abs(here) <= FAR * size else 0.0
        if j == count - 1:
            along, foot, there, own_there = x, near, 0.0, point
        else:
            own_there = point + near * z if kinds[j + 1] == "P" else points[j + 1]
            axis, next_point = (z, point, here), (directions[j + 1], own_there)
            along, foot, there, a[j], alpha[j] = _perpendicular(axis, next_point, x, tolerance, size)
        if base is None:
            base = transform(np.stack([along, np.cross(z, along), z], axis=-1), point + foot * z)
        else:
            offset[j] = 0.0 if abs(foot - here) <= MEETING * size else foot - here
            angle[j] = math.atan2(np.cross(x, along).dot(z), x.dot(along))
        x, here, point = along, there, own_there
    assert base is not None
    return Links(a, alpha, offset, angle, base)


def _perpendicular(
    axis: tuple[NDArray[Any], NDArray[Any], float],
    other_axis: tuple[NDArray[Any], NDArray[Any]],
    before: NDArray[Any],
    tolerance: float,
    size: float,
) -> tuple[NDArray[Any], float, float, float, float]:
    """Return direction, heights of the feet on this axis and on the next, length and twist of the link between them."""
    (z, point, here), (other_z, next_point) = axis, other_axis
    normal = np.cross(z, other_z)
    sine = float(np.linalg.norm(normal))
    if sine <= tolerance:
        # at the height of the link before, but not where that is so far away that the axes are apart there
        foot = here if sine * abs(here) <= MEETING * size else 0.0
        gap = next_point - (point + foot * z)
        level = gap - gap.dot(z) * z
        length = float(np.linalg.norm(level))
        twist = 0.0 if z.dot(other_z) > 0 else math.pi
        there = -float(gap.dot(other_z))
        if length <= MEETING * size:
            return _level(before, z), foot, there, 0.0, twist
        return level / length, foot, there, length, twist
    # Across the first axis to rounding: a cross product of nearly parallel axes is not. What is left of its error turns
    # the link about that axis, and is made good where all that follows is measured in the link's own directions.
    x = normal / sine
    x -= x.dot(z) * z
    x /= np.linalg.norm(x)
    gap = next_point - point
    length = float(gap.dot(x))
    if length < 0:
        x, length = -x, -length
    if length <= MEETING * size:
        length = 0.0
    y = np.cross(z, x)
    sine, cosine = -float(y.dot(other_z)), float(z.dot(other_z))
    beyond = float(gap.dot(y)) / sine
    return x, float(gap.dot(z)) + beyond * cosine, beyond, length, math.atan2(sine, cosine)


def _level(x: NDArray[Any], z: NDArray[Any]) -> NDArray[Any]:
    """Return the direction of x, made perpendicular to z."""
    level = x - x.dot(z) * z
    length = float(np.linalg.norm(level))
    return level / length if length > 0.5 else _across(z)


def _across(z: NDArray[Any]) -> NDArray[Any]:
    """Return a direction across z: that of the next of x, y, z after its largest component, made perpendicular."""
    helper = np.eye(3)[(int(np.argmax(np.abs(z))) + 1) % 3]
    across: NDArray[Any] = helper - helper.dot(z) * z
    return across / float(np.linalg.norm(across))


UNIT_LENGTH = 1e-6
"""Largest deviation of a screw from unit length: decimals in a file, not another unit."""


ROUNDED = 1e-7
"""Error of a pose, relative to the size, for each joint, that is accepted: ten times what the tolerance leaves."""


@with_html
class ProductOfExponentials(NamedTuple):
    """A robot as a product of exponentials.

    Attributes
    ----------
    screws : array (v, 6)
        One for each variable, (omega; v), in the base frame with all coordinates zero.
    home : array (4, 4)
        Pose of the end frame there.
    """

    screws: NDArray[np.float64]
    home: NDArray[np.float64]


def from_product_of_exponentials(
    screws: ArrayLike,
    home: ArrayLike | None = None,
    *,
    tolerance: float = PARALLEL,
    unit: str = "mm",
    name: str = "",
    names: Iterable[str] = (),
) -> Placement:
    """Return the mechanism of a product of exponentials.

    Parameters
    ----------
    screws : array_like (n, 6)
        omega and v of each joint, the base's first; omega is a unit vector, or zero and v a unit vector.
    home : array_like (4, 4), optional
        End frame where all coordinates are zero; left out: the base frame.
    tolerance : float, optional
        Largest sine between axes that count as parallel.
    unit, name, names
        As of :class:`Mechanism`.

    Returns
    -------
    Placement
        Joints R, P and H (where omega · v is not zero). Its coordinates are those of the product.

    Raises
    ------
    RodgenError
        When a screw is not finite or not of unit length, or the links miss the poses of the screws: this is checked.

    Notes
    -----
    Parallel, meeting and coincident axes are distinguished to rounding. Where consecutive axes are nearly parallel, the
    convention itself puts the feet of the perpendicular far away: a pose is right to some ten epsilons over the
    sine, 1e-7 of the size at worst.

    Examples
    --------
    >>> from rodgen import spatial
    >>> arm = spatial.from_product_of_exponentials([[0, 0, 1, 0, 0, 0], [0, 0, 1, 0, -300, 0]])
    >>> arm.mechanism.joints, arm.mechanism.a
    (('R', 'R'), array([300.]))
    """
    rows = real_array("the screws", screws)
    if rows.ndim != 2 or rows.shape[1] != 6 or not len(rows) or not np.isfinite(rows).all():
        raise RodgenError(
            f"the screws have the shape {rows.shape}; expected (n, 6) finite numbers, one row a joint"
        )
    kinds, directions, points, pitches = (
        [],
        np.zeros((len(rows), 3)),
        np.zeros((len(rows), 3)),
        np.zeros(len(rows)),
    )
    for j, (omega, v) in enumerate(zip(rows[:, :3], rows[:, 3:], strict=True)):
        slides = not omega.any()
        length = float(np.linalg.norm(v if slides else omega))
        if abs(length - 1) > UNIT_LENGTH:
            raise RodgenError(f"screw {j + 1} has an axis of the length {length:g}; expected a unit vector")
        directions[j] = (v if slides else omega) / length
        if slides:
            kinds.append("P")
            continue
        points[j] = np.cross(directions[j], v / length)
        pitch = float(directions[j].dot(v)) / length
        screwed = abs(pitch) > 1e-12 * np.abs(v).max(initial=0.0)
        pitches[j] = pitch if screwed else 0.0
        kinds.append("H" if screwed else "R")
    end = one_frame("home", home)
    labels = {"unit": unit, "name": name, "names": tuple(names)}
    return placement_from_axes(tuple(kinds), directions, points, pitches, end, tolerance, labels)


def placement_from_axes(
    kinds: tuple[str, ...],
    directions: NDArray[np.float64],
    points: NDArray[np.float64],
    pitches: NDArray[np.float64],
    home: NDArray[np.float64],
    tolerance: float,
    labels: Mapping[str, Any],
) -> Placement:
    """Return the mechanism of the axes of its joints and its end frame, both where all coordinates are zero."""
    links = links_from_axes(kinds, directions, points, tolerance)
    mechanism, zero = mechanism_at(kinds, links.a, links.alpha, links.offset, links.angle, pitches, **labels)
    # from the chain's own last frame, so that the pose at zero is the given one whatever was rounded on the way
    last = links.base @ frames(mechanism, zero)[-1]
    placement = Placement(mechanism, links.base, inverse_transform(last) @ home, zero)
    _put_back(placement, kinds, directions, points, pitches, home, tolerance)
    return placement


def _put_back(
    placement: Placement,
    kinds: tuple[str, ...],
    directions: NDArray[np.float64],
    points: NDArray[np.float64],
    pitches: NDArray[np.float64],
    home: NDArray[np.float64],
    tolerance: float,
) -> None:
    """Raise an error when the mechanism misses the motion of its axes at a few positions."""
    turning = np.array([kind != "P" for kind in kinds])
    sizes = (points[turning], home[:3, 3], pitches)
    size = max(float(np.abs(x).max(initial=0.0)) for x in sizes) or 1.0
    moves = np.cos(np.arange(3)[:, None] + 1.7 * np.arange(len(kinds))) * np.where(turning, 2.0, size)
    wanted = np.broadcast_to(home, (3, 4, 4))
    for j in reversed(range(len(kinds))):
        turned = np.eye(3)
        shifted = moves[:, j, None] * directions[j] * (pitches[j] if turning[j] else 1.0)
        if turning[j]:
            turned = kernels.matrix_from_axis_angle(directions[j], moves[:, j])[0]
            shifted = shifted + points[j] - turned @ points[j]
        wanted = transform(turned, shifted) @ wanted
    off = np.abs(placement.forward(moves) - wanted)
    worst = max(float(off[:, :3, :3].max()), float(off[:, :3, 3].max()) / size)
    allowed = len(kinds) * max(ROUNDED, 10 * tolerance)
    if not worst <= allowed:
        raise RodgenError(
            f"the links are off by {worst:.1g} of the size, expected at most {allowed:.1g}: consecutive axes are so "
            "nearly parallel that their common perpendiculars cannot be computed; make them exactly parallel"
        )


def to_product_of_exponentials(robot: Mechanism | Placement) -> ProductOfExponentials:
    """Return the product of exponentials of an open chain.

    Parameters
    ----------
    robot : Mechanism or Placement

    Returns
    -------
    ProductOfExponentials
        A row for each variable; a C has two, the turn and then the shift along the same axis.

    Raises
    ------
    RodgenError
        When the chain is closed or has joints E, T or S.

    Examples
    --------
    >>> from rodgen import spatial
    >>> spatial.to_product_of_exponentials(spatial.PUMA_560).screws[1].round(9) + 0.0
    array([ 0., -1.,  0.,  0.,  0.,  0.])
    """
    placement = placed(robot)
    chain = placement.base @ frames(placement.mechanism, placement.zero)
    return ProductOfExponentials(screws(placement.mechanism, chain), chain[-1] @ placement.end)
