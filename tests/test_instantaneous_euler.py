"""Instantaneous Euler angles, ridge lines, rates and trajectories, against SciPy's rotations and many digits."""

from __future__ import annotations

import inspect
import re

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

import rodgen
from rodgen.errors import RodgenError
from rodgen.kinematics import instantaneous_euler as ie

EPS = float(np.finfo(float).eps)
FEW = 16 * EPS
"""Some ten roundings of numbers near 1, here and in SciPy."""
EVERY = [*ie.SEQUENCES, *(name.lower() for name in ie.SEQUENCES)]
RNG = np.random.default_rng(5)
TURNS = Rotation.random(400, random_state=3)
MATRICES = TURNS.as_matrix()
finite_angles = arrays(float, 3, elements=st.floats(-10, 10))


def names(enum: type, codes: object) -> list[str]:
    return [enum(int(code)).name for code in np.ravel(codes)]


def exact_angles(quaternion: np.ndarray) -> list[mpmath.mpf]:
    """Arccosines of the diagonal of the matrix, with 80 digits."""
    with mpmath.workdps(80):
        q = [mpmath.mpf(float(x)) for x in quaternion]
        square = sum(x * x for x in q)
        return [
            mpmath.acos((q[0] ** 2 + q[i] ** 2 - q[j] ** 2 - q[k] ** 2) / square)
            for i, j, k in ((1, 2, 3), (2, 3, 1), (3, 1, 2))
        ]


# angles ------------------------------------------------------------------------------------------------


def test_angles_are_the_arccosines_of_the_diagonal() -> None:
    expected = np.arccos(np.diagonal(MATRICES, axis1=1, axis2=2))
    chi, status = ie.angles_from_matrix(MATRICES)
    assert (status == ie.AngleStatus.ANGLES).all()
    # arccos itself turns a rounding of the cosine into one over the sine
    assert (np.abs(chi - expected) <= FEW / np.sin(expected)).all()
    of_quaternion, _ = ie.angles_from_quaternion(TURNS.as_quat(scalar_first=True))
    np.testing.assert_allclose(of_quaternion, chi, atol=FEW)


@pytest.mark.parametrize("sequence", EVERY)
def test_angles_of_every_sequence(sequence: str) -> None:
    angles = RNG.uniform(-4, 4, (200, 3))
    expected = np.diagonal(Rotation.from_euler(sequence, angles).as_matrix(), axis1=1, axis2=2)
    chi, _ = ie.angles_from_euler(angles, sequence)
    np.testing.assert_allclose(np.cos(chi), expected, atol=FEW)


def test_example_of_the_paper_s_sequences() -> None:
    """ZYX and ZYZ at (30, 40, 50) degrees, from cosines written by hand."""
    a, b, c = np.radians([30, 40, 50])
    zyx = [
        np.cos(a) * np.cos(b),
        np.sin(a) * np.sin(b) * np.sin(c) + np.cos(a) * np.cos(c),
        np.cos(b) * np.cos(c),
    ]
    np.testing.assert_allclose(ie.angles_from_euler([a, b, c])[0], np.arccos(zyx), atol=FEW)
    zyz = [
        np.cos(a) * np.cos(b) * np.cos(c) - np.sin(a) * np.sin(c),
        np.cos(a) * np.cos(c) - np.sin(a) * np.cos(b) * np.sin(c),
        np.cos(b),
    ]
    np.testing.assert_allclose(ie.angles_from_euler([a, b, c], "ZYZ")[0], np.arccos(zyz), atol=FEW)


@pytest.mark.parametrize("size", [1e-2, 1e-5, 1e-8, 1e-12, 1e-100, 1e-200])
def test_small_angles_keep_all_digits(size: float) -> None:
    """An arccosine of a double has none left at 1e-8; the half-angle form loses a few units in the last place."""
    for axis in np.concatenate([np.eye(3), RNG.normal(size=(5, 3))]):
        vector = size * axis / np.linalg.norm(axis)
        quaternion = np.array([1.0, *vector])
        chi, _ = ie.angles_from_quaternion(quaternion / np.linalg.norm(quaternion))
        # by the small angle: 2 |the part across the axis|, to a relative size²
        across = [2 * mpmath.hypot(*(mpmath.mpf(float(x)) for x in np.delete(vector, i))) for i in range(3)]
        for found, expected in zip(chi, across, strict=True):
            assert abs(found - expected) <= (8 * EPS + size**2) * expected
        if size >= 1e-12:
            for found, expected in zip(chi, exact_angles(quaternion), strict=True):
                assert abs(found - expected) <= 8 * EPS * expected


