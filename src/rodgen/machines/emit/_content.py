"""The content of an emitted machine's files, independent of the language: kernels, tables, words, test samples.

Samples are compared with where the machine is by the kernels that a fit evaluates. These are derived from the machine
as it was measured, with its instrument and its frame, and run on NumPy; the emitted code from the part of the machine
that is emitted, with its numbers.
"""

from __future__ import annotations

import keyword
import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.codegen.operations import CPP_WORDS, MATLAB_WORDS
from rodgen.codegen.source_text import in_comment
from rodgen.errors import RodgenError, shown
from rodgen.machines.emit._compensation import ROUNDING, STATUSES, Compensation
from rodgen.machines.emit._kernels import (
    PORTS,
    Constant,
    MachineKernels,
    machine_kernels,
)
from rodgen.machines.emit._scope import Scope, scope_of
from rodgen.machines.families.kinematics import Kinematics
from rodgen.machines.layout import OF_JOINTS, WORDS
from rodgen.machines.measured import ANGLE_ABOUT
from rodgen.machines.model import Frame, Model
from rodgen.machines.rigid import rotation_vector
from rodgen.machines.structure import row_effects

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine
    from rodgen.machines.parameters import Parameter


class Reference:
    """The model of a machine, in the frame of the machine.

    Parameters
    ----------
    machine : Machine
        Without effects of the instrument. An inclination is read of the same body as an angle, whose kernel has the
        attitude.
    travel : array_like, optional
        As of :class:`Model`.
    """

    def __init__(self, machine: Machine, travel: Any = None) -> None:
        self.machine = machine
        if machine.measurand.line == "vertical":
            up = (-machine.gravity[0], -machine.gravity[1], -machine.gravity[2])
            measured = replace(machine.measured, kind=ANGLE_ABOUT.kind, about=up)
            machine = replace(machine, measured=measured)
        self.model = Model(machine, travel, compiled=False)
        self.theta = self.model.start()

    @classmethod
    def of(cls, machine: Machine, scope: Scope, travel: Any = None) -> Reference:
        """Return that of a fitted machine, of which the scope leaves out effects that belong to no part of it."""
        effects = tuple(e for e in machine.effects if e.place is not None or e in scope.machine.effects)
        return cls(replace(machine, effects=effects), travel)

    def nominal(self) -> Reference:
        """Return that of the nominal machine, with targets as they are mounted: directions as in the file."""
        return Reference(ideal_of(self.machine, self.model))

    @property
    def conditions(self) -> list[tuple[str, int | str]]:
        """The columns of a row other than coordinates, as in `Structure.columns`."""
        return [column for column in self.model.structure.columns if column[0] in PORTS]

    @cached_property
    def _fitted(self) -> Kinematics:
        kinematics = self.machine.kinematics
        return kinematics.with_numbers({n: self.model.number(self.theta, n) for n in kinematics.numbers})

    def poses(self, q: Array) -> Array:
        """Return the poses of a platform that emitted code finds without effects, (n, numbers); of a chain (n, 0)."""
        return self._fitted.found_by_code(q)

    def is_regular(self, q: Array, least: float) -> NDArray[np.bool_]:
        """Return where a platform is held with at least this singular value, (n,): everywhere of a chain."""
        return self._fitted.least_singular_value(self.poses(q)) > least

    def places(
        self,
        q: Array,
        targets: Sequence[int],
        conditions: Mapping[tuple[str, int | str], Array] | None = None,
    ) -> Array:
        """Return where targets are: points, directions or attitudes, row by row, (n, numbers).

        Parameters
        ----------
        q : ndarray, shape (n, joints)
        targets : sequence of int, length n
        conditions : mapping of column to ndarray, shape (n,), optional
            Of :attr:`conditions`; zero where there is none.
        """
        known = {("q", j): x for j, x in enumerate(q.T)} | dict(conditions or {})
        known |= {("start", i): x for i, x in enumerate(self.poses(q).T)}
        rows = np.stack([known.get(x, np.zeros(len(q))) for x in self.model.structure.columns], axis=1)
        g = self.model.geometries(self.theta, Frame.identity(), [(target, 0) for target in targets])
        e = self.model.parameters_of_effects(self.theta)
        e = np.broadcast_to(e, (len(q), len(e)))
        places: Array = self.model.kernels["place"].in_sets(rows, [1] * len(q), g, e)[0]
        return places


