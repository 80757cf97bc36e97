"""All poses of a Tricept with given rods: are they solutions, and are there no others?

Completeness is held against two independent counts: exact arithmetic (the positive roots of the resultant over the
rationals, by Sturm's theorem), and Newton's method by SciPy from many starts.
"""

import numpy as np
import pytest
import sympy as sp
from lazy import LazyDerivation
from scipy.optimize import fsolve

from rodgen.kinematics import tricept
from rodgen.kinematics.tricept import PAPER, Geometry

pytestmark = pytest.mark.xdist_group("tricept")
paper = LazyDerivation("tricept")


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


# rational rods and radii, from the paper's machine to very different ones
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
    values = dict(zip((paper.R, paper.r, paper.A0, paper.A1, paper.Am), numbers, strict=True))
    resultant, linear = paper.exact_resultant(values)
    resultant, _ = paper.without(resultant, sp.Poly(resultant.gen, resultant.gen))
    resultant, _ = paper.without(resultant, linear)
    assert sp.gcd(resultant, resultant.diff()).degree() == 0  # so each root is one pair of poses
    R, r, *legs = map(float, numbers)
    _, count = tricept.direct_all(legs, Geometry(R, r))
    assert count == 2 * resultant.count_roots(0, sp.oo)


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


@pytest.mark.slow
def test_counts_are_those_of_exact_arithmetic_for_many_random_machines():
    rng = np.random.default_rng(9)
    for _ in range(150):
        numbers = [int(x) for x in rng.integers(20, 100, 5)]
        values = dict(zip((paper.R, paper.r, paper.A0, paper.A1, paper.Am), numbers, strict=True))
        resultant, linear = paper.exact_resultant(values)
        resultant, _ = paper.without(resultant, sp.Poly(resultant.gen, resultant.gen))
        resultant, _ = paper.without(resultant, linear)
        if sp.gcd(resultant, resultant.diff()).degree() > 0:
            continue
        R, r, *legs = map(float, numbers)
        assert tricept.direct_all(legs, Geometry(R, r))[1] == 2 * resultant.count_roots(0, sp.oo), numbers


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
