"""The fewest readings that settle a question, out of all positions within the travel, and what they bring.

The models in question are fitted to the data, and compared by pairs: of every pair, one is taken for true and the other
for wrong.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.plan.design import (
    PARTS,
    SWEEPS,
    Considered,
    Coordinates,
    Linearized,
    Pair,
    Sharpen,
    Task,
    both_ways,
    chosen,
)
from rodgen.calibration.plan.pool import Pool, levels
from rodgen.calibration.plan.rivals import Rival, Rivals
from rodgen.calibration.plan.rows import Rows, Surroundings, ordered
from rodgen.calibration.positions import distinct_positions, position_of
from rodgen.statistics.thresholds import DETERMINACY, PLAN, SELECTION

if TYPE_CHECKING:
    from rodgen.calibration.plan.question import Question
    from rodgen.machines.observations import Observations
    from rodgen.machines.parts import EffectIdentity

IDLE = 0.01
"""More readings are not worthwhile that raise the probability of telling effects apart by less."""
MOST_DEPENDENT = 30.0
"""Dependent readings raise the variance of a mean by this factor at most; beyond, a fit went elsewhere."""


MOST_READINGS = 500
"""No plan is made of more readings, and none is promised by more."""
EFFORT = 0.01
"""Cost, as a fraction of what is needed, of going where nothing was measured, of mounting a load, of a new target."""
FEWEST = 2
"""Readings that are planned at least: nothing would contradict a single one."""
SIZES = (3, 6, 12, 24, 48, 100, 200)
"""Sizes of plans that are tried one after the other, and then those between."""
EXCHANGES = 60
"""Number of readings that are exchanged in a large plan before it counts as good."""
FAR, MANY = 5, (60, 120)
"""How many readings would be enough is found from a plan this many times as large, within these limits."""
TRIED = 40
"""Numbers of readings from that of the plan to the most, of which the first that is enough is promised."""


class Campaign:
    """The models in question, and the readings that may be taken.

    Parameters
    ----------
    question : Question
    o : Observations
        The data without outliers.

    Attributes
    ----------
    models : list of Rival
        Those of all alternatives, and that of the parameters in question.
    titles : list of str
        Of the effect in question that each has.
    rows : Rows
        All readings that are considered.
    pairs : list of Pair
    refuted : list of (int, int)
        Number of the alternatives, and a model that the data refute.
    sharpen : list of Sharpen
    unshown : set of str
        Parameters in question that no reading shows.
    """

    def __init__(self, question: Question, o: Observations) -> None:
        self.question, self.machine, self.o = question, question.machine, o
        effects = {e.identity: e for each in question.alternatives for e in each}
        effects |= {e.identity: e for e in question.further if e.identity not in effects}
        self.rivals = Rivals(self.machine, o, list(effects.values()))
        self._fit_models()
        known = self.models[0].fit.problem.model.travel
        self.travel = question.constraints.travel(self.machine, known)
        self.variance = self.rivals.variance(self.models)
        if question.trusted:
            self.variance *= self._dependence()
        self._collect_readings()
        self.coordinates = [
            Coordinates(model.information / self.variance, o.n, linearized.jacobian)
            for model, linearized in zip(self.models, self.considered.models, strict=True)
        ]
        self._pair_models()
        self.sharpen, self.unshown = self._parameters()

    # models --------------------------------------------------------------------------------------------------

    def _fit_models(self) -> None:
        """Fit every model; that of the parameters in question is the one with the likeliest effects."""
        question, known = self.question, self.rivals.asked
        members = [[place for e in each if (place := e.identity) in known] for each in question.alternatives]
        first = [places[0] for places in members if places]
        self.models: list[Rival] = []
        self.titles: list[str] = []
        self.groups: list[list[int]] = []
        for places in members:
            others = {p for p in first if places and p != places[0]}
            self.groups.append([self._number({*others, place}, known[place].title) for place in places])
        further = {e.identity for e in question.further} & set(known)
        self.key_model = self._number({*first, *further}, "") if question.keys else None
        self.counted = {place for places in members for place in places} | further

    def _number(self, places: set[EffectIdentity], title: str) -> int:
        """Return the number of the model with some of the effects; it is fitted where there is none yet."""
        rival = self.rivals.rival(places)
        for k, (model, name) in enumerate(zip(self.models, self.titles, strict=True)):
            if model is rival and name in ("", title):
                self.titles[k] = title or name
                return k
        self.models.append(rival)
        self.titles.append(title)
        return len(self.models) - 1

    def worse_now(self, a: int, b: int) -> float:
        """Return by how much model b fits the data worse than a, in chi-square."""
        return (self.models[b].fit.chi_square - self.models[a].fit.chi_square) / self.variance

    def threshold(self, a: int, b: int) -> float:
        """Return by how much b must fit worse than a to be refuted."""
        return SELECTION.parameter_cost(self.o.n) * max(self.models[a].own - self.models[b].own, 1)

    def _dependence(self) -> float:
        """Return by what factor the variance of a reading must be larger for the data not to refute any alternative."""
        factor = 1.0
        for numbers in self.groups:
            plausible = [k for k in numbers if self.models[k].plausible]
            for a, b in itertools.permutations(plausible, 2):
                factor = max(factor, self.worse_now(a, b) / self.threshold(a, b))
        return min(factor, MOST_DEPENDENT)

    # readings ------------------------------------------------------------------------------------------------

    def _collect_readings(self) -> None:
        """Collect the readings that are considered, and linearize each model for them."""
        o, rivals, constraints = self.o, self.rivals, self.question.constraints
        uses = {kind: rivals.uses(kind, self.counted) for kind in "svTF"}
        for kind in "sv":  # a joint that cannot move comes from no side
            uses[kind] = [
                j for j in uses[kind] if np.ptp(self.travel[j]) > 0 and self.machine.joints[j].is_read
            ]
        choice = levels(o, sides=uses["s"], speeds=uses["v"], temperatures=uses["T"], load=bool(uses["F"]))
        if (listed := constraints.poses) is not None and "load" in listed.columns_given:
            choice = replace(choice, loads=tuple(np.unique(np.asarray(listed.load)).tolist()))
        self.surroundings = Surroundings(o)
        pool = Pool(self.models[0].fit, self.travel, choice, self.surroundings, constraints)
        rows = pool.readings()
        self.out_of_reach = pool.out_of_reach
        seen = self.surroundings.observations(rows, at_once=True)
        linearized = rivals.linearized(self.models, seen, self.variance)
        finite = np.all(
            [np.isfinite(x.jacobian).all((1, 2)) & np.isfinite(x.residual).all(1) for x in linearized], axis=0
        )
        self.rows = rows = rows.take(finite)
        one_sided = np.flatnonzero(
            np.abs(o.s.sum(axis=0, dtype=int)) == o.n
        )  # as measured: a change would be one more
        self.sides = tuple(sorted({*choice.sides, *one_sided.tolist()}))
        same = np.concatenate([rows.q, rows.s, rows.load[:, None], rows.state[:, None]], axis=1)
        q = np.asarray(o.q)
        new = np.any((rows.q < q.min(axis=0)) | (rows.q > q.max(axis=0)), axis=1).astype(float)
        new += ~np.isin(rows.target, o.target)
        if o.load is not None:
            new += ~np.isin(rows.load, o.load)
        self.considered = Considered(
            models=[x.take(finite) for x in linearized],
            effort=EFFORT * new,
            poses=np.unique(same, axis=0, return_inverse=True)[1].ravel(),
            parts=self._parts_of_travel(rows),
        )

    def _parts_of_travel(self, rows: Rows) -> NDArray[np.int_]:
        """Return in which part of their travel joints are, (n, k), of which an effect in question is a function.

        Where the data have many positions of a joint, further ones may be anywhere.
        """
        o, asked = self.o, self.rivals.asked
        names = {position_of(effect, o) for place, effect in asked.items() if place in self.counted}
        poses = len(np.unique(o.pose))
        of = [
            j
            for j, joint in enumerate(self.machine.joints)
            if joint.name in names
            and np.ptp(self.travel[j]) > 0
            and distinct_positions(np.asarray(o.q[:, j]), poses) is not None
        ]
        low, high = self.travel[of].T
        parts = (rows.q[:, of] - low) / (high - low) * PARTS
        return np.asarray(np.clip(parts, 0, PARTS - 1).astype(int))

    # what could be settled -----------------------------------------------------------------------------------

    def _pair_models(self) -> None:
        pairs: list[Pair] = []
        self.refuted: list[tuple[int, int]] = []
        for group, numbers in enumerate(self.groups):
            plausible = [a for a in numbers if self.models[a].plausible]
            left = [
                a
                for a in plausible
                if not any(self.worse_now(a, b) < -self.threshold(b, a) for b in plausible)
            ]
            self.refuted += [(group, a) for a in numbers if a not in left]
            found = [self._pair(group, a, b) for a, b in itertools.permutations(left, 2)]
            pairs += [pair for pair in found if pair is not None]
        self.pairs = both_ways(pairs)

    def _pair(self, group: int, a: int, b: int) -> Pair | None:
        """Return the pair of a true model and a wrong one; None where the wrong one is larger and includes the true."""
        true, wrong = self.models[a], self.models[b]
        now, threshold = self.worse_now(a, b), self.threshold(a, b)
        root = PLAN.margin + np.sqrt(PLAN.margin**2 + threshold + PLAN.margin)
        pair = Pair(a, b, now, float(root**2), threshold, group)
        alone = Task(self.coordinates, [pair], [])
        gain = float(alone.gains(self.considered.models)[0][0]) * max(1.0, MOST_READINGS / self.rows.n)
        possible = now + gain >= pair.needed
        return None if not possible and wrong.own > true.own else replace(pair, possible=bool(possible))

    def _parameters(self) -> tuple[list[Sharpen], set[str]]:
        """Return the parameters to sharpen, and those in question that no reading shows."""
        if self.key_model is None:
            return [], set()
        model, unseen = self.models[self.key_model], self.coordinates[self.key_model].unseen
        numbers = {model.fit.parameters[i].key: k for k, i in enumerate(model.index)}
        rests = np.abs(unseen).max(axis=1, initial=0.0) > DETERMINACY.rests
        changing = np.any(self.coordinates[self.key_model].root, axis=1)
        keys = self.question.keys
        shown = [key for key in keys if key in numbers and not rests[numbers[key]]]
        if not shown and self.question.by_default:  # the model as a whole, in these coordinates
            some = [key for key in keys if key in numbers and changing[numbers[key]]]
        else:
            some = shown
        return [Sharpen(self.key_model, numbers[key], key) for key in some], set(keys) - set(shown)


@dataclass(frozen=True)
class PairGain:
    """What a plan brings for a pair of models."""

    pair: Pair
    after: float
    """Expected chi-square."""
    probability: float
    """That it exceeds the threshold."""

    @property
    def reached(self) -> bool:
        """Whether that is likely enough."""
        return self.pair.possible and self.probability >= 1 - PLAN.doubt


class Search:
    """Searches for the fewest readings that distinguish the models; pairs that none does are given up on the way.

    Parameters
    ----------
    campaign : Campaign
    n : int
        Readings at most.

    Attributes
    ----------
    rows : Rows
        What was found, in the order in which the readings are to be taken.
    needed : int or None
        How many readings would be enough, where these are not.
    linearized : list of Linearized
        Each model for these readings.
    """

    def __init__(self, campaign: Campaign, n: int) -> None:
        self.campaign = campaign
        self._take(campaign.pairs)
        self.rows, self.needed = self._least(n), None
        if self.task.pairs and self._missing(self.task, self.rows) > 0:
            # further readings than these would only repeat them
            many = self._chosen(self.task, min(max(FAR * n, MANY[0]), MANY[1]), 0)
            if self._give_up(many):
                self.rows = self._least(n)
            self.needed = self._enough(many, n) if self.task.pairs else None
        self.linearized = self._linearized(self.rows)

    def _take(self, pairs: list[Pair]) -> None:
        """Make a task of the pairs that readings are planned for."""
        self.pairs = pairs
        self.task = Task(self.campaign.coordinates, [p for p in pairs if p.possible], self.campaign.sharpen)

    # readings ------------------------------------------------------------------------------------------------

    def _least(self, n: int) -> Rows:
        """Return the fewest readings that are enough, or n."""
        task = self._within(n)
        if not task.pairs:
            return self._good(task, n) if task.sharpen else self._ordered([0])
        if task.sharpen:
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
            return next(rows for missing, rows in found if missing <= found[-1][0] + IDLE)
        while size - failed > 1:
            middle = (size + failed) // 2
            fewer = self._good(task, middle)
            if self._missing(task, fewer) <= 0:
                size, rows = middle, fewer
            else:
                failed = middle
        return rows

    def _within(self, n: int) -> Task:
        """Return the task without the pairs that n readings rather fail to distinguish, where others are left.

        For these, readings are not spent that would bring nothing: how many they take is said.
        """
        task = self.task
        models = self._linearized(self._chosen(task, n, 0)) if task.pairs else []
        likely = [p for p in task.pairs if task.probability(p, models) > PLAN.hopeless]
        return Task(task.coordinates, likely, task.sharpen) if 0 < len(likely) < len(task.pairs) else task

    def _good(self, task: Task, n: int) -> Rows:
        """Return n readings, exchanged as long as is worthwhile."""
        return self._chosen(task, n, max(1, min(SWEEPS, EXCHANGES // min(n, self.campaign.rows.n))))

    def _chosen(self, task: Task, n: int, sweeps: int) -> Rows:
        campaign = self.campaign
        return self._ordered(chosen(task, campaign.considered, min(n, campaign.rows.n), sweeps=sweeps))

    def _ordered(self, picked: Sequence[int]) -> Rows:
        campaign, o = self.campaign, self.campaign.o
        start = np.asarray(o.q[-1])
        span = np.ptp(campaign.travel, axis=1)
        rows = ordered(campaign.rows.take(np.array(picked)), campaign.sides, span, start)
        moved = rows.as_moved(start)
        stated = [f"dir_{joint.column}" in o.columns_given for joint in campaign.machine.joints]
        s = np.where(stated, rows.s, moved.s).astype(np.int8)
        return replace(moved, s=s, v=np.abs(moved.v) * s)

    def _enough(self, rows: Rows, n: int) -> int | None:
        """Return how many readings, n at least, would be enough, if each of these were taken so many times."""
        needed = np.array([p.needed for p in self.task.pairs])
        for count in np.geomspace(n, MOST_READINGS, TRIED):
            if np.all(self._chi_squares(rows, count / rows.n) >= needed):
                return math.ceil(float(count) - 1e-9)
        return None

    def _give_up(self, rows: Rows) -> bool:
        """Stop counting pairs that readings like these never distinguish, and return whether there were any."""
        after = self._chi_squares(rows, MOST_READINGS / rows.n)
        bad = {p for p, x in zip(self.task.pairs, after, strict=True) if x < p.needed}
        self._take(both_ways(replace(p, possible=p.possible and p not in bad) for p in self.pairs))
        return bool(bad)

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
        return 1 - PLAN.doubt - min((task.probability(p, models) for p in task.pairs), default=1.0)

    def gains(self) -> list[PairGain]:
        """Return what the readings that were found bring for each pair."""
        task = Task(self.campaign.coordinates, self.pairs, [])
        rises, _ = task.gains(self.linearized)
        return [
            PairGain(p, float(p.now + rise), task.probability(p, self.linearized))
            for p, rise in zip(self.pairs, rises, strict=True)
        ]
