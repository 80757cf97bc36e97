"""Find changes in a sequence of readings with a linear model, by a test that is valid at every time.

Readings r of unit weight have columns W, of the parameters of a model (δ, unknown but for the reference readings)
and of effects that the model lacks (small, with a normal prior). As long as nothing changes,

    r_i = W_i δ + e_i,     e_i independent, of variance σ²,

and all of δ and σ is what the reference readings, and the new ones, leave of it. A change at j of a group k of
columns adds W_i^k b from there on, b ~ N(0, s² σ²). The ratio of the likelihoods with and without it, δ, b and σ
integrated, is

    Λ_jk = |I + s² A|^(-1/2) (1 - uᵀ(A + s⁻²)⁻¹u / S)^(-ν/2),

u and A the score and the information of b given δ: differences of sums from one time to another. Without a change
Λ_jk has the expectation 1 at every time, since it began at j (an e-process). A sum of Λ_jk over j with weights that
are, up to any time, at most the time that has passed has at most that time as its expectation (an e-detector: Shin,
Ramdas and Rinaldo, "E-detectors", 2022; for simple alternatives, Shiryaev and Roberts). So the mean time until it
exceeds A is at least A, by Ward's optional stopping, for any A and any number of readings.

Beginnings j are tried at all multiples of 2^v of level v, as long as they are no more than four steps old: of what
began a readings ago some are within a/2. What is left out makes the sum smaller, and no false alarm more frequent.

A reading that is far from what was expected counts as if it were at a distance that normal readings seldom exceed
(Huber's ψ of its length, in standard deviations). Clipping is a contraction, so that the moments of the scores of
normal errors become less: the bound stays. Neither can a single reading add more than half of that distance's
square to log Λ.

How often readings are near, far and very far from what is expected is counted; a change of these frequencies, with
Dirichlet priors, is one more alternative: another noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rodgen.array_types import Array
from rodgen.statistics.thresholds import WATCH
from rodgen.statistics.whitening import MotionDeviations

CONFIRMED = 2
"""Readings after which an alarm must still stand: no single bad reading is a change."""
LEVELS = 12
"""Levels of times at which a change may have begun."""
KEPT = 4
"""Times that each level keeps: the oldest began 8192 blocks ago. In so many readings a change of a tenth of the
noise is seen, and none of a thirtieth matters."""
EXACT = 0.05
"""Part of all readings up to which those since a change leave what was known before it as it is; to neglect that
makes the sum smaller, by as little."""
SIZES = (0.1, 0.5, 2.5)
"""Standard deviations of a change, as rms per reading, in units of the noise: in steps of five, as each is good for
changes of half and of twice as much. Three cost log 3."""
UNSEEN = 1.0
"""Standard deviation of what an effect that the model lacks does to the reference readings, in units of their
residuals: they show what is there, and it is no change."""
UNKNOWN = 1e5
"""The same of parameters of the model, of which nothing but the reference readings says anything."""
NOISE = 0.1
"""Part of the false alarms that a change of the noise may have."""
BINS = (0.5, 0.8, 0.95, 0.99)
"""Parts of normal readings that are nearer than the bounds between which they are counted."""
RECENT = 1024
"""Readings that are kept as they are, from which a change is named: in so many one of a tenth of the noise is seen."""

ROUNDING = 1e-12
"""Part of a column's information that keeps rounding out of the inverse: what no reading sees stays open."""
SMALLEST = 1e-300


class Sums(NamedTuple):
    """Sums over all readings up to a time, or from one time to another."""

    mark: Array  # what the user calls the last reading
    rows: Array
    scatter: Array  # of squares of what was not expected, clipped
    square: Array  # (d, d), WᵀW
    onto: Array  # (d,), Wᵀr, r clipped
    bins: Array  # how many readings were how far from what was expected

    def less(self, subtracted: Sums) -> Sums:
        """Return the sums since another time."""
        return Sums(*map(np.subtract, self, subtracted))

    def plus(self, new: Sums) -> Sums:
        """Return the sums up to a later time."""
        return Sums(*map(np.add, self, new))._replace(mark=new.mark)


