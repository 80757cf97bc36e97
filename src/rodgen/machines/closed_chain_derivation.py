"""The model of a closed chain: the platform's pose from the lengths of its legs, inside a kernel.

Each leg joins a point a of the base and a point p of the platform at a length l: F = |p(y) - a|² - l² = 0 for as many
unknowns y of the pose as there are legs. Newton's method starts at the pose on the nominal machine, which comes with
the row, and takes a few steps, written out. They double the right digits each, so the last one is exact to rounding;
and the derivative of a step y - J⁻¹F at a solution, where F = 0, is that of the implicit function theorem, -J⁻¹ ∂F.
This is proved in derivation/closed_chain.py. A delta needs no steps: its platform is where three spheres meet
(derivation/delta.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeAlias

from rodgen.machines.kinematics import (
    NEWTON_STEPS,
    Hexapod,
    Kinematics,
    LinearDelta,
    RotaryDelta,
    ThreeSpsS,
    Tricept,
)
from rodgen.machines.model_steps import ModelSteps
from rodgen.machines.structure import Term
from rodgen.symbolic import legs

if TYPE_CHECKING:
    from rodgen.codegen.kernel import Kernel

Vector: TypeAlias = Any
"""A matrix of values."""

STEPS = 3
"""Newton's steps. From 3 % off the nominal pose, more than any machine that is to be calibrated, they leave 1e-12."""
CLOSED = Fraction(1, 10**12)
"""Square of the last step, in rad or radii of the base, above which the legs do not close: after a smaller one what is
left is its square, which is below rounding."""


@dataclass(frozen=True)
class _Pose:
    """A pose of the platform."""

    turn: Vector
    """Rotation matrix."""
    shift: Vector
    """Where the middle of the platform is in base axes, shifted and not turned."""
    joints: list[Vector]
    """Where the platform's joints are."""
    by: list[Vector]
    """Derivative (3, 3) of each of them with respect to the unknowns."""


