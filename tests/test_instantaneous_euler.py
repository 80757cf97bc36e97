"""Instantaneous Euler angles, ridge lines, rates and trajectories, against SciPy's rotations and many digits.

All rotations with given angles: none invented, none missing. The oracle is numeric: least squares on the three cosines
from many starts finds no rotation that the list lacks.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import least_squares, minimize
from scipy.spatial.transform import Rotation

import rodgen
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
def test_what_is_no_sequence_is_an_error(refuses, name: str) -> None:
    refuses(ie.angles_from_euler, [0.1, 0.2, 0.3], name)


def test_wrong_shapes_are_an_error(refuses) -> None:
    refuses(ie.angles_from_euler, [0.1, 0.2], raises=ValueError)
    refuses(ie.angles_from_matrix, np.eye(4), raises=ValueError)
    refuses(ie.euler_from_quaternion, [1.0, 0, 0], raises=ValueError)
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
    matrix, omega = ie.motion_from_euler(angles, speed, sequence)
    found = ie.rates(matrix, omega)
    step = 1e-6
    after, before = (ie.angles_from_euler(angles + s * step * speed, sequence)[0] for s in (1, -1))
    sine = np.sin(ie.angles_from_euler(angles, sequence)[0])
    assert (np.abs((after - before) / (2 * step) - found.rate) <= 1e-8 + 100 * step**2 / sine**3).all()
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


def test_rows_that_are_no_rotation_do_not_break_the_way(refuses) -> None:
    quaternions = np.array([[1.0, 0.1, 0.2, 0.3], [np.nan] * 4, [1.0, 0.1, 0.2, 0.31], [0, 0, 0, 0]])
    found = ie.trajectory(quaternions)
    assert names(ie.PathStatus, found.status[:, 0]) == ["SMOOTH", "INVALID", "SMOOTH", "INVALID"]
    assert np.isnan(found.signed[[1, 3]]).all()
    assert np.isnan(found.continuous["ZYX"][[1, 3]]).all()
    assert np.isfinite(found.continuous["ZYX"][[0, 2]]).all()
    refuses(ie.trajectory, [1.0, 0, 0, 0], raises=ValueError)


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


VERTICES = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
GIVEN = Rotation.random(300, random_state=4)
STARTS_RNG = np.random.default_rng(6)


def rotation_names(codes: object) -> list[str]:
    return [ie.RotationsStatus(int(code)).name for code in np.ravel(codes)]


def quaternion(*components: float) -> np.ndarray:
    return np.array(components) / np.linalg.norm(components)


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between rotations given by unit quaternions."""
    return (
        2
        * np.arctan2(
            np.minimum(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)) / 2,
            np.maximum(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)) / 2,
        )
        * 2
    )


def test_all_eight_have_the_angles_and_the_given_one_is_among_them() -> None:
    chi, _ = ie.angles_from_matrix(GIVEN.as_matrix())
    found = ie.rotations(chi)
    assert rotation_names(found.status) == ["EIGHT"] * 300
    assert (found.distance == 0).all()
    np.testing.assert_array_equal(found.nearest, chi)
    np.testing.assert_allclose(np.linalg.norm(found.quaternions, axis=-1), 1, atol=FEW)
    again, _ = ie.angles_from_quaternion(found.quaternions)
    np.testing.assert_allclose(np.cos(again), np.broadcast_to(np.cos(chi)[:, None], again.shape), atol=FEW)
    given_one = GIVEN.as_quat(scalar_first=True)
    # a component is the root of its square: its error is the rounding over twice itself
    smallest = np.abs(given_one).min(axis=1)
    assert (apart(found.quaternions, given_one[:, None]).min(axis=1) <= 8 * EPS / smallest + FEW).all()
    between = apart(found.quaternions[:, :, None], found.quaternions[:, None])
    assert (between[:, ~np.eye(8, dtype=bool)] > smallest[:, None]).all()  # eight different ones


