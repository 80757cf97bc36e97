"""The builder with which a derivation writes a kernel, step by step."""

from __future__ import annotations

import builtins
import keyword
import re
from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import Any

import sympy as sp
from sympy.logic.boolalg import Boolean

from rodgen.codegen.expressions import check_expression
from rodgen.codegen.kernel import Kernel, Value
from rodgen.codegen.kernel_parts import (
    Assignment,
    KernelError,
    Port,
    UsualCase,
    live_steps,
    packed,
    port_symbols,
)
from rodgen.codegen.operations import OPERATIONS
from rodgen.symbolic import EPS, LARGEST

_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z")
_WORDS_OF_C = """
auto bool case char const default do double enum extern false float goto inline int long register restrict
short signed sizeof static struct switch true typedef union unsigned void volatile
"""
_WORDS_OF_TEMPLATES = """
copysign ldexp isfinite linux unix NAN INFINITY NULL math np xp out count input output eps largest
BLOCK CODE CONDITION REAL INLINED SHARED VECTORISE LOOP_ISA MAYBE_UNUSED ON_COLUMNS STREAM_FROM_BYTES
BIG_ENDIAN BYTE_ORDER FD_SETSIZE LITTLE_ENDIAN NFDBITS PDP_ENDIAN
WCONTINUED WEXITED WNOHANG WNOWAIT WSTOPPED WUNTRACED
"""
_RESERVED = {
    *keyword.kwlist,
    *dir(builtins),
    *re.findall(r"\w+", _WORDS_OF_C + _WORDS_OF_TEMPLATES),
    # functions that a variable of the same name would hide
    *(row.c.partition("(")[0] for row in OPERATIONS.values() if row.c.endswith(")")),
    *("sign_f64", "power_of_two_scale_f64"),
}
"""Words of Python and C, and names that the templates or a compiler use."""
_MACROS = re.compile(
    r"(DBL|FLT|LDBL|REAL|FE|FP|MATH|EXIT|VECTOR|RODGEN)_\w+|HUGE_VAL[FL]?|DECIMAL_DIG|math_errhandling"
    r"|(U?INT\w*|SIZE|PTRDIFF|SIG_ATOMIC|WCHAR|WINT|RAND|MB_CUR)_(MAX|MIN)"
    r"|M_(E|LOG2E|LOG10E|LN2|LN10|[12]_PI|2_SQRTPI|PI(_[24])?|SQRT(2|1_2))"
)
"""What the headers of C and those of the loops define."""


