"""What a comparison looks at: residuals by cell, a target in a pose, and what the fit may have taken out of them.

Readings of one target in one pose are averaged; cells of one pose may share errors and are never taken for independent.
A fit moves its parameters a little to swallow a part of every error. That part lies in the span of the model's Jacobian
J, so that y - QQᵀy, Q an orthonormal basis of it, is the same for the errors as for the residuals, and every test is
made with Q taken out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Index
from rodgen.calibration.problem import Problem
from rodgen.calibration.reading_motion import motion_with_reading
from rodgen.calibration.words import IN_UNCERTAINTIES
from rodgen.data.observations import Observations
from rodgen.data.poses import stretches
from rodgen.statistics.columns import orthonormal_basis

if TYPE_CHECKING:
    from rodgen.calibration.fitted import FittedModel


MOST_CELLS = 6_000
"""Cells that are looked at. What explains one percent of their variance lowers chi-square by 60, which chance does with
p < 1e-8 even for the 16 columns of a pair of drivers."""
STRETCH = 50
"""Poses that are taken together where not all are: what follows each other is needed for correlations in time."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Residuals of the poses that are looked at; N cells in P poses, m components."""

    fit: FittedModel
    rows: Index
    """Rows of the data that are looked at."""
    cell: Index
    """The cell of each, like `rows`."""
    y: Array
    """Weighted residuals, means of cells, (N, m)."""
    taken: Array
    """Orthonormal basis of what the fit may have taken out of them; components run fastest, (N m, r)."""
    scale: Array
    """What a weighted residual of 1 is in the unit that the fit is shown in, (N, m)."""
    count: Array
    """Rows of each cell, (N,)."""
    pose: Index
    """From 0, in the order of measurement; cells are sorted by it, (N,)."""
    number: Index
    run: Index
    """Of each pose the number that it has in the data, and its run, (P,)."""
    by_row: Array
    """Weighted residuals of `rows`, (rows, m)."""

    @classmethod
    def of(cls, fit: FittedModel) -> Sample:
        """Average the residuals of a fit, without its outliers."""
        rows = _chosen(fit)
        o: Observations = fit.observations.take(rows)
        targets = len(fit.machine.targets)
        key, first, cell = np.unique(
            o.pose.astype(np.int64) * targets + o.target, return_index=True, return_inverse=True
        )
        count = np.bincount(cell, minlength=len(key)).astype(float)
        number, pose = np.unique(key // targets, return_inverse=True)
        run = np.zeros(len(number), np.intp)
        run[pose] = o.run[first]
        problem = Problem(fit.problem.model, o)
        theta, frame = fit.solution.theta, fit.solution.frame
        residuals = problem.residuals(theta, frame, weighted=True)
        y = np.stack([np.bincount(cell, r, len(key)) for r in residuals.T], axis=-1) / count[:, None]
        free = list(fit.moving)
        jacobian = np.zeros((len(key), problem.components, len(free)))
        for block_rows, block in problem.jacobian_blocks(theta, frame):
            np.add.at(jacobian, cell[block_rows], block[:, :, free])
        jacobian /= count[:, None, None]
        weight = (
            np.stack([np.bincount(cell, w, len(key)) for w in problem.weight.T], axis=-1) / count[:, None]
        )
        taken = orthonormal_basis(jacobian.reshape(len(key) * problem.components, len(free)))
        scale = 1 / (weight * fit.unit_factor)
        return cls(fit, rows, cell, y, taken, scale, count, pose, number, run, residuals)

    @property
    def components(self) -> int:
        """Number of components of a residual."""
        return int(self.y.shape[1])

    @property
    def poses(self) -> int:
        """Number of poses."""
        return len(self.number)

    @property
    def observations(self) -> Observations:
        """All observations of the fit."""
        return self.fit.observations

    @cached_property
    def total(self) -> Array:
        """Sum of the squares of the rows' weighted residuals, (m,)."""
        return np.asarray(np.sum(self.by_row**2, axis=0))

    @cached_property
    def shown(self) -> Array:
        """What is compared in size, (rows, m), in :attr:`unit`."""
        return self.fit.sizes[self.rows]

    @property
    def unit(self) -> str:
        """The unit of :attr:`shown`."""
        return IN_UNCERTAINTIES if self.fit.weighted else self.fit.unit

    @cached_property
    def first(self) -> Index:
        """A row of each cell, (N,)."""
        return np.asarray(self.rows[np.unique(self.cell, return_index=True)[1]])

    @cached_property
    def residual(self) -> Array:
        """Residuals in the fit's unit, means of cells, (N, m)."""
        return self.y * self.scale

    @cached_property
    def follows(self) -> NDArray[np.bool_]:
        """Whether a pose was measured right after the one before, in the same run, (P - 1,)."""
        return np.asarray((np.diff(self.number) == 1) & (np.diff(self.run) == 0))

    @cached_property
    def places(self) -> Array:
        """Where the model puts what was measured, means of cells, (N, 3), in machine axes."""
        found = self.fit.places(self.observations.take(self.rows))
        sums = [np.bincount(self.cell, column, len(self.count)) for column in found.T]
        return np.stack(sums, axis=-1) / self.count[:, None]

    @cached_property
    def motions(self) -> Array:
        """How the prediction moves with each joint's reading, (N, m, joints), in weighted residuals.

        What a wrong reading of a joint does lies along these, wherever the joints before it have turned them.
        """
        o = self.observations.take(self.rows)
        found = np.empty((*self.y.shape, o.q.shape[1]))
        for j in range(o.q.shape[1]):
            motion = motion_with_reading(self.fit, o, j, weighted=True)
            for c, values in enumerate(motion.T):
                found[:, c, j] = np.bincount(self.cell, values, len(self.count)) / self.count
        return found

    def mean(self, values: Array) -> Array:
        """Return the means over cells, (N,), of what is given for every row of the data."""
        sums = np.bincount(self.cell, values[self.rows], len(self.count))
        return np.asarray(sums / self.count)

    def by_pose(self, values: Array) -> Array:
        """Return the means over poses, (P, …), of values of cells, (N, …)."""
        starts, sizes = stretches(self.pose)
        return np.asarray(
            np.add.reduceat(values, starts, axis=0) / sizes.reshape(-1, *[1] * (values.ndim - 1))
        )


def _chosen(fit: FittedModel) -> Index:
    """Return the rows to look at: all but the outliers, or stretches of poses where these are too many."""
    o = fit.observations
    rows = np.flatnonzero(~fit.outliers & np.isfinite(fit.residuals).all(axis=1))
    if len(rows) <= MOST_CELLS:
        return rows
    pose, target = o.pose[rows], o.target[rows]
    starts = np.ones(len(rows), bool)
    starts[1:] = (pose[1:] != pose[:-1]) | (
        target[1:] != target[:-1]
    )  # nearly: targets of a pose in turns count more
    poses = int(pose[-1]) + 1
    most = max(int(MOST_CELLS * poses / starts.sum()), 2 * STRETCH)
    if most >= poses:
        return rows
    many = poses // STRETCH
    chosen = np.random.default_rng(0).choice(many, most // STRETCH, replace=False)
    kept = np.zeros(many + 1, bool)
    kept[chosen] = True
    return np.asarray(rows[kept[pose // STRETCH]])
