"""The method that solves an arm with six revolute joints, chosen by its geometry.

An arm has a closed form, or a pair of equations in two angles, when three axes that follow each other meet in one
point or are parallel. Where that is at the far end, the chain is read from its end: the transforms are inverted, the
angles change their signs and their order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.spatial.links.forward import jacobian
from rodgen.kinematics.spatial.links.mechanism import Mechanism

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
            made = np.empty_like(T)
            made[..., :3, :3] = R
            made[..., :3, 3] = -(R @ T[..., :3, 3:])[..., 0]
            made[..., 3, :] = T[..., 3, :]
            T = made
        return T * np.array([1.0, -1.0, -1.0, 1.0]) if self.turned else T

    def angles(self, q: Any) -> Any:
        """Return the angles of the given chain for angles (..., 6) of this one."""
        if self._as_given:
            return q
        found = (q * self.sign)[..., self.order]
        return np.where(found == -np.pi, np.pi, found)  # the interval is open there

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
