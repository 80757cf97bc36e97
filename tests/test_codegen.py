"""From a spec to code: what a builder refuses, what a kernel keeps, derivatives, printers, and the files on disk."""

from __future__ import annotations

import ast
import ctypes
import hashlib
import itertools
import math
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from enum import IntEnum
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import cpp_calls
import hypothesis
import mpmath
import numpy as np
import pytest
import sympy as sp
from code_tokens import ANY_NAME, code_of, python_code
from hypothesis import strategies as st
from kernel_reference import GENERATED, KERNELS, inputs_of, of_kernels, pairs
from octave import Octave, OctaveError

import rodgen
import rodgen.generated
from conftest import CPP_WARNINGS, compile_shared
from rodgen.codegen import Kernel, KernelBuilder, KernelError, numpy_function
from rodgen.codegen.source_files import KernelModule, check_kernels, render, write_kernels
from rodgen.codegen.source_text import in_comment, in_docstring
from rodgen.symbolic import EPS, LARGEST, Derivation, power_of_two_scale, select


class Sign(IntEnum):
    """Which sign a number has."""

    MINUS = -1
    ZERO = 0
    PLUS = 1


def builder(name: str = "sample") -> KernelBuilder:
    return KernelBuilder(name, summary="A sample.", source="none")


# The spec ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    ["2x", "a b", "a-b", "", "lambda", "double", "np", "out", "eps", "größe", "sin", "INT8_MAX", "M_PI"],
)
def test_names_that_no_target_can_have_are_refused(name: str) -> None:
    with pytest.raises(KernelError, match="not a valid name in generated code"):
        builder(name)
    with pytest.raises(KernelError, match=r"not a valid name in generated code|used twice"):
        builder().input(name, unit="1", doc="")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems define other names")
def test_what_the_headers_of_the_generated_c_define_is_no_name(compiler: str) -> None:
    loops = Path(rodgen.generated.__path__[0], "gufunc", "axis_loops.c")
    command = [compiler, "-std=gnu11", "-DREAL_BITS=64", "-dM", "-E", str(loops)]
    told = subprocess.run(command, text=True, capture_output=True, check=True).stdout
    macros = set(re.findall(r"^#define ([A-Za-z]\w*) ", told, re.MULTILINE)) - {"AXIS_H"}  # of that module
    assert {"INT8_MAX", "M_PI", "SHARED"} <= macros
    for name in macros:
        with pytest.raises(KernelError, match="not a valid name in generated code"):
            builder(name)


def test_a_name_is_used_once() -> None:
    k = builder()
    x = k.input("x", 3, unit="1", doc="")
    for again in ("x", "x_2"):
        with pytest.raises(KernelError, match=f"the name {again} is used twice"):
            k.let(again, x[0])
    with pytest.raises(KernelError, match="used twice"):
        k.output("x", x[0], unit="1", doc="")


def test_symbols_from_elsewhere_are_refused() -> None:
    k = builder()
    k.input("x", unit="1", doc="")
    with pytest.raises(KernelError, match="y uses stranger; expected inputs and earlier steps only"):
        k.let("y", sp.Symbol("stranger", real=True) + 1)


def test_a_kernel_without_output_is_refused() -> None:
    with pytest.raises(KernelError, match="has no output"):
        builder().build()


def test_usual_case_of_unknown_steps_is_refused() -> None:
    k = builder()
    x = k.input("x", unit="1", doc="")
    with pytest.raises(KernelError, match="the usual case names nothing"):
        k.usual(x > 0, nothing=1)


def test_missing_ports_steps_and_cases_are_an_error() -> None:
    k = builder()
    k.output("y", k.input("x", unit="1", doc="") ** 2, unit="1", doc="")
    kernel = k.build()
    with pytest.raises(KeyError, match="no port z"):
        kernel.port("z")
    with pytest.raises(KeyError, match="no input, output or step z"):
        kernel.expand("z")
    with pytest.raises(KernelError, match="no usual case"):
        kernel.usual_case()
    with pytest.raises(ValueError, match=r"x has shape \(2,\); expected \(\)"):
        kernel.evaluate({"x": [1, 2]})


def shared_kernel() -> Kernel:
    k = builder("shared")
    x, y = k.input("x", unit="1", doc=""), k.input("y", unit="1", doc="")
    named = k.let("named", x + y)
    k.let("unused", x * 17)
    k.output("first", sp.sqrt(x**2 + y**2) + named, unit="1", doc="")
    k.output("second", 1 / sp.sqrt(x**2 + y**2), unit="1", doc="")
    return k.build()


def test_elimination_keeps_named_steps_shares_the_rest_and_drops_what_nothing_needs() -> None:
    kernel = shared_kernel()
    names = [a.symbol.name for a in kernel.assignments]
    assert "named" in names
    assert "unused" not in names
    # x² + y² and its root, once: an addition there, two more for named and first
    assert kernel.operations == {"add": 3, "mul": 2, "div": 1, "sqrt": 1}
    seen = {s for p in kernel.inputs for s in p.symbols}
    for assignment in kernel.assignments:  # every line uses what stands above it
        assert assignment.value.free_symbols <= seen
        seen.add(assignment.symbol)


