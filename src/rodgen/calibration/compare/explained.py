"""How much of the residuals a set of columns explains, and whether that is more than chance.

With Q, an orthonormal basis of the columns X less what the fit takes out, a fit with X would lower the sum of squares
by T = ‖Qᵀy‖². Errors of different poses are independent, those of one pose may depend on each other in any way; then
E T = tr V with V = Σ S_p S_pᵀ over poses, S_p = Q_pᵀ e_p, e the residuals of a fit with X. Box's (1954) approximation
T / tr V ~ F(h, d) is used, with

    h = (tr V)² / tr V²,    d = (Σ ω_p)² / Σ ω_p² times the share of degrees of freedom that remains,  ω_p = ‖Q_p‖²,

which is the analysis-of-variance type statistic of Brunner, Dette and Munk (1997), on poses. Fitting shrinks residuals:
e_p is brought to the size of errors by (1 - H_p)^(-1/2), H_p the pose's block of the hat matrix (Bell and McCaffrey
2002).

For normal errors of equal variance the probability of p < 1e-4 is at most 1e-4; 5e-4 when their standard deviation
triples over the range of X, or they have the tails of Student's t with 4 degrees of freedom (simulated: 24 to 100 poses
with 1 or 3 rows, 5 to 16 columns, 20 000 draws each).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.compare.sample import Sample
from rodgen.data.poses import stretches
from rodgen.statistics.columns import ColumnSpace, Whiten, directions_above, project_out, unit_columns
from rodgen.statistics.f_tests import log10_f_tail
from rodgen.statistics.leave_out import undo_leverage
from rodgen.statistics.thresholds import COMPARISON

WHITENED = 1e-5
"""Directions that whitening leaves less than this part of no longer belong to what the fit takes out."""
CLOSER_LOOK = -2.0
"""Logarithm of the p-value below which leverage is undone pose by pose, which is slow and makes p-values larger."""
EXACT_POSES = 1000
"""With more poses leverage is never undone pose by pose: it is a matter of a percent."""
LARGEST_BLOCK = 60
"""Nor where a pose has more readings than this."""
LARGEST_LEVERAGE = 0.99
"""What the fit takes out of a pose nearly whole counts as if it left this much less than all."""


@dataclass(frozen=True)
class Explained:
    """What columns explain."""

    log10_p: float
    """Logarithm of the p-value."""
    falls: Array
    """By how much the sum of the squares of the rows' weighted residuals falls in each component, less what chance
    makes of it, (m,)."""
    alone: float | None = None
    """The p-value's logarithm if successive poses were independent, where it allows for their correlation."""


