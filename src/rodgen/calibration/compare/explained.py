"""How much of the residuals a set of columns explains, and whether that is more than chance.

With Q, an orthonormal basis of the columns X less what the fit takes out, T = ‖Qᵀy‖² is what a fit with X would lower
the sum of squares by. Errors of different poses are independent, those of one pose may depend on each other in any way;
then E T = tr V with V = Σ S_p S_pᵀ over poses, S_p = Q_pᵀ e_p, e what is left beside X. Box's (1954) approximation
T / tr V ~ F(h, d) is used, with

    h = (tr V)² / tr V²,    d = (Σ ω_p)² / Σ ω_p² times the share of freedoms that is left,  ω_p = ‖Q_p‖²,

which is the analysis-of-variance type statistic of Brunner, Dette and Munk (1997), on poses. Fitting shrinks residuals:
e_p is brought to the size of errors by (1 - H_p)^(-1/2), H_p the pose's block of the hat matrix (Bell and McCaffrey
2002).

For normal errors of equal variance the probability of p < 1e-4 is at most 1e-4; 5e-4 when their standard deviation
triples over the range of X, or they have the tails of Student's t with 4 degrees of freedom (simulated: 24 to 100 poses
with 1 or 3 rows, 5 to 16 columns, 20 000 draws each).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.compare.sample import Sample, orthonormal

__all__ = ["Evidence", "Space", "log10_f_tail", "unshrunk"]

Array: TypeAlias = NDArray[np.float64]
Filter: TypeAlias = Callable[[Array], Array]

TAKEN = 0.02
"""Columns of which the fit leaves less than this part are not tested: there the residuals say nothing."""
LEAST_FREEDOMS = 6.0
"""Fewer denominator degrees of freedom make every p-value a guess about the shape of the errors."""
CLOSER_LOOK = -2.0
"""Only p-values below 1 % are worth that the shrinking of residuals is undone exactly, which makes them larger."""
EXACT_POSES = 1000
"""Up to so many poses the shrinking is undone pose by pose; with more it is a matter of a percent."""
LARGEST_BLOCK = 60
"""Readings of a pose up to which the same."""


@dataclass(frozen=True)
class Evidence:
    """What columns explain.

    Attributes
    ----------
    log10_p : float
        Logarithm of the p-value.
    falls : ndarray, shape (m,)
        By how much the sum of the squares of the rows' residuals falls in each component, in the square of the fit's
        unit, less what chance makes of it.
    alone : float or None
        The p-value's logarithm if successive poses were independent, where it allows for their correlation.
    """

    log10_p: float
    falls: Array
    alone: float | None = None


class Space:
    """Residuals beside what the fit, and columns found before, can explain.

    Parameters
    ----------
    sample : Sample
    found : sequence of ndarray, each of shape (N, m, k)
        Columns that the residuals are known to depend on.
    filters : mapping of int to callable
        For components whose errors are correlated in time: takes columns (N, k) to where they are not.

    Attributes
    ----------
    y : ndarray, shape (N, m)
        Residuals less all that.
    taken : ndarray, shape (N m, r)
        Orthonormal basis of it; components run fastest.
    """

    def __init__(
        self, sample: Sample, found: Sequence[Array] = (), filters: Mapping[int, Filter] | None = None
    ) -> None:
        self.sample = sample
        self.filters = dict(filters or {})
        m = sample.components
        self.starts = np.flatnonzero(np.diff(sample.pose, prepend=-1)) * m
        self.taken = sample.taken
        if self.filters:
            self.taken = orthonormal(self._filtered(sample.taken), 1e-5)
        for columns in found:
            self.taken = np.column_stack([self.taken, self._beside(columns)])
        flat = self._filtered(sample.y.reshape(-1, 1))[:, 0]
        self.y = (flat - self.taken @ (self.taken.T @ flat)).reshape(sample.y.shape)
        self._leverage = np.einsum("ij,ij->i", self.taken, self.taken)
        self._blocks = list(_blocks(sample.pose, m))
        widest = max((block.shape[1] for block in self._blocks), default=0)
        self._exact = sample.poses <= EXACT_POSES and widest <= LARGEST_BLOCK
        self._hat = [_gram(self.taken[block]) for block in self._blocks] if self._exact else []

    def _filtered(self, columns: Array) -> Array:
        if not self.filters:
            return columns
        new, m = columns.copy(), self.sample.components
        for c, filtered in self.filters.items():
            new[c::m] = filtered(columns[c::m])
        return new

    def _beside(self, columns: Array, more: Array | None = None) -> Array:
        """Return an orthonormal basis of columns, (N, m, k), beside what is taken out."""
        flat = self._filtered(columns.reshape(-1, columns.shape[-1]))
        size = np.sqrt(np.einsum("ij,ij->j", flat, flat))
        flat = flat[:, size > 0] / size[size > 0]
        for basis in (self.taken, more):
            if basis is not None:
                flat = flat - basis @ (basis.T @ flat)
        return orthonormal(flat, TAKEN)

    def test(self, columns: Array, beside: Array | None = None) -> Evidence | None:
        """Hold columns against the residuals.

        Parameters
        ----------
        columns : ndarray, shape (N, m, k)
        beside : ndarray, shape (N, m, l), optional
            Columns that may explain them, too, and are not asked for.

        Returns
        -------
        Evidence or None
            None where the data do not allow to tell: the fit takes such columns out, or too few poses are left.
        """
        sample, y = self.sample, self.y.ravel()
        leverage, hat = self._leverage, []
        if beside is not None:
            hat.append(self._beside(beside))
            y = y - hat[0] @ (hat[0].T @ y)
        basis = self._beside(columns, hat[0] if hat else None)
        if not basis.shape[1]:
            return None
        hat.append(basis)
        leverage = leverage + sum(np.einsum("ij,ij->i", b, b) for b in hat)
        weight = np.einsum("ij,ij->i", basis, basis)
        share = np.add.reduceat(weight, self.starts)
        left = 1 - float(weight @ np.minimum(leverage, 1.0)) / float(weight.sum())
        d = float(share.sum() ** 2 / (share @ share)) * left
        if d < LEAST_FREEDOMS:
            return None
        amount = basis.T @ y
        error = y - basis @ amount
        log10_p, v = self._judged(basis, amount, error / np.sqrt(1 - np.minimum(leverage, 0.9)), d)
        if self._exact and log10_p < CLOSER_LOOK:
            log10_p, v = self._judged(basis, amount, self._unshrunk(error, hat), d)
        # what the rows' squares fall by, and what chance makes of that
        square = (sample.count[:, None] * sample.scale**2).ravel()
        fall = square * ((y - error) * (y + error) - np.einsum("ij,jk,ik->i", basis, v, basis))
        return Evidence(log10_p, fall.reshape(sample.y.shape).sum(axis=0))

    def _judged(self, basis: Array, amount: Array, error: Array, d: float) -> tuple[float, Array]:
        """Return the logarithm of the p-value, and V."""
        scores = np.add.reduceat(basis * error[:, None], self.starts, axis=0)
        v = scores.T @ scores
        trace = float(np.trace(v))
        if trace <= 0:
            return 0.0, v
        return log10_f_tail(float(amount @ amount) / trace, trace**2 / float(np.sum(v**2)), d), v

    def _unshrunk(self, residual: Array, more: Sequence[Array]) -> Array:
        found = np.empty_like(residual)
        for block, hat in zip(self._blocks, self._hat, strict=True):
            found[block] = unshrunk(residual[block], hat + sum(_gram(basis[block]) for basis in more))
        return found


def unshrunk(residual: Array, hat: Array) -> Array:
    """Bring residuals to the size of errors: (1 - H)^(-1/2) r, block by block.

    Parameters
    ----------
    residual : ndarray, shape (…, b)
    hat : ndarray, shape (…, b, b)
        Blocks of the hat matrix; what it takes out nearly whole (over 0.99) is left as it is found.
    """
    if residual.shape[-1] == 1:
        return np.asarray(residual / np.sqrt(1 - np.clip(hat[..., 0], 0.0, 0.99)))
    values, vectors = np.linalg.eigh(hat)
    along = np.einsum("...ji,...j->...i", vectors, residual) / np.sqrt(1 - np.clip(values, 0.0, 0.99))
    return np.asarray(np.einsum("...ij,...j->...i", vectors, along))


def _gram(columns: Array) -> Array:
    return np.asarray(columns @ np.swapaxes(columns, -1, -2))


def _blocks(pose: NDArray[np.intp], m: int) -> list[NDArray[np.intp]]:
    """Return the readings' numbers by pose, (poses of one size, size m)."""
    starts = np.flatnonzero(np.diff(pose, prepend=-1))
    sizes = np.diff(starts, append=len(pose))
    return [(starts[sizes == size] * m)[:, None] + np.arange(size * m) for size in np.unique(sizes)]


def log10_f_tail(ratio: float, h: float, d: float) -> float:
    """Return log10 of the probability that F(h, d) is above a ratio, also where it is below the smallest double."""
    from scipy.special import betaln, fdtrc

    if not np.isfinite(ratio):
        return -np.inf
    p = float(fdtrc(h, d, ratio))
    if p > 1e-290:
        return float(np.log10(p))
    # the first two terms of the incomplete beta function, of which the third is a 1000th where it is so small
    a, b = d / 2, h / 2
    x = d / (d + h * ratio)
    second = max((1 - b) * x * a / (a + 1), -0.9)
    return float((a * np.log(x) - np.log(a) - betaln(a, b) + np.log1p(second)) / np.log(10))
