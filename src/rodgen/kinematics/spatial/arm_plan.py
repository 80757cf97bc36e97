"""The method that solves an arm with six revolute joints, chosen by its geometry, and the steps of each method.

An arm has a closed form, or a pair of equations in two angles, when three axes that follow each other meet in one
point or are parallel. Where that is at the far end, the chain is read from its end: the transforms are inverted, the
angles change their signs and their order.

Three axes that meet or are parallel leave two scalar products of the vector loop that do not change when the chain
turns about these three axes and about one more. They hold two angles; the pair has up to eight solutions (four where
the axes at an end meet). The rest is one angle from a known direction, and a wrist or a plane triangle with two
branches. The equations are kernels, made in the derivation ``robots_6r`` from the expressions that are proved there;
what follows from their angles is said there as well. Joints are numbered 1 to 6 here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.numerics import angle_between
from rodgen.kinematics.spatial.forward_analysis import jacobian
from rodgen.kinematics.spatial.mechanism import Mechanism

SIX_REVOLUTES = ("R",) * 6

ANGLE = 1e-12
"""Twists whose sine is below this count as parallel: it moves the end by 1e-12 of the reach."""
LENGTH = 1e-12
"""Lengths below this, relative to the sum of all lengths, count as zero."""

SINGULAR = 1e-12
"""Singular values of a Jacobian, lengths over the reach, that are rounding. Robots have 1e-3 to 1 there."""


@dataclass(frozen=True, eq=False)
class Arm:
    """A chain of six revolute joints in the form of the solvers, and the conversion from and to the given one.

    Links a (5) and offsets (6) as in a mechanism; cosine and sine (5) of the twists are exact at right angles. Parallel
    axes point the same way. The angles of the given chain are ``sign * angles[order]``.
    """

    a: Array
    cosine: Array
    sine: Array
    offset: Array
    sign: Array
    order: NDArray[np.intp]
    backwards: bool
    turned: bool
    """Whether the end is turned by half a turn about its x axis."""
    unit: float
    """Lengths of this arm over those of the given one."""

    def pose(self, T: Any) -> Any:
        """Return the poses of this chain for poses (..., 4, 4) of the given one."""
        if self.unit != 1:
            T = T.copy()
            T[..., :3, 3] *= self.unit
        if self.backwards:
            R = np.swapaxes(T[..., :3, :3], -1, -2)
            posed = np.empty_like(T)
            posed[..., :3, :3] = R
            posed[..., :3, 3] = -(R @ T[..., :3, 3:])[..., 0]
            posed[..., 3, :] = T[..., 3, :]
            T = posed
        return T * np.array([1.0, -1.0, -1.0, 1.0]) if self.turned else T

    def angles(self, q: Any) -> Any:
        """Return the angles of the given chain for angles (..., 6) of this one."""
        if self._as_given:
            return q
        angles = (q * self.sign)[..., self.order]
        return np.where(angles == -np.pi, np.pi, angles)  # the interval is open there

    @cached_property
    def _as_given(self) -> bool:
        """Whether the joints turn as those of the given chain do."""
        return bool(not self.backwards and (self.sign > 0).all())

    def parallel(self, *links: int) -> bool:
        """Whether the twists of links (from 0 on) are zero."""
        return bool((self.sine[list(links)] == 0).all())

    def skew(self, *links: int) -> bool:
        """Whether the twists of links are neither zero nor half a turn."""
        return bool((self.sine[list(links)] != 0).all())

    def meet(self, first: int) -> bool:
        """Whether the axes of joint `first` (from 0 on) and of the two after it meet in one point."""
        return not (self.a[first] or self.a[first + 1] or self.offset[first + 1]) and self.skew(
            first, first + 1
        )


@dataclass(frozen=True)
class Plan:
    """How an arm is solved.

    Ways: ``wrist`` and ``parallel`` are closed forms; ``meet 456``, ``meet 234``, ``parallel 234`` and ``parallel 123``
    need a pair of equations, with the axes counted in the arm's own direction; ``general`` has no special geometry.
    """

    way: str
    arm: Arm

    @property
    def slots(self) -> int:
        """The largest number of solutions."""
        return 8 if self.way in ("wrist", "parallel", "meet 456") else 16

    @property
    def method(self) -> str:
        """The method in words, with the special axes as the given chain counts them."""
        words = _WORDS[self.way]
        if self.arm.backwards:
            kind, _, axes = words.partition(":")
            swapped = "".join(str(7 - int(c)) if c.isdigit() else c for c in axes)
            parts = [_in_order(part) for part in swapped.split(" and ")]
            return f"{kind}:{' and '.join(parts)}".replace(" and axes 1, 2 meet", ", axes 1, 2 meet")
        return words.replace(" and axes 5, 6 meet", ", axes 5, 6 meet")


_WORDS: dict[str, str] = {
    "wrist": "closed form: axes 2, 3 are parallel and axes 4, 5, 6 meet",
    "parallel": "closed form: axes 2, 3, 4 are parallel and axes 5, 6 meet",
    "meet 456": "pair of equations: axes 4, 5, 6 meet",
    "parallel 234": "pair of equations: axes 2, 3, 4 are parallel",
    "meet 234": "pair of equations: axes 2, 3, 4 meet",
    "parallel 123": "pair of equations: axes 1, 2, 3 are parallel",
    "general": "general: ssik",
}


def _in_order(words: str) -> str:
    """Write the digits of one phrase in rising order."""
    digits = iter(sorted(c for c in words if c.isdigit()))
    return "".join(next(digits) if c.isdigit() else c for c in words)


def reach(chain: Arm | Mechanism) -> float:
    """Return the sum of all lengths and offsets."""
    return float(np.abs(chain.a).sum() + np.abs(chain.offset).sum())


def scaled_jacobian(mechanism: Mechanism, angles: Any, unit: float) -> Any:
    """Return the Jacobian (..., 6, 6) with lengths in a unit."""
    return jacobian(mechanism, angles) / np.array([1.0, 1.0, 1.0, unit, unit, unit])[:, None]


def plan(mechanism: Mechanism) -> Plan:
    """Return the method that solves a mechanism.

    Raises
    ------
    RodgenError
        When the mechanism is not an open chain of six revolute joints, or its Jacobian is singular everywhere.
    """
    known: Plan | None = vars(mechanism).get("_reverse_plan")
    if known is None:  # kept with the mechanism: to hash its numbers takes longer than to solve a pose
        known = _plan(mechanism)
        object.__setattr__(mechanism, "_reverse_plan", known)
    return known


def _plan(mechanism: Mechanism) -> Plan:
    if mechanism.closed:
        raise RodgenError("the mechanism is a closed loop; expected an open chain, or use reverse_loop")
    if mechanism.joints != SIX_REVOLUTES:
        raise RodgenError(
            f"the joints are {''.join(mechanism.joints)}; expected RRRRRR, or six freedoms of joints R, P and C"
        )
    arms = list(_arms(mechanism))
    if not _moves_freely(mechanism):
        raise RodgenError(
            "the six freedoms of this arm depend on each other in every position, so that it has no solution for "
            "almost every pose and whole families for the rest; expected an arm whose Jacobian is not singular "
            "everywhere"
        )
    for way, fits in _WAYS.items():
        for arm in arms:
            if fits(arm):
                return Plan(way, arm)
    return Plan("general", arms[0])


def _moves_freely(mechanism: Mechanism) -> bool:
    """Whether the Jacobian is regular at one of a few positions without anything special."""
    size = reach(mechanism)
    if not size:
        return False
    angles = np.array([[0.71, -1.13, 0.93, 1.37, -0.82, 0.31], [-2.3, 0.57, -1.9, 0.83, 1.21, -0.47]])
    return bool(
        (np.linalg.svd(scaled_jacobian(mechanism, angles, size), compute_uv=False)[:, -1] > SINGULAR).any()
    )


def _wrist(arm: Arm) -> bool:
    forearm = arm.a[2] or arm.sine[2] * arm.offset[3]
    return arm.meet(3) and arm.parallel(1) and arm.skew(0) and bool(arm.a[1] and forearm)


def _parallel(arm: Arm) -> bool:
    return arm.parallel(1, 2) and arm.skew(0, 3, 4) and bool(arm.a[1] and arm.a[2] and not arm.a[4])


_WAYS: dict[str, Callable[[Arm], bool]] = {
    "wrist": _wrist,
    "parallel": _parallel,
    "meet 456": lambda arm: arm.meet(3),
    "parallel 234": lambda arm: arm.parallel(1, 2) and arm.skew(3) and bool(arm.a[1] and arm.a[2]),
    "meet 234": lambda arm: arm.meet(1),
    "parallel 123": lambda arm: arm.parallel(0, 1) and arm.skew(2) and bool(arm.a[0] and arm.a[1]),
}
"""In the order of their cost."""


def _arms(mechanism: Mechanism) -> Iterator[Arm]:
    """Yield the chain, and the chain read from its end."""
    a, alpha, offset = (np.array(x) for x in (mechanism.a, mechanism.alpha, mechanism.offset))
    size = reach(mechanism)
    a, offset = (np.where(np.abs(x) <= LENGTH * size, 0.0, x) for x in (a, offset))
    # squares of squares of lengths must be numbers
    unit = 1.0 if size == 0 or 1e-30 < size < 1e30 else 2.0 ** -np.frexp(size)[1]
    a, offset = a * unit, offset * unit
    yield _aligned(a, alpha, offset, unit, backwards=False)
    yield _aligned(-a[::-1], -alpha[::-1], -offset[::-1], unit, backwards=True)


def _aligned(a: Array, alpha: Array, offset: Array, unit: float, *, backwards: bool) -> Arm:
    """Return the arm with parallel axes pointing the same way: Rx(π) Tz(S) Rz(θ) = Tz(-S) Rz(-θ) Rx(π), and so on."""
    cosine, sine = np.cos(alpha), np.sin(alpha)
    sign, offset = np.ones(6), offset.copy()
    turned = 1.0
    for link in range(5):
        cosine[link], sine[link] = turned * cosine[link], turned * sine[link]
        if abs(sine[link]) <= ANGLE:
            turned = np.sign(cosine[link])
            cosine[link], sine[link] = 1.0, 0.0
        else:
            turned = 1.0
            if abs(cosine[link]) <= 1e-15:  # 90 degrees are no number of radians
                cosine[link], sine[link] = 0.0, np.sign(sine[link])
        offset[link + 1] *= turned
        sign[link + 1] = turned
    order = np.arange(6)
    if backwards:
        sign, order = -sign, order[::-1].copy()
    return Arm(a, cosine, sine, offset, sign, order, backwards, bool(turned < 0), unit)


EPS = float(np.finfo(float).eps)
MEETING = 64 * EPS
"""Solutions meet within this, relative to what an equation is made of: the rounding of some thirty operations."""
FREE = 4096 * EPS
"""A vector shorter than this, relative to all lengths, has no direction: poses with 12 digits are that exact."""


class Branch(NamedTuple):
    """Two branches, last axis 2: angles (..., 2, m), and whether each is there, is double, holds a free angle."""

    angles: Any
    there: Any
    double: Any
    free: Any


def about_x(c: Any, s: Any, v: Any) -> Any:
    """Return vectors (..., 3) rotated about x."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.stack([x, c * y - s * z, s * y + c * z], axis=-1)


