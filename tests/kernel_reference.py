"""Inputs for every kernel, hard ones among them, and what each kernel gives for them with 50 digits.

The reference is the kernel's own expression trees (`Kernel.evaluate`). How far a target may be from it is asked of the
reference, too: it is evaluated again at inputs that are moved by the machine epsilon, in a few directions. A target may
be off by `UNITS` times what that changes, and may take the other side of a case distinction where such a move does.
"""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mpmath
import numpy as np
import pytest
from kernel_inputs import (
    chi_inputs,
    delta_inputs,
    link_inputs,
    loop_inputs,
    pair_inputs,
    parameter_inputs,
    polygon_inputs,
    robot_inputs,
    sps_inputs,
    tricept_inputs,
    trig_inputs,
)
from kinematics_cases import unit
from scipy.spatial.transform import Rotation

import rodgen.generated
from conftest import group_of
from rodgen.codegen import Kernel
from rodgen.generated import numpy as generated_numpy


@dataclass(frozen=True)
class Port:
    """An input or output of a kernel, as its generated docstring describes it."""

    name: str
    shape: tuple[int, ...]
    is_status: bool

    @property
    def size(self) -> int:
        return math.prod(self.shape)


@dataclass(frozen=True)
class Generated:
    """A kernel as the generated files describe it, so that no derivation is executed to name a test.

    `vectorised`, `usual` and `trigonometric` are the branches that the template of the gufunc loops takes.
    """

    module: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    operations: int
    vectorised: bool
    usual: bool
    trigonometric: bool
    is_derivative: bool


PORT = re.compile(r"^ *(\w+) : (int8 )?array \((?:\.\.\.)?,? ?([^)]*)\)", re.MULTILINE)


def generated() -> dict[str, Generated]:
    folder = Path(rodgen.generated.__file__).parent
    texts = {
        file.stem: file.read_text() for file in (*folder.glob("gufunc/*_loops.c"), *folder.glob("c/*.c"))
    }
    found = {}
    for name, function in vars(generated_numpy.ALL).items():
        module = function.__module__.rpartition(".")[2]
        ports = [
            tuple(
                Port(port, tuple(map(int, filter(None, shape.split(",")))), bool(codes))
                for port, codes, shape in PORT.findall(part)
            )
            for part in function.__doc__.split("Returns\n")
        ]
        text = texts[f"{module}_loops"]
        counts = re.search(rf"^/\* {name}: (.*) \*/$", texts[module], re.MULTILINE)
        found[name] = Generated(
            module,
            *ports,
            operations=sum(map(int, re.findall(r"\d+(?= [a-z])", counts[1]))),
            vectorised=f"BLOCKWISE({name})" in text,
            usual=f"TYPED({name}_usual)" in text,
            trigonometric=bool(re.search(rf"[1-9], BLOCKWISE\({name}\)", text)),
            is_derivative="; last axis: " in function.__doc__,
        )
    return found


GENERATED = generated()


class Kernels(Mapping[str, Kernel]):
    """Every kernel by its name; the derivation that it is from is executed when the kernel is first used."""

    def __iter__(self) -> Iterator[str]:
        return iter(GENERATED)

    def __len__(self) -> int:
        return len(GENERATED)

    def __getitem__(self, name: str) -> Kernel:
        derivation = importlib.import_module(f"rodgen.derivation.{GENERATED[name].module}").derivation
        return derivation.kernels[name]


KERNELS = Kernels()
MODULE_OF = {name: found.module for name, found in GENERATED.items()}
LONG_DERIVATIONS = {"machine_model", "tricept", "tricept_uncertainty"}
"""Of the 40 s of a processor that all derivations take, these take 26."""


def of_kernels(
    names: Iterable[str], slow: Callable[[str], bool] = lambda name: False
) -> pytest.MarkDecorator:
    """Repeat a test for kernels; one test process has all that execute the same derivation.

    `slow` tells which kernels are left to `make test-slow`, beside those of `LONG_DERIVATIONS`.
    """
    marked = []
    for name in sorted(names):
        group = pytest.mark.xdist_group(group_of(MODULE_OF[name]))
        is_slow = MODULE_OF[name] in LONG_DERIVATIONS or slow(name)
        marked.append(pytest.param(name, marks=[group, pytest.mark.slow] if is_slow else group))
    return pytest.mark.parametrize("name", marked)


