"""Bounds of rounding errors that hold for every input of a box, by ball arithmetic.

A program runs on `Number`s. Each holds a ball: all values that it takes for the inputs of the box, whatever the
rounding errors. An operation in floating point gives (a ∘ b)(1 + δ) with |δ| ≤ u = 2⁻⁵³ (a fused product and sum
is the case where one δ is 0; underflow is left out). By the mean value theorem the computed result is off from
that of exact arithmetic by at most

    u Σ sup |∂result/∂zₖ| |zₖ|

over all roundings k, where the derivatives, by reverse accumulation, are balls, too, taken at all inputs *and*
all roundings. So the bound holds; no term of second order is dropped. FPTaylor (Solovyev et al., 2015) bounds
first and second order apart.

Where inputs depend on each other, as the elements of a rotation matrix do, they are functions of a few parameters, of
which the box is. A number then has a second ball, by the mean value theorem again: that of its value at the middle of
the box, and its slopes over the box times half the sides. 1 + m₁₁ + m₂₂ + m₃₃ is four times the square of w there, and
not the sum of four intervals.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from flint import arb, ctx

ctx.prec = 80  # bits of the balls' centres: far beyond those of the numbers whose rounding they enclose

U = 2.0**-53
EPS = 2.0**-52
FUNCTION_ULPS = 1
"""What is assumed of sine, cosine and arc tangent: at most so many units in the last place off."""
ROOM = 1 + 1e-9
"""For the rounding of the sums of bounds themselves."""


class UndecidedError(ArithmeticError):
    """The box is too large: a divisor or a root's argument may be zero in it."""


def ball(low: float, high: float) -> arb:
    """Return the smallest ball that holds an interval."""
    middle = (arb(low) + arb(high)) / 2
    return middle + arb(0, float(max(arb(high) - middle, middle - arb(low)).abs_upper()) * ROOM)


def upper(x: arb) -> float:
    """Return a float that no absolute value in the ball exceeds."""
    return float(x.abs_upper()) * ROOM


