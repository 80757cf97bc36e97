"""The 3-SPS-S machine: legs, Jacobian, all assembly modes and workspace, against points, differences and searches.

Nothing here uses the octic: completeness is asked of a multi-start search of SciPy's, of signs that must balance, and
of families of modes known in closed form.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from rodgen.kinematics import three_sps_s
from rodgen.kinematics.three_sps_s import DirectStatus, Geometry, OrientationStatus

MACHINE = Geometry(2.0, 1.0, 1.5)
DIRECTIONS = np.array([[np.cos(a), np.sin(a), 0] for a in np.radians([-30, 90, 210])])
EQUAL = 2.578759391645525  # all legs so long: A = 0.3, eight modes


def by_points(rotation: Rotation, machine: Geometry = MACHINE) -> np.ndarray:
    """Legs from joints moved in space."""
    matrices = rotation.as_matrix()
    joints = np.einsum("...ij,kj->...ki", matrices, machine.r * DIRECTIONS) + np.array([0, 0, machine.h])
    return np.linalg.norm(joints - machine.R * DIRECTIONS, axis=-1)


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles of the rotations from a to b; small ones keep their digits."""
    return 2 * np.arcsin(np.clip(np.sqrt(np.square(a - b).sum(axis=(-2, -1)) / 8), 0, 1))


def searched(legs: np.ndarray, machine: Geometry, starts: Rotation) -> list[np.ndarray]:
    """Modes by SciPy's own solver from many starts, on rotation vectors: shares nothing with the package."""
    found: list[np.ndarray] = []
    for start in starts:

        def missing(turn: np.ndarray, start: Rotation = start) -> np.ndarray:
            return by_points(Rotation.from_rotvec(turn) * start, machine) - legs

        solution = root(missing, np.zeros(3), method="hybr", tol=1e-13)
        if np.abs(solution.fun).max() > 1e-10 or np.linalg.norm(solution.x) > 20:
            continue
        matrix = (Rotation.from_rotvec(solution.x) * start).as_matrix()
        if all(angles_between(matrix, other) > 1e-5 for other in found):
            found.append(matrix)
    return found


def random_machines(count: int, seed: int) -> list[Geometry]:
    rng = np.random.default_rng(seed)
    return [Geometry(*rng.uniform([0.5, 0.3, -2.5], [3, 3, 2.5])) for _ in range(count)]


# legs and Jacobian -------------------------------------------------------------------------------------


def test_legs_are_distances_of_joints():
    turns = Rotation.random(200, random_state=1)
    for machine in (MACHINE, Geometry(330, 140, 600), Geometry(1, 4, -0.3)):
        wanted = by_points(turns, machine)
        assert np.allclose(three_sps_s.legs(turns.as_matrix(), machine), wanted, rtol=1e-14, atol=0)
        q = turns.as_quat(scalar_first=True) * np.linspace(-3, 5, 200)[:, None]
        assert np.allclose(three_sps_s.legs_from_quaternion(q, machine), wanted, rtol=1e-14, atol=0)


def test_the_worked_example_of_the_facts():
    turn = Rotation.from_euler("ZYX", [-2.089973, -0.190923, -0.987843])
    wanted = [3.171729016215, 2.536477604076, 3.262424470785]
    assert np.allclose(three_sps_s.legs(turn.as_matrix(), MACHINE), wanted, rtol=0, atol=5e-13)
    rotations, count, status = three_sps_s.direct_all(wanted, MACHINE)
    assert (count, status) == (4, DirectStatus.CONVERGED)
    assert angles_between(rotations[:4], turn.as_matrix()).min() < 1e-11  # legs are given to 1e-12
    assert np.isnan(rotations[4:]).all()


def test_the_jacobian_is_the_difference_quotient():
    rng = np.random.default_rng(2)
    turns = Rotation.random(50, random_state=2)
    omega, step = rng.normal(size=(50, 3)), 1e-6
    ahead, behind = (by_points(Rotation.from_rotvec(s * step * omega) * turns) for s in (1, -1))
    rates = (three_sps_s.jacobian(turns.as_matrix(), MACHINE) @ omega[..., None])[..., 0]
    assert np.allclose(
        rates, (ahead - behind) / (2 * step), rtol=0, atol=1e-9
    )  # step² and rounding over step