class _OnLegs:
    """The steps that all families share."""

    def __init__(self, model: ModelSteps) -> None:
        self.m = model
        self.family = model.structure.kinematics
        self.number = {
            name: model.known(name)
            + model.matrix([model.freedom.get((f"geometry.{name}{x}", 0), 0) for x in components])
            for name, components in self.family.numbers.items()
        }
        self.number = {name: model.let("number", value) for name, value in self.number.items()}
        self.start = [model.column["start", i] for i in range(self.family.pose_numbers)]
        self.place_joints(range(len(self.family.legs)))

    def place_joints(self, legs: range) -> None:
        """Write where the joints of the legs are: on the base, and on the platform in its axes."""
        self.base = [self.centre(self.drawn_base, k, "base_joint") for k in legs]
        self.own = [self.centre(self.drawn_platform, k, "platform_joint") for k in legs]

    def centre(self, drawn: Callable[[int], Vector], leg: int, component: str) -> Vector:
        """Return a leg's joint on the base, or on the platform in platform axes."""
        value = drawn(leg)
        for number in self.terms(leg, component):
            value = value + self.m.term(number)
        return self.m.let("centre", value)

    def on_circle(self, radius: str, leg: int) -> Vector:
        cosine, sine = self.m.algebra.circle(list(self.family.legs.values())[leg])
        return self.number[radius][0] * self.m.matrix([cosine, sine, 0])

    def terms(self, leg: int, component: str) -> list[int]:
        terms = self.m.structure.terms
        return [n for n, term in enumerate(terms) if (term.joint, term.component) == (leg, component)]

    # of each family ------------------------------------------------------------------------------------------

    def drawn_base(self, leg: int) -> Vector:
        """Return where the drawing puts a leg's joint on the base."""
        return self.on_circle("R", leg)

    def drawn_platform(self, leg: int) -> Vector:
        """Return where the drawing puts a leg's joint on the platform, in platform axes."""
        return self.on_circle("r", leg)

    def first(self) -> _Pose:
        raise NotImplementedError

    def moved(self, step: Vector) -> _Pose:
        raise NotImplementedError

    def carry(self, pose: _Pose, x: Vector) -> Vector:
        """Return where a target is."""
        raise NotImplementedError

    def carry_by(self, pose: _Pose, x: Vector) -> Vector:
        """Return the derivative (3, unknowns) of where a target is."""
        raise NotImplementedError

    # the legs ------------------------------------------------------------------------------------------------

    def legs(self, pose: _Pose) -> list[Vector]:
        return [self.m.let("leg", p - a) for p, a in zip(pose.joints, self.base, strict=True)]

    def tensions(self, pose: _Pose, x: Vector, gravity: Vector) -> list[Any]:
        """Return the force in each leg, tension positive, under a unit force along gravity at x."""
        spans = self.legs(pose)
        slopes = legs.slopes(self.m, spans, pose.by)
        return legs.tensions(self.m, spans, slopes, self.carry_by(pose, x), gravity)

    def solved(self, x: Vector) -> tuple[_Pose, Any]:
        """Return the pose, and the square of the last step."""
        m, terms = self.m, self.m.structure.terms
        pose = self.first()
        if any(term.uses_tension for term in terms):
            # the pose with rigid legs has the same forces; the start of the row would not do, as the forces depend
            # on the commands
            pose, _ = self.nearer(pose, self.lengths(lambda term: not term.uses_tension))
            m.tension = dict(enumerate(self.tensions(pose, x, m.known("gravity"))))
        half = self.lengths(lambda term: True)
        step = self.m.matrix.zeros(3, 1)
        for _ in range(STEPS):
            pose, step = self.nearer(pose, half)
        return pose, m.let("square", self.size(step))

    def lengths(self, counts: Callable[[Term], bool]) -> list[Any]:
        """Return the halves of the squares of the legs' lengths, with the effects that count."""
        m, found = self.m, []
        for k in range(len(self.base)):
            here = [n for n in self.terms(k, "reading") if counts(m.structure.terms[n])]
            length = m.let("length", sum((m.term(n) for n in here), m.column["q", k]))
            found.append(m.let("half_square", length**2 / 2))
        return found

    def nearer(self, pose: _Pose, half: Sequence[Any]) -> tuple[_Pose, Vector]:
        """Return the pose after one of Newton's steps towards legs with these halves of squares, and the step."""
        spans = self.legs(pose)
        gap = [legs.half_gap(self.m, leg, h) for leg, h in zip(spans, half, strict=True)]
        slopes = legs.slopes(self.m, spans, pose.by)
        step = legs.solution(self.m, slopes, self.m.let("gap", self.m.matrix(gap)))
        step = self.m.let("step", -step)
        return self.moved(step), step

    def numbers(self, pose: _Pose) -> list[Any]:
        """Return a pose as the numbers that a solver starts from."""
        raise NotImplementedError

    def from_afar(self) -> _Pose:
        """Return the pose with legs of the commanded lengths, from where the family starts."""
        half = self.lengths(lambda term: True)
        pose = self.afar(half)
        for _ in range(NEWTON_STEPS):
            pose, _step = self.nearer(pose, half)
        return pose

    def afar(self, half: Sequence[Any]) -> _Pose:
        """Return where the family starts, given the halves of the squares of the legs' lengths."""
        raise NotImplementedError

    def size(self, step: Vector) -> Any:
        return step.dot(step)


