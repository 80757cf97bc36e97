"""What each slot of a reverse analysis holds."""

from enum import IntEnum

__all__ = ["ReverseStatus"]


class ReverseStatus(IntEnum):
    """What one slot of the solutions of a reverse analysis is.

    REGULAR: a solution that stands alone.
    DOUBLE: two solutions meet here.
    FAMILY: the representative of a one-parameter family of solutions.
    NONE: there is no solution in this slot; the value is NaN.
    INCOMPLETE: there is none here, but one may be missing; the value is NaN.
    INVALID: an input is not finite or no pose; the value is NaN.
    """

    REGULAR = 0
    DOUBLE = 1
    FAMILY = 2
    NONE = 3
    INCOMPLETE = 4
    INVALID = 5
