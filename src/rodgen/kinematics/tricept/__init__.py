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
from rodgen.kinematics.tricept._budget import Budget, BudgetLine, budget
from rodgen.kinematics.tricept._closure import disturbed_point
from rodgen.kinematics.tricept._covariance import check_covariance, covariance, is_covariance
from rodgen.kinematics.tricept._cube import Cube, largest_cube
from rodgen.kinematics.tricept._direct import direct_all
from rodgen.kinematics.tricept._geometry import LEG_LIMITS, PAPER, Geometry
from rodgen.kinematics.tricept._kinematics import direct, inverse, legs, point, pose, rotation
from rodgen.kinematics.tricept._matrices import (
    Matrices,
    Singularity,
    matrices,
    propagate,
    sensitivity,
    singularity,
)
from rodgen.kinematics.tricept._monte_carlo import (
    MonteCarlo,
    coverage_intervals,
    monte_carlo,
    numerical_tolerance,
)
from rodgen.kinematics.tricept._parameters import ANGLES, GROUPS, GUIDE, PARAMETERS
from rodgen.kinematics.tricept._uncertainty import (
    Ellipsoid,
    coverage_factor,
    ellipsoid,
    parameter_sensitivity,
    place_covariance,
)
from rodgen.kinematics.tricept._uncertainty_map import UncertaintyMap, uncertainty_map
from rodgen.kinematics.tricept._workspace import (
    Beams,
    Slice,
    Workspace,
    beams,
    reachable,
    workspace,
    workspace_slice,
)
from rodgen.kinematics.tricept.influence import Influence, influence_map, influence_region

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
    "Budget",
    "BudgetLine",
    "Cube",
    "Ellipsoid",
    "Geometry",
    "Influence",
    "Matrices",
    "MonteCarlo",
    "Singularity",
    "Slice",
    "TriceptStatus",
    "UncertaintyMap",
    "Workspace",
    "beams",
    "bounds",
    "budget",
    "check_covariance",
    "covariance",
    "coverage_factor",
    "coverage_intervals",
    "direct",
    "direct_all",
    "disturbed_point",
    "ellipsoid",
    "influence_map",
    "influence_region",
    "inverse",
    "is_covariance",
    "largest_cube",
    "legs",
    "matrices",
    "monte_carlo",
    "numerical_tolerance",
    "parameter_sensitivity",
    "place_covariance",
    "point",
    "pose",
    "propagate",
    "reachable",
    "rod_bounds",
    "rotation",
    "sensitivity",
    "singularity",
    "uncertainty_map",
    "workspace",
    "workspace_slice",
]