def test_expand_writes_an_output_in_the_inputs() -> None:
    kernel = shared_kernel()
    x, y = (p.symbols[0] for p in kernel.inputs)
    assert sp.simplify(kernel.expand("first") - (sp.sqrt(x**2 + y**2) + x + y)) == 0
    named = kernel["named"]
    assert named == sp.Symbol("named", real=True)
    assert kernel.expand("first", keep=(named,)).has(named)
    assert kernel.expand(named) == x + y
    with pytest.raises(KeyError, match="does not compute unused"):
        kernel.expand(kernel["unused"])


# Exact evaluation ----------------------------------------------------------------------------------------


def test_exact_evaluation_has_the_digits_that_are_asked_for() -> None:
    value = shared_kernel().evaluate({"x": Fraction(1, 3), "y": 2}, digits=80)["second"]
    with mpmath.workdps(80):
        assert mpmath.almosteq(value, 1 / mpmath.sqrt(mpmath.mpf(1) / 9 + 4), rel_eps=mpmath.mpf(10) ** -78)


def test_exact_evaluation_takes_floats_as_they_are() -> None:
    k = builder()
    k.output("y", k.input("x", unit="1", doc="") * 10, unit="1", doc="")
    value = k.build().evaluate({"x": 0.1})["y"]
    with mpmath.workdps(50):
        assert value == mpmath.mpf(0.1) * 10
        assert value != 1


def test_exact_evaluation_means_what_floating_point_means() -> None:
    k = builder()
    x, y = k.input("x", unit="1", doc=""), k.input("y", unit="1", doc="")
    k.output("quotient", x / y, unit="1", doc="")
    k.output("root", sp.sqrt(x), unit="1", doc="")
    k.output("chosen", select(x > y, 1, 2), unit="1", doc="")
    kernel = k.build()
    assert kernel.evaluate({"x": 1, "y": 0})["quotient"] == mpmath.inf
    assert kernel.evaluate({"x": -1, "y": 0})["quotient"] == -mpmath.inf
    assert mpmath.isnan(kernel.evaluate({"x": 0, "y": 0})["quotient"])
    assert mpmath.isnan(kernel.evaluate({"x": -1, "y": 1})["root"])
    assert kernel.evaluate({"x": float("nan"), "y": 1})["chosen"] == 2
    assert kernel.evaluate({"x": float("inf"), "y": 1})["chosen"] == 1


def test_exact_powers_and_their_derivatives_are_those_of_floating_point() -> None:
    k = builder()
    x, y = k.input("x", unit="1", doc=""), k.input("y", unit="1", doc="")
    k.output("power", x**y, unit="1", doc="")
    kernel = k.build().jacobian(values=True)
    for point in itertools.product([0.0, -2.0, -0.5, 0.5, 3.0], [0.0, -1.0, 1.0, 2.5, -math.inf, math.inf]):
        exact = kernel.evaluate(dict(zip("xy", point, strict=True)))
        found = [exact["power"], *exact["power_jacobian"]]
        base, exponent = np.array(point)
        with np.errstate(all="ignore"):
            value = base**exponent
            expected = [value, exponent * base ** (exponent - 1), value * np.log(base)]
        np.testing.assert_allclose(np.array(found, float), expected, rtol=1e-15)  # three roundings


def test_derivatives_at_a_pole_are_infinite_or_nan() -> None:
    """1/(x y) and its derivative by x have no value at y = 0; that by y has an infinite one-sided limit."""
    k = builder()
    x, y = k.input("x", unit="1", doc=""), k.input("y", unit="1", doc="")
    k.output("pole", 1 / (x * y), unit="1", doc="")
    kernel = k.build().jacobian(values=True)
    exact = kernel.evaluate({"x": 2, "y": 0})
    value, slopes = numpy_function(kernel)(2.0, 0.0)
    assert exact["pole"] == value == math.inf
    assert mpmath.isnan(exact["pole_jacobian"][0])
    assert np.isnan(slopes[0])
    assert exact["pole_jacobian"][1] == slopes[1] == -math.inf


# The usual case ------------------------------------------------------------------------------------------


WITH_USUAL_CASE = sorted(n for n, k in GENERATED.items() if k.usual)


@pytest.mark.thorough
@of_kernels(n for n in WITH_USUAL_CASE if GENERATED[n].module == "axis")
def test_usual_case_of_the_axis_is_the_kernel_where_its_guard_holds(name: str) -> None:
    """With all digits the two differ by what the guard lets pass: less than the machine epsilon times the condition."""
    kernel, usual = KERNELS[name], KERNELS[name].usual_case()
    inputs = pairs()
    held = 0
    for rho, rho_prime, angle in zip(*inputs.values(), strict=True):
        values = {"rho": rho, "rho_prime": rho_prime, "angle": angle, "length_tolerance": 1e-8}
        full, short = kernel.evaluate(values), usual.evaluate(values)
        if not short.pop("is_usual"):
            continue
        held += 1
        condition = float(KERNELS["axis_condition"].evaluate({k: values[k] for k in inputs})["condition"])
        for port in kernel.outputs:
            if port.is_status:
                assert short[port.name] == full[port.name]
            else:
                difference = np.abs((short[port.name] - full[port.name]).astype(float)).max()
                assert difference <= 2.0**-52 * max(condition, 1)
    assert held >= 8  # the ordinary ones


