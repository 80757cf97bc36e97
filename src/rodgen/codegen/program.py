"""A straight-line program as plain data: what a kernel over rows is, before it runs anywhere."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

__all__ = ["Operand", "Program", "programs_from", "text_of"]

Operand: TypeAlias = int | float
"""The number of an operation, or a float: a constant."""


@dataclass(frozen=True)
class Program:
    """A straight-line program over rows.

    Attributes
    ----------
    name : str
    inputs, outputs : dict of str to tuple of int
        The shapes of the ports; the first input is that of the rows, the others are the same for all rows.
    operations : list of sequences
        The name of each and its operands; ``("input", port, component)`` for a number of an input.
    results : dict of str to list of operands
        The components of each output.
    """

    name: str
    inputs: dict[str, tuple[int, ...]]
    outputs: dict[str, tuple[int, ...]]
    operations: list[Sequence[Any]]
    results: dict[str, list[Operand]]

    @cached_property
    def shared(self) -> list[bool]:
        """Whether each operation has one result for all rows."""
        rows, found = next(iter(self.inputs)), list[bool]()
        for op, *args in self.operations:
            found.append(
                args[0] != rows if op == "input" else all(found[a] for a in args if isinstance(a, int))
            )
        return found

    @property
    def operations_of_a_row(self) -> dict[str, int]:
        """How often each operation is done for a row."""
        operations = zip(self.operations, self.shared, strict=True)
        return Counter(op for (op, *_), shared in operations if not shared and op != "input")

    @property
    def columns(self) -> int:
        """Columns of the Jacobian where the outputs are residuals, (m,), and their Jacobian, (m, columns), else 0."""
        match list(self.outputs.values()):
            case [(height,), (rows, columns)] if rows == height:
                return columns
        return 0

    @property
    def width(self) -> int:
        """The least number of columns, in blocks of four, that holds Jacobian and residual; 0 without a Jacobian."""
        return -(-(self.columns + 1) // 4) * 4 if self.columns else 0

    @property
    def about(self) -> dict[str, Any]:
        """What a caller must know: the shapes of the ports, and how many columns a Jacobian has."""
        return {
            "inputs": list(self.inputs.items()),
            "outputs": list(self.outputs.items()),
            "columns": self.columns,
            "width": self.width,
        }


def text_of(programs: Sequence[Program]) -> str:
    """Return programs as text."""
    return json.dumps([[p.name, p.inputs, p.outputs, p.operations, p.results] for p in programs])


def programs_from(text: str) -> list[Program]:
    """Return the programs that :func:`text_of` wrote."""
    return [
        Program(name, _shapes(inputs), _shapes(outputs), operations, results)
        for name, inputs, outputs, operations, results in json.loads(text)
    ]


def _shapes(ports: dict[str, list[int]]) -> dict[str, tuple[int, ...]]:
    return {port: tuple(shape) for port, shape in ports.items()}
