"""What the template of an emitted test writes: samples, equations, derivatives."""

from __future__ import annotations

from typing import Any

from rodgen.codegen._equations import periods
from rodgen.codegen.kernel import Kernel
from rodgen.codegen.printers import ArrayPrinter


def data_of_tests(kernels: tuple[Kernel, ...]) -> dict[str, Any]:
    """Return what test.py.j2 needs of the kernels whose inputs all have a domain; empty if no kernel has."""
    sampled = {k.name: k for k in kernels if k.inputs and all(p.between is not None for p in k.inputs)}
    if not sampled:
        return {}
    equations = [made for kernel in sampled.values() if (made := _equations(kernel))]
    derivatives = [made for kernel in sampled.values() if (made := _derivative(kernel, sampled))]
    return {
        "kernels": [
            {
                "name": kernel.name,
                "inputs": [(p.name, p.shape, *map(float, p.between or ())) for p in kernel.inputs],
                "outputs": [
                    (p.name, p.shape, p.is_status, periods(kernel).get(p.name)) for p in kernel.outputs
                ],
            }
            for kernel in sampled.values()
        ],
        "equations": equations,
        "complete": any(e["complete"] for e in equations),
        "nowhere": any(e["nowhere"] for e in equations),
        "derivatives": derivatives,
    }


def _equations(kernel: Kernel) -> dict[str, Any] | None:
    if kernel.equations is None:
        return None
    given, printer = kernel.equations, ArrayPrinter()
    residuals = given.residuals
    unknowns = residuals.inputs[len(kernel.inputs) :]
    ports = {p.name: p for p in residuals.outputs}
    return {
        "kernel": kernel.name,
        "function": residuals.name,
        "components": ", ".join(s.name for p in residuals.inputs for s in p.symbols),
        "lines": [f"{a.symbol.name} = {printer.line(a.value)}" for a in residuals.assignments],
        "residual": ", ".join(s.name for s in ports["residual"].symbols),
        "size": ", ".join(s.name for s in ports["size"].symbols),
        "count": ports["residual"].size,
        "unknowns": [(p.name, p.size, periods(kernel).get(p.name)) for p in unknowns],
        "solutions": given.solutions,
        "where": _codes(given.where),
        "nowhere": _codes(given.nowhere),
        "complete": given.complete,
        "tolerance": float(given.tolerance),
    }


def _derivative(kernel: Kernel, others: dict[str, Kernel]) -> dict[str, Any] | None:
    """Return in which kernel the differentiated outputs are; None if no emitted kernel has them."""
    given = kernel.derivative
    if given is None:
        return None
    if set(given.outputs) <= {p.name for p in kernel.outputs}:
        of = kernel
    elif given.of in others:
        of = others[given.of]
    else:
        return None
    return {
        "kernel": kernel.name,
        "of": of.name,
        "outputs": [(name, periods(of).get(name)) for name in given.outputs],
        "wrt": list(given.wrt),
        "where": _codes(given.where),
    }


def _codes(statuses: tuple[Any, ...]) -> list[int]:
    return [int(status) for status in statuses]
