"""The Tricept's public functions, against vector geometry, SciPy's solvers, differences, sampling and symmetry.

Poses and rods of the reference are computed here from rotation matrices and distances of joints, without a formula of
the paper.
"""

import numpy as np
import pytest
import sympy as sp
from lazy import LazyDerivation
from scipy.optimize import fsolve, minimize, root
from scipy.spatial.transform import Rotation

import rodgen
from rodgen.kinematics import tricept
from rodgen.kinematics.backend import kernels
from rodgen.kinematics.tricept import LEG_LIMITS, PAPER, Geometry, TriceptStatus

WITH_Q = Geometry(330.0, 140.0, (20.0, -30.0, 50.0))
OTHER = Geometry(250.0, 110.0, (-15.0, 5.0, 120.0))
MACHINES = [PAPER, WITH_Q, OTHER]
E = np.stack([[np.cos(t), np.sin(t), 0] for t in np.radians([0, 120, -120])])


def turn(pose):
    """Orientation by SciPy; the paper's α is the opposite of the right-handed angle."""
    pose = np.asarray(pose, float).reshape(-1, 3)
    about_x = Rotation.from_rotvec(-pose[:, :1] * [1, 0, 0])
    about_y = Rotation.from_rotvec(pose[:, 1:2] * [0, 1, 0])
    return (about_y * about_x).as_matrix()


def reference_point(pose, geometry):
    pose = np.asarray(pose, float).reshape(-1, 3)
    shifted = np.array(geometry.q) + np.array([0, 0, 1]) * pose[:, 2:]
    return np.einsum("nij,nj->ni", turn(pose), shifted)


def reference_legs(pose, geometry):
    pose = np.asarray(pose, float).reshape(-1, 3)
    joints = geometry.r * E[None] + np.array([0, 0, 1]) * pose[:, None, 2:]
    joints = np.einsum("nij,nkj->nki", turn(pose), joints)
    return np.linalg.norm(joints - geometry.R * E, axis=-1)


def random_poses(n, seed=0, tilt=0.5):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-tilt, tilt, (n, 2)), rng.uniform(560, 800, n)])


def workspace_poses(n, seed=0):
    """Poses with rods within the paper's limits, uniform in the box of poses."""
    rng = np.random.default_rng(seed)
    found = np.zeros((0, 3))
    while len(found) < n:
        pose = np.column_stack(
            [rng.uniform(-0.58, 0.58, n), rng.uniform(-0.68, 0.63, n), rng.uniform(535, 837, n)]
        )
        legs = reference_legs(pose, PAPER)
        found = np.concatenate([found, pose[((legs >= 568) & (legs <= 858)).all(axis=1)]])
    return found[:n]


# point, rotation, legs ---------------------------------------------------------------------------------


@pytest.mark.parametrize("geometry", MACHINES)
def test_point_rotation_and_legs_are_those_of_vector_geometry(geometry):
    poses = random_poses(50, tilt=3.0)
    np.testing.assert_allclose(tricept.rotation(poses), turn(poses), atol=1e-15)
    # some ten roundings of lengths below 1000
    np.testing.assert_allclose(tricept.point(poses, geometry), reference_point(poses, geometry), atol=2e-12)
    np.testing.assert_allclose(tricept.legs(poses, geometry), reference_legs(poses, geometry), rtol=4e-15)


def test_a_positive_alpha_moves_the_platform_towards_positive_y():
    assert tricept.point([0.1, 0.0, 600.0], PAPER)[1] > 0
    assert tricept.point([0.0, 0.1, 600.0], PAPER)[0] > 0


# inverse -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("geometry", MACHINES)
def test_all_four_poses_reach_the_point_and_the_first_is_the_machines(geometry):
    poses = random_poses(200)
    points = reference_point(poses, geometry)
    found, legs, status = tricept.inverse(points, geometry)
    assert (status == TriceptStatus.REACHABLE).all()
    for branch in range(4):
        # 1e-15 of the point times a condition number below 10
        np.testing.assert_allclose(reference_point(found[:, branch], geometry), points, atol=1e-11)
        np.testing.assert_allclose(legs[:, branch], reference_legs(found[:, branch], geometry), rtol=1e-14)
    np.testing.assert_allclose(found[:, 0], poses, atol=1e-11)
    apart = np.abs(np.exp(1j * found[:, :, None, :2]) - np.exp(1j * found[:, None, :, :2])).max(axis=-1)
    apart += np.abs(found[:, :, None, 2] - found[:, None, :, 2])
    assert (apart[:, *np.triu_indices(4, 1)] > 0.1).all()


