"""The Tricept: three telescopic rods and a middle rod that slides and swings, as Kureková et al. (2015) treat it.

A pose is (α, β, z), the rods are A0, A1, A-1 at 0°, +120° and −120°, the parameters of an uncertainty are A0, A1, A-1,
r, R. Functions take arrays of any shape, with the components along the last axis, and a :class:`Geometry`; lengths are
in one unit, angles in rad.

>>> from rodgen import tricept
>>> pose, status = tricept.direct([650.0, 700.0, 760.0], tricept.PAPER)
>>> tricept.point(pose, tricept.PAPER).round(3)
array([112.982,  75.326, 664.245])
"""

from rodgen.generated.numpy.tricept import TriceptStatus
from rodgen.kinematics.tricept._bounds import ELEMENTS, Bounds, bounds, rod_bounds
from rodgen.kinematics.tricept._geometry import ANGLES, GROUPS, GUIDE, LEG_LIMITS, PAPER, PARAMETERS, Geometry
from rodgen.kinematics.tricept._kinematics import (
    direct,
    direct_all,
    disturbed_point,
    inverse,
    legs,
    point,
    pose,
    rotation,
)
from rodgen.kinematics.tricept._uncertainty import (
    Ellipsoid,
    Matrices,
    Singularity,
    covariance,
    ellipsoid,
    is_covariance,
    matrices,
    parameter_sensitivity,
    propagate,
    singularity,
)
from rodgen.kinematics.tricept._workspace import (
    Beams,
    UncertaintyMap,
    Workspace,
    beams,
    reachable,
    uncertainty_map,
    workspace,
)

__all__ = [
    "ANGLES",
    "ELEMENTS",
    "GROUPS",
    "GUIDE",
    "LEG_LIMITS",
    "PAPER",
    "PARAMETERS",
    "Beams",
    "Bounds",
    "Ellipsoid",
    "Geometry",
    "Matrices",
    "Singularity",
    "TriceptStatus",
    "UncertaintyMap",
    "Workspace",
    "beams",
    "bounds",
    "covariance",
    "direct",
    "direct_all",
    "disturbed_point",
    "ellipsoid",
    "inverse",
    "is_covariance",
    "legs",
    "matrices",
    "parameter_sensitivity",
    "point",
    "pose",
    "propagate",
    "reachable",
    "rod_bounds",
    "rotation",
    "singularity",
    "uncertainty_map",
    "workspace",
]