def test_the_normed_determinant_is_that_of_the_moments():
    turns = Rotation.random(50, random_state=3)
    for machine in random_machines(5, 3):
        found = three_sps_s.singularity(turns.as_matrix(), machine)
        base = machine.R * DIRECTIONS - [0, 0, machine.h]
        arms = np.einsum("nij,kj->nki", turns.as_matrix(), machine.r * DIRECTIONS)
        moments = np.cross(base, arms) / (np.linalg.norm(base[0]) * machine.r)
        assert np.allclose(found.determinant, np.linalg.det(moments), rtol=0, atol=1e-14)
        assert (np.abs(found.determinant) <= 1).all()
        J = three_sps_s.jacobian(turns.as_matrix(), machine)
        assert np.allclose(found.gains, np.linalg.svd(J, compute_uv=False), rtol=1e-13)
        assert np.allclose(found.condition, np.linalg.cond(J), rtol=1e-6)


@pytest.mark.parametrize("machine", [MACHINE, *random_machines(3, 4)])
def test_where_the_machine_is_singular(machine):
    azimuth, tilt, torsion = np.random.default_rng(5).uniform(-np.pi, np.pi, size=(3, 20))

    def determinant(*angles):
        rotation = three_sps_s.rotation_from_tilt_torsion(*angles)
        return three_sps_s.singularity(rotation, machine).determinant

    assert abs(three_sps_s.singularity(np.eye(3), machine).determinant) < 1e-16
    assert three_sps_s.singularity(np.eye(3), machine).condition > 1e15
    assert np.abs(determinant(azimuth, 0, np.pi)).max() < 1e-15
    assert np.abs(determinant(azimuth, np.pi, torsion)).max() < 1e-15
    straight = np.radians([30, 90, 150, 210, 270, 330])  # towards a joint, or away from it
    assert np.abs(determinant(straight[:, None], tilt, 0)).max() < 1e-14
    size = np.hypot(machine.R, machine.h)
    pure = 1.5 * np.sqrt(3) * machine.R * machine.h**2 / size**3 * np.sin(torsion)
    assert np.allclose(determinant(azimuth, 0, torsion), pure, rtol=0, atol=1e-14)


def test_tilt_and_torsion_go_both_ways():
    rng = np.random.default_rng(6)
    F, sigma = rng.uniform(-3.1, 3.1, size=(2, 100))
    T = rng.uniform(0.01, 3.1, size=100)
    rotation = three_sps_s.rotation_from_tilt_torsion(F, T, sigma)
    assert np.allclose(
        rotation, Rotation.from_euler("ZYZ", np.stack([F, T, sigma - F], -1)).as_matrix(), atol=1e-14
    )
    assert np.allclose(three_sps_s.tilt_torsion(rotation), np.stack([F, T, sigma], -1), rtol=0, atol=1e-12)
    turned = three_sps_s.rotation_from_tilt_torsion(0.3, 0.0, 1.1)
    assert np.allclose(three_sps_s.tilt_torsion(turned), [0, 0, 1.1])
    over = three_sps_s.tilt_torsion(three_sps_s.rotation_from_tilt_torsion(0.3, np.pi, 1.1))
    assert np.allclose(over[1], np.pi)
    assert over[2] == 0
    assert np.isnan(three_sps_s.tilt_torsion(np.full((3, 3), np.nan))).all()


# all modes ---------------------------------------------------------------------------------------------


def check_modes(legs: np.ndarray, machine: Geometry, result: tuple) -> None:
    """Every mode has the legs, no mode is there twice, and signs balance where nothing is singular."""
    rotations, count, status = result
    there = np.isfinite(rotations[..., 0, 0])
    assert (there.sum(axis=-1) == count).all()
    assert (there == (np.arange(8) < count[..., None])).all()
    found = np.broadcast_to(legs[..., None, :], (*there.shape, 3))[there]
    scale = np.abs([machine.R, machine.r, machine.h]).sum() + legs.max()
    error = np.square(three_sps_s.legs(rotations[there], machine)) - np.square(found)
    assert np.abs(error).max(initial=0) < 1e-13 * scale**2
    matrices = rotations[there]
    assert np.allclose(matrices @ matrices.swapaxes(-1, -2), np.eye(3), rtol=0, atol=1e-14)
    signs = np.sign(
        three_sps_s.singularity(np.where(there[..., None, None], rotations, np.eye(3)), machine).determinant
    )
    regular = status == DirectStatus.CONVERGED
    assert (np.where(there, signs, 0).sum(axis=-1)[regular] == 0).all()


