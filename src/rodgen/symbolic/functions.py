"""The functions that a floating-point kernel needs and SymPy does not have.

A kernel has no branches, so a case distinction is the :func:`select` of two values. The machine epsilon
of the number type it will run in is the symbol :data:`EPS`, and :class:`power_of_two_scale` is the factor
that brings a number near 1 without rounding it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import sympy as sp
from sympy.logic.boolalg import Boolean

from rodgen.symbolic.vectors import cross, dot

EPS = sp.Symbol("eps", positive=True)
"""Machine epsilon of the kernel's number type: 2**-52 in float64, 2**-23 in float32."""

LARGEST = sp.Symbol("largest", positive=True)
"""Largest finite number of the kernel's number type; ``abs(x) <= LARGEST`` is false for NaN and infinity."""

Value = TypeVar("Value", sp.Expr, sp.Matrix)


# SymPy has no annotations, and its functions are named as they are read, like sin.
class power_of_two_scale(sp.Function):  # type: ignore[misc]  # noqa: N801
    """Power of two that scales a positive number into [1, 2): ``2**-floor(log2(x))``.

    Multiplying by it is exact in binary floating point. It is constant between powers of two, and a
    kernel uses it only where the result does not depend on it, so its derivative is 0. At 0 it is 1.

    Examples
    --------
    >>> import sympy as sp
    >>> power_of_two_scale(sp.Rational(5)), power_of_two_scale(sp.Rational(1, 3))
    (1/4, 4)
    >>> power_of_two_scale(sp.Symbol("x", positive=True)).diff("x")
    0
    """

    nargs = 1
    is_real = True
    is_positive = True

    @classmethod
    def eval(cls, x: sp.Expr) -> sp.Expr | None:
        """Evaluate at a number; stay unevaluated otherwise."""
        if x.is_zero:
            return sp.S.One
        if x.is_Rational and x.is_positive:
            numerator, denominator = int(x.p), int(x.q)
            exponent = numerator.bit_length() - denominator.bit_length()
            if sp.Integer(2) ** exponent > x:
                exponent -= 1
            return sp.Integer(2) ** -exponent
        if x.is_number and x.is_positive:
            exponent = int(sp.floor(sp.log(x, 2)))
            return sp.Integer(2) ** -exponent
        return None

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        """Return the derivative, 0 by convention."""
        return sp.S.Zero

    def _latex(self, printer: Any) -> str:
        return rf"2^{{-\lfloor\log_2\left({printer._print(self.args[0])}\right)\rfloor}}"


def select(condition: Boolean | bool, if_true: Value, if_false: Value) -> Value:
    """Take one of two values, or entry by entry of two matrices.

    Both values are evaluated and one is taken, so neither may trap; a NaN in the other does no harm.

    Parameters
    ----------
    condition : sympy relational or boolean
        Decides which.
    if_true, if_false : sympy expression or matrix
        Values of equal shape.

    Returns
    -------
    sympy expression or matrix
        A two-branch :class:`sympy.Piecewise`, or a matrix of them.

    Examples
    --------
    >>> import sympy as sp
    >>> x = sp.Symbol("x", real=True)
    >>> select(x < 0, -x, x)
    Piecewise((-x, x < 0), (x, True))
    """
    if isinstance(if_true, sp.MatrixBase):
        if if_true.shape != if_false.shape:
            raise ValueError(f"select needs equal shapes, not {if_true.shape} and {if_false.shape}")
        chosen = [select(condition, a, b) for a, b in zip(if_true, if_false, strict=True)]
        return sp.Matrix(*if_true.shape, chosen)
    return sp.Piecewise((if_true, condition), (if_false, True))


def last_case(value: Value) -> Value:
    """Return a formula with each select replaced by its last case, which is the one where no condition holds."""
    return value.replace(lambda part: isinstance(part, sp.Piecewise), lambda part: part.args[-1].expr)


@dataclass(frozen=True)
class Formulas:
    """SymPy as the algebra of :mod:`rodgen.symbolic.rigid_motions`: formulas in letters, or in components.

    A proof of one case gives `select` the case, and may give the root of a square that is known.

    Examples
    --------
    >>> from rodgen.symbolic import Vector, rigid_motions
    >>> rigid_motions.moment(Formulas(), Vector("r"), Vector("g"))
    r x g
    """

    let: Callable[[str, Any], Any] = lambda name, value: value
    select: Callable[[Any, Any, Any], Any] = select
    sqrt: Callable[[Any], Any] = sp.sqrt
    sin: Callable[[Any], Any] = sp.sin
    cos: Callable[[Any], Any] = sp.cos
    dot: Callable[[Any, Any], Any] = dot
    cross: Callable[[Any, Any], Any] = cross
    matrix: Any = sp.Matrix
