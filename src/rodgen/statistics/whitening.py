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

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

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

    def taken(self, rows: NDArray[np.bool_]) -> Poses:
        """Return the poses of some rows, (n,), alone; between them time goes on."""
        kept = np.bincount(self.of[rows], minlength=self.count) > 0
        first = np.isinf(self.gap)
        run = np.cumsum(first) - 1
        time = np.cumsum(np.where(first, 0.0, self.gap))
        number = np.cumsum(kept) - 1
        found = Poses._of(number[self.of[rows]], time[kept], run[kept], self.timed)
        return Poses(found.of, found.gap, self.spacing, self.duration, self.timed)

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
    """After which x has forgotten 63 % of what it was."""

    def times(self, one: MotionDeviations, other: MotionDeviations) -> MotionDeviations:
        """Return these, times the ratio of one to another."""
        ratios = [
            np.divide(a, b, out=np.ones_like(b), where=b > 0)
            for a, b in ((one.shared, other.shared), (one.wander, other.wander))
        ]
        return MotionDeviations(
            self.shared * ratios[0], self.wander * ratios[1], self.time * one.time / other.time
        )


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

    def covariance_of(self, deviations: MotionDeviations, columns: Array) -> Array:
        """Return Cᵀ V C, (K, K), of columns C, (n, m, K)."""
        return np.asarray(sum(left.T @ right for left, right in self._factors(deviations, columns)))

    def variances_of(self, deviations: MotionDeviations, columns: Array) -> Array:
        """Return the diagonal of Cᵀ V C, (K,), of columns C, (n, m, K)."""
        return np.asarray(
            sum(np.einsum("ik,ik->k", left, right) for left, right in self._factors(deviations, columns))
        )

    def _factors(self, deviations: MotionDeviations, columns: Array) -> Iterator[tuple[Array, Array]]:
        """Yield factors, each (rows, K), of which the products add up to Cᵀ V C."""
        K = columns.shape[2]
        flat, onto = columns.reshape(-1, K), self.onto(columns)
        yield flat, flat
        along = (deviations.shared[:, None] * onto).reshape(-1, K)
        yield along, along
        free = np.flatnonzero(deviations.wander)
        if len(free):
            along = deviations.wander[free][:, None] * onto[:, free]
            band = _Chain.of(self.poses.gap, deviations.time).band(1)
            side = along.reshape(self.poses.count, -1)
            yield (
                along.reshape(-1, K),
                _solved(band, side).reshape(-1, K),
            )

    def drawn(self, deviations: MotionDeviations, count: int, random: np.random.Generator) -> Array:
        """Return errors, (n, m, count), drawn independently, of a motion that goes on from run to run."""
        P, k = self.poses.count, self.dof
        x = random.normal(size=(P, k, count))
        gap = np.where(np.isinf(self.poses.gap), self.poses.spacing, self.poses.gap)
        keeps = np.exp(-gap / deviations.time)
        for p in range(1, P):
            x[p] = keeps[p] * x[p - 1] + np.sqrt(1 - keeps[p] ** 2) * x[p]
        x = deviations.wander[:, None] * x + deviations.shared[:, None] * random.normal(size=x.shape)
        noise = random.normal(size=(*self.columns.shape[:2], count))
        return np.asarray(noise + self.columns @ x[self.poses.of])


