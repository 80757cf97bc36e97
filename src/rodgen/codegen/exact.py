"""Evaluate a kernel with many digits: the reference that NumPy and C are compared with.

It runs the very assignments of the kernel, in mpmath, so a wrong printer or template cannot hide.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import mpmath
import numpy as np
import sympy as sp

from rodgen.symbolic import EPS, LARGEST

if TYPE_CHECKING:
    from rodgen.codegen.kernel import Kernel

__all__ = ["evaluate"]


def _power_of_two_scale(x: Any) -> Any:
    if x == 0 or not mpmath.isfinite(x):
        return mpmath.mpf(1)
    return mpmath.mpf(2) ** (1 - mpmath.frexp(x)[1])


_MODULES = [{"power_of_two_scale": _power_of_two_scale}, "mpmath"]


@lru_cache(maxsize=64)
def _lines(kernel: Kernel) -> list[tuple[sp.Symbol, list[sp.Symbol], Any]]:
    lines = []
    for assignment in kernel.assignments:
        arguments = sorted(assignment.value.free_symbols, key=lambda s: str(s.name))
        lines.append(
            (assignment.symbol, arguments, sp.lambdify(arguments, assignment.value, modules=_MODULES))
        )
    return lines


def evaluate(
    kernel: Kernel, values: Mapping[str, Any], *, digits: int = 50, eps: Any = None, largest: Any = None
) -> dict[str, Any]:
    """Evaluate a kernel at one point.

    Parameters
    ----------
    kernel : Kernel
        What to evaluate.
    values : mapping of str to number or array_like
        A value for each input, of the port's shape. Floats are taken exactly as they are in binary;
        ``mpmath.mpf``, int and ``fractions.Fraction`` are welcome.
    digits : int
        Decimal digits of the evaluation.
    eps, largest : number, optional
        Rounding unit and largest number of the type whose case distinctions are to be reproduced;
        float64 when left out.

    Returns
    -------
    dict
        For each output an mpf, an int (status), or an object array of the port's shape.
    """
    with mpmath.workdps(digits):
        environment: dict[sp.Symbol, Any] = {
            EPS: mpmath.mpf(2) ** -52 if eps is None else mpmath.mpf(eps),
            LARGEST: mpmath.mpf(np.finfo(np.float64).max.item()) if largest is None else mpmath.mpf(largest),
        }
        for port in kernel.inputs:
            components = np.asarray(values[port.name], dtype=object)
            if components.shape != port.shape:
                raise ValueError(
                    f"kernel {kernel.name}: {port.name} has shape {components.shape}; expected {port.shape}"
                )
            environment.update(
                (s, mpmath.mpmathify(x)) for s, x in zip(port.symbols, components.ravel(), strict=True)
            )
        for symbol, arguments, function in _lines(kernel):
            environment[symbol] = function(*(environment[a] for a in arguments))
        result: dict[str, Any] = {}
        for port in kernel.outputs:
            flat = [environment[s] for s in port.symbols]
            flat = [int(x) for x in flat] if port.is_status else [mpmath.mpf(x) for x in flat]
            array = np.empty(len(flat), dtype=object)
            array[:] = flat
            result[port.name] = flat[0] if port.shape == () else array.reshape(port.shape)
        return result
