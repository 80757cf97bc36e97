"""The text of kernels over many rows: C with vectors, or NumPy.

A kernel falls into two parts. What depends on the shared inputs alone is computed once for all rows; the rest once a
row, in C with one vector for the values of several rows.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import sympy as sp
from sympy.core.relational import Relational
from sympy.printing.precedence import PRECEDENCE

from rodgen.codegen._count import called_functions, count_operations, operations_text
from rodgen.codegen._numbering import Pair, joined, numbered
from rodgen.codegen.kernel import Kernel
from rodgen.codegen.kernel_parts import Assignment, KernelError, Port, live_steps
from rodgen.codegen.lines import released
from rodgen.codegen.printers import ELEMENTARY, CPrinter, KernelPrinter, NumPyPrinter
from rodgen.codegen.source_files import DO_NOT_EDIT, ENVIRONMENT, scale_functions
from rodgen.symbolic import EPS, LARGEST

__all__ = ["c_source", "numpy_source"]


@dataclass(frozen=True)
class SplitKernel:
    """A kernel over rows: its lines once a call, and its lines once a row; those of the outputs are among these."""

    kernel: Kernel
    rows: Port
    shared: tuple[Port, ...]
    once: tuple[Pair, ...]
    each: tuple[Pair, ...]

    @property
    def operations(self) -> str:
        """Operations once a row."""
        return operations_text(count_operations(value for _, value in self.each))

    @property
    def columns(self) -> int:
        """Columns of the Jacobian where the outputs are residuals, (m,), and their Jacobian, (m, columns), else 0."""
        match [port.shape for port in self.kernel.outputs]:
            case [(height,), (rows, columns)] if rows == height:
                return columns
        return 0

    @property
    def width(self) -> int:
        """The least number of columns of blocks of four that holds Jacobian and residual, 0 where there is none."""
        return -(-(self.columns + 1) // 4) * 4 if self.columns else 0

    def place(self, output: int, component: int) -> str:
        """Return where C keeps a result: residuals in the column after those of the Jacobian."""
        if not self.columns:
            return f"{output}[{component}]"
        row, column = divmod(component, self.columns) if output else (component, self.columns)
        return f"[{self.width * row + column}]"


def _split(kernel: Kernel, shared: Collection[str]) -> SplitKernel:
    rows, *others = kernel.inputs
    strange = [p.name for p in others if p.name not in shared] + [rows.name] * (rows.name in shared)
    if strange:
        raise KernelError(
            f"kernel {kernel.name}: {', '.join(strange)} is out of place; expected one for the rows, then shared ones"
        )
    for port in kernel.outputs:
        if port.is_status:
            raise KernelError(f"kernel {kernel.name}: {port.name} is a status; expected numbers")
    same = {EPS, LARGEST, *(s for p in others for s in p.symbols)}
    numbering = numbered(kernel, kernel.outputs, invariant=same)
    results = [(s, numbering.operand(s)) for p in kernel.outputs for s in p.symbols]
    once = [line for line in numbering.lines if line[0] in numbering.invariant]
    each = [line for line in numbering.lines if line[0] not in numbering.invariant] + results
    used = {s for _, value in each for s in value.free_symbols} | {s for s, _ in results}
    once = live_steps(once, used)
    return SplitKernel(
        kernel,
        rows,
        tuple(others),
        tuple(joined(once, used)),
        tuple(
            _outputs_early(
                list(joined(live_steps(each, used), {s for s, _ in results})), {s for s, _ in results}
            )
        ),
    )


def _outputs_early(lines: Sequence[Pair], results: Collection[sp.Symbol]) -> Iterator[Pair]:
    """Put the line of each output right after those that it needs, so that they need not be kept."""
    place = {symbol: n for n, (symbol, _) in enumerate(lines)}
    after: dict[int, list[Pair]] = {}
    for symbol, value in lines:
        if symbol in results:
            last = max((place.get(s, -1) for s in value.free_symbols), default=-1)
            after.setdefault(last, []).append((symbol, value))
    yield from after.get(-1, [])
    for n, (symbol, value) in enumerate(lines):
        if symbol not in results:
            yield symbol, value
            yield from after.get(n, [])


def _about(kernels: Sequence[SplitKernel]) -> dict[str, Any]:
    """Return what a caller must know: the shapes of the ports, and the columns of a Jacobian."""
    return {
        p.kernel.name: {
            "inputs": [(port.name, port.shape) for port in p.kernel.inputs],
            "outputs": [(port.name, port.shape) for port in p.kernel.outputs],
            "columns": p.columns,
        }
        for p in kernels
    }


def _description(split: SplitKernel) -> dict[str, Any]:
    return {
        "name": split.kernel.name,
        "operations": split.operations,
        "inputs": [f"{n} {port.name}" for n, port in enumerate(split.kernel.inputs)],
        "outputs": [f"{n} {port.name}" for n, port in enumerate(split.kernel.outputs)],
    }


def _results(split: SplitKernel) -> Iterator[tuple[int, int, sp.Symbol]]:
    """Yield the number of the output, that of the component, and its symbol."""
    for n, port in enumerate(split.kernel.outputs):
        for i, symbol in enumerate(port.symbols):
            yield n, i, symbol


def _functions(kernels: Sequence[SplitKernel]) -> set[str]:
    return called_functions(value for p in kernels for _, value in (*p.once, *p.each))


# C -------------------------------------------------------------------------------------------------------

LANEWISE = {
    **{name: (name, ("x", "y") if name == "atan2" else ("x",)) for name in ELEMENTARY},
    "power_of_two_scale": ("power_of_two_scale_f64", ("x",)),
}


class LanesPrinter(CPrinter):
    """GNU C on vectors of lanes; a part without a symbol of the rows is a number.

    A rational factor is a constant to multiply with: vectors are divided slowly.
    """

    conjunction, disjunction, negation = (
        KernelPrinter.conjunction,
        KernelPrinter.disjunction,
        KernelPrinter.negation,
    )
    functions: ClassVar[dict[str, str]] = {
        **{name: f"lanes_{name}" for name in LANEWISE},
        "Abs": "lanes_magnitude",
        "sign": "lanes_sign",
    }

    def __init__(self, same: Collection[sp.Symbol]) -> None:
        super().__init__()
        self.same = same

    def _as_ordered_terms(self, expr: sp.Add, order: str | None = None) -> list[sp.Expr]:
        return list(
            expr.args
        )  # in the order in which SymPy keeps them: sorting takes half the time of printing

    def is_same(self, value: sp.Basic) -> bool:
        """Whether the value is one for all rows."""
        return bool(value.free_symbols <= self.same)

    def whole(self, value: sp.Basic) -> str:
        """Write a value as a vector."""
        text = str(self._print(value))
        return f"WHOLE({text})" if self.is_same(value) else text

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return _name(expr, self.constants)

    def square_root(self, argument: str) -> str:
        """Write a square root; those of numbers are in other lines."""
        return f"lanes_root({argument})"

    def power(self, base: str, exponent: str) -> str:
        """Write a general power."""
        return f"lanes_pow(WHOLE({base}), WHOLE({exponent}))"

    def _print_Function(self, expr: sp.Function) -> str:
        name = self.functions.get(type(expr).__name__)
        if name is None:
            return str(super()._print_Function(expr))
        return f"{name}({', '.join(map(self.whole, expr.args))})"

    def _print_Mul(self, expr: sp.Mul) -> str:
        factor, rest = expr.as_coeff_Mul()
        q = int(factor.q)
        if q & (q - 1) == 0:
            return str(super()._print_Mul(expr))
        sign, p = ("-", -factor.p) if factor.p < 0 else ("", factor.p)
        return f"{sign}({self.number(int(p))}/{self.number(q)})*{self.parenthesize(rest, PRECEDENCE['Mul'])}"

    def _print_Piecewise(self, expr: sp.Piecewise) -> str:
        *cases, (last, _) = expr.args
        text = self.whole(last)
        for value, condition in reversed(cases):
            holds = self._print(condition)
            holds = f"WHOLE_MASK({holds})" if self.is_same(condition) else holds
            text = f"lanes_blend({holds}, {self.whole(value)}, {text})"
        return text

    def _print_BooleanTrue(self, expr: sp.Basic) -> str:
        return "(int64_t)-1"

    def _print_BooleanFalse(self, expr: sp.Basic) -> str:
        return "(int64_t)0"

    def _print_Relational(self, expr: Relational) -> str:
        text = super()._print_Relational(expr)
        return f"-(int64_t)({text})" if self.is_same(expr) else f"({text})"


class NumberPrinter(CPrinter):
    """C of what is one number for all rows; its conditions are all ones or all zeros, as the lanes' are."""

    functions: ClassVar[dict[str, str]] = {**CPrinter.functions, "sign": "sign_of_number"}

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return _name(expr, self.constants)


