"""The dimensions of a Tricept: two radii, the point on the platform, and the limits of its rods.

The joints of the base lie on a circle of the radius R about its centre, at 0°, +120° and −120°, those of the platform
on one of the radius r in the same directions. The tool point is at q from the platform's centre.
"""

from __future__ import annotations

from dataclasses import dataclass

from rodgen.errors import RodgenError
from rodgen.kinematics.dimensions import finite_number, positive_length
from rodgen.views import html_of


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

    _repr_html_ = html_of

    def __post_init__(self) -> None:
        for name in ("R", "r"):
            object.__setattr__(self, name, positive_length(name, getattr(self, name)))
        if not hasattr(self.q, "__len__") or len(self.q) != 3:
            raise RodgenError(f"q is {self.q!r}; expected three lengths")
        object.__setattr__(self, "q", tuple(finite_number("q", x) for x in self.q))

    @property
    def radii(self) -> tuple[float, float]:
        """The radii in the kernels' order, r before R, as in the paper's list of parameters."""
        return self.r, self.R


PAPER = Geometry(330.0, 140.0)
"""The machine of the paper's Table 1, in mm."""

LEG_LIMITS = (568.0, 858.0)
"""Least and greatest length of its rods, in mm."""
