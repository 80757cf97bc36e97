"""The workspace of the Tricept, against sampling, bisection of rods, and what symmetry demands."""

import numpy as np
import pytest
from scipy.optimize import minimize

from rodgen import RodgenError
from rodgen.kinematics import tricept
from rodgen.kinematics.tricept import LEG_LIMITS, PAPER, Geometry, TriceptStatus

WITH_Q = Geometry(330.0, 140.0, (20.0, -30.0, 50.0))


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


def test_a_slice_has_the_status_of_its_points(paper):
    found = tricept.workspace_slice(PAPER, LEG_LIMITS, "x", 50.0, 31, paper.extents)
    assert (found.points[..., 0] == 50).all()
    inside = tricept.reachable(found.points, PAPER, LEG_LIMITS)
    np.testing.assert_array_equal(found.status == TriceptStatus.REACHABLE, inside)
    assert inside.any()
    assert not inside.all()
    assert (found.ratio[inside] > 0.6).all()
    with pytest.raises(RodgenError, match="expected x, y or z"):
        tricept.workspace_slice(PAPER, LEG_LIMITS, "w", 50.0, 31, paper.extents)


def test_points_behind_the_base_are_not_reached():
    """Rods within the limits, but with the platform turned over."""
    point = [0.0, 0.0, -700.0]
    assert tricept.inverse(point, PAPER, LEG_LIMITS)[2][0] == TriceptStatus.REACHABLE
    assert not tricept.reachable(point, PAPER, LEG_LIMITS)
    box = [[-1, 1], [-1, 1], [-700, -600]]
    found = tricept.workspace_slice(PAPER, LEG_LIMITS, "z", -700.0, 3, box)
    assert (found.status == TriceptStatus.UNREACHABLE).all()


def test_rods_that_allow_nothing():
    with pytest.raises(RodgenError, match="allow no pose"):
        tricept.workspace(PAPER, (1.0, 2.0))
    with pytest.raises(RodgenError, match="infinite"):
        tricept.workspace(PAPER, (1.0, np.inf))
