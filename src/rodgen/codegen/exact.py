"""Evaluate a kernel with many digits: the reference that NumPy and C are compared with.

It walks the very expression trees of the kernel, in mpmath, so a wrong printer or template cannot hide. Where
floating point has a value that mathematics has not, it is the same one here: 1/0 is infinite, the root of a
negative number is NaN, a comparison with NaN is false.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import mpmath
import numpy as np
import sympy as sp
from sympy.core.relational import Relational

from rodgen.symbolic import EPS, LARGEST, power_of_two_scale

if TYPE_CHECKING:
    from rodgen.codegen.kernel import Kernel

__all__ = ["evaluate"]

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


def _root(x: Real) -> Real:
    return mpmath.nan if x < 0 else mpmath.sqrt(x)


def _periodic(function: Callable[[Real], Real]) -> Callable[[Real], Real]:
    return lambda x: function(x) if mpmath.isfinite(x) else mpmath.nan


def _real(function: Callable[[Real], Real]) -> Callable[[Real], Real]:
    def value(x: Real) -> Real:
        result = function(x)
        return mpmath.nan if isinstance(result, mpmath.mpc) else result

    return value


_FUNCTIONS: dict[type, Callable[..., Real]] = {
    sp.Abs: abs,
    sp.sign: mpmath.sign,
    **{f: _periodic(getattr(mpmath, f.__name__)) for f in (sp.sin, sp.cos, sp.tan)},
    **{f: _real(getattr(mpmath, f.__name__)) for f in (sp.asin, sp.acos, sp.log)},
    **{f: getattr(mpmath, f.__name__) for f in (sp.atan, sp.atan2, sp.sinh, sp.cosh, sp.tanh, sp.exp)},
}

_COMPARISONS: dict[str, Callable[[Real, Real], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


def _value(tree: sp.Basic, environment: Mapping[sp.Symbol, Real]) -> Real:
    """Return the value of an expression or condition; of a select only the case that holds is evaluated."""
    if isinstance(tree, sp.Symbol):
        return environment[tree]
    if isinstance(tree, sp.Rational):
        return mpmath.mpf(int(tree.p)) / int(tree.q)
    if isinstance(tree, sp.Piecewise):
        return next(_value(case, environment) for case, holds in tree.args if _value(holds, environment))
    if isinstance(tree, Relational):
        return _COMPARISONS[tree.rel_op](_value(tree.lhs, environment), _value(tree.rhs, environment))
    if isinstance(tree, sp.And):
        return all(_value(a, environment) for a in tree.args)
    if isinstance(tree, sp.Or):
        return any(_value(a, environment) for a in tree.args)
    if isinstance(tree, sp.Not):
        return not _value(tree.args[0], environment)
    if isinstance(tree, sp.ITE):  # SymPy makes this of a select inside a condition
        return _value(tree.args[1] if _value(tree.args[0], environment) else tree.args[2], environment)
    if tree in (sp.true, sp.false):
        return tree is sp.true
    if tree is sp.nan:
        return mpmath.nan
    if isinstance(tree, sp.Add):
        total = _value(tree.args[0], environment)
        for term in tree.args[1:]:
            total = total + _value(term, environment)
        return total
    if isinstance(tree, sp.Mul):
        above, below = mpmath.mpf(1), mpmath.mpf(1)
        for factor in tree.args:
            if isinstance(factor, sp.Pow) and factor.exp.is_negative:
                below = below * _power(factor.base, -factor.exp, environment)
            else:
                above = above * _value(factor, environment)
        return _quotient(above, below)
    if isinstance(tree, sp.Pow):
        if tree.exp.is_negative:
            return _quotient(mpmath.mpf(1), _power(tree.base, -tree.exp, environment))
        return _power(tree.base, tree.exp, environment)
    if isinstance(tree, sp.NumberSymbol):
        return mpmath.mpf(getattr(mpmath, str(tree).lower()))
    arguments = [_value(a, environment) for a in tree.args]
    if isinstance(tree, power_of_two_scale):
        return _scale(arguments[0], environment[LARGEST])
    if any(mpmath.isnan(x) for x in arguments):
        return mpmath.nan
    return _FUNCTIONS[type(tree)](*arguments)


def _power(base: sp.Expr, exponent: sp.Expr, environment: Mapping[sp.Symbol, Real]) -> Real:
    x = _value(base, environment)
    if exponent == 1:
        return x
    if exponent == sp.S.Half:
        return _root(x)
    if exponent.is_Integer:
        return x ** int(exponent)
    y = _value(exponent, environment)
    return mpmath.nan if x < 0 else x**y


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
            environment.update((s, _number(x)) for s, x in zip(port.symbols, components.ravel(), strict=True))
        for assignment in kernel.assignments:
            environment[assignment.symbol] = _value(assignment.value, environment)
        result: dict[str, Any] = {}
        for port in kernel.outputs:
            flat = [environment[s] for s in port.symbols]
            flat = [int(x) for x in flat] if port.is_status else [mpmath.mpf(x) for x in flat]
            array = np.empty(len(flat), dtype=object)
            array[:] = flat
            result[port.name] = flat[0] if port.shape == () else array.reshape(port.shape)
        return result


def _number(x: Any) -> Real:
    if isinstance(x, np.generic):
        x = x.item()
    if hasattr(x, "numerator") and not isinstance(x, int):
        return mpmath.mpf(x.numerator) / x.denominator
    return mpmath.mpf(x)
