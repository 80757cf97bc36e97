"""Kernels over many rows, with inputs that all rows share: the inner loop of a fit.

A kernel with the inputs x (a row), g and e (the same for all rows) is called with an array of rows, g and e, and gives
an array of results, a row each. It is compiled once and kept in the user's cache, with the shapes of its ports. A
process that finds it there imports neither SymPy nor Jinja2.

C takes 2, 4 or 8 rows at a time, as many as the vectors of this processor have room for. Measured on a chain of six
revolute joints with 63 parameters and three residuals, in nanoseconds a row on one core of a Xeon with AVX-512: 20 for
the residuals and 120 with their derivatives, half of it to write 1.5 kB; 200 beyond the second cache, so that blocks of
some 500 rows are best. A loop over scalars takes 200 and 420, NumPy 450 and 1900. All of it is derived, printed and
compiled in 0.8 s, and loaded in 0.03 s. Least squares needs products of derivatives only, which are summed up without
writing any: on a core of an EPYC of 2024 and for 30 parameters 60 with AVX-512 and 120 with AVX2, where derivatives and
a product by BLAS take 160 and 185.
"""

from __future__ import annotations

import ctypes
import functools
import json
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.codegen._array_call import _checked_out, _shape_text
from rodgen.codegen.build_cache import (
    CompilerError,
    cached_text,
    compiler,
    native_flag,
    notice,
    shared_library,
    source_hash,
)
from rodgen.codegen.program import Program, programs_from, text_of
from rodgen.stages import stage