SAMPLES = 20
TRIES = 40 * SAMPLES
"""Points tried at most until enough of them have a finite place: a formula may have none at some."""
OFF_SEEN = 0.01
"""Part of their lengths by which the legs of a sample differ from those of a pose that the code starts from."""
REGULAR = 0.1
"""Least singular value of a pose, 1 at best, above which rounding does not matter."""
MARGIN = 0.1
"""Part of the travel at its ends from where no sample is taken, so that small steps from a sample stay inside."""

DIFFERENCE = 1e-5
"""Step of the difference quotients, in parts of a sample's motion: rounding leaves 1e-11, curvature less."""
SLOPES = 1e-6
"""Of the size and the motion, how far a slope may be off."""
ASIDE = 1e-3
"""By so many weights the commands of a sample are moved to a place that can be reached."""
FAR = 1e3
"""So many sizes away nothing is reached."""

NEARBY, IN_LINE = 1e-6, 1e-3
"""A motion of so many weights shows where a joint moves a place; a motion of all of them by less than this part of the
size across the others is the curvature of these. The sample with most freedoms counts."""

_HEADERS = """assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdarg stdbool
stddef stdint stdio stdlib string tgmath time wchar wctype"""
_MODULES = {*keyword.kwlist, *keyword.softkwlist, *sys.stdlib_module_names, "numpy", "jax"}
_TAKEN = {*_MODULES, *_HEADERS.split(), *CPP_WORDS.split(), *MATLAB_WORDS.split(), "linux", "unix"}
"""Names that an emitted file would hide from Python or from the C compiler, or that a language keeps for itself."""
_LONGEST_NAME = 40

COLUMNS = {
    "s": "direction of approach, +1 or -1",
    "v": "velocity",
    "T": "temperature less {reference:g} degC, K",
    "t": "time, s",
    "F": "payload force along gravity, N",
    "x": "covariates, in these units",
}
"""What each kind of column is, other than the coordinates."""


@dataclass(frozen=True)
class Field:
    """A field of a row: a number, or an array."""

    name: str
    length: int
    """0 for a number."""
    doc: str


@dataclass(frozen=True)
class Sample:
    """A point at which the emitted code is tested."""

    q: tuple[float, ...]
    fields: dict[str, tuple[float, ...]]
    """Values of the conditions, zero where a machine does not depend on them."""
    target: int
    place: tuple[float, ...]
    ideal: tuple[float, ...]
    """Where the machine is, fitted and nominal, by the kernels of a fit."""
    along: tuple[float, ...]
    slope: tuple[float, ...]
    """A motion of the coordinates, and how the place goes with it: a quotient of differences of the fourth order."""


@dataclass(frozen=True)
class Case:
    """A compensation by which the emitted code is tested."""

    sample: int
    """The sample with the command and the conditions."""
    times: float
    """The command is that of the sample times this: 1 or NaN."""
    target: int
    wanted: tuple[float, ...]
    lowest: int
    highest: int
    """Codes of the status between which it is."""
    most: float
    """The distance of the corrected place from the wanted one, at most; NaN where there is none."""


