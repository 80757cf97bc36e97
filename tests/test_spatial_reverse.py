"""Reverse analysis of every kind of arm: all solutions, none twice, none wrong, and the statuses where they meet."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_inputs import robot_inputs
from kernel_reference import KERNELS
from test_reverse_robots import check_is_solution, check_misses_nothing

from rodgen.kinematics import spatial
from rodgen.kinematics.spatial import ReverseStatus

pytestmark = pytest.mark.xdist_group("robots_6r")
EPS = float(np.finfo(float).eps)
KINDS = {
    "wrist": ("closed form: axes 2, 3 are parallel and axes 4, 5, 6 meet", 8),
    "parallel": ("closed form: axes 2, 3, 4 are parallel, axes 5, 6 meet", 8),
    "meet 456": ("pair of equations: axes 4, 5, 6 meet", 8),
    "meet 456 and 12": ("pair of equations: axes 4, 5, 6 meet", 8),
    "meet 456, 12 parallel": ("pair of equations: axes 4, 5, 6 meet", 8),
    "parallel 234": ("pair of equations: axes 2, 3, 4 are parallel", 16),
    "meet 234": ("pair of equations: axes 2, 3, 4 meet", 16),
    "parallel 123": ("pair of equations: axes 1, 2, 3 are parallel", 16),
}


def arm_of(kind: str, seed: int, *, backwards: bool = False) -> spatial.Mechanism:
    """An arm of one kind whose other lengths, twists and offsets are anything; or that arm read from its end."""
    rng = np.random.default_rng(seed)
    a, alpha, offset = rng.uniform(0.3, 1, 5), rng.uniform(0.4, 2.6, 5), rng.uniform(-1, 1, 6)
    alpha *= rng.choice([-1, 1], 5)
    straight = rng.choice([0.0, np.pi], 2)  # parallel axes may point against each other
    if kind == "wrist":
        alpha[1] = straight[0]
    if kind in ("parallel", "parallel 234"):
        alpha[1:3] = straight
    if kind == "parallel":
        a[4] = 0
    if kind == "wrist" or kind.startswith("meet 456"):
        a[3] = a[4] = offset[4] = 0
    if kind.endswith("and 12"):
        a[0] = 0
    if kind.endswith("12 parallel"):
        alpha[0] = straight[0]
    if kind == "meet 234":
        a[1] = a[2] = offset[2] = 0
    if kind == "parallel 123":
        alpha[:2] = straight
    if backwards:
        a, alpha, offset = -a[::-1], -alpha[::-1], -offset[::-1]
    return spatial.Mechanism("R" * 6, a, alpha, offset)


def some_poses(mechanism: spatial.Mechanism, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, 6))
    return q, spatial.forward(mechanism, q)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_the_angles_that_made_the_pose_are_among_the_solutions(kind: str, backwards: bool) -> None:
    for seed in range(4):
        mechanism = arm_of(kind, seed, backwards=backwards)
        assert spatial.group(mechanism).method.split(":")[0] == KINDS[kind][0].split(":")[0]
        q, T = some_poses(mechanism, 40, seed)
        found = spatial.reverse(mechanism, T)
        assert found.solutions.shape == (40, KINDS[kind][1], 6)
        check_is_solution(mechanism, T, found)
        assert (found.status != ReverseStatus.INCOMPLETE).all()
        off = np.abs(np.remainder(found.solutions - q[:, None] + np.pi, 2 * np.pi) - np.pi).max(axis=-1)
        # some eight roundings of the pose and of six links, times the condition of the angles in it
        reach = np.abs(mechanism.a).sum() + np.abs(mechanism.offset).sum()
        rates = spatial.jacobian(mechanism, q) / np.array([1, 1, 1, reach, reach, reach])[:, None]
        assert (np.nanmin(off, axis=-1) < 8 * EPS * np.linalg.cond(rates)).all()


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("wrist", "parallel")])
def test_newton_from_many_starts_finds_no_more(kind: str, backwards: bool) -> None:
    mechanism = arm_of(kind, 11, backwards=backwards)
    _, T = some_poses(mechanism, 2, 12)
    found = spatial.reverse(mechanism, T)
    assert check_misses_nothing(mechanism, T, found) >= 4


@pytest.mark.parametrize("name", ["robot_wrist_reverse", "robot_parallel_reverse"])
def test_kernels_solve_their_equations_to_40_digits(name: str) -> None:
    """The closed forms themselves, without rounding: where a pose is exact to 50 digits, so are the angles."""
    import mpmath

    inputs = robot_inputs(name)
    with mpmath.workdps(50):
        for row in (0, 3, 5):
            a, offset = (list(map(mpmath.mpf, inputs[key][row])) for key in ("a", "offset"))
            alpha = [
                mpmath.atan2(s, c) for c, s in zip(inputs["cosine"][row], inputs["sine"][row], strict=True)
            ]
            cosine, sine = [mpmath.cos(x) for x in alpha], [mpmath.sin(x) for x in alpha]
            q = [mpmath.mpf(x) for x in (0.3, -0.8, 1.1, 0.4, -0.9, 2.0)]

            def forward(q, a=a, cosine=cosine, sine=sine, offset=offset):
                T = mpmath.eye(4)
                for j, angle in enumerate(q):
                    length, c, s = (a[j - 1], cosine[j - 1], sine[j - 1]) if j else (0, 1, 0)
                    p, t = mpmath.cos(angle), mpmath.sin(angle)
                    T = T * mpmath.matrix(
                        [
                            [p, -t, 0, length],
                            [t * c, p * c, -s, -s * offset[j]],
                            [t * s, p * s, c, c * offset[j]],
                            [0, 0, 0, 1],
                        ]
                    )
                return T

            T = forward(q)
            found = KERNELS[name].evaluate(
                {"pose": np.array(T.tolist()), "a": a, "cosine": cosine, "sine": sine, "offset": offset},
                digits=50,
                eps=mpmath.mpf(10) ** -45,
                largest=mpmath.mpf(10) ** 300,
            )
            there = np.asarray(found["status"]) == ReverseStatus.REGULAR
            assert there.sum() >= 2
            angles = np.asarray(found["angles"])[there]
            for solution in angles:
                assert max(abs(x) for x in forward(solution) - T) < mpmath.mpf(10) ** -40
            off = [max(abs(mpmath.sin((x - y) / 2)) for x, y in zip(s, q, strict=True)) for s in angles]
            assert min(off) < mpmath.mpf(10) ** -40


def test_free_first_angle_before_three_parallel_axes() -> None:
    """Zero may leave no solution where other first angles do; Newton's method finds those."""
    alpha, offset = [np.pi / 2, 0, 0, 1.1, -1.4], [0.5, 0.4, -0.9, 0.5 - 0.6 * np.cos(1.1), 0.6, 1.0]
    arm = spatial.Mechanism("R" * 6, [0.3, 2, 1.5, 0.4, 0], alpha, offset)
    rng = np.random.default_rng(1)
    T = spatial.forward(arm, rng.uniform(-3, 3, (60, 6)))
    T[:, :3, 3] = T[:, :3, 2]
    T[:, 2, 3] += 0.5 + rng.uniform(-3, 3, 60)
    found = spatial.reverse(arm, T)
    check_is_solution(arm, T, found)
    assert (found.status[:, 0] == ReverseStatus.FAMILY).all()
    assert (found.solutions[:, 0, 0] != 0).any()