def test_pose_is_the_first_of_the_four():
    points = np.concatenate(
        [reference_point(random_poses(50), WITH_Q), [[0, 700, 0], [0, 0, 5], [np.nan, 0, 600], [0, 0, 400]]]
    )
    poses, legs, status = tricept.inverse(points, WITH_Q, LEG_LIMITS)
    pose, rods, code = tricept.pose(points, WITH_Q, LEG_LIMITS)
    np.testing.assert_array_equal(code, status[:, 0])
    assert set(code.tolist()) >= {TriceptStatus.REACHABLE, TriceptStatus.OUT_OF_LIMITS, TriceptStatus.INVALID}
    np.testing.assert_allclose(pose, poses[:, 0], rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(rods, legs[:, 0], rtol=1e-14)


@pytest.mark.parametrize("geometry", [PAPER, WITH_Q])
def test_there_are_no_other_poses(geometry):
    """SciPy's solver, from many starts, comes to nothing but the four."""
    rng = np.random.default_rng(5)
    point = reference_point([[0.2, -0.3, 650.0]], geometry)[0]
    four = tricept.inverse(point, geometry)[0]
    reached = set()
    for _ in range(150):
        start = [*rng.uniform(-np.pi, np.pi, 2), rng.uniform(-900, 900)]
        done = root(lambda x: (reference_point(x, geometry)[0] - point) / 600, start)
        if not done.success or np.abs(done.fun).max() > 1e-9:
            continue
        near = np.abs(np.exp(1j * four[:, :2]) - np.exp(1j * done.x[:2])).max(axis=1)
        near += np.abs(four[:, 2] - done.x[2]) / 600
        assert near.min() < 1e-6
        reached.add(int(near.argmin()))
    assert reached == {0, 1, 2, 3}


def test_limits_are_inclusive_and_judged_rod_by_rod():
    legs = tricept.inverse([30.0, 40.0, 650.0], PAPER)[1][0]
    for limits, expected in (
        ((legs.min(), legs.max()), TriceptStatus.REACHABLE),
        ((np.nextafter(legs.min(), 1e9), legs.max()), TriceptStatus.OUT_OF_LIMITS),
        ((legs.min(), np.nextafter(legs.max(), 0)), TriceptStatus.OUT_OF_LIMITS),
    ):
        assert tricept.inverse([30.0, 40.0, 650.0], PAPER, limits)[2][0] == expected


def test_a_point_that_beta_does_not_move_is_a_gimbal_lock():
    poses, _, status = tricept.inverse([0.0, 700.0, 0.0], PAPER)
    assert (status == TriceptStatus.GIMBAL_LOCK).all()
    np.testing.assert_allclose(poses[0], [np.pi / 2, 0, 700])
    np.testing.assert_allclose(reference_point(poses, PAPER), [[0, 700, 0]] * 4, atol=1e-12)
    assert (tricept.inverse([0.0, 0.0, 0.0], PAPER)[2] == TriceptStatus.GIMBAL_LOCK).all()


def test_where_a_root_vanishes_two_poses_meet_and_beyond_there_is_none():
    geometry = Geometry(330, 140, (50.0, 0.0, 0.0))
    poses, _, status = tricept.inverse([30.0, 100.0, 40.0], geometry)  # 30² + 40² = 50²
    assert (status == TriceptStatus.DOUBLE_POSE).all()
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-7)
    np.testing.assert_allclose(reference_point(poses, geometry), [[30, 100, 40]] * 4, atol=1e-6)
    poses, legs, status = tricept.inverse([30.0, 100.0, 39.0], geometry)
    assert (status == TriceptStatus.UNREACHABLE).all()
    assert np.isnan(poses).all()
    assert np.isnan(legs).all()
    near = tricept.inverse([30.0, 100.0, 40.001], geometry)
    assert (near[2] == TriceptStatus.REACHABLE).all()
    np.testing.assert_allclose(reference_point(near[0], geometry), [[30, 100, 40.001]] * 4, atol=1e-9)
    # the other root: |Q|² = q_y² with Q_x, Q_z nearly nothing
    other = Geometry(330, 140, (0.0, 50.0, 10.0))
    assert (tricept.inverse([0.0, 30.0, 40.0], other)[2] == TriceptStatus.DOUBLE_POSE).all()
    assert (tricept.inverse([0.0, 30.0, 39.0], other)[2] == TriceptStatus.UNREACHABLE).all()


