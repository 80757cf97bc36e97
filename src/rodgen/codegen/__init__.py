"""From a derivation to code: the kernel, its derivatives, and the targets it is printed to.

What loads kernels from the cache needs no SymPy, so that names are imported when they are asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rodgen.codegen.builder import KernelBuilder
    from rodgen.codegen.kernel import Kernel
    from rodgen.codegen.program import Assignment, Derivative, KernelError, Port, port_symbols

_MODULES = {
    "Assignment": "program",
    "Derivative": "program",
    "Kernel": "kernel",
    "KernelBuilder": "builder",
    "KernelError": "program",
    "Port": "program",
    "port_symbols": "program",
}

__all__ = ["Assignment", "Derivative", "Kernel", "KernelBuilder", "KernelError", "Port", "port_symbols"]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"rodgen.codegen.{_MODULES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
