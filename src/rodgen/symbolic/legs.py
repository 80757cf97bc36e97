"""Platforms on legs: how they turn, how Newton's method closes the legs, and the forces in these, over any algebra.

`derivation/closed_chain.py` and `derivation/delta.py` prove these functions; the models of machines are built with
them, as :mod:`rodgen.symbolic.rigid_motions` says. Matrices have SymPy's methods.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rodgen.symbolic.rigid_motions import Algebra, Turn, Vector

# how platforms turn ----------------------------------------------------------------------------------------------


def tricept_turn(a: Algebra, alpha: Turn, beta: Turn) -> Any:
    """Return a Tricept's rotation matrix Oy(β) Ox(α), with the paper's transposed Ox (tricept-turns)."""
    (ca, sa), (cb, sb) = alpha, beta
    return a.let("turn", a.matrix([[cb, -sb * sa, sb * ca], [0, ca, sa], [-sb, -cb * sa, cb * ca]]))


def tricept_rates(a: Algebra, turn: Any, beta: Turn, p: Vector) -> Any:
    """Return the derivative (3, 3) of a point of a Tricept's platform by α, β and the stroke (tricept-turns)."""
    cb, sb = beta
    about = -a.matrix([cb, 0, -sb])  # the transposed Ox turns the other way
    y = a.matrix([0, 1, 0])
    return a.matrix.hstack(a.cross(about, p), a.cross(y, p), turn.col(2))


def turn_rates(a: Algebra, x: Vector) -> Any:
    """Return the derivative (3, 3) of a vector by a small turn w, of w × x (step-is-small)."""
    return a.matrix([[0, x[2], -x[1]], [-x[2], 0, x[0]], [x[1], -x[0], 0]])


def turned_by_step(a: Algebra, turn: Any, step: Vector) -> Any:
    """Return a rotation matrix after one with the Rodrigues vector of a step: Cayley's map (step-turns)."""
    half = a.let("half", step / 2)
    factor = a.let("factor", 2 / (1 + a.dot(half, half)))
    columns = []
    for i in range(3):
        across = a.let("across", a.cross(half, turn.col(i)))
        columns.append(a.let("column", turn.col(i) + factor * (across + a.cross(half, across))))
    return a.matrix.hstack(*columns)


def matrix_of_quaternion(a: Algebra, w: Any, v: Vector) -> Any:
    """Return the rotation matrix of a unit quaternion of scalar w and vector v (quaternion)."""
    cross = -turn_rates(a, v)
    return a.let("turn", a.matrix.eye(3) + 2 * w * cross + 2 * cross * cross)


# legs ------------------------------------------------------------------------------------------------------------


def half_gap(a: Algebra, leg: Vector, half_square: Any) -> Any:
    """Return half the square of a leg, less half of that of its length: the equation that closes it (closed-leg)."""
    return a.dot(leg, leg) / 2 - half_square


def slopes(a: Algebra, legs: Sequence[Vector], rates: Sequence[Any]) -> Any:
    """Return the derivative (legs, unknowns) of half the squares of the legs, by those of their ends (closed-leg)."""
    rows = [leg.T * rate for leg, rate in zip(legs, rates, strict=True)]
    return a.let("slopes", a.matrix.vstack(*rows))


def inverse(a: Algebra, matrix: Any) -> Any:
    """Return the inverse of a (3, 3) matrix (inverse)."""
    adjugate = a.let("adjugate", matrix.adjugate())
    determinant = a.let("determinant", (matrix.row(0) * adjugate.col(0))[0])
    return a.let("inverse", adjugate / determinant)