@dataclass(frozen=True)
class Content:
    """The content of the files."""

    name: str
    """Of the files, and prefix of what is in them."""
    machine: Machine
    """As it was given."""
    scope: Scope
    fitted: MachineKernels
    ideal: MachineKernels
    compensation: Compensation
    fields: tuple[Field, ...]
    """Of a row, without ``q``."""
    weight: tuple[float, ...]
    """How freely each joint moves in a compensation: not where it moves no target on the nominal machine. A slide
    that tilts by an error would go far for an attitude."""
    size: float
    """Of the numbers that a place is made of."""
    samples: tuple[Sample, ...]
    cases: tuple[Case, ...]
    slopes: float
    """How far slopes of samples may be off."""

    @property
    def directions(self) -> bool:
        """Whether a place is a direction."""
        return self.scope.machine.measurand.is_direction

    @property
    def numbers(self) -> int:
        """How many numbers a place has: a point and the matrix of an attitude have twelve."""
        return self.scope.machine.measurand.place_numbers

    @property
    def at_rest(self) -> list[str]:
        """What forms that follow the coordinates alone say of the other conditions."""
        text = "Without load, at rest, at the reference temperature and time 0, between both directions of approach."
        return [text] if self.fields else []


def content_of(machine: Machine, name: str | None = None, travel: Any = None) -> Content:
    """Return the content of the files of a machine; see :func:`rodgen.machines.emit.emit`."""
    chosen = named(machine, name)
    scope = scope_of(machine, travel)
    fitted = machine_kernels(scope.model)
    ideal = machine_kernels(Model(ideal_of(scope.machine, scope.model)), "ideal", "ideal_")
    measurand, joints = scope.machine.measurand, machine.joints
    size = _size(scope)
    limits = [limits_of or (-np.inf, np.inf) for limits_of in machine.limits]
    usual = [2 * np.pi if joint.revolute else size for joint in joints]
    ranges = [high - low for low, high in limits]
    weight = [
        way if 0 < way < np.inf else usual_range for way, usual_range in zip(ranges, usual, strict=True)
    ]
    reference = Reference.of(machine, scope, travel)
    nominal = reference.nominal()
    fields = tuple(_fields(scope.machine, fitted))
    samples = tuple(_samples(scope, fitted, fields, reference, nominal, size, weight))
    moved, freedoms = _moves(nominal, samples, weight, size)
    freely = np.where(moved, weight, 0.0)
    return Content(
        name=chosen,
        machine=machine,
        scope=scope,
        fitted=fitted,
        ideal=ideal,
        compensation=Compensation(
            measurand,
            [joint.revolute for joint in joints],
            [low for low, _ in limits],
            [high for _, high in limits],
            size,
            is_bound=freedoms < len(measurand.freedoms),
        ),
        fields=fields,
        weight=tuple(freely.tolist()),
        size=size,
        samples=samples,
        cases=tuple(_cases(scope, fitted, reference, samples, size, freely)),
        slopes=SLOPES * (size + sum(weight)),
    )


def ideal_of(machine: Machine, model: Model) -> Machine:
    """Return the machine without errors, with the targets that there are.

    Where a ball or a reflector is mounted is no error of the machine, and joints may not be able to make up for it. A
    measured direction is what the machine points, such as a telescope's line of sight, and belongs where the file says.
    """
    targets, theta = machine.targets, model.start()
    if machine.measurand.moving:
        places = [model.target(theta, k).tolist() for k in range(len(targets))]
        targets = tuple(replace(target, point=tuple(x)) for target, x in zip(targets, places, strict=True))
    if machine.measurand.has_attitude:
        turns = [rotation_vector(model.attitude(theta, k)).tolist() for k in range(len(targets))]
        targets = tuple(replace(t, attitude=tuple(x)) for t, x in zip(targets, turns, strict=True))
    return replace(machine, targets=targets, effects=(), estimate=(), values={}, ties={})


# names -------------------------------------------------------------------------------------------------------


def identifier(text: str) -> str:
    """Return a name for files and functions, made from a machine's name.

    Examples
    --------
    >>> identifier("Gantry with a rotary C axis"), identifier("Fräse 3"), identifier("6R"), identifier("math")
    ('gantry_with_a_rotary_c_axis', 'fr_se_3', 'machine_6r', 'math_machine')
    """
    name = re.sub(r"[^a-z0-9]+", "_", text.lower()[:400]).strip("_")[:_LONGEST_NAME].strip("_")
    if not name or not name[0].isalpha():
        name = f"machine_{name}".strip("_")
    return f"{name}_machine" if name in _TAKEN else name


