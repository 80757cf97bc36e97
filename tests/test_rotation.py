"""Rotations and conversions against scipy.spatial.transform, and round trips between all ways to write them."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

import rodgen
from rodgen import RotationStatus

EPS = float(np.finfo(float).eps)
FEW = 16 * EPS
"""Conversions through the quaternion: some ten roundings of numbers near 1; SciPy's as many."""


def rotations(n: int = 500, seed: int = 1) -> Rotation:
    """Turns of all sizes from 1e-9 to near a half turn, about any axis."""
    rng = np.random.default_rng(seed)
    angle = np.concatenate(
        [rng.uniform(0, math.pi, n), 10.0 ** rng.uniform(-9, 0, n), math.pi - 10.0 ** rng.uniform(-6, 0, n)]
    )
    axis = rng.normal(size=(len(angle), 3))
    return Rotation.from_rotvec(axis / np.linalg.norm(axis, axis=1, keepdims=True) * angle[:, None])


TURNS = rotations()
AXIS = TURNS.as_rotvec() / TURNS.magnitude()[:, None]
FORMS = {
    "axis_angle": (AXIS, TURNS.magnitude()),
    "rodrigues_vector": (2 * np.tan(TURNS.magnitude() / 2)[:, None] * AXIS,),
    "matrix": (TURNS.as_matrix(),),
    "quaternion": (TURNS.as_quat(canonical=True, scalar_first=True),),
}


def convert(target: str, source: str, *values: object) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    name = (
        f"{target}_from_{source}"
        if (target, source) != ("rodrigues_vector", "axis_angle")
        else "rodrigues_vector"
    )
    *found, status = getattr(rodgen, name)(*values)
    return tuple(found), status


def as_rotation(form: str, values: tuple[np.ndarray, ...]) -> Rotation:
    if form == "axis_angle":
        return Rotation.from_rotvec(values[0] * values[1][..., None])
    if form == "rodrigues_vector":
        length = np.linalg.norm(values[0], axis=-1, keepdims=True)
        return Rotation.from_rotvec(
            values[0] * np.where(length > 0, 2 * np.arctan(length / 2) / np.maximum(length, 1e-300), 1)
        )
    if form == "matrix":
        return Rotation.from_matrix(values[0])
    return Rotation.from_quat(values[0], scalar_first=True)


both_ways = pytest.mark.parametrize(("source", "target"), list(permutations(FORMS, 2)))


@both_ways
def test_conversion_is_the_same_rotation_as_scipys(source: str, target: str) -> None:
    found, status = convert(target, source, *FORMS[source])
    assert (status == RotationStatus.ROTATION).all()
    difference = (as_rotation(target, found) * TURNS.inv()).magnitude()
    # near a half turn the Rodrigues vector is huge, and its length has the angle's last digits
    assert difference.max() <= FEW


@both_ways
def test_there_and_back(source: str, target: str) -> None:
    found, _ = convert(target, source, *FORMS[source])
    back, _ = convert(source, target, *found)
    for value, expected in zip(back, FORMS[source], strict=True):
        if (
            source == "rodrigues_vector"
        ):  # relative to its length, and to the angle's rounding near a half turn
            size = np.linalg.norm(expected, axis=1)
            error = np.linalg.norm(value - expected, axis=1) / (size * (1 + size / 2))
        elif (
            source == "axis_angle" and value.ndim == 2
        ):  # an axis is as exact as the turn is large, from a matrix
            error = np.linalg.norm(value - expected, axis=1) * (
                TURNS.magnitude() if target == "matrix" else 1
            )
        else:
            error = np.abs(value - expected)
        assert error.max() <= FEW


@pytest.mark.parametrize("source", FORMS)
def test_small_turns_keep_all_their_digits_but_in_a_matrix(source: str) -> None:
    angle = 10.0 ** np.arange(-300, 0, 10.0)
    axis = np.array([0.36, -0.48, 0.8])
    half = {
        "axis_angle": (np.broadcast_to(axis, (30, 3)), angle),
        "rodrigues_vector": (2 * np.tan(angle / 2)[:, None] * axis,),
        "quaternion": (np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis]),),
    }
    if source == "matrix":
        found, _ = convert(
            "rodrigues_vector", "matrix", Rotation.from_rotvec(angle[:, None] * axis).as_matrix()
        )
        np.testing.assert_allclose(found[0], angle[:, None] * axis, rtol=0.01, atol=4 * EPS)
        return
    found, status = (
        convert("axis_angle", source, *half[source]) if source != "axis_angle" else (half[source], 0)
    )
    if source != "axis_angle":
        assert (status == RotationStatus.ROTATION).all()
    np.testing.assert_allclose(found[0], np.broadcast_to(axis, (30, 3)), atol=FEW)
    np.testing.assert_allclose(found[1], angle, rtol=FEW)
    found, _ = convert("quaternion" if source != "quaternion" else "rodrigues_vector", source, *half[source])
    vector = found[0][:, 1:] if source != "quaternion" else found[0] / 2
    np.testing.assert_allclose(vector, np.tan(angle / 2)[:, None] * axis, rtol=0.01)


