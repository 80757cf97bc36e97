"""Kernels of a C++ header, instantiated for both precisions and called through ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from conftest import CPP_WARNINGS, compile_shared

REALS = {np.dtype("f8"): "double", np.dtype("f4"): "float"}


def cpp_type(port: Any, real: str) -> str:
    kind = real
    for length in reversed(port.shape):
        kind = f"std::array<{kind}, {length}>"
    return kind


def loop(module: str, name: str, kernel: Any, real: str) -> str:
    """Return a C function that calls a template row by row; ports are pointers to packed rows."""
    ports = ", ".join(f"void *{p.name}" for p in (*kernel.inputs, *kernel.outputs))
    given = ", ".join(f"reinterpret_cast<const {cpp_type(p, real)} *>({p.name})[i]" for p in kernel.inputs)
    stores = []
    for port in kernel.outputs:
        value = f"found.{port.name}" if len(kernel.outputs) > 1 else "found"
        stores.append(
            f"std::memcpy(static_cast<char *>({port.name}) + i * sizeof {value}, &{value}, sizeof {value});"
        )
    return f"""
extern "C" void call_{name}_{real}(std::size_t count, {ports}) {{
  for (std::size_t i = 0; i < count; ++i) {{
    const auto found = rodgen::{module}::{name}<{real}>({given});
    {" ".join(stores)}
  }}
}}
"""


def cpp_library(
    compiler: str, folder: Path, module: str, header: str, kernels: Mapping[str, Any]
) -> ctypes.CDLL:
    """Compile the kernels of a header, without optimisation: that takes minutes for all of them."""
    (folder / f"{module}.hpp").write_text(header)
    source = folder / f"{module}.cpp"
    loops = "".join(
        loop(module, name, kernel, real) for name, kernel in kernels.items() for real in REALS.values()
    )
    source.write_text(f'#include "{module}.hpp"\n#include <cstring>\n{loops}')
    made = compile_shared(compiler, [source], folder / f"{module}.so", "-O0", warnings=CPP_WARNINGS)
    return ctypes.CDLL(str(made))


def call(
    library: ctypes.CDLL, name: str, kernel: Any, arguments: Sequence[np.ndarray]
) -> tuple[np.ndarray, ...]:
    """Evaluate a batch along the first axis."""
    real, count = arguments[0].dtype, len(arguments[0])
    inputs = [np.ascontiguousarray(a) for a in arguments]
    outputs = [np.zeros((count, *p.shape), np.int8 if p.is_status else real) for p in kernel.outputs]
    function = getattr(library, f"call_{name}_{REALS[real]}")
    function.restype = None
    function(ctypes.c_size_t(count), *(ctypes.c_void_p(a.ctypes.data) for a in (*inputs, *outputs)))
    return tuple(outputs)
