"""The Tricept: three legs, and a passive one that turns about the origin and slides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Array
from rodgen.machines.families.kinematics import Vector
from rodgen.machines.families.on_legs import OnThreeLegs, Pose, Steps
from rodgen.symbolic import legs as leg_steps

if TYPE_CHECKING:
    from rodgen.kinematics import tricept


@dataclass(frozen=True)
class Tricept(OnThreeLegs):
    """Three legs, and a passive one that turns about the origin and slides; its pose is alpha, beta, z."""

    q: Vector = (0.0, 0.0, 0.0)
    """From the middle of the platform's joints to its centre, in platform axes."""

    family = "tricept"
    words = "Tricept: three legs, and a passive one that turns about the origin and slides"
    legs = MappingProxyType({"A0": 0, "A1": 120, "A-1": -120})
    numbers = MappingProxyType({"R": ("",), "r": ("",), "q": ("x", "y", "z")})
    keys = ("R", "r", "q")
    pose_numbers = 3

    @property
    def pose_scale(self) -> Array:
        """A radian, a radian, the radius of the base."""
        return np.array([1.0, 1.0, self.R])

    def modes(self, legs: Array) -> Array:
        """Return the one physical pose: all cosines and z are positive."""
        from rodgen.kinematics import tricept

        pose, _ = tricept.direct(legs, self._geometry())
        return np.asarray(pose)[:, None]

    def least_singular_value(self, poses: Array) -> Array:
        """Return the least singular value, from W33 d(pose) + W35 d(rods, radii) = 0."""
        from rodgen.kinematics import tricept

        blocks = tricept.matrices(poses, self._geometry())
        slopes = np.linalg.solve(blocks.W35[..., :3], -blocks.W33) / np.array([self.R, self.R, 1.0])
        good = np.asarray(np.isfinite(slopes).all(axis=(1, 2)))
        gains = np.linalg.svd(np.where(good[:, None, None], slopes, 0.0), compute_uv=False)
        return np.where(good, gains[:, -1], np.nan)

    def usual_legs(self) -> Array:
        """Return the lengths with the platform upright, two radii of the base away."""
        from rodgen.kinematics import tricept

        return np.asarray(tricept.legs([0.0, 0.0, 2 * self.R], self._geometry()))

    def mode_words(self) -> str:
        """Say what the physical mode is."""
        return "upright, alpha and beta within a quarter turn and z positive"

    def _geometry(self) -> tricept.Geometry:
        from rodgen.kinematics import tricept

        return tricept.Geometry(self.R, self.r, self.q)

    # the platform is turned by P = Oy(beta) Ox(alpha) and slides along its own z

    def state(self, m: Steps, numbers: Sequence[Any]) -> Any:
        """Return the column of alpha, beta, z."""
        return m.matrix(numbers)

    def begin(self, m: Steps, half: Sequence[Any]) -> Any:
        """Begin upright, where the legs are as long as they are in the mean."""
        square = m.let("height", (sum(half, 0) * 2 / 3) - (self.R - self.r) ** 2)
        return m.matrix([0, 0, m.let("height", m.sqrt(m.select(square > 0, square, self.R**2)))])

    def pose(self, m: Steps, arms: Sequence[Any], state: Any) -> Pose:
        """Return the pose of alpha, beta, z."""
        beta = m.turn(state[1])
        turn = leg_steps.tricept_turn(m, m.turn(state[0]), beta)
        shift = m.let("shift", turn.col(2) * state[2])
        joints = [m.let("joint", m.let("arm", turn * arm) + shift) for arm in arms]
        return Pose(
            state, turn, shift, joints, [leg_steps.tricept_rates(m, turn, beta, joint) for joint in joints]
        )

    def moved(self, m: Steps, state: Any, step: Any) -> Any:
        """Add the step."""
        return m.let("pose", state + step)

    def step_size(self, m: Steps, step: Any, spans: Sequence[Any]) -> Any:
        """Return the square, with the way in radii of the base."""
        return step[0] ** 2 + step[1] ** 2 + (step[2] / self.R) ** 2

    def carried(self, m: Steps, pose: Pose, x: Any) -> Any:
        """Carry a target from the platform's centre, which is at q from the middle of its joints."""
        return super().carried(m, pose, m.let("arm", x + self.q) if m.structure.moving else x)

    def carried_by(self, m: Steps, pose: Pose, x: Any) -> Any:
        """Return the derivative by alpha, beta and z."""
        seen = m.let("seen", self.carried(m, pose, x))
        return leg_steps.tricept_rates(m, pose.turn, m.turn(pose.state[1]), seen)
