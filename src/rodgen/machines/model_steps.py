"""The steps of a machine's model: from its structure, link by link, as SymPy or on a tape.

A target p is carried from the last joint to the first,

    x <- D_j J_j x,   J_j x = P + R(n, q')(x - P)  or  x + n q',   D_j x = P + R(w)(x - P) + t,

then by the moves of the frame, and compared with the reading. Of a machine of two branches that is as far as its bed;
the joints that carry the instrument are passed backwards, x <- J_j⁻¹ D_j⁻¹ x. Each link is a named step of a
straight-line program, so nothing swells, and the Jacobian is one sweep backwards through it. The geometry's freedoms
(the tilt of an axis, the offset of a point) are inputs whose value is zero: they have been added to the geometry
before, and only the derivative with respect to them is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

from rodgen.errors import RodgenError
from rodgen.machines.algebra import Algebra
from rodgen.machines.effects.formula import Formula
from rodgen.machines.measured import TURNS
from rodgen.machines.structure import CLOSED, MOMENTS, TENSION, Structure, Term
from rodgen.symbolic import rigid_motions as motions

if TYPE_CHECKING:
    from rodgen.machines.coupling import Coupling

Vector: TypeAlias = Any
"""A column of values."""


def cached(function: Any) -> Any:
    """Keep what a method returned, for each argument, in the object: a step is written once."""

    def kept(self: ModelSteps, *arguments: int) -> Any:
        key = (function.__name__, *arguments)
        if key not in self.done:
            self.done[key] = function(self, *arguments)
        return self.done[key]

    return kept


class ModelSteps:
    """The steps of one kernel of a machine's model.

    Parameters
    ----------
    name : str
        Of the kernel.
    algebra : Algebra
        What it is written with.
    with_residual : bool
        Whether it ends in the weighted residual; else in the place.
    """

    def __init__(
        self, structure: Structure, name: str, algebra: Algebra, *, with_residual: bool = True
    ) -> None:
        self.structure = structure
        self.with_residual = with_residual
        self.algebra = algebra
        self.matrix, self.select = self.algebra.matrix, self.algebra.select
        self.sin, self.cos, self.sqrt = (self.algebra.functions[name] for name in ("sin", "cos", "sqrt"))
        self.builder = self.algebra.builder(name)
        self.count = 0
        self.done: dict[tuple[Any, ...], Any] = {}
        self.tension: dict[int, Any] = {}
        self.directions: dict[int, dict[str, Any]] = {}
        self.begins: list[list[Any]] = []
        self.held: frozenset[Any] = (
            frozenset()
        )  # a pose of legs, on which the next one does not depend to first order
        self.further_steps = 0  # of Newton's, to the pose in which the legs have their forces
        self.zero = self.matrix.zeros(3, 1)
        self.inputs()

    def inputs(self) -> None:
        """Declare the inputs of the kernel, and keep which symbol is what."""
        s, k = self.structure, self.builder
        rows = k.input("rows", (len(s.columns),), unit="1", doc="what differs from row to row")
        lengths = [length for _, _, length in s.geometry]
        g = list(k.input("g", (sum(lengths),), unit="1", doc="geometry"))
        self.column = dict(zip(s.columns, rows, strict=True))
        self.g: dict[tuple[str, int], list[Any]] = {}
        for name, number, length in s.geometry:
            self.g[name, number], g = g[:length], g[length:]
        freedoms = (
            k.input("freedom", (len(s.slots),), unit="1", doc="change of a freedom, zero") if s.slots else []
        )
        self.freedom = dict(zip(s.slots, freedoms, strict=True))
        e = list(k.input("e", (max(1, len(s.parameters)),), unit="1", doc="parameters of the effects"))
        self.e = dict(zip(s.parameters, e, strict=False))  # one is left over where there is none
        n = 0 if s.kinematics.is_closed else len(s.joints)
        self.axis = [self.varied("axis", j) for j in range(n)]
        has_points = s.moving or s.weights
        self.joint_point = [self.moved_point(j) if has_points else self.zero for j in range(n)]
        self.point = self.joint_point if s.moving else [self.zero] * n  # a direction turns, and nothing else
        revolute = [j for j in range(n) if s.joints[j].revolute]
        self.ideal_turn = {j: self.turn(self.coordinate(j)) for j in revolute}

    # small things --------------------------------------------------------------------------------------------

    def let(self, name: str, value: Any) -> Any:
        """Name a step, unless it is a symbol or number already."""
        parts = value if hasattr(value, "shape") else [value]
        if all(getattr(x, "is_Atom", isinstance(x, int | float | Fraction)) for x in parts):
            return value
        self.count += 1
        return self.builder.let(f"{name}{self.count}", value)

    def known(self, name: str, number: int = 0) -> Vector:
        """Return a vector of the geometry."""
        return self.matrix(self.g[name, number])

    def varied(self, name: str, number: int) -> Vector:
        """Return a unit vector of the geometry that has two freedoms, where they are slots."""
        value = self.known(name, number)
        for x in "ab":
            if (f"{name}.{x}", number) in self.freedom:
                value = value + self.freedom[f"{name}.{x}", number] * self.known(f"{name}_by_{x}", number)
        return self.let(name, value)

    def moved_point(self, j: int) -> Vector:
        """Return the point of a joint, moved by its two freedoms where they are slots."""
        value = self.known("point", j)
        if self.structure.joints[j].point:
            u, v = self.known("u", j), self.known("v", j)
            value = value + self.freedom["point.a", j] * u + self.freedom["point.b", j] * v
        return self.let("point", value)

    def freedoms(self, name: str, components: Sequence[str]) -> Vector:
        """Return the freedoms of a part of the geometry, zero where they are no slots."""
        return self.matrix([self.freedom.get((f"{name}.{x}", 0), 0) for x in components])

    def turn(self, angle: Any) -> tuple[Any, Any]:
        """Return cosine and sine of an angle as steps."""
        return self.let("cosine", self.cos(angle)), self.let("sine", self.sin(angle))

    @staticmethod
    def dot(x: Vector, y: Vector) -> Any:
        """Return a scalar product."""
        return x.dot(y)

    @staticmethod
    def cross(x: Vector, y: Vector) -> Vector:
        """Return a vector product."""
        return x.cross(y)

    # coordinates of joints, by their readings -----------------------------------------------------------------

    def coupling(self, j: int) -> Coupling | None:
        """Return how the coordinate of a joint follows from readings, None where it is the joint's own."""
        return self.structure.couplings[j] if self.structure.couplings else None

    def has_reading(self, j: int) -> bool:
        """Return whether a joint has a reading, on which its effects act; else they act on its coordinate."""
        coupling = self.coupling(j)
        return coupling is None or j in dict(coupling.factors)

    @cached
    def coordinate(self, j: int) -> Any:
        """Return the coordinate of a joint, without errors."""
        coupling, number = self.coupling(j), self.algebra.number
        if coupling is None:
            return self.column["q", j]
        constant = number(coupling.constant)
        return self.let(
            "coordinate", sum((number(x) * self.column["q", i] for i, x in coupling.factors), constant)
        )

    def followers(self, i: int) -> dict[int, Any]:
        """Return the joints that follow what acts at a joint, each with the factor: itself, or all with its reading."""
        if not self.structure.couplings or not self.has_reading(i):
            return {i: 1}
        followers = {}
        for j, coupling in enumerate(self.structure.couplings):
            factor = Fraction(i == j) if coupling is None else dict(coupling.factors).get(i)
            if factor:
                followers[j] = 1 if factor == 1 else self.algebra.number(factor)
        return followers

    @cached
    def reading_errors(self, i: int) -> list[Any]:
        """Return what the effects at a joint change its reading by, or its coordinate where it has none."""
        return [
            self.term(n, part)
            for n, term in enumerate(self.structure.terms)
            if term.joint == i
            for part, (component, _) in enumerate(term.parts)
            if component == "reading"
        ]

    def coordinate_errors(self, j: int) -> list[Any]:
        """Return what the coordinate of a joint is off by: the errors of all readings that it follows."""
        coupling = self.coupling(j)
        if coupling is None:
            return list(self.reading_errors(j))
        errors = [] if self.has_reading(j) else [*self.reading_errors(j)]
        for i, factor in coupling.factors:
            errors += [self.algebra.number(factor) * error for error in self.reading_errors(i)]
        return errors

    # the ideal pose ------------------------------------------------------------------------------------------

    @cached
    def gravity(self, j: int) -> Vector:
        """Return the direction of gravity as joint j sees it at zero."""
        if not self.structure.carriers(j):
            return self.known("gravity")
        before = self.structure.carriers(j)[-1]
        g = self.gravity(before)
        if self.structure.joints[before].revolute:
            turn = motions.back(self.ideal_turn[before])
            g = self.let("gravity", motions.turned(self, g, self.axis[before], turn))
        return g

    @cached
    def centre(self) -> Vector:
        """Return the mean of the targets."""
        return self.let("centre", self.known("centre") + self.freedoms("centre", "xyz"))

    @cached
    def ideally_carried(self, j: int) -> Vector:
        """Return the mean of the targets, carried by the ideal joints from the last one to joint j."""
        later = self.structure.beyond(j)
        x = self.ideally_carried(later[0]) if later else self.centre()
        n, point = self.axis[j], self.point[j]
        if self.structure.joints[j].revolute:
            return self.let("carried", motions.turned_about(self, x, n, point, self.ideal_turn[j]))
        return self.let("carried", motions.slid(x, n, self.coordinate(j))) if self.structure.moving else x

    @cached
    def arm(self, j: int) -> Vector:
        """Return the arm from joint j's point to the mean of the targets, in the ideal pose."""
        return self.let("arm", self.ideally_carried(j) - self.point[j])

    def moments(self, j: int, names: frozenset[str]) -> dict[str, Any]:
        """Return those of the catalogue's moments that are asked for."""
        if not names & MOMENTS:
            return {}
        n, arm = self.axis[j], self.arm(j)
        moments: dict[str, Any] = {}
        if names & {"M", "M_across"}:
            moments["M"] = motions.moment_about(self, self.rate(j), arm)
        if "M_across" in names:
            moments["M_across"] = motions.across(motions.moment(self, arm, self.gravity(j)), n, moments["M"])
        if "M_perp" in names:
            moments["M_perp"] = motions.moment_turned(self, n, self.rate(j), arm)
        if "M_guide" in names:
            guide = n * self.coordinate(j) if self.structure.moving else self.zero
            guided = motions.moment(self, arm - guide, self.gravity(j))
            moments["M_guide"] = motions.across(guided, n, n.dot(guided))
        return moments

    def moments_at(self, i: int, names: frozenset[str], component: str) -> dict[str, Any]:
        """Return the moments that bend a joint, or, where its reading is changed, those that its drive bears."""
        factors = self.followers(i) if component == "reading" else {i: 1}
        if factors == {i: 1} or not names & MOMENTS:
            return self.moments(i, names)
        moments_there: dict[str, Any] = {}
        for j, factor in factors.items():
            turns = self.structure.joints[j].revolute
            moments = (
                self.moments(j, names) if turns else dict.fromkeys(names & {"M", "M_perp"}, self.force(j))
            )
            for name, moment in moments.items():
                moments_there[name] = factor * moment + moments_there.get(name, 0)
        return moments_there

    def force(self, j: int) -> Any:
        """Return the part of a unit force along gravity that a prismatic joint's drive bears."""
        return self.let("force", self.gravity(j).dot(self.axis[j]) if self.structure.moving else 0)

    def weights_on_drive(self, i: int) -> list[Any]:
        """Return the moments of unit weights that the drive of a joint bears, in the order of `Term.weights`."""
        factors, beyond = self.followers(i), list(self.structure.beyond(i))
        factor_of = factors.pop(i)
        on_drive = [moment if factor_of == 1 else factor_of * moment for moment in self.moments_of_weights(i)]
        for j, factor in factors.items():
            turns, later = self.structure.joints[j].revolute, self.structure.beyond(j)
            moments = self.moments_of_weights(j) if turns else [self.force(j)] * len(later)
            for k, moment in zip(later, moments, strict=False):
                if k in beyond:
                    on_drive[beyond.index(k)] = on_drive[beyond.index(k)] + factor * moment
        return on_drive

    def bends(self, j: int, names: frozenset[str]) -> dict[str, Any]:
        """Return what gravity bends: a shaft along the axis, a fork that stands on the axis before."""
        bends: dict[str, Any] = {}
        if "bend" in names:
            bends["bend"] = motions.shaft_bend(self, self.axis[j], self.gravity(j))
        if "fork" in names:
            before = self.axis[self.structure.carriers(j)[-1]]
            bends["fork"] = motions.fork_bend(self, self.axis[j], before, self.gravity(j))
        return bends

    @cached
    def rate(self, j: int) -> Vector:
        """Return by how much the moment about joint j's axis grows with the place of a unit force along gravity."""
        return motions.moment_rate(self, self.axis[j], self.gravity(j))

    @cached
    def moments_of_weights(self, j: int) -> list[Any]:
        """Return the moments about joint j's axis of unit forces along gravity, in the order of `Term.weights`."""
        points = self.joint_point
        links = [
            motions.Link(self.axis[k], self.ideal_turn.get(k), self.coordinate(k), points[k], points[after])
            for k, after in pairwise([j, *self.structure.beyond(j)])
        ]
        return motions.moments_of_weights(self, self.axis[j], self.rate(j), links)

    # effects -------------------------------------------------------------------------------------------------

    def value(
        self, number: int, formula: str, component: str = "", leg: int | None = None, **more: Any
    ) -> Any:
        """Evaluate an effect's formula, of one that changes all legs at one of them: a number, or a vector."""
        component = component or self.structure.terms[number].component
        value = Formula.parse(formula, file="effect", place=component).evaluate(
            self.names(number, component, leg) | more, self.algebra.functions, self.algebra.number
        )
        if not all(map(self.algebra.is_real, value if hasattr(value, "shape") else [value])):
            raise RodgenError(f"the formula {formula!r} of an effect is not a real number anywhere")
        return value

    def names(self, number: int, component: str, leg: int | None = None) -> dict[str, Any]:
        """Return what each name in the formula of an effect for a component stands for."""
        term = self.structure.terms[number]
        names: dict[str, Any] = {"pi": self.algebra.pi}
        if not term.own:
            names |= self.vocabulary(term, component, leg)
        elif term.sky:
            names |= self.sky()
        names |= {name: self.quantity(name, column, component) for name, column in term.columns}
        names |= {name: self.e[number, name] for name in term.parameters}
        return names

    def quantity(self, name: str, column: tuple[str, int | str], component: str) -> Any:
        """Return what stands for a column of a formula: the q of a joint's motion is its coordinate."""
        kind, j = column
        if kind == "q" and self.structure.couplings:
            by_reading = self.has_reading(int(j)) and (name != "q" or component == "reading")
            kind = "q" if by_reading else "c"
        return self.coordinate(int(j)) if kind == "c" else self.column[kind, j]

    @cached
    def sky(self) -> dict[str, Any]:
        """Return zenith angle and azimuth of the line of sight, by the commands and the machine as it is given.

        No parameter changes them: what it would is smaller by the size of an error, and the azimuth has no derivative
        at the zenith.
        """
        x = self.known("target")
        for j in sorted(self.ideal_turn.keys() - set(range(self.structure.inner)), reverse=True):
            x = self.let("pointed", motions.turned(self, x, self.known("axis", j), self.ideal_turn[j]))
        up = -self.known("gravity")
        first, second = (self.let("level", self.known(name).dot(x)) for name in ("level_u", "level_v"))
        sine = self.let("sine", motions.length(self, up.cross(x)))
        return {
            "z": self.let("zenith_angle", self.algebra.atan2(sine, up.dot(x))),
            "azimuth": self.let("azimuth", self.algebra.atan2(first, second)),
        }

    def vocabulary(self, term: Term, component: str, leg: int | None = None) -> dict[str, Any]:
        """Return the names that only formulas of the catalogue may use, for a component."""
        unit = self.matrix.eye(3)
        names: dict[str, Any] = {f"E{x}": unit[:, i] for i, x in enumerate("XYZ")}
        j = leg if term.joint is None else term.joint
        if j is None:
            return names
        if self.structure.kinematics.is_closed:
            tension = {TENSION: self.tension[j]} if term.uses_tension else {}
            return names | self.directions.get(j, {}) | tension
        names["N"] = self.axis[j]
        if term.uses_directions:
            names |= {"U": self.known("u", j), "V": self.known("v", j)}
        if term.uses_travel:
            length = self.g["length", j][0]
            zeta = self.let("zeta", (self.coordinate(j) - self.g["start", j][0]) / length)
            names |= {"L": length, "zeta": zeta}
            names |= {
                f"P{k}": self.let("legendre", legendre(2 * zeta - 1))
                for k, legendre in motions.LEGENDRE.items()
            }
        return names | self.moments_at(j, term.names, component) | self.bends(j, term.names)

    def term(self, number: int, part: int = 0, leg: int | None = None) -> Any:
        """Return what an effect changes its component by, or another of its components, named."""
        term = self.structure.terms[number]
        value = self.value(number, term.parts[part][1], term.parts[part][0], leg)
        j = term.joint
        if j is not None and term.weights:
            for name, moment in zip(term.weights, self.weights_on_drive(j), strict=True):
                value = value + self.e[number, name] * moment
        if term.target:
            value = value * self.g["acts", number][0]
        return self.let("effect", value)

    def terms_of(self, joint: int, component: str) -> list[int]:
        """Return the numbers of the effects at a leg of a closed chain, or at all, that change a component."""
        terms = self.structure.terms
        return [n for n, x in enumerate(terms) if x.joint in {joint, None} and x.component == component]

    def changed(self, joint: int, component: str, value: Any) -> Any:
        """Add to a value what the effects at a joint change this component by."""
        return sum((self.term(n, leg=joint) for n in self.terms_of(joint, component)), value)

    def rigid(self, numbers: Sequence[int], pivot: Vector, j: int | None) -> tuple[Vector, Vector] | None:
        """Add up the translations and the rotation vectors of several effects; None where there is none."""
        t, w = self.zero, self.zero
        unit = self.matrix.eye(3)
        for number in numbers:
            term = self.structure.terms[number]
            if term.component == "sag":
                assert j is not None
                offset, turn = self.sag(number, pivot, j)
                t, w = t + offset, w + turn
                continue
            for part, (component, _) in enumerate(term.parts):
                if component == "reading":
                    continue
                value = self.term(number, part)
                if component == "frame":
                    if self.structure.moving:
                        t = t + value
                    else:
                        w = w + value
                elif component == "translation":
                    t = t + value
                elif component == "rotation":
                    w = w + value
                elif component in {"tx", "ty", "tz"}:
                    t = t + unit[:, "xyz".index(component[1])] * value
                elif component in {"rx", "ry", "rz"}:
                    w = w + unit[:, "xyz".index(component[1])] * value
        return (t, w) if numbers else None

    def sag(self, number: int, pivot: Vector, j: int) -> tuple[Vector, Vector]:
        """Return translation and rotation vector of a beam whose load drops along gravity and turns by the slope."""
        term = self.structure.terms[number]
        drop = self.let("drop", self.value(number, term.formula))
        slope = self.let("slope", self.value(number, term.slope))
        n, gravity = self.axis[j], self.gravity(j)
        w = motions.sag_turn(self, n, gravity, slope)
        if not self.structure.moving:
            return self.zero, w
        arm = self.let("arm", motions.slid(self.centre(), n, self.coordinate(j)) - pivot)
        return motions.sag_shift(self, arm, gravity, drop, w), w

    # the way of the target -----------------------------------------------------------------------------------

    def target(self) -> Vector:
        """Return the target with all joints at zero, moved by the effects at it."""
        s = self.structure
        free = self.known("target") + self.freedoms("target", "xyz") if s.moving else self.varied("target", 0)
        value = self.let("target", free)
        here = [n for n, term in enumerate(s.terms) if term.target]
        return self.displaced(value, here, self.zero, None, moves=s.moving)

    def axes(self) -> list[Vector]:
        """Return the axes of the target with all joints at zero, turned by its freedoms."""
        if not self.structure.measurand.has_attitude:
            return [self.matrix.eye(3)[:, i] for i in range(3)]
        turned = self.matrix(3, 3, self.g["target_rotation", 0])
        if not self.structure.target:
            return [turned[:, i] for i in range(3)]
        turn = self.matrix(3, 3, self.g["target_turns", 0]) * self.freedoms("target", TURNS)
        if self.structure.remounting:
            turns = self.matrix(3, 3, self.g["remounting_turns", 0])
            turn = turn + turns * self.freedoms("remounting", TURNS)
        turn = self.let("turn", turn)
        return [self.let("axis", motions.turned_a_little(self, turned[:, i], turn)) for i in range(3)]

    def displaced(
        self,
        x: Vector,
        numbers: Sequence[int],
        pivot: Vector,
        j: int | None,
        *,
        moves: bool,
        backwards: bool = False,
    ) -> Vector:
        """Move x by the sum of some effects: D x = P + R(w)(x - P) + t, or D⁻¹ x; a direction is only turned."""
        motion = self.rigid(numbers, pivot, j)
        if motion is None:
            return x
        t, w = motion
        if not moves:
            w = -w if backwards else w
            return x if w == self.zero else self.let("moved", motions.turned_by_vector(self, x, w))
        if w == self.zero:
            return self.let("moved", x - t if backwards else x + t)
        move = motions.moved_back if backwards else motions.moved
        return self.let("moved", move(self, x, pivot, t, w))

    def carried(self, x: Vector, joints: range, *, moves: bool) -> Vector:
        """Carry a point, or a direction, by some joints with their errors, the last one first."""
        s = self.structure
        for j in reversed(joints):
            backwards = j < s.inner
            here = [n for n, term in enumerate(s.terms) if term.joint == j]
            q, off = self.coordinate(j), self.coordinate_errors(j)
            if off:
                q = self.let("reading", sum(off, q))
            errors = [n for n in here if any(component != "reading" for component, _ in s.terms[n].parts)]
            displaced = partial(
                self.displaced, numbers=errors, pivot=self.point[j], j=j, moves=moves, backwards=backwards
            )
            x = displaced(x) if backwards else x
            if s.joints[j].revolute:
                turn = self.turn(q) if off else self.ideal_turn[j]
                turn = motions.back(turn) if backwards else turn
                point = self.point[j] if moves else self.zero
                x = self.let("carried", motions.turned_about(self, x, self.axis[j], point, turn))
            elif moves:
                x = self.let("carried", motions.slid(x, self.axis[j], -q if backwards else q))
            x = x if backwards else displaced(x)
        return x

    def lifted(self, x: Vector) -> Vector:
        """Lift a direction towards the zenith by the sum of all lifts; the form has no singularity at the zenith."""
        numbers = [n for n, term in enumerate(self.structure.terms) if term.component == "lift"]
        if not numbers:
            return x
        up = -self.known("gravity")
        c = self.let("cos_zenith", up.dot(x))
        # angle f sin z, with f = a / cos z
        words = {"tan_zenith": 1 / motions.air_depth(self, c), "sin_zenith": 1}
        f = self.let("lift", sum(self.value(n, self.structure.terms[n].formula, **words) for n in numbers))
        return motions.lifted(self, x, up, c, f)

    def framed(self, x: Vector, *, moves: bool) -> Vector:
        """Move by the frame's own motions: those that differ from row to row, the shift, the free frame."""
        s = self.structure
        elsewhere = {"lift", "factor", "axes", "plate", "reading", *CLOSED}  # the last are of all legs
        whole = [
            n
            for n, term in enumerate(s.terms)
            if term.joint is None and not term.target and term.component not in elsewhere
        ]
        x = self.displaced(x, whole, self.zero, None, moves=moves)
        if s.shift:
            turned = self.matrix(3, 3, self.g["shift_rotation", 0]) * x
            turns = self.matrix(3, 3, self.g["shift_turns", 0])
            x = self.let("turned", turned)
            x = motions.turned_a_little(self, x, turns * self.freedoms("shift", TURNS))
            if moves:
                x = x + self.known("shift") + self.freedoms("shift", "xyz")
            x = self.let("shifted", x)
        if s.frame:
            x = self.let("inner", motions.turned_a_little(self, x, self.freedoms("frame", TURNS)))
            x = self.matrix(3, 3, self.g["frame_rotation", 0]) * x
            if moves:
                x = x + self.known("frame") + self.freedoms("frame", "xyz")
            x = self.let("seen", x)
        return x

    def factor(self) -> Any:
        """Return what the instrument multiplies its readings by."""
        terms = enumerate(self.structure.terms)
        return self.let(
            "factor", math.prod(1 + self.term(n) for n, term in terms if term.component == "factor")
        )

    def scaled(self, x: Vector) -> Vector:
        """Add to a reading what the errors of the instrument's axes do."""
        return self.let("scaled", self.changes_by_place("axes", x, x))

    def changes_by_place(self, component: str, x: Vector, value: Any) -> Any:
        """Add to a value what the effects on a component do at a place."""
        words = {f"read_{name}": x[i] for i, name in enumerate("xyz")}
        changes = (
            self.value(n, t.formula, **words)
            for n, t in enumerate(self.structure.terms)
            if t.component == component
        )
        return sum(changes, value)