@of_kernels(n for n in WITH_USUAL_CASE if GENERATED[n].module != "axis")
def test_usual_case_is_the_kernel_where_its_guard_holds(name: str) -> None:
    """Cases are left out that are not taken, so that with all digits the values are the same."""
    kernel, usual = KERNELS[name], KERNELS[name].usual_case()
    held = 0
    for row in zip(*inputs_of(kernel).values(), strict=True):
        values = dict(zip((p.name for p in kernel.inputs), row, strict=True))
        full, short = kernel.evaluate(values), usual.evaluate(values)
        if short.pop("is_usual"):
            held += 1
            assert all(np.array_equal(short[p.name], full[p.name]) for p in kernel.outputs)
    assert held >= 8


# Derivatives ---------------------------------------------------------------------------------------------


def functions_kernel() -> Kernel:
    k = builder("functions")
    x, y = k.input("x", unit="1", doc=""), k.input("y", unit="1", doc="")
    z = k.let("z", x * y + sp.Rational(1, 3))
    k.output("trigonometric", sp.Matrix([sp.sin(z), sp.cos(x), sp.tan(y), sp.atan2(x, y)]), unit="1", doc="")
    k.output("inverse", sp.Matrix([sp.asin(x / 4), sp.acos(y / 4), sp.atan(z)]), unit="1", doc="")
    k.output(
        "growing", sp.Matrix([sp.exp(x), sp.log(y), sp.sinh(x), sp.cosh(y), sp.tanh(z)]), unit="1", doc=""
    )
    k.output("powers", sp.Matrix([sp.sqrt(y), 1 / x, x**3 / y**2, y ** sp.Rational(3, 2)]), unit="1", doc="")
    cases = [abs(x), select(x < y, x**2, sp.sin(y)), select(z > 100, 1 / (z - z**2), y)]
    k.output("cases", sp.Matrix(cases), unit="1", doc="")
    k.output("scaled", x * power_of_two_scale(abs(x)), unit="1", doc="")
    return k.build()


@pytest.mark.parametrize("point", [(0.7, 1.3), (-0.7, 1.3), (1.9, 0.6), (-2.5, 3.1)])
def test_derivatives_against_differences_with_many_digits(point: tuple[float, float]) -> None:
    kernel = functions_kernel()
    jacobian = kernel.jacobian().evaluate(dict(zip("xy", point, strict=True)), digits=50)
    step = mpmath.mpf(10) ** -15
    for column, name in enumerate("xy"):
        values = []
        for sign in (1, -1):
            moved = {n: mpmath.mpf(p) for n, p in zip("xy", point, strict=True)}
            with mpmath.workdps(50):
                moved[name] += sign * step
            values.append(kernel.evaluate(moved, digits=50))
        for port in kernel.outputs:
            with mpmath.workdps(50):
                difference = (values[0][port.name] - values[1][port.name]) / (2 * step)
                found = jacobian[f"{port.name}_jacobian"][..., column] - difference
            # central differences are off by step²/6 times the third derivative, 1e-28 here
            assert np.all(np.abs(np.asarray(found, dtype=float)) < 1e-25)


def test_derivatives_keep_values_and_statuses_where_asked() -> None:
    k = builder()
    x = k.input("x", unit="1", doc="")
    k.output("y", x**2, unit="1", doc="")
    k.status("sign", sp.Piecewise((1, x > 0), (-1, x < 0), (0, True)), Sign, doc="")
    kernel = k.build().jacobian(values=True)
    assert [p.name for p in kernel.outputs] == ["y", "y_jacobian", "sign"]
    result = kernel.evaluate({"x": -3})
    assert (result["y"], result["y_jacobian"][0], result["sign"]) == (9, -6, -1)
    with pytest.raises(KernelError, match="a status has no derivative"):
        k.build().jacobian(outputs=["sign"])


def test_derivatives_of_a_kernel_are_numbers_of_another_and_have_a_formula() -> None:
    k = builder()
    x, y = (k.input(name, unit="1", doc="") for name in "xy")
    k.output("u", x + k.let("square", y**2), unit="1", doc="")
    slopes = k.build().jacobian()
    assert slopes.expand("u_jacobian") == sp.Matrix([[1, 2 * y]]).T
    with pytest.raises(KernelError, match="u_jacobian_1 is a derivative"):
        slopes.expand("u_jacobian", keep=[slopes["square"]])
    k = builder("other")
    by_x, by_y = k.include(slopes)["u_jacobian"]
    k.output("v", by_x * y + by_y, unit="1", doc="")
    assert k.build().evaluate({"x": 7, "y": 5})["v"] == 5 + 2 * 5