def test_a_machine_that_is_none_is_refused(refuses):
    for R, r, q in (
        (-330, 140, (0, 0, 0)),
        (330, 0, (0, 0, 0)),
        (330, np.nan, (0, 0, 0)),
        (330, 140, (0, 0)),
    ):
        refuses(Geometry, R, r, q)
    refuses(tricept.inverse, [0, 0, 600], PAPER, (858, 568))
    refuses(tricept.inverse, [0, 0, 600], PAPER, (np.nan, 568))
    refuses(tricept.inverse, [0, 0], PAPER, raises=ValueError)


# derivatives and uncertainty ---------------------------------------------------------------------------


def differences(function, x, step=1e-3):
    """Central differences with Richardson's extrapolation: the error is of the fourth order in the step."""

    def central(h):
        return np.stack(
            [(function(x + h * e) - function(x - h * e)) / (2 * h) for e in np.eye(len(x))], axis=-1
        )

    return (4 * central(step / 2) - central(step)) / 3


@pytest.mark.parametrize("geometry", MACHINES)
def test_matrices_are_derivatives_of_pose_point_and_rods(geometry):
    for pose in random_poses(4, seed=1):
        found = tricept.matrices(pose, geometry)
        M33 = differences(lambda x: reference_point(x, geometry)[0], pose)
        # rounding: 1e-13 of a length of 700, over a step of 1e-3
        np.testing.assert_allclose(found.M33, M33, atol=2e-9)
        rods = differences(lambda x: reference_legs(x, geometry)[0], pose)
        np.testing.assert_allclose(found.M35[:, :3], np.linalg.inv(rods), rtol=1e-6, atol=1e-11)
        radii = differences(
            lambda x, pose=pose: reference_legs(pose, Geometry(x[1], x[0], geometry.q))[0],
            np.array([geometry.r, geometry.R]),
        )
        np.testing.assert_allclose(found.M35[:, 3:], -np.linalg.solve(rods, radii), rtol=1e-6, atol=1e-10)
        np.testing.assert_allclose(found.A35, found.M33 @ found.M35, rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(found.M35, -np.linalg.solve(found.W33, found.W35), rtol=1e-10, atol=1e-14)
        alone = kernels.tricept_sensitivity(pose, *geometry.radii, *geometry.q)
        np.testing.assert_allclose(alone, found.A35, rtol=1e-12, atol=1e-14)


def test_equal_radii_leave_the_machine_regular():
    """R = r: the rods are parallel at home, and radii then do not move the point."""
    geometry = Geometry(200.0, 200.0)
    A = tricept.matrices([0.0, 0.0, 600.0], geometry).A35
    np.testing.assert_allclose(A[:, 3:], 0, atol=1e-15)
    assert np.isfinite(A).all()
    pose = [0.2, -0.1, 600.0]
    found, status = tricept.direct(tricept.legs(pose, geometry), geometry)
    assert status == TriceptStatus.REACHABLE
    np.testing.assert_allclose(found, pose, atol=1e-11)


@pytest.mark.parametrize("geometry", MACHINES)
def test_propagation_is_a_u_at(geometry):
    rng = np.random.default_rng(3)
    poses = random_poses(100, seed=2, tilt=0.4)
    half = rng.normal(size=(100, 5, 5)) * 3e-3
    U_x = half @ half.swapaxes(1, 2)
    A = tricept.matrices(poses, geometry).A35
    U_y, status = tricept.propagate(reference_point(poses, geometry), geometry, U_x)
    assert (status == TriceptStatus.REACHABLE).all()
    expected = A @ U_x @ A.swapaxes(1, 2)
    np.testing.assert_allclose(U_y, expected, rtol=1e-10, atol=1e-15)
    np.testing.assert_array_equal(U_y, U_y.swapaxes(1, 2))


def test_covariances_are_taken_and_others_refused():
    rng = np.random.default_rng(0)
    point = [30.0, 20.0, 650.0]
    good = [np.zeros((5, 5)), np.diag([1, 0, 0, 0, 0.0]), np.ones((5, 5))]
    for rank in range(
        1, 6
    ):  # products, as a fit makes them; singular ones rounded to slightly negative eigenvalues
        for size in (1e-12, 1.0, 1e6):
            half = size * rng.normal(size=(5, rank))
            good.append(half @ half.T)
            unequal = half * np.logspace(-6, 6, 5)[:, None]
            good.append(unequal @ unequal.T)
    status = tricept.propagate(point, PAPER, np.array(good))[1]
    assert (status == TriceptStatus.REACHABLE).all()
    bad = []
    for _ in range(30):
        turned = np.linalg.qr(rng.normal(size=(5, 5)))[0]
        bad.append(turned @ np.diag([1, 1, 1, 1, -1e-3]) @ turned.T)
    unsymmetric = np.eye(5)
    unsymmetric[1, 3] = 1e-6
    bad += [
        unsymmetric,
        -np.eye(5),
        np.full((5, 5), np.nan),
        np.diag([1, 1, 1, 1, -1e-300]),
        np.diag([np.inf, 1, 1, 1, 1]),
    ]
    lone = np.zeros((5, 5))
    lone[0, 1] = lone[1, 0] = 1e-9
    bad.append(lone)
    U_y, status = tricept.propagate(point, PAPER, np.array(bad))
    assert (status == TriceptStatus.NOT_COVARIANCE).all()
    assert np.isnan(U_y).all()


def test_propagation_tells_unreachable_out_of_limits_and_invalid():
    U_x = np.eye(5) * 1e-6
    geometry = Geometry(330, 140, (50.0, 0.0, 0.0))
    U_y, status = tricept.propagate([[30, 100, 39], [np.nan, 0, 600]], geometry, U_x)
    assert status.tolist() == [TriceptStatus.UNREACHABLE, TriceptStatus.INVALID]
    assert np.isnan(U_y).all()
    # a constant covariance over more points than a block of the loops, and one that is none
    many = np.tile([[30.0, 20.0, 650.0]], (100, 1))
    assert (tricept.propagate(many, PAPER, U_x)[1] == TriceptStatus.REACHABLE).all()
    assert (tricept.propagate(many, PAPER, -U_x)[1] == TriceptStatus.NOT_COVARIANCE).all()
    U_y, status = tricept.propagate([0, 0, 500], PAPER, U_x, LEG_LIMITS)
    assert status == TriceptStatus.OUT_OF_LIMITS
    assert np.isfinite(U_y).all()


# singularities -----------------------------------------------------------------------------------------


def test_a_singular_pose_has_an_infinite_condition():
    """z = 0 at home: the rods lie in the base's plane."""
    found = tricept.singularity([0.0, 0.0, 0.0], PAPER)
    assert found.det_w33 == 0
    assert np.isinf(found.condition)
    assert np.isnan(tricept.matrices([0.0, 0.0, 0.0], PAPER).A35).all()
    assert np.isnan(tricept.singularity([np.nan, 0, 600], PAPER).condition)


def test_det_w33_changes_its_sign_where_an_assembly_is_left():
    """Between the pose of the machine and the one turned by half a turn with the same rods it must vanish somewhere."""
    poses, _ = tricept.direct_all([650.0, 700.0, 760.0], PAPER)
    signs = np.sign(tricept.singularity(poses[:4], PAPER).det_w33)
    assert signs[0] > 0
    assert set(signs) == {-1.0, 1.0}


# direct ------------------------------------------------------------------------------------------------


def test_direct_finds_every_pose_of_the_workspace():
    """20 000 poses within the limits, and the vertices of the rods' box: Newton's method never fails, to 1e-12."""
    poses = workspace_poses(20_000)
    found, status = rodgen.kinematics.backend.kernels.tricept_direct(
        reference_legs(poses, PAPER), PAPER.r, PAPER.R
    )
    assert (status == TriceptStatus.REACHABLE).all()
    np.testing.assert_allclose(found, poses, rtol=0, atol=2e-10)
    np.testing.assert_allclose(found[:, :2], poses[:, :2], rtol=0, atol=1e-12)
    grid = np.stack(np.meshgrid(*[np.linspace(568, 858, 21)] * 3), axis=-1).reshape(-1, 3)
    found, status = rodgen.kinematics.backend.kernels.tricept_direct(grid, PAPER.r, PAPER.R)
    assert (status == TriceptStatus.REACHABLE).all()
    np.testing.assert_allclose(tricept.legs(found, PAPER), grid, rtol=1e-14)


def test_rods_that_meet_nowhere_are_unreachable():
    _, status = tricept.direct([[100.0, 100.0, 100.0], [600.0, 600.0, 2000.0], [600.0, -600.0, 600.0]], PAPER)
    assert status.tolist() == [
        TriceptStatus.UNREACHABLE,
        TriceptStatus.UNREACHABLE,
        TriceptStatus.INVALID,
    ]


def test_dask_arrays_pass_through():
    dask = pytest.importorskip("dask.array")
    poses = random_poses(100)
    legs = tricept.legs(dask.from_array(poses, chunks=(30, 3)), PAPER)
    np.testing.assert_array_equal(np.asarray(legs.compute()), tricept.legs(poses, PAPER))
    pose, _ = tricept.direct(legs, PAPER)
    np.testing.assert_allclose(np.asarray(pose.compute()), poses, atol=1e-10)


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0), (40.0, -25.0, 60.0)])
def test_points_behind_the_base_are_not_of_the_assembled_machine(q):
    geometry = tricept.Geometry(330.0, 140.0, q)
    random = np.random.default_rng(8)
    points = random.uniform(-700, 700, (4000, 3))
    pose, rods, status = tricept.pose(points, geometry)
    cosines = np.cos(tricept.inverse(points, geometry)[0][:, 0, :2])
    with np.errstate(invalid="ignore"):
        assembled = (cosines > 0).all(axis=1)
    reached = status == tricept.TriceptStatus.REACHABLE
    assert 500 < reached.sum() < 3500
    np.testing.assert_array_equal(reached, assembled)
    assert np.isfinite(pose[reached]).all()
    assert np.isnan(rods[~reached]).all()
    U_x = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
    U_y, code = tricept.propagate(points, geometry, U_x)
    np.testing.assert_array_equal(code == tricept.TriceptStatus.REACHABLE, reached)
    assert np.isnan(U_y[~reached]).all()
    # within the limits, where there is one pose, it comes back by the direct problem
    low, high = tricept.LEG_LIMITS
    within = ((rods > low) & (rods < high)).all(axis=1)
    assert within.sum() > 20
    back, _ = tricept.direct(rods[within], geometry)
    np.testing.assert_allclose(tricept.point(back, geometry), points[within], atol=1e-6)


