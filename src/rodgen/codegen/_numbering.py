"""Value numbering: write a long program operation by operation, each operation once.

SymPy's ``cse`` looks for common parts of sums and products, which takes minutes for thousands of lines. Here an
operation on symbols is looked up in a table when it is written, and gets the symbol that it has already; that takes
time in proportion to the length. Numbers are folded on the way: what is added to 0 or multiplied by 0 or 1 costs no
line, and a select whose condition is known is the case that holds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterator, Mapping, Sequence
from functools import reduce
from itertools import count

import sympy as sp
from sympy.core.relational import Relational
from sympy.logic.boolalg import Boolean

Pair = tuple[sp.Symbol, sp.Basic]


class Numbering:
    """A straight-line program of single operations.

    An operand is a number, a symbol or a negated symbol. An operation is a sum of operands with rational factors, a
    product of two symbols, a rational multiple, a power, a function, a select, or a condition.

    Parameters
    ----------
    taken : container of str
        Names that the symbols made here do not take.
    known : mapping of Symbol to number, optional
        Numbers that replace some of the symbols.

    Attributes
    ----------
    lines : list of (Symbol, value)
        The program so far, in the order of evaluation.

    Examples
    --------
    >>> a, b = sp.symbols("a b", real=True)
    >>> program = Numbering(taken={"a", "b"})
    >>> program.operand(sp.sin(a * b) + 2 * a * b), program.operand(-b * a)
    (x2, -x0)
    >>> program.lines
    [(x0, a*b), (x1, sin(x0)), (x2, 2*x0 + x1)]
    """

    def __init__(self, taken: Container[str], known: Mapping[sp.Symbol, sp.Basic] | None = None) -> None:
        self.lines: list[Pair] = []
        self._operands: dict[sp.Symbol, sp.Basic] = dict(known or {})
        self._found: dict[sp.Basic, sp.Basic] = {}
        self._names = (name for name in (f"x{n}" for n in count()) if name not in taken)

    def define(self, symbol: sp.Symbol, value: sp.Basic, *, by_name: bool = True) -> None:
        """Let `symbol` have a value: by a line of its name, or as another name of an operand."""
        operand = self._written(value, symbol if by_name else None)
        if operand is not symbol:
            self._operands[symbol] = operand

    def operand(self, value: sp.Basic) -> sp.Basic:
        """Return the operand that has this value; write the operations that it still needs."""
        return self._written(value, None)

    def product(self, a: sp.Basic, b: sp.Basic) -> sp.Basic:
        """Return the operand that is the product of two operands."""
        if a is sp.S.One:
            return b
        return a if b is sp.S.One else self._line(sp.Mul(a, b), None)

    def total(self, terms: Sequence[sp.Basic]) -> sp.Basic:
        """Return the operand that is the sum of operands."""
        return terms[0] if len(terms) == 1 else self._line(sp.Add(*terms), None)

    def _written(self, value: sp.Basic, name: sp.Symbol | None) -> sp.Basic:
        if value.is_Symbol:
            return self._operands.get(value, value)
        known = self._found.get(value)
        if known is None:
            known = self._found[value] = self._operation(value, name)
        return known

    def _operation(self, value: sp.Basic, name: sp.Symbol | None) -> sp.Basic:
        if isinstance(value, sp.Add):
            return self._line(sp.Add(*map(self._term, value.args)), name)
        if isinstance(value, sp.Mul):
            factor, rest = value.as_coeff_Mul()
            parts = [self._written(part, None) for part in sp.Mul.make_args(rest)]
            parts.sort(key=lambda x: x.as_coeff_Mul()[1].is_Symbol)  # numbers first
            *inner, last = parts if factor is sp.S.One else [*parts, factor]
            return self._line(sp.Mul(reduce(self.product, inner), last), name)
        if isinstance(value, sp.Pow):
            return self._power(value.base, value.exp, name)
        if isinstance(value, sp.Piecewise):
            return self._select(value, name)
        if isinstance(value, Boolean):
            condition = self._condition(value)
            return condition if condition in (sp.true, sp.false) else self._line(condition, name)
        if not value.args:
            return self._line(value, name)
        return self._line(value.func(*(self._written(a, None) for a in value.args)), name)

    def _term(self, value: sp.Basic) -> sp.Basic:
        factor, rest = value.as_coeff_Mul()
        operand = self._written(rest, None)
        return operand if factor is sp.S.One else factor * operand

    def _power(self, base: sp.Basic, exponent: sp.Basic, name: sp.Symbol | None) -> sp.Basic:
        """Write reciprocals and roots as operations of their own: derivatives use them again."""
        x = self._written(base, None)
        if exponent.is_Rational and exponent < 0 and exponent != -1:
            return self._line(1 / self._written(sp.Pow(x, -exponent), None), name)
        if exponent.is_Rational and exponent.q == 2 and exponent != sp.S.Half:
            whole, root = sp.Pow(x, exponent - sp.S.Half), sp.sqrt(x)
            return self._line(sp.Mul(self._written(whole, None), self._written(root, None)), name)
        return self._line(sp.Pow(x, self._written(exponent, None)), name)

    def _select(self, value: sp.Piecewise, name: sp.Symbol | None) -> sp.Basic:
        cases: list[tuple[sp.Basic, sp.Basic]] = []
        for case, condition in value.args:
            holds = self._written(condition, None)
            if holds is sp.false:
                continue
            cases.append((self._written(case, None), holds))
            if holds is sp.true:
                break
        if all(case == cases[0][0] for case, _ in cases):
            return cases[0][0]
        return self._line(sp.Piecewise(*cases, evaluate=False), name)

    def _condition(self, value: sp.Basic) -> sp.Basic:
        """Return a condition on operands; one between numbers is decided here."""
        if isinstance(value, sp.Symbol):
            return self._operands.get(value, value)
        if isinstance(value, Relational):
            left, right = self._written(value.lhs, None), self._written(value.rhs, None)
            if sp.nan in (left, right):
                return sp.true if isinstance(value, sp.Ne) else sp.false
            return value.func(left, right, evaluate=left.is_number and right.is_number)
        return value.func(*map(self._condition, value.args))

    def _line(self, operation: sp.Basic, name: sp.Symbol | None) -> sp.Basic:
        """Return the operand of an operation on operands."""
        if operation.is_Symbol:
            return operation
        if not operation.args:
            # a value that is infinite or not real is NaN, as it is in floating point wherever it counts
            return sp.nan if getattr(operation, "is_real", None) is False else operation
        sign: sp.Basic = sp.S.One
        if isinstance(operation, sp.Mul) and operation.args[0].is_negative and operation.args[0].is_Number:
            sign, operation = sp.S.NegativeOne, -operation
            if operation.is_Symbol:
                return -operation
        symbol = self._found.get(operation)
        if symbol is None:
            if name is None or sign is not sp.S.One:
                symbol = sp.Symbol(next(self._names), real=None if isinstance(operation, Boolean) else True)
            else:
                symbol = name
            if not operation.free_symbols and getattr(operation, "is_real", None) is False:
                return sp.nan
            self._found[operation] = symbol
            self.lines.append((symbol, operation))
        return symbol if sign is sp.S.One else -symbol


def slope_of(value: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """Return the derivative; that of sign() is 0, also at 0."""
    slope = value.diff(symbol)
    return slope.replace(sp.DiracDelta, lambda *_: sp.S.Zero) if slope.has(sp.DiracDelta) else slope


LONGEST = 12
"""Most operands of a line that others were written into: longer ones are hard to read."""


def joined(lines: Sequence[Pair], named: Container[sp.Symbol]) -> Iterator[Pair]:
    """Yield the lines, each sum, product or power that is used once written into the line that uses it.

    Parameters
    ----------
    lines : sequence of (Symbol, value)
        Single operations, as :class:`Numbering` writes them.
    named : container of Symbol
        Lines that are kept.
    """
    uses = Counter(symbol for _, value in lines for symbol in value.free_symbols)
    held: dict[sp.Symbol, tuple[sp.Expr, int]] = {}
    for symbol, value in lines:
        size = len(value.args)
        inner: dict[sp.Symbol, sp.Expr] = {}
        for used in sorted(value.free_symbols & held.keys(), key=lambda s: str(s.name)):
            operation, length = held.pop(used)
            if _may_absorb(value, operation) and size + length <= LONGEST:
                inner[used] = operation
                size += length - 1
            else:
                yield used, operation
        if inner:
            value = _absorbed(value, inner)
        if uses[symbol] == 1 and symbol not in named and isinstance(value, sp.Add | sp.Mul | sp.Pow):
            held[symbol] = value, size
        else:
            yield symbol, value


def _may_absorb(value: sp.Basic, operation: sp.Expr) -> bool:
    """Return whether an operation may replace its symbol: each is evaluated once, and in the same order."""
    if value.is_Symbol:
        return True
    if isinstance(value, sp.Add):
        return isinstance(operation, sp.Mul | sp.Pow)
    if isinstance(value, sp.Mul):
        return not value.args[0].is_Number or not isinstance(operation, sp.Add)
    return False


def _absorbed(value: sp.Basic, inner: dict[sp.Symbol, sp.Expr]) -> sp.Basic:
    if value.is_Symbol:
        return inner[value]
    parts = (sp.Mul(*(inner.get(f, f) for f in sp.Mul.make_args(a))) for a in value.args)
    return value.func(*parts)
