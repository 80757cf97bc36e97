"""Reverse analysis of robots, held to Newton's method from 300 starts: it misses nothing, and nothing of it is wrong.

The search (`numeric_reverse`) is plain NumPy with its own forward analysis: an error in a convention would show.
"""

from __future__ import annotations

import numpy as np
import pytest
from numeric_reverse import Chain, errors, forward, reach, search, wrapped

from rodgen.kinematics import spatial
from rodgen.kinematics.spatial import ReverseStatus

ROBOTS = {"puma": spatial.PUMA_560, "p60": spatial.GE_P60, "t3": spatial.T3_776}
BAR = 1e-10
"""Of position, relative to the reach, and of angle."""


def random_poses(mechanism: spatial.Mechanism, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return forward(mechanism, rng.uniform(-np.pi, np.pi, (count, 6)))


def there(found: spatial.Reverse) -> np.ndarray:
    return found.status <= ReverseStatus.FAMILY


def check_is_solution(mechanism: spatial.Mechanism, T: np.ndarray, found: spatial.Reverse) -> None:
    """Hold every solution against the pose, and every slot against its status."""
    good = there(found)
    shape = found.solutions.shape
    assert found.status.shape == shape[:-1]
    assert (np.isfinite(found.solutions).all(axis=-1) == good).all()
    assert np.isnan(found.solutions[~good]).all()
    assert (good[..., :-1] >= good[..., 1:]).all(), "those that there are come first"
    q = found.solutions[good]
    assert ((-np.pi < q) & (q <= np.pi)).all()
    pose = np.broadcast_to(T[..., None, :, :], (*shape[:-1], 4, 4))[good]
    distance, angle = errors(mechanism, q, pose)
    assert distance.max(initial=0.0) < BAR
    assert angle.max(initial=0.0) < BAR


def check_misses_nothing(
    mechanism: spatial.Mechanism, T: np.ndarray, found: spatial.Reverse, **how: int
) -> int:
    """Hold the solutions against those of the search; return how many these are."""
    total = 0
    for status, solutions, numeric in zip(
        found.status, found.solutions, search(mechanism, T, **how), strict=True
    ):
        there = solutions[status <= ReverseStatus.FAMILY]
        assert len(there) >= len(numeric.solutions)
        total += len(numeric.solutions)
        for q, condition in zip(numeric.solutions, numeric.condition, strict=True):
            off = np.abs(wrapped(there - q)).max(axis=1)
            # Newton's own rounding is some units of 1e-16 times the condition.
            assert off.min() < BAR + 1e-13 * condition
        regular = solutions[status == ReverseStatus.REGULAR]
        apart = np.abs(wrapped(regular[:, None] - regular)).max(axis=2) + 10 * np.eye(len(regular))
        assert apart.min(initial=10.0) > 1e-7, "the same solution twice"
    return total


@pytest.mark.parametrize(
    ("count", "seed", "how"),
    [(8, 1, {}), pytest.param(1000, 2, {"starts": 300, "seed": 3}, marks=pytest.mark.slow)],
    ids=["few", "many"],
)
@pytest.mark.parametrize("name", ROBOTS)
def test_every_solution_of_the_search_is_found(name: str, count: int, seed: int, how: dict[str, int]) -> None:
    mechanism = ROBOTS[name]
    T = random_poses(mechanism, count, seed=seed)
    found = spatial.reverse(mechanism, T)
    check_is_solution(mechanism, T, found)
    assert check_misses_nothing(mechanism, T, found, **how) >= count * 4


@pytest.mark.parametrize("name", ROBOTS)
def test_the_pose_of_random_joints_leads_back_to_them(name: str) -> None:
    mechanism = ROBOTS[name]
    q = np.random.default_rng(4).uniform(-np.pi, np.pi, (3000, 6))
    T = forward(mechanism, q)
    found = spatial.reverse(mechanism, T)
    check_is_solution(mechanism, T, found)
    off = np.abs(wrapped(found.solutions - q[:, None])).max(axis=-1)
    nearest = np.where(there(found), off, np.inf).min(axis=1)
    # Of 3000 random poses some are near a singular one, where the joints are known less well than the pose.
    assert np.quantile(nearest, 0.99) < BAR
    assert nearest.max() < 1e-6


def test_published_example_of_the_p60() -> None:
    """Crane and Duffy's course: the tool at (80, 80, 18) cm; two of the eight sets of angles, in degrees."""
    x, z = np.array([1, 2, -1]) / np.sqrt(6), np.array([-1, 1, 1]) / np.sqrt(3)
    R = np.column_stack([x, np.cross(z, x), z])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.array([80.0, 80, 18]) - R @ [2.0, 3, 5]
    found = spatial.reverse(spatial.GE_P60, T)
    assert (found.status == ReverseStatus.REGULAR).sum() == 8
    degrees = np.degrees(found.solutions)
    for published in (
        (-139.4434, 142.8251, 73.3548, 60.0729, 144.4928, -52.3343),
        (30.7305, 58.1274, -103.3851, -63.9599, 37.6924, 143.7742),
    ):
        assert np.abs(degrees - published).max(axis=1).min() < 6e-5


def test_shapes_and_what_cannot_be_reached() -> None:
    T = random_poses(spatial.PUMA_560, 6, seed=5).reshape(2, 3, 4, 4)
    T[0, 1, :3, 3] *= 100
    T[1, 2, 0, 0] = np.nan
    found = spatial.reverse(spatial.PUMA_560, T)
    assert found.solutions.shape == (2, 3, 8, 6)
    assert (found.status[0, 1] == ReverseStatus.NONE).all()
    assert (found.status[1, 2] == ReverseStatus.INVALID).all()
    one = spatial.reverse(spatial.PUMA_560, T[0, 0])
    # one pose a call is solved by itself, poses of a stack side by side: some digits are rounded otherwise
    np.testing.assert_allclose(one.solutions, found.solutions[0, 0], rtol=0, atol=2e-15)
    empty = spatial.reverse(spatial.PUMA_560, np.empty((0, 4, 4)))
    assert empty.solutions.shape == (0, 8, 6)


def test_what_is_no_pose_is_invalid() -> None:
    scaled, mirrored, row = (np.eye(4) for _ in range(3))
    scaled[:3, :3] *= 1.01
    mirrored[2, 2] = -1
    row[3, 0] = 1
    status = spatial.reverse(spatial.T3_776, np.array([scaled, mirrored, row])).status
    assert (status == ReverseStatus.INVALID).all()


# degenerate poses --------------------------------------------------------------------------------------


def family_members(mechanism: spatial.Mechanism, T: np.ndarray, seed: int) -> np.ndarray:
    """Return different solutions of one pose that Newton's method ends at."""
    return search(mechanism, T, starts=100, seed=seed)[0].solutions


@pytest.mark.parametrize(
    ("name", "angle"), [("puma", 0.0), ("puma", np.pi), ("p60", 0.0), ("p60", np.pi), ("t3", np.pi)]
)
def test_singular_wrist_is_a_family_with_its_representative(name: str, angle: float) -> None:
    mechanism = ROBOTS[name]
    q = np.random.default_rng(6).uniform(-3, 3, (80, 6))
    q[:, 4] = angle
    # Not at a straight elbow, too, where rounding of the pose is 1e-8 in the arm and then in theta5.
    rates = spatial.jacobian(mechanism, q) / np.repeat([1.0, reach(mechanism)], 3)[:, None]
    q = q[np.linalg.svd(rates, compute_uv=False)[:, 4] > 0.01]
    assert len(q) > 40
    T = forward(mechanism, q)
    found = spatial.reverse(mechanism, T)
    check_is_solution(mechanism, T, found)
    family = found.status == ReverseStatus.FAMILY
    # A folded arm brings its rounding into theta5, and the wrist may count as regular.
    assert family.any(axis=1).mean() > 0.95
    # A member of the family, but for the angles that turn about one line, is the posture that was begun with.
    singular = there(found) & (np.abs(np.sin(found.solutions[..., 4])) < 1e-9)
    other = [0, 1, 2, 4] if name != "p60" else [0, 4]
    off = np.abs(wrapped(found.solutions - q[:, None]))[..., other].max(axis=-1)
    assert np.where(singular, off, np.inf).min(axis=1).max() < 1e-6
    # And it is a family indeed: the search, too, ends at different members.
    assert len(family_members(mechanism, T[0], 7)) > 16


@pytest.mark.parametrize(
    ("name", "angle"),
    [("puma", "out"), ("puma", "in"), ("p60", 0.0), ("p60", np.pi), ("t3", "out"), ("t3", "in")],
)
def test_straight_elbow_is_double(name: str, angle: float | str) -> None:
    mechanism = ROBOTS[name]
    # The wrist's distance from S2 goes with a34 cos(theta3) + S4 sin(alpha34) sin(theta3): greatest, least.
    greatest = np.arctan2(mechanism.offset[3] * np.sin(mechanism.alpha[2]), mechanism.a[2])
    straight = {"out": greatest, "in": greatest + np.pi}.get(angle, angle)
    q = np.random.default_rng(8).uniform(-3, 3, (50, 6))
    q[:, 2] = straight
    T = forward(mechanism, q)
    found = spatial.reverse(mechanism, T)
    check_is_solution(mechanism, T, found)
    double = found.status == ReverseStatus.DOUBLE
    assert double.any(axis=1).all()
    off = np.abs(wrapped(found.solutions - q[:, None])).max(axis=-1)
    # Where two solutions meet, rounding of 1e-16 in the pose is 1e-8 in the joints.
    assert np.where(double, off, np.inf).min(axis=1).max() < 1e-6


def test_stretched_wrist_of_the_t3_is_double() -> None:
    """Its twists of 61 deg do not align S4 and S6 at theta5 = 0, but turn S6 furthest from S4: two solutions meet."""
    q = np.random.default_rng(13).uniform(-3, 3, (80, 6))
    q[:, 4] = 0.0
    T = forward(spatial.T3_776, q)
    found = spatial.reverse(spatial.T3_776, T)
    check_is_solution(spatial.T3_776, T, found)
    double = found.status == ReverseStatus.DOUBLE
    off = np.abs(wrapped(found.solutions - q[:, None])).max(axis=-1)
    assert np.where(double, off, np.inf).min(axis=1).max() < 1e-6


def test_wrist_centre_on_the_first_axis_is_a_family() -> None:
    """T3: with S2 + S3 + S4 c34 = 0 the wrist's centre reaches S1, and theta1 is free there."""
    rng = np.random.default_rng(9)
    q = rng.uniform(-3, 3, (50, 6))
    q[:, 1] = [_on_axis(t) for t in q[:, 2]]
    T = forward(spatial.T3_776, q)
    centre = T[:, :3, 3] - spatial.T3_776.offset[5] * T[:, :3, 2]
    assert np.abs(centre[:, :2]).max() < 1e-12
    found = spatial.reverse(spatial.T3_776, T)
    check_is_solution(spatial.T3_776, T, found)
    assert (found.status == ReverseStatus.FAMILY).any(axis=1).all()
    assert len(family_members(spatial.T3_776, T[0], 10)) > 16


def _on_axis(theta3: float) -> float:
    """Return the theta2 of a T3 at which the wrist's centre is on S1."""
    arm = spatial.T3_776

    def x(theta2: float) -> float:
        T = forward(arm, [0, theta2, theta3, 0, 0, 0])
        return T[0, 3] - arm.offset[5] * T[0, 2]

    # A cos + B sin = 0
    return float(np.arctan2(-x(0.0), x(np.pi / 2)))


def test_puma_cannot_bring_its_wrist_to_the_first_axis() -> None:
    """S2 = 5.9 in, which theta1 cannot make up for: A = B = 0 and D is not."""
    T = random_poses(spatial.PUMA_560, 20, seed=11)
    T[:, :2, 3] = (spatial.PUMA_560.offset[5] * T[:, :3, 2])[:, :2]
    found = spatial.reverse(spatial.PUMA_560, T)
    assert (found.status == ReverseStatus.NONE).all()
    assert all(len(each.solutions) == 0 for each in search(spatial.PUMA_560, T[:3], starts=100))


@pytest.mark.parametrize("name", ROBOTS)
def test_near_degenerate_poses_lose_no_solution(name: str) -> None:
    mechanism = ROBOTS[name]
    rng = np.random.default_rng(12)
    q = rng.uniform(-3, 3, (300, 6))
    # 1e-1 to 1e-12 off a singular wrist, then off a straight elbow
    distance = 10.0 ** rng.uniform(-12, -1, 300)
    q[:, 4] = (np.pi if name == "t3" else 0.0) + distance
    T = forward(mechanism, q)
    found = spatial.reverse(mechanism, T)
    check_is_solution(mechanism, T, found)
    assert there(found).any(axis=1).all()


# other arms of six turning joints ----------------------------------------------------------------------


def special_arm(kind: str, place: int, seed: int) -> Chain:
    """Return a random arm whose axes `place`, `place` + 1, `place` + 2 (from 0) meet in one point or are parallel."""
    rng = np.random.default_rng(seed)
    a, alpha = rng.uniform(0.3, 1.5, 5), rng.uniform(0.4, 2.7, 5) * rng.choice([-1, 1], 5)
    S = np.concatenate([[0.0], rng.uniform(-1, 1, 4), [0.5]])
    if kind == "meet":
        a[place : place + 2], S[place + 1] = 0.0, 0.0
    else:
        alpha[place : place + 2] = 0.0
    return Chain("RRRRRR", a, alpha, S, np.full(6, np.nan), np.zeros(6))


@pytest.mark.quick("meet-1", "meet-2", "meet-3", "parallel-0", "parallel-2")
@pytest.mark.thorough("meet-1", "meet-2", "meet-3")
@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("kind", ["meet", "parallel"])
def test_arms_with_three_special_axes(kind: str, place: int) -> None:
    chain = special_arm(kind, place, seed=20 + place)
    mechanism = spatial.Mechanism(chain.joints, chain.a, chain.alpha, chain.offset)
    T = random_poses(mechanism, 6, seed=21)
    found = spatial.reverse(mechanism, T)
    check_is_solution(mechanism, T, found)
    assert check_misses_nothing(mechanism, T, found) >= 6 * 2
