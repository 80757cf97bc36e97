"""The 3-SPS-S: three legs, and a pivot about which the platform turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.kinematics import three_sps_s
from rodgen.kinematics.rotation import matrix_from_rodrigues_vector, quaternion_from_matrix
from rodgen.machines.families.kinematics import Vector
from rodgen.machines.families.on_legs import NEAR, NEWTON_STEPS, OnThreeLegs, Pose, Steps, rotation_vectors
from rodgen.machines.rigid import rotation_matrix, rotation_vector
from rodgen.symbolic import legs as leg_steps

MOST_SEEN = 32
"""Poses at most, in addition to the first, that emitted code chooses from to begin."""


@dataclass(frozen=True)
class ThreeSpsS(OnThreeLegs):
    """Three legs, and a pivot about which the platform turns; its pose is a rotation matrix, row by row."""

    h: float = 0.0
    """Height of the pivot above the base."""
    start: Vector | None = None
    """Rotation vector in radians; the assembly mode is the one nearest to it, else the one nearest to the readings."""
    seen: tuple[Vector, ...] = field(default=(), compare=False, repr=False)
    """Of a machine that was measured: further rotation vectors of that mode, from which all that were measured are
    found; for code that finds poses by itself. They are in no file."""

    family = "3-sps-s"
    words = "3-SPS-S: three legs, and a pivot about which the platform turns"
    legs = MappingProxyType({"L1": -30, "L2": 90, "L3": 210})
    numbers = MappingProxyType({"R": ("",), "r": ("",), "h": ("",)})
    keys = ("R", "r", "h", "start")
    pose_numbers = 9
    has_modes = True
    begin_of = ("leg1", "leg2", "leg3", "w", "x", "y", "z")

    @property
    def begins(self) -> Array:
        """Lengths of the legs, and unit quaternions."""
        if self.start is None:
            return np.zeros((0, 7))
        turns = rotation_matrix([self.start, *self.seen])
        return np.concatenate([self.legs_at(turns), quaternion_from_matrix(turns)[0]], axis=1)

    def degrees_of_freedom(self, poses: Array) -> Array:
        """Return the rotation vectors from the start."""
        return poses if self.start is None else rotation_vectors(poses, rotation_matrix(self.start))

    def modes(self, legs: Array) -> Array:
        """Return the rotation matrices of up to eight modes, (n, 8, 9)."""
        turns = np.asarray(three_sps_s.direct_all(legs, self._geometry())[0])
        return turns.reshape(*turns.shape[:-2], 9)

    def placed(self, poses: Array, targets: Array, *, moving: bool) -> Array:
        """Return the targets turned, and shifted by the height of the pivot."""
        turned = np.einsum("...ij,...j->...i", poses.reshape(*poses.shape[:-1], 3, 3), targets)
        return np.asarray(turned + np.array([0.0, 0.0, self.h])) if moving else np.asarray(turned)

    def least_singular_value(self, poses: Array) -> Array:
        """Return the least gain of the legs' lengths over a turn of the platform."""
        gains = three_sps_s.singularity(poses.reshape(-1, 3, 3), self._geometry()).gains
        return np.asarray(gains[:, -1] / self.r)

    def usual_legs(self) -> Array:
        """Return the lengths at `start`, or with the platform parallel to the base."""
        return self.legs_at(np.eye(3) if self.start is None else rotation_matrix(self.start))

    def mode_words(self) -> str:
        """Say from where the pose is found."""
        if self.start is None:
            return "by Newton's steps from where it is parallel to the base"
        x = ", ".join(f"{c:.6g}" for c in self.start)
        words = f"in the assembly mode of the rotation vector ({x}) rad, by Newton's steps from there"
        if self.seen:
            words += (
                f" or from {len(self.seen)} more poses that were measured, whichever has the nearest legs"
            )
        return words

    def legs_at(self, turns: Array) -> Array:
        """Return the lengths of the legs, (..., 3), at rotations, (..., 3, 3)."""
        return np.asarray(three_sps_s.legs(turns, self._geometry()))

    def found_by_code(self, legs: Array) -> Array:
        """Return the rotation matrices, (n, 9), that emitted code finds, right or wrong."""
        begins = np.eye(3)[None] if self.start is None else rotation_matrix([self.start, *self.seen])
        return self.found_from(begins, legs).reshape(-1, 9)

    def in_mode(self, start: Vector | None) -> ThreeSpsS:
        """Return the machine with another `start`."""
        return replace(self, start=start)

    def with_seen(self, poses: Array, legs: Array) -> ThreeSpsS:
        """Add those poses from which others are found, the one with the farthest legs first, until all are found."""
        begins = rotation_matrix([self.start or (0.0, 0.0, 0.0)])
        poses = poses.reshape(-1, 3, 3)
        while len(begins) <= MOST_SEEN:
            lost = ~(np.abs(self.found_from(begins, legs) - poses).max(axis=(1, 2)) < NEAR)
            if not lost.any():
                break
            apart = np.sum((legs[lost, None] - self.legs_at(begins)) ** 2, axis=2).min(axis=1)
            begins = np.concatenate([begins, poses[lost][[np.argmax(apart)]]])
        x = rotation_vector(begins[1:])
        return replace(self, seen=tuple((float(a), float(b), float(c)) for a, b, c in x))

    def found_from(self, begins: Array, legs: Array) -> Array:
        """Return the rotations, (n, 3, 3), that emitted code finds: from the beginning whose legs are the nearest.

        Parameters
        ----------
        begins : ndarray, shape (k, 3, 3)
        legs : ndarray, shape (n, 3)
        """
        geometry = self._geometry()
        apart = np.sum((legs[:, None] - self.legs_at(begins)) ** 2, axis=2)
        turns = begins[np.argmin(apart, axis=1)]
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                now = self.legs_at(turns)
                slopes = now[:, :, None] * three_sps_s.jacobian(turns, geometry)
                slopes[~np.isfinite(np.linalg.cond(slopes))] = np.nan
                step = -np.linalg.solve(slopes, (now**2 - legs**2)[:, :, None] / 2)[:, :, 0]
                turns = matrix_from_rodrigues_vector(step)[0] @ turns
        return np.asarray(turns)

    def _geometry(self) -> three_sps_s.Geometry:
        return three_sps_s.Geometry(self.R, self.r, self.h)

    # unknowns: a small turn after the one before, as the Rodrigues vector of half of it (Cayley's map)

    def state(self, m: Steps, numbers: Sequence[Any]) -> Any:
        """Return the rotation matrix."""
        return m.matrix(3, 3, numbers)

    def begin(self, m: Steps, half: Sequence[Any]) -> Any:
        """Begin with the rotation whose legs are the nearest, by selects without a branch."""
        least, chosen = None, m.matrix.zeros(4, 1)
        for begin in m.begins:
            lengths = [m.column["q", k] for k in range(3)]
            squares = ((a - b) ** 2 for a, b in zip(lengths, begin[:3], strict=True))
            apart, quaternion = m.let("apart", sum(squares, 0)), m.matrix(begin[3:])
            if least is None:
                least, chosen = apart, quaternion
                continue
            here = apart < least
            pairs = zip(quaternion, chosen, strict=True)
            chosen = m.let("chosen", m.matrix([m.select(here, a, b) for a, b in pairs]))
            least = m.let("least", m.select(here, apart, least))
        return leg_steps.matrix_of_quaternion(m, chosen[0], chosen[1:])

    def pose(self, m: Steps, arms: Sequence[Any], state: Any) -> Pose:
        """Return the pose of a rotation matrix."""
        shift = m.matrix([0, 0, self.h])
        arms = [m.let("arm", state * arm) for arm in arms]
        by = [leg_steps.turn_rates(m, arm) for arm in arms]
        return Pose(state, state, shift, [arm + shift for arm in arms], by)

    def moved(self, m: Steps, state: Any, step: Any) -> Any:
        """Turn on by the step."""
        return leg_steps.turned_by_step(m, state, step)

    def carried_by(self, m: Steps, pose: Pose, x: Any) -> Any:
        """Return the derivative by a small turn."""
        return leg_steps.turn_rates(m, m.let("seen", pose.turn * x))
