"""From a derivation to code: the kernel, its derivatives, and the targets it is printed to.

What loads kernels from the cache needs no SymPy, so that names are imported when they are asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rodgen.codegen.kernel import Assignment, Kernel, KernelBuilder, KernelError, Port

__all__ = ["Assignment", "Kernel", "KernelBuilder", "KernelError", "Port"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("rodgen.codegen.kernel"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
