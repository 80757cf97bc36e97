"""Three-vectors, in a paper's notation and in components.

A :class:`Vector` is one letter, so that a formula can be kept and typeset as a paper prints it:
``theta``, ``cross(theta, rho)``, ``norm(theta)``. :func:`explicit` turns such a formula into components.
The functions accept both forms; on explicit 3x1 matrices they compute.
"""

from __future__ import annotations

from typing import Any

import sympy as sp
from sympy.matrices.expressions.matexpr import MatrixExpr

__all__ = ["Vector", "cross", "dot", "explicit", "formal_determinant", "norm", "skew"]


# SymPy has no annotations: hence the marks on its subclasses.
class Vector(sp.MatrixSymbol):  # type: ignore[misc]
    """A real three-vector named by one letter.

    Its components are the real symbols ``name_1``, ``name_2`` and ``name_3``.

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

    @property
    def components(self) -> sp.ImmutableMatrix:
        """The three components as a 3x1 matrix of real symbols."""
        return sp.ImmutableMatrix([sp.Symbol(f"{self.name}_{i}", real=True) for i in (1, 2, 3)])

    def __iter__(self) -> Any:
        return iter(self.components)


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


def skew(a: sp.MatrixBase) -> sp.Matrix:
    """Matrix [a]× of the cross product: ``skew(a) * b == cross(a, b)``."""
    return sp.Matrix([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def explicit(formula: sp.Basic) -> sp.Basic:
    """Write a formula in components.

    Examples
    --------
    >>> a, b = Vector("a"), Vector("b")
    >>> explicit(dot(a, cross(a, b))).expand()
    0
    """
    if isinstance(formula, Vector):
        return formula.components
    if isinstance(formula, sp.MatrixBase):
        return formula.applyfunc(explicit) if formula.has(Vector) else formula
    if not formula.args or not formula.has(Vector):
        return formula
    parts = [explicit(part) for part in formula.args]
    if isinstance(formula, _Cross):
        return cross(*parts)
    if isinstance(formula, _Dot):
        return dot(*parts)
    if isinstance(formula, _Norm):
        return norm(parts[0])
    if isinstance(formula, sp.MatAdd):
        total = sp.zeros(3, 1)
        for part in parts:
            total += sp.Matrix(part)
        return total
    if isinstance(formula, sp.MatMul):
        product: Any = sp.S.One
        for part in parts:
            product = product * part
        return product
    return formula.func(*parts)
