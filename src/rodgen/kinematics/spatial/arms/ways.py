"""Arms without a closed form: two equations, linear in cosine and sine of two angles, and the other angles.

Three axes that meet or are parallel leave two scalar products of the vector loop that do not change when the chain
turns about these three axes and about one more. They hold two angles; the pair has up to eight solutions (four where
the axes at an end meet). The rest is one angle from a known direction, and a wrist or a plane triangle with two
branches.

The equations are kernels, made in the derivation ``robots_6r`` from the expressions that are proved there; what follows
from their angles is said there as well. Joints are numbered 1 to 6 here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rodgen.kinematics.angles import angle_between
from rodgen.kinematics.spatial.arms.plan import Arm, reach
from rodgen.kinematics.spatial.arms.steps import (
    FREE,
    Branch,
    about_x,
    about_z,
    back_x,
    back_z,
    triangle,
    wrist,
)

X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


class Way(NamedTuple):
    """The two equations of an arm, and all angles from a solution of them.

    ``equations`` names the kernel: poses and the arm's numbers to (n, 2, 3, 3). ``complete(arm, R, P, one, two)`` takes
    rotations and points, S1 taken off, with one more axis, which the angles (n, m) have as well, and gives branches of
    six angles.
    """

    equations: str
    complete: Any


def _twists(arm: Arm) -> Any:
    return [(arm.cosine[k], arm.sine[k]) for k in range(5)]


def _times(R: Any, v: Any) -> Any:
    return np.einsum("...ab,...b->...a", R, v)


def _back(R: Any, v: Any) -> Any:
    return np.einsum("...ba,...b->...a", R, v)


def _twice(*angles: Any) -> list[Any]:
    """Return angles for both branches."""
    return [np.repeat(angle[..., None], 2, axis=-1) for angle in angles]


def _outer(R: Any, steps: Any) -> Any:
    """Return a matrix with each column rotated: steps are functions of a vector, the first one first."""
    columns = []
    for k in range(3):
        v = R[..., :, k]
        for step in steps:
            v = step(v)
        columns.append(v)
    return np.stack(columns, axis=-1)


# ---- axes 4, 5 and 6 meet: the wrist's centre holds θ2 and θ3 (Pieper)


def _tip(arm: Arm) -> Any:
    """Return the wrist's centre from the origin of link 23, as joint 3 turns it."""
    a, S = arm.a, arm.offset
    return np.array([a[2], -arm.sine[2] * S[3], S[2] + arm.cosine[2] * S[3]])


def _from_456(arm: Arm, R: Any, P: Any, two: Any, three: Any) -> Branch:
    (c12, s12), (c23, s23), (c34, s34), *_ = _twists(arm)
    W = P - arm.offset[5] * R[..., :, 2]
    h = arm.a[1] * X + about_x(c23, s23, about_z(three, _tip(arm)))
    g = arm.a[0] * X + about_x(c12, s12, arm.offset[1] * Z + about_z(two, h))
    size = np.hypot(g[..., 0], g[..., 1]) + np.hypot(W[..., 0], W[..., 1])
    free = size <= FREE * (reach(arm) + np.abs(P).sum(axis=-1))
    one = np.where(free, 0.0, angle_between(g[..., 0], g[..., 1], W[..., 0], W[..., 1]))
    N = _outer(
        np.broadcast_to(R, (*one.shape, 3, 3)),
        [
            lambda v: back_x(c12, s12, back_z(one, v)),
            lambda v: back_x(c23, s23, back_z(two, v)),
            lambda v: back_x(c34, s34, back_z(three, v)),
        ],
    )
    rest = wrist(N, arm.cosine[3:], arm.sine[3:])
    angles = np.stack([*_twice(one, two, three), *np.moveaxis(rest.angles, -1, 0)], axis=-1)
    return rest._replace(angles=angles, free=rest.free | (free[..., None] & rest.there))


# ---- axes 2, 3 and 4 meet: their point, as the base and as the end has it, holds θ1 and θ6