@pytest.fixture(scope="module")
def paper():
    return tricept.workspace(PAPER, LEG_LIMITS, samples=200)


@pytest.mark.parametrize("geometry", [PAPER, WITH_Q])
def test_a_beam_is_inside_exactly_where_the_rods_are_within_the_limits(geometry):
    rng = np.random.default_rng(0)
    alpha, beta = rng.uniform(-0.7, 0.7, (2, 300))
    found = tricept.beams(alpha, beta, geometry, LEG_LIMITS)
    z = rng.uniform(300, 1000, (300, 200))
    pose = np.stack(np.broadcast_arrays(alpha[:, None], beta[:, None], z), axis=-1)
    legs = tricept.legs(pose, geometry)
    within = ((legs >= LEG_LIMITS[0]) & (legs <= LEG_LIMITS[1])).all(axis=-1)
    place = (z[..., None] >= found.ends[:, None, :]).sum(axis=-1) - 1
    told = np.take_along_axis(found.inside, np.clip(place, 0, 7), axis=1) & (place >= 0) & (place < 8)
    np.testing.assert_array_equal(told, within)
    assert within.any()
    assert not within.all()
    # and at each end of a part that is inside a rod has a length of the limits
    rows, parts = np.nonzero(found.inside)
    for end in (parts, parts + 1):
        pose = np.column_stack([alpha[rows], beta[rows], found.ends[rows, end]])
        legs = tricept.legs(pose, geometry)
        gap = np.minimum(np.abs(legs - LEG_LIMITS[0]), np.abs(legs - LEG_LIMITS[1])).min(axis=1)
        assert gap.max() < 1e-9


