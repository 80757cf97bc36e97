"""What changed among new readings: a view of the evidence, with the reference's noise and a beginning.

The detector clips readings that are far from what is expected, so that it knows neither how large a large change is
nor, therefore, which columns it follows. Here the last readings are not clipped. The evidence names the set of effects
that explains those since the change began best; that moves to where -2 ln of the probability falls most, and readings
that are wrong by themselves are left out, until all stay. That readings scatter more competes with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.candidates import Candidate
from rodgen.calibration.evidence import Estimated, Evidence
from rodgen.calibration.fitted import Estimate
from rodgen.calibration.selection import equals, select
from rodgen.calibration.watch.columns import Alternative, WatchedColumns
from rodgen.calibration.watch.events import Likely
from rodgen.errors import joined
from rodgen.statistics.change_detector import ChangeDetector, Since, Sums, central
from rodgen.statistics.thresholds import COST, WATCH

WRONG = 10.0
"""Standard deviations beyond which a reading says no more of a change than that it is wrong."""
NOISES = np.geomspace(0.1, 1e6, 281)
"""Factors of the noise that are tried."""


@dataclass(frozen=True, eq=False)
class Change:
    """What changed.

    Attributes
    ----------
    likely : list of Likely
        The likeliest first, down to a hundredth of its probability; see `COST.tied`.
    moved : list of int
        Columns whose coefficients may have changed.
    first, last : ndarray
        Marks of the readings between which it began with a probability of 90 %.
    noise : float
        Factor by which readings scatter more; 1 where that is not likely.
    before, since : Sums
        Up to the change, and from there on.
    """

    likely: list[Likely]
    moved: list[int]
    first: Array
    last: Array
    noise: float
    before: Sums
    since: Sums


def what_changed(detector: ChangeDetector, watched: WatchedColumns) -> Change:
    """Return what changed, as far as the last readings tell it."""
    first, _, best = detector.began()
    before, readings = first.sums, detector.readings_since(first.sums)
    far, dof = readings.distance(), detector.dof_of(before)
    start = max(len(far) - int(detector.sums.rows - best.sums.rows), 0)
    after, near = np.arange(len(far)) >= start, np.ones(len(far), bool)
    for _ in range(WATCH.rounds):
        some = Since(*(part[after & near] for part in readings))
        evidence = watched.evidence(*detector.products(before, some), some.unexpected.size, dof)
        # something changed, so that the likeliest effect is named where none is likely enough
        chosen, sizes = _sized(evidence, select(evidence) or evidence.promising([[]], 1)[0])
        change = np.zeros(readings.columns.shape[2])
        change[[i for one in watched.of(chosen) for i in one.columns]] = sizes.theta
        left = readings.distance(change)
        wrong, unchanged = (float(np.sum(x)) for x in (_loss(left[after & ~near]), _loss(far[after])))
        since = np.cumsum((_loss(far) - _loss(left))[::-1])[::-1]
        was = after, near
        after = np.arange(len(far)) >= int(np.argmax(since))
        near = left < WRONG * max(float(np.median(left[after])), 1.0)
        if np.array_equal(was, (after, near)):
            break
    noise, noisier, log_ratio = _noisier(far, detector.components)
    whole = float(np.logaddexp.reduce(since))
    of_beginning = float(np.max(since)) - whole + math.log(len(far))
    cost = dof + 2 * (unchanged - log_ratio - wrong - of_beginning)
    likely, moved = _weighed(watched, evidence, chosen, cost)
    began = noisier if likely[0].is_noise else np.exp(since - whole)
    ends = [readings.marks[i - 1] if i else before.mark for i in central(began)]
    if not any(one.is_noise and one.probability >= WATCH.likely for one in likely):
        noise = 1.0
    change = change * (not likely[0].is_noise)
    sums = detector.split(before, readings, int(np.argmax(began)), change, noise)
    return Change(likely, moved, ends[0], ends[1], noise, *sums)


def _weighed(
    watched: WatchedColumns, evidence: Evidence, chosen: list[Candidate], of_noise: float
) -> tuple[list[Likely], list[int]]:
    """Return what may have changed, and its columns; the cost of readings that only scatter more is given."""
    sets = [chosen, *([c] for c in evidence.candidates)]
    for equal in equals(evidence, chosen):
        sets.append([*(c for c in chosen if c not in equal.replaced), *equal.candidates])
    costs = {frozenset(map(id, one)): (evidence.cost(one), one) for one in sets if one}
    ranked = sorted([(of_noise + 2 * evidence.log_choices, []), *costs.values()], key=lambda each: each[0])
    weights = np.exp([(ranked[0][0] - cost) / 2 for cost, _ in ranked])
    likely, moved = list[Likely](), set[int]()
    for (cost, one), p in zip(ranked, (weights / weights.sum()).tolist(), strict=True):
        if cost < ranked[0][0] + COST.tied:
            order, sizes = _sized(evidence, one)
            several = watched.of(order)
            likely.append(_likely(several, sizes, p))
            moved |= {i for each in several for i in each.columns} if p >= WATCH.likely else set()
    return likely, sorted(moved)


def _likely(several: Sequence[Alternative], sizes: Estimated, probability: float) -> Likely:
    """Return effects that may have changed, for a report; none: readings scatter more."""
    changes = list[Estimate]()
    for one in several:
        for name, unit, factor in zip(one.candidate.short_names, one.units, one.factors, strict=True):
            key, i = f"{one.title} {name}" if len(several) > 1 else name, len(changes)
            value, std = float(sizes.theta[i] / factor), float(sizes.spread[i] / factor)
            changes.append(Estimate(key, unit, value, std, False, True))
    title = joined(one.title for one in several) or "noise"
    if len(several) == 1 and not several[0].adjusted:
        return Likely(title, *several[0].candidate.key, probability, tuple(changes))
    return Likely(title, None, None, probability, tuple(changes))


def _sized(evidence: Evidence, chosen: Sequence[Candidate]) -> tuple[list[Candidate], Estimated]:
    """Return a set in the order of its columns, as its sizes are."""
    order = sorted(chosen, key=lambda c: int(evidence.parts[id(c)][0]))
    return order, evidence.estimated(order)


def _loss(far: Array) -> Array:
    """Return half the squares of distances, at most that of a reading that is wrong."""
    return np.asarray(np.minimum(far, WRONG) ** 2 / 2)


def _noisier(far: Array, components: int) -> tuple[float, Array, float]:
    """Return the factor by which readings scatter more, when that began, and the logarithm of its likelihood ratio.

    A change of the noise by a factor f makes the loss m log f + z²/2f².
    """
    loss = components * np.log(NOISES) + _loss(far[:, None] / NOISES)
    since = np.cumsum((_loss(far)[:, None] - loss)[::-1], axis=0)[::-1]  # (n, factors)
    whole = float(np.logaddexp.reduce(since.ravel()))
    likely = np.exp(since - whole)
    return float(NOISES[np.argmax(likely.sum(axis=0))]), likely.sum(axis=1), whole - math.log(since.size)