def test_equal_legs_have_eight_modes():
    rotations, count, status = three_sps_s.direct_all([EQUAL] * 3, MACHINE)
    assert (count, status) == (8, DirectStatus.CONVERGED)
    tilt, torsion = three_sps_s.tilt_torsion(rotations)[:, 1:].T
    pure = np.isclose(tilt, 0, atol=1e-12)
    assert pure.sum() == 2
    assert np.allclose(np.sort(torsion[pure]), [-np.arccos(0.15), np.arccos(0.15)])
    # the six others: sin²(T/2) = 4h²/(R² + 4h²)
    assert np.allclose(np.sin(tilt[~pure] / 2) ** 2, 9 / 13)
    check_modes(np.full(3, EQUAL), MACHINE, (rotations, count, np.asarray(status)))


def test_random_poses_are_among_their_modes_and_signs_balance():
    for number, machine in enumerate([MACHINE, *random_machines(12, 7)]):
        turns = Rotation.random(300, random_state=number)
        legs = by_points(turns, machine)
        result = three_sps_s.direct_all(legs, machine)
        check_modes(legs, machine, result)
        nearest = np.nanmin(
            np.where(
                np.isnan(result[0][..., 0, 0]), np.inf, angles_between(result[0], turns.as_matrix()[:, None])
            ),
            axis=1,
        )
        determinant = np.abs(three_sps_s.singularity(turns.as_matrix(), machine).determinant)
        assert (nearest < 1e-13 + 1e-12 / determinant).all()
        assert (result[2] == DirectStatus.CONVERGED).mean() > 0.99
        assert (result[1][result[2] == DirectStatus.CONVERGED] % 2 == 0).all()


@pytest.mark.thorough("0", "1", "5")
@pytest.mark.parametrize("number", range(6))
def test_a_search_from_many_starts_finds_no_other_modes(number):
    machine = [MACHINE, *random_machines(5, 8)][number]
    starts = Rotation.random(40, random_state=100 + number)
    turns = Rotation.random(2, random_state=number)
    for legs in by_points(turns, machine):
        rotations, count, status = three_sps_s.direct_all(legs, machine)
        assert status == DirectStatus.CONVERGED
        for mode in searched(legs, machine, starts):
            assert angles_between(rotations[:count], mode).min() < 1e-6


@pytest.mark.parametrize("size", [0.0, 1e-14, 1e-11, 1e-8, 1e-6, 1e-4, 1e-2])
def test_nearly_equal_legs_lose_no_mode(size):
    rng = np.random.default_rng(10)
    legs = rng.uniform(1.9, 2.9, size=(100, 1)) + size * rng.normal(size=(100, 3))
    result = three_sps_s.direct_all(legs, MACHINE)
    check_modes(legs, MACHINE, result)
    A = (3 * 7.25 - np.square(legs).sum(axis=1)) / 6
    clear = np.abs(np.abs(A) - 8 / 13) > 0.2  # from where six modes meet in pairs
    wanted = np.where(np.abs(A) < 8 / 13, 8, 2)
    assert (result[1] == wanted)[clear].all()
    assert clear.sum() > 40


@pytest.mark.parametrize("size", [0.0, 1e-13, 1e-9, 1e-6, 1e-3])
def test_symmetric_legs_lose_no_mode(size):
    """L1 = L3, and the same turned by 120°: the octic is the square of a quartic."""
    rng = np.random.default_rng(11)
    count = 0
    for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1]):
        side, middle = rng.uniform(1.6, 3.2, size=(2, 150))
        legs = np.stack([side, middle, side], axis=-1)[:, order] + size * rng.normal(size=(150, 3))
        result = three_sps_s.direct_all(legs, MACHINE)
        check_modes(legs, MACHINE, result)
        good = result[2] == DirectStatus.CONVERGED
        count += good.sum()
        if size == 0:  # mirror images: each mode with the plane's mirror image is a mode
            mirror = np.diag([-1.0, 1, 1]) if order == [0, 1, 2] else None
            if mirror is not None:
                rotations = result[0][good]
                images = mirror @ rotations @ mirror
                for modes, others, n in zip(rotations, images, result[1][good], strict=True):
                    apart = angles_between(modes[:n, None], others[None, :n]).min(axis=1)
                    assert apart.max(initial=0) < 1e-7
    assert count > 300


