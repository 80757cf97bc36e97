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
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import sympy as sp

from rodgen.array_types import Array
from rodgen.codegen import Assignment, Kernel, KernelBuilder, Port, port_symbols
from rodgen.machines.algebra import solved
from rodgen.machines.closed_chain_derivation import pose_from_afar
from rodgen.machines.derivation import model_kernel
from rodgen.machines.kinematics import OnLegs
from rodgen.machines.measured import Measurand
from rodgen.machines.model import Frame, Model
from rodgen.machines.model_steps import ModelSteps
from rodgen.machines.structure import Structure, Term, row_effects
from rodgen.symbolic import select

SOURCE = "product of exponentials with error motions"
TINY = sp.Rational(1, 10**300)
"""Added to what is divided by: where no joint moves the place at all, the step is zero."""

OF_A_JOINT = frozenset({"axis", "point", "u", "v", "start", "length"})
"""Parts of the geometry that each joint has."""
OF_A_CLOSED_CHAIN = {
    "R": "base_radius",
    "A": "arm_length",
    "L": "rod_length",
    "r": "platform_radius",
    "q": "offset",
    "h": "pivot_height",
    **{f"{of[0].upper()}{k}": f"{of}_joint{k}" for of in ("base", "platform") for k in range(1, 7)},
}
"""Parts of the geometry of a closed chain, and what they are called in code."""
SWEEPS = 5
"""Joints up to which derivatives are accumulated forward: 0.6 of the operations of three sweeps backward with 4 or 5
joints and many effects, 1.6 of them with 6."""


@dataclass(frozen=True)
class Constant:
    """A number of the machine that the emitted code names."""

    name: str
    """Identifier in the code, made of fixed words and numbers."""
    value: float
    of: tuple[str, int, str]
    """What it is: part of the geometry or ``"effect"``, number of the joint or term, component or parameter."""


@dataclass(frozen=True)
class MachineKernels:
    """Forward kernels of a machine, with its numbers."""

    forward: Kernel
    """Inputs: ``q``, ``start`` of a closed chain, the columns (``s0``, ``t``, ...), ``seen`` where targets differ, the
    constants. Its derivative does not run through ``start``, on which a solved pose does not depend."""
    pose: Kernel | None
    """What finds ``start`` of ``q`` and the constants."""
    columns: tuple[tuple[str, tuple[str, int | str]], ...]
    """Names of the inputs that differ from row to row, other than ``q``, and the column of each."""
    constants: tuple[Constant, ...]
    seen: Array
    """The input ``seen`` of each target, (targets, n)."""
    seen_of: tuple[str, ...]
    """What its components are."""

    @cached_property
    def place(self) -> Kernel:
        """The kernel of the place: inputs ``q``, the columns, ``seen``, the constants."""
        return self._begun(self.forward)

    @cached_property
    def place_and_jacobian(self) -> Kernel:
        """The kernel with the position and its derivative with respect to ``q``."""
        mode = "forward" if self.forward.port("q").size <= SWEEPS else "reverse"
        name = f"{self.forward.name}_and_jacobian"
        return self._begun(self.forward.jacobian(["q"], ["place"], name=name, values=True, mode=mode))

    def _begun(self, kernel: Kernel) -> Kernel:
        """Return a kernel after the one that finds the start, where there is one."""
        return kernel if self.pose is None else kernel.after(self.pose)

    def inputs(self, q: Sequence[float], columns: Mapping[str, float], target: int) -> dict[str, Any]:
        """Return the inputs of the kernels by name, constants and all."""
        values: dict[str, Any] = {constant.name: constant.value for constant in self.constants}
        values |= {"q": list(q), **columns}
        if self.seen.shape[1]:
            values["seen"] = list(self.seen[target])
        return {port.name: values[port.name] for port in self.place.inputs}