class Start(NamedTuple):
    """A time at which a change may have begun."""

    block: int
    weight: float  # the time that it stands for
    time: float
    sums: Sums


class Since(NamedTuple):
    """Readings since a time, not clipped, with their errors in standard deviations."""

    columns: Array
    """Derivatives by coefficients in the user's units, (n, m, d)."""
    unexpected: Array
    """What readings are more than was expected at that time, (n, m)."""
    spread: Array
    """Covariance of that, (n, m, m)."""
    marks: Array

    def distance(self, change: Array | float = 0.0) -> Array:
        """Return how far each reading is from what is expected after a change of the coefficients, (d,)."""
        change = np.broadcast_to(change, self.columns.shape[2])
        return _distance(self.unexpected - self.columns @ change, self.spread)


class ChangeDetector:
    """An e-detector of changes of the coefficients of a linear model, and of its noise.

    Parameters
    ----------
    columns : ndarray, shape (n, m, d)
        Of the reference readings.
    readings : ndarray, shape (n, m)
        Whitened: their errors are independent and have one variance.
    free : int
        The first so many columns have coefficients of which nothing is known; those of the others are small.
    groups : sequence of sequences of int
        The columns that change together, of each alternative.
    limit : float
        What the sum must exceed: the mean time between false alarms, in the unit of the time that passes.
    mark : ndarray
        What the user calls the last of them.

    Attributes
    ----------
    log_sum : float
        Of the e-detector, at the last update.
    components : int
        m.
    suspected : int
        Block at which the sum exceeded the limit, where later readings are waited for; else -1.
    """

    def __init__(
        self,
        columns: Array,
        readings: Array,
        free: int,
        groups: Sequence[Sequence[int]],
        limit: float,
        mark: Array,
    ) -> None:
        d = columns.shape[2]
        self.limit, self.groups = limit, [np.asarray(group) for group in groups]
        length = np.sqrt(np.mean(columns**2, axis=(0, 1)))
        self.scale = float(np.sqrt(np.mean(readings**2))) or 1.0
        is_seen = length > ROUNDING * length.max(
            initial=0.0
        )  # of the others the reference has rounding alone
        self.unit = np.divide(self.scale, length, out=np.zeros(d), where=is_seen)
        self._per_unit = np.divide(1.0, self.unit, out=np.zeros(d), where=is_seen)
        self.components, of_width = columns.shape[1], dict[int, list[int]]()
        for k, group in enumerate(self.groups):
            of_width.setdefault(len(group), []).append(k)
        self._widths = [(some, np.stack([self.groups[k] for k in some])) for some in of_width.values()]
        self.base = np.diag(np.where(np.arange(d) < free, UNKNOWN, UNSEEN) ** -2.0)
        self._learn(columns * (self.unit / self.scale), readings / self.scale, mark)
        self.recent: Sequence[Array] = (columns[:0], readings[:0], mark[None][:0])
        self._begin()

    def _learn(self, columns: Array, readings: Array, mark: Array) -> None:
        """Take the reference readings in."""
        n, m, d = columns.shape
        flat = columns.reshape(-1, d)
        self.covariance = self._inverse(flat.T @ flat)
        leverage = columns @ self.covariance @ np.swapaxes(columns, 1, 2)
        self.lost = float(np.einsum("nii->", leverage))
        dof, variance, onto = max(n * m - self.lost, 1.0), 1.0, flat.T @ readings.ravel()
        for _ in range(WATCH.rounds):
            self.mean = self.covariance @ onto
            left, _, sums = _clipped(columns, readings, self.mean, np.eye(m) - leverage, variance, mark)
            onto, variance = sums.onto, float(np.sum(left**2)) / dof
        self.sums = sums._replace(scatter=np.array(variance * dof), bins=sums.bins + 0.5)

    def _begin(self) -> None:
        """Forget all beginnings."""
        self.blocks, self.time, self.log_sum = 0, 0.0, -np.inf
        self.levels: list[list[Start]] = [[] for _ in range(LEVELS)]
        self.suspected = -1
        self._start()

    def distance_of(self, probability: float) -> float:
        """Return the distance, in standard deviations, that a good reading exceeds with a probability."""
        from scipy import special

        return float(np.sqrt(special.chdtri(self.components, probability)))

    def _variance_of(self, sums: Sums) -> float:
        """Return σ², relative to the mean square of the reference readings."""
        return float(sums.scatter) / self.dof_of(sums)

    def dof_of(self, sums: Sums) -> float:
        """Return with how many degrees of freedom the variance is known at a time."""
        return float(max(sums.rows * self.components - self.lost, 1.0))

    # new readings ----------------------------------------------------------------------------------------------

    def update(self, columns: Array, readings: Array, time: float, marks: Array) -> Array:
        """Take a block of readings in; return how far each is from what was expected, in standard deviations, (n,).

        Parameters
        ----------
        columns : ndarray, shape (n, m, d)
        readings : ndarray, shape (n, m)
        time : float
            That has passed since the block before.
        marks : ndarray, shape (n, k)
            What the user calls them.
        """
        columns, readings = columns * (self.unit / self.scale), readings / self.scale
        new = columns, readings, marks
        self.recent = tuple(np.concatenate(parts)[-RECENT:] for parts in zip(self.recent, new, strict=True))
        spread = self._spread(columns, self.covariance)
        _, far, sums = _clipped(columns, readings, self.mean, spread, self._variance_of(self.sums), marks[-1])
        self.sums = self.sums.plus(sums)
        self.blocks += 1
        self.time += time
        self.covariance = self._inverse(self.sums.square)
        self.mean = self.covariance @ self.sums.onto
        self.log_sum = float(_log_add(self._log_parts(self._tried())))
        self._start()
        return far

    def _spread(self, columns: Array, covariance: Array) -> Array:
        return np.asarray(np.eye(self.components) + columns @ covariance @ np.swapaxes(columns, 1, 2))

    def _inverse(self, square: Array) -> Array:
        inverse = np.linalg.inv(self.base + square + ROUNDING * np.diag(np.diag(square)))
        return np.asarray((inverse + inverse.T) / 2)

    def _start(self) -> None:
        """Begin new processes where it is time to: each stands for the time since the one before on its level."""
        for level, starts in enumerate(self.levels):
            if self.blocks % (1 << level) == 0:
                stood_for = self.time - starts[-1].time if starts else WATCH.at_once * self.limit
                starts.append(Start(self.blocks, stood_for / LEVELS, self.time, self.sums))
                del starts[:-KEPT]

    # the sum ---------------------------------------------------------------------------------------------------

    def _tried(self) -> list[Start]:
        """Return the beginnings that are looked at: the older ones of each level, all of the first."""
        return [
            start
            for level, starts in enumerate(self.levels)
            for start in starts
            if not level or self.blocks - start.block > 2 << level
        ]

    def _log_parts(self, starts: Sequence[Start]) -> Array:
        """Return the logarithms of the parts of the sum, (starts, K + 1)."""
        since = [self.sums.less(start.sums) for start in starts]
        square = np.stack([each.square for each in since])
        score = np.stack([each.onto for each in since]) - square @ self.mean
        # of few readings, what δ is uncertain by hardly matters
        exact = np.array([each.rows for each in since]) > EXACT * self.sums.rows
        square[exact] -= square[exact] @ self.covariance @ square[exact]
        effects = np.empty((len(starts), len(self.groups)))
        for some, index in self._widths:
            A = square[:, index[:, :, None], index[:, None, :]]
            effects[:, some] = self._log_ratio(score[:, index], A)
        share, bins = np.log((1 - NOISE) / len(self.groups)), np.stack([each.bins for each in since])
        before = np.stack([start.sums.bins for start in starts])
        noise = _log_of_counts(np.ones_like(bins), bins) - _log_of_counts(before, bins) + np.log(NOISE)
        log_parts = np.column_stack([effects + share, noise])
        return np.asarray(log_parts + np.log([start.weight for start in starts])[:, None])

    def _log_ratio(self, u: Array, A: Array) -> Array:
        """Return log Λ, (...), from scores u, (..., p), and information A, (..., p, p); the mean over the sizes."""
        of_sizes = []
        for size in SIZES:
            inner = A * size**2 + np.eye(u.shape[-1])
            q = size**2 * np.einsum("...a,...a->...", u, np.linalg.solve(inner, u[..., None])[..., 0])
            part = np.minimum(q / self.sums.scatter, 1 - ROUNDING)
            of_sizes.append(-np.linalg.slogdet(inner)[1] / 2 - self.dof_of(self.sums) / 2 * np.log1p(-part))
        return np.asarray(_log_add(np.array(of_sizes), axis=0) - np.log(len(of_sizes)))

    @property
    def alarm(self) -> bool:
        """Whether the sum exceeds the limit, and did so already `CONFIRMED` blocks ago; asked once a block.

        What a single bad reading did, later ones take back.
        """
        limit = float(np.log(self.limit * (1 + WATCH.at_once)))
        if self.suspected < 0:
            self.suspected = self.blocks if self.log_sum >= limit else -1
        elif self.blocks - self.suspected >= CONFIRMED:
            if self.log_sum >= limit:
                return True
            self.suspected = -1
        return False

    # what is known of a change ---------------------------------------------------------------------------------

    def began(self) -> tuple[Start, Start, Start]:
        """Return the times between which it began with a probability of 90 %, and the likeliest."""
        every = (start for starts in self.levels for start in starts if start.block < self.blocks)
        tried = sorted(every, key=lambda start: start.block)
        parts = self._log_parts(tried)
        of_starts = np.exp(_log_add(parts, axis=1) - _log_add(parts))
        first, last = central(of_starts)
        return tried[max(first - 1, 0)], tried[last], tried[int(np.argmax(of_starts))]

    def readings_since(self, before: Sums) -> Since:
        """Return the readings since a time, the last ones where these are too many."""
        count = int(self.sums.rows - before.rows)
        columns, readings, marks = (part[-count:] for part in self.recent)
        covariance, sigma = self._inverse(before.square), np.sqrt(self._variance_of(before))
        unexpected = readings - columns @ (covariance @ before.onto)
        spread = self._spread(columns, covariance)
        return Since(columns * (self._per_unit / sigma), unexpected / sigma, spread, marks)

    def products(self, before: Sums, since: Since) -> tuple[Array, Array, float]:
        """Return XᵀX, Xᵀy and yᵀy of readings since a time, as far as what was known then does not imitate them."""
        flat = since.columns.reshape(-1, len(self.unit))
        square, onto = flat.T @ flat, flat.T @ since.unexpected.ravel()
        scale = np.outer(self.unit, self.unit) * self._variance_of(before)
        covariance = self._inverse(before.square + square * scale) * scale
        gram, pull = square - square @ covariance @ square, onto - square @ (covariance @ onto)
        return gram, pull, float(np.sum(since.unexpected**2) - onto @ covariance @ onto)

    def split(
        self, before: Sums, since: Since, at: int, change: Array, noise: float = 1.0
    ) -> tuple[Sums, Sums]:
        """Return the sums up to one of the readings since a time, and from there on, after a change."""
        columns, readings = (part[-len(since.marks) :] for part in self.recent[:2])
        mean, variance = self._inverse(before.square) @ before.onto, self._variance_of(before)
        spread, after = np.eye(self.components), mean + change * self._per_unit
        same = _clipped(columns[:at], readings[:at], mean, spread, variance, before.mark)
        changed = _clipped(columns[at:], readings[at:], after, spread, variance * noise**2, before.mark)
        return before.plus(same[2]), changed[2]

    def go_on(self, before: Sums, since: Sums, moved: Sequence[int], noise: float = 1.0) -> None:
        """Take what changed for how things are from now on; changes from there are looked for.

        Parameters
        ----------
        before, since : Sums
            Up to the change, and from there on.
        moved : sequence of int
            Columns whose coefficients may have changed.
        noise : float
            Factor by which readings scatter more since; 1 where that did not change.
        """
        rows, scatter, bins = before.rows, before.scatter, before.bins
        if noise != 1.0:
            rows, bins = since.rows, since.bins + 0.5
            scatter = self._variance_of(before) * noise**2 * rows * self.components
            self.lost = 0.0
        covariance = self._inverse(before.square)
        mean = covariance @ before.onto
        covariance[moved, moved] += UNKNOWN**2
        self.base = np.asarray(np.linalg.inv(covariance))
        self.sums = Sums(
            self.sums.mark, rows, np.asarray(scatter), since.square, self.base @ mean + since.onto, bins
        )
        self.covariance = self._inverse(self.sums.square)
        self.mean = self.covariance @ self.sums.onto
        self._begin()

    # kept in a file --------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Array]:
        """Return everything that readings have changed, as arrays."""
        starts = [(level, start) for level, of in enumerate(self.levels) for start in of]
        every = [*(start.sums for _, start in starts), self.sums]
        sums = zip(Sums._fields, zip(*every, strict=True), strict=True)
        numbers = [(level, *start[:-1]) for level, start in starts]
        counts = self.blocks, self.time, self.log_sum, self.lost, self.suspected
        return (
            {f"sums.{name}": np.stack(parts) for name, parts in sums}
            | {"starts": np.array(numbers, float), "counts": np.array(counts, float), "base": self.base}
            | {f"recent.{i}": part for i, part in enumerate(self.recent)}
        )

    def restore(self, state: Mapping[str, Array]) -> None:
        """Go on from a state."""
        parts = zip(*(state[f"sums.{name}"] for name in Sums._fields), strict=True)
        *sums, self.sums = [Sums(*part) for part in parts]
        blocks, self.time, self.log_sum, self.lost, suspected = state["counts"].tolist()
        self.blocks, self.suspected = int(blocks), int(suspected)
        self.levels = [[] for _ in range(LEVELS)]
        for (level, block, weight, time), each in zip(state["starts"].tolist(), sums, strict=True):
            self.levels[int(level)].append(Start(int(block), weight, time, each))
        self.base = state["base"]
        self.recent = tuple(state[f"recent.{i}"] for i in range(3))
        self.covariance = self._inverse(self.sums.square)
        self.mean = self.covariance @ self.sums.onto


