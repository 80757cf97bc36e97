"""The text of programs over rows in C with vectors.

What depends on the shared inputs alone is computed once for all rows; the rest once a row, with one vector for the
values of several rows.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import Any

from rodgen.codegen.program import Operand, Program
from rodgen.codegen.source_text import DO_NOT_EDIT, ENVIRONMENT, operations_text, scale_functions

__all__ = ["c_source"]

OPERATORS = {
    "add": "{} + {}",
    "sub": "{} - {}",
    "mul": "{}*{}",
    "neg": "-{}",
    "recip": "1.0/{}",
    "and": "{} & {}",
    "or": "{} | {}",
    "not": "~{}",
}
"""What numbers and vectors have in common."""

COMPARISONS = {"lt": "{} < {}", "le": "{} <= {}", "eq": "{} == {}", "ne": "{} != {}"}

NUMBERS = {
    **OPERATORS,
    **{op: f"-(int64_t)({text})" for op, text in COMPARISONS.items()},
    "abs": "fabs({})",
    "sign": "sign_of_number({})",
    "scale": "power_of_two_scale_f64({})",
    "select": "{} ? {} : {}",
    "atan2": "atan2({}, {})",
    "pow": "pow({}, {})",
}
"""Numbers that all rows share; a condition is all ones or all zeros, as the lanes' are."""

LANES = {
    **OPERATORS,
    **COMPARISONS,
    "abs": "lanes_magnitude({})",
    "sqrt": "lanes_root({})",
    "select": "lanes_blend({}, {}, {})",
    "scale": "lanes_power_of_two_scale({})",
    "atan2": "lanes_atan2({}, {})",
    "pow": "lanes_pow({}, {})",
}

CONDITIONS = {*COMPARISONS, "and", "or", "not"}


def c_source(programs: Sequence[Program]) -> str:
    """Return C whose functions ``rows_NAME`` evaluate programs over many rows."""
    functions = {op for program in programs for op, *_ in program.operations}
    called = {
        "power_of_two_scale" if op == "scale" else op: "power_of_two_scale_f64" if op == "scale" else op
        for op in sorted(functions - OPERATORS.keys() - COMPARISONS.keys() - _INLINE)
    }
    lanewise = [(name, call, ("x", "y") if name == "atan2" else ("x",)) for name, call in called.items()]
    lanewise.append(("pow", "pow", ("x", "y")))
    return ENVIRONMENT.get_template("rows.c.j2").render(
        do_not_edit=DO_NOT_EDIT,
        template="rows.c.j2",
        kernels=[_c_kernel(program) for program in programs],
        about=json.dumps(json.dumps({program.name: program.about for program in programs})),
        functions={"power_of_two_scale" if op == "scale" else op for op in functions},
        lanewise=lanewise,
        scale_functions=scale_functions(["f64"]),
    )


_INLINE = {"input", "abs", "sign", "sqrt", "select", "pow", "sin", "cos"}
"""Operations for which the template has its own functions."""


def _c_kernel(program: Program) -> dict[str, Any]:
    once: list[tuple[int, str, list[Any]]] = []
    each: list[tuple[int, str, list[Any]]] = []
    shared = program.shared
    for n, (op, *args) in enumerate(program.operations):
        (once if shared[n] else each).append((n, op, args))
    ports = list(program.inputs)
    lines = [_shared_line(ports, shared, *operation) for operation in once]
    used = {args[0] for _, op, args in once if op == "input"}
    lines += [f"(void)in{n};" for n, port in enumerate(ports) if n and port not in used]
    numbers = range(len(ports))
    given = ", ".join(f"const double *in{n}" for n in numbers)
    of_rows = list(_lines(program, each))
    return {
        "name": program.name,
        "operations": operations_text(program.operations_of_a_row),
        "inputs": [f"{n} {port}" for n, port in enumerate(ports)],
        "outputs": [f"{n} {port}" for n, port in enumerate(program.outputs)],
        "given": given,
        "prototype": ", ".join([given, *(f"double *out{n}" for n in range(len(program.outputs)))]),
        "arguments": ", ".join(f"in{n}" for n in numbers),
        "rows": math.prod(program.inputs[ports[0]]),
        "sizes": [math.prod(shape) for shape in program.outputs.values()],
        "columns": program.columns,
        "width": program.width,
        "once": lines,
        "lines": of_rows,
        "circular": any("lanes_sine_cosine" in line for line in of_rows),
    }


def _place(program: Program, output: int, component: int) -> str:
    """Return where C keeps a result: residuals in the column after those of the Jacobian."""
    if not program.columns:
        return f"result{output}[{component}]"
    row, column = divmod(component, program.columns) if output else (component, program.columns)
    return f"result[{program.width * row + column}]"


def _operand(x: Operand) -> str:
    if isinstance(x, int):
        return f"t{x}"
    if math.isfinite(x):
        return repr(x) if math.copysign(1.0, x) > 0 else f"({x!r})"
    return "(double)NAN" if math.isnan(x) else f"({'-' if x < 0 else ''}(double)INFINITY)"


def _shared_line(ports: Sequence[str], shared: Sequence[bool], n: int, op: str, args: Sequence[Any]) -> str:
    if op == "input":
        return f"const double t{n} = in{ports.index(args[0])}[{args[1]}];"
    text = NUMBERS.get(op, f"{op}({{}})").format(*map(_operand, args))
    return f"const {'int64_t' if op in CONDITIONS else 'double'} t{n} = {text};"


def _lines(program: Program, each: Sequence[tuple[int, str, list[Any]]]) -> Iterator[str]:
    """Write the lines of a row; sine and cosine of one angle come together, and a result right after its line."""
    shared = program.shared
    places: dict[int, list[str]] = {}
    for output, values in enumerate(program.results.values()):
        for component, x in enumerate(values):
            if isinstance(x, int) and not shared[x]:
                places.setdefault(x, []).append(_place(program, output, component))
            else:
                yield f"{_place(program, output, component)} = WHOLE({_operand(x)});"

    def whole(x: Operand) -> str:
        if isinstance(x, int) and not shared[x]:
            return _operand(x)
        is_condition = isinstance(x, int) and program.operations[x][0] in CONDITIONS
        return f"{'WHOLE_MASK' if is_condition else 'WHOLE'}({_operand(x)})"

    pairs: dict[Operand, dict[str, int]] = {}
    for n, op, args in each:
        if op in {"sin", "cos"}:
            pairs.setdefault(args[0], {})[op] = n
    for n, op, args in each:
        if op in {"sin", "cos"}:
            pair = pairs.pop(args[0], None)
            if pair is not None:
                sine, cosine = (f"t{pair[f]}" if f in pair else f"{f}{n}" for f in ("sin", "cos"))
                yield f"vec {sine}, {cosine};"
                yield f"lanes_sine_cosine({_operand(args[0])}, &{sine}, &{cosine}, &far, use_libm);"
        elif op == "input":
            yield f"const vec t{n} = row[{args[1]}];"
        else:
            text = LANES.get(op, f"lanes_{op}({{}})")
            texts = map(_operand if op in OPERATORS or op in COMPARISONS else whole, args)
            yield f"const {'mask' if op in CONDITIONS else 'vec'} t{n} = {text.format(*texts)};"
        yield from (f"{place} = t{n};" for place in places.get(n, ()))
