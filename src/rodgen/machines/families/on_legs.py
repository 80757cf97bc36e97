"""A platform on legs: what each family of such machines says of itself, as numbers and as steps of a model.

A coordinate is the length of a leg, from its joint on the base to its joint on the platform; in a delta the height of
a carriage, or the angle of an arm. Where the platform is follows from all of them together (the direct problem), and
may have several answers, the assembly modes.

The numbers of a geometry are floats, or in a model those of its kernel: then vectors are columns of values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from rodgen.array_types import Array
from rodgen.machines.families.kinematics import Kinematics
from rodgen.machines.rigid import rotation_vector

Steps: TypeAlias = Any
"""The `ModelSteps` of a kernel."""

NEWTON_STEPS = 8
"""Newton's steps from where the platform may be to where it is, all over the workspace."""
NEAR = 0.02
"""In rad, or radii of the base. The nominal pose may be so far from that of the fitted geometry and still be the same
one."""
LEG_CHANGE = 0.05
"""Part of its usual length by which a leg is assumed to change, either way, where no travel is known."""


@dataclass(frozen=True)
class Pose:
    """A pose of a platform in a model; each number is a value of its kernel."""

    state: Any
    """The pose as its family has it; see :meth:`OnLegs.state`."""
    turn: Any
    """Rotation matrix."""
    shift: Any
    """Where the middle of the platform is in base axes, shifted and not turned."""
    joints: list[Any]
    """Where the platform's joints are."""
    by: list[Any]
    """Derivative (3, unknowns) of each of them."""


@dataclass(frozen=True)
class OnLegs(Kinematics):
    """A platform on legs; lengths in the machine file's unit."""

    is_closed = True

    @property
    def fault(self) -> tuple[str, str, str] | None:
        """Why there is no such machine: the key, what it gives, and what is expected; None where there may be."""
        return None

    def freedoms(self, joints: Sequence[str]) -> list[str]:
        """List the geometry, each of its numbers, and the targets."""
        return ["geometry", *self.numbers, "target"]

    @property
    def pose_scale(self) -> Array:
        """What a radian, or the radius of the base, is in each number of a pose, (pose_numbers,)."""
        return np.ones(self.pose_numbers)

    def modes(self, legs: Array) -> Array:
        """Return the poses of the platform on the nominal machine.

        Parameters
        ----------
        legs : ndarray, shape (n, legs)

        Returns
        -------
        ndarray, shape (n, m, pose_numbers)
            One for each assembly mode that is physically possible, as a model starts from it; NaN beyond those that
            there are.
        """
        raise NotImplementedError

    def placed(self, poses: Array, targets: Array, *, moving: bool) -> Array:
        """Return where targets are on the nominal machine.

        Parameters
        ----------
        poses : ndarray, shape (..., pose_numbers)
        targets : ndarray, shape (..., 3)
            In platform axes.
        moving : bool
            Whether they are points; else directions.
        """
        raise NotImplementedError

    def degrees_of_freedom(self, poses: Array) -> Array:
        """Return poses, (n, pose_numbers), as one number for each degree of freedom of the platform."""
        return poses

    def usual_legs(self) -> Array:
        """Return the lengths of the legs, (legs,), in the middle of where the machine works."""
        raise NotImplementedError

    def usual_travel(self, leg: int) -> tuple[float, float]:
        """Return lengths of a leg around the middle of where the machine works, where its travel is not known."""
        length = float(self.usual_legs()[leg])
        return (1 - LEG_CHANGE) * length, (1 + LEG_CHANGE) * length

    def found_by_code(self, legs: Array) -> Array:
        """Return the poses, (n, pose_numbers), that emitted code finds for legs (n, legs), right or wrong."""
        return np.asarray(self.modes(legs)[:, 0])

    # the steps of a model, whose kernel is written with ``m``; vectors are columns of its values --------------------

    def heading(self, leg: int) -> int:
        """Return the direction of a leg's joints from the middle, degrees about z."""
        return list(self.legs.values())[leg]

    def base_joint(self, m: Steps, leg: int) -> Any:
        """Return where the drawing puts a leg's joint on the base."""
        raise NotImplementedError

    def platform_joint(self, m: Steps, leg: int) -> Any:
        """Return where the drawing puts a leg's joint on the platform, in platform axes."""
        raise NotImplementedError

    def state(self, m: Steps, numbers: Sequence[Any]) -> Any:
        """Return a pose, of which there are `pose_numbers`, as a step may change it."""
        raise NotImplementedError

    def numbers_of(self, state: Any) -> list[Any]:
        """Return the numbers of a pose, as a solver starts from them."""
        return list(state)

    def begin(self, m: Steps, half: Sequence[Any]) -> Any:
        """Return the state from which the pose is found without a start, given the halves of the legs' squares."""
        raise NotImplementedError

    def pose(self, m: Steps, arms: Sequence[Any], state: Any) -> Pose:
        """Return the pose of a state; `arms` are the platform's joints in its axes."""
        raise NotImplementedError

    def moved(self, m: Steps, state: Any, step: Any) -> Any:
        """Return the state after a step of the unknowns."""
        raise NotImplementedError

    def step_size(self, m: Steps, step: Any, spans: Sequence[Any]) -> Any:
        """Return the square of a step, in rad or parts of the size of the machine; `spans` are the legs after it."""
        return step.dot(step)

    def carried(self, m: Steps, pose: Pose, x: Any) -> Any:
        """Return where a target is, or a direction where the machine is measured by directions."""
        return pose.turn * x + pose.shift if m.structure.moving else pose.turn * x

    def carried_by(self, m: Steps, pose: Pose, x: Any) -> Any:
        """Return the derivative (3, unknowns) of where a target is."""
        raise NotImplementedError

    def closed_form(self, m: Steps, base: Sequence[Any]) -> tuple[Pose, Any] | None:
        """Return the pose and 0, or 1 where the legs do not close; None of a family that takes Newton's steps."""
        return None