def central(probabilities: Array) -> tuple[int, int]:
    """Return the numbers between which the sum of probabilities, (n,), is 90 %."""
    ends = np.searchsorted(np.cumsum(probabilities), [WATCH.outside / 2, 1 - WATCH.outside / 2])
    first, last = np.minimum(ends, len(probabilities) - 1).tolist()
    return first, last


def _distance(error: Array, spread: Array) -> Array:
    """Return the length of each error in standard deviations, (n,)."""
    squares = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[..., None])[..., 0])
    return np.asarray(np.sqrt(squares))


def _clipped(
    columns: Array, readings: Array, mean: Array, spread: Array, variance: float, mark: Array
) -> tuple[Array, Array, Sums]:
    """Return the clipped errors of readings, (n, m), how far each is from what is expected, (n,), and sums."""
    from scipy import special

    _, m, d = columns.shape
    error, flat = readings - columns @ mean, columns.reshape(-1, d)
    far = _distance(error, np.broadcast_to(spread * variance, (len(error), m, m)))
    near = np.minimum(1.0, WATCH.clip(m) / np.maximum(far, SMALLEST))
    left = error * near[:, None]
    clipped, scatter = readings - (error - left), np.array(variance * np.sum((far * near) ** 2))
    rows, bins = (
        np.array(float(len(far))),
        np.searchsorted(np.sqrt(special.chdtri(m, 1 - np.array(BINS))), far),
    )
    counts = np.bincount(bins, minlength=len(BINS) + 1).astype(float)
    return left, far, Sums(mark, rows, scatter, flat.T @ flat, flat.T @ clipped.ravel(), counts)


