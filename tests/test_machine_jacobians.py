"""Every column of a machine's Jacobian, and both ways in which its kernels are evaluated.

The derivatives are held against differences of the plain simulator, which shares no code with rodgen: four values on a
line give a derivative whose error is h⁴/30 of the fifth one. Angles move by h = 4e-4 rad, and what bends more sharply
than a sine by as much less, so the neglected terms are 1e-15 of a column; rounding, eps times the size of a position
over that of the step, leaves 1e-12 of it and some ten times as much where places are added up. Parameters
that change little (a period, a time, those of users' formulas) have longer steps, eight values, and an error of h⁸/630.

C and NumPy run a program that was written without SymPy. It is held against the kernel that SymPy derives, and central
differences of that, with 50 digits: a step of 1e-20 leaves its square, so they differ by the program's constants, which
are rounded. Then C and NumPy are held against the program
with 50 digits. How far they may be off is asked of the program itself: it is evaluated again with inputs that are moved
by the machine epsilon, in a few directions, and a result may be off by `UNITS` times what that changes: a few hundred
roundings of either sign add up like the root of their number. So they are within twice that of each other.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any

import mpmath
import numpy as np
import pytest
import sympy as sp
from exact_programs import exact
from machine_cases import ROWS, Case, every, frame, own, several, skyward, unit
from scipy.spatial.transform import Rotation

from rodgen.calibration.problem import Problem
from rodgen.codegen import Kernel, KernelBuilder
from rodgen.codegen.program import Program
from rodgen.codegen.rows import row_kernels
from rodgen.machines.algebra import Algebra
from rodgen.machines.closed_chain import pose_of
from rodgen.machines.derivation import derive_programs, model_kernel
from rodgen.machines.model import _key
from rodgen.machines.model_steps import ModelSteps
from rodgen.machines.structure import Structure
from rodgen.symbolic import select

KINDS = ["point", "direction", "distance"]
UNITS = 16
DIRECTIONS = 6
EPS = float(np.finfo(float).eps)
STENCILS = {4: {1: 2 / 3, 2: -1 / 12}, 8: {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}}


# columns -----------------------------------------------------------------------------------------------------


def step(case: Case, key: str, values: dict[str, float]) -> float:
    """Return a change of a parameter that changes the reading by some 0.1 mm, or 4e-4 rad."""
    parameter = case.model.parameters[case.model.keys[key]]
    name = key.rsplit(".", 1)[1]
    if "own_" in key:
        part = {"P": 2.5e-3, "D": 2.5e-3, "tau": 0.02, "c": 0.02, "L0": 0.02}.get(name, 0.3)
        return part * abs(values[key])
    if name == "P":  # turns by 2 pi q dP / P²
        joint = case.machine.number_of(str(parameter.place))
        return float(0.02 * values[key] ** 2 / (2 * np.pi * np.abs(case.observations.q[:, joint]).max()))
    if name == "tau":
        return 8.0 if parameter.effect == "warm_up_drift" else 4e-4
    if key.startswith("Z.point."):  # moves only what turns about it by an error
        return 5.0
    steps = {
        "arcsec": 2e-3,
        "deg": 2e-3,
        "rad": 2e-3,
        "mm": 0.5,
        "arcsec/mm": 5e-6,
        "1": 5e-4,
        "1/K": 5e-5,
        "mm/K": 0.05,
        "mm/s": 1e-4,
    }
    steps |= {
        "arcsec/N/mm": 5e-8,
        "arcsec/N": 2e-5,
        "arcsec/K": 1e-4,
        "mm/N": 0.01,
        "arcsec/s": 5e-7,
        "s**2": 2e-3,
    }
    return steps[parameter.unit] / 5


def moved(case: Case, values: dict[str, float], key: str, by: float) -> np.ndarray:
    """Return what the simulator reads when one parameter has changed; the frame turns by what comes before it."""
    if not key.startswith("frame.r"):
        return case.simulated(values | {key: values.get(key, 0.0) + by})
    turns = ("frame.rx", "frame.ry", "frame.rz")
    change = Rotation.from_rotvec([by * (key == turn) for turn in turns])
    vector = (Rotation.from_rotvec([values[turn] for turn in turns]) * change).as_rotvec()
    return case.simulated(values | dict(zip(turns, vector, strict=True)))


def residuals(case: Case, reading: np.ndarray) -> np.ndarray:
    """Return measured less predicted; of directions in the stereographic measure, level and upwards."""
    measured = case.observations.reading
    if case.kind != "direction":
        return measured - reading
    level = np.cross(-np.array(case.machine.gravity), measured)
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    upward = np.cross(measured, level)
    along = np.sum(measured * reading, axis=1)
    return np.stack([-2 * np.sum(e * reading, axis=1) / (1 + along) for e in (level, upward)], axis=-1)


def columns_off(
    case: Case, values: dict[str, float], keys: Iterable[str], rows: Any, *, within: float = 1e-10
) -> dict[str, float]:
    """Return the columns that are off the simulator's, and by which part of the column."""
    jacobian = case.problem.jacobian(case.theta(values), case.frame(values))
    off = {}
    for key in keys:
        h = step(case, key, values)
        points = 8 if "own_" in key or key.endswith((".P", ".tau")) else 4
        expected = sum(
            factor * (residuals(case, moved(case, values, key, sign * n * h)) * sign)
            for n, factor in STENCILS[points].items()
            for sign in (1, -1)
        )
        expected = expected[rows] / h
        size = np.abs(expected).max()
        off[key] = np.abs(jacobian[rows, :, case.model.keys[key]] - expected).max() / size if size else np.inf
    return {key: part for key, part in off.items() if not part < within}


