"""Kernels over many rows: on every instruction set and on NumPy, against exact evaluation; the cache; the notice."""

from __future__ import annotations

import math
import operator
import os
import platform
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
import sympy as sp

from conftest import kept_files
from rodgen.codegen import _rows_source, tape, tape_jacobian
from rodgen.codegen import build_cache as _build_cache
from rodgen.codegen import rows as rows_module
from rodgen.codegen._rows_source import c_source
from rodgen.codegen.build_cache import source_hash
from rodgen.codegen.program import Program
from rodgen.codegen.rows import RowKernel, row_kernels
from rodgen.codegen.tape import Tape, absolute, atan2, cos, exp, log, sign, sin, sqrt, tan
from rodgen.codegen.tape_matrix import Matrix
from rodgen.machines import model
from rodgen.machines.machine import Machine
from rodgen.symbolic import select

JOINTS = 6
COMPILERS = [c for c in ("gcc", "clang") if shutil.which(c)]
needs_compiler = pytest.mark.skipif(not COMPILERS, reason="no C compiler: gcc, clang are not on the PATH")
ON_X86 = platform.machine() in {"x86_64", "AMD64"}
LEVELS = ("", "baseline", "avx2") if ON_X86 else ("", "baseline")
TARGETS = [
    pytest.param("numpy", id="NumPy"),
    *(pytest.param(level, id=level or "native", marks=needs_compiler) for level in LEVELS),
]
BOTH = TARGETS[:2]
EPSILON = np.finfo(float).eps


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, in place of the user's."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("RODGEN_CACHE", str(folder))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.delenv("RODGEN_CPU", raising=False)
    for function in (_build_cache.notice, _build_cache.compiler_version, _build_cache.native_flag):
        function.cache_clear()
    return folder


# A chain of revolute joints ------------------------------------------------------------------------------


def chain() -> list[Program]:
    """Residuals of a point that six revolute joints carry, and with their derivatives by 63 parameters.

    The axes turn by `tilt` and move by `shift`, which are zero: derivatives are taken with respect to them. The row
    holds angles, reading and weights.
    """
    on = Tape()
    rows = on.inputs("rows", JOINTS + 6, same=False)
    g = Matrix(6 * JOINTS + 1, 3, on.inputs("g", 3 * (6 * JOINTS + 1)))  # n, t1, t2, P, u, v; the target
    tilt, shift = (Matrix(JOINTS, 2, on.inputs(name, 2 * JOINTS)) for name in ("tilt", "shift"))
    e, ball = Matrix(JOINTS, 6, on.inputs("e", 6 * JOINTS)), Matrix(on.inputs("ball", 3))
    x = g[6 * JOINTS, :].T + ball
    for j in reversed(range(JOINTS)):
        n, t1, t2, point, u, v = (g[6 * j + i, :].T for i in range(6))
        n = n + tilt[j, 0] * t1 + tilt[j, 1] * t2
        point = point + shift[j, 0] * u + shift[j, 1] * v
        q = rows[j]
        c, s = cos(q), sin(q)
        harmonics = e[j, 2] * c + e[j, 3] * s + e[j, 4] * (c**2 - s**2) + e[j, 5] * 2 * s * c
        angle = q + e[j, 0] + e[j, 1] * q + harmonics
        c, s = cos(angle), sin(angle)
        d = x - point
        x = point + d * c + n.cross(d) * s + n * (n.dot(d) * (1 - c))
    residual = [rows[JOINTS + 3 + i] * (rows[JOINTS + i] - x[i]) for i in range(3)]
    by = tape_jacobian.jacobian_row(residual, [*tilt, *shift, *e, *ball])
    at = tape.with_known([*residual, *by], dict.fromkeys([*tilt, *shift], 0.0))
    residual, by = ([at.get(x, x) for x in values] for values in (residual, by))
    inputs = {"rows": (JOINTS + 6,), "g": (6 * JOINTS + 1, 3), "e": (JOINTS, 6), "ball": (3,)}
    values = {"residual": ((3,), residual)}
    return [
        on.program("values", inputs, values),
        on.program("both", inputs, values | {"residual_jacobian": ((3, 63), by)}),
    ]


