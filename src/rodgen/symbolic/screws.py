"""Lines, screws and reciprocal systems of screws, in exact arithmetic.

A screw is a column of six: direction S and moment S0. It is a line where S · S0 = 0 and S is not zero; the line through
the point p along S has S0 = p × S. A screw of pitch h about that line has S0 = p × S + h S, and a couple has S = 0. The
reciprocal product of two screws, S · T0 + T · S0, is the power of the wrench on the one in the twist on the other; for
two lines it vanishes where, and only where, they meet or are parallel.

The screws reciprocal to given ones are a linear space, of dimension 6 - rank; its lines are the zeros of a quadratic
form. Every test for zero is exact, also with roots, sines and cosines (see :func:`rodgen.symbolic.remainder`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from rodgen.symbolic.reduction import factored, remainder
from rodgen.symbolic.vectors import cross, dot, skew

DELTA = sp.ImmutableMatrix(sp.BlockMatrix([[sp.zeros(3), sp.eye(3)], [sp.eye(3), sp.zeros(3)]]).as_explicit())
"""Matrix of the reciprocal product: ``a.T * DELTA * b``. It swaps direction and moment."""


def line_through(a: sp.MatrixBase, b: sp.MatrixBase) -> sp.Matrix:
    """Line through two points, directed from the first to the second and as long: (b - a; a × b).

    Examples
    --------
    >>> import sympy as sp
    >>> line_through(sp.Matrix([0, 1, 0]), sp.Matrix([2, 1, 0])).T
    Matrix([[2, 0, 0, 0, 0, -2]])
    """
    return sp.Matrix([*(sp.Matrix(b) - sp.Matrix(a)), *cross(sp.Matrix(a), sp.Matrix(b))])


def line_along(point: sp.MatrixBase, direction: sp.MatrixBase) -> sp.Matrix:
    """Line through a point along a direction of any length: (S; p × S)."""
    return screw(point, direction, 0)


def screw(point: sp.MatrixBase, direction: sp.MatrixBase, pitch: sp.Expr | int) -> sp.Matrix:
    """Screw of a pitch about the line through a point along a direction: (S; p × S + h S)."""
    direction = sp.Matrix(direction)
    return sp.Matrix([*direction, *(cross(sp.Matrix(point), direction) + pitch * direction)])


def couple(direction: sp.MatrixBase) -> sp.Matrix:
    """Screw of infinite pitch: a couple, or a translation, (0; S)."""
    return sp.Matrix([0, 0, 0, *direction])


def line_of_planes(
    normal: sp.MatrixBase,
    distance: sp.Expr | int,
    other_normal: sp.MatrixBase,
    other_distance: sp.Expr | int,
) -> sp.Matrix:
    """Line in which the planes n · x = d and m · x = e meet: (n × m; e n - d m).

    Parallel planes give a couple across their normals, and coinciding ones (with equal n and d) zero.

    Examples
    --------
    >>> import sympy as sp
    >>> line_of_planes(sp.Matrix([0, 0, 1]), 0, sp.Matrix([1, 0, 0]), 3).T  # z = 0 and x = 3
    Matrix([[0, 1, 0, 0, 0, 3]])
    """
    normal, other_normal = sp.Matrix(normal), sp.Matrix(other_normal)
    return sp.Matrix([*cross(normal, other_normal), *(other_distance * normal - distance * other_normal)])


def reciprocal_product(a: sp.MatrixBase, b: sp.MatrixBase) -> sp.Expr:
    """Reciprocal product S · T0 + T · S0 of two screws."""
    a, b = sp.Matrix(a), sp.Matrix(b)
    return dot(a[:3, 0], b[3:, 0]) + dot(b[:3, 0], a[3:, 0])


def self_product(a: sp.MatrixBase) -> sp.Expr:
    """S · S0 of a screw: zero for lines and for couples."""
    a = sp.Matrix(a)
    return dot(a[:3, 0], a[3:, 0])


def pitch(a: sp.MatrixBase) -> sp.Expr:
    """Pitch S · S0 / S · S of a screw that is not a couple."""
    a = sp.Matrix(a)
    return self_product(a) / dot(a[:3, 0], a[:3, 0])


def axis_point(a: sp.MatrixBase) -> sp.Matrix:
    """Point of a screw's axis that is nearest the origin, S × S0 / S · S."""
    a = sp.Matrix(a)
    return cross(a[:3, 0], a[3:, 0]) / dot(a[:3, 0], a[:3, 0])