# Printers ------------------------------------------------------------------------------------------------

X, Y = sp.symbols("x y", real=True)
CONSTRUCTS: dict[str, Any] = {
    "integer": sp.Integer(3) + X,
    "negative_integer": X * -3,
    "dyadic": X * sp.Rational(3, 8),
    "rational": X * sp.Rational(2, 7) - sp.Rational(1, 3),
    "pi": sp.pi * X,
    "difference": X - Y - (X - 2 * Y),
    "nested_sum": X - (Y - (X + Y * 3)),
    "product_of_sums": (X + Y) * (X - Y),
    "quotient": X / Y,
    "quotient_of_products": X * Y / (3 * (X + 5) * Y**2),
    "quotient_of_quotients": (X / Y) / (Y / (X + 7)),
    "reciprocal": 1 / (X + Y + 5),
    "minus_reciprocal": -1 / (X + 5),
    "square": (X + Y) ** 2,
    "fourth": X**4,
    "seventh": X**7,
    "minus_third": (X + 6) ** -3,
    "root": sp.sqrt(X**2 + Y**2),
    "reciprocal_root": 1 / sp.sqrt(X**2 + Y**2),
    "root_cubed": (X**2 + 1) ** sp.Rational(3, 2),
    "power": (X**2 + 1) ** sp.Rational(1, 3),
    "absolute": sp.Abs(X - Y),
    "sign": sp.sign(X - Y),
    "scale": power_of_two_scale(sp.Abs(X) + 1),
    "less": select(X < Y, X, Y),
    "less_equal": select(X <= Y, -X, 2 * Y),
    "equal": select(sp.Eq(X, Y), 1, X),
    "unequal": select(sp.Ne(X, Y), 1, X),
    "conjunction": select((X > 0) & (Y > 0) & (X < 2), 1, 2),
    "disjunction": select((X > 1) | (Y < 0), 1, 2),
    "negation": select(sp.Not((X > 0) & (Y > 0)), 1, 2),
    "mixed_condition": select(((X > 0) | (Y > 1)) & sp.Not(sp.Eq(X, 1)), X, Y),
    "three_cases": sp.Piecewise((1, X > 1), (2, X > 0), (3, True)),
    "select_in_a_sum": 1 + 2 * select(X > 0, X, Y) - select(Y > 0, X, Y),
    "select_in_a_condition": select(select(X > 0, X, Y) > 1, 1, 2),
    "not_a_number": select(X > 0, X, sp.nan),
    "machine_epsilon": 1 + 4 * EPS * X,
    "largest_number": select(sp.Abs(X) <= LARGEST, X, 0),
}
ELEMENTARY: dict[str, Any] = {
    "sine": sp.sin(X),
    "cosine": sp.cos(X),
    "tangent": sp.tan(X),
    "arc_sine": sp.asin(X / 4),
    "arc_cosine": sp.acos(X / 4),
    "arc_tangent": sp.atan(X),
    "arc_tangent_2": sp.atan2(X, Y),
    "hyperbolic_sine": sp.sinh(X),
    "hyperbolic_cosine": sp.cosh(X),
    "hyperbolic_tangent": sp.tanh(X),
    "exponential": sp.exp(X),
    "logarithm": sp.log(X**2 + 1),
}
POINTS = np.array(
    [
        (0.7, 1.3),
        (-0.7, 1.3),
        (1.9, -0.6),
        (-2.5, -3.1),
        (1.0, 1.0),
        (3.0, 0.25),
        (0.0, 2.0),
        (2.0, -2.0),
        (1e-3, 0.5),
    ]
)


def constructs_module(constructs: dict[str, Any]) -> KernelModule:
    k = builder("constructs")
    k.input("x", unit="1", doc="")
    k.input("y", unit="1", doc="")
    for name, value in constructs.items():
        k.output(name, value, unit="1", doc="")
    return KernelModule("printed", "Every construct.", "none", (k.build(),))


def check_constructs(module: KernelModule, results: tuple[np.ndarray, ...], bits: int) -> None:
    kernel = module.kernels[0]
    limits = np.finfo(f"f{bits // 8}")
    for row, (x, y) in enumerate(POINTS.astype(limits.dtype)):
        exact = kernel.evaluate(
            {"x": float(x), "y": float(y)}, eps=float(limits.eps), largest=float(limits.max)
        )
        for port, result in zip(kernel.outputs, results, strict=True):
            # a dozen operations on numbers up to 7^7 at worst, cancellation included
            expected = float(exact[port.name])
            bound = 16 * float(limits.eps) * max(abs(expected), 8)
            assert result[row] == pytest.approx(expected, abs=bound, nan_ok=True), port.name


