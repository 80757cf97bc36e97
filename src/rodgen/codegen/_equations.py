"""The implicit equations of a kernel as a kernel of their own, from which its test is made."""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import IntEnum

import sympy as sp

from rodgen.codegen.kernel import Kernel
from rodgen.codegen.kernel_parts import Assignment, Equations, KernelError, Port, port_symbols, shortened
from rodgen.symbolic import explicit

_SMOOTH = (sp.sin, sp.cos, sp.tan, sp.sinh, sp.cosh, sp.tanh, sp.exp, sp.atan)


def equations_of(
    kernel: Kernel,
    equations: Iterable[sp.Basic],
    *,
    where: tuple[IntEnum, ...],
    nowhere: tuple[IntEnum, ...],
    complete: bool,
    tolerance: float,
) -> Equations:
    """Return the :class:`Equations` of a kernel; :meth:`rodgen.codegen.KernelBuilder.solves` explains the arguments.

    Raises
    ------
    KernelError
        When the equations name no output of the kernel, or are too few; when an input has no domain; when a status
        is not one of the kernel's.
    """
    complaint = f"kernel {kernel.name}: solves()"
    for port in kernel.inputs:
        if port.between is None:
            raise KernelError(
                f"{complaint} needs to know where {port.name} is sampled; give it between=(low, high)"
            )
    known = {port.enum for port in kernel.outputs if port.enum is not None}
    for status in (*where, *nowhere):
        if type(status) not in known:
            raise KernelError(f"{complaint} names the status {status!r}, which is none of the kernel's")

    sides = [side for equation in equations for side in _sides(equation)]
    names = {symbol.name for pair in sides for side in pair for symbol in side.free_symbols}
    unknowns, solutions = _unknowns(kernel, names, complaint)
    count = sum(port.size for port in unknowns)
    if len(sides) < count:
        raise KernelError(
            f"{complaint} has {len(sides)} equations for {count} unknowns; expected at least {count}"
        )

    ours = {s.name: s for port in (*kernel.inputs, *unknowns) for s in port.symbols}
    steps: list[Assignment] = []
    residual, size = (port_symbols(name, (len(sides),)) for name in ("residual", "size"))
    for number, pair in enumerate(sides):
        left, right = (side.xreplace({s: ours[s.name] for s in side.free_symbols}) for side in pair)
        steps.append(Assignment(residual[number], left - right))
        steps.append(Assignment(size[number], _magnitude(left) + _magnitude(right)))
    inputs = (*kernel.inputs, *unknowns)
    outputs = (
        Port("residual", (len(sides),), "1", "left minus right side", residual),
        Port("size", (len(sides),), "1", "sum of the magnitudes of the terms", size),
    )
    residuals = Kernel(
        f"{kernel.name}_equations",
        f"The equations that {kernel.name} solves.",
        kernel.source,
        inputs,
        outputs,
        shortened(inputs, outputs, steps),
    )
    return Equations(
        residuals, tuple(port.name for port in unknowns), solutions, where, nowhere, complete, tolerance
    )


def _sides(equation: sp.Basic) -> list[tuple[sp.Expr, sp.Expr]]:
    """Write an equation in components: left and right side of each."""
    parts = equation.args if isinstance(equation, sp.Eq) else (equation, None)
    left, right = (None if part is None else explicit(part) for part in parts)
    if not isinstance(left, sp.MatrixBase):
        return [(sp.sympify(left), sp.S.Zero if right is None else right)]
    return list(zip(left, sp.zeros(*left.shape) if right is None else right, strict=True))


def _unknowns(kernel: Kernel, names: set[str], complaint: str) -> tuple[list[Port], int | None]:
    """Return the outputs that the equations name, as ports of one solution, and the number of solutions."""
    left = names - {s.name for port in kernel.inputs for s in port.symbols}
    found: list[Port] = []
    counts: set[int | None] = set()
    for port in kernel.outputs:
        for shape, count in ((port.shape, None), (port.shape[1:], port.shape[0] if port.shape else None)):
            symbols = port_symbols(port.name, shape)
            if not port.is_status and left & {s.name for s in symbols}:
                found.append(Port(port.name, shape, port.unit, port.doc, symbols))
                counts.add(count)
                left -= {s.name for s in symbols}
                break
    if left:
        raise KernelError(
            f"{complaint} names {', '.join(sorted(left))}; expected inputs and real outputs only"
        )
    if not found:
        raise KernelError(f"{complaint} has equations without an output in them")
    if len(counts) > 1:
        raise KernelError(f"{complaint} mixes outputs of {' and '.join(sorted(map(str, counts)))} solutions")
    return found, counts.pop()


def _magnitude(value: sp.Expr) -> sp.Expr:
    """Bound the rounding of `value`, in roundings of its numbers: every term and every slope taken positive."""
    if isinstance(value, sp.Add):
        return sp.Add(*(_magnitude(part) for part in value.args))
    if isinstance(value, sp.Mul):
        return sp.Mul(*(_magnitude(part) for part in value.args))
    if isinstance(value, sp.Pow) and value.exp.is_Integer and value.exp.is_positive:
        return _magnitude(value.base) ** value.exp
    if isinstance(value, _SMOOTH):
        argument = sp.Dummy(real=True)
        slope = value.func(argument).diff(argument).xreplace({argument: value.args[0]})
        # sin(pi) is zero to the rounding of pi only
        return abs(value) + abs(slope) * _magnitude(value.args[0])
    return abs(value)


def periods(kernel: Kernel) -> dict[str, float]:
    """Return the period of each output that is an angle, by its unit."""
    turns = {"rad": 2 * math.pi, "deg": 360.0}
    return {port.name: turns[port.unit] for port in kernel.outputs if port.unit in turns}