class _Tricept(_OnLegs):
    """Unknowns: alpha, beta, z. The platform is turned by P = Oy(beta) Ox(alpha) and slides along its own z."""

    def first(self) -> _Pose:
        self.unknowns = self.m.matrix(self.start)
        return self.pose()

    def afar(self, half: Sequence[Any]) -> _Pose:
        R, r = self.number["R"][0], self.number["r"][0]
        square = self.m.let("height", (sum(half, 0) * 2 / 3) - (R - r) ** 2)
        self.unknowns = self.m.matrix(
            [0, 0, self.m.let("height", self.m.sqrt(self.m.select(square > 0, square, R**2)))]
        )
        return self.pose()

    def numbers(self, pose: _Pose) -> list[Any]:
        return list(self.unknowns)

    def moved(self, step: Vector) -> _Pose:
        self.unknowns = self.m.let("pose", self.unknowns + step)
        return self.pose()

    def pose(self) -> _Pose:
        alpha, beta, z = self.unknowns
        first, self.beta = self.m.turn(alpha), self.m.turn(beta)
        turn = legs.tricept_turn(self.m, first, self.beta)
        shift = self.m.let("shift", turn.col(2) * z)
        joints, by = [], []
        for own in self.own:
            arm = self.m.let("arm", turn * own)
            joints.append(self.m.let("joint", arm + shift))
            by.append(legs.tricept_rates(self.m, turn, self.beta, joints[-1]))
        return _Pose(turn, shift, joints, by)

    def carry(self, pose: _Pose, x: Vector) -> Vector:
        if not self.m.structure.moving:
            return pose.turn * x
        return pose.turn * self.m.let("arm", x + self.number["q"]) + pose.shift

    def carry_by(self, pose: _Pose, x: Vector) -> Vector:
        return legs.tricept_rates(self.m, pose.turn, self.beta, self.m.let("seen", self.carry(pose, x)))

    def size(self, step: Vector) -> Any:
        R = self.number["R"][0]
        return step[0] ** 2 + step[1] ** 2 + (step[2] / R) ** 2


class _ThreeSpsS(_OnLegs):
    """Unknowns: a small turn after the one before, as the Rodrigues vector of half of it (Cayley's map)."""

    def first(self) -> _Pose:
        return self.pose(self.m.matrix(3, 3, self.start))

    def afar(self, half: Sequence[Any]) -> _Pose:
        return self.pose(self.nearest([self.m.column["q", k] for k in range(3)]))

    def nearest(self, lengths: Sequence[Any]) -> Vector:
        """Return the starting rotation whose legs are the nearest, by selects without a branch."""
        least, chosen = None, self.m.matrix.zeros(4, 1)
        for begin in self.m.begins:
            apart = self.m.let(
                "apart", sum(((a - b) ** 2 for a, b in zip(lengths, begin[:3], strict=True)), 0)
            )
            quaternion = self.m.matrix(begin[3:])
            if least is None:
                least, chosen = apart, quaternion
                continue
            here = apart < least
            chosen = self.m.let(
                "chosen",
                self.m.matrix([self.m.select(here, a, b) for a, b in zip(quaternion, chosen, strict=True)]),
            )
            least = self.m.let("least", self.m.select(here, apart, least))
        return legs.matrix_of_quaternion(self.m, chosen[0], chosen[1:])

    def numbers(self, pose: _Pose) -> list[Any]:
        return list(pose.turn)

    def moved(self, step: Vector) -> _Pose:
        return self.pose(legs.turned_by_step(self.m, self.turn, step))

    def pose(self, turn: Vector) -> _Pose:
        self.turn = turn
        shift = self.m.matrix([0, 0, self.number["h"][0]])
        arms = [self.m.let("arm", turn * own) for own in self.own]
        return _Pose(
            turn, shift, [arm + shift for arm in arms], [legs.turn_rates(self.m, arm) for arm in arms]
        )

    def carry(self, pose: _Pose, x: Vector) -> Vector:
        return pose.turn * x + (pose.shift if self.m.structure.moving else self.m.matrix.zeros(3, 1))

    def carry_by(self, pose: _Pose, x: Vector) -> Vector:
        return legs.turn_rates(self.m, self.m.let("seen", pose.turn * x))