@pytest.mark.parametrize("height", [0.0, 1e-12, 1e-8, 1e-5, 1e-3, 0.05, -0.3, 30.0, 300.0])
def test_flat_and_tall_machines_lose_no_mode(height):
    machine = Geometry(2, 1, height)
    turns = Rotation.random(200, random_state=12)
    legs = by_points(turns, machine)
    result = three_sps_s.direct_all(legs, machine)
    check_modes(legs, machine, result)
    assert (result[1] >= 1).all()
    if height == 0:
        assert (result[1] == 4).all()


def singular_rotations() -> np.ndarray:
    """Poses on the singularity, between two of different sign."""
    a, b = (Rotation.random(60, random_state=n).as_quat(scalar_first=True) for n in (13, 14))
    sign = np.where((a * b).sum(axis=1) < 0, -1, 1)[:, None]

    def determinant(part: np.ndarray) -> np.ndarray:
        q = a + (sign * b - a) * part[:, None]
        return three_sps_s.singularity(
            Rotation.from_quat(q, scalar_first=True).as_matrix(), MACHINE
        ).determinant

    low, high = np.zeros(60), np.ones(60)
    cross = determinant(low) * determinant(high) < 0
    for _ in range(60):
        middle = (low + high) / 2
        same = determinant(middle) * determinant(np.zeros(60)) > 0
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    q = (a + (sign * b - a) * low[:, None])[cross]
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


def test_singular_poses_are_found_once_and_reported():
    rotations = singular_rotations()
    assert len(rotations) > 15
    legs = three_sps_s.legs(rotations, MACHINE)
    result = three_sps_s.direct_all(legs, MACHINE)
    check_modes(legs, MACHINE, result)
    assert (result[2] == DirectStatus.SINGULAR).all()
    apart = np.where(np.isnan(result[0][..., 0, 0]), np.inf, angles_between(result[0], rotations[:, None]))
    # two modes in one: rounding of the legs, 1e-16, is felt as its square root, and more where a third mode is near
    # (in one of these cases it is 0.02 rad away)
    assert (apart.min(axis=1) < 3e-6).all()
    assert np.median(apart.min(axis=1)) < 1e-7
    assert (np.sort(apart, axis=1)[:, 1] > 1e-4).all()


def test_the_home_pose_is_one_singular_mode():
    rotations, count, status = three_sps_s.direct_all([MACHINE.home_leg] * 3, MACHINE)
    assert (count, status) == (1, DirectStatus.SINGULAR)
    assert angles_between(rotations[0], np.eye(3)) < 1e-6


# statuses and shapes -----------------------------------------------------------------------------------


def test_every_status_of_all_modes():
    legs = [
        [2.5, 2.4, 2.6],
        [10, 1, 1],
        [np.nan, 2, 2],
        [2, np.inf, 2],
        [2, 2, -2.0],
        [MACHINE.home_leg] * 3,
    ]
    rotations, count, status = three_sps_s.direct_all(legs, MACHINE)
    assert list(status) == [0, 2, 5, 5, 5, 1]
    assert list(count > 0) == [True, False, False, False, False, True]
    assert np.isnan(rotations[1:5]).all()
    assert rotations.dtype == float
    assert (count.dtype, status.dtype) == (np.int8, np.int8)


def test_the_nearest_mode_is_the_nearest():
    turns = Rotation.random(100, random_state=16)
    legs = by_points(turns)
    rotations, _, _ = three_sps_s.direct_all(legs, MACHINE)
    near = Rotation.random(100, random_state=17).as_matrix()
    found, status = three_sps_s.direct(legs, MACHINE, near=near)
    apart = np.where(np.isnan(rotations[..., 0, 0]), np.inf, angles_between(rotations, near[:, None]))
    assert np.allclose(angles_between(found, near), apart.min(axis=1), rtol=0, atol=1e-12)
    assert (status == DirectStatus.CONVERGED).all()
    own, _ = three_sps_s.direct(legs, MACHINE, near=turns.as_matrix())
    assert angles_between(own, turns.as_matrix()).max() < 1e-9