@pytest.mark.thorough
@pytest.mark.quick("point")
@pytest.mark.parametrize("kind", KINDS)
def test_each_column_is_the_derivative_of_the_simulator(kind):
    case = every(kind)
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    values = case.sizeable(keys, 30.0) | frame(kind)
    rows = np.ones(ROWS, bool)
    if kind == "direction":
        case = case.changed(data=case.data | near(case, values))
        # refraction bends most sharply near the horizon, where differences say little
        unlifted = values | dict.fromkeys((*frame(kind), "refraction.a", "tube_flexure.a"), 0.0)
        rows = np.abs(case.simulated(unlifted) @ case.machine.gravity) > 0.1
        assert rows.sum() > 15
    off = columns_off(case, values, case.model.keys, rows)
    if kind == "direction":
        assert off.pop("Z.load_sag.k0") == np.inf  # a drop that turns nothing
    assert off == {}


@pytest.mark.parametrize("kind", KINDS)
def test_columns_of_an_effect_of_several_components_are_the_derivatives_of_the_simulator(kind, monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    case, numbers = several(kind)
    if kind == "direction":
        case = case.changed(data=case.data | near(case, numbers))
    assert columns_off(case, numbers, case.model.keys, slice(None)) == {}


@pytest.mark.thorough
def test_columns_of_formulas_of_the_sky_are_the_derivatives_of_the_simulator(monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    case, numbers = skyward()
    case = case.changed(data=case.data | near(case, numbers))
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    assert columns_off(case, numbers, keys, slice(None)) == {}


def near(case: Case, values: dict[str, float]) -> dict[str, np.ndarray]:
    """Return directions some degrees off those that are predicted, as measured ones are."""
    reading = case.simulated(values)
    reading = unit(reading + 0.05 * np.random.default_rng(3).normal(size=reading.shape))
    return dict(zip(("ux", "uy", "uz"), reading.T, strict=True))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_columns_of_formulas_are_derivatives_of_the_simulator(kind, monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    case, values = own(kind)
    if kind == "direction":
        case = case.changed(data=case.data | near(case, values))
    assert columns_off(case, values, values, slice(None)) == {}


# C, NumPy and 50 digits --------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.quick("point")
@pytest.mark.parametrize("kind", ["point", "direction", pytest.param("distance", marks=pytest.mark.slow)])
def test_c_and_numpy_give_the_same_numbers_to_rounding(kind, compiler, monkeypatch):
    same_numbers(every(kind), monkeypatch)


def with_sympy() -> Algebra:
    """Return the algebra whose kernels are SymPy's."""
    names = ("sin", "cos", "tan", "exp", "log", "sqrt")
    return Algebra(
        matrix=sp.Matrix,
        functions={
            **{name: getattr(sp, name) for name in names},
            "abs": sp.Abs,
            # as selects: SymPy's derivative of sign is a delta function
            "sign": lambda x: select(x > 0, sp.S.One, select(x < 0, -sp.S.One, sp.S.Zero)),
        },
        atan2=sp.atan2,
        select=select,
        nan=sp.nan,
        pi=sp.pi,
        number=lambda x: sp.Rational(x.numerator, x.denominator),
        circle=lambda degrees: (sp.cos(sp.rad(degrees)), sp.sin(sp.rad(degrees))),
        is_real=lambda x: not sp.sympify(x).has(sp.I, sp.zoo, sp.nan, sp.oo),
        builder=lambda name: KernelBuilder(name, summary="A model.", source="rodgen.machines"),
    )


def derive_kernels(structure: Structure) -> dict[str, Kernel]:
    """Return the kernels of a machine by SymPy, by the names of the programs of its fit."""
    algebra = with_sympy()
    kernels = [
        model_kernel(ModelSteps(structure, "place", algebra, with_residual=False)),
        model_kernel(ModelSteps(structure, "residual", algebra)),
    ]
    if structure.kinematics.is_closed:
        kernels.append(pose_of(ModelSteps(structure, "pose", algebra)))
    return {kernel.name: kernel for kernel in kernels}


def hold_against_sympy(
    kernel: Kernel, structure: Structure, found: np.ndarray, allowed: np.ndarray, inputs: Any
) -> None:
    """Hold the columns of a program, residual and derivatives, against a kernel and its differences, with 50 digits."""
    values = dict(zip(("rows", "g", "e"), ([mpmath.mpf(x) for x in array] for array in inputs), strict=True))
    values |= {"freedom": [mpmath.mpf(0)] * len(structure.slots)} if structure.slots else {}
    (output,) = (port.name for port in kernel.outputs)

    def moved(port: str, n: int, step: Any) -> np.ndarray:
        array = [x + step * (i == n) for i, x in enumerate(values[port])]
        return np.ravel(kernel.evaluate(values | {port: array}, digits=50)[output])

    assert (np.abs(found[:, 0] - moved("rows", 0, 0)) <= allowed[:, 0]).all()
    freedoms = [("freedom", n) for n in range(len(structure.slots))]
    step = mpmath.mpf(10) ** -20
    for column, at in enumerate([*freedoms, *(("e", n) for n in range(len(structure.parameters)))], 1):
        if column < found.shape[1]:
            slope = (moved(*at, step) - moved(*at, -step)) / (2 * step)
            assert (np.abs(slope - found[:, column]) <= allowed[:, column]).all(), at


def same_numbers(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hold the programs of a machine in C and NumPy against what SymPy derives, and 50 digits."""
    kind = case.kind
    structure = case.model.structure
    kernels = derive_kernels(structure)

    def make() -> list[Program]:
        return derive_programs(structure)

    if os.environ.get("RODGEN_CPU") == "numpy":
        monkeypatch.delenv("RODGEN_CPU")
    compiled = row_kernels(_key(structure), make)
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    plain = row_kernels(_key(structure), make)
    keys = [key for key in case.model.keys if not key.startswith("frame.")]
    values = case.sizeable(keys, 30.0) | frame(kind)
    if kind == "direction":
        case = case.changed(data=case.data | near(case, values))
    theta, place = case.theta(values), case.frame(values)
    g, e = case.model.geometries(theta, place, [(0, 0)])[0], case.model.parameters_of_effects(theta)
    problem = Problem(case.model, case.observations)  # of its own: it keeps the block
    rows = problem._block(problem.groups[0], 0, 5)
    rng = np.random.default_rng(9)
    for program in derive_programs(structure):
        kernel = kernels[program.name.removesuffix("_and_jacobian")]
        results = {
            "c": compiled[program.name](rows, g, e),
            "numpy": plain[program.name](rows, g, e),
        }
        assert compiled[program.name].target == "c"
        assert plain[program.name].target == "numpy"
        for row in (0, len(rows) - 1):  # a row of a whole vector of rows, and one of what is left over
            expected, allowed = bound(program, (rows[row], g, e), rng)
            if row == 0:
                with mpmath.workdps(50):
                    hold_against_sympy(kernel, structure, expected, allowed, (rows[row], g, e))
            for target, result in results.items():
                several = result if isinstance(result, tuple) else (result,)
                found = np.concatenate(
                    [output[row].reshape(len(output[row]), -1) for output in several], axis=1
                )
                off = np.abs(found - expected.astype(float))
                assert (off <= allowed).all(), (target, program.name, (off / allowed).max())


def bound(
    program: Program, inputs: Sequence[np.ndarray], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return what a program gives with 50 digits, a column a freedom, and how far off a double may be."""

    def evaluate(arrays: Sequence[Any]) -> np.ndarray:
        several = exact(program, dict(zip(("rows", "g", "e"), arrays, strict=True)))
        return np.concatenate([output.reshape(len(output), -1) for output in several], axis=1)

    with mpmath.workdps(50):
        found = evaluate(inputs)
        change = np.zeros(found.shape)
        for _ in range(DIRECTIONS):
            change = np.maximum(
                change, np.abs(evaluate([beside(a, rng) for a in inputs]) - found).astype(float)
            )
    # a component may cancel where its column does not
    allowed = UNITS * (change.max(axis=0) + EPS / 2 * np.abs(found).astype(float).max(axis=0))
    return found, np.broadcast_to(allowed, found.shape)


def beside(array: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Move every component by the machine epsilon times its own size, up or down."""
    signs = rng.choice([-1, 1], len(array)).tolist()
    return np.array(
        [mpmath.mpf(x) * (1 + sign * mpmath.mpf(EPS)) for x, sign in zip(array.tolist(), signs, strict=True)]
    )
