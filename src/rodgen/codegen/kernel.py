"""The one spec from which every target is made: a straight-line program with named, united ports.

A kernel computes outputs from inputs by a list of assignments, each of which uses only inputs and
earlier assignments. There is no branch: a case distinction is a select of two values, so that a C compiler
can vectorise the program and NumPy can evaluate it on whole arrays.

:class:`KernelBuilder` is how a derivation writes one; :class:`Kernel` is what comes out, after
common-subexpression elimination, and never changes again.
"""

from __future__ import annotations

import builtins
import keyword
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import Any, TypeAlias

import sympy as sp
from sympy.logic.boolalg import Boolean

from rodgen.codegen._cse import eliminate_common_subexpressions
from rodgen.codegen._numbering import joined
from rodgen.symbolic import EPS, LARGEST

__all__ = ["Assignment", "Kernel", "KernelBuilder", "KernelError", "Port", "UsualCase"]

_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z")
_WORDS_OF_C = """
auto bool case char const default do double enum extern false float goto inline int long register restrict
short signed sizeof static struct switch true typedef union unsigned void volatile
"""
_RESERVED = {
    *keyword.kwlist,
    *dir(builtins),
    *re.findall(r"\w+", _WORDS_OF_C),
    *(
        "linux",
        "unix",
        "NAN",
        "INFINITY",
        "NULL",
        "math",
        "np",
        "out",
        "count",
        "input",
        "output",
        "eps",
        "largest",
        "REAL",
    ),
}
"""Words of Python and C, and names that the templates or a compiler use."""

Value: TypeAlias = Any
"""A SymPy expression, or a matrix of them."""


class KernelError(ValueError):
    """A kernel that cannot be built: a name used twice, an unknown symbol, a shape that does not fit."""


@dataclass(frozen=True)
class Port:
    """An input or output of a kernel.

    Attributes
    ----------
    name : str
        Name in every target.
    shape : tuple of int
        ``()`` for a number.
    unit : str
        What it is measured in: ``"rad"``, ``"1"``, or a word such as ``"length"`` for any length unit.
    doc : str
        One phrase.
    symbols : tuple of sympy.Symbol
        Its components in row-major order: ``name`` itself, or ``name_1``, ``name_1_2``, ....
    enum : type of IntEnum or None
        The codes of a status; None for real numbers.
    between : tuple of two sympy numbers, or None
        From where tests sample each component of an input; None where nobody said.
    """

    name: str
    shape: tuple[int, ...]
    unit: str
    doc: str
    symbols: tuple[sp.Symbol, ...] = field(repr=False)
    enum: type[IntEnum] | None = None
    between: tuple[sp.Expr, sp.Expr] | None = None

    @property
    def size(self) -> int:
        """Number of components."""
        return math.prod(self.shape)

    @property
    def is_status(self) -> bool:
        """Whether the components are codes of :attr:`enum` rather than real numbers."""
        return self.enum is not None


@dataclass(frozen=True)
class Assignment:
    """One line of the program: ``symbol = value``; the value is real, or boolean for a condition."""

    symbol: sp.Symbol
    value: sp.Basic

    @property
    def is_condition(self) -> bool:
        """Whether the value is a truth value."""
        return self.symbol.is_real is None  # a symbol is a Boolean to SymPy, so the value does not tell


@dataclass(frozen=True)
class UsualCase:
    """Where a kernel needs none of its case distinctions.

    Attributes
    ----------
    guard : sympy boolean
        Condition in inputs and named steps; false where there is any doubt.
    values : dict of str to sympy number or boolean
        Named steps that have these values wherever `guard` holds. A scale may be given as 1 where scaling by a
        power of two changes no bit of the result.
    """

    guard: Boolean
    values: Mapping[str, sp.Basic]

    def __hash__(self) -> int:
        return hash((self.guard, tuple(sorted(self.values))))


