"""From a derivation to code: the kernel, its derivatives, and the targets it is printed to.

What loads kernels from the cache needs no SymPy, so that names are imported when they are asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rodgen.codegen.builder import KernelBuilder
    from rodgen.codegen.kernel import Kernel
    from rodgen.codegen.kernel_parts import Assignment, KernelError, Port, port_symbols
    from rodgen.codegen.source_files import numpy_function

_MODULES = {
    "Assignment": "kernel_parts",
    "Kernel": "kernel",
    "KernelBuilder": "builder",
    "KernelError": "kernel_parts",
    "Port": "kernel_parts",
    "numpy_function": "source_files",
    "port_symbols": "kernel_parts",
}

__all__ = [
    "Assignment",
    "Kernel",
    "KernelBuilder",
    "KernelError",
    "Port",
    "numpy_function",
    "port_symbols",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"rodgen.codegen.{_MODULES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
