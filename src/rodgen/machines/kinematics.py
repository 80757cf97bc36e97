"""How joints carry the target: one after the other in a chain, or together as the legs of a platform.

In a closed chain a coordinate is the length of a leg, from its joint on the base to its joint on the platform. Where
the platform is follows from all of them together (the direct problem), and may have several answers, the assembly
modes.
In a delta a coordinate is the height of a carriage, or the angle of an arm, and the platform only shifts.
A family of such machines is a class here; how its model is derived stands in
:mod:`rodgen.machines.closed_chain_derivation`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np

from rodgen.array_types import Array
from rodgen.machines.rigid import rotation_matrix, rotation_vector

if TYPE_CHECKING:
    from rodgen.kinematics import delta, hexapod, three_sps_s, tricept

Vector: TypeAlias = tuple[float, float, float]

NEWTON_STEPS = 8
"""Newton's steps from where the platform may be to where it is, all over the workspace."""
LEG_CHANGE = 0.05
"""Part of its usual length by which a leg is assumed to change, either way, where no travel is known."""


@dataclass(frozen=True)
class Kinematics:
    """How the joints of a machine carry its target.

    Attributes
    ----------
    family : str
        Its name in machine files; empty for a chain of joints.
    words : str
        What people call it.
    legs : mapping of str to int
        Name of each leg, and where joints are on circles the direction of its joints from the middle, degrees about
        z.
    numbers : mapping of str to tuple of str
        What ``[geometry]`` gives, each with the names of its components; ``""`` of a plain number.
    keys : tuple of str
        All that may stand in ``[geometry]``.
    pose_numbers : int
        How many numbers describe a pose of the platform, for a solver to start from; 0 where none is needed.
    is_closed : bool
        Whether it is a closed chain, whose joints are legs.
    leg : str
        The type of these joints.
    dimensions : tuple of str
        Effects at them that say, beside `numbers`, that a dimension is not that of the file.
    start : tuple of float, length 3, or None
        Rotation vector in radians near which the assembly mode is; None where the file does not say, or need not.
    seen : tuple of tuple of float
        Further rotation vectors of that mode.
    home : tuple of float, length 3, or None
        Where the platform is in the middle of its workspace, if the file says so.
    """

    family: ClassVar[str] = ""
    words: ClassVar[str]
    legs: ClassVar[Mapping[str, int]] = MappingProxyType({})
    numbers: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({})
    keys: ClassVar[tuple[str, ...]] = ()
    pose_numbers: ClassVar[int] = 0
    is_closed: ClassVar[bool] = False
    leg: ClassVar[str] = "leg"
    dimensions: ClassVar[tuple[str, ...]] = ("leg_zero_offset",)

    @property
    def start(self) -> Vector | None:
        """Rotation vector near which the assembly mode is."""
        return None

    @property
    def seen(self) -> tuple[Vector, ...]:
        """Further rotation vectors of that mode."""
        return ()

    @property
    def home(self) -> Vector | None:
        """Position of the platform in the middle of its workspace."""
        return None

    @property
    def begins(self) -> Array:
        """Poses that code which finds poses by itself may begin with, (k, 0 and more): legs first."""
        return np.zeros((0, 0))

    @property
    def size(self) -> float:
        """Radius of the base, in the unit of the machine file; 0 of a chain of joints."""
        return 0.0

    def number(self, name: str) -> tuple[float, ...]:
        """Return one of the numbers of ``[geometry]``, as its components."""
        value = getattr(self, name)
        return value if isinstance(value, tuple) else (value,)

    def freedoms(self, joints: Sequence[str]) -> list[str]:
        """List what ``[estimate]`` may name, given the names of the joints."""
        raise NotImplementedError


@dataclass(frozen=True)
class Chain(Kinematics):
    """Joints of which each carries the next."""

    words = "chain of joints"

    def freedoms(self, joints: Sequence[str]) -> list[str]:
        """List the axis and the point of each joint, and the targets."""
        return [f"{joint}.{freedom}" for joint in joints for freedom in ("axis", "point")] + ["target"]


