"""Public functions refuse arrays with masked elements: they computed with what is behind the mask."""

from __future__ import annotations

import numpy as np
import pytest

import rodgen
from rodgen import instantaneous_euler, screws, three_sps_s, tricept

VECTOR = np.ma.array(np.eye(3)[:2], mask=[[0, 0, 1], [0, 0, 0]])
ANGLE = np.ma.array([0.1, 0.2], mask=[0, 1])
QUATERNION = np.ma.array([[1.0, 0, 0, 0]], mask=[[0, 1, 0, 0]])
MATRIX = np.ma.array([np.eye(3)], mask=np.eye(3, dtype=bool)[None])
PLATFORM = three_sps_s.Geometry(1.0, 0.5, 0.8)

CALLS = {
    "rotate": lambda: rodgen.rotate(VECTOR, [0, 0, 1.0]),
    "rotate by": lambda: rodgen.rotate([1.0, 0, 0], VECTOR),
    "solve_axis": lambda: rodgen.solve_axis(VECTOR, np.eye(3)[:2], [0.1, 0.2]),
    "fit_axis": lambda: rodgen.fit_axis(np.eye(3)[:2], np.eye(3)[:2], ANGLE),
    "axis_condition": lambda: rodgen.axis_condition(VECTOR, VECTOR, ANGLE),
    "matrix_from_axis_angle": lambda: rodgen.matrix_from_axis_angle(np.eye(3)[:2], ANGLE),
    "matrix_from_quaternion": lambda: rodgen.matrix_from_quaternion(QUATERNION),
    "in a list": lambda: rodgen.rotate([VECTOR[1], VECTOR[0]], [0, 0, 1.0]),
    "tricept in a tuple": lambda: tricept.pose((VECTOR[0],), tricept.PAPER),
    "screws": lambda: screws.line_through(VECTOR, np.eye(3)[:2] + 1),
    "angles_from_euler": lambda: instantaneous_euler.angles_from_euler(VECTOR, "xyz"),
    "angles_from_matrix": lambda: instantaneous_euler.angles_from_matrix(MATRIX),
    "euler_from_quaternion": lambda: instantaneous_euler.euler_from_quaternion(QUATERNION, "xyz"),
    "rotations": lambda: instantaneous_euler.rotations(VECTOR),
    "trajectory": lambda: instantaneous_euler.trajectory(QUATERNION),
    "choose": lambda: instantaneous_euler.choose(VECTOR, x=0.1),
    "legs": lambda: three_sps_s.legs(MATRIX, PLATFORM),
    "rotation_from_tilt_torsion": lambda: three_sps_s.rotation_from_tilt_torsion(ANGLE, 0.1, 0.1),
    "tricept": lambda: tricept.pose(VECTOR, tricept.PAPER),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_masked_elements_are_refused(refuses, call):
    refuses(call)


def test_an_array_with_an_empty_mask_is_an_array():
    given = np.ma.array([1.0, 0, 0], mask=[0, 0, 0])
    np.testing.assert_array_equal(rodgen.rotate(given, [0, 0, 1.0]), rodgen.rotate(given.data, [0, 0, 1.0]))


def test_a_masked_cell_of_measurements_is_an_empty_cell(refuses):
    refuses(rodgen.Measurements.from_frame, {"x [mm]": ANGLE})
