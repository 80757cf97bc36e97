"""Products of exponentials, to and from mechanisms.

A robot is given by the screws of its joints where all coordinates are zero, and by its end frame there, T(q) = exp(q_1
[xi_1]) ... exp(q_n [xi_n]) M; its links are wanted. A screw is (omega; v): the axis is along omega through omega × v,
the pitch is omega · v, and omega = 0 is a translation along v.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.spatial.links.axes import PARALLEL, links_from_axes
from rodgen.kinematics.spatial.links.forward import frames, screws
from rodgen.kinematics.spatial.links.mechanism import Mechanism
from rodgen.kinematics.spatial.links.transforms import inverse_transform, one_frame, transform
from rodgen.kinematics.spatial.robots.placement import Placement, mechanism_at, placed
from rodgen.views import html_of

UNIT_LENGTH = 1e-6
"""Largest deviation of a screw from unit length: decimals in a file, not another unit."""


ROUNDED = 1e-7
"""Error of a pose, relative to the size, for each joint, that is accepted: ten times what the tolerance leaves."""


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

    def _repr_html_(self) -> str:
        return html_of(self)


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
    made = Placement(mechanism, links.base, inverse_transform(last) @ home, zero)
    _put_back(made, kinds, directions, points, pitches, home, tolerance)
    return made


def _put_back(
    made: Placement,
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
    off = np.abs(made.forward(moves) - wanted)
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
    given = placed(robot)
    chain = given.base @ frames(given.mechanism, given.zero)
    return ProductOfExponentials(screws(given.mechanism, chain), chain[-1] @ given.end)
