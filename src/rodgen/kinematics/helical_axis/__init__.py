"""The axis of screws, finite and instantaneous: from points or poses, with angles and slides that are not known."""

from rodgen.kinematics.helical_axis.fit import fit_helical_axis, fit_pose_axis
from rodgen.kinematics.helical_axis.instantaneous import InstantaneousAxes, instantaneous_axes
from rodgen.kinematics.helical_axis.result import HelicalAxis

__all__ = ["HelicalAxis", "InstantaneousAxes", "fit_helical_axis", "fit_pose_axis", "instantaneous_axes"]