def machine_kernels(model: Model, name: str = "place", prefix: str = "") -> MachineKernels:
    """Write the forward kernels of a machine in machine axes; names of its constants begin with `prefix`."""
    structure = _without_parameters(model.structure)
    general = model_kernel(ModelSteps(structure, name, with_residual=False))
    numbers = _Numbers(model, structure, prefix)
    pose = _pose_kernel(model, structure, numbers) if structure.kinematics.pose_numbers else None
    rows, g, e = (list(general.port(port).symbols) for port in ("rows", "g", "e"))
    columns = [
        (c, s) for c, s in zip(structure.columns, rows, strict=True) if c[0] not in {"reading", "weight"}
    ]
    stands_for = dict(zip(g, numbers.geometry, strict=True))
    stands_for |= dict(zip(e, numbers.effects, strict=False))  # one is left over where there is none
    if structure.slots:  # the change of a freedom is in the geometry already
        stands_for |= dict.fromkeys(general.port("freedom").symbols, sp.S.Zero)

    ports = [_port("q", (len(structure.joints),), "commanded coordinates")]
    if pose is not None:
        ports.append(_port("start", pose.port("start").shape, "pose on the nominal machine"))
    names: dict[str, tuple[str, int | str]] = {}
    for (kind, of), symbol in columns:
        if kind == "q":
            stands_for[symbol] = ports[0].symbols[int(of)]
            continue
        if kind == "start":
            stands_for[symbol] = ports[1].symbols[int(of)]
            continue
        of_row = _port(_column_name(kind, of, names), (), "of the row")
        names[of_row.name] = kind, of
        stands_for[symbol] = of_row.symbols[0]
        ports.append(of_row)
    if numbers.seen.shape[1]:
        ports.append(_port("seen", (numbers.seen.shape[1],), "of the target"))
    place = _folded(general, stands_for, ports, numbers)
    kernels = [place] if pose is None else [place, pose]
    read = {s.name for kernel in kernels for a in kernel.assignments for s in a.value.free_symbols}
    return MachineKernels(
        place,
        pose,
        tuple((n, column) for n, column in names.items() if n in read),
        tuple(constant for constant in numbers.constants if constant.name in read),
        numbers.seen,
        numbers.seen_of,
    )


def _without_parameters(structure: Structure) -> Structure:
    joints = tuple(replace(joint, axis=False, point=False) for joint in structure.joints)
    return replace(structure, joints=joints, target=False, numbers=())


def _pose_kernel(model: Model, structure: Structure, numbers: _Numbers) -> Kernel:
    """Write the kernel that finds the pose of a closed chain on the nominal machine."""
    bare = replace(structure, terms=(), shift=False, frame=False)
    kinematics = model.machine.kinematics
    assert isinstance(kinematics, OnLegs)
    begins = kinematics.begins
    general = _general_pose_kernel(bare, begins.shape)
    q = _port("q", (len(structure.joints),), "commanded coordinates")
    stands_for: dict[sp.Symbol, sp.Expr] = {}
    for (kind, of), symbol in zip(bare.columns, general.port("rows").symbols, strict=True):
        if kind == "q":
            stands_for[symbol] = q.symbols[int(of)]
    if len(begins):
        symbols = iter(general.port("begin").symbols)
        for k, begin in enumerate(begins.tolist()):
            for name, value in zip(kinematics.begin_of, begin, strict=True):
                stands_for[next(symbols)] = numbers.number(value, "begin", k, name)
    for slot, symbol in zip(_slots(bare), general.port("g").symbols, strict=True):
        stands_for[symbol] = numbers.by_slot[slot]
    return _folded(general, stands_for, [q], numbers)


@lru_cache(maxsize=8)
def _general_pose_kernel(bare: Structure, begins: tuple[int, ...]) -> Kernel:
    """Write it once for the fitted machine and the nominal one."""
    return pose_from_afar(ModelSteps(bare, "pose", with_residual=False), begins)


def _folded(
    general: Kernel, stands_for: Mapping[sp.Symbol, sp.Expr], ports: Sequence[Port], numbers: _Numbers
) -> Kernel:
    """Return a kernel with other inputs: `ports` and the constants that it reads; numbers are folded in."""
    known = {symbol: value for symbol, value in stands_for.items() if value.is_Number}
    inputs = [
        *ports,
        *(_port(constant.name, (), "a number of the machine") for constant in numbers.constants),
    ]
    if known:
        inputs.append(Port("known", (len(known),), "1", "folded in", tuple(known)))
    renamed = {symbol: value for symbol, value in stands_for.items() if symbol not in known}
    steps = tuple(Assignment(a.symbol, a.value.xreplace(renamed)) for a in general.assignments)
    made = replace(general, inputs=tuple(inputs), assignments=steps)
    made = made.at({"known": list(known.values())}) if known else made
    read = {s.name for a in made.assignments for s in a.value.free_symbols}
    return replace(made, inputs=tuple(p for p in made.inputs if p.shape != () or p.name in read))


