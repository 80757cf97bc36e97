"""The kernels of an emitted machine.

``place`` and ``place_and_jacobian`` are the fitted machine, ``ideal`` is the nominal one. A number of the machine that
is 0 or ±1 is folded in, so that an axis along z costs what a turn about z costs; every other one is a named constant.
What differs from target to target is an input, ``seen``.

``aim`` and ``step`` are what a compensation repeats. With the scaled Jacobian S = J W (W: how freely each joint moves)
the step is W y, where y is the damped least-squares solution of S y = e; it is solved in as many unknowns as the
place has freedoms or the machine has joints, whichever are fewer:

    (SᵀS + λ) y = Sᵀe        or        y = Sᵀ (SSᵀ + λ)⁻¹ e.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from rodgen.array_types import Array
from rodgen.codegen.program import Program
from rodgen.codegen.tape import Number, Tape, asin, select, sqrt
from rodgen.codegen.tape_jacobian import jacobian
from rodgen.codegen.tape_matrix import Matrix
from rodgen.machines.algebra import TapeBuilder, on_tape, solved
from rodgen.machines.closed_chain import pose_from_afar
from rodgen.machines.derivation import model_kernel
from rodgen.machines.measured import Measurand
from rodgen.machines.model import Frame, Model
from rodgen.machines.model_steps import ModelSteps
from rodgen.machines.structure import Structure, Term, row_effects

TINY = 1e-300
"""Added to what is divided by: where no joint moves the place at all, the step is zero."""

OF_A_JOINT = frozenset({"axis", "point", "u", "v", "start", "length"})
"""Parts of the geometry that each joint has."""


@dataclass(frozen=True)
class Constant:
    """A number of the machine that the emitted code names."""

    name: str
    """Identifier in the code, made of fixed words and numbers."""
    value: float
    of: tuple[str, int, str]
    """What it is: part of the geometry or ``"effect"``, number of the joint or term, component or parameter."""


class _Values(NamedTuple):
    """The numbers of a place on their tape."""

    tape: Tape
    q: list[Number]
    place: list[Any]


@dataclass(frozen=True)
class MachineKernels:
    """Forward programs of a machine, with its numbers."""

    place: Program
    """Inputs: ``q``, ``start`` of a closed chain, the columns (``s0``, ``t``, ...), ``seen`` where targets differ, the
    constants."""
    pose: Program | None
    """What finds ``start`` of ``q`` and the constants."""
    columns: tuple[tuple[str, tuple[str, int | str]], ...]
    """Names of the inputs that differ from row to row, other than ``q``, and the column of each."""
    constants: tuple[Constant, ...]
    seen: Array
    """The input ``seen`` of each target, (targets, n)."""
    seen_of: tuple[str, ...]
    """What its components are."""
    values: _Values

    @cached_property
    def place_and_jacobian(self) -> Program:
        """The place, and its derivative with respect to ``q``, (numbers of a place, joints).

        It does not run through ``start``, on which a solved pose does not depend.
        """
        tape, q, place = self.values
        late = len(tape.numbers)
        slopes = list(chain(*jacobian(place, q)))
        outputs = {
            "place": ((len(place),), place),
            "place_jacobian": ((len(place), len(q)), slopes),
        }
        return tape.program(f"{self.place.name}_and_jacobian", self.place.inputs, outputs, late)


class _Builder(TapeBuilder):
    """Makes a part of a program whose inputs stand already for numbers, constants, and what differs from row to row."""

    def __init__(self, on: Tape, given: Mapping[str, Sequence[Any]], prefix: str = "") -> None:
        super().__init__(on)
        self.given, self.prefix = given, prefix

    def input(self, name: str, shape: tuple[int, ...], *, unit: str, doc: str) -> Any:
        """Return what stands for an input."""
        return Matrix(*shape, self.given[name]) if len(shape) == 2 else list(self.given[name])

    def let(self, name: str, value: Any) -> Any:
        """Name a step."""
        return self.tape.let(f"{self.prefix}{name}", value)

    def steps(self, structure: Structure) -> ModelSteps:
        """Return the steps of a machine that are written into this part."""
        return ModelSteps(
            structure, "", replace(on_tape(self.tape), builder=lambda _: self), with_residual=False
        )


def machine_kernels(model: Model, name: str = "place", prefix: str = "") -> MachineKernels:
    """Write the forward programs of a machine in machine axes; names of its constants begin with `prefix`."""
    structure = _without_parameters(model.structure)
    tape = Tape()
    numbers = _Numbers(model, structure, prefix, tape)
    q = tape.inputs("q", len(structure.joints), same=False)
    start = tape.inputs("start", structure.kinematics.pose_numbers, same=False)
    names: dict[str, tuple[str, int | str]] = {}
    rows: list[Any] = []
    for kind, of in structure.columns:
        if kind in {"q", "start"}:
            rows.append((q if kind == "q" else start)[int(of)])
        elif kind in {"reading", "weight"}:
            rows.append(np.nan)  # of residuals only
        else:
            column = _column_name(kind, of, names)
            names[column] = kind, of
            rows += tape.inputs(column, 1, same=False)
    freedoms = [0] * len(structure.slots)  # the change of a freedom is in the geometry already
    given = {"rows": rows, "g": numbers.geometry, "e": numbers.effects or [0], "freedom": freedoms}
    place = model_kernel(_Builder(tape, given).steps(structure)).outputs["place"]
    found = _pose(model, structure, numbers, q) if start else []

    shapes: dict[str, tuple[int, ...]] = {"q": (len(q),), "start": (len(start),)}
    shapes |= {**dict.fromkeys(names, ()), "seen": (numbers.seen.shape[1],)}
    constants: dict[str, tuple[int, ...]] = {constant.name: () for constant in numbers.constants}
    outputs = {"place": ((len(place),), place)}
    programs = [
        tape.program(name, shapes | constants, outputs),
        tape.program(f"{name}_pose", {"q": (len(q),), **constants}, {"start": ((len(start),), found)}),
    ]
    read = {args[0] for program in programs for op, *args in program.operations if op == "input"}
    for port, shape in [("q", len(q)), ("start", len(start)), ("seen", numbers.seen.shape[1])]:
        read |= {port} if shape else set()  # whole, whatever is read of them
    first, pose = (
        replace(p, inputs={port: shape for port, shape in p.inputs.items() if port in read}) for p in programs
    )
    return MachineKernels(
        first,
        pose if start else None,
        tuple((n, column) for n, column in names.items() if n in read),
        tuple(constant for constant in numbers.constants if constant.name in read),
        numbers.seen,
        numbers.seen_of,
        _Values(tape, q, place),
    )


def _without_parameters(structure: Structure) -> Structure:
    joints = tuple(replace(joint, axis=False, point=False) for joint in structure.joints)
    return replace(structure, joints=joints, target=False, numbers=())


def _pose(model: Model, structure: Structure, numbers: _Numbers, q: list[Number]) -> list[Any]:
    """Find the pose of a closed chain on the nominal machine."""
    bare = replace(structure, terms=(), shift=False, frame=False)
    kinematics = model.machine.kinematics
    begins = kinematics.begins
    given = {
        "rows": [q[int(of)] if kind == "q" else np.nan for kind, of in bare.columns],
        "g": [numbers.by_slot[slot] for slot in _slots(bare)],
        "e": [0],
        "freedom": [0] * len(bare.slots),
        "begin": [
            numbers.number(value, "begin", k, name)
            for k, begin in enumerate(begins.tolist())
            for name, value in zip(kinematics.begin_of, begin, strict=True)
        ],
    }
    builder: Any = pose_from_afar(_Builder(numbers.tape, given, "pose_").steps(bare), begins.shape)
    return list(builder.outputs["start"])


def _column_name(kind: str, of: int | str, names: Mapping[str, tuple[str, int | str]]) -> str:
    if kind == "x":
        return f"column{sum(k == 'x' for k, _ in names.values())}"
    return {"t": "t", "F": "load"}.get(kind, f"{kind}{of}")


class _Numbers:
    """What stands for each component of ``g`` and ``e``: a number, a named constant, or a component of ``seen``."""

    def __init__(self, model: Model, structure: Structure, prefix: str, tape: Tape) -> None:
        self.constants: list[Constant] = []
        self.prefix, self.tape = prefix, tape
        theta = model.start()
        values = np.array(
            [self._geometry(model, structure, theta, k) for k in range(len(model.machine.targets))]
        )
        differ = np.flatnonzero(np.ptp(values, axis=0) > 0)
        self.seen = values[:, differ]
        seen = iter(tape.inputs("seen", len(differ), same=False))
        slots = _slots(structure)
        self.words = structure.kinematics.number_words
        self.seen_of = tuple(self._slot_name(*slots[i]) for i in differ)
        self.geometry: list[Any] = [
            next(seen) if i in differ else self.number(float(values[0, i]), *slot)
            for i, slot in enumerate(slots)
        ]
        self.by_slot = dict(zip(slots, self.geometry, strict=True))
        effects = [effect.definition for effect in row_effects(model.machine)]
        self.effects = [
            self._parameter(float(value), term, name, structure.terms[term], effects[term])
            for (term, name), value in zip(
                structure.parameters, model.parameters_of_effects(theta), strict=False
            )
        ]

    @staticmethod
    def _geometry(model: Model, structure: Structure, theta: Array, target: int) -> Array:
        """Return ``g`` of the structure without freedoms, from that of the model's."""
        g = model.geometry(theta, Frame.identity(), target)
        ends = np.cumsum([length for _, _, length in model.structure.geometry])
        parts = np.split(g, ends[:-1])
        named = {(name, n): x for (name, n, _), x in zip(model.structure.geometry, parts, strict=True)}
        return np.concatenate([named[name, n] for name, n, _ in structure.geometry])

    def number(self, value: float, part: str, number: int, component: str) -> Any:
        if value in (0.0, 1.0, -1.0):
            return int(value)
        return self._named(self._slot_name(part, number, component), value, (part, number, component))

    def _parameter(self, value: float, number: int, name: str, term: Term, definition: Any) -> Any:
        """Return a parameter; one that is zero takes its term away where the formula is known to be linear in it."""
        if value == 0.0 and not term.own and name not in definition.searched:
            return 0
        is_ours = not term.own and name in definition.parameters
        plain = name if is_ours else f"p{term.parameters.index(name)}"
        return self._named(f"effect{number}_{plain}", value, ("effect", number, name))

    def _slot_name(self, part: str, number: int, component: str) -> str:
        part, _ = self.words.get(part, (part, ""))
        of = f"{part}{number}" if part in OF_A_JOINT | {"acts", "begin"} else part
        return "_".join(filter(None, [of, component]))

    def _named(self, name: str, value: float, of: tuple[str, int, str]) -> Number:
        self.constants.append(Constant(f"{self.prefix}{name}", value, of))
        return self.tape.inputs(self.constants[-1].name, 1)[0]