@pytest.fixture(scope="module")
def programs() -> list[Program]:
    return chain()


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache for this module, so that the chain is compiled once a target."""
    return tmp_path_factory.mktemp("kept")


@pytest.fixture
def on(
    programs: list[Program], kept: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], dict[str, RowKernel]]:
    """The kernels of the chain on a target."""

    def on(level: str) -> dict[str, RowKernel]:
        monkeypatch.setenv("RODGEN_CACHE", str(kept))
        monkeypatch.setenv("RODGEN_CPU", level)
        return row_kernels("chain", lambda: programs)

    return on


@pytest.fixture(scope="module")
def reference(programs: list[Program]) -> dict[str, list[np.ndarray]]:
    return {program.name: exact(program, *chain_inputs(11)) for program in programs}


def chain_inputs(count: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(7)
    rows = np.hstack([3 * rng.uniform(-1, 1, (count, JOINTS)), rng.uniform(-1, 1, (count, 6))])
    g = rng.uniform(-1, 1, (6 * JOINTS + 1, 3))
    g[: 6 * JOINTS : 6] /= np.linalg.norm(g[: 6 * JOINTS : 6], axis=1)[:, None]
    return rows, g, 1e-2 * rng.uniform(-1, 1, (JOINTS, 6)), 0.1 * rng.uniform(-1, 1, 3)


def exact(program: Program, rows: np.ndarray, *shared: Any) -> list[np.ndarray]:
    """Evaluate with 50 digits, row by row."""
    found = [np.empty((len(rows), *shape)) for shape in program.outputs.values()]
    with mpmath.workdps(50):
        for n, row in enumerate(rows):
            inputs = dict(zip(program.inputs, map(np.ravel, (row, *shared)), strict=True))
            by_seed = [evaluated(program, inputs, seed) for seed in range(max(program.height, 1))]
            for k, (output, result) in enumerate(zip(found, by_seed[0], strict=True)):
                rows_of_it = [values[k] for values in by_seed] if program.by_row and k else result
                output[n] = np.reshape(rows_of_it, output.shape[1:])
    return found


EXACTLY: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "neg": operator.neg,
    "recip": lambda x: 1 / x,
    "lt": operator.lt,
    "select": lambda condition, yes, no: yes if condition else no,
    "abs": abs,
    "pow": operator.pow,
    "sign": mpmath.sign,
    "sqrt": mpmath.sqrt,
    **{name: getattr(mpmath, name) for name in ("sin", "cos", "tan", "exp", "log", "atan2")},
}


def evaluated(program: Program, inputs: Mapping[str, Sequence[float]], seed: int) -> list[list[float]]:
    """The components of each output, where one seed is 1."""
    values: list[Any] = []

    def value(operand: float) -> Any:
        return values[operand] if isinstance(operand, int) else mpmath.mpf(operand)

    for op, *args in program.operations:
        if op == "input":
            values.append(mpmath.mpf(float(inputs[args[0]][args[1]])))
        elif op == "seed":
            values.append(mpmath.mpf(args[0] == seed))
        else:
            values.append(EXACTLY[op](*map(value, args)))
    return [[float(value(x)) for x in found] for found in program.results.values()]


def as_tuple(results: Any) -> tuple[np.ndarray, ...]:
    return results if isinstance(results, tuple) else (results,)


@pytest.mark.thorough
@pytest.mark.parametrize("level", TARGETS)
def test_values_and_derivatives_against_50_digits(on, reference, level):
    for name, kernel in on(level).items():
        assert kernel.target == ("numpy" if level == "numpy" else "c")
        for here, there in zip(as_tuple(kernel(*chain_inputs(11))), reference[name], strict=True):
            # some hundred roundings, of either sign, of terms that are at most ten
            np.testing.assert_allclose(here, there, rtol=0, atol=10 * 10 * EPSILON)


@pytest.mark.thorough("NumPy")
@pytest.mark.parametrize("level", TARGETS)
def test_any_number_of_rows(on, level):
    """A row has the same result wherever it stands: alone, among others, at the end of a block."""
    both = on(level)["both"]
    rows, *shared = chain_inputs(70)
    residual, jacobian = both(rows, *shared)
    assert residual.shape == (70, 3)
    assert jacobian.shape == (70, 3, 63)
    for count in (0, 1, 2, 3, 7, 8, 9, 15, 17, 33):
        for here, there in zip(both(rows[:count], *shared), (residual, jacobian), strict=True):
            # NumPy's own sine may differ by a rounding with the place in the array
            np.testing.assert_allclose(here, there[:count], rtol=0, atol=1e-13 if level == "numpy" else 0)


@pytest.mark.thorough("NumPy")
@pytest.mark.parametrize("level", TARGETS)
def test_products_of_the_jacobian_against_50_digits(on, reference, level):
    both = on(level)["both"]
    residual, jacobian = reference["both"]
    joined = np.concatenate([jacobian, residual[:, :, None]], axis=2)
    for count in (0, 1, 3, 4, 9, 11):
        rows, *shared = chain_inputs(11)
        there = np.einsum("nci,ncj->ij", joined[:count], joined[:count])
        # each factor, at most ten, is good to a hundred epsilons (see above)
        room = 2 * 10 * 100 * EPSILON * 3 * count
        np.testing.assert_allclose(both.gram(rows[:count], *shared), there, rtol=0, atol=room)


@pytest.mark.parametrize("level", TARGETS)
def test_products_of_many_rows_are_those_of_the_stored_jacobian(on, level):
    """Of more rows than C or NumPy takes at once, one of them not finite."""
    kernels = on(level)
    rows, *shared = chain_inputs(5003)
    residual, jacobian = kernels["both"](rows, *shared)
    joined = np.concatenate([jacobian, residual[:, :, None]], axis=2).reshape(-1, 64)
    found = kernels["both"].gram(rows, *shared)
    np.testing.assert_array_equal(found, found.T)
    np.testing.assert_allclose(found, joined.T @ joined, rtol=1e-13, atol=1e-13 * found.max())
    rows[4000, 0] = np.nan
    assert np.isnan(kernels["both"].gram(rows, *shared)[-1, -1])
    with pytest.raises(TypeError, match="values: no Jacobian"):
        kernels["values"].gram(rows, *shared)


@pytest.mark.parametrize("level", TARGETS)
def test_several_values_of_shared_inputs_give_what_calls_with_each_give(on, level):
    """Also of more rows together than NumPy takes at once."""
    kernels = on(level)
    rows, *shared = chain_inputs(700)
    sets = [[factor * values for values in shared] for factor in (1.0, 0.5, 2.0, -1.0)]
    stacked = [np.stack(values) for values in zip(*sets, strict=True)]
    counts, ends = [3, 0, 40, 657], [0, 3, 3, 43, 700]
    in_sets = kernels["both"].in_sets(rows, counts, *stacked)
    for own, start, stop in zip(sets, ends, ends[1:], strict=False):
        for found, alone in zip(in_sets, kernels["both"](rows[start:stop], *own), strict=True):
            np.testing.assert_allclose(
                found[start:stop], alone, rtol=1e-13, atol=1e-13 * np.abs(alone).max(initial=1.0)
            )


@pytest.mark.parametrize("level", TARGETS)
def test_sine_and_cosine_of_any_angle(monkeypatch, level):
    """To 1e5 the inline ones; a vector with an angle beyond is left to libm, the near angles in it, too."""
    monkeypatch.setenv("RODGEN_CPU", level)
    on = Tape()
    (x,) = on.inputs("x", 1, same=False)
    program = on.program("circle", {"x": ()}, {"point": ((2,), [cos(x), sin(x)])})
    circle = row_kernels("circle", lambda: [program])["circle"]
    near = np.random.default_rng(1).uniform(-1e5, 1e5, 64)
    near[:8] = [0.0, 1e-300, np.pi / 2, np.pi, 1e5, -1e5, np.nextafter(np.pi / 4, 0), 1e-9]
    far = np.concatenate([[1.0000001e5, -1e6, 1e12, 1e22, 1e300, 3.0], near[:7]])
    for angles in (near, far):
        (there,) = exact(program, angles)
        # two units in the last place of 1; NumPy's own are good to four
        np.testing.assert_allclose(circle(angles), there, rtol=0, atol=2 * EPSILON)
    for angle in (np.inf, -np.inf, np.nan):
        near[3] = angle
        found = circle(near)
        assert np.isnan(found[3]).all()
        assert np.isfinite(np.delete(found, 3, 0)).all()


def test_zero_parameters_and_shared_terms_cost_nothing(programs):
    values, both = programs
    assert sum(values.operations_of_a_row.values()) <= 360
    assert sum(both.operations_of_a_row.values()) <= 2200
    text = c_source(programs)
    assert text.count("lanes_sine_cosine(") == 1 + 2 * 2 * JOINTS  # its definition; sine and cosine together
    loop = text[text.index("void rows_values(") :]
    shift = loop[: loop.index(" = in3[0];")].split()[-1]
    assert f" + {shift};" in loop[: loop.index("for (size_t start")]  # the target is moved once


# Every construct -----------------------------------------------------------------------------------------


def everything() -> Program:
    """What a program may say, of numbers of the row, of shared numbers, and of both."""
    on = Tape()
    x, y = on.inputs("x", 2, same=False)
    (a, b), (load,) = on.inputs("a", 2), on.inputs("load", 1)  # load is the name of a function in the C
    outputs = {
        "arithmetic": x * y * a * b + x * Fraction(1, 3) - y / 7 + 2 * a * y - x**2 / b + a + b + load,
        "powers": 1 / x + x**-2 * y**3 + sqrt(y) / sqrt(a) + y ** Fraction(3, 2) + y**a + a**y + y**x,
        "circular": sin(x) * cos(x) + sin(a) * cos(y) + tan(x * a) + atan2(x, a) + atan2(load, y),
        "exponential": exp(x) + log(y) + exp(a) * log(b),
        "magnitudes": absolute(x) + sign(x) * y + absolute(a - b) + sign(a - b) * x,
        "row_select": tape.select(x < y, x, tape.select(y < 1, a, 7)),
        "shared_select": tape.select(a < b, x, a) + tape.select(a < b, tape.select(a < 0, x, y), b),
        "mixed_select": tape.select(x < y, x * a, 3) + tape.select(a > x, x, load),
        "condition_of_a_shared_select": tape.select(tape.select(a < b, x, b) < y, a, b),
        "an_input": x,
        "a_shared_input": b,
        "a_number": 2 / 3 + math.pi,
        "a_shared_value": sin(a) + tape.select(a < b, a, sign(b)),
        "nothing": tape.select(x > 0, math.nan, y),
    }
    inputs = {"x": (2,), "a": (2,), "load": ()}
    components = {name: ((), [value]) for name, value in outputs.items()}
    return on.program("everything", inputs, components | {"matrix": ((2, 2), [x, 0, a, x + y])})


@pytest.mark.thorough("a1-NumPy", "a0-NumPy", "a0-baseline")
@pytest.mark.parametrize("level", TARGETS)
@pytest.mark.parametrize("a", [(0.5, 1.5), (2.0, 0.25)])
def test_every_construct_against_50_digits(monkeypatch, level, a):
    monkeypatch.setenv("RODGEN_CPU", level)
    program = everything()
    made = row_kernels("everything", lambda: [program])["everything"]
    rng = np.random.default_rng(5)
    rows = np.column_stack([rng.uniform(-3, 3, 37), rng.uniform(0.1, 5, 37)])
    found = made(rows, a, 1.25)
    for port, here, there in zip(program.outputs, found, exact(program, rows, a, 1.25), strict=True):
        # a few roundings of terms that may be ten times the sum; the functions of libm are good to one or two
        room = 40 * EPSILON * np.maximum(1, np.abs(there))
        assert np.array_equal(np.isnan(here), np.isnan(there)), port
        assert np.all((np.abs(here - there) <= room) | np.isnan(there)), port


@pytest.mark.parametrize("level", TARGETS)
def test_special_values_go_through(monkeypatch, level):
    monkeypatch.setenv("RODGEN_CPU", level)
    on = Tape()
    (x,), (a,) = on.inputs("x", 1, same=False), on.inputs("a", 1)
    outputs = {
        "safe": tape.select(absolute(x) > 0, 1 / x, a),  # no infinity
        "quotient": a / x,  # infinite at 0
        "root": sqrt(x) + sign(x),  # NaN below 0
    }
    program = on.program("special", {"x": (), "a": ()}, {name: ((), [v]) for name, v in outputs.items()})
    made = row_kernels("special", lambda: [program])["special"]
    safe, quotient, root = made(np.array([0.0, 2.0, -1.0, np.nan, np.inf]), 3.0)
    np.testing.assert_array_equal(safe, [3, 0.5, -1, 3, 0])
    np.testing.assert_array_equal(quotient, [np.inf, 1.5, -3, np.nan, 0])
    np.testing.assert_allclose(root[[0, 1, 4]], [0, np.sqrt(2) + 1, np.inf])
    assert np.isnan(root[[2, 3]]).all()


def parabola() -> Program:
    """Residuals and their Jacobian."""
    on = Tape()
    (x, y), p = on.inputs("rows", 2, same=False), on.inputs("p", 3)
    residual = [p[0] + p[1] * x + p[2] * x**2 - y]
    by = tape_jacobian.jacobian_row(residual, p)
    outputs = {"residual": ((1,), residual), "residual_jacobian": ((1, 3), by)}
    return on.program("both", {"rows": (2,), "p": (3,)}, outputs)


@pytest.mark.thorough("flags0-gcc")
@needs_compiler
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(
    "flags", [(), ("-mavx2", "-mfma"), ("-mavx512f", "-mavx512dq")][: 3 if ON_X86 else 1]
)
def test_c_compiles_without_a_warning(compiler, flags, tmp_path):
    (tmp_path / "k.c").write_text(c_source([everything(), parabola()]))
    command = [compiler, *rows_module.FLAGS, "-Wall", "-Wextra", "-Werror", *flags, "k.c", "-o", os.devnull]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("level", TARGETS)
def test_names_of_the_generated_code_are_free_for_a_user(monkeypatch, level):
    """Joints, columns and parameters have the names that users give them."""
    monkeypatch.setenv("RODGEN_CPU", level)
    on = Tape()
    load = on.inputs("load", 2, same=False)
    names = ("row", "vec", "gamma", "in0", "far", "rows", "about")
    others = [on.inputs(name, 1)[0] for name in names]
    named = load[0] * others[0] + others[1]
    outputs = {"out0": ((), [sum(others, sin(named))]), "mask": ((), [named])}
    program = on.program("row", {"load": (2,), **dict.fromkeys(names, ())}, outputs)
    out0, mask = row_kernels("names", lambda: [program])["row"]([[1.0, 2.0]], *range(7))
    assert mask == [1.0]
    assert out0 == pytest.approx(np.sin(1.0) + 21, rel=1e-15)


# Derivatives by one sweep for all rows of a Jacobian -------------------------------------------------------


def numbers_of_a_chain(x: Any, p: Any, f: dict[str, Any]) -> list[Any]:
    """Three values, of which two depend on most of the parameters through one number; one is a parameter alone."""
    narrow = sum((f["sin"](a * x[0]) * b for a, b in pairwise(p)), x[1]) * p[0]
    chosen = f["select"](x[0] < p[1], f["cos"](narrow) * p[2], narrow**2 / (p[3] + narrow**2))
    return [chosen * x[2] + p[0], f["sqrt"](1 + chosen**2) - narrow * p[1], p[4]]


@pytest.mark.thorough("500-NumPy")
@pytest.mark.parametrize("level", TARGETS)
@pytest.mark.parametrize("part", [6, 500])
def test_one_sweep_gives_all_rows_of_a_jacobian(monkeypatch, level, part):
    monkeypatch.setenv("RODGEN_CPU", level)
    monkeypatch.setattr(_rows_source, "PART", part)

    def make() -> list[Program]:
        on = tape.Tape()
        x, p = on.inputs("x", 3, same=False), on.inputs("p", 6)
        values = numbers_of_a_chain(x, p, vars(tape))
        by = tape_jacobian.jacobian_row(values, p)
        outputs = {"f": ((3,), values), "by": ((3, 6), by)}
        return [on.program("chain", {"x": (3,), "p": (6,)}, outputs)]

    (program,) = make()
    assert program.by_row
    rng = np.random.default_rng(3)
    rows, shared = rng.uniform(0.5, 2, (19, 3)), rng.uniform(0.5, 1.5, 6)
    x, p = sp.symbols("x:3", positive=True), sp.symbols("p:6", positive=True)
    there = sp.Matrix(numbers_of_a_chain(x, p, {**vars(sp), "select": select}))
    wanted = sp.lambdify([x, p], [there.T, there.jacobian(p)], "numpy")
    chain = row_kernels(f"sweep {part}", make)["chain"]
    values, by = chain(rows, shared)
    expected = [wanted(row, shared) for row in rows]
    np.testing.assert_allclose(values, np.concatenate([e[0] for e in expected]), rtol=0, atol=1e-13)
    np.testing.assert_allclose(by, [e[1] for e in expected], rtol=0, atol=1e-12)
    joined = np.concatenate([by, values[:, :, None]], axis=2).reshape(-1, 7)
    np.testing.assert_allclose(chain.gram(rows, shared), joined.T @ joined, rtol=1e-12, atol=1e-10)


def test_what_acts_through_one_number_is_differentiated_once():
    def operations_of_each_row(harmonics: int) -> int:
        on = tape.Tape()
        (x,), (a, b) = on.inputs("x", 1, same=False), on.inputs("p", 2)
        angle = sum((tape.sin(k * a * x) * b for k in range(1, harmonics + 1)), x)
        values = [tape.cos(angle) * a, tape.sin(angle) * b]
        by = tape_jacobian.jacobian_row(values, [a, b])
        program = on.program("f", {"x": (1,), "p": (2,)}, {"f": ((2,), values), "by": ((2, 2), by)})
        return sum(program.seeded)

    assert operations_of_each_row(20) == operations_of_each_row(4)


# The call ------------------------------------------------------------------------------------------------


def line() -> Program:
    on = Tape()
    (x, _), (height, slope) = on.inputs("x", 2, same=False), on.inputs("p", 2)  # of x one number is not used
    return on.program("line", {"x": (2,), "p": (2,)}, {"y": ((), [height + slope * x])})


@pytest.fixture(params=BOTH)
def straight(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> RowKernel:
    monkeypatch.setenv("RODGEN_CPU", request.param)
    return row_kernels("line", lambda: [line()])["line"]


def test_attributes(straight):
    assert (straight.name, straight.inputs, straight.outputs) == ("line", {"x": (2,), "p": (2,)}, {"y": ()})
    assert repr(straight) == f"<RowKernel line(x, p) -> y, {straight.target}>"


def test_arrays_of_other_layouts_and_types_are_welcome(straight):
    expected = [5.0, 7.0, 9.0]
    rows = np.array([[0, 9], [1, 9], [2, 9]])
    frozen = np.array([5.0, 2.0])
    frozen.flags.writeable = False
    wide = np.zeros((3, 4))
    wide[:, ::2] = rows
    for given in (rows, rows.tolist(), np.asfortranarray(rows, float), wide[:, ::2], rows.astype(np.float32)):
        assert straight(given, frozen).tolist() == expected
        assert straight(given, [5, 2]).tolist() == expected
    assert straight(np.empty((0, 2)), frozen).shape == (0,)


def test_results_are_written_where_they_are_asked_for(straight):
    out = np.full(4, np.nan)
    result = straight([[0, 9], [1, 9], [2, 9]], [5, 2], out=out[:3])
    assert np.shares_memory(result, out)
    assert out[:3].tolist() == [5, 7, 9]
    assert np.isnan(out[3])


@pytest.mark.parametrize(
    ("arguments", "out", "error", "told"),
    [
        (([[1, 2]],), None, TypeError, "line: 1 arguments; expected x, p"),
        (([1, 2], [1, 2]), None, ValueError, r"x has shape \(2,\); expected \(count, 2\)"),
        (([[1, 2, 3]], [1, 2]), None, ValueError, r"x has shape \(1, 3\); expected \(count, 2\)"),
        (([[1, 2]], [1, 2, 3]), None, ValueError, r"p has shape \(3,\); expected \(2,\)"),
        ((3, [1, 2]), None, ValueError, r"x has shape \(\); expected \(count, 2\)"),
        (([[1, 2]], [1, 2]), np.empty(2), ValueError, r"out for y has shape \(2,\); expected \(1,\)"),
        (
            ([[1, 2]], [1, 2]),
            np.empty(1, int),
            TypeError,
            "out for y has type int64, which does not hold float64",
        ),
        (([[1, 2]], [1, 2]), (np.empty(1),) * 2, ValueError, "out has 2 arrays; expected 1"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(straight, arguments, out, error, told):
    with pytest.raises(error, match=told):
        straight(*arguments, out=out)


def test_sets_that_are_not_those_of_the_rows_are_refused(straight):
    rows, values = np.ones((4, 2)), np.ones((2, 2))
    assert [a.shape for a in straight.in_sets(rows, [3, 1], values)] == [(4,)]
    with pytest.raises(ValueError, match="line: 4 rows; expected 3, the sum of the counts"):
        straight.in_sets(rows, [2, 1], values)
    with pytest.raises(ValueError, match="line: 2 sets of p; expected 3"):
        straight.in_sets(rows, [2, 1, 1], values)


def test_out_that_overlaps_an_input_is_refused(straight):
    rows = np.ones((2, 2))
    with pytest.raises(ValueError, match="out for y overlaps an input"):
        straight(rows, [1, 2], out=rows[0])


def test_threads_share_a_kernel(on):
    both = on("")["both"]
    rows, *shared = chain_inputs(400)
    expected = both(rows, *shared)
    out = tuple(np.empty_like(a) for a in expected)

    def part(start: int) -> None:
        here = slice(start, start + 50)
        both(rows[here], *shared, out=tuple(a[here] for a in out))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(part, range(0, 400, 50)))
    for here, there in zip(out, expected, strict=True):
        np.testing.assert_allclose(here, there, rtol=0, atol=1e-13)


# The cache -----------------------------------------------------------------------------------------------


def counting(programs: Callable[[], list[Program]]) -> tuple[Callable[[], list[Program]], list[int]]:
    calls: list[int] = []

    def make() -> list[Program]:
        calls.append(1)
        return programs()

    return make, calls


@pytest.mark.parametrize("level", BOTH)
def test_made_once_for_a_key(cache, monkeypatch, level):
    monkeypatch.setenv("RODGEN_CPU", level)
    make, calls = counting(lambda: [line()])
    for _ in range(2):
        assert row_kernels("one", make)["line"]([[2, 0]], [1, 1]).tolist() == [3]
    assert len(calls) == len(kept_files(cache)) == 1
    row_kernels("two", make)
    assert len(calls) == len(kept_files(cache)) == 2


def test_another_text_of_the_generator_is_another_key(cache, monkeypatch):
    make, calls = counting(lambda: [line()])
    row_kernels("one", make)
    monkeypatch.setattr(rows_module, "source_hash", lambda *_: "another text")
    row_kernels("one", make)
    assert len(calls) == 2


@pytest.mark.parametrize("path", ["effects/_formula_tree.py", "../data/units.py"])
def test_another_text_of_what_gives_a_formula_its_meaning_is_another_key(tmp_path, monkeypatch, path):
    home = Path(model.__file__).parent
    monkeypatch.setattr(model, "_HOME", tmp_path / "machines")
    for folder in (home, home.parent / "data"):
        shutil.copytree(folder, tmp_path / folder.name)
    structure = Machine.load(Path(__file__).parents[1] / "examples/machines/mount/machine.toml").structure
    before = model._key(structure)
    source_hash.cache_clear()
    assert model._key(structure) == before
    with (tmp_path / "machines" / path).open("a") as file:
        file.write("#")
    source_hash.cache_clear()
    assert model._key(structure) != before


@needs_compiler
def test_another_processor_flag_or_compiler_is_another_library(cache, monkeypatch):
    """A cache on a shared disk serves different processors."""
    make, calls = counting(lambda: [line()])
    row_kernels("one", make)
    monkeypatch.setattr(_build_cache, "compiler_version", lambda _: "another version")
    row_kernels("one", make)
    monkeypatch.setattr(rows_module, "native_flag", lambda _: ("", "another processor"))
    row_kernels("one", make)
    monkeypatch.setattr(rows_module, "FLAGS", (*rows_module.FLAGS, "-DOTHER"))
    row_kernels("one", make)
    assert len(calls) == len(kept_files(cache)) == 4


LOADED = """
import sys
from rodgen.codegen.rows import row_kernels
def make():
    raise SystemExit("made again")
