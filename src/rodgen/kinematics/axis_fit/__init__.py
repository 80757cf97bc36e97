"""One axis of rotation from many noisy pairs: direction, point, uncertainty, and what is not determined."""

from rodgen.kinematics.axis_fit._fit import fit_axis
from rodgen.kinematics.axis_fit._result import AxisFit, AxisFitStatus

__all__ = ["AxisFit", "AxisFitStatus", "fit_axis"]
