"""Where the numbers are computed: instruction sets, the NumPy fallback and its notice, Dask."""

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
