"""Whitening of readings that depend on each other: those of a pose, and those of neighbours in time; in time O(n).

The errors of the n readings of P poses, with m components each and columns H of a small motion with k degrees of
freedom, are

    e = ε + H (u_p + x_p),    cov e = V,

ε independent with variance 1, u_p of each pose by itself, x_p an Ornstein-Uhlenbeck process that begins anew with each
run. Within a pose the inverse of V is that of a matrix of k columns. From pose to pose x is a Markov chain: the inverse
of its covariance is a band, so is M = cov(x)⁻¹ + Hᵀ(I + H cov(u) Hᵀ)⁻¹H, and one triangle of M gives the determinant of
V, products with its inverse, and what a Kalman filter would predict of each pose from those before. A reading less that
prediction, over the root of the covariance of the pose's predictions, is independent of all others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Moments", "MotionDeviations", "Poses", "SharedMotion"]

Array: TypeAlias = NDArray[np.float64]
Index: TypeAlias = NDArray[np.intp]

SHORTEST = 1e-3
"""Poses nearer in time than this part of the usual spacing are taken for so far apart: one time twice has no
inverse."""
AT_ONCE = 1 << 23
"""Numbers in a block of columns that are whitened at once: 64 MB."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Which rows are a pose, and when it was measured; poses are sorted by run, then by time.

    Attributes
    ----------
    of : ndarray of int, shape (n,)
        Number of each row's pose, from 0.
    gap : ndarray, shape (P,)
        Time since the pose before; infinite for the first of a run.
    spacing, duration : float
        Median of the gaps, and the longest that a run takes; seconds, or poses where there are no times.
    timed : bool
        Whether there are times.
    """

    of: Index
    gap: Array
    spacing: float
    duration: float
    timed: bool

    @classmethod
    def among(cls, pose: NDArray[Any], run: NDArray[Any], t: Array | None) -> Poses:
        """Return the poses of rows.

        Parameters
        ----------
        pose, run : ndarray of int, shape (n,)
            Of each row.
        t : ndarray, shape (n,), or None
            Time of each row, seconds; None where poses follow each other in the order of their numbers.
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
        return cls._of(rank[of], time[order], run_of_pose[order], timed)

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

    def taken(self, kept: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Poses]:
        """Return the rows of some poses, (n,), and these poses alone; between them time goes on."""
        rows = kept[self.of]
        first = np.isinf(self.gap)
        run = np.cumsum(first) - 1
        time = np.cumsum(np.where(first, 0.0, self.gap))
        number = np.cumsum(kept) - 1
        found = Poses._of(number[self.of[rows]], time[kept], run[kept], self.timed)
        return rows, Poses(found.of, found.gap, self.spacing, self.duration, self.timed)

    def total(self, values: Array) -> Array:
        """Return the sums of values of rows, (n, ...), over each pose, (P, ...)."""
        order = np.argsort(self.of, kind="stable")
        if not np.array_equal(order, np.arange(len(order))):
            values = values[order]
        counts = np.bincount(self.of, minlength=self.count)
        if np.all(counts == 1):
            return values
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        return np.asarray(np.add.reduceat(values, starts, axis=0))


@dataclass(frozen=True)
class MotionDeviations:
    """Standard deviations of a motion that readings share, relative to readings of variance 1.

    Attributes
    ----------
    shared, wander : ndarray, shape (k,)
        Standard deviations of u and x along each degree of freedom.
    time : float
        After which x has forgotten 63 % of what it was.
    """

    shared: Array
    wander: Array
    time: float


@dataclass(frozen=True, eq=False)
class _Filter:
    """What the poses before predict of the motion x of each pose."""

    free: Index  # degrees of freedom that wander
    factor: Array  # lower band of the triangle of M
    keeps: Array  # (P,) part of the last pose's x that remains
    precision: Array  # (P, k, k) of x, given the poses up to this one
    covariance: Array  # (P, k, k) of x, given the poses before


