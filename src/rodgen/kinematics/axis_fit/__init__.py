"""One axis of rotation from many noisy pairs: direction, point, uncertainty, and what is not determined."""

from rodgen.kinematics.axis_fit.fit import fit_axis
from rodgen.kinematics.axis_fit.result import AxisFit, AxisFitStatus

__all__ = ["AxisFit", "AxisFitStatus", "fit_axis"]
