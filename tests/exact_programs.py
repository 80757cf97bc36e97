"""Programs over rows with 50 digits: an operation at a time, with the numbers of mpmath."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mpmath
import numpy as np

from rodgen.codegen.exact import exact_results
from rodgen.codegen.program import Program


def exact(program: Program, inputs: Mapping[str, Sequence[Any]]) -> list[np.ndarray]:
    """Return the outputs for one row, in their shapes; the working precision is mpmath's."""
    known = {name: [mpmath.mpf(x) for x in values] for name, values in inputs.items()}
    rows = [exact_results(program, known, row) for row in range(program.height if program.by_row else 1)]
    flat = {port: [x for row in rows for x in row[port]] for port in program.outputs}
    first, *_ = program.outputs
    if program.by_row:  # the residual is that of any row
        flat[first] = rows[0][first]
    return [np.array(flat[port]).reshape(shape) for port, shape in program.outputs.items()]
