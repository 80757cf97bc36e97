"""Call a kernel on arrays: broadcast its inputs, allocate its outputs, evaluate it.

NumPy evaluates block by block; arrays of other libraries (CuPy, PyTorch, JAX, ...) are evaluated whole, in functions of
the array API standard and without a look at their values, so that their compilers can trace it.

The generated NumPy modules import nothing of this package: they contain the text of these functions, or import it from
their neighbour ``_call``. It is all that follows the marker. Their names start with an underscore, as no kernel's does.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

# Generated modules contain this file from here on.

BLOCK = 8192
"""Elements evaluated at a time: few enough for the intermediates to stay in the cache."""


def _power_of_two_scale(x: Any) -> Any:
    """Return the power of two that scales x >= 0 into [1, 2), from the exponent bits; 1 for 0."""
    xp = np if isinstance(x, np.ndarray) else _namespace((x,))
    if xp is np:
        x = np.asarray(x)
    elif not hasattr(x, "view"):  # the standard has no access to bits
        return xp.from_dlpack(np.asarray(_power_of_two_scale(np.from_dlpack(x))))
    word, mantissa, top = (xp.int64, 52, 2046) if x.dtype == xp.float64 else (xp.int32, 23, 254)
    bits, one = x.view(word), (word if xp is np else int)(1 << mantissa)  # NumPy is slow with plain integers
    exponent = xp.clip(bits & (top + 1) * one, one, (top - 1) * one)
    exponent = xp.where(bits == 0, top // 2 * one, exponent)
    return (top * one - exponent).view(x.dtype)


def _is_foreign(x: Any) -> bool:
    """Return whether this is an array of another library than NumPy."""
    if isinstance(x, (np.ndarray, np.generic, float)):
        return False
    return hasattr(x, "__array_namespace__") or type(x).__module__.partition(".")[0] in ("cupy", "torch")


def _namespace(arguments: Any) -> Any:
    """Return the functions for arrays as of the array API standard: those of NumPy, unless one is of another library.

    Arrays of other libraries need array-api-compat.
    """
    if {np.ndarray}.issuperset(map(type, arguments)) or not any(map(_is_foreign, arguments)):
        return np
    from array_api_compat import array_namespace

    return array_namespace(*filter(_is_foreign, arguments))


def _shape_text(shape: tuple[Any, ...]) -> str:
    """Return a shape as text, such as ``(..., 3)``."""
    return f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"


def _checked_out(name: str, out: Any, expected: list[tuple[str, tuple[int, ...], Any]]) -> list[Any]:
    """Return the arrays of `out` after a check of their number, shapes and types; None: one is to be allocated."""
    outputs = list(out) if isinstance(out, tuple) else [out]
    if len(outputs) != len(expected):
        raise ValueError(f"{name}: out has {len(outputs)} arrays; expected {len(expected)}")
    for array, (port, shape, kind) in zip(outputs, expected, strict=True):
        if array is not None and array.shape != shape:
            raise ValueError(f"{name}: out for {port} has shape {array.shape}; expected {shape}")
        if array is not None and not np.can_cast(kind, array.dtype, "same_kind"):
            raise TypeError(f"{name}: out for {port} has type {array.dtype}, which does not hold {kind}")
    return outputs


class _Call:
    """The inputs of one call as arrays, and arrays for its outputs.

    `inputs` are the names and shapes of the ports, `outputs` also whether each is a status. Inputs that are all float32
    or Python numbers are evaluated in float32, others in float64: `real`.
    """

    def __init__(self, name: str, arguments: Any, inputs: Any, outputs: Any, out: Any) -> None:
        self.arrays = [np.asarray(a) for a in arguments]
        self.loops = []
        for array, (port, core) in zip(self.arrays, inputs, strict=True):
            if not np.can_cast(array.dtype, np.float64):
                raise TypeError(f"{name}: {port} has type {array.dtype}; expected real numbers")
            if array.ndim < len(core) or array.shape[array.ndim - len(core) :] != core:
                shape = _shape_text(("...", *core))
                raise ValueError(f"{name}: {port} has shape {array.shape}; expected {shape}")
            self.loops.append(array.shape[: array.ndim - len(core)])
        weak = [
            a if isinstance(a, (int, float)) else array
            for a, array in zip(arguments, self.arrays, strict=True)
        ]
        self.real: Any = np.dtype(
            np.float32 if np.can_cast(np.result_type(*weak), np.float32) else np.float64
        )
        self.shape = np.broadcast_shapes(*self.loops)
        self.count = math.prod(self.shape)

        self.is_new = out is None
        kinds = [np.dtype(np.int8) if is_status else self.real for *_, is_status in outputs]
        wanted = [
            (port, self.shape + core, kind) for (port, core, _), kind in zip(outputs, kinds, strict=True)
        ]
        passed = [None] * len(kinds) if self.is_new else _checked_out(name, out, wanted)
        self.results = [
            np.empty(shape, kind) if array is None else array
            for array, (_, shape, kind) in zip(passed, wanted, strict=True)
        ]
        # what the kernel fills: contiguous, of the computed type, and no input
        self.targets = [
            r if r.dtype == kind and r.flags.carray and not self._is_an_input(r) else np.empty(r.shape, kind)
            for r, kind in zip(self.results, kinds, strict=True)
        ]

    def _is_an_input(self, result: Any) -> bool:
        return not self.is_new and any(np.may_share_memory(result, a) for a in self.arrays)

    def finish(self) -> Any:
        """Copy the targets to the results that are other arrays, and return the results as the caller expects them."""
        for result, target in zip(self.results, self.targets, strict=True):
            if result is not target:
                result[...] = target
        results = [r if r.ndim or not self.is_new else r[()] for r in self.results]
        return results[0] if len(results) == 1 else tuple(results)


def _evaluate(body: Any, usual: Any, name: str, arguments: Any, inputs: Any, outputs: Any, out: Any) -> Any:
    """Evaluate the straight-line body block by block.

    `usual`, unless it is None, is a shorter body that also returns for which elements it holds.
    """
    xp = _namespace(arguments)
    if xp is not np:
        if out is not None:
            raise TypeError(f"{name}: out is for NumPy arrays")
        return _evaluate_whole(xp, body, name, arguments, inputs, outputs)
    call = _Call(name, arguments, inputs, outputs, out)
    columns = []
    for array, loop, (_, core) in zip(call.arrays, call.loops, inputs, strict=True):
        array = array.astype(call.real, copy=False)
        if loop != call.shape and any(n != 1 for n in loop):
            array = np.broadcast_to(array, call.shape + core)
            loop = call.shape
        columns.append(array.reshape((call.count if loop == call.shape else 1, math.prod(core))))
    targets = [
        t.reshape((call.count, math.prod(core)))
        for t, (_, core, _) in zip(call.targets, outputs, strict=True)
    ]
    limits = np.finfo(call.real)
    numbers = float(limits.eps), float(limits.max)
    with np.errstate(all="ignore"):
        for start in range(0, call.count, BLOCK):
            block = slice(start, start + BLOCK)
            rows = (c[block] if len(c) != 1 else c for c in columns)
            components = [component for r in rows for component in np.ascontiguousarray(r.T)]
            rest: Any = block
            if usual:
                *values, is_usual = usual(np, *components, *numbers)
                _fill(targets, block, values)
                here = np.flatnonzero(~is_usual)
                if here.size == 0:
                    continue
                components = [c[here] if len(c) != 1 else c for c in components]
                rest = start + here
                if 2 * here.size > BLOCK:
                    usual = None  # it does not pay here
            _fill(targets, rest, body(np, *components, *numbers))
    return call.finish()


def _fill(targets: Any, rows: Any, values: Any) -> None:
    """Put the components of every output into the given rows."""
    values = iter(values)
    for target in targets:
        for k in range(target.shape[1]):
            target[rows, k] = next(values)


class _Functions:
    """Those of an array API namespace; `where` chooses between two numbers, too, which become arrays like `one`."""

    def __init__(self, xp: Any, one: Any) -> None:
        self.xp, self.one = xp, one

    def __getattr__(self, name: str) -> Any:
        return getattr(self.xp, name)

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        return self.xp.where(
            condition, a * self.one if isinstance(a, float) and isinstance(b, float) else a, b
        )


def _evaluate_whole(xp: Any, body: Any, name: str, arguments: Any, inputs: Any, outputs: Any) -> Any:
    """Evaluate the straight-line body on arrays of another library, all elements at once.

    Lists and numbers become arrays where the others are; arrays that are all float32 are evaluated in float32.
    """
    from array_api_compat import device

    arrays = [a for a in arguments if _is_foreign(a)]
    narrow = all(xp.isdtype(a.dtype, "real floating") and a.dtype != xp.float64 for a in arrays)
    one = xp.ones((), dtype=xp.float32 if narrow else xp.float64, device=device(arrays[0]))
    columns, loops = [], []
    for array, (port, core) in zip(arguments, inputs, strict=True):
        if not _is_foreign(array):
            array = xp.asarray(array, dtype=one.dtype, device=device(arrays[0]))
        if xp.isdtype(array.dtype, "complex floating"):
            raise TypeError(f"{name}: {port} has type {array.dtype}; expected real numbers")
        loop, shape = tuple(array.shape[: array.ndim - len(core)]), tuple(array.shape)
        if loop + core != shape:
            raise ValueError(f"{name}: {port} has shape {shape}; expected {_shape_text(('...', *core))}")
        loops.append(loop)
        rows = xp.reshape(xp.astype(array, one.dtype), (*loop, math.prod(core)))
        columns += [rows[..., k] for k in range(math.prod(core))]
    shape = np.broadcast_shapes(*loops)
    limits = xp.finfo(one.dtype)
    values = body(_Functions(xp, one), *columns, float(limits.eps), float(limits.max))
    results, first = [], 0
    for _, core, is_status in outputs:
        kind = xp.int8 if is_status else one.dtype
        parts = [x * one if isinstance(x, float) else x for x in values[first : first + math.prod(core)]]
        first += len(parts)
        parts = [xp.broadcast_to(xp.astype(part, kind), shape) for part in parts]
        results.append(xp.reshape(xp.stack(parts, axis=-1), shape + core) if core else parts[0])
    return results[0] if len(results) == 1 else tuple(results)