@pytest.mark.parametrize("off", [0.0, 1e-2, 1e-6, 1e-9, 1e-13])
def test_angles_near_half_turns_are_right_to_their_last_digits(off: float) -> None:
    for i in range(3):
        quaternion = np.array([off, 0.3 * off, -0.2 * off, 0.5 * off])
        quaternion[1 + i] = 1
        quaternion /= np.linalg.norm(quaternion)
        chi, _ = ie.angles_from_quaternion(quaternion)
        for found, expected in zip(chi, exact_angles(quaternion), strict=True):
            assert abs(found - expected) <= 4 * EPS * np.pi
    # the arccosine, for comparison, is off by the root of the rounding
    assert abs(np.arccos(np.cos(np.pi - 1e-9)) - (np.pi - 1e-9)) > 1e-10


def test_small_turns_of_a_matrix_keep_their_digits() -> None:
    """The angles come from the off-diagonal elements, which have them, not from the diagonal, which is 1."""
    size = 10.0 ** np.arange(-15, -2)
    vectors = size[:, None] * [0.36, -0.48, 0.8]
    chi, _ = ie.angles_from_matrix(Rotation.from_rotvec(vectors).as_matrix())
    expected = np.stack([np.hypot(*np.delete(vectors, i, axis=1).T) for i in range(3)], axis=1)
    np.testing.assert_allclose(chi, expected, rtol=1e-5, atol=0)  # to size², the next term of the sine


@pytest.mark.parametrize(
    ("matrix", "name"),
    [
        (np.eye(3), "IDENTITY"),
        (Rotation.from_rotvec([0, 0, 1.0]).as_matrix(), "NO_RIDGE"),
        (np.diag([-1.0, -1, 1]), "NO_RIDGE"),
        (1.01 * Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix(), "NOT_NORMAL"),
        (np.diag([1.0, 1, -1]), "INVALID"),
        (np.full((3, 3), np.nan), "INVALID"),
        (np.zeros((3, 3)), "INVALID"),
    ],
)
def test_status_of_angles(matrix: np.ndarray, name: str) -> None:
    chi, status = ie.angles_from_matrix(matrix)
    assert names(ie.AngleStatus, status) == [name]
    assert np.isnan(chi).all() == (name == "INVALID")


def test_a_matrix_out_of_shape_gives_the_angles_of_its_rotation() -> None:
    scaled, _ = ie.angles_from_matrix(1.01 * MATRICES)
    np.testing.assert_allclose(scaled, ie.angles_from_matrix(MATRICES)[0], atol=0.02)


@given(finite_angles)
@settings(max_examples=200, deadline=None)
def test_properties_of_the_three_angles(angles: np.ndarray) -> None:
    matrix = Rotation.from_euler("ZYX", angles).as_matrix()
    chi, _ = ie.angles_from_matrix(matrix)
    back, _ = ie.angles_from_matrix(matrix.T)
    np.testing.assert_allclose(chi, back, atol=1e-15)  # the inverse has the same
    total = Rotation.from_matrix(matrix).magnitude()
    assert np.cos(chi).sum() == pytest.approx(1 + 2 * np.cos(total), abs=FEW)
    assert (chi <= total + FEW).all()
    s = np.sin(chi / 2) ** 2
    assert (2 * s <= s.sum() + FEW).all()
    assert s.sum() <= 2 + FEW
    swing, _ = ie.angles_from_euler(angles)
    np.testing.assert_allclose(np.cos(swing), np.cos(chi), atol=FEW)


@pytest.mark.parametrize("name", ["ABC", "ZZX", "zYX", "", "XYY", "ZY", "ZYXZ"])
def test_what_is_no_sequence_is_an_error(name: str) -> None:
    with pytest.raises(RodgenError, match="the sequence"):
        ie.angles_from_euler([0.1, 0.2, 0.3], name)


