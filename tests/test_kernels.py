"""Every kernel, on every target, against its expression trees: one test body, one subclass a target.

The targets are the generated NumPy module, the gufuncs of each instruction set, the emitted C and C++ alone,
compiled as a careful user would and called through ctypes, and the MATLAB functions in GNU Octave.

Values are compared for every kernel. What concerns the memory alone, such as strides and overlap, is the work of the
loop template and of one NumPy function, which are the same for all kernels but for the number and the shapes of the
ports: `LAYOUT_KERNELS` has each form of port in each form of loop.
"""

from __future__ import annotations

import ctypes
import functools
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import cpp_calls
import numpy as np
import pytest
from kernel_reference import GENERATED, KERNELS, MODULE_OF, Generated, expected, of_kernels
from octave import Octave, columns, rows

from conftest import C_FOLDER
from rodgen.codegen.source_files import KernelModule, render
from rodgen.generated import numpy as generated_numpy

Results = tuple[np.ndarray, ...]


def forms(kernel: Generated) -> set[tuple[object, ...]]:
    """What of a kernel the loop template takes another branch for, or has other code for."""
    loop = (kernel.vectorised, kernel.usual, kernel.trigonometric)
    found: set[tuple[object, ...]] = {(loop, len(kernel.inputs) > 1, len(kernel.outputs) > 1)}
    for side, ports in (("in", kernel.inputs), ("out", kernel.outputs)):
        for port in ports:
            written_out = (
                port.size if port.size in (1, 3, 6) else None
            )  # sizes that loop.h has code of its own for
            found.add((kernel.vectorised, side, len(port.shape), port.is_status, written_out))
    overlapping = {p.shape for p in kernel.inputs} & {p.shape for p in kernel.outputs if not p.is_status}
    return found | {("output over an input", shape) for shape in overlapping}


def layout_kernels() -> list[str]:
    """Few kernels that together have every form; of equals the one with fewer operations."""
    missing = set().union(*(forms(kernel) for kernel in GENERATED.values()))
    chosen = []
    while missing:
        most = max(GENERATED, key=lambda n: (len(forms(GENERATED[n]) & missing), -GENERATED[n].operations, n))
        chosen.append(most)
        missing -= forms(GENERATED[most])
    return chosen


LAYOUT_KERNELS = layout_kernels()
every_kernel = of_kernels(GENERATED)
every_layout = of_kernels(LAYOUT_KERNELS)
BITS = (64, 32)
QUICK_IN_BOTH = {*LAYOUT_KERNELS, *(name for name, kernel in GENERATED.items() if kernel.usual)}
"""Kernels that fast tests compare in both precisions; one text is compiled for both."""


def stream_from_bytes() -> int:
    """The threshold as it stands in the generated header."""
    header = (C_FOLDER.parent / "gufunc" / "loop.h").read_text()
    number, shift = re.findall(r"#define STREAM_FROM_BYTES \((\d+) << (\d+)\)", header)[0]
    return int(number) << int(shift)


def as_tuple(results: Any) -> Results:
    return results if isinstance(results, tuple) else (results,)


class KernelTests:
    """What holds true of a kernel on any target."""

    def call(self, name: str, *arguments: np.ndarray) -> Results:
        """Evaluate a batch along the first axis."""
        raise NotImplementedError

    def call_one(self, name: str, *arguments: np.ndarray) -> Results:
        """Evaluate one element."""
        raise NotImplementedError

    @every_kernel
    def test_values_agree_with_the_expression_trees(self, name: str) -> None:
        """All at once, and in batches around the blocks: 16 elements in the gufuncs, 8192 in NumPy."""
        for bits in BITS if name in QUICK_IN_BOTH else (64,):
            self.check_values(name, bits)

    @of_kernels(GENERATED.keys() - QUICK_IN_BOTH, slow=lambda name: True)
    def test_values_in_single_precision_agree_with_the_expression_trees(self, name: str) -> None:
        self.check_values(name, 32)
        self.check_one_by_one(name, 32)

    def check_values(self, name: str, bits: int) -> None:
        reference = expected(name, bits)
        reference.check(self.call(name, *reference.inputs))
        for count in (0, 1, 2, 15, 16, 17, 31, 33, 1000, 8193):
            rows = np.random.default_rng(count).integers(len(reference.inputs[0]), size=count)
            reference.check(self.call(name, *(a[rows] for a in reference.inputs)), rows)

    def check_one_by_one(self, name: str, bits: int) -> None:
        reference = expected(name, bits)
        for row in range(len(reference.inputs[0])):
            results = self.call_one(name, *(a[row] for a in reference.inputs))
            reference.check(tuple(np.asarray(r)[None] for r in results), [row])


