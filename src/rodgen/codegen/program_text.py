"""The text of a program in C, C++, NumPy, JAX and MATLAB: a line a number, or several where each is used once.

What is used once is written into the line that uses it, in brackets where the order of operations needs them, so that
every language does the same operations in the same order. A product with a reciprocal that is used once is a quotient.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from itertools import count, product
from typing import NamedTuple

from rodgen.codegen.operations import COMPARISONS, CONDITIONS, OPERATIONS
from rodgen.codegen.program import GIVEN, Operand, Program

LONGEST = 12
"""Most operands of a line that others were written into: longer ones are hard to read."""

_NEEDS = {
    **{"add": (2, 3), "sub": (2, 3), "mul": (3, 4), "div": (3, 4), "neg": (3,), "recip": (4,)},
    **dict.fromkeys(COMPARISONS, (2, 2)),
    **{"and": (9, 9), "or": (9, 9), "not": (9,)},
}
"""How strongly an operand must bind to stand without brackets; 1 in a select, 0 in a call."""
_BINDS = {
    **{"select": 0, "add": 2, "sub": 2, "mul": 3, "div": 3, "neg": 3, "recip": 3, "not": 3},
    **dict.fromkeys(CONDITIONS - {"not"}, 1),
}
_BITS = {"and": "{} & {}", "or": "{} | {}", "not": "~{}"}
"""Conditions where a truth value is a bit, or an array of them."""


class Language(NamedTuple):
    """How a language writes operations and numbers."""

    written: Mapping[str, str]
    """Each operation, with ``{}`` for its operands."""
    not_a_number: str
    infinity: str = ""
    literal: str = "{!r}"
    """A constant."""
    inputs: Mapping[str, str] = {}
    """Inputs that have another name: those of the number type."""
    of_constants: Mapping[str, str] = {}
    """Operations that are written in another way where no operand is an array."""

    def constant(self, x: float) -> str:
        """Write a number."""
        if math.isfinite(x):
            return self.literal.format(float(x))
        return self.not_a_number if math.isnan(x) else f"{'-' if x < 0 else ''}{self.infinity}"


C = Language({op: row.c for op, row in OPERATIONS.items()}, "(double)NAN", "(double)INFINITY")
"""C99, and C++ where the functions of ``std`` are at hand."""
CPP = Language(
    {
        op: f"({row.c})" if op == "select" else row.c if op in _NEEDS else f"std::{row.c}"
        for op, row in OPERATIONS.items()
    }
    | {"sign": "detail::sign({})", "power_of_two_scale": "detail::power_of_two_scale({})"},
    "std::numeric_limits<Real>::quiet_NaN()",
    literal="Real({!r})",
    inputs={"eps": "std::numeric_limits<Real>::epsilon()", "largest": "(std::numeric_limits<Real>::max)()"},
)
"""C++17 in a type ``Real``, the parameter of a template; the brackets keep windows.h from reading a macro."""
MATLAB = Language({op: row.matlab for op, row in OPERATIONS.items()}, "NaN", "Inf")
MACROS = Language(
    {
        op: f"{'FABS' if op == 'abs' else op.upper()}({', '.join(['{}'] * row.c.count('{}'))})"
        for op, row in OPERATIONS.items()
    }
    | {op: OPERATIONS[op].c for op in ("add", "sub", "mul", "div", "neg")}
    | {"recip": "K(1.0)/{}"}
    | {op: f"TEST({OPERATIONS[op].c})" for op in COMPARISONS}
    | {"and": _BITS["and"], "or": _BITS["or"]},
    "(REAL)NAN",
    literal="K({!r})",
    inputs={"eps": "REAL_EPSILON", "largest": "REAL_MAX"},
)
"""C99 in a type REAL, ``double`` or ``float`` where it is compiled: constants, functions and choices are macros.