class _Hexapod(_OnLegs):
    """Unknowns: a shift, and a small turn after the one before."""

    def drawn_base(self, leg: int) -> Vector:
        return self.number[f"B{leg + 1}"]

    def drawn_platform(self, leg: int) -> Vector:
        return self.number[f"P{leg + 1}"]

    def first(self) -> _Pose:
        return self.pose(self.m.matrix(self.start[:3]), self.m.matrix(3, 3, self.start[3:]))

    def afar(self, half: Sequence[Any]) -> _Pose:
        (begin,) = self.m.begins
        return self.pose(self.m.matrix(begin[len(self.base) :]), self.m.matrix.eye(3))

    def numbers(self, pose: _Pose) -> list[Any]:
        return [*pose.shift, *pose.turn]

    def moved(self, step: Vector) -> _Pose:
        shift = self.m.let("shift", self.at.shift + step[:3, :])
        return self.pose(shift, legs.turned_by_step(self.m, self.at.turn, step[3:, :]))

    def pose(self, shift: Vector, turn: Vector) -> _Pose:
        arms = [self.m.let("arm", turn * own) for own in self.own]
        by = [self.derivative(arm) for arm in arms]
        self.at = _Pose(turn, shift, [self.m.let("joint", arm + shift) for arm in arms], by)
        return self.at

    def derivative(self, arm: Vector) -> Vector:
        """Return the derivative (3, 6) of a point of the platform, at the end of an arm."""
        return self.m.matrix.hstack(self.m.matrix.eye(3), legs.turn_rates(self.m, arm))

    def carry(self, pose: _Pose, x: Vector) -> Vector:
        return pose.turn * x + pose.shift if self.m.structure.moving else pose.turn * x

    def carry_by(self, pose: _Pose, x: Vector) -> Vector:
        return self.derivative(self.m.let("seen", pose.turn * x))

    def size(self, step: Vector) -> Any:
        """Return the square of a step: of its turn, and of its shift over the legs' usual length."""
        squares = [(p - a).dot(p - a) for p, a in zip(self.at.joints, self.base, strict=True)]
        square = self.m.let("square", sum(squares, 0) / len(squares))
        return step[3:, :].dot(step[3:, :]) + step[:3, :].dot(step[:3, :]) / square


class _Delta(_OnLegs):
    """The platform hangs where three spheres about the upper joints of the rods meet."""

    def place_joints(self, legs: range) -> None:
        self.base = [self.upper_joint(k) for k in legs]
        self.own = [self.m.zero] * len(legs)

    def sum_of(self, leg: int, component: str, start: Any) -> Any:
        """Add what effects change a component of a leg by."""
        terms = self.m.structure.terms
        parts = [(n, part) for n in self.terms(leg, component) for part, _ in enumerate(terms[n].parts)]
        return sum((self.m.term(*part) for part in parts), start)

    def upper_joint(self, leg: int) -> Vector:
        m = self.m
        cosine, sine = m.algebra.circle(list(self.family.legs.values())[leg])
        if self.terms(leg, "heading"):
            c, s = m.turn(self.sum_of(leg, "heading", 0))
            cosine, sine = m.let("cosine", cosine * c - sine * s), m.let("sine", sine * c + cosine * s)
        outwards, across = m.matrix([cosine, sine, 0]), m.matrix([-sine, cosine, 0])
        m.directions[leg] = {"U": outwards, "V": across, "N": m.matrix([0, 0, 1])}
        coordinate = m.let("coordinate", self.sum_of(leg, "reading", m.column["q", leg]))
        out, height = self.reach(leg, coordinate)
        drawn = legs.upper_joint(m, (cosine, sine), out, height)
        return m.let("joint", self.sum_of(leg, "base_joint", drawn))

    def reach(self, leg: int, coordinate: Any) -> tuple[Any, Any]:
        """Return how far out, and how high, the upper joint of a rod is drawn."""
        raise NotImplementedError

    def solved(self, x: Vector) -> tuple[_Pose, Any]:
        """Return the pose, and 0 or 1: whether the spheres do not meet."""
        m = self.m
        rods = [self.sum_of(k, "rod", self.number["L"][0]) for k in range(len(self.base))]
        meet = legs.three_spheres(m, self.base, [m.let("square", rod**2) for rod in rods])
        meets = meet.ratio > 0
        below = m.let("below", m.sqrt(m.select(meets, meet.ratio, 1)))
        down = m.let("down", m.select(meet.normal[2] < 0, below, -below))
        place = m.let("platform", meet.foot + meet.normal * down)
        count, unit = len(self.base), m.matrix.eye(3)
        return _Pose(unit, place, [place] * count, [unit] * count), m.select(meets, 0, 1)

    def carry(self, pose: _Pose, x: Vector) -> Vector:
        return x + pose.shift if self.m.structure.moving else x


