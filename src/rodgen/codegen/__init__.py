"""From a derivation to code: the kernel, its derivatives, and the targets it is printed to.

What loads kernels from the cache needs no SymPy, so that names are imported when they are asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rodgen.codegen.builder import KernelBuilder
    from rodgen.codegen.kernel import Kernel
    from rodgen.codegen.kernel_parts import KernelError
    from rodgen.codegen.source_files import numpy_function

_MODULES = {
    "Kernel": "kernel",
    "KernelBuilder": "builder",
    "KernelError": "kernel_parts",
    "numpy_function": "source_files",
}

__all__ = [
    "Kernel",
    "KernelBuilder",
    "KernelError",
    "numpy_function",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"rodgen.codegen.{_MODULES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