def screw_transform(rotation: sp.MatrixBase, origin: sp.MatrixBase) -> sp.Matrix:
    """6x6 matrix that writes a screw of a moved frame in the fixed one: T = [[R, 0], [p^ R, R]].

    `rotation` has the moved frame's axes as columns, and `origin` is p, the moved frame's origin. Reciprocal products
    stay: Tᵀ Δ T = Δ for every rotation and p.
    """
    rotation, origin = sp.Matrix(rotation), sp.Matrix(origin)
    return sp.Matrix(
        sp.BlockMatrix([[rotation, sp.zeros(3)], [skew(origin) * rotation, rotation]]).as_explicit()
    )


@dataclass(frozen=True)
class ReciprocalSystem:
    """All screws reciprocal to given ones.

    Attributes
    ----------
    rank : int
        Rank of the given screws; 6 - rank screws span the system. Where there are free symbols, it is the generic rank.
    basis : tuple of 6x1 matrices
        Screws that span it.
    """

    rank: int
    basis: tuple[sp.ImmutableMatrix, ...]

    def member(self, coefficients: Sequence[sp.Expr | int]) -> sp.Matrix:
        """Screw with these coefficients in the basis."""
        combined = sp.zeros(6, 1)
        for coefficient, part in zip(coefficients, self.basis, strict=True):
            combined += coefficient * part
        return combined

    def form(self) -> sp.Matrix:
        """Symmetric matrix G of the quadratic form S · S0 = cᵀ G c of the member with the coefficients c."""
        size = len(self.basis)
        return sp.Matrix(size, size, lambda i, j: reciprocal_product(self.basis[i], self.basis[j]) / 2)

    def line_condition(self, coefficients: Sequence[sp.Expr | int]) -> sp.Expr:
        """S · S0 of a member, factored: the members that are lines (or couples) are its zeros.

        A product of linear factors means families of lines: planes of the system in which every member is one.
        """
        return factored(sp.together(sp.expand(self_product(self.member(coefficients)))))

    def contains(self, candidate: sp.MatrixBase) -> bool:
        """Return whether a screw is in the system: exactly if adding it to the basis leaves the rank unchanged."""
        columns = sp.Matrix.hstack(*self.basis) if self.basis else sp.zeros(6, 1)
        both = sp.Matrix.hstack(columns, sp.Matrix(candidate))
        return bool(both.rank(iszerofunc=_is_zero) == columns.rank(iszerofunc=_is_zero))


def reciprocal_system(screws: Sequence[sp.MatrixBase]) -> ReciprocalSystem:
    """Find all screws reciprocal to the given ones.

    Parameters
    ----------
    screws : sequence of 6x1 matrices
        Exact: numbers, or expressions in symbols. The rank of the latter is the generic one: it holds wherever no pivot
        of the elimination vanishes.

    Returns
    -------
    ReciprocalSystem
        Rank of the given screws, and a basis of the system.

    Examples
    --------
    >>> import sympy as sp
    >>> x, y, z = (line_along(sp.zeros(3, 1), sp.eye(3)[:, i]) for i in range(3))
    >>> system = reciprocal_system([x, y, z])  # three axes through the origin
    >>> system.rank, [list(b) for b in system.basis]
    (3, [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0]])
    """
    if not screws:
        return ReciprocalSystem(0, tuple(sp.ImmutableMatrix(sp.eye(6)[:, i]) for i in range(6)))
    rows = sp.Matrix.vstack(*((DELTA * sp.Matrix(s)).T for s in screws))
    reduced, pivots = rows.rref(iszerofunc=_is_zero, simplify=_shorter)
    basis = []
    for free in (column for column in range(6) if column not in pivots):
        vector = sp.zeros(6, 1)
        vector[free] = sp.S.One
        for row, pivot in enumerate(pivots):
            vector[pivot] = -reduced[row, free]
        basis.append(sp.ImmutableMatrix(vector.applyfunc(_shorter)))
    return ReciprocalSystem(len(pivots), tuple(basis))


def _is_zero(expression: sp.Expr) -> bool:
    return bool(expression.is_zero) or remainder(expression) == 0


def _shorter(expression: sp.Expr) -> sp.Expr:
    return sp.S.Zero if _is_zero(expression) else sp.cancel(sp.together(expression))
