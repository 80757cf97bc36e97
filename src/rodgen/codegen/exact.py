"""Evaluate a kernel with many digits: the reference that NumPy and C are compared with.

It walks the very expression trees of the kernel, in mpmath, so a wrong printer or template cannot hide. Where
floating point has a value that mathematics has not, it is the same one here: 1/0 is infinite, the root of a
negative number is NaN, a comparison with NaN is false.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import mpmath
import numpy as np
import sympy as sp
from sympy.core.relational import Relational

from rodgen.codegen.kernel_parts import StraightLine
from rodgen.symbolic import EPS, LARGEST, power_of_two_scale

Real: TypeAlias = Any
"""An mpf, or a bool for a condition."""

Evaluation: TypeAlias = Callable[[Sequence[Real]], Real]


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


def _translated(tree: sp.Basic, places: Mapping[sp.Symbol, int]) -> Evaluation:
    """Make an expression or condition a function of the list of all values; of a select only one case is evaluated.

    Once for all points, because SymPy takes longer to say what a node is than mpmath to compute its value. Constants
    have the digits that are set when this is called.
    """
    if isinstance(tree, sp.Symbol):
        return operator.itemgetter(places[tree])
    if isinstance(tree, sp.Rational):
        return _constant(mpmath.mpf(int(tree.p)) / int(tree.q))
    if isinstance(tree, sp.NumberSymbol):
        return _constant(mpmath.mpf(getattr(mpmath, str(tree).lower())))
    if tree in (sp.true, sp.false):
        return _constant(tree is sp.true)
    if tree is sp.nan:
        return _constant(mpmath.nan)
    if isinstance(tree, sp.Piecewise):
        cases = [(_translated(case, places), _translated(holds, places)) for case, holds in tree.args]
        return lambda known: next(case(known) for case, holds in cases if holds(known))
    if isinstance(tree, sp.Mul):
        return _product(tree, places)
    if isinstance(tree, sp.Pow):
        if tree.exp.is_negative:
            below = _power(tree.base, -tree.exp, places)
            return lambda known: _quotient(mpmath.mpf(1), below(known))
        return _power(tree.base, tree.exp, places)
    parts = [_translated(part, places) for part in tree.args]
    if isinstance(tree, Relational):
        compare, (left, right) = _COMPARISONS[tree.rel_op], parts
        return lambda known: compare(left(known), right(known))
    if isinstance(tree, sp.And):
        return lambda known: all(part(known) for part in parts)
    if isinstance(tree, sp.Or):
        return lambda known: any(part(known) for part in parts)
    if isinstance(tree, sp.Not):
        return lambda known: not parts[0](known)
    if isinstance(tree, sp.ITE):  # SymPy makes this of a select inside a condition
        condition, yes, no = parts
        return lambda known: yes(known) if condition(known) else no(known)
    if isinstance(tree, sp.Add):
        return lambda known: functools.reduce(operator.add, [part(known) for part in parts])
    if isinstance(tree, power_of_two_scale):
        largest = places[LARGEST]
        return lambda known: _scale(parts[0](known), known[largest])
    return _function(_FUNCTIONS[type(tree)], parts)


def _constant(value: Real) -> Evaluation:
    return lambda known: value


def _function(function: Callable[..., Real], parts: Sequence[Evaluation]) -> Evaluation:
    def value(known: Sequence[Real]) -> Real:
        arguments = [part(known) for part in parts]
        return mpmath.nan if any(map(mpmath.isnan, arguments)) else function(*arguments)

    return value


def _product(tree: sp.Mul, places: Mapping[sp.Symbol, int]) -> Evaluation:
    above, below = [], []
    for factor in tree.args:
        if isinstance(factor, sp.Pow) and factor.exp.is_negative:
            below.append(_power(factor.base, -factor.exp, places))
        else:
            above.append(_translated(factor, places))

    def value(known: Sequence[Real]) -> Real:
        product = mpmath.mpf(1)
        for factor in above:
            product = product * factor(known)
        if not below:
            return product
        divisor = mpmath.mpf(1)
        for factor in below:
            divisor = divisor * factor(known)
        return _quotient(product, divisor)

    return value


def _power(base: sp.Expr, exponent: sp.Expr, places: Mapping[sp.Symbol, int]) -> Evaluation:
    x = _translated(base, places)
    if exponent == 1:
        return x
    if exponent == sp.S.Half:
        return lambda known: _root(x(known))
    if exponent.is_Integer:
        n = int(exponent)
        return lambda known: x(known) ** n
    y = _translated(exponent, places)

    def value(known: Sequence[Real]) -> Real:
        number = x(known)
        return mpmath.nan if number < 0 else number ** y(known)

    return value


def translated(kernel: StraightLine) -> tuple[dict[sp.Symbol, int], list[Evaluation]]:
    """Translate a kernel: the place of each symbol among the values, and what gives the value of each assignment."""
    inputs = [s for port in kernel.inputs for s in port.symbols]
    symbols = [EPS, LARGEST, *inputs, *(a.symbol for a in kernel.assignments)]
    places = {symbol: place for place, symbol in enumerate(symbols)}
    return places, [_translated(a.value, places) for a in kernel.assignments]


def evaluate(
    kernel: StraightLine, values: Mapping[str, Any], *, digits: int = 50, eps: Any = None, largest: Any = None
) -> dict[str, Any]:
    """Evaluate a kernel at one point.

    Parameters
    ----------
    kernel : StraightLine
        What to evaluate.
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
        known = [
            mpmath.mpf(2) ** -52 if eps is None else mpmath.mpf(eps),
            mpmath.mpf(np.finfo(np.float64).max.item()) if largest is None else mpmath.mpf(largest),
        ]
        for port in kernel.inputs:
            components = np.asarray(values[port.name], dtype=object)
            if components.shape != port.shape:
                raise ValueError(
                    f"kernel {kernel.name}: {port.name} has shape {components.shape}; expected {port.shape}"
                )
            known += map(_number, components.ravel())
        if digits not in kernel.translations:
            kernel.translations[digits] = translated(kernel)
        places, steps = kernel.translations[digits]
        for step in steps:
            known.append(step(known))
        result: dict[str, Any] = {}
        for port in kernel.outputs:
            flat = [known[places[s]] for s in port.symbols]
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