def c_source(kernels: Sequence[Kernel], shared: Collection[str]) -> str:
    """Return C whose functions ``rows_KERNEL`` evaluate kernels over many rows."""
    parts = [_split(kernel, shared) for kernel in kernels]
    functions = _functions(parts)
    lanewise = [(name, *LANEWISE[name]) for name in sorted(functions & LANEWISE.keys() - {"sin", "cos"})]
    lanewise.append(("pow", "pow", ("x", "y")))
    return ENVIRONMENT.get_template("rows.c.j2").render(
        do_not_edit=DO_NOT_EDIT,
        template="rows.c.j2",
        kernels=[_c_kernel(p) for p in parts],
        about=json.dumps(json.dumps(_about(parts))),
        functions=functions,
        lanewise=lanewise,
        scale_functions=scale_functions(["f64"]),
    )


def _c_kernel(split: SplitKernel) -> dict[str, Any]:
    same = {EPS, LARGEST, *(s for p in split.shared for s in p.symbols), *(s for s, _ in split.once)}
    used = {s for _, value in (*split.once, *split.each) for s in value.free_symbols}
    number = NumberPrinter()
    once = [
        f"const double {_name(s)} = in{n}[{i}];"
        for n, p in enumerate(split.shared, 1)
        for i, s in enumerate(p.symbols)
        if s in used
    ]
    once += [f"(void)in{n};" for n, p in enumerate(split.shared, 1) if not used & set(p.symbols)]
    for symbol, value in split.once:
        text = number.line(value)
        condition = Assignment(symbol, value).is_condition
        once.append(
            f"const int64_t {_name(symbol)} = -(int64_t)({text});"
            if condition
            else f"const double {_name(symbol)} = {text};"
        )
    lines = [f"const vec {_name(s)} = row[{i}];" for i, s in enumerate(split.rows.symbols) if s in used]
    lines += _lane_lines(split, LanesPrinter(same))
    inputs = range(1 + len(split.shared))
    given = ", ".join(f"const double *in{n}" for n in inputs)
    return {
        **_description(split),
        "given": given,
        "prototype": ", ".join([given, *(f"double *out{n}" for n in range(len(split.kernel.outputs)))]),
        "arguments": ", ".join(f"in{n}" for n in inputs),
        "rows": split.rows.size,
        "sizes": [p.size for p in split.kernel.outputs],
        "columns": split.columns,
        "width": split.width,
        "once": once,
        "lines": lines,
        "circular": any("lanes_sine_cosine" in line for line in lines),
    }