def numeric_rotations(chi: np.ndarray, starts: int, seed: int) -> list[np.ndarray]:
    """Every rotation that least squares finds from random starts, as unit quaternions."""
    found: list[np.ndarray] = []
    for start in Rotation.random(starts, random_state=seed):

        def error(step: np.ndarray, start: Rotation = start) -> np.ndarray:
            turned = Rotation.from_rotvec(step) * start
            return np.diagonal(turned.as_matrix()) - np.cos(chi)

        solved = least_squares(error, np.zeros(3), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        if np.abs(solved.fun).max() < 1e-10:
            here = (Rotation.from_rotvec(solved.x) * start).as_quat(scalar_first=True)
            if all(apart(here, other) > 1e-4 for other in found):
                found.append(here)
    return found


@pytest.mark.parametrize("seed", range(4))
def test_least_squares_from_many_starts_finds_exactly_the_list(seed: int) -> None:
    turn = Rotation.from_quat(quaternion(*(0.3 + STARTS_RNG.uniform(0, 1, 4))), scalar_first=True)
    chi, _ = ie.angles_from_matrix(turn.as_matrix())
    listed = ie.rotations(chi).quaternions
    numeric = numeric_rotations(chi, 60, seed)
    assert len(numeric) == 8  # none is missing in the numeric search, so that it is an oracle
    for here in numeric:
        assert apart(listed, here).min() < 1e-8


@pytest.mark.thorough("components0", "components1")
@pytest.mark.parametrize(
    "components", [(0, 0.5, 0.6, 0.4), (0.7, 0.5, 0, 0.3), (0.7, 0, 0.4, 0), (0, 0, 0.8, 0.6)]
)
def test_least_squares_finds_the_list_on_faces_and_edges(components: tuple[float, ...]) -> None:
    q = quaternion(*components)
    chi, _ = ie.angles_from_quaternion(q)
    listed = ie.rotations(chi)
    count = int(2 ** (np.count_nonzero(q) - 1))
    assert listed.count == count
    rows = listed.quaternions[:count]
    assert np.isnan(listed.quaternions[count:]).all()
    for here in numeric_rotations(chi, 30, 1):  # a double root: found to the root of the tolerance
        assert apart(rows, here).min() < 1e-3
    assert apart(rows, q).min() < 1e-12
    assert (apart(rows[:, None], rows[None])[~np.eye(count, dtype=bool)] > 0.5).all()


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6, 1e-9, 1e-150])
@pytest.mark.parametrize("corner", range(4))
def test_count_does_not_depend_on_the_size_of_the_rotation(size: float, corner: int) -> None:
    """Near no rotation, and near the half turns about the axes, where the same happens to squared cosines."""
    small = size * np.array([0.5, 0.3, 0.4])
    for missing, name in ((None, "EIGHT"), (0, "FOUR"), (1, "FOUR")):
        part = small.copy()
        if missing is not None:
            part[missing] = 0
        q = np.insert(part, corner, 1.0)
        chi, _ = ie.angles_from_quaternion(q / np.linalg.norm(q))
        found = ie.rotations(chi)
        # an angle of a half turn holds no more digits than π: what is farther down is the half turn itself
        assert rotation_names(found.status) == ["ONE" if corner and size < 1e-15 else name]
        if missing is None and not corner:
            off = np.abs(found.quaternions - q / np.linalg.norm(q))
            nearest = off[off.max(axis=1).argmin()]
            assert nearest[0] <= 2 * EPS  # the component of nearly 1
            assert nearest[1:].max() <= 1e-14 * size


def test_corners() -> None:
    pi = np.pi
    found = ie.rotations([[0, 0, 0], [0, pi, pi], [pi, 0, pi], [pi, pi, 0]])
    assert rotation_names(found.status) == ["ONE"] * 4
    np.testing.assert_array_equal(np.abs(found.quaternions[:, 0]), np.eye(4))


def test_components_below_the_tolerance_are_one_rotation() -> None:
    q = quaternion(0.7, 1e-4, 0.5, 0.4)
    chi, _ = ie.angles_from_quaternion(q)
    assert rotation_names(ie.rotations(chi).status) == ["EIGHT"]
    assert rotation_names(ie.rotations(chi, tolerance=1e-6).status) == ["FOUR"]
    q = quaternion(0.7, 1e-9, 0.5, 0.4)  # its square is below a rounding of the others
    found = ie.rotations(ie.angles_from_quaternion(q)[0])
    assert rotation_names(found.status) == ["FOUR"]
    assert apart(found.quaternions[:4], q).min() < 1e-8


def test_measured_angles_of_a_face_are_not_outside_with_the_advised_tolerance() -> None:
    random = np.random.default_rng(0)
    q = np.column_stack([random.uniform(0.2, 1, (500, 3)), np.zeros(500)])
    chi, _ = ie.angles_from_quaternion(q / np.linalg.norm(q, axis=1, keepdims=True))
    u = 1e-4
    measured = chi + u * random.normal(size=chi.shape)
    strict = ie.rotations(measured)
    assert (strict.status == ie.RotationsStatus.INFEASIBLE).mean() > 0.3
    tolerant = ie.rotations(measured, tolerance=3 * u / chi.max(axis=1))
    assert (tolerant.status == ie.RotationsStatus.INFEASIBLE).mean() < 0.01