def test_a_rod_that_gets_too_short_leaves_a_hole_in_a_beam():
    """The platform's joint passes the base's: the beam is inside before and after."""
    geometry, limits = Geometry(100.0, 20.0), (40.0, 400.0)
    found = tricept.beams(0.0, 1.4, geometry, limits)
    z = (np.arange(50_000) + 0.5) / 100
    legs = tricept.legs(np.column_stack([0 * z, 0 * z + 1.4, z]), geometry)
    within = ((legs >= limits[0]) & (legs <= limits[1])).all(axis=-1)
    starts = np.count_nonzero(within & ~np.r_[False, within[:-1]])
    assert starts == 2
    merged = found.inside & ~np.r_[False, found.inside[:-1]]
    assert np.count_nonzero(merged) == 2
    length = np.where(found.inside, np.diff(found.ends), 0).sum()
    assert length == pytest.approx(within.sum() / 100, abs=0.05)


@pytest.mark.thorough
@pytest.mark.parametrize("geometry", [PAPER, WITH_Q])
def test_volume_is_that_of_random_points(geometry):
    found = tricept.workspace(geometry, LEG_LIMITS, samples=200)
    rng = np.random.default_rng(1)
    box, n = found.extents, 400_000
    points = rng.uniform(box[:, 0], box[:, 1], (n, 3))
    share = tricept.reachable(points, geometry, LEG_LIMITS).mean()
    whole = np.prod(np.diff(box))
    deviation = whole * np.sqrt(share * (1 - share) / n)
    assert abs(found.volume - whole * share) < 4 * deviation
    assert found.volume_error < 1e-4 * found.volume


