"""Programs over rows on NumPy: an operation at a time, on a block of rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.codegen.operations import CONDITION, OPERATIONS
from rodgen.codegen.program import GIVEN, Program

WORK_BYTES = 1 << 22
"""Room for the numbers of a block: with fewer rows NumPy's calls cost more than the sums, with more the cache ends."""
FEWEST, MOST = 128, 4096
"""Rows a block. With 2048 at most the programs of a mount, a robot, a gantry and a hexapod take 1.1 times as long."""

FUNCTIONS: dict[str, Callable[..., Any]] = {
    op: getattr(np, row.array) for op, row in OPERATIONS.items() if row.array
}
INTO = {op: f for op, f in FUNCTIONS.items() if op not in {CONDITION, "select"}}
"""Operations whose result NumPy writes into an array that is given."""


class NumPyProgram:
    """A program that is evaluated on arrays."""

    def __init__(self, program: Program) -> None:
        shared, seeded = program.shared, program.seeded
        rows, *others = program.inputs
        self.height = program.height if program.by_row else 0
        self.of_row: list[tuple[int, int]] = []
        self.of_seed: list[tuple[int, int]] = []
        self.given: list[tuple[int, int, int]] = []
        self.once: list[tuple[Callable[..., Any], int, list[int]]] = []
        self.each: list[tuple[Any, ...]] = []
        self.count = len(program.operations)
        self.constants: dict[str, int] = {}  # they stand behind the operations
        places: dict[int, list[tuple[int, int]]] = {}
        for output, values in enumerate(program.results.values()):
            for component, x in enumerate(values):
                places.setdefault(self._place(x), []).append((output, component))
        self.same_results = [(x, at) for x, at in places.items() if x >= self.count or shared[x]]
        order = sorted(range(self.count), key=lambda n: seeded[n])  # what needs a seed comes last
        last = {
            a: n
            for n in order
            if program.operations[n][0] not in GIVEN
            for a in program.operations[n][1:]
            if isinstance(a, int)
        }
        rooms = self.rooms = [_Rooms(), _Rooms()]  # for a row, and for every row of the Jacobian
        for n in order:
            op, *args = program.operations[n]
            if op == "seed":
                self.of_seed.append((n, args[0]))
            elif op == "input" and args[0] == rows:
                self.of_row.append((n, args[1]))
            elif op == "input":
                self.given.append((n, others.index(args[0]), args[1]))
            elif shared[n]:
                self.once.append((FUNCTIONS[op], n, [self._place(a) for a in args]))
            else:
                operands = [self._place(a) for a in args]
                for a in set(operands):
                    if last.get(a) == n:
                        rooms[a < self.count and seeded[a]].free(a)
                if op in INTO:
                    at = rooms[seeded[n]].taken(n)
                    if n not in last:
                        rooms[seeded[n]].free(n)
                    first, second = operands if len(operands) == 2 else (operands[0], -1)
                    self.each.append((FUNCTIONS[op], n, (seeded[n], at), first, second))
                else:
                    self.each.append((FUNCTIONS[op], n, None, operands, 0))
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
        filled: list[Array] = [a.reshape(count, -1) for a in outputs]
        if self.height:  # a component of the results is one of every row of the Jacobian
            filled[1] = outputs[1].reshape(count, self.height, -1)
        values: list[Any] = [None] * self.count + list(map(float, self.constants))
        with np.errstate(all="ignore"):
            a_row = self.rooms[0].count + self.height * self.rooms[1].count
            size = min(count, max(FEWEST, min(MOST, WORK_BYTES // (8 * max(1, a_row)))))
            work = np.empty((self.rooms[0].count, size)), np.empty((self.rooms[1].count, self.height, size))
            for start in range(0, count, size):
                block = slice(start, start + size)
                if not shared:
                    self._share(values, [np.ascontiguousarray(a[block].T) for a in others])
                elif not start:
                    self._share(values, others)
                parts = [a[block] for a in filled]
                for n, at in self.same_results:
                    for output, component in at:
                        parts[output][..., component] = np.transpose(values[n])
                self._fill(values, rows[block], work, parts)

    def _share(self, values: list[Any], others: Sequence[Array]) -> None:
        """Evaluate what does not depend on the rows' own input."""
        for n, port, component in self.given:
            values[n] = others[port][component]
        for n, row in self.of_seed:
            values[n] = np.eye(self.height)[:, row, None]
        for function, n, operands in self.once:
            values[n] = function(*[values[a] for a in operands])

    def _fill(self, values: list[Any], rows: Array, work: Sequence[Array], outputs: Sequence[Array]) -> None:
        columns = np.ascontiguousarray(rows.T)
        for n, component in self.of_row:
            values[n] = columns[component]
        room = [list(some[..., : len(rows)]) for some in work]
        for function, n, at, first, second in self.each:
            if function is None:
                outputs[at][..., first] = values[n].T
            elif at is None:
                values[n] = function(*[values[a] for a in first])
            elif second < 0:
                values[n] = function(values[first], room[at[0]][at[1]])
            else:
                values[n] = function(values[first], values[second], room[at[0]][at[1]])


class _Rooms:
    """Arrays that hold the numbers of a block, each until its last use."""

    def __init__(self) -> None:
        self.count = 0
        self.of: dict[int, int] = {}
        self.empty: list[int] = []

    def taken(self, n: int) -> int:
        """Return an array for a number."""
        if not self.empty:
            self.empty.append(self.count)
            self.count += 1
        self.of[n] = self.empty.pop()
        return self.of[n]

    def free(self, n: int) -> None:
        """Give back the array of a number, if it has one."""
        if n in self.of:
            self.empty.append(self.of.pop(n))
