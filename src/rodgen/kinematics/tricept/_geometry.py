"""The dimensions of a Tricept, and the geometrical parameters on which the place of its tool depends.

The joints of the base lie on a circle of the radius R about its centre, at 0°, +120° and −120°, those of the platform
on one of the radius r in the same directions. The tool point is at q from the platform's centre.

The parameters are those of section 3, a) to g), of the paper. The first five are the paper's own choice. Joints A, B, C
of the base belong to the rods A0, A1, A-1, as do the joints A', B', C' of the platform, written Ap, Bp, Cp. Errors of
the guiding rod are explained in ``GUIDE``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import finite_number, positive_length
from rodgen.views import with_html


@with_html
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


RODS = ("A0", "A1", "A-1")
ZEROS = ("zero_A0", "zero_A1", "zero_A-1")
FIXED = tuple(f"{joint}_{axis}" for joint in "ABC" for axis in "xyz")
MOVING = tuple(f"{joint}p_{axis}" for joint in "ABC" for axis in "xyz")
TOOL = ("q_x", "q_y", "q_z")

GUIDE = {
    "P_x": "centre of the guiding rod's joint",
    "P_y": "centre of the guiding rod's joint",
    "P_z": "centre of the guiding rod's joint",
    "axis_x": "its first axis, turned about x",
    "axis_z": "its first axis, turned about z",
    "axes_gap": "distance between its two axes",
    "axes_square": "its two axes not at a right angle",
    "rod_x": "platform off the rod's axis",
    "rod_y": "platform off the rod's axis",
    "rod_z": "platform along the rod: the distance PP', which the rods' lengths take up",
    "rod_tilt": "rod not at a right angle to the second axis",
    "mount_x": "platform turned on the rod",
    "mount_y": "platform turned on the rod",
    "mount_z": "platform turned on the rod",
}
"""Errors of the guiding rod and its joint, in the kernels' order."""

ANGLES = frozenset({"axis_x", "axis_z", "axes_square", "rod_tilt", "mount_x", "mount_y", "mount_z"})
"""Parameters that are angles; all others are lengths."""

PARAMETERS = (*RODS, "r", "R", *ZEROS, *FIXED, *MOVING, *TOOL, *GUIDE)
"""All parameters, in the order of the sensitivity's columns."""

GROUPS = {
    "rods": RODS,
    "radii": ("r", "R"),
    "zeros": ZEROS,
    "fixed_joints": FIXED,
    "moving_joints": MOVING,
    "q": TOOL,
    "guide_lengths": tuple(name for name in GUIDE if name not in ANGLES),
    "guide_angles": tuple(name for name in GUIDE if name in ANGLES),
}
"""Parameters that usually share one uncertainty."""


def joints(geometry: Geometry) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the joints of the base and those of the platform, in its axes; a row each (3, 3)."""
    side = np.sqrt(3.0) / 2
    directions = np.array([[1.0, 0.0, 0.0], [-0.5, side, 0.0], [-0.5, -side, 0.0]])
    return geometry.R * directions, geometry.r * directions
