"""Programs over rows: on NumPy an operation at a time, on a block of rows; on arrays of other libraries on all rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from rodgen.array_types import Array
from rodgen.codegen._array_call import _Functions, _is_foreign, _power_of_two_scale
from rodgen.codegen.program import GIVEN, Program

WORK_BYTES = 1 << 22
"""Room for the numbers of a block: with fewer rows NumPy's calls cost more than the sums, with more the cache ends."""
FEWEST, MOST = 128, 2048
"""Rows a block."""

BLOCK = 1024
"""Rows whose products are summed at once on arrays of other libraries."""

INTO = {
    "add": "add",
    "sub": "subtract",
    "mul": "multiply",
    "neg": "negative",
    "recip": "reciprocal",
    **{
        name: name
        for name in ("abs", "sign", "pow", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2")
    },
    **{name: name for name in ("sinh", "cosh", "tanh", "exp", "log")},
}
"""Functions of the array API standard, which NumPy lets write their result into an array that is given."""

NEW = {
    "lt": "less",
    "le": "less_equal",
    "eq": "equal",
    "ne": "not_equal",
    "and": "logical_and",
    "or": "logical_or",
    "not": "logical_not",
    "select": "where",
}
"""Functions that return a new array."""


def _function(xp: Any, op: str) -> Callable[..., Any]:
    """Return the function of an operation in an array namespace."""
    return (
        _power_of_two_scale
        if op == "scale"
        else cast("Callable[..., Any]", getattr(xp, INTO.get(op) or NEW[op]))
    )


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
                self.once.append((_function(np, op), n, [self._place(a) for a in args]))
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
                    self.each.append((_function(np, op), n, (seeded[n], at), first, second))
                else:
                    self.each.append((_function(np, op), n, None, operands, 0))
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


def _components(xp: Any, program: Program, rows: Any, shared: Sequence[Any]) -> list[list[Any]]:
    """Return the components of each output, (count,); of a Jacobian whose rows seeds make (height, count)."""
    one = xp.ones((), dtype=rows.dtype, device=_device(rows))
    functions, count = _Functions(xp, one), rows.shape[0]
    flat = dict(zip(program.inputs, (xp.reshape(a, (-1,)) for a in (rows, *shared)), strict=True))
    flat[next(iter(flat))] = xp.reshape(rows, (count, -1))
    seeds = xp.eye(max(program.height, 1), dtype=rows.dtype, device=_device(rows))
    last = {a: n for n, (op, *args) in enumerate(program.operations) if op not in GIVEN for a in args}
    last |= dict.fromkeys((x for found in program.results.values() for x in found), -1)
    values: list[Any] = []
    constants: dict[str, Any] = {}

    def value(x: float) -> Any:
        return values[x] if isinstance(x, int) else constants.setdefault(repr(x), x * one)

    for n, (op, *args) in enumerate(program.operations):
        if op == "seed":
            values.append(seeds[:, args[0], None])
        elif op == "input":
            values.append(flat[args[0]][..., args[1]])
        else:
            values.append(_function(functions, op)(*map(value, args)))
            for a in args:
                if isinstance(a, int) and last[a] == n:
                    values[a] = None  # its memory can be used again
    shapes: list[tuple[int, ...]] = [(count,)] * len(program.results)
    if program.by_row:
        shapes[1] = (program.height, count)
    return [
        [xp.broadcast_to(value(x), shape) for x in found]
        for found, shape in zip(program.results.values(), shapes, strict=True)
    ]


def outputs_on(xp: Any, program: Program, rows: Any, shared: Sequence[Any]) -> list[Any]:
    """Return the outputs of a program, (count, ...), on arrays of another library than NumPy, all rows at once.

    Parameters
    ----------
    xp : module
        Their functions, as of the array API standard.
    rows : array (count, ...)
    """
    found = []
    for values, shape in zip(_components(xp, program, rows, shared), program.outputs.values(), strict=True):
        together = xp.stack(values, axis=-1)
        if together.ndim > 2:  # (height, count, columns)
            together = xp.permute_dims(together, (1, 0, 2))
        found.append(xp.reshape(together, (rows.shape[0], *shape)))
    return found


def gram_on(xp: Any, program: Program, rows: Any, shared: Sequence[Any]) -> Any:
    """Return [J r]ᵀ[J r] of residuals r and their Jacobian J; see :func:`outputs_on`.

    Products of blocks of rows are summed, as for one product of a few columns and millions of rows a processor of
    graphics finds no work for all its parts.
    """
    whole = rows.shape[0] - rows.shape[0] % BLOCK
    total = xp.zeros((program.columns + 1,) * 2, dtype=rows.dtype, device=_device(rows))
    for part in (rows[:whole, ...], rows[whole:, ...]):
        if not part.shape[0]:
            continue
        block = min(BLOCK, part.shape[0])
        residual, jacobian = _components(xp, program, part, shared)
        if program.by_row:
            jacobian = [x[h, :] for h in range(program.height) for x in jacobian]
        columns = [jacobian[c :: program.columns] for c in range(program.columns)]
        each = [xp.reshape(x, (-1, block)) for column in (*columns, residual) for x in column]
        joined = xp.reshape(xp.stack(each, axis=1), (-1, program.columns + 1, program.height * block))
        total = total + xp.sum(xp.matmul(joined, xp.matrix_transpose(joined)), axis=0)
    return total


def arrays_on(xp: Any, given: Sequence[Any]) -> list[Any]:
    """Return arrays of another library than NumPy, of the type and where the first of them is; float32 stays."""
    first = next(a for a in given if _is_foreign(a))
    real = xp.float32 if first.dtype == xp.float32 else xp.float64
    return [
        xp.astype(a, real) if _is_foreign(a) else xp.asarray(a, dtype=real, device=_device(first))
        for a in given
    ]


def _device(array: Any) -> Any:
    from array_api_compat import device

    return device(array)