def _port(name: str, shape: tuple[int, ...], doc: str) -> Port:
    return Port(name, shape, "1", doc, port_symbols(name, shape))


def _column_name(kind: str, of: int | str, names: Mapping[str, tuple[str, int | str]]) -> str:
    if kind == "x":
        return f"column{sum(k == 'x' for k, _ in names.values())}"
    return {"t": "t", "F": "load"}.get(kind, f"{kind}{of}")


class _Numbers:
    """What stands for each component of ``g`` and ``e``: a number, a named constant, or a component of ``seen``."""

    def __init__(self, model: Model, structure: Structure, prefix: str) -> None:
        self.constants: list[Constant] = []
        self.prefix = prefix
        theta = model.start()
        values = np.array(
            [self._geometry(model, structure, theta, k) for k in range(len(model.machine.targets))]
        )
        differ = np.flatnonzero(np.ptp(values, axis=0) > 0)
        self.seen = values[:, differ]
        seen = iter(port_symbols("seen", (len(differ),)))
        slots = _slots(structure)
        self.seen_of = tuple(_slot_name(*slots[i]) for i in differ)
        self.geometry: list[sp.Expr] = [
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

    def number(self, value: float, part: str, number: int, component: str) -> sp.Expr:
        if value in (0.0, 1.0, -1.0):
            return sp.Integer(int(value))
        return self._named(_slot_name(part, number, component), value, (part, number, component))

    def _parameter(self, value: float, number: int, name: str, term: Term, definition: Any) -> sp.Expr:
        """Return a parameter; one that is zero takes its term away where the formula is known to be linear in it."""
        if value == 0.0 and not term.own and name not in definition.searched:
            return sp.S.Zero
        is_ours = not term.own and name in definition.parameters
        plain = name if is_ours else f"p{term.parameters.index(name)}"
        return self._named(f"effect{number}_{plain}", value, ("effect", number, name))

    def _named(self, name: str, value: float, of: tuple[str, int, str]) -> sp.Symbol:
        self.constants.append(Constant(f"{self.prefix}{name}", value, of))
        return sp.Symbol(self.constants[-1].name, real=True)


def _slots(structure: Structure) -> list[tuple[str, int, str]]:
    """Return part, number and component of each number in ``g``."""
    return [(part, n, _component(i, length)) for part, n, length in structure.geometry for i in range(length)]


def _slot_name(part: str, number: int, component: str) -> str:
    part = OF_A_CLOSED_CHAIN.get(part, part)
    of = f"{part}{number}" if part in OF_A_JOINT | {"acts", "begin"} else part
    return "_".join(filter(None, [of, component]))


def _component(i: int, length: int) -> str:
    return {1: "", 3: "xyz"[i % 3], 9: f"{i // 3 + 1}{i % 3 + 1}"}[length]


# what a compensation repeats ---------------------------------------------------------------------------------


def _turns(rates: sp.Matrix, axes: sp.Matrix) -> sp.Matrix:
    """Return ½ Σ m × m′ over the axes m of a body, columns of a matrix: the rotation vector of their rates m′."""
    half = sp.Rational(1, 2)
    return sum((axes[:, i].cross(rates[:, i]) for i in range(3)), sp.zeros(3, 1)) * half


def _exact(arm: float) -> sp.Expr:
    """Return a round number near a lever arm, whose size hardly matters."""
    return sp.Rational(f"{arm:.3g}")


def _with_turns(place: sp.Matrix, jacobian: sp.Matrix, arm: float) -> sp.Matrix:
    """Return the derivative of a pose, (6, joints): of its point, and its turns times an arm; (3, joints) without."""
    axes = sp.Matrix(3, 3, list(place[-9:, :]))
    columns = (
        _turns(sp.Matrix(3, 3, list(jacobian[-9:, j])), axes) * _exact(arm) for j in range(jacobian.cols)
    )
    return sp.Matrix.vstack(jacobian[:-9, :], sp.Matrix.hstack(*columns))


def aim_kernel(measurand: Measurand, joints: int, arm: float) -> Kernel:
    """Write the kernel of how far a place is from the wanted one, and how each joint pulls it there.

    Outputs: ``error`` (3), of a direction in its tangent plane, as long as the chord, (6) of a pose, turns times `arm`;
    ``distance``, of directions the angle, of attitudes 2 tan of its half; ``pull`` (joints): Jᵀ error; ``reach``
    (joints): how far the place goes with each joint.
    """
    k = KernelBuilder(
        "aim", summary="How far it is to the wanted place, and which joints pull.", source=SOURCE
    )
    size = measurand.place_numbers
    place = k.input("place", size, unit="1", doc="where the machine is")
    jacobian = k.input("place_jacobian", (size, joints), unit="1", doc="its derivative")
    wanted = k.input("wanted", size, unit="1", doc="where it should be")
    if measurand.has_attitude:
        axes, goal = (sp.Matrix(3, 3, list(x[-9:, :])) for x in (place, wanted))
        along = k.let("along", 1 + sum(axes[:, i].dot(goal[:, i]) for i in range(3)))
        safe = k.let("safe", select(along > sp.Rational(1, 10**6), along, sp.Rational(1, 10**6)))
        turn = _turns(goal, axes) * (4 * _exact(arm) / safe)
        gap = k.let("gap", sp.Matrix.vstack(wanted[:-9, :] - place[:-9, :], turn))
        jacobian = k.let("slopes", _with_turns(place, jacobian, arm))
    else:
        gap = k.let("gap", wanted - place)
    square = k.let("square", gap.dot(gap))
    if measurand.is_direction:
        # cos² of half the angle, and the part of the gap across the direction brought to the length of the chord
        half = k.let("half", 1 - square / 4)
        safe = k.let("safe", select(half > sp.Rational(1, 10**12), half, sp.Rational(1, 10**12)))
        error = k.let("across", (gap - place * gap.dot(place)) / sp.sqrt(safe))
        chord = k.let("chord", sp.sqrt(square) / 2)
        distance = 2 * sp.asin(select(chord > 1, sp.S.One, chord))  # NaN stays
    else:
        error, distance = gap, sp.sqrt(square)
    k.output("error", error, unit="1", doc="from the place to the wanted one")
    k.output("distance", distance, unit="1", doc="its length")
    k.output("pull", jacobian.T * error, unit="1", doc="derivative of half the squared distance, negative")
    reach = [sp.sqrt(jacobian[:, j].dot(jacobian[:, j])) for j in range(joints)]
    k.output("reach", sp.Matrix(reach), unit="1", doc="lengths of the Jacobian's columns")
    return k.build()


def step_kernel(measurand: Measurand, joints: int, arm: float) -> Kernel:
    """Write the kernel of a damped step of the joints towards the wanted place, the least one where several do.

    A weight of 0 holds a joint; the damping is relative to the mean square of the scaled Jacobian.
    """
    k = KernelBuilder("step", summary="The least step of the joints towards the wanted place.", source=SOURCE)
    size, errors = measurand.place_numbers, len(measurand.rigid if measurand.has_attitude else "xyz")
    place = k.input("place", size, unit="1", doc="where the machine is")
    jacobian = k.input("place_jacobian", (size, joints), unit="1", doc="its derivative")
    error = k.input("error", errors, unit="1", doc="from the place to the wanted one")
    weight = k.input("weight", joints, unit="1", doc="how freely each joint moves")
    damping = k.input("damping", unit="1", doc="0 for Newton's step")
    if measurand.has_attitude:
        jacobian = k.let("slopes", _with_turns(place, jacobian, arm))
    scaled = k.let("scaled", sp.Matrix(errors, joints, lambda i, j: jacobian[i, j] * weight[j]))
    freedoms = len(measurand.freedoms)
    few = joints <= freedoms
    square = scaled.T * scaled if few else scaled * scaled.T
    square = sp.Matrix(*square.shape, [k.let(f"a{n}", x) for n, x in enumerate(square)])
    level = k.let("level", square.trace() / freedoms)
    diagonal = k.let("added", damping * level + TINY)
    if not few and measurand.is_direction:
        square = (
            square + place * place.T * level
        )  # no step goes along the direction, so this only keeps it regular
    square = square + sp.eye(square.rows) * diagonal
    right = scaled.T * error if few else error
    y = sp.Matrix(solved(k.let, square, right))
    y = y if few else scaled.T * y
    k.output(
        "step", sp.Matrix([w * x for w, x in zip(weight, y, strict=True)]), unit="1", doc="of the joints"
    )
    return k.build()
