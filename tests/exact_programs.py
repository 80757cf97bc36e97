"""Programs over rows with 50 digits: an operation at a time, with the numbers of mpmath."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mpmath
import numpy as np

from rodgen.codegen.program import Program

OPERATIONS: dict[str, Callable[..., Any]] = {
    **{
        op: getattr(mpmath, op) for op in ("sin", "cos", "tan", "asin", "exp", "log", "sqrt", "sign", "atan2")
    },
    **{op: getattr(operator, op) for op in ("add", "sub", "mul", "neg", "lt", "abs", "pow")},
    "recip": lambda x: 1 / x if x else mpmath.nan,
    "select": lambda holds, yes, no: yes if holds else no,
}


def exact(program: Program, inputs: Mapping[str, Sequence[Any]]) -> list[np.ndarray]:
    """Return the outputs for one row, in their shapes; the working precision is mpmath's."""
    rows = [_results(program, inputs, row) for row in range(program.height if program.by_row else 1)]
    flat = {port: [x for row in rows for x in row[port]] for port in program.outputs}
    first, *_ = program.outputs
    if program.by_row:  # the residual is that of any row
        flat[first] = rows[0][first]
    return [np.array(flat[port]).reshape(shape) for port, shape in program.outputs.items()]


def _results(program: Program, inputs: Mapping[str, Sequence[Any]], row: int) -> dict[str, list[Any]]:
    found: list[Any] = []
    for op, *args in program.operations:
        if op == "input":
            found.append(mpmath.mpf(inputs[args[0]][args[1]]))
        elif op == "seed":
            found.append(mpmath.mpf(args[0] == row))
        else:
            operands = (found[a] if isinstance(a, int) else mpmath.mpf(a) for a in args)
            found.append(OPERATIONS[op](*operands))
    return {
        port: [found[x] if isinstance(x, int) else mpmath.mpf(x) for x in values]
        for port, values in program.results.items()
    }