SPATIAL_INPUTS = {
    "spatial_links": link_inputs,
    "spatial_loops": loop_inputs,
    "spherical_polygons": polygon_inputs,
    "biquadratic_pair": pair_inputs,
    "robots_6r": robot_inputs,
    "trig_equation": trig_inputs,
    "delta": delta_inputs,
}
"""For each derivation of spatial mechanisms the function that gives a kernel's inputs by its name."""

UNITS = 16
"""A result may be off by what a change of each input by this multiple of eps makes. The longest chain of dependent
roundings in a kernel is some 60 long; their errors, of either sign, add up like the square root of that, and the few
directions that are tried find about half of the largest change."""
DIRECTIONS = 4


def pairs() -> dict[str, np.ndarray]:
    """Points and angles: ordinary ones, and ones near or at every case distinction of the solver."""
    rng = np.random.default_rng(1)
    rho, rho_prime, angle = [], [], []

    def add(before: object, after: object, chi: float) -> None:
        rho.append(before)
        rho_prime.append(after)
        angle.append(chi)

    def turned(before: np.ndarray, e: np.ndarray, chi: float) -> np.ndarray:
        return Rotation.from_rotvec(np.multiply(e, chi)).apply(before)

    for chi in (0.3, -0.3, 1.0, 2.0, 3.0, -3.0, 4.0, 7.0, -50.0, 1e3):
        e, x = unit(rng.normal(size=3)), 3 * rng.normal(size=3)
        add(x, turned(x, e, chi), chi)
    for chi in (
        1e-3,
        1e-8,
        1e-12,
        np.pi - 1e-8,
        np.pi,
        -np.pi,
        2 * np.pi + 1e-6,
    ):  # angles near 0 and half turns
        e, x = unit(rng.normal(size=3)), rng.normal(size=3)
        add(x, turned(x, e, chi), chi)
    for power in (120, -120, 30, -30, 250, -250):  # lengths
        e, x = unit(rng.normal(size=3)), rng.normal(size=3)
        add(x * 10.0**power, turned(x, e, 1.1) * 10.0**power, 1.1)
    for tilt in (1e-2, 1e-5):  # near the tangent case
        e = unit(rng.normal(size=3))
        x = unit(np.cross(e, rng.normal(size=3))) + tilt * e
        add(x, turned(x, e, 1.3), 1.3)
    for tilt in (1e-3, 1e-9, 0.0):  # near the axis, and on it
        e = unit(rng.normal(size=3))
        x = e + tilt * rng.normal(size=3)
        add(x, turned(x, e, 1.3) if tilt else x, 1.3)
    for factor in (1 + 1e-9, 1 + 1e-6, 1.1, 1e-3):  # lengths that differ
        e, x = unit(rng.normal(size=3)), rng.normal(size=3)
        add(x, factor * turned(x, e, 0.7), 0.7)
    for chi in (
        0.7,
        1e-2,
        3.1,
    ):  # lengths that differ as measured ones do, also for small turns and near half turns
        for factor in (1 + 4e-4, 1 - 4e-4, 1 - 1e-6):
            e, x = unit(rng.normal(size=3)), rng.normal(size=3)
            add(x, factor * turned(x, e, chi), chi)
    x = np.array([1.0, 2.0, -2.0])
    add(x, -x, np.pi)  # every axis perpendicular
    add(x, x, 0.0)  # every axis
    add(x, x, 1e-300)
    add([0, 0, 0], [0, 0, 0], 1.0)
    add([0, 0, 1], [0, 1, 0], 1.0)  # the angle is too small
    add(x, x[::-1], 0.5)
    add(x, x[::-1], 0.0)
    add([0, 0, 0], x, 1.0)
    add(x, [0, 0, 0], 1.0)
    add([np.nan, 0, 0], x, 1.0)
    add(x, [0, np.inf, 0], 1.0)
    add(x, x, np.nan)
    add(x, x, -np.inf)
    return {"rho": np.array(rho), "rho_prime": np.array(rho_prime), "angle": np.array(angle)}


