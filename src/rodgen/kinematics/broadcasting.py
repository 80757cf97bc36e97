"""Call a kernel on array-likes, NumPy or Dask, with errors that name the argument.

NumPy's gufuncs take care of broadcasting, types and ``out``. Dask spreads a gufunc over chunks once it knows the sizes
that appear only in the result.
"""

from __future__ import annotations

import inspect
import re
import sys
from typing import Any

import numpy as np

__all__ = ["call"]


def call(kernel: Any, arguments: tuple[Any, ...], out: Any) -> Any:
    """Return the results of a kernel.

    Raises
    ------
    TypeError
        When an argument is not real.
    ValueError
        When the last axes of an argument have another shape than the kernel's, or the other axes do not broadcast.
    """
    if "dask.array" in sys.modules:
        from dask.array import Array, apply_gufunc

        if any(isinstance(a, Array) for a in arguments):
            if out is not None:
                raise TypeError("out is for NumPy arrays; a Dask array is computed later")
            return _spread(kernel, arguments, apply_gufunc)
    try:
        return kernel(*arguments) if out is None else kernel(*arguments, out=out)
    except (TypeError, ValueError):
        _check(kernel.__name__, arguments)
        raise


def _check(name: str, arguments: tuple[Any, ...]) -> None:
    """Raise the error of the NumPy kernel, which names the argument, where the compiled one speaks of operands."""
    from rodgen.generated import numpy as generated

    evaluate = getattr(generated.ALL, name)
    for port, argument in zip(inspect.signature(evaluate).parameters, arguments, strict=False):
        kind = np.asarray(argument).dtype
        if kind.kind not in "fiub":
            raise TypeError(f"{port} has type {kind}; expected real numbers")
    try:
        evaluate(*arguments)
    except (TypeError, ValueError) as error:
        raise type(error)(str(error).removeprefix(f"{name}: ")) from None


def _spread(kernel: Any, arguments: tuple[Any, ...], apply_gufunc: Any) -> Any:
    inputs, outputs = kernel.signature.split("->")
    sizes = {size: int(size) for size in set(re.findall(r"\d+", outputs)) - set(re.findall(r"\d+", inputs))}
    number = np.result_type(
        *(a.dtype if hasattr(a, "dtype") else np.asarray(a).dtype for a in arguments if np.ndim(a))
    )
    real = np.float32 if np.can_cast(number, np.float32) else np.float64
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
