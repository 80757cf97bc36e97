"""Count the floating-point operations of expressions as the printers write them, and list the functions called."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import sympy as sp
from sympy.core.relational import Relational
from sympy.logic.boolalg import Boolean


def count_operations(values: Iterable[sp.Basic]) -> dict[str, int]:
    """Return the number of operations by kind, in a fixed order, zeros left out."""
    counts: Counter[str] = Counter()
    for value in values:
        _count(value, counts)
    first = ["add", "mul", "div", "sqrt", "select", "compare"]
    order = [*first, *sorted(set(counts) - set(first))]
    return {kind: counts[kind] for kind in order if counts[kind]}


def called_functions(values: Iterable[sp.Basic]) -> set[str]:
    """Return the names of all functions in the values, ``Piecewise``, ``Abs`` and ``sign`` among them."""
    return {type(f).__name__ for value in values for f in value.atoms(sp.Function)}


def _count(value: sp.Basic, counts: Counter[str]) -> None:
    if isinstance(value, sp.Piecewise):
        counts["select"] += len(value.args) - 1
    elif isinstance(value, Relational):
        counts["compare"] += 1
    elif isinstance(value, sp.Add):
        counts["add"] += len(value.args) - 1
    elif isinstance(value, sp.Mul):
        below = [a for a in value.args if isinstance(a, sp.Pow) and a.exp.is_negative]
        above = [a for a in value.args if a not in below and a is not sp.S.NegativeOne]
        counts["mul"] += max(len(above) - 1, 0) + max(len(below) - 1, 0)
        counts["div"] += bool(below)
        for factor in below:
            _count(factor.base**-factor.exp, counts)
        for factor in above:
            _count(factor, counts)
        return
    elif isinstance(value, sp.Pow):
        if value.exp.is_negative:
            counts["div"] += 1
            _count(value.base**-value.exp, counts)
            return
        if value.exp == sp.S.Half:
            counts["sqrt"] += 1
        elif value.exp.is_Integer:
            counts["mul"] += int(value.exp) - 1
        else:
            counts["pow"] += 1
        _count(value.base, counts)
        return
    elif isinstance(value, sp.Abs):
        counts["abs"] += 1
    elif isinstance(value, sp.Function):
        counts[type(value).__name__] += 1
    elif not isinstance(value, Boolean) and not value.args:
        return
    for argument in value.args:
        _count(argument, counts)
