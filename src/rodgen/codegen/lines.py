"""The lines of a kernel in each language."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set

import sympy as sp

from rodgen.codegen.kernel import Kernel
from rodgen.codegen.printers import ArrayPrinter, CPrinter
from rodgen.codegen.source_text import operations_text
from rodgen.symbolic import EPS, LARGEST


def symbols_read(kernel: Kernel) -> set[sp.Symbol]:
    """Return the symbols on the right side of the assignments."""
    return {s for a in kernel.assignments for s in a.value.free_symbols}


def operation_counts(kernel: Kernel) -> str:
    """Return the numbers of operations of a kernel as text, such as ``3 add, 6 mul``."""
    return operations_text(kernel.operations)


def released(lines: Sequence[tuple[sp.Symbol, sp.Basic]], kept: Set[sp.Symbol]) -> Iterator[list[sp.Symbol]]:
    """Yield for each line the symbols that no later line uses, except those to keep: their memory can be used again."""
    last_use = {symbol: n for n, (_, value) in enumerate(lines) for symbol in value.free_symbols}
    for n, (_, value) in enumerate(lines):
        done = (symbol for symbol in value.free_symbols - kept if last_use[symbol] == n)
        yield sorted(done, key=lambda symbol: str(symbol.name))


def numpy_lines(kernel: Kernel, printer: ArrayPrinter) -> Iterator[str]:
    """Yield the assignments in Python, on arrays; each is deleted after its last use."""
    kept = {EPS, LARGEST, *(s for p in (*kernel.inputs, *kernel.outputs) for s in p.symbols)}
    for (symbol, value), done in zip(kernel.assignments, released(kernel.assignments, kept), strict=True):
        yield f"{symbol.name} = {printer.line(value)}"
        if done:
            yield f"del {', '.join(s.name for s in done)}"


def c_lines(kernel: Kernel, printer: CPrinter) -> tuple[list[str], list[str]]:
    """Return the lines of C or C++ that compute, and those that store the outputs."""
    targets = {s: (printer.component(p, i), p) for p in kernel.outputs for i, s in enumerate(p.symbols)}
    used_later = symbols_read(kernel)
    # a number's output is a pointer of that name; where the number is read again it has a name of its own
    renamed = {
        s: type(s)(f"{s.name}_value", real=True)
        for s, (_, port) in targets.items()
        if s in used_later and port.shape == ()
    }
    body, stores = [], []
    for assignment in kernel.assignments:
        symbol, text = assignment.symbol, printer.line(assignment.value.xreplace(renamed))
        if symbol not in targets:
            kind = printer.condition if assignment.is_condition else printer.real
            body.append(f"const {kind} {symbol.name} = {text};")
            continue
        target, port = targets[symbol]
        if symbol in used_later or (port.shape == () and port.is_status):
            name = f"{symbol.name}_value" if port.shape == () else symbol.name
            body.append(f"const {printer.real} {name} = {text};")
            text = name
        stores.append(f"{target} = {printer.code(port, text) if port.is_status else text};")
    return body, stores
