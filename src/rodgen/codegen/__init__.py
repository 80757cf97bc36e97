"""From a derivation to code: the kernel, its derivatives, and the targets it is printed to."""

from rodgen.codegen.kernel import Assignment, Kernel, KernelBuilder, KernelError, Port

__all__ = ["Assignment", "Kernel", "KernelBuilder", "KernelError", "Port"]