def _from_234(arm: Arm, R: Any, P: Any, one: Any, six: Any) -> Branch:
    a, S = arm.a, arm.offset
    (c12, s12), _, _, (c45, s45), (c56, s56) = _twists(arm)
    point = about_z(one, np.array([a[0], -s12 * S[1], c12 * S[1]]))
    seen = a[4] * X + about_x(c56, s56, S[5] * Z + about_z(six, _back(R, point - P)))
    free = np.hypot(seen[..., 0], seen[..., 1]) <= FREE * (reach(arm) + np.abs(P).sum(axis=-1))
    five = np.where(free, 0.0, angle_between(seen[..., 0], seen[..., 1], -a[3], -s45 * S[3]))
    N = _outer(
        np.broadcast_to(np.eye(3), (*one.shape, 3, 3)),
        [
            lambda v: back_z(five, back_x(c45, s45, v)),
            lambda v: back_z(six, back_x(c56, s56, v)),
            lambda v: back_x(c12, s12, back_z(one, _times(R, v))),
        ],
    )
    rest = wrist(N, arm.cosine[1:3], arm.sine[1:3])
    first, fifth, sixth = _twice(one, five, six)
    angles = np.stack([first, *np.moveaxis(rest.angles, -1, 0), fifth, sixth], axis=-1)
    return rest._replace(angles=angles, free=rest.free | (free[..., None] & rest.there))


# ---- axes 2, 3 and 4 are parallel: S2 · S5 and the loop along S2 hold θ1 and θ6


def _from_parallel_234(arm: Arm, R: Any, P: Any, one: Any, six: Any) -> Branch:
    a, S = arm.a, arm.offset
    (c12, s12), _, _, (_, s45), (c56, s56) = _twists(arm)
    axis_2 = _back(R, about_z(one, np.array([0.0, -s12, c12])))
    seen = about_x(c56, s56, about_z(six, axis_2))  # (s45 s5, s45 c5, c45)
    five = np.arctan2(s45 * seen[..., 0], s45 * seen[..., 1])

    def outwards(v: Any) -> Any:
        return back_x(c12, s12, back_z(one, v))

    def to_end(v: Any) -> Any:
        return back_z(six, back_x(c56, s56, v))

    x_4 = outwards(_times(R, to_end(back_z(five, np.broadcast_to(X, seen.shape)))))
    origin_4 = to_end(back_z(five, np.array([-a[3], 0.0, -S[4]])) - a[4] * X)
    origin_4[..., 2] -= S[5]
    end = (outwards(P + _times(R, origin_4)) - a[0] * X)[..., :2]
    rest = triangle(end, a[1], a[2], reach(arm) + np.abs(P).sum(axis=-1))
    first, fifth, sixth, turned = _twice(one, five, six, np.arctan2(x_4[..., 1], x_4[..., 0]))
    two, three = np.moveaxis(rest.angles, -1, 0)
    return rest._replace(angles=np.stack([first, two, three, turned - two - three, fifth, sixth], axis=-1))


# ---- axes 1, 2 and 3 are parallel: S1 · S4 and the loop along S1 hold θ5 and θ6


def _from_parallel_123(arm: Arm, R: Any, P: Any, five: Any, six: Any) -> Branch:
    a, S = arm.a, arm.offset
    _, _, (_, s34), (c45, s45), (c56, s56) = _twists(arm)
    seen = about_z(six, np.broadcast_to(R[..., 2, :], (*six.shape, 3)))
    seen = about_x(c45, s45, about_z(five, about_x(c56, s56, seen)))  # (s34 s4, s34 c4, c34)
    four = np.arctan2(s34 * seen[..., 0], s34 * seen[..., 1])

    def outwards(v: Any, c: float, s: float, theta: Any, length: float, offset: float) -> Any:
        """Return a point of one link in the frame of the next."""
        found = back_x(c, s, v - length * X)
        return back_z(theta, found - offset * Z)

    points = []
    for start in (0 * X, X):
        point = np.broadcast_to(start, (*six.shape, 3))
        for link, theta in ((2, four), (3, five), (4, six)):
            point = outwards(point, arm.cosine[link], arm.sine[link], theta, a[link], S[link + 1])
        points.append(_times(R, point))
    origin_3, ahead = points
    end = (P + origin_3)[..., :2]
    x_3 = ahead - origin_3
    rest = triangle(end, a[0], a[1], reach(arm) + np.abs(P).sum(axis=-1))
    fourth, fifth, sixth, turned = _twice(four, five, six, np.arctan2(x_3[..., 1], x_3[..., 0]))
    one, two = np.moveaxis(rest.angles, -1, 0)
    return rest._replace(angles=np.stack([one, two, turned - one - two, fourth, fifth, sixth], axis=-1))


WAYS = {
    "meet 456": Way("robot_pair_456", _from_456),
    "meet 234": Way("robot_pair_234", _from_234),
    "parallel 234": Way("robot_pair_parallel_234", _from_parallel_234),
    "parallel 123": Way("robot_pair_parallel_123", _from_parallel_123),
}
