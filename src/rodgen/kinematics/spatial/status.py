"""Solutions of a reverse analysis, and the status of each slot, there and in those of two equations in two angles."""

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from rodgen.views import with_html


@with_html
class Reverse(NamedTuple):
    """The variables of every solution, with the status of each slot.

    Attributes
    ----------
    solutions : array (..., N, v)
        Variables in the order of the mechanism's `variables`, those of a loop that were given among them; angles in
        rad, in (-π, π]. Solutions come first; NaN in empty slots.
    status : array (..., N) of int8
        Codes of :class:`ReverseStatus`.
    """

    solutions: Any
    status: Any


class ReverseStatus(IntEnum):
    """The status of one slot in the solutions of a reverse analysis, or of two equations in two angles.

    REGULAR: a solution that stands alone.
    DOUBLE: two solutions or more meet here, to rounding; it is given once. Where four solutions of two equations meet,
        it may be given twice, within 1e-4 rad.
    FAMILY: the representative of a one-parameter family of solutions. Two equations have one by a common factor.
    NONE: this slot holds no solution; the value is NaN.
    INCOMPLETE: this slot is empty, but a solution may be missing; the value is NaN.
    INVALID: an input is not finite or no pose; the value is NaN.
    """

    REGULAR = 0
    DOUBLE = 1
    FAMILY = 2
    NONE = 3
    INCOMPLETE = 4
    INVALID = 5


def solutions_first(values: Any, status: Any) -> tuple[Any, Any]:
    """Return slots that hold a solution first, in their order: values (n, m, v) and statuses (n, m)."""
    order = np.argsort(status >= ReverseStatus.NONE, axis=-1, kind="stable")
    return np.take_along_axis(values, order[..., None], axis=1), np.take_along_axis(status, order, axis=1)