def test_every_status_of_the_nearest_mode():
    pure = three_sps_s.legs(Rotation.from_rotvec([0, 0, 0.4]).as_matrix(), MACHINE)
    legs = [pure, [10, 1, 1], [np.nan] * 3, [MACHINE.home_leg] * 3]
    found, status = three_sps_s.direct(legs, MACHINE, near=np.eye(3))
    assert list(status) == [3, 2, 5, 1]
    assert np.isnan(found[1:3]).all()
    assert np.isfinite(found[[0, 3]]).all()
    found, status = three_sps_s.direct(pure, MACHINE, near=Rotation.from_rotvec([0, 0, 0.1]).as_matrix())
    assert status == DirectStatus.CONVERGED
    assert np.allclose(Rotation.from_matrix(found).as_rotvec(), [0, 0, 0.4])
    for no_rotation in (np.full((3, 3), np.nan), np.zeros((3, 3)), 2 * np.eye(3), -np.eye(3)):
        found, status = three_sps_s.direct(pure, MACHINE, near=no_rotation)
        assert status == DirectStatus.INVALID
        assert np.isnan(found).all()
    few_digits = Rotation.from_rotvec([0, 0, 0.1]).as_matrix().round(5)
    assert three_sps_s.direct(pure, MACHINE, near=few_digits)[1] == DirectStatus.CONVERGED


def test_what_is_no_rotation_has_no_legs(refuses):
    for bad in (2 * np.eye(3), np.zeros((3, 3)), -np.eye(3), np.diag([1, 1, np.nan])):
        assert np.isnan(three_sps_s.legs(bad, MACHINE)).all()
        assert np.isnan(three_sps_s.jacobian(bad, MACHINE)).all()
        assert np.isnan(three_sps_s.singularity(bad, MACHINE).determinant)
        assert np.isnan(three_sps_s.tilt_torsion(bad)).all()
        assert three_sps_s.orientation_status(bad, MACHINE)[0] == OrientationStatus.INVALID
    refuses(three_sps_s.legs, 1j * np.eye(3), MACHINE)
    refuses(three_sps_s.legs, np.ones(3), MACHINE)


def test_legs_longer_than_everything_have_no_mode_and_no_warning():
    assert three_sps_s.direct_all([[1e300] * 3, [9, 1, 1], [0, 0, 0]], MACHINE)[2].tolist() == [2, 2, 2]


def test_following_a_motion_keeps_the_mode():
    t = np.linspace(0, 2 * np.pi, 60)
    motion = three_sps_s.rotation_from_tilt_torsion(t, 0.5 + 0.1 * np.sin(3 * t), 0.8)
    legs = three_sps_s.legs(motion, MACHINE)
    legs[20] = 10, 1, 1
    found, status = three_sps_s.follow(legs, MACHINE, start=motion[0])
    rest = np.arange(60) != 20
    assert angles_between(found[rest], motion[rest]).max() < 1e-11
    assert (status[rest] == 0).all()
    assert status[20] == DirectStatus.NO_ASSEMBLY


def test_shapes_scalars_lists_and_single_precision():
    legs = by_points(Rotation.random(12, random_state=18)).reshape(3, 4, 3)
    rotations, count, status = three_sps_s.direct_all(legs, MACHINE)
    assert rotations.shape == (3, 4, 8, 3, 3)
    assert count.shape == status.shape == (3, 4)
    alone, alone_count, alone_status = three_sps_s.direct_all(legs[1, 2].tolist(), MACHINE)
    assert (alone_count, alone_status) == (count[1, 2], status[1, 2])
    # One pose and a stack round differently, and the roots of an octic of this condition lose three digits.
    np.testing.assert_allclose(alone, rotations[1, 2], rtol=0, atol=1e-12)
    assert three_sps_s.direct_all(np.zeros((0, 3)), MACHINE)[0].shape == (0, 8, 3, 3)
    near, state = three_sps_s.direct(legs[:, None], MACHINE, near=np.broadcast_to(np.eye(3), (2, 1, 3, 3)))
    assert near.shape == (3, 2, 4, 3, 3)
    assert state.shape == (3, 2, 4)
    single = three_sps_s.direct_all(legs.astype(np.float32), MACHINE)
    assert single[0].dtype == float


