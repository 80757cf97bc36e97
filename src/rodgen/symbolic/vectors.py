"""Vectors and matrices, in a paper's notation and in components.

A :class:`Vector` is one letter, so that a formula can be kept and typeset as a paper prints it:
``theta``, ``cross(theta, rho)``, ``norm(theta)``. :func:`explicit` turns such a formula into components.
The functions accept both forms; on explicit matrices they compute. A :class:`Letter` is the same for a matrix
of any shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import sympy as sp
from sympy.matrices.expressions.matexpr import MatrixExpr


# SymPy has no annotations: hence the marks on its subclasses.
class Letter(sp.MatrixSymbol):  # type: ignore[misc]
    """A real matrix named by one letter.

    Its components are the real symbols ``name_1`` to ``name_n`` of a column, ``name_1_1`` and so on of
    a matrix.
    """

    @property
    def components(self) -> sp.ImmutableMatrix:
        """The components as a matrix of real symbols."""
        rows, columns = (int(size) for size in self.shape)

        def component(i: int, j: int) -> sp.Symbol:
            index = f"{i + 1}" if columns == 1 else f"{i + 1}_{j + 1}"
            return sp.Symbol(f"{self.name}_{index}", real=True)

        return sp.ImmutableMatrix(rows, columns, component)

    def __iter__(self) -> Any:
        return iter(self.components)


class Vector(Letter):
    """A real three-vector named by one letter.

    Examples
    --------
    >>> rho = Vector("rho")
    >>> rho.components.T
    Matrix([[rho_1, rho_2, rho_3]])
    """

    def __new__(cls, name: Any, *shape: Any) -> Vector:
        """Create the letter; SymPy itself passes the shape when it rebuilds one."""
        vector: Vector = sp.MatrixSymbol.__new__(cls, name, 3, 1)
        return vector


class _Cross(MatrixExpr):  # type: ignore[misc]
    """Cross product that is not carried out."""

    shape = (sp.Integer(3), sp.Integer(1))

    def __new__(cls, a: sp.Expr, b: sp.Expr) -> _Cross:
        node: _Cross = MatrixExpr.__new__(cls, a, b)
        return node

    def doit(self, **hints: Any) -> _Cross:
        """Leave the product as it stands; :func:`explicit` carries it out."""
        return self

    def _sympystr(self, printer: Any) -> str:
        return " x ".join(
            f"({printer._print(a)})" if isinstance(a, _Cross | sp.MatAdd) else str(printer._print(a))
            for a in self.args
        )


class _Skew(MatrixExpr):  # type: ignore[misc]
    """Matrix of the cross product with a vector that is a letter."""

    shape = (sp.Integer(3), sp.Integer(3))

    def __new__(cls, a: sp.Expr) -> _Skew:
        node: _Skew = MatrixExpr.__new__(cls, a)
        return node

    def doit(self, **hints: Any) -> _Skew:
        """Leave the matrix as it stands; :func:`explicit` writes it out."""
        return self

    def _sympystr(self, printer: Any) -> str:
        return f"[{printer._print(self.args[0])}]x"


class _FormalDeterminant(_Cross):
    """Cross product written as the determinant of unit vectors and two rows of components."""

    def _sympystr(self, printer: Any) -> str:
        first, second = (printer._print(a) for a in self.args)
        return f"det[i j k; {first}; {second}]"


class _Scalar(sp.Expr):  # type: ignore[misc]
    """A real number made from vectors and not carried out."""

    is_commutative = True
    is_real = True

    def __new__(cls, *vectors: sp.Expr) -> _Scalar:
        node: _Scalar = sp.Expr.__new__(cls, *vectors)
        return node


class _Dot(_Scalar):
    def _sympystr(self, printer: Any) -> str:
        return "(" + ", ".join(printer._print(a) for a in self.args) + ")"


class _Norm(_Scalar):
    is_nonnegative = True

    def _sympystr(self, printer: Any) -> str:
        return f"|{printer._print(self.args[0])}|"


def cross(a: sp.Expr, b: sp.Expr) -> sp.Expr:
    """Cross product a × b of two vectors, either letters or 3x1 matrices."""
    if isinstance(a, sp.MatrixBase) and isinstance(b, sp.MatrixBase):
        return sp.Matrix(
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
        )
    return _Cross(a, b)


def formal_determinant(a: sp.Expr, b: sp.Expr) -> sp.Expr:
    """Cross product a × b, written as a determinant with the unit vectors in its first row."""
    return _FormalDeterminant(a, b)


def dot(a: sp.Expr, b: sp.Expr) -> sp.Expr:
    """Scalar product of two vectors, either letters or 3x1 matrices."""
    if isinstance(a, sp.MatrixBase) and isinstance(b, sp.MatrixBase):
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return _Dot(a, b)


def norm(a: sp.Expr) -> sp.Expr:
    """Length of a vector, either a letter or a 3x1 matrix."""
    return sp.sqrt(dot(a, a)) if isinstance(a, sp.MatrixBase) else _Norm(a)


def skew(a: sp.Expr) -> sp.Expr:
    """Matrix [a]× of the cross product: ``skew(a) * b == cross(a, b)``."""
    if not isinstance(a, sp.MatrixBase):
        return _Skew(a)
    return sp.Matrix([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def explicit(formula: sp.Basic) -> sp.Basic:
    """Write a formula in components.

    Examples
    --------
    >>> a, b = Vector("a"), Vector("b")
    >>> explicit(dot(a, cross(a, b))).expand()
    0
    """
    if isinstance(formula, Letter):
        return formula.components
    if isinstance(formula, sp.MatrixBase):
        return formula.applyfunc(explicit) if formula.has(Letter) else formula
    if not formula.has(Letter):
        return formula.as_explicit() if isinstance(formula, MatrixExpr) else formula
    parts = [explicit(part) for part in formula.args]
    carry_out = _CARRY_OUT.get(type(formula))
    return formula.func(*parts) if carry_out is None else carry_out(*parts)


def _sum(*parts: sp.MatrixBase) -> sp.Matrix:
    return sum(parts[1:], sp.Matrix(parts[0]))


def _product(*parts: Any) -> Any:
    return math.prod(parts, start=sp.S.One)


_CARRY_OUT: dict[type, Callable[..., sp.Basic]] = {
    _Cross: cross,
    _FormalDeterminant: cross,
    _Dot: dot,
    _Norm: norm,
    _Skew: skew,
    sp.Transpose: lambda matrix: matrix.T,
    sp.MatAdd: _sum,
    sp.MatMul: _product,
}