def test_wrong_shapes_are_an_error() -> None:
    with pytest.raises(ValueError, match="last axis of 3"):
        ie.angles_from_euler([0.1, 0.2])
    with pytest.raises(ValueError, match=r"shape|dimension"):
        ie.angles_from_matrix(np.eye(4))
    with pytest.raises(ValueError, match="last axis of 4"):
        ie.euler_from_quaternion([1.0, 0, 0])
    with pytest.raises(TypeError):
        ie.angles_from_euler([1j, 0, 0])


def test_shapes_broadcast_and_types_stay() -> None:
    angles = RNG.normal(size=(4, 5, 3)).astype(np.float32)
    chi, status = ie.angles_from_euler(angles, "XZX")
    assert (chi.shape, chi.dtype, status.shape, status.dtype) == ((4, 5, 3), np.float32, (4, 5), np.int8)
    lines, status = ie.ridge_lines(MATRICES[:6, None], RNG.normal(size=(2, 3)))
    assert (lines.shape, status.shape) == ((6, 2, 3, 6), (6, 2, 3))


# ridge lines -------------------------------------------------------------------------------------------


def test_ridge_lines_lie_in_both_planes_and_turn_the_one_into_the_other() -> None:
    points = 10 * RNG.normal(size=(len(MATRICES), 3))
    lines, status = ie.ridge_lines(MATRICES, points)
    assert (status == ie.RidgeStatus.LINE).all()
    chi, _ = ie.angles_from_matrix(MATRICES)
    for i in range(3):
        direction, moment = lines[:, i, :3], lines[:, i, 3:]
        sine = np.sin(chi[:, i])
        foot = np.cross(direction, moment)  # the line's point that is nearest the origin
        np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, atol=FEW)
        np.testing.assert_allclose((direction * moment).sum(axis=1), 0, atol=1e-12)
        normal = MATRICES[:, :, i]
        for s in (0.0, 2.5):
            on_line = foot + s * direction
            assert (np.abs(on_line[:, i]) <= 1e-14 / sine).all()
            height = (normal * (on_line - points)).sum(axis=1)
            assert (np.abs(height) <= 40 * FEW / sine).all()
        turned = Rotation.from_rotvec(chi[:, i, None] * direction).as_matrix()[:, :, i]
        assert (np.abs(turned - normal).max(axis=1) <= FEW / sine).all()


def test_ridge_lines_of_parallel_planes() -> None:
    about_z = Rotation.from_rotvec([0, 0, 0.7]).as_matrix()
    lines, status = ie.ridge_lines(about_z, [[1.0, 2.0, 0.0], [1.0, 2.0, 3.0]])
    assert names(ie.RidgeStatus, status[:, 2]) == ["PLANES_COINCIDE", "PLANES_PARALLEL"]
    assert np.isnan(lines[:, 2]).all()
    np.testing.assert_allclose(lines[:, :2, :3], np.broadcast_to([0.0, 0, 1], (2, 2, 3)))
    upside_down = np.diag([-1.0, 1, -1])
    _, status = ie.ridge_lines(upside_down, [0.0, 0.0, 5.0])
    assert names(ie.RidgeStatus, status) == ["PLANES_COINCIDE", "PLANES_COINCIDE", "PLANES_PARALLEL"]


def test_ridge_lines_of_what_is_no_rotation() -> None:
    _, status = ie.ridge_lines(2 * np.eye(3))
    assert names(ie.RidgeStatus, status) == ["NOT_NORMAL"] * 3
    lines, status = ie.ridge_lines([np.diag([1.0, 1, -1]), np.full((3, 3), np.nan), 1.001 * MATRICES[0]])
    assert names(ie.RidgeStatus, status) == ["INVALID"] * 6 + ["NOT_NORMAL"] * 3
    assert np.isnan(lines[:2]).all()
    assert np.isfinite(lines[2]).all()
    _, status = ie.ridge_lines(np.eye(3), [np.inf, 0, 0])
    assert names(ie.RidgeStatus, status) == ["INVALID"] * 3


# rates -------------------------------------------------------------------------------------------------


