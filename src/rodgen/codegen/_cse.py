"""Common-subexpression elimination over a straight-line program.

SymPy's ``cse`` finds the shared parts. It would also pull conditions out of a Piecewise and leave truth
values where numbers are expected; so each condition is kept aside while it runs, and only the two sides of
its comparisons take part.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import sympy as sp
from sympy.core.relational import Relational
from sympy.logic.boolalg import Boolean

Pair = tuple[sp.Symbol, sp.Basic]


class _Select(sp.Function):  # type: ignore[misc]
    """Stands for a two-branch Piecewise while ``cse`` runs: (condition's stand-in, value, other value)."""

    nargs = 3
    is_real = True


def eliminate_common_subexpressions(steps: Sequence[Pair], taken: Iterable[str]) -> list[Pair]:
    """Share what several steps compute, and return the steps in an order in which they can be evaluated.

    Parameters
    ----------
    steps : sequence of (Symbol, value)
        Each value uses inputs and earlier symbols. Named steps keep their names.
    taken : iterable of str
        Names that the new symbols ``x0``, ``x1``, ... must not take.
    """
    conditions: dict[Boolean, sp.Symbol] = {}
    bare = [_hide_conditions(value, conditions) for _, value in steps]
    comparisons = sorted(
        {c for condition in conditions for c in condition.atoms(Relational)}, key=sp.default_sort_key
    )
    sides = [_hide_conditions(side, conditions) for c in comparisons for side in c.args]
    taken = set(taken)
    names = (s for s in sp.numbered_symbols("x", real=True) if s.name not in taken)
    shared, reduced = sp.cse([*bare, *sides], symbols=names, order="canonical")

    reduced_sides = iter(reduced[len(bare) :])
    shown: dict[sp.Basic, sp.Basic] = {}
    for comparison in comparisons:
        left, right = next(reduced_sides), next(reduced_sides)
        shown[comparison] = comparison.func(left, right, evaluate=False)
    restored = {symbol: condition.xreplace(shown) for condition, symbol in conditions.items()}

    def show(value: sp.Basic) -> sp.Basic:
        if isinstance(value, _Select):
            stand_in, a, b = value.args
            return sp.Piecewise((show(a), show(restored[stand_in])), (show(b), True), evaluate=False)
        if isinstance(value, sp.Symbol) and value in restored:
            return show(restored[value])
        if not value.args or not value.has(_Select):
            return value
        return value.func(*(show(argument) for argument in value.args))

    definitions = {symbol: show(value) for symbol, value in shared}
    # a negated symbol is a sign in the sum that uses it, not a step
    opposite: dict[sp.Symbol, sp.Basic] = {}
    for symbol, value in definitions.items():
        if isinstance(value, sp.Expr) and (-value).is_Symbol:
            opposite[symbol] = value.xreplace(opposite)
    definitions = {s: v.xreplace(opposite) for s, v in definitions.items() if s not in opposite}
    values = (show(value).xreplace(opposite) for value in reduced[: len(bare)])
    result = [(symbol, value) for (symbol, _), value in zip(steps, values, strict=True)]
    return list(_ordered(result, definitions))


def _hide_conditions(value: sp.Basic, conditions: dict[Boolean, sp.Symbol]) -> sp.Basic:
    if isinstance(value, Boolean) and not isinstance(value, sp.Symbol):
        return conditions.setdefault(value, sp.Symbol(f"_condition_{len(conditions)}"))
    if isinstance(value, sp.Piecewise):
        *cases, (last, otherwise) = value.args
        if otherwise is not sp.true:
            raise ValueError(f"a select needs a value for every case: {value}")
        hidden = _hide_conditions(last, conditions)
        for case, condition in reversed(cases):
            stand_in = conditions.setdefault(condition, sp.Symbol(f"_condition_{len(conditions)}"))
            hidden = _Select(stand_in, _hide_conditions(case, conditions), hidden)
        return hidden
    if not value.args or not value.has(sp.Piecewise):
        return value
    return value.func(*(_hide_conditions(argument, conditions) for argument in value.args))


def _ordered(steps: Sequence[Pair], definitions: dict[sp.Symbol, sp.Basic]) -> Iterator[Pair]:
    """Put each shared definition right before its first use."""
    done: set[sp.Symbol] = set()

    def needed(value: sp.Basic) -> Iterator[Pair]:
        for symbol in sorted(value.free_symbols & set(definitions), key=lambda s: int(s.name[1:])):
            if symbol not in done:
                done.add(symbol)
                yield from needed(definitions[symbol])
                yield symbol, definitions[symbol]

    for symbol, value in steps:
        yield from needed(value)
        yield symbol, value