def carriers(j: int, inner: int) -> range:
    """Return the numbers of the joints that carry a joint, the bed's first.

    Parameters
    ----------
    j : int
        Number of the joint in the chain from the instrument to the target.
    inner : int
        How many joints, the first ones, carry the instrument; the bed is between them and the others.
    """
    return range(inner - 1, j, -1) if j < inner else range(inner, j)


def beyond(j: int, inner: int, joints: int) -> range:
    """Return the numbers of the joints that a joint carries, the next one first; the arguments as of `carriers`."""
    return range(j - 1, -1, -1) if j < inner else range(j + 1, joints)


@dataclass(frozen=True)
class OnLegs(Kinematics):
    """A platform on legs; lengths in the machine file's unit."""

    begin_of: ClassVar[tuple[str, ...]] = ()
    """What the numbers of a pose to begin with are."""
    is_closed = True

    @property
    def is_possible(self) -> bool:
        """Whether there may be such a machine."""
        return True

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

    def least_singular_value(self, poses: Array) -> Array:
        """Return how well the legs hold the platform: about 1 at best, 0 in a singular pose.

        Parameters
        ----------
        poses : ndarray, shape (n, pose_numbers)

        Returns
        -------
        ndarray, shape (n,)
            The least singular value of the derivative of the lengths of the legs with respect to the platform's
            freedoms. A turn by one radian counts as a way of the joints' distance from where it turns about.
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

    def mode_words(self) -> str:
        """Say which of the poses that lengths of legs allow the emitted code finds."""
        raise NotImplementedError

    def found_by_code(self, legs: Array) -> Array:
        """Return the poses, (n, pose_numbers), that emitted code finds for legs (n, legs), right or wrong."""
        return np.asarray(self.modes(legs)[:, 0])


@dataclass(frozen=True)
class OnThreeLegs(OnLegs):
    """A platform on three legs, whose joints are on circles."""

    R: float
    r: float
    """Radii of the circles of the joints on the base and on the platform."""

    @property
    def size(self) -> float:
        """Radius of the base."""
        return self.R

    @property
    def is_possible(self) -> bool:
        """Whether both radii are positive."""
        return min(self.R, self.r) > 0


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

        found = tricept.matrices(poses, self._geometry())
        slopes = np.linalg.solve(found.W35[..., :3], -found.W33) / np.array([self.R, self.R, 1.0])
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


@dataclass(frozen=True)
class ThreeSpsS(OnThreeLegs):
    """Three legs, and a pivot about which the platform turns; its pose is a rotation matrix, row by row."""

    h: float = 0.0
    """Height of the pivot above the base."""
    start: Vector | None = None
    """Rotation vector in radians; the assembly mode is the one nearest to it, else the one nearest to the readings."""
    seen: tuple[Vector, ...] = field(default=(), compare=False, repr=False)
    """Of a machine that was measured: further rotation vectors of that mode, from which all that were measured are
    found; for code that finds poses by itself. They stand in no file."""

    family = "3-sps-s"
    words = "3-SPS-S: three legs, and a pivot about which the platform turns"
    legs = MappingProxyType({"L1": -30, "L2": 90, "L3": 210})
    numbers = MappingProxyType({"R": ("",), "r": ("",), "h": ("",)})
    keys = ("R", "r", "h", "start")
    pose_numbers = 9
    begin_of = ("leg1", "leg2", "leg3", "w", "x", "y", "z")

    @property
    def begins(self) -> Array:
        """Lengths of the legs, and unit quaternions."""
        if self.start is None:
            return np.zeros((0, 7))
        from rodgen.kinematics.rotation import quaternion_from_matrix

        turns = rotation_matrix([self.start, *self.seen])
        return np.concatenate([self.legs_at(turns), quaternion_from_matrix(turns)[0]], axis=1)

    def degrees_of_freedom(self, poses: Array) -> Array:
        """Return the rotation vectors from the start."""
        return poses if self.start is None else _rotation_vectors(poses, rotation_matrix(self.start))

    def modes(self, legs: Array) -> Array:
        """Return the rotation matrices of up to eight modes, (n, 8, 9)."""
        from rodgen.kinematics import three_sps_s

        turns = np.asarray(three_sps_s.direct_all(legs, self._geometry())[0])
        return turns.reshape(*turns.shape[:-2], 9)

    def placed(self, poses: Array, targets: Array, *, moving: bool) -> Array:
        """Return the targets turned, and shifted by the height of the pivot."""
        turned = np.einsum("...ij,...j->...i", poses.reshape(*poses.shape[:-1], 3, 3), targets)
        return np.asarray(turned + np.array([0.0, 0.0, self.h])) if moving else np.asarray(turned)

    def least_singular_value(self, poses: Array) -> Array:
        """Return the least gain of the legs' lengths over a turn of the platform."""
        from rodgen.kinematics import three_sps_s

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
        from rodgen.kinematics import three_sps_s

        return np.asarray(three_sps_s.legs(turns, self._geometry()))

    def found_by_code(self, legs: Array) -> Array:
        """Return the rotation matrices, (n, 9), that emitted code finds, right or wrong."""
        begins = np.eye(3)[None] if self.start is None else rotation_matrix([self.start, *self.seen])
        return self.found_from(begins, legs).reshape(-1, 9)

    def found_from(self, begins: Array, legs: Array) -> Array:
        """Return the rotations, (n, 3, 3), that emitted code finds: from the beginning whose legs are the nearest.

        Parameters
        ----------
        begins : ndarray, shape (k, 3, 3)
        legs : ndarray, shape (n, 3)
        """
        from rodgen.kinematics import three_sps_s
        from rodgen.kinematics.rotation import matrix_from_rodrigues_vector

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
        from rodgen.kinematics import three_sps_s

        return three_sps_s.Geometry(self.R, self.r, self.h)


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
    keys = (*numbers, "home")
    pose_numbers = 12
    begin_of = (*(f"leg{k}" for k in range(1, 7)), "x", "y", "z")

    @property
    def size(self) -> float:
        """Root mean square distance of the base's joints from their middle."""
        return self._geometry().size

    @property
    def pose_scale(self) -> Array:
        """The size of the base, and a radian."""
        return np.repeat([self.size, 1.0], [3, 9])

    @property
    def begins(self) -> Array:
        """Lengths of the legs, and position, of `home`."""
        return np.concatenate([self.usual_legs(), self.home])[None]

    def modes(self, legs: Array) -> Array:
        """Return the one pose that belongs to `home`."""
        from rodgen.kinematics import hexapod

        position, turn, _ = hexapod.direct(legs, self._geometry(), self.home)
        return np.concatenate([position, turn.reshape(-1, 9)], axis=1)[:, None]

    def found_by_code(self, legs: Array) -> Array:
        """Return the poses, (n, 12), that emitted code finds, right or wrong."""
        from rodgen.kinematics import hexapod

        position, turn = hexapod.by_newton(legs, self._geometry(), self.home, NEWTON_STEPS)
        return np.concatenate([position, turn.reshape(-1, 9)], axis=1)

    def least_singular_value(self, poses: Array) -> Array:
        """Return the least singular value of the derivative of the legs."""
        from rodgen.kinematics import hexapod

        turns = poses[:, 3:].reshape(-1, 3, 3)
        return hexapod.least_singular_value(poses[:, :3], turns, self._geometry())

    def degrees_of_freedom(self, poses: Array) -> Array:
        """Return positions and rotation vectors, (n, 6)."""
        return np.concatenate([poses[:, :3], _rotation_vectors(poses[:, 3:], np.eye(3))], axis=1)

    def usual_legs(self) -> Array:
        """Return the lengths at `home`."""
        from rodgen.kinematics import hexapod

        return hexapod.legs(self.home, np.eye(3), self._geometry())

    def mode_words(self) -> str:
        """Say from where the pose is found."""
        x = ", ".join(f"{c:.6g}" for c in self.home)
        return f"by Newton's steps from where it is parallel to the base at ({x})"

    def _geometry(self) -> hexapod.Geometry:
        from rodgen.kinematics import hexapod

        base, platform = (np.array([self.number(f"{of}{k}") for k in range(1, 7)]) for of in "BP")
        return hexapod.Geometry(base, platform)