Each type has constants of its own precision: ``K(0.1)`` is ``0.1`` or ``0.1f``. In the loops that the compiler
vectorises sine, cosine and arc tangent are inline polynomials: a call to libm would stop vectorisation, and compilers
fuse sin and cos of one argument into a call that has no vector form. A condition is a mask of bits there and a select
blends with it: from ``?:`` compilers make control flow, and then no vectors (gcc 12 with nested conditions).
"""


def array_language(namespace: str) -> Language:
    """Return Python on arrays of a module that has the array API standard, ``np`` or ``jnp``."""
    written = {
        op: row.c if op in _NEEDS else f"{namespace}.{row.array}({', '.join(['{}'] * row.c.count('{}'))})"
        for op, row in OPERATIONS.items()
    }
    written |= _BITS | {"power_of_two_scale": "_power_of_two_scale({})"}
    of_constants = {"sqrt": "{}**0.5", "pow": "{}**{}"}  # the functions take arrays
    return Language(written, f"{namespace}.nan", f"{namespace}.inf", of_constants=of_constants)


NUMBER_TYPE = frozenset({"eps", "largest"})
"""Inputs of the kernels of papers that are the machine epsilon and the largest number of the number type."""


class Line(NamedTuple):
    """A name and what it stands for."""

    name: str
    text: str
    is_condition: bool
    is_read: bool
    """Whether a later line uses it; others are results."""
    done: tuple[str, ...]
    """Names of earlier lines that no later line and no result uses."""


class ProgramText(NamedTuple):
    """A program in a language."""

    lines: list[Line]
    results: dict[str, list[str]]
    """The components of each output."""
    operations: dict[str, int]
    """How often each kind of operation is done."""
    names: dict[int, str]
    """Of operations and inputs."""


class _Part(NamedTuple):
    """An operation that waits to be written into a line."""

    op: str
    text: str
    binds: int
    size: int
    reads: frozenset[int]
    below: str = ""
    """What a reciprocal divides by, or what is negative, in brackets where they are needed."""


def component_names(port: str, shape: Sequence[int]) -> list[str]:
    """Return the names of the components of a port: ``x``, ``x_1``, ``x_1_2``."""
    return ["_".join([port, *map(str, at)]) for at in product(*(range(1, n + 1) for n in shape))]


def program_text(program: Program, language: Language, apart: Collection[int] = ()) -> ProgramText:
    """Write a program whose inputs have the names of :func:`component_names`.

    The operations of `apart` have lines of their own, also where they are used once.

    Examples
    --------
    >>> from rodgen.codegen.tape import Tape, sin
    >>> tape = Tape()
    >>> (a,), (b,) = tape.inputs("a", 1), tape.inputs("b", 1)
    >>> twice = sin(a) / b
    >>> text = program_text(tape.program("f", {"a": (), "b": ()}, {"y": ((2,), [1 - twice * b, twice])}), C)
    >>> [(line.name, line.text) for line in text.lines], text.results
    ([('y_2', 'sin(a)/b'), ('y_1', '1.0 - b*y_2')], {'y': ['y_1', 'y_2']})
    """
    return _Writer(program, language, apart).whole()


class _Writer:
    def __init__(self, program: Program, language: Language, apart: Collection[int]) -> None:
        self.program, self.language, self.apart = program, language, apart
        self.uses = Counter(
            a for op, *args in program.operations if op not in GIVEN for a in args if isinstance(a, int)
        )
        self.names: dict[int, str] = {}
        self.held: dict[int, _Part] = {}
        self.lines: list[tuple[int, str, frozenset[int]]] = []
        self.counts: Counter[str] = Counter()
        self.results: set[int] = set()
        self.arrays: set[int] = set()
        for n, (op, *args) in enumerate(program.operations):
            operands = {a for a in args if isinstance(a, int)}
            if args[0] not in NUMBER_TYPE if op == "input" else op == "seed" or operands & self.arrays:
                self.arrays.add(n)
        self._name()

    def _name(self) -> None:
        """Choose names: those of the ports, of the steps, and numbers."""
        operations, taken = self.program.operations, set[str]()
        inputs = {port: component_names(port, shape) for port, shape in self.program.inputs.items()}
        for names in inputs.values():
            taken.update(names)
        for port, shape in self.program.outputs.items():
            # a single number is stored where its name points to in C
            names = component_names(port, shape) if shape else [f"{port}_value"]
            taken.update(names)
            for name, x in zip(names, self.program.results[port], strict=True):
                if isinstance(x, int):
                    self.results.add(x)
                    if operations[x][0] not in {*GIVEN, "pi"}:
                        self.names.setdefault(x, name)
        free = (name for name in (f"x{n}" for n in count()) if name not in taken)
        for n, (op, *args) in enumerate(operations):
            if op == "input":
                self.names[n] = self.language.inputs.get(args[0], inputs[args[0]][args[1]])
            elif op == "pi":
                self.names[n] = self.language.constant(math.pi)
            elif n not in self.names:
                name = self.program.names.get(n, "")
                self.names[n] = name if name and name not in taken else next(free)
                taken.add(self.names[n])

    def whole(self) -> ProgramText:
        for n, (op, *args) in enumerate(self.program.operations):
            if op not in GIVEN and op != "pi":
                self._operation(n, op, args)
        last = {a: at for at, (_, _, reads) in enumerate(self.lines) for a in reads}
        of_lines = {n for n, _, _ in self.lines}
        lines = []
        for at, (n, text, reads) in enumerate(self.lines):
            done = sorted(self.names[a] for a in (reads & of_lines) - self.results if last[a] == at)
            is_condition = self.program.operations[n][0] in CONDITIONS
            lines.append(Line(self.names[n], text, is_condition, n in last, tuple(done)))
        results = {
            port: [self.names[x] if isinstance(x, int) else self.language.constant(x) for x in values]
            for port, values in self.program.results.items()
        }
        first = ["add", "mul", "div", "sqrt", "select", "compare"]
        order = [*first, *sorted(self.counts.keys() - set(first))]
        counts = {kind: self.counts[kind] for kind in order if self.counts[kind]}
        return ProgramText(lines, results, counts, self.names)

    def _operation(self, n: int, op: str, args: Sequence[Operand]) -> None:
        parts = self._operands(args)
        self._count(op, parts)
        whole = self._joined(op, parts)
        if self.uses[n] == 1 and n not in self.results and n not in self.apart:
            self.held[n] = whole
        else:
            self.lines.append((n, whole.text, whole.reads))

    def _operands(self, args: Sequence[Operand]) -> list[_Part]:
        """Return the operands; those that make the line too long get lines of their own, the later ones first."""
        held = [a for a in args if isinstance(a, int) and a in self.held]
        size = len(args)
        reused = set()
        for a in held:
            if size - 1 + self.held[a].size <= LONGEST:
                size += self.held[a].size - 1
                reused.add(a)
        for a in held:
            if a not in reused:
                part = self.held.pop(a)
                self.lines.append((a, part.text, part.reads))
        return [self.held.pop(a) if isinstance(a, int) and a in reused else self._atom(a) for a in args]

    def _atom(self, x: Operand) -> _Part:
        if isinstance(x, int):
            return _Part("", self.names[x], 9, 1, frozenset({x}))
        return _Part("", self.language.constant(x), 9, 1, frozenset())

    def _joined(self, op: str, parts: Sequence[_Part]) -> _Part:
        written = self.language.written[op]
        if op in self.language.of_constants and not any(part.reads & self.arrays for part in parts):
            powers = (_bracketed(part, 9) for part in parts)
            text = self.language.of_constants[op].format(*powers)
            return _Part(op, text, 4, len(parts), frozenset().union(*(part.reads for part in parts)))
        size = sum(part.size for part in parts)
        reads = frozenset().union(*(part.reads for part in parts))
        if op == "mul" and "recip" in (parts[0].op, parts[1].op):
            above, below = parts if parts[1].op == "recip" else reversed(parts)
            over = self.language.written["div"].format(_bracketed(above, 3), below.below)
            return _Part("div", over, 3, size, reads)
        if op == "add" and parts[1].op == "neg":
            op, written, parts = (
                "sub",
                self.language.written["sub"],
                [parts[0], parts[1]._replace(text=parts[1].below)],
            )
        if written.endswith(")"):
            return _Part(op, written.format(*(part.text for part in parts)), 9, size, reads)
        needs = _NEEDS.get(op, (1,) * len(parts))
        texts = [_bracketed(part, need) for part, need in zip(parts, needs, strict=True)]
        if op in {"and", "or"} and parts[0].op == op:
            texts[0] = parts[0].text
        if op == "neg" and texts[0].startswith("-"):
            texts = [f"({texts[0]})"]
        return _Part(
            op, written.format(*texts), _BINDS[op], size, reads, texts[0] if op in {"recip", "neg"} else ""
        )

    def _count(self, op: str, parts: Sequence[_Part]) -> None:
        kinds = {"sub": "add", "recip": "div", **dict.fromkeys(COMPARISONS, "compare")}
        if op in {"neg", "and", "or", "not"} or not any(part.reads for part in parts):  # a compiler does it
            return
        if op == "mul" and "recip" in (parts[0].op, parts[1].op):
            return
        self.counts[kinds.get(op, op)] += 1


def _bracketed(part: _Part, need: int) -> str:
    return part.text if part.binds >= need else f"({part.text})"
