"""A machine's model as numbers: its geometry with the current values of the parameters, and its compiled kernels."""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.codegen.build_cache import source_hash
from rodgen.codegen.rows import row_kernels
from rodgen.data.units import ANGLE, LENGTH, Dimension, unit_factor
from rodgen.machines.known import Tied, tied_parameters
from rodgen.machines.measured import TURNS
from rodgen.machines.parameters import parameters_of
from rodgen.machines.plausibility import plausibility
from rodgen.machines.rigid import complete_basis, left_jacobian, rotation_matrix, tilted
from rodgen.machines.structure import Structure, row_effects

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine


@dataclass(frozen=True)
class Frame:
    """Where the measuring frame is: a reading is ``rotation @ x + position`` of a point x in machine axes."""

    rotation: Array
    """Shape (3, 3)."""
    position: Array
    """Length unit of the machine, (3,)."""

    @classmethod
    def identity(cls) -> Frame:
        """Return the machine's own frame."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def fitted(cls, values: Mapping[str, float]) -> Frame | None:
        """Return the frame in a machine's fitted values, None where there is none in them."""
        if "frame.rx" not in values:
            return None
        turn, at = (np.array([values.get(f"frame.{x}", 0.0) for x in names]) for names in (TURNS, "xyz"))
        return cls(rotation_matrix(turn), at)

    def moved(self, change: Mapping[str, float]) -> Frame:
        """Return the frame after small changes of ``x y z rx ry rz``; the turn is about machine axes."""
        turn = np.array([change.get(x, 0.0) for x in TURNS])
        shift = np.array([change.get(x, 0.0) for x in "xyz"])
        return Frame(self.rotation @ rotation_matrix(turn), self.position + shift)


@functools.lru_cache(maxsize=64)
def _kernels(structure: Structure, compiled: bool) -> Mapping[str, Any]:
    def make() -> Sequence[Any]:
        from rodgen.machines.derivation import derive_programs

        return derive_programs(structure)

    kernels: Mapping[str, Any] = row_kernels(_key(structure), make, compiled=compiled)
    return kernels


_HOME = Path(__file__).parent
_OF_GROUPS = frozenset({"target", "shift", "remounting"})
"""Slots that are of another parameter for each target or set-up."""


def _key(structure: Structure) -> str:
    """Return what its kernels depend on: this package, the formulas that it builds with, and units of data."""
    return f"{structure!r} {source_hash(_HOME, *(_HOME.parent / name for name in ('symbolic', 'data')))}"


@functools.lru_cache(maxsize=1024)
def _basis(axis: tuple[float, float, float]) -> tuple[Array, Array]:
    return complete_basis(axis)


