"""Rotation of a vector: Rodrigues' formula and the rotation matrix.

The rotation by the angle χ about the unit axis e is described by e and χ, or by the Rodrigues vector
θ = 2 tan(χ/2) e, for which every formula is rational.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from rodgen.symbolic.vectors import cross, dot, norm, skew


def rodrigues(rho: sp.Expr, theta: sp.Expr) -> sp.Expr:
    """Rotate a vector by Rodrigues' formula, ρ + θ × (ρ + θ × ρ / 2) / (1 + |θ|² / 4).

    Parameters
    ----------
    rho, theta : Vector or 3x1 matrix
        Vector to rotate, and Rodrigues vector 2 tan(χ/2) e.

    Examples
    --------
    >>> import sympy as sp
    >>> rodrigues(sp.Matrix([1, 0, 0]), sp.Matrix([0, 0, 2])).T  # a quarter turn about z
    Matrix([[0, 1, 0]])
    """
    square = dot(theta, theta) if isinstance(theta, sp.MatrixBase) else norm(theta) ** 2
    return rho + cross(theta, rho + cross(theta, rho) / 2) / (1 + square / 4)


def matrix_from_rodrigues_vector(theta: sp.MatrixBase) -> sp.Matrix:
    """Matrix of the rotation with the Rodrigues vector θ = 2 tan(χ/2) e."""
    return sp.eye(3) + (skew(theta) + skew(theta) ** 2 / 2) / (1 + dot(theta, theta) / 4)


def matrix_from_axis_angle(
    axis: sp.MatrixBase, cosine: sp.Expr | sp.Symbol, sine: sp.Expr | sp.Symbol
) -> sp.Matrix:
    """Matrix of the rotation about a unit axis, from the cosine and the sine of its angle."""
    return cosine * sp.eye(3) + sine * skew(axis) + (1 - cosine) * axis * axis.T


def coordinate_rotation(axis: str, cosine: sp.Expr, sine: sp.Expr) -> sp.Matrix:
    """Return the matrix of the rotation about x, y or z, from the cosine and the sine of its angle.

    Examples
    --------
    >>> import sympy as sp
    >>> coordinate_rotation("z", *sp.symbols("c s"))
    Matrix([
    [c, -s, 0],
    [s,  c, 0],
    [0,  0, 1]])
    """
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    matrix = sp.eye(3)
    matrix[j, j] = matrix[k, k] = cosine
    matrix[k, j], matrix[j, k] = sine, -sine
    return matrix


def rot(axis: str, angle: sp.Expr) -> sp.Matrix:
    """Return the matrix of the rotation about x, y or z by an angle, Rot(z, θ) of the textbooks."""
    return coordinate_rotation(axis, sp.cos(angle), sp.sin(angle))


def transform(rotation: sp.MatrixBase, origin: Sequence[sp.Expr]) -> sp.Matrix:
    """Return the 4x4 transformation matrix of a rotation matrix and an origin."""
    top = sp.Matrix(rotation).row_join(sp.Matrix(list(origin)))
    return top.col_join(sp.Matrix([[0, 0, 0, 1]]))


def inverse_transform(matrix: sp.MatrixBase) -> sp.Matrix:
    """Return the inverse of a transformation matrix."""
    turned = matrix[:3, :3].T
    return transform(turned, -turned * matrix[:3, 3])
