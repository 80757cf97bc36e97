"""The kernels of an emitted machine.

``place`` and ``place_and_jacobian`` are the fitted machine, ``ideal`` is the nominal one. A number of the machine that
is 0 or ±1 is folded in, so that an axis along z costs what a turn about z costs; every other one is a named constant.
What differs from target to target is an input, ``seen``. Its first component is added to every result: it is 0, and NaN
where there is no such target.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from rodgen.array_types import Array
from rodgen.codegen.program import Program
from rodgen.codegen.tape import Number, Tape
from rodgen.codegen.tape_jacobian import jacobian
from rodgen.codegen.tape_matrix import Matrix
from rodgen.machines.algebra import TapeBuilder, on_tape
from rodgen.machines.closed_chain import pose_from_afar
from rodgen.machines.derivation import model_kernel
from rodgen.machines.layout import OF_JOINTS
from rodgen.machines.model import Frame, Model
from rodgen.machines.model_steps import ModelSteps
from rodgen.machines.structure import Structure, Term, row_effects

_NUMBERED = {"acts", "begin", *(part.name for part in OF_JOINTS)}

PORTS = {"s": "s", "v": "v", "T": "T", "t": "t", "F": "load", "x": "x"}
"""Inputs that kinds of columns are, but for coordinates: numbers of all joints, a number, or covariates."""


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
    differentiable: list[Any]
    """The place; forces of legs are those in a pose that is solved, so that they change with `q` as it does."""
    held: frozenset[Any]


class PosePrograms(NamedTuple):
    """How the pose ``start`` of a closed chain is found: by `NEWTON_STEPS` from where it begins.

    Both have the inputs ``q`` and the constants, the second ``start`` too, before the step.
    """

    name: str
    begin: Program
    nearer: Program

    @property
    def size(self) -> int:
        """How many numbers a pose has."""
        return int(self.nearer.outputs["nearer"][0])


@dataclass(frozen=True)
class MachineKernels:
    """Forward programs of a machine, with its numbers."""

    place: Program
    """Inputs: ``q``, ``start`` of a closed chain, the conditions (:data:`PORTS`), ``seen``, the constants."""
    pose: PosePrograms | None
    """What finds ``start``."""
    conditions: dict[tuple[str, int | str], tuple[str, int]]
    """The columns of a row that it depends on, other than ``q``: input and component of each."""
    constants: tuple[Constant, ...]
    seen: Array
    """The input ``seen`` of each target, and of a missing one, (targets + 1, n)."""
    seen_of: tuple[str, ...]
    """What its components are."""
    values: _Values

    @cached_property
    def place_and_jacobian(self) -> Program:
        """The place, and its derivative with respect to ``q``, (numbers of a place, joints).

        It runs through the last of Newton's steps alone: on where this starts a solved pose does not depend.
        """
        tape, q, place, differentiable, held = self.values
        late = len(tape.numbers)
        known = tape.inputs("seen", self.seen.shape[1], same=False)[0]
        slopes = [slope + known for slope in chain(*jacobian(differentiable, q, held))]
        outputs = {
            "place": ((len(place),), place),
            "place_jacobian": ((len(place), len(q)), slopes),
        }
        return tape.program(f"{self.place.name}_and_jacobian", self.place.inputs, outputs, late)


class _Builder(TapeBuilder):
    """Makes a part of a program whose inputs stand already for numbers, constants, and what differs from row to row."""

    def __init__(self, on: Tape, inputs: Mapping[str, Sequence[Any]], prefix: str = "") -> None:
        super().__init__(on)
        self.given, self.prefix = inputs, prefix

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
    conditions: dict[tuple[str, int | str], tuple[str, int]] = {}
    shapes: dict[str, tuple[int, ...]] = {"q": (len(q),), "start": (len(start),)}
    for kind, of in structure.columns:
        if kind in PORTS:
            port, others = PORTS[kind], [kind for kind, _ in conditions]
            conditions[kind, of] = port, int(of) if kind in "svT" else others.count(kind)
    for kind, port in PORTS.items():
        if count := [kind for kind, _ in conditions].count(kind):
            shapes[port] = () if kind in "tF" else (count if kind == "x" else len(q),)
    inputs = {port: tape.inputs(port, math.prod(shape), same=False) for port, shape in shapes.items()}
    rows = [
        inputs[kind][int(of)]
        if kind in ("q", "start")
        else inputs[PORTS[kind]][conditions[kind, of][1]]
        if kind in PORTS
        else np.nan  # of residuals only
        for kind, of in structure.columns
    ]
    freedoms = [0] * len(structure.slots)  # the change of a freedom is in the geometry already
    arguments = {"rows": rows, "g": numbers.geometry, "e": numbers.effects or [0], "freedom": freedoms}
    steps = _Builder(tape, arguments).steps(structure)
    place = [x + numbers.known for x in model_kernel(steps).outputs["place"]]
    further = _Builder(tape, arguments).steps(structure)
    further.further_steps = 1
    pose_programs = _pose(model, structure, numbers, q, start) if start else {}

    shapes["seen"] = (numbers.seen.shape[1],)
    constants: dict[str, tuple[int, ...]] = {constant.name: () for constant in numbers.constants}
    outputs = {"place": ((len(place),), place)}
    begin = {"q": (len(q),), **constants}
    ports = {"begin": begin, "nearer": begin | {"start": (len(start),)}}
    programs = [
        tape.program(name, shapes | constants, outputs),
        *(
            tape.program(f"{name}_{port}", ports[port], {port: ((len(x),), x)})
            for port, x in pose_programs.items()
        ),
    ]
    of_ports = {tuple(args) for program in programs for op, *args in program.operations if op == "input"}
    read = {"q", "seen", *(port for port, _ in of_ports)} | ({"start"} if start else set())
    first, *pose = (
        replace(p, inputs={port: shape for port, shape in p.inputs.items() if port in read}) for p in programs
    )
    return MachineKernels(
        first,
        PosePrograms(f"{name}_pose", *pose) if pose else None,
        {
            column: place
            for column, place in conditions.items()
            if place in of_ports
            or place[0] == "x" in read  # covariates, all or none: they are in their order
        },
        tuple(constant for constant in numbers.constants if constant.name in read),
        numbers.seen,
        numbers.seen_of,
        _Values(tape, q, place, model_kernel(further).outputs["place"] if start else place, further.held),
    )


def _without_parameters(structure: Structure) -> Structure:
    joints = tuple(replace(joint, axis=False, point=False) for joint in structure.joints)
    return replace(structure, joints=joints, target=False, numbers=())


def _pose(
    model: Model, structure: Structure, numbers: _Numbers, q: list[Number], start: list[Number]
) -> dict[str, list[Any]]:
    """Return where the pose of a closed chain on the nominal machine begins, and a step from a start."""
    bare = replace(structure, terms=(), shift=False, frame=False)
    kinematics = model.machine.kinematics
    begins = kinematics.begins
    inputs = {
        "rows": [
            {"q": q, "start": start}[kind][int(of)] if kind in {"q", "start"} else np.nan
            for kind, of in bare.columns
        ],
        "g": [numbers.by_slot[slot] for slot in _slots(bare)],
        "e": [0],
        "freedom": [0] * len(bare.slots),
        "begin": [
            numbers.number(value, "begin", k, name)
            for k, begin in enumerate(begins.tolist())
            for name, value in zip(kinematics.begin_of, begin, strict=True)
        ],
    }
    builder: Any = pose_from_afar(_Builder(numbers.tape, inputs, "pose_").steps(bare), begins.shape)
    return {port: list(x) for port, x in builder.outputs.items()}


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
        self.seen = np.pad(values[:, differ], ((0, 1), (1, 0)))
        self.seen[-1] = np.nan
        self.known, *others = tape.inputs("seen", 1 + len(differ), same=False)
        seen = iter(others)
        slots = _slots(structure)
        self.words = structure.kinematics.number_words
        self.seen_of = ("whether there is no such target", *(self._slot_name(*slots[i]) for i in differ))
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
        short_name = name if is_ours else f"p{term.parameters.index(name)}"
        return self._named(f"effect{number}_{short_name}", value, ("effect", number, name))

    def _slot_name(self, part: str, number: int, component: str) -> str:
        part, _ = self.words.get(part, (part, ""))
        of = f"{part}{number}" if part in _NUMBERED else part
        return "_".join(filter(None, [of, component]))

    def _named(self, name: str, value: float, of: tuple[str, int, str]) -> Number:
        self.constants.append(Constant(f"{self.prefix}{name}", value, of))
        return self.tape.inputs(self.constants[-1].name, 1)[0]


def _slots(structure: Structure) -> list[tuple[str, int, str]]:
    """Return part, number and component of each number in ``g``."""
    return [(part, n, _component(i, length)) for part, n, length in structure.geometry for i in range(length)]


def _component(i: int, length: int) -> str:
    return {1: "", 3: "xyz"[i % 3], 9: f"{i // 3 + 1}{i % 3 + 1}"}[length]
