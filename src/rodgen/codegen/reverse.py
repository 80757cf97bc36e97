"""Derivatives of a program by adjoint accumulation, for few outputs and many inputs.

The adjoint of a line is the derivative of one output with respect to it. The output's own is 1; going through the
program from its end, a line ``s = f(a, b)`` with the adjoint t adds ``t * df/da`` to the adjoint of a, and
``t * df/db`` to that of b. One such sweep gives the derivatives of one output with respect to all inputs in a few
times the operations of the program; forward accumulation takes as many for each input.

A select passes its adjoint on to the case that holds. So an adjoint is a value and the conditions under which it
counts; where adjoints with different conditions meet, one of two values is taken. None is ever multiplied by a truth
value: the case that is not taken may be infinite.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import cache, reduce
from itertools import combinations
from operator import or_
from typing import TypeAlias

import sympy as sp

from rodgen.codegen._numbering import Numbering, slope_of

Guard: TypeAlias = frozenset[tuple[sp.Basic, bool]]
"""Conditions, and whether each holds; empty for always."""

Slope: TypeAlias = tuple[sp.Symbol, sp.Expr, Guard]
"""An operand, the derivative with respect to it, and where it has this derivative."""

ALWAYS: Guard = frozenset()


def gradients(
    program: Numbering, outputs: Sequence[sp.Expr], variables: Sequence[sp.Symbol]
) -> list[list[sp.Expr]]:
    """Add the derivatives of some operands to a program.

    Parameters
    ----------
    program : Numbering
        Gets the lines of the derivatives.
    outputs : sequence of operands
        What is differentiated.
    variables : sequence of Symbol
        With respect to what: symbols that no line defines.

    Returns
    -------
    list of list of operands
        For each output the derivatives in the order of `variables`.
    """
    tape = list(program.lines)
    # the variables on which each symbol depends, a bit each
    depends = {x: 1 << n for n, x in enumerate(variables)}
    for symbol, value in tape:
        bits = reduce(or_, (depends.get(s, 0) for s in value.free_symbols), 0)
        if bits and symbol.is_real:
            depends[symbol] = bits

    @cache  # the same for every output
    def slopes(value: sp.Basic) -> list[Slope]:
        return [
            (symbol, program.operand(slope), guard)
            for symbol, slope, guard in _slopes(value)
            if symbol in depends
        ]

    def gradient(output: sp.Expr) -> list[sp.Expr]:
        adjoints: dict[sp.Symbol, dict[Guard, list[sp.Expr]]] = defaultdict(lambda: defaultdict(list))
        factor, symbol = output.as_coeff_Mul()
        adjoints[symbol][ALWAYS].append(factor)
        for symbol, value in reversed(tape):
            if symbol not in depends or symbol not in adjoints:
                continue
            for guard, adjoint in _accumulated(program, adjoints.pop(symbol)).items():
                for operand, slope, condition in slopes(value):
                    if not _possible(guard | condition):
                        continue
                    if slope is sp.nan:  # what has no value has no derivative, whatever comes before it
                        for n, x in enumerate(variables):
                            if depends[operand] >> n & 1:
                                adjoints[x][guard | condition].append(slope)
                        continue
                    share = program.product(adjoint, slope)
                    if share != 0:
                        adjoints[operand][guard | condition].append(share)
        return [_unconditional(program, _accumulated(program, adjoints[x])) for x in variables]

    return [gradient(output) for output in outputs]


def _slopes(value: sp.Basic) -> list[Slope]:
    """Return the operands of a single operation, the derivative with respect to each, and where it holds."""
    if isinstance(value, sp.Add):
        terms = (term.as_coeff_Mul() for term in value.args)
        return [(symbol, factor, ALWAYS) for factor, symbol in terms if symbol.is_Symbol]
    if isinstance(value, sp.Mul):
        a, b = value.args
        return [(x, y, ALWAYS) for x, y in ((a, b), (b, a)) if x.is_Symbol]
    if isinstance(value, sp.Pow):
        return list(_slopes_of_power(*value.args))
    if isinstance(value, sp.Piecewise):
        return list(_slopes_of_select(value))
    symbols = sorted(value.free_symbols, key=lambda s: str(s.name))
    return [(symbol, slope_of(value, symbol), ALWAYS) for symbol in symbols]


def _slopes_of_power(base: sp.Expr, exponent: sp.Expr) -> Iterator[Slope]:
    power = sp.Pow(base, exponent)
    factor, symbol = base.as_coeff_Mul()
    if symbol.is_Symbol:
        slope = -(power**2) if exponent == -1 else exponent * sp.Pow(base, exponent - 1)
        yield symbol, factor * slope, ALWAYS
    factor, symbol = exponent.as_coeff_Mul()
    if symbol.is_Symbol:
        yield symbol, factor * power * sp.log(base), ALWAYS


def _slopes_of_select(value: sp.Piecewise) -> Iterator[Slope]:
    cases = [case.as_coeff_Mul() for case, _ in value.args]
    symbols = [symbol for _, symbol in cases if symbol.is_Symbol]
    before = ALWAYS
    for (factor, symbol), (_, condition) in zip(cases, value.args, strict=True):
        holds = before if condition is sp.true else before | {(condition, True)}
        before |= {(condition, False)}
        if symbol.is_Symbol:
            yield symbol, factor, holds
        elif factor is sp.nan:
            yield from ((other, sp.nan, holds) for other in symbols)


def _possible(guard: Guard) -> bool:
    return not any((condition, not holds) in guard for condition, holds in guard)


def _accumulated(program: Numbering, adjoints: dict[Guard, list[sp.Expr]]) -> dict[Guard, sp.Expr]:
    """Add the adjoints of a line, and take one of two where their conditions leave a choice."""
    sums = {guard: program.total(shares) for guard, shares in adjoints.items()}
    joins = True
    while joins and len(sums) > 1:
        joins = False
        for a, b in combinations(sorted(sums, key=_order), 2):
            differing = a ^ b
            if a < b:
                sums[a] = program.total([sums[a], program.operand(_where(b - a, sums.pop(b)))])
            elif len(differing) == 2 and not _possible(differing):
                ((condition, _),) = {pair for pair in differing if pair[1]}
                yes, no = (a, b) if (condition, True) in a else (b, a)
                both = sp.Piecewise((sums.pop(yes), condition), (sums.pop(no), True), evaluate=False)
                sums[a & b] = program.total(
                    [program.operand(both), *([sums[a & b]] if a & b in sums else [])]
                )
            else:
                continue
            joins = True
            break
    return {guard: adjoint for guard, adjoint in sums.items() if adjoint != 0}


def _order(guard: Guard) -> tuple[int, str]:
    """Fewer conditions first: nothing may depend on the order of a set."""
    return len(guard), str(sorted(guard, key=str))


def _where(guard: Guard, adjoint: sp.Expr) -> sp.Expr:
    """Return the adjoint where the conditions hold, and 0 elsewhere."""
    for condition, holds in sorted(guard, key=str):
        cases = (adjoint, sp.S.Zero) if holds else (sp.S.Zero, adjoint)
        adjoint = sp.Piecewise((cases[0], condition), (cases[1], True), evaluate=False)
    return adjoint


def _unconditional(program: Numbering, adjoints: dict[Guard, sp.Expr]) -> sp.Expr:
    return program.total([program.operand(_where(g, a)) for g, a in adjoints.items()] or [sp.S.Zero])
