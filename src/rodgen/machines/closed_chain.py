"""The model of a closed chain: the platform's pose from the lengths of its legs, inside a kernel.

Each leg joins a point a of the base and a point p of the platform at a length l: F = |p(y) - a|² - l² = 0 for as many
unknowns y of the pose as there are legs. Newton's method starts at the pose on the nominal machine, which comes with
the row, and takes a few steps, written out. They double the right digits each, so the last one is exact to rounding;
and the derivative of a step y - J⁻¹F at a solution, where F = 0, is that of the implicit function theorem, -J⁻¹ ∂F.
This is proved in derivation/closed_chain.py. A delta needs no steps: its platform is where three spheres meet
(derivation/delta.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeAlias

from rodgen.machines.families.on_legs import OnLegs, Pose
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


class ClosedChain:
    """A closed chain in a kernel: its geometry, and Newton's steps to its pose.

    Parameters
    ----------
    model : ModelSteps
        Whose kernel it is written into.

    Attributes
    ----------
    family : OnLegs
        With the numbers of the kernel.
    base, arms : list of Matrix
        The joints of the legs: on the base, and on the platform in its axes.
    """

    def __init__(self, model: ModelSteps) -> None:
        self.m = model
        family: Any = model.structure.kinematics
        numbers = {
            name: model.known(name)
            + model.matrix([model.freedom.get((f"geometry.{name}{x}", 0), 0) for x in components])
            for name, components in family.numbers.items()
        }
        numbers = {name: model.let("number", value) for name, value in numbers.items()}
        self.family: OnLegs = family(**{n: x if len(x) > 1 else x[0] for n, x in numbers.items()})
        every = range(len(family.legs))
        self.base = [self.joint(self.family.base_joint, k, "base_joint") for k in every]
        self.arms = [self.joint(self.family.platform_joint, k, "platform_joint") for k in every]

    def joint(self, drawn: Callable[[ModelSteps, int], Vector], leg: int, component: str) -> Vector:
        """Return a leg's joint, as it is drawn and moved by effects."""
        return self.m.let("centre", self.m.changed(leg, component, drawn(self.m, leg)))

    def at(self, state: Any) -> Pose:
        """Return the pose of a state."""
        return self.family.pose(self.m, self.arms, state)

    def start(self) -> Pose:
        """Return the pose that comes with the row."""
        start = [self.m.column["start", i] for i in range(self.family.pose_numbers)]
        return self.at(self.family.state(self.m, start))

    def spans(self, pose: Pose) -> list[Vector]:
        """Return the legs, from base to platform."""
        return [self.m.let("leg", p - a) for p, a in zip(pose.joints, self.base, strict=True)]

    def tensions(self, pose: Pose, x: Vector, gravity: Vector) -> list[Any]:
        """Return the force in each leg, tension positive, under a unit force along gravity at x."""
        spans = self.spans(pose)
        slopes = legs.slopes(self.m, spans, pose.by)
        return legs.tensions(self.m, spans, slopes, self.family.carried_by(self.m, pose, x), gravity)

    def solved(self, x: Vector) -> tuple[Pose, Any]:
        """Return the pose by steps from the start of the row, and the square of the last step."""
        m, terms = self.m, self.m.structure.terms
        if (closed := self.family.closed_form(m, self.base)) is not None:
            return closed
        pose, held = self.start(), frozenset[Any]()
        if any(term.uses_tension for term in terms):
            # the pose with rigid legs has the same forces; the start of the row would not do, as the forces depend
            # on the commands
            rigid = self.lengths(lambda term: not term.uses_tension)
            pose, _ = self.nearer(pose, rigid)
            for _ in range(m.further_steps):
                held |= frozenset(self.family.numbers_of(pose.state))
                pose, _ = self.nearer(pose, rigid)
            m.tension = dict(enumerate(self.tensions(pose, x, m.known("gravity"))))
        half = self.lengths(lambda term: True)
        step = m.matrix.zeros(3, 1)
        for _ in range(STEPS):
            m.held = held | frozenset(self.family.numbers_of(pose.state))
            pose, step = self.nearer(pose, half)
        return pose, m.let("square", self.family.step_size(m, step, self.spans(pose)))

    def lengths(self, counts: Callable[[Term], bool]) -> list[Any]:
        """Return the halves of the squares of the legs' lengths, with the effects that count."""
        m, lengths = self.m, []
        for k in range(len(self.base)):
            here = [n for n in m.terms_of(k, "reading") if counts(m.structure.terms[n])]
            length = m.let("length", sum((m.term(n) for n in here), m.column["q", k]))
            lengths.append(m.let("half_square", length**2 / 2))
        return lengths

    def nearer(self, pose: Pose, half: Sequence[Any]) -> tuple[Pose, Vector]:
        """Return the pose after one of Newton's steps towards legs with these halves of squares, and the step."""
        spans = self.spans(pose)
        gap = [legs.half_gap(self.m, leg, h) for leg, h in zip(spans, half, strict=True)]
        slopes = legs.slopes(self.m, spans, pose.by)
        step = legs.solution(self.m, slopes, self.m.let("gap", self.m.matrix(gap)))
        step = self.m.let("step", -step)
        return self.at(self.family.moved(self.m, pose.state, step)), step


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
    chain = ClosedChain(model)
    pose, square = chain.solved(x)
    place = model.let("carried", chain.family.carried(model, pose, x))
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
    chain = ClosedChain(model)
    pose, square = chain.solved(model.target())
    closing = _where_closed(model, model.matrix(chain.family.numbers_of(pose.state)), square)
    model.builder.output("pose", closing, unit="1", doc="numbers that a solver starts from")
    return model.builder.build()


def pose_from_afar(model: ModelSteps, begins: tuple[int, ...] = (0,)) -> Kernel:
    """Return the kernel with which the pose on the nominal machine is found without a start.

    It replaces the start that usually comes with each row. ``begin`` is the pose to begin with: for a family with one
    physical assembly mode in the middle of the workspace; for others the one of some poses whose legs are the nearest.
    ``nearer`` is the pose after one of Newton's steps from the start of the row; `NEWTON_STEPS` of them find it.

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
    chain = ClosedChain(model)
    half = chain.lengths(lambda term: True)
    begin = chain.family.numbers_of(chain.family.begin(model, half))
    model.builder.output("begin", model.matrix(begin), unit="1", doc="pose to begin with")
    pose, _step = chain.nearer(chain.start(), half)
    nearer = chain.family.numbers_of(pose.state)
    model.builder.output("nearer", model.matrix(nearer), unit="1", doc="pose after a step")
    kernel: Kernel = model.builder.build()
    return kernel
