"""From SymPy to operations: the one place where the expressions of a kernel become a program.

Operations are done in the order in which a sum or product is read, and each once: what was computed before is found
again on the tape. Of the parts of a sum or product, those two are taken first that stand together most often in all of
them; so the expressions are walked three times, each with what the walk before counted. What is divided by twice is
inverted once. Nothing is done with the numbers themselves: a named step is computed as it stands.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from heapq import heapify, heappop, heappush
from itertools import combinations, count, groupby
from typing import Any, NamedTuple, TypeAlias

import sympy as sp
from sympy.core.relational import Relational

from rodgen.codegen.kernel_parts import Assignment, KernelError, Port, slope
from rodgen.codegen.operations import COMPARISONS
from rodgen.codegen.program import Program
from rodgen.codegen.tape import Number, Tape
from rodgen.codegen.tape_jacobian import forward
from rodgen.symbolic import EPS, LARGEST, power_of_two_scale

Operand: TypeAlias = Number | float

FUNCTIONS: dict[type, str] = {
    sp.Abs: "abs",
    power_of_two_scale: "power_of_two_scale",
    **{
        getattr(sp, name): name
        for name in (
            *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
            *("exp", "log", "sign"),
        )
    },
}
"""The operation of each function that a kernel may use."""

_COMPARED = {sign: op for op, sign in COMPARISONS.items()}
LARGEST_POWER_AS_PRODUCT = 4


class _Part(NamedTuple):
    """A term of a sum, or a factor of a product."""

    negative: bool
    value: Operand
    """Without its sign."""
    key: Any
    """What counts as the same part in other sums and products."""


def program_of(
    name: str, inputs: Sequence[Port], outputs: Sequence[Port], steps: Sequence[Assignment]
) -> Program:
    """Return the program of steps, each of which uses inputs and earlier steps.

    Named steps are names of the program; the machine epsilon and the largest number are two more inputs.
    """
    counted = Counter[Any]()
    for _ in range(3):
        walk = _Walk(inputs, counted)
        walk.through(steps)
        counted = walk.seen
    shapes = {port.name: port.shape for port in inputs} | {EPS.name: (), LARGEST.name: ()}
    results = {port.name: (port.shape, [walk.known[s] for s in port.symbols]) for port in outputs}
    return walk.tape.program(name, shapes, results)


def check_expression(value: sp.Basic) -> None:
    """Raise a KernelError where a kernel cannot compute an expression or condition."""
    walk = _Walk((), Counter())
    walk.known.update((s, walk.tape.inputs(s.name, 1)[0]) for s in value.free_symbols)
    walk(value)


class _Walk:
    """Expressions as operations on a tape."""

    def __init__(self, inputs: Sequence[Port], counted: Counter[Any]) -> None:
        self.tape, self.counted, self.seen = Tape(), counted, Counter[Any]()
        self.known: dict[sp.Basic, Operand] = {}
        for port in inputs:
            self.known.update(zip(port.symbols, self.tape.inputs(port.name, port.size), strict=True))
        for symbol in (EPS, LARGEST):
            (self.known[symbol],) = self.tape.inputs(symbol.name, 1)
        self.done: dict[sp.Basic, tuple[bool, Operand]] = {}

    def through(self, steps: Sequence[Assignment]) -> None:
        """Take steps, in their order; derivatives that follow each other are taken together."""
        for are_slopes, group in groupby(steps, lambda step: isinstance(step.value, slope)):
            taken = list(group)
            values = self.slopes([value for _, value in taken]) if are_slopes else (self(v) for _, v in taken)
            for (symbol, _), value in zip(taken, values, strict=True):
                self.known[symbol] = self.tape.let(symbol.name, value)

    def slopes(self, wanted: Sequence[slope]) -> list[Operand]:
        """Return derivatives of steps with respect to inputs."""
        steps, inputs = (
            list(dict.fromkeys(symbols)) for symbols in zip(*(x.args for x in wanted), strict=True)
        )
        variables: list[Any] = [self.known[x] for x in inputs]
        slopes: dict[slope, Operand] = {}
        for s, row in zip(steps, forward([self.known[s] for s in steps], variables), strict=True):
            for x, value in zip(inputs, row, strict=True):
                slopes[slope(s, x)] = value if isinstance(value, Number) else float(value)
        return [slopes[x] for x in wanted]

    def __call__(self, value: sp.Basic) -> Operand:
        """Return an expression or condition."""
        negative, x = self.signed(value)
        if not negative:
            return x
        return self.tape.number("neg", x) if isinstance(x, Number) else -x

    def signed(self, value: sp.Basic) -> tuple[bool, Operand]:
        """Return whether an expression has a minus sign, and what it is without."""
        if value in self.known:
            return False, self.known[value]
        if value not in self.done:
            self.done[value] = self._signed(value)
        return self.done[value]

    def _signed(self, value: sp.Basic) -> tuple[bool, Operand]:
        if isinstance(value, sp.Rational):
            return bool(value.p < 0), self.constant(abs(Fraction(int(value.p), int(value.q))))
        if isinstance(value, sp.Add):
            terms = [_Part(*self.signed(t), t) for t in value.as_ordered_terms()]
            terms = [_Part(n, x, -t if n else t) for n, x, t in terms]
            return self.joined("add", sorted(terms, key=lambda term: term.negative))[:2]
        if isinstance(value, sp.Mul):
            return self.product(value)
        if isinstance(value, sp.Pow):
            if value.exp.is_negative:
                self.seen[value] += 1
                negative, x = self.signed(value.base**-value.exp)
                if x == 0:
                    raise KernelError(f"a kernel divides by zero: {value}")
                return negative, self.tape.number("div", 1.0, x)
            return self.power(value.base, value.exp)
        return False, self.unsigned(value)

    def unsigned(self, value: sp.Basic) -> Operand:
        """Return a function, a condition, or a case distinction."""
        number = self.tape.number
        if isinstance(value, sp.Piecewise):
            *cases, (last, otherwise) = value.args
            if otherwise != sp.true:
                raise KernelError(f"a select needs a value for every case: {value}")
            operand = self(last)
            for case, condition in reversed(cases):
                operand = number("select", self(condition), self(case), operand)
            return operand
        if isinstance(value, Relational):
            (left, right), relation = map(self, value.args), value.rel_op
            if relation in {">", ">="}:
                left, right, relation = right, left, relation.replace(">", "<")
            return number(_COMPARED[relation], left, right)
        if isinstance(value, sp.And | sp.Or):
            parts = [_Part(False, self(part), part) for part in sorted(value.args, key=sp.default_sort_key)]
            return self.joined("and" if isinstance(value, sp.And) else "or", parts).value
        if isinstance(value, sp.Not):
            return number("not", self(value.args[0]))
        if isinstance(value, sp.ITE):  # SymPy makes this of a select inside a condition
            condition, yes, no = map(self, value.args)
            return number("or", number("and", condition, yes), number("and", number("not", condition), no))
        if value in (sp.true, sp.false):
            return number("lt", *((0.0, 1.0) if value == sp.true else (1.0, 0.0)))
        if value is sp.pi:
            return number("pi")
        if value is sp.E:
            return number("exp", 1.0)
        if value is sp.nan:
            return math.nan
        if isinstance(value, slope):
            return self.slopes([value])[0]
        if type(value) in FUNCTIONS:
            return number(FUNCTIONS[type(value)], *map(self, value.args))
        if isinstance(value, sp.Float):
            raise KernelError(
                f"the float {float(value):.6g} is in a kernel; expected an exact number, such as sp.Rational(1, 2)"
            )
        known = ", ".join(sorted({*(f.__name__ for f in FUNCTIONS), "sqrt", "select"}))
        what = f"{type(value).__name__}()" if value.args else str(value)
        raise KernelError(f"a kernel has no {what}; it may use {known}")

    def constant(self, x: Fraction) -> Operand:
        """Return an exact constant, which may be a quotient or sum of floats."""
        try:
            nearest = float(x)
        except OverflowError:
            raise KernelError(
                "a number in a kernel is too large or too small; expected one between 1e-308 and 1e308"
            ) from None
        if nearest == x:
            return nearest
        if x.denominator != 1:
            return self.tape.number(
                "div", self.constant(Fraction(x.numerator)), self.constant(Fraction(x.denominator))
            )
        rest = self.constant(abs(x - Fraction(nearest)))
        return self.tape.number("add" if nearest < x else "sub", nearest, rest)

    def power(self, base: sp.Expr, exponent: sp.Expr) -> tuple[bool, Operand]:
        """Return a power whose exponent is not negative: a product, a root, or what the library gives."""
        number = self.tape.number
        if exponent == sp.S.Half:
            return False, number("sqrt", self(base))
        if not exponent.is_Integer or exponent > LARGEST_POWER_AS_PRODUCT:
            return False, number("pow", self(base), self(exponent))
        negative, x = self.signed(base)
        square = number("mul", x, x)
        higher = {0: 1.0, 1: x, 2: square, 3: number("mul", square, x), 4: number("mul", square, square)}
        return negative and exponent % 2 == 1, higher[int(exponent)]

    def product(self, value: sp.Mul) -> tuple[bool, Operand]:
        """Return a product; what several products divide by is inverted once.

        A fraction goes with the factor that it stands with most often: the two together are computed once.
        """
        number = self.tape.number
        coefficient, rest = value.as_coeff_Mul(rational=True)
        factors, negative = rest.as_ordered_factors(), bool(coefficient.p < 0)
        p, q = Fraction(abs(int(coefficient.p))), Fraction(int(coefficient.q))
        if not q.numerator & (q.numerator - 1):  # a float
            p, q = p / q, Fraction(1)
        pairs = [(p, q, factor) for factor in factors if q != 1]
        self.seen.update([*filter(_divides, factors), *pairs])
        together = max(pairs, key=lambda pair: self.counted[pair], default=None)
        if self.counted[together] < 2:
            together = None
        above, below = (
            [_Part(False, self.constant(x), x)] if x != 1 and together is None else [] for x in (p, q)
        )
        for factor in factors:
            divides = _divides(factor)
            sign, x = self.signed(factor.base**-factor.exp if divides else factor)
            negative ^= sign
            if (p, q, factor) == together:
                top, bottom = self.constant(p), self.constant(q)
                if divides:
                    bottom = number("mul", bottom, x)
                else:
                    top = number("mul", top, x) if p != 1 else x
                x, divides = number("div", top, bottom), False
            elif divides and self.counted[factor] > 1:
                x, divides = number("div", 1.0, x), False
            (below if divides else above).append(_Part(False, x, factor))
        found = self.joined("mul", above).value if above else 1.0
        if below:
            found = number("div", found, self.joined("mul", below).value)
        return negative, found

    def joined(self, op: str, parts: list[_Part]) -> _Part:
        """Return the sum or product of parts, or what conditions say together."""
        self.seen.update(_pair(op, a, b) for a, b in combinations(parts, 2))
        there = dict(enumerate(parts))  # by place; what two become stands at that of the first
        number = count()

        def ranked(i: int, j: int) -> tuple[float, int, int, int, _Part, _Part]:
            a, b = there[i], there[j]
            return -self.worth(op, a, b), i, j, next(number), a, b

        heap = [ranked(i, j) for i, j in combinations(there, 2)]
        heapify(heap)
        while len(there) > 1:
            _, i, j, _, a, b = heappop(heap)
            if there.get(i) is not a or there.get(j) is not b:
                continue
            del there[j]
            there[i] = both = self.two(op, a, b)
            others = [k for k in there if k != i]
            self.seen.update(_pair(op, both, there[k]) for k in others)
            for k in others:
                heappush(heap, ranked(*sorted((i, k))))
        return there[0]

    def worth(self, op: str, a: _Part, b: _Part) -> float:
        """Return how often two parts stand together; more where their sum or product is on the tape."""
        often = self.counted[_pair(op, a, b)]
        return (often if often > 1 else 0) + 1.5 * any(self.tape.has(*key) for _, key in _ways(op, a, b))

    def two(self, op: str, a: _Part, b: _Part) -> _Part:
        """Return two parts together; what is on the tape is found."""
        ways = _ways(op, a, b)
        negative, key = next((way for way in ways if self.tape.has(*way[1])), ways[0])
        return _Part(negative, self.tape.number(*key), _pair(op, a, b))


def _divides(factor: sp.Expr) -> bool:
    return isinstance(factor, sp.Pow) and bool(factor.exp.is_negative)


def _pair(op: str, a: _Part, b: _Part) -> Any:
    return op, a.negative == b.negative, frozenset((a.key, b.key))


def _ways(op: str, a: _Part, b: _Part) -> list[tuple[bool, tuple[str, Operand, Operand]]]:
    """Return the operations that join two parts, and whether a minus sign is left; first as they are read."""
    x, y = a.value, b.value
    if a.negative == b.negative:
        return [(a.negative, (op, x, y)), (a.negative, (op, y, x))]
    ways = [(a.negative, ("sub", x, y)), (b.negative, ("sub", y, x))]
    return ways[::-1] if a.negative else ways
