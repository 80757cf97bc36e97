"""Is what was given an array of real numbers of the shape that is needed? If not, one sentence says what it is."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.errors import RodgenError

__all__ = ["real_array"]


def real_array(what: str, given: ArrayLike, ending: tuple[int, ...] = ()) -> NDArray[np.float64]:
    """Return an array of real numbers.

    Parameters
    ----------
    what : str
        What the error calls it, such as ``"the pose"``.
    given : array_like (..., *ending)
    ending : tuple of int, optional
        Its last axes.

    Raises
    ------
    RodgenError
        When it is no array of real numbers, or of another shape.

    Examples
    --------
    >>> real_array("the pose", [[1.0, 0.0]], (4, 4))
    Traceback (most recent call last):
    rodgen.errors.RodgenError: the pose has the shape (1, 2); expected (..., 4, 4)
    """
    expected = f"(..., {', '.join(map(str, ending))})" if ending else "real numbers"
    try:
        found: NDArray[Any] = np.asarray(given)
    except ValueError:  # rows of different lengths
        raise RodgenError(f"{what} is no array; expected {expected}") from None
    if found.dtype.kind not in "fiub":
        raise RodgenError(
            f"{what} is not of real numbers, but of the type {found.dtype}; expected {expected}"
        )
    if ending and found.shape[-len(ending) :] != ending:
        raise RodgenError(f"{what} has the shape {found.shape}; expected {expected}")
    return found.astype(float, copy=False)