@pytest.mark.parametrize("bits", [64, 32])
def test_numpy_printer_writes_every_construct(bits: int) -> None:
    module = constructs_module(CONSTRUCTS | ELEMENTARY)
    results = numpy_function(module.kernels[0])(*POINTS.T.astype(f"f{bits // 8}"))
    assert {r.dtype for r in results} == {np.dtype(f"f{bits // 8}")}
    check_constructs(module, results, bits)


@pytest.mark.parametrize("bits", [64, 32])
def test_c_printer_writes_every_construct(bits: int, compiler: str, tmp_path: Path) -> None:
    module = constructs_module(CONSTRUCTS | ELEMENTARY)
    for name in ("c/printed.h", "c/printed.c"):
        (tmp_path / Path(name).name).write_text(render(module)[name])
    library = ctypes.CDLL(
        str(compile_shared(compiler, [tmp_path / "printed.c"], tmp_path / "printed.so", "-O1"))
    )
    real = np.dtype(f"f{bits // 8}")
    inputs = [np.ascontiguousarray(c, dtype=real) for c in POINTS.T]
    outputs = [np.zeros(len(POINTS), real) for _ in module.kernels[0].outputs]
    function = getattr(library, f"printed_constructs_batch_f{bits}")
    function.restype = None
    function(ctypes.c_size_t(len(POINTS)), *(ctypes.c_void_p(a.ctypes.data) for a in (*inputs, *outputs)))
    check_constructs(module, tuple(outputs), bits)


@pytest.mark.parametrize("bits", [64, 32])
def test_cpp_printer_writes_every_construct(bits: int, cpp_compiler: str, tmp_path: Path) -> None:
    module = constructs_module(CONSTRUCTS | ELEMENTARY)
    kernels = {k.name: k for k in module.kernels}
    (header,) = render(module, ["cpp"]).values()
    library = cpp_calls.cpp_library(cpp_compiler, tmp_path, "printed", header, kernels)
    inputs = [np.ascontiguousarray(c, dtype=f"f{bits // 8}") for c in POINTS.T]
    results = cpp_calls.call(library, "constructs", kernels["constructs"], inputs)
    check_constructs(module, results, bits)


def written(files: dict[str, str], folder: Path) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


@pytest.mark.parametrize("bits", [64, 32])
def test_matlab_printer_writes_every_construct(bits: int, octave: Octave, tmp_path: Path) -> None:
    module = constructs_module(CONSTRUCTS | ELEMENTARY)
    written(render(module, ["matlab"]), tmp_path)
    octave.run(f"addpath('{tmp_path}/matlab');")
    inputs = [np.ascontiguousarray(c, dtype=f"f{bits // 8}") for c in POINTS.T]
    results = octave.call(
        "rodgen.printed.constructs", [c[None] for c in inputs], len(module.kernels[0].outputs)
    )
    check_constructs(module, tuple(r.ravel() for r in results), bits)
    octave.run(f"rmpath('{tmp_path}/matlab');")


def test_what_has_no_real_value_is_nan_in_matlab_as_elsewhere(octave: Octave, tmp_path: Path) -> None:
    """MATLAB gives complex numbers, which would spread to the other columns."""
    k = KernelBuilder("outside", summary="", source="")
    x = k.input("x", unit="1", doc="")
    functions = (
        sp.sqrt,
        sp.log,
        sp.asin,
        sp.acos,
        lambda x: x ** sp.Rational(7, 3),
        lambda x: sp.sqrt(x) ** 3,
    )
    for n, function in enumerate(functions):
        k.output(f"y{n}", function(x), unit="1", doc="")
    module = KernelModule("nowhere", "", "", (k.build(),))
    written(render(module, ["matlab"]), tmp_path)
    given = np.array([-2.0, -0.5, -0.0, 0.0, 0.5, 1.0, 2.0, np.nan, np.inf])
    octave.run(f"addpath('{tmp_path}/matlab');")
    for found, expected in zip(
        octave.call("rodgen.nowhere.outside", [given[None]], len(functions)),
        numpy_function(module.kernels[0])(given),
        strict=True,
    ):
        assert not np.iscomplexobj(found)
        np.testing.assert_allclose(found[0], expected, rtol=1e-15)
    octave.run(f"rmpath('{tmp_path}/matlab');")


