"""The kernels of the public functions: compiled gufuncs, or NumPy functions when there are no compiled ones.

Set ``RODGEN_CPU`` to ``numpy``, ``baseline`` or ``avx2`` before the import to use less than the processor has;
that is for tests and comparisons.

A kernel is called on array-likes, NumPy or Dask, with errors that name the argument. The kernels broadcast, choose
float32 or float64 and fill ``out`` themselves: compiled they are NumPy gufuncs, otherwise generated functions with the
same signature. Dask applies either to its chunks.
"""

from __future__ import annotations

import importlib
import inspect
import os
import re
import sys
import warnings
from functools import wraps
from types import SimpleNamespace
from typing import Any

import numpy as np

from rodgen.kinematics.arrays import has_masked, not_broadcast, refuse_masked

__all__ = ["backend", "call_kernel", "kernels", "often_single"]


def _load() -> tuple[str, Any]:
    """Return the instruction set and the kernels for it."""
    reason = None
    if os.environ.get("RODGEN_CPU") != "numpy":
        try:
            compiled = importlib.import_module("rodgen._gufuncs")
            return compiled.instruction_set, compiled
        except ImportError as error:
            reason = str(error)
    from rodgen.generated import numpy as generated

    return "numpy", generated.ALL if reason is None else _warning_once(generated.ALL, reason)


def _warning_once(functions: SimpleNamespace, reason: str) -> SimpleNamespace:
    """Return the functions, wrapped so that the first call of any warns that NumPy is slower.

    A warning at import would come before the user could filter it.
    """
    warned = False

    def wrapped(function: Any) -> Any:
        @wraps(function)
        def warn_and_call(*arguments: Any, **options: Any) -> Any:
            nonlocal warned
            if not warned:
                warned = True
                warnings.warn(
                    f"rodgen runs on NumPy, which is slower: it has no compiled kernels ({reason}); "
                    "install a C compiler and then rodgen again",
                    RuntimeWarning,
                    stacklevel=4,  # the caller of the public function, above `call_kernel`
                )
            return function(*arguments, **options)

        return warn_and_call

    return SimpleNamespace(**{name: wrapped(function) for name, function in vars(functions).items()})


backend, kernels = _load()
"""Instruction set of the kernels in use (``avx512``, ``avx2``, ``baseline`` or ``numpy``), and the kernels."""


def often_single(name: str) -> Any:
    """Return a kernel that is called soonest where every argument is a float64 array of the kernel's own shape.

    It takes whatever the kernel takes, except ``out``. A gufunc is called as soon, less 1.5 µs for NumPy's iteration.
    """
    return getattr(kernels, "one_element", {}).get(name, getattr(kernels, name))


def call_kernel(kernel: Any, arguments: tuple[Any, ...], out: Any = None) -> Any:
    """Return the results of a kernel.

    Raises
    ------
    TypeError
        When an argument is not real, or `out` is given with a Dask array.
    ValueError
        When the last axes of an argument have another shape than the kernel's, the other axes do not broadcast, or
        elements are masked.
    """
    if any(map(has_masked, arguments)):
        # strict=False: the last parameter of the kernel is `out`
        for parameter, argument in zip(_parameters(kernel.__name__), arguments, strict=False):
            refuse_masked(parameter, argument)
    if "dask.array" in sys.modules:
        from dask.array import Array, apply_gufunc

        if any(isinstance(a, Array) for a in arguments):
            if out is not None:
                raise TypeError("out is for NumPy arrays; a Dask array is computed later")
            return _apply_to_chunks(kernel, arguments, apply_gufunc)
    try:
        return kernel(*arguments) if out is None else kernel(*arguments, out=out)
    except (TypeError, ValueError):
        _raise_named(kernel.__name__, arguments)
        raise


def _parameters(name: str) -> list[str]:
    """Return the names of a kernel's arguments, ``out`` at the end."""
    from rodgen.generated import numpy as generated

    return list(inspect.signature(getattr(generated.ALL, name)).parameters)


def _raise_named(name: str, arguments: tuple[Any, ...]) -> None:
    """Raise the NumPy kernel's error, which names the argument; a compiled one's only numbers the operand.

    Returns when the NumPy kernel accepts the arguments: then the fault is in ``out``.
    """
    from rodgen.generated import numpy as generated

    evaluate = getattr(generated.ALL, name)
    # strict=False: the last parameter of the kernel is `out`
    for parameter, argument in zip(_parameters(name), arguments, strict=False):
        dtype = np.asarray(argument).dtype
        if dtype.kind not in "fiub":
            raise TypeError(f"{parameter} has type {dtype}; expected real numbers")
    try:
        evaluate(*arguments)
    except (TypeError, ValueError) as error:
        if "broadcast" in str(error):
            parameters = _parameters(name)
            raise not_broadcast(dict(zip(parameters, arguments, strict=False))) from None
        raise type(error)(str(error).removeprefix(f"{name}: ")) from None


def _apply_to_chunks(kernel: Any, arguments: tuple[Any, ...], apply_gufunc: Any) -> Any:
    """Return the results as Dask arrays, with the sizes and types that Dask cannot read off the gufunc."""
    inputs, outputs = kernel.signature.split("->")
    sizes = {size: int(size) for size in set(re.findall(r"\d+", outputs)) - set(re.findall(r"\d+", inputs))}
    # as in NumPy, arrays decide between float32 and float64; numbers follow
    dtype = np.result_type(
        *(a.dtype if hasattr(a, "dtype") else np.asarray(a).dtype for a in arguments if np.ndim(a))
    )
    real = np.float32 if np.can_cast(dtype, np.float32) else np.float64
    types = [np.int8 if code == "b" else real for code in kernel.types[0].split("->")[1]]
    scalars = tuple(np.asarray(a, real) if np.ndim(a) == 0 else a for a in arguments)
    return apply_gufunc(
        kernel,
        kernel.signature,
        *scalars,
        output_sizes=sizes,
        output_dtypes=types if len(types) > 1 else types[0],
        allow_rechunk=True,
    )
