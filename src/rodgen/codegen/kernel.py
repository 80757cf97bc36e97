"""The one spec from which every target is made: a straight-line program with named ports and units.

A kernel computes outputs from inputs by a list of assignments, each of which uses only inputs and
earlier assignments. There is no branch: a case distinction is a select of two values, so that a C compiler
can vectorise the program and NumPy can evaluate it on whole arrays.

:class:`rodgen.codegen.KernelBuilder` is how a derivation writes one; :class:`Kernel` is the result, and never changes
again. Its assignments are SymPy's expressions, as they were written, for proofs and derivatives; what is written or
evaluated is its :attr:`Kernel.program`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import sympy as sp

from rodgen.codegen.exact import evaluate
from rodgen.codegen.expressions import FUNCTIONS, program_of
from rodgen.codegen.kernel_parts import (
    Assignment,
    KernelError,
    Port,
    UsualCase,
    live_steps,
    port_symbols,
    slope,
)
from rodgen.codegen.program import Program
from rodgen.codegen.program_text import MACROS, Language, ProgramText, program_text

Value: TypeAlias = Any
"""A SymPy expression, or a matrix or array of them."""


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
    steps : mapping of str to Symbol, Matrix or array of symbols
        The results of :meth:`KernelBuilder.let`, by name; `assignments` has only those that an output needs.
    """

    name: str
    summary: str
    source: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    assignments: tuple[Assignment, ...] = field(repr=False)
    notes: str = field(default="", repr=False)
    usual: UsualCase | None = field(default=None, repr=False)
    steps: Mapping[str, Value] = field(default_factory=dict, repr=False, compare=False)

    def port(self, name: str) -> Port:
        """Return the input or output called `name`; a KeyError if there is none."""
        for port in (*self.inputs, *self.outputs):
            if port.name == name:
                return port
        raise KeyError(f"kernel {self.name} has no port {name}")

    @cached_property
    def program(self) -> Program:
        """The assignments as operations, of which each is done once: what all targets are written from."""
        return program_of(self.name, self.inputs, self.outputs, self.assignments)

    def text(self, language: Language) -> ProgramText:
        """Return the program in a language; named steps and angles have lines of their own."""
        return program_text(self.program, language, {*self.program.names, *self.angles})

    @cached_property
    def macros(self) -> ProgramText:
        """The program in C, whose functions are macros."""
        return self.text(MACROS)

    @property
    def operations(self) -> dict[str, int]:
        """Floating-point operations of one evaluation, by kind (``add``, ``mul``, ``div``, ``sqrt``, ...)."""
        return self.macros.operations

    @cached_property
    def functions(self) -> frozenset[str]:
        """Names of the elementary functions that are called (``sin``, ``atan2``, ...)."""
        called = {op for op, *_ in self.program.operations} & set(FUNCTIONS.values())
        return frozenset(called - {"abs", "sign", "power_of_two_scale"})

    @property
    def angles(self) -> list[int]:
        """The operations, or inputs, of which a sine or cosine is taken."""
        operands = (args[0] for op, *args in self.program.operations if op in {"sin", "cos"})
        return sorted({x for x in operands if isinstance(x, int)})

    def __getitem__(self, name: str) -> Value:
        """Return the symbol, or the Matrix or array of symbols, of the input, output or named step `name`."""
        for port in (*self.inputs, *self.outputs):
            if port.name == name:
                return port.value
        if name not in self.steps:
            raise KeyError(f"kernel {self.name} has no input, output or step {name}")
        return self.steps[name]

    def substitution(self, **values: Any) -> dict[sp.Symbol, sp.Basic]:
        """Return the mapping with which ``subs`` or ``xreplace`` puts `values` in place of ports and named steps.

        Examples
        --------
        >>> from rodgen.codegen import KernelBuilder
        >>> k = KernelBuilder("length", summary="Length of a vector.", source="definition")
        >>> x = k.input("x", 2, unit="m", doc="vector")
        >>> square = k.let("square", x.dot(x))
        >>> k.output("length", sp.sqrt(square), unit="m", doc="its length")
        >>> kernel = k.build()
        >>> kernel.expand("length"), kernel.expand("length", keep=[square])
        (sqrt(x_1**2 + x_2**2), sqrt(square))
        >>> kernel.expand("length").subs(kernel.substitution(x=(3, 4)))
        5
        """
        return {
            symbol: sp.sympify(part)
            for name, value in values.items()
            for symbol, part in zip(sp.flatten([self[name]]), sp.flatten([value]), strict=True)
        }

    def expand(self, value: str | Value, keep: Iterable[Value] = ()) -> Value:
        """Write a value in the inputs and the named steps of `keep`.

        This is what a derivation proves equal to its formula.

        Parameters
        ----------
        value : str, or expression or Matrix
            The name of an output, or anything in the kernel's symbols, as ``kernel["step"]``.
        keep : iterable of Symbol or Matrix
            Steps that stay symbols, as :meth:`KernelBuilder.let` returned them, or ``kernel["step"]``; derivatives
            have none.

        Raises
        ------
        KeyError
            For what the kernel does not compute.
        KernelError
            For a derivative that is to be written with steps of `keep`.
        """
        if isinstance(value, str):
            value = self[value]
        wanted = value.free_symbols
        needed_symbols = {symbol for step in keep for symbol in step.free_symbols} - wanted
        environment: dict[sp.Symbol, sp.Basic] = {s: s for port in self.inputs for s in port.symbols}
        for symbol, step in live_steps(
            [a for a in self.assignments if a.symbol not in needed_symbols], wanted
        ):
            if isinstance(step, slope):
                if needed_symbols:
                    raise KernelError(
                        f"kernel {self.name}: {symbol.name} is a derivative; expand it without `keep`"
                    )
                environment[symbol] = environment[step.args[0]].diff(step.args[1])
            else:
                environment[symbol] = step.xreplace(environment)
        missing = sorted(symbol.name for symbol in wanted - set(environment))
        if missing:
            raise KeyError(f"kernel {self.name} does not compute {', '.join(missing)}")
        return value.xreplace(environment)

    def jacobian(
        self,
        wrt: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        *,
        name: str | None = None,
        summary: str | None = None,
        values: bool = False,
    ) -> Kernel:
        """Return the kernel of the derivatives, by accumulation through the assignments.

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

        Returns
        -------
        Kernel
            It has an output ``OUTPUT_jacobian`` for each differentiated output, with the inputs' components
            one after the other as its last axis; statuses stay as they are. Where an output is infinite, such as
            1/(x y) at y = 0, a derivative is infinite or NaN: the rule for products takes infinity times 0.
        """
        inputs = [p.name for p in self.inputs] if wrt is None else list(wrt)
        variables = [s for n in inputs for s in self.port(n).symbols]
        real = (
            [p for p in self.outputs if not p.is_status] if outputs is None else list(map(self.port, outputs))
        )
        if any(port.is_status for port in real):
            raise KernelError(f"kernel {self.name}: a status has no derivative")
        ports, steps = list[Port](), list(self.assignments)
        for port in real:
            jacobian_name, shape = f"{port.name}_jacobian", (*port.shape, len(variables))
            unit = f"{port.unit} per unit of {', '.join(inputs)}"
            doc = f"derivative of {port.name}; last axis: {', '.join(x.name for x in variables)}"
            ports.append(Port(jacobian_name, shape, unit, doc, port_symbols(jacobian_name, shape)))
            slopes = (slope(y, x) for y in port.symbols for x in variables)
            steps += map(Assignment, ports[-1].symbols, slopes)
        derived = self._with_program(
            name or f"{self.name}_jacobian",
            self.inputs,
            (*(real if values else ()), *ports, *(port for port in self.outputs if port.is_status)),
            steps,
        )
        return replace(derived, summary=summary or f"Derivatives of {self.name}.")

    def evaluate(
        self, values: Mapping[str, Any], *, digits: int = 50, eps: Any = None, largest: Any = None
    ) -> dict[str, Any]:
        """Evaluate the same program with `digits` decimal digits; see :mod:`rodgen.codegen.exact`."""
        return evaluate(self.program, self.inputs, self.outputs, values, digits, eps, largest)

    def usual_case(self) -> Kernel:
        """Return the shorter kernel of the usual case, with a further output: the condition ``is_usual``.

        Where it is false the other outputs mean nothing.
        """
        if self.usual is None:
            raise KernelError(f"kernel {self.name} has no usual case")
        known: dict[sp.Symbol, sp.Basic] = {}
        steps = list[Assignment]()
        for a in self.assignments:
            value = self.usual.values.get(a.symbol.name, a.value).xreplace(known)
            if value.is_Symbol or value.is_Number or value in (sp.true, sp.false):
                known[a.symbol] = value
            steps.append(Assignment(a.symbol, value))
        symbol = sp.Symbol("is_usual")
        steps.append(Assignment(symbol, self.usual.guard.xreplace(known)))
        port = Port("is_usual", (), "1", "whether the other outputs hold", (symbol,))
        return self._with_program(f"{self.name}_usual", self.inputs, (*self.outputs, port), steps)

    def _with_program(
        self,
        name: str,
        inputs: Sequence[Port],
        outputs: Sequence[Port],
        steps: Sequence[Assignment],
    ) -> Kernel:
        """Return a kernel of other steps with this one's summary, source, notes and named steps."""
        live = tuple(live_steps(steps, [symbol for port in outputs for symbol in port.symbols]))
        return replace(
            self, name=name, inputs=tuple(inputs), outputs=tuple(outputs), assignments=live, usual=None
        )