class ArrayTests(KernelTests):
    """What NumPy arrays have that a C pointer has not: shapes, strides, types, `out`."""

    def function(self, name: str) -> Callable[..., Any]:
        raise NotImplementedError

    def call(self, name: str, *arguments: np.ndarray) -> Results:
        """Evaluate; a select evaluates both values, and what the other one divides by is not worth a warning."""
        with np.errstate(all="raise"):
            return as_tuple(self.function(name)(*arguments))

    def call_one(self, name: str, *arguments: np.ndarray) -> Results:
        return self.call(name, *arguments)

    @of_kernels(QUICK_IN_BOTH)
    def test_single_elements_agree_with_the_expression_trees(self, name: str) -> None:
        """A block of one element takes the usual case wherever the element is one."""
        for bits in BITS:
            self.check_one_by_one(name, bits)

    def check_same(self, name: str, arguments: Sequence[Any], rows: np.ndarray, bits: int = 64) -> None:
        expected(name, bits).check(self.call(name, *arguments), rows)

    @every_layout
    def test_broadcasting(self, name: str) -> None:
        """Each argument in turn stays one element while the others are a table; and all against each other."""
        inputs = expected(name, 64).inputs
        n = len(inputs[0])
        alone = self.call(name, *(a[:1] for a in inputs))
        for position in range(len(inputs)):
            arguments = [
                a[0] if k == position else np.broadcast_to(a[0], (2, 3, *a.shape[1:]))
                for k, a in enumerate(inputs)
            ]
            for result, one in zip(self.call(name, *arguments), alone, strict=True):
                shape = (2, 3) if len(inputs) > 1 else ()
                np.testing.assert_allclose(
                    result, np.broadcast_to(one[0], shape + one.shape[1:]), rtol=1e-13, atol=1e-13
                )
        rows = np.arange(n).reshape(n, 1)
        crossed = [a[:, None] if k % 2 else a[None, :, ...] for k, a in enumerate(inputs)]
        results = self.call(name, *crossed)
        diagonal = tuple(
            np.asarray(r)[np.arange(n), np.arange(n)] if len(inputs) > 1 else r[0] for r in results
        )
        expected(name, 64).check(diagonal, rows[:, 0])

    @every_layout
    def test_memory_layouts(self, name: str) -> None:
        for bits in BITS:
            for layout in ("every second", "backwards", "fortran", "unaligned", "read-only", "core strides"):
                self.check_layout(name, bits, layout)

    def check_layout(self, name: str, bits: int, layout: str) -> None:
        inputs = expected(name, bits).inputs
        rows = np.arange(len(inputs[0]))
        arguments = []
        for a in inputs:
            if layout == "every second":
                wide = np.full((2 * len(a), *a.shape[1:]), np.nan, a.dtype)
                wide[::2] = a
                b = wide[::2]
            elif layout == "backwards":
                b = a[::-1].copy()[::-1]
            elif layout == "fortran":
                b = np.asfortranarray(a)
            elif layout == "unaligned":
                raw = np.zeros(a.nbytes + 1, np.uint8)
                b = raw[1:].view(a.dtype).reshape(a.shape)
                b[...] = a
                assert not b.flags.aligned
            elif layout == "read-only":
                b = a.copy()
                b.flags.writeable = False
            else:
                wide = np.full((*a.shape, 2), np.nan, a.dtype)
                wide[..., 1] = a
                b = wide[..., 1]
            arguments.append(b)
        self.check_same(name, arguments, rows, bits)

    @every_layout
    def test_out(self, name: str) -> None:
        for bits in BITS:
            for layout in ("packed", "every second", "fortran", "unaligned", "backwards"):
                self.check_out(name, bits, layout)

    def check_out(self, name: str, bits: int, layout: str) -> None:
        reference = expected(name, bits)
        inputs = reference.inputs
        n = len(inputs[0])
        targets, guards = [], []
        for result in self.call(name, *inputs):
            if layout == "every second":
                wide = np.full((2 * n, *result.shape[1:]), 99, result.dtype)
                target = wide[::2]
                guards.append(wide[1::2])
            elif layout == "fortran":
                target = np.full(result.shape, 99, result.dtype, order="F")
            elif layout == "unaligned":
                target = np.zeros(result.nbytes + 1, np.uint8)[1:].view(result.dtype).reshape(result.shape)
            elif layout == "backwards":
                target = np.full(result.shape, 99, result.dtype)[::-1]
            else:
                target = np.full(result.shape, 99, result.dtype)
            targets.append(target)
        out = tuple(targets) if len(targets) > 1 else targets[0]
        returned = as_tuple(self.function(name)(*inputs, out=out))
        assert all(r is t for r, t in zip(returned, targets, strict=True))
        reference.check(tuple(targets))
        assert all((guard == 99).all() for guard in guards)  # nothing is written outside the target

    @every_layout
    def test_output_over_an_input(self, name: str) -> None:
        """Memory that is read and written in one call gives what separate memory gives."""
        kernel, reference = GENERATED[name], expected(name, 64)
        for source, port_in in enumerate(kernel.inputs):
            for target, port_out in enumerate(kernel.outputs):
                if port_in.shape != port_out.shape or port_out.is_status:
                    continue
                inputs = [a.copy() for a in reference.inputs]
                out: list[Any] = [None] * len(kernel.outputs)
                out[target] = inputs[source]
                results = as_tuple(self.function(name)(*inputs, out=tuple(out) if len(out) > 1 else out[0]))
                assert results[target] is inputs[source]
                reference.check(results)

    def test_integers_hold_no_results(self) -> None:
        """As in NumPy, nothing is cast into an array that cannot hold it, and the array stays as it is."""
        out = np.full((2, 3), 99), np.empty((), np.int8)
        with pytest.raises(TypeError):
            self.function("solve_axis")([1.0, 0, 0], [0, 1.0, 0], 2.0, 1e-8, out=out)
        assert (out[0] == 99).all()

    def test_output_shifted_against_an_input(self) -> None:
        """Overlap that is not element on element: each result still comes from what was there before."""
        rng = np.random.default_rng(0)
        memory = rng.normal(size=(101, 3))
        theta = rng.normal(size=(100, 3))
        before = memory.copy()
        (wanted,) = self.call("rotate", before[:-1], theta)
        self.function("rotate")(memory[:-1], theta, out=memory[1:])
        np.testing.assert_array_equal(memory[1:], wanted)
        np.testing.assert_array_equal(memory[0], before[0])

    @every_layout
    def test_lists_and_integers_are_numbers(self, name: str) -> None:
        kernel = GENERATED[name]
        whole = [np.ones(p.shape, int) + np.arange(p.size).reshape(p.shape) for p in kernel.inputs]
        wanted = self.call(name, *(a.astype(float) for a in whole))
        for arguments in (
            whole,
            [a.tolist() for a in whole],
            [a.astype(np.int8).astype(np.int32) for a in whole],
        ):
            for result, value in zip(self.call(name, *arguments), wanted, strict=True):
                assert result.dtype == value.dtype
                np.testing.assert_array_equal(result, value)

    @every_layout
    def test_complex_numbers_are_refused(self, name: str) -> None:
        with pytest.raises(TypeError):
            self.call(name, *(a + 0j for a in expected(name, 64).inputs))

    @every_layout
    def test_wrong_last_axis_is_refused(self, name: str) -> None:
        inputs = expected(name, 64).inputs
        for position, port in enumerate(GENERATED[name].inputs):
            if port.shape:
                wrong = [
                    np.concatenate([a, a[..., :1]], axis=-1) if k == position else a
                    for k, a in enumerate(inputs)
                ]
                with pytest.raises(ValueError, match=r"shape|dimension"):
                    self.call(name, *wrong)

    def test_shapes_that_do_not_broadcast_are_refused(self) -> None:
        with pytest.raises(ValueError, match="broadcast"):
            self.call("rotate", np.ones((2, 3)), np.ones((5, 3)))