def _slots(structure: Structure) -> list[tuple[str, int, str]]:
    """Return part, number and component of each number in ``g``."""
    return [(part, n, _component(i, length)) for part, n, length in structure.geometry for i in range(length)]


def _component(i: int, length: int) -> str:
    return {1: "", 3: "xyz"[i % 3], 9: f"{i // 3 + 1}{i % 3 + 1}"}[length]


# what a compensation repeats ---------------------------------------------------------------------------------


def _turns(rates: Matrix, axes: Matrix) -> Matrix:
    """Return ½ Σ m × m′ over the axes m of a body, columns of a matrix: the rotation vector of their rates m′."""
    return sum((axes.col(i).cross(rates.col(i)) for i in range(3)), Matrix.zeros(3, 1)) * 0.5


def _rounded(arm: float) -> float:
    """Return a round number near a lever arm, whose size hardly matters."""
    return float(f"{arm:.3g}")


def _with_turns(place: Matrix, slopes: Matrix, arm: float) -> Matrix:
    """Return the derivative of a pose, (6, joints): of its point, and its turns times an arm; (3, joints) without."""
    axes = Matrix(3, 3, place.flat[-9:])
    columns = [
        _turns(Matrix(3, 3, slopes.col(j).flat[-9:]), axes) * _rounded(arm) for j in range(slopes.shape[1])
    ]
    return Matrix.vstack(slopes[:-9, :], Matrix.hstack(*columns))