def _log_of_counts(before: Array, since: Array) -> Array:
    """Return the logarithm of the probability of counts, whose frequencies have Dirichlet priors, (...)."""
    from scipy import special

    whole = before + since
    each = special.gammaln(whole) - special.gammaln(before)
    return np.asarray(each.sum(-1) - special.gammaln(whole.sum(-1)) + special.gammaln(before.sum(-1)))


def _log_add(logarithms: Array, axis: int | None = None) -> Any:
    return np.logaddexp.reduce(logarithms.ravel() if axis is None else logarithms, axis=axis or 0)


class StreamWhitener:
    """What earlier rows say of the motion that the next ones share.

    The errors are those of :mod:`rodgen.statistics.whitening`, e = ε + H (u + x), u of each pose by itself, x a process
    that forgets. A Kalman filter goes from row to row and keeps what it knows of u and x, so that rows may come in any
    parts. Each is whitened: less what those before it predict.

    Parameters
    ----------
    deviations : MotionDeviations
    width : int
        Number of columns; the last is that of the readings.
    white : float
        Standard deviation of the independent errors.
    """

    def __init__(self, deviations: MotionDeviations, width: int, white: float) -> None:
        shared, wander = np.flatnonzero(deviations.shared), np.flatnonzero(deviations.wander)
        self._used = np.concatenate([shared, wander])
        self._sizes = np.concatenate([deviations.shared[shared], deviations.wander[wander]])
        self._wanders = np.arange(len(self._used)) >= len(shared)
        self._time, self._white = deviations.time, white
        self._mean = np.zeros((len(self._used), width))
        self._covariance = np.eye(len(self._used))

    def __call__(self, columns: Array, motion: Array, gap: Array, expected: Array) -> Array:
        """Return rows, (n, m, K), whitened.

        Parameters
        ----------
        columns : ndarray, shape (n, m, K)
        motion : ndarray, shape (n, m, k)
            H.
        gap : ndarray, shape (n,)
            Time since the row before: 0 of the same pose, infinite at the beginning of a run.
        expected : ndarray, shape (K - 1,)
            Coefficients of the columns by which readings are expected; one that is far from there predicts nothing.
        """
        whitened, m = np.empty(columns.shape), columns.shape[1]
        contrast = np.append(-expected, 1.0) / self._white
        for i, (row, H) in enumerate(zip(columns, motion[:, :, self._used] * self._sizes, strict=True)):
            if gap[i] > 0:
                keeps = np.where(self._wanders, np.exp(-gap[i] / self._time), 0.0)
                self._mean = keeps[:, None] * self._mean
                self._covariance = keeps[:, None] * self._covariance * keeps + np.diag(1 - keeps**2)
            across = self._covariance @ H.T
            inverse = np.linalg.inv(np.linalg.cholesky(np.eye(m) + H @ across))
            whitened[i] = inverse @ (row - H @ self._mean)
            if np.linalg.norm(whitened[i] @ contrast) > WATCH.clip(m):
                continue
            gain = across @ inverse.T
            self._mean = self._mean + gain @ whitened[i]
            self._covariance = self._covariance - gain @ gain.T
        return whitened

    def state(self) -> dict[str, Array]:
        """Return what is known, as arrays."""
        return {"whitener.mean": self._mean, "whitener.covariance": self._covariance}

    def restore(self, state: Mapping[str, Array]) -> None:
        """Go on from a state."""
        self._mean, self._covariance = state["whitener.mean"], state["whitener.covariance"]
