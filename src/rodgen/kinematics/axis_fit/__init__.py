"""One axis from many readings: direction, point, angles, slides, uncertainty, and what is not determined."""

from rodgen.kinematics.axis_fit.fit import fit_axis
from rodgen.kinematics.axis_fit.instantaneous import InstantaneousAxes, instantaneous_axes
from rodgen.kinematics.axis_fit.result import AxisFit, AxisFitStatus, Motions
from rodgen.kinematics.axis_fit.screws import fit_pose_axis

__all__ = [
    "AxisFit",
    "AxisFitStatus",
    "InstantaneousAxes",
    "Motions",
    "fit_axis",
    "fit_pose_axis",
    "instantaneous_axes",
]
