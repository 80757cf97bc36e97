"""Generated modules on arrays of other libraries; test_kernels.py compares all values."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from types import ModuleType

import numpy as np
import pytest
from kernel_reference import pairs, unit

import rodgen
from rodgen import instantaneous_euler, screws, three_sps_s, tricept
from rodgen.generated.numpy import axis, rotations

LIBRARIES = ("array_api_strict", "torch", pytest.param("jax.numpy", marks=pytest.mark.slow))
RANDOM = np.random.default_rng(20)


@pytest.fixture(params=LIBRARIES)
def xp(request: pytest.FixtureRequest) -> ModuleType:
    """The functions of a library, without which a test is skipped; JAX has 64 bits."""
    if request.param == "jax.numpy":
        pytest.importorskip("jax").config.update("jax_enable_x64", True)
    return pytest.importorskip(request.param)


def turned(count: int) -> tuple[np.ndarray, ...]:
    before, turn = RANDOM.normal(size=(2, count, 3))
    return before, rotations.rotate(before, turn), 2 * np.arctan(np.linalg.norm(turn, axis=-1) / 2)


def test_inputs_broadcast_and_numbers_lists_and_numpy_arrays_are_brought_along(xp: ModuleType) -> None:
    before, after, angle = turned(4)
    with np.errstate(all="ignore"):
        axes, status = axis.solve_axis(before[0].tolist(), xp.asarray(after)[:, None, :], angle[:2], 1.0)
        expected, codes = axis.solve_axis(before[0], after[:, None, :], angle[:2], 1.0)
    assert type(axes) is type(status) is type(xp.asarray(after))
    assert (status.dtype, tuple(axes.shape)) == (xp.int8, (4, 2, 2, 3))
    np.testing.assert_allclose(np.asarray(axes), expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(np.asarray(status), codes)


def test_float32_stays_and_integers_become_float64(xp: ModuleType) -> None:
    turn = np.array([[1, 0, 0], [0, 2, 0]])
    for kind, result in (("float32", xp.float32), ("float64", xp.float64), ("int32", xp.float64)):
        point = xp.asarray(np.ones((2, 3), kind))
        assert rotations.rotate(point, xp.asarray(turn.astype(kind))).dtype == result


def test_what_an_array_cannot_be_is_said(xp: ModuleType) -> None:
    good = xp.asarray(np.ones((2, 3)))
    with pytest.raises(ValueError, match=r"rotate: theta has shape \(2, 2\); expected \(\.\.\., 3\)"):
        rotations.rotate(good, good[:, :2])
    with pytest.raises(TypeError, match=r"rotate: theta has type .*complex"):
        rotations.rotate(good, xp.asarray(np.ones((2, 3), complex)))
    with pytest.raises(TypeError, match="rotate: out is for NumPy arrays"):
        rotations.rotate(good, good, out=np.empty((2, 3)))


@pytest.mark.slow
def test_jax_compiles_maps_and_differentiates() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    before, after, angle = turned(5)
    solve = jax.jit(lambda *given: axis.solve_axis(*given, 1e-6))
    axes, _ = solve(*map(jax.numpy.asarray, (before, after, angle)))
    expected, _ = axis.solve_axis(before, after, angle, 1e-6)
    np.testing.assert_allclose(axes, expected, rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(solve)(before, after, angle)[0], expected, rtol=1e-12)
    slope = jax.vmap(jax.jacobian(lambda chi, a, b: solve(a, b, chi)[0]))(angle, before, after)
    step = 1e-6
    ends = [axis.solve_axis(before, after, angle + side, 1e-6)[0] for side in (step, -step)]
    np.testing.assert_allclose(slope, (ends[0] - ends[1]) / (2 * step), rtol=1e-6, atol=1e-7)


def test_no_array_library_is_imported_for_numpy() -> None:
    code = (
        "import sys, rodgen; rodgen.rotate([1.0, 0, 0], [0, 0, 1.0]); from rodgen.generated.numpy import axis;"
        "axis.solve_axis([1.0, 0, 0], [0, 1.0, 0], 2.0, 1e-8);"
        "print(*{'array_api_compat', 'torch', 'jax', 'cupy'} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == ""


# Public functions refuse arrays with masked elements: they computed with what is behind the mask


VECTOR = np.ma.array(np.eye(3)[:2], mask=[[0, 0, 1], [0, 0, 0]])
ANGLE = np.ma.array([0.1, 0.2], mask=[0, 1])
QUATERNION = np.ma.array([[1.0, 0, 0, 0]], mask=[[0, 1, 0, 0]])
MATRIX = np.ma.array([np.eye(3)], mask=np.eye(3, dtype=bool)[None])
PLATFORM = three_sps_s.Geometry(1.0, 0.5, 0.8)

CALLS = {
    "rotate": lambda: rodgen.rotate(VECTOR, [0, 0, 1.0]),
    "rotate by": lambda: rodgen.rotate([1.0, 0, 0], VECTOR),
    "solve_axis": lambda: rodgen.solve_axis(VECTOR, np.eye(3)[:2], [0.1, 0.2]),
    "fit_axis": lambda: rodgen.fit_axis(np.eye(3)[:2], np.eye(3)[:2], ANGLE),
    "axis_condition": lambda: rodgen.axis_condition(VECTOR, VECTOR, ANGLE),
    "matrix_from_axis_angle": lambda: rodgen.matrix_from_axis_angle(np.eye(3)[:2], ANGLE),
    "matrix_from_quaternion": lambda: rodgen.matrix_from_quaternion(QUATERNION),
    "in a list": lambda: rodgen.rotate([VECTOR[1], VECTOR[0]], [0, 0, 1.0]),
    "tricept in a tuple": lambda: tricept.pose((VECTOR[0],), tricept.PAPER),
    "screws": lambda: screws.line_through(VECTOR, np.eye(3)[:2] + 1),
    "angles_from_euler": lambda: instantaneous_euler.angles_from_euler(VECTOR, "xyz"),
    "angles_from_matrix": lambda: instantaneous_euler.angles_from_matrix(MATRIX),
    "euler_from_quaternion": lambda: instantaneous_euler.euler_from_quaternion(QUATERNION, "xyz"),
    "rotations": lambda: instantaneous_euler.rotations(VECTOR),
    "trajectory": lambda: instantaneous_euler.trajectory(QUATERNION),
    "choose": lambda: instantaneous_euler.choose(VECTOR, x=0.1),
    "legs": lambda: three_sps_s.legs(MATRIX, PLATFORM),
    "rotation_from_tilt_torsion": lambda: three_sps_s.rotation_from_tilt_torsion(ANGLE, 0.1, 0.1),
    "tricept": lambda: tricept.pose(VECTOR, tricept.PAPER),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_masked_elements_are_refused(refuses, call):
    refuses(call)


def test_an_array_with_an_empty_mask_is_an_array():
    given = np.ma.array([1.0, 0, 0], mask=[0, 0, 0])
    np.testing.assert_array_equal(rodgen.rotate(given, [0, 0, 1.0]), rodgen.rotate(given.data, [0, 0, 1.0]))


def test_a_masked_cell_of_measurements_is_an_empty_cell(refuses):
    refuses(rodgen.Measurements.from_frame, {"x [mm]": ANGLE})


# Where the numbers are computed: instruction sets, the NumPy fallback and its notice, Dask


da = pytest.importorskip("dask.array")


def python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        check=False,
        timeout=120,
    )


BLOCKED = """
import sys
sys.modules["rodgen._gufuncs"] = None  # importing it raises ImportError
import rodgen
print(rodgen.backend)
for _ in range(3):
    print(rodgen.solve_axis([2.0, 0, 1], [0, 2.0, 1], 1.6)[0].round(3).tolist())
