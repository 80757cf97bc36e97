"""The geometrical parameters on which the place of a Tricept's tool depends: section 3, a) to g), of the paper.

The first five are the paper's own choice. Joints A, B, C of the base belong to the rods A0, A1, A-1, as do the joints
A', B', C' of the platform, written Ap, Bp, Cp. Errors of the guiding rod are explained in ``GUIDE``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rodgen.kinematics.tricept._geometry import Geometry

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
