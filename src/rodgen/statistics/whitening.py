"""Whitening of readings that depend on each other: those of a pose, and those of neighbours in time; in time O(n).

The errors of the n readings of P poses, with m components each and columns H of a small motion with k degrees of
freedom, are

    e = ε + H (u_p + x_p + g),    cov e = V,

ε independent with variance 1, u_p of each pose by itself, x_p an Ornstein-Uhlenbeck process that begins anew with each
run, g what all poses at one position, or of one run, have in common. Within a pose the inverse of V is that of a matrix
of k columns. From pose to pose x is a Markov chain: the inverse
of its covariance is a band, so is M = cov(x)⁻¹ + Hᵀ(I + H cov(u) Hᵀ)⁻¹H, and one triangle of M gives the determinant of
V, products with its inverse, and what a Kalman filter would predict of each pose from those before. A reading less that
prediction, over the root of the covariance of the pose's predictions, is independent of all others. Positions and runs
are few: what they share is taken in afterwards, as a matrix of as many columns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Index
from rodgen.statistics.decompositions import eigh

SHORTEST = 1e-3
"""Poses nearer in time than this part of the usual spacing are taken for so far apart: one time twice has no
inverse."""
AT_ONCE = 1 << 23
"""Numbers in a block of columns that are whitened at once: 64 MB."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Which rows are a pose, and when it was measured; poses are sorted by run, then by time."""

    of: Index
    """Number of each row's pose, from 0, (n,)."""
    gap: Array
    """Time since the pose before; infinite for the first of a run, (P,)."""
    spacing: float
    duration: float
    """Median of the gaps, and the longest that a run takes; seconds, or poses where there are no times."""
    timed: bool
    """Whether there are times."""
    position: Index | None = None
    """Number of each pose's position, from 0, (P,); None where it is not asked for."""

    @classmethod
    def among(
        cls, pose: NDArray[Any], run: NDArray[Any], t: Array | None, position: NDArray[Any] | None = None
    ) -> Poses:
        """Return the poses of rows.

        Parameters
        ----------
        pose, run : ndarray of int, shape (n,)
            Of each row.
        t : ndarray, shape (n,), or None
            Time of each row, seconds; None where poses follow each other in the order of their numbers.
        position : ndarray of int, shape (n,), optional
            Equal of rows at the same position.
        """
        number, of = np.unique(pose, return_inverse=True)
        count = np.bincount(of)
        timed = t is not None and bool(np.ptp(t) > 0)
        time = np.bincount(of, t) / count if timed and t is not None else number.astype(float)
        run_of_pose = np.zeros(len(number), np.intp)
        run_of_pose[of] = run
        order = np.lexsort((number, time, run_of_pose))
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        poses = cls._of(rank[of], time[order], run_of_pose[order], timed)
        if position is None:
            return poses
        at = np.zeros(len(number), np.intp)
        at[rank[of]] = position
        return replace(poses, position=np.unique(at, return_inverse=True)[1])

    @classmethod
    def _of(cls, of: Index, time: Array, run: Index, timed: bool) -> Poses:
        gap = np.diff(time, prepend=time[0])
        first = np.diff(run, prepend=-1) != 0
        inside = gap[~first]
        known = inside[inside > 0]
        spacing = float(np.median(known)) if len(known) else 1.0
        starts = np.flatnonzero(first)
        ends = np.append(starts[1:], len(time)) - 1
        duration = max(float(np.max(time[ends] - time[starts])), spacing)
        gap = np.where(first, np.inf, np.maximum(gap, SHORTEST * spacing))
        return cls(of, gap, spacing, duration, timed)

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.gap)

    def taken(self, rows: NDArray[np.bool_]) -> Poses:
        """Return the poses of some rows, (n,), alone; between them time goes on."""
        is_taken = np.bincount(self.of[rows], minlength=self.count) > 0
        first = np.isinf(self.gap)
        run = np.cumsum(first) - 1
        time = np.cumsum(np.where(first, 0.0, self.gap))
        number = np.cumsum(is_taken) - 1
        taken_poses = Poses._of(number[self.of[rows]], time[is_taken], run[is_taken], self.timed)
        position = None
        if self.position is not None:
            position = np.unique(self.position[is_taken], return_inverse=True)[1]
        return replace(taken_poses, spacing=self.spacing, duration=self.duration, position=position)

    @cached_property
    def run(self) -> Index:
        """Number of each pose's run, from 0, (P,)."""
        return np.asarray(np.cumsum(np.isinf(self.gap)) - 1)

    def level_columns(self, deviations: MotionDeviations) -> Array | None:
        """Return the motion of each pose by one standard deviation of its position and its run, (P, k, L)."""
        columns_of = []
        for name in ("position", "run"):
            sizes, level = getattr(deviations, name), getattr(self, name)
            free = np.flatnonzero(sizes)
            if not len(free) or level is None:
                continue
            columns = np.zeros((self.count, len(sizes), len(free), int(level.max()) + 1))
            for i, j in enumerate(free):
                columns[np.arange(self.count), j, i, level] = sizes[j]
            columns_of.append(columns.reshape(self.count, len(sizes), -1))
        return np.concatenate(columns_of, axis=2) if columns_of else None

    def total(self, values: Array) -> Array:
        """Return the sums of values of rows, (n, ...), over each pose, (P, ...)."""
        starts = np.cumsum(self._counts) - self._counts
        return np.asarray(np.add.reduceat(self.sorted(values), starts, axis=0))

    def sorted(self, values: Array) -> Array:
        """Return values of rows, (n, ...), pose by pose."""
        return values if self._order is None else values[self._order]

    @cached_property
    def _order(self) -> Index | None:
        order = np.argsort(self.of, kind="stable")
        return None if np.array_equal(order, np.arange(len(order))) else order

    @cached_property
    def _counts(self) -> Index:
        return np.bincount(self.of, minlength=self.count)

    @cached_property
    def size(self) -> int | None:
        """Number of rows of a pose; None if it differs from pose to pose."""
        first = int(self._counts[0]) if self.count else 1
        return first if np.all(self._counts == first) else None