@pytest.mark.thorough("32-row by row")
@pytest.mark.parametrize("rows", ["in blocks", "row by row"])
@pytest.mark.parametrize("bits", [64, 32])
def test_vector_printer_writes_every_construct(bits: int, rows: str, compiler: str, tmp_path: Path) -> None:
    """The loop of a gufunc, without NumPy: sine and cosine by polynomials, conditions as masks."""
    k = builder("constructs")
    x, _ = k.input("x", unit="1", doc=""), k.input("y", unit="1", doc="")
    for name, value in CONSTRUCTS.items():
        if not value.has(sp.Rational(1, 3)) and "power" not in name and name not in ("root_cubed", "seventh"):
            k.output(name, value, unit="1", doc="")  # general powers have no vector form
    k.output("sine", sp.sin(x), unit="1", doc="")
    k.output("cosine", sp.cos(x), unit="1", doc="")
    k.output("sine_of_a_sum", sp.sin(x + 1), unit="1", doc="")
    k.output("sine_of_an_output", sp.sin(sp.Symbol("sine", real=True)), unit="1", doc="")
    module = KernelModule("printed", "Every construct.", "none", (k.build(),))
    printed = Derivation(module.name, title=module.summary, source=module.source)
    printed.kernel(*module.kernels)
    write_kernels([printed], tmp_path, extension=True)
    library = tmp_path / "loops.so"
    sources = [str(tmp_path / "c/printed.c"), str(tmp_path / "gufunc/printed_loops.c")]
    command = [
        compiler,
        "-std=c11",
        "-O2",
        "-fopenmp-simd",
        f"-DREAL_BITS={bits}",
        *(["-DROW_BY_ROW"] if rows == "row by row" else []),
        "-fPIC",
        "-shared",
        *sources,
        "-o",
        str(library),
        "-lm",
    ]
    subprocess.run(command, check=True)
    real = np.dtype(f"f{bits // 8}")
    repeated = np.concatenate([POINTS, POINTS, POINTS])  # a whole block and a part of one
    arrays = [np.ascontiguousarray(c, dtype=real) for c in repeated.T]
    arrays += [np.zeros(len(repeated), real) for _ in module.kernels[0].outputs]
    pointers = (ctypes.c_void_p * len(arrays))(*(a.ctypes.data for a in arrays))
    steps = (ctypes.c_ssize_t * len(arrays))(*(real.itemsize for _ in arrays))
    count = (ctypes.c_ssize_t * 1)(len(repeated))
    function = getattr(ctypes.CDLL(str(library)), f"printed_constructs_loop_f{bits}_baseline")
    function.restype = None
    function(pointers, count, steps, None)
    for part in range(3):
        block = slice(part * len(POINTS), (part + 1) * len(POINTS))
        check_constructs(module, tuple(a[block] for a in arrays[2:]), bits)


@pytest.mark.parametrize(("value", "told"), [(sp.gamma(X), "gamma"), (X * sp.Float(0.1), "exact number")])
def test_a_builder_refuses_what_no_language_has(value: Any, told: str) -> None:
    k = builder()
    k.input("x", unit="1", doc="")
    with pytest.raises(KernelError, match=told):
        k.output("y", value, unit="1", doc="")


# A user's words ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words", ['ends in "', 'ends in \\"', "ends in a backslash \\", '"""', 'four """"', "\\N{BEL} \\x"]
)
def test_words_come_out_of_a_docstring_as_they_were(words: str) -> None:
    assert ast.literal_eval(f'"""{in_docstring(words)}"""') == words


@pytest.mark.parametrize("words", ["*/", "/*", "*/*", "/*/", "**//", "*\\", "\\*", "*\\\n/", "/\u202e*"])
def test_words_neither_end_nor_open_a_comment(words: str) -> None:
    assert not {"*/", "/*"} & {in_comment(words)[i : i + 2] for i in range(len(in_comment(words)))}


HOSTILE = '*/ #error no */ \\\n#error "no"\n%{\n%}\nx = 1; ...\n'
"""Ends comments and begins lines, in C, C++ and MATLAB."""


def hostile_module(words: Iterable[str] = (HOSTILE,) * 12) -> KernelModule:
    """Make a module with matrices, codes, names of functions, and whatever a docstring may hold."""
    words = iter(words)

    class Code(IntEnum):
        __doc__ = next(words)
        GOOD = 0
        BAD = -1

    k = KernelBuilder("lever", summary=next(words), source=next(words), notes=next(words))
    arms = k.input("size", (2, 3), unit="m", doc=next(words))
    k.input("unread", unit=next(words), doc=next(words))
    force = k.input("zeros", unit="N", doc=next(words))
    k.output("moments", force * arms, unit="N m", doc=next(words))
    k.status("status", sp.Piecewise((0, force > 0), (-1, True)), Code, doc=next(words))
    return KernelModule("size", next(words), next(words), (k.build(),))


@pytest.mark.parametrize("examples", [10, pytest.param(300, marks=pytest.mark.slow)])
def test_kernels_with_any_words_are_those_with_plain_words(examples: int) -> None:
    def code(words: Iterable[str]) -> list[str]:
        files = render(hostile_module(words), ["numpy", "c", "cpp", "matlab"])
        ways = {"py": python_code, "m": partial(code_of, language="matlab")}
        return [
            ways.get(name.rpartition(".")[2], partial(code_of, language="c"))(text)
            for name, text in sorted(files.items())
        ]

    expected = code(("plain",) * 12)

    @hypothesis.settings(max_examples=examples, deadline=None, database=None)
    @hypothesis.given(st.lists(ANY_NAME, min_size=12, max_size=12))
    def same(words: list[str]) -> None:
        assert code(words) == expected

    same()


