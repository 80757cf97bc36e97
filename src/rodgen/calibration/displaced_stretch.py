"""A stretch of rows that lies displaced: poses that follow each other and share a motion of the frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Mask
from rodgen.statistics.columns import orthonormal_basis, project_out

ENDS = 80
"""Ends of stretches that are tried first; the best are then moved, at last pose by pose."""
NEARER = 8
"""How much nearer ends are tried from one step to the next."""
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
    tries : int
        Number of stretches that may be.
    rows : ndarray of bool, shape (n,)
    columns : ndarray, shape (n, m, k)
        Derivatives of the weighted residuals by the motion of the frame in these rows.
    """

    first: int
    last: int
    gain: float
    tries: int
    rows: Mask = field(repr=False)
    columns: Array = field(repr=False)


def stretch_of(
    residual: Array,
    model: Array,
    motion: Array,
    pose: NDArray[np.int_],
    order: NDArray[np.int_],
    wrong: Mask,
) -> DisplacedStretch | None:
    """Return the likeliest stretch of several rows; None where the residuals are likelier without any.

    Parameters
    ----------
    residual : ndarray, shape (n, m)
        Weighted.
    model : ndarray, shape (n, m, p)
        Derivatives of the weighted residuals by the fitted parameters.
    motion : ndarray, shape (n, m, k)
        The same by a motion of the frame, translations first.
    pose : ndarray of int, shape (n,)
    order : ndarray of int, shape (n,)
        The rows as they were measured.
    wrong : ndarray of bool, shape (n,)
        Rows that do not count.

    Notes
    -----
    Translations alone, and with turns, are tried. A motion of k components costs k ln of the degrees of freedom
    (Schwarz 1978). Each motion of the set-up may be after any of N poses, which costs 2 ln N: one where the stretch
    reaches the first or the last pose, else two.
    """
    n, m, k = motion.shape
    there = ~wrong[order, None, None]
    base = orthonormal_basis((model[order] * there).reshape(n * m, -1))
    left = project_out(base, (residual[order] * there[:, :, 0]).ravel()).reshape(n, m)
    total, dof = float(np.sum(left**2)), m * int(there.sum()) - base.shape[1]
    ends = np.flatnonzero(np.diff(pose[order], prepend=-1, append=-1))
    poses = len(ends) - 1
    tries = poses * (poses + 1) // 2 - 1
    best = (0.0, 0, 0, 0)
    for size in {min(k, 3), k}:
        if dof <= size + m or not total:
            continue
        sums = _Sums(motion[order][:, :, :size] * there, base.reshape(n, m, -1), left, ends)
        for moves in (1, 2):
            fall, first, last = sums.best(moves)
            price = size * math.log(dof) + 2 * moves * math.log(poses)
            gain = -dof * math.log(max(1 - fall / total, 1e-12)) - price
            best = max(best, (gain, first, last, size))
    gain, first, last, size = best
    if gain <= 0:
        return None
    if 2 * (last - first) > poses and (first == 0 or last == poses):  # a jump: the shorter side of it
        first, last = (last, poses) if first == 0 else (0, first)
    found = order[ends[first] : ends[last]]
    rows = np.zeros(n, bool)
    rows[found] = True
    columns = motion[:, :, :size] * rows[:, None, None]
    return DisplacedStretch(int(found[0]), int(found[-1]), gain, tries, rows, columns)


class _Sums:
    """Sums over the rows before each end, from which the fall of every stretch follows."""

    def __init__(self, motion: Array, base: Array, left: Array, ends: NDArray[np.int_]) -> None:
        scale = np.sqrt(np.sum(motion**2, axis=(0, 1)))
        motion = motion[:, :, scale > 0] / scale[scale > 0]
        every = np.concatenate([motion, base, left[:, :, None]], axis=2)
        products = np.einsum("nmk,nml->nkl", motion, every)
        self.sums = np.concatenate([products[:1] * 0, np.cumsum(products, axis=0)])[ends]
        self.ends = ends

    def best(self, moves: int) -> tuple[float, int, int]:
        """Return the largest fall of the sum of squares, and the ends of its stretch, as numbers of poses.

        Parameters
        ----------
        moves : int
            Ends of the stretch that lie between poses: 1 or 2.
        """
        poses = len(self.ends) - 1
        grid = np.unique(np.linspace(0, poses, min(poses, ENDS) + 1).astype(int))
        found = self._best_of(grid, grid, moves)
        step = poses / ENDS
        while step > 1:
            step = max(step / NEARER, 1.0)
            near = np.unique(np.round(step * np.arange(-NEARER, NEARER + 1)).astype(int))
            while (better := self._best_of(found[1] + near, found[2] + near, moves)) > found:
                found = better
        return found

    def _best_of(
        self, firsts: NDArray[np.int_], lasts: NDArray[np.int_], moves: int
    ) -> tuple[float, int, int]:
        poses, k = len(self.ends) - 1, self.sums.shape[1]
        a, b = (x.ravel() for x in np.meshgrid(firsts, lasts, indexing="ij"))
        between = (a > 0).astype(int) + (b < poses)
        tried = (a >= 0) & (b <= poses) & (b > a) & (between == moves)
        a, b = a[tried], b[tried]
        rows = self.ends[b] - self.ends[a]
        several = (rows > 1) & (rows < self.ends[-1] - 1)
        a, b = a[several], b[several]
        if not len(a) or not k:
            return 0.0, 0, 0
        inside = self.sums[b] - self.sums[a]
        seen, shared, pull = inside[:, :, :k], inside[:, :, k:-1], inside[:, :, -1]
        ridge = RIDGE * np.trace(seen, axis1=1, axis2=2)[:, None, None] * np.eye(k) + 1e-300 * np.eye(k)
        beyond = seen - shared @ shared.transpose(0, 2, 1) + ridge
        falls = np.einsum("sk,sk->s", pull, np.linalg.solve(beyond, pull[:, :, None])[:, :, 0])
        i = int(np.argmax(falls))
        return float(falls[i]), int(a[i]), int(b[i])