@dataclass
class Tape:
    """What a program has done: for each number its ball, derivatives, and how far rounding moves it.

    Attributes
    ----------
    parents : list of list of (int, arb)
        For each number those that it was computed from, with the derivatives.
    roundings : list of (list of int, float)
        Numbers that are moved by a vector of at most so many times u.
    choices : list of bool
        The outcomes that are taken, in their order, for conditions that both hold and fail in the box.
    halves : list of arb
        Balls around 0 that hold what parameters differ from the middle of the box.
    exact : bool
        Whether nothing is rounded: inputs are made of parameters.
    """

    choices: list[bool] = field(default_factory=list)
    halves: list[arb] = field(default_factory=list)
    exact: bool = False
    parents: list[list[tuple[int, arb]]] = field(default_factory=list)
    roundings: list[tuple[list[int], float]] = field(default_factory=list)
    asked: dict[Any, bool] = field(default_factory=dict)

    def number(
        self, function: Callable[..., arb], operands: Sequence[tuple[Number, arb]] = (), ulps: float = 0.5
    ) -> Number:
        """Return what an operation, of operands with derivatives, gives, rounded by units in the last place."""
        value = function(*(x.value for x, _ in operands))
        if not value.is_finite() or not all(d.is_finite() for _, d in operands):
            raise UndecidedError
        off = sum(upper(d) * x.off for x, d in operands) * ROOM  # by the roundings before
        middle, slopes = None, ()
        if self.halves and all(x.middle is not None for x, _ in operands):
            middle = function(*(x.middle for x, _ in operands))
            slopes = tuple(
                sum((d * x.slopes[k] for x, d in operands), arb(0)) for k in range(len(self.halves))
            )
            centred = middle + sum((d * h for d, h in zip(slopes, self.halves, strict=True)), arb(0, off))
            if centred.is_finite():
                value = value.intersection(centred)
        if ulps and not self.exact:
            own = 2 * ulps * upper(value)
            value, off = value * (1 + arb(0, 2 * ulps * U)), (off + own * U) * ROOM
            self.roundings.append(([len(self.parents)], own))
        self.parents.append([(x.index, d) for x, d in operands])
        return Number(self, len(self.parents) - 1, value, off, middle, slopes)

    def input(self, value: Any, middle: arb | None = None, slopes: tuple[arb, ...] = ()) -> Number:
        """Return an input: it is what it is, without an error."""
        self.parents.append([])
        if middle is None and value.rad() == 0:
            middle, slopes = value, (arb(0),) * len(self.halves)
        return Number(self, len(self.parents) - 1, value, 0.0, middle, slopes)

    def inputs(self, box: Box, made: Callable[..., Sequence[Number]], within: float = 0.0) -> list[Number]:
        """Return inputs that are functions of parameters in a box, but for `within` (an absolute difference)."""
        middles = [(arb(low) + arb(high)) / 2 for low, high in box]
        self.halves = [ball(*side) - middle for side, middle in zip(box, middles, strict=True)]
        self.exact = True
        ones = [tuple(arb(int(j == k)) for j in range(len(box))) for k in range(len(box))]
        found = made(*map(self.input, (ball(*side) for side in box), middles, ones))
        self.exact = False
        return [self.input(x.value + arb(0, within), x.middle + arb(0, within), x.slopes) for x in found]

    def rounded(self, numbers: Sequence[Number], size: float) -> list[Number]:
        """Move numbers together by a vector of at most `size` times u."""
        self.roundings.append(([x.index for x in numbers], size))
        by = size * U * ROOM
        return [replace(x, value=x.value + arb(0, by), off=x.off + by) for x in numbers]

    def decide(self, key: Any) -> bool:
        """Return the outcome of a condition that may hold and may fail; the same each time it is asked."""
        if key not in self.asked:
            if len(self.asked) == len(self.choices):
                self.choices.append(True)
            self.asked[key] = self.choices[len(self.asked)]
        return self.asked[key]

    def errors(self, results: Sequence[Number]) -> list[tuple[np.ndarray, np.ndarray, float]]:
        """Return for each rounding the derivatives of the results and its size.

        The derivatives are centres and radii, of shape (results, numbers that are moved).
        """
        count = len(results)
        centre, radius = np.zeros((len(self.parents), count)), np.zeros((len(self.parents), count))
        for column, x in enumerate(results):
            centre[x.index, column] = 1
        for index in range(len(self.parents) - 1, -1, -1):
            c, r = centre[index], radius[index]
            if not c.any() and not r.any():
                continue
            for parent, d in self.parents[index]:
                middle = float(d.mid())
                width = (float(d.rad()) + abs(middle) * 1e-15) * ROOM
                centre[parent] += c * middle
                radius[parent] += (abs(c) * width + r * (abs(middle) + width)) * ROOM
                radius[parent] += 4e-16 * (abs(centre[parent]) + abs(c * middle))
        return [(centre[n].T, radius[n].T, size) for n, size in self.roundings]


def _is_short(constant: float) -> bool:
    """Return whether a constant of a program has fewer than 30 binary digits."""
    return (constant * 2.0 ** (30 - math.frexp(constant)[1])).is_integer()