class TestNumPy(ArrayTests):
    def function(self, name: str) -> Callable[..., Any]:
        return getattr(generated_numpy.ALL, name)


class LibraryTests(KernelTests):
    """The generated NumPy modules on arrays of another library, through the array API standard."""

    library: str

    @pytest.fixture(autouse=True)
    def _library(self) -> None:
        self.xp = pytest.importorskip(self.library)

    def call(self, name: str, *arguments: np.ndarray) -> Results:
        given = [self.xp.asarray(a) for a in arguments]
        with np.errstate(all="ignore"):  # array-api-strict is NumPy
            found = as_tuple(getattr(generated_numpy.ALL, name)(*given))
        assert {type(x) for x in found} == {type(x) for x in given}
        return tuple(map(np.asarray, found))

    call_one = call

    def check_values(self, name: str, bits: int) -> None:
        reference = expected(name, bits)
        reference.check(self.call(name, *reference.inputs))
        reference.check(self.call(name, *(a[:0] for a in reference.inputs)), np.arange(0))


class TestArrayAPIStrict(LibraryTests):
    library = "array_api_strict"


class TestPyTorch(LibraryTests):
    library = "torch"


@pytest.mark.slow
class TestJAX(LibraryTests):
    library = "jax.numpy"

    @pytest.fixture(autouse=True)
    def _double(self) -> Iterator[None]:
        with pytest.importorskip("jax").enable_x64(True):
            yield


