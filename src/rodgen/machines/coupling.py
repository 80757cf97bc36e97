"""Coupled joints: joints whose coordinate is a linear combination of what the controller reads.

A joint has a reading, which is its column in the measurements and what the controller commands; its coordinate, by
which it moves what it carries, is the same, unless the machine file states another one. ``coordinate = "J3m - J2m"`` is
that of an arm which a parallelogram drives; ``coordinate = "-(J2 + J3)"`` that of a flange which rods keep level, with
no reading at all. So q, wherever it stands for what is measured or commanded, is made of readings; only kernels, and
what draws or describes bodies, need coordinates.

An error of a reading (of an encoder, a drive) changes every coordinate that the reading is in; one of a joint without a
reading changes its coordinate. The moment on a drive is what does the work of its reading: the sum of the moments about
the joints, each times the factor with which they follow it.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rodgen.errors import UnexpectedError, shown
from rodgen.machines.linear import Combination, combination
from rodgen.machines.parts import Joint, MachineData

_ROUNDING = 1e-12
"""Factors below this are rounding of an inverse matrix."""


class CouplingError(UnexpectedError):
    """A coordinate or a reading that cannot be: the joint, the key, what was found, and what was expected."""

    def __init__(self, joint: str, key: str, found: str, expected: str) -> None:
        self.joint = joint
        self.key = key
        super().__init__(found, expected)
        self.args = (joint, key, found, expected)

    def __str__(self) -> str:
        return f"joint {self.joint}, {self.key}: {super().__str__()}"


@dataclass(frozen=True)
class Coupling:
    """A coordinate as a combination of readings, internal units."""

    factors: tuple[tuple[int, Fraction], ...]
    """Numbers of the joints whose readings they are, in rising order, and the factors, none of them zero."""
    constant: Fraction


@dataclass(frozen=True)
class Couplings:
    """How the coordinates of a machine's joints follow from its readings."""

    of: tuple[Coupling | None, ...]
    """Of each joint; None where the coordinate is the reading."""
    stated: tuple[Combination | None, ...] = ()
    """As the machine file says it, by names of readings and joints."""

    def coordinates(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coordinates that belong to readings, (..., J) each; those of joints without one do not count."""
        return np.asarray(q @ self._matrix.T + self._constant)

    def rates(self, v: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the speeds of the coordinates that belong to those of the readings, (..., J)."""
        return np.asarray(v @ self._matrix.T)

    @cached_property
    def _matrix(self) -> NDArray[np.float64]:
        matrix = np.eye(len(self.of))
        for j, coupling in enumerate(self.of):
            if coupling is not None:
                matrix[j] = 0.0
                for i, factor in coupling.factors:
                    matrix[j, i] = float(factor)
        return matrix

    @cached_property
    def _constant(self) -> NDArray[np.float64]:
        return np.array([0.0 if coupling is None else float(coupling.constant) for coupling in self.of])

    def ranges(self, travel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return between which values coordinates are while readings are within some, (J, 2) each."""
        return _interval(self._matrix, travel) + self._constant[:, None]

    def readings_within(self, travel: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return between which values readings are while coordinates are within some, (J, 2) each.

        NaN of a reading that coordinates do not bound.
        """
        read = [j for j, coupling in enumerate(self.of) if coupling is None or j in dict(coupling.factors)]
        among = self._matrix[np.ix_(read, read)]
        found = np.full((len(self.of), 2), np.nan)
        if np.linalg.matrix_rank(among) == len(read):
            inverse = np.asarray(np.linalg.inv(among), float)
            found[read] = _interval(inverse, (travel - self._constant[:, None])[read])
        return found


def _interval(matrix: NDArray[np.float64], ranges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the ranges of matrix x while x is within ranges; NaN where one is not known that counts."""
    matrix = np.where(np.abs(matrix) < _ROUNDING, 0.0, matrix)[:, :, None]
    ends = np.where(matrix == 0, 0.0, matrix * ranges)
    return np.stack([ends.min(axis=2).sum(axis=1), ends.max(axis=2).sum(axis=1)], axis=1)


def couplings_of(machine: MachineData) -> Couplings | None:
    """Return how coordinates follow from readings; None where each is the joint's reading.

    Raises
    ------
    CouplingError
    """
    if not any(joint.coordinate or joint.reading for joint in machine.joints):
        return None
    return _Couplings(machine).found


class _Couplings:
    """Finds the readings behind every coordinate, through the coordinates of other joints."""

    def __init__(self, machine: MachineData) -> None:
        self.machine = machine
        self.joints = {joint.name: joint for joint in machine.joints}
        self.number = {name: j for j, name in enumerate(self.joints)}
        self.readings = {joint.column: j for j, joint in enumerate(machine.joints) if joint.is_read}
        self._check_names()
        self.done: dict[str, Coupling] = {}
        self.stated: dict[str, Combination] = {}
        found = [self._of(joint, ()) for joint in machine.joints]
        for joint, coupling in zip(machine.joints, found, strict=True):
            if joint.reading and self.number[joint.name] not in dict(coupling.factors):
                text = f"{shown(joint.coordinate)}, without {shown(joint.reading)}, the joint's reading"
                raise CouplingError(joint.name, "coordinate", text, "a combination with it, or no reading")
        own = [Coupling(((j, Fraction(1)),), Fraction(0)) for j in range(len(found))]
        of = tuple(None if a == b else a for a, b in zip(found, own, strict=True))
        stated = tuple(self.stated.get(joint.name) for joint in machine.joints)
        self.found = Couplings(of, stated) if any(of) else None

    def _check_names(self) -> None:
        targets = {target.name for target in self.machine.targets}
        seen: dict[str, str] = {}
        for joint in self.joints.values():
            if joint.reading is None:
                continue
            if joint.reading != joint.name and joint.reading in self.joints.keys() | targets:
                found = f"{shown(joint.reading)}, the name of another joint or target"
                raise CouplingError(
                    joint.name, "reading", found, f"a name of its own, such as '{joint.name}m'"
                )
            if joint_there := seen.get(joint.reading):
                found = f"{shown(joint.reading)}, which is that of joint {joint_there}"
                raise CouplingError(joint.name, "reading", found, "a reading of its own")
            seen[joint.reading] = joint.name

    def _of(self, joint: Joint, above: tuple[str, ...]) -> Coupling:
        if joint.name in self.done:
            return self.done[joint.name]
        if joint.coordinate is None:
            return Coupling(((self.number[joint.name], Fraction(1)),), Fraction(0))
        if joint.name in above:
            way = " follows ".join([*above[above.index(joint.name) :], joint.name])
            found = f"a circle, {way}"
            raise CouplingError(above[-1], "coordinate", found, "readings at the end of the way")
        names = {name: self.machine.joints[j].dimension for name, j in self.readings.items()}
        names |= {name: other.dimension for name, other in self.joints.items()}
        try:
            coupling = combination(
                joint.coordinate, names, joint.dimension, self.machine.length_unit, "joint or reading"
            )
        except UnexpectedError as error:
            if isinstance(error, CouplingError):
                raise
            raise CouplingError(joint.name, "coordinate", error.found, error.expected) from None
        self.stated[joint.name] = coupling
        if not coupling.factors:
            raise CouplingError(
                joint.name, "coordinate", "a constant", "what it follows, such as 'J3m - J2m'"
            )
        factors: dict[int, Fraction] = {}
        constant = coupling.constant
        for name, factor in coupling.factors:
            parts, start = self._parts(name, (*above, joint.name))
            constant += factor * start
            for i, x in parts:
                factors[i] = factors.get(i, Fraction(0)) + factor * x
        self.done[joint.name] = Coupling(tuple((i, x) for i, x in sorted(factors.items()) if x), constant)
        return self.done[joint.name]

    def _parts(self, name: str, above: tuple[str, ...]) -> tuple[tuple[tuple[int, Fraction], ...], Fraction]:
        joint = self.joints.get(name)
        # by its own name a joint refers to its reading, where both have that name
        if joint is not None and not (name == above[-1] == joint.reading):
            found = self._of(joint, above)
            return found.factors, found.constant
        return ((self.readings[name], Fraction(1)),), Fraction(0)