@dataclass(frozen=True, eq=False)
class Number:
    """A number of a program, for all inputs of a box.

    Attributes
    ----------
    value : arb
        All values, whatever the roundings.
    off : float
        How far roundings move it at most.
    middle : arb, optional
        Its value without roundings at the middle of the box, where it is a function of parameters.
    slopes : tuple of arb
        Its derivatives by them in the box, without roundings.
    """

    tape: Tape
    index: int
    value: arb
    off: float
    middle: arb | None = None
    slopes: tuple[arb, ...] = ()

    def _with(self, other: Any) -> Number:
        if isinstance(other, Number):
            return other
        # a constant that is no short fraction stands for a number with more digits, such as the root of 3
        return self.tape.number(
            lambda: arb(other), ulps=0 if isinstance(other, arb) or _is_short(other) else 0.5
        )

    def __add__(self, other: Any) -> Number:
        if not isinstance(other, Number) and other == 0:
            return self
        b = self._with(other)
        return self.tape.number(lambda x, y: x + y, [(self, arb(1)), (b, arb(1))])

    def __sub__(self, other: Any) -> Number:
        b = self._with(other)
        return self.tape.number(lambda x, y: x - y, [(self, arb(1)), (b, arb(-1))])

    def __rsub__(self, other: Any) -> Number:
        return self._with(other) - self

    def __mul__(self, other: Any) -> Number:
        if isinstance(other, Number):
            if other is self:
                return self.tape.number(lambda x: x * x, [(self, 2 * self.value)])
            return self.tape.number(lambda x, y: x * y, [(self, other.value), (other, self.value)])
        if not _is_short(other):
            return self * self._with(other)
        exact = math.frexp(abs(other))[0] in {0.0, 0.5}  # a power of two
        return self.tape.number(lambda x: x * other, [(self, arb(other))], ulps=0 if exact else 0.5)

    def __truediv__(self, other: Any) -> Number:
        if not isinstance(other, Number) and math.frexp(abs(other))[0] == 0.5:
            return self * (1 / other)
        b = self._with(other)
        slope = 1 / b.value
        return self.tape.number(lambda x, y: x / y, [(self, slope), (b, -self.value * slope * slope)])

    def __rtruediv__(self, other: Any) -> Number:
        return self._with(other) / self

    def __neg__(self) -> Number:
        return self.tape.number(lambda x: -x, [(self, arb(-1))], ulps=0)

    __radd__, __rmul__ = __add__, __mul__

    def sqrt(self) -> Number:
        """Return the square root."""
        return self.tape.number(arb.sqrt, [(self, 1 / (2 * self.value.sqrt()))])

    def function(self, name: str) -> Number:
        """Return sine or cosine."""
        sine, cosine = self.value.sin_cos()
        function, slope = (arb.sin, cosine) if name == "sin" else (arb.cos, -sine)
        return self.tape.number(function, [(self, slope)], ulps=FUNCTION_ULPS)

    def __abs__(self) -> Number:
        sign = arb(1) if self.value > 0 else arb(-1) if self.value < 0 else arb(0, 1)
        return self.tape.number(abs, [(self, sign)], ulps=0)

    def _compared(self, other: Any, sign: int) -> Condition:
        b = other.value if isinstance(other, Number) else arb(other)
        key = (sign, self.index, other.index if isinstance(other, Number) else other)
        difference = (self.value - b) * sign
        return Condition(self.tape, True if difference > 0 else False if difference < 0 else None, key)

    def __lt__(self, other: Any) -> Condition:
        return self._compared(other, -1)

    def __gt__(self, other: Any) -> Condition:
        return self._compared(other, 1)

    __le__, __ge__ = __lt__, __gt__


@dataclass(frozen=True)
class Condition:
    """What holds for all inputs of a box (True), for none (False), or for some (None)."""

    tape: Tape
    holds: bool | None
    key: Any

    def __and__(self, other: Condition) -> Condition:
        parts = {self.holds, other.holds}
        holds = False if False in parts else None if None in parts else True
        return Condition(self.tape, holds, ("&", self.key, other.key))

    def __or__(self, other: Condition) -> Condition:
        parts = {self.holds, other.holds}
        holds = True if True in parts else None if None in parts else False
        return Condition(self.tape, holds, ("|", self.key, other.key))

    def __invert__(self) -> Condition:
        return Condition(self.tape, None if self.holds is None else not self.holds, ("~", self.key))

    def __bool__(self) -> bool:
        return self.tape.decide(self.key) if self.holds is None else self.holds


class Code:
    """A status, which no number depends on: it is not followed."""


class BallFunctions:
    """What generated modules use of the array API standard, on `Number`s: their ``xp``."""

    nan = math.nan

    def __init__(self, tape: Tape) -> None:
        self.tape = tape

    def _number(self, x: Any) -> Number:
        return x if isinstance(x, Number) else self.tape.input(arb(x))

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        """Return one of two values, or a code."""
        numbers = isinstance(yes, Number) or isinstance(no, Number)
        if isinstance(yes, Code) or isinstance(no, Code) or (not numbers and abs(yes) != abs(no)):
            return Code()  # plain numbers that are chosen for a computation differ in their sign only
        return yes if condition else no

    def abs(self, x: Any) -> Any:
        """Return the absolute value."""
        return abs(x)

    def sqrt(self, x: Any) -> Number:
        """Return the square root."""
        return self._number(x).sqrt()

    def sin(self, x: Number) -> Number:
        """Return the sine."""
        return x.function("sin")

    def cos(self, x: Number) -> Number:
        """Return the cosine."""
        return x.function("cos")

    def atan2(self, y: Any, x: Any) -> Number:
        """Return the angle of a point."""
        y, x = self._number(y), self._number(x)
        square = y.value * y.value + x.value * x.value
        parents = [(y, x.value / square), (x, -y.value / square)]
        return self.tape.number(arb.atan2, parents, ulps=FUNCTION_ULPS)