class Model:
    """A machine with its parameters, its geometry and its kernels.

    Parameters
    ----------
    travel : array_like, shape (joints, 2), optional
        Range of each joint, internal units; from the machine file where it is given there.
    runs : sequence of str
        Names of the set-ups in the data.
    compiled : bool
        Whether the kernels are compiled; a model that is evaluated a few times is quicker on NumPy.

    Attributes
    ----------
    parameters : tuple of Parameter
        Without those that are tied.
    tied : tuple of Tied
    structure : Structure
    """

    def __init__(
        self, machine: Machine, travel: Any = None, runs: Sequence[str] = ("",), *, compiled: bool = True
    ) -> None:
        self.machine = machine
        self.runs = tuple(runs)
        self.compiled = compiled
        self.structure = machine.structure
        self.parameters, self.tied = tied_parameters(machine, parameters_of(machine, self.structure, runs))
        self.index = {p.slot: i for i, p in enumerate(self.parameters)}
        self._of_tied = {tied.parameter.slot: k for k, tied in enumerate(self.tied)}
        self.keys = {p.key: i for i, p in enumerate(self.parameters)}
        self.travel = _travel(machine, travel)
        self._row_effects = row_effects(machine)
        self._bases = [
            (np.zeros(3), np.zeros(3)) if joint.in_loop else _basis(tuple(joint.axis))
            for joint in machine.joints
        ]
        directions = () if machine.measurand.moving else machine.targets
        self._target_bases = [_basis(tuple(t.point)) for t in directions]
        x, y, z = machine.gravity
        self._line = machine.measured.about or (-x, -y, -z)
        self._of_effects = self._numbers(
            [("e", n, name) for n, name in self.structure.parameters] or [("e",)]
        )
        self._constant: tuple[tuple[tuple[int, int], ...], Array] = ((), np.zeros((0, 0)))

    def __getstate__(self) -> dict[str, Any]:
        # Functions of a compiled library belong to one process; a copy in another loads them when it needs them.
        return {name: value for name, value in self.__dict__.items() if name != "kernels"}

    @functools.cached_property
    def kernels(self) -> Mapping[str, Any]:
        """The compiled kernels ``place``, ``residual``, ``residual_and_jacobian``; compiled when first used."""
        return _kernels(self.structure, self.compiled)

    def start(self) -> Array:
        """Return the values that a fit starts from: what is held, what was fitted before, else zero.

        The frame is zero here, as its start is found separately. A searched parameter has no meaning at zero;
        until the search it has a value at which every formula is finite: 1, and for a time constant so much that
        nothing decays.
        """
        given = self.machine.values
        values = []
        for p in self.parameters:
            unsearched = p.searched.before if p.searched else 0.0
            start = given.get(p.key, unsearched) if p.slot[0] != "frame" else 0.0
            values.append(start if p.hold is None else p.hold)
        return np.array(values, dtype=float)

    @functools.cached_property
    def kinds(self) -> tuple[str, ...]:
        """What each parameter is of: ``"axis"``, ``"point"``, ``"target"``, ``"frame"``, ``"shift"``, ``"e"``, ..."""
        return tuple(str(p.slot[0]).partition(".")[0] for p in self.parameters)

    @functools.cached_property
    def anchored(self) -> NDArray[np.bool_]:
        """Of which parameters the machine file says a value, (parameters,).

        It says none of a frame, of what is searched, nor of a body's attitude on the last link where it gives none.
        """
        unknown = {
            ("target", k, x) for k, t in enumerate(self.machine.targets) if not any(t.attitude) for x in TURNS
        }
        of_file = [
            kind != "frame" and p.slot not in unknown and not p.searched
            for kind, p in zip(self.kinds, self.parameters, strict=True)
        ]
        return np.array(of_file, bool)

    @functools.cached_property
    def known(self) -> tuple[Array, Array, Array, Array]:
        """Means and inverse standard deviations of priors, zeros without, and lowest and highest values."""
        priors = np.array([p.prior or (0.0, np.inf) for p in self.parameters]).reshape(-1, 2).T
        bounds = np.array([p.bounds or (-np.inf, np.inf) for p in self.parameters]).reshape(-1, 2).T
        return priors[0], 1 / priors[1], bounds[0], bounds[1]

    @functools.cached_property
    def turns(self) -> NDArray[np.bool_]:
        """Which parameters are angles, (parameters,)."""
        return self._measuring(ANGLE)

    @functools.cached_property
    def ways(self) -> NDArray[np.bool_]:
        """Which parameters are lengths, (parameters,)."""
        return self._measuring(LENGTH)

    def _measuring(self, dimension: Dimension) -> NDArray[np.bool_]:
        length = self.machine.length_unit
        return np.array([unit_factor(p.unit, length)[1] == dimension for p in self.parameters], bool)

    @functools.cached_property
    def reach(self) -> Array:
        """Range of the coordinate of each joint, internal units, (joints, 2): its travel, unless it is coupled."""
        if self.machine.couplings is None:
            return self.travel
        reached = self.machine.couplings.ranges(self.travel)
        return np.array([j.travel or x for j, x in zip(self.machine.joints, reached, strict=True)])

    @functools.cached_property
    def effect_sizes(self) -> tuple[Array, Array]:
        """Usual and largest sizes of the parameters of effects, internal units, (parameters,); NaN if not known."""
        found = np.full((2, len(self.parameters)), np.nan)
        for effect in self.machine.effects:
            sizes = plausibility(self.machine, effect).sizes
            for i, parameter in enumerate(self.parameters):
                size = sizes.get(parameter.key.rpartition(".")[2]) if effect.owns(parameter.key) else None
                if size:
                    found[:, i] = size.usual, size.largest
        return found[0], found[1]

    @functools.cached_property
    def farthest(self) -> float:
        """Distance of the target that is farthest from a joint's point, length unit."""
        points, targets = (
            np.array([x.point for x in of]) for of in (self.machine.joints, self.machine.targets)
        )
        return float(np.linalg.norm(targets[:, None] - points, axis=-1).max())

    # the geometry --------------------------------------------------------------------------------------------

    def value(self, theta: Array, *slot: object) -> float:
        """Return a parameter's value, zero where there is no such parameter."""
        if slot in self._of_tied:
            return self.tied_value(self.tied[self._of_tied[slot]], theta)
        index = self.index.get(slot)
        return 0.0 if index is None else float(theta[index])

    @staticmethod
    def tied_value(tied: Tied, theta: Array) -> float:
        """Return the value of a parameter that is tied to others."""
        return tied.constant + sum(factor * float(theta[i]) for i, factor in tied.factors)

    def _numbers(self, slots: Sequence[tuple[object, ...]]) -> NDArray[np.intp]:
        """Return the indices of parameters in what `_and_zero` returns; for slots without one, that of its zero."""
        free = len(self.parameters)
        tied = {slot: free + 1 + k for slot, k in self._of_tied.items()}
        return np.array([self.index.get(slot, tied.get(slot, free)) for slot in slots], np.intp)

    def _and_zero(self, theta: Array) -> Array:
        """Return the values, a zero and those tied to them, as `_numbers` indexes them. np.append takes longer."""
        free = len(self.parameters)
        values = np.zeros(free + 1 + len(self.tied))
        values[:free] = theta
        for k, tied in enumerate(self.tied, free + 1):
            values[k] = self.tied_value(tied, theta)
        return values

    def parameters_of_effects(self, theta: Array) -> Array:
        """Return the kernel's vector ``e``; one zero where there are no effects."""
        return np.asarray(self._and_zero(theta)[self._of_effects])

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

    def number(self, theta: Array, name: str) -> tuple[float, ...]:
        """Return one of the numbers of a closed chain's geometry, as its components, length unit."""
        kinematics = self.machine.kinematics
        components, nominal = kinematics.numbers[name], kinematics.number(name)
        changes = (self.value(theta, f"geometry.{name}{x}", 0) for x in components)
        return tuple(float(a + b) for a, b in zip(nominal, changes, strict=True))

    def target(self, theta: Array, k: int) -> tuple[Array, Array]:
        """Return a target and its derivative (3, freedoms)."""
        point = np.array(self.machine.targets[k].point)
        if self.structure.moving:
            return point + [self.value(theta, "target", k, x) for x in "xyz"], np.eye(3)
        u, v = self._target_bases[k]
        return tilted(point, u, v, np.array([self.value(theta, "target", k, x) for x in "ab"]))

    def line(self, theta: Array) -> Array:
        """Return the axis about which angles are read, or the vertical, upwards, (3,)."""
        a, b = (self.value(theta, f"{self.machine.measurand.line}.{x}", 0) for x in "ab")
        return np.asarray(tilted(self._line, *_basis(self._line), [a, b])[0])

    def attitude(self, theta: Array, k: int) -> Array:
        """Return the matrix of a target's attitude, (3, 3): its axes as columns, in machine axes."""
        turn = np.array([self.value(theta, "target", k, x) for x in TURNS])
        return np.asarray(rotation_matrix(turn) @ self._attitudes[k])

    # The parts of ``g`` that change are written into a copy of the constant ones, for all joints, targets and set-ups
    # at once: a small fit spends most of its time here.

    def geometries(self, theta: Array, frame: Frame, groups: Sequence[tuple[int, int]]) -> Array:
        """Return the kernel's vector ``g`` for several pairs of target and set-up, (groups, length).

        Parameters
        ----------
        theta : ndarray, shape (parameters,)
            Internal units.
        frame : Frame
            Of the measurements; used where it is free.
        groups : sequence of (int, int)
            Number of the target that is seen, and of the set-up.
        """
        s, at, values = self.structure, self._at, self._and_zero(theta)
        g = self._constants(tuple(groups)).copy()
        turned, by = self._tilted(values)
        count = len(self._axes)
        if s.line:
            start = at[s.measurand.line, 0]
            g[:, start : start + 3], g[:, start + 3 : start + 9] = turned[-1], by[-1].T.ravel()
            turned, by = turned[:-1], by[:-1]
        if count:
            axes = np.empty((count, 3, 3))
            axes[:, 0], axes[:, 1:] = turned[:count], by[:count].swapaxes(1, 2)
            g[:, self._axes_at] = axes.ravel()
        if len(self._points):
            g[:, self._points_at] = self._moved_points(values).ravel()
        if s.numbers:
            g[:, self._geometry_at[0]] += values[self._geometry_at[1]]
        targets = self._targets + values[self._target_numbers] if s.moving else turned[count:]
        if s.centre:
            g[:, at["centre", 0] : at["centre", 0] + 3] = targets.sum(axis=0) / len(targets)
        if s.target:
            of_target = np.array([target for target, _ in groups], np.intp)
            start = at["target", 0]
            g[:, start : start + 3] = targets[of_target]
            if "a" in s.measurand.freedoms:
                g[:, start + 3 : start + 9] = by[count:].swapaxes(1, 2).reshape(-1, 6)[of_target]
            if s.remounting:
                remounted = values[self._remounting_numbers(tuple(groups))]
                if s.moving:
                    g[:, start : start + 3] += remounted[:, :3]
                elif "a" in s.measurand.freedoms:
                    n, u, v, numbers = (part[count:][of_target] for part in self._tilts)
                    seen, by_tilt = tilted(n, u, v, values[numbers] + remounted[:, :2])
                    g[:, start : start + 3] = seen
                    g[:, start + 3 : start + 9] = by_tilt.swapaxes(1, 2).reshape(-1, 6)
        if s.measurand.has_attitude and s.target:
            of_target = np.array([target for target, _ in groups], np.intp)
            turns = values[self._target_turns][of_target]
            parts = {
                "target_rotation": rotation_matrix(turns) @ self._attitudes[of_target],
                "target_turns": left_jacobian(turns),
            }
            if s.remounting:
                again = rotation_matrix(remounted[:, -3:])
                parts = {name: again @ part for name, part in parts.items()}
                parts["remounting_turns"] = left_jacobian(remounted[:, -3:])
            for name, value in parts.items():
                g[:, at[name, 0] : at[name, 0] + 9] = value.reshape(-1, 9)
        if s.measurand.has_zero and s.target:
            zeros = values[self._numbers([("target", target, "zero") for target, _ in groups])]
            g[:, at["target_zero", 0]] += zeros
            if s.remounting:
                g[:, at["target_zero", 0]] += remounted[:, -1]
        if s.shift:
            of_run = np.array([run for _, run in groups], np.intp)
            shifts = values[self._shift_numbers(int(of_run.max(initial=0)) + 1)]
            parts = {
                "shift_rotation": rotation_matrix(shifts[:, 3:]),
                "shift_turns": left_jacobian(shifts[:, 3:]),
            }
            for name, value in (parts | ({"shift": shifts[:, :3]} if s.moving else {})).items():
                value = value.reshape(len(value), -1)
                g[:, at[name, 0] : at[name, 0] + value.shape[1]] = value[of_run]
        if s.frame:
            g[:, at["frame_rotation", 0] : at["frame_rotation", 0] + 9] = frame.rotation.ravel()
            if s.moving:
                g[:, at["frame", 0] : at["frame", 0] + 3] = frame.position
        return g

    def geometry(self, theta: Array, frame: Frame, target: int, run: int = 0) -> Array:
        """Return the kernel's vector ``g`` for one target and set-up; see :meth:`geometries`."""
        return np.asarray(self.geometries(theta, frame, [(target, run)])[0])

    @functools.cached_property
    def _at(self) -> dict[tuple[str, int], int]:
        """Where each part of ``g`` begins."""
        lengths = [length for _, _, length in self.structure.geometry]
        starts = np.cumsum([0, *lengths]).tolist()
        return {
            (name, j): start for (name, j, _), start in zip(self.structure.geometry, starts, strict=False)
        }

    def _constants(self, groups: tuple[tuple[int, int], ...]) -> Array:
        """Return ``g`` with everything that no parameter changes, (groups, length)."""
        kept, g = self._constant
        if kept != groups:
            g = np.zeros((len(groups), sum(length for _, _, length in self.structure.geometry)))
            for (name, j), start in self._at.items():
                value = self._constant_part(name, j, groups)
                g[:, start : start + value.shape[-1]] = value
            self._constant = (groups, g)
        return g

    def _constant_part(self, name: str, j: int, groups: Sequence[tuple[int, int]]) -> Array:
        machine = self.machine
        if name in machine.kinematics.numbers:
            return np.array(machine.kinematics.number(name))
        if name == "axis":
            return np.array(machine.joints[j].axis)
        if name == "point":
            return np.array(machine.joints[j].point)
        if name in {"u", "v"}:
            return self._bases[j]["uv".index(name)]
        if name in {"start", "length"}:
            first, last = self.reach[j]
            return np.array([first if name == "start" else last - first])
        if name == "target":
            return np.array([machine.targets[target].point for target, _ in groups])
        if name == "target_rotation":
            return self._attitudes[[target for target, _ in groups]].reshape(-1, 9)
        if name == machine.measurand.line:
            return np.array(self._line)
        if name == "target_zero":
            return np.array([[machine.targets[target].zero] for target, _ in groups])
        if name == "gravity":
            return np.array(machine.gravity)
        if name in {"level_u", "level_v"}:
            return complete_basis(-np.array(machine.gravity))["uv".index(name[-1])]
        if name == "origin":
            return np.array(machine.measured.origin)
        if name == "acts":
            place = self._row_effects[j].place
            return np.array([[float(machine.targets[target].name == place)] for target, _ in groups])
        return np.zeros(1)

    @functools.cached_property
    def _geometry_at(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Indices in ``g`` of the adjusted numbers of a closed chain's geometry, and of their parameters."""
        slots = [slot for slot in self.structure.slots if str(slot[0]).startswith("geometry.")]
        components = self.machine.kinematics.numbers
        starts = [
            self._at[name, 0] + i for name in self.structure.numbers for i in range(len(components[name]))
        ]
        return np.array(starts, np.intp), self._numbers(slots)

    @functools.cached_property
    def _axes(self) -> list[int]:
        """The joints whose axes are tilted."""
        return [j for j, joint in enumerate(self.structure.joints) if joint.axis]

    @functools.cached_property
    def _axes_at(self) -> NDArray[np.intp]:
        """Indices in ``g`` of axes and their two derivatives, one after the other."""
        return np.concatenate([self._at["axis", j] + np.arange(9) for j in self._axes])

    @functools.cached_property
    def _tilts(self) -> tuple[Array, Array, Array, NDArray[np.intp]]:
        """Tilted unit vectors (axes, measured directions, line of angles): n, u, v, the indices of their two angles."""
        s, machine = self.structure, self.machine
        vectors = [(machine.joints[j].axis, *self._bases[j]) for j in self._axes]
        slots: list[tuple[object, ...]] = [(f"axis.{x}", j) for j in self._axes for x in "ab"]
        if not s.moving:
            seen = zip(machine.targets, self._target_bases, strict=True)
            vectors += [(target.point, u, v) for target, (u, v) in seen]
            slots += [("target", k, x) for k in range(len(machine.targets)) for x in "ab"]
        if s.line:
            vectors.append((self._line, *_basis(self._line)))
            slots += [(f"{machine.measurand.line}.{x}", 0) for x in "ab"]
        n, u, v = np.array(vectors, float).reshape(-1, 3, 3).swapaxes(0, 1).copy()
        return n, u, v, self._numbers(slots).reshape(-1, 2)

    def _tilted(self, values: Array) -> tuple[Array, Array]:
        n, u, v, numbers = self._tilts
        return tilted(n, u, v, values[numbers]) if len(n) else (n, n[..., None])

    @functools.cached_property
    def _points(self) -> list[int]:
        """The joints whose points are moved."""
        s = self.structure
        return [j for j, joint in enumerate(s.joints) if joint.point and ("point", j) in self._at]

    @functools.cached_property
    def _points_at(self) -> NDArray[np.intp]:
        return np.concatenate([self._at["point", j] + np.arange(3) for j in self._points])

    @functools.cached_property
    def _moves(self) -> tuple[Array, Array, NDArray[np.intp]]:
        """Points, the two directions in which each moves, and the indices of its two freedoms."""
        points = np.array([self.machine.joints[j].point for j in self._points], float)
        numbers = self._numbers([(f"point.{x}", j) for j in self._points for x in "ab"])
        return points, np.array([self._bases[j] for j in self._points]), numbers.reshape(-1, 1, 2)

    def _moved_points(self, values: Array) -> Array:
        points, directions, numbers = self._moves
        return np.asarray(points + (values[numbers] @ directions)[:, 0])

    @functools.cached_property
    def _targets(self) -> Array:
        return np.array([target.point for target in self.machine.targets], float)

    @functools.cached_property
    def _attitudes(self) -> Array:
        return rotation_matrix(np.array([target.attitude for target in self.machine.targets], float))

    @functools.cached_property
    def _target_numbers(self) -> NDArray[np.intp]:
        return self._numbers_of_targets("xyz")

    @functools.cached_property
    def _target_turns(self) -> NDArray[np.intp]:
        return self._numbers_of_targets(TURNS)

    def _numbers_of_targets(self, components: Sequence[str]) -> NDArray[np.intp]:
        targets = range(len(self.machine.targets))
        return self._numbers([("target", k, x) for k in targets for x in components]).reshape(-1, 3)

    @functools.lru_cache(maxsize=8)  # noqa: B019
    def _remounting_numbers(self, groups: tuple[tuple[int, int], ...]) -> NDArray[np.intp]:
        """Return the indices of the freedoms of remounted targets, (groups, freedoms)."""
        freedoms = self.structure.measurand.freedoms
        slots = [("remounting", target, run, x) for target, run in groups for x in freedoms]
        return self._numbers(slots).reshape(-1, len(freedoms))

    def _shift_numbers(self, runs: int) -> NDArray[np.intp]:
        return self._numbers([("shift", run, x) for run in range(runs) for x in (*"xyz", *TURNS)]).reshape(
            -1, 6
        )

    # from the kernel's slots to parameters -------------------------------------------------------------------

    def slots(self, theta: Array, groups: Sequence[tuple[int, int]]) -> Iterator[Array]:
        """Yield, for pairs of target and set-up, the derivative of the slots by the parameters, (slots, parameters).

        They are not to be written to.
        """
        common = self._common_slots
        if not self.has_constant_slots:
            common = common.copy()
            by = self._tilted(self._and_zero(theta))[1][len(self._axes) :][: len(self.machine.targets)]
            rows, numbers, kept = self._centre_at
            common[rows, numbers] += by.swapaxes(0, 1).reshape(3, -1)[:, kept] / len(by)
        for target, run in groups:
            matrix = common.copy() if self._group_rows else common
            for row, kind, component in self._group_rows:
                slots: list[tuple[object, ...]] = [(kind, target if kind == "target" else run, component)]
                # turns of a body have a slot of their own: they follow those of the target
                if kind == "remounting" or (kind == "target" and component not in TURNS):
                    slots.append(("remounting", target, run, component))
                for slot in slots:
                    if (index := self.index.get(slot)) is not None:
                        matrix[row, index] = 1.0
            yield matrix

    @property
    def has_constant_slots(self) -> bool:
        """Whether :meth:`slots` are the same for all values: but for the mean of several directions they are."""
        return not (self.structure.centre and not self.structure.moving and self.structure.target)

    @functools.cached_property
    def _split_slots(self) -> list[tuple[int, str, str, int]]:
        return [(row, *name.split("."), number) for row, (name, number) in enumerate(self.structure.slots)]  # type: ignore[misc]

    @functools.cached_property
    def _group_rows(self) -> list[tuple[int, str, str]]:
        """The slots that belong to a different parameter for each target or set-up."""
        return [(row, kind, x) for row, kind, x, _ in self._split_slots if kind in _OF_GROUPS]

    @functools.cached_property
    def _centre_at(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
        """The slots of the mean of the directions, their parameters, and which freedoms have a parameter."""
        rows = [row for row, kind, _, _ in self._split_slots if kind == "centre"]
        numbers = self._numbers([("target", k, x) for k in range(len(self.machine.targets)) for x in "ab"])
        kept = numbers < len(self.parameters)
        return np.array(rows)[:, None], numbers[kept], kept

    @functools.cached_property
    def _common_slots(self) -> Array:
        """The derivative of the slots that are the same for all targets and set-ups and do not depend on values."""
        s, targets = self.structure, range(len(self.machine.targets))
        matrix = np.zeros((len(s.slots) + len(s.parameters), len(self.parameters)))
        for row, kind, x, number in self._split_slots:
            found: list[tuple[object, ...]] = [(f"{kind}.{x}", number)]
            if kind in _OF_GROUPS:
                continue
            if kind == "centre":
                found = [("target", k, x) for k in targets]  # of directions there is no such parameter
            elif kind == "frame":
                found = [("frame", x)]
            for slot in found:
                for index, factor in self._parts(slot):
                    matrix[row, index] = factor / len(found)
        for row, (n, name) in enumerate(s.parameters, start=len(s.slots)):
            for index, factor in self._parts(("e", n, name)):
                matrix[row, index] = factor
        return matrix

    def _parts(self, slot: tuple[object, ...]) -> Sequence[tuple[int, float]]:
        """Return the parameters that make up the value of a slot, with their factors."""
        if slot in self._of_tied:
            return self.tied[self._of_tied[slot]].factors
        return [(self.index[slot], 1.0)] if slot in self.index else []


def _travel(machine: Machine, travel: Any) -> Array:
    given = machine.limits
    found = np.zeros((len(given), 2)) if travel is None else np.asarray(travel, float)
    return np.array([f if g is None else g for f, g in zip(found, given, strict=True)])


_RECENT: deque[Model] = deque(maxlen=8)


def model_of(machine: Machine, travel: Any, runs: Sequence[str], *, compiled: bool) -> Model:
    """Return a machine's model, the same one for the same machine: to make it takes a fifth of a small fit.

    Parameters
    ----------
    machine, travel, runs, compiled
        As of :class:`Model`.
    """
    for model in tuple(_RECENT):
        if (
            model.machine is machine
            and model.compiled == compiled
            and model.runs == tuple(runs)
            and np.array_equal(model.travel, _travel(machine, travel))
        ):
            return model
    model = Model(machine, travel, runs, compiled=compiled)
    _RECENT.append(model)
    return model