def back_x(c: Any, s: Any, v: Any) -> Any:
    """Return vectors (..., 3) rotated about x by the opposite angle."""
    return about_x(c, -s, v)


def about_z(theta: Any, v: Any) -> Any:
    """Return vectors (..., 3) rotated about z by angles (...)."""
    c, s = np.cos(theta), np.sin(theta)
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.stack([c * x - s * y, s * x + c * y, np.broadcast_to(z, np.shape(c * x))], axis=-1)


def back_z(theta: Any, v: Any) -> Any:
    """Return vectors (..., 3) rotated about z by the opposite angles."""
    return about_z(-np.asarray(theta), v)


def both_branches(angles: Any, there: Any, double: Any, free: Any, single: Any) -> Branch:
    """Return two branches, of which only the first counts where they are `single`."""
    both = np.stack([there, there & ~single], axis=-1)
    return Branch(angles, both, double[..., None] & both, free[..., None] & both)


def wrist(N: Any, cosine: Any, sine: Any) -> Branch:
    """Return the angles of three axes that meet: N = Rz(first) Rx(alpha) Rz(middle) Rx(beta) Rz(last).

    Derivation ``robots_6r``. `N` is (..., 3, 3), `cosine` and `sine` of alpha and beta (2). The angles are (..., 2, 3).
    """
    (ca, cb), (sa, sb) = cosine, sine
    h = np.hypot(N[..., 0, 2], N[..., 1, 2])
    ahead = N[..., 2, 2] >= 0
    apart = np.where(ahead, ca - cb, ca + cb)
    product = np.where(ahead, ca * cb, -ca * cb)
    gram = h**2 * (1 - 2 * product / (1 + np.abs(N[..., 2, 2]))) - apart**2
    tolerance = MEETING * (h + apart**2)
    there = gram >= -tolerance
    free = (h <= FREE) & there
    double = (np.abs(gram) <= tolerance) & ~free
    q = np.sqrt(np.where((gram > 0) & ~double, gram, 0.0))
    middle = np.arctan2(np.sign(sa * sb) * q, np.sign(sa * sb) * (ca * cb - N[..., 2, 2]))
    middle = np.stack([middle, -middle], axis=-1)
    c, s = np.cos(middle), np.sin(middle)
    M = N[..., None, :, :]
    first = np.where(
        free[..., None], 0.0, angle_between(sb * s, -ca * sb * c - sa * cb, M[..., 0, 2], M[..., 1, 2])
    )
    rest = back_x(cb, sb, back_z(middle, back_x(ca, sa, back_z(first, M[..., :, 0]))))
    last = np.arctan2(rest[..., 1], rest[..., 0])
    return both_branches(np.stack([first, middle, last], axis=-1), there, double, free, double | free)


def triangle(end: Any, upper: float, forearm: float, spare: Any) -> Branch:
    """Return both angles of two links in a plane that reach `end` (..., 2); `spare` is the size of all lengths."""
    square = np.square(end).sum(axis=-1)
    size = 2 * upper * forearm
    cosine = (square - upper**2 - forearm**2) / size
    tolerance = MEETING * np.square(spare) / abs(size)
    with np.errstate(over="ignore", invalid="ignore"):
        room = 1 - np.abs(cosine)
    there = room >= -tolerance
    double = np.abs(room) <= tolerance
    sine = np.sqrt(np.where((room > 0) & ~double, room * (1 + np.abs(cosine)), 0.0))
    second = np.arctan2(sine, cosine)
    second = np.stack([second, -second], axis=-1)
    x, y = upper + forearm * np.cos(second), forearm * np.sin(second)
    free = (np.abs(end).sum(axis=-1) <= FREE * spare) & there
    first = np.where(free[..., None], 0.0, angle_between(x, y, end[..., None, 0], end[..., None, 1]))
    return both_branches(np.stack([first, second], axis=-1), there, double, free, double)


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
        moved = back_x(c, s, v - length * X)
        return back_z(theta, moved - offset * Z)

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
