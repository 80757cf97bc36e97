"""Where is the model worst? Ranges of joints and of the workspace whose residuals are larger than elsewhere.

Each covariate is cut at its deciles, or between its values where there are few; neighbouring pieces together are a
region. The mean squares of its poses are compared with those of the others by a t test of their cube roots, times the
number of all regions. Where successive poses are alike, they count for fewer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.discrepancy.compare._covariates import Covariate
from rodgen.discrepancy.compare._sample import Sample

__all__ = ["REGION_CLAIM", "Region", "Worst", "quarters", "round_between", "worst_regions"]

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]

REGION_CLAIM = 0.001
"""Probability of any claim of a region where the model is as good everywhere."""
WORSE = 1.15
"""Ratio of rms from which a region is worth telling."""
PIECES = 10
LEAST_POSES = 5
"""In a region, and outside of it."""
AS_BAD = 0.93
"""A joint's region is named before that of a place whose t is larger by less."""


@dataclass(frozen=True, eq=False)
class Region:
    """A range of a covariate, or one of its categories.

    Attributes
    ----------
    covariate : Covariate
    low, high : float or None
        In the covariate's unit; None: open. Of what goes round, `low` may be above `high`.
    category : str or None
    """

    covariate: Covariate
    low: float | None = None
    high: float | None = None
    category: str | None = None

    @property
    def text(self) -> str:
        """Such as ``"EL is above 70 deg"``."""
        name, unit = self.covariate.text, f" {self.covariate.unit}".rstrip()
        if self.covariate.unit == "row":
            name, unit = "the row (from 0)", ""
        if self.category is not None:
            return f"{name} is {self.category}"
        if self.low is None:
            return f"{name} is below {self.high:.12g}{unit}"
        if self.high is None:
            return f"{name} is above {self.low:.12g}{unit}"
        return f"{name} is between {self.low:.12g} and {self.high:.12g}{unit}"


@dataclass(frozen=True, eq=False)
class Worst:
    """The region of a covariate where the model is worst.

    Attributes
    ----------
    region : Region
    rms : float
        There, in the fit's unit.
    poses : int
    log10_p : float
        Times the number of all regions that were looked at.
    t : float
    """

    region: Region
    rms: float
    poses: int
    log10_p: float
    t: float


def worst_regions(sample: Sample, covariates: Sequence[Covariate]) -> list[Worst]:
    """Return for each covariate, except targets, its worst region; the clearest first."""
    from scipy.special import stdtr

    square = np.mean(sample.fit.residuals[sample.rows] ** 2, axis=1)
    pose = sample.pose[sample.cell]
    readings = np.bincount(pose)
    sums = np.bincount(pose, square)
    z = np.cbrt(sums / readings)
    z = (z - z.mean()) / (z.std() or 1.0)
    overall = float(sums.sum() / readings.sum())
    alike = float(np.mean(z[1:] * z[:-1])) if len(z) > 1 else 0.0
    fewer = (1 - max(alike, 0.0)) / (1 + max(alike, 0.0))
    found, looked = [], 0
    for covariate in covariates:
        if covariate.kind in {"target", "approach", "period"}:
            continue
        best = None
        for region, inside in _regions(covariate, sample):
            looked += 1
            count = int(inside.sum())
            rms = float(np.sqrt(sums[inside].sum() / readings[inside].sum()))
            t = _t(z, inside) * np.sqrt(fewer)
            if rms**2 > WORSE**2 * overall and (best is None or t > best.t):
                best = Worst(region, rms, count, 0.0, t)
        if best is not None:
            found.append(best)
    freedoms = max(len(z) * fewer - 2, 1.0)
    done = []
    for worst in found:
        p = float(stdtr(freedoms, -worst.t)) * looked
        done.append(
            Worst(worst.region, worst.rms, worst.poses, float(np.log10(min(max(p, 1e-300), 1.0))), worst.t)
        )
    return sorted(
        done, key=lambda worst: -worst.t * (AS_BAD if worst.region.covariate.kind == "place" else 1.0)
    )


def _t(z: Array, inside: Mask) -> float:
    """Return Student's t of two groups, those inside less the others."""
    a, b = z[inside], z[~inside]
    square = np.sum((a - a.mean()) ** 2) + np.sum((b - b.mean()) ** 2)
    if square <= 0:
        return 0.0
    return float((a.mean() - b.mean()) / np.sqrt(square / (len(z) - 2) * (1 / len(a) + 1 / len(b))))


def _regions(covariate: Covariate, sample: Sample) -> Iterator[tuple[Region, Mask]]:
    """Yield regions of a covariate that hold at most half of the poses, with these."""
    values = sample.by_pose(covariate.values)
    least = max(LEAST_POSES, int(0.05 * len(values)))

    def fits(inside: Mask) -> bool:
        return bool(least <= inside.sum() <= len(values) / 2)

    if covariate.categories:
        for code, name in enumerate(covariate.categories):
            if fits(values == code):
                yield Region(covariate, category=name), values == code
        return
    if covariate.turn is not None:
        values = values % covariate.turn if np.ptp(covariate.values) > 1.01 * covariate.turn else values
    edges = _edges(values)
    piece = np.searchsorted(edges, values, "right")
    pieces = len(edges) + 1
    for first in range(pieces):
        for last in range(first, first + pieces - 1):
            if last >= pieces and covariate.turn is None:
                break
            inside = (piece - first) % pieces <= last - first
            if fits(inside):
                low = edges[first - 1] if first > 0 else None
                high = edges[last % pieces] if last % pieces < pieces - 1 else None
                yield Region(covariate, low, high), inside


def _edges(values: Array, pieces: int = PIECES) -> Array:
    """Return round numbers that cut values into about equal pieces, or between every two where these are few."""
    known, count = np.unique(values, return_counts=True)
    below = np.cumsum(count)[:-1]
    if len(known) > pieces:
        wanted = np.arange(1, pieces) * len(values) / pieces
        cuts = np.unique(np.argmin(np.abs(below[:, None] - wanted), axis=0))
    else:
        cuts = np.arange(len(below))
    return np.unique([round_between(known[i], known[i + 1]) for i in cuts])


def round_between(a: float, b: float) -> float:
    """Return the roundest number x with a < x <= b.

    Examples
    --------
    >>> round_between(68.31, 71.2), round_between(0.0123, 0.0127), round_between(-3.0, 8.0)
    (70.0, 0.0125, 0.0)
    """
    if a < 0 <= b:
        return 0.0
    step = 10.0 ** np.ceil(np.log10(max(abs(a), abs(b))))
    for _ in range(17):
        for part in (1.0, 0.5, 0.2, 0.1):
            x = np.floor(b / (step * part)) * step * part
            if a < x <= b:
                return float(f"{x:.15g}")
        step /= 10
    return b


def quarters(covariate: Covariate) -> Iterator[tuple[Region, Mask]]:
    """Yield four ranges of a covariate with as many cells each, or its categories."""
    values = covariate.values
    if covariate.categories:
        for code, name in enumerate(covariate.categories):
            if (values == code).any():
                yield Region(covariate, category=name), values == code
        return
    edges = _edges(values, 4)
    piece = np.searchsorted(edges, values, "right")
    for k in range(len(edges) + 1):
        low = edges[k - 1] if k else None
        high = edges[k] if k < len(edges) else None
        if (piece == k).any():
            yield Region(covariate, low, high), piece == k