class KernelBuilder:
    """Write a kernel step by step.

    Parameters
    ----------
    name : str
        An identifier, valid in Python and C.
    summary : str
        First line of the docstring.
    source : str
        Paper and equation number.
    notes : str, optional
        Further paragraphs of the docstring.

    Examples
    --------
    >>> k = KernelBuilder("lever", summary="Moment of a force.", source="definition")
    >>> arm = k.input("arm", 3, unit="m", doc="from the pivot")
    >>> force = k.input("force", 3, unit="N", doc="at its end")
    >>> k.output("moment", arm.cross(force), unit="N m", doc="about the pivot")
    >>> k.build().operations
    {'add': 3, 'mul': 6}
    """

    def __init__(self, name: str, *, summary: str, source: str, notes: str = "") -> None:
        self._name = _identifier(name)
        self._summary = summary
        self._source = source
        self._notes = notes
        self._inputs: list[Port] = []
        self._outputs: list[Port] = []
        self._steps: list[Assignment] = []
        self._named: dict[str, Value] = {}
        self._names: set[str] = {EPS.name, LARGEST.name}
        self._known: set[sp.Symbol] = {EPS, LARGEST}
        self._usual: UsualCase | None = None

    def input(self, name: str, shape: int | tuple[int, ...] = (), *, unit: str, doc: str) -> Any:
        """Declare an input and return its symbols.

        Parameters
        ----------
        name : str
            An identifier.
        shape : int or tuple of int
            ``()`` for a number.
        unit, doc : str
            What it is measured in, and what it is.

        Returns
        -------
        Symbol, Matrix or ImmutableDenseNDimArray
            A Symbol for ``shape=()``, a column Matrix for an integer or a 1-tuple, a Matrix for a 2-tuple, an
            array beyond.
        """
        shape = (shape,) if isinstance(shape, int) else tuple(shape)
        symbols = port_symbols(name, shape)
        self._claim(name, symbols)
        self._inputs.append(Port(name, shape, unit, doc, symbols))
        self._known.update(symbols)
        return packed(symbols, shape)

    def __getitem__(self, name: str) -> Any:
        """Return the symbol, Matrix or array that :meth:`let` returned for the step `name`."""
        if name not in self._named:
            raise KernelError(f"kernel {self._name} has no step {name}")
        return self._named[name]

    def let(self, name: str, value: Any) -> Any:
        """Name an intermediate value; return its symbol, or a Matrix of symbols.

        A named step is evaluated as it stands: use it to fix the order of operations where rounding
        depends on it. A condition gives a boolean symbol.
        """
        if isinstance(value, Boolean) and not (
            value.is_Symbol and value.is_real
        ):  # a symbol is a Boolean to SymPy
            symbol = sp.Symbol(name)
            self._claim(name, (symbol,))
            self._step(symbol, value)
            self._named[name] = symbol
            return symbol
        shape = _shape(value)
        symbols = port_symbols(name, shape)
        self._claim(name, symbols)
        for symbol, component in zip(symbols, _components(value), strict=True):
            self._step(symbol, component)
        self._named[name] = packed(symbols, shape)
        return packed(symbols, shape)

    def include(self, kernel: Kernel) -> dict[str, Any]:
        """Add the inputs and steps of another kernel; return the symbols of its outputs, by name."""
        for port in kernel.inputs:
            self._claim(port.name, port.symbols)
            self._inputs.append(port)
            self._known.update(port.symbols)
        for assignment in kernel.assignments:
            self._names.add(assignment.symbol.name)
            self._step(assignment.symbol, assignment.value)
        outputs = {port.name: port.value for port in kernel.outputs}
        self._named |= {**kernel.steps, **outputs}
        return outputs

    def output(self, name: str, value: Any, *, unit: str, doc: str) -> None:
        """Declare a real output and its value."""
        self._output(name, value, unit, doc, None)

    def status(self, name: str, value: sp.Expr, enum: type[IntEnum], *, doc: str) -> None:
        """Declare an integer output whose value is one of the codes of `enum`."""
        self._output(name, value, "1", doc, enum)

    def usual(self, guard: Boolean, **values: Any) -> None:
        """Declare, after the outputs, when no case distinction is needed; see :class:`UsualCase`."""
        known = {s.name for s in self._known} & self._live_names()
        unknown = sorted({s.name for s in guard.free_symbols} - known | set(values) - self._names)
        if unknown:
            raise KernelError(
                f"kernel {self._name}: the usual case names {', '.join(unknown)}, no step that an output needs"
            )
        self._usual = UsualCase(guard, {name: sp.sympify(value) for name, value in values.items()})

    def _live_names(self) -> set[str]:
        wanted = [s for port in self._outputs for s in port.symbols]
        named = {a.symbol.name for a in live_steps(self._steps, wanted)}
        return named | {s.name for port in self._inputs for s in port.symbols} | {EPS.name, LARGEST.name}

    def build(self) -> Kernel:
        """Return the kernel."""
        if not self._outputs:
            raise KernelError(f"kernel {self._name} has no output")
        return Kernel(
            self._name,
            self._summary,
            self._source,
            tuple(self._inputs),
            tuple(self._outputs),
            tuple(live_steps(self._steps, [s for port in self._outputs for s in port.symbols])),
            self._notes,
            self._usual,
            dict(self._named),
        )

    def _output(self, name: str, value: Any, unit: str, doc: str, enum: type[IntEnum] | None) -> None:
        if isinstance(value, list | tuple):
            raise KernelError(f"kernel {self._name}: {name} is a list; expected an expression or a matrix")
        shape = _shape(value)
        symbols = port_symbols(name, shape)
        self._claim(name, symbols)
        self._outputs.append(Port(name, shape, unit, doc, symbols, enum))
        for symbol, component in zip(symbols, _components(value), strict=True):
            self._step(symbol, component)

    def _claim(self, name: str, symbols: Iterable[sp.Symbol]) -> None:
        names = {_identifier(name), *(symbol.name for symbol in symbols)}
        taken = names & self._names
        if taken:
            raise KernelError(f"kernel {self._name}: the name {min(taken)} is used twice")
        self._names |= names

    def _step(self, symbol: sp.Symbol, value: sp.Basic) -> None:
        unknown = sorted(s.name for s in value.free_symbols - self._known)
        if unknown:
            alike = {s.name for s in self._known} & set(unknown)
            raise KernelError(
                f"kernel {self._name}: {symbol.name} uses {', '.join(unknown)}; expected inputs and earlier steps "
                "only" + (f"; {min(alike)} here is another symbol than input() returned" if alike else "")
            )
        try:
            check_expression(value)  # raised here, so that the traceback leads to the line of the script
        except KernelError as error:
            raise KernelError(f"kernel {self._name}: {symbol.name}: {error}") from None
        self._steps.append(Assignment(symbol, value))
        self._known.add(symbol)


def _components(value: Value | Sequence[Any]) -> list[sp.Expr]:
    if isinstance(value, sp.MatrixBase):
        return list(value)
    if isinstance(value, sp.NDimArray):
        return list(sp.flatten(value.tolist()))
    return [sp.sympify(value)]


def _shape(value: Value | Sequence[Any]) -> tuple[int, ...]:
    if isinstance(value, sp.MatrixBase):
        rows, columns = value.shape
        return (rows,) if columns == 1 else (rows, columns)
    if isinstance(value, sp.NDimArray):
        return tuple(int(n) for n in value.shape)
    return ()


def _identifier(name: str) -> str:
    if not _IDENTIFIER.match(name):
        raise KernelError(f"{name!r} is not a valid name in generated code; expected a plain identifier")
    if name in _RESERVED or _MACROS.fullmatch(name):
        raise KernelError(
            f"{name!r} is not a valid name in generated code: it is reserved there; expected another one"
        )
    return name