@pytest.mark.parametrize("decades", [1, 8, 16, 200])
def test_no_rotation_is_called_infeasible_whatever_its_components(decades: int) -> None:
    q = STARTS_RNG.choice([-1, 1], (40_000, 4)) * 10.0 ** STARTS_RNG.uniform(-decades, 0, (40_000, 4))
    q[STARTS_RNG.random(q.shape) < 0.1] = 0
    q = q[np.abs(q).max(axis=1) > 0]
    q /= np.abs(q).max(axis=1, keepdims=True)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    for chi in (
        ie.angles_from_quaternion(q)[0],
        ie.angles_from_matrix(rodgen.matrix_from_quaternion(q)[0])[0],
    ):
        turns = chi.max(axis=1) > 1e-150  # squares of smaller angles lose digits
        assert turns.mean() > 0.9
        found = ie.rotations(chi[turns])
        assert np.isin(found.count, (1, 2, 4, 8)).all()
        assert (np.isfinite(found.quaternions[..., 0]) == (np.arange(8) < found.count[:, None])).all()
        assert (np.nan_to_num(found.quaternions[..., 0]) >= 0).all()
        off = [np.abs(found.quaternions + sign * q[turns, None]).max(axis=-1) for sign in (-1, 1)]
        # what is taken for 0 is below the root of 16 eps of a size of at most 3/2, and a little for the rest
        assert np.nanmin(np.minimum(*off), axis=1).max() <= np.sqrt(1.5 * 16 * EPS + 16 * EPS)


# triples that there are not ----------------------------------------------------------------------------


def test_infeasible_triples_have_their_distance_and_the_nearest_triple() -> None:
    chi = STARTS_RNG.uniform(0, np.pi, (400, 3))
    found = ie.rotations(chi)
    inside = ((1 + np.cos(chi) @ VERTICES.T) >= 0).all(axis=1)
    assert ((found.count == 8) == inside).all()
    assert (~inside).sum() > 300
    assert np.isnan(found.quaternions[~inside]).all()
    reached = np.linalg.norm(np.cos(found.nearest) - np.cos(chi), axis=1)
    np.testing.assert_allclose(found.distance, np.where(inside, 0, reached), atol=1e-14)
    assert (ie.rotations(found.nearest, tolerance=1e-12).count > 0).all()
    for target, distance in zip(np.cos(chi[~inside][:25]), found.distance[~inside][:25], strict=True):
        best = minimize(
            lambda b, target=target: ((b @ VERTICES - target) ** 2).sum(),
            np.full(4, 0.25),
            jac=lambda b, target=target: 2 * VERTICES @ (b @ VERTICES - target),
            bounds=[(0, 1)] * 4,
            constraints={"type": "eq", "fun": lambda b: b.sum() - 1, "jac": lambda b: np.ones(4)},
            options={"ftol": 1e-14},
        )
        assert np.sqrt(best.fun) == pytest.approx(distance, abs=1e-6)


# choice by ridge lines ---------------------------------------------------------------------------------


def ridges(turns: Rotation) -> np.ndarray:
    return np.asarray(ie.ridge_lines(turns.as_matrix())[0])[..., :3]


def test_one_ridge_line_with_a_sense_chooses_the_rotation() -> None:
    chi, _ = ie.angles_from_matrix(GIVEN.as_matrix())
    directions = ridges(GIVEN)
    for i, axis in enumerate("xyz"):
        choice = ie.choose(chi, **{axis: 3.0 * directions[:, i]}, angle_tolerance=1e-9)
        assert (choice.status == ie.ChoiceStatus.CHOSEN).all()
        assert (choice.left == 1).all()
        assert apart(choice.quaternion, GIVEN.as_quat(scalar_first=True)).max() < 1e-8
        assert choice.misfit.max() < 1e-8


def test_one_ridge_line_without_a_sense_leaves_two_and_two_lines_leave_one() -> None:
    chi, _ = ie.angles_from_matrix(GIVEN.as_matrix())
    directions = ridges(GIVEN)
    given_one = GIVEN.as_quat(scalar_first=True)
    one = ie.choose(chi, z=-directions[:, 2], oriented=False, angle_tolerance=1e-9)
    assert (one.left == 2).all()
    assert (one.status == ie.ChoiceStatus.AMBIGUOUS).all()
    half_turn = Rotation.from_rotvec([0, 0, np.pi])
    other = (half_turn * GIVEN * half_turn).as_quat(scalar_first=True)
    either = np.minimum(apart(one.quaternion, given_one), apart(one.quaternion, other))
    assert either.max() < 1e-8
    for first, second in ("xy", "xz", "yz"):
        lines = {axis: directions[:, "xyz".index(axis)] for axis in (first, second)}
        two = ie.choose(chi, **lines, oriented=False, angle_tolerance=1e-9)
        assert (two.left == 1).all()
        assert apart(two.quaternion, given_one).max() < 1e-8


def test_choice_that_cannot_be_made(refuses) -> None:
    choice = ie.choose(
        [[np.pi / 2, 0, 0], [0.3, 0.3, 0.3], [np.nan, 1, 1]], z=[[1.0, 0, 0], [0.0, 0, 0], [1.0, 0, 0]]
    )
    assert [ie.ChoiceStatus(int(c)).name for c in choice.status] == ["INFEASIBLE", "INVALID", "INVALID"]
    assert np.isnan(choice.quaternion).all()
    assert np.isnan(choice.misfit).all()
    assert choice.left.tolist() == [0, 0, 0]
    refuses(ie.choose, [0.3, 0.3, 0.3])
    refuses(ie.choose, [0.3, 0.3, 0.3], z=[1.0, 0.0], raises=ValueError)
