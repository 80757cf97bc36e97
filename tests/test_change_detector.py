"""The detector against what theory says of it: an e-process on exact rows, robust to single readings, right names."""

from __future__ import annotations

import numpy as np
import pytest

from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.watch.watch import SETTLED
from rodgen.statistics.change_detector import ChangeDetector, StreamWhitener
from rodgen.statistics.whitening import MotionDeviations, Poses, SharedMotion, Whitener

GROUPS = [[0], [1], [2, 3], [4]]
FREE, D, M = 2, 5, 2


@pytest.fixture(autouse=True)
def _one_thread():
    with one_thread_in_blas():
        yield


class Bench:
    """Exact rows of a linear model: two parameters of any size, effects that are not there."""

    def __init__(self, seed: int, noise: str = "normal") -> None:
        self.random = np.random.default_rng(seed)
        self.theta = np.array([30.0, -7.0, 0.0, 0.0, 0.0])
        self.noise = noise

    def rows(self, n: int, change: np.ndarray | float = 0.0, factor: float = 1.0):
        columns = self.random.normal(size=(n, M, D))
        if self.noise == "normal":
            error = self.random.normal(size=(n, M))
        else:  # one scale for each row: 3 degrees of freedom
            error = self.random.normal(size=(n, M)) / np.sqrt(self.random.chisquare(3, (n, 1)) / 3)
        return columns, columns @ (self.theta + change) + 0.01 * factor * error

    def detector(self, rows: int = 60, limit: float = 1000.0) -> ChangeDetector:
        return ChangeDetector(*self.rows(rows), FREE, GROUPS, limit, np.array([-1.0]))

    def watch(self, detector, rows: int, first: int = 0, **changed) -> int | None:
        """Update row by row until an alarm; give the number of rows to it."""
        for i in range(rows):
            detector.update(*self.rows(1, **changed), 1.0, np.array([[float(first + i)]]))
            if detector.alarm:
                return i + 1
        return None


def change(*values: float) -> np.ndarray:
    return 0.01 * np.array(values)


@pytest.mark.slow
def test_parts_of_the_sum_have_an_expectation_of_one_without_a_change() -> None:
    """Each process starts at one, and its mean stays there: the reference's uncertainty is in it, too.

    From a reference of 12 rows for two parameters: plugged in, they would be off by half of the noise.
    """
    found, tried = [], 150
    for seed in range(tried):
        bench = Bench(seed)
        detector = bench.detector(12)
        start = detector.levels[0][0]
        for _ in range(12):
            detector.update(*bench.rows(1), 1.0, np.zeros((1, 1)))
        parts = detector._log_parts([start])
        found.append(np.exp(np.logaddexp.reduce(parts[0]) - np.log(start.weight)))
    assert np.mean(found) < 1 + 3 * np.std(found) / np.sqrt(tried)
    assert np.mean(found) > 0.1


def test_a_constant_machine_raises_no_alarm_in_the_time_between_false_ones() -> None:
    assert all(Bench(seed).watch(Bench(seed).detector(), 300) is None for seed in range(2))


@pytest.mark.parametrize(
    ("moved", "group", "within"),
    [((0, 3, 0, 0, 0), 1, 20), ((0, 0, 1.5, -1.5, 0), 2, 40), ((0, 0, 0, 0, 60), 3, 12)],
    ids=["a parameter of the model", "an effect", "a large effect"],
)
def test_a_change_is_found_and_dated_and_its_products_tell_its_size(moved, group, within) -> None:
    bench = Bench(5)
    detector = bench.detector()
    assert bench.watch(detector, 100) is None
    delay = bench.watch(detector, 100, 100, change=change(*moved))
    assert delay is not None
    assert delay <= within
    for i in range(SETTLED):
        detector.update(*bench.rows(1, change(*moved)), 1.0, np.array([[100.0 + delay + i]]))
    first, last, _ = detector.began()
    assert first.sums.mark[0] <= 99 <= last.sums.mark[0] + 8
    assert last.sums.mark[0] - first.sums.mark[0] < 32
    since = detector.readings_since(first.sums)
    assert since is not None
    later = since.marks[:, 0] > 99
    some = type(since)(*(part[later] for part in since))
    assert np.median(some.distance(change(*moved))) < 3 < np.median(some.distance()) + (group < 3) * 3
    gram, pull, square = detector.products(first.sums, some)
    own = GROUPS[group]
    size = np.linalg.solve(gram[np.ix_(own, own)], pull[own])
    # of unit variance are readings in the noise that the reference has, 0.01
    std = 0.01 * np.sqrt(np.diag(np.linalg.inv(gram[np.ix_(own, own)]))) / 0.01
    assert np.all(np.abs(size - change(*moved)[own]) < 4 * std)
    assert square > pull[own] @ size
    before, after = detector.split(first.sums, since, int(np.argmax(later)), change(*moved))
    detector.go_on(before, after, own)
    assert bench.watch(detector, 200, change=change(*moved)) is None