@pytest.mark.slow
def test_the_quadrature_says_how_far_it_is_off(paper):
    fine = tricept.workspace(PAPER, LEG_LIMITS, samples=1200)
    assert abs(paper.volume - fine.volume) < paper.volume_error
    assert fine.volume == pytest.approx(47.5058e6, rel=2e-6)


def test_the_papers_machine_is_symmetric_in_y_and_not_in_x(paper):
    np.testing.assert_allclose(paper.extents[1], [-paper.extents[1, 1], -paper.extents[1, 0]], rtol=1e-9)
    assert abs(paper.extents[0].sum()) > 10
    assert paper.pose_extents[2, 1] == pytest.approx(np.sqrt(858**2 - 190**2), abs=1e-9)
    assert paper.pose_extents[2, 0] == pytest.approx(np.sqrt(568**2 - 190**2), abs=1e-9)


def test_no_point_lies_beyond_the_extents_and_an_optimiser_comes_no_farther(paper):
    """In metres: with lengths of the size of angles SLSQP keeps the limits of the rods to some 1e-9 mm."""
    machine, (shortest, longest) = Geometry(PAPER.R / 1000, PAPER.r / 1000), np.array(LEG_LIMITS) / 1000
    keep_the_limits = [
        {"type": "ineq", "fun": lambda x: tricept.legs(x, machine) - shortest},
        {"type": "ineq", "fun": lambda x: longest - tricept.legs(x, machine)},
    ]
    rng = np.random.default_rng(2)
    for component in range(3):
        for sign, end in ((-1, paper.extents[component, 0]), (1, paper.extents[component, 1])):
            best = -np.inf
            for _ in range(12):
                done = minimize(
                    lambda x, sign=sign, component=component: -sign * tricept.point(x, machine)[component],
                    [*rng.uniform(-0.6, 0.6, 2), rng.uniform(0.6, 0.76)],
                    bounds=[(-1.2, 1.2), (-1.2, 1.2), (0.3, 0.9)],
                    constraints=keep_the_limits,
                    method="SLSQP",
                    options={"maxiter": 300, "ftol": 1e-12},
                )
                if done.success:
                    best = max(best, -1000 * done.fun)
            assert best <= sign * end + 1e-5
            assert best == pytest.approx(sign * end, abs=1e-5)  # it gets there from one of the starts


def test_the_machine_is_nowhere_singular_within_its_limits(paper):
    assert paper.ratio[0] == pytest.approx(0.63628656, abs=1e-7)
    assert paper.ratio[1] == pytest.approx(1.0, abs=1e-9)
    rng = np.random.default_rng(3)
    points = rng.uniform(paper.extents[:, 0], paper.extents[:, 1], (100_000, 3))
    poses, _, status = tricept.inverse(points, PAPER, LEG_LIMITS)
    ratio = tricept.singularity(poses[status[:, 0] == 0, 0], PAPER).ratio
    assert paper.ratio[0] <= ratio.min() < 0.68
    assert ratio.max() <= paper.ratio[1]


def test_points_behind_the_base_are_not_reached():
    """Rods within the limits, but with the platform turned over."""
    point = [0.0, 0.0, -700.0]
    assert tricept.inverse(point, PAPER, LEG_LIMITS)[2][0] == TriceptStatus.REACHABLE
    assert not tricept.reachable(point, PAPER, LEG_LIMITS)


def test_rods_that_allow_nothing(refuses):
    refuses(tricept.workspace, PAPER, (1.0, 2.0))
    refuses(tricept.workspace, PAPER, (1.0, np.inf))


# All poses of a Tricept with given rods: are they solutions, and are there no others?


derivation = LazyDerivation("tricept")


def parts(pose):
    """Coordinates that distinguish two poses, of order 1 each."""
    pose = np.asarray(pose)
    return np.concatenate([np.cos(pose[..., :2]), np.sin(pose[..., :2]), pose[..., 2:] / 500], axis=-1)


