"""A machine's model as numbers: its geometry with the current values of the parameters, and its compiled kernels."""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.codegen.build_cache import source_hash
from rodgen.codegen.rows import row_kernels
from rodgen.data.units import ANGLE, LENGTH, Dimension, unit_factor
from rodgen.machines.known import Tied, tied_parameters
from rodgen.machines.layout import AB, XYZ
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
MOST_GROUPS = 8
"""Sets of groups of which a model keeps what ``g`` is made of."""
Groups: TypeAlias = tuple[tuple[int, int], ...]
"""Numbers of a target and of a set-up, for each group of rows that has one ``g``."""


class _OfGroups(NamedTuple):
    """What ``g`` is made of for some groups; of parameters the indices in what `Model._and_zero` returns."""

    groups: Groups
    constant: Array
    """What no parameter changes, (groups, length)."""
    tilted_at: NDArray[np.intp]
    """Indices of unit vectors of joints and of the line of angles, with their two derivatives."""
    vectors: Array
    """Unit vectors n, u, v, (3, k, 3): those of joints and of the line, of the groups' targets, of all targets."""
    tilts: tuple[NDArray[np.intp], ...]
    """What turns each about u and v, (k, 2): one or two parameters that add up."""
    points_at: NDArray[np.intp]
    directions: Array
    slides: NDArray[np.intp]
    """Indices of points of joints, their directions u and v, (k, 2, 3), and how far they go, (k, 1, 2)."""
    moves_at: NDArray[np.intp]
    moves: tuple[NDArray[np.intp], ...]
    """Indices of what parameters are added to, and which, (groups, k)."""
    moves_of_targets: NDArray[np.intp]
    """Of all targets, (targets, 3)."""
    turning: tuple[str, ...]
    turns: tuple[NDArray[np.intp], ...]
    """What turns bodies and frames, and their rotation vectors, (groups, 3 k)."""


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
    bases : list of (ndarray, ndarray)
        Unit vectors u and v that complete the axis of each joint.
    line_of_file : tuple of float, length 3
        Axis about which angles are read, or the vertical, upwards, as the file has it.
    points, attitudes, zeros : ndarray, shapes (targets, 3), (targets, 3, 3) and (targets, 1)
        Of the targets, as the file has them; attitudes as matrices.
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
        self.bases = [
            (np.zeros(3), np.zeros(3)) if joint.in_loop else _basis(tuple(joint.axis))
            for joint in machine.joints
        ]
        x, y, z = machine.gravity
        self.line_of_file = machine.measured.about or (-x, -y, -z)
        self.points = np.array([target.point for target in machine.targets], float)
        self.attitudes = rotation_matrix(np.array([target.attitude for target in machine.targets], float))
        self.zeros = np.array([[target.zero] for target in machine.targets])
        self._of_effects = self._numbers(
            [("e", n, name) for n, name in self.structure.parameters] or [("e",)]
        )
        self._of_groups: dict[Groups, _OfGroups] = {}

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
        stated = self.machine.values
        values = []
        for p in self.parameters:
            unsearched = p.searched.before if p.searched else 0.0
            start = stated.get(p.key, unsearched) if p.slot[0] != "frame" else 0.0
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
        sizes_and_ranges = np.full((2, len(self.parameters)), np.nan)
        for effect in self.machine.effects:
            sizes = plausibility(self.machine, effect).sizes
            for i, parameter in enumerate(self.parameters):
                size = sizes.get(parameter.key.rpartition(".")[2]) if effect.owns(parameter.key) else None
                if size:
                    sizes_and_ranges[:, i] = size.usual, size.largest
        return sizes_and_ranges[0], sizes_and_ranges[1]

    @property
    def level(self) -> tuple[Array, Array]:
        """Level unit vectors, at azimuths of 90 degrees and of 0."""
        return complete_basis(-np.array(self.machine.gravity))

    def acts(self, term: int) -> Array:
        """Return 1 for each target that an effect at a target acts on, else 0, (targets, 1)."""
        place = row_effects(self.machine)[term].place
        return np.array([[float(target.name == place)] for target in self.machine.targets])

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

    def part(self, theta: Array, name: str, number: int = 0, target: int = 0) -> Array:
        """Return a part of the geometry by its name and the number of the joint, as seen with a target, (length,)."""
        start = self._at[name, number]
        length = next(part.length for part, _ in self.structure.parts if part.name == name)
        return self.geometry(theta, Frame.identity(), target)[start : start + length]

    def axis(self, theta: Array, j: int) -> Array:
        """Return a joint's axis, (3,)."""
        return self.part(theta, "axis", j)

    def point(self, theta: Array, j: int) -> Array:
        """Return the point of a joint, length unit."""
        (u, v), (a, b) = self.bases[j], (self.value(theta, f"point.{x}", j) for x in AB)
        return np.array(self.machine.joints[j].point) + a * u + b * v

    def number(self, theta: Array, name: str) -> tuple[float, ...]:
        """Return one of the numbers of a closed chain's geometry, as its components, length unit."""
        return tuple(self.part(theta, name).tolist())

    def target(self, theta: Array, k: int) -> Array:
        """Return a target, (3,)."""
        return self.part(theta, "target", target=k)

    def line(self, theta: Array) -> Array:
        """Return the axis about which angles are read, or the vertical, upwards, (3,)."""
        return self.part(theta, self.machine.measurand.line)

    def attitude(self, theta: Array, k: int) -> Array:
        """Return the matrix of a target's attitude, (3, 3): its axes as columns, in machine axes."""
        return self.part(theta, "target_rotation", target=k).reshape(3, 3)

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
        # all joints, targets and set-ups at once: a small fit spends most of its time here
        s, values, of = self.structure, self._and_zero(theta), self._of(tuple(groups))
        g, seen = of.constant.copy(), self.points
        if not groups:
            return g
        if of.tilts:
            n, u, v = of.vectors
            axis, by = tilted(n, u, v, _sum(values, of.tilts))
            vectors = np.empty((len(n), 3, 3))
            vectors[:, 0], vectors[:, 1:] = axis, by.swapaxes(1, 2)
            first = len(of.tilted_at) // 9
            if first:
                g[:, of.tilted_at] = vectors[:first].ravel()
            if len(vectors) > first:  # those of the targets of the groups, then those of all targets
                self._write(g, "target", vectors[first : first + len(g)].reshape(-1, 9))
                seen = axis[first + len(g) :]
        if len(of.points_at):
            g[:, of.points_at] += (values[of.slides] @ of.directions).ravel()
        if of.moves:
            g[:, of.moves_at] += _sum(values, of.moves)
        if s.centre:
            seen = self.points + values[of.moves_of_targets] if s.moving else seen
            self._write(g, "centre", seen.sum(axis=0) / len(seen))
        for name, value in self._turned(values, of) if of.turning else ():
            self._write(g, name, value.reshape(-1, 9))
        if s.frame:
            self._write(g, "frame_rotation", frame.rotation.ravel())
            if s.moving:
                self._write(g, "frame", frame.position)
        return g

    def _write(self, g: Array, name: str, value: Array) -> None:
        start = self._at[name, 0]
        g[:, start : start + value.shape[-1]] = value

    def _turned(self, values: Array, of: _OfGroups) -> Iterator[tuple[str, Array]]:
        """Yield the matrices of attitudes and frames, and those of small turns after them, (groups, 3, 3)."""
        turns = _sum(values, of.turns).reshape(len(of.groups), -1, 3).swapaxes(0, 1)
        pairs = zip(rotation_matrix(turns), left_jacobian(turns), strict=True)
        turn = dict(zip(of.turning, pairs, strict=True))
        if "target" in turn:
            rotation, small = turn["target"]
            again, small_again = turn.get("remounting", (np.eye(3), None))
            yield "target_rotation", again @ (rotation @ self.attitudes[[k for k, _ in of.groups]])
            yield "target_turns", again @ small
            if small_again is not None:
                yield "remounting_turns", small_again
        if "shift" in turn:
            yield from zip(("shift_rotation", "shift_turns"), turn["shift"], strict=True)

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

    def _of(self, groups: Groups) -> _OfGroups:
        """Return what ``g`` is made of for some groups."""
        if groups not in self._of_groups:
            if len(self._of_groups) == MOST_GROUPS:
                self._of_groups.clear()
            self._of_groups[groups] = self._found(groups)
        return self._of_groups[groups]

    def _found(self, groups: Groups) -> _OfGroups:
        s, at, joints = self.structure, self._at, self.machine.joints
        targets = [target for target, _ in groups]
        constant = np.zeros((len(groups), sum(part.length for part, _ in s.parts)))
        for part, j in s.parts:
            value = np.asarray(part.value(self, j), float)
            start = at[part.name, j]
            constant[:, start : start + part.length] = value[targets] if value.ndim == 2 else value

        tilted_parts = [("axis", j) for j, joint in enumerate(s.joints) if joint.axis]
        vectors = [(joints[j].axis, *self.bases[j]) for _, j in tilted_parts]
        if s.line:
            tilted_parts.append((s.measurand.line, 0))
            vectors.append((self.line_of_file, *_basis(self.line_of_file)))
        tilts = [x for name, j in tilted_parts for free in AB for x in self._sources(f"{name}.{free}", j)]
        if ("target_by_a", 0) in at:
            # all are those of the first set-up, in which none is mounted anew
            seen = [*groups, *((k, 0) for k in range(len(self.points)) if s.centre)]
            vectors += [(self.points[k], *_basis(tuple(self.points[k]))) for k, _ in seen]
            tilts += [x for k, run in seen for free in AB for x in self._sources(f"target.{free}", 0, k, run)]

        points = [j for j, joint in enumerate(s.joints) if joint.point and ("point", j) in at]
        components = s.kinematics.numbers
        moves = [(f"geometry.{name}", name, components[name]) for name in s.numbers]
        moves += [("target.", "target", XYZ)] if s.moving and s.target else []
        moves += [("target.", "target_zero", ("zero",))] if s.measurand.has_zero and s.target else []
        moves += [("shift.", "shift", XYZ)] if s.moving and s.shift else []
        turning = [kind for kind in ("target", "remounting", "shift") if (f"{kind}_turns", 0) in at]
        return _OfGroups(
            groups,
            constant,
            tilted_at=_indices((at[part], 9) for part in tilted_parts),
            vectors=np.array(vectors, float).reshape(-1, 3, 3).swapaxes(0, 1).copy(),
            tilts=self._adding_up(tilts, (-1, 2)),
            points_at=_indices((at["point", j], 3) for j in points),
            directions=np.array([self.bases[j] for j in points]),
            slides=self._numbers([(f"point.{x}", j) for j in points for x in AB]).reshape(-1, 1, 2),
            moves_at=_indices((at[name, 0], len(of)) for _, name, of in moves),
            moves=self._entering(groups, [f"{slot}{x}" for slot, _, of in moves for x in of]),
            moves_of_targets=self._numbers(
                [("target", k, x) for k in range(len(self.points)) for x in XYZ]
            ).reshape(-1, 3),
            turning=tuple(turning),
            turns=self._entering(groups, [f"{kind}.{x}" for kind in turning for x in TURNS]),
        )

    def _entering(self, groups: Groups, slots: Sequence[str]) -> tuple[NDArray[np.intp], ...]:
        """Return the indices of the parameters that add up to each of some slots, (groups, slots) each."""
        sources = [x for target, run in groups for slot in slots for x in self._sources(slot, 0, target, run)]
        return self._adding_up(sources, (len(groups), len(slots)))

    def _adding_up(
        self, slots: Sequence[tuple[object, ...]], shape: tuple[int, int]
    ) -> tuple[NDArray[np.intp], ...]:
        """Return the indices of the parameters of pairs of slots: the first ones, and the second if there are any."""
        first, second = self._numbers(slots).reshape(-1, 2).T
        pair = (first.reshape(shape), second.reshape(shape))
        return pair[: np.any(second != len(self.parameters)) + 1] if first.size else ()

    @staticmethod
    def _sources(slot: str, number: int, target: int = 0, run: int = 0) -> tuple[tuple[object, ...], ...]:
        """Return the two parameters that add up to a slot for a target and a set-up; () where there is none."""
        kind, x = slot.split(".")
        match kind:
            case "target":
                # turns of a body have a slot of their own: they follow those of the target
                return ("target", target, x), ("remounting", target, run, x) if x not in TURNS else ()
            case "remounting":
                return ("remounting", target, run, x), ()
            case "shift":
                return ("shift", run, x), ()
        return (slot, number), ()

    # from the kernel's slots to parameters -------------------------------------------------------------------

    def slots(self, theta: Array, groups: Sequence[tuple[int, int]]) -> Iterator[Array]:
        """Yield, for pairs of target and set-up, the derivative of the slots by the parameters, (slots, parameters).

        They are not to be written to.
        """
        common = self._common_slots
        if not self.has_constant_slots:
            targets = range(len(self.points))
            every = self.geometries(theta, Frame.identity(), [(k, 0) for k in targets])
            start, row = self._at["target_by_a", 0], self.structure.slots.index(("centre.x", 0))
            common = common.copy()
            for k in targets:
                for i, x in enumerate(AB):
                    by = every[k, start + 3 * i : start + 3 * i + 3] / len(targets)
                    if (index := self.index.get(("target", k, x))) is not None:
                        common[row : row + 3, index] += by
        for target, run in groups:
            matrix = common.copy() if self._group_rows else common
            for row, slot in self._group_rows:
                for source in self._sources(*slot, target, run):
                    if (index := self.index.get(source)) is not None:
                        matrix[row, index] = 1.0
            yield matrix

    @property
    def has_constant_slots(self) -> bool:
        """Whether :meth:`slots` are the same for all values: but for the mean of several directions they are."""
        return not (self.structure.centre and ("target_by_a", 0) in self._at)

    @functools.cached_property
    def _group_rows(self) -> list[tuple[int, tuple[str, int]]]:
        """The slots that belong to a different parameter for each target or set-up."""
        slots = enumerate(self.structure.slots)
        return [
            (row, slot) for row, slot in slots if slot[0].startswith(("target.", "remounting.", "shift."))
        ]

    @functools.cached_property
    def _common_slots(self) -> Array:
        """The derivative of the slots that are the same for all targets and set-ups and do not depend on values."""
        s, of_groups = self.structure, {row for row, _ in self._group_rows}
        matrix = np.zeros((len(s.slots) + len(s.parameters), len(self.parameters)))
        for row, slot in enumerate([*s.slots, *(("e", *parameter) for parameter in s.parameters)]):
            slots: Sequence[tuple[object, ...]] = [slot]
            if str(slot[0]).startswith("centre."):  # of directions there is no such parameter
                slots = [("target", k, str(slot[0])[-1]) for k in range(len(self.points))]
            elif str(slot[0]).startswith("frame."):
                slots = [("frame", str(slot[0])[6:])]
            for each in slots if row not in of_groups else ():
                for index, factor in self._parts(each):
                    matrix[row, index] = factor / len(slots)
        return matrix

    def _parts(self, slot: tuple[object, ...]) -> Sequence[tuple[int, float]]:
        """Return the parameters that make up the value of a slot, with their factors."""
        if slot in self._of_tied:
            return self.tied[self._of_tied[slot]].factors
        return [(self.index[slot], 1.0)] if slot in self.index else []


def _sum(values: Array, numbers: tuple[NDArray[np.intp], ...]) -> Array:
    """Return the sums of the values with some indices: of one or two each."""
    return values[numbers[0]] if len(numbers) == 1 else values[numbers[0]] + values[numbers[1]]


def _indices(parts: Iterable[tuple[int, int]]) -> NDArray[np.intp]:
    """Return the indices of parts, each with its first one and its length."""
    return np.array([start + i for start, length in parts for i in range(length)], np.intp)


def _travel(machine: Machine, travel: Any) -> Array:
    limits = machine.limits
    ranges = np.zeros((len(limits), 2)) if travel is None else np.asarray(travel, float)
    return np.array([f if g is None else g for f, g in zip(ranges, limits, strict=True)])


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