class GufuncTests(ArrayTests):
    level: str

    @pytest.fixture(autouse=True)
    def _module(self, gufuncs: dict[str, ModuleType]) -> None:
        if self.level not in gufuncs:
            pytest.skip(
                f"this processor or build has no {self.level}; it has {', '.join(gufuncs) or 'no extension'}"
            )
        self.module = gufuncs[self.level]

    def function(self, name: str) -> Callable[..., Any]:
        return getattr(self.module, name)

    def test_signatures_are_those_of_the_numpy_functions(self) -> None:
        assert {name: self.function(name).signature for name in GENERATED} == {
            name: function.signature for name, function in vars(generated_numpy.ALL).items()
        }

    @pytest.mark.parametrize("bits", BITS)
    @pytest.mark.parametrize(
        ("name", "offset"),
        [
            *[("rotate", -1), ("rotate", 0), ("rotate", 1), ("length_mismatch", 1)],
            pytest.param("solve_axis", 1, marks=pytest.mark.slow),
        ],
    )
    def test_sizes_around_the_streaming_threshold(self, name: str, bits: int, offset: int) -> None:
        """From some size of the output on, gufuncs write past the caches, in whole lines where they can."""
        reference = expected(name, bits)
        largest = max(p.size for p in GENERATED[name].outputs) * bits // 8
        count = stream_from_bytes() // largest + offset
        rows = np.random.default_rng(5).integers(len(reference.inputs[0]), size=count)
        arguments = [a[rows] for a in reference.inputs]
        reference.check(self.call(name, *arguments), rows)
        shifted = []  # a target that starts inside a line, on an odd element
        for result in self.call(name, *(a[:1] for a in arguments)):
            memory = np.empty((count + 1, *result.shape[1:]), result.dtype)
            shifted.append(memory[1:])
        self.function(name)(*arguments, out=tuple(shifted) if len(shifted) > 1 else shifted[0])
        reference.check(tuple(shifted), rows)

    @pytest.mark.parametrize("bits", BITS)
    def test_long_arrays_begin_anywhere_in_a_cache_line(self, bits: int) -> None:
        """Leading rows are evaluated apart until the rows begin at a line; each row's result stays the same."""
        reference = expected("solve_axis", bits)
        count = 64 * 64 + 5
        rows = np.random.default_rng(6).integers(len(reference.inputs[0]), size=count)
        for first in range(64 // (bits // 8)):
            arguments = []
            for a in reference.inputs:
                memory = np.empty(count * a[0].size + 128, a.dtype)
                start = (-memory.ctypes.data % 64) // a.itemsize + first
                own = memory[start : start + count * a[0].size].reshape(count, *a.shape[1:])
                own[...] = a[rows]
                arguments.append(own)
            reference.check(self.call("solve_axis", *arguments), rows)


class TestBaseline(GufuncTests):
    level = "baseline"


class TestAVX2(GufuncTests):
    level = "avx2"


class TestAVX512(GufuncTests):
    level = "avx512"


class TestEmittedC(KernelTests):
    """The C alone: scalar functions and batches."""

    @pytest.fixture(autouse=True)
    def _library(self, emitted_c: Callable[[str], ctypes.CDLL]) -> None:
        self.library = emitted_c

    def function(self, name: str, bits: int, batch: bool) -> Any:
        middle = "_batch" if batch else ""
        module = GENERATED[name].module
        return getattr(self.library(module), f"{module}_{name}{middle}_f{bits}")

    def call(self, name: str, *arguments: np.ndarray) -> Results:
        kernel, real = GENERATED[name], arguments[0].dtype
        count = len(arguments[0])
        inputs = [np.ascontiguousarray(a) for a in arguments]
        outputs = [np.zeros((count, *p.shape), np.int8 if p.is_status else real) for p in kernel.outputs]
        pointers = [ctypes.c_void_p(a.ctypes.data) for a in (*inputs, *outputs)]
        function = self.function(name, 8 * real.itemsize, batch=True)
        function.restype = None
        function(ctypes.c_size_t(count), *pointers)
        return tuple(outputs)

    def call_one(self, name: str, *arguments: np.ndarray) -> Results:
        kernel, real = GENERATED[name], arguments[0].dtype
        number = ctypes.c_float if real == np.float32 else ctypes.c_double
        inputs = [np.ascontiguousarray(a) for a in arguments]
        outputs = [np.zeros(p.shape, np.int8 if p.is_status else real) for p in kernel.outputs]
        values = [
            number(a.item()) if p.shape == () else ctypes.c_void_p(a.ctypes.data)
            for a, p in zip(inputs, kernel.inputs, strict=True)
        ]
        function = self.function(name, 8 * real.itemsize, batch=False)
        function.restype = None
        function(*values, *(ctypes.c_void_p(a.ctypes.data) for a in outputs))
        return tuple(outputs)

    @every_kernel
    def test_single_elements_agree_with_the_expression_trees(self, name: str) -> None:
        for bits in BITS if name in QUICK_IN_BOTH else (64,):
            self.check_one_by_one(name, bits)


# Languages that are written when they are asked for ------------------------------------------------------


def module_text(name: str, target: str) -> dict[str, str]:
    """Return the files of one of rodgen's modules in a language."""
    kernels = tuple(KERNELS[kernel] for kernel in GENERATED if MODULE_OF[kernel] == name)
    return render(KernelModule(name, "A module.", "none", kernels), [target])


QUICK = {"axis_angle_from_matrix", "rotate", "trig_solve"}
"""Of two small modules; together they have each form of port, codes and `power_of_two_scale`."""


class OnRequestTests(KernelTests):
    """Languages that are written on request: few kernels always, the others in slow tests."""

    @of_kernels(GENERATED, slow=lambda name: name not in QUICK)
    def test_values_agree_with_the_expression_trees(self, name: str) -> None:
        super().test_values_agree_with_the_expression_trees(name)

    def call_one(self, name: str, *arguments: np.ndarray) -> Results:
        return tuple(result[0] for result in self.call(name, *(np.asarray(a)[None] for a in arguments)))


class TestCpp(OnRequestTests):
    """The C++ header."""

    @pytest.fixture(autouse=True)
    def _library(self, library_of_templates: Callable[[str], ctypes.CDLL]) -> None:
        self.library = library_of_templates

    def call(self, name: str, *arguments: np.ndarray) -> Results:
        return cpp_calls.call(self.library(MODULE_OF[name]), name, GENERATED[name], arguments)


class TestMatlab(OnRequestTests):
    """The MATLAB functions, in GNU Octave."""

    @pytest.fixture(autouse=True)
    def _octave(self, octave: Octave, matlab_folder: Callable[[str], Path]) -> None:
        self.octave, self.written = octave, matlab_folder

    def call(self, name: str, *arguments: np.ndarray) -> Results:
        kernel = GENERATED[name]
        self.octave.run(f"addpath('{self.written(kernel.module)}');")
        given = [columns(a) for a in arguments]
        results = self.octave.call(f"rodgen.{kernel.module}.{name}", given, len(kernel.outputs))
        for result, port in zip(results, kernel.outputs, strict=True):
            assert result.dtype == (np.int32 if port.is_status else arguments[0].dtype)
        return tuple(
            rows(result.astype(np.int8) if port.is_status else result, port.shape, len(arguments[0]))
            for result, port in zip(results, kernel.outputs, strict=True)
        )


@pytest.fixture(scope="session")
def matlab_folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder with the MATLAB functions of a module."""
    folder = tmp_path_factory.mktemp("matlab")

    @functools.cache
    def written(module: str) -> Path:
        for path, text in module_text(module, "matlab").items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text)
        return folder / "matlab"

    return written


@pytest.fixture(scope="session")
def library_of_templates(
    cpp_compiler: str, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], ctypes.CDLL]:
    """The kernels of a module as instances of its C++ templates."""
    folder = tmp_path_factory.mktemp("cpp")

    @functools.cache
    def library(module: str) -> ctypes.CDLL:
        (text,) = module_text(module, "cpp").values()
        kernels = {name: kernel for name, kernel in GENERATED.items() if kernel.module == module}
        return cpp_calls.cpp_library(cpp_compiler, folder, module, text, kernels)

    return library