def body(module: Any, name: str, tape: Tape) -> Callable[..., tuple[Any, ...]]:
    """Return the function of a generated NumPy module that computes a kernel, working on `Number`s.

    Its operations are those of the module's text, in their order, which is that of the C text, too.
    """
    function = getattr(module, f"_{name}")
    # a product with a power of two is exact, and all is homogeneous in it
    found = type(function)(function.__code__, {"_power_of_two_scale": lambda x: 1.0})
    return lambda *inputs: found(BallFunctions(tape), *inputs, eps=EPS, largest=1e308)


def paths(program: Callable[[Tape], Any]) -> Iterator[Any]:
    """Run a program once for each outcome of the conditions that hold for a part of the box."""
    choices: list[bool] = []
    while True:
        tape = Tape(choices)
        yield program(tape)
        choices = tape.choices
        while choices and not choices[-1]:
            choices.pop()
        if not choices:
            return
        choices[-1] = False


# Directions such that every other one is within an angle of that cosine of one of them or its opposite: the corners of
# squares of side 1/4 on the faces of the cube around the unit sphere.
_steps = np.linspace(-1, 1, 9)
_faces = [np.roll([1, a, b], k) for a, b in itertools.product(_steps, _steps) for k in range(3)]
DIRECTIONS = np.array([face / np.linalg.norm(face) for face in _faces])
COSINE = math.cos(0.25 / math.sqrt(2))


def bounds(tape: Tape, results: Sequence[Sequence[Number]]) -> list[float]:
    """Return how far roundings move results at most, in multiples of eps.

    Each is one number, or a vector of three, whose error is a length: the largest of its components in all directions.
    """
    flat = [x for result in results for x in result]
    together: dict[int, list[Any]] = {}  # roundings that move one number, and those that move three
    for error in tape.errors(flat):
        together.setdefault(error[0].shape[1], []).append(error)
    groups = [tuple(map(np.array, zip(*errors, strict=True))) for errors in together.values()]
    found, first = [], 0
    for result in results:
        rows = slice(first, first + len(result))
        directions = DIRECTIONS if len(result) == 3 else np.eye(1)
        total = np.zeros(len(directions))
        for centre, radius, size in groups:  # centre and radius (roundings, results, numbers)
            along = np.linalg.norm(directions @ centre[:, rows], axis=2)
            total += size @ (along + np.linalg.norm(radius[:, rows], axis=(1, 2))[:, None])
        largest = float(total.max()) * ROOM / (COSINE if len(result) == 3 else 1)
        found.append(largest * U / EPS)
        first += len(result)
    return found


MOST = 50_000
Box = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Certificate:
    """What holds for all inputs of some boxes.

    Attributes
    ----------
    worst : float
        Bound of all boxes that are certified, in the unit of the claim.
    boxes : int
        How many of them there are.
    open : list of Box
        Those of which nothing could be said at the greatest depth.
    """

    worst: float
    boxes: int
    open: list[Box]


def certify(measure: Callable[[Box], float], start: Sequence[Box], target: float, depth: int) -> Certificate:
    """Halve boxes, the relatively longest side first, until the measure of each is at most the target.

    Parameters
    ----------
    measure : callable
        Bound of the error in a box; it raises `UndecidedError` where there is none.
    depth : int
        How often a box is halved at most; what is above the target then counts as it is.

    Returns
    -------
    Certificate
        After `MOST` boxes all others stay open.
    """
    worst, count, left = 0.0, 0, list[Box]()
    stack = [(box, 0) for box in start]
    while stack:
        box, level = stack.pop()
        if count + len(left) >= MOST:
            left += [box, *(other for other, _ in stack)]
            break
        try:
            found = measure(box)
        except UndecidedError:
            found = math.inf
        if found <= target or (level == depth and found < math.inf):
            worst, count = max(worst, found), count + 1
        elif level == depth:
            left.append(box)
        else:
            sides = [(high - low) / max(abs(low), abs(high), 1e-3) for low, high in box]
            axis = int(np.argmax(sides))
            low, high = box[axis]
            middle = math.sqrt(low * high) if low > 0 else (low + high) / 2
            stack += [
                ((*box[:axis], side, *box[axis + 1 :]), level + 1) for side in ((low, middle), (middle, high))
            ]
    return Certificate(worst, count, left)
