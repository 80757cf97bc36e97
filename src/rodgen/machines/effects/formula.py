"""Formulas of machine files: parsed safely, written back, checked for their units, evaluated.

A formula is one value made of numbers, names, ``+ - * / **`` (``^`` is ``**``), parentheses and the functions
``sin cos tan exp log sqrt abs sign``, such as ``a*sin(q) + k*F``. Its text is parsed into a tree and never run as
code; the tree is evaluated with any kind of operands: floats, arrays, SymPy expressions.
"""

from __future__ import annotations

import ast
import functools
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, cast

import numpy as np

from rodgen.data.units import ONE, Dimension
from rodgen.errors import in_file, shown
from rodgen.machines.effects._formula_tree import (
    FUNCTIONS,
    OPERATORS,
    FormulaError,
    fold,
    nonlinear_parts,
    parse,
    write,
)

__all__ = ["ARRAY_FUNCTIONS", "FUNCTION_NAMES", "Formula", "FormulaError"]

FUNCTION_NAMES = frozenset(FUNCTIONS)
ARRAY_FUNCTIONS: dict[str, Callable[[Any], Any]] = {name: getattr(np, name) for name in FUNCTIONS}
"""The functions of formulas, as functions of arrays."""


@dataclass(frozen=True)
class Formula:
    """A formula; two are equal when their trees are.

    Examples
    --------
    >>> import math
    >>> formula = Formula.parse("a*sin( 2*q )+k * F", file="machine.toml", place="formula")
    >>> formula.text, sorted(formula.names)
    ('a*sin(2*q) + k*F', ['F', 'a', 'k', 'q'])
    >>> formula.evaluate({"a": 2.0, "q": math.pi / 4, "k": 1.0, "F": 3.0}, {"sin": math.sin}, float)
    5.0
    """

    text: str
    """Written from its tree; it parses to an equal formula. Made by :meth:`parse`."""

    @classmethod
    def parse(cls, text: str, *, file: str | os.PathLike[str], place: str) -> Formula:
        """Return the formula that a text stands for.

        Parameters
        ----------
        text : str
            At most 2000 characters, 300 numbers, names and operators, nested 40 deep; exponents up to 20.
        file, place : str
            Where it stands, for the error message.

        Raises
        ------
        InputFileError
            When it is not a formula; one sentence says where and what was expected.

        Examples
        --------
        >>> Formula.parse("2q", file="machine.toml", place="effect 1, formula")
        Traceback (most recent call last):
        rodgen.errors.InputFileError: machine.toml: effect 1, formula: '2q' at character 1, with no operator \
between; expected '2*q'
        """
        with in_file(file, place):
            return cls(write(_parsed(text)))

    @functools.cached_property
    def names(self) -> frozenset[str]:
        """Every name in it, including ``pi``, but not the functions."""
        return _names([_parsed(self.text)])

    @property
    def inner_names(self) -> frozenset[str]:
        """The names in a function's argument, below a fraction bar or in a power: the rest enters linearly.

        Examples
        --------
        >>> sorted(Formula.parse("a*exp(-t/tau) + b*q", file="machine.toml", place="formula").inner_names)
        ['t', 'tau']
        """
        return _names(nonlinear_parts(_parsed(self.text)))

    def evaluate(
        self,
        names: Mapping[str, Any],
        functions: Mapping[str, Callable[[Any], Any]],
        number: Callable[[Fraction], Any],
    ) -> Any:
        """Return the value of the formula, computed with Python's operators on operands of any kind.

        Parameters
        ----------
        names : mapping
            What each name stands for, ``pi`` included.
        functions : mapping
            What each function does, by name; all have one argument.
        number : callable
            What a number of the formula becomes, from the exact Fraction.
        """
        return fold(_parsed(self.text), names, functions, number)

    def dimension(self, dimensions: Mapping[str, Dimension | None]) -> Dimension | None:
        """Return the dimension of the formula's value.

        A bare number takes on the dimension of what it is added to, and a formula of numbers alone is a plain
        number. An angle is in radians, and as good as a plain number everywhere.

        Parameters
        ----------
        dimensions : mapping
            The dimension of each name (``pi`` is a plain number); None for one that is not known, such as a
            column's before there are data.

        Returns
        -------
        Dimension or None
            None where it hangs on a name whose dimension is not known.

        Raises
        ------
        FormulaError
            Where dimensions do not fit: a length and an angle added, the sine of a length.

        Examples
        --------
        >>> from rodgen.data.units import ANGLE, FORCE, LENGTH
        >>> formula = Formula.parse("a*(1 + k*F)", file="machine.toml", place="formula")
        >>> print(formula.dimension({"a": LENGTH, "k": ONE / FORCE, "F": FORCE}))
        length
        >>> Formula.parse("a + F", file="machine.toml", place="formula").dimension({"a": LENGTH, "F": FORCE})
        Traceback (most recent call last):
        rodgen.machines.effects._formula_tree.FormulaError: 'a + F' of length and force; expected two of one kind
        """
        return _quantity(_parsed(self.text), dimensions).dimension


