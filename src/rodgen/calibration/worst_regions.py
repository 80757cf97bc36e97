"""Where a model is worst: ranges of joints and of the workspace whose residuals are larger than elsewhere.

Each driver is cut at its deciles, in round numbers; neighbouring pieces together are a region.
A region of P₁ poses with the mean square s₁, P₂ others with s₂, all P with s, gains P ln s - P₁ ln s₁ - P₂ ln s₂ in
chi-square with a variance of its own, which costs ln P, and twice the logarithm of the number of regions. Where
successive poses are alike, they count for fewer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.data.poses import stretches
from rodgen.machines.drivers import Driver
from rodgen.statistics.thresholds import COST
from rodgen.views import Result

PIECES = 10
FEWEST_POSES = 5
"""In a region, and outside of it."""


@dataclass(frozen=True, repr=False, eq=False)
class Region(Result):
    """A range of a driver, or one of its categories, and how much worse the model is there."""

    covariate: Driver
    low: float | None
    high: float | None
    """In the driver's unit, `low` with it and `high` without; None: open. Of what goes round, `low` may be above."""
    category: str | None
    rms: float
    """There, in the unit of the sizes."""
    poses: int
    gain: float
    """Twice the logarithm of the odds that the model is worse there."""

    _keys = "covariate=covariate.name unit=covariate.unit low high category where=text rms poses"

    @property
    def text(self) -> str:
        """Such as ``"EL is 70 deg or more"``."""
        name, unit = self.covariate.text, f" {self.covariate.unit}".rstrip()
        if self.covariate.kind == "order":
            name, unit = f"the {self.covariate.counted}", ""
        if self.category is not None:
            return f"{name} is {self.category}"
        if self.low is None:
            return f"{name} is below {self.high:.12g}{unit}"
        if self.high is None:
            return f"{name} is {self.low:.12g}{unit} or more"
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
    regions, tried = [], 0
    for driver in drivers:
        if driver.kind in {"target", "approach", "period"}:
            continue
        values = np.add.reduceat(driver.values.astype(float), starts) / rows
        several = [*_regions(driver, values, square, fewer)]
        tried += len(several)
        regions += [max(several, key=lambda region: region.gain)] if several else []
    price = math.log(max(len(square) * fewer, 1.0)) + 2 * math.log(max(tried, 1))
    # the joints make the place
    seen = [region for region in regions if region.gain - price > COST.something]
    return sorted(seen, key=lambda r: -r.gain + (COST.needed if r.covariate.kind == "place" else 0.0))


def _regions(driver: Driver, values: Array, square: Array, fewer: float) -> Iterator[Region]:
    """Yield the regions of a driver that are worse than the others; of half of the poses at most."""
    if driver.categories:
        edges, widest = np.arange(1, len(driver.categories)) - 0.5, 1
    else:
        if driver.turn is not None and np.ptp(driver.values) > 1.01 * driver.turn:
            values = values % driver.turn
        edges, widest = _edges(values), PIECES
    piece, last = np.searchsorted(edges, values, "right"), len(edges)
    poses, whole = len(square), float(square.mean())
    for a, width in product(range(last + 1), range(1, widest + 1)):
        inside = (piece - a) % (last + 1) < width
        n, b = int(np.count_nonzero(inside)), a + width - 1
        if not max(FEWEST_POSES, 0.05 * poses) <= n <= poses / 2 or (b > last and driver.turn is None):
            continue
        here, elsewhere = float(square[inside].mean()), float(square[~inside].mean())
        if not here > elsewhere > 0:
            continue
        gain = poses * math.log(whole) - n * math.log(here) - (poses - n) * math.log(elsewhere)
        low = float(edges[a - 1]) if a > 0 else None
        high = float(edges[b % (last + 1)]) if b % (last + 1) < last else None
        category = driver.categories[a] if driver.categories else None
        yield Region(driver, low, high, category, math.sqrt(here), n, fewer * gain)


def _edges(values: Array) -> Array:
    """Return round numbers that cut values into about equal pieces: deciles, to a hundredth of their range."""
    deciles = np.quantile(values, np.arange(1, PIECES) / PIECES)
    edges = np.unique(np.round(deciles, int(2 - np.ceil(np.log10(np.ptp(values) or 1.0)))))
    return np.asarray(edges[(edges > values.min()) & (edges <= values.max())])
