"""Deltas: three pairs of rods that shift a platform, from carriages on towers or from the ends of arms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from rodgen.array_types import Array
from rodgen.kinematics import delta
from rodgen.machines.families.on_legs import OnLegs, Pose, Steps
from rodgen.symbolic import legs as leg_steps


@dataclass(frozen=True)
class _Delta(OnLegs):
    """Three pairs of rods that shift a platform; its pose is its position, which a model solves for in closed form."""

    R: float
    L: float
    """Radius of the rods' upper joints less that of the lower ones; length of the rods."""

    dimensions: ClassVar[tuple[str, ...]] = ("zero_offset", "delta_angle", "delta_radius", "rod_length")
    one_by_one = True
    number_words = MappingProxyType(
        {
            "R": ("base_radius", "radius of the rods' upper joints less that of the lower ones, {length}"),
            "L": ("rod_length", "length of the rods, {length}"),
            "A": ("arm_length", "length of the arms, {length}"),
        }
    )

    @property
    def fault(self) -> tuple[str, str, str] | None:
        """Rods that do not reach the middle from where they begin, with an arm drawn in."""
        least = max(self.R - getattr(self, "A", 0.0), 0.0)
        if least < self.L:
            return None
        return "L", f"{self.L:.6g}: the rods end before the middle", f"a length above {least:.6g}"

    @property
    def pose_scale(self) -> Array:
        """The size of the machine."""
        return np.full(3, self.size)

    def least_singular_value(self, poses: Array) -> Array:
        """Return the least singular value of the directions of the rods."""
        rods: Array = delta.rods(poses, self._geometry())
        good = np.asarray(np.isfinite(rods).all(axis=(1, 2)))
        gains = np.linalg.svd(np.where(good[:, None, None], rods, 0.0), compute_uv=False)
        return np.asarray(np.where(good, gains[:, -1], np.nan))

    def mode_words(self) -> str:
        """Say where the platform hangs."""
        return "below the upper joints of the rods"

    def _geometry(self) -> Any:
        """Return the geometry as `rodgen.kinematics.delta` has it."""
        raise NotImplementedError

    def _headings(self) -> tuple[float, ...]:
        return tuple(float(x) for x in self.legs.values())

    # the platform hangs where three spheres about the upper joints of the rods meet

    def base_joint(self, m: Steps, leg: int) -> Any:
        """Return the upper joint of a leg's rods, on its carriage or arm."""
        cosine, sine = m.algebra.circle(self.heading(leg))
        if m.terms_of(leg, "heading"):
            c, s = m.turn(m.changed(leg, "heading", 0))
            cosine, sine = m.let("cosine", cosine * c - sine * s), m.let("sine", sine * c + cosine * s)
        outwards, across = m.matrix([cosine, sine, 0]), m.matrix([-sine, cosine, 0])
        m.directions[leg] = {"U": outwards, "V": across, "N": m.matrix([0, 0, 1])}
        out, height = self.reach(m, leg, m.let("coordinate", m.changed(leg, "reading", m.column["q", leg])))
        return leg_steps.upper_joint(m, (cosine, sine), out, height)

    def reach(self, m: Steps, leg: int, coordinate: Any) -> tuple[Any, Any]:
        """Return how far out, and how high, the upper joint of a rod is drawn."""
        raise NotImplementedError

    def platform_joint(self, m: Steps, leg: int) -> Any:
        """Return the middle of the platform, as R is less by its radius."""
        return m.zero

    def closed_form(self, m: Steps, base: Sequence[Any]) -> tuple[Pose, Any]:
        """Return the pose, and whether the spheres do not meet."""
        rods = [m.changed(k, "rod", self.L) for k in range(len(base))]
        meet = leg_steps.three_spheres(m, base, [m.let("square", rod**2) for rod in rods])
        meets = meet.ratio > 0
        below = m.let("below", m.sqrt(m.select(meets, meet.ratio, 1)))
        down = m.let("down", m.select(meet.normal[2] < 0, below, -below))
        place, unit = m.let("platform", meet.foot + meet.normal * down), m.matrix.eye(3)
        return Pose(place, unit, place, [place] * len(rods), [unit] * len(rods)), m.select(meets, 0, 1)


@dataclass(frozen=True)
class LinearDelta(_Delta):
    """Rods on the carriages of three vertical towers; a coordinate is the height of a carriage."""

    family = "linear-delta"
    words = "linear delta: rods on the carriages of three towers"
    legs = MappingProxyType({"A": 210, "B": 330, "C": 90})
    numbers = MappingProxyType({"R": ("",), "L": ("",)})
    keys = ("R", "L")
    leg = "tower"
    coordinate = "height of the carriage of tower"

    @property
    def size(self) -> float:
        """Length of the rods."""
        return self.L

    def usual_legs(self) -> Array:
        """Return the heights with the platform in the middle of the plane z = 0."""
        return np.full(3, np.sqrt(max(self.L**2 - self.R**2, 0.0)))

    def usual_travel(self, leg: int) -> tuple[float, float]:
        """Return an eighth of a rod above and below that."""
        height = float(self.usual_legs()[leg])
        return height - self.L / 8, height + self.L / 8

    def modes(self, legs: Array) -> Array:
        """Return the position below the carriages."""
        return np.asarray(delta.linear_direct(legs, self._geometry())[0])[:, None]

    def _geometry(self) -> delta.LinearGeometry:
        return delta.LinearGeometry(self.R, self.L, self._headings())  # type: ignore[arg-type]

    def reach(self, m: Steps, leg: int, coordinate: Any) -> tuple[Any, Any]:
        """Return the radius of the towers, and the height of the carriage."""
        return self.R, coordinate


@dataclass(frozen=True)
class RotaryDelta(_Delta):
    """Rods at the ends of three arms (Clavel); a coordinate is the angle of an arm, positive downwards."""

    A: float
    """Length of the arms."""

    family = "rotary-delta"
    words = "rotary delta: rods at the ends of three arms"
    legs = MappingProxyType({"A1": 0, "A2": 120, "A3": 240})
    numbers = MappingProxyType({"R": ("",), "A": ("",), "L": ("",)})
    keys = ("R", "A", "L")
    leg = "arm"
    coordinate = "angle of arm"
    dimensions = (*_Delta.dimensions, "arm_length")

    @property
    def size(self) -> float:
        """Length of an arm."""
        return self.A

    def usual_legs(self) -> Array:
        """Return level arms."""
        return np.zeros(3)

    def usual_travel(self, leg: int) -> tuple[float, float]:
        """Return an eighth of a turn up and down."""
        return -np.pi / 4, np.pi / 4

    def modes(self, legs: Array) -> Array:
        """Return the position below the ends of the arms."""
        return np.asarray(delta.rotary_direct(legs, self._geometry())[0])[:, None]

    def _geometry(self) -> delta.RotaryGeometry:
        return delta.RotaryGeometry(self.R, self.A, self.L, self._headings())  # type: ignore[arg-type]

    def reach(self, m: Steps, leg: int, coordinate: Any) -> tuple[Any, Any]:
        """Return where the end of the arm is."""
        return leg_steps.elbow(self.R, m.changed(leg, "arm", self.A), m.turn(coordinate))