def _lane_lines(split: SplitKernel, printer: LanesPrinter) -> Iterator[str]:
    """Write the lines of a row; sine and cosine of one angle come together."""
    pairs: dict[sp.Symbol, dict[type, str]] = {}
    for symbol, value in split.each:
        if isinstance(value, sp.sin | sp.cos):
            pairs.setdefault(value.args[0], {})[type(value)] = _name(symbol)
    places = {s: f"result{split.place(n, i)}" for n, i, s in _results(split)}
    for symbol, value in split.each:
        if isinstance(value, sp.sin | sp.cos):
            angle = value.args[0]
            if angle in pairs:
                pair = pairs.pop(angle)
                sine, cosine = (pair.get(f, f"{f.__name__}_{_name(angle)}_") for f in (sp.sin, sp.cos))
                yield f"vec {sine}, {cosine};"
                yield f"lanes_sine_cosine({_name(angle)}, &{sine}, &{cosine}, &far, use_libm);"
            continue
        text = printer.line(value)
        if symbol in places:
            yield f"{places[symbol]} = {f'WHOLE({text})' if printer.is_same(value) else text};"
        else:
            kind = "mask" if Assignment(symbol, value).is_condition else "vec"
            yield f"const {kind} {_name(symbol)} = {text};"


def _name(symbol: sp.Symbol, constants: Mapping[sp.Symbol, str] = MappingProxyType({})) -> str:
    """Return a name that nothing else in the file has: a user may call an angle `sin`, and a force `load`."""
    return constants.get(symbol) or f"{symbol.name}_"


# NumPy ---------------------------------------------------------------------------------------------------


class ColumnsPrinter(NumPyPrinter):
    """NumPy on columns, with the names of this file."""

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return _name(expr, {EPS: "eps", LARGEST: "largest"})


def numpy_source(kernels: Sequence[Kernel], shared: Collection[str]) -> str:
    """Return Python whose functions ``rows_KERNEL`` evaluate kernels on columns, and fill columns of the outputs."""
    parts = [_split(kernel, shared) for kernel in kernels]
    return ENVIRONMENT.get_template("rows.py.j2").render(
        do_not_edit=DO_NOT_EDIT,
        template="rows.py.j2",
        kernels=[_numpy_kernel(p) for p in parts],
        about=repr(json.dumps(_about(parts))),
        functions=_functions(parts),
    )


def _numpy_kernel(split: SplitKernel) -> dict[str, Any]:
    inputs, outputs = 1 + len(split.shared), len(split.kernel.outputs)
    return {
        **_description(split),
        "arguments": ", ".join([f"in{n}" for n in range(inputs)] + [f"out{n}" for n in range(outputs)]),
        "lines": list(_numpy_lines(split)),
    }


def _numpy_lines(split: SplitKernel) -> Iterator[str]:
    """Yield the lines; each array is deleted after its last use."""
    printer = ColumnsPrinter()
    lines = (*split.once, *split.each)
    used = {s for _, value in lines for s in value.free_symbols}
    for n, port in enumerate((split.rows, *split.shared)):
        yield from (f"{_name(s)} = in{n}[{i}]" for i, s in enumerate(port.symbols) if s in used)
    places = {s: f"out{n}[{i}]" for n, i, s in _results(split)}
    for (symbol, value), done in zip(lines, released(lines, {EPS, LARGEST}), strict=True):
        yield f"{places.get(symbol) or _name(symbol)} = {printer.line(value)}"
        if done:
            yield f"del {', '.join(map(_name, done))}"
