"""Compile kernels while the program runs: C by the system's compiler, NumPy where there is none.

The C of a module is compiled once into a shared library in the user's cache. Only the lines that the
printers write for a kernel's expressions are compiled or run; its texts (summary, notes, units) are not used.
"""

from __future__ import annotations

import ctypes
import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np

from rodgen.codegen._array_call import _Call
from rodgen.codegen.build_cache import (
    CompilerError,
    cache_folder,
    compiler,
    notice,
    one_row,
    shared_library,
    source_hash,
)
from rodgen.codegen.kernel import Kernel
from rodgen.codegen.kernel_parts import KernelError, Port
from rodgen.codegen.source_files import KernelModule, render

__all__ = ["CompiledKernel", "cache_folder", "compile_kernel", "compile_kernels"]

FLAGS = ("-std=c99", "-O3", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared")
"""No -march=native: a cache on a shared disk serves different processors. No -ffast-math: it deletes NaN tests."""

BLOCK = 4096
"""Elements a call while an input that is the same for all elements is repeated in a buffer."""

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")


@dataclass(frozen=True)
class CompiledKernel:
    """A kernel as a function on arrays.

    It is called like the generated NumPy function: the inputs in order, broadcast against each other, and ``out``,
    an array or a tuple of arrays to fill. With float32 inputs it computes in float32, else in float64.
    """

    kernel: Kernel
    """What it evaluates."""
    target: str
    """``"c"`` or ``"numpy"``."""
    _run: Callable[..., Any] = field(repr=False)

    def __call__(self, *arguments: Any, out: Any = None) -> Any:
        """Evaluate; see :class:`CompiledKernel`.

        Raises
        ------
        TypeError
            For a wrong number of arguments, and for an argument that is not an array of real numbers.
        ValueError
            When a shape does not fit.
        """
        if len(arguments) != len(self.kernel.inputs):
            names = ", ".join(port.name for port in self.kernel.inputs)
            raise TypeError(f"{self.kernel.name}: {len(arguments)} arguments; expected {names}")
        return self._run(*arguments, out=out)


def compile_kernel(kernel: Kernel) -> CompiledKernel:
    """Compile one kernel; see :func:`compile_kernels`.

    Examples
    --------
    >>> import sympy as sp
    >>> from rodgen.codegen import KernelBuilder
    >>> k = KernelBuilder("hypotenuse", summary="Longest side.", source="Pythagoras")
    >>> a = k.input("a", unit="m", doc="one side")
    >>> b = k.input("b", unit="m", doc="the other side")
    >>> k.output("c", sp.sqrt(a**2 + b**2), unit="m", doc="longest side")
    >>> hypotenuse = compile_kernel(k.build())
    >>> hypotenuse([3.0, 5.0], [4.0, 12.0])
    array([ 5., 13.])
    """
    return compile_kernels([kernel])[kernel.name]


def compile_kernels(kernels: Sequence[Kernel]) -> dict[str, CompiledKernel]:
    """Compile kernels into one library, or load the library from the cache.

    The compiler is the one that the environment variable ``CC`` names, else cc, gcc or clang. Without one, or when it
    fails, the kernels run on NumPy, and one warning says why.

    Parameters
    ----------
    kernels : sequence of Kernel
        Each with a name of its own.

    Returns
    -------
    dict of str to CompiledKernel
        By the kernels' names.

    Raises
    ------
    KernelError
        When two kernels share a name, or a name is not an identifier.
    """
    names = [kernel.name for kernel in kernels]
    if len(set(names)) != len(names):
        raise KernelError(f"kernels share a name: {', '.join(names)}")
    module = KernelModule("kernels", "", "", tuple(map(_without_texts, kernels)))
    files = render(module)
    sources = {name: files[f"c/{name}"] for name in ("kernels.c", "kernels.h")}
    of_one_row = functools.partial(one_row, [[p.shape for p in k.inputs] for k in kernels])

    def compiled(library: ctypes.CDLL) -> list[CompiledKernel]:
        return [
            CompiledKernel(k, "c", functools.partial(_run_compiled, _loops(library, k), k)) for k in kernels
        ]

    def on_numpy() -> list[CompiledKernel]:
        functions: dict[str, Any] = {}
        exec(compile(files["numpy/kernels.py"], "<generated kernels>", "exec"), functions)
        return [CompiledKernel(k, "numpy", functions[k.name]) for k in kernels]

    try:
        library = shared_library(
            (source_hash(Path(__file__).parent), *sources.values()), lambda: sources, compiler(), FLAGS,
            lambda library: of_one_row(compiled(library)), lambda: of_one_row(on_numpy()),
        )  # fmt: skip
        made = compiled(library)
    except CompilerError as error:
        notice(str(error))
        made = on_numpy()
    return {k.kernel.name: k for k in made}


class _Code(IntEnum):
    """Placeholder for the enumeration of every status: the codes are stored, their names are not needed."""

    NONE = 0


def _without_texts(kernel: Kernel) -> Kernel:
    """Return a kernel without its texts, after a check of its names."""
    symbols = [s.name for p in (*kernel.inputs, *kernel.outputs) for s in p.symbols]
    names = [kernel.name, *(p.name for p in (*kernel.inputs, *kernel.outputs)), *symbols]
    names += [s.name for a in kernel.assignments for s in {a.symbol, *a.value.free_symbols}]
    for name in names:
        if not _IDENTIFIER.match(name):
            raise KernelError(f"{name!r} is not a valid name in generated code; expected a plain identifier")

    def without_texts(port: Port) -> Port:
        return replace(port, unit="", doc="", between=None, enum=_Code if port.is_status else None)

    return replace(
        kernel,
        summary="",
        source="",
        notes="",
        inputs=tuple(map(without_texts, kernel.inputs)),
        outputs=tuple(map(without_texts, kernel.outputs)),
        usual=None,
        equations=None,
        derivative=None,
    )


# the call --------------------------------------------------------------------------------------------------


def _loops(made: ctypes.CDLL, kernel: Kernel) -> Mapping[Any, Any]:
    """Return the functions over many elements, by their number type."""
    loops = {}
    for real, bits in ((np.dtype(np.float64), "f64"), (np.dtype(np.float32), "f32")):
        loop = getattr(made, f"kernels_{kernel.name}_batch_{bits}")
        loop.argtypes = [ctypes.c_size_t] + [ctypes.c_void_p] * len((*kernel.inputs, *kernel.outputs))
        loop.restype = None
        loops[real] = loop
    return loops


def _run_compiled(loops: Mapping[Any, Any], kernel: Kernel, *arguments: Any, out: Any = None) -> Any:
    """Evaluate the compiled kernel on arrays, block by block."""
    inputs = [(p.name, p.shape) for p in kernel.inputs]
    call = _Call(
        kernel.name, arguments, inputs, [(p.name, p.shape, p.is_status) for p in kernel.outputs], out
    )
    # an input that is the same for all elements is repeated in a buffer, which every block of elements reads
    repeated = [call.count > 1 and all(n == 1 for n in loop) for loop in call.loops]
    step = min(call.count, BLOCK) if any(repeated) else call.count
    columns = []
    for (_, core), array, loop, same in zip(inputs, call.arrays, call.loops, repeated, strict=True):
        if same:
            array = np.broadcast_to(array.reshape(core), (step, *core))
        elif loop != call.shape:
            array = np.broadcast_to(array, call.shape + core)
        columns.append(np.ascontiguousarray(array, call.real))
    for start in range(0, call.count, max(step, 1)):
        loops[call.real](
            min(step, call.count - start),
            *(
                c.ctypes.data + (0 if same else start * p.size * c.itemsize)
                for c, p, same in zip(columns, kernel.inputs, repeated, strict=True)
            ),
            *(
                t.ctypes.data + start * p.size * t.itemsize
                for t, p in zip(call.targets, kernel.outputs, strict=True)
            ),
        )
    return call.finish()