FLAGS = ("-std=c11", "-O2", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-fPIC", "-shared")
"""A product and a sum may be rounded as one. No -ffast-math: it deletes NaN tests. No -O3: it gains nothing."""

LEVELS = {"baseline": (), "avx2": ("-mavx2", "-mfma")}
"""Flags for the instruction sets that ``RODGEN_CPU`` names; else all that this processor has is used."""

BLOCK = 2048
"""Rows a block on NumPy: few enough for the columns to stay in the cache."""

Shapes = dict[str, tuple[int, ...]]


class RowKernel:
    """A kernel as a function on rows.

    ``f(rows, *shared)`` returns an array for the kernel's output, or a tuple of arrays for its outputs; with ``out=``
    they are written there. The function lets other threads run.

    Attributes
    ----------
    name : str
    target : str
        ``"c"`` or ``"numpy"``.
    inputs, outputs : dict of str to tuple of int
        The shapes of the ports, of one row; the first input is that of the rows.
    """

    __slots__ = (
        "_columns",
        "_evaluate",
        "_evaluate_each",
        "_gram",
        "_row",
        "_shapes",
        "_width",
        "inputs",
        "name",
        "outputs",
        "target",
    )

    def __init__(
        self,
        name: str,
        target: str,
        about: Any,
        evaluate: Callable[..., Any],
        gram: Callable[..., Any] | None,
        evaluate_each: Callable[..., Any] | None = None,
    ) -> None:
        self.name = name
        self.target = target
        self._columns: int = about["columns"]
        self._width: int = about["width"]
        self._gram = gram
        self.inputs: Shapes = {port: tuple(shape) for port, shape in about["inputs"]}
        self.outputs: Shapes = {port: tuple(shape) for port, shape in about["outputs"]}
        self._row, *self._shapes = self.inputs.values()
        self._evaluate = evaluate
        self._evaluate_each = evaluate_each

    def __repr__(self) -> str:
        return (
            f"<RowKernel {self.name}({', '.join(self.inputs)}) -> {', '.join(self.outputs)}, {self.target}>"
        )

    def __call__(self, rows: Any, *shared: Any, out: Any = None) -> Any:
        """Evaluate all rows.

        Parameters
        ----------
        rows : array_like (count, ...)
            The inputs of each row. A C-contiguous array of float64 is not copied.
        *shared : array_like
            One value of every other input, of the shape of its port.
        out : array or tuple of arrays (count, ...), optional
            C-contiguous, of float64, and not overlapping the inputs.

        Raises
        ------
        TypeError
            For a wrong number of arguments.
        ValueError
            When a shape does not fit, or `out` cannot be written to.
        """
        arrays = self._checked((rows, *shared))
        count = len(arrays[0])
        if out is None:
            results = [np.empty((count, *shape)) for shape in self.outputs.values()]
        else:
            results = self._checked_out(out, count, arrays)
        if count:
            self._evaluate(count, arrays, results)
        return results[0] if len(results) == 1 else tuple(results)

    def in_sets(self, rows: Any, counts: Sequence[int], *shared: Any) -> list[Array]:
        """Evaluate sets of rows, each with its own values of the other inputs; on NumPy all at once.

        Parameters
        ----------
        rows : array_like (sum of counts, ...)
            One set after the other.
        counts : sequence of int
            Rows of each set.
        *shared : array_like (sets, ...)

        Returns
        -------
        list of array (sum of counts, ...)
            Of each output.

        Raises
        ------
        TypeError
            For a wrong number of arguments.
        ValueError
            When a shape does not fit, or the rows or the values are not those of the sets.
        """
        rows = np.ascontiguousarray(rows, np.float64)
        if sum(counts) != len(rows):
            raise ValueError(f"{self.name}: {len(rows)} rows; expected {sum(counts)}, the sum of the counts")
        for values, port in zip(shared, list(self.inputs)[1:], strict=False):
            if len(values) != len(counts):
                raise ValueError(f"{self.name}: {len(values)} sets of {port}; expected {len(counts)}")
        results = [np.empty((len(rows), *shape)) for shape in self.outputs.values()]
        if self._evaluate_each is None or not len(rows) or len(counts) == 1:
            ends = np.cumsum(counts)
            for k, (start, stop) in enumerate(zip(ends - counts, ends, strict=True)):
                out = tuple(result[start:stop] for result in results)
                self(
                    rows[start:stop],
                    *(values[k] for values in shared),
                    out=out[0] if len(out) == 1 else out,
                )
        else:
            self._checked((rows, *(values[0] for values in shared)))
            others = [np.repeat(np.asarray(values, np.float64), counts, axis=0) for values in shared]
            self._evaluate_each(len(rows), [rows.reshape(len(rows), -1), *others], results)
        return results

    @property
    def has_jacobian(self) -> bool:
        """Whether the kernel gives residuals and their Jacobian, as :meth:`gram` needs."""
        return self._gram is not None

    def gram(self, rows: Any, *shared: Any) -> Array:
        """Return [J r]ᵀ[J r], (columns + 1, columns + 1), of residuals r and their Jacobian J, which the kernel gives.

        All rows are stacked. In C none of J is stored.

        Parameters
        ----------
        rows, *shared : array_like
            As of a call.

        Raises
        ------
        TypeError, ValueError
            As of a call; also for a kernel without a Jacobian.
        """
        if self._gram is None:
            raise TypeError(f"{self.name}: no Jacobian")
        arrays = self._checked((rows, *shared))
        gram = np.zeros((self._width, self._width))
        if len(arrays[0]):
            self._gram(len(arrays[0]), arrays, gram)
        return gram[: self._columns + 1, : self._columns + 1]

    def _checked(self, checked: Sequence[Any]) -> list[Array]:
        """Return the inputs as arrays after a check of their shapes."""
        if len(checked) != len(self.inputs):
            raise TypeError(f"{self.name}: {len(checked)} arguments; expected {', '.join(self.inputs)}")
        arrays = [np.asarray(a, np.float64, order="C") for a in checked]
        for array, shape in zip(arrays[1:], self._shapes, strict=True):
            if array.shape != shape:
                self._raise_wrong_shape(arrays)
        if not arrays[0].ndim or arrays[0].shape[1:] != self._row:
            self._raise_wrong_shape(arrays)
        return arrays

    def _raise_wrong_shape(self, arrays: Sequence[Array]) -> None:
        """Raise the error that names the input of a wrong shape."""
        (row, shape), *others = self.inputs.items()
        for array, (port, expected) in zip(arrays, [(row, ("count", *shape)), *others], strict=True):
            found = ("count", *array.shape[1:]) if port == row and array.ndim else array.shape
            if found != expected:
                raise ValueError(
                    f"{self.name}: {port} has shape {array.shape}; expected {_shape_text(expected)}"
                )

    def _checked_out(self, out: Any, count: int, arrays: Sequence[Array]) -> list[Array]:
        """Return the arrays of `out` after a check that the kernel can fill them."""
        outputs = _checked_out(
            self.name,
            out,
            [(port, (count, *shape), np.dtype(np.float64)) for port, shape in self.outputs.items()],
        )
        for array, port in zip(outputs, self.outputs, strict=True):
            if array.dtype != np.float64 or not array.flags.carray:
                raise ValueError(
                    f"{self.name}: out for {port} is not a C-contiguous, writable array of float64"
                )
            if any(np.may_share_memory(array, input_array) for input_array in arrays):
                raise ValueError(f"{self.name}: out for {port} overlaps an input")
        return outputs


@stage("loading kernels")
def row_kernels(
    key: str,
    make: Callable[[], Sequence[Program]],
    *,
    compiled: bool = True,
) -> dict[str, RowKernel]:
    """Return kernels over rows: from the cache, or made and compiled.

    The compiler is the one that the environment variable ``CC`` names, else cc, gcc or clang. Without one, or when it
    fails, the kernels run on NumPy, and one warning says why; ``RODGEN_CPU=numpy`` asks for that.

    Parameters
    ----------
    key : str
        Everything that the kernels depend on, outside of :mod:`rodgen.codegen` and :mod:`rodgen.symbolic`.
    make : callable
        Returns the programs; called only when nothing is kept for the key. The first input of each is that of the rows.
    compiled : bool
        False for NumPy, which costs nothing to make: for kernels that are called a few times only.

    Returns
    -------
    dict of str to RowKernel
        By the kernels' names.

    Examples
    --------
    >>> from rodgen.codegen.tape import Tape
    >>> def make():
    ...     tape = Tape()
    ...     (x,), (height, slope) = tape.inputs("x", 1, same=False), tape.inputs("p", 2)
    ...     return [tape.program("line", {"x": (), "p": (2,)}, {"y": ((), [height + slope * x])})]
    >>> line = row_kernels("a line, first version", make)["line"]
    >>> line([0.0, 1.0, 2.0], [5.0, 0.5])
    array([5. , 5.5, 6. ])
    """
    home = Path(__file__).parent
    about = ["rows", key, source_hash(home, home.parent / "symbolic")]
    make_kernels = functools.cache(stage("deriving the model")(make))
    level = os.environ.get("RODGEN_CPU", "")
    if compiled and level != "numpy":
        try:
            return _compiled(about, make_kernels, level)
        except CompilerError as error:
            notice(str(error))
    return _on_numpy(about, make_kernels)


# C ---------------------------------------------------------------------------------------------------------


def _compiled(key: Sequence[str], make: Callable[[], Sequence[Program]], level: str) -> dict[str, RowKernel]:
    command = compiler()
    if level in LEVELS:
        extra, macros = LEVELS[level], ""
    else:
        flag, macros = native_flag(command)
        extra = (flag,) if flag else ()

    def files() -> dict[str, str]:
        from rodgen.codegen._rows_source import c_source

        return {"kernels.c": c_source(make())}

    loaded = shared_library(
        (*key, macros), files, command, (*FLAGS, *extra),
        lambda library: _of_one_row(_in_library(library)), lambda: _of_one_row(_of_programs(make())),
    )  # fmt: skip
    return _in_library(loaded)


def _in_library(library: ctypes.CDLL) -> dict[str, RowKernel]:
    kernels = json.loads(ctypes.c_char_p.in_dll(library, "about").value or b"{}")
    return {
        name: RowKernel(
            name,
            "c",
            about,
            _c_evaluate(library[f"rows_{name}"], len(about["inputs"]) + len(about["outputs"])),
            _c_gram(library[f"gram_{name}"], len(about["inputs"]) + 1) if about["columns"] else None,
        )
        for name, about in kernels.items()
    }


def _of_one_row(kernels: dict[str, RowKernel]) -> list[Array]:
    """Return the outputs of kernels for one row of numbers between 1/2 and 1, in the order of their names."""
    outputs: list[Array] = []
    for kernel in (kernels[name] for name in sorted(kernels)):
        shapes = list(kernel.inputs.values())
        sizes = [math.prod(shape) for shape in shapes]
        # the multiples of the golden ratio: as irregular as random ones, and the same everywhere
        numbers = 0.5 + 0.5 * (0.6180339887498949 * np.arange(1, 1 + sum(sizes)) % 1)
        shapes[0] = (1, *shapes[0])
        parts = np.split(numbers, np.cumsum(sizes)[:-1])
        inputs = [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
        with np.errstate(all="ignore"):
            outputs_there = kernel(*inputs)
            outputs += map(np.ravel, outputs_there if isinstance(outputs_there, tuple) else (outputs_there,))
            if kernel.has_jacobian:
                outputs.append(np.ravel(kernel.gram(*inputs)))
    return outputs


def _c_evaluate(function: Any, arrays: int) -> Callable[..., None]:
    function.argtypes = [ctypes.c_size_t] + [ctypes.c_void_p] * arrays
    function.restype = None

    def evaluate(count: int, inputs: Sequence[Array], outputs: Sequence[Array]) -> None:
        function(count, *[_address(a) for a in (*inputs, *outputs)])

    return evaluate


def _c_gram(function: Any, arrays: int) -> Callable[..., None]:
    evaluate = _c_evaluate(function, arrays)
    return lambda count, inputs, gram: evaluate(count, inputs, [gram])


def _address(array: Array) -> int:
    try:
        start = ctypes.c_char.from_buffer(array)  # type: ignore[arg-type]  # an array is a buffer
        return ctypes.addressof(start)  # a third of the time of array.ctypes.data
    except (TypeError, ValueError):  # read-only, or empty
        return array.ctypes.data


# NumPy -----------------------------------------------------------------------------------------------------


def _on_numpy(key: Sequence[str], make: Callable[[], Sequence[Program]]) -> dict[str, RowKernel]:
    return _of_programs(programs_from(cached_text(key, lambda: text_of(make()))))


def _of_programs(programs: Sequence[Program]) -> dict[str, RowKernel]:
    from rodgen.codegen._rows_numpy import NumPyProgram

    kernels = {}
    for program in programs:
        run = _Built(NumPyProgram, program)
        gram = functools.partial(_numpy_gram, run, program.outputs) if program.columns else None
        each = functools.partial(run, shared=False)
        kernels[program.name] = RowKernel(program.name, "numpy", program.about, run, gram, each)
    return kernels


class _Built:
    """A program that is prepared when it is first run: of a machine's programs few are."""

    def __init__(self, build: Callable[[Program], Callable[..., None]], program: Program) -> None:
        self._build, self._program = build, program

    @functools.cached_property
    def _run(self) -> Callable[..., None]:
        return self._build(self._program)

    def __call__(self, *inputs: Any, **options: Any) -> None:
        self._run(*inputs, **options)


def _numpy_gram(
    evaluate: Callable[..., None], outputs: Shapes, count: int, inputs: Sequence[Array], gram: Array
) -> None:
    (height,), (_, columns) = outputs.values()
    for start in range(0, count, BLOCK):
        rows = inputs[0][start : start + BLOCK]
        residual, jacobian = np.empty((len(rows), height)), np.empty((len(rows), height, columns))
        evaluate(len(rows), [rows, *inputs[1:]], [residual, jacobian])
        joined = np.concatenate([jacobian, residual[:, :, None]], axis=2).reshape(-1, columns + 1)
        with np.errstate(all="ignore"):
            gram[: columns + 1, : columns + 1] += joined.T @ joined