def test_rotate_is_scipys_rotation() -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(size=(len(AXIS), 3)) * 10.0 ** rng.integers(-100, 100, (len(AXIS), 1))
    turned = rodgen.rotate(points, FORMS["rodrigues_vector"][0])
    error = np.abs(turned - TURNS.apply(points)).max(axis=1) / np.linalg.norm(points, axis=1)
    assert error.max() <= FEW
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), np.linalg.norm(points, axis=1), rtol=FEW)


@pytest.mark.parametrize("size", [1e15, 1e16, 1e100, 1e300])
def test_rotate_by_a_half_turn_whatever_stands_for_infinity(size: float) -> None:
    axis = np.array([0.36, -0.48, 0.8])
    point = np.array([1.0, 2.0, 3.0])
    expected = 2 * (axis @ point) * axis - point
    np.testing.assert_allclose(rodgen.rotate(point, size * axis), expected, atol=FEW * 4 + 8 / size)


@pytest.mark.parametrize("source", ["axis_angle", "matrix", "quaternion"])
@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.8, 0], [2 / 3, -1 / 3, 2 / 3]])
def test_half_turns(source: str, axis: list[float]) -> None:
    e = np.array(axis, float)
    values = {
        "axis_angle": (e, math.pi),
        "matrix": (2 * np.outer(e, e) - np.eye(3),),
        "quaternion": (np.array([0.0, *e]),),
    }[source]
    for target in FORMS:
        if target == source:
            continue
        found, status = convert(target, source, *values)
        assert status == RotationStatus.HALF_TURN
        matrix = (
            rodgen.matrix_from_rodrigues_vector(found[0])[0]
            if target == "rodrigues_vector"
            else as_rotation(target, found).as_matrix()
        )
        np.testing.assert_allclose(matrix, 2 * np.outer(e, e) - np.eye(3), atol=FEW)


@pytest.mark.parametrize("source", FORMS)
def test_no_turn_is_the_identity(source: str) -> None:
    values = {
        "axis_angle": (np.array([0.0, 1, 0]), 0.0),
        "rodrigues_vector": (np.zeros(3),),
        "matrix": (np.eye(3),),
        "quaternion": (np.array([1.0, 0, 0, 0]),),
    }[source]
    for target in FORMS:
        if target != source:
            found, status = convert(target, source, *values)
            assert status == RotationStatus.IDENTITY
            assert as_rotation(target, found).magnitude() == 0
    if source != "axis_angle":
        (axis, angle), _ = convert("axis_angle", source, *values)
        assert axis.tolist() == [0, 0, 1]
        assert angle == 0


def test_input_that_is_not_normal_has_a_status_and_the_nearest_is_used() -> None:
    (matrix,), status = convert("matrix", "axis_angle", [0.0, 0.0, 1.001], 1.0)
    assert status == RotationStatus.NOT_NORMAL
    np.testing.assert_allclose(matrix, Rotation.from_rotvec([0, 0, 1]).as_matrix(), atol=FEW)
    (matrix,), status = convert("matrix", "quaternion", 1e200 * FORMS["quaternion"][0][0])
    assert status == RotationStatus.NOT_NORMAL
    np.testing.assert_allclose(matrix, FORMS["matrix"][0][0], atol=FEW)
    turn = Rotation.from_rotvec([0.3, 0.2, -0.5]).as_matrix()
    (quaternion,), status = convert(
        "quaternion", "matrix", turn + 1e-6 * np.random.default_rng(4).normal(size=(3, 3))
    )
    assert status == RotationStatus.NOT_NORMAL
    assert np.linalg.norm(quaternion) == pytest.approx(1, abs=FEW)
    np.testing.assert_allclose(Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), turn, atol=1e-5)


@given(arrays(float, (3, 3), elements=st.floats(allow_nan=True, allow_infinity=True)))
@settings(max_examples=120, deadline=None)
def test_any_matrix_gives_a_unit_quaternion_or_invalid(matrix: np.ndarray) -> None:
    (quaternion,), status = convert("quaternion", "matrix", matrix)
    if status == RotationStatus.INVALID:
        assert np.isnan(quaternion).all()
    else:
        assert np.linalg.norm(quaternion) == pytest.approx(1, abs=FEW)


@given(arrays(float, 4, elements=st.floats(allow_nan=True, allow_infinity=True)))
@settings(max_examples=120, deadline=None)
def test_any_quaternion_gives_a_rotation_matrix_or_invalid(quaternion: np.ndarray) -> None:
    (matrix,), status = convert("matrix", "quaternion", quaternion)
    if status == RotationStatus.INVALID:
        assert np.isnan(matrix).all()
        # the least subnormal numbers count as zero: their quarters are
        assert not np.isfinite(quaternion).all() or np.abs(quaternion).max() < 1e-322
    else:
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=FEW)
        assert np.linalg.det(matrix) == pytest.approx(1, abs=FEW)