def on_circle(m: Steps, radius: Any, degrees: float) -> Any:
    """Return a point of a circle about the origin in the plane z = 0, in a model."""
    cosine, sine = m.algebra.circle(degrees)
    return radius * m.matrix([cosine, sine, 0])


@dataclass(frozen=True)
class OnThreeLegs(OnLegs):
    """A platform on three legs, whose joints are on circles."""

    R: float
    r: float
    """Radii of the circles of the joints on the base and on the platform."""

    dimensions = ("leg_zero_offset", "base_joint_offset", "platform_joint_offset")
    number_words = MappingProxyType(
        {
            "R": ("base_radius", "radius of the joints on the base, {length}"),
            "r": ("platform_radius", "radius of the joints on the platform, {length}"),
            "q": ("offset", "from the middle of the platform's joints to its centre, {length}"),
            "h": ("pivot_height", "height of the pivot, {length}"),
        }
    )

    @property
    def size(self) -> float:
        """Radius of the base."""
        return self.R

    @property
    def fault(self) -> tuple[str, str, str] | None:
        """A radius that is not positive."""
        names = [name for name in "Rr" if not getattr(self, name) > 0]
        return (names[0], f"{getattr(self, names[0]):.6g}", "a positive radius") if names else None

    def base_joint(self, m: Steps, leg: int) -> Any:
        """Return the joint on the circle of the base."""
        return on_circle(m, self.R, self.heading(leg))

    def platform_joint(self, m: Steps, leg: int) -> Any:
        """Return the joint on the circle of the platform."""
        return on_circle(m, self.r, self.heading(leg))


def rotation_vectors(turns: Array, middle: Array) -> Array:
    """Return the rotation vectors, (n, 3), from a rotation to others, (n, 9), NaN where these are."""
    vectors = np.full((len(turns), 3), np.nan)
    closing = np.isfinite(turns).all(axis=1)
    vectors[closing] = rotation_vector(turns[closing].reshape(-1, 3, 3) @ middle.T)
    return vectors
