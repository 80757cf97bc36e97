"""rodgen: the equations of rotating machines, derived, proved, generated as fast code, and fitted to measurements.

The functions here are numeric and need nothing but NumPy; SymPy is imported where something is derived.
"""

from importlib.metadata import version as _version

from rodgen._kernels import backend
from rodgen.axis import (
    AxisStatus,
    axis_condition,
    axis_covariance,
    axis_jacobian,
    length_mismatch,
    solve_axis,
)
from rodgen.axis_fit import AxisFit, AxisFitStatus, fit_axis
from rodgen.errors import RodgenError
from rodgen.rotation import (
    RotationStatus,
    axis_angle_from_matrix,
    axis_angle_from_quaternion,
    axis_angle_from_rodrigues_vector,
    matrix_from_axis_angle,
    matrix_from_quaternion,
    matrix_from_rodrigues_vector,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
    quaternion_from_rodrigues_vector,
    rodrigues_vector,
    rodrigues_vector_from_matrix,
    rodrigues_vector_from_quaternion,
    rotate,
)

__version__ = _version("rodgen")

__all__ = [
    "AxisFit",
    "AxisFitStatus",
    "AxisStatus",
    "RodgenError",
    "RotationStatus",
    "axis_angle_from_matrix",
    "axis_angle_from_quaternion",
    "axis_angle_from_rodrigues_vector",
    "axis_condition",
    "axis_covariance",
    "axis_jacobian",
    "backend",
    "fit_axis",
    "length_mismatch",
    "matrix_from_axis_angle",
    "matrix_from_quaternion",
    "matrix_from_rodrigues_vector",
    "quaternion_from_axis_angle",
    "quaternion_from_matrix",
    "quaternion_from_rodrigues_vector",
    "rodrigues_vector",
    "rodrigues_vector_from_matrix",
    "rodrigues_vector_from_quaternion",
    "rotate",
    "solve_axis",
]