def test_rates_are_the_derivatives_of_the_angles() -> None:
    omega = RNG.normal(size=(len(MATRICES), 3))
    found = ie.rates(MATRICES, omega)
    step = 1e-5
    after, before = (
        ie.angles_from_matrix((Rotation.from_rotvec(s * step * omega) * TURNS).as_matrix())[0]
        for s in (1, -1)
    )
    sine = np.sin(ie.angles_from_matrix(MATRICES)[0])
    # the third derivative of an angle grows as its sine's inverse squared
    assert (np.abs((after - before) / (2 * step) - found.rate) <= 20 * step**2 / sine**2 + 1e-10).all()
    quaternion = TURNS.as_quat(scalar_first=True)
    np.testing.assert_allclose(found.determinant, 16 * quaternion.prod(axis=1), atol=FEW)


@pytest.mark.parametrize("sequence", EVERY)
def test_rates_of_every_sequence(sequence: str) -> None:
    angles, speed = RNG.uniform(-2, 2, (50, 3)), RNG.normal(size=(50, 3))
    found = ie.rates_from_euler(angles, speed, sequence)
    step = 1e-6
    after, before = (ie.angles_from_euler(angles + s * step * speed, sequence)[0] for s in (1, -1))
    sine = np.sin(ie.angles_from_euler(angles, sequence)[0])
    assert (np.abs((after - before) / (2 * step) - found.rate) <= 1e-8 + 100 * step**2 / sine**3).all()
    matrix, omega = ie.motion_from_euler(angles, speed, sequence)
    expected = Rotation.from_euler(sequence, angles)
    np.testing.assert_allclose(matrix, expected.as_matrix(), atol=FEW)
    turned = Rotation.from_euler(sequence, angles + step * speed) * expected.inv()
    np.testing.assert_allclose(turned.as_rotvec() / step, omega, atol=1e-4)


def test_angular_velocity_from_rates() -> None:
    omega = RNG.normal(size=(len(MATRICES), 3))
    rate, determinant, _ = ie.rates(MATRICES, omega)
    found, status = ie.angular_velocity(MATRICES, rate)
    assert (status == ie.MotionStatus.REGULAR).all()
    assert (np.abs(found - omega) <= (100 * EPS / np.abs(determinant))[:, None]).all()


@pytest.mark.parametrize(
    ("vector", "name"),
    [([0.5, 0.7, 0], "SINGULAR"), ([0, 0, 0.9], "KINK"), ([0, 0, 0], "KINK"), ([0, np.pi, 0], "KINK")],
)
def test_where_rates_do_not_tell_the_angular_velocity(vector: list[float], name: str) -> None:
    matrix = Rotation.from_rotvec(vector).as_matrix()
    found = ie.rates(matrix, [0.3, -0.4, 1.2])
    assert names(ie.MotionStatus, found.status) == [name]
    assert abs(found.determinant) <= FEW
    assert np.isfinite(found.rate).all()
    omega, status = ie.angular_velocity(matrix, found.rate)
    assert names(ie.MotionStatus, status) == [name]
    assert np.isnan(omega).all()


@pytest.mark.parametrize("part", [1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13])
def test_an_angular_velocity_with_few_digits_says_so(part: float) -> None:
    quaternion = np.array([1, 0.5, 0.3, part])
    turn = Rotation.from_quat(quaternion, scalar_first=True)
    omega = np.array([0.1, 0.2, 0.3])
    found, status = ie.angular_velocity(turn.as_matrix(), ie.rates(turn.as_matrix(), omega).rate)
    error = np.abs(found - omega).max()
    assert error <= 20 * EPS / part
    assert names(ie.MotionStatus, status) == ["REGULAR" if part >= 1e-7 else "NEAR_SINGULAR"]


def test_rate_at_a_kink_is_the_one_towards_later_times() -> None:
    omega = np.array([0.3, -0.4, 1.2])
    for vector in ([0, 0, 0], [0, 0, 0.9], [np.pi, 0, 0]):
        turn = Rotation.from_rotvec(vector)
        chi, _ = ie.angles_from_matrix(turn.as_matrix())
        later, _ = ie.angles_from_matrix((Rotation.from_rotvec(1e-7 * omega) * turn).as_matrix())
        np.testing.assert_allclose(ie.rates(turn.as_matrix(), omega).rate, (later - chi) / 1e-7, atol=1e-6)