class _Numeric:
    """A program whose inputs are arrays of numbers."""

    def __init__(self) -> None:
        self.tape = Tape()
        self.let = self.tape.let
        self.shapes: dict[str, tuple[int, ...]] = {}

    def input(self, name: str, *shape: int) -> Matrix:
        self.shapes[name] = shape
        return Matrix(
            *(shape if len(shape) == 2 else (int(np.prod(shape)), 1)),
            self.tape.inputs(name, int(np.prod(shape)), same=False),
        )

    def program(self, name: str, **outputs: Any) -> Program:
        """Return what computes outputs, vectors or numbers."""
        ports = {
            port: ((len(x),), list(x)) if isinstance(x, Matrix) else ((), [x]) for port, x in outputs.items()
        }
        return self.tape.program(name, self.shapes, ports)


def aim_kernel(measurand: Measurand, joints: int, arm: float) -> Program:
    """Write how far a place is from the wanted one, and how each joint pulls it there.

    Inputs: ``place``, ``place_jacobian``, its derivative, and ``wanted``. Outputs: ``error`` (3), of a direction in its
    tangent plane, as long as the chord, (6) of a pose, turns times `arm`; ``distance``, of directions the angle, of
    attitudes 2 tan of its half; ``pull`` (joints): Jᵀ error; ``reach`` (joints): how far the place goes with each one.
    """
    k, size = _Numeric(), measurand.place_numbers
    place, slopes = k.input("place", size), k.input("place_jacobian", size, joints)
    wanted = k.input("wanted", size)
    if measurand.has_attitude:
        axes, goal = (Matrix(3, 3, x.flat[-9:]) for x in (place, wanted))
        along = k.let("along", 1 + sum(axes.col(i).dot(goal.col(i)) for i in range(3)))
        turn = _turns(goal, axes) * (4 * _rounded(arm) / k.let("safe", select(along > 1e-6, along, 1e-6)))
        gap = k.let("gap", Matrix.vstack(wanted[:-9, :] - place[:-9, :], turn))
        slopes = k.let("slopes", _with_turns(place, slopes, arm))
    else:
        gap = k.let("gap", wanted - place)
    square = k.let("square", gap.dot(gap))
    if measurand.is_direction:
        # cos² of half the angle, and the part of the gap across the direction brought to the length of the chord
        half = k.let("half", 1 - square / 4)
        safe = k.let("safe", select(half > 1e-12, half, 1e-12))
        error = k.let("across", (gap - place * gap.dot(place)) / sqrt(safe))
        chord = k.let("chord", sqrt(square) / 2)
        distance = 2 * asin(select(chord > 1, 1, chord))  # NaN stays
    else:
        error, distance = gap, sqrt(square)
    reach = Matrix([sqrt(x.dot(x)) for x in (slopes.col(j) for j in range(joints))])
    return k.program("aim", error=error, distance=distance, pull=slopes.T * error, reach=reach)