class Whitener:
    """L⁻¹, L Lᵀ = V, ready for any columns."""

    def __init__(self, motion: SharedMotion, deviations: MotionDeviations) -> None:
        self.motion = motion
        gram = motion.gram()
        self._shared = _Shared(gram, deviations.shared)
        self._filter = _filtered(motion.poses, self._shared.gram, deviations)
        spread = np.broadcast_to(np.diag(deviations.shared**2), gram.shape).copy()
        if self._filter is not None:
            free = self._filter.free
            self._wander = deviations.wander[free][:, None]
            spread[np.ix_(np.arange(len(gram)), free, free)] += (
                self._wander * self._filter.covariance * self._wander[:, 0]
            )
            # a pose's mean, from what the factor knows: precision⁻¹ (block of the factor)
            self._mean = np.linalg.solve(self._filter.precision, _blocks(self._filter.factor, len(free)))
        self._inner = _inverse_root(gram, spread)

    def __call__(self, columns: Array) -> Array:
        """Return L⁻¹ columns, (n, m, K), of columns (n, m, K)."""
        motion = self.motion
        n, m, K = columns.shape
        found = np.empty(columns.shape)
        step = max(1, AT_ONCE // max(1, n * max(m, motion.dof)))
        for start in range(0, K, step):
            some = columns[:, :, start : start + step]
            if self._filter is not None:
                some = some - self._predicted(self._filter, some)
            along = (self._inner @ motion.onto(some))[motion.poses.of]
            found[:, :, start : start + step] = some - motion.columns @ along
        return found

    def _predicted(self, filtered: _Filter, columns: Array) -> Array:
        motion = self.motion
        P, k, K = motion.poses.count, len(filtered.free), columns.shape[2]
        side = self._wander * self._shared.onto(motion.onto(columns))[:, filtered.free]
        known = _forward(filtered.factor, side.reshape(P * k, K)).reshape(P, k, K)
        expected = np.zeros((P, k, K))
        expected[1:] = filtered.keeps[1:, None, None] * (self._mean[:-1] @ known[:-1])
        return np.asarray(motion.columns[:, :, filtered.free] @ (self._wander * expected)[motion.poses.of])


class Moments:
    """Sums over poses from which the likelihood of a motion's variances is made, without the readings.

    Parameters
    ----------
    columns : ndarray, shape (n, m, K)
    """

    def __init__(self, motion: SharedMotion, columns: Array) -> None:
        flat = columns.reshape(-1, columns.shape[2])
        self.poses = motion.poses
        self.gram = motion.gram()
        self.onto = motion.onto(columns)
        self.square = flat.T @ flat
        self._kept: dict[bytes, tuple[_Shared, Array, Array]] = {}

    def _shared(self, deviations: Array) -> tuple[_Shared, Array, Array]:
        """Return what the pose's part leaves: its inverse, Cᵀ(…)⁻¹C and Hᵀ(…)⁻¹C."""
        shared = _Shared(self.gram, deviations)
        if not deviations.any():
            return shared, self.square, self.onto
        solved = shared.solved(self.onto)
        flat = solved.reshape(-1, solved.shape[2])
        return shared, self.square - flat.T @ flat, shared.less(self.onto, solved)

    def inverse(self, deviations: MotionDeviations) -> InverseProducts:
        """Return Cᵀ V⁻¹ C and log |V|, from which their derivatives follow."""
        key = deviations.shared.tobytes()
        if key not in self._kept:  # differences along the wander leave the pose's part as it is
            self._kept = {key: self._shared(deviations.shared)}
        shared, products, onto = self._kept[key]
        logarithm = shared.log_determinant
        free = np.flatnonzero(deviations.wander)
        if not len(free):
            return InverseProducts(self.poses, deviations, shared.gram, onto, products, logarithm, free)
        band, log_chain = _information(self.poses.gap, shared.gram, deviations, free)
        factor = _triangle(band)
        side = deviations.wander[free][:, None] * onto[:, free]
        known = _forward(factor, side.reshape(-1, side.shape[2]))
        products = products - known.T @ known
        logarithm += 2 * float(np.sum(np.log(factor[0]))) + log_chain
        return InverseProducts(
            self.poses,
            deviations,
            shared.gram,
            onto,
            products,
            logarithm,
            free,
            (band, factor, known),
        )


@dataclass(frozen=True, eq=False)
class InverseProducts:
    """Products of columns C with the inverse of V, and how they change with the deviations."""

    _poses: Poses
    _deviations: MotionDeviations
    _gram: Array  # (P, k, k), G = Hᵀ R⁻¹ H, R = I + H cov(u) Hᵀ
    _onto: Array  # (P, k, K), Hᵀ R⁻¹ C
    products: Array
    """Cᵀ V⁻¹ C, (K, K)."""
    log_determinant: float
    """log |V|."""
    _free: Index  # degrees of freedom that wander
    _solved: tuple[Array, Array, Array] | None = None  # band of M, its triangle T, and T⁻¹ side

    def change(self, roots: Array, together: Array) -> Change:
        """Return how log |V| + tr(rootsᵀ Cᵀ V⁻¹ C roots) changes with the logarithms of the deviations.

        Parameters
        ----------
        roots : ndarray, shape (K, r)
            The last makes, of C, the residuals that the fixed effects leave, in standard deviations.
        together : ndarray, shape (2 k + 1, p)
            By which each logarithm changes with each of p parameters: those of the shared deviations, of those of the
            wander, and of its time.

        Notes
        -----
        With x̂ = M⁻¹ side, what the columns C roots say of the motion x, and Q = Hᵀ V⁻¹ C roots: the derivative along a
        shared deviation s is 2 s² (tr Hᵀ V⁻¹ H - QᵀQ) in its degree of freedom; those along the wander and its time
        follow from dM and x̂ᵀ cov(x)⁻¹ x̂ (Harville 1977). The average of the observed and the expected information needs
        no more than dV V⁻¹ of the residuals (Gilmour, Thompson and Cullis 1995).
        """
        s, w, free = self._deviations.shared, self._deviations.wander, self._free
        gram, (P, k) = self._gram, self._gram.shape[:2]
        f = len(free)
        slope, moved = np.zeros(2 * k + 1), np.zeros((P, k, 2 * k + 1))  # dV V⁻¹ C roots[:, -1] = H moved
        whole, along = gram, self._onto @ (roots if s.any() else roots[:, -1:])  # Hᵀ V⁻¹ H of each pose, Q
        if self._solved is not None:
            band, factor, known = self._solved
            expected = _backward(factor, known @ roots).reshape(P, f, -1)
            middle, after = _inverse_blocks(band, factor, f)
            scaled = w[free][:, None] * gram[:, free][:, :, free] * w[free]
            chain = _Chain.of(self._poses.gap, self._deviations.time)
            squares = np.einsum("pfr,pfr->pf", expected, expected)
            crossed = np.einsum("pfr,pfr->pf", expected[:-1], expected[1:])
            slope[k + free] = 2 * np.einsum("pij,pji->i", middle, scaled)
            slope[k + free] -= 2 * (chain.diagonal @ squares + 2 * chain.off_diagonal[1:] @ crossed)
            slope[-1] = chain.diagonal_slope @ (np.einsum("pii->p", middle) + squares.sum(axis=1))
            slope[-1] += (
                2 * chain.off_diagonal_slope[1:] @ (after + crossed.sum(axis=1)) + f * chain.log_slope
            )
            moved[:, free, k + free] = 2 * w[free] * expected[:, :, -1]
            moved[:, free, -1] = -w[free] * chain.covariance_of_slope(expected[:, :, -1])
            across = gram[:, :, free] * w[free]
            whole = gram - across @ middle @ np.swapaxes(across, 1, 2)
            along = along - across @ expected
        slope[:k] = 2 * s**2 * (np.einsum("pii->i", whole) - np.einsum("pir,pir->i", along, along))
        each = np.arange(k)
        moved[:, each, each] = 2 * s**2 * along[:, :, -1]
        moved = moved @ together
        onto = gram @ moved
        square = np.einsum("pia,pib->ab", moved, onto)
        products = np.einsum("pic,pia->ca", self._onto, moved, optimize=True)
        if self._solved is not None:
            further = _forward(factor, (w[free][:, None] * onto[:, free]).reshape(P * f, -1))
            square -= further.T @ further
            products -= known.T @ further
        return Change(slope @ together, products, square)


class Change(NamedTuple):
    """How a likelihood changes with p parameters."""

    slope: Array
    """Derivatives, (p,)."""
    products: Array
    square: Array
    """Cᵀ V⁻¹ d and dᵀ V⁻¹ d, d the derivatives of V times V⁻¹ of the residuals, (K, p) and (p, p)."""


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
        factor = np.linalg.cholesky(inner)
        self._s = s
        diagonal = np.diagonal(factor, axis1=1, axis2=2)
        self.log_determinant = 2 * float(np.sum(np.log(diagonal)))
        self._inverse = np.linalg.inv(factor)
        half = self._inverse @ self._across
        self._half = half
        self.gram = gram - np.swapaxes(half, 1, 2) @ half

    def solved(self, onto: Array) -> Array:
        """Return what CᵀC less Cᵀ(…)⁻¹C is the square of, of Hᵀ C."""
        return np.asarray((self._inverse * self._s) @ onto[:, self._free])

    def less(self, onto: Array, solved: Array) -> Array:
        """Return Hᵀ(…)⁻¹C of Hᵀ C, and of what is solved."""
        return np.asarray(onto - np.swapaxes(self._half, 1, 2) @ solved)

    def onto(self, onto: Array) -> Array:
        """Return Hᵀ(…)⁻¹C of Hᵀ C."""
        return self.less(onto, self.solved(onto)) if len(self._free) else onto


@dataclass(frozen=True, eq=False)
class _Chain:
    """The inverse covariance of the process with variance 1, a band, and its derivative by log time."""

    keeps: Array  # (P,) part of the last pose's x that remains
    new: Array  # (P,) variance that is added
    diagonal: Array  # (P,)
    off_diagonal: Array  # (P,) next to the diagonal, of a pose with the one before
    log_determinant: float  # of the covariance
    diagonal_slope: Array
    off_diagonal_slope: Array
    log_slope: float

    @classmethod
    def of(cls, gap: Array, time: float) -> _Chain:
        ratio = gap / time
        keeps, new = np.exp(-ratio), -np.expm1(-2 * ratio)
        change = keeps * np.where(np.isinf(ratio), 0.0, ratio)  # of `keeps`
        steeper = 2 * keeps * change / new**2
        return cls(
            keeps,
            new,
            1 / new + _onward(keeps**2 / new),
            -keeps / new,
            float(np.sum(np.log(new))),
            steeper + _onward(steeper),
            -change * (1 + keeps**2) / new**2,
            -float(np.sum(2 * keeps * change / new)),
        )

    def covariance_of_slope(self, values: Array) -> Array:
        """Return the covariance, times the derivative of its inverse, times values, (P, k)."""
        side = self.diagonal_slope[:, None] * values
        side[1:] += self.off_diagonal_slope[1:, None] * values[:-1]
        side[:-1] += self.off_diagonal_slope[1:, None] * values[1:]
        return _solved(self.band(1), side)

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


def _information(gap: Array, gram: Array, deviations: MotionDeviations, free: Index) -> tuple[Array, float]:
    """Return the lower band of M, and log |cov(x)|."""
    k, P = len(free), len(gap)
    chain = _Chain.of(gap, deviations.time)
    band = chain.band(k)
    w = deviations.wander[free]
    block = w[:, None] * gram[:, free][:, :, free] * w
    for i in range(k):
        for j in range(i + 1):
            band[i - j].reshape(P, k)[:, j] += block[:, i, j]
    return band, k * chain.log_determinant


def _triangle(band: Array) -> Array:
    from scipy.linalg import cholesky_banded

    return np.asarray(cholesky_banded(band, lower=True, check_finite=False))


def _solved(band: Array, side: Array) -> Array:
    """Solve with a positive definite band. `scipy.linalg.solveh_banded` does not solve one equation."""
    from scipy.linalg import cho_solve_banded

    return np.asarray(cho_solve_banded((_triangle(band), True), side, check_finite=False))


def _forward(factor: Array, side: Array) -> Array:
    """Solve a lower triangular band."""
    from scipy.linalg import solve_banded

    return np.asarray(solve_banded((len(factor) - 1, 0), factor, side, check_finite=False))


def _backward(factor: Array, side: Array) -> Array:
    """Solve with the transpose of a lower triangular band."""
    from scipy.linalg import solve_banded

    b, n = factor.shape
    upper = np.zeros_like(factor)
    for d in range(min(b, n)):
        upper[-1 - d, d:] = factor[d, : n - d]
    return np.asarray(solve_banded((0, b - 1), upper, side, check_finite=False))


def _inverse_blocks(band: Array, factor: Array, k: int) -> tuple[Array, Array]:
    """Return the blocks on the diagonal of M⁻¹, (P, k, k), and the traces of those next to it, (P - 1,).

    A block of M less what the poses before and after it take away is the inverse of the block of M⁻¹. The triangle
    holds the block less what the poses before take away; that of M in the opposite order, what the poses after do.
    """
    b, n = band.shape
    opposite = np.zeros_like(band)
    for d in range(b):
        opposite[d, : n - d] = band[d, : n - d][::-1]
    ahead, back = (_blocks(triangle, k) for triangle in (factor, _triangle(opposite)))
    ahead, back = (blocks @ np.swapaxes(blocks, 1, 2) for blocks in (ahead, back))
    own = _blocks(band, k)
    own = own + np.swapaxes(np.tril(own, -1), 1, 2)
    middle = np.asarray(np.linalg.inv(ahead + back[::-1, ::-1, ::-1] - own), float)
    next_to = band[k, : n - k : k]  # the same for all processes
    return middle, np.asarray(-next_to * np.einsum("pij,pij->p", np.linalg.inv(ahead[:-1]), middle[1:]))


def _blocks(factor: Array, k: int) -> Array:
    """Return the lower triangles of the blocks on the diagonal of a band, (P, k, k)."""
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
    chain = _Chain.of(poses.gap, deviations.time)
    keeps, new = chain.keeps, chain.new
    block = _blocks(factor, k)
    precision = block @ np.swapaxes(block, 1, 2)
    precision[:, np.arange(k), np.arange(k)] -= _onward(keeps**2 / new)[:, None]
    covariance = np.broadcast_to(np.eye(k), precision.shape).copy()
    before = np.linalg.inv(precision[:-1])
    covariance[1:] = keeps[1:, None, None] ** 2 * before + new[1:, None, None] * np.eye(k)
    return _Filter(free, factor, keeps, precision, covariance)


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