def named(machine: Machine, name: str | None) -> str:
    """Return the name of a machine's files: the given one, checked, or one made from the machine's."""
    return identifier(machine.name) if name is None else _checked(name)


def title_of(machine: Machine) -> str:
    """Return a machine's name on one line, which can end no comment and no string in double quotes."""
    return in_comment(shown(machine.name)[1:-1]).replace('"', "'")


def _checked(name: str) -> str:
    if not re.fullmatch(rf"[a-z][a-z0-9_]{{0,{_LONGEST_NAME - 1}}}", name):
        raise RodgenError(
            f"the name {shown(name)}; expected lower-case letters, digits and _, a letter first, "
            f"{_LONGEST_NAME} at most"
        )
    if name in _TAKEN:
        raise RodgenError(
            f"the name {shown(name)} is taken in C, C++, MATLAB or Python; expected another one"
        )
    return name


# words -------------------------------------------------------------------------------------------------------

_PARTS = WORDS | {
    "begin": "of a pose to begin with: lengths of the legs, position, unit quaternion",
}


def constant_words(scope: Scope, constant: Constant) -> str:
    """Return a short description of a constant."""
    part, number, name = constant.of
    machine = scope.machine
    if part == "effect":
        parameter = scope.model.parameters[scope.model.index["e", number, name]]
        effect = shown(row_effects(machine)[number].title)
        return f"{name} of {effect}: {_shown_value(parameter, constant.value, '.9g')}"
    words = {"length": machine.length_unit, "joint": "", "coordinate": ""}
    if part in {each.name for each in OF_JOINTS}:
        joint = machine.joints[number]
        words |= {"joint": shown(joint.name), "coordinate": coordinate_unit(machine, number)}
    parts = _PARTS | {name: text for name, (_, text) in machine.kinematics.number_words.items()}
    return parts[part].format(**words, target=shown(machine.targets[0].name))


def coordinate_unit(machine: Machine, joint: int) -> str:
    """Return the unit of a joint's coordinate in the emitted code."""
    return "rad" if machine.joints[joint].revolute else machine.length_unit


def _fields(machine: Machine, kernels: MachineKernels) -> Iterator[Field]:
    names = [joint.name for joint in machine.joints]
    for kind, text in COLUMNS.items():
        doc, port = text.format(reference=machine.reference_temperature), PORTS[kind]
        used = [of for k, of in kernels.conditions if k == kind]
        words = ", ".join(shown(of if kind == "x" else names[int(of)]) for of in used if kind not in "tF")
        if used:
            length = 0 if kind in "tF" else kernels.place.inputs[port][0]
            yield Field(port, length, doc + {"x": f" {words}", "t": "", "F": ""}.get(kind, f"; of {words}"))


def effect_words(scope: Scope) -> list[tuple[str, str]]:
    """Return the effects that are emitted, each with the values of its parameters."""
    model, start = scope.model, scope.model.start()
    words = []
    for effect in scope.machine.effects:
        keys = {name: effect.key(name) for name in effect.units(scope.machine)}
        values = []
        for name, index in ((name, model.keys[key]) for name, key in keys.items() if key in model.keys):
            parameter = model.parameters[index]
            values.append(f"{name} = {_shown_value(parameter, start[index], '.6g')}")
        words.append((shown(effect.title), ", ".join(values)))
    return words


def _shown_value(parameter: Parameter, value: float, form: str) -> str:
    """Return the value of a parameter in the unit in which it is shown."""
    return f"{value / parameter.factor:{form}}" + ("" if parameter.unit == "1" else f" {parameter.unit}")


# sizes and samples -------------------------------------------------------------------------------------------


