"""A stretch of rows that lies displaced: poses that follow each other and share a motion, or all poses a slow one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Mask
from rodgen.statistics.columns import orthonormalizing

ENDS = 80
"""Ends of stretches that are tried first; the best are then moved, at last pose by pose."""
NEARER = 8
"""How much nearer ends are tried from one step to the next."""
ROWS = 4096
"""Rows whose columns are multiplied at once."""
SLOWEST = 3
"""Half waves over all poses, at most, of which a slow motion consists: what is faster is nearly a jump."""
RIDGE = 1e-3
"""Part of the products of columns that is added to them: a motion that the fitted parameters imitate has no gain."""


@dataclass(frozen=True)
class DisplacedStretch:
    """Rows of poses that follow each other and lie displaced together, as where a set-up was pushed.

    Attributes
    ----------
    first, last : int
        Rows, from 0, in the order of the data.
    gain : float
        By how much -2 ln of the probability falls with it, over all stretches that may be: its odds are exp(gain / 2).
    rows : ndarray of bool, shape (n,)
    columns : ndarray, shape (n, m, k)
        Derivatives of the weighted residuals by the motion in these rows.
    """

    first: int
    last: int
    gain: float
    rows: Mask = field(repr=False)
    columns: Array = field(repr=False)
    of_target: bool = False
    """Whether the targets lie displaced in the body that carries them, not the frame."""
    creeps: bool = False
    """Whether the motion is a slow one over all poses."""
    rival: float = 0.0
    """The gain of the likeliest motion of the other kind, at once or slow."""


def stretch_of(
    residual: Array,
    model: Array,
    motion: Array,
    pose: NDArray[np.int_],
    order: NDArray[np.int_],
    wrong: Mask,
) -> DisplacedStretch | None:
    """Return the likeliest stretch of several rows, or a slow motion; None where the residuals are likelier without.

    Parameters
    ----------
    residual : ndarray, shape (n, m)
        Weighted.
    model : ndarray, shape (n, m, p)
        Derivatives of the weighted residuals by the fitted parameters.
    motion : ndarray, shape (n, m, k)
        The same by a motion of the frame, or of the targets, translations first.
    pose : ndarray of int, shape (n,)
    order : ndarray of int, shape (n,)
        The rows as they were measured.
    wrong : ndarray of bool, shape (n,)
        Rows that do not count.

    Notes
    -----
    Translations alone, and with turns, are tried. A motion of k components costs k ln of the degrees of freedom
    (Schwarz 1978). Each motion of the set-up may be after any of N poses, which costs 2 ln N: one where the stretch
    reaches the first or the last pose, else two. That its readings only scatter more competes with the motion, and so
    does a slow motion over all poses: cosines of one to `SLOWEST` half waves.
    """
    n, m, k = motion.shape
    ends = np.flatnonzero(np.diff(pose[order], prepend=-1, append=-1))
    poses = len(ends) - 1
    if poses < 1:
        return None
    sums = _Sums(residual, model, motion, order, ~wrong, ends)
    total, dof = sums.total, m * int(np.count_nonzero(~wrong)) - sums.rank
    best, slow = (0.0, 0, 0, 0, 0.0), (0.0, 0, 0)

    def gain_of(fall: float, numbers: int) -> float:
        return float(-dof * math.log(max(1 - fall / total, 1e-12)) - numbers * math.log(dof))

    for size in {min(k, 3), k}:
        if dof <= size + m or not total:
            continue
        for moves in (1, 2):
            fall, first, last = sums.best(moves, size)
            of_place = 2 * moves * math.log(poses)
            best = max(best, (gain_of(fall, size) - of_place, first, last, size, of_place))
        for waves in range(1, SLOWEST + 1):
            if dof > size * waves + m:
                slow = max(slow, (gain_of(sums.slow(waves, size), size * waves), waves, size))
    gain, first, last, size, of_place = best
    if gain and sums.gain_of_scatter(first, last, dof) - math.log(dof) >= gain + of_place:
        gain = 0.0
    if slow[0] > gain:
        place = np.searchsorted(ends, np.argsort(order), side="right").astype(float) - 0.5
        wave = _half_waves(place, poses, slow[1]).T[:, None, None]
        columns = (motion[:, :, : slow[2], None] * wave).reshape(n, m, -1)
        every = np.ones(n, bool)
        return DisplacedStretch(
            int(order[0]), int(order[-1]), slow[0], every, columns, creeps=True, rival=gain
        )
    if gain <= 0:
        return None
    if 2 * (last - first) > poses and (first == 0 or last == poses):  # a jump: the shorter side of it
        first, last = (last, poses) if first == 0 else (0, first)
    stretch = order[ends[first] : ends[last]]
    rows = np.zeros(n, bool)
    rows[stretch] = True
    columns = motion[:, :, :size] * rows[:, None, None]
    return DisplacedStretch(int(stretch[0]), int(stretch[-1]), gain, rows, columns, rival=slow[0])


def _half_waves(place: Array, poses: int, count: int) -> Array:
    """Return cosines of one half wave over all poses, two, and so on, at some places among them, (count, n)."""
    return np.asarray(np.cos(np.pi * np.arange(1, count + 1)[:, None] * place / poses))


def _falls(seen: Array, shared: Array, pull: Array) -> Array:
    """Return the falls of the sum of squares by columns, (s,), from their products with all."""
    size = seen.shape[-1]
    ridge = RIDGE * np.trace(seen, axis1=1, axis2=2)[:, None, None] * np.eye(size) + 1e-300 * np.eye(size)
    beyond = seen - shared @ shared.transpose(0, 2, 1) + ridge
    return np.asarray(np.einsum("sk,sk->s", pull, np.linalg.solve(beyond, pull[:, :, None])[:, :, 0]))


class _Sums:
    """Sums over the rows before each end, from which the fall of every stretch follows.

    Attributes
    ----------
    total : float
        Sum of squares of the residuals that the model leaves.
    rank : int
        Of the model.
    """

    def __init__(
        self,
        residual: Array,
        model: Array,
        motion: Array,
        order: NDArray[np.int_],
        there: Mask,
        ends: NDArray[np.int_],
    ) -> None:
        self.model, self.motion, self.order, self.there, self.ends = model, motion, order, there, ends
        judged = model if there.all() else model[there]
        n, m, p = judged.shape
        self.basis = orthonormalizing(judged.reshape(n * m, p), ROWS)
        self.rank = self.basis.shape[1]
        scale = np.linalg.norm(motion[there], axis=(0, 1))
        self.scale = np.where(scale > 0, scale, np.inf)
        self.left = residual * there[:, None]
        flat = model.reshape(len(model) * m, p)
        pull = self.basis.T @ (flat.T @ self.left.ravel())
        self.left -= (flat @ (self.basis @ pull)).reshape(residual.shape) * there[:, None]
        self.total = float(np.sum(self.left**2))
        poses = len(ends) - 1
        self.grid, cells = (
            np.unique(np.linspace(0, poses, min(poses, count) + 1).astype(int))
            for count in (ENDS, math.isqrt(poses))
        )
        self.cells = np.union1d(self.grid, cells)
        self.within = np.stack([self._between(*pair) for pair in pairwise(ends[self.cells])])
        before = np.concatenate([self.within[:1] * 0, np.cumsum(self.within, axis=0)])
        self.before = dict(zip(self.cells.tolist(), before, strict=True))

    def _base(self, some: slice) -> Array:
        """Return the model in some rows of the order as orthonormal columns, (rows m, rank)."""
        rows = self.order[some]
        part = self.model[rows] * self.there[rows, None, None]
        return part.reshape(part.shape[0] * part.shape[1], part.shape[2]) @ self.basis

    def _between(self, first: int, last: int) -> Array:
        """Return the products of the motion with itself, the model and the residuals, (k, k + rank + 1)."""
        some = slice(first, last)
        rows = self.order[some]
        motion = (self.motion[rows] / self.scale * self.there[rows, None, None]).reshape(-1, len(self.scale))
        every = np.concatenate([motion, self._base(some), self.left[rows].reshape(-1, 1)], axis=1)
        return np.asarray(motion.T @ every)

    def _at(self, ends: NDArray[np.int_]) -> Array:
        """Return the sums over all rows before some ends, (e, k, k + rank + 1)."""
        cell = self.cells[np.searchsorted(self.cells, ends, side="right") - 1].tolist()
        for end, c in zip(ends.tolist(), cell, strict=True):
            if end not in self.before:
                self.before[end] = self.before[c] + self._between(self.ends[c], self.ends[end])
        return np.stack([self.before[end] for end in ends.tolist()])

    def gain_of_scatter(self, first: int, last: int, dof: int) -> float:
        """Return what it gains that the readings of a stretch have a larger variance of their own."""
        rows = self.order[self.ends[first] : self.ends[last]]
        inside = np.count_nonzero(self.there[rows]) * self.left.shape[1]
        outside, square = dof - inside, float(np.sum(self.left[rows] ** 2))
        if min(inside, outside) < 1 or square * outside <= (self.total - square) * inside:
            return 0.0
        scatter = [(dof, self.total), (-inside, square), (-outside, self.total - square)]
        return math.fsum(n * math.log(max(x, 1e-300) / abs(n)) for n, x in scatter)

    def best(self, moves: int, size: int) -> tuple[float, int, int]:
        """Return the largest fall of the sum of squares, and the ends of its stretch, as numbers of poses.

        Parameters
        ----------
        moves : int
            Ends of the stretch that lie between poses: 1 or 2.
        size : int
            Components of the motion, translations first.
        """
        poses = len(self.ends) - 1
        best = self._best_of(self.grid, self.grid, moves, size)
        step = poses / ENDS
        while step > 1:
            step = max(step / NEARER, 1.0)
            near = np.unique(np.round(step * np.arange(-NEARER, NEARER + 1)).astype(int))
            while (better := self._best_of(best[1] + near, best[2] + near, moves, size)) > best:
                best = better
        return best

    def slow(self, count: int, size: int) -> float:
        """Return the fall of the sum of squares by so many half waves of a motion, each constant within a cell."""
        wave = _half_waves((self.cells[1:] + self.cells[:-1]) / 2, len(self.ends) - 1, count)
        some, k = self.within[:, :size], len(self.scale)
        seen = np.einsum("ac,bc,cij->aibj", wave, wave, some[:, :, :size])
        shared, pull = np.einsum("ac,cir->air", wave, some[:, :, k:-1]), wave @ some[:, :, -1]
        n = count * size
        return float(_falls(seen.reshape(1, n, n), shared.reshape(1, n, -1), pull.reshape(1, n))[0])

    def _best_of(
        self, firsts: NDArray[np.int_], lasts: NDArray[np.int_], moves: int, size: int
    ) -> tuple[float, int, int]:
        poses = len(self.ends) - 1
        a, b = (x.ravel() for x in np.meshgrid(firsts, lasts, indexing="ij"))
        between = (a > 0).astype(int) + (b < poses)
        tried = (a >= 0) & (b <= poses) & (b > a) & (between == moves)
        a, b = a[tried], b[tried]
        rows = self.ends[b] - self.ends[a]
        several = (rows > 1) & (rows < self.ends[-1] - 1)
        a, b = a[several], b[several]
        if not len(a):
            return 0.0, 0, 0
        ends, numbers = np.unique([a, b], return_inverse=True)
        sums = self._at(ends)[:, :size]
        one, later = numbers.reshape(2, -1)
        inside, k = sums[later] - sums[one], len(self.scale)
        seen, shared, pull = inside[:, :, :size], inside[:, :, k:-1], inside[:, :, -1]
        falls = _falls(seen, shared, pull)
        i = int(np.argmax(falls))
        return float(falls[i]), int(a[i]), int(b[i])
