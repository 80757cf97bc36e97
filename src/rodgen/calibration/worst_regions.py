"""Where a model is worst: ranges of joints and of the workspace whose residuals are larger than elsewhere.

Each driver is cut at its deciles, or between its values where there are few; neighbouring pieces together are a region.
A region of P₁ poses with the mean square s₁, P₂ others with s₂, all P with s, gains P ln s - P₁ ln s₁ - P₂ ln s₂ in
chi-square with a variance of its own, which costs ln P, and twice the logarithm of the number of regions. Where
successive poses are alike, they count for fewer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.data.poses import stretches
from rodgen.machines.drivers import Driver
from rodgen.statistics.thresholds import COST
from rodgen.views import Result

PIECES = 10
CLOSEST = 1e-6
"""Values that are closer than this part of the range are not cut apart."""
FEWEST_POSES = 5
"""In a region, and outside of it."""


@dataclass(frozen=True, repr=False, eq=False)
class Region(Result):
    """A range of a driver, or one of its categories, and how much worse the model is there."""

    covariate: Driver
    low: float | None
    high: float | None
    """In the driver's unit; None: open. Of what goes round, `low` may be above `high`."""
    category: str | None
    rms: float
    """There, in the unit of the sizes."""
    poses: int
    gain: float
    """Twice the logarithm of the odds that the model is worse there."""

    _keys = "covariate=covariate.name unit=covariate.unit low high category where=text rms poses"

    @property
    def text(self) -> str:
        """Such as ``"EL is above 70 deg"``."""
        name, unit = self.covariate.text, f" {self.covariate.unit}".rstrip()
        if self.covariate.kind == "order":
            name, unit = f"the {self.covariate.counted}", ""
        if self.category is not None:
            return f"{name} is {self.category}"
        if self.low is None:
            return f"{name} is below {self.high:.12g}{unit}"
        if self.high is None:
            return f"{name} is above {self.low:.12g}{unit}"
        return f"{name} is between {self.low:.12g} and {self.high:.12g}{unit}"


def worst_regions(drivers: Sequence[Driver], sizes: Array, pose: NDArray[np.integer]) -> list[Region]:
    """Return the worst region of each driver where the model is worse than elsewhere, the clearest first.

    Parameters
    ----------
    sizes : ndarray, shape (n, m)
        Residuals by which rows are compared.
    pose : ndarray of int, shape (n,)
        Not decreasing.
    """
    starts, rows = stretches(pose)
    square = np.add.reduceat(np.mean(sizes**2, axis=1), starts) / rows
    if len(square) < 2 * FEWEST_POSES or not square.sum() > 0:
        return []
    z = np.cbrt(square)
    z = (z - z.mean()) / (z.std() or 1.0)
    alike = max(float(np.mean(z[1:] * z[:-1])), 0.0)
    fewer = (1 - alike) / (1 + alike)
    found, tried = [], 0
    for driver in drivers:
        if driver.kind in {"target", "approach", "period"}:
            continue
        values = np.add.reduceat(driver.values.astype(float), starts) / rows
        several = list(_regions(driver, values, square, fewer))
        tried += len(several)
        found += [max(several, key=lambda region: region.gain)] if several else []
    price = math.log(max(len(square) * fewer, 1.0)) + 2 * math.log(max(tried, 1))
    # the joints make the place
    seen = [region for region in found if region.gain - price > COST.something]
    return sorted(seen, key=lambda r: -r.gain + (COST.needed if r.covariate.kind == "place" else 0.0))


def _regions(driver: Driver, values: Array, square: Array, fewer: float) -> list[Region]:
    """Return the regions of a driver that are worse than the others; of half of the poses at most."""
    edges: Array = np.zeros(0)
    if driver.categories:
        piece, pieces = values.astype(int), len(driver.categories)
        first, last = np.arange(pieces), np.arange(pieces)
    else:
        if driver.turn is not None and np.ptp(driver.values) > 1.01 * driver.turn:
            values = values % driver.turn
        edges = _edges(values)
        piece, pieces = np.searchsorted(edges, values, "right"), len(edges) + 1
        first, last = (x.ravel() for x in np.mgrid[:pieces, : 2 * pieces])
        allowed = (last >= first) & (last < first + pieces) & ((last < pieces) | (driver.turn is not None))
        first, last = first[allowed], last[allowed]
    by_piece = np.stack([np.bincount(piece, weights, pieces) for weights in (np.ones(len(square)), square)])
    below = np.concatenate([np.zeros((2, 1)), np.cumsum(np.tile(by_piece, 2), axis=1)], axis=1)
    count, inside = below[:, last + 1] - below[:, first]
    poses, total = len(square), float(square.sum())
    fits = (count >= max(FEWEST_POSES, int(0.05 * poses))) & (count <= poses / 2)
    found = []
    for a, b, n, own in zip(first[fits], last[fits], count[fits], inside[fits], strict=True):
        here, elsewhere = own / n, (total - own) / (poses - n)
        if here <= elsewhere or not elsewhere > 0:
            continue
        gain = poses * math.log(total / poses) - n * math.log(here) - (poses - n) * math.log(elsewhere)
        low = float(edges[a - 1]) if a > 0 and len(edges) else None
        high = float(edges[b % pieces]) if b % pieces < pieces - 1 and len(edges) else None
        category = driver.categories[a] if driver.categories else None
        found.append(Region(driver, low, high, category, math.sqrt(here), int(n), fewer * gain))
    return found


def _edges(values: Array) -> Array:
    """Return round numbers that cut values into about equal pieces, or between every two where these are few."""
    known, count = np.unique(values, return_counts=True)
    gaps = np.flatnonzero(np.diff(known) > CLOSEST * (known[-1] - known[0]))
    below = np.cumsum(count)[gaps]
    if len(gaps) >= PIECES:
        wanted = np.arange(1, PIECES) * len(values) / PIECES
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
