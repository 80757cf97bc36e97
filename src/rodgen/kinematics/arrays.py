"""Checks of arguments: arrays of real numbers with the last axes that a function expects, lengths and limits."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError, joined

_FLOAT64 = np.dtype(np.float64)


class NotRealError(RodgenError, TypeError):
    """Raised for an array whose numbers are not real; caught as a TypeError, too."""


def has_masked(given: object) -> bool:
    """Return whether an array, or one in lists of them, has masked elements."""
    if "numpy.ma" not in sys.modules:  # NumPy imports it when it is first used
        return False
    if isinstance(given, list | tuple):
        return any(map(has_masked, given))
    return isinstance(given, np.ma.MaskedArray) and bool(np.ma.is_masked(given))


def refuse_masked(what: str, given: object) -> None:
    """Refuse an array with masked elements: what is behind a mask would be computed with.

    Raises
    ------
    RodgenError

    Examples
    --------
    >>> refuse_masked("rho", np.ma.array([1.0, 2.0], mask=[False, True]))
    Traceback (most recent call last):
    rodgen.errors.RodgenError: rho has masked elements; expected numbers: leave the others out, or fill them with NaN
    """
    if has_masked(given):
        raise RodgenError(
            f"{what} has masked elements; expected numbers: leave the others out, or fill them with NaN"
        )


def real_array(what: str, given: ArrayLike, ending: tuple[int, ...] = ()) -> NDArray[np.float64]:
    """Return an array of real numbers.

    Parameters
    ----------
    what : str
        The name in an error, such as ``"the pose"``.
    given : array_like (..., *ending)
    ending : tuple of int, optional
        Its last axes.

    Raises
    ------
    NotRealError
        When it does not hold real numbers.
    RodgenError
        When it is not an array, has masked elements, or its last axes have another shape.

    Examples
    --------
    >>> real_array("the pose", [[1.0, 0.0]], (4, 4))
    Traceback (most recent call last):
    rodgen.errors.RodgenError: the pose has the shape (1, 2); expected (..., 4, 4)
    """
    refuse_masked(what, given)
    try:
        array = np.asarray(given)
    except ValueError:  # rows of different lengths
        raise RodgenError(f"{what} is not an array; expected {_ending(ending)}") from None
    if array.dtype is not _FLOAT64:
        if array.dtype.kind not in "fiub":
            raise NotRealError(f"{what} has the type {array.dtype}; expected real numbers")
        array = array.astype(float, copy=False)
    if ending and array.shape[-len(ending) :] != ending:
        raise RodgenError(f"{what} has the shape {array.shape}; expected {_ending(ending)}")
    return array


def not_broadcast(arguments: Mapping[str, Any]) -> RodgenError:
    """Return the error for arguments whose shapes do not fit together.

    Examples
    --------
    >>> print(not_broadcast({"rho": np.ones((3, 3)), "rho_prime": np.ones((2, 3)), "angle": 1.0}))
    rho (3, 3) and rho_prime (2, 3) do not fit together; expected shapes that broadcast
    """
    shapes = [f"{name} {np.shape(given)}" for name, given in arguments.items() if np.ndim(given)]
    return RodgenError(f"{joined(shapes)} do not fit together; expected shapes that broadcast")


def broadcast_shapes(arguments: Mapping[str, tuple[NDArray[np.float64], int]]) -> tuple[int, ...]:
    """Return the shape that arguments have together, each without so many of its last axes.

    Raises
    ------
    RodgenError
        When they do not fit together.
    """
    try:
        return np.broadcast_shapes(*(given.shape[: given.ndim - axes] for given, axes in arguments.values()))
    except ValueError:
        raise not_broadcast({name: given for name, (given, _) in arguments.items()}) from None


def _ending(ending: tuple[int, ...]) -> str:
    return f"(..., {', '.join(map(str, ending))})" if ending else "real numbers"


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
