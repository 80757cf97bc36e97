"""Factor a polynomial, in a time that is the same in every run."""

from __future__ import annotations

from typing import Any

import sympy as sp
from sympy.core import random


def factored(expr: sp.Expr) -> Any:
    """Factor a polynomial.

    SymPy lifts factors from random points, and with bad luck it takes minutes where it usually takes milliseconds. Here
    its random numbers are always the same; the factors do not depend on them.

    Examples
    --------
    >>> x, y = sp.symbols("x y")
    >>> factored(x**2 - y**2)
    (x - y)*(x + y)
    """
    state = random.rng.getstate()
    random.seed(0)
    try:
        return sp.factor(expr)
    finally:
        random.rng.setstate(state)
