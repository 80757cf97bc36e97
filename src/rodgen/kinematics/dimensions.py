"""Dimensions of a machine, checked: numbers that are finite, and limits of legs or rods."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rodgen.errors import RodgenError


def finite_number(name: str, value: object) -> float:
    """Return a dimension as a float.

    Raises
    ------
    RodgenError
        When it is not a finite number.
    """
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise RodgenError(f"{name} is {value!r}; expected a number") from None
    if not math.isfinite(number):
        raise RodgenError(f"{name} is {number}; expected a finite number")
    return number


def positive_length(name: str, value: object) -> float:
    """Return a dimension that is a positive length; errors as of `finite_number`."""
    number = finite_number(name, value)
    if not number > 0:
        raise RodgenError(f"{name} is {number}; expected a positive length")
    return number


def length_limits(limits: Sequence[float] | None, what: str) -> tuple[float, float]:
    """Return the least and the greatest length of a rod or a leg; 0 and infinity without limits.

    Raises
    ------
    RodgenError
        When they are not two numbers from 0 on, the smaller first.
    """
    if limits is None:
        return 0.0, math.inf
    if np.shape(limits) != (2,) or not 0 <= float(limits[0]) <= float(limits[1]):
        raise RodgenError(f"limits are {limits!r}; expected the least and the greatest length of a {what}")
    return float(limits[0]), float(limits[1])