rodgen.rotate([1.0, 0, 0], [0, 0, 2.0])
"""


def test_without_compiled_kernels_one_notice_says_so_and_numpy_answers() -> None:
    done = python(BLOCKED, RODGEN_CPU="")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == "numpy"
    axes = rodgen.solve_axis([2.0, 0, 1], [0, 2.0, 1], 1.6)[0].round(3).tolist()
    assert done.stdout.splitlines()[1:] == [str(axes)] * 3
    assert done.stderr.count("RuntimeWarning") == 1
    assert "no compiled kernels" in done.stderr
    assert "install a C compiler" in done.stderr


def test_numpy_that_was_asked_for_gives_no_notice() -> None:
    done = python(
        "import rodgen; rodgen.rotate([1.0, 0, 0], [0, 0, 2.0]); print(rodgen.backend)", RODGEN_CPU="numpy"
    )
    assert (done.stdout.strip(), done.stderr) == ("numpy", "")


@pytest.mark.parametrize("level", ["baseline", "avx2", "avx512"])
def test_environment_lowers_the_instruction_set(level: str, gufuncs: dict[str, ModuleType]) -> None:
    if level not in gufuncs:
        pytest.skip(f"this processor or build has no {level}")
    done = python("import rodgen; print(rodgen.backend)", RODGEN_CPU=level)
    assert (done.stdout.strip(), done.stderr) == (level, "")


def test_statuses_are_the_same_everywhere(gufuncs: dict[str, ModuleType]) -> None:
    """Thousands of ordinary and special inputs. Only where a rounding decides may targets part, and that is rare."""
    from rodgen.generated import numpy as generated

    rng = np.random.default_rng(1)
    special = pairs()
    rho = np.concatenate([special["rho"], rng.normal(size=(5000, 3))])
    rho_prime = np.concatenate([special["rho_prime"], rng.normal(size=(5000, 3))])
    lengths = np.linalg.norm(rho[-5000:], axis=1, keepdims=True)
    rho_prime[-4000:] = unit(rho_prime[-4000:]) * lengths[-4000:]
    angle = np.concatenate([special["angle"], rng.uniform(-4, 4, 5000)])
    _, expected = generated.ALL.solve_axis(rho, rho_prime, angle, 1e-8)
    assert {0, 2, 6} <= set(expected[-5000:].tolist())
    for module in gufuncs.values():
        _, status = module.solve_axis(rho, rho_prime, angle, 1e-8)
        assert (status[-5000:] == expected[-5000:]).all()
        assert (status != expected).sum() <= 2


def test_one_element_a_call_is_what_the_gufunc_gives(gufuncs: dict[str, ModuleType]) -> None:
    rng = np.random.default_rng(3)
    for module in gufuncs.values():
        assert len(module.one_element) > 50
        for name, single in module.one_element.items():
            gufunc = getattr(module, name)
            shapes = [
                tuple(map(int, re.findall(r"\d+", core)))
                for core in re.findall(r"\(([\d,]*)\)", gufunc.signature)
            ]
            given = [np.asarray(rng.uniform(0.1, 1, shape)) for shape in shapes[: gufunc.nin]]
            for arguments in (given, [a.tolist() for a in given], [np.stack([a, a]) for a in given]):
                found, expected = single(*arguments), gufunc(*arguments)
                assert type(found) is type(expected)
                pairs_of = zip(found, expected, strict=True) if gufunc.nout > 1 else [(found, expected)]
                for one, other in pairs_of:
                    assert (type(one), one.dtype, one.shape) == (type(other), other.dtype, other.shape)
                    np.testing.assert_array_equal(one, other)
            with pytest.raises(TypeError):
                single(*given[1:])
        strided = np.ones((5, 6))[:, ::2]
        np.testing.assert_array_equal(
            module.one_element["rotate"](strided[0], strided[1]), module.rotate(strided[0], strided[1])
        )
        with pytest.raises(ValueError, match="mismatch in its core dimension"):
            module.one_element["rotate"](np.ones(4), np.ones(3))


def lazy_sample() -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(2)
    rho = rng.normal(size=(100, 3))
    return (
        rho,
        unit(rng.normal(size=(100, 3))) * np.linalg.norm(rho, axis=1, keepdims=True),
        rng.uniform(0, 3, 100),
    )


def test_dask_arrays_pass_through_and_give_the_same_numbers() -> None:
    arguments = lazy_sample()
    lazy = [da.from_array(a, chunks=(30, *a.shape[1:])) for a in arguments]
    axes, status = rodgen.solve_axis(*lazy)
    assert isinstance(axes, da.Array)
    assert isinstance(status, da.Array)
    assert (axes.shape, axes.dtype, status.dtype) == ((100, 2, 3), np.dtype(float), np.dtype(np.int8))
    expected_axes, expected_status = rodgen.solve_axis(*arguments)
    # a block of 16 elements rounds as all its elements need, and chunks cut other blocks
    np.testing.assert_allclose(axes.compute(), expected_axes, rtol=0, atol=1e-12)
    assert np.array_equal(status.compute(), expected_status)


def test_dask_computes_nothing_before_it_is_asked() -> None:
    def fail(block: np.ndarray) -> np.ndarray:
        raise AssertionError("computed")

    lazy = [
        da.from_array(a, chunks=(50, *a.shape[1:])).map_blocks(fail, dtype=a.dtype, meta=a[:0])
        for a in lazy_sample()
    ]
    axes, _ = rodgen.solve_axis(*lazy)
    condition = rodgen.axis_condition(*lazy)
    assert (axes.shape, condition.shape) == ((100, 2, 3), (100,))
    with pytest.raises(AssertionError, match="computed"):
        condition.compute()


@pytest.mark.parametrize("name", ["axis_jacobian", "axis_condition"])
def test_other_functions_take_dask_arrays_too(name: str) -> None:
    arguments = lazy_sample()
    lazy = [da.from_array(a, chunks=(64, *a.shape[1:])) for a in arguments]
    found, expected = getattr(rodgen, name)(*lazy), getattr(rodgen, name)(*arguments)
    if isinstance(expected, tuple):
        found, expected = found[0], expected[0]
    assert isinstance(found, da.Array)
    assert found.shape == expected.shape
    np.testing.assert_allclose(found.compute(), expected, rtol=1e-9)