def test_cpp_header_stands_names_and_words_of_users(cpp_compiler: str, tmp_path: Path) -> None:
    """It is included twice, by two sources of one program."""
    (header,) = render(hostile_module(), ["cpp"]).values()
    (tmp_path / "size.hpp").write_text(header)
    call = "rodgen::size::lever<float>({{{1, 2, 3}, {4, 5, 6}}}, 0, 2)"
    (tmp_path / "other.cpp").write_text(
        f'#include "size.hpp"\nfloat other() {{ return {call}.moments[1][0]; }}\n'
    )
    (tmp_path / "main.cpp").write_text(
        '#include "size.hpp"\n#include "size.hpp"\nfloat other();\n'
        f"int main() {{ const auto [moments, status] = {call};\n"
        "return !(moments[1][0] == other() && other() == 8 && status == rodgen::size::Code::GOOD); }\n"
    )
    sources = [str(tmp_path / name) for name in ("other.cpp", "main.cpp")]
    command = [cpp_compiler, *CPP_WARNINGS, "-Wold-style-cast", "-Wconversion", *sources]
    done = subprocess.run([*command, "-o", str(tmp_path / "run")], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert subprocess.run([tmp_path / "run"]).returncode == 0
    refused = subprocess.run([*command, "-ffast-math", "-fsyntax-only"], capture_output=True, text=True)
    assert "#error" in refused.stderr


def test_matlab_functions_stand_names_and_words_of_users(octave: Octave, tmp_path: Path) -> None:
    written(render(hostile_module(), ["matlab"]), tmp_path)
    octave.run(f"addpath('{tmp_path}/matlab');")
    octave.run("[moments, status] = rodgen.size.lever([1 2 3; 4 5 6], 0, single([2 -2]));")
    octave.run(
        "assert(moments, single(cat(3, [2 4 6; 8 10 12], -[2 4 6; 8 10 12]))); assert(class(moments), 'single');"
    )
    octave.run("codes = rodgen.size.Code(); assert(status, [codes.GOOD codes.BAD]);")
    octave.run("assert(size(rodgen.size.lever(zeros(2, 3, 0), 0, 1)), [2 3 0]);")
    for arguments, words in (
        ("[1 2 3], 0, 1", "size is 1 x 3; expected 2 x 3 x N"),
        ("ones(2, 3, 4), 0, [1 2 3]", "zeros has 3 columns, another input 4"),
        ("ones(2, 3), 0, ones(2, 2)", "zeros is 2 x 2; expected 1 x N"),
        ("ones(2, 3), 0, 1i", "zeros is no array of real numbers"),
        ("ones(2, 3), 'a', 1", "unread is no array of real numbers"),
    ):
        with pytest.raises(OctaveError, match=words):
            octave.run(f"rodgen.size.lever({arguments});")
    octave.run(f"rmpath('{tmp_path}/matlab');")


@pytest.mark.parametrize(
    ("target", "word", "why"),
    [
        ("cpp", "template", r"template is reserved in generated C\+\+"),
        ("matlab", "end", "end is reserved in generated MATLAB"),
        ("matlab", "x" * 64, "has more than 63 characters in generated MATLAB"),
    ],
)
@pytest.mark.parametrize("where", ["module", "kernel", "input", "step", "code"])
def test_names_that_a_language_keeps_are_refused_when_it_is_asked_for(
    where: str, target: str, word: str, why: str
) -> None:
    name = {part: word if part == where else part for part in ("module", "kernel", "input", "step", "code")}
    k = KernelBuilder(name["kernel"], summary="", source="")
    x = k.input(name["input"] + "_" * (where != "input"), unit="1", doc="")
    y = k.let(name["step"], sp.sin(x))
    k.output("y", y + y**2, unit="1", doc="")
    k.status(
        "status",
        sp.Piecewise((0, x > 0), (1, True)),
        IntEnum("Code", [(name["code"], 0), ("Other", 1)]),
        doc="",
    )
    module = KernelModule(name["module"], "", "", (k.build(),))
    assert len(render(module)) == 3
    with pytest.raises(KernelError, match=why):
        render(module, [target])


# Files ---------------------------------------------------------------------------------------------------


def small_derivation(factor: int = 2) -> Derivation:
    derivation = Derivation("small", title="Small.", source="none")
    k = builder("twice")
    k.output("y", factor * k.input("x", unit="1", doc="a number"), unit="1", doc="a multiple")
    derivation.kernel(k.build())
    return derivation


def test_fresh_files_compare_equal_and_are_not_written_again(tmp_path: Path) -> None:
    written = write_kernels([small_derivation()], tmp_path, extension=True)
    assert {p.relative_to(tmp_path).as_posix() for p in written} >= {
        "numpy/small.py",
        "c/small.c",
        "c/small.h",
    }
    assert check_kernels([small_derivation()], tmp_path, extension=True) == ""
    assert write_kernels([small_derivation()], tmp_path, extension=True) == []


def test_changed_files_are_shown_as_a_diff(tmp_path: Path) -> None:
    write_kernels([small_derivation()], tmp_path)
    difference = check_kernels([small_derivation(3)], tmp_path)
    assert "--- committed/c/small.c" in difference
    assert "+++ regenerated/c/small.c" in difference
    assert any(line.startswith("-") and "K(2.0)*x" in line for line in difference.splitlines())
    assert any(line.startswith("+") and "K(3.0)*x" in line for line in difference.splitlines())


def test_missing_and_stale_files_are_reported(tmp_path: Path) -> None:
    write_kernels([small_derivation()], tmp_path, extension=True)
    (tmp_path / "c" / "small.h").unlink()
    (tmp_path / "c" / "old.c").write_text("/* no kernel makes this */\n")
    difference = check_kernels([small_derivation()], tmp_path, extension=True)
    assert "+++ regenerated/c/small.h" in difference
    assert difference.endswith("c/old.c: no kernel makes this file; delete it\n")


def test_files_of_other_derivations_are_not_stale(tmp_path: Path) -> None:
    write_kernels([small_derivation()], tmp_path)
    (tmp_path / "c" / "neighbour.c").write_text("/* another derivation makes this */\n")
    assert check_kernels([small_derivation()], tmp_path) == ""


def test_line_endings_of_a_checkout_do_not_hide_a_change(tmp_path: Path) -> None:
    write_kernels([small_derivation()], tmp_path)
    path = tmp_path / "c" / "small.c"
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert check_kernels([small_derivation()], tmp_path) != ""


HASH = """
import hashlib, importlib, sys
from pathlib import Path
from rodgen.codegen.source_files import TARGETS, _files
derivations = [importlib.import_module(f"rodgen.derivation.{name}").derivation for name in sys.argv[1:]]
text = "".join(name + content for name, content in sorted(_files(derivations, TARGETS, True, Path()).items()))
print("bytes", hashlib.sha256(text.encode()).hexdigest())
"""


def bytes_with_seed(seed: int, *names: str) -> str:
    """What a fresh process makes; sets and dicts iterate in another order there."""
    environment = {**os.environ, "PYTHONHASHSEED": str(seed)}
    command = [sys.executable, "-c", HASH, *names]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    return done.stdout.splitlines()[-1]


@pytest.mark.slow
def test_bytes_are_the_same_in_every_process() -> None:
    assert bytes_with_seed(0, "rotations") == bytes_with_seed(12345, "rotations")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 99])
