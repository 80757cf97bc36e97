"""The hexapod: six legs from six joints of a base to six of a platform."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.kinematics import hexapod
from rodgen.machines.families.kinematics import Vector
from rodgen.machines.families.on_legs import NEWTON_STEPS, OnLegs, Pose, Steps, rotation_vectors
from rodgen.symbolic import legs as leg_steps

SINGULAR = 1e-9
"""Least singular value, about 1 at best, that is rounding."""


@dataclass(frozen=True)
class Hexapod(OnLegs):
    """Six legs (6-UPS, Stewart-Gough platform); its pose is a position and a rotation matrix, row by row.

    Attributes
    ----------
    B1, ..., B6, P1, ..., P6 : tuple of float, length 3
        Where the joints of the legs are: on the base, and on the platform in its own axes.
    home : tuple of float, length 3
        Where the origin of the platform axes is, in the middle of the workspace, when these are parallel to the base's.
        The assembly mode is the one to which the platform comes from there while its legs grow evenly.
    """

    B1: Vector
    B2: Vector
    B3: Vector
    B4: Vector
    B5: Vector
    B6: Vector
    P1: Vector
    P2: Vector
    P3: Vector
    P4: Vector
    P5: Vector
    P6: Vector
    home: Vector = (0.0, 0.0, 0.0)

    family = "hexapod"
    words = "hexapod: six legs"
    legs = MappingProxyType({f"L{k}": 0 for k in range(1, 7)})
    numbers = MappingProxyType({f"{of}{k}": ("x", "y", "z") for of in "BP" for k in range(1, 7)})
    number_words = MappingProxyType(
        {f"B{k}": (f"base_joint{k}", f"joint of leg {k} on the base, {{length}}") for k in range(1, 7)}
        | {
            f"P{k}": (f"platform_joint{k}", f"joint of leg {k} on the platform, in its axes, {{length}}")
            for k in range(1, 7)
        }
    )
    keys = (*numbers, "home")
    pose_numbers = 12
    of_all_legs = ("common_zero_offset", "base_radius", "platform_radius", "platform_shift")
    are_shared = False
    begin_of = (*(f"leg{k}" for k in range(1, 7)), "x", "y", "z")

    @property
    def size(self) -> float:
        """Root mean square distance of the base's joints from their middle."""
        return self._geometry().size

    def dimension(self, effect: str) -> tuple[str, float] | None:
        """Return the radius of a plate: the mean distance of its joints from their middle, across z.

        None of a plate that does not lie about so.
        """
        plate = {"base_radius": "base", "platform_radius": "platform"}.get(effect)
        if plate is None:
            return None
        joints = getattr(self._geometry(), plate)
        ways = joints - joints.mean(axis=0)
        radius = float(np.linalg.norm(ways[:, :2], axis=1).mean())
        return None if ways[:, 2].std() > radius / 2 else (f"radius of the {plate}", radius)

    @property
    def pose_scale(self) -> Array:
        """The size of the base, and a radian."""
        return np.repeat([self.size, 1.0], [3, 9])

    @property
    def fault(self) -> tuple[str, str, str] | None:
        """Legs that do not hold the platform at `home`, as where two of them are one."""
        gain = self.least_singular_value(np.concatenate([self.home, np.eye(3).ravel()])[None])[0]
        if gain > SINGULAR:
            return None
        return (
            "home",
            "a pose that the legs do not hold",
            "joints B and P with which they do, no two legs alike",
        )

    @property
    def begins(self) -> Array:
        """Lengths of the legs, and position, of `home`."""
        return np.concatenate([self.usual_legs(), self.home])[None]

    def modes(self, legs: Array) -> Array:
        """Return the one pose that belongs to `home`."""
        position, turn, _ = hexapod.direct(legs, self._geometry(), self.home)
        return np.concatenate([position, turn.reshape(-1, 9)], axis=1)[:, None]

    def found_by_code(self, legs: Array) -> Array:
        """Return the poses, (n, 12), that emitted code finds, right or wrong."""
        position, turn = hexapod.by_newton(legs, self._geometry(), self.home, NEWTON_STEPS)
        return np.concatenate([position, turn.reshape(-1, 9)], axis=1)

    def least_singular_value(self, poses: Array) -> Array:
        """Return the least singular value of the derivative of the legs."""
        turns = poses[:, 3:].reshape(-1, 3, 3)
        return hexapod.least_singular_value(poses[:, :3], turns, self._geometry())

    def degrees_of_freedom(self, poses: Array) -> Array:
        """Return positions and rotation vectors, (n, 6)."""
        return np.concatenate([poses[:, :3], rotation_vectors(poses[:, 3:], np.eye(3))], axis=1)

    def usual_legs(self) -> Array:
        """Return the lengths at `home`."""
        return hexapod.legs(self.home, np.eye(3), self._geometry())

    def mode_words(self) -> str:
        """Say from where the pose is found."""
        x = ", ".join(f"{c:.6g}" for c in self.home)
        return f"by Newton's steps from where it is parallel to the base at ({x})"

    def _geometry(self) -> hexapod.Geometry:
        base, platform = (np.array([self.number(f"{of}{k}") for k in range(1, 7)]) for of in "BP")
        return hexapod.Geometry(base, platform)

    # unknowns: a shift, and a small turn after the one before

    def base_joint(self, m: Steps, leg: int) -> Any:
        """Return the joint on the base."""
        return self._joint(m, "B", leg)

    def platform_joint(self, m: Steps, leg: int) -> Any:
        """Return the joint on the platform."""
        return self._joint(m, "P", leg)

    def _joint(self, m: Steps, plate: str, leg: int) -> Any:
        """Return a joint of a plate, and keep its direction from the middle of the plate where an effect needs it."""
        joints = [getattr(self, f"{plate}{k}") for k in range(1, 7)]
        component = "base_joint" if plate == "B" else "platform_joint"
        if any("U" in m.structure.terms[n].names for n in m.terms_of(leg, component)):
            way = m.let("way", joints[leg] - sum(joints[1:], joints[0]) / 6)
            length = m.let("distance", m.sqrt(way[0] ** 2 + way[1] ** 2))
            m.directions[leg] = {"U": m.let("outwards", m.matrix([way[0] / length, way[1] / length, 0]))}
        return joints[leg]

    def state(self, m: Steps, numbers: Sequence[Any]) -> Any:
        """Return position and rotation matrix."""
        return m.matrix(numbers[:3]), m.matrix(3, 3, numbers[3:])

    def numbers_of(self, state: Any) -> list[Any]:
        """Return the position, and the matrix row by row."""
        return [x for part in state for x in part]

    def begin(self, m: Steps, half: Sequence[Any]) -> Any:
        """Begin at `home`."""
        (begin,) = m.begins
        return m.matrix(begin[6:]), m.matrix.eye(3)

    def pose(self, m: Steps, arms: Sequence[Any], state: Any) -> Pose:
        """Return the pose of position and rotation matrix."""
        shift, turn = state
        arms = [m.let("arm", turn * arm) for arm in arms]
        by = [self._rates(m, arm) for arm in arms]
        return Pose(state, turn, shift, [m.let("joint", arm + shift) for arm in arms], by)

    def moved(self, m: Steps, state: Any, step: Any) -> Any:
        """Shift, and turn on."""
        shift = m.let("shift", state[0] + step[:3, :])
        return shift, leg_steps.turned_by_step(m, state[1], step[3:, :])

    def step_size(self, m: Steps, step: Any, spans: Sequence[Any]) -> Any:
        """Return the square of the turn, and of the shift over the legs' usual length."""
        square = m.let("square", sum((leg.dot(leg) for leg in spans), 0) / len(spans))
        return step[3:, :].dot(step[3:, :]) + step[:3, :].dot(step[:3, :]) / square

    def carried_by(self, m: Steps, pose: Pose, x: Any) -> Any:
        """Return the derivative by shift and turn."""
        return self._rates(m, m.let("seen", pose.turn * x))

    @staticmethod
    def _rates(m: Steps, arm: Any) -> Any:
        """Return the derivative (3, 6) of a point of the platform, at the end of an arm."""
        return m.matrix.hstack(m.matrix.eye(3), leg_steps.turn_rates(m, arm))