@dataclass(frozen=True, eq=False)
class SharedMotion:
    """A small motion that the readings of poses share.

    Attributes
    ----------
    poses : Poses
    columns : ndarray, shape (n, m, k)
        H: what each degree of freedom does to the weighted readings.
    """

    poses: Poses
    columns: Array

    @property
    def dof(self) -> int:
        """Number of degrees of freedom."""
        return int(self.columns.shape[2])

    def gram(self) -> Array:
        """Return HᵀH of each pose, (P, k, k)."""
        return self.poses.total(np.swapaxes(self.columns, 1, 2) @ self.columns)

    def onto(self, values: Array) -> Array:
        """Return Hᵀ values of each pose, (P, k, K), of values (n, m, K)."""
        return self.poses.total(np.swapaxes(self.columns, 1, 2) @ values)

    def whiten(self, deviations: MotionDeviations, columns: Array) -> Array:
        """Return L⁻¹ columns, (n, m, K), L Lᵀ = V.

        Parameters
        ----------
        deviations : MotionDeviations
        columns : ndarray, shape (n, m, K)
        """
        gram = self.gram()
        shared = _Shared(gram, deviations.shared)
        filtered = _filtered(self.poses, shared.gram, deviations)
        spread = np.broadcast_to(np.diag(deviations.shared**2), gram.shape).copy()
        if filtered is not None:
            w = deviations.wander[filtered.free]
            spread[np.ix_(np.arange(len(gram)), filtered.free, filtered.free)] += (
                w[:, None] * filtered.covariance * w
            )
        inner = _inverse_root(gram, spread)
        n, m, K = columns.shape
        found = np.empty(columns.shape)
        step = max(1, AT_ONCE // max(1, n * max(m, self.dof)))
        for start in range(0, K, step):
            some = columns[:, :, start : start + step]
            if filtered is not None:
                some = some - self._predicted(deviations, shared, filtered, some)
            along = (inner @ self.onto(some))[self.poses.of]
            found[:, :, start : start + step] = some - self.columns @ along
        return found

    def _predicted(
        self, deviations: MotionDeviations, shared: _Shared, filtered: _Filter, columns: Array
    ) -> Array:
        P, k, K = self.poses.count, len(filtered.free), columns.shape[2]
        w = deviations.wander[filtered.free][:, None]
        known = _forward(
            filtered.factor, (w * shared.onto(self.onto(columns))[:, filtered.free]).reshape(P * k, K)
        )
        here = np.einsum("pij,pjc->pic", _blocks(filtered.factor, k), known.reshape(P, k, K))
        mean = np.linalg.solve(filtered.precision, here)
        expected = np.zeros((P, k, K))
        expected[1:] = filtered.keeps[1:, None, None] * mean[:-1]
        return np.asarray(self.columns[:, :, filtered.free] @ (w * expected)[self.poses.of])

    def covariance_of(self, deviations: MotionDeviations, columns: Array) -> Array:
        """Return Cᵀ V C, (K, K), of columns C, (n, m, K)."""
        flat = columns.reshape(-1, columns.shape[2])
        found = flat.T @ flat
        onto = self.onto(columns)
        along = deviations.shared[:, None] * onto
        found += np.einsum("pkc,pkd->cd", along, along)
        free = np.flatnonzero(deviations.wander)
        if len(free):
            from rodgen.statistics.compiled_scipy import solveh_banded

            along = deviations.wander[free][:, None] * onto[:, free]
            P, k, K = along.shape
            band, _ = _chain(self.poses.gap, deviations.time, 1)
            side = along.reshape(P, k * K)
            found += np.einsum("pkc,pkd->cd", along, solveh_banded(band, side).reshape(P, k, K))
        return np.asarray(found)


class Moments:
    """Sums over poses from which the likelihood of a motion's variances is made, without the readings.

    Parameters
    ----------
    motion : SharedMotion
    columns : ndarray, shape (n, m, K)
    """

    def __init__(self, motion: SharedMotion, columns: Array) -> None:
        flat = columns.reshape(-1, columns.shape[2])
        self.poses = motion.poses
        self.gram = motion.gram()
        self.onto = motion.onto(columns)
        self.square = flat.T @ flat

    def inverse(self, deviations: MotionDeviations) -> tuple[Array, float]:
        """Return Cᵀ V⁻¹ C, (K, K), and log |V|."""
        shared = _Shared(self.gram, deviations.shared)
        found, logarithm, onto = self.square, shared.log_determinant, self.onto
        if deviations.shared.any():
            solved = shared.solved(onto)
            flat = solved.reshape(-1, solved.shape[2])
            found = found - flat.T @ flat
            onto = shared.less(onto, solved)
        free = np.flatnonzero(deviations.wander)
        if len(free):
            band, log_chain = _information(self.poses.gap, shared.gram, deviations, free)
            factor = _triangle(band)
            side = deviations.wander[free][:, None] * onto[:, free]
            known = _forward(factor, side.reshape(-1, side.shape[2]))
            found = found - known.T @ known
            logarithm += 2 * float(np.sum(np.log(factor[0]))) + log_chain
        return found, logarithm


class _Shared:
    """The inverse of I + H cov(u) Hᵀ, seen through H."""

    def __init__(self, gram: Array, shared: Array) -> None:
        self._free = np.flatnonzero(shared)
        self.gram = gram
        self.log_determinant = 0.0
        if not len(self._free):
            return
        s = shared[self._free]
        self._across = gram[:, self._free] * s[:, None]  # half Hᵀ H, (P, u, k)
        inner = self._across[:, :, self._free] * s
        inner[:, np.arange(len(s)), np.arange(len(s))] += 1.0
        self._factor = np.linalg.cholesky(inner)
        self._s = s
        diagonal = np.diagonal(self._factor, axis1=1, axis2=2)
        self.log_determinant = 2 * float(np.sum(np.log(diagonal)))
        half = np.linalg.solve(self._factor, self._across)
        self._half = half
        self.gram = gram - np.swapaxes(half, 1, 2) @ half

    def solved(self, onto: Array) -> Array:
        """Return what CᵀC less Cᵀ(…)⁻¹C is the square of, of Hᵀ C."""
        return np.asarray(np.linalg.solve(self._factor, self._s[:, None] * onto[:, self._free]))

    def less(self, onto: Array, solved: Array) -> Array:
        """Return Hᵀ(…)⁻¹C of Hᵀ C, and of what is solved."""
        return np.asarray(onto - np.swapaxes(self._half, 1, 2) @ solved)

    def onto(self, onto: Array) -> Array:
        """Return Hᵀ(…)⁻¹C of Hᵀ C."""
        return self.less(onto, self.solved(onto)) if len(self._free) else onto


def _chain(gap: Array, time: float, k: int) -> tuple[Array, float]:
    """Return the lower band of the inverse covariance of the process with variance 1, k times, and log |covariance|."""
    keeps = np.exp(-gap / time)
    new = -np.expm1(-2 * gap / time)  # variance
    onward = np.append(keeps[1:] ** 2 / new[1:], 0.0)
    band = np.zeros((k + 1, len(gap) * k))
    band[0] = np.repeat(1 / new + onward, k)
    band[k, : (len(gap) - 1) * k] = np.repeat(-keeps[1:] / new[1:], k)
    return band, k * float(np.sum(np.log(new)))


def _information(gap: Array, gram: Array, deviations: MotionDeviations, free: Index) -> tuple[Array, float]:
    """Return the lower band of M, and log |cov(x)|."""
    k, P = len(free), len(gap)
    band, logarithm = _chain(gap, deviations.time, k)
    w = deviations.wander[free]
    block = w[:, None] * gram[:, free][:, :, free] * w
    for i in range(k):
        for j in range(i + 1):
            band[i - j].reshape(P, k)[:, j] += block[:, i, j]
    return band, logarithm


def _triangle(band: Array) -> Array:
    from rodgen.statistics.compiled_scipy import cholesky_banded

    return cholesky_banded(band)


def _forward(factor: Array, side: Array) -> Array:
    """Solve a lower triangular band."""
    from rodgen.statistics.compiled_scipy import solve_triangular_band

    return solve_triangular_band(factor, side)


def _blocks(factor: Array, k: int) -> Array:
    """Return the triangles on the diagonal of a band, (P, k, k)."""
    P = factor.shape[1] // k
    found = np.zeros((P, k, k))
    for i in range(k):
        for j in range(i + 1):
            found[:, i, j] = factor[i - j].reshape(P, k)[:, j]
    return found


def _filtered(poses: Poses, gram: Array, deviations: MotionDeviations) -> _Filter | None:
    free = np.flatnonzero(deviations.wander)
    if not len(free):
        return None
    k = len(free)
    band, _ = _information(poses.gap, gram, deviations, free)
    factor = _triangle(band)
    keeps = np.exp(-poses.gap / deviations.time)
    new = -np.expm1(-2 * poses.gap / deviations.time)
    block = _blocks(factor, k)
    precision = block @ np.swapaxes(block, 1, 2)
    onward = np.append(keeps[1:] ** 2 / new[1:], 0.0)
    precision[:, np.arange(k), np.arange(k)] -= onward[:, None]
    covariance = np.broadcast_to(np.eye(k), precision.shape).copy()
    before = np.linalg.inv(precision[:-1])
    covariance[1:] = keeps[1:, None, None] ** 2 * before + new[1:, None, None] * np.eye(k)
    return _Filter(free, factor, keeps, precision, covariance)


def _inverse_root(gram: Array, spread: Array) -> Array:
    """Return Z of each pose with (I + H spread Hᵀ)^(-1/2) = I - H Z Hᵀ, (P, k, k)."""
    values, vectors = np.linalg.eigh(spread)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    values, vectors = np.linalg.eigh(np.swapaxes(root, 1, 2) @ gram @ root)
    values = np.maximum(values, 0.0)
    big = np.sqrt(1 + values)
    part = 1 / (big * (1 + big))  # (1 - 1/big) / values
    root = root @ vectors
    return np.asarray((root * part[:, None, :]) @ np.swapaxes(root, 1, 2))