def solved(let: Callable[[str, Any], Any], matrix: Any, b: Any) -> list[Any]:
    """Return the solution of a positive definite system, by its factors L D Lᵀ; `let` names each step (factors)."""
    n = len(b)
    factor: dict[tuple[int, int], Any] = {}
    pivot: list[Any] = []
    x: list[Any] = []
    for i in range(n):
        for j in range(i):
            done = sum((factor[i, m] * factor[j, m] * pivot[m] for m in range(j)), 0)
            factor[i, j] = let(f"l{i}{j}", (matrix[i, j] - done) / pivot[j])
        done = sum((factor[i, m] ** 2 * pivot[m] for m in range(i)), 0)
        pivot.append(let(f"pivot{i}", matrix[i, i] - done))
    for i in range(n):
        rest = b[i] - sum((factor[i, m] * x[m] for m in range(i)), 0)
        x.append(rest if getattr(rest, "is_Symbol", False) else let(f"forward{i}", rest))
    x = [let(f"divided{i}", x[i] / pivot[i]) for i in range(n)]
    for i in reversed(range(n - 1)):
        later = sum((factor[m, i] * x[m] for m in range(i + 1, n)), 0)
        x[i] = let(f"solved{i}", x[i] - later)
    return x


def solution(a: Algebra, slopes: Any, right: Vector) -> Vector:
    """Return J⁻¹ times a vector: by the inverse of three slopes, by normal equations of more (normal-equations).

    Elimination of J itself would need a choice of pivots.
    """
    if slopes.shape[0] == 3:
        return inverse(a, slopes) * right
    return a.matrix(solved(a.let, a.let("normal", slopes.T * slopes), slopes.T * right))


def transposed_solution(a: Algebra, slopes: Any, right: Vector) -> Vector:
    """Return J⁻ᵀ times a vector (normal-equations)."""
    if slopes.shape[0] == 3:
        return inverse(a, slopes).T * right
    return slopes * a.matrix(solved(a.let, a.let("normal", slopes.T * slopes), right))


def tensions(a: Algebra, legs: Sequence[Vector], slopes: Any, rates: Any, gravity: Vector) -> list[Any]:
    """Return the force in each leg, tension positive, under a unit force along gravity (tensions-balance).

    By virtual work it is the way that the load goes along gravity when the leg alone grows: t = l J⁻ᵀ (∂x/∂y)ᵀ g, where
    J is the derivative of half the squared lengths and ∂x/∂y, `rates`, that of the load's place.
    """
    pull = a.let("pull", transposed_solution(a, slopes, rates.T * gravity))
    lengths = [a.let("length", a.sqrt(a.dot(leg, leg))) for leg in legs]
    return [a.let("tension", t * length) for t, length in zip(pull, lengths, strict=True)]


# three spheres ---------------------------------------------------------------------------------------------------


class ThreeSpheres(NamedTuple):
    """Where three spheres meet: foot ± normal · √ratio."""

    foot: Any
    """The point of the centres' plane between the two."""
    normal: Any
    """Of that plane, as long as twice the triangle of the centres is large."""
    area: Any
    """Square of the length of the normal: zero where the centres are in a line."""
    ratio: Any
    """Square of the height above the plane, over that of the normal: negative where the spheres do not meet."""
    height: Any
    """Square of the height above the plane."""


def three_spheres(a: Algebra, centres: Sequence[Vector], squares: Sequence[Any]) -> ThreeSpheres:
    """Return the points at distances, given by their squares, from three centres (derivation delta, three-spheres)."""
    second, third = a.let("to_second", centres[1] - centres[0]), a.let("to_third", centres[2] - centres[0])
    normal = a.let("normal", a.cross(second, third))
    area = a.let("area", a.dot(normal, normal))
    along_second = a.let("along_second", (a.dot(second, second) + squares[0] - squares[1]) / 2)
    along_third = a.let("along_third", (a.dot(third, third) + squares[0] - squares[2]) / 2)
    sideways = a.cross(third, normal) * along_second + a.cross(normal, second) * along_third
    way = a.let("way", sideways / area)
    height = a.let("height", squares[0] - a.dot(way, way))
    return ThreeSpheres(a.let("foot", centres[0] + way), normal, area, a.let("ratio", height / area), height)


def elbow(radius: Any, arm: Any, turn: Turn) -> tuple[Any, Any]:
    """Return how far out, and how high, the joint at the end of a delta's arm is (delta, inverse-of-an-arm)."""
    return radius + arm * turn[0], -arm * turn[1]


def upper_joint(a: Algebra, heading: Turn, out: Any, height: Any) -> Vector:
    """Return where the upper joint of a delta's rod is (delta, inverse-of-a-tower, inverse-of-an-arm)."""
    return a.matrix([out * heading[0], out * heading[1], height])
