"""What a Tricept is made of: two radii, the point on the platform, and how long its rods may be.

The joints of the base lie on a circle of the radius R about its centre, at 0°, +120° and −120°, those of the platform
on one of the radius r in the same directions. The point whose position counts is at q from the platform's centre.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rodgen.errors import RodgenError

__all__ = ["LEG_LIMITS", "PAPER", "Geometry", "kernel_limits"]


def _number(value: object, name: str) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise RodgenError(f"{name} is {value!r}; expected a number") from None
    if not math.isfinite(number):
        raise RodgenError(f"{name} is {number}; expected a finite number")
    return number


@dataclass(frozen=True)
class Geometry:
    """The fixed dimensions of a Tricept, in one unit of length.

    Parameters
    ----------
    R, r : float
        Radii of the joints of the base and of the platform.
    q : sequence of three floats, optional
        The point of the platform, in its own axes, from its centre; that centre when left out.

    Raises
    ------
    RodgenError
        When a radius is not positive, or a number not finite.

    Examples
    --------
    >>> Geometry(330, 140).q
    (0.0, 0.0, 0.0)
    """

    R: float
    r: float
    q: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("R", "r"):
            object.__setattr__(self, name, _number(getattr(self, name), name))
            if not getattr(self, name) > 0:
                raise RodgenError(f"{name} is {getattr(self, name)}; expected a positive length")
        if not hasattr(self.q, "__len__") or len(self.q) != 3:
            raise RodgenError(f"q is {self.q!r}; expected three lengths")
        object.__setattr__(self, "q", tuple(_number(x, "q") for x in self.q))

    @property
    def radii(self) -> tuple[float, float]:
        """The radii in the kernels' order, r before R, as in the paper's list of parameters."""
        return self.r, self.R


PAPER = Geometry(330.0, 140.0)
"""The machine of the paper's Table 1, in mm."""

LEG_LIMITS = (568.0, 858.0)
"""Least and greatest length of its rods, in mm."""


def kernel_limits(limits: Sequence[float] | None) -> tuple[float, float]:
    """Return limits of the rods as the kernels take them.

    Raises
    ------
    RodgenError
        When they are not two numbers, the smaller first.
    """
    if limits is None:
        return 0.0, math.inf
    if len(limits) != 2 or not 0 <= float(limits[0]) <= float(limits[1]):
        raise RodgenError(f"limits are {limits!r}; expected the least and the greatest length of a rod")
    return float(limits[0]), float(limits[1])
