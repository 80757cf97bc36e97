"""Closed loops, and robots with slides: every way that an independent search finds is found, and each one closes."""

from itertools import permutations

import numeric_reverse
import numpy as np
import pytest

from rodgen.kinematics import spatial
from rodgen.kinematics.spatial import Mechanism, ReverseStatus, loop_reverse, reverse, reverse_loop

GROUP_1 = ("CCCR", "PCCRR", "CPCRR", "CPRCR", "PPCRRR", "PRPCRR", "PRCRPR", "PRPRPRR")
GROUP_2 = ("RRRCC", "RCRCR", "RPCRRR", "RCPRRR", "CRRPRR", "RPRPRRR", "RPPRRRR", "RPRRPRR")
SAME = 1e-7
"""Distance, in rad or in the reach, of a solution of the search and ours. Both are right to the condition number times
1e-16; solutions with a worse condition than 1e6 are where two of them meet, and are not compared."""


def a_loop(kinds: str, rng: np.random.Generator, special: bool = False) -> Mechanism:
    """A loop with any sizes, or with right angles, parallel axes and zeros among them."""
    n = len(kinds)
    if special:
        a = rng.choice([0, 0, 1, 2, 1.5], n)
        alpha = np.radians(rng.choice([0, 90, -90, 30, 180, 60], n, p=[0.15, 0.3, 0.2, 0.15, 0.05, 0.15]))
        offsets, angles = rng.choice([0, 0, 1, -0.5], n), np.radians(rng.choice([0, 90, 30], n))
    else:
        a, alpha = rng.uniform(0.3, 2, n), rng.uniform(-np.pi, np.pi, n)
        offsets, angles = rng.uniform(-1, 1, n), rng.uniform(-3, 3, n)
    slides, turns = (np.array([k in which for k in kinds]) for which in ("PC", "RC"))
    return Mechanism(kinds, a, alpha, np.where(slides, np.nan, offsets), np.where(turns, np.nan, angles))


def missing(mechanism, found, search, status):
    """How many solutions of a search, in places that are not singular, are not among those found."""
    turns = np.array([which == "theta" for _, which in mechanism.variables])
    there = found[status <= ReverseStatus.FAMILY]
    count = 0
    for solution, condition in zip(search.solutions, search.condition, strict=True):
        difference = there - solution
        difference = np.where(
            turns, numeric_reverse.wrapped(difference), difference / numeric_reverse.reach(mechanism)
        )
        count += condition < 1e6 and not (np.abs(difference).max(axis=-1, initial=0) < SAME).any()
    return count


def check_loop(mechanism, given, value, starts=300):
    """Compare with a search; return how many solutions it found."""
    index = mechanism.variables.index(given)
    search = numeric_reverse.search(mechanism, np.eye(4), starts=starts, given={index: value})[0]
    found = reverse_loop(mechanism, {given: value})
    there = found.status <= ReverseStatus.FAMILY
    distance, angle = numeric_reverse.errors(mechanism, found.solutions[there], np.eye(4))
    assert max(distance.max(initial=0), angle.max(initial=0)) < 1e-10
    assert np.isnan(found.solutions[~there]).all()
    assert np.isfinite(found.solutions[there]).all()
    assert (found.solutions[there][:, index] == value).all()
    assert missing(mechanism, found.solutions, search, found.status) == 0
    return len(search.solutions), found


def test_the_worked_example_of_the_facts():
    """A spherical quadrilateral of the course's homework; offsets by back-substitution."""
    loop = Mechanism(
        "CCCR", [1.0, 2.0, 3.0, 4.0], np.radians([40, 70, 85, 70]), [np.nan, np.nan, np.nan, 0.5]
    )
    found = reverse_loop(loop, {(3, "theta"): np.radians(75.0)})
    assert found.status.tolist() == [0, 0]
    wanted = [[136.5430, -38.2302, 135.7593], [63.5047, 38.2302, 87.7179]]
    assert np.allclose(
        np.degrees(found.solutions[:, [0, 2, 4]]), wanted, rtol=0, atol=5.1e-5
    )  # four decimals
    assert max(x.max() for x in numeric_reverse.errors(loop, found.solutions, np.eye(4))) < 1e-14


