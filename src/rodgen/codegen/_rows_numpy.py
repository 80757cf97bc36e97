"""Programs over rows on NumPy: an operation at a time, on a block of rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rodgen.codegen._array_call import _power_of_two_scale
from rodgen.codegen.program import Program

__all__ = ["NumPyProgram"]

Array = np.ndarray[Any, np.dtype[np.float64]]

WORK_BYTES = 1 << 21
"""Room for the numbers of a block: with fewer rows NumPy's calls cost more than the sums, with more the cache ends."""
FEWEST, MOST = 128, 2048
"""Rows a block."""

INTO: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "neg": np.negative,
    "recip": np.reciprocal,
    "abs": np.abs,
    "sign": np.sign,
    "pow": np.power,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
}
"""Functions that write their result into an array that is given."""

NEW: dict[str, Callable[..., Any]] = {
    "lt": np.less,
    "le": np.less_equal,
    "eq": np.equal,
    "ne": np.not_equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "not": np.logical_not,
    "select": np.where,
    "scale": _power_of_two_scale,
}
"""Functions that return a new array."""


class NumPyProgram:
    """A program that is evaluated on arrays.

    Parameters
    ----------
    program : Program
    """

    def __init__(self, program: Program) -> None:
        shared = program.shared
        rows, *others = program.inputs
        self.of_row: list[tuple[int, int]] = []
        self.given: list[tuple[int, int, int]] = []
        self.once: list[tuple[Callable[..., Any], int, list[int]]] = []
        self.each: list[tuple[Any, ...]] = []
        self.rooms = 0
        self.count = len(program.operations)
        self.constants: dict[str, int] = {}  # they stand behind the operations
        places: dict[int, list[tuple[int, int]]] = {}
        for output, values in enumerate(program.results.values()):
            for component, x in enumerate(values):
                places.setdefault(self._place(x), []).append((output, component))
        last = {
            a: n
            for n, (op, *args) in enumerate(program.operations)
            if op != "input"
            for a in args
            if isinstance(a, int)
        }
        self.same_results = [(x, at) for x, at in places.items() if x >= self.count or shared[x]]
        free: list[int] = []
        room: dict[int, int] = {}
        for n, (op, *args) in enumerate(program.operations):
            operands = [] if op == "input" else [self._place(a) for a in args]
            if op == "input" and args[0] == rows:
                self.of_row.append((n, args[1]))
            elif op == "input":
                self.given.append((n, others.index(args[0]), args[1]))
            elif shared[n]:
                self.once.append((INTO.get(op) or NEW[op], n, operands))
            else:
                free += [room.pop(a) for a in set(operands) if a in room and last[a] == n]
                if op in INTO:
                    if not free:
                        free.append(self.rooms)
                        self.rooms += 1
                    at = free.pop()
                    if n in last:
                        room[n] = at
                    first, second = operands if len(operands) == 2 else (operands[0], -1)
                    self.each.append((INTO[op], n, at, first, second))
                    if n not in last:
                        free.append(at)
                else:
                    self.each.append((NEW[op], n, -1, operands, 0))
            if not shared[n]:
                self.each += [(None, n, output, component, 0) for output, component in places.get(n, ())]

    def _place(self, operand: float) -> int:
        """Return where an operand is among the values."""
        if isinstance(operand, int):
            return operand
        return self.constants.setdefault(repr(operand), self.count + len(self.constants))

    def __call__(
        self, count: int, inputs: Sequence[Array], outputs: Sequence[Array], *, shared: bool = True
    ) -> None:
        """Evaluate rows, (count, ...), and fill the outputs, (count, ...).

        The other inputs are shared by all rows, or, where they are not, of each row, (count, ...), too.
        """
        rows = inputs[0].reshape(count, -1)
        others = [a.ravel() if shared else a.reshape(count, -1) for a in inputs[1:]]
        filled = [a.reshape(count, -1) for a in outputs]
        values: list[Any] = [None] * self.count + list(map(float, self.constants))
        with np.errstate(all="ignore"):
            size = min(count, max(FEWEST, min(MOST, WORK_BYTES // (8 * max(1, self.rooms)))))
            work = np.empty((self.rooms, size))
            for start in range(0, count, size):
                block = slice(start, start + size)
                if not shared:
                    self._share(values, [np.ascontiguousarray(a[block].T) for a in others])
                elif not start:
                    self._share(values, others)
                parts = [a[block] for a in filled]
                for n, at in self.same_results:
                    for output, component in at:
                        parts[output][:, component] = values[n]
                self._fill(values, rows[block], work, parts)

    def _share(self, values: list[Any], others: Sequence[Array]) -> None:
        """Evaluate what does not depend on the rows' own input."""
        for n, port, component in self.given:
            values[n] = others[port][component]
        for function, n, operands in self.once:
            values[n] = function(*[values[a] for a in operands])

    def _fill(self, values: list[Any], rows: Array, work: Array, outputs: Sequence[Array]) -> None:
        columns = np.ascontiguousarray(rows.T)
        for n, component in self.of_row:
            values[n] = columns[component]
        room = list(work[:, : len(rows)])
        for function, n, at, first, second in self.each:
            if function is None:
                outputs[at][:, first] = values[n]
            elif at < 0:
                values[n] = function(*[values[a] for a in first])
            elif second < 0:
                values[n] = function(values[first], room[at])
            else:
                values[n] = function(values[first], values[second], room[at])