@dataclass(frozen=True)
class Equations:
    """The implicit equations that outputs of a kernel solve; see :meth:`KernelBuilder.solves`.

    Attributes
    ----------
    program : Kernel
        Outputs ``residual`` and ``size``, one component an equation: left minus right side, and the sum of the
        magnitudes of its terms. Its inputs are those of the kernel, then the unknowns.
    unknowns : tuple of str
        Names of the outputs that are the unknowns.
    solutions : int or None
        How many solutions the first axis of each unknown holds; None for one without such an axis.
    where, nowhere : tuple of IntEnum
        Statuses with which the outputs are solutions, and with which there is none; empty for always, and never.
    complete : bool
        Whether the outputs are all solutions there are.
    tolerance : float
        Largest residual of a solution, relative to its size.
    """

    program: Kernel = field(repr=False)
    unknowns: tuple[str, ...]
    solutions: int | None
    where: tuple[IntEnum, ...]
    nowhere: tuple[IntEnum, ...]
    complete: bool
    tolerance: float


@dataclass(frozen=True)
class Derivative:
    """Which outputs of which kernel another kernel differentiates, and with respect to which inputs."""

    of: str
    outputs: tuple[str, ...]
    wrt: tuple[str, ...]
    where: tuple[IntEnum, ...] = ()


