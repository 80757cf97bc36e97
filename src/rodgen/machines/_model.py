"""A machine's model as numbers: its geometry with the current values of the parameters, and its compiled kernels."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.codegen.rows import row_kernels
from rodgen.machines._parameters import Parameter, parameters_of
from rodgen.machines._rigid import complete_basis, left_jacobian, rotation_matrix, tilted
from rodgen.machines._structure import Structure, row_effects, structure_of
from rodgen.machines.machine import Machine

__all__ = ["Frame", "Model"]

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Frame:
    """Where the measuring frame is: a reading is ``rotation @ x + position`` of a point x in machine axes.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
    position : ndarray, shape (3,)
        Length unit of the machine.
    """

    rotation: Array
    position: Array

    @classmethod
    def identity(cls) -> Frame:
        """Return the machine's own frame."""
        return cls(np.eye(3), np.zeros(3))

    def moved(self, change: Mapping[str, float]) -> Frame:
        """Return the frame after small changes of ``x y z rx ry rz``; the turn is about machine axes."""
        turn = np.array([change.get(x, 0.0) for x in ("rx", "ry", "rz")])
        shift = np.array([change.get(x, 0.0) for x in "xyz"])
        return Frame(self.rotation @ rotation_matrix(turn), self.position + shift)


@functools.lru_cache(maxsize=64)
def _kernels(structure: Structure) -> Mapping[str, Any]:
    def make() -> Sequence[Any]:
        from rodgen.machines._derive import derive_kernels

        return derive_kernels(structure)

    kernels: Mapping[str, Any] = row_kernels(_key(structure), make, shared=("g", "e"))
    return kernels


def _key(structure: Structure) -> str:
    return f"{structure!r} {_source_hash()}"


@functools.cache
def _source_hash() -> str:
    """Return a hash of the text that turns a structure into kernels: a change of it makes them anew."""
    import hashlib
    from importlib.resources import files

    folder = files("rodgen.machines")
    names = ("_derive.py", "_structure.py", "formula.py")
    return hashlib.sha256(b"".join((folder / name).read_bytes() for name in names)).hexdigest()


