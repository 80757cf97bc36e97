"""What a comparison looks at: residuals by cell, a target in a pose, and what the fit may have taken out of them.

Readings of one target in one pose are averaged; cells of one pose may share errors and are never taken for independent.
A fit moves its parameters a little to swallow a part of every error. That part lies in the span of the model's Jacobian
J, so that y - QQᵀy, Q an orthonormal basis of it, is the same for the errors as for the residuals, and every test is
made with Q taken out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array, Index
from rodgen.calibration.problem import Problem
from rodgen.calibration.reading_motion import motion_with_reading
from rodgen.calibration.words import IN_UNCERTAINTIES
from rodgen.data.drivers import Driver, drivers_of_place, products
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


# The drivers that residuals are compared with: those of the data, the place of the reading, and pairs of them.


SAME = 0.9999
"""Correlation from which two drivers are one: an altitude and the elevation axis that makes it."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two drivers together: what neither explains alone."""

    first: Driver
    second: Driver
    kind: str = field(default="pair", init=False)
    in_time: bool = field(default=False, init=False)

    @property
    def name(self) -> str:
        """Both names."""
        return f"{self.first.name} and {self.second.name}"

    @property
    def text(self) -> str:
        """What a sentence calls it."""
        if self.first.kind == "target":
            return f"{self.second.text}, differently for each target"
        return f"{self.first.text} and {self.second.text} together"

    @property
    def columns(self) -> Array:
        """Products of low order, (N, k)."""
        return products(self.first.low_columns, self.second.low_columns)

    @property
    def alone(self) -> Array:
        """What each does alone, (N, k)."""
        return np.column_stack([self.first.columns, self.second.columns])


def compared(sample: Sample) -> list[Driver | Pair]:
    """Return everything that a sample is compared with; the place last, because joints make it.

    What does not vary is left out; what has the same values as another one becomes a further name of that.
    """
    listed: list[Driver] = []
    given = (driver.as_noted(sample.mean, sample.first) for driver in sample.observations.drivers())
    for driver in (*given, *drivers_of_place(sample.fit.machine, sample.places)):
        if driver.levels < 2:
            continue
        twin = next((i for i, other in enumerate(listed) if _same(driver, other)), None)
        if twin is None:
            listed.append(driver)
        else:
            listed[twin] = replace(listed[twin], same=(*listed[twin].same, driver.text))
    places = [driver for driver in listed if driver.kind == "place"]
    return [*(driver for driver in listed if driver.kind != "place"), *_pairs(listed), *places]


def _same(one: Driver, other: Driver) -> bool:
    """Return whether two drivers are the same numbers, but for their zero, sign and size."""
    if {one.kind, other.kind} & {"approach", "run", "target", "period", "time", "order"}:
        return False
    if one.turn is not None and other.turn is not None:
        a, b = 2 * np.pi * one.values / one.turn, 2 * np.pi * other.values / other.turn
        return bool(max(abs(np.mean(np.exp(1j * (a + sign * b)))) for sign in (1, -1)) > SAME)
    a, b = one.values - one.values.mean(), other.values - other.values.mean()
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return bool(size > 0 and abs(a @ b) > SAME * size)


def _pairs(listed: Sequence[Driver]) -> list[Pair]:
    """Return the pairs worth testing: joints with each other, with load, temperatures, columns and targets."""
    joints = [driver for driver in listed if driver.kind == "joint"]
    others = [d for d in listed if d.kind in {"load", "temperature", "column", "target"}]
    found = [Pair(a, b) for a, b in combinations(joints, 2)]
    return found + [Pair(other, joint) for other in others for joint in joints if other.joint != joint.joint]