@dataclass(frozen=True)
class Kernel:
    """A straight-line program: inputs, assignments, outputs.

    Attributes
    ----------
    name : str
        Function name in every target.
    summary : str
        First line of the docstring.
    source : str
        Where the equations stand: paper and equation number, or the derivation's entry.
    inputs, outputs : tuple of Port
        In the order of the arguments.
    assignments : tuple of Assignment
        In the order of evaluation; the outputs' symbols are assigned last.
    notes : str
        Further paragraphs of the docstring.
    usual : UsualCase or None
        Where the program can be shortened; a target may use it for speed.
    equations : Equations or None
        What the outputs solve; a test is made of it.
    derivative : Derivative or None
        What the outputs are the derivatives of; a test is made of it.
    """

    name: str
    summary: str
    source: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    assignments: tuple[Assignment, ...] = field(repr=False)
    notes: str = field(default="", repr=False)
    usual: UsualCase | None = field(default=None, repr=False)
    equations: Equations | None = field(default=None, repr=False)
    derivative: Derivative | None = field(default=None, repr=False)

    def port(self, name: str) -> Port:
        """Return the input or output called `name`; KeyError where there is none."""
        for port in (*self.inputs, *self.outputs):
            if port.name == name:
                return port
        raise KeyError(f"kernel {self.name} has no port {name}")

    @cached_property
    def operations(self) -> dict[str, int]:
        """Floating-point operations of one evaluation, by kind (``add``, ``mul``, ``div``, ``sqrt``, ...)."""
        from rodgen.codegen._count import count_operations

        return count_operations(assignment.value for assignment in self.assignments)

    @cached_property
    def functions(self) -> frozenset[str]:
        """Names of the elementary functions that are called (``sin``, ``atan2``, ...)."""
        names = {type(f).__name__ for a in self.assignments for f in a.value.atoms(sp.Function)}
        return frozenset(names - {"Piecewise", "Abs", "sign", "power_of_two_scale"})

    def expand(self, output: str, keep: Iterable[str] = ()) -> Value:
        """Write an output, or a named step, in the inputs and the named steps of `keep`.

        This is what a derivation proves equal to its formula. Returned as a Matrix for a vector
        (a column) or matrix, as an expression for a number.

        Parameters
        ----------
        output : str
            An output, or a step that was named with :meth:`KernelBuilder.let`.
        keep : iterable of str
            Named steps that stay symbols; ``"w"`` keeps ``w_1``, ``w_2``, ``w_3``, too.
        """
        keep = set(keep)
        ports = [port for port in self.outputs if port.name == output]
        wanted = [
            a.symbol for a in self.assignments if re.fullmatch(rf"{re.escape(output)}(_\d+)*", a.symbol.name)
        ]
        if ports:
            wanted = list(ports[0].symbols)
        if not wanted:
            raise KeyError(f"kernel {self.name} has no output or step {output}")

        def is_kept(symbol: sp.Symbol) -> bool:
            kept = symbol.name in keep or symbol.name.rstrip("0123456789_") in keep
            return kept and symbol not in wanted

        open_steps = [a for a in self.assignments if not is_kept(a.symbol)]
        environment: dict[sp.Symbol, sp.Basic] = {}
        for assignment in _live(open_steps, wanted):
            environment[assignment.symbol] = assignment.value.xreplace(environment)
        values = [environment[symbol] for symbol in wanted]
        if len(values) == 1 and (not ports or ports[0].shape == ()):
            return values[0]
        return sp.Matrix(*(_matrix_shape(ports[0].shape) if ports else (len(values), 1)), values)

    def jacobian(
        self,
        wrt: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        *,
        name: str | None = None,
        summary: str | None = None,
        values: bool = False,
        mode: str = "forward",
        at: Mapping[str, Any] | None = None,
    ) -> Kernel:
        """Make the kernel of the derivatives, by accumulation through the assignments.

        Parameters
        ----------
        wrt : sequence of str, optional
            Inputs to differentiate with respect to; all of them when left out.
        outputs : sequence of str, optional
            Outputs to differentiate; all real ones when left out.
        name, summary : str, optional
            Of the new kernel; made from this one's when left out.
        values : bool
            Whether the differentiated outputs themselves are outputs, too.
        mode : str
            ``"forward"``, or ``"reverse"`` where the outputs have fewer components than the inputs: one sweep an
            output instead of one an input. The ports and, to rounding, the numbers are the same.
        at : mapping of str to number or nested sequence, optional
            Inputs that are held at numbers once the derivatives are taken; see :meth:`at`.

        Returns
        -------
        Kernel
            It has an output ``OUTPUT_jacobian`` for each differentiated output, with the inputs' components
            one after the other as its last axis; statuses stay as they are.
        """
        from rodgen.codegen.differentiate import jacobian

        made = jacobian(self, wrt, outputs, name=name, summary=summary, values=values, mode=mode)
        if at:
            return made.at(at)
        inputs = [p.name for p in self.inputs] if wrt is None else wrt
        real = [p.name for p in self.outputs if not p.is_status] if outputs is None else outputs
        where = self.equations.where if self.equations else ()
        return replace(made, derivative=Derivative(self.name, tuple(real), tuple(inputs), where))

    def after(self, first: Kernel) -> Kernel:
        """Take inputs from the outputs of another kernel that have their names: the two as one program.

        Parameters
        ----------
        first : Kernel
            Inputs that it has in common with this one are the same.

        Raises
        ------
        KernelError
            When no input is an output of `first`, or ports of one name differ in shape.

        Examples
        --------
        >>> k = KernelBuilder("area", summary="Area of a circle.", source="definition")
        >>> k.output("square", k.input("r", unit="m", doc="radius") ** 2, unit="m2", doc="its square")
        >>> area = k.build()
        >>> k = KernelBuilder("volume", summary="Volume of a cylinder.", source="definition")
        >>> square = k.input("square", unit="m2", doc="square of the radius")
        >>> k.output("volume", sp.pi * square * k.input("h", unit="m", doc="height"), unit="m3", doc="of all")
        >>> both = k.build().after(area)
        >>> both.expand("volume"), [port.name for port in both.inputs]
        (pi*h*r**2, ['h', 'r'])
        """
        taken = {port.name: port for port in first.outputs}
        known = {port.name: port for port in first.inputs}
        for port in self.inputs:
            other = taken.get(port.name) or known.get(port.name)
            if other is not None and other.shape != port.shape:
                raise KernelError(
                    f"{port.name} is {other.shape} in {first.name}, but {port.shape} in {self.name}"
                )
        if not any(port.name in taken for port in self.inputs):
            raise KernelError(f"kernel {self.name} takes nothing from {first.name}")
        own = {a.symbol: _like(a.symbol, f"{first.name}_{a.symbol.name}") for a in first.assignments}
        steps = [replace(a, symbol=own[a.symbol], value=a.value.xreplace(own)) for a in first.assignments]
        ports = [port for port in self.inputs if port.name in taken]
        given = {
            s: own[t] for port in ports for s, t in zip(port.symbols, taken[port.name].symbols, strict=True)
        }
        steps += [replace(a, value=a.value.xreplace(given)) for a in self.assignments]
        inputs = {port.name: port for port in (*self.inputs, *first.inputs) if port.name not in taken}
        return replace(self, inputs=tuple(inputs.values()), assignments=tuple(steps))

    def at(self, values: Mapping[str, Any], *, name: str | None = None) -> Kernel:
        """Hold inputs at numbers: the kernel without these inputs, and without what they make needless.

        Parameters
        ----------
        values : mapping of str to number or nested sequence
            For each of some inputs an exact number for all its components, or one for each.
        name : str, optional
            Of the new kernel; this one's when left out.

        Raises
        ------
        KernelError
            When no number of that shape is given, or an output has no value there.

        Examples
        --------
        >>> k = KernelBuilder("spring", summary="Force of a spring.", source="definition")
        >>> x = k.input("x", unit="m", doc="elongation")
        >>> a = k.input("a", 2, unit="N/m", doc="stiffness, and its growth")
        >>> k.output("force", a[0] * x + a[1] * x**2, unit="N", doc="towards the rest")
        >>> k.build().at({"a": [3, 0]}).expand("force")
        3*x
        """
        from rodgen.codegen._numbering import numbered

        known: dict[sp.Symbol, sp.Basic] = {}
        for key, value in values.items():
            port = self.port(key)
            numbers = [sp.sympify(x) for x in sp.flatten([value])]
            numbers = [sp.Rational(x) if x.is_Float else x for x in numbers]
            if len(numbers) not in (1, port.size) or not all(x.is_number for x in numbers):
                raise KernelError(
                    f"kernel {self.name}: {key} is held at {value}; expected one number or {port.size}"
                )
            known.update(zip(port.symbols, numbers * (port.size // len(numbers)), strict=True))
        program = numbered(self, self.outputs, known)
        results = {s: program.operand(s) for port in self.outputs for s in port.symbols}
        for symbol, result in results.items():
            if result is sp.nan:
                raise KernelError(f"kernel {self.name}: {symbol.name} has no value at {dict(values)}")
        steps = [Assignment(symbol, value) for symbol, value in (*program.lines, *results.items())]
        inputs = [port for port in self.inputs if port.name not in values]
        made = (name or self.name, self.summary, self.source, inputs, self.outputs, steps, self.notes)
        return finish(*made, shared=True)

    def evaluate(
        self, values: Mapping[str, Any], *, digits: int = 50, eps: Any = None, largest: Any = None
    ) -> dict[str, Any]:
        """Evaluate the same program with `digits` decimal digits; see :mod:`rodgen.codegen.exact`."""
        from rodgen.codegen.exact import evaluate

        return evaluate(self, values, digits=digits, eps=eps, largest=largest)

    @cached_property
    def programs(self) -> dict[int, Any]:
        """What :func:`rodgen.codegen.exact.program` made of this kernel, by digits."""
        return {}

    def usual_case(self) -> Kernel:
        """Return the shorter kernel of the usual case, with a further output: the condition ``is_usual``.

        Where it is false the other outputs mean nothing.
        """
        if self.usual is None:
            raise KernelError(f"kernel {self.name} has no usual case")
        known: dict[sp.Symbol, sp.Basic] = {}
        steps = []
        for a in self.assignments:
            value = self.usual.values.get(a.symbol.name, a.value).xreplace(known)
            if value.is_Symbol or value.is_Number or value in (sp.true, sp.false):
                known[a.symbol] = value
            steps.append(Assignment(a.symbol, value))
        symbol = sp.Symbol("is_usual")
        steps.append(Assignment(symbol, self.usual.guard.xreplace(known)))
        port = Port("is_usual", (), "1", "whether the other outputs hold", (symbol,))
        return finish(
            f"{self.name}_usual",
            self.summary,
            self.source,
            self.inputs,
            (*self.outputs, port),
            steps,
            self.notes,
        )


def _matrix_shape(shape: tuple[int, ...]) -> tuple[int, int]:
    if len(shape) == 1:
        return shape[0], 1
    return math.prod(shape[:-1]), shape[-1]


def port_symbols(name: str, shape: tuple[int, ...]) -> tuple[sp.Symbol, ...]:
    """Return the real symbols of a port's components, in row-major order."""
    names = [name]
    for length in shape:
        names = [f"{prefix}_{index}" for prefix in names for index in range(1, length + 1)]
    return tuple(sp.Symbol(n, real=True) for n in names)


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
        self._names: set[str] = {EPS.name, LARGEST.name}
        self._known: set[sp.Symbol] = {EPS, LARGEST}
        self._usual: UsualCase | None = None
        self._solves: tuple[tuple[sp.Basic, ...], dict[str, Any]] | None = None

    def input(
        self,
        name: str,
        shape: int | tuple[int, ...] = (),
        *,
        unit: str,
        doc: str,
        between: tuple[Any, Any] | None = None,
    ) -> Any:
        """Declare an input and return its symbols.

        Parameters
        ----------
        name : str
            An identifier.
        shape : int or tuple of int
            ``()`` for a number.
        unit, doc : str
            What it is measured in, and what it is.
        between : tuple of two numbers, optional
            From where tests sample each component. A kernel that has it for every input is emitted with a test.

        Returns
        -------
        Symbol, Matrix or ImmutableDenseNDimArray
            A Symbol for ``shape=()``, a column Matrix for an integer or a 1-tuple, a Matrix for a 2-tuple, an
            array beyond.
        """
        shape = (shape,) if isinstance(shape, int) else tuple(shape)
        symbols = port_symbols(name, shape)
        domain = None if between is None else _domain(name, between)
        self._claim(name, symbols)
        self._inputs.append(Port(name, shape, unit, doc, symbols, between=domain))
        self._known.update(symbols)
        return _packed(symbols, shape)

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
            return symbol
        shape = _shape(value)
        symbols = port_symbols(name, shape)
        self._claim(name, symbols)
        for symbol, component in zip(symbols, _components(value), strict=True):
            self._step(symbol, component)
        return _packed(symbols, shape)

    def include(self, kernel: Kernel) -> dict[str, Any]:
        """Take in all steps of another kernel, its inputs as inputs; return its outputs by name as symbols."""
        for port in kernel.inputs:
            self._claim(port.name, port.symbols)
            self._inputs.append(port)
            self._known.update(port.symbols)
        for assignment in kernel.assignments:
            self._names.add(assignment.symbol.name)
            self._step(assignment.symbol, assignment.value)
        return {port.name: _packed(port.symbols, port.shape) for port in kernel.outputs}

    def output(self, name: str, value: Any, *, unit: str, doc: str) -> None:
        """Declare a real output and its value."""
        self._output(name, value, unit, doc, None)

    def status(self, name: str, value: sp.Expr, enum: type[IntEnum], *, doc: str) -> None:
        """Declare an integer output whose value is one of the codes of `enum`."""
        self._output(name, value, "1", doc, enum)

    def usual(self, guard: Boolean, **values: Any) -> None:
        """Declare, after the outputs, where the case distinctions are not needed; see :class:`UsualCase`."""
        known = {s.name for s in self._known} & self._live_names()
        unknown = sorted({s.name for s in guard.free_symbols} - known | set(values) - self._names)
        if unknown:
            raise KernelError(
                f"kernel {self._name}: the usual case names {', '.join(unknown)}, no step that an output needs"
            )
        self._usual = UsualCase(guard, {name: sp.sympify(value) for name, value in values.items()})

    def _live_names(self) -> set[str]:
        wanted = [s for port in self._outputs for s in port.symbols]
        named = {a.symbol.name for a in _live(self._steps, wanted)}
        return named | {s.name for port in self._inputs for s in port.symbols} | {EPS.name, LARGEST.name}

    def solves(
        self,
        *equations: sp.Basic,
        where: Sequence[IntEnum] = (),
        nowhere: Sequence[IntEnum] = (),
        complete: bool = True,
        tolerance: float = 2.0**-40,
    ) -> None:
        """Say which implicit equations the outputs solve: the emitted test solves them numerically and compares.

        Parameters
        ----------
        *equations : equation or expression
            In the names of inputs and outputs; an expression stands for its zero. Where an output ``x`` of shape
            (n,) holds n solutions, they are written with ``x`` itself, where (n, 3) does, with ``x_1`` to ``x_3``:
            every output in the equations then has the solutions along its first axis.
        where : sequence of IntEnum, optional
            Statuses with which the outputs are solutions; every one when left out.
        nowhere : sequence of IntEnum, optional
            Statuses with which there is no solution.
        complete : bool
            Whether the outputs are all the solutions there are.
        tolerance : float
            Largest residual, relative to the magnitudes of an equation's terms. The default is 4096 roundings of
            float64: room for the rounding of a few hundred operations, none for a wrong formula.

        Examples
        --------
        >>> import sympy as sp
        >>> k = KernelBuilder("square_roots", summary="Both square roots.", source="definition")
        >>> square = k.input("square", unit="1", doc="a positive number", between=(1, 9))
        >>> k.output("root", sp.Matrix([sp.sqrt(square), -sp.sqrt(square)]), unit="1", doc="the roots")
        >>> k.solves(sp.Eq(sp.Symbol("root") ** 2, square))
        >>> k.build().equations.solutions
        2
        """
        if self._solves is not None:
            raise KernelError(f"kernel {self._name}: solves() is called twice; give all equations at once")
        options = {
            "where": tuple(where),
            "nowhere": tuple(nowhere),
            "complete": complete,
            "tolerance": tolerance,
        }
        self._solves = equations, options

    def build(self) -> Kernel:
        """Eliminate common subexpressions and return the kernel."""
        if not self._outputs:
            raise KernelError(f"kernel {self._name} has no output")
        kernel = finish(
            self._name, self._summary, self._source, self._inputs, self._outputs, self._steps, self._notes
        )
        solved = None
        if self._solves is not None:
            from rodgen.codegen._equations import equations_of

            solved = equations_of(kernel, self._solves[0], **self._solves[1])
        return replace(kernel, usual=self._usual, equations=solved)

    def _output(self, name: str, value: Any, unit: str, doc: str, enum: type[IntEnum] | None) -> None:
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
        from rodgen.codegen.printers import NumPyPrinter

        try:
            NumPyPrinter().line(value)  # told here, so that the traceback leads to the line of the script
        except KernelError as error:
            raise KernelError(f"kernel {self._name}: {symbol.name}: {error}") from None
        self._steps.append(Assignment(symbol, value))
        self._known.add(symbol)


def finish(
    name: str,
    summary: str,
    source: str,
    inputs: Sequence[Port],
    outputs: Sequence[Port],
    steps: Sequence[Assignment],
    notes: str,
    *,
    shared: bool = False,
) -> Kernel:
    """Make a kernel of raw steps: drop what no output needs, share what is computed twice.

    Where the steps are `shared`, as a :class:`~rodgen.codegen._numbering.Numbering` writes them, lines are joined.
    """
    wanted = [symbol for port in outputs for symbol in port.symbols]
    live = [(a.symbol, a.value) for a in _live(steps, wanted)]
    if shared:
        pairs = list(joined(live, set(wanted)))
    else:
        taken = {symbol.name for symbol, _ in live} | {s.name for port in inputs for s in port.symbols}
        pairs = eliminate_common_subexpressions(live, taken)
    return Kernel(
        name,
        summary,
        source,
        tuple(inputs),
        tuple(outputs),
        tuple(Assignment(symbol, value) for symbol, value in pairs),
        notes,
    )


def _like(symbol: sp.Symbol, name: str) -> sp.Symbol:
    """Return a symbol of another name, that is real or a condition as this one is."""
    return sp.Symbol(name, **symbol.assumptions0) if symbol.is_real else sp.Symbol(name)


def _live(steps: Sequence[Assignment], wanted: Iterable[sp.Symbol]) -> Iterator[Assignment]:
    needed = set(wanted)
    kept = []
    for step in reversed(steps):
        if step.symbol in needed:
            needed |= step.value.free_symbols
            kept.append(step)
    return reversed(kept)


def _domain(name: str, between: tuple[Any, Any]) -> tuple[sp.Expr, sp.Expr]:
    low, high = (sp.sympify(x) for x in between)
    if not (low.is_real and high.is_real and low.is_finite and high.is_finite and low < high):
        raise KernelError(f"{name} is between {low} and {high}; expected two rising numbers")
    return low, high


def _identifier(name: str) -> str:
    if not _IDENTIFIER.match(name):
        raise KernelError(f"{name!r} is no name for generated code; expected a plain identifier")
    if name in _RESERVED or name.startswith(("DBL_", "FLT_", "REAL_")):
        raise KernelError(
            f"{name!r} is no name for generated code: it is reserved there; expected another one"
        )
    return name


def _packed(symbols: tuple[sp.Symbol, ...], shape: tuple[int, ...]) -> Any:
    if shape == ():
        return symbols[0]
    if len(shape) <= 2:
        return sp.Matrix(*_matrix_shape(shape), symbols)
    return sp.ImmutableDenseNDimArray(symbols, shape)
