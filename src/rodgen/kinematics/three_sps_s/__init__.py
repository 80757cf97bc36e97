"""The 3-SPS-S machine: a platform that three legs turn about a ball joint, as in Zhou and Zhu (2023), section 5.1.

The legs stand at -30°, 90° and 210°; an orientation is a rotation matrix, from platform to machine axes. Functions take
arrays of any shape, with the components along the last axes, and a :class:`Geometry`; lengths are in one unit, angles
in rad.

>>> from rodgen import three_sps_s
>>> machine = three_sps_s.Geometry(R=2, r=1, h=1.5)
>>> rotations, count, status = three_sps_s.direct_all([3.171729016215, 2.536477604076, 3.262424470785], machine)
>>> int(count)
4
"""

from rodgen.kinematics.three_sps_s._direct import DirectStatus, direct, direct_all, follow
from rodgen.kinematics.three_sps_s._legs import (
    Geometry,
    Singularity,
    jacobian,
    legs,
    legs_from_quaternion,
    rotation_from_tilt_torsion,
    singularity,
    tilt_torsion,
)
from rodgen.kinematics.three_sps_s._workspace import (
    OrientationStatus,
    Workspace,
    orientation_status,
    workspace,
)

__all__ = [
    "DirectStatus",
    "Geometry",
    "OrientationStatus",
    "Singularity",
    "Workspace",
    "direct",
    "direct_all",
    "follow",
    "jacobian",
    "legs",
    "legs_from_quaternion",
    "orientation_status",
    "rotation_from_tilt_torsion",
    "singularity",
    "tilt_torsion",
    "workspace",
]