@functools.lru_cache(maxsize=1024)
def _parsed(text: str) -> ast.expr:
    return parse(text)


def _names(trees: Iterable[ast.expr]) -> frozenset[str]:
    nodes = (node for tree in trees for node in ast.walk(tree))
    return frozenset(node.id for node in nodes if isinstance(node, ast.Name)) - FUNCTION_NAMES


@dataclass(frozen=True)
class _Quantity:
    """A dimension, None when unknown; whether it is made of numbers alone; and the value where that is rational."""

    dimension: Dimension | None
    bare: bool = False
    value: Fraction | None = None


def _quantity(node: ast.expr, dimensions: Mapping[str, Dimension | None]) -> _Quantity:
    match node:
        case ast.Constant(value):
            return _Quantity(ONE, bare=True, value=cast("Fraction", value))
        case ast.Name("pi"):
            return _Quantity(ONE, bare=True)
        case ast.Name(name):
            return _Quantity(dimensions[name])
        case ast.UnaryOp(_, operand):
            inner = _quantity(operand, dimensions)
            return _Quantity(inner.dimension, inner.bare, None if inner.value is None else -inner.value)
        case ast.Call(ast.Name(function), [argument]):
            return _of_call(node, function, _quantity(argument, dimensions))
        case ast.BinOp(left, _, right):
            return _of_operation(node, _quantity(left, dimensions), _quantity(right, dimensions))
    raise TypeError(node)


def _of_call(node: ast.expr, function: str, inner: _Quantity) -> _Quantity:
    if function == "sign":
        return _Quantity(ONE, inner.bare)
    if function in {"abs", "sqrt"}:
        power = Fraction(1, 2) if function == "sqrt" else 1
        return _Quantity(None if inner.dimension is None else inner.dimension**power, inner.bare)
    if inner.dimension is not None and not inner.dimension.fits(ONE):
        raise FormulaError(
            f"{shown(write(node), 40)}, {function} of {_said(inner)}", "an angle or a plain number inside"
        )
    return _Quantity(ONE, inner.bare)


def _of_operation(node: ast.BinOp, left: _Quantity, right: _Quantity) -> _Quantity:
    bare = left.bare and right.bare
    if isinstance(node.op, ast.Pow):
        return _of_power(node, left, right)
    if isinstance(node.op, ast.Add | ast.Sub):
        if left.bare or left.dimension is None:
            return _Quantity(right.dimension if not right.bare else left.dimension, bare)
        if right.bare or right.dimension is None:
            return _Quantity(left.dimension)
        if not left.dimension.fits(right.dimension):
            raise FormulaError(
                f"{shown(write(node), 40)} of {_said(left)} and {_said(right)}", "two of one kind"
            )
        return left
    value = None
    if left.value is not None and right.value is not None:
        value = OPERATORS[type(node.op)](left.value, right.value)
    if left.dimension is None or right.dimension is None:
        return _Quantity(None)
    return _Quantity(OPERATORS[type(node.op)](left.dimension, right.dimension), bare, value)


def _of_power(node: ast.BinOp, base: _Quantity, exponent: _Quantity) -> _Quantity:
    if exponent.dimension is not None and not exponent.dimension.fits(ONE):
        raise FormulaError(f"exponent {shown(write(node.right), 40)}, {_said(exponent)}", "a plain number")
    if base.dimension is None:
        return _Quantity(None)
    if exponent.value is not None:
        return _Quantity(base.dimension**exponent.value, base.bare)
    if not base.dimension.fits(ONE):
        raise FormulaError(
            f"{shown(write(node), 40)}, a power of {_said(base)} with an exponent that is not a number",
            "a plain number as base, or a number as exponent",
        )
    return _Quantity(ONE, base.bare and exponent.bare)


def _said(quantity: _Quantity) -> str:
    return str(quantity.dimension)