def test_single_bad_readings_are_no_change() -> None:
    bench = Bench(4)
    detector = bench.detector()
    for i in range(300):
        columns, readings = bench.rows(1)
        if i % 30 == 17:
            readings = readings + 5.0
        far = detector.update(columns, readings, 1.0, np.zeros((1, 1)))
        assert (far[0] > 20) == (i % 30 == 17)
        assert not detector.alarm


@pytest.mark.slow
def test_heavy_tails_are_no_change() -> None:
    bench = Bench(6, "tails")
    assert bench.watch(bench.detector(200), 600) is None


def test_a_state_goes_on_as_if_nothing_had_been_between() -> None:
    whole, parts = Bench(7), Bench(7)
    one, other = whole.detector(), parts.detector()
    for i in range(90):
        mark = np.array([[float(i)]])
        moved = change(0, 2 * (i > 80), 0, 0, 0)
        one.update(*whole.rows(1, moved), 1.0, mark)
        other.update(*parts.rows(1, moved), 1.0, mark)
        assert one.alarm == other.alarm
        if i == 60:
            state = other.state()
            other = Bench(7).detector()
            other.restore(state)
    assert other.log_sum == pytest.approx(one.log_sum, rel=1e-9)
    assert [start.block for start in other.began()] == [start.block for start in one.began()]


def test_rows_are_whitened_one_by_one_as_all_at_once() -> None:
    """Two factors of one covariance give the same products."""
    random = np.random.default_rng(0)
    pose = np.repeat(np.arange(20), 3)
    run, t = (pose >= 10).astype(int), np.repeat(np.cumsum(random.uniform(1, 3, 20)), 3)
    motion = SharedMotion(Poses.among(pose, run, t), random.normal(size=(60, 3, 6)))
    deviations = MotionDeviations(np.repeat([0.7, 0.0], 3), np.repeat([0.0, 0.5], 3), 4.0)
    columns = random.normal(size=(60, 3, 4)) * [1, 1, 1, 0.01]
    at_once = Whitener(motion, deviations)(columns).reshape(-1, 4)
    gap = np.diff(t, prepend=t[0])
    gap[[0, 30]] = np.inf
    stream = StreamWhitener(deviations, 4, 1.0)
    parts = [
        stream(columns[i : i + 7], motion.columns[i : i + 7], gap[i : i + 7], np.zeros(3))
        for i in range(0, 60, 7)
    ]
    one_by_one = np.concatenate(parts).reshape(-1, 4)
    assert one_by_one.T @ one_by_one == pytest.approx(at_once.T @ at_once, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("noise", ["normal", "tails"])
def test_the_mean_time_between_false_alarms_is_at_least_the_limit(noise) -> None:
    """With a limit of 300 rows, the mean of 40 times, of which each stops at 1500."""
    times = []
    for seed in range(40):
        bench = Bench(seed, noise)
        times.append(bench.watch(bench.detector(limit=300.0), 1500) or 1500)
    assert np.mean(times) > 300


def test_what_the_reference_shows_by_rounding_alone_leaves_the_evidence_finite() -> None:
    random = np.random.default_rng(1)
    columns, new = random.normal(size=(20, 3, 4)), random.normal(size=(4, 3, 4))
    columns[:, :, 1], columns[:, :, 2:] = 1e6 * columns[:, :, 1], 1e-13 * columns[:, :, 2:]
    detector = ChangeDetector(columns, random.normal(size=(20, 3)), 1, [[1], [2, 3], [2]], 1e6, np.zeros(1))
    for row in new:
        far = detector.update(row[None], random.normal(size=(1, 3)), 1.0, np.zeros((1, 1)))
        assert np.isfinite([*far, detector.log_sum]).all()
        assert np.isfinite(detector.mean).all()
