"""Where is the model worst? Ranges of joints and of the workspace whose residuals are larger than elsewhere.

Each covariate is cut at its deciles, or between its values where there are few; neighbouring pieces together are a
region. The mean squares of its poses are compared with those of the others by a t test of their cube roots, times the
number of all regions. Where successive poses are alike, they count for fewer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rodgen.array_types import Array, Mask
from rodgen.calibration.compare.sample import Sample
from rodgen.data.drivers import Driver
from rodgen.statistics.thresholds import COMPARISON, SMALLEST_P

PIECES = 10
CLOSEST = 1e-6
"""Values that are closer than this part of the range are not cut apart."""
LEAST_POSES = 5
"""In a region, and outside of it."""


@dataclass(frozen=True, eq=False)
class Region:
    """A range of a covariate, or one of its categories."""

    covariate: Driver
    low: float | None = None
    high: float | None = None
    """In the covariate's unit; None: open. Of what goes round, `low` may be above `high`."""
    category: str | None = None

    @property
    def text(self) -> str:
        """Such as ``"EL is above 70 deg"``."""
        name, unit = self.covariate.text, f" {self.covariate.unit}".rstrip()
        if self.covariate.kind == "order":
            name, unit = f"the {self.covariate.counted}", ""
        if self.category is not None:
            return f"{name} is {self.category}"
        if self.covariate.kind == "approach":
            return f"{name} is {'-1' if self.low is None else '+1'}"
        if self.low is None:
            return f"{name} is below {self.high:.12g}{unit}"
        if self.high is None:
            return f"{name} is above {self.low:.12g}{unit}"
        return f"{name} is between {self.low:.12g} and {self.high:.12g}{unit}"


@dataclass(frozen=True, eq=False)
class Worst:
    """The region of a covariate where the model is worst."""

    region: Region
    rms: float
    """There, in the fit's unit."""
    poses: int
    log10_p: float
    """Times the number of all regions that were looked at."""
    t: float


def worst_regions(sample: Sample, covariates: Sequence[Driver]) -> list[Worst]:
    """Return for each covariate, except targets, its worst region; the clearest first."""
    from scipy import special

    square = np.mean(sample.shown**2, axis=1)
    pose = sample.pose[sample.cell]
    readings, sums = np.bincount(pose), np.bincount(pose, square)
    z = np.cbrt(sums / readings)
    z = (z - z.mean()) / (z.std() or 1.0)
    by_pose = np.stack([np.ones(len(z)), z, sums, readings])
    alike = max(float(np.mean(z[1:] * z[:-1])), 0.0) if len(z) > 1 else 0.0
    fewer = (1 - alike) / (1 + alike)
    found, looked = [], 0
    for covariate in covariates:
        if covariate.kind in {"target", "approach", "period"}:
            continue
        best, tried = _worst(covariate, sample.by_pose(covariate.values), by_pose)
        looked += tried
        if best is not None:
            found.append(replace(best, t=best.t * np.sqrt(fewer)))
    dof = max(len(z) * fewer - 2, 1.0)
    p = [float(special.stdtr(dof, -worst.t)) * looked for worst in found]
    done = [
        replace(w, log10_p=float(np.log10(min(max(q, SMALLEST_P), 1.0))))
        for w, q in zip(found, p, strict=True)
    ]
    return sorted(
        done, key=lambda w: -w.t * (COMPARISON.as_bad if w.region.covariate.kind == "place" else 1.0)
    )


def _worst(covariate: Driver, values: Array, by_pose: Array) -> tuple[Worst | None, int]:
    """Return the worst region of a covariate, and how many were compared.

    Regions hold at most half of the poses. All are sums over neighbouring pieces, of what is summed up by piece.
    """
    edges: Array = np.zeros(0)
    if covariate.categories:
        piece, pieces = values.astype(int), len(covariate.categories)
        first, last = np.arange(pieces), np.arange(pieces)
    else:
        if covariate.turn is not None and np.ptp(covariate.values) > 1.01 * covariate.turn:
            values = values % covariate.turn
        edges = _edges(values)
        piece, pieces = np.searchsorted(edges, values, "right"), len(edges) + 1
        first, last = (x.ravel() for x in np.mgrid[:pieces, : 2 * pieces])
        allowed = (last >= first) & (last < first + pieces) & ((last < pieces) | (covariate.turn is not None))
        first, last = first[allowed], last[allowed]
    by_piece = np.stack([np.bincount(piece, row, pieces) for row in by_pose], axis=-1)
    below = np.concatenate([np.zeros((1, 4)), np.cumsum(np.tile(by_piece, (2, 1)), axis=0)])
    count, z, square, readings = (below[last + 1] - below[first]).T
    poses = len(values)
    fits = (count >= max(LEAST_POSES, int(0.05 * poses))) & (count <= poses / 2)
    first, last, count, z, square, readings = (x[fits] for x in (first, last, count, z, square, readings))
    if not len(first):
        return None, 0
    # Student's t of those inside less the others; z has mean 0 and variance 1 over all
    within = poses - z**2 / count - z**2 / (poses - count)
    apart = z / count + z / (poses - count)
    t = apart / np.sqrt(np.maximum(within, 1e-12) / (poses - 2) * (1 / count + 1 / (poses - count)))
    rms = np.sqrt(square / readings)
    overall = np.sqrt(by_pose[2].sum() / by_pose[3].sum())
    t = np.where(rms > COMPARISON.worse * overall, t, -np.inf)
    best = int(np.argmax(t))
    if t[best] <= 0:
        return None, len(t)
    a, b = int(first[best]), int(last[best])
    if covariate.categories:
        region = Region(covariate, category=covariate.categories[a])
    else:
        low = float(edges[a - 1]) if a > 0 else None
        high = float(edges[b % pieces]) if b % pieces < pieces - 1 else None
        region = Region(covariate, low, high)
    return Worst(region, float(rms[best]), int(count[best]), 0.0, float(t[best])), len(t)


def _edges(values: Array, pieces: int = PIECES) -> Array:
    """Return round numbers that cut values into about equal pieces, or between every two where these are few."""
    known, count = np.unique(values, return_counts=True)
    gaps = np.flatnonzero(np.diff(known) > CLOSEST * (known[-1] - known[0]))
    below = np.cumsum(count)[gaps]
    if len(gaps) >= pieces:
        wanted = np.arange(1, pieces) * len(values) / pieces
        gaps = gaps[np.unique(np.argmin(np.abs(below[:, None] - wanted), axis=0))]
    return np.unique([round_between(known[i], known[i + 1]) for i in gaps])


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


def quarters(covariate: Driver) -> Iterator[tuple[Region, Mask]]:
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
