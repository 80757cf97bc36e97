"""How evenly residuals scatter once all dependences are taken out, and whether large ones are too frequent.

Evenness: cube roots of the cells' mean squares, which are nearly normal for normal errors (Wilson and Hilferty 1931),
are tested against every driver as the residuals are, by poses (in the manner of Breusch and Pagan 1979, and of Levene
1960 for groups). Tails: kurtosis of one cell a pose (Anscombe and Glynn 1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.compare.dependence import Search
from rodgen.calibration.compare.explained import ProjectedResiduals
from rodgen.calibration.compare.regions import Region, quarters
from rodgen.calibration.compare.sample import Sample
from rodgen.data.drivers import Driver
from rodgen.data.poses import stretches
from rodgen.statistics.robust import kurtosis_of, kurtosis_tail
from rodgen.statistics.thresholds import SMALLEST_P

LEAST_POSES = 20
"""Below this the p-value of a kurtosis is a guess."""


@dataclass(frozen=True, eq=False)
class Uneven:
    """How the scatter follows a covariate."""

    covariate: Driver
    log10_p: float
    """Not yet times the number of covariates."""
    low: tuple[Region, float]
    high: tuple[Region, float]
    """The quarter, or category, with the least and the largest scatter, and its rms in the fit's unit."""


@dataclass(frozen=True)
class Tails:
    """Kurtosis of one component, 3 for normal errors."""

    component: int
    kurtosis: float
    log10_p: float


def _errors(sample: Sample, search: Search) -> Array:
    """Return residuals less all that was found, at the size of errors, (N, m), in standard deviations."""
    space = search.last.filtered
    leverage = space.leverage.reshape(space.y.shape)
    errors = space.y / np.sqrt(1 - np.minimum(leverage, 0.9))
    if space.whiten:
        errors = errors[sample.pose > 0]  # the first pose has no step before it
    size = np.sqrt(np.mean(errors**2, axis=0))
    found = np.full(sample.y.shape, np.nan)
    found[-len(errors) :] = errors / np.where(size > 0, size, 1.0)
    return found


def uneven(sample: Sample, search: Search, covariates: Sequence[Driver]) -> list[Uneven]:
    """Test the scatter against every covariate."""
    errors = _errors(sample, search)
    rows = np.isfinite(errors[:, 0])
    z = np.where(rows, np.cbrt(np.mean(errors**2, axis=1)), 0.0)
    z[~rows] = z[rows].mean()
    # Means of more readings scatter less, as they should.
    other = np.column_stack([np.ones(len(z)), 1 / sample.count])
    taken = np.linalg.qr(other[:, : 1 + bool(np.ptp(sample.count))])[0]
    space = ProjectedResiduals(replace(sample, y=z[:, None], taken=taken))
    unit = np.sqrt(np.mean(sample.shown**2, axis=0))
    left = np.where(rows[:, None], errors, np.nan) * unit * _left(sample, search)
    found = []
    for covariate in covariates:
        columns = covariate.values[:, None] if covariate.kind == "approach" else covariate.low_columns
        evidence = space.test(columns[:, None, :])
        parts = [
            (region, float(np.sqrt(np.nanmean(left[inside] ** 2))))
            for region, inside in quarters(covariate)
            if rows[inside].any()
        ]
        if evidence and len(parts) > 1:
            low, high = (choose(parts, key=lambda part: part[1]) for choose in (min, max))
            found.append(Uneven(covariate, evidence.log10_p, low, high))
    return found


def _left(sample: Sample, search: Search) -> Array:
    """Return which part of each component's rms remains, (m,)."""
    before, after = np.sum(sample.y**2, axis=0), np.sum(search.last.space.y**2, axis=0)
    return np.asarray(np.sqrt(np.divide(after, before, out=np.ones_like(before), where=before > 0)))


def tails(sample: Sample, search: Search) -> list[Tails]:
    """Test the tails of each component; none where poses are few, or means are of different numbers of readings."""
    errors = _errors(sample, search)
    first, _ = stretches(sample.pose)
    errors = errors[first][np.isfinite(errors[first, 0])]
    if len(errors) < LEAST_POSES or sample.count.max() > 1.5 * sample.count.min():
        return []
    found = []
    for c, e in enumerate(errors.T):
        if np.ptp(e) > 0:
            kurtosis = kurtosis_of(e)
            found.append(
                Tails(c, kurtosis, float(np.log10(max(kurtosis_tail(kurtosis, len(e)), SMALLEST_P))))
            )
    return found