@dataclass(frozen=True)
class MotionDeviations:
    """Standard deviations of a motion that readings share, relative to readings of variance 1."""

    shared: Array
    wander: Array
    """Standard deviations of u and x along each degree of freedom, (k,)."""
    time: float
    """After which x has forgotten 63 % of its value."""
    position: Array = field(default_factory=lambda: np.zeros(0))
    run: Array = field(default_factory=lambda: np.zeros(0))
    """Of what all poses at one position, and of a run, share, (k,); empty where they share nothing."""


@dataclass(frozen=True, eq=False)
class SharedMotion:
    """A small motion that the readings of poses share."""

    poses: Poses
    columns: Array
    """H: what each degree of freedom does to the weighted readings, (n, m, k)."""

    @property
    def dof(self) -> int:
        """Number of degrees of freedom."""
        return int(self.columns.shape[2])

    def gram(self) -> Array:
        """Return HᵀH of each pose, (P, k, k)."""
        return self.onto(self.columns)

    def onto(self, values: Array) -> Array:
        """Return Hᵀ values of each pose, (P, k, K), of values (n, m, K)."""
        if self.poses.size is None:
            return self.poses.total(np.swapaxes(self.columns, 1, 2) @ values)
        return np.asarray(self._of_poses @ self._by_pose(values))

    @cached_property
    def _of_poses(self) -> Array:
        """Hᵀ of each pose, (P, k, rows m), where all have the same number of rows."""
        return np.ascontiguousarray(np.swapaxes(self._by_pose(self.columns), 1, 2))

    def _by_pose(self, values: Array) -> Array:
        return self.poses.sorted(values).reshape(self.poses.count, -1, values.shape[2])

    def covariance_of(self, deviations: MotionDeviations, columns: Array, onto: Array | None = None) -> Array:
        """Return Cᵀ V C, (K, K), of columns C, (n, m, K); `onto` is Hᵀ C, where it is known."""
        return np.asarray(sum(x.T @ x for x in self._factors(deviations, columns, onto)))

    def variances_of(self, deviations: MotionDeviations, columns: Array, onto: Array | None = None) -> Array:
        """Return the diagonal of Cᵀ V C, (K,), of columns C, (n, m, K)."""
        return np.asarray(sum(np.einsum("ik,ik->k", x, x) for x in self._factors(deviations, columns, onto)))

    def _factors(self, deviations: MotionDeviations, columns: Array, onto: Array | None) -> Iterator[Array]:
        """Yield factors, each (rows, K), of which the squares add up to Cᵀ V C."""
        K = columns.shape[2]
        flat, onto = columns.reshape(-1, K), self.onto(columns) if onto is None else onto
        yield flat
        yield (deviations.shared[:, None] * onto).reshape(-1, K)
        free = np.flatnonzero(deviations.wander)
        if len(free):
            along = deviations.wander[free][:, None] * onto[:, free]
            band = _Chain.of(self.poses.gap, deviations.time).band(1)
            yield _forward(_triangle(band), along.reshape(self.poses.count, -1)).reshape(-1, K)
        levels = self.poses.level_columns(deviations)
        if levels is not None:
            yield _product(levels, onto)