def equations(x, legs, geometry):
    lengths = tricept.legs(x, geometry)
    return (lengths**2 - legs**2) / 1e5


@pytest.mark.parametrize("geometry", [PAPER, Geometry(300, 260), Geometry(120, 300, (3, 2, 1))])
def test_every_pose_has_the_rods_and_comes_once(geometry):
    rng = np.random.default_rng(0)
    legs = rng.uniform(300, 900, (300, 3))
    poses, count = tricept.direct_all(legs, geometry)
    there = np.arange(28) < count[:, None]
    assert (np.isfinite(poses).all(axis=-1) == there).all()
    found = tricept.legs(poses[there], geometry)
    wanted = np.repeat(legs, count, axis=0)
    np.testing.assert_allclose(
        found, wanted, rtol=1e-11
    )  # near singular poses rounding is multiplied by up to 1e3
    everything = parts(poses)
    apart = np.abs(everything[:, :, None] - everything[:, None]).max(axis=-1)
    apart[:, np.arange(28), np.arange(28)] = np.nan
    assert np.nanmin(apart) > 1e-6


def test_poses_come_in_mirrored_pairs_the_assembled_one_first():
    rng = np.random.default_rng(1)
    poses, count = tricept.direct_all(rng.uniform(568, 858, (100, 3)), PAPER)
    assert (count == 8).all()
    np.testing.assert_array_equal(poses[:, 4:8], -poses[:, :4])
    assert (poses[:, :4, 2] > 0).all()
    physical = (np.cos(poses[:, :4, :2]) > 0).all(axis=-1)
    assert (physical == [True, False, False, False]).all()
    assert (np.diff(poses[:, 1:4, 2], axis=1) < 0).all()


# rational rods and radii, from the derivation's machine to very different ones
EXACT = [
    (330, 140, 650, 700, 760),
    (330, 140, 858, 568, 700),
    (330, 140, 480, 460, 470),
    (330, 140, 300, 310, 320),
    (330, 140, 400, 501, 350),
    (330, 140, 200, 193, 190),
    (5, 3, 6, 7, 5),
    (5, 3, 4, 5, 3),
    (2, 3, 2, 4, 3),
    (3, 3, 4, 5, 3),
    (4, 1, 4, 5, 6),
]


@pytest.mark.quick("(5, 3, 4, 5, 3)", "(5, 3, 6, 7, 5)", "(330, 140, 480, 460, 470)")
@pytest.mark.thorough("(5, 3, 4, 5, 3)")
@pytest.mark.parametrize("numbers", EXACT, ids=str)
def test_count_is_that_of_exact_arithmetic(numbers):
    values = dict(
        zip((derivation.R, derivation.r, derivation.A0, derivation.A1, derivation.Am), numbers, strict=True)
    )
    resultant, linear = derivation.exact_resultant(values)
    resultant, _ = derivation.without(resultant, sp.Poly(resultant.gen, resultant.gen))
    resultant, _ = derivation.without(resultant, linear)
    assert sp.gcd(resultant, resultant.diff()).degree() == 0  # so each root is one pair of poses
    R, r, *legs = map(float, numbers)
    _, count = tricept.direct_all(legs, Geometry(R, r))
    assert count == 2 * resultant.count_roots(0, sp.oo)


@pytest.mark.slow
def test_counts_are_those_of_exact_arithmetic_for_many_random_machines():
    rng = np.random.default_rng(9)
    for _ in range(150):
        numbers = [int(x) for x in rng.integers(20, 100, 5)]
        values = dict(
            zip(
                (derivation.R, derivation.r, derivation.A0, derivation.A1, derivation.Am),
                numbers,
                strict=True,
            )
        )
        resultant, linear = derivation.exact_resultant(values)
        resultant, _ = derivation.without(resultant, sp.Poly(resultant.gen, resultant.gen))
        resultant, _ = derivation.without(resultant, linear)
        if sp.gcd(resultant, resultant.diff()).degree() > 0:
            continue
        R, r, *legs = map(float, numbers)
        assert tricept.direct_all(legs, Geometry(R, r))[1] == 2 * resultant.count_roots(0, sp.oo), numbers


