"""Dual numbers: against derivatives of SymPy, and against rigid motions as 4x4 matrices."""

from __future__ import annotations

import pytest
import sympy as sp

from rodgen.symbolic import Dual, dual_matrix, dual_rotation_x, dual_rotation_z, dual_value, skew

x, x0, y, y0 = sp.symbols("x x_0 y y_0", real=True)


@pytest.mark.parametrize(
    "expression",
    [x * y, x / y, x**3 - 2 * x, 1 / x, (x + 1) * (2 - y), sp.sin(x) * sp.cos(y), sp.tan(x), sp.sqrt(x) * y],
)
def test_arithmetic_is_the_rule_for_functions(expression: sp.Expr) -> None:
    """Each operation of the class, against the derivative of the whole expression."""
    a, b = Dual(x, x0), Dual(y, y0)

    def evaluate(node: sp.Expr) -> Dual:
        if node == x:
            return a
        if node == y:
            return b
        if node.is_number:
            return Dual(node)
        parts = [evaluate(arg) for arg in node.args]
        if node.is_Add:
            return sum(parts[1:], parts[0])
        if node.is_Mul:
            found = parts[0]
            for part in parts[1:]:
                found = found * part
            return found
        if node.is_Pow:
            return parts[0] ** node.exp
        return {sp.sin: Dual.sin, sp.cos: Dual.cos, sp.tan: Dual.tan}[node.func](parts[0])

    found, whole = evaluate(expression), dual_value(expression, {x: a, y: b})
    assert sp.simplify(found.primary - expression) == 0
    assert sp.simplify(found.secondary - whole.secondary) == 0
    assert sp.simplify(whole.secondary - expression.diff(x) * x0 - expression.diff(y) * y0) == 0


def test_numbers_on_either_side() -> None:
    a = Dual(3, 5)
    assert 2 + a == a + 2 == Dual(5, 5)
    assert 2 - a == Dual(-1, -5)
    assert a - 2 == Dual(1, 5)
    assert 2 * a == a * 2 == Dual(6, 10)
    assert 2 / a == Dual(sp.Rational(2, 3), sp.Rational(-10, 9))
    assert -a == Dual(-3, -5)
    assert len({Dual(3, 5), a, Dual(3)}) == 2


def test_square_of_epsilon_is_zero() -> None:
    assert Dual(0, 1) * Dual(0, 1) == Dual(0, 0)


def test_products_of_dual_matrices_are_products_of_motions() -> None:
    """Link and joint twice, as dual matrices and as homogeneous ones."""
    angles = sp.symbols("alpha_1 theta_1 alpha_2 theta_2", real=True)
    lengths = sp.symbols("a_1 S_1 a_2 S_2", real=True)
    values = dict(zip(angles, (sp.Rational(n, 7) for n in (3, -5, 11, 2)), strict=True))
    values |= dict(zip(lengths, (2, -3, 5, 7), strict=True))
    dual, whole = Dual(sp.eye(3)), sp.eye(4)
    for number, (angle, length) in enumerate(zip(angles, lengths, strict=True)):
        turn = dual_rotation_z if number % 2 else dual_rotation_x
        dual = dual * turn(Dual(angle, length))
        rotation = sp.rot_axis3(-angle) if number % 2 else sp.rot_axis1(-angle)
        shift = sp.Matrix([0, 0, length]) if number % 2 else sp.Matrix([length, 0, 0])
        whole = whole * sp.Matrix(
            sp.BlockMatrix([[rotation, shift], [sp.zeros(1, 3), sp.eye(1)]]).as_explicit()
        )
    expected = dual_matrix(whole[:3, :3], whole[:3, 3])
    for part in ("primary", "secondary"):
        difference = (getattr(dual, part) - getattr(expected, part)).subs(values)
        assert max(abs(entry.n(40)) for entry in difference) < sp.Float(10) ** -35
    assert dual.T[0, 2] == dual[2, 0]
    assert expected.secondary == sp.ImmutableMatrix(skew(whole[:3, 3]) * whole[:3, :3])


def test_parts_need_one_shape(refuses) -> None:
    refuses(Dual, sp.eye(3), sp.eye(2), raises=ValueError)
    refuses(Dual, 1, sp.eye(2), raises=ValueError)
