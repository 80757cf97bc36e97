"""Derivatives of a kernel, made from the kernel.

Forward accumulation: for each assignment ``s = f(a, b)`` the program gains
``ds/dx = df/da * da/dx + df/db * db/dx`` for every input component x on which s depends. Local derivatives
are small, so nothing swells; what is computed twice is shared afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import count

import sympy as sp

from rodgen.codegen.kernel_parts import Assignment, KernelError, Port, StraightLine, port_symbols


def derivatives(
    kernel: StraightLine, inputs: Sequence[str], outputs: Sequence[str]
) -> tuple[list[Port], list[Assignment]]:
    """Return the ports of the derivatives of `outputs` with respect to `inputs`, and the steps that compute them.

    See :meth:`rodgen.codegen.Kernel.jacobian`. The steps compute the kernel's own outputs, too.

    Raises
    ------
    KeyError
        For a name that is not a port of the kernel.
    KernelError
        When a status is to be differentiated.
    """
    variables = [s for n in inputs for s in kernel.port(n).symbols]
    differentiated = [kernel.port(n) for n in outputs]
    if any(port.is_status for port in differentiated):
        raise KernelError(f"kernel {kernel.name}: a status has no derivative")

    ports = []
    for port in differentiated:
        shape = (*port.shape, len(variables))
        symbols = port_symbols(f"{port.name}_jacobian", shape)
        unit = f"{port.unit} per unit of {', '.join(inputs)}"
        doc = f"derivative of {port.name}; last axis: {', '.join(x.name for x in variables)}"
        ports.append(Port(f"{port.name}_jacobian", shape, unit, doc, symbols))

    rows = [s for port in differentiated for s in port.symbols]
    steps, slopes = _forward(kernel, rows, variables)
    entries = [s for port in ports for s in port.symbols]
    steps += [Assignment(s, v) for s, v in zip(entries, (v for row in slopes for v in row), strict=True)]
    return ports, steps


def _forward(
    kernel: StraightLine, outputs: Sequence[sp.Symbol], variables: Sequence[sp.Symbol]
) -> tuple[list[Assignment], list[list[sp.Expr]]]:
    """Return the program with its derivatives, and those of each output with respect to each variable."""
    steps: list[Assignment] = []
    # tangent[s][x] is the symbol (or number) that holds ds/dx; what is absent is zero
    tangent: dict[sp.Symbol, dict[sp.Symbol, sp.Expr]] = {x: {x: sp.S.One} for x in variables}
    for symbol, value in _with_selects_on_their_own_lines(kernel):
        steps.append(Assignment(symbol, value))
        if steps[-1].is_condition:
            continue
        of_symbol: dict[sp.Symbol, sp.Expr] = {}
        for x in variables:
            slope = _slope(value, x, tangent)
            if slope.is_zero:
                continue
            if slope.is_Number or slope.is_Symbol:
                of_symbol[x] = slope
                continue
            derivative = sp.Symbol(f"d_{symbol.name}_d_{x.name}", real=True)
            steps.append(Assignment(derivative, slope))
            of_symbol[x] = derivative
        tangent[symbol] = of_symbol
    return steps, [[tangent.get(s, {}).get(x, sp.S.Zero) for x in variables] for s in outputs]


def _slope(value: sp.Expr, x: sp.Symbol, tangent: Mapping[sp.Symbol, Mapping[sp.Symbol, sp.Expr]]) -> sp.Expr:
    """Differentiate one line by the chain rule; a select keeps its condition and takes one slope of two.

    A slope is never multiplied by a truth value: the branch that is not taken may be infinite.
    """
    if value is sp.nan:
        return value
    if isinstance(value, sp.Piecewise):
        cases = [(_slope(case, x, tangent), condition) for case, condition in value.args]
        if all(slope.is_zero or slope is sp.nan for slope, _ in cases):
            return sp.S.Zero
        return sp.Piecewise(*cases, evaluate=False)
    moving = sorted((s for s in value.free_symbols if x in tangent.get(s, {})), key=lambda s: str(s.name))
    return sp.Add(*(_slope_of(value, s) * tangent[s][x] for s in moving))


def _slope_of(value: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """Return the derivative; that of sign() is 0, also at 0."""
    slope = value.diff(symbol)
    return slope.replace(sp.DiracDelta, lambda *_: sp.S.Zero) if slope.has(sp.DiracDelta) else slope


def _with_selects_on_their_own_lines(kernel: StraightLine) -> Iterator[tuple[sp.Symbol, sp.Basic]]:
    """Yield the kernel's lines with every inner select moved to a line of its own."""
    lines: list[tuple[sp.Symbol, sp.Basic]] = []
    names = (sp.Symbol(f"select_{n}", real=True) for n in count())

    def bare(value: sp.Basic, *, outermost: bool = False) -> sp.Basic:
        if not value.has(sp.Piecewise):
            return value
        if isinstance(value, sp.Piecewise):
            value = sp.Piecewise(*((bare(case), bare(c)) for case, c in value.args), evaluate=False)
            if outermost:
                return value
            name = next(names)
            lines.append((name, value))
            return name
        return value.func(*(bare(argument) for argument in value.args))

    for assignment in kernel.assignments:
        value = bare(assignment.value, outermost=True)
        yield from lines
        lines.clear()
        yield assignment.symbol, value
