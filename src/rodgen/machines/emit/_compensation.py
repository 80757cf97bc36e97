"""How a command is found that brings a machine to a wanted place: the programs that every language repeats.

A pose is coordinates and what there is to know of the place that they lead to: its distance from the wanted one, how
each joint pulls it there, and its derivatives. A language writes one loop,

    begin, look
    propose, look, judge     until the distance is within the tolerance, or the proposal is to end
    report

where ``look`` is the place of a row with its Jacobian, and ``aim``. Apart from the pose that is ``here`` it keeps
the ``best`` one where the steps came to rest, ``damping``, which starts with DAMPING, and ``attempt``, which
starts with 0.

A step is damped least squares with travels. With the scaled Jacobian S = J W (W: how freely each joint moves, 0 at an
end of its travel) it is W y, where y is the damped least-squares solution of S y = e; it is solved in as many unknowns
as the place has freedoms or the machine has joints, whichever are fewer:

    (SᵀS + λ) y = Sᵀe        or        y = Sᵀ (SSᵀ + λ)⁻¹ e.

Where no step comes nearer, the machine goes aside, ATTEMPTS times: out of where joints are in line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

from rodgen.codegen.program import Program
from rodgen.codegen.tape import Tape, absolute, asin, select, sqrt
from rodgen.codegen.tape_matrix import Matrix
from rodgen.machines.algebra import solved
from rodgen.machines.measured import Measurand

TINY = 1e-300
"""Added to what is divided by: where no joint moves the place at all, the step is zero."""
ATTEMPTS = 2
"""Times that a machine goes aside."""
ROUNDING = 2.0**-40

STATUSES = (
    ("CONVERGED", "the place is the wanted one"),
    (
        "NEAREST",
        "no coordinates bring it nearer, on a machine that moves a target on a curve or surface only",
    ),
    ("UNREACHABLE", "no coordinates bring it nearer"),
    ("OUT_OF_TRAVEL", "a joint at an end of its travel would have to go on"),
    ("NOT_CONVERGED", "it could come nearer, but the steps are used up"),
    ("NOT_FINITE", "something given, or the model there, is not finite"),
    ("NO_TARGET", "there is no such target"),
)
_CODES = {name: code for code, (name, _) in enumerate(STATUSES)}

_NUMBERS = [
    ("TOLERANCE", ROUNDING, "of a place: 4096 roundings, relative to the size"),
    ("STILL", 1e-3, "cosine below which a joint does not bring the place nearer"),
    ("GAIN", 1e-6, "part of the squared distance for which no step is taken: the square of STILL"),
    ("DAMPING", 1e-10, "of the first step: Newton's, but for where joints are nearly in line"),
    ("SMALLEST_DAMPING", 1e-13, "below it rounding spoils the step where joints are in line"),
    ("LARGEST_TURN", 1.0, "of a joint in one step, rad"),
    ("LARGEST_ASIDE", 0.1, "of the weight, to go out of where joints are in line"),
    ("IN_LINE", 1e-6, "part of the farthest reach below which a joint moves nothing"),
]


@dataclass(frozen=True)
class Compensation:
    """What the programs of a compensation depend on."""

    measurand: Measurand
    revolute: Sequence[bool]
    """Of each joint whether it turns."""
    lowest: Sequence[float]
    highest: Sequence[float]
    """Ends of the travels, infinite where there are none."""
    size: float
    """Of the numbers that a place is made of, and the arm on which turns count as lengths."""
    is_bound: bool
    """Whether the nominal machine moves a target on a curve or a surface only."""

    @property
    def numbers(self) -> list[tuple[str, float, str]]:
        """The numbers that the programs name, with what they are."""
        read = {args[0] for program in self.programs for op, *args in program.operations if op == "input"}
        numbers = [("SIZE", self.size, "of the numbers that a place is made of"), *_NUMBERS]
        return [number for number in numbers if number[0] in read]

    @property
    def joints(self) -> range:
        """Numbers of the joints."""
        return range(len(self.revolute))

    @property
    def errors(self) -> int:
        """How many numbers the error of a place has."""
        return len(self.measurand.rigid if self.measurand.has_attitude else "xyz")

    @cached_property
    def programs(self) -> list[Program]:
        """The programs, in the order in which they are used."""
        return [self.begin, self.aim, self.propose, self.judge, self.report]

    @property
    def begin(self) -> Program:
        """Bring coordinates into the travel.

        Inputs: ``given``, coordinates, and ``wanted``. Outputs: ``at``, coordinates within the travel; ``aimed``, the
        wanted place, of directions of length 1; ``tolerance`` of the distance.
        """
        k = _Numeric()
        given, wanted = k.input("given", len(self.joints)), k.input("wanted", self.measurand.place_numbers)
        tolerance = k.constant("TOLERANCE")
        if self.measurand.is_direction:
            wanted = wanted / sqrt(wanted.dot(wanted))
        else:
            tolerance = tolerance * (k.constant("SIZE") + sum(absolute(x) for x in wanted.flat[:3]))
        return k.program("begin", at=self._within_travel(given), aimed=wanted, tolerance=tolerance)

    @property
    def aim(self) -> Program:
        """Say how far a place is from the wanted one, and how each joint pulls it there.

        Inputs: ``place``, ``place_jacobian``, its derivative, and ``wanted``. Outputs: ``distance``, of directions the
        angle, of attitudes 2 tan of its half; ``pull`` (joints): Jᵀ error; ``reach`` (joints): how far the place goes
        with each one; ``error`` (3), of a direction in its tangent plane, as long as the chord, (6) of a pose, turns
        times the size.
        """
        measurand, joints, arm = self.measurand, len(self.joints), self.size
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
        return k.program("aim", distance=distance, pull=slopes.T * error, reach=reach, error=error)

    @property
    def propose(self) -> Program:
        """Take a step towards the wanted place, or where none comes nearer go aside from the best pose.

        Inputs: the poses ``here`` and ``best``; ``weight``, how freely each joint moves, of any sign; ``damping`` and
        ``attempt``. Outputs: ``next``, coordinates; ``goes``: 1 for a step, 0 to go aside, -1 to end; ``worth``: the
        part of the squared distance that the step should take away; ``is_best``: whether `here` is the best now.
        """
        k, joints = _Numeric(), self.joints
        here, numbers = k.pose("here", len(joints)), self.measurand.place_numbers
        error, place = k.input("here_error", self.errors), k.input("here_place", numbers)
        slopes = k.input("here_place_jacobian", numbers, len(joints))
        best = k.pose("best", len(joints))
        weight = Matrix([absolute(x) for x in k.input("weight", len(joints))])
        (damping,), (attempt,) = k.input("damping"), k.input("attempt")

        free = k.let("free", self._movable(here, weight))
        step = k.let("step", self._step(k, place, slopes, error, free, damping))
        turn = _largest([absolute(step[j]) for j in joints if self.revolute[j]])
        most = k.constant("LARGEST_TURN")
        if any(self.revolute):
            step = step * k.let("part", most / select(turn > most, turn, most))
        after = k.let("after", self._within_travel(here.q + step))
        worth = k.let("worth", here.pull.dot(after - here.q) / here.distance**2)
        goes = worth > k.constant("GAIN")

        nearer = here.distance < best.distance
        rest = _Pose(*(_either(nearer, a, b) for a, b in zip(here, best, strict=True)))
        free = k.let("rest_free", self._movable(rest, weight))
        reach = k.let("reach", Matrix([a * b for a, b in zip(rest.reach, free, strict=True)]))
        moves = _largest(reach.flat) * k.constant("IN_LINE")
        turns = []
        for j in joints:
            # at most about as far as the wanted place is away, first all one way and then the other
            far = rest.distance / select(reach[j] > moves, rest.reach[j], 1)
            most = k.constant("LARGEST_ASIDE") * free[j]
            turn = select(far < most, far, most) * ((j + 1) / len(joints)) * (1 - 2 * attempt)
            turns.append(select(reach[j] > moves, turn, 0))
        aside = k.let("aside", self._within_travel(rest.q + Matrix(turns)))
        return k.program(
            "propose",
            next=_either(goes, after, aside),
            goes=select(goes, 1, select(attempt < ATTEMPTS, 0, -1)),
            worth=worth,
            is_best=select(goes, 0, select(nearer, 1, 0)),
        )

    @property
    def judge(self) -> Program:
        """Judge the pose after a step by what it gained.

        Inputs: ``goes``, ``worth``, ``distance`` before, ``next_distance`` after, ``damping``, ``attempt``. Outputs:
        ``taken``, whether the pose is the next one; ``next_damping`` and ``next_attempt``.
        """
        k = _Numeric()
        names = ("goes", "worth", "distance", "next_distance", "damping", "attempt")
        goes, worth, before, after, damping, attempt = (k.input(name)[0] for name in names)
        gained = k.let("gained", 1 - (after / before) ** 2)
        less, least = damping / 10, k.constant("SMALLEST_DAMPING")
        more = select(gained > 0.25 * worth, damping, damping * 10)
        of_step = select(gained > 0.75 * worth, select(less > least, less, least), more)
        is_step, ends = goes > 0, goes < 0
        return k.program(
            "judge",
            taken=select(is_step, select(gained > 0, 1, 0), select(ends, 0, 1)),
            next_damping=select(is_step, of_step, k.constant("DAMPING")),
            next_attempt=select(is_step, attempt, attempt + 1),
        )

    @property
    def report(self) -> Program:
        """Say how it ended.

        Inputs: the poses ``here`` and ``best``, ``weight``, ``attempt``, ``tolerance``. Outputs: ``corrected``,
        coordinates; ``left``, the distance; ``status``, a code of :data:`STATUSES`.
        """
        k, joints = _Numeric(), self.joints
        here, best = k.pose("here", len(joints)), k.pose("best", len(joints))
        weight = Matrix([absolute(x) for x in k.input("weight", len(joints))])
        (attempt,), (tolerance,) = k.input("attempt"), k.input("tolerance")
        nearer = here.distance < best.distance
        rest = _Pose(*(_either(nearer, a, b) for a, b in zip(here, best, strict=True)))
        free = self._movable(rest, weight)
        still = k.constant("STILL") * rest.distance
        stopped = 0
        for j in joints:
            if free[j] is not weight[j]:
                pulled = select(absolute(rest.pull[j]) > still * rest.reach[j], 1, 0)
                stopped = stopped + select(free[j] < weight[j], pulled, 0)
        at_rest = _CODES["NEAREST" if self.is_bound else "UNREACHABLE"]
        at_rest = select(stopped > 0, _CODES["OUT_OF_TRAVEL"], at_rest)
        far = select(attempt > 0, at_rest, _CODES["NOT_CONVERGED"])
        status = select(rest.distance > tolerance, far, _CODES["CONVERGED"])
        return k.program("report", corrected=rest.q, left=rest.distance, status=status)

    def _within_travel(self, q: Matrix) -> Matrix:
        """Return coordinates within the travel; NaN stays."""
        within = []
        for x, low, high in zip(q, self.lowest, self.highest, strict=True):
            x = select(x < low, low, x) if math.isfinite(low) else x
            within.append(select(x > high, high, x) if math.isfinite(high) else x)
        return Matrix(within)

    def _movable(self, pose: _Pose, weight: Matrix) -> Matrix:
        """Return the weights, zero for joints at an end of their travel beyond which the wanted place lies."""
        free = []
        for q, pull, w, low, high in zip(pose.q, pose.pull, weight, self.lowest, self.highest, strict=True):
            if math.isfinite(low):
                w = select(q > low, w, select(pull < 0, 0, w))
            if math.isfinite(high):
                w = select(q < high, w, select(pull > 0, 0, w))
            free.append(w)
        return Matrix(free)

    def _step(
        self, k: _Numeric, place: Matrix, slopes: Matrix, error: Matrix, weight: Matrix, damping: Any
    ) -> Matrix:
        """Return a damped step of the joints towards the wanted place, the least one where several do.

        A weight of 0 holds a joint; the damping is relative to the mean square of the scaled Jacobian.
        """
        measurand, joints, arm, errors = self.measurand, len(self.joints), self.size, self.errors
        if measurand.has_attitude:
            slopes = k.let("slopes", _with_turns(place, slopes, arm))
        scaled = Matrix(
            errors, joints, [slopes[i, j] * weight[j] for i in range(errors) for j in range(joints)]
        )
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
        return Matrix([w * x for w, x in zip(weight, y, strict=True)])


class _Pose(NamedTuple):
    """What of a pose a step aside needs."""

    q: Matrix
    distance: Any
    pull: Matrix
    reach: Matrix


class _Numeric:
    """A program whose inputs are arrays of numbers."""

    def __init__(self) -> None:
        self.tape = Tape()
        self.let = self.tape.let
        self.shapes: dict[str, tuple[int, ...]] = {}
        self.constants: dict[str, Any] = {}

    def input(self, name: str, *shape: int) -> Matrix:
        self.shapes[name] = shape
        size = math.prod(shape)
        of = shape if len(shape) == 2 else (size, 1)
        return Matrix(*of, self.tape.inputs(name, size, same=False))

    def constant(self, name: str) -> Any:
        """Return a number that the language names."""
        if name not in self.constants:
            (self.constants[name],) = self.tape.inputs(name, 1)
        return self.constants[name]

    def pose(self, name: str, joints: int) -> _Pose:
        q, (distance,) = self.input(f"{name}_q", joints), self.input(f"{name}_distance")
        return _Pose(q, distance, self.input(f"{name}_pull", joints), self.input(f"{name}_reach", joints))

    def program(self, name: str, **outputs: Any) -> Program:
        """Return what computes outputs, vectors or numbers."""
        ports = {
            port: ((len(x),), list(x)) if isinstance(x, Matrix) else ((), [x]) for port, x in outputs.items()
        }
        program = self.tape.program(name, self.shapes | dict.fromkeys(self.constants, ()), ports)
        read = {args[0] for op, *args in program.operations if op == "input"}
        inputs = {
            port: shape for port, shape in program.inputs.items() if port in read or port in self.shapes
        }
        return replace(program, inputs=inputs)


def _either(condition: Any, yes: Any, no: Any) -> Any:
    """Select one of two numbers or vectors."""
    if isinstance(yes, Matrix):
        return Matrix([select(condition, a, b) for a, b in zip(yes, no, strict=True)])
    return select(condition, yes, no)


def _largest(values: Sequence[Any]) -> Any:
    """Return the largest of some numbers, 0 of none."""
    largest = values[0] if values else 0
    for x in values[1:]:
        largest = select(x > largest, x, largest)
    return largest


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
