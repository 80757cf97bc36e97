"""Kinematics and calibration of machines: proved equations, generated code, and diagnosis of errors.

A name is imported when it is first asked for, so that nobody waits for what is not used. The functions in `__all__` are
numeric and need nothing but NumPy; SymPy is imported where something is derived.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from rodgen import facade as _facade  # noqa: F401

if _TYPE_CHECKING:
    from rodgen.calibration.simulate import simulate as simulate
    from rodgen.calibration.watch import Watch as Watch
    from rodgen.calibration.watch.file import watch as watch
    from rodgen.data.measurements import Measurements as Measurements
    from rodgen.errors import RodgenError
    from rodgen.facade import Fit as Fit
    from rodgen.facade import Machine as Machine
    from rodgen.kinematics import axis_fit as axis_fit
    from rodgen.kinematics import delta as delta
    from rodgen.kinematics import hexapod as hexapod
    from rodgen.kinematics import instantaneous_euler as instantaneous_euler
    from rodgen.kinematics import screws as screws
    from rodgen.kinematics import spatial as spatial
    from rodgen.kinematics import three_sps_s as three_sps_s
    from rodgen.kinematics import tricept as tricept
    from rodgen.kinematics.axis import (
        AxisStatus,
        axis_condition,
        axis_covariance,
        axis_jacobian,
        length_mismatch,
        solve_axis,
    )
    from rodgen.kinematics.axis_fit import AxisFit, AxisFitStatus, fit_axis
    from rodgen.kinematics.backend import backend
    from rodgen.kinematics.rotation import (
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
    from rodgen.machines.imports.files import import_files as import_files
    from rodgen.machines.machine import Joint as Joint
    from rodgen.machines.machine import Measured as Measured
    from rodgen.machines.machine import Target as Target
    from rodgen.output import figures as figures
    from rodgen.output.report import write_report as write_report

    __version__: str

_NUMERIC = (
    "rodgen.errors",
    "rodgen.kinematics.backend",
    "rodgen.kinematics.rotation",
    "rodgen.kinematics.axis",
    "rodgen.kinematics.axis_fit",
)
"""Modules of the names in __all__, those that are imported soonest first."""
# Not in __all__: "from rodgen import *" must do with NumPy alone.
_LATER = {
    "Fit": "rodgen.calibration.fit",
    "Joint": "rodgen.machines.machine",
    "Machine": "rodgen.machines.machine",
    "Measured": "rodgen.machines.machine",
    "Measurements": "rodgen.data.measurements",
    "write_report": "rodgen.output.report",
    "Target": "rodgen.machines.machine",
    "Watch": "rodgen.calibration.watch",
    "import_files": "rodgen.machines.imports.files",
    "simulate": "rodgen.calibration.simulate",
    "watch": "rodgen.calibration.watch.file",
}
_SUBJECTS = {
    "figures": "rodgen.output.figures",
    "axis_fit": "rodgen.kinematics.axis_fit",
    "delta": "rodgen.kinematics.delta",
    "hexapod": "rodgen.kinematics.hexapod",
    "instantaneous_euler": "rodgen.kinematics.instantaneous_euler",
    "screws": "rodgen.kinematics.screws",
    "spatial": "rodgen.kinematics.spatial",
    "three_sps_s": "rodgen.kinematics.three_sps_s",
    "tricept": "rodgen.kinematics.tricept",
}

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


def __getattr__(name: str) -> _Any:
    if name in _SUBJECTS:
        return _import_module(_SUBJECTS[name])
    attribute: _Any
    if name in __all__:
        modules = map(_import_module, _NUMERIC)
        attribute = next(getattr(module, name) for module in modules if name in module.__all__)
    elif name in _LATER:
        attribute = getattr(_import_module(_LATER[name]), name)
    elif name == "__version__":
        from importlib.metadata import version

        attribute = version("rodgen")
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = attribute
    return attribute


def __dir__() -> list[str]:
    return sorted({*globals(), "__version__", *__all__, *_LATER, *_SUBJECTS})
