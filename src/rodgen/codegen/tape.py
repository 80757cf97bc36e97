"""Numbers that write down what is done with them: a program without SymPy.

A `Number` is an operation on earlier numbers of its `Tape`. Arithmetic with a number that is known is done at once, and
what was computed before is found again, so that a formula that is written with Python's operators becomes a program
without repetitions; :mod:`rodgen.codegen.tape_jacobian` adds its derivatives. This takes a hundredth of the time of the
same with SymPy, and suits formulas that need no algebra, such as a product of exponentials.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from itertools import product
from operator import attrgetter
from typing import Any, TypeAlias

from rodgen.codegen.program import GIVEN, Program


class Number:
    """A number of a program: an operation on earlier ones, or an input."""

    __slots__ = ("args", "index", "op", "same", "tape")
    __hash__ = object.__hash__

    def __init__(self, tape: Tape, op: str, args: tuple[Any, ...], same: bool) -> None:
        self.tape, self.op, self.args, self.same = tape, op, args, same
        self.index = len(tape.numbers)

    def __repr__(self) -> str:
        return f"<Number {self.index}: {self.op}>"

    def __add__(self, other: Any) -> Any:
        return _sum(self, other) if isinstance(other, _VALUES) else NotImplemented

    def __sub__(self, other: Any) -> Any:
        return _sum(self, -other) if isinstance(other, _VALUES) else NotImplemented

    def __rsub__(self, other: Any) -> Any:
        return _sum(-self, other) if isinstance(other, _VALUES) else NotImplemented

    def __mul__(self, other: Any) -> Any:
        return _product(self, other) if isinstance(other, _VALUES) else NotImplemented

    def __truediv__(self, other: Any) -> Any:
        return _product(self, _reciprocal(other)) if isinstance(other, _VALUES) else NotImplemented

    def __rtruediv__(self, other: Any) -> Any:
        return _product(_reciprocal(self), other) if isinstance(other, _VALUES) else NotImplemented

    def __pow__(self, other: Any) -> Any:
        return _power(self, other) if isinstance(other, _VALUES) else NotImplemented

    def __rpow__(self, other: Any) -> Any:
        return (
            self.tape.number("pow", _operand(other), self) if isinstance(other, _VALUES) else NotImplemented
        )

    def __neg__(self) -> Number:
        if self.op == "neg":
            return self.args[0]  # type: ignore[no-any-return]
        return self.tape.number("neg", self)

    def __lt__(self, other: Any) -> Number:
        return self.tape.number("lt", self, _operand(other))

    def __gt__(self, other: Any) -> Number:
        return self.tape.number("lt", _operand(other), self)

    __radd__, __rmul__ = __add__, __mul__


Value: TypeAlias = Number | Fraction | float
"""A number of the program, or one that is known; integers are welcome."""

_VALUES = (Number, int, float, Fraction)


def _operand(x: Any) -> Number | float:
    return x if isinstance(x, Number) else float(x)


def _sum(a: Number, b: Value) -> Value:
    tape = a.tape
    if not isinstance(b, Number):
        if b == 0:
            return a
        if a.op == "add" and isinstance(a.args[0], float):
            return _sum(a.args[1], a.args[0] + float(b))
        return tape.number("add", float(b), a)
    if a.op == "neg":
        a, b = b, a
    if b.op == "neg":
        if a.op == "neg":
            return -_sum(a.args[0], b.args[0])
        return 0 if a is b.args[0] else tape.number("sub", a, b.args[0])
    if a is b:
        return _product(a, 2)
    return tape.number("add", *_in_order(a, b))


def _product(a: Number, b: Value) -> Value:
    tape = a.tape
    if not isinstance(b, Number):
        if b in (0, 1, -1):
            return 0 if b == 0 else a if b == 1 else -a
        if b != b:
            return math.nan
        if a.op == "neg":
            return _product(a.args[0], -b)
        if a.op == "mul" and isinstance(a.args[0], float):
            return _product(a.args[1], a.args[0] * float(b))
        return tape.number("mul", float(b), a)
    for x, y in ((a, b), (b, a)):
        if x.op == "neg":
            return -_product(x.args[0], y)
        if x.op == "recip":
            if x.args[0] is y:
                return 1
            if y.op == "mul" and x.args[0] in y.args:
                return y.args[1 - y.args.index(x.args[0])]  # type: ignore[no-any-return]
    for x, y in ((a, b), (b, a)):
        if y.same and not x.same and x.op == "mul":
            left, right = x.args
            if isinstance(left, float) or left.same:
                return _product(right, y * left)
            if right.same:
                return _product(left, y * right)
    return tape.number("mul", *_in_order(a, b))


def _in_order(a: Number, b: Number) -> tuple[Number, Number]:
    return (a, b) if a.index < b.index else (b, a)


def _reciprocal(x: Any) -> Any:
    if not isinstance(x, Number):
        return 1 / x if x else math.nan
    if x.op == "recip":
        return x.args[0]
    if x.op == "neg":
        return -_reciprocal(x.args[0])
    return x.tape.number("recip", x)


def _power(base: Number, exponent: Value) -> Any:
    if isinstance(exponent, Number):
        return base.tape.number("pow", base, exponent)
    n = Fraction(exponent)
    if n < 0:
        return _reciprocal(_power(base, -n))
    if n.denominator == 2:
        return _power(base, n - Fraction(1, 2)) * sqrt(base)
    if n.denominator != 1:
        return base.tape.number("pow", base, float(n))
    result: Value = 1
    square: Value = base
    k = int(n)
    while k:
        if k & 1:
            result = result * square
        square = square * square if k > 1 else square
        k >>= 1
    return result


def _function(op: str, known: Callable[[float], float]) -> Callable[[Any], Any]:
    def function(x: Any) -> Any:
        if isinstance(x, Number):
            return x.tape.number(op, x)
        try:
            return known(float(x))
        except ValueError:  # it has no real value
            return math.nan
        except OverflowError:
            return math.inf

    function.__name__ = op
    function.__doc__ = f"Return {op} of a value."
    return function


sin, cos, tan = _function("sin", math.sin), _function("cos", math.cos), _function("tan", math.tan)
exp, log = _function("exp", math.exp), _function("log", math.log)
sqrt, absolute = _function("sqrt", math.sqrt), _function("abs", abs)
asin = _function("asin", math.asin)
sign = _function("sign", lambda x: float((x > 0) - (x < 0)))


def atan2(y: Any, x: Any) -> Any:
    """Return the angle of the point x, y."""
    for value in (y, x):
        if isinstance(value, Number):
            return value.tape.number("atan2", _operand(y), _operand(x))
    return math.atan2(y, x)


def select(condition: Any, yes: Any, no: Any) -> Any:
    """Return one of two values."""
    if not isinstance(condition, Number):
        return yes if condition else no
    if yes is no:
        return yes
    return condition.tape.number("select", condition, _operand(yes), _operand(no))


class Tape:
    """The operations of a program, in their order.

    Examples
    --------
    >>> tape = Tape()
    >>> (x,), (a, b) = tape.inputs("x", 1, same=False), tape.inputs("p", 2)
    >>> y = a * sin(x) + b + 0 * x
    >>> program = tape.program("wave", {"x": (), "p": (2,)}, {"y": ((), [y])})
    >>> [operation[0] for operation in program.operations]
    ['input', 'input', 'input', 'sin', 'mul', 'add']
    >>> program.results
    {'y': [5]}
    """

    def __init__(self) -> None:
        self.numbers: list[Number] = []
        self._found: dict[tuple[Any, ...], Number] = {}
        self._names: dict[Number, str] = {}

    def inputs(self, port: str, size: int, *, same: bool = True) -> list[Number]:
        """Return the components of an input; `same` is whether all rows share it."""
        return [self._number(("input", port, i), same=same) for i in range(size)]

    def seeds(self, count: int) -> list[Number]:
        """Return numbers of which one is 1 and the others are 0: another one for each row of a Jacobian."""
        return [self._number(("seed", i), same=False) for i in range(count)]

    def let(self, name: str, value: Any) -> Any:
        """Return a value, a number or a matrix, whose numbers get a name, unless they have one."""
        numbers, shape = getattr(value, "flat", [value]), getattr(value, "shape", ())
        shape = shape[:1] if shape[1:] == (1,) else shape
        for number, at in zip(numbers, product(*(range(1, n + 1) for n in shape)), strict=True):
            if isinstance(number, Number) and number.op not in GIVEN:
                self._names.setdefault(number, "_".join([name, *map(str, at)]))
        return value

    def number(self, op: str, *args: Any) -> Number:
        """Return the number of an operation on numbers and floats."""
        known = self._found.get((op, *args))
        if known is None:
            for a in args:
                if isinstance(a, Number) and not a.same:
                    return self._number((op, *args), same=False)
            return self._number((op, *args), same=True)
        return known

    def has(self, op: str, *args: Any) -> bool:
        """Return whether an operation is on the tape."""
        return (op, *args) in self._found

    def _number(self, key: tuple[Any, ...], *, same: bool) -> Number:
        known = self._found.get(key)
        if known is None:
            known = self._found[key] = Number(self, key[0], key[1:], same)
            self.numbers.append(known)
        return known

    def program(
        self,
        name: str,
        inputs: Mapping[str, tuple[int, ...]],
        outputs: Mapping[str, tuple[tuple[int, ...], Sequence[Any]]],
        late: int | None = None,
    ) -> Program:
        """Return what computes some outputs.

        Parameters
        ----------
        inputs : mapping of str to tuple of int
            Shapes; the first input is that of the rows.
        outputs : mapping of str to (shape, values)
        late : int, optional
            Numbers from this one on stand right after what they need: few of those that come before are then in use at
            once, where these are derivatives that were taken forward.
        """
        wanted = [x for _, values in outputs.values() for x in values]
        place: dict[Any, int] = {}
        operations: list[Sequence[Any]] = []
        for number in needed(wanted) if late is None else _early(needed(wanted), late):
            place[number] = len(operations)
            args = (
                number.args
                if number.op in GIVEN
                else [place[a] if isinstance(a, Number) else a for a in number.args]
            )
            operations.append((number.op, *args))
        operands = iter([place[x] if isinstance(x, Number) else float(x) for x in wanted])
        return Program(
            name,
            dict(inputs),
            {port: shape for port, (shape, _) in outputs.items()},
            operations,
            {port: [next(operands) for _ in values] for port, (_, values) in outputs.items()},
            {n: self._names[number] for number, n in place.items() if number in self._names},
        )


def with_known(wanted: Sequence[Any], known: Mapping[Number, float]) -> dict[Any, Any]:
    """Return what numbers are on a tape where some inputs are known."""
    tape = Tape()
    here: dict[Any, Any] = dict(known)
    for x in needed(wanted):
        if x.op in GIVEN:
            here.setdefault(x, tape._number((x.op, *x.args), same=x.same))
        else:
            here[x] = _OPERATIONS[x.op](*[here[a] if isinstance(a, Number) else a for a in x.args])
    return here


def needed(wanted: Sequence[Any]) -> list[Number]:
    """Return all that some numbers need, in order."""
    stack, reached = [x for x in wanted if isinstance(x, Number)], set()
    while stack:
        number = stack.pop()
        if number not in reached:
            reached.add(number)
            stack += [a for a in number.args if isinstance(a, Number)]
    return sorted(reached, key=attrgetter("index"))


def _early(numbers: Sequence[Number], late: int) -> list[Number]:
    """Return numbers in an order in which the late ones come right after what they need."""
    rank: dict[Number, int] = {}
    for x in numbers:
        operands = [rank[a] for a in x.args if isinstance(a, Number)]
        rank[x] = x.index if x.index < late or not operands else max(operands)
    return sorted(numbers, key=lambda x: (rank[x], x.index))


def _known_power(a: Any, b: Any) -> Any:
    try:
        return a**b
    except (ZeroDivisionError, OverflowError):
        return math.nan


_OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "neg": lambda a: -a,
    "recip": _reciprocal,
    "pow": _known_power,
    "lt": lambda a, b: a < b,
    "atan2": atan2,
    "select": select,
    **{f.__name__: f for f in (sin, cos, tan, asin, exp, log, sqrt, absolute, sign)},
}