kernel = row_kernels("one", make)["line"]
print(kernel([[2.0, 0.0]], [1.0, 1.0]), kernel.target)
print(sorted({"sympy", "jinja2", "mpmath"} & set(sys.modules)))
"""


@pytest.mark.parametrize("level", BOTH)
def test_what_is_kept_is_loaded_without_sympy(cache, monkeypatch, level):
    monkeypatch.setenv("RODGEN_CPU", level)
    made = row_kernels("one", lambda: [line()])["line"]
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True)
    assert (done.stderr, done.stdout) == ("", f"[3.] {made.target}\n[]\n")


def told(call: Callable[[], Any]) -> tuple[Any, list[str]]:
    with warnings.catch_warnings(record=True) as notices:
        warnings.simplefilter("always")
        result = call()
    return result, [str(n.message) for n in notices]


@pytest.mark.parametrize(
    ("compiler", "reason"),
    [
        ("no-such-compiler", "CC names the compiler 'no-such-compiler', which is not found"),
        ("false", "false fails: exit code 1"),
    ],
)
def test_without_a_compiler_numpy_runs_and_one_notice_says_why(cache, monkeypatch, compiler, reason):
    monkeypatch.setenv("CC", compiler)
    make, calls = counting(lambda: [line()])
    made, notices = told(lambda: row_kernels("one", make))
    assert made["line"].target == "numpy"
    assert len(notices) == 1
    assert re.fullmatch(f"kernels that are made at run time run on NumPy, not in C: .*{reason}", notices[0])
    again, notices = told(lambda: row_kernels("one", make))
    assert notices == []
    assert again["line"]([[2, 0]], [1, 1]).tolist() == made["line"]([[2, 0]], [1, 1]).tolist() == [3]
    assert len(calls) == (1 if compiler == "no-such-compiler" else 2)


def test_without_any_compiler_on_the_path_the_notice_says_what_to_do(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    made, notices = told(lambda: row_kernels("one", lambda: [line()])["line"])
    assert made.target == "numpy"
    assert notices[0].endswith("no C compiler is found (cc, gcc or clang); install one, or name one in CC")


def test_numpy_that_is_asked_for_is_no_surprise(monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    made, notices = told(lambda: row_kernels("one", lambda: [line()]))
    assert made["line"].target == "numpy"
    assert notices == []


def rewritten(path: Path, change: Callable[[bytes], bytes]) -> None:
    """Put another file in the place of one: of a library that this process has loaded no byte may go."""
    content = change(path.read_bytes())
    path.unlink()
    path.write_bytes(content)


SPOIL = {
    "cut": lambda path: rewritten(path, lambda whole: whole[: len(whole) // 2]),
    "bit": lambda path: rewritten(path, lambda whole: whole[:3000] + bytes([whole[3000] ^ 4]) + whole[3001:]),
    "empty": lambda path: rewritten(path, lambda _: b""),
    "open to others": lambda path: path.chmod(0o660),
    "no note": lambda path: path.with_suffix(".json").unlink(),
    "damaged note": lambda path: path.with_suffix(".json").write_text("{"),
}


@pytest.mark.thorough
@pytest.mark.quick("bit")
@needs_compiler
@pytest.mark.parametrize("how", SPOIL)
def test_a_kept_library_that_is_not_as_it_was_written_is_never_loaded(cache, how):
    """In a process of its own: to load half a library would end it."""
    row_kernels("one", lambda: [line()])
    (kept,) = kept_files(cache)
    SPOIL[how](kept)
    done = subprocess.run([sys.executable, "-c", MADE_AGAIN], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "[3.] c\n")
    assert len(re.findall("is not as it was written; it is deleted and made again", done.stderr)) == 1
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True)
    assert (done.stderr, done.stdout) == ("", "[3.] c\n[]\n")
    assert {path.stat().st_mode & 0o777 for path in cache.iterdir()} == {0o600}


NO_FILE_OF_RODGEN = {
    "nested note": lambda path: path.with_suffix(".json").write_text("[" * 100_000),
    "pipe": lambda path: (path.unlink(), os.mkfifo(path, 0o600)),
    "huge": lambda path: os.truncate(path, 1 << 40),
}


@needs_compiler
@pytest.mark.parametrize("how", NO_FILE_OF_RODGEN)
def test_a_kept_library_that_would_be_waited_for_or_fill_the_memory_is_made_again(cache, how):
    row_kernels("one", lambda: [line()])
    (kept,) = kept_files(cache)
    NO_FILE_OF_RODGEN[how](kept)
    made, notices = told(lambda: row_kernels("one", lambda: [line()])["line"])
    assert (made([[2.0, 0.0]], [1.0, 1.0]).tolist(), made.target) == ([3.0], "c")
    assert len(notices) == 1
    assert "is not as it was written; it is deleted and made again" in notices[0]


MADE_AGAIN = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from test_rows import line, row_kernels
kernel = row_kernels("one", lambda: [line()])["line"]
print(kernel([[2.0, 0.0]], [1.0, 1.0]), kernel.target)
"""