def rotation_inputs() -> Rotation:
    rng = np.random.default_rng(2)
    angles = np.array([0.3, 1.0, 2.0, 3.0, 1e-3, 1e-8, np.pi - 1e-8, 2.5, 1.5, 0.7, 2.2, 1.9])
    vectors = unit(rng.normal(size=(len(angles), 3)))
    vectors[-3:] = np.eye(3)
    return Rotation.from_rotvec(vectors * angles[:, None])


def rotation_vectors() -> np.ndarray:
    """Rotation vectors of every size; some near 1/2, where the series end, on both sides and to rounding."""
    lengths = [0.3, 1.0, 2.0, 3.0, np.pi, 6.0, 50.0, 0.499, 0.501, 0.1, 1e-2, 1e-4, 1e-8, 1e-20, 1e-200]
    random = unit(np.random.default_rng(5).normal(size=(len(lengths), 3))) * np.array(lengths)[:, None]
    border = [[x, 0, 0] for x in (0.5, np.nextafter(0.5, 0), np.nextafter(0.5, 1))] + [[0.3, 0.4, 0]]
    extreme = [[0, 0, 0], [0, -1e-3, 0], [np.nan, 0, 0], [0, np.inf, 0]]
    return np.concatenate([random, border, extreme])


def helical_inputs() -> dict[str, np.ndarray]:
    """Points before and after screws of all angles; and velocities, some along and across the angular one, and none."""
    rng = np.random.default_rng(4)
    angle = np.array([0.3, -1.0, 2.5, 1e-3, 1e-8, np.pi, np.pi - 1e-8, 7.0, 0.0, 1.0, np.nan, 1.0])
    n = len(angle)
    values = {name: rng.normal(size=(n, 3)) for name in ("before", "reading", "point", "position", "origin")}
    values |= {"axis": unit(rng.normal(size=(n, 3))), "angle": angle, "slide": rng.normal(size=n)}
    omega, velocity = rng.normal(size=(2, n, 3))
    omega[-3:-1] = [[0, 0, 1e-6], [0, 0, 0]]
    velocity[0], velocity[1], velocity[2] = omega[0], np.cross(omega[1], velocity[1]), 0
    values["before"][-1], omega[-1] = [np.inf, 0, 0], [np.nan, 0, 1]
    return {**values, "omega": omega, "velocity": velocity}


