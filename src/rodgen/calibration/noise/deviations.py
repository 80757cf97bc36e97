"""How much things differ that should be equal, and whether anything else explains it.

Replicates should have equal residuals; two targets on one body should keep their distance. Both are scalars in groups,
some of them taken in one pose, and what one pose does to all that was read in it makes them dependent. So the degrees
of freedom are not counted but estimated (Satterthwaite 1946): those of independent normal readings whose sum of squares
would scatter as this one does. Its variance is twice the sum of the squared covariances within a pose, of which the
estimates are corrected for their own scatter (Bai and Saranadasa 1996).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.data.drivers import Driver, Kind
from rodgen.data.poses import stretches
from rodgen.statistics.decompositions import svd
from rodgen.statistics.f_tests import f_tail

Ints: TypeAlias = NDArray[np.integer[Any]]

DRIFTS: tuple[Kind, ...] = ("run", "time", "order", "temperature", "column")
"""Kinds of drivers that differ between poses with equal commands."""
SURE = 1e-4
"""Probability by chance, over all that is tried, below which something drives the deviations."""
DEGREE = 3
"""Of the polynomial in a driver that deviations are compared with: a drift and its bend."""
MOST_RUNS = 50
"""Runs that are looked at one by one; of more, a drift from run to run."""
MOST_POSES = 20_000
"""Poses that covariances are estimated from at most: their sum is then good to about 1 %."""
FEW_POSES = 5
"""Fewer differences between poses do not show what the readings of a pose share."""


@dataclass(frozen=True)
class StandardDeviation:
    """An estimated standard deviation."""

    value: float
    degrees_of_freedom: float
    """Of independent normal values with as much information."""
    low: float
    high: float
    """It is between them with 95 % probability."""

    @classmethod
    def of(cls, variance: float, degrees_of_freedom: float, factor: float = 1.0) -> StandardDeviation:
        """Return the root of a variance, times a factor, with its interval."""
        from scipy import special

        value = factor * float(np.sqrt(variance))
        low, high = (
            float(np.sqrt(degrees_of_freedom / special.chdtri(degrees_of_freedom, p))) for p in (0.025, 0.975)
        )
        return cls(value, degrees_of_freedom, value * low, value * high)


@dataclass(frozen=True)
class Deviations:
    """Values less the mean of their group.

    Each has c components; its standard deviation is √variance · √(left / weight).
    """

    value: Array
    """Shape (n, c)."""
    weight: Array
    """Shape (n, c)."""
    left: Array
    """Part of the variance that the mean of the group leaves: 1 - weight / (sum of the group's weights), (n, c)."""
    group: Ints
    pose: Ints
    column: Ints
    """`column` numbers what is looked at in a pose, such as targets, (n,)."""
    row: Ints
    """A row of the data that it comes from, (n,)."""
    lever: Array
    """By how much the value changes when a driver does: 1 but for distances, which have a common scale, (n,). The same
    within a group, or a lever times a constant driver would itself be the deviation."""
    lost: float = 0.0
    """Degrees of freedom that something fitted has taken away."""

    @classmethod
    def of(
        cls,
        value: Array,
        weight: Array,
        group: Ints,
        pose: Ints,
        column: Ints,
        row: Ints,
        lever: Array | None = None,
    ) -> Deviations:
        """Take the means of the groups off, and leave out groups of one value. All in the order of the groups."""
        starts, sizes = stretches(group)
        total = np.repeat(np.add.reduceat(weight, starts), sizes, axis=0) if len(group) else weight
        mean = (
            np.repeat(np.add.reduceat(weight * value, starts), sizes, axis=0) / total if len(group) else value
        )
        several = np.repeat(sizes > 1, sizes)
        lever = np.ones(len(value)) if lever is None else lever
        made = cls(value - mean, weight, 1 - weight / total, group, pose, column, row, lever)
        return made.take(several)

    def take(self, rows: NDArray[np.bool_]) -> Deviations:
        """Return some of them."""
        names = ("value", "weight", "left", "group", "pose", "column", "row", "lever")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    @property
    def normalized(self) -> Array:
        """Values times the roots of their weights."""
        return self.value * np.sqrt(self.weight)

    @property
    def sum_of_squares(self) -> float:
        """Weighted."""
        return float(np.sum(self.weight * self.value**2))

    @property
    def count(self) -> float:
        """Degrees of freedom, were all values independent."""
        return float(self.left.sum()) - self.lost

    @property
    def poses(self) -> float:
        """Number of differences between poses."""
        if not len(self.pose):
            return 0.0
        order = np.argsort(self.pose, kind="stable")
        starts, _ = stretches(self.pose[order])
        return float(np.maximum.reduceat(self.left.max(axis=1)[order], starts).sum())

    @property
    def variance(self) -> float:
        """Mean square per degree of freedom."""
        return self.sum_of_squares / self.count

    @property
    def share(self) -> float:
        """Share of the degrees of freedom that remains because values of one pose depend on each other."""
        share = independent_share(self.normalized, self.left, self.pose, self.column)
        if self.poses < FEW_POSES and self.count > 0:
            share = min(share, self.value.shape[1] * self.poses / self.count)
        return share

    def estimate(self, factor: float = 1.0) -> StandardDeviation:
        """Return the standard deviation at weight 1, times a factor."""
        return StandardDeviation.of(self.variance, max(self.share * self.count, 1.0), factor)

    def without_drift(self, candidates: Iterable[Driver]) -> tuple[Deviations, list[str]]:
        """Take out what follows a driver beyond doubt, the strongest first; return the rest, and the drivers' names."""
        left, named = self, list[str]()
        if not len(self.group):
            return left, named
        candidates = [driver for driver in candidates if len(driver.categories) != 1]
        while True:
            tried = [driver for driver in candidates if driver.text not in named]
            found = [(*left._explained(driver, SURE / len(tried)), driver.text) for driver in tried]
            best = min(found, key=lambda t: t[0], default=None)
            if best is None or best[0] > SURE / len(tried):
                return left, named
            left = best[1]
            named.append(best[2])

    def _explained(self, driver: Driver, enough: float) -> tuple[float, Deviations]:
        """Return the probability that chance explains as much as a driver does, and what it leaves.

        The probability is that for independent values where this is more than `enough` already.
        """
        by_row = _curve(driver, self.row) * self.lever[:, None]
        mean_weight = self.weight.mean(axis=1, keepdims=True)
        starts, sizes = stretches(self.group)
        mean = np.add.reduceat(mean_weight * by_row, starts) / np.add.reduceat(mean_weight, starts)
        columns = (by_row - np.repeat(mean, sizes, axis=0)) * np.sqrt(mean_weight)
        u, size, _ = svd(columns)
        u = u[:, size > 1e-9 * np.linalg.norm(by_row * np.sqrt(mean_weight))]
        used = u.shape[1] * self.value.shape[1]
        residual_dof = self.count - used
        if not used or residual_dof < FEW_POSES:
            return 1.0, self
        explained = u @ (u.T @ self.normalized)
        gain = float(np.sum(explained**2))
        rest = replace(self, value=self.value - explained / np.sqrt(self.weight), lost=self.lost + used)
        if not gain > 0:
            return 1.0, self
        with np.errstate(divide="ignore"):
            ratio = float(np.divide(gain / used, rest.variance))
        p = f_tail(ratio, used, residual_dof)
        if p > enough:  # fewer degrees of freedom make it no less
            return p, rest
        share = rest.share
        return f_tail(ratio, max(share * used, 1.0), max(share * residual_dof, 1.0)), rest


def _curve(driver: Driver, rows: Ints) -> Array:
    """Return functions of a driver for some rows, (rows, k): one for each category, or powers."""
    if 0 < len(driver.categories) <= MOST_RUNS:
        return np.asarray(np.eye(len(driver.categories))[driver.values[rows]])
    x = np.asarray(driver.values[rows], float)
    middle, half = (x.max() + x.min()) / 2, np.ptp(x) / 2
    return np.asarray(np.polynomial.legendre.legvander((x - middle) / (half or 1.0), DEGREE)[:, 1:])


def independent_share(value: Array, left: Array, pose: Ints, column: Ints) -> float:
    """Return the effective degrees of freedom of a sum of squares, as part of those of independent values.

    Parameters
    ----------
    value : ndarray, shape (n, c)
        Of equal variance but for `left`, without weights.
    left : ndarray, shape (n, c)
        Part of the variance that is left of each.
    pose, column : ndarray of int, shape (n,)
        Values of different poses are independent; equal columns of different poses are alike.
    """
    if not len(value):
        return 1.0
    _, place = np.unique(pose, return_inverse=True)
    columns, at = np.unique(column, return_inverse=True)
    poses = int(place.max()) + 1
    if poses > MOST_POSES:
        some = place % (poses // MOST_POSES + 1) == 0
        _, place = np.unique(place[some], return_inverse=True)
        value, left, at, poses = value[some], left[some], at[some], int(place.max()) + 1
    c = value.shape[1]
    both = np.zeros((2, poses, len(columns), c))
    both[0, place, at], both[1, place, at] = value, np.sqrt(left)
    table, seen = both.reshape(2, poses, -1)
    number = seen.T @ seen
    with np.errstate(invalid="ignore", divide="ignore"):
        covariance = np.where(number > 0, table.T @ table / number, 0.0)
        own = np.diag(covariance)
        squares = (covariance**2 - np.outer(own, own) / number) / (1 + 1 / number)
        alone = own**2 / (1 + 2 / np.diag(number))
    total, alone_sum = float(np.sum(table**2)), float(np.nansum(np.diag(number) * alone))
    np.fill_diagonal(squares, 0.0)
    shared = float(np.sum(np.where(number > 0, number * np.nan_to_num(squares), 0.0)))
    scatter = alone_sum + max(shared, 0.0)
    return min(total**2 / scatter / float(np.diag(number).sum()), 1.0) if scatter > 0 else 1.0
