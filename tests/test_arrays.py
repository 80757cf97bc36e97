"""Generated modules on arrays of other libraries; test_kernels.py compares all values."""

from __future__ import annotations

import subprocess
import sys
from types import ModuleType

import numpy as np
import pytest

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
