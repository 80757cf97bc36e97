"""The fewest readings that settle a question in one campaign, and what they bring for every goal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.plan.campaign import MOST_READINGS, Campaign
from rodgen.calibration.plan.design import SWEEPS, Linearized, Pair, Task, both_ways, chosen
from rodgen.calibration.plan.goals import Gain
from rodgen.calibration.plan.order import ordered, wrong_sides
from rodgen.calibration.plan.rows import Rows
from rodgen.statistics.thresholds import PLAN

FEWEST = 2
"""Readings that are planned at least: nothing would contradict a single one."""
SIZES = (3, 6, 12, 24, 48, 100, 200)
"""Sizes of plans that are tried one after the other, and then those between."""
EXCHANGES = 60
"""Number of readings that are exchanged in a large plan before it counts as good."""
FAR, MANY = 5, (60, 120)
"""How many readings would be enough is found from a plan this many times as large, within these limits."""


@dataclass(frozen=True)
class PairGain:
    """What a plan brings for a pair of models."""

    pair: Pair
    after: float
    """Expected chi-square."""
    probability: float
    """That it exceeds the threshold."""
    reached: bool
    """Whether that is likely enough."""


@dataclass(frozen=True, eq=False)
class CandidatePlan:
    """Readings to take in one campaign, as yet without words."""

    campaign: Campaign
    rows: Rows
    """In order."""
    gains: list[PairGain]
    parameters: list[Gain]
    """Standard deviations of all parameters in question."""
    needed: int | None
    """How many readings would be enough, where these are not."""

    @property
    def reached(self) -> bool:
        """Whether every pair is distinguished."""
        return all(gain.reached for gain in self.gains)

    @property
    def reached_as_far_as_possible(self) -> bool:
        """Whether every pair is distinguished that readings like these can distinguish."""
        return all(gain.reached for gain in self.gains if gain.pair.planned)

    @property
    def hopeless(self) -> bool:
        """Whether no pair is likely to be distinguished, and no parameter becomes determined."""
        likely = any(gain.pair.possible and gain.probability > PLAN.hopeless for gain in self.gains)
        return not likely and not any(gain.determined for gain in self.parameters)

    @property
    def settled(self) -> bool:
        """Whether some pair is distinguished, and every one that differs at all; or a parameter becomes determined."""
        if not self.gains:
            return any(gain.now is None and gain.determined for gain in self.parameters)
        differ = [gain for gain in self.gains if gain.pair.tiny or gain.pair.planned]
        return any(gain.reached for gain in self.gains) and all(gain.reached for gain in differ)

    @property
    def sharpest(self) -> float | None:
        """The part to which the standard deviation falls that falls most; None where one is not known, now or then."""
        if any(gain.now is None or gain.after is None for gain in self.parameters):
            return None
        return min(
            (gain.after / gain.now for gain in self.parameters if gain.now and gain.after), default=None
        )

    @property
    def worth(self) -> float:
        """How many wrong effects are refuted, in the mean over what may be true."""
        return sum(gain.pair.weight * gain.probability for gain in self.gains if gain.pair.planned)

    @property
    def wrong_sides(self) -> bool:
        """Whether the order brings a joint from another side than the most informative one."""
        return bool(len(wrong_sides(self.rows, self.campaign.choice.sides)))


def plan_campaign(campaign: Campaign, n: int, *, quick: bool = False) -> CandidatePlan:
    """Return a plan of n readings, or of fewer where they are enough; if quick, without how many would be."""
    return _PlanSearch(campaign).plan(n, quick=quick)


def rough_plan(campaign: Campaign, n: int) -> CandidatePlan:
    """Return a plan of n readings, chosen one after the other: what a campaign can bring."""
    return _PlanSearch(campaign).rough(n)


class _PlanSearch:
    """Searches for the fewest readings that distinguish the models; pairs that none does are given up on the way."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self._take(campaign.pairs)

    def _take(self, pairs: list[Pair]) -> None:
        """Make a task of the pairs that readings are planned for."""
        self.pairs = pairs
        self.task = Task(self.campaign.coordinates, [p for p in pairs if p.planned], self.campaign.sharpen)

    def plan(self, n: int, *, quick: bool) -> CandidatePlan:
        rows, needed = self._ordered([0]), None
        while self.task.pairs or self.task.sharpen:
            within = self._within(n)
            rows, needed = self._least(within, n), None
            if not self.task.pairs or quick or (within is self.task and self._missing(within, rows) <= 0):
                break
            more = self._many(n)
            needed = self._enough(more, n)
            if needed is not None or not self._give_up(more):
                break
        return self._candidate(rows, needed)

    def rough(self, n: int) -> CandidatePlan:
        return self._candidate(self._chosen(self.task, n, 0), None)

    def _within(self, n: int) -> Task:
        """Return the task without the pairs that n readings rather fail to distinguish, where others are left.

        For these, readings are not spent that would bring nothing: how many they take is said.
        """
        task = self.task
        models = self._linearized(self._chosen(task, n, 0))
        likely = [p for p in task.pairs if task.probability(p, models) > PLAN.hopeless]
        return Task(task.coordinates, likely, task.sharpen) if 0 < len(likely) < len(task.pairs) else task

    # readings ------------------------------------------------------------------------------------------------

    def _chosen(self, task: Task, count: int, sweeps: int) -> Rows:
        campaign = self.campaign
        count = min(count, len(campaign.pool.q))
        return self._ordered(
            chosen(task, campaign.linearized, campaign.moves, campaign.effort, count, sweeps=sweeps)
        )

    def _good(self, task: Task, n: int) -> Rows:
        """Return n readings, exchanged as long as is worthwhile."""
        count = min(n, len(self.campaign.pool.q))
        return self._chosen(task, n, max(1, min(SWEEPS, EXCHANGES // max(count, 1))))

    def _least(self, task: Task, n: int) -> Rows:
        """Return the fewest readings that are enough, or n."""
        if task.sharpen or not task.pairs:
            return self._good(task, n)
        failed, found = FEWEST - 1, []
        for size in (*(x for x in SIZES if x < n), n):
            rows = self._good(task, size)
            missing = self._missing(task, rows)
            found.append((missing, rows))
            if missing <= 0:
                break
            failed = size
        else:
            return next(rows for missing, rows in found if missing <= found[-1][0] + PLAN.idle)
        while size - failed > 1:
            middle = (size + failed) // 2
            fewer = self._good(task, middle)
            if self._missing(task, fewer) <= 0:
                size, rows = middle, fewer
            else:
                failed = middle
        return rows

    def _many(self, n: int) -> Rows:
        """Return enough readings that further ones would only repeat them."""
        return self._chosen(self.task, min(max(FAR * n, MANY[0]), MANY[1]), 0)

    def _enough(self, rows: Rows, n: int) -> int | None:
        """Return how many readings, n at least, would be enough, if each of these were taken so many times."""
        needed = np.array([p.needed for p in self.task.pairs])

        def enough(times: float) -> bool:
            return bool(np.all(self._chi_squares(rows, times) >= needed))

        low = high = n / rows.n
        while not enough(high):
            low, high = high, 2 * high
            if high * rows.n > MOST_READINGS:
                return None
        while high / low > 1.1:
            middle = math.sqrt(low * high)
            low, high = (low, middle) if enough(middle) else (middle, high)
        return math.ceil(high * rows.n)

    def _give_up(self, rows: Rows) -> bool:
        """Stop counting pairs that readings like these never distinguish, and return whether there were any."""
        after = self._chi_squares(rows, MOST_READINGS / rows.n)
        bad = {p for p, x in zip(self.task.pairs, after, strict=True) if x < p.needed}
        self._take(both_ways(replace(p, possible=p.possible and p not in bad) for p in self.pairs))
        return bool(bad)

    def _ordered(self, picked: Sequence[int]) -> Rows:
        campaign, o = self.campaign, self.campaign.o
        picked_rows = campaign.pool.take(np.array(picked))
        rows = ordered(picked_rows, campaign.sides, campaign.way, np.asarray(o.q[-1]))
        moved = rows.as_moved(np.asarray(o.q[-1]))
        stated = [f"dir_{joint.column}" in o.columns_given for joint in campaign.machine.joints]
        s = np.where(stated, rows.s, moved.s).astype(np.int8)
        return replace(moved, s=s, v=np.abs(moved.v) * s)

    # what they bring -----------------------------------------------------------------------------------------

    def _linearized(self, rows: Rows, times: float = 1.0) -> list[Linearized]:
        """Return each model for readings in their order, each taken several times."""
        campaign = self.campaign
        readings = campaign.surroundings.observations(rows)
        return campaign.rivals.linearized(campaign.models, readings, campaign.variance / times)

    def _chi_squares(self, rows: Rows, times: float) -> Array:
        """Return the chi-squares that readings bring, each taken several times."""
        now = np.array([p.now for p in self.task.pairs])
        return now + self.task.gains(self._linearized(rows, times))[0]

    def _missing(self, task: Task, rows: Rows) -> float:
        """Return by how much it is too likely that a wrong effect cannot be distinguished from the true one."""
        models = self._linearized(rows)
        chances = [task.probability(p, models) for p in task.pairs]
        return max(_doubts(task.pairs, chances).values(), default=0.0) - PLAN.doubt

    def _sure(self, group: int) -> float:
        """Return the probability that is planned for, so that all wrong alternatives fail at once."""
        return 1 - PLAN.doubt / max(len(self.campaign.groups[group]) - 1, 1)

    def _candidate(self, rows: Rows, needed: int | None) -> CandidatePlan:
        models = self._linearized(rows)
        task = Task(self.campaign.coordinates, self.pairs, self.campaign.sharpen)
        rises, _ = task.gains(models)
        chances = [task.probability(p, models) for p in self.pairs]
        planned = [(p, chance) for p, chance in zip(self.pairs, chances, strict=True) if p.planned]
        doubts = _doubts([p for p, _ in planned], [chance for _, chance in planned])
        settled = {group for group, doubt in doubts.items() if doubt <= PLAN.doubt}
        gains = [
            PairGain(
                p,
                float(p.now + rise),
                chance,
                p.possible and (p.group in settled or chance >= self._sure(p.group)),
            )
            for p, rise, chance in zip(self.pairs, rises, chances, strict=True)
        ]
        return CandidatePlan(self.campaign, rows, gains, self._parameters(models), needed)

    def _parameters(self, models: Sequence[Linearized]) -> list[Gain]:
        """Return the standard deviations that a fit states now, and is expected to state with planned readings."""
        campaign, number = self.campaign, self.campaign.key_model
        if number is None:
            return []
        fit = campaign.models[number].fit
        further = models[number].jacobian * np.sqrt(
            campaign.variance
        )  # of weighted readings, as a fit takes them
        expected = fit.estimates_with(further.reshape(-1, further.shape[-1]))
        found = []
        for key in campaign.question.keys:
            now, after = fit.estimates.get(key), expected.get(key)
            if now is None or after is None or key in campaign.unshown:
                found.append(Gain("std", key, None, None, determined=False))
                continue
            found.append(Gain("std", key, now.std, after.std, unit=now.unit, determined=after.determined))
        return found


def _doubts(pairs: Sequence[Pair], chances: Sequence[float]) -> dict[int, float]:
    """Return, for each group of alternatives, how likely a wrong one cannot be distinguished from the true one.

    Each of them is taken for the true one in turn.
    """
    missed: dict[int, dict[int, float]] = {}
    weights = {(p.group, p.true): p.weight for p in pairs}
    for p, chance in zip(pairs, chances, strict=True):
        of_group = missed.setdefault(p.group, {})
        of_group[p.true] = min(of_group.get(p.true, 0.0) + 1.0 - chance, 1.0)
    return {
        group: sum(weights[group, true] * doubt for true, doubt in each.items())
        for group, each in missed.items()
    }
