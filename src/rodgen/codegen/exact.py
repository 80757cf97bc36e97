"""Programs with many digits: an operation at a time, with the numbers of mpmath.

It is the reference that NumPy and C are compared with. Where floating point has a value that mathematics has not, it is
the same one here: 1/0 is infinite, the root of a negative number is NaN, a comparison with NaN is false.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import mpmath
import numpy as np

from rodgen.codegen.kernel_parts import Port
from rodgen.codegen.program import Program

Real: TypeAlias = Any
"""An mpf, or a bool for a condition."""


def _scale(x: Real, largest: Real) -> Real:
    """Return the scale that every target takes: a normal number whatever x is, even infinite or NaN; 1 for 0."""
    top = mpmath.frexp(largest)[1] - 2
    exponent = top
    if mpmath.isfinite(x):
        exponent = min(max(mpmath.frexp(x)[1] - 1, -top), top) if x != 0 else 0
    return mpmath.mpf(2) ** -exponent


def _quotient(above: Real, below: Real) -> Real:
    if below != 0:
        return above / below
    return above * mpmath.inf  # NaN for 0/0; mpmath has no negative zero


def _power(x: Real, y: Real) -> Real:
    if x == 0 and y < 0:
        return mpmath.inf
    if mpmath.isinf(y):  # of any base, as if it were even
        return abs(x) ** y
    return mpmath.nan if x < 0 and y != int(y) else x**y


def _real(function: Callable[..., Real], *, periodic: bool = False) -> Callable[..., Real]:
    """Return a function that is NaN where it has no real value."""

    def value(*arguments: Real) -> Real:
        if any(map(mpmath.isnan, arguments)) or (periodic and not mpmath.isfinite(arguments[0])):
            return mpmath.nan
        result = function(*arguments)
        return mpmath.nan if isinstance(result, mpmath.mpc) else result

    return value


_OPERATIONS: dict[str, Callable[..., Real]] = {
    **{op: getattr(operator, op) for op in ("add", "sub", "mul", "neg", "lt", "le", "eq", "ne", "abs")},
    "and": lambda a, b: a and b,
    "or": lambda a, b: a or b,
    "not": operator.not_,
    "div": _quotient,
    "recip": lambda x: _quotient(mpmath.mpf(1), x),
    "select": lambda holds, yes, no: yes if holds else no,
    "pi": lambda: +mpmath.pi,
    "pow": _real(_power),
    **{op: _real(getattr(mpmath, op), periodic=True) for op in ("sin", "cos", "tan")},
    **{op: _real(getattr(mpmath, op)) for op in ("asin", "acos", "log", "sqrt", "sign", "atan", "atan2")},
    **{op: _real(getattr(mpmath, op)) for op in ("sinh", "cosh", "tanh", "exp")},
}


def exact_results(
    program: Program, inputs: Mapping[str, Sequence[Real]], row: int = 0
) -> dict[str, list[Real]]:
    """Return the components of the outputs of a program for one row of its Jacobian; the precision is mpmath's.

    `inputs` has the components of each input.
    """
    results: list[Real] = []
    for op, *args in program.operations:
        if op == "input":
            results.append(inputs[args[0]][args[1]])
        elif op == "seed":
            results.append(mpmath.mpf(args[0] == row))
        else:
            operands = [results[a] if isinstance(a, int) else mpmath.mpf(a) for a in args]
            if op == "power_of_two_scale":
                operands.append(inputs["largest"][0])
                results.append(_scale(*operands))
            else:
                results.append(_OPERATIONS[op](*operands))
    return {
        port: [results[x] if isinstance(x, int) else mpmath.mpf(x) for x in values]
        for port, values in program.results.items()
    }


def evaluate(
    program: Program,
    inputs: Sequence[Port],
    outputs: Sequence[Port],
    values: Mapping[str, Any],
    digits: int = 50,
    eps: Any = None,
    largest: Any = None,
) -> dict[str, Any]:
    """Evaluate the program of a kernel at one point.

    Parameters
    ----------
    program, inputs, outputs : Program, sequence of Port
        Of the kernel.
    values : mapping of str to number or array_like
        A value for each input, of the port's shape. Floats are taken exactly as they are in binary;
        ``mpmath.mpf``, int and ``fractions.Fraction`` are welcome.
    digits : int
        Decimal digits of the evaluation.
    eps, largest : number, optional
        Machine epsilon and largest number of the type whose case distinctions are to be reproduced;
        float64 when left out.

    Returns
    -------
    dict
        For each output an mpf, an int (status), or an object array of the port's shape.
    """
    with mpmath.workdps(digits):
        limits = np.finfo(np.float64)
        known = {
            "eps": [mpmath.mpf(limits.eps.item() if eps is None else eps)],
            "largest": [mpmath.mpf(limits.max.item() if largest is None else largest)],
        }
        for port in inputs:
            components = np.asarray(values[port.name], dtype=object)
            if components.shape != port.shape:
                raise ValueError(
                    f"kernel {program.name}: {port.name} has shape {components.shape}; expected {port.shape}"
                )
            known[port.name] = list(map(_number, components.ravel()))
        results = exact_results(program, known)
        by_port: dict[str, Any] = {}
        for port in outputs:
            flat = [int(x) if port.is_status else mpmath.mpf(x) for x in results[port.name]]
            array = np.empty(len(flat), dtype=object)
            array[:] = flat
            by_port[port.name] = flat[0] if port.shape == () else array.reshape(port.shape)
        return by_port


def _number(x: Any) -> Real:
    if isinstance(x, np.generic):
        x = x.item()
    if hasattr(x, "numerator") and not isinstance(x, int):
        return mpmath.mpf(x.numerator) / x.denominator
    return mpmath.mpf(x)
