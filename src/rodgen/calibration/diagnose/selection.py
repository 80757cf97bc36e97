"""Which candidates together explain the residuals, in the space of their columns.

Forward: the candidate that chance imitates least, as long as that is improbable over all of them and errors on poses
left out fall noticeably. Backward: what the others explain as well is removed again; and up to three of the set, or
none, are exchanged for a single other, any two, or one effect at several joints, where these do better. An effect with
few parameters is preferred to one with more that does the same: the larger one must lower chi-square by
`SelectionPolicy.parameter_cost` for each further parameter, and by more than the little by which real effects differ
from formulas.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.checks.positions import position_of
from rodgen.calibration.diagnose.candidate_space import CandidateSpace, Score
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.clusters import Clusters
from rodgen.calibration.diagnose.held_out_blocks import Blocks
from rodgen.machines.effects.catalogue import OFFSETS, SCALES, WINDUPS
from rodgen.machines.effects.plausibility import BALANCED, Plausibility
from rodgen.statistics.columns import ColumnSpace, unit_columns
from rodgen.statistics.thresholds import SELECTION

__all__ = ["Selection", "follows_time", "of_one_leg"]

Array: TypeAlias = NDArray[np.float64]

SHARED = OFFSETS | SCALES | WINDUPS
"""Effects that a machine has at several joints if it has them at one: further ones need no evidence of their kind."""


@dataclass(frozen=True)
class Selection:
    """Stepwise selection of candidates: forward, exchange, backward.

    Attributes
    ----------
    space : CandidateSpace
    blocks : Blocks
        Of poses, for the error on poses left out.
    rows : int
    clusters : Clusters
        Of readings of one pose.
    stretches : Blocks or None
        Of time, where the set-up wanders: what follows the time must predict stretches of it that it did not see.
    level : float
        Rate of false alarms.
    balanced : bool
        Whether weight may turn any joint upwards, as a counterweight or a spring makes it do.
    """

    space: CandidateSpace
    blocks: Blocks
    rows: int
    clusters: Clusters
    stretches: Blocks | None = None
    level: float = SELECTION.family_wise
    balanced: bool = False
    _tests: dict[frozenset[tuple[str, str | None]], float] = field(default_factory=dict, repr=False)

    def run(self) -> list[Candidate]:
        """Return the candidates that explain the residuals, in the order of adding."""
        included = self._forward([])
        for _ in range(3):
            better = self._exchanged(included)
            better = self._backward(better)
            more = self._forward(better)
            if [c.key for c in more] == [c.key for c in included]:
                break
            included = more
        included = self._of_one_cause(included)
        included = self._likeliest(included)
        return self.pruned(self._ordered(included))

    def pruned(self, included: Sequence[Candidate]) -> list[Candidate]:
        """Return the candidates needed given all others: beyond chance, and with a lower error on poses left out."""
        kept = self._backward(list(included))
        while kept and (impossible := self.impossible(kept)):
            kept.remove(impossible[-1])
        for candidate in list(reversed(kept)):
            others = [c for c in kept if c is not candidate]
            if not self._lowers(others, candidate):
                kept = others
        return kept

    # forward -------------------------------------------------------------------------------------------------

    def _forward(self, included: list[Candidate]) -> list[Candidate]:
        included = list(included)
        while len(included) < SELECTION.most_steps:
            best = self.best(included)
            if best is None or not self.is_worth(included, best):
                break
            included.append(best.candidate)
        return included

    def best(self, included: Sequence[Candidate]) -> Score | None:
        """Return the candidate to add next, None where chance explains as much."""
        left = self.left(included)
        scores = self.space.scores(self.residual, left, included)
        if not scores:
            return None
        tests = self.tests(included)
        # Stricter with each step: each may be wrong, and the model is less exact.
        level = np.log(self.level / (1 + len(included)))
        real = [s for s in scores if s.dof and s.log_p + np.log(tests) - self.log_weight(s.candidate) < level]
        real.sort(key=lambda s: s.log_p - s.candidate.prior.log_odds)
        while real:
            best = self._simplest(real)
            possible = best.candidate not in self.impossible([*included, best.candidate], best.left)
            if possible and self._is_beyond_chance(included, best.candidate):
                return best
            real.remove(best)
        return None

    def _simplest(self, real: Sequence[Score]) -> Score:
        """Return the first of the scores, or the simplest that explains nearly as much."""
        first = real[0]
        variance = first.left / max(first.residual_dof, 1)
        needed = SELECTION.parameter_cost(self.rows) * variance

        def alike(score: Score) -> bool:
            saved = first.parameters - score.parameters
            return saved > 0 and first.fall - score.fall < max(needed * saved, SELECTION.alike * first.fall)

        simpler = [s for s in real if alike(s)]
        return min(simpler, key=lambda s: (s.parameters, -s.fall)) if simpler else first

    def is_worth(self, included: Sequence[Candidate], best: Score) -> bool:
        """Return whether a candidate noticeably lowers the error, beyond an imperfection of an included formula."""
        here = [c for c in included if _related(c, best.candidate)]
        if here:
            others = [c for c in included if not _related(c, best.candidate)]
            explained = self.left(others) - self.left(included)
            if best.fall < SELECTION.imperfect**2 * explained:
                return False
        return self._is_needed(included, best.candidate)

    def _log_p_with_wander(self, included: Sequence[Candidate], candidate: Candidate) -> float:
        """Return the logarithm of the probability that chance explains as much, where the wander counts as noise.

        How a set-up wanders is estimated from the same residuals, and once it is taken out some period always fits what
        remains: an effect with a searched value must be seen without that.
        """
        if self.stretches is None or not candidate.searched:
            return -np.inf
        N = len(self.blocks.residual)
        flat = [self.blocks.model, *(c.columns.reshape(N, -1) for c in included)]
        base = ColumnSpace.of(flat)
        visible = base.visible_part(unit_columns(candidate.columns.reshape(N, -1)), SELECTION.visible)
        test = base.score_test(base.project_out(self.blocks.residual), visible)
        return 0.0 if test is None else test.log_p + float(np.log(candidate.tries))

    def _lowers(self, included: Sequence[Candidate], candidate: Candidate) -> bool:
        """Return whether a candidate noticeably lowers the error on poses left out."""
        kinds = [self.blocks]
        if self.stretches is not None and follows_time(candidate):
            kinds.append(self.stretches)
        if joint := position_of(candidate.effect, self.blocks.observations):
            kinds += filter(None, [self.blocks.by_position(joint)])
        more = [c.columns for c in (*included, candidate)]
        return all(
            blocks.held_out(more) < (1 - SELECTION.noticed) * blocks.held_out(more[:-1]) for blocks in kinds
        )

    def left(self, included: Sequence[Candidate]) -> float:
        """Return the residual sum of squares with some candidates in the model."""
        base = self.space.base(included)
        along = base.basis.T @ self.residual
        return max(self.total - float(along @ along), 1e-12 * self.total)

    # backward ------------------------------------------------------------------------------------------------

    def _backward(self, included: list[Candidate]) -> list[Candidate]:
        """Return the effects without those that the others explain as well; the least significant is removed first."""
        included = list(included)
        while included:
            worst, chance = None, np.log(self.level)
            for candidate in included:
                others = [c for c in included if c is not candidate]
                log = self._log_doubt(others, candidate)
                if log > chance:
                    worst, chance = candidate, log
            if worst is None:
                break
            included.remove(worst)
        return included

    def _is_needed(self, others: Sequence[Candidate], candidate: Candidate) -> bool:
        """Return whether a candidate, given others, explains more than chance does, on poses left out, too."""
        return self._is_beyond_chance(others, candidate) and self._lowers(others, candidate)

    def _is_beyond_chance(self, others: Sequence[Candidate], candidate: Candidate) -> bool:
        return bool(self._log_doubt(others, candidate) < np.log(self.level))

    def _log_doubt(self, others: Sequence[Candidate], candidate: Candidate) -> float:
        """Return what must be below the logarithm of the rate of false alarms.

        It is `log_p`, where the likelier effects before the data have a larger share of the false alarms, and sizes far
        beyond the usual one a smaller share.
        """
        log = self.log_p(others, candidate) - self.log_weight(candidate)
        if log >= np.log(self.level):
            return log
        values, _ = self._estimates_at([*others, candidate])[-1]
        return log + candidate.prior.size_cost(candidate.short_names, values) / 2

    def log_p(self, others: Sequence[Candidate], candidate: Candidate) -> float:
        """Return the logarithm of the probability that chance explains as much as an effect, given others.

        It holds for any of the candidates: it is multiplied by the number of independent tests. Where weights wind
        up joints, it must hold with a weight at every later joint, too: what the fit takes in is only what the data
        call for, and all parts weigh something.
        """
        log = max(self._log_p(given, candidate) for given in self._with_weights(others))
        tests = self.tests(others)
        name = candidate.effect.name
        if name in SHARED and any(c.effect.name == name for c in others):
            # what yields at one joint yields at others: there is not much to choose from
            tests = min(tests, len({c.key for c in self.space.candidates if c.effect.name == name}))
        return min(log + float(np.log(tests)), 0.0)

    def _log_p(self, others: Sequence[Candidate], candidate: Candidate) -> float:
        """Return the logarithm of the probability that chance explains as much as this one effect, given others."""
        score = self.space.score(others, self.residual, self.left(others), candidate)
        if not score.dof:
            return 0.0
        log = score.log_p + self.clusters.penalty([c.columns for c in others], candidate.columns)
        return max(log, self._log_p_with_wander(others, candidate))

    def _with_weights(self, included: Sequence[Candidate]) -> Iterator[Sequence[Candidate]]:
        """Yield the effects, and the same with a weight at every later joint that has a lever arm."""
        yield included
        most = {c.key: c for c in self.space.candidates if c.later_weights}  # the last one has all of them
        every = [most.get(c.key, c) for c in included]
        if any(map(operator.is_not, every, included)):
            yield every

    def log_weight(self, candidate: Candidate) -> float:
        """Return the logarithm of a candidate's share of the false alarms, compared with that of all alike.

        The likelier before the data, the larger; the mean of the shares is 1, so that the rate of false alarms over all
        of them is kept (Genovese, Roeder, Wasserman 2006, weighted Bonferroni).
        """
        return min(candidate.prior.log_odds, 0.0) - self._mean_odds

    @cached_property
    def _mean_odds(self) -> float:
        """The logarithm of the mean of the odds of all candidates."""
        odds = {c.key: min(np.exp(c.prior.log_odds), 1.0) for c in self.space.candidates}
        return float(np.log(np.mean(list(odds.values()))))

    def _odds_cost(self, included: Sequence[Candidate]) -> float:
        """Return what the odds of candidates before the data, over their mean, cost in units of chi-square.

        Where most are unlikely, as on a telescope, there is less to choose from, and two likely ones may cost no more
        than an unlikely one.
        """
        return -2 * sum(c.prior.log_odds - self._mean_odds for c in included)

    def tests(self, included: Sequence[Candidate]) -> float:
        """Return the number of independent tests that all candidates amount to, given those included."""
        key = frozenset(c.key for c in included)
        if key not in self._tests:
            scores = self.space.scores(np.zeros(len(self.space.model)), 1.0, included)
            self._tests[key] = self.space.tests(scores, included)
        return self._tests[key]

    # exchange ------------------------------------------------------------------------------------------------

    def _exchanged(self, included: list[Candidate]) -> list[Candidate]:
        """Return the effects after exchanging up to three for one, two or a group, while that lowers `cost`."""
        best = list(included)
        for _ in range(SELECTION.most_steps):
            cost = self.cost(best, best)
            cheaper = [
                (new, i, kept, tried)
                for i, (kept, tried) in enumerate(self._exchanges(best, cost))
                if (new := self.cost(tried, best)) < cost - 1e-6
            ]
            needed = (
                tried
                for *_, kept, tried in sorted(cheaper)
                if all(
                    self._is_needed([c for c in tried if c is not new], new)
                    for new in tried
                    if new not in kept
                )
            )
            if (found := next(needed, None)) is None:
                break
            best = found
        return best

    def _exchanges(
        self, best: list[Candidate], cost: float
    ) -> Iterator[tuple[list[Candidate], list[Candidate]]]:
        """Yield what is kept of a set, and sets with something else in the place of the rest that may cost less."""
        for count in range(min(len(best), SELECTION.most_exchanged) + 1):
            for gone in combinations(best, count):
                kept = [c for c in best if c not in gone]
                for tried in self._in_their_place(kept, gone, best, cost):
                    yield kept, tried

    def _in_their_place(
        self,
        kept: list[Candidate],
        gone: Sequence[Candidate],
        best: Sequence[Candidate],
        most: float,
    ) -> Iterator[list[Candidate]]:
        """Yield the sets with one candidate, two, or a physical group in the place of those that are gone."""
        left = self.left(kept)
        scores = [s for s in self.space.scores(self.residual, left, kept) if s.dof]
        for score in scores[: SELECTION.rivals] if gone else ():
            tried = [*kept, score.candidate]
            if score.candidate in gone:
                continue
            rank = self.space.base(kept).rank + score.dof
            if self._least_cost(tried, best, score.left, rank) < most:
                yield tried
        if len(kept) + 2 <= SELECTION.most_steps and len(scores) > 1:
            before, variance = self.cost(kept, best), self._variance(best)
            falls = self.space.pair_falls(self.residual, scores, kept) / variance
            each = SELECTION.parameter_cost(self.rows)
            dear = np.array([each * s.parameters + self._odds_cost([s.candidate]) for s in scores])
            costs = np.where(
                np.triu(np.ones_like(falls), 1) > 0, before - falls + dear + dear[:, None], np.inf
            )
            for k in np.argsort(costs, axis=None)[: SELECTION.pairs]:
                i, j = np.unravel_index(k, costs.shape)
                if not costs[i, j] < most:
                    break
                if not {scores[i].candidate, scores[j].candidate} & set(gone):
                    yield [*kept, scores[i].candidate, scores[j].candidate]
        for name in SHARED:
            members = [s.candidate for s in scores if s.candidate.effect.name == name]
            if len(members) > 1 and len(gone) in {0, len(best)}:
                yield self._cheapest(kept, members[: SELECTION.most_steps - len(kept)], best)

    def _cheapest(
        self,
        kept: list[Candidate],
        members: list[Candidate],
        best: Sequence[Candidate],
    ) -> list[Candidate]:
        """Return a set with those of a group's members that are worth their cost together."""
        found = [*kept, *members]
        cost = self.cost(found, best)
        while len(found) > len(kept):
            fewer = [[c for c in found if c is not member] for member in found[len(kept) :]]
            costs = [self.cost(some, best) for some in fewer]
            if not min(costs) < cost:
                break
            found, cost = fewer[int(np.argmin(costs))], min(costs)
        return found

    def _of_one_cause(self, included: list[Candidate]) -> list[Candidate]:
        """Return the effects with two of legs replaced by a single one where these only imitate it.

        What displaces a leg's end or changes its length does nearly the same all over a small workspace, so that two of
        these imitate a third: what one of them leaves falls to another, there or at another leg. One cause is likelier
        than two: it may have a parameter more.
        """
        for gone in combinations(included, 2):
            if not all(map(_is_of_a_leg, gone)):
                continue
            kept = [c for c in included if c not in gone]
            legs = {c.effect.place for c in gone}
            alone = [
                [*kept, c]
                for c in self.space.candidates
                if _is_of_a_leg(c) and c.effect.place in legs and c not in gone
            ]
            most, rank = self.cost(included, included), self.space.base(included).rank
            each = SELECTION.parameter_cost(self.rows)
            costs = [self.cost(some, included) - each * (self.space.base(some).rank > rank) for some in alone]
            if costs and min(costs) < most:
                return self._of_one_cause(alone[int(np.argmin(costs))])
        return included

    def cost(self, included: Sequence[Candidate], best: Sequence[Candidate]) -> float:
        """Return chi-square, in variances that the best set leaves, plus what parameters, odds and sizes cost."""
        least = self._least_cost(included, best, self.left(included), self.space.base(included).rank)
        return least + self._size_cost(self._variance(best), included)

    def _least_cost(
        self, included: Sequence[Candidate], best: Sequence[Candidate], left: float, rank: int
    ) -> float:
        """Return the same as `cost` but for what sizes cost, of a set that leaves so much and has such a rank."""
        own = rank + sum(len(c.searched) for c in included)
        shared = SELECTION.parameter * self._shared(included)
        left = max(left, self._bent) / self._variance(best)
        return float(left + SELECTION.parameter_cost(self.rows) * own - shared + self._odds_cost(included))

    def _variance(self, best: Sequence[Candidate]) -> float:
        """Return the variance of a reading that a set leaves, as far as columns are right."""
        return self.variance(best, max(self.left(best), self._bent))

    @property
    def _bent(self) -> float:
        """The part of what is explained that columns of large effects get wrong."""
        return SELECTION.bent**2 * self.left([])

    def _shared(self, included: Sequence[Candidate]) -> int:
        """Return the number of parameters of effects that a machine has at several joints if it has them at one.

        Weights at later joints are not counted.
        """
        count = 0
        for name in SHARED:
            sizes = [
                max(self.space.across((), c).shape[1] - c.later_weights, 0)
                for c in included
                if c.effect.name == name
            ]
            count += sum(sizes) - max(sizes, default=0)
        return count

    def or_balanced(self, chosen: list[Candidate]) -> tuple[Selection, list[Candidate]]:
        """Return the selection and what it chose, or one in which weight may turn joints upwards, if much likelier."""
        balanced = replace(self, balanced=True)
        if any(balanced._is_balanced(given) for given in ([], chosen)):
            better = balanced.run()
            if balanced._is_likelier(better, chosen):
                return balanced, better
        return self, chosen

    def balanced_with(self, candidate: Candidate, chosen: Sequence[Candidate]) -> Selection | None:
        """Return a selection in which weight may turn joints upwards if what it allows is much likelier; else None.

        Parameters
        ----------
        candidate : Candidate
            An effect of the wrong sign.
        chosen : sequence of Candidate
            What was chosen, with it.
        """
        balanced = replace(self, balanced=True)
        if candidate.effect.name in BALANCED and balanced._is_likelier(chosen, self.without(candidate).run()):
            return balanced
        return None

    def _is_likelier(self, better: Sequence[Candidate], other: Sequence[Candidate]) -> bool:
        """Return whether a set in which weight turns joints upwards is much likelier than another."""
        return self.cost(other, better) - self.cost(better, better) > SELECTION.balanced

    @cached_property
    def _coordinates(self) -> tuple[Array, float]:
        """Coordinates of the residuals of the model as it was, and their whole sum of squares."""
        return self.space.residual(self.clusters.residual)

    @property
    def residual(self) -> Array:
        """Coordinates of the residuals of the model as it was."""
        return self._coordinates[0]

    @property
    def total(self) -> float:
        """Their whole sum of squares."""
        return self._coordinates[1]

    def without(self, candidate: Candidate) -> Selection:
        """Return the selection without an effect."""
        return replace(self, space=self.space.without({candidate.key}), _tests={})

    def _is_balanced(self, given: list[Candidate]) -> bool:
        """Return whether weight seems to turn a joint upwards where some candidates are in the model."""
        weights = [c for c in self.space.candidates if c.effect.name in BALANCED and c not in given]
        return any(
            not c.prior.is_possible(c.short_names, *self._estimates_at([*given, c])[-1])
            and self.log_p(given, c) < np.log(self.level)
            for c in weights
        )

    # what is known before the data ------------------------------------------------------------------------------

    def estimates(self, variance: float, included: Sequence[Candidate]) -> list[tuple[Array, Array]]:
        """Return the linear estimates of each candidate's parameters with their standard deviations, internal units.

        What the data hardly determine is held within some usual sizes.

        Parameters
        ----------
        variance : float
            Of a reading.
        included : sequence of Candidate

        Returns
        -------
        list of (ndarray, ndarray), each of shape (k,)
        """
        if not included:
            return []
        sizes = [self.space.sizes(c) for c in included]
        units = []
        for c, size in zip(included, sizes, strict=True):
            usual, own = SELECTION.shrunk * c.prior.usual(c.short_names), np.where(size > 0, size, 1.0)
            # without a usual size: a million standard deviations
            units.append(np.where(np.isfinite(usual), usual, 1e6 * np.sqrt(variance) / own))
        ends = np.cumsum([len(unit) for unit in units])[:-1]
        unit = np.concatenate(units)
        columns = np.concatenate(
            [self.space.columns(c) * s for c, s in zip(included, sizes, strict=True)], axis=1
        )
        base = self.space.base()
        across = base.project_out(columns) * unit
        covariance = np.linalg.inv(across.T @ across / variance + np.eye(len(unit)))
        values = -unit * (covariance @ (across.T @ base.project_out(self.residual))) / variance
        std = unit * np.sqrt(covariance.diagonal())
        return list(zip(np.split(values, ends), np.split(std, ends), strict=True))

    def prior_of(self, candidate: Candidate) -> Plausibility:
        """Return what is known of a candidate before the data."""
        lifted = self.balanced and candidate.effect.name in BALANCED
        return candidate.prior.of_any_sign if lifted else candidate.prior

    def prior_cost(self, variance: float, included: Sequence[Candidate]) -> float:
        """Return what candidates cost in units of chi-square by what is known before the data; inf if impossible."""
        return self._size_cost(variance, included) - 2 * sum(c.prior.log_odds for c in included)

    def _size_cost(self, variance: float, included: Sequence[Candidate]) -> float:
        """Return what their sizes cost in units of chi-square; inf if impossible."""
        return sum(
            c.prior.size_cost(c.short_names, values)
            if self.prior_of(c).is_possible(c.short_names, values, std)
            else np.inf
            for c, (values, std) in zip(included, self.estimates(variance, included), strict=True)
        )

    def impossible(self, included: Sequence[Candidate], left: float | None = None) -> list[Candidate]:
        """Return the candidates that have, together with the others, a size or a sign that no machine has.

        Parameters
        ----------
        included : sequence of Candidate
        left : float, optional
            What they leave.
        """
        found = zip(included, self._estimates_at(included, left), strict=True)
        return [c for c, estimates in found if not self.prior_of(c).is_possible(c.short_names, *estimates)]

    def _estimates_at(
        self, included: Sequence[Candidate], left: float | None = None
    ) -> list[tuple[Array, Array]]:
        """Return the estimates with the variance that the candidates leave together."""
        return self.estimates(self.variance(included, left), included)

    def variance(self, included: Sequence[Candidate], left: float | None = None) -> float:
        """Return the variance of a reading that candidates leave together."""
        left = self.left(included) if left is None else left
        return left / max(self.space.readings - self.space.base(included).rank, 1)

    def _likeliest(self, included: Sequence[Candidate]) -> list[Candidate]:
        """Return the effects, each exchanged for the likeliest of those that the data cannot tell from it."""
        found = list(included)
        left, variance = self.left(found), self.variance(found)
        for k, own in enumerate(included):
            others = [c for c in found if c is not found[k]]
            without = self.left(others)
            dof = self.space.across(others, own).shape[1] + len(own.searched)
            before = self.prior_cost(variance, found)
            best = 0.0
            for score in self.space.scores(self.residual, without, others)[: SELECTION.rivals]:
                difference = (score.left - left) / variance
                if score.candidate.key == own.key or not self.are_alike(difference, score.parameters - dof):
                    continue
                tried = [*found[:k], score.candidate, *found[k + 1 :]]
                prior = self.prior_cost(variance, tried) - before
                prior += self.width_cost(variance, others, score.candidate)
                prior -= self.width_cost(variance, others, own)
                cost = self.preference(difference, (without - left) / variance, prior)
                if cost < best and self._is_needed(others, score.candidate):
                    best, found = cost, tried
        return found

    def are_alike(self, difference: float, further: int) -> bool:
        """Return whether the data cannot tell two effects apart.

        Parameters
        ----------
        difference : float
            By how much chi-square is larger with the other one.
        further : int
            Parameters that the other one has more.
        """
        each = SELECTION.parameter_cost(self.rows)
        return -each * max(further, 1) < difference < each * max(-further, 1)

    def width_cost(self, variance: float, others: Sequence[Candidate], candidate: Candidate) -> float:
        """Return what an effect's parameters cost in units of chi-square: how much narrower the data make them.

        It is -2 ln of the part of the values before the data, of the usual sizes, that remain after them (Laplace's
        approximation of the evidence); ln(rows), as of Schwarz, for one that has no usual size or was searched.

        Parameters
        ----------
        variance : float
            Of a reading.
        others : sequence of Candidate
            What else is there.
        candidate : Candidate
        """
        usual = candidate.prior.usual(candidate.short_names)
        known = np.isfinite(usual)
        columns = self.space.columns(candidate) * np.where(known, usual, 0.0) * self.space.sizes(candidate)
        across = self.space.base(others).project_out(columns)
        narrower = np.linalg.slogdet(np.eye(len(usual)) + across.T @ across / variance)[1]
        return float(narrower + np.log(self.rows) * (np.sum(~known) + len(candidate.searched)))

    def preference(self, difference: float, explained: float, prior: float) -> float:
        """Return how much dearer another effect is that does nearly the same, in units of chi-square.

        Parameters
        ----------
        difference : float
            By how much chi-square is larger with the other one. What real effects may differ from their formulas by
            does not count.
        explained : float
            By how much the effect lowers chi-square.
        prior : float
            What it costs by what is known before the data and by its parameters, less what the effect does.
        """
        part = SELECTION.imperfect * float(np.sqrt(max(explained, 0.0)))
        counts = max(abs(difference) - part**2 - 2 * part, 0.0)
        return float(np.copysign(counts, difference) + prior)

    def _ordered(self, included: list[Candidate]) -> list[Candidate]:
        """Return the effects in the order in which each lowers the sum of squares most."""
        order: list[Candidate] = []
        rest = list(included)
        while rest:
            nxt = min(rest, key=lambda c: self.left([*order, c]))
            order.append(nxt)
            rest.remove(nxt)
        return order


def _related(one: Candidate, other: Candidate) -> bool:
    """Return whether one may be an imperfection of the other's formula: same place, or both follow temperature."""
    if one.effect.place == other.effect.place:
        return True
    return _is_thermal(one) and _is_thermal(other)


def of_one_leg(candidates: Sequence[Candidate]) -> bool:
    """Return whether all of them are at the same leg of a closed chain."""
    return len({c.effect.place for c in candidates}) == 1 and all(map(_is_of_a_leg, candidates))


def _is_of_a_leg(candidate: Candidate) -> bool:
    return "leg" in candidate.effect.definition.at


def follows_time(candidate: Candidate) -> bool:
    """Return whether an effect changes with time or from run to run, whatever the pose."""
    definition = candidate.effect.definition
    return definition.per_run or "t" in definition.formula.names


def _is_thermal(candidate: Candidate) -> bool:
    return bool(candidate.effect.definition.formula.names & {"T", "t"})
