"""Kernels as programs over rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from fractions import Fraction
from functools import reduce
from operator import add, mul
from typing import Any

import numpy as np
import sympy as sp
from sympy.core.relational import Relational

from rodgen.codegen.kernel import Kernel
from rodgen.codegen.kernel_parts import KernelError
from rodgen.codegen.program import Program
from rodgen.codegen.tape import Tape, absolute, select
from rodgen.symbolic import EPS, LARGEST

_NAMES = {"power_of_two_scale": "scale"}
_COMPARISONS: dict[str, tuple[str, bool]] = {
    "<": ("lt", False),
    "<=": ("le", False),
    ">": ("lt", True),
    ">=": ("le", True),
    "==": ("eq", False),
    "!=": ("ne", False),
}
"""The operation of each comparison, and whether its sides are exchanged."""


def programs_of(kernels: Sequence[Kernel], shared: Collection[str]) -> list[Program]:
    """Return kernels as programs whose first input is that of the rows, and the others are `shared`.

    Raises
    ------
    KernelError
        When an input is neither the first nor shared, or an output is a status.
    """
    return [_program(kernel, shared) for kernel in kernels]


def _program(kernel: Kernel, shared: Collection[str]) -> Program:
    rows, *others = kernel.inputs
    strange = [p.name for p in others if p.name not in shared] + [rows.name] * (rows.name in shared)
    if strange:
        raise KernelError(
            f"kernel {kernel.name}: {', '.join(strange)} is out of place; expected one for the rows, then shared ones"
        )
    for port in kernel.outputs:
        if port.is_status:
            raise KernelError(f"kernel {kernel.name}: {port.name} is a status; expected numbers")
    tape = Tape()
    about = np.finfo(np.float64)
    known: dict[sp.Symbol, Any] = {EPS: float(about.eps), LARGEST: float(about.max)}
    for port in kernel.inputs:
        known.update(zip(port.symbols, tape.inputs(port.name, port.size, same=port is not rows), strict=True))
    for symbol, value in kernel.assignments:
        known[symbol] = _value(tape, value, known)
    return tape.program(
        kernel.name,
        {port.name: port.shape for port in kernel.inputs},
        {port.name: (port.shape, [known[s] for s in port.symbols]) for port in kernel.outputs},
    )


def _value(tape: Tape, tree: sp.Basic, known: dict[sp.Symbol, Any]) -> Any:
    """Write an expression or a condition into a tape."""
    if isinstance(tree, sp.Symbol):
        return known[tree]
    if isinstance(tree, sp.Rational):
        return Fraction(int(tree.p), int(tree.q))
    if tree in (sp.true, sp.false):
        return tree is sp.true
    if isinstance(tree, sp.NumberSymbol):
        return float(tree)
    if not tree.args:  # infinite, or no number
        return math.nan
    if isinstance(tree, sp.Piecewise):
        *cases, (last, _) = tree.args
        value = _value(tape, last, known)
        for case, condition in reversed(cases):
            value = select(_value(tape, condition, known), _value(tape, case, known), value)
        return value
    args = [_value(tape, part, known) for part in tree.args]
    if isinstance(tree, Relational):
        op, exchanged = _COMPARISONS[tree.rel_op]
        return tape.number(op, *(_float(x) for x in (reversed(args) if exchanged else args)))
    if isinstance(tree, sp.ITE):  # SymPy makes this of a select inside a condition
        condition, yes, no = args
        return _either(tape, _both(tape, condition, yes), _both(tape, _not(tape, condition), no))
    operation = _OPERATIONS.get(type(tree))
    return (
        operation(tape, *args)
        if operation
        else tape.number(_NAMES.get(name := type(tree).__name__, name), *map(_float, args))
    )


def _float(x: Any) -> Any:
    return float(x) if isinstance(x, Fraction) else x


def _both(tape: Tape, a: Any, b: Any) -> Any:
    if isinstance(a, bool) or isinstance(b, bool):
        return (b if a else False) if isinstance(a, bool) else (a if b else False)
    return tape.number("and", a, b)


def _not(tape: Tape, a: Any) -> Any:
    return not a if isinstance(a, bool) else tape.number("not", a)


def _either(tape: Tape, a: Any, b: Any) -> Any:
    return _not(tape, _both(tape, _not(tape, a), _not(tape, b)))


_OPERATIONS: dict[type, Callable[..., Any]] = {
    sp.Add: lambda tape, *args: reduce(add, args),
    sp.Mul: lambda tape, *args: reduce(mul, args),
    sp.Pow: lambda tape, base, exponent: base**exponent,
    sp.Abs: lambda tape, x: absolute(x),
    sp.And: lambda tape, *args: reduce(lambda a, b: _both(tape, a, b), args),
    sp.Or: lambda tape, *args: reduce(lambda a, b: _either(tape, a, b), args),
    sp.Not: lambda tape, x: _not(tape, x),
}