def _size(scope: Scope) -> float:
    """Return the largest length that a place is a sum of; 1 for a direction."""
    machine = scope.machine
    if not machine.measurand.moving:
        return 1.0
    slides = np.array([joint.type == "prismatic" for joint in machine.joints])
    # that of the data where the file has none
    travel = np.abs(scope.model.travel[slides]).max(axis=1).tolist()
    points = [
        float(np.linalg.norm(p))
        for p in (*(j.point for j in machine.joints), *(t.point for t in machine.targets))
    ]
    loop = machine.kinematics
    usual = [loop.usual_travel(k) for k in range(len(machine.joints)) if not machine.joints[k].revolute]
    travel += [max(highest for _, highest in filter(None, usual))] if any(usual) else []
    if loop.is_closed and not usual:  # of arms, which turn, and rods
        travel += [float(np.linalg.norm(loop.number(name))) for name in loop.numbers]
    return float(sum(travel) + max(points)) or 1.0


def _samples(
    scope: Scope,
    fitted: MachineKernels,
    fields: Sequence[Field],
    reference: Reference,
    nominal: Reference,
    size: float,
    weight: Sequence[float],
) -> Iterator[Sample]:
    """Yield samples from an even sequence all over the travel, with their places."""
    machine, count = scope.machine, len(scope.machine.joints)
    low, high = np.array(
        [
            travel if np.ptp(travel) > 0 else _usual_travel(machine, j, size)
            for j, travel in enumerate(scope.model.travel.tolist())
        ]
    ).T
    conditions, begins = reference.conditions, machine.kinematics.begins
    points = np.array(list(_even(count + len(conditions), TRIES)))
    numbers = np.arange(TRIES)
    q = low + (MARGIN + (1 - 2 * MARGIN) * points[:, :count]) * (high - low)
    if len(begins):  # of several modes the one that is meant is only sure near these
        near = begins[numbers % len(begins), :count]
        q = near * (1 + OFF_SEEN * (2 * points[:, :count] - 1))
    values = {
        (kind, of): _column(kind, x, high[int(of)] - low[int(of)] if kind == "v" else 0.0)
        for (kind, of), x in zip(conditions, points[:, count:].T, strict=True)
    }
    targets = (numbers % len(machine.targets)).tolist()
    places, ideal = reference.places(q, targets, values), nominal.places(q, targets)
    good = np.isfinite(np.hstack([places, ideal])).all(axis=1) & reference.is_regular(q, REGULAR)
    if not good.any():
        raise RodgenError(
            f"{machine.file or machine.name}: the model is not finite at any of {TRIES} points all over the travel; "
            "expected formulas and values that are"
        )
    chosen = np.flatnonzero(good)[:SAMPLES]
    q, places, ideal = q[chosen], places[chosen], ideal[chosen]
    values = {column: x[chosen] for column, x in values.items()}
    targets = [targets[n] for n in chosen.tolist()]
    along = weight * (1 - 2 * points[chosen, :count])
    quotients = [
        factor * reference.places(q + offset * DIFFERENCE * along, targets, values) / (12 * DIFFERENCE)
        for offset, factor in zip((-2, -1, 1, 2), (1, -8, 8, -1), strict=True)
    ]
    slopes = np.sum(quotients, axis=0)
    for n, target in enumerate(targets):
        values_of = {field.name: [0.0] * max(field.length, 1) for field in fields}
        for column, (port, i) in fitted.conditions.items():
            values_of[port][i] = float(values[column][n])
        of_target = (tuple(x[n].tolist()) for x in (places, ideal, along, slopes))
        yield Sample(
            tuple(q[n].tolist()), {port: tuple(x) for port, x in values_of.items()}, target, *of_target
        )


def levers(scope: Scope, size: float) -> Array:
    """Return by what the numbers of a place count in a distance: turns as lengths."""
    measurand = scope.machine.measurand
    turns = 9 if measurand.has_attitude else 0
    return np.repeat([1.0, size / math.sqrt(2)], [measurand.place_numbers - turns, turns])