def test_bytes_of_all_derivations_are_the_same_in_every_process(seed: int) -> None:
    names = ("axis", "machine_model", "trig_equation", "rotations")
    assert bytes_with_seed(0, *names) == bytes_with_seed(seed, *names)


def test_generated_text_names_no_time_place_or_machine() -> None:
    folder = Path(rodgen.generated.__file__).parent
    for path in [*folder.glob("c/*"), *folder.glob("gufunc/*"), *folder.glob("numpy/*.py")]:
        text = path.read_text()
        assert "Generated by rodgen; do not edit." in text
        assert str(folder) not in text
        assert rodgen.__version__ not in text


def test_hash_of_the_text_does_not_depend_on_the_order_of_derivations(tmp_path: Path) -> None:
    other = Derivation("other", title="Other.", source="none")
    k = builder("thrice")
    k.output("y", 3 * k.input("x", unit="1", doc="a number"), unit="1", doc="a multiple")
    other.kernel(k.build())
    digests = []
    for n, derivations in enumerate(([small_derivation(), other], [other, small_derivation()])):
        write_kernels(derivations, tmp_path / str(n))
        files = sorted(p for p in (tmp_path / str(n)).rglob("*") if p.is_file())
        digests.append([hashlib.sha256(p.read_bytes()).hexdigest() for p in files])
    assert digests[0] == digests[1]


def test_output_that_another_output_uses_is_read_by_its_value(compiler: str, tmp_path: Path) -> None:
    k = KernelBuilder("chained", summary="Two outputs, one of the other.", source="test")
    a = k.input("a", unit="1", doc="a number")
    same = k.let("same", a)  # a plain symbol under another name is a number, not a condition
    k.output("first", same + sp.Rational(1, 2), unit="1", doc="number")
    k.output("pair", sp.Matrix([a**2, a]), unit="1", doc="vector")
    first, pair_1 = sp.Symbol("first", real=True), sp.Symbol("pair_1", real=True)
    k.output("second", first * 3 + pair_1, unit="1", doc="of both")
    kernel = k.build()
    written(render(KernelModule("small", "", "", (kernel,))), tmp_path)
    library = ctypes.CDLL(
        str(compile_shared(compiler, [tmp_path / "c/small.c"], tmp_path / "small.so", "-O1"))
    )
    outputs = [np.zeros(port.size) for port in kernel.outputs]
    library.small_chained_f64(ctypes.c_double(2.25), *(ctypes.c_void_p(x.ctypes.data) for x in outputs))
    for found in (outputs, numpy_function(kernel)(2.25)):
        assert [np.ravel(x).tolist() for x in found] == [[2.75], [5.0625, 2.25], [13.3125]]