class Whitener:
    """L⁻¹, L Lᵀ = V, ready for any columns."""

    def __init__(self, motion: SharedMotion, deviations: MotionDeviations) -> None:
        self.motion, gram = motion, motion.gram()
        self._poses = poses = _Poses(motion.poses, gram, deviations)
        spread = np.broadcast_to(np.diag(deviations.shared**2), gram.shape).copy()
        if len(free := poses.free):
            k, chain, w = np.arange(len(free)), poses.chain, poses.wander
            block = _blocks(poses.factor, len(free))
            precision = block @ np.swapaxes(block, 1, 2)  # of x, given the poses up to this one
            precision[:, k, k] -= _onward(chain.keeps**2 / chain.new)[:, None]
            covariance = np.broadcast_to(np.eye(len(free)), precision.shape).copy()  # given the poses before
            before, keeps = np.linalg.inv(precision[:-1]), chain.keeps[1:, None, None]
            covariance[1:] = keeps**2 * before + chain.new[1:, None, None] * np.eye(len(free))
            spread[np.ix_(np.arange(len(gram)), free, free)] += w * covariance * w[:, 0]
            # what the poses before predict of a pose, from what the factor knows
            self._mean = keeps * np.linalg.solve(precision[:-1], block[:-1])
        self._inner = _inverse_root(gram, spread)
        self._levels: tuple[Array, Array] | None = None
        levels = motion.poses.level_columns(deviations)
        if levels is not None:
            flat = self._of_poses(motion.columns @ levels[motion.poses.of]).reshape(-1, levels.shape[2])
            values, vectors = eigh(flat.T @ flat)
            some = values > 1e-14 * values[-1]
            values, vectors = values[some], vectors[:, some]
            big = np.sqrt(1 + values)
            self._levels = flat @ (vectors / (big * (1 + big))), flat @ vectors

    def __call__(self, columns: Array) -> Array:
        """Return L⁻¹ columns, (n, m, K), of columns (n, m, K)."""
        whitened = self._of_poses(columns)
        if self._levels is None:
            return whitened
        flat = whitened.reshape(whitened.shape[0] * whitened.shape[1], columns.shape[2])
        root, across = self._levels
        return (flat - root @ (across.T @ flat)).reshape(columns.shape)

    def _of_poses(self, columns: Array) -> Array:
        """Return columns without what a pose shares and what wanders."""
        motion = self.motion
        n, m, K = columns.shape
        whitened = np.empty(columns.shape)
        step = max(1, AT_ONCE // max(1, n * max(m, motion.dof)))
        for start in range(0, K, step):
            some = columns[:, :, start : start + step]
            if len(self._poses.free):
                some = some - self._predicted(some)
            along = (self._inner @ motion.onto(some))[motion.poses.of]
            whitened[:, :, start : start + step] = some - motion.columns @ along
        return whitened

    def _predicted(self, columns: Array) -> Array:
        motion, poses = self.motion, self._poses
        expected = np.zeros((motion.poses.count, len(poses.free), columns.shape[2]))
        known = poses.halved(motion.onto(columns))[1][-expected[..., 0].size :].reshape(expected.shape)
        expected[1:] = self._mean @ known[:-1]
        return np.asarray(motion.columns[:, :, poses.free] @ (poses.wander * expected)[motion.poses.of])


class Moments:
    """Sums over poses from which the likelihood of a motion's variances is made, without the readings.

    Parameters
    ----------
    columns : ndarray, shape (n, m, K)
    """

    def __init__(self, motion: SharedMotion, columns: Array) -> None:
        flat = columns.reshape(columns.shape[0] * columns.shape[1], columns.shape[2])
        self.poses = motion.poses
        self.gram = motion.gram()
        self.onto = motion.onto(columns)
        self.square = flat.T @ flat


class Weighted:
    """Products of columns C with V⁻¹, and how they change with the variances.

    What positions and runs share, H Λ with V = V₂ + H Λ Λᵀ Hᵀ, is taken for further columns, Y = (H Λ, C). The triangle
    of Yᵀ V₂⁻¹ Y, plus 1 on the diagonal for each column of H Λ, then has in its upper rows |V| / |V₂|, and in the
    others the triangle of Cᵀ V⁻¹ C.

    Attributes
    ----------
    log_determinant : float
        log |V|.
    levels : int
        Number of columns of H Λ.
    triangle : ndarray, shape (levels + K, levels + K)
        Lower.

    Raises
    ------
    numpy.linalg.LinAlgError
        When columns depend on each other, or numbers leave the range of doubles.
    """

    def __init__(self, moments: Moments, deviations: MotionDeviations) -> None:
        self._gram, self._deviations, self._of = moments.gram, deviations, moments.poses
        self._poses = _Poses(moments.poses, moments.gram, deviations)
        self._onto, square, self.levels = moments.onto, moments.square, 0
        levels = moments.poses.level_columns(deviations)
        if levels is not None:
            self.levels, moved = levels.shape[2], self._gram @ levels
            side = _product(levels, moments.onto)
            self._onto = np.concatenate([moved, moments.onto], axis=2)
            square = np.block([[_product(levels, moved), side], [side.T, square]])
        self._within, self._half = self._poses.halved(self._onto)
        square = square - self._half.T @ self._half
        leading = np.arange(self.levels)
        self._of_levels = square[leading, leading]
        square[leading, leading] += 1.0
        self.triangle = np.linalg.cholesky(square)
        self.log_determinant = self._poses.log_determinant + 2 * float(
            np.sum(np.log(self.triangle[leading, leading]))
        )

    def score(
        self, parts: Sequence[tuple[str, slice]], fixed: int, variance: float, *, profiled: bool
    ) -> tuple[Array, Array]:
        """Return the slope of the restricted likelihood of the last column, and its average information.

        By the logarithm of a standard deviation, V has the derivative 2 H D Hᵀ, D that part of the covariance of the
        motion; by that of the correlation time, 2 D = -W C (C⁻¹)' C W, W C W the covariance of what wanders. With r, of
        variance σ², what all other columns leave of the last one, and P = V⁻¹ - V⁻¹X (XᵀV⁻¹X)⁻¹ XᵀV⁻¹, the slope is

            rᵀ V⁻¹ H D Hᵀ V⁻¹ r / σ² - tr P H D Hᵀ

        and the information the mean of that expected and that observed, 2 fᵀ P f, where f = H D Hᵀ V⁻¹ r / σ (Gilmour,
        Thompson and Cullis 1995). The traces ask for the blocks of M⁻¹ on its diagonal and next to it only.

        Parameters
        ----------
        parts : sequence of (kind, degrees of freedom)
            That share a standard deviation; of kind ``"time"`` for the correlation time.
        fixed : int
            Number of columns of X, the first.
        variance : float
            σ².
        profiled : bool
            Whether σ² is the likeliest.

        Returns
        -------
        slope : ndarray, shape (parts,)
        information : ndarray, shape (parts, parts)
        """
        inverse = np.linalg.inv(self.triangle)
        residual = inverse[-1] * (self.triangle[-1, -1] / np.sqrt(variance))
        directions = np.column_stack([inverse[: self.levels + fixed].T, residual])
        changes = self._changes(directions, {kind for kind, _ in parts})
        slope = np.array([np.sum(changes[kind][0][of]) for kind, of in parts])
        moves = np.zeros((*self._gram.shape[:2], len(parts)))
        for i, (kind, of) in enumerate(parts):
            moves[:, of, i] = changes[kind][1][:, of]
        onto = self._gram @ moves
        half = self._poses.halved(onto)[1]
        seen = (inverse if profiled else inverse[:-1]) @ (_product(self._onto, moves) - self._half.T @ half)
        return slope, 2 * (_product(moves, onto) - half.T @ half - seen.T @ seen)

    def _changes(self, directions: Array, kinds: set[str]) -> dict[str, tuple[Array, Array]]:
        """Return the slope of each kind along each degree of freedom, (k,), and D HᵀV⁻¹ r / σ of each pose, (P, k)."""
        deviations, poses, gram, (P, k) = (
            self._deviations,
            self._poses,
            self._poses.gram,
            self._gram.shape[:2],
        )
        along, diagonals = self._within @ directions, np.einsum("pii->i", gram)
        changes = {}
        if count := len(free := poses.free):
            w, chain = poses.wander, poses.chain
            x = _forward(poses.factor, self._half[-P * count :] @ directions, "T").reshape(P, count, -1)
            across = gram[:, :, free] * w[:, 0]
            along = along - across @ x
            blocks, beside = _inverse_blocks(poses.band, poses.factor, chain.off_diagonal, count)
            diagonals = diagonals - np.einsum("pij,pij->i", across @ blocks, across)
            inner = np.einsum("pii->pi", blocks)
            diagonal, off_diagonal, logarithm = chain.by_time
            rate = diagonal[:, None, None] * x
            rate[1:] += off_diagonal[1:, None, None] * x[:-1]
            rate[:-1] += off_diagonal[1:, None, None] * x[1:]
            traces = chain.diagonal @ inner + 2 * chain.off_diagonal @ beside - P
            wander = np.einsum("pka,pka->k", along[:, free], w * x) + traces
            traces = logarithm + diagonal @ inner + 2 * off_diagonal @ beside
            time = -(np.einsum("pka,pka->k", x, rate) + traces) / 2
            root = _triangle(chain.band(1))
            later = -_forward(root, _forward(root, rate[:, :, -1]), "T") / 2
            for kind, slope, move in (("wander", wander, x[:, :, -1]), ("time", time, later)):
                changes[kind] = np.zeros(k), np.zeros((P, k))
                changes[kind][0][free], changes[kind][1][:, free] = slope, w[:, 0] * move
        for kind in kinds - {"wander", "time"}:
            size = deviations.shared if kind == "pose" else getattr(deviations, kind)
            some, moved, trace = np.flatnonzero(size), along, size**2 * diagonals
            if kind != "pose":
                level = getattr(self._of, kind)
                moved = sums(along, level)[level]
                of_kind = len(some) * (int(level.max()) + 1)
                columns = self._of_levels[:of_kind] if kind == "position" else self._of_levels[-of_kind:]
                trace = np.zeros(k)
                trace[some] = columns.reshape(len(some), -1).sum(axis=1)
            slope = size**2 * np.einsum("pka,pka->k", along, moved) - trace
            changes[kind] = slope, size**2 * moved[:, :, -1]
        return changes


class _Poses:
    """What V₂⁻¹ is made of: the inverses of I + H cov(u) Hᵀ of each pose, and the triangle of M."""

    def __init__(self, poses: Poses, gram: Array, deviations: MotionDeviations) -> None:
        self._shared, self.free = np.flatnonzero(deviations.shared), np.flatnonzero(deviations.wander)
        s = deviations.shared[self._shared]
        across = gram[:, self._shared] * s[:, None]  # half Hᵀ H, (P, u, k)
        within = np.linalg.cholesky(np.eye(len(s)) + across[:, :, self._shared] * s)
        inverse = np.linalg.inv(within)
        self._inverse, self._half = inverse * s, inverse @ across
        self.gram = gram - np.swapaxes(self._half, 1, 2) @ self._half
        """Hᵀ(I + H cov(u) Hᵀ)⁻¹H, (P, k, k)."""
        self.log_determinant = 2 * float(np.sum(np.log(np.diagonal(within, axis1=1, axis2=2))))
        """log |V₂|."""
        if k := len(self.free):
            self.wander = deviations.wander[self.free][:, None]
            self.chain = _Chain.of(poses.gap, deviations.time)
            self.band = self.chain.band(k)
            """Lower, of M."""
            block = self.wander * self.gram[:, self.free][:, :, self.free] * self.wander[:, 0]
            for i in range(k):
                for j in range(i + 1):
                    self.band[i - j].reshape(-1, k)[:, j] += block[:, i, j]
            self.factor = _triangle(self.band)
            self.log_determinant += 2 * float(np.sum(np.log(self.factor[0]))) + k * self.chain.log_determinant

    def halved(self, onto: Array) -> tuple[Array, Array]:
        """Return Hᵀ(I + H cov(u) Hᵀ)⁻¹Y of Hᵀ Y, and that whose square is YᵀY less Yᵀ V₂⁻¹ Y."""
        within, half = onto, np.zeros((0, onto.shape[2]))
        if len(self._shared):
            solved = self._inverse @ onto[:, self._shared]
            within, half = onto - np.swapaxes(self._half, 1, 2) @ solved, solved.reshape(-1, onto.shape[2])
        if not len(self.free):
            return within, half
        side = _forward(self.factor, (self.wander * within[:, self.free]).reshape(-1, onto.shape[2]))
        return within, np.concatenate([half, side]) if len(half) else side


@dataclass(frozen=True, eq=False)
class _Chain:
    """The inverse covariance of the process with variance 1, a band."""

    ratio: Array  # (P,) of the gap to the correlation time; 0 for the first of a run
    keeps: Array  # (P,) part of the last pose's x that remains
    new: Array  # (P,) variance that is added
    diagonal: Array  # (P,)
    off_diagonal: Array  # (P,) next to the diagonal, of a pose with the one before
    log_determinant: float  # of the covariance

    @classmethod
    def of(cls, gap: Array, time: float) -> _Chain:
        ratio = gap / time
        keeps, new = np.exp(-ratio), -np.expm1(-2 * ratio)
        off_diagonal = -keeps / new
        return cls(
            np.where(np.isinf(gap), 0.0, ratio),
            keeps,
            new,
            1 / new - _onward(keeps * off_diagonal),
            off_diagonal,
            float(np.sum(np.log(new))),
        )

    @property
    def by_time(self) -> tuple[Array, Array, float]:
        """The derivatives of the diagonals and of the determinant by the logarithm of the correlation time."""
        change = 2 * self.ratio * (self.keeps / self.new) ** 2
        beside = -self.ratio * self.keeps * (1 + self.keeps**2) / self.new**2
        return change + _onward(change), beside, -float(change @ self.new)

    def band(self, k: int) -> Array:
        """Return its lower band, of k processes that are independent of each other."""
        P = len(self.diagonal)
        band = np.zeros((k + 1, P * k))
        band[0] = np.repeat(self.diagonal, k)
        band[k, : (P - 1) * k] = np.repeat(self.off_diagonal[1:], k)
        return band


def _onward(values: Array) -> Array:
    """Return for each pose the value of the next one, 0 for the last."""
    return np.append(values[1:], 0.0)


def _triangle(band: Array) -> Array:
    from scipy.linalg.lapack import dpbtrf

    factor, failed = dpbtrf(band, lower=1)
    if failed:
        raise np.linalg.LinAlgError("a band is not positive definite")
    return np.asarray(factor)


def _forward(factor: Array, side: Array, transposed: str = "N") -> Array:
    """Solve a lower triangular band, or its transpose."""
    if not side.shape[1]:
        return side  # LAPACK writes where there is nothing
    from scipy.linalg.lapack import dtbtrs

    solved, failed = dtbtrs(factor, side, uplo="L", trans=transposed)
    if failed:
        raise np.linalg.LinAlgError("a band is singular")
    return np.asarray(solved)


def _blocks(factor: Array, k: int) -> Array:
    """Return the lower triangles of the blocks on the diagonal of a band, (P, k, k)."""
    P = factor.shape[1] // k
    blocks = np.zeros((P, k, k))
    for i in range(k):
        for j in range(i + 1):
            blocks[:, i, j] = factor[i - j].reshape(P, k)[:, j]
    return blocks


def _inverse_blocks(band: Array, factor: Array, beside: Array, k: int) -> tuple[Array, Array]:
    """Return the blocks on the diagonal of M⁻¹, (P, k, k), and the diagonals of those left of them, (P, k).

    The inverse of one on the diagonal is the block of M, less what the poses before explain of it, and those after.
    """
    before, inner = _blocks(factor, k), _blocks(band, k)
    before = before @ np.swapaxes(before, 1, 2)
    inner = inner + np.swapaxes(np.tril(inner, -1), 1, 2)
    flipped = np.zeros_like(band)
    for i, row in enumerate(band):
        flipped[i, : len(row) - i] = row[: len(row) - i][::-1]
    after = _blocks(_triangle(flipped), k)
    after = (after @ np.swapaxes(after, 1, 2))[::-1, ::-1, ::-1]
    inverses, left = np.asarray(np.linalg.inv(before + after - inner)), np.zeros((len(inner), k))
    left[1:] = -beside[1:, None] * np.einsum("pij,pji->pi", inverses[1:], np.linalg.inv(before[:-1]))
    return inverses, left


def _product(one: Array, second: Array) -> Array:
    """Return the products, (K, L), of columns (P, k, K) with columns (P, k, L)."""
    return one.reshape(-1, one.shape[2]).T @ second.reshape(-1, second.shape[2])


def sums(values: Array, level: Index) -> Array:
    """Return the sums of values of poses, (P, ...), over each level, (levels, ...)."""
    totals = np.zeros((int(level.max()) + 1, *values.shape[1:]))
    np.add.at(totals, level, values)
    return totals


def _inverse_root(gram: Array, spread: Array) -> Array:
    """Return Z of each pose with (I + H spread Hᵀ)^(-1/2) = I - H Z Hᵀ, (P, k, k)."""
    values, vectors = eigh(spread)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    values, vectors = eigh(np.swapaxes(root, 1, 2) @ gram @ root)
    values = np.maximum(values, 0.0)
    big = np.sqrt(1 + values)
    part = 1 / (big * (1 + big))  # (1 - 1/big) / values
    root = root @ vectors
    return np.asarray((root * part[:, None, :]) @ np.swapaxes(root, 1, 2))
