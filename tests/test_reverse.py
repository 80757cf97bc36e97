"""Adjoint accumulation, compared with forward accumulation, the complex step, and differences with many digits."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
import sympy as sp
from kernel_reference import GENERATED, KERNELS, inputs_of, of_kernels

from rodgen.codegen import Kernel, KernelBuilder, KernelError
from rodgen.symbolic import select

DIGITS = 50


def builder(name: str = "f") -> KernelBuilder:
    return KernelBuilder(name, summary="A test.", source="none")


def one_input(function: Callable[[Any], Any], size: int = 1) -> Kernel:
    """A kernel ``f(x)`` with as many numbers in x as `size`."""
    k = builder()
    x = k.input("x", size, unit="1", doc="numbers")
    k.output("f", function(*x), unit="1", doc="a function of them")
    return k.build()


def slopes(kernel: Kernel, mode: str, **values: Any) -> np.ndarray:
    made = kernel.jacobian(outputs=["f"], mode=mode)
    return np.asarray(made.evaluate(values)["f_jacobian"], dtype=float)


DIFFERENTIATED = sorted(n for n, k in GENERATED.items() if "covariance" not in n and not k.is_derivative)
# SymPy takes a minute for the derivatives of a thousand operations, and the same rules make them as those of a few.
LONG = [n for n in DIFFERENTIATED if GENERATED[n].operations > 100]


@pytest.mark.thorough("polygon_notation_1", "quaternion_from_rodrigues_vector", "link_inverse")
@of_kernels(set(DIFFERENTIATED) - set(LONG))
def test_both_modes_agree_on_every_kernel_and_at_every_hard_input(name: str) -> None:
    check_both_modes(name)


@pytest.mark.slow
@of_kernels(LONG)
def test_both_modes_agree_on_long_kernels_and_at_every_hard_input(name: str) -> None:
    check_both_modes(name)


def check_both_modes(name: str) -> None:
    """Zeros, infinities, NaN and case distinctions among the inputs; both modes with 50 digits.

    Each component of an output is compared by itself: of eight solutions of a robot some have no value at most poses.
    """
    kernel = KERNELS[name]
    inputs = inputs_of(kernel)
    forward, reverse = (kernel.jacobian(mode=mode) for mode in ("forward", "reverse"))
    assert [(p.name, p.shape, p.symbols) for p in forward.outputs] == [
        (p.name, p.shape, p.symbols) for p in reverse.outputs
    ]
    count = len(next(iter(inputs.values())))
    defined = compared = 0
    for row in range(count):
        values = {key: array[row] for key, array in inputs.items()}
        expected, found, function = (k.evaluate(values) for k in (forward, reverse, kernel))
        for port in (p for p in kernel.outputs if not p.is_status):
            key = f"{port.name}_jacobian"
            components = np.ravel(function[port.name])
            slopes_of_each = [np.reshape(k[key], (len(components), -1)) for k in (expected, found)]
            # what cancels is as large as the largest slope
            largest = max(map(abs, filter(mpmath.isfinite, slopes_of_each[0].ravel())), default=0)
            room = mpmath.mpf(10) ** (10 - DIGITS) * max(1, largest)
            for value, there, here in zip(components, *slopes_of_each, strict=True):
                defined += bool(mpmath.isfinite(value))
                # a sum with NaN in it has slopes all the same
                if mpmath.isnan(value) and any(map(mpmath.isnan, there)):
                    assert any(map(mpmath.isnan, here)), (key, row)
                # elsewhere 0 times infinity depends on the order of factors
                elif all(map(mpmath.isfinite, there)):
                    assert max(abs(there - here)) <= room, (key, row)
                    compared += bool(mpmath.isfinite(value))
    assert compared >= defined / 2


EVERY_OPERATION = [
    ("sum, product, rational factors", lambda x, y, z: 2 * x - y / 3 + x * y * z - x**2 * y + 7, True),
    (
        "powers",
        lambda x, y, z: x**-2 + y**3 / z + sp.sqrt(z) - 1 / sp.sqrt(x * z) + z ** sp.Rational(3, 2),
        True,
    ),
    ("general powers", lambda x, y, z: x**y + z ** sp.Rational(1, 3) + 2**x, True),
    ("circular functions", lambda x, y, z: sp.sin(x * y) + sp.cos(x - z) * sp.tan(y), True),
    ("exponentials", lambda x, y, z: sp.exp(-x / y) * sp.log(z) + sp.sinh(x) * sp.cosh(y) - sp.tanh(z), True),
    ("inverse functions", lambda x, y, z: sp.asin(x / 3) + sp.acos(y / 5) * sp.atan(z), True),
    ("two arguments, magnitudes", lambda x, y, z: sp.atan2(x, y) * sp.Abs(z) + sp.sign(x) * z, False),
    (
        "selects",
        lambda x, y, z: select(x < y, x * z, y**2) + x * select(z > 9, z, select(y > 0, x, -y)),
        False,
    ),
]


@pytest.mark.parametrize(
    ("function", "smooth"), [c[1:] for c in EVERY_OPERATION], ids=[c[0] for c in EVERY_OPERATION]
)
def test_every_operation_against_differences_and_the_complex_step(function: Any, smooth: bool) -> None:
    kernel = one_input(function, 3)
    at = [Fraction(7, 10), Fraction(9, 8), Fraction(13, 5)]
    found = slopes(kernel, "reverse", x=at)
    step = Fraction(1, 10**20)
    for n in range(3):

        def value(move: Fraction, n: int = n) -> Any:
            return kernel.evaluate({"x": [a + move * (k == n) for k, a in enumerate(at)]}, digits=60)["f"]

        with mpmath.workdps(60):
            difference = (value(step) - value(-step)) / (2 * mpmath.mpf(step.numerator) / step.denominator)
        # central differences: the error is the square of the step; found is rounded to float64
        assert found[n] == pytest.approx(float(difference), rel=1e-15)
    if smooth:
        numeric = sp.lambdify(kernel.inputs[0].symbols, kernel.expand("f"), "numpy")
        for n in range(3):
            moved = [complex(float(a), 1e-30 * (k == n)) for k, a in enumerate(at)]
            # the imaginary part has no cancellation: a few roundings of a sum of a few terms
            assert found[n] == pytest.approx(numeric(*moved).imag / 1e-30, rel=1e-13, abs=1e-14)


@pytest.mark.parametrize(
    ("function", "x", "expected"),
    [
        (lambda x: select(x > 0, sp.sqrt(x), 3 * x), 0, 3),
        (lambda x: select(x > 0, 1 / sp.sqrt(x), -x), 0, -1),
        (lambda x: 2 * select(sp.Abs(x) < 1, x**2, 1 / x) + 5 * x, 0, 5),
        (lambda x: select(x < 1, select(x > 0, sp.log(x), x), sp.sqrt(x - 1)), 0, 1),
        (lambda x: x * select(x > 0, sp.sqrt(x), 0), 0, 0),
        (lambda x: select(x > 0, sp.log(x) * select(x > 1, sp.sqrt(x - 1), x), 4 * x), 0, 4),
        (lambda x: select(x > 0, sp.nan, x), -1, 1),
    ],
)
def test_infinite_slope_of_a_case_that_is_not_taken_does_no_harm(
    function: Any, x: int, expected: int
) -> None:
    kernel = one_input(function)
    assert slopes(kernel, "forward", x=[x]) == [expected]
    assert slopes(kernel, "reverse", x=[x]) == [expected]


def test_a_case_that_two_selects_share_keeps_both_conditions_apart() -> None:
    """The root is used under two conditions that are no opposites; at 0 neither holds."""
    k = builder()
    x = k.input("x", unit="1", doc="a number")
    y = k.input("y", unit="1", doc="a number")
    root = k.let("root", sp.sqrt(x))
    k.output("f", select(x > 0, root, 0) + select(x > y, 2 * root, x), unit="1", doc="sum of two cases")
    kernel = k.build()
    for at, expected in (((0, 1), [1, 0]), ((4, 1), [0.75, 0]), ((4, 5), [1.25, 0])):
        values = dict(zip("xy", at, strict=True))
        assert slopes(kernel, "reverse", **values).tolist() == expected
        assert slopes(kernel, "forward", **values).tolist() == expected


def test_truth_values_are_not_multiplied() -> None:
    kernel = one_input(lambda x: select(x > 0, sp.sqrt(x), 0) * 3)
    lines = [a.value for a in kernel.jacobian(mode="reverse").assignments]
    assert [v for v in lines if v.has(sp.Piecewise) and not isinstance(v, sp.Piecewise)] == []


def test_named_conditions_and_statuses_stay() -> None:
    kernel = KERNELS["solve_axis"].jacobian(["angle"], mode="reverse", values=True)
    names = [p.name for p in KERNELS["solve_axis"].outputs]
    assert [p.name for p in kernel.outputs] == [
        *names[:-1],
        *(f"{n}_jacobian" for n in names[:-1]),
        names[-1],
    ]
    assert kernel.outputs[-1].is_status


def test_work_grows_with_the_outputs_and_not_with_the_inputs() -> None:
    """Griewank: a gradient takes at most five times the operations of its function."""

    k = builder()
    x = k.input("x", 40, unit="1", doc="numbers")
    total = sp.S.One
    for n, a in enumerate(x):
        total = k.let(f"total_{n}", sp.cos(total * a + a))
    k.output("f", total, unit="1", doc="a function of all of them")
    kernel = k.build()
    count = sum(kernel.operations.values())
    gradient = sum(kernel.jacobian(mode="reverse").operations.values())
    assert gradient <= 5 * count
    assert sum(kernel.jacobian(mode="forward").operations.values()) > 3 * gradient


def test_inputs_held_at_numbers_cost_nothing() -> None:
    k = builder()
    x = k.input("x", unit="1", doc="a number")
    a = k.input("a", 2, unit="1", doc="zeros")
    b = k.input("b", unit="1", doc="one")
    k.output("f", sp.sin(x + a[0] * x**2) * b + a[1] * sp.exp(x), unit="1", doc="a function")
    kernel = k.build()
    held = kernel.at({"a": 0, "b": 1})
    assert [p.name for p in held.inputs] == ["x"]
    assert held.operations == {"sin": 1}
    slopes = kernel.jacobian(["a"], mode="reverse").at({"a": [0, 0], "b": 1})
    assert slopes.expand("f_jacobian") == sp.Matrix([sp.cos(x) * x**2, sp.exp(x)])
    assert kernel.at({"b": 0.5}).evaluate({"x": 0, "a": [0, 3]})["f"] == 3


def test_held_inputs_decide_selects() -> None:
    k = builder()
    x = k.input("x", unit="1", doc="a number")
    angle = k.input("angle", unit="rad", doc="zero")
    sine = k.let("sine", sp.sin(angle) / angle)
    k.output("f", x * select(sp.Abs(angle) < 1, 1 - angle**2 / 6, sine), unit="1", doc="a product")
    held = k.build().jacobian(mode="reverse", values=True).at({"angle": 0})
    assert held.expand("f") == x
    assert held.expand("f_jacobian") == sp.Matrix([1, 0])


def test_what_is_infinite_or_not_real_at_held_inputs_is_as_in_floating_point() -> None:
    k = builder()
    x = k.input("x", unit="1", doc="a number")
    a = k.input("a", unit="1", doc="zero")
    root, quotient = k.let("root", sp.sqrt(a - 1)), k.let("quotient", 1 / a)
    k.output("f", select(quotient < 5, root, x) + select(a > 1, root * x, 2 * x), unit="1", doc="a sum")
    kernel = k.build()
    assert kernel.at({"a": 0}).expand("f") == 3 * x
    assert kernel.evaluate({"x": 7, "a": 0})["f"] == 21
    with pytest.raises(KernelError, match="f_jacobian_1 has no value at"):
        kernel.jacobian(["a"], mode="reverse").at({"a": 1})


def test_a_missing_value_is_an_error() -> None:
    kernel = one_input(lambda x: 1 / x)
    with pytest.raises(KernelError, match="f has no value at"):
        kernel.at({"x": 0})
    with pytest.raises(KernelError, match="x is fixed at \\[1, 2\\]; expected one number or 1"):
        kernel.at({"x": [1, 2]})
    with pytest.raises(KeyError, match="no port y"):
        kernel.at({"y": 0})
    with pytest.raises(KernelError, match="no mode 'backward'"):
        kernel.jacobian(mode="backward")