def inputs_of(kernel: Kernel) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input."""
    names = {p.name for p in kernel.inputs}
    rng = np.random.default_rng(3)
    if MODULE_OF[kernel.name] in SPATIAL_INPUTS:
        values = SPATIAL_INPUTS[MODULE_OF[kernel.name]](kernel.name)
    elif kernel.name.startswith("chi_"):
        values = chi_inputs(names)
    elif kernel.name.startswith("sps_"):
        values = sps_inputs(kernel.name)
    elif MODULE_OF[kernel.name] == "tricept_uncertainty":
        values = parameter_inputs(kernel.name)
    elif kernel.name.startswith("tricept_"):
        values = tricept_inputs(names)
    elif MODULE_OF[kernel.name] == "helical_axis":
        values = helical_inputs()
    elif "rho_prime" in names:
        values = pairs()
        n = len(values["angle"])
        values["length_tolerance"] = np.full(n, 1e-8)
        values["axis"] = unit(rng.normal(size=(n, 3)))
        values["point"] = rng.normal(size=(n, 3))
        for name in ("cov_rho", "cov_rho_prime"):
            root = rng.normal(size=(n, 3, 3))
            size = np.nan_to_num(np.abs(values["rho"]).max(axis=1))[
                :, None, None
            ]  # in proportion to the point
            values[name] = np.clip(1e-3 * root, -1, 1) * np.clip(size, 1e-150, 1e150)
            values[name] = values[name] @ values[name].swapaxes(1, 2)
        values["var_angle"] = np.full(n, 1e-8)
    elif "w" in names:
        values = {"w": rotation_vectors()}
    elif "tilt" in names:
        tilts = rotation_vectors()[:, :2]
        bases = Rotation.from_rotvec(rng.normal(size=(len(tilts), 3))).as_matrix()
        values = {"axis": bases[:, 2], "u": bases[:, 0], "v": bases[:, 1], "tilt": tilts}
    elif "matrix" in names:
        good = rotation_inputs().as_matrix()
        bad = [
            np.eye(3),
            np.diag([1.0, -1, -1]),
            np.diag([1.0, 1, -1]),
            np.full((3, 3), np.nan),
            np.zeros((3, 3)),
        ]
        values = {"matrix": np.concatenate([good, bad, 1.001 * good[:2], good[:1] + np.diag([np.inf, 0, 0])])}
    elif "quaternion" in names:
        good = rotation_inputs().as_quat(scalar_first=True)
        bad = [[1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 1], [-2, 0, 1, 0]]
        values = {"quaternion": np.concatenate([good, -good[:4], 1e150 * good[:1], 1e-150 * good[:1], bad])}
    else:
        turns = rotation_inputs()
        vectors = turns.as_rotvec()
        angles = np.linalg.norm(vectors, axis=1)
        theta = unit(vectors) * 2 * np.tan(angles / 2)[:, None]
        extra = np.array(
            [[0, 0, 0], [1e16, 0, 0], [0, 1e300, 1], [1e-300, 0, 0], [np.nan, 0, 0], [0, 0, np.inf]]
        )
        axes = np.concatenate(
            [unit(vectors), [[0, 0, 2], [0, 0, 0], [0, 1, 0], [1, 0, 0], [0, np.nan, 1], [1, 0, 0]]]
        )
        values = {
            "theta": np.concatenate([theta, extra]),
            "axis": axes,
            "angle": np.concatenate([angles, [1.0, 1.0, 0.0, -np.pi, 1.0, np.inf]]),
        }
        values["rho"] = rng.normal(size=(len(values["theta"]), 3))
    return {p.name: values[p.name] for p in kernel.inputs}


@dataclass(frozen=True)
class Expected:
    """What a kernel gives for its inputs, output by output.

    Values, how far off a target may be (NaN where nothing is said), which codes it may give, and whether it is an angle
    that is cut at half a turn.
    """

    inputs: tuple[np.ndarray, ...]
    values: tuple[np.ndarray, ...]
    tolerances: tuple[np.ndarray, ...]
    codes: tuple[tuple[tuple[frozenset[int], ...], ...], ...]
    cut: tuple[bool, ...]

    def check(self, results: tuple[np.ndarray, ...], rows: object = None) -> None:
        """Assert that `results` are right; `rows` gives the input of each element."""
        rows = np.arange(len(self.inputs[0])) if rows is None else np.asarray(rows)
        assert len(results) == len(self.values)
        for result, value, tolerance, codes, cut in zip(
            results, self.values, self.tolerances, self.codes, self.cut, strict=True
        ):
            assert result.shape == rows.shape + value.shape[1:]
            assert result.dtype == (np.int8 if value.dtype == np.int8 else self.inputs[0].dtype)
            if result.dtype == np.int8:
                wrong = [
                    (int(r), found.tolist())
                    for r, found in zip(
                        rows.ravel(), result.reshape(rows.size, math.prod(value.shape[1:])), strict=True
                    )
                    if not all(c in allowed for c, allowed in zip(found, codes[r], strict=True))
                ]
                assert wrong == []
                continue
            expected, allowed = value[rows], tolerance[rows]
            determined = ~np.isnan(allowed)
            same = np.isnan(result) == np.isnan(expected)
            with np.errstate(invalid="ignore"):
                room = allowed.reshape(rows.shape + (1,) * (value.ndim - 1))
                close = np.abs(result - expected) <= room
                if cut:  # half a turn is one angle, whichever sign rounding gives it
                    half = np.abs(expected) >= np.pi - room
                    close |= half & (np.abs(np.abs(result) - np.abs(expected)) <= room)
            close |= np.isnan(result) | (result == expected)
            good = (same & close).all(axis=tuple(range(rows.ndim, result.ndim))) | ~determined
            assert good.all(), (rows[~good], result[~good], expected[~good], allowed[~good])


@cache
def expected(name: str, bits: int) -> Expected:
    """Evaluate a kernel at its inputs, rounded to numbers of `bits` bits."""
    kernel = KERNELS[name]
    real = np.dtype(f"f{bits // 8}")
    limits = np.finfo(real)
    with np.errstate(over="ignore"):
        inputs = tuple(a.astype(real) for a in inputs_of(kernel).values())
    rng = np.random.default_rng(4)
    options = {"digits": 50, "eps": float(limits.eps), "largest": float(limits.max)}

    def evaluate(row: tuple[np.ndarray, ...]) -> list[np.ndarray]:
        results = kernel.evaluate(dict(zip((p.name for p in kernel.inputs), row, strict=True)), **options)
        return [np.asarray(results[p.name]) for p in kernel.outputs]

    values: list[list[np.ndarray]] = [[] for _ in kernel.outputs]
    tolerances: list[list[float]] = [[] for _ in kernel.outputs]
    codes: list[list[tuple[frozenset[int], ...]]] = [[] for _ in kernel.outputs]

    def moved(row: tuple[np.ndarray, ...], units: int) -> list[list[np.ndarray]]:
        step = units * float(limits.eps)
        return [evaluate(tuple(_moved(x, step, rng) for x in row)) for _ in range(DIRECTIONS)]

    for row in zip(*inputs, strict=True):
        exact = evaluate(row)
        by_one = moved(row, 1)
        by_all = moved(row, UNITS) if any(np.isinf(x.astype(float)).any() for x in exact) else []
        for n, port in enumerate(kernel.outputs):
            near = [m[n] for m in by_one]
            if port.is_status:
                values[n].append(exact[n].astype(np.int8))
                tolerances[n].append(0.0)
                found = zip(*(np.ravel(x) for x in (exact[n], *near)), strict=True)
                codes[n].append(tuple(frozenset(map(int, each)) for each in found))
                continue
            value = exact[n].astype(float)
            values[n].append(value)
            codes[n].append(())
            tolerances[n].append(_allowed(exact[n], near, [m[n] for m in by_all], limits))
    arrays = tuple(map(np.array, values))
    cut = tuple(p.unit == "rad" and bool((v < 0).any()) for p, v in zip(kernel.outputs, arrays, strict=True))
    return Expected(inputs, arrays, tuple(map(np.array, tolerances)), tuple(map(tuple, codes)), cut)


def _moved(x: np.ndarray, eps: float, rng: np.random.Generator) -> np.ndarray:
    """Move every component by the machine epsilon times the largest one, with many digits."""
    x = np.asarray(x)
    size = np.abs(x).max()
    signs = rng.choice([-1, 1], size=x.shape)
    step = mpmath.mpf(float(size)) * eps if np.isfinite(size) else mpmath.mpf(0)
    result = np.empty(x.shape, dtype=object)
    for index in np.ndindex(x.shape):
        with mpmath.workdps(50):
            result[index] = mpmath.mpf(float(x[index])) + int(signs[index]) * step
    return result


def _allowed(exact: np.ndarray, near: list[np.ndarray], farther: list[np.ndarray], limits: np.finfo) -> float:
    """Return UNITS times the change; NaN where rounding decides whether there is a value, or it is too large."""
    kinds = {tuple(bool(mpmath.isfinite(x)) for x in a.ravel()) for a in (exact, *near, *farther)}
    finite = [x for x in exact.ravel() if mpmath.isfinite(x)]
    size = max(map(abs, finite), default=0)
    if len(kinds) > 1 or size > float(limits.max) * float(limits.eps):
        return float("nan")
    change = max(
        (
            abs(x - y)
            for a in near
            for x, y in zip(exact.ravel(), a.ravel(), strict=True)
            if mpmath.isfinite(x)
        ),
        default=0,
    )
    return float(UNITS * (change + size * float(limits.eps) / 2 + float(limits.smallest_subnormal)))
