"""The status of each slot in the solutions of two equations in two angles."""

from enum import IntEnum

__all__ = ["SLOTS", "PairStatus"]

SLOTS = 8
"""Two equations without a common factor have no more solutions than the octic has roots."""


class PairStatus(IntEnum):
    """The status of one slot in the solutions of two equations in two angles.

    REGULAR: a solution that stands alone.
    DOUBLE: two solutions or more meet here, to rounding; it is given once.
    COMMON_FACTOR: one of a family: the equations have a common factor, and this solves it.
    NONE: there is no solution in this slot; the angles are NaN.
    INCOMPLETE: this slot is empty, but a solution may be missing; the angles are NaN.
    INVALID: a coefficient is not finite; the angles are NaN.
    """

    REGULAR = 0
    DOUBLE = 1
    COMMON_FACTOR = 2
    NONE = 3
    INCOMPLETE = 4
    INVALID = 5