def test_a_kept_text_that_is_not_as_it_was_written_is_made_again(cache, monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    make, calls = counting(lambda: [line()])
    row_kernels("one", make)
    (kept,) = kept_files(cache)
    kept.write_text(kept.read_text().replace("mul", "add"))
    assert row_kernels("one", make)["line"]([[2, 0]], [1, 1]).tolist() == [3]
    assert len(calls) == 2


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
@pytest.mark.parametrize(
    "flag", ["-ffast-math", "-Ofast", "-ffinite-math-only", "-funsafe-math-optimizations"]
)
def test_flags_that_change_arithmetic_are_undone(cache, monkeypatch, flag):
    monkeypatch.setenv("CC", f"gcc {flag} -fno-signed-zeros")
    made, notices = told(lambda: row_kernels("one", lambda: [parabola()])["both"])
    assert (made.target, notices) == ("c", [])
    assert (
        np.array([5e-324]) * 1.0 > 0
    )  # GCC links with some of them what sets it to zero in the whole process


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
def test_a_library_with_one_small_output_that_is_not_as_on_numpy_is_not_used(cache, monkeypatch):
    on = Tape()
    (x,), (p,) = on.inputs("x", 1, same=False), on.inputs("p", 1)
    # a third, and an output that is right, and far larger
    outputs = {"y": ((), [(x + p) * Fraction(1, 3)]), "z": ((), [1024 * x])}
    program = on.program("third", {"x": (), "p": ()}, outputs)
    monkeypatch.setenv("CC", "gcc -fsingle-precision-constant")
    made, notices = told(lambda: row_kernels("one", lambda: [program])["third"])
    assert made.target == "numpy"
    assert len(notices) == 1
    assert "computes other numbers than NumPy" in notices[0]
    assert kept_files(cache) == [path for path in cache.iterdir() if path.suffix == ".py"]


@pytest.mark.parametrize("level", BOTH)
def test_a_forbidden_cache_is_done_without(cache, monkeypatch, level):
    monkeypatch.setenv("RODGEN_CPU", level)
    row_kernels("one", lambda: [line()])
    (kept,) = kept_files(cache)
    kept.unlink()
    monkeypatch.setenv("RODGEN_CACHE", os.path.join(os.devnull, "cache"))
    assert row_kernels("one", lambda: [line()])["line"]([[2, 0]], [1, 1]).tolist() == [3]


@needs_compiler
def test_a_cache_into_which_others_can_write_is_not_used(cache):
    cache.mkdir()
    cache.chmod(0o777)
    assert row_kernels("one", lambda: [line()])["line"].target == "c"
    assert list(cache.iterdir()) == []


@pytest.mark.parametrize(
    ("system", "environment", "expected"),
    [
        ("linux", {"RODGEN_CACHE": "/r"}, "/r"),
        ("linux", {"XDG_CACHE_HOME": "/x"}, "/x/rodgen"),
        ("linux", {}, "/home/me/.cache/rodgen"),
        ("darwin", {}, "/home/me/Library/Caches/rodgen"),
        ("win32", {"LOCALAPPDATA": "/local"}, "/local/rodgen/Cache"),
    ],
)
def test_the_cache_is_where_the_platform_keeps_caches(monkeypatch, system, environment, expected):
    for name in ("RODGEN_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {"HOME": "/home/me", **environment}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", system)
    assert _build_cache.cache_folder() == Path(expected)


@pytest.mark.slow
@needs_compiler
def test_processes_that_compile_at_once_do_not_disturb_each_other(cache):
    command = [sys.executable, "-W", "error::RuntimeWarning:rodgen.codegen", "-c", MADE_AGAIN]
    several = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) for _ in range(3)]
    outputs = [process.communicate(timeout=120) for process in several]
    assert outputs == [(b"[3.] c\n", b"")] * 3
    assert [path.suffix for path in kept_files(cache)] == [".so"]