# conventional angles -----------------------------------------------------------------------------------


@pytest.mark.parametrize("sequence", EVERY)
def test_conventional_angles_are_scipys(sequence: str) -> None:
    angles, status = ie.euler_from_quaternion(TURNS.as_quat(scalar_first=True), sequence)
    assert (status == ie.MotionStatus.REGULAR).all()
    expected = TURNS.as_euler(sequence)
    np.testing.assert_allclose(np.cos(angles - expected), 1, atol=1e-14)
    np.testing.assert_allclose(angles[:, 1], expected[:, 1], atol=1e-12)
    np.testing.assert_allclose(Rotation.from_euler(sequence, angles).as_matrix(), MATRICES, atol=1e-14)
    of_matrix, _ = ie.euler_from_matrix(MATRICES, sequence)
    np.testing.assert_allclose(np.cos(of_matrix - angles), 1, atol=1e-14)


@pytest.mark.parametrize("sequence", EVERY)
def test_gimbal_lock_has_a_status_and_the_rotation_stays_right(sequence: str) -> None:
    proper = sequence[0] == sequence[2]
    for middle in (0.0, np.pi) if proper else (np.pi / 2, -np.pi / 2):
        turn = Rotation.from_euler(sequence, [0.4, middle, -1.1])
        angles, status = ie.euler_from_quaternion(turn.as_quat(scalar_first=True), sequence)
        assert names(ie.MotionStatus, status) == ["SINGULAR"]
        assert angles[0 if sequence.islower() else 2] == 0
        np.testing.assert_allclose(
            Rotation.from_euler(sequence, angles).as_matrix(), turn.as_matrix(), atol=1e-15 * 8
        )


# trajectories ------------------------------------------------------------------------------------------


def test_a_turn_about_a_fixed_axis_is_followed_over_many_turns() -> None:
    angle = np.linspace(0.1, 20, 400)
    half = angle / 2
    found = ie.trajectory(np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1))
    np.testing.assert_allclose(found.signed[:, 0], angle, atol=1e-13)
    np.testing.assert_allclose(found.signed[:, 1], angle, atol=1e-13)
    assert (found.status[:, 2] == ie.PathStatus.NO_RIDGE).all()
    assert (found.status[:, 0] == ie.PathStatus.TURNED).sum() == 6  # 20 rad pass six multiples of a half turn
    np.testing.assert_allclose(found.continuous["ZYX"][:, 0], angle, atol=1e-13)
    np.testing.assert_allclose(
        found.continuous["ZYZ"][:, 0] + found.continuous["ZYZ"][:, 2], angle, atol=1e-13
    )
    assert (found.euler_status["ZYZ"] == ie.MotionStatus.SINGULAR).all()


@pytest.mark.parametrize("sequence", EVERY)
def test_continuous_angles_do_not_jump_and_are_the_same_rotation(sequence: str) -> None:
    t = np.linspace(0.05, 6, 1500)  # the middle angle passes the locks, to both sides, between two rows
    way = np.stack([1.5 * t, 2 * np.sin(t), np.cos(2 * t) + t], axis=1)
    turns = Rotation.from_euler(sequence, way)
    found = ie.trajectory(turns.as_quat(scalar_first=True), [sequence])
    made = found.continuous[sequence]
    np.testing.assert_allclose(Rotation.from_euler(sequence, made).as_matrix(), turns.as_matrix(), atol=1e-12)
    offset = (made - made[0]) - (way - way[0])
    assert np.abs(offset).max() < 1e-9  # it is the way itself, but for whole turns
    assert np.abs(np.diff(found.euler[sequence], axis=0)).max() > 1
    np.testing.assert_allclose(np.cos(found.signed), np.cos(found.chi), atol=1e-12)


