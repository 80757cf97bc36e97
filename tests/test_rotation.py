"""Rotations and conversions against scipy.spatial.transform, and round trips between all ways to write them."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

import rodgen
from rodgen import RotationStatus
from rodgen.kinematics import screws
from rodgen.kinematics.screws import ScrewStatus
from rodgen.symbolic import (
    DELTA,
    Derivation,
    axis_point,
    couple,
    equal,
    line_along,
    line_of_planes,
    line_through,
    matrix_from_rodrigues_vector,
    pitch,
    reciprocal_product,
    reciprocal_system,
    remainder,
    screw,
    screw_transform,
    self_product,
)

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


# Lines and screws: exact ones and numeric ones, against geometry that does not use them


ORIGIN = sp.zeros(3, 1)
X, Y, Z = (sp.eye(3)[:, i] for i in range(3))


def vector(name):
    return sp.Matrix(sp.symbols(f"{name}_1:4", real=True))


def vanishes(matrix):
    return all(remainder(part) == 0 for part in sp.Matrix([matrix]))


def test_a_line_is_the_same_by_two_points_and_by_point_and_direction():
    a, b = vector("a"), vector("b")
    assert vanishes(line_through(a, b) - line_along(a, b - a))
    assert vanishes(line_through(a, b) - line_along(b, b - a))
    assert remainder(self_product(line_through(a, b))) == 0


def test_the_line_of_two_planes_lies_in_both():
    n, m = vector("n"), vector("m")
    d, e, t = sp.symbols("d e t", real=True)
    line = line_of_planes(n, d, m, e)
    point = axis_point(line) + t * line[:3, 0]
    assert remainder(self_product(line)) == 0
    assert remainder(n.dot(point) - d) == 0
    assert remainder(m.dot(point) - e) == 0


def test_parallel_planes_meet_in_no_line_but_a_couple():
    assert line_of_planes(Z, 0, Z, 2) == couple(2 * Z)
    assert line_of_planes(Z, 2, Z, 2) == sp.zeros(6, 1)


def test_the_reciprocal_product_of_lines_is_length_times_distance_times_sine():
    # two perpendicular lines at distance 5
    assert reciprocal_product(line_along(ORIGIN, X), line_along(5 * Z, 2 * Y)) ** 2 == (2 * 5) ** 2
    p, s, t = vector("p"), vector("s"), vector("t")
    assert remainder(reciprocal_product(line_along(p, s), line_along(p, t))) == 0  # they meet
    assert remainder(reciprocal_product(line_along(p, s), line_along(2 * t, 3 * s))) == 0  # parallel
    assert reciprocal_product(line_along(ORIGIN, X), line_along(Z, Y)) != 0  # skew


def test_pitch_and_axis_of_a_screw_are_what_it_was_made_of():
    p, s = vector("p"), vector("s")
    h = sp.Symbol("h", real=True)
    made = screw(p, s, h)
    assert remainder(pitch(made) - h) == 0
    assert vanishes((axis_point(made) - p).cross(s))
    assert remainder(axis_point(made).dot(s)) == 0


def test_the_transform_keeps_every_reciprocal_product():
    R, p = matrix_from_rodrigues_vector(vector("theta")), vector("p")
    T = screw_transform(R, p)
    d = Derivation("transform", title="t", source="s")
    entry = d.check("t", equal(sp.ImmutableMatrix(T.T * DELTA * T), DELTA)).prove()
    assert entry.verdict == "proved"
    assert vanishes(
        screw_transform(R, p) * line_along(vector("a"), vector("s"))
        - line_along(R * vector("a") + p, R * vector("s"))
    )
    wrong = sp.Matrix(sp.BlockMatrix([[sp.eye(3), sp.zeros(3)], [sp.eye(3), sp.eye(3)]]).as_explicit())
    assert wrong.T * DELTA * wrong != DELTA


def test_what_is_reciprocal_to_three_axes_is_every_line_through_their_point():
    system = reciprocal_system([line_along(ORIGIN, axis) for axis in (X, Y, Z)])
    assert system.rank == 3
    assert system.line_condition(sp.symbols("c_1:4")) == 0
    assert system.contains(line_along(ORIGIN, X + 2 * Y))
    assert not system.contains(line_along(X, Y))


def test_dependent_screws_do_not_raise_the_rank():
    first, second = line_along(ORIGIN, X), line_along(Z, Y)
    system = reciprocal_system([first, second, 2 * first - 3 * second])
    assert system.rank == 2
    assert len(system.basis) == 4
    assert all(reciprocal_product(b, s) == 0 for b in system.basis for s in (first, second))


def test_a_rank_that_only_trigonometry_lowers_is_seen():
    angle = sp.Symbol("angle", real=True)
    c, s = sp.cos(angle), sp.sin(angle)
    turned = [line_along(ORIGIN, c * X + s * Y), line_along(ORIGIN, -s * X + c * Y)]
    system = reciprocal_system([*turned, line_along(ORIGIN, X)])
    assert system.rank == 2
    assert all(remainder(reciprocal_product(b, t)) == 0 for b in system.basis for t in turned)


def test_lines_among_the_screws_reciprocal_to_three_skew_lines_are_a_regulus():
    lines = [line_along(ORIGIN, X), line_along(Z, Y), line_along(X + Y, Z)]
    system = reciprocal_system(lines)
    form = system.form()
    assert system.rank == 3
    assert form.det() != 0  # no linear factor: one family, the lines of a ruled surface
    a, b = sp.symbols("a b")
    coefficients = [a, b, 1]
    root = sp.solve(system.line_condition(coefficients), a)[0]
    assert remainder(self_product(system.member([root, b, 1]))) == 0


def test_no_screws_leave_all_and_six_independent_ones_leave_none():
    assert len(reciprocal_system([]).basis) == 6
    six = [*(line_along(ORIGIN, axis) for axis in (X, Y, Z)), *(couple(axis) for axis in (X, Y, Z))]
    assert reciprocal_system(six).basis == ()
    assert reciprocal_system([sp.zeros(6, 1)]).rank == 0


# numbers


def random(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape)


def test_numeric_lines_are_the_exact_ones():
    a, b, n, m = random(4, 3)
    for numeric, exact in (
        (screws.line_through(a, b), line_through(sp.Matrix(a), sp.Matrix(b))),
        (screws.line_along(a, b, 0.3), screw(sp.Matrix(a), sp.Matrix(b), 0.3)),
        (
            screws.line_of_planes(n, 0.2, m, -0.7),
            line_of_planes(sp.Matrix(n), 0.2, sp.Matrix(m), -0.7),
        ),
    ):
        assert np.allclose(numeric, np.array(exact, float).ravel(), rtol=0, atol=1e-15)


def test_a_moved_frame_moves_points_and_keeps_products():
    turns = Rotation.from_rotvec(random(50, 3))
    p, a, b = random(3, 50, 3, seed=1)
    T = screws.transform(turns.as_matrix(), p)
    line, other = screws.line_through(a, b), screws.line_along(b, a, 0.4)
    moved = np.einsum("nij,nj->ni", T, line)
    assert np.allclose(moved, screws.line_through(turns.apply(a) + p, turns.apply(b) + p), atol=1e-13)
    product = screws.reciprocal_product(moved, np.einsum("nij,nj->ni", T, other))
    assert np.allclose(product, screws.reciprocal_product(line, other), atol=1e-12)


def test_axis_and_pitch_are_found_again_at_any_size():
    p, s = random(2, 40, 3, seed=2)
    h = random(40, seed=3)
    for size in (1e-200, 1.0, 1e200):
        axis = screws.screw_axis(screws.line_along(p, s, h) * size)
        assert np.allclose(np.cross(axis.direction, s), 0, atol=1e-14)
        assert np.allclose(np.cross(axis.point - p, s), 0, atol=1e-13)
        assert np.allclose(axis.pitch, h, atol=1e-13)
        assert (axis.status == ScrewStatus.SCREW).all()


def test_every_screw_that_is_none_is_named():
    made = [
        screws.line_along([1.0, 2, 3], [0.1, 0.7, 0.3]),
        [0, 0, 0, 0, 0, 2.0],
        [0] * 6,
        [np.nan, 0, 0, 0, 0, 1],
        [0, np.inf, 0, 0, 0, 1],
        [0, 0, 1.0, 0, 0, 1],
    ]
    axis = screws.screw_axis(made)
    assert list(axis.status) == [1, 2, 3, 4, 4, 0]
    assert axis.pitch[1] == np.inf
    assert np.isnan(axis.point[1:5]).all()
    assert np.array_equal(axis.direction[1], [0, 0, 1])
    assert np.isnan(axis.direction[2:5]).all()


def exact_rank(rows):
    return sp.Matrix(6, len(rows), lambda i, j: rows[j][i]).rank()


def test_rank_and_basis_agree_with_exact_elimination():
    rng = np.random.default_rng(4)
    for _ in range(30):
        rank = int(rng.integers(1, 7))
        rows = rng.integers(-3, 4, size=(6, rank)) @ rng.integers(-3, 4, size=(rank, 6))
        exact = exact_rank([[sp.Integer(int(x)) for x in row] for row in rows])
        system = screws.reciprocal_system(rows)
        assert system.rank == exact
        basis = system.basis[: 6 - exact]
        assert np.isnan(system.basis[6 - exact :]).all()
        assert np.allclose(basis @ basis.T, np.eye(6 - exact), atol=1e-14)
        size = max(1, np.abs(rows).max())
        assert np.allclose(screws.reciprocal_product(basis[:, None], rows), 0, atol=1e-13 * size)


def test_batches_ranks_of_nothing_and_lengths():
    lines = screws.line_through(random(7, 4, 3), random(7, 4, 3, seed=9) + np.array([0, 0, 2]))
    lines[0] = 0
    lines[1, 0, 0] = np.nan
    lines[2, 1:] = lines[2, :1]
    system = screws.reciprocal_system(lines, length=250.0)
    assert list(system.rank) == [0, -1, 1, 4, 4, 4, 4]
    assert np.isfinite(system.basis[0]).all()
    assert np.isnan(system.basis[1]).all()
    found = system.basis[3:, :2] / ([1.0] * 3 + [250.0] * 3)
    assert np.allclose(np.einsum("nik,njk->nij", found, found), np.eye(2), atol=1e-14)
    products = screws.reciprocal_product(system.basis[3:, :2, None], lines[3:, None])
    assert np.allclose(products, 0, atol=1e-12)
    assert screws.reciprocal_system(np.zeros((0, 6))).rank == 0


def test_wrong_shapes_and_numbers_are_an_error(refuses):
    refuses(screws.line_through, [1, 2], [1, 2, 3])
    refuses(screws.reciprocal_product, np.ones(6) * 1j, np.ones(6))
    refuses(screws.reciprocal_system, np.ones((2, 6)), length=0, raises=ValueError)
    refuses(screws.transform, np.ones(3), [0, 0, 0])