def _cases(
    scope: Scope,
    fitted: MachineKernels,
    reference: Reference,
    samples: Sequence[Sample],
    size: float,
    weight: Array,
) -> Iterator[Case]:
    """Yield what can be reached and what is wanted of each sample; of the first, too, what cannot be computed."""
    code = {name: k for k, (name, _) in enumerate(STATUSES)}
    q = np.array([sample.q for sample in samples])
    targets = [sample.target for sample in samples]
    values = {
        column: np.array([sample.fields[port][i] for sample in samples])
        for column, (port, i) in fitted.conditions.items()
    }
    aside = ASIDE * weight * (1 - 2 * (np.arange(len(weight)) % 2))
    near = reference.places(q + aside, targets, values)
    rounding = ROUNDING * size
    worst = code["NOT_CONVERGED"]
    for n, sample in enumerate(samples):
        yield Case(n, 1.0, sample.target, tuple(near[n].tolist()), 0, 0, 4 * rounding)
        before = float(np.linalg.norm((np.array(sample.place) - sample.ideal) * levers(scope, size)))
        yield Case(n, 1.0, sample.target, sample.ideal, 0, worst, before + rounding)
        if scope.machine.measurand.moving:
            far = FAR * size, *sample.ideal[1:]
            is_endless = any(limits is None or math.isinf(limits[1]) for limits in scope.machine.limits)
            yield Case(n, 1.0, sample.target, far, 0 if is_endless else 1, worst, math.inf)
    first, none, missing = samples[0], code["NOT_FINITE"], code["NO_TARGET"]
    nowhere = (math.nan,) * len(first.ideal)
    yield Case(0, math.nan, first.target, first.ideal, none, none, math.nan)
    yield Case(0, 1.0, first.target, nowhere, none, none, math.nan)
    for target in (-1, len(scope.machine.targets)):
        yield Case(0, 1.0, target, first.ideal, missing, missing, math.nan)


def _moves(
    nominal: Reference, samples: Sequence[Sample], weight: Sequence[float], size: float
) -> tuple[NDArray[np.bool_], int]:
    """Return which joints move a target on the nominal machine, and with how many freedoms together at most."""
    moved, freedoms = np.zeros(len(weight), bool), 0
    for sample in samples:
        levers = np.where(np.arange(len(sample.ideal)) < 3, 1.0, size)
        q = np.array(sample.q) + NEARBY * np.diag(weight)
        moves = (nominal.places(q, [sample.target] * len(q)) - sample.ideal) * levers
        least = IN_LINE * NEARBY * size
        moved |= np.linalg.norm(moves, axis=1) > least
        freedoms = max(freedoms, int(np.linalg.matrix_rank(moves, tol=least)))
    return moved, freedoms


def _usual_travel(machine: Machine, j: int, size: float) -> tuple[float, float]:
    """Return coordinates of a joint whose travel is not known."""
    of_joint = (-np.pi, np.pi) if machine.joints[j].revolute else (-size, size)
    return machine.kinematics.usual_travel(j) or of_joint


def _even(dimensions: int, count: int) -> Iterator[Array]:
    """Yield points that fill the unit cube: multiples of powers of 1/φ, where φ^(d + 1) = φ + 1 (Roberts' sequence)."""
    ratio = 2.0
    for _ in range(60):
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    step = np.array([ratio**-k for k in range(1, dimensions + 1)])
    for n in range(1, count + 1):
        yield np.asarray((0.5 + n * step) % 1.0)


def _column(kind: str, x: Array, span: float) -> Array:
    low, high = {"s": (-1, 1), "T": (-5, 5), "t": (0, 3600), "F": (0, 100), "x": (0, 1)}.get(kind, (-1, 1))
    if kind == "s":
        return np.where(x < 0.5, 1.0, -1.0)
    if kind == "v":
        return (2 * x - 1) * span / 100  # the whole travel in 100 s
    return low + x * (high - low)
