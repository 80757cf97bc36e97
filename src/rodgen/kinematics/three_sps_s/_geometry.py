"""The dimensions of a 3-SPS-S machine: two radii and the height of the pivot.

The joints on the base stand at -30°, 90° and 210° on a circle of the radius R in the plane z = 0; those on the platform
in the same directions on one of the radius r, in the plane of the pivot (0, 0, h), when the platform is not turned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rodgen.kinematics.dimensions import finite_number, positive_length
from rodgen.views import html_of


@dataclass(frozen=True)
class Geometry:
    """The fixed dimensions of a 3-SPS-S machine, in one unit of length.

    Parameters
    ----------
    R, r : float
        Radii of the joints on the base and on the platform.
    h : float
        Height of the pivot over the base.

    Raises
    ------
    RodgenError
        When a radius is not positive, or a number not finite.

    Examples
    --------
    >>> from rodgen import three_sps_s
    >>> three_sps_s.Geometry(2, 1, 1.5).home_leg.__round__(6)
    1.802776
    """

    R: float
    r: float
    h: float

    _repr_html_ = html_of

    def __post_init__(self) -> None:
        for name, check in (("R", positive_length), ("r", positive_length), ("h", finite_number)):
            object.__setattr__(self, name, check(name, getattr(self, name)))

    @property
    def lengths(self) -> tuple[float, float, float]:
        """R, r and h, in the kernels' order."""
        return self.R, self.r, self.h

    @property
    def home_leg(self) -> float:
        """Length of each leg when the platform is not turned."""
        return math.hypot(self.R - self.r, self.h)
