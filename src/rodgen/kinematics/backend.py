"""The kernels of the public functions: compiled gufuncs, or NumPy functions when there are no compiled ones.

Set ``RODGEN_CPU`` to ``numpy``, ``baseline`` or ``avx2`` before the import to use less than the processor has;
that is for tests and comparisons.
"""

from __future__ import annotations

import importlib
import os
import warnings
from functools import wraps
from types import SimpleNamespace
from typing import Any

__all__ = ["backend", "kernels", "often_single"]


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
