"""The text of programs over rows in C with vectors.

What depends on the shared inputs alone is computed once for all rows; the rest once a row, with one vector for the
values of several rows.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rodgen.codegen.operations import CONDITION, OPERATIONS, OPERATORS
from rodgen.codegen.program import GIVEN, Operand, Program
from rodgen.codegen.source_text import DO_NOT_EDIT, ENVIRONMENT, operations_text


def c_source(programs: Sequence[Program]) -> str:
    """Return C whose functions ``rows_NAME`` evaluate programs over many rows."""
    functions = {op for program in programs for op, *_ in program.operations}
    called = sorted(functions - OPERATORS - _INLINE)
    lanewise = [(name, ("x", "y") if name == "atan2" else ("x",)) for name in called]
    lanewise.append(("pow", ("x", "y")))
    return ENVIRONMENT.get_template("rows.c.j2").render(
        do_not_edit=DO_NOT_EDIT,
        template="rows.c.j2",
        kernels=[_c_kernel(program) for program in programs],
        about=json.dumps(json.dumps({program.name: program.about for program in programs})),
        functions=functions,
        lanewise=lanewise,
    )


PART = 500
"""Operations a function."""

CIRCULAR = ("sin", "cos")

_INLINE = {*GIVEN, *CIRCULAR, CONDITION, "abs", "sign", "sqrt", "select", "pow"}
"""Operations for which the template has its own functions."""


def _c_kernel(program: Program) -> dict[str, Any]:
    shared = program.shared
    ports = list(program.inputs)
    once = [(n, op, args) for n, (op, *args) in enumerate(program.operations) if shared[n]]
    lines = [_shared_line(ports, shared, *operation) for operation in once]
    used = {args[0] for _, op, args in once if op == "input"}
    lines += [f"(void)in{n};" for n, port in enumerate(ports) if n and port not in used]
    numbers = range(len(ports))
    arguments = ", ".join(f"const double *in{n}" for n in numbers)
    of_rows = _Parts(program)
    return {
        "name": program.name,
        "operations": operations_text(program.operations_of_a_row),
        "inputs": [f"{n} {port}" for n, port in enumerate(ports)],
        "outputs": [f"{n} {port}" for n, port in enumerate(program.outputs)],
        "given": arguments,
        "prototype": ", ".join([arguments, *(f"double *out{n}" for n in range(len(program.outputs)))]),
        "arguments": ", ".join(f"in{n}" for n in numbers),
        "rows": math.prod(program.inputs[ports[0]]),
        "sizes": [math.prod(shape) for shape in program.outputs.values()],
        "columns": program.columns,
        "width": program.width,
        "once": lines,
        "parts": of_rows.lines,
        "work": of_rows.rooms,
        "same": [f"t{n}" for n in of_rows.same],
        "held": [f"t{n}" for n in of_rows.held],
        "first_seeded": of_rows.first_seeded,
        "circular": any(op in CIRCULAR for op in program.operations_of_a_row),
    }


def _place(program: Program, output: int, component: int) -> str:
    """Return where C keeps a result: residuals in the column after those of the Jacobian."""
    if not program.columns:
        before = [math.prod(shape) for shape in program.outputs.values()][:output]
        return f"result[{sum(before) + component}]"
    if program.by_row and output:
        return f"result[{component}]"
    row, column = divmod(component, program.columns) if output else (component, program.columns)
    return f"result[{program.width * row + column}]"


def _operand(x: Operand) -> str:
    return f"t{x}" if isinstance(x, int) else _constant(x)


def _constant(x: float) -> str:
    if math.isfinite(x):
        return repr(x) if math.copysign(1.0, x) > 0 else f"({x!r})"
    return "(double)NAN" if math.isnan(x) else f"({'-' if x < 0 else ''}(double)INFINITY)"


def _shared_line(ports: Sequence[str], shared: Sequence[bool], n: int, op: str, args: Sequence[Any]) -> str:
    if op == "input":
        return f"const double t{n} = in{ports.index(args[0])}[{args[1]}];"
    text = OPERATIONS[op].c.format(*map(_operand, args))
    if op == CONDITION:  # all ones or all zeros, as the lanes' are
        return f"const int64_t t{n} = -(int64_t)({text});"
    return f"const double t{n} = {text};"


class _Parts:
    """The lines of a row in parts, each of which becomes a function.

    A compiler takes more than twice the time for twice the lines, as it looks for a register for every number over all
    of them; and of some thousand numbers it keeps in registers not those that are needed next. What goes from part to
    part is stored.

    Attributes
    ----------
    lines : list of list of str
        Of each part.
    first_seeded : int
        The parts from here on are done for every row of the Jacobian.
    rooms : int
        Numbers that must be stored at once.
    same, held : list of int
        Operations with one result for all rows that are read: numbers, and conditions.
    """

    def __init__(self, program: Program) -> None:
        self.program, self.shared = program, program.shared
        self.same: list[int] = []
        self.held: list[int] = []
        self.rooms = 0
        self.room: dict[int, int] = {}
        operations = program.operations
        each = [n for n, (op, *_) in enumerate(operations) if op not in GIVEN and not self.shared[n]]
        self.pairs: dict[Any, dict[str, int]] = {}  # sine and cosine of an angle
        for n in each:
            op, *args = operations[n]
            if op in CIRCULAR:
                self.pairs.setdefault(args[0], {})[op] = n
        levels = [[n for n in each if program.seeded[n] is seeded] for seeded in (False, True)]
        parts = [[level[at : at + PART] for at in range(0, len(level), PART)] for level in levels]
        # what is done once a row: results that no operation makes are stored there
        parts[0] = parts[0] or [[]]
        if program.by_row:
            parts[1] = parts[1] or [[]]
        self.first_seeded = len(parts[0])
        self.part = {n: at for at, part in enumerate([*parts[0], *parts[1]]) for n in part}
        for pair in self.pairs.values():
            self.part |= dict.fromkeys(pair.values(), self.part[min(pair.values())])
        self.last: dict[
            int, int
        ] = {}  # in which part it is read last; for every row of the Jacobian if in one of them
        for n in each:
            for a in operations[n][1:]:
                if isinstance(a, int) and a in self.part:
                    again = program.seeded[n] and not program.seeded[a]
                    self.last[a] = max(self.last.get(a, 0), len(self.part) if again else self.part[n])
        places: dict[int, list[str]] = {}
        self.lines = [list[str]() for _ in (*parts[0], *parts[1])]
        for output, values in enumerate(program.results.values()):
            for component, x in enumerate(values):
                place = _place(program, output, component)
                if isinstance(x, int) and x in self.part:
                    places.setdefault(x, []).append(place)
                else:
                    at = self.first_seeded if program.by_row and output else 0
                    self.lines[at].append(f"{place} = {self.whole(x, at)};")
        self.fill([*parts[0], *parts[1]], places)

    def fill(self, parts: Sequence[Sequence[int]], places: Mapping[int, Sequence[str]]) -> None:
        """Write the lines; a result is stored right after its line."""
        free: list[int] = []
        for at, (lines, part) in enumerate(zip(self.lines, parts, strict=True)):
            free += [self.room.pop(a) for a in list(self.room) if self.last[a] < at]
            for n in part:
                op, *args = self.program.operations[n]
                pair = self.pairs[args[0]] if op in CIRCULAR else {op: n}
                if n != min(pair.values()):
                    continue
                lines += self.line(at, n, op, args)
                for x in pair.values():
                    if self.last.get(x, at) > at:
                        if not free:
                            free.append(self.rooms)
                            self.rooms += 1
                        self.room[x] = free.pop()
                        lines.append(f"work[{self.room[x]}] = {'(vec)' * self.is_condition(x)}t{x};")
                    lines += [f"{place} = t{x};" for place in places.get(x, ())]

    def is_condition(self, x: int) -> bool:
        """Return whether an operation gives truth values."""
        return bool(self.program.operations[x][0] == CONDITION)

    def operand(self, x: Operand, part: int) -> str:
        """Return the text of an operand in a part."""
        if not isinstance(x, int):
            return _constant(x)
        op, *args = self.program.operations[x]
        if not self.shared[x]:
            if op in GIVEN:
                return f"{'row' if op == 'input' else 'seed'}[{args[-1]}]"
            stored = self.part[x] < part
            return f"{'(mask)' * self.is_condition(x)}work[{self.room[x]}]" if stored else f"t{x}"
        name, numbers = ("held", self.held) if self.is_condition(x) else ("same", self.same)
        if x not in numbers:
            numbers.append(x)
        return f"{name}[{numbers.index(x)}]"

    def whole(self, x: Operand, part: int) -> str:
        """Return the text of an operand as a vector."""
        text = self.operand(x, part)
        if isinstance(x, int) and not self.shared[x]:
            return text
        return f"{'WHOLE_MASK' if text.startswith('held') else 'WHOLE'}({text})"

    def line(self, part: int, n: int, op: str, args: Sequence[Any]) -> Iterator[str]:
        """Write an operation; sine and cosine of one angle come together."""
        if op in CIRCULAR:
            pair = self.pairs[args[0]]
            sine, cosine = (f"t{pair[f]}" if f in pair else f"{f}{n}" for f in CIRCULAR)
            yield f"vec {sine}, {cosine};"
            yield f"lanes_sine_cosine({self.operand(args[0], part)}, &{sine}, &{cosine}, far, use_libm);"
        else:
            text = OPERATIONS[op].lanes
            write = self.operand if op in OPERATORS or op == CONDITION else self.whole
            kind = "mask" if op == CONDITION else "vec"
            yield f"const {kind} t{n} = {text.format(*(write(a, part) for a in args))};"