def test_wrong_arguments_are_an_error(refuses):
    refuses(Geometry, -1, 1, 1)
    refuses(Geometry, 1, 1, float("nan"))
    refuses(Geometry, 1, "x", 1)
    refuses(three_sps_s.direct_all, [1, 2], MACHINE)
    refuses(three_sps_s.direct_all, [1j, 2, 3], MACHINE)
    refuses(three_sps_s.direct, [2, 2, 2], MACHINE, near=[1, 0, 0])
    refuses(three_sps_s.follow, [2, 2, 2], MACHINE, start=np.eye(3), raises=ValueError)
    refuses(three_sps_s.workspace, MACHINE, (3, 1))
    refuses(three_sps_s.workspace, MACHINE, side=2)


# workspace ---------------------------------------------------------------------------------------------


def test_every_status_of_an_orientation():
    allowed = three_sps_s.rotation_from_tilt_torsion(0.2, 0.1, 0.6)
    given = [
        allowed,
        allowed.T,
        np.eye(3),
        Rotation.from_rotvec([1.5, 0.2, 0.7]).as_matrix(),
        np.full((3, 3), np.nan),
        1.0001 * allowed,
        -allowed,
    ]
    status, determinant = three_sps_s.orientation_status(given, MACHINE, (1.0, 2.4), side=1)
    names = [OrientationStatus(int(code)).name for code in status]
    assert names == ["ALLOWED", "OTHER_SIDE", "NEAR_SINGULAR", "TOO_LONG", "INVALID", "NOT_NORMAL", "INVALID"]
    assert determinant[0] > 0 > determinant[1]
    assert three_sps_s.orientation_status(allowed, MACHINE, (2.2, 2.4))[0] == OrientationStatus.TOO_SHORT


def test_shares_of_the_workspace_are_those_of_random_rotations():
    limits = (1.3, 2.7)
    found = three_sps_s.workspace(MACHINE, limits, samples=40)
    turns = Rotation.random(40000, random_state=19).as_matrix()
    status, _ = three_sps_s.orientation_status(turns, MACHINE, limits, side=1)
    share = (status == OrientationStatus.ALLOWED).mean()
    assert abs(found.share - share) < 5 * np.sqrt(share / 40000) + 0.002  # chance, and the grid's steps
    assert found.joined_share <= found.share
    either = three_sps_s.workspace(MACHINE, limits, side=0, samples=40)
    assert np.isclose(either.share, 2 * found.share, rtol=0.02)  # a mirror image is on the other side


def test_a_workspace_without_allowed_orientations_is_reported():
    found = three_sps_s.workspace(MACHINE, (0.1, 0.2), samples=8)
    assert found.share == found.joined_share == 0
    assert not found.joined.any()
    assert np.isnan(found.best).all()


def test_the_page_s_examples_run_and_give_what_it_says():
    page = (Path(__file__).parents[1] / "docs/mechanisms/three_sps_s.md").read_text(encoding="utf-8")
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.S):
        exec(block, names)
    assert np.allclose(names["legs"], [254.637, 277.575, 321.192], rtol=0, atol=5e-4)
    assert (names["count"], names["status"]) == (2, DirectStatus.CONVERGED)
    assert angles_between(names["found"], names["turned"]) < 1e-12
    assert names["system"].rank == 5
    assert np.allclose(np.abs(names["free"].direction), [0, 0, 1])
    longer = three_sps_s.direct_all(three_sps_s.legs(np.eye(3), names["machine"]) + 1e-3, names["machine"])
    torsions = three_sps_s.tilt_torsion(longer[0][:2])[:, 2]
    assert np.allclose(np.sort(np.degrees(torsions)), [-0.273, 0.273], atol=5e-4)


@pytest.mark.slow
def test_no_mode_is_missing_on_machines_of_every_shape():
    """Dimensions over a factor of 50, pivots above and below: each pose is found, and signs balance."""
    rng = np.random.default_rng(21)
    for number in range(60):
        dims = np.exp(rng.uniform(-2, 2, 3)) * [1, 1, rng.choice([-1, 1])]
        machine = Geometry(*dims)
        turns = Rotation.random(3000, random_state=number)
        legs = by_points(turns, machine)
        result = three_sps_s.direct_all(legs, machine)
        check_modes(legs, machine, result)
        assert (result[2] <= DirectStatus.SINGULAR).all()
        apart = angles_between(result[0], turns.as_matrix()[:, None])
        nearest = np.where(np.isnan(apart), np.inf, apart).min(axis=1)
        determinant = np.abs(three_sps_s.singularity(turns.as_matrix(), machine).determinant)
        assert (nearest < 1e-12 + 1e-11 / np.maximum(determinant, 1e-9)).all()