@pytest.mark.parametrize("step", [90, 45, 30])
@pytest.mark.parametrize("robot", [spatial.PUMA_560, spatial.GE_P60, spatial.T3_776], ids=lambda m: m.name)
def test_positions_as_people_write_them(robot: spatial.Mechanism, step: int) -> None:
    """Multiples of right angles and their parts are singular in several ways at once; none is lost."""
    rng = np.random.default_rng(step)
    q = np.radians(rng.integers(-180 // step + 1, 180 // step + 1, (1000, 6)) * step)
    T = spatial.forward(robot, q)
    found = spatial.reverse(robot, T)
    check_is_solution(robot, T, found)
    there = found.status <= ReverseStatus.FAMILY
    off = np.abs(np.remainder(found.solutions - q[:, None] + np.pi, 2 * np.pi) - np.pi).max(axis=-1)
    known = np.where(there, off, np.inf).min(axis=-1) < 1e-6  # solutions that meet are right to 1e-7 or so
    assert (known | (found.status == ReverseStatus.FAMILY).any(axis=-1)).all()


def test_a_chain_with_slides_is_solved_as_a_loop() -> None:
    quarter = np.pi / 2
    gantry = spatial.Mechanism(
        "PPPRRR",
        np.zeros(5),
        [quarter, quarter, 0.0, quarter, quarter],
        angle=[0.0, quarter, 0.0, np.nan, np.nan, np.nan],
    )
    T = spatial.forward(gantry, [1.0, 2.0, 3.0, 0.4, 0.5, 0.6])
    found = spatial.reverse(gantry, T)
    assert (found.status == ReverseStatus.REGULAR).sum() == 2
    np.testing.assert_allclose(spatial.forward(gantry, found.solutions[:2]), [T, T], rtol=0, atol=1e-12)


def test_a_placed_robot_is_solved_in_its_own_coordinates() -> None:
    base = np.eye(4)
    base[:3, 3] = 1, 2, 3
    robot = spatial.Placement(spatial.PUMA_560, base=base, zero=[0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    q = [0.3, -0.2, 0.4, 0.5, -0.6, 0.7]
    found = spatial.reverse(robot, robot.forward(q))
    assert (found.status == ReverseStatus.REGULAR).all()
    assert np.abs(found.solutions - q).max(axis=1).min() < 1e-12


def test_what_is_no_arm_of_six_revolute_joints_is_an_error(refuses) -> None:
    refuses(spatial.reverse, spatial.Mechanism("RP", [1.0], [0.5]), np.eye(4))
    refuses(spatial.reverse, spatial.Mechanism("R" * 6, [1.0] * 6, [0.5] * 6), np.eye(4))
    refuses(spatial.reverse, spatial.PUMA_560, np.eye(3))
    refuses(spatial.reverse, spatial.PUMA_560, np.eye(4) * 1j)


@pytest.mark.parametrize(
    ("a", "alpha", "offset"),
    [
        ([0, 0, 3, 0, 0], [90, 90, 90, 90, 90], [1, 0, 2, 3, 0, 1]),  # two wrists
        ([1, 1, 0, 0, 0], [0, 0, 90, 90, 90], [0.5, 0, 0.2, 0, 0, 0.1]),  # three parallel axes and a wrist
        ([1, 1, 1, 0.5, 0.2], [0, 0, 0, 90, 90], [0, 0, 0, 0.3, 0.4, 0.1]),  # four parallel axes
        ([0, 0, 0, 0, 0], [90, 90, 90, 90, 90], [0, 0, 0, 0, 0, 0]),  # all axes through one point
    ],
)
def test_an_arm_that_is_singular_everywhere_is_an_error(refuses, a: list, alpha: list, offset: list) -> None:
    arm = spatial.Mechanism("R" * 6, a, np.radians(alpha), offset)
    refuses(spatial.reverse, arm, np.eye(4))


def anything(seed: int) -> spatial.Mechanism:
    rng = np.random.default_rng(seed)
    return spatial.Mechanism(
        "R" * 6, rng.uniform(20, 100, 5), rng.uniform(0.4, 2.6, 5), rng.uniform(-100, 100, 6)
    )


def test_without_ssik_the_error_for_a_general_arm_says_what_to_install(
    refuses,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ssik", None)
    assert spatial.group(anything(1)).method == "general: ssik"
    refuses(spatial.reverse, anything(1), np.eye(4))


@pytest.mark.slow  # ssik is installed for make test-slow only
def test_ssik_is_given_the_same_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a Puma, which ssik knows how to solve without preparation, it finds what the closed form finds."""
    pytest.importorskip("ssik")
    from rodgen.kinematics.spatial import arm_plan, arm_reverse

    robot = spatial.PUMA_560
    _, T = some_poses(robot, 5, 2)
    wanted = spatial.reverse(robot, T)
    monkeypatch.setattr(arm_reverse, "plan", lambda m: arm_plan.Plan("general", arm_plan.plan(m).arm))
    found = spatial.reverse(robot, T)
    check_is_solution(robot, T, found)
    for mine, its, status in zip(wanted.solutions, found.solutions, found.status, strict=True):
        assert (status <= ReverseStatus.FAMILY).sum() == 8
        apart = np.abs(np.remainder(mine[:, None] - its[None] + np.pi, 2 * np.pi) - np.pi).max(axis=-1)
        assert np.nanmin(apart, axis=1).max() < 1e-9
