"""What all families of machines say of themselves, and the family of chains, whose joints carry each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np

from rodgen.array_types import Array

Vector: TypeAlias = tuple[float, float, float]


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
        All that may be in ``[geometry]``.
    number_words : mapping of str to tuple of str
        Of each number its name in emitted code, and what it is.
    pose_numbers : int
        How many numbers describe a pose of the platform, for a solver to start from; 0 where none is needed.
    is_closed : bool
        Whether it is a closed chain, whose joints are legs.
    has_modes : bool
        Whether legs of the same lengths allow several poses that are physically possible, of which `start` is one.
    leg, coordinate : str
        The type of these joints, and what their coordinates are.
    begin_of : tuple of str
        What the numbers of each pose in `begins` are.
    dimensions : tuple of str
        Effects at them that say, beside `numbers`, that a dimension is not that of the file.
    of_all_legs : tuple of str
        Effects of all legs together that it may have.
    are_shared : bool
        Whether all legs share each of `numbers`.
    one_by_one : bool
        Whether these have all that `numbers` have, each for one joint.
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
    number_words: ClassVar[Mapping[str, tuple[str, str]]] = MappingProxyType({})
    pose_numbers: ClassVar[int] = 0
    is_closed: ClassVar[bool] = False
    has_modes: ClassVar[bool] = False
    leg: ClassVar[str] = "leg"
    coordinate: ClassVar[str] = "length of leg"
    begin_of: ClassVar[tuple[str, ...]] = ()
    dimensions: ClassVar[tuple[str, ...]] = ("leg_zero_offset",)
    of_all_legs: ClassVar[tuple[str, ...]] = ("common_zero_offset",)
    are_shared: ClassVar[bool] = True
    one_by_one: ClassVar[bool] = False

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

    def dimension(self, effect: str) -> tuple[str, float] | None:
        """Return the dimension that an effect of all legs changes, in words and by the file; None of others."""
        return None

    def freedoms(self, joints: Sequence[str]) -> list[str]:
        """List what ``[estimate]`` may name, given the names of the joints."""
        raise NotImplementedError

    def usual_travel(self, leg: int) -> tuple[float, float] | None:
        """Return coordinates around the middle of where the machine works; None of a joint of a chain."""
        return None

    def mode_words(self) -> str:
        """Say which of the poses that lengths of legs allow the emitted code finds; empty of a chain."""
        return ""

    def found_by_code(self, legs: Array) -> Array:
        """Return the poses, (n, pose_numbers), that emitted code finds for legs (n, legs), right or wrong."""
        return np.zeros((len(legs), 0))

    def least_singular_value(self, poses: Array) -> Array:
        """Return how well the legs hold the platform, (n,): about 1 at best, 0 in a singular pose.

        Parameters
        ----------
        poses : ndarray, shape (n, pose_numbers)

        Returns
        -------
        ndarray, shape (n,)
            The least singular value of the derivative of the lengths of the legs with respect to the platform's
            freedoms. A turn by one radian counts as a way of the joints' distance from where it turns about.
        """
        return np.ones(len(poses))

    def with_numbers(self, numbers: Mapping[str, Sequence[Any]]) -> Self:
        """Return the machine with other numbers of ``[geometry]``, given as their components."""
        changed: dict[str, Any] = {n: tuple(x) if len(x) > 1 else x[0] for n, x in numbers.items()}
        return replace(self, **changed)

    def in_mode(self, start: Vector | None) -> Self:
        """Return the machine in the assembly mode of a rotation vector, or in that of its readings."""
        return self

    def with_seen(self, poses: Array, legs: Array) -> Self:
        """Return the machine with `seen` such that emitted code finds poses (n, pose_numbers) for legs (n, legs)."""
        return self


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
