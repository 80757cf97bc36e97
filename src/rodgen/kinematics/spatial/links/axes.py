"""Links on the common perpendiculars of the axes of joints.

Joints are given as lines in space, links are wanted in Crane and Duffy's convention. Two
axes that are neither parallel nor meet have one common perpendicular. Where they meet, it is the direction across both
that counts; where they are parallel, it may stand anywhere, and where they are one, it may have any direction, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rodgen.kinematics.spatial.links.transforms import transform

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
    own = (
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
            along, foot, there, own_there = x, near, 0.0, own
        else:
            own_there = own + near * z if kinds[j + 1] == "P" else points[j + 1]
            axis, other = (z, own, here), (directions[j + 1], own_there)
            along, foot, there, a[j], alpha[j] = _perpendicular(axis, other, x, tolerance, size)
        if base is None:
            base = transform(np.stack([along, np.cross(z, along), z], axis=-1), own + foot * z)
        else:
            offset[j] = 0.0 if abs(foot - here) <= MEETING * size else foot - here
            angle[j] = math.atan2(np.cross(x, along).dot(z), x.dot(along))
        x, here, own = along, there, own_there
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
    (z, own, here), (other_z, other) = axis, other_axis
    normal = np.cross(z, other_z)
    sine = float(np.linalg.norm(normal))
    if sine <= tolerance:
        # at the height of the link before, but not where that is so far away that the axes are apart there
        foot = here if sine * abs(here) <= MEETING * size else 0.0
        gap = other - (own + foot * z)
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
    gap = other - own
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
    found = x - x.dot(z) * z
    length = float(np.linalg.norm(found))
    return found / length if length > 0.5 else _across(z)


def _across(z: NDArray[Any]) -> NDArray[Any]:
    """Return a direction across z: that of the next of x, y, z after its largest component, made perpendicular."""
    helper = np.eye(3)[(int(np.argmax(np.abs(z))) + 1) % 3]
    found: NDArray[Any] = helper - helper.dot(z) * z
    return found / float(np.linalg.norm(found))