@pytest.mark.quick("PRPCRR", "CPCRR", "RPPRRRR", "RRRCC", "RCRCR", "RPCRRR")
@pytest.mark.thorough("PRPCRR", "CPCRR", "RPPRRRR")
@pytest.mark.parametrize("kinds", GROUP_1 + GROUP_2)
def test_every_way_that_a_search_finds(kinds):
    rng = np.random.default_rng(len(kinds) + sum(map(ord, kinds)))
    total, known = 0, 0
    for _ in range(4):
        loop = a_loop(kinds, rng)
        angles = [v for v in loop.variables if v[1] == "theta" or kinds in GROUP_1]
        given = angles[rng.integers(len(angles))]
        count, found = check_loop(loop, given, float(rng.uniform(-3, 3)))
        total, known = total + count, known + int((found.status == ReverseStatus.REGULAR).sum())
    # a search that finds next to nothing would check nothing; that it misses some is why it is not the way
    assert total >= 0.75 * known > 0


@pytest.mark.thorough("RRRCC")
@pytest.mark.parametrize("kinds", ["RCRCR", "RRRCC", "CCCR", "RPCRRR"])
def test_loops_of_right_angles_and_zeros(kinds):
    rng = np.random.default_rng(3)
    for _ in range(8):
        loop = a_loop(kinds, rng, special=True)
        angles = [v for v in loop.variables if v[1] == "theta"]
        given = angles[rng.integers(len(angles))]
        count, found = check_loop(loop, given, float(np.radians(rng.choice([25, 90, 140]))), starts=100)
        # more may be missing beside a family, or where equations say nothing and the search finds nothing either
        if (found.status == ReverseStatus.INCOMPLETE).any():
            assert count == 0 or (found.status == ReverseStatus.FAMILY).any()


def test_a_pentagon_loop_can_close_in_eight_ways():
    """Rare among random RRRCC loops: the search knows the eight of this one, too."""
    rng = np.random.default_rng(176)
    loop = a_loop("RRRCC", rng)
    count, found = check_loop(loop, (1, "theta"), float(rng.uniform(-3, 3, 20)[7]))
    assert count == 8
    assert found.status.tolist() == [ReverseStatus.REGULAR] * 8


@pytest.mark.parametrize(("kinds", "input_joint"), [("CCCR", 3), ("CRCC", 1), ("RRCCR", 4), ("CCRRR", 2)])
def test_closed_forms_are_the_general_way(kinds, input_joint, monkeypatch):
    rng = np.random.default_rng(7)
    values, given = rng.uniform(-3, 3, 40), (input_joint, "theta")
    loop = a_loop(kinds, rng)
    index = loop.variables.index(given)
    assert loop_reverse.closed_form(loop, {index: values}) is not None
    found = reverse_loop(loop, {given: values})
    monkeypatch.setattr(loop_reverse, "closed_form", lambda *_: None)
    general = reverse_loop(loop, {given: values})
    assert ((found.status <= 1).sum(axis=1) == (general.status <= 1).sum(axis=1)).all()
    turns = np.array([which == "theta" for _, which in loop.variables])
    for ours, other in zip(found.solutions, general.solutions, strict=True):
        apart = ours[:, None] - other[None]
        apart = np.where(turns, np.remainder(apart + np.pi, 2 * np.pi) - np.pi, apart)
        size = 1 + np.abs(np.where(turns, 0.0, ours)).max(axis=-1)  # offsets grow where sines are small
        nearest = np.abs(np.nan_to_num(apart, nan=1e9)).max(axis=-1).min(axis=1) / size
        assert (nearest[np.isfinite(ours[:, 0])] < 1e-9).all()  # each way as a whole