class ProjectedResiduals:
    """Residuals less everything that the fit, and columns found before, can explain.

    Parameters
    ----------
    found : sequence of ndarray, each of shape (N, m, k)
        Columns that the residuals are known to depend on.
    whiten : mapping of int to callable
        For components whose errors are correlated in time: takes columns (N, k) to where they are not.

    Attributes
    ----------
    y : ndarray, shape (N, m)
        The residuals.
    space : ColumnSpace
        What was taken out of them, (N m, r); components run fastest.
    """

    def __init__(
        self, sample: Sample, found: Sequence[Array] = (), whiten: Mapping[int, Whiten] | None = None
    ) -> None:
        self.sample = sample
        self.whiten = dict(whiten or {})
        m = sample.components
        self.starts = stretches(sample.pose)[0] * m
        basis = sample.taken
        self.space = ColumnSpace(directions_above(self._whitened(basis), WHITENED) if self.whiten else basis)
        for columns in found:
            self.space = self.space.joined(self._visible(self.space, columns))
        self.y = self.space.project_out(self._whitened(sample.y.reshape(-1, 1))).reshape(sample.y.shape)
        self.leverage = self.space.leverage
        self._blocks = list(_blocks(sample.pose, m))
        widest = max((block.shape[1] for block in self._blocks), default=0)
        self._exact = sample.poses <= EXACT_POSES and widest <= LARGEST_BLOCK
        self._hat = [_gram(self.space.basis[block]) for block in self._blocks] if self._exact else []

    def _whitened(self, columns: Array) -> Array:
        if not self.whiten:
            return columns
        new, m = columns.copy(), self.sample.components
        for c, whiten in self.whiten.items():
            new[c::m] = whiten(columns[c::m])
        return new

    def _visible(self, space: ColumnSpace, columns: Array) -> Array:
        """Return an orthonormal basis of what columns, (N, m, k), span outside of a space."""
        flat = unit_columns(self._whitened(columns.reshape(-1, columns.shape[-1])))
        return space.visible_part(flat, COMPARISON.visible)

    def test(self, columns: Array, given: Array | None = None) -> Explained | None:
        """Test whether the residuals depend on columns.

        Parameters
        ----------
        columns : ndarray, shape (N, m, k)
        given : ndarray, shape (N, m, l), optional
            Columns that may explain them, too, and are not tested.

        Returns
        -------
        Explained or None
            None where the data do not allow a test: the fit takes such columns out, or too few poses remain.
        """
        sample, y, space, new = self.sample, self.y.ravel(), self.space, []
        if given is not None:
            new.append(self._visible(space, given))
            space = space.joined(new[0])
            y = project_out(new[0], y)
        basis = self._visible(space, columns)
        if not basis.shape[1]:
            return None
        new.append(basis)
        leverage = self.leverage + sum(ColumnSpace(b).leverage for b in new)
        weight = ColumnSpace(basis).leverage
        share = np.add.reduceat(weight, self.starts)
        left = 1 - float(weight @ np.minimum(leverage, 1.0)) / float(weight.sum())
        d = float(share.sum() ** 2 / (share @ share)) * left
        if d < COMPARISON.least_dof:
            return None
        amount = basis.T @ y
        error = y - basis @ amount
        log10_p, v = self._chance(basis, amount, error / np.sqrt(1 - np.minimum(leverage, 0.9)), d)
        if self._exact and log10_p < CLOSER_LOOK:
            log10_p, v = self._chance(basis, amount, self._without_leverage(error, new), d)
        # what the rows' squares fall by, and what chance makes of that
        count = np.repeat(sample.count, sample.components)
        fall = count * ((y - error) * (y + error) - np.einsum("ij,ij->i", basis @ v, basis))
        return Explained(log10_p, fall.reshape(sample.y.shape).sum(axis=0))

    def _chance(self, basis: Array, amount: Array, error: Array, d: float) -> tuple[float, Array]:
        """Return the logarithm of the p-value, and V."""
        scores = np.add.reduceat(basis * error[:, None], self.starts, axis=0)
        v = scores.T @ scores
        trace = float(np.trace(v))
        if trace <= 0:
            return 0.0, v
        return log10_f_tail(float(amount @ amount) / trace, trace**2 / float(np.sum(v**2)), d), v

    def _without_leverage(self, residual: Array, more: Sequence[Array]) -> Array:
        """Return residuals at the size of errors; `more`: bases taken out in addition to that of the space."""
        found = np.empty_like(residual)
        for block, hat in zip(self._blocks, self._hat, strict=True):
            whole = hat + sum(_gram(basis[block]) for basis in more)
            found[block] = undo_leverage(whole, residual[block], 0.5, cap=LARGEST_LEVERAGE)
        return found


def _gram(columns: Array) -> Array:
    return np.asarray(columns @ np.swapaxes(columns, -1, -2))


def _blocks(pose: NDArray[np.intp], m: int) -> list[NDArray[np.intp]]:
    """Return the readings' numbers by pose, (poses of one size, size m)."""
    starts, sizes = stretches(pose)
    return [(starts[sizes == size] * m)[:, None] + np.arange(size * m) for size in np.unique(sizes)]
