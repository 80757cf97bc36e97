"""The numbers of a tape against SymPy: values, derivatives, matrices, what is found again."""

from __future__ import annotations

import math
import operator
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
import sympy as sp

from rodgen.codegen import tape
from rodgen.codegen._rows_numpy import NumPyProgram
from rodgen.codegen.program import programs_from, text_of
from rodgen.codegen.tape import Tape
from rodgen.codegen.tape_jacobian import _WAYS, forward, jacobian, jacobian_row
from rodgen.codegen.tape_matrix import Matrix
from rodgen.symbolic import select

NAMES = ("sin", "cos", "tan", "asin", "exp", "log", "sqrt")
OF_TAPE = {name: getattr(tape, name) for name in NAMES} | {
    "abs": tape.absolute,
    "select": tape.select,
    "atan2": tape.atan2,
}
OF_SYMPY = {name: getattr(sp, name) for name in NAMES} | {"abs": sp.Abs, "select": select, "atan2": sp.atan2}
FORMULAS = [
    "x*a - a*x/3 + x - (x - b) + 2*x*b*a - 0*y + x*1",
    "(-x)*(-y) - (y - x) + -(x*a)*y - (-y)",
    "x/y + 1/(a*x) + y/2 - (x*y)/y + 3/x",
    "x**2 + y**7 + x**-3 + y**Fraction(3, 2) + y**Fraction(1, 3) + y**a + a**y + 2**x",
    "sin(x)*cos(x*a) + tan(y/3) + exp(-x)*log(y) + sqrt(x*y) + abs(x - 5*y)",
    "select(x < y, x*a, y) + select(y > x, 1, a)*y",
    "a*b + b**2 + sin(a)",
    "atan2(x, y*a) + atan2(-x, -b) + atan2(2, y)",
    "asin(x/3) - b*asin(-y/4)",
]


def value(formula: str, names: dict[str, Any], functions: dict[str, Any]) -> Any:
    return eval(formula, {"Fraction": Fraction, **functions}, names)


def evaluated(on: Tape, values: list[Any], rows: np.ndarray, shared: np.ndarray) -> np.ndarray:
    program = on.program("f", {"rows": (2,), "p": (2,)}, {"f": ((len(values),), values)})
    (program,) = programs_from(text_of([program]))
    found = np.empty((len(rows), len(values)))
    NumPyProgram(program)(len(rows), [rows, shared], [found])
    return found


@pytest.mark.parametrize("formula", FORMULAS)
def test_values_and_derivatives_are_those_of_sympy(formula):
    on = Tape()
    numbers = [*on.inputs("rows", 2, same=False), *on.inputs("p", 2)]
    symbols = sp.symbols("x y a b", positive=True)
    here = value(formula, dict(zip("xyab", numbers, strict=True)), OF_TAPE)
    there = value(formula, dict(zip("xyab", symbols, strict=True)), OF_SYMPY)
    wanted = sp.lambdify(symbols, [there, *(sp.diff(there, s) for s in symbols)], "numpy")
    rng = np.random.default_rng(2)
    rows, shared = rng.uniform(0.5, 2, (9, 2)), np.array([0.75, 1.5])
    found = evaluated(on, [here, *jacobian_row([here], numbers)], rows, shared)
    expected = [wanted(*row, *shared) for row in rows]
    np.testing.assert_allclose(found, np.array(expected, float), rtol=0, atol=2e-13)


@pytest.mark.parametrize("way", range(len(_WAYS)))
def test_derivatives_of_several_values_are_those_of_sympy_in_every_way(way, monkeypatch):
    monkeypatch.setattr("rodgen.codegen.tape_jacobian._WAYS", _WAYS[way : way + 1])
    on = Tape()
    numbers = [*on.inputs("rows", 2, same=False), *on.inputs("p", 2)]
    symbols = sp.symbols("x y a b", positive=True)
    here = [value(f, dict(zip("xyab", numbers, strict=True)), OF_TAPE) for f in FORMULAS]
    there = [value(f, dict(zip("xyab", symbols, strict=True)), OF_SYMPY) for f in FORMULAS]
    wanted = sp.lambdify(symbols, sp.Matrix(there).jacobian(symbols[:2]).doit(), "numpy")
    slopes = jacobian([*here, numbers[1], 3.0], numbers[:2])
    assert slopes[len(here) :] == [[0, 1], [0, 0]]
    row, shared = np.array([[0.8, 1.7]]), np.array([0.75, 1.5])
    found = evaluated(on, [x for each in slopes for x in each], row, shared)[0]
    # some ten roundings of terms up to 300
    np.testing.assert_allclose(found[:-4].reshape(-1, 2), wanted(*row[0], *shared), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("function", "at", "slope"),
    [
        (lambda x: tape.select(x > 0, tape.sqrt(x), 3 * x), 0.0, 3),
        (lambda x: tape.select(x > 0, 1 / tape.sqrt(x), -x), 0.0, -1),
        (lambda x: tape.select(x < 1, tape.select(x > 0, tape.log(x), x), tape.sqrt(x - 1)), 0.0, 1),
        (lambda x: tape.select(x > 0, math.nan, x), -1.0, 1),
    ],
)
def test_forward_an_infinite_slope_of_a_case_that_is_not_taken_does_no_harm(function, at, slope, monkeypatch):
    monkeypatch.setattr("rodgen.codegen.tape_jacobian._WAYS", _WAYS[:1])
    on = Tape()
    (x,) = on.inputs("rows", 1, same=False)
    ((found,),) = jacobian([function(x)], [x])
    with np.errstate(all="ignore"):
        assert evaluated(on, [found], np.array([[at, 0.0]]), np.zeros(2)) == slope


