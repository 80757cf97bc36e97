"""All rotations with given instantaneous Euler angles: none invented, none missing, and how far others are from any.

The oracle is numeric: least squares on the three cosines from many starts finds no rotation that the list lacks.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import least_squares, minimize
from scipy.spatial.transform import Rotation

import rodgen
from rodgen.errors import RodgenError
from rodgen.kinematics import instantaneous_euler as ie

EPS = float(np.finfo(float).eps)
FEW = 16 * EPS
VERTICES = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
TURNS = Rotation.random(300, random_state=4)
RNG = np.random.default_rng(6)


def names(codes: object) -> list[str]:
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
    chi, _ = ie.angles_from_matrix(TURNS.as_matrix())
    found = ie.rotations(chi)
    assert names(found.status) == ["EIGHT"] * 300
    assert (found.distance == 0).all()
    np.testing.assert_array_equal(found.nearest, chi)
    np.testing.assert_allclose(np.linalg.norm(found.quaternions, axis=-1), 1, atol=FEW)
    again, _ = ie.angles_from_quaternion(found.quaternions)
    np.testing.assert_allclose(np.cos(again), np.broadcast_to(np.cos(chi)[:, None], again.shape), atol=FEW)
    given_one = TURNS.as_quat(scalar_first=True)
    # a component is the root of its square: its error is the rounding over twice itself
    smallest = np.abs(given_one).min(axis=1)
    assert (apart(found.quaternions, given_one[:, None]).min(axis=1) <= 8 * EPS / smallest + FEW).all()
    between = apart(found.quaternions[:, :, None], found.quaternions[:, None])
    assert (between[:, ~np.eye(8, dtype=bool)] > smallest[:, None]).all()  # eight different ones


def test_the_eight_are_the_rotation_and_its_inverse_between_half_turns() -> None:
    flips = [np.diag(d) for d in ([1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])]
    for turn in TURNS[:30]:
        matrix = turn.as_matrix()
        found = ie.rotations(ie.angles_from_matrix(matrix)[0]).quaternions
        made = Rotation.from_quat(found, scalar_first=True).as_matrix()
        for flip, R in product(flips, (matrix, matrix.T)):
            assert np.abs(made - flip @ R @ flip).max(axis=(1, 2)).min() < 1e-11


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
    turn = Rotation.from_quat(quaternion(*(0.3 + RNG.uniform(0, 1, 4))), scalar_first=True)
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
        assert names(found.status) == ["ONE" if corner and size < 1e-15 else name]
        if missing is None and not corner:
            off = np.abs(found.quaternions - q / np.linalg.norm(q))
            nearest = off[off.max(axis=1).argmin()]
            assert nearest[0] <= 2 * EPS  # the component of nearly 1
            assert nearest[1:].max() <= 1e-14 * size


def test_corners() -> None:
    pi = np.pi
    found = ie.rotations([[0, 0, 0], [0, pi, pi], [pi, 0, pi], [pi, pi, 0]])
    assert names(found.status) == ["ONE"] * 4
    np.testing.assert_array_equal(np.abs(found.quaternions[:, 0]), np.eye(4))


def test_components_below_the_tolerance_are_one_rotation() -> None:
    q = quaternion(0.7, 1e-4, 0.5, 0.4)
    chi, _ = ie.angles_from_quaternion(q)
    assert names(ie.rotations(chi).status) == ["EIGHT"]
    assert names(ie.rotations(chi, tolerance=1e-6).status) == ["FOUR"]
    q = quaternion(0.7, 1e-9, 0.5, 0.4)  # its square is below a rounding of the others
    found = ie.rotations(ie.angles_from_quaternion(q)[0])
    assert names(found.status) == ["FOUR"]
    assert apart(found.quaternions[:4], q).min() < 1e-8


def test_measured_angles_of_a_face_are_not_outside_with_the_advised_tolerance() -> None:
    q = np.column_stack([RNG.uniform(0.2, 1, (500, 3)), np.zeros(500)])
    chi, _ = ie.angles_from_quaternion(q / np.linalg.norm(q, axis=1, keepdims=True))
    u = 1e-4
    measured = chi + u * RNG.normal(size=chi.shape)
    strict = ie.rotations(measured)
    assert (strict.status == ie.RotationsStatus.INFEASIBLE).mean() > 0.3
    tolerant = ie.rotations(measured, tolerance=3 * u / chi.max(axis=1))
    assert (tolerant.status == ie.RotationsStatus.INFEASIBLE).mean() < 0.01


@pytest.mark.parametrize("decades", [1, 8, 16, 200])
def test_no_rotation_is_called_infeasible_whatever_its_components(decades: int) -> None:
    q = RNG.choice([-1, 1], (40_000, 4)) * 10.0 ** RNG.uniform(-decades, 0, (40_000, 4))
    q[RNG.random(q.shape) < 0.1] = 0
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
        assert (found.count > 0).all()
        off = [np.abs(found.quaternions + sign * q[turns, None]).max(axis=-1) for sign in (-1, 1)]
        # what is taken for 0 is below the root of 16 eps of a size of at most 3/2, and a little for the rest
        assert np.nanmin(np.minimum(*off), axis=1).max() <= np.sqrt(1.5 * 16 * EPS + 16 * EPS)


# triples that there are not ----------------------------------------------------------------------------


def test_infeasible_triples_have_their_distance_and_the_nearest_triple() -> None:
    chi = RNG.uniform(0, np.pi, (400, 3))
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


def test_a_third_of_the_cosines_and_a_seventh_of_the_angles() -> None:
    n = 200_000
    in_cosines = ie.rotations(np.arccos(RNG.uniform(-1, 1, (n, 3)))).count > 0
    assert in_cosines.mean() == pytest.approx(1 / 3, abs=0.005)  # five standard deviations
    in_angles = ie.rotations(RNG.uniform(0, np.pi, (n, 3))).count > 0
    assert in_angles.mean() == pytest.approx(0.147, abs=0.005)


@pytest.mark.parametrize("chi", [[np.nan, 1, 1], [-0.1, 0.1, 0.1], [3.2, 1, 3], [np.inf, 0, 0]])
def test_no_angles(chi: list[float]) -> None:
    found = ie.rotations(chi)
    assert names(found.status) == ["INVALID"]
    assert found.count == 0
    assert np.isnan(found.quaternions).all()
    assert np.isnan(found.distance)
    assert np.isnan(found.nearest).all()
    assert names(ie.rotations([0.1, 0.1, 0.1], tolerance=np.nan).status) == ["INVALID"]


@given(arrays(float, 4, elements=st.sampled_from([0.0, 1e-6, -1e-3, 0.1, -0.5, 1.0, 2.0])))
@settings(max_examples=120, deadline=None)
def test_what_a_rotation_has_always_leads_back_to_it(components: np.ndarray) -> None:
    size = np.linalg.norm(components)
    if size == 0:
        return
    q = components / size
    chi, _ = ie.angles_from_quaternion(q)
    found = ie.rotations(chi)
    assert found.count in (1, 2, 4, 8)
    rows = found.quaternions[: int(found.count)]
    # a component that was taken for 0 is below the root of 16 units of the rotation's size
    assert apart(rows, q).min() <= 4e-7
    assert np.isnan(found.quaternions[int(found.count) :]).all()
    assert (rows[:, 0] >= 0).all()


@given(arrays(float, 3, elements=st.floats(0, np.pi)))
@settings(max_examples=120, deadline=None)
def test_every_triple_has_a_count_and_its_rotations_have_the_triple(chi: np.ndarray) -> None:
    found = ie.rotations(chi)
    assert names(found.status)[0] != "INVALID"
    rows = found.quaternions[: int(found.count)]
    again, _ = ie.angles_from_quaternion(rows)
    np.testing.assert_allclose(np.cos(again), np.broadcast_to(np.cos(chi), again.shape), atol=8 * FEW)


# choice by ridge lines ---------------------------------------------------------------------------------


def ridges(turns: Rotation) -> np.ndarray:
    return np.asarray(ie.ridge_lines(turns.as_matrix())[0])[..., :3]


def test_one_ridge_line_with_a_sense_chooses_the_rotation() -> None:
    chi, _ = ie.angles_from_matrix(TURNS.as_matrix())
    directions = ridges(TURNS)
    for i, axis in enumerate("xyz"):
        choice = ie.choose(chi, **{axis: 3.0 * directions[:, i]}, angle_tolerance=1e-9)
        assert (choice.status == ie.ChoiceStatus.CHOSEN).all()
        assert (choice.left == 1).all()
        assert apart(choice.quaternion, TURNS.as_quat(scalar_first=True)).max() < 1e-8
        assert choice.misfit.max() < 1e-8


def test_one_ridge_line_without_a_sense_leaves_two_and_two_lines_leave_one() -> None:
    chi, _ = ie.angles_from_matrix(TURNS.as_matrix())
    directions = ridges(TURNS)
    given_one = TURNS.as_quat(scalar_first=True)
    one = ie.choose(chi, z=-directions[:, 2], oriented=False, angle_tolerance=1e-9)
    assert (one.left == 2).all()
    assert (one.status == ie.ChoiceStatus.AMBIGUOUS).all()
    half_turn = Rotation.from_rotvec([0, 0, np.pi])
    other = (half_turn * TURNS * half_turn).as_quat(scalar_first=True)
    either = np.minimum(apart(one.quaternion, given_one), apart(one.quaternion, other))
    assert either.max() < 1e-8
    for first, second in ("xy", "xz", "yz"):
        lines = {axis: directions[:, "xyz".index(axis)] for axis in (first, second)}
        two = ie.choose(chi, **lines, oriented=False, angle_tolerance=1e-9)
        assert (two.left == 1).all()
        assert apart(two.quaternion, given_one).max() < 1e-8


def test_choice_with_measured_lines_and_unknown_ones() -> None:
    chi, _ = ie.angles_from_matrix(TURNS.as_matrix())
    directions = ridges(TURNS)
    x = np.full((300, 3), np.nan)
    x[::2] = directions[::2, 0]
    choice = ie.choose(chi, x=x, z=directions[:, 2] + 1e-6 * RNG.normal(size=(300, 3)))
    assert apart(choice.quaternion, TURNS.as_quat(scalar_first=True)).max() < 1e-7
    assert 1e-7 < choice.misfit.max() < 1e-4


def test_choice_that_cannot_be_made() -> None:
    choice = ie.choose(
        [[np.pi / 2, 0, 0], [0.3, 0.3, 0.3], [np.nan, 1, 1]], z=[[1.0, 0, 0], [0.0, 0, 0], [1.0, 0, 0]]
    )
    assert [ie.ChoiceStatus(int(c)).name for c in choice.status] == ["INFEASIBLE", "INVALID", "INVALID"]
    assert np.isnan(choice.quaternion).all()
    assert np.isnan(choice.misfit).all()
    assert choice.left.tolist() == [0, 0, 0]
    with pytest.raises(RodgenError, match="no ridge line"):
        ie.choose([0.3, 0.3, 0.3])
    with pytest.raises(ValueError, match="last axis of 3"):
        ie.choose([0.3, 0.3, 0.3], z=[1.0, 0.0])