class _LinearDelta(_Delta):
    def reach(self, leg: int, coordinate: Any) -> tuple[Any, Any]:
        return self.number["R"][0], coordinate


class _RotaryDelta(_Delta):
    def reach(self, leg: int, coordinate: Any) -> tuple[Any, Any]:
        turn = self.m.turn(coordinate)
        return legs.elbow(self.number["R"][0], self.sum_of(leg, "arm", self.number["A"][0]), turn)


STEPS_OF: Mapping[type[Kinematics], type[_OnLegs]] = {
    Tricept: _Tricept,
    ThreeSpsS: _ThreeSpsS,
    Hexapod: _Hexapod,
    LinearDelta: _LinearDelta,
    RotaryDelta: _RotaryDelta,
}
"""How each family is derived."""


def closed_chain(model: ModelSteps, x: Vector, axes: Sequence[Vector] = ()) -> tuple[Vector, list[Vector]]:
    """Carry a target, and directions, by the platform; NaN where the legs do not close.

    Parameters
    ----------
    model : ModelSteps
        Whose kernel it is written into.
    x : Matrix
        The target, in platform axes.
    axes : sequence of Matrix, optional
        The directions.
    """
    chain = STEPS_OF[model.structure.kinematics](model)
    pose, square = chain.solved(x)
    place = model.let("carried", chain.carry(pose, x))
    turned = [_where_closed(model, model.let("carried", pose.turn * axis), square) for axis in axes]
    closed = model.let("closed", _where_closed(model, place, square))
    return closed, [model.let("closed", axis) for axis in turned]


def _where_closed(m: ModelSteps, values: Vector, square: Any) -> Vector:
    return m.matrix([m.select(square < CLOSED, value, m.algebra.nan) for value in values])


def pose_of(model: ModelSteps) -> Any:
    """Return the kernel of the pose of the platform, NaN where the legs do not close.

    Parameters
    ----------
    model : ModelSteps
        With its terms and freedoms.
    """
    chain = STEPS_OF[model.structure.kinematics](model)
    pose, square = chain.solved(model.target())
    found = _where_closed(model, model.matrix(chain.numbers(pose)), square)
    model.builder.output("pose", found, unit="1", doc="numbers that a solver starts from")
    return model.builder.build()


def pose_from_afar(model: ModelSteps, begins: tuple[int, ...] = (0,)) -> Kernel:
    """Return the kernel that finds the pose on the nominal machine without a start.

    It replaces the start that usually comes with each row. For a family with one physical assembly mode it starts in
    the middle of the workspace; for others from the one of some poses whose legs are the nearest.

    Parameters
    ----------
    model : ModelSteps
        Without terms and freedoms.
    begins : tuple of int
        Shape of `OnLegs.begins`, the poses there are to begin with: the kernel has an input ``begin`` of them.
    """
    if begins[0]:
        port = model.builder.input("begin", begins, unit="1", doc="poses to begin with, legs first")
        model.begins = port.tolist()
    chain = STEPS_OF[model.structure.kinematics](model)
    found = chain.numbers(chain.from_afar())
    model.builder.output("start", model.matrix(found), unit="1", doc="pose on the nominal machine")
    kernel: Kernel = model.builder.build()
    return kernel