def test_paper_s_curve_2_followed() -> None:
    x = np.linspace(0.1, 6.3, 200)
    turns = Rotation.from_euler("ZYX", np.stack([np.sin(x), np.cos(x), 0 * x], axis=1))
    found = ie.trajectory(turns.as_quat(scalar_first=True))
    np.testing.assert_allclose(found.chi[:, 1], np.abs(np.sin(x)), atol=1e-14)
    np.testing.assert_allclose(found.chi[:, 2], np.abs(np.cos(x)), atol=1e-14)
    np.testing.assert_allclose(found.signed[:, 1], np.sin(x), atol=1e-14)
    np.testing.assert_allclose(found.signed[:, 2], np.cos(x), atol=1e-14)
    assert (found.chi[:, 0] >= np.abs(np.sin(x)) - 1e-15).all()
    assert np.degrees(found.chi[:, 0].min()) == pytest.approx(54.69, abs=0.01)
    assert np.degrees(found.chi[:, 0].max()) == pytest.approx(57.30, abs=0.01)


def test_rows_too_far_apart_are_reported() -> None:
    turns = Rotation.from_rotvec([[0.5, 0, 0], [0, 0.5, 0], [0.5, 0.01, 0]])
    found = ie.trajectory(turns.as_quat(scalar_first=True))
    assert names(ie.PathStatus, found.status[:, 2]) == ["SMOOTH", "COARSE", "COARSE"]


def test_rows_that_are_no_rotation_do_not_break_the_way() -> None:
    quaternions = np.array([[1.0, 0.1, 0.2, 0.3], [np.nan] * 4, [1.0, 0.1, 0.2, 0.31], [0, 0, 0, 0]])
    found = ie.trajectory(quaternions)
    assert names(ie.PathStatus, found.status[:, 0]) == ["SMOOTH", "INVALID", "SMOOTH", "INVALID"]
    assert np.isnan(found.signed[[1, 3]]).all()
    assert np.isnan(found.continuous["ZYX"][[1, 3]]).all()
    assert np.isfinite(found.continuous["ZYX"][[0, 2]]).all()
    with pytest.raises(ValueError, match=r"\(n, 4\)"):
        ie.trajectory([1.0, 0, 0, 0])


# arm ---------------------------------------------------------------------------------------------------


def test_arm_pose_is_the_chain_of_its_joints() -> None:
    joints, lengths = RNG.uniform(-3, 3, (20, 6)), np.array([0.4, 0.5, 0.45, 0.15])
    matrix, point, wrist = ie.arm_pose(joints, lengths)
    for q, R, p, w in zip(joints, matrix, point, wrist, strict=True):
        base, upper, forearm = (Rotation.from_rotvec(v) for v in ([0, 0, q[0]], [0, q[1], 0], [0, q[2], 0]))
        elbow = np.array([0, 0, 0.4]) + base.apply(upper.apply([0, 0, 0.5]))
        centre = elbow + (base * upper * forearm).apply([0.45, 0, 0])
        tool = base * upper * forearm * Rotation.from_euler("ZYX", q[3:])
        np.testing.assert_allclose(R, tool.as_matrix(), atol=1e-14)
        np.testing.assert_allclose(w, centre, atol=1e-14)
        np.testing.assert_allclose(p, centre + tool.apply([0.15, 0, 0]), atol=1e-14)


def test_in_the_forearm_s_axes_the_wrist_alone_counts() -> None:
    joints = RNG.uniform(-3, 3, (20, 6))
    home = joints * [1, 1, 1, 0, 0, 0]
    sizes = RNG.uniform(0.1, 2, (20, 4))
    seen = np.swapaxes(ie.arm_pose(home, sizes)[0], 1, 2) @ ie.arm_pose(joints, sizes)[0]
    chi, _ = ie.angles_from_matrix(seen)
    np.testing.assert_allclose(np.cos(chi), np.cos(ie.angles_from_euler(joints[:, 3:])[0]), atol=1e-14)


def test_it_is_an_attribute_of_rodgen() -> None:
    assert rodgen.instantaneous_euler is ie


@pytest.mark.parametrize("name", [name for name in ie.__all__ if inspect.isfunction(getattr(ie, name))])
def test_docstrings_tell_parameters_results_and_show_an_example(name: str) -> None:
    function = getattr(ie, name)
    text = inspect.getdoc(function)
    parameters = text.partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    told = re.findall(r"^(\w[\w, ]*?)(?: :|$)", parameters, re.MULTILINE)
    assert {word.strip() for line in told for word in line.split(",")} == set(
        inspect.signature(function).parameters
    )
    assert "Returns\n-------\n" in text
    assert ">>> from rodgen import instantaneous_euler as ie" in text
