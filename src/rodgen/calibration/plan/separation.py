"""The fewest readings that tell effects apart, and with what probability they do.

Each effect in question is fitted to the data instead of the others, and the models are compared by pairs: of every
pair, one is taken for true and the other for wrong.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rodgen.calibration.fit import fitted
from rodgen.calibration.fitted import Fit
from rodgen.calibration.plan.constraints import Constraints
from rodgen.calibration.plan.design import Design, Linearized, Pair, linearized
from rodgen.calibration.plan.goals import MOST_READINGS, Gain, Goal
from rodgen.calibration.plan.pool import Planned, Pool
from rodgen.calibration.plan.rows import Rows
from rodgen.calibration.words import percent
from rodgen.errors import InputFileError, counted, joined
from rodgen.machines.machine import Effect
from rodgen.machines.observations import Observations
from rodgen.statistics.thresholds import PLAN, SELECTION

FEWEST = 2
"""Readings that are planned at least: nothing would contradict a single one."""
MANY = 60
"""Whether readings would ever be enough, and how many, is found from so many, each taken several times."""
FEWEST_RESIDUAL_DOF = 10
"""Degrees of freedom from which residuals larger than the stated noise replace it: with fewer, chance alone makes
their mean square half as large again (its relative standard deviation is the square root of 2/10)."""
MOST_DEPENDENT = 30.0
"""Dependent readings raise the variance of a mean by this factor at most; beyond, a fit went elsewhere."""
MOST_PAIRS = 3
"""Pairs of effects that a sentence names; the others are counted."""


@dataclass(frozen=True, eq=False)
class Rival:
    """A model with one of the effects in question."""

    title: str
    fit: Fit
    own: int
    """Number of its free parameters that belong to the effect."""


class Separation(Planned):
    """A plan of readings that tell effects apart.

    Parameters
    ----------
    fit : Fit
        Of the machine with or without these effects.
    o : Observations
        The data without outliers.
    alternatives : sequence of sequences of Effect
        Of each, one effect is there; the likeliest first.
    constraints : Constraints
    n : int
        Readings at most.
    trusted : bool
        Whether a diagnosis, which knows how readings depend on each other, says that the alternatives cannot be told
        apart: where they differ by more in independent readings, the readings are not independent.
    """

    def __init__(
        self,
        fit: Fit,
        o: Observations,
        alternatives: Sequence[Sequence[Effect]],
        constraints: Constraints,
        n: int,
        trusted: bool,
    ) -> None:
        self.o, self.notes = o, list[str]()
        self.rivals: list[Rival] = []
        groups = [self._fitted(fit, each, alternatives) for each in alternatives]
        effects = [e for each in alternatives for e in each]
        self.pool = Pool(self.rivals[0].fit if self.rivals else fit, o, effects, constraints)
        self.variance = self._variance(groups, trusted) if self.rivals else 1.0
        left = [
            [b for b in of if not any(self._worse(a, b) > self.variance * self._threshold(a, b) for a in of)]
            for of in groups
        ]
        pairs = [self._pair(a, b) for of in left for a, b in itertools.permutations(of, 2)]
        self.pairs, self.alike = self._resolvable(pairs) if pairs else ([], set())
        if self.pairs:
            self.rows = self._fewest(min(n, self.pool.rows.n))
        gains = dict(zip(self.pairs, self._gains(), strict=True))
        self.goals = [
            self._goal(each, of, some, gains)
            for each, of, some in zip(alternatives, groups, left, strict=True)
        ]

    # models --------------------------------------------------------------------------------------------------

    def _fitted(
        self, fit: Fit, group: Sequence[Effect], alternatives: Sequence[Sequence[Effect]]
    ) -> list[int]:
        """Fit a model with each effect of a group, and with the likeliest of the others; return their numbers."""
        bare, here = fit.machine, {e.identity for e in group}
        for place in {e.identity for each in alternatives for e in each} & {e.identity for e in bare.effects}:
            bare = bare.without_effect(*place)
        others = [each[0] for each in alternatives if here.isdisjoint(e.identity for e in each[:1])]
        fits = []
        for effect in {e.identity: e for e in group}.values():
            machine = bare
            try:
                for one in {e.identity: e for e in (*others, effect)}.values():
                    machine = machine.with_effect(one)
            except InputFileError as error:
                self.notes.append(f"{effect.title} is left out: {error.found}.")
                continue
            model = fitted(machine, self.o)
            count = sum(effect.owns(model.parameters[i].key) for i in model.free)
            fits.append(len(self.rivals))
            self.rivals.append(Rival(effect.title, model, count))
        return fits

    def _variance(self, groups: Sequence[Sequence[int]], trusted: bool) -> float:
        """Return the variance of a weighted residual: 1 where the noise is stated, or what the best model says."""
        left = [(r.fit.chi_square, r.fit.degrees_of_freedom) for r in self.rivals]
        cost, residual_dof = min(left, key=lambda x: x[0] / max(x[1], 1))
        stated = self.o.sigma is not None
        variance = cost / residual_dof if residual_dof >= (FEWEST_RESIDUAL_DOF if stated else 1) else 1.0
        variance = max(variance, 1.0) if stated else variance
        pairs = [pair for of in groups for pair in itertools.permutations(of, 2)] if trusted else []
        ratios = [self._worse(*pair) / variance / self._threshold(*pair) for pair in pairs]
        return variance * min(max([1.0, *ratios]), MOST_DEPENDENT)

    def _worse(self, a: int, b: int) -> float:
        """Return by how much model b fits the data worse than a, in chi-square."""
        return self.rivals[b].fit.chi_square - self.rivals[a].fit.chi_square

    def _threshold(self, a: int, b: int) -> float:
        """Return by how much b must fit worse than a to be refuted."""
        return SELECTION.parameter_cost(self.o.n) * max(self.rivals[a].own - self.rivals[b].own, 1)

    def _pair(self, a: int, b: int) -> Pair:
        """Return the pair of a true model and a wrong one."""
        threshold = self._threshold(a, b)
        root = PLAN.margin + math.sqrt(PLAN.margin**2 + threshold + PLAN.margin)
        return Pair(a, b, self._worse(a, b) / self.variance, root**2, threshold)

    # readings ------------------------------------------------------------------------------------------------

    def _at(self, rows: Rows, *, at_once: bool = False) -> list[Linearized]:
        readings = self.pool.surroundings.observations(rows, at_once=at_once)
        return linearized(
            [r.fit for r in self.rivals], readings, self.variance, () if at_once else self.models
        )

    def _resolvable(self, pairs: list[Pair]) -> tuple[list[Pair], set[frozenset[int]]]:
        """Return the pairs that readings can distinguish, and those that none do whichever of the two is true."""
        self.models = self._at(self.pool.rows, at_once=True)
        finite = [np.isfinite(x.jacobian).all((1, 2)) & np.isfinite(x.residual).all(1) for x in self.models]
        self.models = [x.take(np.all(finite, axis=0)) for x in self.models]
        self.pool.rows = self.pool.rows.take(np.all(finite, axis=0))
        picked = Design(self.models, pairs).chosen(min(MANY, self.pool.rows.n), sweeps=0)
        self.many, times = self._at(self.pool.ordered(picked)), MOST_READINGS / len(picked)
        short = {p for p in pairs if p.now + p.gain(self.many, times) < p.needed}
        # of a wrong one that includes the true one the evidence prefers the smaller
        larger = {p for p in short if self.rivals[p.wrong].own > self.rivals[p.true].own}
        alike = {p.models for p in short - larger}
        return [p for p in pairs if p not in larger and p.models not in alike], alike

    def _fewest(self, n: int) -> Rows:
        """Return the fewest readings that are enough, or n."""
        design = Design(self.models, self.pairs, sides=self.pool.over)
        tried: dict[int, Rows] = {}

        def enough(size: int) -> bool:
            tried[size] = self.pool.ordered(design.chosen(size))
            models = self._at(tried[size])
            return all(p.probability(models) >= 1 - PLAN.doubt for p in self.pairs)

        if enough(n):
            size = FEWEST + bisect_left(range(FEWEST, n), True, key=enough)
            return tried[min(size, n)]
        counts = range(n + 1, MOST_READINGS + 1)
        times = 1 / len(self.many[0].residual)

        def would_be(count: int) -> bool:
            return all(p.now + p.gain(self.many, count * times) >= p.needed for p in self.pairs)

        first = bisect_left(counts, True, key=would_be)
        self.needed = counts[first] if first < len(counts) else None
        return tried[n]

    def _gains(self) -> Iterator[Gain]:
        """Yield what the readings bring for each pair."""
        models = self._at(self.rows) if self.rows is not None else []
        for p in self.pairs:
            of = f"{self.rivals[p.true].title}, not {self.rivals[p.wrong].title}"
            after = p.now + p.gain(models)
            yield Gain("chi_square", of, p.now, after, p.threshold, p.probability(models))

    # words ---------------------------------------------------------------------------------------------------

    def _goal(
        self, effects: Sequence[Effect], group: Sequence[int], left: Sequence[int], every: dict[Pair, Gain]
    ) -> Goal:
        """Return the goal to distinguish alternatives, of which the data have left some."""
        title = {k: self.rivals[k].title for k in group}
        gains = {p: gain for p, gain in every.items() if p.models <= set(group)}
        alike = sorted(sorted(pair) for pair in self.alike if pair <= set(group))
        chances = [gain.probability or 0.0 for gain in gains.values()]
        reached = not alike and all(chance >= 1 - PLAN.doubt for chance in chances)
        sentences = []
        if gains:
            names = joined([title[k] for k in sorted({k for p in gains for k in p.models})])
            sentences = [
                f"Tell {names} apart{', except for the pairs below' if alike else ''}.",
                _chance(chances),
            ]
        if len(group) < 2:
            sentences.append(f"Fewer than two effects to tell apart: {joined([e.title for e in effects])}.")
        elif refuted := [title[k] for k in group if k not in left]:
            only = f"Only {title[left[0]]} remains: " if len(left) == 1 else ""
            sentences.append(
                f"{only}{joined(refuted)} fit{'s' * (len(refuted) == 1)} the data worse already."
            )
        if alike:
            texts = [f"{title[a]} and {title[b]}" for a, b in alike[:MOST_PAIRS]]
            if more := len(alike) - len(texts):
                texts.append(f"and {counted(more, 'more pair')}")
            sentences.append(
                f"No {MOST_READINGS} readings within reach would distinguish {'; '.join(texts)}."
            )
        of = tuple(e.title for e in effects)
        least = sorted(gains.values(), key=lambda gain: (gain.probability, gain.after))
        return Goal("separate", of, (), tuple(sentences), bool(gains), reached, tuple(least))

    def not_enough(self) -> Iterator[str]:
        """Yield how many readings would be enough, where these are not."""
        chances = [gain.probability or 0.0 for goal in self.goals for gain in goal.gains]
        if self.rows is None or min(chances) >= 1 - PLAN.doubt:
            return
        more = f"; about {self.needed} would be" if self.needed else f", and neither may {MOST_READINGS}"
        yield f"{self.rows.n} readings may not be enough{more}."


def _chance(chances: Sequence[float]) -> str:
    low, high = percent(min(chances), 1), percent(max(chances), 1)
    reached = min(chances) >= 1 - PLAN.doubt
    either = low if low == high or reached else f"{low} to {high}, depending on which is present"
    return f"Probability that these readings suffice: {either}."