@dataclass(frozen=True)
class _Delta(OnLegs):
    """Three pairs of rods that shift a platform; its pose is its position, which a model solves for in closed form."""

    R: float
    L: float
    """Radius of the rods' upper joints less that of the lower ones; length of the rods."""

    @property
    def is_possible(self) -> bool:
        """Whether the rods are longer than the radius at which they begin."""
        return self.L > 0

    @property
    def pose_scale(self) -> Array:
        """The size of the machine."""
        return np.full(3, self.size)

    def modes(self, legs: Array) -> Array:
        """Return the position below the upper joints of the rods."""
        return np.asarray(self._position(legs))[:, None]

    def least_singular_value(self, poses: Array) -> Array:
        """Return the least singular value of the directions of the rods."""
        from rodgen.kinematics import delta

        rods: Array = delta.rods(poses, self._geometry())
        good = np.asarray(np.isfinite(rods).all(axis=(1, 2)))
        gains = np.linalg.svd(np.where(good[:, None, None], rods, 0.0), compute_uv=False)
        return np.asarray(np.where(good, gains[:, -1], np.nan))

    def mode_words(self) -> str:
        """Say where the platform hangs."""
        return "below the upper joints of the rods"

    def _position(self, legs: Array) -> Array:
        raise NotImplementedError

    def _geometry(self) -> delta.LinearGeometry | delta.RotaryGeometry:
        raise NotImplementedError