@pytest.mark.parametrize(
    ("legs", "expected"),
    [
        # A1 = A-1: the resultant has double roots, of poses ±α and of poses with sin α = 0
        ((600, 600, 600), 8),
        ((650, 700, 700), 8),
        ((460, 460, 460), 12),
        ((440, 450, 450), 12),
    ],
)
@pytest.mark.parametrize("way", ["direct_all", "newton"])
def test_symmetric_rods(legs, expected, way):
    legs = np.array(legs, float)
    poses, count = tricept.direct_all(legs, PAPER)
    if way == "direct_all":
        assert count == expected
        return
    assert_newton_finds_no_others(legs, PAPER, poses[:count], starts=250)


def assert_newton_finds_no_others(legs, geometry, poses, starts, seed=0):
    """SciPy from many starts; what it finds must be among the poses, and it must find all of them."""
    rng = np.random.default_rng(seed)
    height = np.sqrt((legs**2).mean())
    reached = np.zeros(len(poses), bool)
    for _ in range(starts):
        start = [*rng.uniform(-np.pi, np.pi, 2), rng.uniform(-height, height)]
        x, _, code, _ = fsolve(equations, start, args=(legs, geometry), full_output=True, xtol=1e-12)
        if code != 1 or np.abs(equations(x, legs, geometry)).max() > 1e-10:
            continue
        near = np.abs(parts(poses) - parts(x)).max(axis=-1)
        assert near.min() < 1e-5, (legs, x)
        reached[near.argmin()] = True
    assert reached.all()


@pytest.mark.parametrize("seed", range(6))
def test_newton_from_many_starts_finds_the_same_poses(seed):
    rng = np.random.default_rng(100 + seed)
    geometry = [PAPER, Geometry(300, 250), Geometry(150, 220)][seed % 3]
    legs = rng.uniform(250, 860, 3)
    poses, count = tricept.direct_all(legs, geometry)
    assert_newton_finds_no_others(legs, geometry, poses[:count], starts=200, seed=seed)


def test_the_answer_does_not_depend_on_the_unit_or_the_batch():
    rng = np.random.default_rng(2)
    legs = rng.uniform(400, 860, (40, 3))
    poses, count = tricept.direct_all(legs, PAPER)
    in_metres, same = tricept.direct_all(legs / 1000, Geometry(0.33, 0.14))
    np.testing.assert_array_equal(count, same)
    np.testing.assert_allclose(parts(in_metres * [1, 1, 1000]), parts(poses), atol=1e-9)
    one, _ = tricept.direct_all(legs[17], PAPER)
    np.testing.assert_allclose(parts(one), parts(poses[17]), atol=1e-9)


@pytest.mark.parametrize("tilt", [0.01, 0.5, 3.1])
@pytest.mark.parametrize(
    ("R", "r", "height"), [(330, 330, 20), (330, 330, 50), (330, 140, 20), (330, 140, 0.5)]
)
def test_low_poses_are_found(R, r, height, tilt):
    """Rods nearly in the base's plane: z² is negligible compared with the squares of rods and radii."""
    rng = np.random.default_rng(3)
    geometry = Geometry(R, r)
    pose = np.column_stack([rng.uniform(-tilt, tilt, (100, 2)), height * rng.uniform(0.9, 1.1, 100)])
    legs = tricept.legs(pose, geometry)
    poses, _ = tricept.direct_all(legs, geometry)
    apart = np.abs(parts(poses) - parts(pose)[:, None]).max(axis=-1)
    assert np.nanmin(apart, axis=1).max() < 1e-5  # rounding of rods over z/R = 0.0015
    if tilt < 1:
        found, status = tricept.direct(legs, geometry)
        assert (status == tricept.TriceptStatus.REACHABLE).all()
        np.testing.assert_allclose(tricept.legs(found, geometry), legs, rtol=1e-11)


def test_rods_of_a_singular_pose():
    """All rods R − r: the platform lies in the base, where two mirrored poses meet."""
    poses, count = tricept.direct_all([190.0, 190.0, 190.0], PAPER)
    found = tricept.legs(poses[:count], PAPER)
    np.testing.assert_allclose(found, 190.0, rtol=1e-9)


def test_wrong_shapes_and_rods_that_are_none(refuses):
    refuses(tricept.direct_all, [1.0, 2.0], PAPER)
    poses, count = tricept.direct_all([[np.nan, 1, 1], [600, -600, 600], [1, 1, 1], [600, 600, 600]], PAPER)
    assert count.tolist() == [0, 0, 0, 8]
    assert np.isnan(poses[:3]).all()
    assert tricept.direct_all(np.zeros((0, 3)), PAPER)[0].shape == (0, 28, 3)
