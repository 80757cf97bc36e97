"""A straight-line program as plain data: what a kernel over rows is, before it runs anywhere."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

Operand: TypeAlias = int | float
"""The number of an operation, or a float: a constant."""

GIVEN = frozenset({"input", "seed"})
"""Operations whose operands are not results of other operations."""


@dataclass(frozen=True)
class Program:
    """A straight-line program over rows."""

    name: str
    inputs: dict[str, tuple[int, ...]]
    outputs: dict[str, tuple[int, ...]]
    """The shapes of the ports; the first input is that of the rows, the others are the same for all rows."""
    operations: list[Sequence[Any]]
    """The name of each and its operands; ``("input", port, component)`` for a number of an input, and ``("seed", i)``
    for one that is 1 in row i of a Jacobian and 0 in its other rows."""
    results: dict[str, list[Operand]]
    """The components of each output; of a Jacobian that depends on seeds those of one row."""
    names: dict[int, str] = field(default_factory=dict, compare=False)
    """What some operations are called in code that people read."""

    @cached_property
    def shared(self) -> list[bool]:
        """Whether each operation has one result for all rows."""
        rows, is_shared = next(iter(self.inputs)), list[bool]()
        for op, *args in self.operations:
            is_shared.append(
                op != "seed" and args[0] != rows
                if op in GIVEN
                else all(is_shared[a] for a in args if isinstance(a, int))
            )
        return is_shared

    @cached_property
    def seeded(self) -> list[bool]:
        """Whether each operation has a result for every row of the Jacobian."""
        is_seeded = list[bool]()
        for op, *args in self.operations:
            is_seeded.append(
                op == "seed" if op in GIVEN else any(is_seeded[a] for a in args if isinstance(a, int))
            )
        return is_seeded

    @property
    def operations_of_a_row(self) -> dict[str, int]:
        """How often each operation is done for a row."""
        counts = Counter[str]()
        for (op, *_), shared, seeded in zip(self.operations, self.shared, self.seeded, strict=True):
            if not shared and op not in GIVEN:
                counts[op] += self.height if seeded else 1
        return counts

    @property
    def by_row(self) -> bool:
        """Whether the results have one row of the Jacobian, which seeds make each of its rows."""
        return self.columns > 0 and len(list(self.results.values())[1]) < self.height * self.columns

    @property
    def height(self) -> int:
        """Rows of the Jacobian; 0 where there is none."""
        return next(iter(self.outputs.values()))[0] if self.columns else 0

    @property
    def columns(self) -> int:
        """Columns of the Jacobian where the outputs are residuals, (m,), and their Jacobian, (m, columns), else 0."""
        match list(self.outputs.values()):
            case [(height,), (rows, columns)] if rows == height > 0:
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