@dataclass(frozen=True)
class LinearDelta(_Delta):
    """Rods on the carriages of three vertical towers; a coordinate is the height of a carriage."""

    family = "linear-delta"
    words = "linear delta: rods on the carriages of three towers"
    legs = MappingProxyType({"A": 210, "B": 330, "C": 90})
    numbers = MappingProxyType({"R": ("",), "L": ("",)})
    keys = ("R", "L")
    leg = "tower"
    dimensions = ("zero_offset", "delta_angle")

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

    def _position(self, legs: Array) -> Array:
        from rodgen.kinematics import delta

        return np.asarray(delta.linear_direct(legs, self._geometry())[0])

    def _geometry(self) -> delta.LinearGeometry:
        from rodgen.kinematics import delta

        heading = tuple(float(x) for x in self.legs.values())
        return delta.LinearGeometry(self.R, self.L, heading)  # type: ignore[arg-type]


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
    dimensions = ("zero_offset", "delta_angle")

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

    def _position(self, legs: Array) -> Array:
        from rodgen.kinematics import delta

        return np.asarray(delta.rotary_direct(legs, self._geometry())[0])

    def _geometry(self) -> delta.RotaryGeometry:
        from rodgen.kinematics import delta

        heading = tuple(float(x) for x in self.legs.values())
        return delta.RotaryGeometry(self.R, self.A, self.L, heading)  # type: ignore[arg-type]


def _rotation_vectors(turns: Array, middle: Array) -> Array:
    """Return the rotation vectors, (n, 3), from a rotation to others, (n, 9), NaN where these are."""
    found = np.full((len(turns), 3), np.nan)
    closing = np.isfinite(turns).all(axis=1)
    found[closing] = rotation_vector(turns[closing].reshape(-1, 3, 3) @ middle.T)
    return found


FAMILIES: Mapping[str, type[OnLegs]] = MappingProxyType(
    {made.family: made for made in (Tricept, ThreeSpsS, Hexapod, LinearDelta, RotaryDelta)}
)
"""All families of closed chains, by their names in a machine file."""
