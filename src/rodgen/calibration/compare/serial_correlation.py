"""Are poses that were measured one after the other alike? And what to do about it when they are.

Lag-1 ratio R = Σ e_p e_{p+1} / Σ e_p² over poses that follow each other in one run (von Neumann 1941; Durbin and Watson
1950), e the means over poses less what the fit takes out, A with ½ next to the diagonal. For independent normal errors
the moments of eᵀAe / eᵀe are exact,

    mean = tr MA / ν,    variance = 2 (ν tr (MA)² - (tr MA)²) / (ν² (ν + 2)),    M = 1 - QQᵀ,   ν = tr M,

and a beta distribution on -1 … 1 with these gives the p-value.

What wanders is modelled as a random walk plus independent errors, the ratio of the two variances by restricted
maximum likelihood. Its steps are brought to independent ones by the Cholesky factor of their covariance, which is
tridiagonal; within a pose nothing changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.compare.explained import ProjectedResiduals
from rodgen.calibration.compare.sample import Sample
from rodgen.statistics.columns import directions_above, project_out
from rodgen.statistics.decompositions import singular_values
from rodgen.statistics.thresholds import SMALLEST_P

LEAST_POSES = 10
"""Degrees of freedom below which nothing is said of correlations."""
RATIOS = np.concatenate([[0.0], np.geomspace(1e-4, 1e2, 19)])
"""Variance of a step of the walk, over that of the errors: the likelihood is flat enough for three a decade."""


@dataclass(frozen=True)
class SerialCorrelation:
    """How alike the residuals of successive poses are."""

    lag_1: float
    """Correlation of successive poses."""
    log10_p: float
    """Of one as high by chance."""


def _taken(space: ProjectedResiduals, c: int) -> Array:
    """Return an orthonormal basis, (P, r), of what is taken out of the poses' means of a component."""
    return directions_above(space.sample.by_pose(space.space.basis[c :: space.sample.components]), 1e-3)


def serial_correlation(space: ProjectedResiduals, c: int) -> SerialCorrelation | None:
    """Test a component; None where too few poses follow each other.

    Parameters
    ----------
    space : ProjectedResiduals
        Without filters.
    c : int
        The component.
    """
    from scipy import special

    sample = space.sample
    follows = sample.follows
    taken = _taken(space, c)
    e = sample.by_pose(space.y[:, c])
    e = project_out(taken, e)
    v = sample.poses - taken.shape[1]
    square = float(e @ e)
    if v < LEAST_POSES or follows.sum() < LEAST_POSES or square == 0.0:
        return None

    def neighbours(x: Array) -> Array:
        """Return A x."""
        found = np.zeros_like(x)
        half = 0.5 * follows.reshape(-1, *[1] * (x.ndim - 1))
        found[:-1] += half * x[1:]
        found[1:] += half * x[:-1]
        return found

    across = neighbours(taken)
    inside = taken.T @ across
    first = -float(np.trace(inside))
    second = follows.sum() / 2 - 2 * float(np.sum(across**2)) + float(np.sum(inside**2))
    mean = first / v
    variance = 2 * (v * second - first**2) / (v**2 * (v + 2))
    ratio = float(e @ neighbours(e)) / square
    total = (1 - mean**2) / variance - 1  # a + b of the beta distribution, from -1 to 1
    a, b = total * (1 + mean) / 2, total * (1 - mean) / 2
    p = float(special.betainc(b, a, (1 - ratio) / 2))
    lag_1 = (ratio - mean) * sample.poses / follows.sum()
    return SerialCorrelation(float(np.clip(lag_1, -1, 1)), float(np.log10(max(p, SMALLEST_P))))


@dataclass(frozen=True)
class Drift:
    """A component's linear trend."""

    change: float
    """From the first to the last, in the fit's unit."""
    log10_p: float
    """Of one as large by chance, where nothing else goes on in time."""


def drift(space: ProjectedResiduals, time: Array, c: int) -> Drift | None:
    """Test a component for a linear trend over times of cells, (N,); None where the fit takes trends out."""
    sample = space.sample
    line = time - time.mean()
    columns = np.zeros((*sample.y.shape, 1))
    columns[:, c, 0] = line
    evidence = space.test(columns)
    square = float(line @ line)
    if evidence is None or square == 0.0:
        return None
    return Drift(float(line @ sample.residual[:, c]) / square * float(np.ptp(time)), evidence.log10_p)


class RandomWalk:
    """Takes columns of cells to where a component's errors, a random walk and independent ones, are independent.

    Parameters
    ----------
    ratio : float
        Variance of the walk's step from pose to pose, over that of a pose's own error.
    """

    def __init__(self, sample: Sample, ratio: float) -> None:
        from scipy.linalg import cholesky_banded

        self.sample = sample
        self.ratio = ratio
        steps = np.diff(sample.number)
        covariance = np.zeros((2, len(steps)))
        covariance[0] = 2 + ratio * steps
        covariance[1, :-1] = -1.0
        self._factor = cholesky_banded(covariance, lower=True, check_finite=False)

    def steps(self, values: Array) -> Array:
        """Return independent steps, (P - 1, k), of values by pose, (P, k)."""
        from scipy.linalg import solve_banded

        return np.asarray(solve_banded((1, 0), self._factor, np.diff(values, axis=0), check_finite=False))

    @property
    def log_determinant(self) -> float:
        """Of the covariance of the steps."""
        return 2 * float(np.sum(np.log(self._factor[0])))

    def __call__(self, columns: Array) -> Array:
        """Return columns or residuals whitened: poses in their order are independent afterwards."""
        mean = self.sample.by_pose(columns)
        new = np.zeros_like(mean)
        new[1:] = self.steps(mean)
        return np.asarray(columns + (new - mean)[self.sample.pose])


def random_walk(space: ProjectedResiduals, c: int) -> RandomWalk | None:
    """Fit a random walk to a component; None where independent errors do as well."""
    sample = space.sample
    taken = _taken(space, c)
    e = sample.by_pose(space.y[:, [c]])
    best, found = -np.inf, None
    for ratio in RATIOS:
        walk = RandomWalk(sample, ratio)
        columns = directions_above(walk.steps(taken), 1e-4)
        left = project_out(columns, walk.steps(e))
        v = len(left) - columns.shape[1]
        if v < LEAST_POSES:
            return None
        # The determinant of the columns' normal equations belongs to the restricted likelihood.
        values = singular_values(walk.steps(taken))
        logs = float(np.sum(np.log(values[values > 1e-4 * values[0]]))) if len(values) else 0.0
        likelihood = -0.5 * (v * np.log(float(np.sum(left**2)) / v) + walk.log_determinant) - logs
        if likelihood > best:
            best, found = likelihood, (walk if ratio > 0 else None)
    return found