@pytest.mark.parametrize(
    ("kinds", "input_joint", "a", "twists", "offsets", "singular"),
    [
        ("CCCR", 3, [1.5, 2, 2, 1], [-90, 90, 90, 90], [0, -0.5, 1, -0.5], 0.0),
        ("RRCCR", 4, [1, 1.5, 1, 0, 1.5], [-90, -90, 90, -90, -90], [0, 0, -0.5, -0.5, -0.5], np.pi / 2),
    ],
)
def test_a_singular_row_changes_nothing_of_the_others(
    kinds, input_joint, a, twists, offsets, singular, monkeypatch
):
    slides = np.array([kind == "C" for kind in kinds])
    loop = Mechanism(kinds, a, np.radians(twists), np.where(slides, np.nan, offsets))
    given, values = (input_joint, "theta"), np.random.default_rng(12).uniform(-3, 3, 20)
    mixed = np.insert(values, 7, singular)  # among the rows of a block
    certain = loop_reverse.closed_form(loop, {loop.variables.index(given): mixed})[-1]
    assert np.flatnonzero(~certain).tolist() == [7]
    found, alone = reverse_loop(loop, {given: mixed}), reverse_loop(loop, {given: values})
    np.testing.assert_array_equal(np.delete(found.solutions, 7, axis=0), alone.solutions)
    np.testing.assert_array_equal(np.delete(found.status, 7, axis=0), alone.status)
    assert (alone.status == ReverseStatus.REGULAR).any()
    monkeypatch.setattr(loop_reverse, "closed_form", lambda *_: None)
    general = reverse_loop(loop, {given: np.array([singular])})
    np.testing.assert_array_equal(found.solutions[7], general.solutions[0])
    np.testing.assert_array_equal(found.status[7], general.status[0])


def test_two_ways_meet_at_the_end_of_the_input_range():
    loop = a_loop("RRRCC", np.random.default_rng(176))
    ways = lambda t: (reverse_loop(loop, {(1, "theta"): t}).status <= ReverseStatus.DOUBLE).sum(axis=-1)  # noqa: E731
    angles = np.linspace(-np.pi, np.pi, 60)
    counts = ways(angles)
    k = np.flatnonzero((counts[:-1] == 2) & (counts[1:] == 0))[0]
    inside, outside = angles[k : k + 2]
    for _ in range(50):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if ways(middle) else (inside, middle)
    found = reverse_loop(loop, {(1, "theta"): inside})
    assert found.status.tolist() == [ReverseStatus.DOUBLE] + [ReverseStatus.NONE] * 7
    assert max(x[0] for x in numeric_reverse.errors(loop, found.solutions, np.eye(4))) < 1e-10


def test_offsets_grow_without_bound_where_both_ways_of_an_rccc_loop_meet():
    """There the three cylindric axes are parallel to one plane."""
    loop = Mechanism("CCCR", [1.0, 2, 3, 4], np.radians([90, 60, 40, 30]), [np.nan, np.nan, np.nan, 0.5])
    closes = lambda t: reverse_loop(loop, {(3, "theta"): t}).status[0] <= ReverseStatus.DOUBLE  # noqa: E731
    inside, outside = 0.0, 3.0
    for _ in range(14):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if closes(middle) else (inside, middle)
    found = reverse_loop(loop, {(3, "theta"): inside})
    assert found.status.tolist() == [ReverseStatus.REGULAR] * 2
    assert np.abs(found.solutions[:, 1]).min() > 100
    assert max(x.max() for x in numeric_reverse.errors(loop, found.solutions, np.eye(4))) < 1e-10


def test_a_loop_that_moves_with_the_input_held_is_a_family():
    """Two cylindric joints on one line: the link between them slides and turns freely, where the loop closes."""
    loop = Mechanism("CCCR", np.zeros(4), np.radians([0, 60, 90, 90]), [np.nan] * 3 + [0.0])
    found = reverse_loop(loop, {(3, "theta"): np.radians([120.0, 119.0])})
    assert found.status[0, 0] == ReverseStatus.FAMILY
    assert max(x[0, 0] for x in numeric_reverse.errors(loop, found.solutions, np.eye(4))) < 1e-12
    assert (found.status[1] == ReverseStatus.NONE).all()


def test_arrays_broadcast_and_bad_elements_have_a_status():
    loop = a_loop("CCCR", np.random.default_rng(1))
    values = np.array([[0.1, np.nan, 0.3], [np.inf, 0.5, 0.6]])
    found = reverse_loop(loop, {("R4", "theta"): values})
    assert found.solutions.shape == (2, 3, 2, 7)
    bad = ~np.isfinite(values)
    assert (found.status[bad] == ReverseStatus.INVALID).all()
    assert np.isnan(found.solutions[bad]).all()
    assert (found.status[~bad] != ReverseStatus.INVALID).all()
    one = reverse_loop(loop, {6: 0.6})
    assert np.array_equal(one.status, found.status[1, 2])
    assert np.allclose(one.solutions, found.solutions[1, 2], rtol=0, atol=1e-12, equal_nan=True)
    assert reverse_loop(loop, {6: np.zeros(0)}).solutions.shape == (0, 2, 7)


