"""The parts of a kernel: ports, assignments, and its usual case.

:mod:`rodgen.codegen.kernel` makes one object of them, :mod:`rodgen.codegen.builder` writes them step by step.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, NamedTuple, TypeVar

import sympy as sp
from sympy.logic.boolalg import Boolean

Step = TypeVar("Step", bound=tuple[sp.Symbol, sp.Basic])


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
    """

    name: str
    shape: tuple[int, ...]
    unit: str
    doc: str
    symbols: tuple[sp.Symbol, ...] = field(repr=False)
    enum: type[IntEnum] | None = None

    @property
    def size(self) -> int:
        """Number of components."""
        return math.prod(self.shape)

    @property
    def value(self) -> Any:
        """The symbols in the shape of the port: one symbol, a column, or a matrix."""
        return packed(self.symbols, self.shape)

    @property
    def is_status(self) -> bool:
        """Whether the components are codes of :attr:`enum` rather than real numbers."""
        return self.enum is not None


class Assignment(NamedTuple):
    """One line of a kernel: ``symbol = value``; the value is real, or boolean for a condition."""

    symbol: sp.Symbol
    value: sp.Basic

    @property
    def is_condition(self) -> bool:
        """Whether the value is a truth value."""
        return self.symbol.is_real is None  # a symbol is a Boolean to SymPy, so the value does not decide


@dataclass(frozen=True)
class UsualCase:
    """Where a kernel needs none of its case distinctions."""

    guard: Boolean
    """Condition in inputs and named steps; false where there is any doubt."""
    values: Mapping[str, sp.Basic]
    """Named steps that have these values wherever `guard` holds. A scale may be given as 1 where scaling by a power of
    two changes no bit of the result."""

    def __hash__(self) -> int:
        return hash((self.guard, tuple(sorted(self.values))))


class slope(sp.Function):  # type: ignore[misc]  # noqa: N801
    """The derivative of a step with respect to an input, as an operation of a kernel.

    The program has it from the operations of the step (:mod:`rodgen.codegen.tape_jacobian`), a proof from its formula.
    """

    nargs = 2
    is_real = True


def port_symbols(name: str, shape: tuple[int, ...]) -> tuple[sp.Symbol, ...]:
    """Return the real symbols of a port's components, in row-major order."""
    names = [name]
    for length in shape:
        names = [f"{prefix}_{index}" for prefix in names for index in range(1, length + 1)]
    return tuple(sp.Symbol(n, real=True) for n in names)


def packed(symbols: tuple[sp.Symbol, ...], shape: tuple[int, ...]) -> Any:
    """Return a Symbol for the shape (), a Matrix for one or two axes, an array for more; a vector is a column."""
    if shape == ():
        return symbols[0]
    if len(shape) <= 2:
        return sp.Matrix(shape[0], shape[1] if len(shape) == 2 else 1, symbols)
    return sp.ImmutableDenseNDimArray(symbols, shape)


def live_steps(steps: Sequence[Step], wanted: Iterable[sp.Symbol]) -> list[Step]:
    """Return the steps, assignments or pairs of symbol and value, that the wanted symbols need, in order."""
    needed = set(wanted)
    live = []
    for step in reversed(steps):
        symbol, value = step
        if symbol in needed:
            needed |= value.free_symbols
            live.append(step)
    return live[::-1]