def step_kernel(measurand: Measurand, joints: int, arm: float) -> Program:
    """Write a damped step of the joints towards the wanted place, the least one where several do.

    Inputs: ``place``, ``place_jacobian``, ``error``, ``weight``, how freely each joint moves, and ``damping``, 0 for
    Newton's step. A weight of 0 holds a joint; the damping is relative to the mean square of the scaled Jacobian.
    """
    k, size = _Numeric(), measurand.place_numbers
    errors = len(measurand.rigid if measurand.has_attitude else "xyz")
    place, slopes = k.input("place", size), k.input("place_jacobian", size, joints)
    error, weight = k.input("error", errors), k.input("weight", joints)
    (damping,) = k.input("damping")
    if measurand.has_attitude:
        slopes = k.let("slopes", _with_turns(place, slopes, arm))
    scaled = Matrix(errors, joints, [slopes[i, j] * weight[j] for i in range(errors) for j in range(joints)])
    k.let("scaled", scaled)
    freedoms = len(measurand.freedoms)
    few = joints <= freedoms
    square = scaled.T * scaled if few else scaled * scaled.T
    n = square.shape[0]
    level = k.let("level", sum(square[i, i] for i in range(n)) / freedoms)
    diagonal = k.let("added", damping * level + TINY)
    if not few and measurand.is_direction:
        square = (
            square + place * place.T * level
        )  # no step goes along the direction: this only keeps it regular
    square = square + Matrix.eye(n) * diagonal
    y = Matrix(solved(k.let, square, scaled.T * error if few else error))
    y = y if few else scaled.T * y
    return k.program("step", step=Matrix([w * x for w, x in zip(weight, y, strict=True)]))