@pytest.mark.parametrize("kinds", sorted({"".join(p) for p in permutations("RRRPPP")})[::5])
def test_robots_with_three_slides(kinds):
    check_robot(kinds)


@pytest.mark.parametrize("kinds", ["RRPRRP", "PRRRRP", "RPRPRR", "RRRCC"[:3] + "CP", "CRRC", "CCRR"])
def test_robots_with_slides(kinds):
    check_robot(kinds)


def check_robot(kinds):
    rng = np.random.default_rng(sum(map(ord, kinds)))
    for _ in range(2):
        loop = a_loop(kinds, rng)
        robot = Mechanism(kinds, loop.a[:-1], loop.alpha[:-1], loop.offset, loop.angle)
        q = rng.uniform(-2, 2, 6)
        T = numeric_reverse.forward(robot, q)
        found = reverse(robot, T)
        there = found.status <= ReverseStatus.FAMILY
        distance, angle = numeric_reverse.errors(robot, found.solutions[there], T)
        assert max(distance.max(), angle.max()) < 1e-10
        assert (np.abs(found.solutions[there] - q).max(axis=-1) < 1e-8).any()
        search = numeric_reverse.search(robot, T, starts=200)[0]
        assert missing(robot, found.solutions, search, found.status) == 0


def test_poses_that_are_none_are_invalid():
    robot = Mechanism("PPPRRR", np.zeros(5), np.full(5, np.pi / 2))
    T = np.stack([np.eye(4), np.diag([1.0, 1, -1, 1]), np.full((4, 4), np.nan)])
    found = reverse(robot, T)
    assert (found.status[1:] == ReverseStatus.INVALID).all()
    assert (found.status[0] != ReverseStatus.INVALID).all()


@pytest.mark.parametrize(
    ("mechanism", "given"),
    [
        (spatial.PUMA_560, {0: 0.0}),
        (Mechanism("RRRCC", [1.0] * 5, [1.0] * 5), {}),
        (Mechanism("RRRCC", [1.0] * 5, [1.0] * 5), {(3, "S"): 0.0}),
        (Mechanism("RRRRRPR", [1.0] * 7, [1.0] * 7), {0: 0.0}),
        (Mechanism("RRRCC", [1.0] * 5, [1.0] * 5), {("C9", "S"): 0.0}),
        (Mechanism("RRRCC", [1.0] * 5, [1.0] * 5), {0: 0.0, (0, "theta"): 0.0}),
        (Mechanism("RRRCC", [1.0] * 5, [1.0] * 5), {0: "x"}),
        (Mechanism("HCCC", [1.0] * 4, [1.0] * 4, pitch=[1, 0, 0, 0]), {0: 0.0}),
        (Mechanism("RSSR", [1.0] * 4, [1.0] * 4), {0: 0.0}),
    ],
)
def test_what_cannot_be_solved_is_an_error(refuses, mechanism, given):
    refuses(reverse_loop, mechanism, given)


def test_a_loop_of_seven_turning_joints_is_an_arm_with_six():
    rng = np.random.default_rng(13)
    a, alpha = rng.uniform(1, 2, 7), rng.uniform(-1.5, 1.5, 7)
    a[3] = a[4] = 0.0  # axes 4, 5 and 6 meet
    offset = np.where(np.arange(7) == 4, 0.0, rng.uniform(-1, 1, 7))
    loop = Mechanism("R" * 7, a, alpha, offset)
    assert sum(check_loop(loop, (given, "theta"), 0.4)[0] for given in (0, 1, 2)) > 0
    found = reverse_loop(loop, {1: np.array([np.nan, 0.4])})
    assert (found.status[0] == ReverseStatus.INVALID).all()
    assert np.isnan(found.solutions[0]).all()


def test_robots_that_cannot_be_solved_are_an_error(refuses):
    refuses(reverse, Mechanism("CCCR", [1.0] * 4, [1.0] * 4), np.eye(4))
    refuses(reverse, Mechanism("RP", [1.0], [1.0]), np.eye(4))
    refuses(reverse, Mechanism("PPPRRR", [1.0] * 5, [1.0] * 5), np.eye(3))
