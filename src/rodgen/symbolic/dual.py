"""Dual numbers a + ε b with ε² = 0: an angle and its length in one number, and derivatives at no extra cost.

A function of a dual number is f(a + ε b) = f(a) + ε b f'(a). The dual angle θ + ε S is the turn by θ about a line and
the shift by S along it, and α + ε a is the twist and the distance of two lines. A rigid motion, the rotation R and the
shift p, is the dual matrix R + ε [p]ₓ R; products of motions are products of these matrices, and each is orthogonal.
So what sines, cosines and orthogonality prove of angles on a sphere holds for dual angles of lines in space; its dual
part is a second equation, with the lengths.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import sympy as sp

from rodgen.symbolic.vectors import skew

_ARGUMENT = sp.Dummy("argument", real=True)


class Dual:
    """A dual number, or a matrix of them: a primary part, and ε times a secondary part.

    Parameters
    ----------
    primary, secondary : expression or matrix
        Both numbers, or matrices of one shape; the secondary part is zero when left out.

    Examples
    --------
    >>> import sympy as sp
    >>> theta, S = sp.symbols("theta S", real=True)
    >>> Dual(theta, S).sin()
    Dual(sin(theta), S*cos(theta))
    >>> Dual(2, 3) / Dual(4, 1)
    Dual(1/2, 5/8)
    >>> Dual(2, 3) ** 3
    Dual(8, 36)
    """

    __slots__ = ("primary", "secondary")

    def __init__(self, primary: Any, secondary: Any = None) -> None:
        self.primary = _part(primary)
        self.secondary = 0 * self.primary if secondary is None else _part(secondary)
        if getattr(self.primary, "shape", ()) != getattr(self.secondary, "shape", ()):
            raise ValueError("the primary and the secondary part of a dual matrix need one shape")

    def apply(self, function: Callable[[sp.Expr], sp.Expr]) -> Dual:
        """Apply a function that SymPy can differentiate.

        Examples
        --------
        >>> Dual(0, 5).apply(sp.exp)
        Dual(1, 5)
        """
        value = function(_ARGUMENT)
        here = {_ARGUMENT: self.primary}
        return Dual(value.subs(here), value.diff(_ARGUMENT).subs(here) * self.secondary)

    def sin(self) -> Dual:
        """Sine: sin θ + ε S cos θ."""
        return self.apply(sp.sin)

    def cos(self) -> Dual:
        """Cosine: cos θ - ε S sin θ."""
        return self.apply(sp.cos)

    def tan(self) -> Dual:
        """Tangent: tan θ + ε S (1 + tan² θ)."""
        return self.apply(sp.tan)

    @property
    def T(self) -> Dual:
        """Transposed dual matrix."""
        return Dual(self.primary.T, self.secondary.T)

    def __getitem__(self, index: Any) -> Dual:
        return Dual(self.primary[index], self.secondary[index])

    def __add__(self, other: Any) -> Dual:
        other = _dual(other)
        return Dual(self.primary + other.primary, self.secondary + other.secondary)

    def __mul__(self, other: Any) -> Dual:
        other = _dual(other)  # in this order, so that matrices may be multiplied
        cross = self.primary * other.secondary + self.secondary * other.primary
        return Dual(self.primary * other.primary, cross)

    def __rmul__(self, other: Any) -> Dual:
        return _dual(other) * self

    def __truediv__(self, other: Any) -> Dual:
        return self * _dual(other) ** -1

    def __rtruediv__(self, other: Any) -> Dual:
        return _dual(other) / self

    def __pow__(self, exponent: Any) -> Dual:
        exponent = sp.sympify(exponent)
        slope = exponent * self.primary ** (exponent - 1)
        return Dual(self.primary**exponent, slope * self.secondary)

    def __neg__(self) -> Dual:
        return Dual(-self.primary, -self.secondary)

    def __sub__(self, other: Any) -> Dual:
        return self + -_dual(other)

    def __rsub__(self, other: Any) -> Dual:
        return _dual(other) - self

    __radd__ = __add__

    def __eq__(self, other: object) -> bool:
        other = _dual(other)
        return bool(self.primary == other.primary and self.secondary == other.secondary)

    def __hash__(self) -> int:
        return hash((self.primary, self.secondary))

    def __repr__(self) -> str:
        return f"Dual({self.primary}, {self.secondary})"


def dual_value(expression: sp.Expr, values: Mapping[sp.Symbol, Dual]) -> Dual:
    """Write an expression with dual numbers for some of its symbols: the others are plain numbers.

    Examples
    --------
    >>> import sympy as sp
    >>> x, y, x0 = sp.symbols("x y x0")
    >>> dual_value(x**2 * y, {x: Dual(x, x0)})
    Dual(x**2*y, 2*x*x0*y)
    """
    inserted = {symbol: value.primary for symbol, value in values.items()}
    secondary = sum(
        (expression.diff(symbol) * value.secondary for symbol, value in values.items()), sp.S.Zero
    )
    primary = expression.subs(inserted, simultaneous=True)
    return Dual(primary, secondary.subs(inserted, simultaneous=True))


def dual_matrix(rotation: sp.MatrixBase, shift: sp.MatrixBase) -> Dual:
    """Dual matrix R + ε [p]ₓ R of the rigid motion that turns by R and then shifts by p."""
    return Dual(rotation, skew(sp.Matrix(shift)) * rotation)


def dual_rotation_x(angle: Dual) -> Dual:
    """Dual matrix of the screw motion about and along x: the link with the twist and the length of `angle`."""
    c, s, zero = angle.cos(), angle.sin(), sp.S.Zero
    return Dual(
        sp.Matrix([[1, 0, 0], [0, c.primary, -s.primary], [0, s.primary, c.primary]]),
        sp.Matrix([[0, 0, 0], [zero, c.secondary, -s.secondary], [0, s.secondary, c.secondary]]),
    )


def dual_rotation_z(angle: Dual) -> Dual:
    """Dual matrix of the screw motion about and along z: the joint with the angle and the offset of `angle`."""
    c, s, zero = angle.cos(), angle.sin(), sp.S.Zero
    return Dual(
        sp.Matrix([[c.primary, -s.primary, 0], [s.primary, c.primary, 0], [0, 0, 1]]),
        sp.Matrix([[c.secondary, -s.secondary, zero], [s.secondary, c.secondary, 0], [0, 0, 0]]),
    )


def _part(value: Any) -> Any:
    return sp.ImmutableMatrix(value) if isinstance(value, sp.MatrixBase | list) else sp.sympify(value)


def _dual(value: Any) -> Dual:
    return value if isinstance(value, Dual) else Dual(value)