POWERS = (
    "1/x",
    "-3/x**2",
    "y/x**3",
    "x**-4",
    "y - x**-7",
    "1/sqrt(x)",
    "x**Fraction(5, 3)",
    "x**Fraction(-5, 3)",
)


@pytest.mark.parametrize("power", POWERS)
def test_where_a_power_has_no_finite_slope_it_is_the_infinity_that_mpmath_tends_to(power):
    def slope(x):
        values = {"Fraction": lambda a, b: mpmath.mpf(a) / b, "sqrt": mpmath.sqrt}
        return mpmath.diff(lambda x: value(power, {"x": x, "y": mpmath.mpf(2)}, values), x, h=x / 10**9)

    near, nearer = (slope(mpmath.mpf(10) ** -n) for n in (40, 80))
    limit = math.copysign(math.inf, nearer) if abs(nearer) > abs(near) else 0.0
    on = Tape()
    x, y = on.inputs("rows", 2, same=False)
    here = value(power, {"x": x, "y": y}, OF_TAPE)
    slopes = [jacobian_row([here], [x])[0], forward([here], [x])[0][0]]
    np.testing.assert_array_equal(evaluated(on, slopes, np.array([[0.0, 2.0]]), np.zeros(2)), [[limit] * 2])


def test_inputs_that_become_known_leave_nothing_behind():
    on = Tape()
    (x, y), (a, zero) = on.inputs("rows", 2, same=False), on.inputs("p", 2)
    moved = x + zero * y
    f = tape.sin(moved) * a
    by = jacobian_row([f], [zero])
    known = tape.with_known([f, *by], {zero: 0})
    program = on.program(
        "f", {"rows": (2,), "p": (2,)}, {"f": ((), [known[f]]), "by": ((), [known[x] for x in by])}
    )
    assert [op for op, *_ in program.operations] == [
        "input",
        "input",
        "input",
        "sin",
        "mul",
        "cos",
        "mul",
        "mul",
    ]
    assert program.shared == [False, False, True, False, False, False, False, False]


def test_what_was_computed_is_found_again_and_what_all_rows_share_is_computed_once():
    on = Tape()
    (x,), (a, b) = on.inputs("rows", 1, same=False), on.inputs("p", 2)
    assert x * a + b is b + a * x
    assert (x * a) * b is x * (a * b)
    assert x - x == 0
    assert x / x == 1


def test_what_has_no_value_has_no_derivative():
    on = Tape()
    x, y = on.inputs("rows", 2, same=False)
    f = tape.select(x < 1, x * y, math.nan)
    found = evaluated(on, [f, *jacobian_row([f], [x, y])], np.array([[0.5, 3.0], [2.0, 3.0]]), np.zeros(2))
    np.testing.assert_array_equal(found, [[1.5, 3, 0.5], [np.nan] * 3])


@pytest.mark.parametrize(("call", "known"), [(tape.log, -1), (tape.sqrt, -1.0), (tape.log, 0)])
def test_what_is_not_real_is_nan(call, known):
    assert math.isnan(call(known))


def test_matrices_are_those_of_sympy():
    a, b = [[1, 2, 4], [-2, 3, 5], [7, 1, -1]], [[3, 0, 1], [2, -4, 1], [5, 1, 2]]

    def results(matrix: Any) -> list[Any]:
        A, B, u, v = matrix(a), matrix(b), matrix([1, 2, 3]), matrix([4, -1, 2])
        parts = [A * B, A - B, -A + 2 * B, A * u, u.T * B, A.T, A.adjugate(), A.row(1), A.col(2), A[:2, :]]
        parts += [matrix.hstack(u, v), matrix.vstack(u.T, v.T), u.cross(v), A[1:, 0], matrix(3, 1, [1, 2, 3])]
        parts += [matrix.eye(3), matrix.zeros(3, 1)]
        return [*(part.tolist() for part in parts), u.dot(v), A[2], A[1, 2], list(u)]

    assert results(Matrix) == results(sp.Matrix)
    assert operator.eq(Matrix([0, 0, 0]), Matrix.zeros(3, 1))
