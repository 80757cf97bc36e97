"""Instantaneous Euler angles: by how much each coordinate plane has turned, and about which line.

A body that turns by R takes each coordinate plane into another one. The angles between them are the instantaneous
Euler angles χ_i = arccos(e_i · R e_i) of Zhou and Zhu (2023), the lines in which they meet the ridge lines. Three
angles belong to up to eight rotations; a ridge line says which. Labels are those of the definitions, equations (10),
(13) and (16): χ_x is the angle between the yz planes; equations (18) and (20) exchange x and z, which
the derivation lists with the rest.

Functions take arrays of any shape, with components along the last axis, angles in rad; they return a status an
element.

>>> import numpy as np
>>> from rodgen import instantaneous_euler as ie
>>> chi, status = ie.angles_from_euler(np.radians([30.0, 40.0, 50.0]), "ZYX")
>>> np.degrees(chi).round(3)
array([48.439, 36.595, 60.501])
>>> ie.rotations(chi).count
np.int64(8)
"""

from rodgen.generated.numpy.instantaneous_euler import AngleStatus
from rodgen.generated.numpy.instantaneous_euler_inverse import RotationsStatus
from rodgen.generated.numpy.instantaneous_euler_motion import MotionStatus
from rodgen.generated.numpy.instantaneous_euler_ridges import RidgeStatus
from rodgen.kinematics.instantaneous_euler._angles import (
    Rates,
    angles_from_euler,
    angles_from_matrix,
    angles_from_quaternion,
    angular_velocity,
    euler_from_matrix,
    euler_from_quaternion,
    motion_from_euler,
    rates,
)
from rodgen.kinematics.instantaneous_euler._rotations import (
    Choice,
    ChoiceStatus,
    Rotations,
    arm_pose,
    choose,
    ridge_lines,
    rotations,
)
from rodgen.kinematics.instantaneous_euler._trajectory import PathStatus, Trajectory, trajectory
from rodgen.kinematics.instantaneous_euler.sequences import SEQUENCES

__all__ = [
    "SEQUENCES",
    "AngleStatus",
    "Choice",
    "ChoiceStatus",
    "MotionStatus",
    "PathStatus",
    "Rates",
    "RidgeStatus",
    "Rotations",
    "RotationsStatus",
    "Trajectory",
    "angles_from_euler",
    "angles_from_matrix",
    "angles_from_quaternion",
    "angular_velocity",
    "arm_pose",
    "choose",
    "euler_from_matrix",
    "euler_from_quaternion",
    "motion_from_euler",
    "rates",
    "ridge_lines",
    "rotations",
    "trajectory",
]