class Model:
    """A machine with its parameters, its geometry and its kernels.

    Parameters
    ----------
    machine : Machine
    travel : array_like, shape (joints, 2), optional
        Range of each joint, internal units; from the machine file where it is given there.
    runs : sequence of str
        Names of the set-ups in the data.

    Attributes
    ----------
    parameters : tuple of Parameter
    structure : Structure
    """

    def __init__(self, machine: Machine, travel: Any = None, runs: Sequence[str] = ("",)) -> None:
        self.machine = machine
        self.structure = structure_of(machine)
        self.parameters: tuple[Parameter, ...] = parameters_of(machine, self.structure, runs)
        self.index = {p.slot: i for i, p in enumerate(self.parameters)}
        self.keys = {p.key: i for i, p in enumerate(self.parameters)}
        self.travel = self._travel(travel)
        self._row_effects = row_effects(machine)
        self._bases = [complete_basis(np.array(joint.axis)) for joint in machine.joints]
        directions = machine.targets if machine.measured.kind == "direction" else ()
        self._target_bases = [complete_basis(np.array(t.point)) for t in directions]

    def _travel(self, travel: Any) -> Array:
        given = [joint.travel for joint in self.machine.joints]
        found = np.zeros((len(given), 2)) if travel is None else np.asarray(travel, float)
        return np.array([f if g is None else g for f, g in zip(found, given, strict=True)])

    @property
    def kernels(self) -> Mapping[str, Any]:
        """The compiled kernels ``place``, ``residual``, ``residual_and_jacobian``; made when first asked for."""
        return _kernels(self.structure)

    def start(self) -> Array:
        """Return the values that a fit starts from: what is held, what was fitted before, else zero.

        A parameter that is searched has no meaning at zero; it starts at 1 until the search.
        """
        given = self.machine.values
        values = [
            p.hold if p.hold is not None else given.get(p.key, 1.0 if p.searched else 0.0)
            for p in self.parameters
        ]
        return np.array(values, dtype=float)

    # the geometry --------------------------------------------------------------------------------------------

    def value(self, theta: Array, *slot: object) -> float:
        """Return a parameter's value, zero where there is no such parameter."""
        index = self.index.get(slot)
        return 0.0 if index is None else float(theta[index])

    def parameters_of_effects(self, theta: Array) -> Array:
        """Return the kernel's vector ``e``; one zero where there are no effects."""
        return np.array([self.value(theta, "e", n, name) for n, name in self.structure.parameters] or [0.0])

    def axis(self, theta: Array, j: int) -> tuple[Array, Array]:
        """Return a joint's axis and its derivative (3, 2) with respect to its two freedoms."""
        u, v = self._bases[j]
        tilt = np.array([self.value(theta, "axis.a", j), self.value(theta, "axis.b", j)])
        return tilted(np.array(self.machine.joints[j].axis), u, v, tilt)

    def point(self, theta: Array, j: int) -> Array:
        """Return the point of a joint, length unit."""
        u, v = self._bases[j]
        a, b = self.value(theta, "point.a", j), self.value(theta, "point.b", j)
        return np.array(self.machine.joints[j].point) + a * u + b * v

    def target(self, theta: Array, k: int) -> tuple[Array, Array]:
        """Return a target and its derivative (3, freedoms)."""
        point = np.array(self.machine.targets[k].point)
        if self.structure.moving:
            return point + [self.value(theta, "target", k, x) for x in "xyz"], np.eye(3)
        u, v = self._target_bases[k]
        return tilted(point, u, v, np.array([self.value(theta, "target", k, x) for x in "ab"]))

    def shift(self, theta: Array, run: int) -> tuple[Array, Array]:
        """Return rotation vector and translation of the frame shift of a run."""
        turn = [self.value(theta, "shift", run, x) for x in ("rx", "ry", "rz")]
        return np.array(turn), np.array([self.value(theta, "shift", run, x) for x in "xyz"])

    def geometries(self, theta: Array, frame: Frame, groups: Sequence[tuple[int, int]]) -> list[Array]:
        """Return the kernel's vector ``g`` for several pairs of target and set-up.

        Parameters
        ----------
        theta : ndarray, shape (parameters,)
            Internal units.
        frame : Frame
            Of the measurements; used where it is free.
        groups : sequence of (int, int)
            Number of the target that is seen, and of the set-up.
        """
        common = self._common(theta, frame)
        return [self._filled(common, self._of_group(theta, target, run)) for target, run in groups]

    def geometry(self, theta: Array, frame: Frame, target: int, run: int = 0) -> Array:
        """Return the kernel's vector ``g`` for one target and set-up; see :meth:`geometries`."""
        return self.geometries(theta, frame, [(target, run)])[0]

    def _filled(self, common: Mapping[Any, Any], own: Mapping[Any, Any]) -> Array:
        g = np.empty(sum(length for _, _, length in self.structure.geometry))
        start = 0
        for name, number, length in self.structure.geometry:
            key = (name, number)
            g[start : start + length] = own[key] if key in own else common[key]
            start += length
        return g

    def _common(self, theta: Array, frame: Frame) -> dict[tuple[str, int], Any]:
        """Return the parts of ``g`` that all targets and set-ups share."""
        parts: dict[tuple[str, int], Any] = {
            ("frame_rotation", 0): frame.rotation.ravel(),
            ("frame", 0): frame.position,
            ("gravity", 0): self.machine.gravity,
            ("origin", 0): self.machine.measured.origin,
        }
        for j, joint in enumerate(self.structure.joints):
            parts["axis", j] = self.machine.joints[j].axis
            if joint.axis:
                parts["axis", j], by = self.axis(theta, j)
                parts["axis_by_a", j], parts["axis_by_b", j] = by.T
            parts["point", j] = self.point(theta, j) if joint.point else self.machine.joints[j].point
            parts["u", j], parts["v", j] = self._bases[j]
            parts["start", j], end = self.travel[j]
            parts["length", j] = end - self.travel[j, 0]
        if self.structure.centre:
            targets = range(len(self.machine.targets))
            parts["centre", 0] = np.mean([self.target(theta, k)[0] for k in targets], axis=0)
        return parts

    def _of_group(self, theta: Array, target: int, run: int) -> dict[tuple[str, int], Any]:
        """Return the parts of ``g`` that depend on the target or the set-up."""
        point, by = self.target(theta, target)
        parts: dict[tuple[str, int], Any] = {("target", 0): point}
        if not self.structure.moving:
            parts["target_by_a", 0], parts["target_by_b", 0] = by.T
        if self.structure.shift:
            turn, shift = self.shift(theta, run)
            parts["shift_rotation", 0] = rotation_matrix(turn).ravel()
            parts["shift_turns", 0] = left_jacobian(turn).ravel()
            parts["shift", 0] = shift
        name = self.machine.targets[target].name
        for n, term in enumerate(self.structure.terms):
            if term.target:
                parts["acts", n] = float(self._row_effects[n].place == name)
        return parts

    def slots(self, theta: Array, target: int, run: int = 0) -> Array:
        """Return the derivative of the kernel's slots with respect to the parameters, (slots, parameters)."""
        s = self.structure
        matrix = np.zeros((len(s.slots) + len(s.parameters), len(self.parameters)))
        for row, (name, number) in enumerate(s.slots):
            kind, component = name.split(".")
            if kind == "centre":
                for k in range(len(self.machine.targets)):
                    by = self.target(theta, k)[1]["xyz".index(component)]
                    for x, slope in zip("xyz" if s.moving else "ab", by, strict=True):
                        if (index := self.index.get(("target", k, x))) is not None:
                            matrix[row, index] += slope / len(self.machine.targets)
                continue
            key: tuple[object, ...] = {
                "target": ("target", target, component),
                "shift": ("shift", run, component),
                "frame": ("frame", component),
            }.get(kind, (name, number))
            if (index := self.index.get(key)) is not None:
                matrix[row, index] = 1.0
        for row, (n, name) in enumerate(s.parameters, start=len(s.slots)):
            matrix[row, self.index["e", n, name]] = 1.0
        return matrix
